"""Pyramids of sight: the hulls of a viewpoint and a convex target, and what reaches into them.

All is decided by separating axes. Two convex bodies are apart when the normal of a face of either,
or the cross product of an edge of each, has one on each side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.vectors import cross, dot

#: Pairs of pyramid and triangle that are worked on at once.
_PAIRS_AT_ONCE: Final = 4_096


@dataclass(frozen=True, slots=True, eq=False)
class Pyramids:
    """The pyramids of many viewpoints over one convex target, flat when the target is a segment.

    Parameters
    ----------
    apexes
        (N, 3) viewpoints, all in front of a polygon.
    base
        (M, 3) corners of the target, counter-clockwise seen from the front; two for a segment.
    contact
        (N,) how deep something may reach in and still only touch.
    normals
        (N, P, 3) unit normals of the half-spaces that make up each pyramid, inwards; zero where
        the pyramid is too thin to have that side.
    offsets
        (N, P) normal · point of their planes; minus infinity where there is no normal.
    """

    apexes: FloatArray
    base: FloatArray
    contact: FloatArray
    normals: FloatArray
    offsets: FloatArray

    @classmethod
    def over(cls, base: FloatArray, apexes: FloatArray, contact: FloatArray) -> Pyramids:
        """Build the pyramids.

        Parameters
        ----------
        base
            (M, 3) corners of the target.
        apexes
            (N, 3) viewpoints.
        contact
            (N,) as in the class.

        Returns
        -------
        Pyramids
            The pyramids.
        """
        count = len(apexes)
        if len(base) == 2:
            a, b = base
            across = np.cross(b - a, apexes - a)
            ends = [np.broadcast_to(a, apexes.shape), np.broadcast_to(b, apexes.shape), apexes]
            following = [*ends[1:], ends[0]]
            inwards = [np.cross(across, q - p) for p, q in zip(ends, following, strict=True)]
            normals = np.stack([*inwards, across, -across], axis=1)
            points = np.stack([*ends, ends[0], ends[0]], axis=1)
        else:
            rim = np.roll(base, -1, axis=0) - base
            upright = np.cross(base, np.roll(base, -1, axis=0)).sum(axis=0)
            sides = np.cross(apexes[:, None] - base, rim)
            normals = np.concatenate([sides, np.tile(upright, (count, 1, 1))], axis=1)
            points = np.tile(np.concatenate([base, base[:1]]), (count, 1, 1))
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = normals / np.where(length > 0, length, 1.0)
        offsets = np.einsum("npi,npi->np", normals, points)
        return cls(apexes, base, contact, normals, np.where(length[..., 0] > 0, offsets, -np.inf))

    def reach_boxes(self, which: IntArray, centres: FloatArray, halves: FloatArray) -> BoolArray:
        """Tell which pyramids may meet a box: no side of theirs has all of the box outside.

        Parameters
        ----------
        which
            (K,) indices of pyramids.
        centres, halves
            (K, 3) of the boxes.

        Returns
        -------
        BoolArray
            (K,) False only if nothing in the box reaches into the pyramid.
        """
        normals = self.normals.take(which, 0)
        deepest = np.matmul(normals, centres[..., None])[..., 0]
        deepest += np.matmul(np.abs(normals, out=normals), halves[..., None])[..., 0]
        deepest -= self.offsets.take(which, 0)
        # What does not pass a plane by the contact is separated by it; half of it covers rounding.
        reach: BoolArray = _least(deepest) > self.contact.take(which) / 2
        return reach

    def met_by(self, which: IntArray, triangles: FloatArray) -> BoolArray:
        """Tell which pyramids have a triangle reaching into them.

        Parameters
        ----------
        which
            (K,) indices of pyramids.
        triangles
            (K, 3, 3) corners of a triangle for each.

        Returns
        -------
        BoolArray
            (K,) exact up to the contact.
        """
        met = np.zeros(len(which), dtype=bool)
        for start in range(0, len(which), _PAIRS_AT_ONCE):
            part = slice(start, start + _PAIRS_AT_ONCE)
            asked, corners = which[part], triangles[part]
            contact = self.contact.take(asked)
            depth = np.matmul(self.normals.take(asked, 0), np.swapaxes(corners, 1, 2))
            depth -= self.offsets.take(asked, 0)[..., None]
            # A corner that is deep inside settles it, and so does a side that all are outside of.
            if len(self.base) > 2:
                met[part] = _most(_least(np.swapaxes(depth, 1, 2))) > contact
            left = np.flatnonzero(~met[part] & (_least(_most(depth)) > contact / 2))
            met[start + left] = self._overlap(asked[left], corners[left])
        return met

    def pierced_by(self, which: IntArray, aim: FloatArray, triangles: FloatArray) -> BoolArray:
        """Tell where the line from a viewpoint to a point of the target proves that it is hidden.

        Parameters
        ----------
        which
            (K,) indices of pyramids.
        aim
            (3,) the point, inside of the target.
        triangles
            (K, 3, 3) corners of a triangle for each.

        Returns
        -------
        BoolArray
            (K,) True only where the line runs through the triangle, well inside of the pyramid. A
            flat pyramid has no inside: there the triangle is judged by all axes.
        """
        if len(self.base) == 2:
            return self.met_by(which, triangles)
        apexes = self.apexes.take(which, 0)
        corners = triangles - apexes[:, None]
        ray = aim - apexes
        a, b, c = (corners[:, k] for k in range(3))
        sides = np.stack([dot(cross(p, q), ray) for p, q in ((a, b), (b, c), (c, a))])
        through = (sides > 0).all(axis=0) | (sides < 0).all(axis=0)
        normal = cross(b - a, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = dot(normal, a) / dot(normal, ray)
        place = apexes + share[:, None] * ray
        depth = np.matmul(self.normals.take(which, 0), place[..., None])[..., 0]
        depth -= self.offsets.take(which, 0)
        # Twice the contact: the place itself is rounded. NaN compares as False.
        proved: BoolArray = through & (_least(depth) > 2 * self.contact.take(which))
        return proved

    def _overlap(self, which: IntArray, triangles: FloatArray) -> BoolArray:
        """All axes: the normals settle most pairs, the products of edges are for the rest."""
        base, apexes, limit = self.base, self.apexes.take(which, 0), -self.contact.take(which)
        edges = np.stack([triangles[:, (k + 1) % 3] - triangles[:, k] for k in range(3)], axis=1)
        own = cross(edges[:, :1], edges[:, 1:2])
        overlap: BoolArray = _widest_gap(own, apexes, base, triangles) < limit
        left = np.flatnonzero(overlap)
        rim = (np.roll(base, -1, axis=0) - base)[: 1 if len(base) == 2 else None]
        sides = apexes[left, None] - base
        pyramid_edges = np.concatenate([np.broadcast_to(rim, (len(left), *rim.shape)), sides], 1)
        products = cross(pyramid_edges[:, :, None], edges[left][:, None])
        products = products.reshape(len(left), 3 * pyramid_edges.shape[1], 3)
        axes = np.concatenate([self.normals[which[left]], products], axis=1)
        overlap[left] = _widest_gap(axes, apexes[left], base, triangles[left]) < limit[left]
        return overlap


def _least(values: FloatArray) -> FloatArray:
    """Smallest along the last axis, which is short."""
    return reduce(np.minimum, np.moveaxis(values, -1, 0))


def _most(values: FloatArray) -> FloatArray:
    """Largest along the last axis, which is short."""
    return reduce(np.maximum, np.moveaxis(values, -1, 0))


def _widest_gap(
    axes: FloatArray, apexes: FloatArray, base: FloatArray, triangles: FloatArray
) -> FloatArray:
    """(K,) widest gap between pyramid and triangle along (K, A, 3) axes; negative: they overlap."""
    length = np.sqrt(np.einsum("kai,kai->ka", axes, axes))
    pyramid = [np.matmul(axes, apexes[..., None])[..., 0], *(axes @ corner for corner in base)]
    triangle = list(np.moveaxis(np.matmul(axes, np.swapaxes(triangles, 1, 2)), -1, 0))
    gap = np.maximum(
        reduce(np.minimum, pyramid) - reduce(np.maximum, triangle),
        reduce(np.minimum, triangle) - reduce(np.maximum, pyramid),
    )
    # An axis of no length (parallel edges) separates nothing.
    gap /= np.where(length > 0, length, 1.0)
    gap[length == 0] = -np.inf
    return _most(gap)
