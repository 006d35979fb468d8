"""How far convex pieces are from triangles, exactly and never too far.

For convex sets A and B and any unit vector u, min over B of u · b less max over A of u · a is no
more than their distance, and is their distance for the right u. So whatever directions are tried,
the best is on the safe side; and the right one is that between the two nearest points, which
alternating projections find (Cheney and Goldstein 1959).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import trimesh

from lenscal.arrays import FloatArray, IntArray
from planning.camera_body import Piece

#: Alternating projections at most, and the gap in mm between both bounds at which they end.
_PROJECTIONS: Final = 200
_GAP_MM: Final = 1e-6


def separation_mm(
    piece: Piece, triangles_mm: FloatArray, group: IntArray, enough_mm: float
) -> FloatArray:
    """Measure how far a piece is from triangles.

    Parameters
    ----------
    piece
        A convex piece.
    triangles_mm
        (K, 3, 3) triangles in its frame in mm.
    group
        (K,) which of them belong together. Only the nearest of a group is of interest: the others
        may be given as nearer than they are, but no nearer than that one.
    enough_mm
        Distances beyond this are of no interest either.

    Returns
    -------
    FloatArray
        (K,) in mm, to 1e-6 mm where the sets are apart. Where they overlap it is negative: how far
        the piece had to move to be free, along the normal of the triangle or in the directions that
        the piece itself suggests.
    """
    best = np.full(len(triangles_mm), -np.inf)
    normals = np.cross(
        triangles_mm[:, 1] - triangles_mm[:, 0], triangles_mm[:, 2] - triangles_mm[:, 0]
    )
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    flat = length[:, 0] > 0
    for direction in (normals, -normals):
        best[flat] = np.maximum(best[flat], _gap(piece, triangles_mm[flat], direction[flat]))
    for direction in piece.directions_towards(triangles_mm):
        np.maximum(best, _gap(piece, triangles_mm, direction), out=best)
    _refine(piece, triangles_mm, group, enough_mm, best)
    return best


def _refine(
    piece: Piece, triangles: FloatArray, group: IntArray, enough_mm: float, best: FloatArray
) -> None:
    """Raise the bounds by alternating projections where that can matter."""
    nearest = np.full(int(group.max(initial=0)) + 1, np.inf)
    rows = np.flatnonzero(best < enough_mm)
    on_piece = piece.nearest_mm(triangles[rows].mean(axis=1)) if len(rows) else np.zeros((0, 3))
    for _ in range(_PROJECTIONS):
        if not len(rows):
            return
        on_triangle = trimesh.triangles.closest_point(triangles[rows], on_piece)
        on_piece = piece.nearest_mm(on_triangle)
        away = on_triangle - on_piece
        distance = np.linalg.norm(away, axis=1)
        apart = distance > 0
        direction = np.divide(
            away, distance[:, None], out=np.zeros_like(away), where=apart[:, None]
        )
        bound = _gap(piece, triangles[rows], direction)
        best[rows] = np.where(apart, np.maximum(best[rows], bound), best[rows])
        np.minimum.at(nearest, group[rows], distance)
        # What overlaps is as negative as it is; what cannot be the nearest does not matter.
        going = (
            apart
            & (distance - best[rows] > _GAP_MM)
            & (best[rows] < np.minimum(nearest[group[rows]], enough_mm))
        )
        rows, on_piece = rows[going], on_piece[going]


def _gap(piece: Piece, triangles: FloatArray, direction: FloatArray) -> FloatArray:
    """(K,) how far triangles lie beyond the piece in directions, negative when they do not."""
    beyond: FloatArray = np.einsum("kij,kj->ki", triangles, direction).min(axis=1)
    return beyond - piece.support_mm(direction)
