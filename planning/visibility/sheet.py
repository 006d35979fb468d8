"""A polygon with holes as a caller gives it: a sheet without thickness that hides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import manifold3d
import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray, IntArray, frozen_array
from lenscal.errors import GeometryError
from planning.polygons import area_vectors
from planning.target import Target
from planning.visibility.frame import TargetFrame
from planning.visibility.loops import (
    FlatFace,
    axes_across,
    cut_in_front,
    flat_faces,
    surrounds,
)

#: How far the corners may leave their plane, as a share of the size of the polygon.
_PLANAR: Final = 1e-6
#: Of the area of the polygon: rounding.
_AREA: Final = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A planar polygon of material, with holes.

    Parameters
    ----------
    outline_mm
        (N, 3) corners in order, in mm.
    holes_mm
        (M, 3) corners of each hole, in the same plane; one that lies in another is an island, and
        so on.

    Raises
    ------
    GeometryError
        When the polygon has no area or no plane, crosses itself, or holes reach out of it or across
        each other.
    """

    outline_mm: FloatArray
    holes_mm: Sequence[FloatArray] = ()
    #: (3,) unit normal: the outline goes counter-clockwise about it.
    normal: FloatArray = field(init=False)
    #: (V, 3) corners of all loops, exactly in the plane, and (F, 3) triangles of the material.
    vertices_mm: FloatArray = field(init=False)
    triangles: IntArray = field(init=False)

    def __post_init__(self) -> None:
        outline = frozen_array("outline_mm", self.outline_mm, ("N", 3))
        holes = [frozen_array("holes_mm", hole, ("M", 3)) for hole in self.holes_mm]
        _refuse_no_area("the polygon", outline)
        for number, hole in enumerate(holes):
            _refuse_no_area(f"hole {number}", hole)
        normal = area_vectors(outline) / np.linalg.norm(area_vectors(outline))
        corners = np.concatenate([outline, *holes])
        height = (corners - outline[0]) @ normal
        height -= height[: len(outline)].mean()
        size = float(np.ptp(outline, axis=0).max())
        if np.abs(height).max() > _PLANAR * size:
            raise GeometryError(
                f"the polygon and its holes lie in no plane: corners leave it by "
                f"{np.abs(height).max():.3g} mm at a size of {size:.3g} mm; give the corners of "
                "one flat face"
            )
        vertices = corners - height[:, None] * normal
        object.__setattr__(self, "outline_mm", outline)
        object.__setattr__(self, "holes_mm", tuple(holes))
        object.__setattr__(self, "normal", normal)
        object.__setattr__(self, "vertices_mm", vertices)
        lengths = [len(outline), *(len(hole) for hole in holes)]
        object.__setattr__(self, "triangles", _triangulated(vertices, lengths, normal))

    @property
    def triangles_mm(self) -> FloatArray:
        """(F, 3, 3) corners of the triangles of the material in mm."""
        triangles: FloatArray = self.vertices_mm[self.triangles]
        return triangles

    def inside_material(self, points_mm: npt.ArrayLike) -> BoolArray:
        """Tell which points lie inside: none, it has no thickness.

        Parameters
        ----------
        points_mm
            (..., 3) points in mm.

        Returns
        -------
        BoolArray
            (...) false.
        """
        return np.zeros(frozen_array("points_mm", points_mm, ("...", 3)).shape[:-1], dtype=bool)

    def faces_in_front(self, target: Target, frame: TargetFrame) -> list[FlatFace]:
        """Cut the sheet at the plane of a target.

        Parameters
        ----------
        target
            The target; a segment cuts nothing.
        frame
            Its frame; the faces are given in it.

        Returns
        -------
        list of FlatFace
            The pieces in front; islands are pieces of their own.
        """
        vertices, triangles = frame.to_local(self.vertices_mm), self.triangles
        if not target.is_segment:
            vertices[np.abs(vertices[:, 2]) <= frame.tolerance, 2] = 0.0
            vertices, triangles = cut_in_front(vertices, triangles)
        return flat_faces(vertices, triangles)


def _refuse_no_area(name: str, loop: FloatArray) -> None:
    size = float(np.ptp(loop, axis=0).max(initial=0.0)) if len(loop) else 0.0
    area = float(np.linalg.norm(area_vectors(loop))) if len(loop) else 0.0
    if len(loop) < 3 or area <= _AREA * size**2:
        raise GeometryError(
            f"{name} has {len(loop)} corners and an area of {area:.3g} mm²; give three corners or "
            "more that go around it without crossing"
        )


def _triangulated(vertices: FloatArray, lengths: list[int], normal: FloatArray) -> IntArray:
    flat = (vertices - vertices[0]) @ axes_across(normal).T
    starts = np.cumsum([0, *lengths])
    loops = [np.arange(a, b) for a, b in pairwise(starts)]
    areas = np.array([_area(flat[loop]) for loop in loops])
    loops = [loop if area > 0 else loop[::-1] for loop, area in zip(loops, areas, strict=True)]
    scale = float(np.sqrt(np.abs(areas[0])))
    depths = _depths(flat / scale, loops, np.abs(areas))
    turned = [loop if d % 2 == 0 else loop[::-1] for loop, d in zip(loops, depths, strict=True)]
    order = np.concatenate(turned)
    found = np.asarray(manifold3d.triangulate([flat[loop] / scale for loop in turned]))
    triangles: IntArray = order[found.astype(np.int64)]
    wanted = float((np.abs(areas) * np.where(np.array(depths) % 2 == 0, 1.0, -1.0)).sum())
    corners = flat[triangles]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    made = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    off = max(-made.min(initial=0.0), abs(made.sum() - wanted))
    if off > _AREA * scale**2 or 0 in depths[1:]:
        raise GeometryError(
            "the outline of the polygon crosses itself, or a hole reaches out of it or across "
            "another hole; give loops that do not cross, each in the order in which it goes around"
        )
    return triangles


def _depths(flat: FloatArray, loops: list[IntArray], areas: FloatArray) -> list[int]:
    """In how many larger loops each lies, told by a point inside of it."""
    depths = []
    for number, loop in enumerate(loops):
        cut = np.asarray(manifold3d.triangulate([flat[loop]])).astype(np.int64)
        triangles = flat[loop][cut]
        edges = triangles[:, 1:] - triangles[:, :1]
        largest = np.argmax(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
        inside = triangles[largest].mean(axis=0, keepdims=True)
        larger = [other for k, other in enumerate(loops) if areas[k] > areas[number]]
        depths.append(sum(bool(surrounds(flat[other], inside)[0]) for other in larger))
    return depths


def _area(flat: FloatArray) -> float:
    (x, y), (x1, y1) = flat.T, np.roll(flat, -1, axis=0).T
    return float((x * y1 - x1 * y).sum() / 2)
