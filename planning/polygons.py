"""Convex polygons in space: triangles that lie in one plane are merged while they stay convex."""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray

#: How far, as a share of the size of all vertices, corners may be off the plane or the convex side.
_TOLERANCE: Final = 1e-11
#: Of polygons thinner than this share of their length the side they turn to a point is unsure.
_THIN: Final = 1e-6


def area_vectors(corners: FloatArray) -> FloatArray:
    """Give the normal of polygons times their area, by Newell's sum.

    Parameters
    ----------
    corners
        (..., N, 3) corners in order; a corner that is repeated changes nothing.

    Returns
    -------
    FloatArray
        (..., 3) vectors; they point to where the corners are seen to go counter-clockwise.
    """
    local = corners - corners[..., :1, :]
    vectors: FloatArray = np.cross(local, np.roll(local, -1, axis=-2)).sum(axis=-2) / 2
    return vectors


def is_thin(corners: FloatArray) -> BoolArray:
    """Tell which polygons are so thin that the side they turn to a point is unsure.

    Parameters
    ----------
    corners
        (N, K, 3) corners in order; a corner that is repeated changes nothing.

    Returns
    -------
    BoolArray
        (N,) whether the area is less than a millionth of the longest side squared, or zero.
    """
    sides = corners - np.roll(corners, 1, axis=1)
    area = np.linalg.norm(area_vectors(corners), axis=-1)
    thin: BoolArray = area <= _THIN * (sides**2).sum(axis=-1).max(axis=1)
    return thin


def merge_convex(vertices: FloatArray, triangles: IntArray) -> list[IntArray]:
    """Merge neighbouring coplanar triangles into convex polygons.

    Edges between coplanar neighbours are dropped one after the other as long as what they part
    stays convex together (Hertel and Mehlhorn 1983: at most four times the fewest pieces possible).

    Parameters
    ----------
    vertices
        (V, 3) points.
    triangles
        (F, 3) indices, all turning the same way.

    Returns
    -------
    list of IntArray
        Corners of each polygon in order, as indices, without corners on a straight line.
    """
    tolerance = _TOLERANCE * float(np.ptp(vertices, axis=0).max())
    shared = _coplanar_edges(vertices, triangles, tolerance)
    # Most triangles of a curved surface have no neighbour in their plane: they stay as they are.
    alone = np.ones(len(triangles), dtype=bool)
    alone[[triangle for edge in shared for triangle in edge[2:]]] = False
    loops = {int(i): [int(v) for v in triangles[i]] for i in np.flatnonzero(~alone)}
    owner = list(range(len(triangles)))

    def polygon_of(triangle: int) -> int:
        while owner[triangle] != triangle:
            owner[triangle] = owner[owner[triangle]]
            triangle = owner[triangle]
        return triangle

    merged_any = True
    while merged_any:
        merged_any = False
        for start, end, left, right in shared:
            first, second = polygon_of(left), polygon_of(right)
            if first == second:
                continue
            joined = _joined(loops[first], loops[second], start, end)
            if joined and _is_convex(vertices[joined], tolerance):
                loops[first] = joined
                del loops[second]
                owner[second] = first
                merged_any = True
    merged = [_proper_corners(vertices, loop, tolerance) for loop in loops.values()]
    return [*triangles[alone], *merged]


def convex_quadrilaterals(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    """Cover a surface with convex quadrilaterals, as few as come easily.

    Parameters
    ----------
    vertices
        (V, 3) points.
    triangles
        (F, 3) indices, all turning the same way.

    Returns
    -------
    FloatArray
        (Q, 4, 3) corners in order. A triangle has its first corner twice.
    """
    found = [
        (loop[0], loop[i], loop[i + 1], loop[min(i + 2, len(loop)) % len(loop)])
        for loop in merge_convex(vertices, triangles)
        for i in range(1, len(loop) - 1, 2)
    ]
    return vertices[np.array(found, dtype=np.int64)]


def without_straight_corners(corners: FloatArray, tolerance: float) -> FloatArray:
    """Leave out corners that lie on the line between their neighbours.

    They go one after the other, so that of two corners at one place one remains.

    Parameters
    ----------
    corners
        (N, 3) corners of a polygon in order.
    tolerance
        How far they may be off that line.

    Returns
    -------
    FloatArray
        (M, 3) what remains; fewer than three when nothing but a line was given.
    """
    kept, k, unchanged = list(corners), 0, 0
    while len(kept) >= 3 and unchanged < len(kept):
        k %= len(kept)
        before, here, after = kept[k - 1], kept[k], kept[(k + 1) % len(kept)]
        chord, arm = after - before, here - before
        length = np.linalg.norm(chord)
        height = np.linalg.norm(np.cross(chord, arm)) / length if length > 0 else 0.0
        if height <= tolerance:
            del kept[k]
            unchanged = 0
        else:
            k, unchanged = k + 1, unchanged + 1
    return np.array(kept)


def clip_polygons(polygons: FloatArray, normal: FloatArray) -> tuple[FloatArray, IntArray]:
    """Cut many convex polygons at a plane through the origin and keep what is in front.

    Parameters
    ----------
    polygons
        (N, K, 3) corners in order. Corners may be repeated to fill up a row.
    normal
        (3,) normal of the plane, towards what is kept.

    Returns
    -------
    polygons : FloatArray
        (M, K + 1, 3) corners in order, the first one repeated where there are fewer.
    kept : IntArray
        (M,) which polygons they are of. What only touches the plane is kept as well.
    """
    height = polygons @ normal
    following, next_height = np.roll(polygons, -1, axis=1), np.roll(height, -1, axis=1)
    crossing = height * next_height < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(crossing, height / (height - next_height), 0.0)[..., None]
    count, corners = height.shape
    slots = np.stack([polygons, polygons + share * (following - polygons)], axis=2)
    used = np.stack([height >= 0, crossing], axis=2).reshape(count, 2 * corners)
    order = np.argsort(~used, axis=1, kind="stable")[:, : corners + 1]
    used = np.take_along_axis(used, order, axis=1)
    cut = np.take_along_axis(slots.reshape(count, 2 * corners, 3), order[..., None], axis=1)
    cut = np.where(used[..., None], cut, cut[:, :1])
    kept = np.flatnonzero(used[:, 0]) if count else np.zeros(0, dtype=np.int64)
    return cut[kept], kept


def _coplanar_edges(
    vertices: FloatArray, triangles: IntArray, tolerance: float
) -> list[tuple[int, int, int, int]]:
    """Edges as (start, end, triangle that runs along it, triangle that runs against it)."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    faces = np.tile(np.arange(len(triangles)), 3)
    count = int(edges.max(initial=0)) + 1
    along, against = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    order = np.argsort(along, kind="stable")
    place = np.searchsorted(along, against, sorter=order)
    other = order[np.minimum(place, len(order) - 1)] if len(order) else order
    paired = np.flatnonzero((edges[:, 0] < edges[:, 1]) & (along[other] == against))
    left, right = faces[paired], faces[other[paired]]
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    off_plane = np.abs(
        np.einsum("fi,fki->fk", normals[left], corners[right] - corners[left][:, :1])
    ).max(axis=1, initial=0.0)
    same_side = np.einsum("fi,fi->f", normals[left], normals[right]) > 0
    keep = (off_plane <= tolerance) & same_side
    found = np.column_stack([edges[paired], left, right])[keep]
    return [(int(a), int(b), int(f), int(g)) for a, b, f, g in found]


def _joined(first: list[int], second: list[int], start: int, end: int) -> list[int]:
    """Outline of two polygons together; the first runs along start → end, the second against it."""
    i, j = first.index(end), second.index(start)
    around = first[i:] + first[:i] + (second[j:] + second[:j])[1:-1]
    # Neighbours that share more than this edge leave spikes a, b, a behind.
    k = 0
    while len(around) > 2 and k < len(around):
        if around[k - 1] == around[(k + 1) % len(around)]:
            spike = sorted({k, (k + 1) % len(around)}, reverse=True)
            for index in spike:
                del around[index]
            k = 0
        else:
            k += 1
    return around if len(around) > 2 and len(set(around)) == len(around) else []


def _is_convex(corners: FloatArray, tolerance: float) -> bool:
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    length = np.linalg.norm(normal)
    if length == 0:
        return False
    normal = normal / length
    if np.abs((corners - corners[0]) @ normal).max() > tolerance:
        return False
    edges = np.roll(corners, -1, axis=0) - corners
    inward = np.cross(normal, edges)
    inward /= np.linalg.norm(inward, axis=-1, keepdims=True)
    # Every corner lies on the inner side of every edge: convex, and goes around only once.
    return bool(
        (np.einsum("ei,eci->ec", inward, corners[None] - corners[:, None]) >= -tolerance).all()
    )


def _proper_corners(vertices: FloatArray, loop: list[int], tolerance: float) -> IntArray:
    corners = vertices[loop]
    before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    chord = after - before
    length = np.linalg.norm(chord, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = np.linalg.norm(np.cross(chord, corners - before), axis=-1) / length
    proper = np.flatnonzero(~(height <= tolerance))
    return np.array(loop)[proper] if len(proper) >= 3 else np.array(loop)
