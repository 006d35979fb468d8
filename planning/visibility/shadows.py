"""Shadows: where a convex piece stands between the viewpoint and some point of a convex target.

The shadow of a piece B of a target T is B + cone(B − T): every b moved away from every t. It is
convex, and it is bounded by the limiting separating planes of the paper (section 1.2.1.3): planes
through an edge of one and a corner of the other, or along a face of B, with T on one side and B on
the other. They are found as such, and the workspace is cut by them, so nothing has to be placed
"far away": the shadow is right at any distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from manifold3d import Manifold

from lenscal.arrays import FloatArray, IntArray
from planning.boolean import Cutter, trimmed
from planning.visibility.convex import ConvexPiece

#: An edge and a corner span a plane when the sine of their angle exceeds this.
_COLLINEAR: Final = 1e-13
#: Planes that agree to this many decimals (in units of the frame) are one.
_SAME_DECIMALS: Final = 11
#: How far shadows go on below the plane of the target, in units of the frame.
_BELOW: Final = 0.25
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


def shadow_cutters(
    pieces: Sequence[ConvexPiece], target: FloatArray, tolerance: float
) -> list[Cutter]:
    """Prepare the shadows of many pieces as solids.

    Parameters
    ----------
    pieces
        What hides the target.
    target
        (M, 3) corners of a convex target in order, in its frame.
    tolerance
        As in `shadow_planes`.

    Returns
    -------
    list of Cutter
        Each makes the shadow within the unit cube about the target, its planes moved outwards by
        the distance it is given.
    """
    cube = Manifold.cube([2.0, 2.0, 2.0], center=True).scale([1.001, 1.001, 1.001])
    if len(target) > 2:
        cube = cube.trim_by_plane([0.0, 0.0, 1.0], -_BELOW)

    def cutter(piece: ConvexPiece) -> Cutter:
        planes = shadow_planes(piece, target, tolerance)
        if len(target) > 2:
            # The workspace is cut at the target's plane already; the shadow of a piece that stands
            # on it goes on below, so that their faces do not coincide there.
            on_plane = (planes[:, 2] > 1 - 1e-12) & (np.abs(planes[:, 3]) <= tolerance)
            planes = planes[~on_plane]

        def make(inflation: float) -> Manifold:
            solid = cube
            for *normal, offset in planes:
                solid = trimmed(solid, normal, offset - inflation)
            return solid

        return make

    return [cutter(piece) for piece in pieces]


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
