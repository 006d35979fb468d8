"""The convex hull of a mesh as a piece of a camera body: how near it comes, how far it goes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import trimesh

from lenscal.arrays import FloatArray
from lenscal.errors import InputError
from planning.solid import Solid

#: Normals that differ by less are the same.
_SAME: Final = 1e-9
#: Pairs of point and face of a hull that are worked on at once.
_PAIRS_AT_ONCE: Final = 200_000


@dataclass(frozen=True, eq=False)
class Hull:
    """The convex hull of a mesh, such as a camera housing from CAD.

    Parameters
    ----------
    mesh
        A closed solid in mm, in the frame of the reference camera.

    Raises
    ------
    InputError
        When the mesh is empty.
    """

    mesh: Solid

    def __post_init__(self) -> None:
        if self.mesh.is_empty:
            raise InputError("a camera body needs a mesh with faces, but it is empty")

    @cached_property
    def _hull(self) -> trimesh.Trimesh:
        return self.mesh.to_mesh().convex_hull

    @cached_property
    def centre_mm(self) -> FloatArray:
        """(3,) a point inside."""
        return np.asarray(self._hull.vertices.mean(axis=0))

    @cached_property
    def extent_mm(self) -> tuple[float, float, float]:
        """Lowest and highest z, and largest distance from the z axis, of what holds it."""
        corners = np.asarray(self._hull.vertices)
        away = float(np.linalg.norm(corners[:, :2], axis=1).max())
        return float(corners[:, 2].min()), float(corners[:, 2].max()), away

    def support_mm(self, directions: FloatArray) -> FloatArray:
        """Give how far it reaches in directions.

        Parameters
        ----------
        directions
            (3, K) unit vectors.

        Returns
        -------
        FloatArray
            (K,) the largest u · p over its points p.
        """
        reach: FloatArray = (np.asarray(self._hull.vertices) @ directions).max(axis=0)
        return reach

    def farthest_mm(self, directions: FloatArray) -> FloatArray:
        """Give the point that reaches farthest in directions.

        Parameters
        ----------
        directions
            (3, K) unit vectors.

        Returns
        -------
        FloatArray
            (3, K) in mm; one of them where there are several.
        """
        vertices = np.asarray(self._hull.vertices)
        return np.asarray(vertices[(vertices @ directions).argmax(axis=0)].T)

    def nearest_mm(self, points_mm: FloatArray) -> FloatArray:
        """Give the nearest of its points, which is the point itself inside.

        Parameters
        ----------
        points_mm
            (3, K) in mm.

        Returns
        -------
        FloatArray
            (3, K) in mm.
        """
        nearest = np.array(points_mm)
        outside = np.flatnonzero((self._normals @ points_mm > self._offsets[:, None]).any(axis=0))
        faces = np.asarray(self._hull.triangles)
        step = max(1, _PAIRS_AT_ONCE // len(faces))
        for start in range(0, len(outside), step):
            part = outside[start : start + step]
            points = points_mm[:, part].T
            pairs = trimesh.triangles.closest_point(
                np.tile(faces, (len(points), 1, 1)), np.repeat(points, len(faces), axis=0)
            ).reshape(len(points), len(faces), 3)
            best = np.linalg.norm(pairs - points[:, None], axis=-1).argmin(axis=1)
            nearest[:, part] = pairs[np.arange(len(points)), best].T
        return nearest

    def distance_mm(self, points_mm: FloatArray) -> FloatArray:
        """Measure how far points are from it.

        Parameters
        ----------
        points_mm
            (3, K) in mm.

        Returns
        -------
        FloatArray
            (K,) in mm, zero inside.
        """
        distance: FloatArray = np.linalg.norm(points_mm - self.nearest_mm(points_mm), axis=0)
        return distance

    def directions_towards(self, corners_mm: FloatArray) -> list[FloatArray]:
        """Suggest directions in which it may be parted from faces: its own normals.

        The opposite directions are covered as well.

        Parameters
        ----------
        corners_mm
            (C, 3, K) corners of convex faces in mm.

        Returns
        -------
        list of FloatArray
            (3, K) unit vectors each.
        """
        shape = corners_mm.shape[1:]
        kept: list[FloatArray] = []
        for normal in self._normals:
            if not any(np.abs(normal + other).max() < _SAME for other in kept):
                kept.append(normal)
        return [np.broadcast_to(normal[:, None], shape) for normal in kept]

    def points_near(self, corners_mm: FloatArray) -> list[FloatArray]:  # noqa: ARG002
        """Suggest points of faces that may be the nearest, besides their corners.

        Parameters
        ----------
        corners_mm
            (C, 3, K) corners of convex faces in mm.

        Returns
        -------
        list of FloatArray
            None: all is found by projecting.
        """
        return []

    @cached_property
    def _normals(self) -> FloatArray:
        return np.unique(np.asarray(self._hull.face_normals).round(12), axis=0)

    @cached_property
    def _offsets(self) -> FloatArray:
        return np.asarray((np.asarray(self._hull.vertices) @ self._normals.T).max(axis=0))
