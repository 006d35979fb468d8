"""Evaluation of one quantity of a lens map: value, derivatives and variance, at given settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import InputError, OutOfDomainError
from lenscal.maps.domain import Domain
from lenscal.maps.quantities import SINGLE, core_surfaces, from_logarithms, single_value
from lenscal.maps.surface import Surfaces

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

Outside = Literal["raise", "nan"]
Motor = Literal["zoom", "focus"]

_ORDERS: Final[dict[Motor, tuple[int, int]]] = {"zoom": (1, 0), "focus": (0, 1)}


def supported(
    domain: Domain, zoom: npt.ArrayLike, focus: npt.ArrayLike, outside: Outside
) -> tuple[FloatArray, FloatArray]:
    """Broadcast settings and hold them against the domain.

    Parameters
    ----------
    domain
        Where the map may be asked.
    zoom, focus
        Settings; they broadcast.
    outside
        What to do beyond the domain: raise, or give NaN there.

    Returns
    -------
    zoom, focus : FloatArray
        Of the broadcast shape; NaN both where one lies outside.

    Raises
    ------
    InputError
        When the settings do not broadcast, or ``outside`` is neither.
    OutOfDomainError
        When a setting lies outside, or is NaN, and that is to raise.
    """
    if outside not in ("raise", "nan"):
        raise InputError(f"outside must be 'raise' or 'nan', but is {outside!r}")
    given = (
        frozen_array("zoom", zoom, ("...",), finite=False),
        frozen_array("focus", focus, ("...",), finite=False),
    )
    try:
        zooms, focuses = np.broadcast_arrays(*given)
    except ValueError as error:
        raise InputError(
            f"zoom of shape {given[0].shape} and focus of shape {given[1].shape} do not broadcast; "
            "give one value per setting of each, or arrays that numpy can combine"
        ) from error
    inside = domain.contains(zooms, focuses)
    if inside.all():
        return zooms, focuses
    if outside == "nan":
        return np.where(inside, zooms, np.nan), np.where(inside, focuses, np.nan)
    first = np.flatnonzero(~inside.ravel())[0]
    named = f"zoom {zooms.ravel()[first]:g}, focus {focuses.ravel()[first]:g}"
    which = (
        f"the setting ({named}) lies"
        if inside.size == 1
        else f"{(~inside).sum()} of {inside.size} settings, the first at {named}, lie"
    )
    raise OutOfDomainError(
        f"{which} outside the map ({domain}); a map is never extrapolated: sample there, "
        'or ask with outside="nan"',
        domain,
        ~inside,
    )


def value_at(
    lens_map: LensMap, quantity: str, zooms: FloatArray, focuses: FloatArray
) -> FloatArray:
    """Evaluate a quantity.

    Parameters
    ----------
    lens_map
        The map.
    quantity
        One of its quantities.
    zooms, focuses
        (...) settings of equal shape; NaN gives NaN.

    Returns
    -------
    FloatArray
        (...).
    """
    surfaces, only = _surfaces(lens_map, quantity)
    found = surfaces.value(zooms, focuses, only=only)
    if quantity in SINGLE:
        return single_value(quantity, np.asarray(found[..., 0]))
    return np.asarray(from_logarithms(quantity, found)[0])


def slopes_at(
    lens_map: LensMap,
    quantity: str,
    zooms: FloatArray,
    focuses: FloatArray,
    motors: Sequence[Motor],
) -> list[FloatArray]:
    """Differentiate a quantity with respect to motors.

    Parameters
    ----------
    lens_map
        The map.
    quantity
        One of its quantities.
    zooms, focuses
        (...) settings of equal shape; NaN gives NaN.
    motors
        The motors.

    Returns
    -------
    list of FloatArray
        (...) per controller unit, for each motor.
    """
    surfaces, only = _surfaces(lens_map, quantity)
    slopes = [surfaces.value(zooms, focuses, _ORDERS[m], only=only) for m in motors]
    if quantity in SINGLE:
        return [np.asarray(slope[..., 0]) for slope in slopes]
    weights = from_logarithms(quantity, surfaces.value(zooms, focuses, only=only))[1]
    return [np.asarray(sum(w * s[..., i] for i, w in enumerate(weights))) for s in slopes]


def variance_at(
    lens_map: LensMap, quantity: str, zooms: FloatArray, focuses: FloatArray
) -> FloatArray:
    """Give the posterior variance of a quantity.

    Parameters
    ----------
    lens_map
        The map.
    quantity
        One of its quantities.
    zooms, focuses
        (...) settings of equal shape; NaN gives NaN.

    Returns
    -------
    FloatArray
        (...), not negative.
    """
    surfaces, only = _surfaces(lens_map, quantity)
    if quantity in SINGLE:
        covariance = surfaces.covariance_at(zooms, focuses, only=only)
        return np.maximum(covariance[..., 0, 0], 0.0)
    logarithms, covariance = surfaces.with_covariance(zooms, focuses, only=only)
    weights = from_logarithms(quantity, logarithms)[1]
    variance = sum(
        (1 + (a != b)) * weights[a] * weights[b] * covariance[..., a, b]
        for a in range(len(weights))
        for b in range(a + 1)
    )
    return np.maximum(variance, 0.0)


def _surfaces(lens_map: LensMap, quantity: str) -> tuple[Surfaces, tuple[int, ...]]:
    """Surfaces that a quantity is made of, and which of them."""
    if quantity in SINGLE:
        return lens_map.single_surfaces[quantity], (0,)
    core = lens_map.core
    return core, core_surfaces(quantity, core.coefficients.shape[2])
