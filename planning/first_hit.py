"""Which triangle a ray seems to meet first: a proposal in single precision, never a proof."""

from __future__ import annotations

from typing import Final

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from lenscal.arrays import FloatArray, IntArray

#: Rays that are shot at once.
_AT_ONCE: Final = 32_768


class FirstHit:
    """Triangles, ready for rays.

    Embree counts in float32, so all is shifted and scaled to a size of about one. What it says must
    be confirmed in double precision by whoever asks.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners; there may be none.
    centre
        (3,) where coordinates are the most precise, by default the middle of the triangles.
    """

    def __init__(self, triangles: FloatArray, centre: FloatArray | None = None) -> None:
        corners = triangles.reshape(-1, 3)
        self._embree = rtcore_scene.EmbreeScene()
        self._empty = not len(corners)
        if self._empty:
            return
        low, high = corners.min(axis=0), corners.max(axis=0)
        self._centre = (low + high) / 2 if centre is None else centre
        self._scale = 1.0 / float(np.abs(corners - self._centre).max())
        local = ((triangles - self._centre) * self._scale).astype(np.float32)
        TriangleMesh(self._embree, np.ascontiguousarray(local))

    def faces(self, origins: FloatArray, directions: FloatArray) -> IntArray:
        """Follow rays.

        Parameters
        ----------
        origins
            (N, 3) where they start, or (3,) when all start there.
        directions
            (N, 3) of any length.

        Returns
        -------
        IntArray
            (N,) index of the triangle, −1 where none is met.
        """
        count = len(directions)
        met = np.full(count, -1, dtype=np.int64)
        if self._empty:
            return met
        starts = np.zeros((count, 3), np.float32)
        starts += (origins - self._centre) * self._scale
        towards = directions.astype(np.float32)
        for start in range(0, count, _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            met[part] = self._embree.run(starts[part], towards[part])
        return met
