"""Which points lie inside a closed surface: exactly, in double precision, and for many at once."""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.box_tree import BoxTree

#: Pairs of point and triangle that are worked on at once, so that they stay in the cache.
_PAIRS_AT_ONCE: Final = 200_000
#: A surface of no more triangles than this is tried for convexity.
_FEW: Final = 256
#: How far, as a share of the size, corners of a convex body may stick out of its planes.
_CONVEX: Final = 1e-14
#: How near to an edge, as a share of the size, a line must pass to be no proof.
_GRAZING: Final = 1e-13
#: A rotation that no part is aligned with: rotation vector (1, √2, √3) / 3, Cayley form.
SKEW: Final = np.linalg.solve(
    np.eye(3) - np.cross(np.eye(3), [1 / 3, 2**0.5 / 3, 3**0.5 / 3]),
    np.eye(3) + np.cross(np.eye(3), [1 / 3, 2**0.5 / 3, 3**0.5 / 3]),
)


class Membership:
    """A closed surface, ready to be asked what lies inside.

    A convex body is asked by its planes. Of others, the faces are counted that a line upwards from
    the point crosses, by which way they face; where it passes too near to an edge to be sure, the
    winding number decides, which has no special cases but looks at every face.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners of each face, counter-clockwise seen from outside; at least one face.
    turn
        (3, 3) rotation after which lines run upwards. The default is one that no part is aligned
        with.
    """

    def __init__(self, triangles: FloatArray, turn: FloatArray = SKEW) -> None:
        corners = triangles.reshape(-1, 3)
        self._low, self._high = corners.min(axis=0), corners.max(axis=0)
        self._centre = (self._low + self._high) / 2
        self._size = float(np.linalg.norm(self._high - self._low))
        self._triangles = triangles
        self._turn = turn
        self._planes = _planes_if_convex(triangles - self._centre, self._size)
        if self._planes is None:
            turned = (triangles - self._centre) @ turn.T
            self._tree = BoxTree.about(turned)
            #: Components stand outermost: picking them is twice as fast.
            self._corners: FloatArray = np.ascontiguousarray(turned.transpose(1, 2, 0))
            along = np.roll(self._corners, -1, axis=0) - self._corners
            self._grazing: FloatArray = _GRAZING * self._size * np.hypot(along[:, 0], along[:, 1])

    def contains(self, points: FloatArray) -> BoolArray:
        """Tell which points lie inside.

        Parameters
        ----------
        points
            (N, 3) points.

        Returns
        -------
        BoolArray
            (N,). On the surface itself either answer may come.
        """
        inside: BoolArray = np.ones(len(points), dtype=bool)
        for k in range(3):
            inside &= (points[:, k] >= self._low[k]) & (points[:, k] <= self._high[k])
        near = np.flatnonzero(inside)
        if self._planes is not None:
            normals, offsets = self._planes
            step = max(1, _PAIRS_AT_ONCE // max(1, len(normals)))
            for start in range(0, len(near) if len(normals) else 0, step):
                part = near[start : start + step]
                local = points[part] - self._centre
                inside[part] = (local @ normals.T <= offsets).all(axis=1)
        elif len(near):
            inside[near] = self._by_crossings(points[near])
        return inside

    def _by_crossings(self, points: FloatArray) -> BoolArray:
        turned = (points - self._centre) @ self._turn.T
        turns = np.zeros(len(points), dtype=np.int64)
        unsure = np.zeros(len(points), dtype=bool)
        places = np.ascontiguousarray(turned.T)
        x, y, z = places

        def meets(
            which: IntArray, centres: FloatArray, halves: FloatArray, _: IntArray
        ) -> BoolArray:
            met: BoolArray = np.abs(centres[0] - x.take(which)) <= halves[0]
            met &= np.abs(centres[1] - y.take(which)) <= halves[1]
            met &= centres[2] + halves[2] >= z.take(which)
            return met

        for which, face in self._tree.pairs(np.arange(len(points)), meets):
            crossed, grazed = self._crossings(places.take(which, 1), face)
            np.add.at(turns, which, crossed)
            unsure[which[grazed]] = True
        again = np.flatnonzero(unsure)
        inside: BoolArray = turns > 0
        inside[again] = winding_number(points[again], self._triangles) > 0.5
        return inside

    def _crossings(self, points: FloatArray, face: IntArray) -> tuple[IntArray, BoolArray]:
        """(K,) +1 or −1 where the line upwards leaves or enters, and where that is unsure."""
        a, b, c = (corner.take(face, 1) - points for corner in self._corners)
        # Twice the areas, seen from above, of the triangles that the point makes with the edges.
        sides = np.stack([p[0] * q[1] - p[1] * q[0] for p, q in ((a, b), (b, c), (c, a))])
        margin = self._grazing.take(face, 1)
        turned_up: BoolArray = np.logical_and.reduce(sides > margin)
        turned_down: BoolArray = np.logical_and.reduce(sides < -margin)
        outside: BoolArray = np.logical_or.reduce(sides > margin)
        outside &= np.logical_or.reduce(sides < -margin)
        sure = turned_up | turned_down | outside
        # The height of the face above the point, times the area seen from above.
        height = sides[0] * c[2] + sides[1] * a[2] + sides[2] * b[2]
        crossed = np.where(turned_up & (height > 0), 1, 0)
        crossed -= np.where(turned_down & (height < 0), 1, 0)
        return crossed.astype(np.int64), np.logical_not(sure)


def winding_number(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Count how often a closed surface goes around each point.

    It is the solid angle that the surface subtends, over 4π. Source: A. van Oosterom and
    J. Strackee, "The solid angle of a plane triangle" (1983).

    Parameters
    ----------
    points
        (N, 3) points.
    triangles
        (F, 3, 3) triangles of closed surfaces.

    Returns
    -------
    FloatArray
        (N,) 1 inside, 0 outside, to rounding.
    """
    turns = np.zeros(len(points))
    step = max(1, _PAIRS_AT_ONCE // max(1, len(triangles)))
    for start in range(0, len(points), step):
        part = slice(start, start + step)
        a, b, c = (triangles[:, k] - points[part][:, None] for k in range(3))
        length_a, length_b, length_c = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
        numerator = np.einsum("...i,...i", a, np.cross(b, c))
        denominator = (
            length_a * length_b * length_c
            + np.einsum("...i,...i", a, b) * length_c
            + np.einsum("...i,...i", b, c) * length_a
            + np.einsum("...i,...i", c, a) * length_b
        )
        turns[part] = np.arctan2(numerator, denominator).sum(axis=-1) / (2 * np.pi)
    return turns


def _planes_if_convex(triangles: FloatArray, size: float) -> tuple[FloatArray, FloatArray] | None:
    """Unit normals and offsets of the planes of a convex body, each once; None for others."""
    if len(triangles) > _FEW:
        return None
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=-1)
    real = length > 0
    normals = normals[real] / length[real, None]
    offsets = np.einsum("fi,fi->f", normals, triangles[real, 0])
    outermost = (triangles.reshape(-1, 3) @ normals.T - offsets).max(axis=0)
    if not len(normals) or outermost.max() > _CONVEX * size:
        return None
    # What lies along the axes is bounded by the box already.
    planes = np.column_stack([normals, offsets])[np.abs(normals).max(axis=1) < 1.0]
    planes = np.unique(planes, axis=0)
    return planes[:, :3], planes[:, 3]
