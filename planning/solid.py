"""Closed solids as plain arrays: volume, membership and distance in float64, without any library.

Membership is by the winding number (the solid angle that the surface subtends, over 4π), which has
no special cases: no ray that grazes an edge, no direction to choose.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh

from lenscal.arrays import BoolArray, FloatArray, IntArray, frozen_array
from lenscal.errors import GeometryError

#: Pairs of point and triangle that are worked on at once, so that they stay in the cache.
_PAIRS_AT_ONCE: Final = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A volume bounded by triangles that face outwards.

    Parameters
    ----------
    vertices_mm
        (V, 3) corners in mm.
    faces
        (F, 3) indices of the corners of each triangle, counter-clockwise seen from outside.

    Raises
    ------
    GeometryError
        When a face names a vertex that does not exist.
    """

    vertices_mm: FloatArray
    faces: IntArray

    def __post_init__(self) -> None:
        vertices = frozen_array("vertices_mm", self.vertices_mm, ("V", 3))
        faces = np.array(self.faces, dtype=np.int64).reshape(-1, 3)
        if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
            raise GeometryError(
                f"a face names vertex {int(faces.max())}, but there are {len(vertices)} vertices"
            )
        faces.setflags(write=False)
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "faces", faces)

    @classmethod
    def closed(cls, name: str, vertices_mm: npt.ArrayLike, faces: npt.ArrayLike) -> Solid:
        """Make a solid of a triangle mesh and make sure that it is one.

        Vertices at exactly the same place become one; nothing is closed, filled or turned.

        Parameters
        ----------
        name
            What the caller calls the mesh; it opens the error message.
        vertices_mm
            (V, 3) corners in mm.
        faces
            (F, 3) indices.

        Returns
        -------
        Solid
            The solid.

        Raises
        ------
        GeometryError
            When the mesh is empty, open, flat or inside out.
        """
        given = np.asarray(vertices_mm, dtype=np.float64).reshape(-1, 3)
        corners = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
        if not len(given) or not len(corners):
            raise GeometryError(f"{name} is empty: it has no faces; export it again")
        vertices, same = np.unique(given, axis=0, return_inverse=True)
        corners = same.reshape(-1)[corners]
        corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
        _refuse_open(name, vertices, corners)
        solid = cls(vertices, corners)
        extent = np.ptp(vertices, axis=0)
        if solid.volume_mm3 < -1e-12 * float(np.max(extent)) ** 3:
            raise GeometryError(
                f"{name} is inside out: its faces point inwards; turn them around in the CAD "
                "program"
            )
        if solid.volume_mm3 <= 1e-12 * float(np.max(extent)) ** 3:
            raise GeometryError(f"{name} is flat: it encloses no volume; give a solid body")
        return solid

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing at all."""
        return len(self.faces) == 0

    @property
    def triangles_mm(self) -> FloatArray:
        """(F, 3, 3) corners of each face in mm."""
        triangles: FloatArray = self.vertices_mm[self.faces]
        return triangles

    @property
    def volume_mm3(self) -> float:
        """Volume in mm³."""
        if self.is_empty:
            return 0.0
        # Measured from a corner of its own, so that a solid far from the origin loses no digits.
        a, b, c = np.moveaxis(self.triangles_mm - self.vertices_mm[0], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @property
    def bounds_mm(self) -> FloatArray:
        """(2, 3) lowest and highest corner in mm; NaN when it is empty."""
        if self.is_empty:
            return np.full((2, 3), np.nan)
        used = self.vertices_mm[np.unique(self.faces)]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    @property
    def digest(self) -> str:
        """SHA-256 of its vertices and faces, in hexadecimal."""
        content = np.ascontiguousarray(self.vertices_mm).tobytes()
        return hashlib.sha256(content + np.ascontiguousarray(self.faces).tobytes()).hexdigest()

    def contains(self, points_mm: npt.ArrayLike) -> BoolArray:
        """Tell which points lie inside.

        Parameters
        ----------
        points_mm
            (..., 3) points in mm.

        Returns
        -------
        BoolArray
            (...). On the surface itself either answer may come.
        """
        points = frozen_array("points_mm", points_mm, ("...", 3))
        flat = points.reshape(-1, 3)
        inside = np.zeros(len(flat), dtype=bool)
        if not self.is_empty and len(flat):
            low, high = self.bounds_mm
            near = np.flatnonzero(((flat >= low) & (flat <= high)).all(axis=1))
            inside[near] = winding_number(flat[near], self.triangles_mm) > 0.5
        return inside.reshape(points.shape[:-1])

    def distance_to_surface_mm(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Measure how far points are from the surface.

        Parameters
        ----------
        points_mm
            (..., 3) points in mm.

        Returns
        -------
        FloatArray
            (...) unsigned distance in mm; infinite when the solid is empty.
        """
        points = frozen_array("points_mm", points_mm, ("...", 3))
        flat = points.reshape(-1, 3)
        distance = np.full(len(flat), np.inf)
        if not self.is_empty:
            triangles = self.triangles_mm
            for part in _parts(len(flat), len(triangles)):
                count = len(flat[part])
                nearest = trimesh.triangles.closest_point(
                    np.tile(triangles, (count, 1, 1)), np.repeat(flat[part], len(triangles), axis=0)
                ).reshape(count, -1, 3)
                distance[part] = np.linalg.norm(nearest - flat[part][:, None], axis=-1).min(axis=1)
        return distance.reshape(points.shape[:-1])

    def to_mesh(self) -> trimesh.Trimesh:
        """Hand the solid over to trimesh.

        Returns
        -------
        trimesh.Trimesh
            A copy in mm.
        """
        return trimesh.Trimesh(self.vertices_mm.copy(), self.faces.copy(), process=False)


def box_workspace(low_mm: npt.ArrayLike, high_mm: npt.ArrayLike) -> Solid:
    """Make a workspace that is a box along the axes of the part.

    Parameters
    ----------
    low_mm, high_mm
        (3,) opposite corners in mm.

    Returns
    -------
    Solid
        The box.

    Raises
    ------
    GeometryError
        When the low corner is not below the high one.
    """
    low, high = frozen_array("low_mm", low_mm, (3,)), frozen_array("high_mm", high_mm, (3,))
    if not (low < high).all():
        raise GeometryError(
            f"a box needs its low corner below its high one along x, y and z, but they are "
            f"{low.tolist()} and {high.tolist()} mm"
        )
    unit = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
    return Solid(np.where(unit.vertices > 0.5, high, low), unit.faces)


def winding_number(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Count how often a closed surface goes around each point.

    Source: A. van Oosterom and J. Strackee, "The solid angle of a plane triangle" (1983).

    Parameters
    ----------
    points
        (N, 3) points.
    triangles
        (F, 3, 3) triangles of closed surfaces.

    Returns
    -------
    FloatArray
        (N,) 1 inside, 0 outside, to rounding.
    """
    turns = np.zeros(len(points))
    for part in _parts(len(points), len(triangles)):
        a, b, c = (triangles[:, k] - points[part][:, None] for k in range(3))
        length_a, length_b, length_c = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
        numerator = np.einsum("...i,...i", a, np.cross(b, c))
        denominator = (
            length_a * length_b * length_c
            + np.einsum("...i,...i", a, b) * length_c
            + np.einsum("...i,...i", b, c) * length_a
            + np.einsum("...i,...i", c, a) * length_b
        )
        turns[part] = np.arctan2(numerator, denominator).sum(axis=-1) / (2 * np.pi)
    return turns


def _parts(points: int, triangles: int) -> list[slice]:
    step = max(1, _PAIRS_AT_ONCE // max(1, triangles))
    return [slice(start, start + step) for start in range(0, points, step)]


def _refuse_open(name: str, vertices: FloatArray, faces: IntArray) -> None:
    """Every directed edge of a closed surface is met by as many that run the other way."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    undirected, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    balance = np.zeros(len(undirected), dtype=np.int64)
    np.add.at(balance, which.reshape(-1), np.where(edges[:, 0] < edges[:, 1], 1, -1))
    unmatched = np.flatnonzero(balance)
    if len(unmatched):
        x, y, z = vertices[undirected[unmatched[0]]].mean(axis=0)
        raise GeometryError(
            f"{name} is no closed solid: {len(unmatched)} of its {len(undirected)} edges are open "
            f"or turned against their neighbour, one of them at ({x:g}, {y:g}, {z:g}) mm; close it "
            "in the CAD program and export it again"
        )
