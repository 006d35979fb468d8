"""How far convex pieces are from flat convex faces, exactly and never too far.

For convex sets A and B and any unit vector u, min over B of u · b less max over A of u · a is no
more than their distance, and is their distance for the right u. So whatever directions are tried,
the best is on the safe side; and the right one is that between the two nearest points. The distance
of any two of their points is no less than that of the sets, and where both bounds meet no more is
to be done. Most often that is at a corner, or where an edge is nearest to the axis; else where the
piece comes nearest to the plane of the face, or somewhere on an edge. For what is left: to project
on one set and then on the other (Cheney and Goldstein 1959) is to descend on the squared distance
with the step one; Nesterov's momentum, dropped whenever it goes uphill, makes that fast.

Faces have four corners, a triangle one of them twice. Components stand outermost: picking and
multiplying them is the fastest so.
"""

from __future__ import annotations

from functools import reduce
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.camera_body import Piece
from planning.vectors import along

#: Projections at most, and the gap in mm between both bounds at which they end.
_PROJECTIONS: Final = 200
_GAP_MM: Final = 1e-4
#: Steps at most in which the nearest point of an edge is found.
_FALSE_POSITIONS: Final = 60
#: What slope is none, as a share of the squared length of the edge.
_LEVEL: Final = 1e-12
#: Faces that are looked at at once, so that they stay in the cache.
_AT_ONCE: Final = 8_192


def directions_apart(
    piece: Piece, corners_mm: FloatArray
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Try directions that often part a piece from faces: their normals, and the piece's own.

    Parameters
    ----------
    piece
        A convex piece.
    corners_mm
        (4, 3, K) faces in its frame in mm.

    Returns
    -------
    list of tuple
        (3, K) unit vectors; (K,) how far the face lies beyond the piece in that direction, negative
        when it does not; (K,) the same for the opposite direction. When the face moves by m, the
        one grows and the other shrinks by the direction times m, so that the largest for one place
        is also a bound for another.
    """
    found = []
    for direction in (unit_normals(corners_mm), *piece.directions_towards(corners_mm)):
        heights = [along(direction, corner) for corner in corners_mm]
        forwards = reduce(np.minimum, heights) - piece.support_mm(direction)
        backwards = -reduce(np.maximum, heights) - piece.support_mm(-direction)
        found.append((direction, forwards, backwards))
    return found


def gap_mm(piece: Piece, corners_mm: FloatArray, directions: FloatArray) -> FloatArray:
    """Measure how far faces lie beyond a piece in directions: never more than their distance.

    Parameters
    ----------
    piece
        A convex piece.
    corners_mm
        (4, 3, K) faces in its frame in mm.
    directions
        (3, K) unit vectors.

    Returns
    -------
    FloatArray
        (K,) in mm, negative when they do not.
    """
    beyond = along(directions, corners_mm[0])
    for corner in corners_mm[1:]:
        np.minimum(beyond, along(directions, corner), out=beyond)
    beyond -= piece.support_mm(directions)
    return beyond


def separation_mm(
    piece: Piece,
    corners_mm: FloatArray,
    group: IntArray,
    enough_mm: float,
    at_least_mm: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Measure how far a piece is from faces.

    Parameters
    ----------
    piece
        A convex piece.
    corners_mm
        (4, 3, K) faces in its frame in mm.
    group
        (K,) which of them belong together. Only the nearest of a group is of interest: the others
        may be given as nearer than they are, but no nearer than that one.
    enough_mm
        Distances beyond this are of no interest either.
    at_least_mm
        (K,) what is known already, from `directions_apart`.

    Returns
    -------
    distance_mm : FloatArray
        (K,) to 1e-4 mm where the sets are apart. Where they overlap, what was known.
    directions : FloatArray
        (3, K) between the points that were found to be nearest, of length one or zero.
    """
    search = _Search(piece, corners_mm, group, enough_mm, at_least_mm)
    parts = [slice(k, k + _AT_ONCE) for k in range(0, len(search.rows), _AT_ONCE)]
    for find in (_nearest_of_few, _nearest_to_rim, _nearest_on_edges):
        places = [find(piece, search.corners[..., part]) for part in parts]
        search.tell(np.concatenate([np.zeros((3, 0)), *places], axis=1))
        parts = [slice(k, k + _AT_ONCE) for k in range(0, len(search.rows), _AT_ONCE)]
    ahead = last = search.places
    momentum, before = np.ones(len(search.rows)), np.full(len(search.rows), np.inf)
    for _ in range(_PROJECTIONS):
        if not len(search.rows):
            break
        here = nearest_on_faces(search.corners, piece.nearest_mm(ahead))
        distance, going = search.tell(here)
        uphill = distance > before
        following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        push = np.where(uphill, 0.0, (momentum - 1) / following)
        ahead = (here + push * (here - last))[:, going]
        momentum = np.where(uphill, 1.0, following)[going]
        last, before = here[:, going], distance[going]
    return search.best, search.directions


class _Search:
    """What is known about faces, and which of them are of interest still.

    Parameters
    ----------
    piece, corners, group, enough_mm, at_least_mm
        As in `separation_mm`.
    """

    def __init__(
        self,
        piece: Piece,
        corners: FloatArray,
        group: IntArray,
        enough_mm: float,
        at_least_mm: FloatArray,
    ) -> None:
        self._piece, self._enough_mm = piece, enough_mm
        self.best = np.array(at_least_mm)
        self.directions: FloatArray = np.zeros((3, len(self.best)))
        self._nearest = np.full(len(self.best), np.inf)
        self._group = np.unique(group, return_inverse=True)[1]
        self.rows, self.corners = np.arange(len(self.best)), corners
        #: The nearest point of each face that was told.
        self.places, self._distance = corners[0], np.full(len(self.best), np.inf)

    def tell(self, places: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Take note of a point of each face that is left, and leave out what is settled by it.

        Gives (K,) how far the points are from the piece, and which faces are left.
        """
        away = places - self._piece.nearest_mm(places)
        distance = np.sqrt(along(away, away))
        apart = distance > _GAP_MM
        away /= np.where(apart, distance, np.inf)
        np.minimum.at(self._nearest, self._group, distance)
        limit = np.minimum(self._nearest[self._group], self._enough_mm)
        known = self.best[self.rows]
        closed = apart & (distance - known <= _GAP_MM)
        self.directions[:, self.rows[closed]] = away[:, closed]
        # What overlaps is as negative as it is; what cannot be the nearest does not matter.
        left = np.flatnonzero(apart & ~closed & (known < limit))
        bound = gap_mm(self._piece, self.corners[..., left], away[:, left])
        better = bound > known[left]
        improved = left[better]
        known[improved] = self.best[self.rows[improved]] = bound[better]
        self.directions[:, self.rows[improved]] = away[:, improved]
        going = np.zeros(len(known), dtype=bool)
        going[left] = (distance[left] - known[left] > _GAP_MM) & (known[left] < limit[left])
        self.rows, self._group = self.rows[going], self._group[going]
        self.corners = self.corners[..., going]
        nearer = distance < self._distance
        self.places = np.where(nearer, places, self.places)[:, going]
        self._distance = np.minimum(distance, self._distance)[going]
        return distance, going


def nearest_on_faces(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Give the point of each face that is nearest to a point.

    Parameters
    ----------
    corners
        (4, 3, K) corners.
    points
        (3, K) points.

    Returns
    -------
    FloatArray
        (3, K).
    """
    a, b, c, d = corners
    one, other = nearest_on_triangles(a, b, c, points), nearest_on_triangles(a, c, d, points)
    beyond, aside = one - points, other - points
    return np.where(along(beyond, beyond) <= along(aside, aside), one, other)


def nearest_on_triangles(
    a: FloatArray, b: FloatArray, c: FloatArray, points: FloatArray
) -> FloatArray:
    """Give the point of each triangle that is nearest to a point.

    Source: C. Ericson, *Real-Time Collision Detection* (2005), section 5.1.5.

    Parameters
    ----------
    a, b, c
        (3, K) corners.
    points
        (3, K) points.

    Returns
    -------
    FloatArray
        (3, K).
    """
    ab, ac, ap = b - a, c - a, points - a
    d1, d2 = along(ab, ap), along(ac, ap)
    bb, cc, bc = along(ab, ab), along(ac, ac), along(ab, ac)
    d3, d4, d5, d6 = d1 - bb, d2 - bc, d1 - bc, d2 - cc
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    total = va + vb + vc
    with np.errstate(divide="ignore", invalid="ignore"):
        # Inside, along the edges BC, AC and AB, and at the corners C, B and A: the last one holds.
        v, w = vb / total, vc / total
        share = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        for where, at_v, at_w in (
            ((va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0), 1 - share, share),
            ((vb <= 0) & (d2 >= 0) & (d6 <= 0), 0.0, d2 / (d2 - d6)),
            ((vc <= 0) & (d1 >= 0) & (d3 <= 0), d1 / (d1 - d3), 0.0),
            ((d6 >= 0) & (d5 <= d6), 0.0, 1.0),
            ((d3 >= 0) & (d4 <= d3), 1.0, 0.0),
            ((d1 <= 0) & (d2 <= 0), 0.0, 0.0),
        ):
            v, w = np.where(where, at_v, v), np.where(where, at_w, w)
    return np.asarray(a + v * ab + w * ac)


def unit_normals(corners: FloatArray) -> FloatArray:
    """Give the normals of faces.

    Parameters
    ----------
    corners
        (4, 3, K) corners.

    Returns
    -------
    FloatArray
        (3, K) unit vectors; a face without area has no normal: any direction is a valid one.
    """
    first, second = corners[2] - corners[0], corners[3] - corners[1]
    # Half the product of the diagonals is the vector of the area.
    normals = np.stack(
        [
            first[1] * second[2] - first[2] * second[1],
            first[2] * second[0] - first[0] * second[2],
            first[0] * second[1] - first[1] * second[0],
        ]
    )
    squared = along(normals, normals)
    length = np.sqrt(np.where(squared > 0, squared, 1.0))
    return np.where(squared > 0, normals / length, np.array([[0.0], [0.0], [1.0]]))


def _nearest_of_few(piece: Piece, corners: FloatArray) -> FloatArray:
    """(3, K) the nearest of a few points of each face: its corners, and what the piece suggests."""
    places: FloatArray = corners[0]
    distance = piece.distance_mm(places)
    for point in (*corners[1:], *piece.points_near(corners)):
        found = piece.distance_mm(point)
        nearer = found < distance
        places, distance = np.where(nearer, point, places), np.where(nearer, found, distance)
    return places


def _nearest_to_rim(piece: Piece, corners: FloatArray) -> FloatArray:
    """(3, K) the points opposite to where the piece comes nearest to the plane of each face."""
    normals = unit_normals(corners)
    above = along(normals, piece.centre_mm[:, None] - corners[0]) > 0
    return nearest_on_faces(corners, piece.farthest_mm(np.where(above, -normals, normals)))


def _nearest_on_edges(piece: Piece, corners: FloatArray) -> FloatArray:
    """(3, K) the nearest of the points of all edges.

    Along an edge the squared distance is convex. So it lies above its tangents at both ends, and an
    edge is left out when they meet higher than what is nearest so far. Its slope has one zero,
    which is found by false position with the weight of an end that stays halved (the Illinois
    method; Dowell and Jarratt 1971).
    """
    aways: list[FloatArray] = [corner - piece.nearest_mm(corner) for corner in corners]
    halves: list[FloatArray] = [along(away, away) / 2 for away in aways]
    places, least = np.array(corners[0]), np.array(halves[0])
    for corner, half in zip(corners[1:], halves[1:], strict=True):
        places, least = np.where(half < least, corner, places), np.minimum(half, least)
    for k, start in enumerate(corners):
        following = (k + 1) % len(corners)
        edge = corners[following] - start
        at_a, at_b = along(aways[k], edge), along(aways[following], edge)
        # Uphill from the start or downhill to the end: a corner is the nearest.
        left = np.flatnonzero((at_a < 0) & (at_b > 0))
        at_a, at_b, half = at_a[left], at_b[left], halves[k][left]
        met = half + at_a * (halves[following][left] - half - at_b) / (at_a - at_b)
        kept = met < least[left]
        left = left[kept]
        share = _zero_slope(piece, start[:, left], edge[:, left], at_a[kept], at_b[kept])
        point = start[:, left] + share * edge[:, left]
        half = np.square(piece.distance_mm(point)) / 2
        nearer = half < least[left]
        places[:, left[nearer]], least[left[nearer]] = point[:, nearer], half[nearer]
    return places


def _slope(piece: Piece, start: FloatArray, edge: FloatArray, share: FloatArray) -> FloatArray:
    """(K,) how half the squared distance from a piece changes along an edge, at a share of it."""
    point = start + share * edge
    return along(point - piece.nearest_mm(point), edge)


def _zero_slope(
    piece: Piece, start: FloatArray, edge: FloatArray, at_a: FloatArray, at_b: FloatArray
) -> FloatArray:
    """(K,) shares of edges where their slope is zero; it is negative at the start."""
    found, rows = np.zeros(len(at_a)), np.arange(len(at_a))
    a, b, stayed = np.zeros(len(at_a)), np.ones(len(at_a)), np.zeros(len(at_a))
    enough = _LEVEL * along(edge, edge)
    for _ in range(_FALSE_POSITIONS):
        found[rows] = share = (a * at_b - b * at_a) / (at_b - at_a)
        value = _slope(piece, start[:, rows], edge[:, rows], share)
        before = value < 0
        # An end that stays for the second time weighs half.
        at_b = np.where(before, np.where(stayed > 0, at_b / 2, at_b), value)
        at_a = np.where(before, value, np.where(stayed < 0, at_a / 2, at_a))
        a, b = np.where(before, share, a), np.where(before, b, share)
        going = np.abs(value) > enough[rows]
        rows, stayed = rows[going], np.where(before, 1.0, -1.0)[going]
        a, b, at_a, at_b = a[going], b[going], at_a[going], at_b[going]
        if not len(rows):
            break
    return found
