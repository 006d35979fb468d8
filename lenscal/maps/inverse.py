"""The inverse of a lens map: settings at which two quantities have wanted values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import InputError
from lenscal.maps.contours import trace
from lenscal.setting import LensSetting

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

_STEPS: Final = 12
#: Solutions closer than this share of the ranges are one.
_SAME: Final = 1e-7


def settings_for(lens_map: LensMap, wanted: Mapping[str, float]) -> list[LensSetting]:
    """Find all settings at which two quantities have the wanted values.

    The contour of the first is followed, and where the second crosses its value along it Newton's
    method makes the crossing exact.

    Parameters
    ----------
    lens_map
        The map.
    wanted
        Two quantities and their values.

    Returns
    -------
    list of LensSetting
        All solutions within the domain, by zoom; empty when the two never meet.

    Raises
    ------
    InputError
        When not exactly two quantities are given, or a value is outside its range.
    """
    if len(wanted) != 2:
        raise InputError(
            f"two quantities determine a setting, but {len(wanted)} were given "
            f"({', '.join(wanted) or 'none'}); give two of {', '.join(lens_map.quantities)}"
        )
    (first, first_value), (second, second_value) = wanted.items()
    low, high = lens_map.range_of(second)
    if not low <= second_value <= high:
        raise InputError(
            f"{second} never is {second_value:g} on this map: it runs from {low:.6g} to {high:.6g}"
        )
    solutions: list[FloatArray] = []
    span = np.array([np.ptp(lens_map.domain.zoom), np.ptp(lens_map.domain.focus)])
    for curve in trace(lens_map, first, first_value):
        rest = curve.value(second) - second_value
        for i in np.flatnonzero(rest[:-1] * rest[1:] <= 0):
            share = rest[i] / (rest[i] - rest[i + 1]) if rest[i] != rest[i + 1] else 0.0
            ends = np.stack([curve.zoom, curve.focus], axis=-1)[i : i + 2]
            start = ends[0] + share * (ends[1] - ends[0])
            found = _polished(lens_map, wanted, start)
            if all((np.abs(found - other) > _SAME * span).any() for other in solutions):
                solutions.append(found)
    return [LensSetting(float(z), float(f)) for z, f in sorted(map(tuple, solutions))]


def _polished(lens_map: LensMap, wanted: Mapping[str, float], start: FloatArray) -> FloatArray:
    point = start
    for _ in range(_STEPS):
        error = np.array([float(lens_map.value(q, *point)) - v for q, v in wanted.items()])
        slope = np.array([[float(g) for g in lens_map.gradient(q, *point)] for q in wanted])
        moved = point - np.linalg.lstsq(slope, error, rcond=None)[0]
        if not lens_map.domain.contains(*moved):
            return point
        point = moved
    return point
