"""The inverse of a lens map: settings at which two quantities have wanted values.

The map is invertible nowhere for certain: two settings, or more, may give the same pair of values.
So every cell of a grid that can hold a solution is searched by Newton's method from several starts.
Where the map folds, two solutions lie close together and one could hide the other; each solution's
twin across the fold is then computed from the curvature of the map and searched as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from lenscal.errors import InputError, MapError
from lenscal.maps.evaluation import value_at
from lenscal.maps.map_grid import MapGrid, gradient_at, grid_over
from lenscal.maps.quantities import SINGLE, from_core
from lenscal.setting import LensSetting

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: Where Newton's method starts in a cell that may hold a solution, as shares of the cell.
_STARTS: Final = np.array([(0.5, 0.5), (0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.8, 0.8)])
_STEPS: Final = 60
#: Share of the range of the settings that one step may cover.
_LONGEST_STEP: Final = 0.02
#: Misfit at which an iteration has found a solution, as share of the range.
_SOLVED: Final = 1e-13
#: Solutions closer than this share of the ranges are one.
_SAME: Final = 3e-7
#: How far rounding can spread a solution beside a fold, as a share of either range.
_BLURRED: Final = 3e-6
#: What rounding does to a value, as a share of it.
_ROUNDING: Final = 2e-15
#: Share of the ranges within which the twin of a solution is searched across a fold.
_TWIN_REACH: Final = 0.1
_CURVATURE_STEP: Final = 1e-3

#: What the image shows of the sharp plane, and the side of the sensor that it is shown on.
FIELDS: Final[dict[str, str]] = {"field_width_mm": "width_mm", "field_height_mm": "height_mm"}


@dataclass(frozen=True, slots=True, eq=False)
class SettingSolution(LensSetting):
    """A setting that was found, with how well the map knows it.

    Parameters
    ----------
    zoom, focus, iris
        The setting; iris is None.
    covariance
        (2, 2) covariance of zoom and focus that follows from that of the map, to first order. It
        grows towards a fold of the map, and is infinite on it.
    """

    covariance: FloatArray = field(kw_only=True)

    def __post_init__(self) -> None:
        # `super()` does not know the class that slots make of this one.
        LensSetting.__post_init__(self)
        covariance = frozen_array("covariance", self.covariance, (2, 2), finite=False)
        object.__setattr__(self, "covariance", covariance)

    @property
    def sigma_zoom(self) -> float:
        """Standard deviation of the zoom setting."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def sigma_focus(self) -> float:
        """Standard deviation of the focus setting."""
        return float(np.sqrt(self.covariance[1, 1]))


def settings_for(lens_map: LensMap, wanted: Mapping[str, float]) -> list[SettingSolution]:
    """Find all settings at which two quantities have the wanted values.

    Parameters
    ----------
    lens_map
        The map; it must extend along both zoom and focus.
    wanted
        Two quantities and their values. ``field_width_mm`` and ``field_height_mm`` stand for the
        magnification at which the image shows so much of the sharp plane, distortion apart; they go
        with ``object_distance_mm`` or ``standoff_mm``, the working distance.

    Returns
    -------
    list of SettingSolution
        All solutions within the domain, by zoom; empty when the two never meet. Solutions closer
        than 3e-7 of the ranges of zoom and focus are given as one.

    Raises
    ------
    InputError
        When not exactly two quantities are given, a value is outside its range, or a quantity is
        the same everywhere.
    MapError
        When a field is wanted of a map without a sensor.
    """
    if len(wanted) != 2:
        raise InputError(
            f"two quantities determine a setting, but {len(wanted)} were given "
            f"({', '.join(wanted) or 'none'}); give two of "
            f"{', '.join((*lens_map.quantities, *FIELDS))}"
        )
    targets = _as_quantities(lens_map, wanted)
    search = _Search.of(lens_map, targets)
    found = search.solutions()
    if not len(found):
        search.refuse_values_out_of_range()
    return [
        SettingSolution(float(zoom), float(focus), covariance=search.covariance(zoom, focus))
        for zoom, focus in found[np.lexsort(found.T[::-1])]
    ]


def _as_quantities(lens_map: LensMap, wanted: Mapping[str, float]) -> dict[str, float]:
    targets: dict[str, float] = {}
    for name, value in wanted.items():
        if not np.isfinite(value):
            raise InputError(f"{name} must be a finite number, but is {value}")
        if name in FIELDS:
            if lens_map.sensor is None:
                raise MapError(
                    f"this map was fitted without a sensor, so it cannot tell a {name}; "
                    "give fit_lens_map(..., sensor=...)"
                )
            if value <= 0:
                raise InputError(f"{name} must be positive, but is {value:g}")
            targets["magnification"] = getattr(lens_map.sensor, FIELDS[name]) / value
        elif name in lens_map.quantities:
            targets[name] = float(value)
        else:
            # The map knows why it lacks a quantity.
            lens_map.value(name, lens_map.samples["zoom"], lens_map.samples["focus"])
    if len(targets) < 2:
        raise InputError(
            f"{' and '.join(wanted)} both state the magnification; "
            "give one of them and another quantity"
        )
    return targets


@dataclass(frozen=True, eq=False)
class _Search:
    """Two quantities and their values; points are (N, 2) settings in shares of the ranges."""

    grid: MapGrid
    quantities: tuple[str, ...]
    targets: FloatArray  # (2,)
    ranges: FloatArray  # (2, 2) lowest and highest of either
    origin: FloatArray  # (2,) lowest zoom and focus
    span: FloatArray  # (2,)

    @classmethod
    def of(cls, lens_map: LensMap, targets: Mapping[str, float]) -> _Search:
        grid = grid_over(lens_map)
        ranges = np.array([grid.range_of(quantity) for quantity in targets])
        for quantity, (low, high) in zip(targets, ranges, strict=True):
            if high - low <= 1e-12 * abs(high):
                raise InputError(
                    f"{quantity} is {high:g} everywhere on this map, so it says nothing about the "
                    "setting; give another quantity"
                )
        return cls(
            grid=grid,
            quantities=tuple(targets),
            targets=np.array(list(targets.values())),
            ranges=ranges,
            origin=np.array([grid.zoom[0], grid.focus[0]]),
            span=np.array([np.ptp(grid.zoom), np.ptp(grid.focus)]),
        )

    def misfit(self, points: FloatArray) -> FloatArray:
        """(N, 2) value less target of either quantity, over its range."""
        zoom, focus = (self.origin + self.span * points).T
        values = [value_at(self.grid.lens_map, q, zoom, focus) for q in self.quantities]
        return np.asarray((np.stack(values, axis=-1) - self.targets) / np.ptp(self.ranges, axis=1))

    def slope(self, points: FloatArray) -> FloatArray:
        """(N, 2, 2) derivative of the misfit."""
        zoom, focus = (self.origin + self.span * points).T
        lens_map = self.grid.lens_map
        rows = [gradient_at(lens_map, q, zoom, focus) for q in self.quantities]
        scale = self.span / np.ptp(self.ranges, axis=1)[:, None]
        return np.asarray(np.stack(rows, axis=-2) * scale)

    def solutions(self) -> FloatArray:
        """(N, 2) all settings within the domain, none twice."""
        found = self._distinct(self._newton(self._starts()))
        found = self._distinct(np.concatenate([found, self._newton(self._twins(found))]))
        settings = self.origin + self.span * found
        inside = self.grid.lens_map.domain.contains(*settings.T)
        return np.asarray(settings[inside])

    def covariance(self, zoom: float, focus: float) -> FloatArray:
        """(2, 2) covariance of zoom and focus at a solution, in controller units."""
        at = np.array(zoom), np.array(focus)
        lens_map = self.grid.lens_map
        slope = np.array([gradient_at(lens_map, q, *at) for q in self.quantities])
        try:
            inverse = np.linalg.inv(slope)
        except np.linalg.LinAlgError:
            return np.full((2, 2), np.inf)
        return np.asarray(inverse @ _joint_covariance(lens_map, self.quantities, *at) @ inverse.T)

    def refuse_values_out_of_range(self) -> None:
        """Say so when the search was in vain because of one of the quantities alone."""
        for quantity, target, (low, high) in zip(
            self.quantities, self.targets, self.ranges, strict=True
        ):
            if not low <= target <= high:
                raise InputError(
                    f"{quantity} never is {target:g} on this map: "
                    f"it runs from {low:.6g} to {high:.6g}"
                )

    def _starts(self) -> FloatArray:
        """(N, 2) starts in all cells whose values can reach both targets."""
        reached = _cells_of_domain(self.grid)
        for quantity, target in zip(self.quantities, self.targets, strict=True):
            low, high = _cell_bounds(self.grid, quantity)
            reached = reached & (low <= target) & (target <= high)
        cells = np.argwhere(reached)[:, ::-1]
        steps = np.array([len(self.grid.zoom), len(self.grid.focus)]) - 1
        return np.asarray(((cells[:, None] + _STARTS) / steps).reshape(-1, 2))

    def _newton(self, points: FloatArray) -> FloatArray:
        """(M, 2) the solutions that Newton's method reaches from (N, 2) starts."""
        points = points.copy()
        best, least = points.copy(), np.full(len(points), np.inf)
        moving = np.arange(len(points))
        for _ in range(_STEPS):
            error = self.misfit(points[moving])
            size = np.abs(error).max(axis=1)
            better = size < least[moving]
            best[moving[better]], least[moving[better]] = points[moving[better]], size[better]
            (a, b), (c, d) = np.moveaxis(self.slope(points[moving]), 0, -1)
            x, y = error.T
            with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
                step = np.stack([d * x - b * y, a * y - c * x], axis=-1)
                step = step / (a * d - b * c)[:, None]
            step = np.clip(np.nan_to_num(step), -_LONGEST_STEP, _LONGEST_STEP)
            # A little beyond the border the surfaces go on; far beyond lies no solution.
            points[moving] = np.clip(points[moving] - step, -_LONGEST_STEP, 1 + _LONGEST_STEP)
            # A solution is polished until rounding lets it improve no more.
            moving = moving[better | (size > _SOLVED)]
            if not len(moving):
                break
        return np.asarray(best[least < _SOLVED])

    def _twins(self, points: FloatArray) -> FloatArray:
        """(M, 2) where, to second order, the other solution lies across a fold nearby.

        Along the direction n in which the map hardly changes, the misfit along u, the direction of
        its image, is t u·Jn + t²/2 u·Hnn: zero at the solution itself and at its twin.
        """
        if not len(points):
            return points
        slope = self.slope(points)
        image, _, directions = np.linalg.svd(slope)
        along, flat = directions[:, 1], image[:, :, 1]
        step = _CURVATURE_STEP * along
        bend = (self.slope(points + step) - self.slope(points - step)) / (2 * _CURVATURE_STEP)
        rise = np.einsum("ni,nij,nj->n", flat, slope, along)
        curve = np.einsum("ni,nij,nj->n", flat, bend, along)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = -2 * rise / curve
        near = np.abs(reach) < _TWIN_REACH
        return np.asarray(points[near] + reach[near, None] * along[near])

    def _distinct(self, points: FloatArray) -> FloatArray:
        """(M, 2) points of which none is the same as another, the best of each kept.

        Beside a fold rounding spreads a solution farther than `_SAME`. Between two such points the
        misfit is no more than rounding; between a solution and its twin it is more.
        """
        rest = points[np.argsort(np.abs(self.misfit(points)).max(axis=1), kind="stable")]
        rounding = _ROUNDING * np.abs(self.targets / np.ptp(self.ranges, axis=1)).max()
        kept: list[FloatArray] = []
        while len(rest):
            kept.append(rest[0])
            apart = np.abs(rest - rest[0]).max(axis=1)
            between = np.abs(self.misfit((rest + rest[0]) / 2)).max(axis=1)
            rest = rest[(apart > _SAME) & ((apart > _BLURRED) | (between > rounding))]
        return np.array(kept).reshape(-1, 2)


@lru_cache(maxsize=4)
def _cells_of_domain(grid: MapGrid) -> BoolArray:
    """(F − 1, Z − 1) which cells may hold a part of the domain: those near a node inside."""
    # The 4 × 4 nodes about a cell: its own corners and those of the cells around it.
    nodes = np.lib.stride_tricks.sliding_window_view(np.pad(grid.inside, 1), (4, 4))
    return np.asarray(nodes.any(axis=(2, 3)))


@lru_cache(maxsize=16)
def _cell_bounds(grid: MapGrid, quantity: str) -> tuple[FloatArray, FloatArray]:
    """(F − 1, Z − 1) lowest and highest value that a quantity can have in each cell.

    Between nodes a smooth function leaves the range of the corners by at most an eighth of its
    second differences along both axes; twice that is allowed, as they change over the cell.
    """
    values = grid.values(quantity)
    along_zoom = np.pad(np.diff(values, 2, axis=1), ((0, 0), (1, 1)), mode="edge")
    along_focus = np.pad(np.diff(values, 2, axis=0), ((1, 1), (0, 0)), mode="edge")
    bend = np.abs(along_zoom) + np.abs(along_focus)
    corners = np.lib.stride_tricks.sliding_window_view(values, (2, 2))
    margin = np.lib.stride_tricks.sliding_window_view(bend, (2, 2)).max(axis=(2, 3)) / 4
    margin = margin + 1e-9 * np.ptp(values)
    return corners.min(axis=(2, 3)) - margin, corners.max(axis=(2, 3)) + margin


def _joint_covariance(
    lens_map: LensMap, quantities: tuple[str, ...], zoom: FloatArray, focus: FloatArray
) -> FloatArray:
    """(2, 2) covariance of two quantities of a map at one setting."""
    core = lens_map.core.value(zoom, focus)
    single = [quantity in SINGLE for quantity in quantities]
    weights = np.stack(
        [
            np.zeros(core.shape) if apart else from_core(quantity, core)[1]
            for quantity, apart in zip(quantities, single, strict=True)
        ]
    )
    covariance = weights @ lens_map.core.covariance_at(zoom, focus) @ weights.T
    for i in np.flatnonzero(single):
        # Surfaces of their own, fitted apart: not correlated with anything else.
        surfaces = lens_map.single_surfaces[quantities[i]]
        covariance[i, i] = surfaces.covariance_at(zoom, focus)[0, 0]
    return np.asarray(covariance)
