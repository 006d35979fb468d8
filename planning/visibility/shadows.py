"""Shadows: where a convex piece stands between the viewpoint and some point of a convex target.

The shadow of a piece B of a target T is B + cone(B − T): every b moved away from every t. It is
convex, and it is bounded by the limiting separating planes of the paper (section 1.2.1.3): planes
through an edge of one and a corner of the other, or along a face of B, with T on one side and B on
the other. They are found as such, and the workspace is cut by them, so nothing has to be placed
"far away": the shadow is right at any distance.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from manifold3d import Manifold

from lenscal.arrays import FloatArray, IntArray
from planning.boolean import Cutter
from planning.visibility.convex import ConvexPiece, Occluders

#: An edge and a corner span a plane when the sine of their angle exceeds this.
_COLLINEAR: Final = 1e-13
#: Planes that agree to this many decimals (in units of the frame) are one.
_SAME_DECIMALS: Final = 11
#: How far shadows go on below the plane of the target, in units of the frame.
_BELOW: Final = 0.25
#: More than the extent is across, or high above the target's plane.
_ACROSS: Final = 3.5
_ABOVE: Final = 1.06
#: How many times farther than the piece the end of its shadow may be.
_FARTHEST: Final = 64.0
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

    Within the frame's extent a shadow is the hull of the piece and of the piece moved away from
    every corner of the target by `stretch` times their distance, when that is far enough for all
    of it to be outside: B + cone(B − T) = {b + r (b − t)}. For pieces that are very near to the
    target it never is; of these the limiting planes are found and a cube is cut by them, so that
    nothing has to be placed "far away": the shadow is right at any distance.

    Parameters
    ----------
    occluders
        What hides the target.
    target
        (M, 3) corners of a convex target in order, in its frame.
    tolerance
        As in `shadow_planes`.
    """

    occluders: Occluders
    target: FloatArray
    tolerance: float
    stretches: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        low, high = self.occluders.bounds()
        gap = np.maximum(low - self.target.max(axis=0), self.target.min(axis=0) - high)
        distance = np.linalg.norm(np.maximum(gap, 0.0), axis=-1)
        with np.errstate(divide="ignore"):
            stretches = _ACROSS / distance
            if len(self.target) > 2:
                upright = np.where(low[:, 2] > 0, _ABOVE / low[:, 2], np.inf)
                # A piece that stands on the plane of the target hides what is below it as well.
                stretches = np.where(low[:, 2] > 0, np.minimum(stretches, upright), np.inf)
        object.__setattr__(self, "stretches", stretches)

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
            if inflation == 0 and self.stretches[index] <= _FARTHEST:
                return self._hull(index)
            return self._between_planes(index, inflation)

        return make

    def _hull(self, index: int) -> Manifold:
        piece, stretch = self.occluders.corners_of(index), self.stretches[index]
        far = (stretch * piece[:, None] - (stretch - 1) * self.target).reshape(-1, 3)
        return Manifold.hull_points(np.concatenate([piece, far]))

    def _between_planes(self, index: int, inflation: float) -> Manifold:
        solid = Manifold.cube([2.0, 2.0, 2.0], center=True).scale([1.001, 1.001, 1.001])
        planes = shadow_planes(self.occluders.piece(index), self.target, self.tolerance)
        if len(self.target) > 2:
            solid = solid.trim_by_plane([0.0, 0.0, 1.0], -_BELOW)
            # The workspace is cut at the target's plane already; the shadow of a piece that stands
            # on it goes on below, so that their faces do not coincide there.
            on_plane = (planes[:, 2] > 1 - 1e-12) & (np.abs(planes[:, 3]) <= self.tolerance)
            planes = planes[~on_plane]
        for *normal, offset in planes:
            solid = solid.trim_by_plane(normal, offset - inflation)
        return solid


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
