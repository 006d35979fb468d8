"""Where a surface crosses itself: near-linear, in float64, with what counts as contact stated.

Boxes around the triangles make a tree along a space-filling curve; the tree is walked against
itself, level by level, in arrays. What is left is decided by the separating-axis theorem: triangles
that only touch, at a vertex, along an edge, or lying against each other, do not cross.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray

#: How deep, as a share of the size of the mesh, triangles may reach through each other: vertices in
#: single precision are off by about that much.
CONTACT: Final = 1e-7
#: Pairs that are worked on at once.
_PAIRS_AT_ONCE: Final = 200_000
#: Bits of each coordinate along the space-filling curve.
_BITS: Final = 20


class Crossing(NamedTuple):
    """One of the places where a surface goes through itself.

    Parameters
    ----------
    place
        (3,) a point on the line where the two triangles meet.
    faces
        The two triangles.
    """

    place: FloatArray
    faces: tuple[int, int]


def find_crossing(vertices: FloatArray, faces: IntArray) -> Crossing | None:
    """Look for two triangles of a mesh that go through each other.

    Parameters
    ----------
    vertices
        (V, 3) corners; those of neighbours must be the same ones.
    faces
        (F, 3) indices.

    Returns
    -------
    Crossing or None
        One of them; None when there is none. Coplanar triangles cross when they overlap and face
        the same way.
    """
    if len(faces) < 2:
        return None
    size = float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max())
    triangles = (vertices - vertices[faces[0, 0]])[faces] / (size or 1.0)
    for pairs in _overlapping_boxes(triangles):
        for start in range(0, len(pairs), _PAIRS_AT_ONCE):
            part = pairs[start : start + _PAIRS_AT_ONCE]
            crossing = part[_cross(triangles, part)]
            if len(crossing):
                first, second = (int(k) for k in crossing[0])
                place = _meeting_point(vertices[faces[first]], vertices[faces[second]])
                return Crossing(place, (first, second))
    return None


def _overlapping_boxes(triangles: FloatArray) -> list[IntArray]:
    """Pairs of triangles whose boxes meet, as (K, 2) indices in handy portions."""
    order = _along_curve(triangles.mean(axis=1))
    leaves = 1 << int(len(order) - 1).bit_length()
    low = np.full((leaves, 3), np.inf)
    high = np.full((leaves, 3), -np.inf)
    low[: len(order)] = triangles[order].min(axis=1)
    high[: len(order)] = triangles[order].max(axis=1)
    levels = [(low, high)]
    while len(levels[-1][0]) > 1:
        below_low, below_high = levels[-1]
        levels.append(
            (
                np.minimum(below_low[::2], below_low[1::2]),
                np.maximum(below_high[::2], below_high[1::2]),
            )
        )
    stack = [(len(levels) - 1, np.zeros((1, 2), dtype=np.int64))]
    found = []
    while stack:
        level, pairs = stack.pop()
        if level == 0:
            found.append(order[pairs[pairs[:, 0] < pairs[:, 1]]])
            continue
        low, high = levels[level - 1]
        first = np.concatenate([2 * pairs[:, 0] + i for i in (0, 0, 1, 1)])
        second = np.concatenate([2 * pairs[:, 1] + j for j in (0, 1, 0, 1)])
        # Of the four pairs below a pair of a node with itself one comes twice.
        meet = first <= second
        for axis in range(3):
            meet &= low[first, axis] <= high[second, axis]
            meet &= low[second, axis] <= high[first, axis]
        below = np.stack([first[meet], second[meet]], axis=-1)
        stack += [
            (level - 1, below[start : start + _PAIRS_AT_ONCE])
            for start in range(0, len(below), _PAIRS_AT_ONCE)
        ]
    return found


def _along_curve(points: FloatArray) -> IntArray:
    """Order points along a Morton curve, so that neighbours in the order are near each other."""
    low = points.min(axis=0)
    extent = np.ptp(points, axis=0).max() or 1.0
    cells = ((points - low) / extent * ((1 << _BITS) - 1)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def _cross(triangles: FloatArray, pairs: IntArray) -> BoolArray:
    """(K,) whether the triangles of each pair go through each other."""
    first, second = triangles[pairs[:, 0]], triangles[pairs[:, 1]]
    normals_first, normals_second = _unit_normals(first), _unit_normals(second)
    depth = np.minimum(
        _overlap(normals_first, first, second), _overlap(normals_second, second, first)
    )
    crossing = depth > CONTACT
    facing_alike = np.einsum("ki,ki->k", normals_first, normals_second) > 0.5
    coplanar = facing_alike & _is_coplanar(normals_first, first, second)
    for which, axes_of in ((crossing, _edge_products), (coplanar, _in_plane_axes)):
        left = np.flatnonzero(which)
        axes = axes_of(first[left], second[left], normals_first[left])
        deep = np.ones(len(left), dtype=bool)
        for k in range(axes.shape[1]):
            length = np.linalg.norm(axes[:, k], axis=-1)
            unit = axes[:, k] / np.where(length > 0, length, 1.0)[:, None]
            deep &= (length <= 1e-12) | (_overlap(unit, first[left], second[left]) > CONTACT)
        which[left] = deep
    either: BoolArray = crossing | coplanar
    return either


def _unit_normals(triangles: FloatArray) -> FloatArray:
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    unit: FloatArray = normals / np.where(length > 0, length, 1.0)
    return unit


def _overlap(axes: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """(K,) by how much two triangles overlap along an axis; negative: they are apart."""
    one = np.einsum("ki,kci->kc", axes, first)
    other = np.einsum("ki,kci->kc", axes, second)
    overlap: FloatArray = np.minimum(
        one.max(axis=1) - other.min(axis=1), other.max(axis=1) - one.min(axis=1)
    )
    return overlap


def _is_coplanar(normals: FloatArray, first: FloatArray, second: FloatArray) -> BoolArray:
    height = np.einsum("ki,kci->kc", normals, second - first[:, :1])
    flat: BoolArray = np.abs(height).max(axis=1) <= CONTACT
    return flat


def _edge_products(first: FloatArray, second: FloatArray, normals: FloatArray) -> FloatArray:
    del normals
    products = np.cross(_edges(first)[:, :, None], _edges(second)[:, None, :])
    return products.reshape(len(first), 9, 3)


def _in_plane_axes(first: FloatArray, second: FloatArray, normals: FloatArray) -> FloatArray:
    edges = np.concatenate([_edges(first), _edges(second)], axis=1)
    axes: FloatArray = np.cross(normals[:, None], edges)
    return axes


def _edges(triangles: FloatArray) -> FloatArray:
    edges: FloatArray = np.roll(triangles, -1, axis=1) - triangles
    return edges


def _meeting_point(first: FloatArray, second: FloatArray) -> FloatArray:
    """Where an edge of one triangle goes deepest through the other; for coplanar ones between."""
    best, place = -np.inf, np.concatenate([first, second]).mean(axis=0)
    for edges_of, through in ((first, second), (second, first)):
        normal = np.cross(through[1] - through[0], through[2] - through[0])
        area = float(normal @ normal)
        for start, stop in zip(edges_of, np.roll(edges_of, -1, axis=0), strict=True):
            before, behind = (start - through[0]) @ normal, (stop - through[0]) @ normal
            if before * behind >= 0 or area == 0:
                continue
            point = start + (stop - start) * (before / (before - behind))
            inside = min(
                float(np.cross(b - a, point - a) @ normal) / area
                for a, b in zip(through, np.roll(through, -1, axis=0), strict=True)
            )
            if inside > best:
                best, place = inside, point
    return np.asarray(place)
