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
    planes
        (P, 4, N) of the half-spaces that make up each pyramid: unit normal, inwards, and normal ·
        point. Where the pyramid is too thin to have that side they are zero and minus infinity.
        Pyramids stand innermost: picking by components is twice as fast.
    """

    apexes: FloatArray
    base: FloatArray
    contact: FloatArray
    planes: FloatArray

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
        offsets[length[..., 0] == 0] = -np.inf
        rows = np.concatenate([normals, offsets[..., None]], axis=-1)
        return cls(apexes, base, contact, np.ascontiguousarray(rows.transpose(1, 2, 0)))

    def reach_boxes(
        self, which: IntArray, centres: FloatArray, halves: FloatArray, points: FloatArray
    ) -> tuple[BoolArray, BoolArray]:
        """Tell which pyramids may meet a box, and which surely meet what is in it.

        They may if no side of theirs has all of the box outside; they do if a point of some face
        in the box lies inside of them.

        Parameters
        ----------
        which
            (K,) indices of pyramids.
        centres, halves
            (3, K) of the boxes.
        points
            (3, K) a point of a face in each box.

        Returns
        -------
        reach : BoolArray
            (K,) False only if nothing in the box reaches into the pyramid.
        hold : BoolArray
            (K,) True only if the point lies inside, deeper than what counts as contact. A flat
            pyramid has no inside.
        """
        box, inside = (np.full(len(which), np.inf) for _ in range(2))
        for plane in self.planes:
            *normal, offset = plane.take(which, 1)
            depth = _along(normal, centres)
            depth -= offset
            place = _along(normal, points)
            place -= offset
            for n, reach in zip(normal, halves, strict=True):
                np.abs(n, out=n)
                n *= reach
                depth += n
            np.minimum(box, depth, out=box)
            np.minimum(inside, place, out=inside)
        contact = self.contact.take(which)
        # What does not pass a plane by the contact is separated by it; half of it covers rounding,
        # and twice of it that the point is rounded.
        return box > contact / 2, (inside > 2 * contact) & (len(self.base) > 2)

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
            places = np.ascontiguousarray(corners.transpose(1, 2, 0))
            inside = np.full((3, len(asked)), np.inf)
            reach = np.full(len(asked), np.inf)
            for plane in self.planes:
                *normal, offset = plane.take(asked, 1)
                depth = np.stack([_along(normal, place) for place in places])
                depth -= offset
                np.minimum(inside, depth, out=inside)
                np.minimum(reach, depth.max(axis=0), out=reach)
            # A corner that is deep inside settles it, and so does a side that all are outside of.
            if len(self.base) > 2:
                met[part] = inside.max(axis=0) > contact
            left = np.flatnonzero(~met[part] & (reach > contact / 2))
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
        through: BoolArray = np.logical_or((sides > 0).all(axis=0), (sides < 0).all(axis=0))
        normal = cross(b - a, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = dot(normal, a) / dot(normal, ray)
        place = np.ascontiguousarray((apexes + share[:, None] * ray).T)
        # Twice the contact: the place itself is rounded. NaN compares as False.
        limit = 2 * self.contact.take(which)
        for plane in self.planes:
            *towards, offset = plane.take(which, 1)
            np.logical_and(through, _along(towards, place) - offset > limit, out=through)
        return through

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
        normals = self.planes[:, :3, which[left]].transpose(2, 0, 1)
        axes = np.concatenate([normals, products], axis=1)
        overlap[left] = _widest_gap(axes, apexes[left], base, triangles[left]) < limit[left]
        return overlap


def _along(normal: list[FloatArray], place: FloatArray) -> FloatArray:
    """(K,) normal · place, of components."""
    product: FloatArray = normal[0] * place[0]
    product += normal[1] * place[1]
    product += normal[2] * place[2]
    return product


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
