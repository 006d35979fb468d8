"""Where in the (zoom, focus) plane samples support a map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from lenscal.arrays import BoolArray, FloatArray, frozen_array

#: Share of the sampled range by which a setting may lie outside, to allow for rounding.
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Domain:
    """The convex hull of the sampled settings.

    Parameters
    ----------
    corners
        (V, 2) its corners (zoom, focus) in order; two for samples on a line, one for a single one.
    """

    corners: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", frozen_array("corners", self.corners, ("V", 2)))

    @classmethod
    def around(cls, zoom: FloatArray, focus: FloatArray) -> Domain:
        """Draw the hull of samples.

        Parameters
        ----------
        zoom, focus
            (N,) sampled settings.

        Returns
        -------
        Domain
            The smallest convex domain that holds them all.
        """
        points = np.unique(np.stack([zoom, focus], axis=-1), axis=0)
        span = np.ptp(points, axis=0)
        scaled = (points - points.min(axis=0)) / np.where(span > 0, span, 1.0)
        flat = np.linalg.svd(scaled - scaled.mean(axis=0), compute_uv=False)
        if len(points) < 3 or flat[-1] < 1e-9 * flat[0]:
            return cls(np.unique(points[[0, -1]], axis=0))
        return cls(points[ConvexHull(scaled).vertices])

    @property
    def zoom(self) -> tuple[float, float]:
        """Lowest and highest zoom anywhere in the domain."""
        return float(self.corners[:, 0].min()), float(self.corners[:, 0].max())

    @property
    def focus(self) -> tuple[float, float]:
        """Lowest and highest focus anywhere in the domain."""
        return float(self.corners[:, 1].min()), float(self.corners[:, 1].max())

    def contains(self, zoom: npt.ArrayLike, focus: npt.ArrayLike) -> BoolArray:
        """Tell which settings are supported.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.

        Returns
        -------
        BoolArray
            True inside and on the border, False outside and for NaN.
        """
        zooms, focuses = np.broadcast_arrays(
            np.asarray(zoom, dtype=np.float64), np.asarray(focus, dtype=np.float64)
        )
        low = self.corners.min(axis=0)
        span = np.ptp(self.corners, axis=0)
        scale = np.where(span > 0, span, np.maximum(1.0, np.abs(low)))
        points = (np.stack([zooms, focuses], axis=-1) - low) / scale
        corners = (self.corners - low) / scale
        inside: BoolArray = (
            (points >= corners.min(axis=0) - _ROUNDING)
            & (points <= corners.max(axis=0) + _ROUNDING)
        ).all(axis=-1)
        if len(corners) == 1:
            return inside
        edges = np.roll(corners, -1, axis=0) - corners
        for corner, edge in zip(corners, edges, strict=True):
            offset = points - corner
            inside &= edge[0] * offset[..., 1] - edge[1] * offset[..., 0] >= -_ROUNDING
        return inside

    def grid(self, count: int = 101) -> tuple[FloatArray, FloatArray]:
        """Lay a regular grid over the domain's bounding rectangle.

        Parameters
        ----------
        count
            Points along an axis that has an extent; an axis without one gets a single point.

        Returns
        -------
        zoom, focus : FloatArray
            (n_focus, n_zoom) each: focus along rows, zoom along columns; some may lie outside.
        """
        axes = [
            np.linspace(low, high, count if high > low else 1)
            for low, high in (self.zoom, self.focus)
        ]
        zoom, focus = np.meshgrid(*axes)
        return zoom, focus

    def __str__(self) -> str:
        (z0, z1), (f0, f1) = self.zoom, self.focus
        return f"zoom {z0:g} to {z1:g} and focus {f0:g} to {f1:g}"
