"""A body of a scene: a closed solid, or bare faces that have no inside."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from lenscal.arrays import BoolArray, FloatArray, IntArray, frozen_array
from lenscal.errors import GeometryError
from planning.crossings import find_crossing
from planning.polygons import convex_quadrilaterals
from planning.solid import Solid
from planning.surface_parts import SurfacePart, surface_parts

#: Pairs of face and corner up to which a body is looked at for being convex.
_AT_A_GLANCE: Final = 20_000
#: How far apart, as a share of the largest coordinate, single precision may put the same corner.
_SINGLE_PRECISION: Final = 2.0**-22


@dataclass(frozen=True, slots=True, eq=False)
class CadFaces:
    """Which face of the CAD model each triangle came from.

    Parameters
    ----------
    of_triangle
        (F,) number of the face.
    kinds
        What surface each face lies on, such as "plane" or "cylinder".
    names
        What the file calls each face; empty strings where it has no name.
    """

    of_triangle: IntArray
    kinds: tuple[str, ...]
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Body(Solid):
    """What stands in a scene, in the frame of the part.

    Parameters
    ----------
    vertices_mm
        (V, 3) corners in mm.
    faces
        (F, 3) indices of the corners of each triangle.
    name
        What people call it.
    is_closed
        Whether the triangles bound a solid and face outwards. If not they are bare faces: they
        hide from both sides, and nothing is inside of them.
    cad
        The CAD faces, where the file knew them.
    """

    name: str = "body"
    is_closed: bool = True
    cad: CadFaces | None = field(default=None)

    @classmethod
    def from_triangles(
        cls,
        name: str,
        vertices_mm: npt.ArrayLike,
        faces: npt.ArrayLike,
        cad: CadFaces | None = None,
        as_faces: bool = False,
    ) -> Body:
        """Make a body of a triangle mesh, and make sure what it is.

        Corners at the same place become one; where the surface is open without that, so do corners
        that only single precision tells apart. Nothing is filled or turned.

        Parameters
        ----------
        name
            What people call it; it opens the error message.
        vertices_mm
            (V, 3) corners in mm.
        faces
            (F, 3) indices.
        cad
            The CAD faces of the triangles.
        as_faces
            Take a mesh that is no solid as bare faces instead of refusing it.

        Returns
        -------
        Body
            The body.

        Raises
        ------
        GeometryError
            When the mesh is empty, or, unless bare faces were asked for, open, inside out, flat, or
            crossing itself.
        """
        given = np.asarray(vertices_mm, dtype=np.float64).reshape(-1, 3)
        corners = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
        if not len(given) or not len(corners):
            raise GeometryError(f"{name} is empty: it has no faces; export it again")
        if not np.isfinite(given).all():
            raise GeometryError(
                f"{name} has a corner that is not finite, vertex "
                f"{int(np.argmin(np.isfinite(given).all(axis=1)))}; export it again"
            )
        vertices, corners, kept = _welded(given, corners)
        if not _is_balanced(corners):
            vertices, corners, kept_too = _welded(*_snapped(vertices, corners))
            kept = kept[kept_too]
        if cad is not None:
            cad = CadFaces(cad.of_triangle[kept], cad.kinds, cad.names)
        try:
            Solid.closed(name, vertices, corners)
            _refuse_crossing(name, vertices, corners)
        except GeometryError as error:
            if not len(corners):
                raise
            if not as_faces:
                raise GeometryError(
                    f"{error}, or have it taken as bare faces (as_faces=True, --as-faces)"
                ) from error
            return cls(vertices, corners, name, False, cad)
        return cls(vertices, corners, name, True, cad)

    @property
    def volume_mm3(self) -> float:
        """Volume in mm³; bare faces have none."""
        return Solid.volume_mm3.fget(self) if self.is_closed else 0.0  # type: ignore[attr-defined]

    @cached_property
    def parts(self) -> tuple[SurfacePart, ...]:
        """Its surface in convex bodies and polygons, found when first asked for, and kept."""
        return surface_parts(self, self.is_closed)

    @cached_property
    def convex_faces_mm(self) -> FloatArray:
        """(Q, 4, 3) corners of convex quadrilaterals that cover its surface; some are triangles."""
        return convex_quadrilaterals(self.vertices_mm, self.faces)

    def contains(self, points_mm: npt.ArrayLike) -> BoolArray:
        """Tell which points lie inside.

        Parameters
        ----------
        points_mm
            (..., 3) points in mm.

        Returns
        -------
        BoolArray
            (...). On the surface itself either answer may come; nothing is inside of bare faces.
        """
        if self.is_closed:
            return Solid.contains(self, points_mm)
        points = frozen_array("points_mm", points_mm, ("...", 3))
        return np.zeros(points.shape[:-1], dtype=bool)


def _welded(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Corners at exactly the same place become one; faces without three corners go."""
    unique, same = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    corners = same.reshape(-1)[faces]
    kept = np.flatnonzero((corners != np.roll(corners, 1, axis=1)).all(axis=1))
    return unique, corners[kept], kept


def _snapped(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Corners that only rounding to single precision tells apart come to the same place."""
    distance = _SINGLE_PRECISION * float(np.abs(vertices).max())
    near = KDTree(vertices).query_pairs(distance, output_type="ndarray")
    count = len(vertices)
    graph = coo_array((np.ones(len(near)), near.T), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    return vertices[first[label]], faces


def _is_balanced(faces: IntArray) -> bool:
    """Whether as many edges run one way as the other between any two corners."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    count = int(faces.max(initial=0)) + 1
    along = np.sort(edges[:, 0] * count + edges[:, 1])
    return bool(np.array_equal(along, np.sort(edges[:, 1] * count + edges[:, 0])))


def _is_convex(vertices: FloatArray, faces: IntArray) -> bool:
    """Whether a small closed surface is seen at a glance to be convex, so that it cannot cross."""
    if len(faces) * len(vertices) > _AT_A_GLANCE or 2 * len(vertices) != len(faces) + 4:
        return False
    a, b, c = (vertices[faces[:, k]] - vertices[0] for k in range(3))
    normals = np.cross(b - a, c - a)
    heights = normals @ (vertices - vertices[0]).T - np.einsum("fi,fi->f", normals, a)[:, None]
    size = float(np.abs(vertices - vertices[0]).max())
    return bool((heights <= 1e-12 * size**3).all())


def _refuse_crossing(name: str, vertices: FloatArray, faces: IntArray) -> None:
    if _is_convex(vertices, faces):
        return
    crossing = find_crossing(vertices, faces)
    if crossing is not None:
        x, y, z = crossing.place
        raise GeometryError(
            f"{name} crosses itself at ({x:g}, {y:g}, {z:g}) mm, where two of its faces go through "
            "each other; unite what overlaps in the CAD program, make it bodies of their own"
        )
