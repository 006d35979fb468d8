"""The area between two contours of d/D in the (zoom, focus) plane, with exact borders.

It is traced on a grid over the rectangle that bounds the domain of the map, beyond whose border the
surfaces go on smoothly; then it is cut with the outline of the domain. Every vertex is put exactly
on the contour or the outline that it belongs to, and where both meet, on both. Nothing beyond the
domain is given out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import contourpy
import numpy as np
from manifold3d import CrossSection
from scipy.optimize import elementwise
from scipy.spatial import cKDTree

from lenscal.arrays import BoolArray, FloatArray
from lenscal.maps.evaluation import value_at

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

Bounds = tuple[float, float]
Quantity = Callable[[FloatArray, FloatArray], FloatArray]

#: Nodes per side of the grid on which the area is traced.
NODES: Final = 201
#: Size of the domain in units of the clipper, which rounds to 1e-8 of such a unit.
_CLIPPER: Final = 1e6
#: How near, in those units, a clipped vertex is to the one that it was.
_SAME: Final = 1e-6
#: Parts of a step between nodes or vertices in which an extremum is sought, and how often.
_PARTS, _ROUNDS = 10, 3


@dataclass(frozen=True, slots=True, eq=False)
class SettingPolygon:
    """A connected area of settings.

    Parameters
    ----------
    outline
        (N, 2) zoom, focus around the area.
    holes
        (M, 2) zoom, focus around each hole in it.
    """

    outline: FloatArray
    holes: tuple[FloatArray, ...] = ()

    @property
    def rings(self) -> tuple[FloatArray, ...]:
        """The outline and the holes."""
        return (self.outline, *self.holes)


@dataclass(frozen=True, eq=False)
class MagnificationGrid:
    """d/D of a map at the nodes of a grid over the rectangle that bounds its domain.

    Parameters
    ----------
    lens
        The map.
    zoom, focus
        (Z,), (F,) the lines of the grid.
    ratio
        (F, Z) d/D at the nodes, those beyond the domain included.
    inside
        (F, Z) whether the domain holds the node.
    """

    lens: LensMap
    zoom: FloatArray
    focus: FloatArray
    ratio: FloatArray
    inside: BoolArray

    @classmethod
    def over(cls, lens: LensMap) -> MagnificationGrid:
        """Lay the grid.

        Parameters
        ----------
        lens
            The map.

        Returns
        -------
        MagnificationGrid
            The grid.
        """
        zoom, focus = np.linspace(*lens.domain.zoom, NODES), np.linspace(*lens.domain.focus, NODES)
        nodes = np.meshgrid(zoom, focus)
        return cls(lens, zoom, focus, _anywhere(lens)(*nodes), lens.domain.contains(*nodes))

    @property
    def reached(self) -> Bounds:
        """Lowest and highest d/D at the nodes within the domain."""
        ratio = self.ratio[self.inside]
        return float(ratio.min()), float(ratio.max())


def trace_area(grid: MagnificationGrid, limits: Bounds) -> tuple[SettingPolygon, ...]:
    """Trace the area between two levels of d/D inside the domain of a map.

    Parameters
    ----------
    grid
        d/D on a grid.
    limits
        Lowest and highest d/D.

    Returns
    -------
    tuple of SettingPolygon
        The areas. What lies on a contour lies on it to rounding, and so does what lies on the
        outline of the domain. An area that is smaller than a cell of 1/200 of the domain may be
        missed.
    """
    generator = contourpy.contour_generator(z=grid.ratio, fill_type=contourpy.FillType.OuterOffset)
    top = max(limits[1], np.nextafter(float(grid.ratio.max()), np.inf))
    rings, offsets = generator.filled(limits[0], limits[1] if np.isfinite(limits[1]) else top)
    polygons = []
    for points, ends in zip(rings, offsets, strict=True):
        exact = onto_contours(grid, np.asarray(points, dtype=np.float64), limits)
        outline, *holes = (exact[a:b] for a, b in pairwise(ends))
        polygons.append(SettingPolygon(outline, tuple(holes)))
    if grid.lens.domain.is_rectangle:
        return tuple(polygons)
    return tuple(_cut(grid.lens, polygons, limits))


def extremes(
    grid: MagnificationGrid,
    polygons: tuple[SettingPolygon, ...],
    quantity: Quantity,
    limits: Bounds,
) -> Bounds:
    """Find the lowest and the highest value of a quantity over the area.

    Parameters
    ----------
    grid
        d/D on a grid.
    polygons
        The area.
    quantity
        Gives the quantity at (N,) zoom and focus within the domain.
    limits
        Lowest and highest d/D.

    Returns
    -------
    tuple of float
        Values that are reached, inside or on the border. About the best node and the best vertex
        the step is divided by 10 three times, so that the extremes are met to about 1e-8 of the
        range where the quantity is smooth.
    """
    anywhere = _anywhere(grid.lens)
    held = grid.inside & (grid.ratio >= limits[0]) & (grid.ratio <= limits[1])
    row, column = np.nonzero(held)
    nodes = np.stack([grid.zoom[column], grid.focus[row]], axis=-1)
    rings = [ring for polygon in polygons for ring in polygon.rings]
    step = np.array([np.ptp(grid.zoom), np.ptp(grid.focus)]) / (NODES - 1)
    found = []
    for sign in (1.0, -1.0):

        def value(points: FloatArray, sign: float = sign) -> FloatArray:
            return sign * quantity(*points.T)

        best = min(
            (_along(anywhere, ring, value, limits, grid.lens) for ring in rings), default=np.inf
        )
        if len(nodes):
            best = min(best, _around(anywhere, nodes, value, limits, grid.lens, step))
        found.append(sign * float(best))
    return found[0], found[1]


def onto_contours(grid: MagnificationGrid, index: FloatArray, limits: Bounds) -> FloatArray:
    """Turn grid coordinates into settings; what lies on a contour is moved onto it exactly.

    The tracer interpolates linearly along the edges of the grid. Each such point lies between two
    nodes on either side of a contour, and the map is solved for it on that edge.

    Parameters
    ----------
    grid
        d/D on a grid.
    index
        (N, 2) points in units of the grid's nodes.
    limits
        Lowest and highest d/D.

    Returns
    -------
    FloatArray
        (N, 2) zoom, focus.
    """
    zoom, focus, ratio = grid.zoom, grid.focus, _anywhere(grid.lens)
    # The tracer's interpolation may pass the last line of the grid by its rounding.
    index = np.clip(index, 0.0, (len(zoom) - 1, len(focus) - 1))
    low, high = np.floor(index).astype(int), np.ceil(index).astype(int)
    between = (low != high).any(axis=1)
    start, stop = (np.stack([zoom[i[:, 0]], focus[i[:, 1]]], axis=-1) for i in (low, high))
    share = (index - low).max(axis=1)
    settings: FloatArray = start + share[:, None] * (stop - start)
    traced = ratio(*settings.T)
    level = np.where(np.abs(traced - limits[0]) <= np.abs(traced - limits[1]), *limits)
    a, b = start[between], stop[between]

    def excess(along: FloatArray, *ends: FloatArray) -> FloatArray:
        zoom_a, focus_a, zoom_b, focus_b, wanted = ends
        at_zoom = np.clip(zoom_a + along * (zoom_b - zoom_a), zoom_a, zoom_b)
        at_focus = np.clip(focus_a + along * (focus_b - focus_a), focus_a, focus_b)
        return np.asarray(ratio(at_zoom, at_focus) - wanted, dtype=np.float64)

    if between.any():
        ends = (np.zeros(len(a)), np.ones(len(a)))
        solved = elementwise.find_root(excess, ends, args=(*a.T, *b.T, level[between]))
        exact = a + solved.x[:, None] * (b - a)
        # A contour through a node, to rounding, brackets nothing; there the tracer is exact.
        settings[between] = np.where(solved.success[:, None], exact, settings[between])
    return settings


def _anywhere(lens: LensMap) -> Quantity:
    """d/D whether the map supports it there or not."""
    if lens.domain.is_rectangle:
        return lambda zoom, focus: lens.magnification(zoom, focus, outside="nan")
    return lambda zoom, focus: value_at(lens, "magnification", zoom, focus)


def _cut(lens: LensMap, polygons: list[SettingPolygon], limits: Bounds) -> list[SettingPolygon]:
    """Cut areas with the outline of the domain."""
    corners = lens.domain.outline
    origin, size = corners.min(axis=0), np.ptp(corners, axis=0)

    def scaled(points: FloatArray) -> FloatArray:
        return np.asarray((points - origin) / size * _CLIPPER)

    known = np.concatenate([corners, *(ring for p in polygons for ring in p.rings)])
    traced = CrossSection([scaled(ring) for p in polygons for ring in p.rings])
    domain = scaled(corners)
    around = np.roll(domain, -1, axis=0)
    turn = domain[:, 0] @ around[:, 1] - domain[:, 1] @ around[:, 0]
    cut = traced ^ CrossSection([domain if turn > 0 else domain[::-1]])
    tree = cKDTree(scaled(known))
    pieces = []
    for piece in cut.decompose():
        rings = [np.asarray(ring) for ring in piece.to_polygons()]
        exact = []
        for ring in rings:
            away, which = tree.query(ring)
            new = np.asarray(np.asarray(away) >= _SAME)
            points = np.where(new[:, None], origin + ring / _CLIPPER * size, known[which])
            points[new] = _onto_both(lens, points[new], limits)
            exact.append(points)
        # The outer ring is the one that holds the others.
        order = np.argsort([-np.ptp(ring[:, 0]) for ring in rings], kind="stable")
        outline, *holes = (exact[i] for i in order)
        pieces.append(SettingPolygon(outline, tuple(holes)))
    return pieces


def _onto_both(lens: LensMap, points: FloatArray, limits: Bounds) -> FloatArray:
    """Move points along the outline of the domain until d/D has the nearest of both levels.

    They lie on the outline already, where the chord between two vertices of a contour crosses it.
    """
    if not len(points):
        return points
    ratio = _anywhere(lens)
    start, stop = lens.domain.outline, np.roll(lens.domain.outline, -1, axis=0)
    size = np.ptp(start, axis=0)
    along = (stop - start) / size
    away = (points[:, None] - start) / size
    share = np.clip((away * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    side = np.linalg.norm(away - share[..., None] * along, axis=-1).argmin(axis=1)
    share = share[np.arange(len(points)), side]
    a, b = start[side], stop[side]
    value = ratio(*points.T)
    level = np.where(np.abs(value - limits[0]) <= np.abs(value - limits[1]), *limits)

    def excess(at: FloatArray, *ends: FloatArray) -> FloatArray:
        zoom_a, focus_a, zoom_b, focus_b, wanted = ends
        at_zoom, at_focus = zoom_a + at * (zoom_b - zoom_a), focus_a + at * (focus_b - focus_a)
        return np.asarray(ratio(at_zoom, at_focus) - wanted, dtype=np.float64)

    # The chord is off its contour by far less than a cell.
    reach = 1.0 / (NODES - 1) / np.linalg.norm(along[side], axis=-1)
    bracket = np.clip(share - reach, 0.0, 1.0), np.clip(share + reach, 0.0, 1.0)
    solved = elementwise.find_root(excess, bracket, args=(*a.T, *b.T, level))
    share = np.where(solved.success, solved.x, share)
    exact: FloatArray = a + share[:, None] * (b - a)
    return exact


def _around(
    ratio: Quantity,
    nodes: FloatArray,
    value: Callable[[FloatArray], FloatArray],
    limits: Bounds,
    lens: LensMap,
    step: FloatArray,
) -> float:
    """Lowest value about the best of the nodes inside."""
    values = value(nodes)
    place, best = nodes[values.argmin()], float(values.min())
    offsets = np.linspace(-1, 1, 2 * _PARTS + 1)
    around = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    for _ in range(_ROUNDS):
        points = place + around * step
        points = points[lens.domain.contains(*points.T)]
        at = ratio(*points.T)
        points = points[(at >= limits[0]) & (at <= limits[1])]
        if not len(points):
            break
        values = value(points)
        if values.min() < best:
            place, best = points[values.argmin()], float(values.min())
        step = step / _PARTS
    return best


def _along(
    ratio: Quantity,
    ring: FloatArray,
    value: Callable[[FloatArray], FloatArray],
    limits: Bounds,
    lens: LensMap,
) -> float:
    """Lowest value along a ring, between its vertices too."""
    # Vertices at the outline may be beyond the domain by rounding.
    ring = ring[lens.domain.contains(*ring.T)]
    if not len(ring):
        return np.inf
    values = value(ring)
    best = float(values.min())
    share = np.linspace(0.0, 1.0, 2 * _PARTS + 1)[:, None]
    for _ in range(_ROUNDS):
        k = int(values.argmin())
        ends = ring[[k - 1, k, (k + 1) % len(ring)]]
        chords = [_on_border(ratio, a + share * (b - a), limits) for a, b in pairwise(ends)]
        ring = np.concatenate(chords)
        ring = ring[lens.domain.contains(*ring.T)]
        if not len(ring):
            break
        values = value(ring)
        best = min(best, float(values.min()))
    return best


def _on_border(ratio: Quantity, points: FloatArray, limits: Bounds) -> FloatArray:
    """Pull the points of a chord onto the contour that both its ends lie on, if they do."""
    ends = ratio(*points[[0, -1]].T)
    levels = [v for v in limits if np.isfinite(v) and (np.abs(ends - v) <= 1e-9 * v).all()]
    chord = points[-1] - points[0]
    if not levels or not chord.any():
        return points
    # The chord is off by a share of its length squared: the secant method is there in a few steps.
    across = np.array([-chord[1], chord[0]])
    first, second = np.zeros(len(points)), np.full(len(points), 1e-3)
    error = ratio(*points.T) - levels[0]
    for _ in range(4):
        moved = ratio(*(points + second[:, None] * across).T) - levels[0]
        slope = moved - error
        steps = np.where(slope != 0, moved * (second - first) / np.where(slope, slope, 1.0), 0.0)
        first, second, error = second, second - np.clip(steps, -1.0, 1.0), moved
    pulled: FloatArray = points + second[:, None] * across
    at = ratio(*pulled.T)
    good = np.abs(at - levels[0]) <= 1e-9 * levels[0]
    return pulled[good]
