"""Contours of a lens map: settings at which a quantity has a value.

A contour is traced on a grid, pulled onto its level, and cut where it leaves the domain. It is
traced over the whole rectangle that bounds the domain, because the surfaces go on smoothly beyond
the border: so a curve ends on the border itself and not at the last node before it. Nothing beyond
the domain is given out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import contourpy
import numpy as np
import pandas as pd
from scipy.optimize import elementwise

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from lenscal.errors import InputError
from lenscal.maps.evaluation import value_at
from lenscal.maps.map_grid import MapGrid, all_quantities, gradient_at, grid_over

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: Share of the range of a quantity by which a vertex may miss its level.
_TOLERANCE: Final = 1e-11
#: Newton steps along an edge after the first, where that was not enough.
_STEPS: Final = 3
#: A stretch is cut into so many parts, so many times, to find where it ends: to 3e-11 of itself.
_PARTS, _ROUNDS = 32, 7

#: (4, 4) each: from values at four nodes to the cubic on their first, second or third interval.
_CUBICS: Final = [
    np.linalg.inv(np.power.outer(np.arange(4.0) - interval, np.arange(4))) for interval in range(3)
]

Kept = Callable[[FloatArray, FloatArray], BoolArray]


@dataclass(frozen=True, slots=True, eq=False)
class SettingCurve:
    """A contour in the (zoom, focus) plane, or a piece of one, with all quantities along it.

    Parameters
    ----------
    zoom, focus
        (N,) settings along the curve, in order; a closed one ends where it starts.
    values
        (N, K) the K quantities of the map at those settings, in the map's order.
    quantity, level
        What is constant along the curve, and its value.
    lens_map
        The map that it was traced on.
    """

    zoom: FloatArray
    focus: FloatArray
    values: FloatArray
    quantity: str
    level: float
    lens_map: LensMap

    def __post_init__(self) -> None:
        object.__setattr__(self, "zoom", frozen_array("zoom", self.zoom, ("N",)))
        shapes = {"focus": (len(self),), "values": (len(self), len(self.lens_map.quantities))}
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), shape))

    def value(self, quantity: str) -> FloatArray:
        """Give a quantity along the curve.

        Parameters
        ----------
        quantity
            One of the map's quantities.

        Returns
        -------
        FloatArray
            (N,).

        Raises
        ------
        InputError
            When the map has no such quantity.
        """
        return np.asarray(self.values[:, _column(self.lens_map, quantity)])

    def within(self, quantity: str, low: float, high: float) -> list[SettingCurve]:
        """Cut out the pieces along which another quantity keeps within a band.

        Parameters
        ----------
        quantity
            One of the map's quantities.
        low, high
            The band, ends included, in its unit; infinite for none on that side.

        Returns
        -------
        list of SettingCurve
            The pieces, in order. Where the band ends a piece, the quantity has the end of the band
            to 1e-12 of its range, from inside. Empty when the curve never enters the band; a piece
            that enters and leaves it between two vertices is not found.

        Raises
        ------
        InputError
            When the band is empty, or the map has no such quantity.
        """
        if not low <= high:
            raise InputError(
                f"a band runs from low to high, but that of {quantity} is {low:g} to {high:g}"
            )
        _column(self.lens_map, quantity)
        ends: tuple[Kept, Kept] = (
            lambda zoom, focus: value_at(self.lens_map, quantity, zoom, focus) >= low,
            lambda zoom, focus: value_at(self.lens_map, quantity, zoom, focus) <= high,
        )
        return [
            piece
            for part in _kept(self, ends[0], self.value(quantity) >= low)
            for piece in _kept(part, ends[1], part.value(quantity) <= high)
        ]

    def to_dataframe(self) -> pd.DataFrame:
        """Give the curve as a table.

        Returns
        -------
        pandas.DataFrame
            A row per vertex: zoom, focus, and every quantity of the map.
        """
        table = pd.DataFrame(self.values, columns=list(self.lens_map.quantities))
        table.insert(0, "zoom", self.zoom)
        table.insert(1, "focus", self.focus)
        return table

    def __len__(self) -> int:
        return len(self.zoom)


def trace(lens_map: LensMap, quantity: str, level: float) -> list[SettingCurve]:
    """Trace the contour of a quantity within the domain of a map.

    Parameters
    ----------
    lens_map
        The map; it must extend along both zoom and focus.
    quantity
        One of its quantities.
    level
        The value, in the unit of the quantity.

    Returns
    -------
    list of SettingCurve
        The pieces of the contour. Every vertex has the level to 1e-11 of the range of the
        quantity, and every open end lies on the border of the domain, from inside, to 1e-12 of the
        ranges. What is smaller than a cell of the grid, of 200 × 200 cells over the domain, may be
        missed. Empty for a level that is met at the edge of its range only.

    Raises
    ------
    InputError
        When the level lies outside the range of the quantity, or the map is a line.
    """
    _column(lens_map, quantity)
    grid = grid_over(lens_map)
    low, high = grid.range_of(quantity)
    # Between the nodes the domain may reach a little past the values at the nodes.
    lines = _tracer(grid, quantity).lines(level) if np.isfinite(level) else []
    curves: list[SettingCurve] = []
    if lines:
        index = np.concatenate([np.asarray(line) for line in lines])
        points, everything = _onto_level(grid, quantity, level, index)
        inside = _inside(grid, index, points)
        ends = np.cumsum([0, *(len(line) for line in lines)])
        for a, b in pairwise(ends):
            zoom, focus = points[a:b].T
            whole = SettingCurve(zoom, focus, everything[a:b], quantity, level, lens_map)
            curves += _kept(whole, lens_map.domain.contains, inside[a:b])
    if not curves and not low <= level <= high:
        raise InputError(
            f"{quantity} never is {level:g} on this map: it runs from {low:.6g} to {high:.6g}"
        )
    return curves


@lru_cache(maxsize=16)
def _tracer(grid: MapGrid, quantity: str) -> contourpy.ContourGenerator:
    return contourpy.contour_generator(z=grid.values(quantity))


def _inside(grid: MapGrid, index: FloatArray, points: FloatArray) -> BoolArray:
    """(N,) whether the domain holds each vertex; asked only where nodes around it are outside."""
    inside = np.ones(len(points), dtype=bool)
    if not grid.inside.all():
        # The 4 × 4 nodes about the edge that a vertex is on, those of the cells beside it.
        corner = np.floor(index[:, ::-1]).astype(np.int64)
        around = np.lib.stride_tricks.sliding_window_view(
            np.pad(grid.inside, 1, mode="edge"), (4, 4)
        )
        near = ~around[tuple(np.minimum(corner, np.array(around.shape[:2]) - 1).T)].all(axis=(1, 2))
        inside[near] = grid.lens_map.domain.contains(*points[near].T)
    return inside


def _column(lens_map: LensMap, quantity: str) -> int:
    names = lens_map.quantities
    if quantity not in names:
        # The map knows why it lacks a quantity.
        lens_map.value(quantity, lens_map.samples["zoom"], lens_map.samples["focus"])
    return names.index(quantity)


def _onto_level(
    grid: MapGrid, quantity: str, level: float, index: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Turn vertices in grid coordinates into settings on the level, with all quantities there.

    The tracer interpolates linearly along an edge of the grid. A vertex moves along that edge to
    the root of the cubic through four nodes, and from there by Newton steps. On an edge that all
    but touches the contour that may not do; there the root is bracketed by the nodes.
    """
    edges, share, coefficients = _edges(grid, quantity, level, index)

    def along(share: FloatArray, *edge: FloatArray) -> tuple[FloatArray, FloatArray]:
        zoom_a, focus_a, zoom_b, focus_b = edge
        # Weighted so that an end is met to the bit.
        zoom = (1 - share) * zoom_a + share * zoom_b
        return zoom, (1 - share) * focus_a + share * focus_b

    def excess(share: FloatArray, *edge: FloatArray) -> FloatArray:
        return value_at(grid.lens_map, quantity, *along(share, *edge)) - level

    for _ in range(2):
        value, slope = _cubic(coefficients, share)
        share = np.clip(share - value / slope, 0.0, 1.0)
    extent = np.ptp(grid.range_of(quantity))
    share = np.clip(share - excess(share, *edges) / slope, 0.0, 1.0)
    found = all_quantities(grid.lens_map, *along(share, *edges))
    # Mostly one step does, and then everything is there already.
    column = _column(grid.lens_map, quantity)
    for _ in range(_STEPS):
        error = found[:, column] - level
        moving = np.flatnonzero(np.abs(error) > _TOLERANCE * extent)
        if not len(moving):
            break
        share[moving] = np.clip(share[moving] - error[moving] / slope[moving], 0.0, 1.0)
        moved = along(share[moving], *(end[moving] for end in edges))
        found[moving] = all_quantities(grid.lens_map, *moved)
    missed = np.abs(found[:, column] - level) > _TOLERANCE * extent
    if missed.any():
        chosen = tuple(end[missed] for end in edges)
        bracket = np.zeros(missed.sum()), np.ones(missed.sum())
        solved = elementwise.find_root(excess, bracket, args=chosen)
        # A contour through a node, to rounding, brackets nothing; there the vertex is that node.
        share[missed] = np.where(solved.success, solved.x, share[missed])
        found[missed] = all_quantities(grid.lens_map, *along(share[missed], *chosen))
    return np.stack(along(share, *edges), axis=-1), found


def _edges(
    grid: MapGrid, quantity: str, level: float, index: FloatArray
) -> tuple[tuple[FloatArray, ...], FloatArray, FloatArray]:
    """Edge of each of N vertices: zoom and focus of both nodes, the vertex's share of it, a cubic.

    The cubic, (4, N) coefficients, is that of the quantity less the level over the share.
    """
    rows = np.arange(len(index))
    # Across its edge a vertex has the index of a node, to rounding.
    nearest = np.rint(index)
    side = np.abs(index - nearest).argmax(axis=1)
    nodes = np.array([len(grid.zoom), len(grid.focus)])[side]
    first = np.clip(np.floor(index[rows, side]), 0, nodes - 2).astype(np.int64)
    low = nearest.astype(np.int64)
    low[rows, side] = first
    high = low.copy()
    high[rows, side] += 1
    # Of the four nodes the edge is between the middle two, save at a border.
    start = np.clip(first - 1, 0, nodes - 4)
    line = start + np.arange(4)[:, None]
    zoom_index = np.where(side == 0, line, low[:, 0])
    focus_index = np.where(side == 1, line, low[:, 1])
    values = grid.values(quantity)[focus_index, zoom_index] - level
    coefficients = _CUBICS[1] @ values
    for at_border in (0, 2):
        chosen = first - start == at_border
        if chosen.any():
            coefficients[:, chosen] = _CUBICS[at_border] @ values[:, chosen]
    ends = (
        grid.zoom[low[:, 0]],
        grid.focus[low[:, 1]],
        grid.zoom[high[:, 0]],
        grid.focus[high[:, 1]],
    )
    return ends, np.clip(index[rows, side] - first, 0.0, 1.0), coefficients


def _cubic(coefficients: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Value and slope of cubics; a slope has the sign of the chord from 0 to 1, or is infinite."""
    constant, linear, square, cube = coefficients
    value = constant + at * (linear + at * (square + at * cube))
    slope = linear + at * (2 * square + 3 * at * cube)
    chord = linear + square + cube
    return value, np.where(slope * chord > 0, slope, np.where(chord == 0, np.inf, chord))


def _kept(curve: SettingCurve, kept: Kept, at_vertices: BoolArray) -> list[SettingCurve]:
    """Cut a curve down to where a condition holds, with the ends found."""
    if at_vertices.all():
        return [curve]
    if not at_vertices.any():
        return []
    points = np.stack([curve.zoom, curve.focus], axis=-1)
    values = curve.values
    if (points[0] == points[-1]).all() and at_vertices[0]:
        # Open a closed curve where it is cut anyway.
        turn = int(np.flatnonzero(~at_vertices)[0])
        around = np.r_[turn : len(points), 1 : turn + 1]
        points, values, at_vertices = points[around], values[around], at_vertices[around]
    crossings = np.flatnonzero(at_vertices[1:] != at_vertices[:-1])
    leaves = at_vertices[crossings]
    inner = np.where(leaves, crossings, crossings + 1)
    outer = np.where(leaves, crossings + 1, crossings)
    along = partial(_between, curve, points[inner], points[outer])
    share = _last_kept(along, kept, len(crossings))
    # Where a vertex is the end itself, nothing is to be put in.
    crossings, ends = crossings[share > 0], along(share[:, None])[share > 0, 0]
    at_ends = all_quantities(curve.lens_map, *ends.T)
    order = np.argsort(np.r_[np.arange(len(points)), crossings + 0.5], kind="stable")
    points = np.concatenate([points, ends])[order]
    values = np.concatenate([values, at_ends])[order]
    held = np.r_[at_vertices, np.ones(len(ends), dtype=bool)][order]
    edges = np.flatnonzero(np.diff(np.r_[False, held, False]))
    return [
        replace(curve, zoom=points[a:b, 0], focus=points[a:b, 1], values=values[a:b])
        for a, b in edges.reshape(-1, 2)
    ]


def _last_kept(along: Callable[[FloatArray], FloatArray], kept: Kept, count: int) -> FloatArray:
    """(N,) share of each stretch, from its kept end, up to which the condition holds."""
    low, width = np.zeros(count), np.ones(count)
    for _ in range(_ROUNDS):
        share = low[:, None] + width[:, None] * np.linspace(0, 1, _PARTS + 1)[1:-1]
        held = kept(*np.moveaxis(along(share), -1, 0))
        steps = np.where(held.all(axis=1), _PARTS - 1, held.argmin(axis=1))
        width = width / _PARTS
        low = low + steps * width
    # A last part is left out, so that rounding cannot put an end on the wrong side.
    return np.asarray(np.maximum(low - width, 0.0))


def _between(
    curve: SettingCurve, start: FloatArray, stop: FloatArray, share: FloatArray
) -> FloatArray:
    """(N, M, 2) points of the curve at (N, M) shares between (N, 2) neighbouring vertices."""
    points = start[:, None] + share[..., None] * (stop - start)[:, None]
    span = np.array([np.ptp(curve.lens_map.domain.zoom), np.ptp(curve.lens_map.domain.focus)])
    reach = np.linalg.norm((stop - start) / span, axis=-1)[:, None]
    for _ in range(3):
        zoom, focus = np.moveaxis(points, -1, 0)
        error = value_at(curve.lens_map, curve.quantity, zoom, focus) - curve.level
        slope = gradient_at(curve.lens_map, curve.quantity, zoom, focus) * span
        steep = np.linalg.norm(slope, axis=-1)
        step = np.clip(error / np.where(steep > 0, steep, np.inf), -reach, reach)
        points = points - (step / np.where(steep > 0, steep, 1.0))[..., None] * slope * span
    # The ends are vertices already, on an edge of the grid that they must not leave.
    points = np.where((share == 0)[..., None], start[:, None], points)
    return points
