"""Closed solids as plain arrays: volume, membership and distance, all in double precision.

What makes membership and distance fast is prepared when first asked for, and kept.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import trimesh

from lenscal.arrays import BoolArray, FloatArray, IntArray, frozen_array
from lenscal.errors import GeometryError
from planning.membership import Membership
from planning.nearest import NearestSurface


@dataclass(frozen=True, eq=False)
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

    @cached_property
    def triangles_mm(self) -> FloatArray:
        """(F, 3, 3) corners of each face in mm."""
        triangles: FloatArray = self.vertices_mm[self.faces]
        triangles.setflags(write=False)
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
        if self.is_empty:
            return np.zeros(points.shape[:-1], dtype=bool)
        return self._membership.contains(points.reshape(-1, 3)).reshape(points.shape[:-1])

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
        if self.is_empty:
            return np.full(points.shape[:-1], np.inf)
        return self._surface.distance(points.reshape(-1, 3)).reshape(points.shape[:-1])

    @cached_property
    def _membership(self) -> Membership:
        return Membership(self.triangles_mm)

    @cached_property
    def _surface(self) -> NearestSurface:
        return NearestSurface(self.triangles_mm)

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
