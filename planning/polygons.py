"""Convex polygons in space: triangles that lie in one plane are merged while they stay convex."""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, IntArray

#: How far, as a share of the size of all vertices, corners may be off the plane or the convex side.
_TOLERANCE: Final = 1e-11


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
    loops: dict[int, list[int]] = {i: [int(v) for v in t] for i, t in enumerate(triangles)}
    owner = list(range(len(triangles)))

    def polygon_of(triangle: int) -> int:
        while owner[triangle] != triangle:
            owner[triangle] = owner[owner[triangle]]
            triangle = owner[triangle]
        return triangle

    shared = _coplanar_edges(vertices, triangles, tolerance)
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
    return [_proper_corners(vertices, loop, tolerance) for loop in loops.values()]


def clip_in_front(polygon: FloatArray) -> FloatArray:
    """Cut a convex polygon at the plane z = 0 and keep what is in front, its edge included.

    Parameters
    ----------
    polygon
        (N, 3) corners in order.

    Returns
    -------
    FloatArray
        (M, 3) corners in order; fewer than three when nothing with an area is left.
    """
    height = polygon[:, 2]
    if (height >= 0).all():
        return polygon if (height > 0).any() else polygon[:0]
    if not (height > 0).any():
        return polygon[:0]
    following, next_height = np.roll(polygon, -1, axis=0), np.roll(height, -1)
    corners = []
    for here, there, z, z_next in zip(polygon, following, height, next_height, strict=True):
        if z >= 0:
            corners.append(here)
        if z * z_next < 0:
            crossing = here + (there - here) * (z / (z - z_next))
            crossing[2] = 0.0
            corners.append(crossing)
    return np.array(corners)


def _coplanar_edges(
    vertices: FloatArray, triangles: IntArray, tolerance: float
) -> list[tuple[int, int, int, int]]:
    """Edges as (start, end, triangle that runs along it, triangle that runs against it)."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    faces = np.tile(np.arange(len(triangles)), 3)
    against = {(int(a), int(b)): int(f) for (a, b), f in zip(edges, faces, strict=True)}
    forward = edges[:, 0] < edges[:, 1]
    pairs = [
        (int(a), int(b), int(f), against[int(b), int(a)])
        for (a, b), f in zip(edges[forward], faces[forward], strict=True)
        if (int(b), int(a)) in against
    ]
    if not pairs:
        return []
    left, right = np.array(pairs)[:, 2], np.array(pairs)[:, 3]
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    off_plane = np.abs(
        np.einsum("fi,fki->fk", normals[left], corners[right] - corners[left][:, :1])
    ).max(axis=1)
    same_side = np.einsum("fi,fi->f", normals[left], normals[right]) > 0
    keep = (off_plane <= tolerance) & same_side
    return [pair for pair, kept in zip(pairs, keep, strict=True) if kept]


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
