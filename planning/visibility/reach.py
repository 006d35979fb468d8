"""How far a star-shaped solid reaches in every direction, as bounds that are safe and fast to ask.

A piece of the scene takes something away from the viewpoints V that see a target so far only when
the piece itself sticks into V (`docs/visibility.md`). V is star-shaped about a point of the target.
Seen from there through the six windows of a cube, with w = 1/depth, V is what lies above a function
h(u, v), and a flat triangle is a piece of a plane. On a grid of cells in each window, h is bounded
from below and a triangle from above. Where the bounds do not overlap, the triangle is outside of V.
All is computed in double precision, and doubt counts as sticking in.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.polygons import clip_polygons

#: Pairs of triangle and cell that are worked on at once.
_PAIRS_AT_ONCE: Final = 1_000_000
#: What rounding may do to positions in a window and, as a share, to depths.
_POSITION_SLACK: Final = 1e-9
_DEPTH_SLACK: Final = 1e-12
#: What passes the origin at less than this share of its size passes through it.
_ON_ORIGIN: Final = 1e-13

#: The windows: rows are the axes u, v and depth of each.
_AXES: Final = np.eye(3)
_WINDOWS: Final = tuple(
    np.stack([np.roll(_AXES, -1 - axis, axis=0)[0], np.roll(_AXES, -2 - axis, axis=0)[0], depth])
    for axis in range(3)
    for depth in (_AXES[axis], -_AXES[axis])
)
#: The sides of a window: inside, normal · point ≥ 0.
_SIDES: Final = np.array([[1.0, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]])


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """Lower bounds of w = 1/depth on the boundary of a star-shaped solid, window by window.

    Parameters
    ----------
    nearest
        (6, C, C) bounds; infinite where the solid does not go at all.
    """

    nearest: FloatArray

    @classmethod
    def of(cls, triangles: FloatArray, cells: int) -> Reach:
        """Measure a solid that is star-shaped about the origin.

        Parameters
        ----------
        triangles
            (F, 3, 3) its surface.
        cells
            How many cells a window has along each side.

        Returns
        -------
        Reach
            The bounds.
        """
        nearest = np.full((len(_WINDOWS), cells * cells), np.inf)
        # Faces in planes through the origin are seen edge-on: their neighbours bound h there.
        triangles = triangles[~_edge_on(triangles)]
        for window, axes in enumerate(_WINDOWS):
            for seen in _through_window(triangles @ axes.T, cells):
                lower = np.maximum(seen.plane - seen.spread, seen.least)
                np.minimum.at(nearest[window], seen.cell, lower * (1 - _DEPTH_SLACK))
        return cls(nearest.reshape(-1, cells, cells))

    def entered_by(self, triangles: FloatArray) -> BoolArray:
        """Tell which triangles may stick into the solid.

        Parameters
        ----------
        triangles
            (F, 3, 3) triangles anywhere.

        Returns
        -------
        BoolArray
            (F,). False is certain: the triangle and the inside of the solid do not meet.
        """
        cells = self.nearest.shape[-1]
        # About the origin itself a window shows nothing.
        enters: BoolArray = _touches_origin(triangles)
        for axes, nearest in zip(_WINDOWS, self.nearest.reshape(-1, cells * cells), strict=True):
            open_ = np.flatnonzero(~enters)
            for seen in _through_window(triangles[open_] @ axes.T, cells):
                upper = np.minimum(seen.plane + seen.spread, seen.greatest)
                sticks = upper * (1 + _DEPTH_SLACK) > nearest[seen.cell]
                enters[open_[seen.triangle[sticks]]] = True
        return enters


@dataclass(frozen=True, slots=True, eq=False)
class Girth:
    """How far a solid goes at most from the axis z, up to several heights.

    Parameters
    ----------
    heights
        (L,) rising; the last one is that of the solid.
    radii
        (L,) greatest distance from the axis of what is not higher.
    """

    heights: FloatArray
    radii: FloatArray

    @classmethod
    def of(cls, triangles: FloatArray, levels: int = 33) -> Girth:
        """Measure a solid.

        Parameters
        ----------
        triangles
            (F, 3, 3) its surface.
        levels
            At how many heights.

        Returns
        -------
        Girth
            The radii.
        """
        highest = max(float(triangles[..., 2].max()), float(np.finfo(np.float64).tiny))
        heights = highest * np.append(np.geomspace(1e-4, 1.0, levels)[:-1], 1.0)
        ends = np.stack([triangles, np.roll(triangles, -1, axis=1)]).reshape(2, -1, 3)
        lower, upper = np.where(ends[0, :, 2:] <= ends[1, :, 2:], ends, ends[::-1])
        # The farthest of what is not higher than a level lies on an edge, at its lower end or where
        # it leaves the level.
        rise = np.maximum(upper[:, 2] - lower[:, 2], np.finfo(np.float64).tiny)
        share = np.clip((heights[:, None] - lower[:, 2]) / rise, 0.0, 1.0)
        leaves = lower[:, :2] + share[..., None] * (upper - lower)[:, :2]
        away = np.maximum(np.linalg.norm(leaves, axis=-1), np.linalg.norm(lower[:, :2], axis=-1))
        counts = lower[:, 2] <= heights[:, None]
        return cls(heights, np.where(counts, away, 0.0).max(axis=1))

    def misses(self, low: FloatArray, high: FloatArray) -> BoolArray:
        """Tell which boxes lie beside the solid.

        Parameters
        ----------
        low, high
            (N, 3) corners of boxes along the axes.

        Returns
        -------
        BoolArray
            (N,) True is certain.
        """
        aside = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0)[:, :2], axis=-1)
        level = np.searchsorted(self.heights, high[:, 2])
        beside: BoolArray = (
            aside * (1 - _POSITION_SLACK) > self.radii[np.minimum(level, len(self.radii) - 1)]
        )
        return beside


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Pairs of triangle and cell in a window, and bounds of w for each pair."""

    triangle: IntArray
    cell: IntArray
    #: w of the triangle's plane at the middle of the cell, and how much it changes within.
    plane: FloatArray
    spread: FloatArray
    #: Least and greatest w of the corners of what the window shows of the triangle.
    least: FloatArray
    greatest: FloatArray


def _through_window(triangles: FloatArray, cells: int) -> Iterator[_Seen]:
    """Find the cells of a window (axes u, v, depth) that triangles may cover, in portions."""
    sides = triangles @ _SIDES.T
    hidden = (sides < 0).all(axis=1).any(axis=1)
    cut = (sides < 0).any(axis=(1, 2)) & ~hidden
    whole = np.flatnonzero(~cut & ~hidden)
    yield from _cells_of(triangles, whole, triangles[whole], cells)
    which = np.flatnonzero(cut)
    shown = triangles[which]
    for side in _SIDES:
        shown, kept = clip_polygons(shown, side)
        which = which[kept]
    yield from _cells_of(triangles, which, shown, cells)


def _cells_of(
    triangles: FloatArray, which: IntArray, shown: FloatArray, cells: int
) -> Iterator[_Seen]:
    depth = shown[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        places = shown[..., :2] / depth[..., None]
        w = 1.0 / depth
    # What comes to the origin fills the window: every cell counts, at any depth.
    doubtful = ~(np.isfinite(places).all(axis=(1, 2)) & (depth > 0).all(axis=1))
    places[doubtful] = np.array([-1.0, 1.0])[np.arange(places.shape[1]) % 2][:, None]
    least, greatest = w.min(axis=1, initial=np.inf), w.max(axis=1, initial=0.0)
    least[doubtful], greatest[doubtful] = 0.0, np.inf
    first, last = (
        np.clip((bound * 0.5 + 0.5) * cells, 0, cells - 1).astype(np.int64)
        for bound in (
            places.min(axis=1) - _POSITION_SLACK,
            places.max(axis=1) + _POSITION_SLACK,
        )
    )
    wide = last[:, 0] - first[:, 0] + 1
    count = wide * (last[:, 1] - first[:, 1] + 1)
    planes, rims = _planes_and_rims(triangles[which])
    rims[doubtful] = 0.0
    done = np.concatenate([[0], np.cumsum(count)])
    start = 0
    while start < len(which):
        stop = int(np.searchsorted(done, done[start] + _PAIRS_AT_ONCE, side="right")) - 1
        stop = max(stop, start + 1)
        yield _pairs(which, first, wide, count, planes, rims, least, greatest, cells, start, stop)
        start = stop


def _planes_and_rims(triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give w = p · (u, v, 1) on each triangle, and its three edges: inside, e · (u, v, 1) ≥ 0."""
    rims = np.cross(triangles, np.roll(triangles, -1, axis=1))
    turn = np.einsum("fi,fi->f", triangles[:, 2], rims[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        planes = (
            np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            / turn[:, None]
        )
        rims *= (np.sign(turn) / np.linalg.norm(rims, axis=-1).max(axis=1))[:, None, None]
    rims[~np.isfinite(rims).all(axis=(1, 2))] = 0.0
    return planes, rims


def _pairs(
    which: IntArray,
    first: IntArray,
    wide: IntArray,
    count: IntArray,
    planes: FloatArray,
    rims: FloatArray,
    least: FloatArray,
    greatest: FloatArray,
    cells: int,
    start: int,
    stop: int,
) -> _Seen:
    index = np.repeat(np.arange(start, stop), count[start:stop])
    within = np.arange(len(index)) - np.repeat(
        np.cumsum(count[start:stop]) - count[start:stop], count[start:stop]
    )
    column = first[index, 0] + within % wide[index]
    row = first[index, 1] + within // wide[index]
    half = 1.0 / cells
    u, v = (2 * column + 1) * half - 1, (2 * row + 1) * half - 1

    def at_middle(plane: FloatArray) -> FloatArray:
        value: FloatArray = plane[:, 0] * u + plane[:, 1] * v + plane[:, 2]
        return value

    def change(plane: FloatArray) -> FloatArray:
        value: FloatArray = (np.abs(plane[:, 0]) + np.abs(plane[:, 1])) * half
        return value

    covered = np.ones(len(index), dtype=bool)
    for k in range(3):
        rim = rims[index, k]
        covered &= at_middle(rim) + change(rim) >= -_POSITION_SLACK
    index, u, v = index[covered], u[covered], v[covered]
    plane = planes[index]
    # The plane of what is seen edge-on says nothing.
    with np.errstate(invalid="ignore"):
        middle, spread = at_middle(plane), change(plane)
    spread[~(np.isfinite(middle) & np.isfinite(spread))] = np.inf
    middle[~np.isfinite(middle)] = 0.0
    return _Seen(
        which[index],
        row[covered] * cells + column[covered],
        middle,
        spread,
        least[index],
        greatest[index],
    )


def _edge_on(triangles: FloatArray) -> BoolArray:
    """(F,) whether the plane of a triangle passes through the origin, or as good as."""
    size = np.abs(triangles).max(axis=(1, 2), initial=0.0)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    off = np.abs(np.einsum("fi,fi->f", normals, triangles[:, 0]))
    edge_on: BoolArray = off <= _ON_ORIGIN * np.linalg.norm(normals, axis=-1) * size
    return edge_on


def _touches_origin(triangles: FloatArray) -> BoolArray:
    """(F,) whether the origin lies on a triangle, or as good as."""
    touching = _edge_on(triangles)
    flat = triangles[touching]
    size = np.abs(flat).max(axis=(1, 2), initial=0.0)
    normals = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    rims = np.cross(flat, np.roll(flat, -1, axis=1))
    turn = np.einsum("fki,fi->fk", rims, normals)
    least = -_ON_ORIGIN * np.linalg.norm(normals, axis=-1) * size**2
    touching[touching] = (turn >= least[:, None]).all(axis=1)
    return touching
