"""Contours of a lens map: settings at which a quantity has a value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import contourpy
import numpy as np

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import InputError

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: Points per axis of the grid on which a contour is traced, before it is made exact.
_GRID: Final = 201
#: Newton steps that pull a traced point onto its contour.
_STEPS: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class SettingCurve:
    """A curve in the (zoom, focus) plane that knows every quantity along it.

    Parameters
    ----------
    zoom, focus
        (N,) settings along the curve, in order.
    lens_map
        The map that it was traced on.
    """

    zoom: FloatArray
    focus: FloatArray
    lens_map: LensMap

    def __post_init__(self) -> None:
        for name in ("zoom", "focus"):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), ("N",)))

    def value(self, quantity: str) -> FloatArray:
        """Give a quantity along the curve.

        Parameters
        ----------
        quantity
            Its name.

        Returns
        -------
        FloatArray
            (N,).
        """
        return self.lens_map.value(quantity, self.zoom, self.focus)

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
        The pieces of the contour, each point on the level to rounding.

    Raises
    ------
    InputError
        When the level lies outside the range of the quantity, or the map is a line.
    """
    zoom, focus = lens_map.domain.grid(_GRID)
    if min(zoom.shape) < 2:
        raise InputError(
            f"a map over {lens_map.domain} has no contours, since it extends along one motor only; "
            "sample both"
        )
    values = lens_map.value(quantity, zoom, focus, outside="nan")
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if not low <= level <= high:
        raise InputError(
            f"{quantity} never is {level:g} on this map: it runs from {low:.6g} to {high:.6g}"
        )
    generator = contourpy.contour_generator(zoom, focus, np.ma.masked_invalid(values))
    curves = []
    for line in generator.lines(level):
        points = onto_level(lens_map, quantity, level, np.asarray(line))
        curves.append(SettingCurve(points[:, 0], points[:, 1], lens_map))
    return curves


def onto_level(lens_map: LensMap, quantity: str, level: float, points: FloatArray) -> FloatArray:
    """Pull points onto a contour along the gradient, without leaving the domain.

    Parameters
    ----------
    lens_map
        The map.
    quantity
        One of its quantities.
    level
        The value wanted.
    points
        (N, 2) settings near the contour.

    Returns
    -------
    FloatArray
        (N, 2) settings on it. A step that would leave the domain slides along the border instead:
        only the coordinate that can move does.
    """
    span = np.array([np.ptp(lens_map.domain.zoom), np.ptp(lens_map.domain.focus)])
    low = np.array([lens_map.domain.zoom[0], lens_map.domain.focus[0]])
    high = low + span
    current = np.clip(points, low, high)
    for _ in range(_STEPS):
        error = lens_map.value(quantity, *current.T) - level
        slope = np.stack(lens_map.gradient(quantity, *current.T), axis=-1) * span
        at_border = (np.abs(current - low) < 1e-12 * span) | (np.abs(current - high) < 1e-12 * span)
        # On the border a point may only slide along it; in a corner it stays.
        slope = np.where(at_border, 0.0, slope)
        square = (slope**2).sum(axis=-1, keepdims=True)
        step = np.where(square > 0, error[:, None] * slope / np.where(square > 0, square, 1.0), 0.0)
        moved = current - step * span
        inside = lens_map.domain.contains(*moved.T)
        current = np.where(inside[:, None], moved, current)
    return current
