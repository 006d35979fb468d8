"""How far points are from a surface of triangles: exactly, and for many at once."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.box_tree import BoxTree
from planning.vectors import cross, dot

#: Triangles about a point that are measured first, for a bound on the distance.
_TRIED_FIRST: Final = 4
#: Pairs of point and triangle that are worked on at once.
_PAIRS_AT_ONCE: Final = 16_384


class NearestSurface:
    """Triangles, ready to be asked how far they are.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners; at least one triangle.
    """

    def __init__(self, triangles: FloatArray) -> None:
        # Measured from their middle, so that a surface far from the origin loses no digits.
        corners = triangles.reshape(-1, 3)
        self._origin: FloatArray = (corners.min(axis=0) + corners.max(axis=0)) / 2
        self._triangles = triangles - self._origin
        self._tree = BoxTree(self._triangles.min(axis=1), self._triangles.max(axis=1))
        a, b, c = np.moveaxis(self._triangles, 1, 0)
        normals = cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        # A triangle without area has no plane that it could be far away from.
        self._normals: FloatArray = normals / np.where(length > 0, length, 1.0)
        self._offsets: FloatArray = dot(self._normals, a)
        middles = self._triangles.mean(axis=1)
        self._middles = cKDTree(np.concatenate([middles, self._triangles.reshape(-1, 3)]))

    def distance(self, points: FloatArray) -> FloatArray:
        """Measure the distance to the nearest triangle.

        Parameters
        ----------
        points
            (N, 3) points.

        Returns
        -------
        FloatArray
            (N,) unsigned, in the unit of the triangles.
        """
        local = points - self._origin
        count = len(self._triangles)
        _, found = self._middles.query(local, min(_TRIED_FIRST, 4 * count))
        entry = np.asarray(found).reshape(len(points), min(_TRIED_FIRST, 4 * count))
        first = np.where(entry < count, entry, (entry - count) // 3)
        best = np.full(len(points), np.inf)
        for column in first.T:
            np.minimum(best, self._measure(local, column), out=best)

        def meets(which: IntArray, centres: FloatArray, halves: FloatArray) -> BoolArray:
            beyond = np.abs(centres - local.take(which, 0)) - halves
            np.maximum(beyond, 0.0, out=beyond)
            nearer: BoolArray = np.einsum("ki,ki->k", beyond, beyond) < best.take(which) ** 2
            return nearer

        for which, face in self._tree.pairs(np.arange(len(points)), meets):
            asked = local.take(which, 0)
            height = np.abs(dot(self._normals.take(face, 0), asked) - self._offsets.take(face))
            left = np.flatnonzero(height < best.take(which))
            np.minimum.at(best, which[left], self._measure(asked[left], face[left]))
        return best

    def _measure(self, points: FloatArray, face: IntArray) -> FloatArray:
        distance = np.zeros(len(points))
        for start in range(0, len(points), _PAIRS_AT_ONCE):
            part = slice(start, start + _PAIRS_AT_ONCE)
            distance[part] = distance_to_triangles(
                points[part], self._triangles.take(face[part], 0)
            )
        return distance


def distance_to_triangles(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Measure how far each point is from a triangle of its own.

    Parameters
    ----------
    points
        (K, 3) points.
    triangles
        (K, 3, 3) corners; a triangle without area is what is left of it, a line or a point.

    Returns
    -------
    FloatArray
        (K,) distances.
    """
    corners = [triangles[:, k] - points for k in range(3)]
    edges = [corners[(k + 1) % 3] - corners[k] for k in range(3)]
    squared = np.full(len(points), np.inf)
    for start, edge in zip(corners, edges, strict=True):
        length = dot(edge, edge)
        share = np.clip(-dot(start, edge) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        nearest = start + share[:, None] * edge
        np.minimum(squared, dot(nearest, nearest), out=squared)
    normal = cross(edges[0], edges[1])
    area = dot(normal, normal)
    above = area > 0
    for start, edge in zip(corners, edges, strict=True):
        above &= dot(cross(start, edge), normal) >= 0
    height = dot(normal, corners[0]) ** 2 / np.where(area > 0, area, 1.0)
    distance: FloatArray = np.sqrt(np.where(above, np.minimum(height, squared), squared))
    return distance
