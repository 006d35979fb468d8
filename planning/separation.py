"""How far convex pieces are from triangles, exactly and never too far.

For convex sets A and B and any unit vector u, min over B of u · b less max over A of u · a is no
more than their distance, and is their distance for the right u. So whatever directions are tried,
the best is on the safe side; and the right one is that between the two nearest points. To project
on one set and then on the other (Cheney and Goldstein 1959) is to descend on the squared distance
with the step one; Nesterov's momentum, dropped whenever it goes uphill, makes that fast.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, IntArray
from planning.camera_body import Piece

#: Projections at most, and the gap in mm between both bounds at which they end.
_PROJECTIONS: Final = 200
_GAP_MM: Final = 1e-4


def directions_apart(piece: Piece, triangles_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Try directions that often part a piece from triangles: their normals, and the piece's own.

    Parameters
    ----------
    piece
        A convex piece.
    triangles_mm
        (K, 3, 3) triangles in its frame in mm.

    Returns
    -------
    directions : FloatArray
        (C, K, 3) unit vectors from the piece to the triangle.
    gaps_mm : FloatArray
        (C, K) how far the triangle lies beyond the piece in that direction, negative when it does
        not. When the triangle moves by m, it grows by the direction times m, so that the largest
        for one place is also a bound for another.
    """
    sides = triangles_mm[:, 1:] - triangles_mm[:, :1]
    normals = np.cross(sides[:, 0], sides[:, 1])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    # A triangle without area has no normal; any direction is a valid one.
    normals = np.where(length > 0, normals / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))
    directions = np.stack([normals, -normals, *piece.directions_towards(triangles_mm)])
    return directions, np.stack([_gap(piece, triangles_mm, d) for d in directions])


def separation_mm(
    piece: Piece,
    triangles_mm: FloatArray,
    group: IntArray,
    enough_mm: float,
    at_least_mm: FloatArray,
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
    at_least_mm
        (K,) what is known already, from `directions_apart`.

    Returns
    -------
    FloatArray
        (K,) in mm, to 1e-4 mm where the sets are apart. Where they overlap, what was known.
    """
    best = np.array(at_least_mm)
    nearest = np.full(int(group.max(initial=0)) + 1, np.inf)
    rows = np.flatnonzero(best < enough_mm)
    if not len(rows):
        return best
    corners = triangles_mm[rows]
    ahead = last = corners.mean(axis=1)
    momentum, before = np.ones(len(rows)), np.full(len(rows), np.inf)
    for _ in range(_PROJECTIONS):
        here = nearest_on_triangles(corners, piece.nearest_mm(ahead))
        away = here - piece.nearest_mm(here)
        distance = np.sqrt(np.einsum("ij,ij->i", away, away))
        apart = distance > _GAP_MM
        away /= np.where(apart, distance, 1.0)[:, None]
        bound = np.where(apart, _gap(piece, corners, away), -np.inf)
        best[rows] = known = np.maximum(best[rows], bound)
        np.minimum.at(nearest, group[rows], distance)
        # What overlaps is as negative as it is; what cannot be the nearest does not matter.
        going = (
            apart
            & (distance - known > _GAP_MM)
            & (known < np.minimum(nearest[group[rows]], enough_mm))
        )
        if not going.any():
            break
        uphill = distance > before
        following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        push = np.where(uphill, 0.0, (momentum - 1) / following)
        ahead = (here + push[:, None] * (here - last))[going]
        momentum = np.where(uphill, 1.0, following)[going]
        rows, last, before, corners = rows[going], here[going], distance[going], corners[going]
    return best


def nearest_on_triangles(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """Give the point of each triangle that is nearest to a point.

    Source: C. Ericson, *Real-Time Collision Detection* (2005), section 5.1.5.

    Parameters
    ----------
    triangles
        (K, 3, 3) corners.
    points
        (K, 3) points.

    Returns
    -------
    FloatArray
        (K, 3).
    """
    a = triangles[:, 0]
    ab, ac, ap = triangles[:, 1] - a, triangles[:, 2] - a, points - a
    d1, d2 = np.einsum("ij,ij->i", ab, ap), np.einsum("ij,ij->i", ac, ap)
    bb, cc, bc = (np.einsum("ij,ij->i", *pair) for pair in ((ab, ab), (ac, ac), (ab, ac)))
    d3, d4, d5, d6 = d1 - bb, d2 - bc, d1 - bc, d2 - cc
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    total = va + vb + vc
    with np.errstate(divide="ignore", invalid="ignore"):
        # Inside, along the edges BC, AC and AB, and at the corners C, B and A: the last one holds.
        v, w = vb / total, vc / total
        along = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        for where, at_v, at_w in (
            ((va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0), 1 - along, along),
            ((vb <= 0) & (d2 >= 0) & (d6 <= 0), 0.0, d2 / (d2 - d6)),
            ((vc <= 0) & (d1 >= 0) & (d3 <= 0), d1 / (d1 - d3), 0.0),
            ((d6 >= 0) & (d5 <= d6), 0.0, 1.0),
            ((d3 >= 0) & (d4 <= d3), 1.0, 0.0),
            ((d1 <= 0) & (d2 <= 0), 0.0, 0.0),
        ):
            v, w = np.where(where, at_v, v), np.where(where, at_w, w)
    return np.asarray(a + v[:, None] * ab + w[:, None] * ac)


def _gap(piece: Piece, triangles: FloatArray, direction: FloatArray) -> FloatArray:
    """(K,) how far triangles lie beyond the piece in directions, negative when they do not."""
    beyond: FloatArray = np.einsum("kij,kj->ki", triangles, direction).min(axis=1)
    return beyond - piece.support_mm(direction)
