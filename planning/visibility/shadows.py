"""Shadows: where a convex piece stands between the viewpoint and some point of a convex target.

The shadow of a piece B of a target T is B + cone(B − T): every b moved away from every t. It is
convex, and it is bounded by the limiting separating planes of the paper (section 1.2.1.3): planes
through an edge of one and a corner of the other, or along a face of B, with T on one side and B on
the other. They are found as such, and the workspace is cut by them, so nothing has to be placed
"far away": the shadow is right at any distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import manifold3d
import numpy as np
from manifold3d import Manifold
from scipy.spatial import ConvexHull

from lenscal.arrays import FloatArray, IntArray
from planning.boolean import Cutter, from_manifold, trimmed
from planning.visibility.convex import ConvexPiece, ConvexPieces
from planning.visibility.perspective import Perspective

#: An edge and a corner span a plane when the sine of their angle exceeds this.
_COLLINEAR: Final = 1e-13
#: Planes that agree to this many decimals (in units of the frame) are one.
_SAME_DECIMALS: Final = 11
#: How far shadows go on below the plane of the target, in units of the frame: not as far as the
#: point that the perspective moves to infinity.
_BELOW: Final = 0.005
#: Where shadows end, in units of the frame's extent along a direction: there and a little farther.
_BEYOND: Final = 1.01
_STAGGER: Final = 0.03
_GOLDEN: Final = 0.618033988749895
_UPRIGHT: Final = np.array([0.0, 0.0, 1.0])
#: How many times farther than the piece the end of its shadow may be.
_FARTHEST: Final = 64.0
#: From how many points on its outline at the end is worked out first.
_MANY: Final = 32
_SAME_PLANE: Final = 1e-9
#: How far, in units of the frame, a shadow may be wrong.
_INEXACT: Final = 1e-12
#: Candidate planes that are tried at once.
_AT_ONCE: Final = 20_000


def shadow_planes(piece: ConvexPiece, target: FloatArray, tolerance: float) -> FloatArray:
    """Find the planes that bound the shadow of a piece.

    Parameters
    ----------
    piece
        The convex piece that hides.
    target
        (M, 3) corners of the convex target in order; two for a segment.
    tolerance
        How far either may be on the wrong side of a plane that still separates them.

    Returns
    -------
    FloatArray
        (K, 4) planes (n, c) with n · x ≥ c in the shadow and n · t ≤ c on the target. None at all
        when piece and target overlap: then the target is hidden from everywhere.
    """
    planes = np.concatenate(
        [
            _through_edges(piece.vertices, piece.edges, target),
            _through_edges(target, _target_edges(len(target)), piece.vertices),
            np.column_stack([piece.normals, piece.offsets]),
        ]
    )
    accepted = [
        _separating(planes[start : start + _AT_ONCE], piece.vertices, target, tolerance)
        for start in range(0, len(planes), _AT_ONCE)
    ]
    found = np.concatenate(accepted)
    _, first = np.unique(np.round(found, _SAME_DECIMALS) + 0.0, axis=0, return_index=True)
    return found[np.sort(first)]


@dataclass(frozen=True, slots=True, eq=False)
class Shadows:
    """The shadows of many pieces, made as solids when they are asked for.

    Every shadow is cut off by a plane beyond the frame's extent: it is the hull of the piece and of
    the points where the rays from its corners, away from every corner of the target, meet that
    plane. For pieces that are very near to the target these would be too far away to be placed
    well; of such pieces the limiting planes are found and a cube is cut by them, so that nothing
    has to be placed "far away": the shadow is right at any distance.

    Parameters
    ----------
    pieces
        What hides the target.
    target
        (M, 3) corners of a convex target in order, in its frame.
    tolerance
        As in `shadow_planes`.
    perspective
        The map under which the solids are given.
    """

    pieces: ConvexPieces
    target: FloatArray
    tolerance: float
    perspective: Perspective

    def cutter(self, index: int) -> Cutter:
        """Prepare the shadow of one piece.

        Parameters
        ----------
        index
            Number of the piece.

        Returns
        -------
        Cutter
            Makes the shadow within the unit cube about the target and some way beyond, its planes
            moved outwards by the distance it is given.
        """

        def make(inflation: float) -> Manifold:
            hull = self._hull(index) if inflation == 0 else None
            return hull or self._between_planes(index, inflation)

        return make

    def _hull(self, index: int) -> Manifold | None:
        corners = self.pieces.corners_of(index)
        if len(self.target) > 2 and corners[:, 2].min() <= 0:
            # What stands on the plane of the target has to hide what is below it as well.
            return None
        directions = np.stack([corners.mean(axis=0) - self.target.mean(axis=0), _UPRIGHT])
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        of_piece, of_target = corners @ directions.T, self.target @ directions.T
        # The planes of different shadows differ: no two faces coincide out there.
        ends = np.abs(directions).sum(axis=-1) * (_BEYOND + _STAGGER * (_GOLDEN * index % 1.0))
        nearness = (of_piece.min(axis=0) - of_target.max(axis=0)) / ends
        best = int(np.argmax(nearness))
        if nearness[best] * _FARTHEST < 1:
            return None
        if of_piece[:, best].min() >= ends[best]:
            # All of the extent lies between the target and the piece.
            return Manifold()
        ahead = of_piece[:, None, best] - of_target[:, best]
        stretch = np.maximum((ends[best] - of_piece[:, None, best]) / ahead, 0.0)
        away = corners[:, None] - self.target
        far = (corners[:, None] + stretch[..., None] * away).reshape(-1, 3)
        if len(far) > _MANY:
            far = far[_outline(far, directions[best])]
        points = self.perspective.forward(np.concatenate([corners, far]))
        for make in (Manifold.hull_points, _careful_hull):
            hull = make(points)
            if _holds(hull, points):
                return hull
        return None

    def _between_planes(self, index: int, inflation: float) -> Manifold:
        solid = Manifold.cube([2.0, 2.0, 2.0], center=True).scale([1.001, 1.001, 1.001])
        planes = shadow_planes(self.pieces.piece(index), self.target, self.tolerance)
        if len(self.target) > 2:
            solid = solid.trim_by_plane([0.0, 0.0, 1.0], -_BELOW)
            # The workspace is cut at the target's plane already; the shadow of a piece that stands
            # on it goes on below, so that their faces do not coincide there.
            on_plane = (planes[:, 2] > 1 - 1e-12) & (np.abs(planes[:, 3]) <= self.tolerance)
            planes = planes[~on_plane]
        for *normal, offset in planes:
            solid = trimmed(solid, normal, offset - inflation)
        return self.perspective.image(solid)


def _careful_hull(points: FloatArray) -> Manifold:
    """Make a hull by qhull, which is ten times slower than manifold3d and leaves nothing out."""
    hull = ConvexHull(points)
    number, faces = np.unique(hull.simplices, return_inverse=True)
    vertices, faces = points[number], faces.reshape(-1, 3)
    first, second, third = np.moveaxis(vertices[faces], 1, 0)
    outwards = np.einsum("fi,fi->f", np.cross(second - first, third - first), hull.equations[:, :3])
    faces = np.where((outwards < 0)[:, None], faces[:, ::-1], faces)
    return Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))


def _holds(hull: Manifold, points: FloatArray) -> bool:
    """Whether a hull holds what it was made of: manifold3d leaves out what sticks out by 1e-7."""
    if hull.is_empty():
        return False
    vertices, faces = from_manifold(hull)
    first, second, third = np.moveaxis(vertices[faces], 1, 0)
    normals = np.cross(second - first, third - first)
    length = np.linalg.norm(normals, axis=-1)
    offsets = np.einsum("fi,fi->f", normals, first)
    beyond = (points @ normals.T - offsets).max(axis=0, initial=0.0)
    return bool((beyond <= _INEXACT * length).all())


def _outline(points: FloatArray, normal: FloatArray) -> IntArray:
    """Which points of a plane with this normal are the corners of their hull; and all off it."""
    height = points @ normal
    on_plane = np.flatnonzero(height < height.min() + _SAME_PLANE)
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    flat = points[on_plane] @ np.stack([across, np.cross(normal, across)], axis=-1)
    corners: IntArray = on_plane[ConvexHull(flat).vertices]
    return np.concatenate([corners, np.flatnonzero(height >= height.min() + _SAME_PLANE)])


def _target_edges(count: int) -> IntArray:
    around = [(i, (i + 1) % count) for i in range(count)]
    return np.array(around[:1] if count == 2 else around)


def _through_edges(vertices: FloatArray, edges: IntArray, corners: FloatArray) -> FloatArray:
    """All planes through an edge and a corner, as (n, c) with unit normals."""
    start, stop = vertices[edges[:, 0]], vertices[edges[:, 1]]
    along = (stop - start)[:, None]
    # The nearer end of the edge as base keeps the most digits of the direction to the corner.
    from_start, from_stop = corners - start[:, None], corners - stop[:, None]
    nearer = (from_start**2).sum(-1, keepdims=True) <= (from_stop**2).sum(-1, keepdims=True)
    towards = np.where(nearer, from_start, from_stop)
    normals = np.cross(along, towards)
    length = np.linalg.norm(normals, axis=-1)
    spanning = length > _COLLINEAR * (
        np.linalg.norm(along, axis=-1) * np.linalg.norm(towards, axis=-1)
    )
    unit = normals[spanning] / length[spanning][:, None]
    base = np.broadcast_to(start[:, None], normals.shape)[spanning]
    return np.column_stack([unit, np.einsum("ki,ki->k", unit, base)])


def _separating(
    planes: FloatArray, piece: FloatArray, target: FloatArray, tolerance: float
) -> FloatArray:
    normals, offsets = planes[:, :3], planes[:, 3:]
    of_piece = normals @ piece.T - offsets
    of_target = normals @ target.T - offsets
    forward = (of_piece.min(axis=1) >= -tolerance) & (of_target.max(axis=1) <= tolerance)
    backward = (of_piece.max(axis=1) <= tolerance) & (of_target.min(axis=1) >= -tolerance)
    return np.concatenate([planes[forward], -planes[backward]])
