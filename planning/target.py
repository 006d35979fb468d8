"""What is to be seen: a planar polygon, or a segment."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import manifold3d
import numpy as np
import numpy.typing as npt
import trimesh

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.errors import GeometryError
from planning.polygons import merge_convex
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
        (N, 3) corners in mm, counter-clockwise seen from the side that is to be seen.

    Raises
    ------
    GeometryError
        When there are fewer than two vertices, the area is zero, the vertices lie in no plane, or
        the outline crosses itself.
    """

    vertices_mm: FloatArray
    #: Corners of its convex pieces, as indices: one piece when the target is convex.
    pieces: tuple[IntArray, ...] = field(init=False)

    def __post_init__(self) -> None:
        vertices = frozen_array("vertices_mm", self.vertices_mm, ("N", 3))
        if len(vertices) < 2:
            raise GeometryError(
                f"a target needs two vertices (a segment) or more, but has {len(vertices)}"
            )
        object.__setattr__(self, "vertices_mm", vertices)
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
    def from_face(cls, scene: Scene, near: npt.ArrayLike) -> Target:
        """Pick the flat face of a part that is nearest to a point.

        Parameters
        ----------
        scene
            The part.
        near
            (3,) a point in mm. Where it is equally near to several faces, the first counts.

        Returns
        -------
        Target
            The outline of all triangles that lie in one plane and hang together.

        Raises
        ------
        GeometryError
            When the face has a hole.
        """
        point = frozen_array("near", near, (3,))
        distances = [
            np.linalg.norm(
                trimesh.triangles.closest_point(
                    body.triangles_mm, np.tile(point, (len(body.faces), 1))
                )
                - point,
                axis=-1,
            )
            for body in scene.bodies
        ]
        which = int(np.argmin([d.min() for d in distances]))
        mesh = scene.bodies[which].to_mesh()
        loops = _outline(mesh, int(np.argmin(distances[which])))
        if len(loops) > 1:
            raise GeometryError(
                f"the face of {scene.names[which]} nearest to {point.tolist()} mm has "
                f"{len(loops) - 1} holes; give the target by its vertices, as the outline of the "
                "piece that must be seen"
            )
        return cls(_without_straight_corners(mesh.vertices[loops[0]]))

    @property
    def is_segment(self) -> bool:
        """Whether it has two vertices, thus no plane and no front."""
        return len(self.vertices_mm) == 2

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
        vector = _area_vector(self.vertices_mm)
        unit: FloatArray = vector / np.linalg.norm(vector)
        return unit

    @property
    def centroid_mm(self) -> FloatArray:
        """(3,) centre of the area in mm; of a segment, its midpoint."""
        if self.is_segment:
            middle: FloatArray = self.vertices_mm.mean(axis=0)
            return middle
        first = self.vertices_mm[0]
        fan = self.vertices_mm[1:] - first
        areas = np.cross(fan[:-1], fan[1:]) @ self.normal / 2
        centre: FloatArray = first + areas @ (fan[:-1] + fan[1:]) / 3 / areas.sum()
        return centre

    @property
    def area_mm2(self) -> float:
        """Area in mm²; zero for a segment."""
        return 0.0 if self.is_segment else float(np.linalg.norm(_area_vector(self.vertices_mm)))

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
        return _convex_pieces(self.vertices_mm, self.normal, self.area_mm2)


def _area_vector(vertices: FloatArray) -> FloatArray:
    """Newell's sum: the normal times the area, whatever the shape."""
    local = vertices - vertices[0]
    vector: FloatArray = np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0) / 2
    return vector


def _convex_pieces(vertices: FloatArray, normal: FloatArray, area: float) -> tuple[IntArray, ...]:
    """Triangulate and merge again while the pieces stay convex."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    flat = (vertices - vertices[0]) @ np.stack([across, np.cross(normal, across)], axis=-1)
    triangles = np.asarray(manifold3d.triangulate([flat / np.sqrt(area)])).astype(np.int64)
    corners = flat[triangles]
    edges = corners[:, 1:] - corners[:, :1]
    areas = (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]) / 2
    if areas.min(initial=0.0) < -1e-9 * area or abs(areas.sum() - area) > 1e-9 * area:
        raise GeometryError(
            "the outline of the target crosses itself; give its vertices in the order in which "
            "they go around it"
        )
    return tuple(merge_convex(vertices, triangles))


def _outline(mesh: trimesh.Trimesh, seed: int) -> list[IntArray]:
    """Loops around the triangles that are coplanar with one of them and connected to it."""
    corner, normal = mesh.triangles[seed, 0], mesh.face_normals[seed]
    size = float(np.ptp(mesh.vertices, axis=0).max())
    in_plane = (np.abs((mesh.triangles - corner) @ normal) <= 1e-7 * size).all(axis=1)
    pairs = mesh.face_adjacency[in_plane[mesh.face_adjacency].all(axis=1)]
    facet = next(
        group
        for group in trimesh.graph.connected_components(pairs, nodes=np.flatnonzero(in_plane))
        if seed in group
    )
    faces = mesh.faces[facet]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    inner = {(int(a), int(b)) for a, b in edges}
    following = {int(a): int(b) for a, b in edges if (int(b), int(a)) not in inner}
    loops = []
    while following:
        loop = [next(iter(following))]
        while loop[-1] in following:
            loop.append(following.pop(loop[-1]))
        loops.append(np.array(loop[:-1]))
    return loops


def _without_straight_corners(loop: FloatArray) -> FloatArray:
    before, after = loop - np.roll(loop, 1, axis=0), np.roll(loop, -1, axis=0) - loop
    turn = np.linalg.norm(np.cross(before, after), axis=-1)
    straight = turn <= 1e-9 * np.linalg.norm(before, axis=-1) * np.linalg.norm(after, axis=-1)
    kept: FloatArray = loop[~straight]
    return kept
