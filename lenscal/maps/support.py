"""Samples to the outline of what they support in the (zoom, focus) plane.

A lens that is not parfocal is sampled over a curved strip, whose hull would bridge the bends. Where
samples stand in columns of equal zoom, as sessions take them, the outline joins the ends of
neighbouring columns. Else it is dug out of the hull: the characteristic shape of Duckham et al.,
Pattern Recognition 41 (2008), of the Delaunay triangulation.
"""

from __future__ import annotations

import heapq
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import Delaunay

from lenscal.arrays import BoolArray, FloatArray

#: Share of the sampled range within which two values are one.
_SAME: Final = 1e-9
#: Share of the sampled range of focus that a column covers at least.
_NARROW: Final = 1e-6
#: So many neighbouring columns may lack a sample that those on both sides have.
_MISSING: Final = 2
#: Columns of equal zoom hold at least this share of the samples where sampling went by columns.
_SHARE_IN_COLUMNS: Final = 0.75
#: Columns of unlike counts hold so many samples on average; else their zooms agree by chance.
_MANY: Final = 5
#: A side of the outline is at most so many times as long as the longest step between samples.
_REACH: Final = 2.5

Column = tuple[float, float, float]  # zoom, lowest and highest focus


def outline_of(zoom: FloatArray, focus: FloatArray) -> FloatArray:
    """Draw the outline of what samples support: one piece, without holes, that holds all of them.

    Parameters
    ----------
    zoom, focus
        (N,) sampled settings, in any order, repeated or not.

    Returns
    -------
    FloatArray
        (V, 2) its corners, zoom and focus, counter-clockwise; the two ends of samples on a line,
        and a single sample itself.
    """
    points = np.unique(np.stack([zoom, focus], axis=-1), axis=0)
    span = np.ptp(points, axis=0)
    scaled = (points - points.min(axis=0)) / np.where(span > 0, span, 1.0)
    # Of samples that are one but for rounding one is kept, since triangles need a size.
    _, first = np.unique(np.rint(scaled / (0.1 * _SAME)), axis=0, return_index=True)
    points, scaled = points[first], scaled[first]
    flat = np.linalg.svd(scaled - scaled.mean(axis=0), compute_uv=False)
    if len(points) < 3 or flat[-1] < _SAME * flat[0]:
        return np.unique(points[[0, -1]], axis=0)
    columns = np.split(points, np.flatnonzero(np.diff(scaled[:, 0]) > _SAME) + 1)
    columns = [column[np.argsort(column[:, 1])] for column in columns]
    whole = _whole(columns, _NARROW * span[1])
    outline = _joined(columns, whole, _SAME * span[1]) if whole.any() else _dug_out(points)
    return _without_straight_angles(outline, span)


def _whole(columns: list[FloatArray], narrow: float) -> BoolArray:
    """(M,) which columns are whole; none where sampling did not go by columns.

    A column between fuller ones, as a single setting beside a grid makes, is not whole.
    """
    count = np.array([len(column) if np.ptp(column[:, 1]) > narrow else 1 for column in columns])
    fullest_before = np.maximum.accumulate(np.concatenate([[0], count[:-1]]))
    fullest_after = np.maximum.accumulate(np.concatenate([[0], count[:0:-1]]))[::-1]
    whole = (count > 1) & (2 * count > np.minimum(fullest_before, fullest_after))
    none = np.zeros(len(count), dtype=bool)
    places = np.flatnonzero(whole)
    # Two single samples in a row at an end would make an outline without width.
    if len(places) < 2 or places[0] > 1 or places[-1] < len(count) - 2:
        return none
    alike = 2 * (2 * count > count.max()).sum() >= len(count)
    by_columns = (
        count[whole].mean() >= (2 if alike else _MANY)
        and count[whole].sum() >= _SHARE_IN_COLUMNS * count.sum()
    )
    return whole if by_columns else none


def _joined(columns: list[FloatArray], whole: BoolArray, same: float) -> FloatArray:
    """Join the ends of neighbouring columns; columns of few samples only add what lies outside."""
    main = _with_missing_ends([c for c, w in zip(columns, whole, strict=True) if w], same)
    zooms, lows, highs = np.array(main).T
    for column in (c for c, w in zip(columns, whole, strict=True) if not w):
        zoom, low, high = column[0, 0], column[0, 1], column[-1, 1]
        if zooms[0] < zoom < zooms[-1]:
            between = [float(np.interp(zoom, zooms, ends)) for ends in (lows, highs)]
            if between[0] <= low and high <= between[1]:
                continue
            low, high = min(low, between[0]), max(high, between[1])
        main.append((float(zoom), float(low), float(high)))
    main.sort()
    below = [(zoom, low) for zoom, low, _ in main]
    above = [(zoom, high) for zoom, _, high in reversed(main)]
    return np.array(below + above)


def _with_missing_ends(columns: list[FloatArray], same: float) -> list[Column]:
    """Ends of each column, and of the rows that pass through it from neighbour to neighbour."""
    ends = [[float(c[0, 0]), float(c[0, 1]), float(c[-1, 1])] for c in columns]
    index = np.repeat(np.arange(len(columns)), [len(c) for c in columns])
    focus = np.concatenate(columns)[:, 1]
    order = np.lexsort((index, focus))
    rows = np.split(order, np.flatnonzero(np.diff(focus[order]) > same) + 1)
    for row in rows:
        for a, b in pairwise(sorted(row, key=lambda sample: int(index[sample]))):
            if index[b] - index[a] <= _MISSING + 1:
                for column in ends[index[a] + 1 : index[b]]:
                    column[1] = min(column[1], float(focus[a]))
                    column[2] = max(column[2], float(focus[a]))
    return [(zoom, low, high) for zoom, low, high in ends]


def _dug_out(points: FloatArray) -> FloatArray:
    """Dig long sides of the hull away, as long as the outline stays one simple polygon."""
    # On a grid a step is one along either axis; elsewhere the axes are scaled by their ranges.
    steps = np.array([len(np.unique(values)) - 1 for values in points.T])
    scaled = (points - points.min(axis=0)) / np.ptp(points, axis=0) * steps
    if steps.min() > 0.5 * len(points):
        scaled = scaled / steps
    mesh = Delaunay(scaled)
    longest = _REACH * _longest_step(mesh)
    follows: dict[int, int] = {}
    sides: list[tuple[float, int, int]] = []  # negative length, triangle inside, place opposite

    def add(triangle: int, opposite: int) -> None:
        start, stop = _side(mesh, triangle, opposite)
        follows[start] = stop
        length = float(np.linalg.norm(scaled[stop] - scaled[start]))
        heapq.heappush(sides, (-length, triangle, opposite))

    for triangle, opposite in np.argwhere(mesh.neighbors == -1):
        add(int(triangle), int(opposite))
    while sides and -sides[0][0] > longest:
        _, triangle, opposite = heapq.heappop(sides)
        vertex = int(mesh.simplices[triangle, opposite])
        if vertex in follows:
            continue  # without this triangle the outline would touch itself
        start, _ = _side(mesh, triangle, opposite)
        del follows[start]
        for place in (p for p in range(3) if p != opposite):
            beyond = int(mesh.neighbors[triangle, place])
            add(beyond, int(np.flatnonzero(mesh.neighbors[beyond] == triangle)[0]))
    first = min(follows)
    ring = [first]
    while (after := follows[ring[-1]]) != first:
        ring.append(after)
    return np.asarray(points[ring])


def _side(mesh: Delaunay, triangle: int, opposite: int) -> tuple[int, int]:
    """Ends of the side opposite to a corner, in the order of the triangle, counter-clockwise."""
    corners = mesh.simplices[triangle]
    return int(corners[(opposite + 1) % 3]), int(corners[(opposite + 2) % 3])


def _longest_step(mesh: Delaunay) -> float:
    """Longest of the steps by which all samples can be reached from one another."""
    a, b = (mesh.simplices[:, [i, j]] for i, j in ((0, 1), (1, 2)))
    c = mesh.simplices[:, [2, 0]]
    edges = np.unique(np.sort(np.concatenate([a, b, c]), axis=1), axis=0)
    lengths = np.linalg.norm(np.diff(mesh.points[edges], axis=1)[:, 0], axis=-1)
    count = len(mesh.points)
    graph = coo_array((lengths, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return float(minimum_spanning_tree(graph.tocsr()).data.max())


def _without_straight_angles(outline: FloatArray, span: FloatArray) -> FloatArray:
    """Leave out repeated corners and those on the line between their neighbours."""
    ring = outline[(outline != np.roll(outline, 1, axis=0)).any(axis=1)]
    before = (ring - np.roll(ring, 1, axis=0)) / span
    after = np.roll(before, -1, axis=0)
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    lengths = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    return np.asarray(ring[np.abs(turn) > _SAME * lengths])
