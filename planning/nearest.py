"""How far points are from a surface of triangles: exactly, and for many at once."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.box_tree import BoxTree, squared_distance
from planning.vectors import cross, dot

#: A triangle whose corner is narrower than this sine is what its edges are: its plane is unsure.
_SLIVER: Final = 1e-8
#: How unsure the height above a plane is at most, as a share of the size of everything.
_UNSURE: Final = 1e-7
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
        self._tree = BoxTree.about(self._triangles)
        a, b, c = np.moveaxis(self._triangles, 1, 0)
        normals, length = _plane_normals(b - a, c - b)
        # A sliver has no plane that it could be known to be far away from.
        self._normals: FloatArray = normals / np.where(length > 0, length, np.inf)[:, None]
        self._offsets: FloatArray = dot(self._normals, a)
        # Each place once: a tree of repeated points is slow.
        self._corners = cKDTree(np.unique(self._triangles.reshape(-1, 3), axis=0))

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
        across = np.ascontiguousarray(local.T)
        # No triangle that matters is farther away than the nearest corner.
        best = np.asarray(self._corners.query(local)[0])

        def meets(
            which: IntArray, centres: FloatArray, halves: FloatArray, _: IntArray
        ) -> BoolArray:
            squared = squared_distance(across.take(which, 1), centres, halves)
            nearer: BoolArray = squared < best.take(which) ** 2
            return nearer

        unsure = _UNSURE * float(max(np.abs(local).max(initial=0.0), np.abs(self._triangles).max()))
        for which, face in self._tree.pairs(np.arange(len(points)), meets):
            asked = local.take(which, 0)
            height = np.abs(dot(self._normals.take(face, 0), asked) - self._offsets.take(face))
            left = np.flatnonzero(height <= best.take(which) + unsure)
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
        (K, 3, 3) corners; a triangle without area is what is left of it, a line or a point, and so
        is one that is a hundred million times longer than wide.

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
    normal, length = _plane_normals(edges[0], edges[1])
    above = length > 0
    for start, edge in zip(corners, edges, strict=True):
        above &= dot(cross(start, edge), normal) >= 0
    height = (dot(normal, corners[0]) / np.where(length > 0, length, 1.0)) ** 2
    distance: FloatArray = np.sqrt(np.where(above, np.minimum(height, squared), squared))
    return distance


def _plane_normals(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(K, 3) cross products of two edges and (K,) their lengths, zero for slivers."""
    normal = cross(first, second)
    length = np.sqrt(dot(normal, normal))
    sides = np.sqrt(dot(first, first) * dot(second, second))
    return normal, np.where(length > _SLIVER * sides, length, 0.0)
