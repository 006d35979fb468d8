"""What is to be seen: a planar polygon, with or without holes, or a segment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from itertools import pairwise
from typing import Final

import manifold3d
import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.errors import GeometryError, InputError
from planning.picking import face_called, face_near
from planning.polygons import area_vectors, merge_convex
from planning.scene import Scene

#: How far the vertices may leave their plane, as a share of the size of the polygon. Meshes in
#: single precision are off by about a tenth of this.
_FLAT: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A planar polygon that is to be seen whole; two vertices make a segment, which has no plane.

    Parameters
    ----------
    vertices_mm
        (N, 3) corners in mm, counter-clockwise seen from the side that is to be seen. The corners
        of the holes are put behind them.
    holes
        (M, 3) corners of each hole in mm, in either order. What lies in a hole need not be seen.

    Raises
    ------
    GeometryError
        When there are fewer than two vertices, the area is zero, the vertices lie in no plane, or
        outlines cross.
    """

    vertices_mm: FloatArray
    holes: InitVar[Sequence[npt.ArrayLike]] = ()
    #: Outline and holes, as indices of their corners: the holes run clockwise.
    loops: tuple[IntArray, ...] = field(init=False)
    #: Corners of its convex pieces, as indices: one piece when the target is convex.
    pieces: tuple[IntArray, ...] = field(init=False)

    def __post_init__(self, holes: Sequence[npt.ArrayLike]) -> None:
        outline = frozen_array("vertices_mm", self.vertices_mm, ("N", 3))
        if len(outline) < 2:
            raise GeometryError(
                f"a target needs two vertices (a segment) or more, but has {len(outline)}"
            )
        if len(outline) == 2 and len(holes):
            raise GeometryError("a segment has no holes; give the outline three vertices or more")
        inner = [frozen_array("a hole", hole, ("M", 3)) for hole in holes]
        up = area_vectors(outline)
        inner = [h if area_vectors(h) @ up < 0 else h[::-1] for h in inner]
        starts = np.cumsum([0, len(outline), *map(len, inner)])
        loops = tuple(np.arange(a, b) for a, b in pairwise(starts))
        vertices = frozen_array("vertices_mm", np.concatenate([outline, *inner]), ("N", 3))
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "loops", loops)
        object.__setattr__(self, "pieces", self._checked_pieces())

    @classmethod
    def segment(cls, a_mm: npt.ArrayLike, b_mm: npt.ArrayLike) -> Target:
        """Make a segment, such as a feature to be resolved.

        Parameters
        ----------
        a_mm, b_mm
            (3,) its ends in mm.

        Returns
        -------
        Target
            The segment.
        """
        return cls(np.stack([frozen_array("a_mm", a_mm, (3,)), frozen_array("b_mm", b_mm, (3,))]))

    @classmethod
    def polyline(cls, points_mm: npt.ArrayLike) -> tuple[Target, ...]:
        """Make the segments of a line with corners, such as a seam or an edge.

        Parameters
        ----------
        points_mm
            (N, 3) its corners in mm.

        Returns
        -------
        tuple of Target
            Its segments. The region of the whole line is what their regions share.

        Raises
        ------
        GeometryError
            When there are fewer than two points, or neighbours are the same.
        """
        points = frozen_array("points_mm", points_mm, ("N", 3))
        if len(points) < 2:
            raise GeometryError(f"a polyline needs two points or more, but has {len(points)}")
        return tuple(cls.segment(a, b) for a, b in pairwise(points))

    @classmethod
    def from_face(
        cls,
        scene: Scene,
        near: npt.ArrayLike | None = None,
        *,
        face: int | str | None = None,
        body: str | None = None,
        fill_holes: bool = False,
    ) -> Target:
        """Pick a flat face of a part: the one nearest to a point, or one that the CAD file knows.

        Parameters
        ----------
        scene
            The part.
        near
            (3,) a point in mm. Where it is equally near to several faces, the first counts.
        face
            Number or name of a face, for parts read from STEP.
        body
            The body that the face belongs to; None to look in all of them.
        fill_holes
            Whether the holes of the face count as if they were part of it. The region then errs on
            the safe side, and is computed much faster where holes are round.

        Returns
        -------
        Target
            The face.

        Raises
        ------
        GeometryError
            When there is no such face, or it is curved.
        InputError
            When neither point nor face is given, or both.
        """
        if (near is None) == (face is None):
            raise InputError("a face is picked either by a point near it or by its name or number")
        if face is not None:
            picked = face_called(scene, face, body)
        else:
            picked = face_near(scene, np.asarray(near), body)
        return cls(picked.outline_mm, () if fill_holes else picked.holes_mm)

    @property
    def is_segment(self) -> bool:
        """Whether it has two vertices, thus no plane and no front."""
        return len(self.vertices_mm) == 2

    @property
    def outline_mm(self) -> FloatArray:
        """(N, 3) corners of the outline in mm, without those of holes."""
        corners: FloatArray = self.vertices_mm[self.loops[0]]
        return corners

    @property
    def is_convex(self) -> bool:
        """Whether it is one convex piece."""
        return len(self.pieces) == 1

    @property
    def normal(self) -> FloatArray:
        """(3,) unit normal of the side to be seen.

        Raises
        ------
        GeometryError
            For a segment.
        """
        if self.is_segment:
            raise GeometryError(
                "a segment has no normal; give three vertices or more where one is needed"
            )
        vector = area_vectors(self.outline_mm)
        unit: FloatArray = vector / np.linalg.norm(vector)
        return unit

    @property
    def centroid_mm(self) -> FloatArray:
        """(3,) centre of the area in mm; of a segment, its midpoint."""
        if self.is_segment:
            middle: FloatArray = self.vertices_mm.mean(axis=0)
            return middle
        first, normal = self.vertices_mm[0], self.normal
        area, moment = 0.0, np.zeros(3)
        for loop in self.loops:
            corner, following = self.vertices_mm[np.stack([loop, np.roll(loop, -1)])] - first
            areas = np.cross(corner, following) @ normal / 2
            area, moment = area + areas.sum(), moment + areas @ (corner + following) / 3
        centre: FloatArray = first + moment / area
        return centre

    @property
    def area_mm2(self) -> float:
        """Area in mm², that of the holes not counted; zero for a segment."""
        if self.is_segment:
            return 0.0
        vectors = [area_vectors(self.vertices_mm[loop]) for loop in self.loops]
        return float(np.linalg.norm(np.sum(vectors, axis=0)))

    @property
    def size_mm(self) -> float:
        """Largest distance between two vertices in mm."""
        difference = self.vertices_mm[:, None] - self.vertices_mm
        return float(np.linalg.norm(difference, axis=-1).max())

    @property
    def flatness_mm(self) -> float:
        """How far the vertices leave the plane in mm."""
        if self.is_segment:
            return 0.0
        return float(np.abs((self.vertices_mm - self.centroid_mm) @ self.normal).max())

    def _checked_pieces(self) -> tuple[IntArray, ...]:
        size = self.size_mm
        if self.is_segment:
            if size == 0:
                raise GeometryError("the ends of a segment must differ, but are the same point")
            return (np.arange(2),)
        if self.area_mm2 <= 1e-9 * size**2:
            raise GeometryError(
                f"the target has no area ({self.area_mm2:.3g} mm² at a size of {size:.3g} mm); its "
                "vertices must go around a polygon that does not cross itself"
            )
        if self.flatness_mm > _FLAT * size:
            raise GeometryError(
                f"the target is not planar: its vertices leave the plane by {self.flatness_mm:.3g} "
                f"mm at a size of {size:.3g} mm; give the vertices of one flat face"
            )
        return _convex_pieces(self.vertices_mm, self.loops, self.normal, self.area_mm2)


def _convex_pieces(
    vertices: FloatArray, loops: Sequence[IntArray], normal: FloatArray, area: float
) -> tuple[IntArray, ...]:
    """Triangulate and merge again while the pieces stay convex."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    flat = (vertices - vertices[0]) @ np.stack([across, np.cross(normal, across)], axis=-1)
    polygons = [flat[loop] / np.sqrt(area) for loop in loops]
    triangles = np.asarray(manifold3d.triangulate(polygons)).astype(np.int64)
    corners = flat[triangles]
    edges = corners[:, 1:] - corners[:, :1]
    areas = (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]) / 2
    if areas.min(initial=0.0) < -1e-9 * area or abs(areas.sum() - area) > 1e-9 * area:
        raise GeometryError(
            "the outline of the target crosses itself"
            + (" or that of a hole, or a hole lies outside of it" if len(loops) > 1 else "")
            + "; give its vertices in the order in which they go around it"
        )
    return tuple(merge_convex(vertices, triangles))
