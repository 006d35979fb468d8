"""Surfaces in the coordinates in which a lens is tame: focus across the strip, and powers.

At a zoom, 1/D and d/D of a lens whose last group focuses are nearly straight lines over the focus
setting, and run through zero where the lens sees infinity; their logarithms fall off a cliff there.
Of a lens that is focused by its distance scale the logarithms are the tamer. The data choose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from lenscal.arrays import FloatArray, frozen_array
from lenscal.maps.strip import Strip
from lenscal.maps.surface import Surfaces, fit_surfaces

#: Powers of a positive quantity that are tried; 0 is the logarithm.
_POWERS: Final = (0.0, 1.0, -1.0)
#: Samples from which the data choose how roughness grows, or the power on a grid.
ENOUGH_TO_TELL: Final = 36
#: By how much minus twice the log-likelihood must be better to leave the logarithm.
_WORTH_IT: Final = 4.0


@dataclass(frozen=True, eq=False)
class TameSurfaces(Surfaces):
    """Surfaces of logarithms (or of plain values) that are splines in other coordinates.

    Parameters
    ----------
    strip
        What the second axis counts.
    powers
        (Q,) p of the coordinate y = exp(p (value − trend)) that is a spline; where p is 0 the
        value itself is.
    trends
        (3, Q) Chebyshev coefficients of the trends over the range of zoom.
    mixing
        (Q, Q) what the surfaces are of what the splines stand for.
    """

    strip: Strip = Strip()  # noqa: RUF009 - frozen
    powers: FloatArray = ()  # type: ignore[assignment]
    trends: FloatArray = ()  # type: ignore[assignment]
    mixing: FloatArray = ()  # type: ignore[assignment]

    def __post_init__(self) -> None:
        super().__post_init__()
        count = self.coefficients.shape[2]
        for name, shape in (
            ("powers", (count,)),
            ("trends", (3, count)),
            ("mixing", (count, count)),
        ):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), shape))

    def value(
        self,
        zoom: FloatArray,
        focus: FloatArray,
        derivative: tuple[int, int] = (0, 0),
        *,
        only: Sequence[int] | None = None,
    ) -> FloatArray:
        """Evaluate surfaces or their first derivatives.

        Parameters
        ----------
        zoom, focus
            (...) settings of equal shape; NaN gives NaN.
        derivative
            (0, 0), or (1, 0) for that along zoom, or (0, 1) along focus.
        only
            Indices of the surfaces wanted; None for all Q.

        Returns
        -------
        FloatArray
            (..., Q), or as many as are wanted; NaN where the coordinate of a positive quantity is
            not positive.
        """
        rows, needed = self._mixed(only)
        found = self._unmixed(zoom, focus, derivative, needed)
        return np.asarray(found @ rows.T)

    def covariance_at(
        self, zoom: FloatArray, focus: FloatArray, *, only: Sequence[int] | None = None
    ) -> FloatArray:
        """Give the posterior covariance of surfaces at each setting.

        Parameters
        ----------
        zoom, focus
            (...) settings of equal shape; NaN gives NaN.
        only
            Indices of the surfaces wanted; None for all Q.

        Returns
        -------
        FloatArray
            (..., Q, Q), or as many as are wanted.
        """
        rows, needed = self._mixed(only)
        across = self.strip.across(zoom, focus)
        covariance = super().covariance_at(zoom, across, only=needed)
        powers = self.powers[needed]
        if powers.any():
            steepness = _steepness(super().value(zoom, across, only=needed), powers)
            covariance = covariance / (steepness[..., :, None] * steepness[..., None, :])
        return np.asarray(rows @ covariance @ rows.T)

    def _mixed(self, only: Sequence[int] | None) -> tuple[FloatArray, list[int]]:
        """Rows of the mixing that are wanted, and the splines that they need."""
        rows = self.mixing if only is None else self.mixing[list(only)]
        needed = [int(i) for i in np.flatnonzero(rows.any(axis=0))]
        return rows[:, needed], needed

    def _unmixed(
        self, zoom: FloatArray, focus: FloatArray, derivative: tuple[int, int], needed: list[int]
    ) -> FloatArray:
        """(..., K) values or slopes of what the splines stand for."""
        across = self.strip.across(zoom, focus)
        powers, trends = self.powers[needed], self.trends[:, needed]
        found = super().value(zoom, across, only=needed)
        if derivative == (0, 0):
            bent = powers != 0
            if not bent.any():
                return found
            with np.errstate(invalid="ignore"):
                logarithm = np.log(np.where(found > 0, found, np.nan))
            trend = _trend(zoom, self.zoom.ends, trends)
            return np.where(bent, logarithm / np.where(bent, powers, 1.0) + trend, found)
        by_zoom, by_focus = self.strip.slopes(zoom, focus)
        along_focus = super().value(zoom, across, (0, 1), only=needed)
        steepness = _steepness(found, powers)
        if derivative == (0, 1):
            return np.asarray(by_focus[..., None] * along_focus / steepness)
        along_zoom = super().value(zoom, across, (1, 0), only=needed)
        slope = (along_zoom + by_zoom[..., None] * along_focus) / steepness
        return np.asarray(slope + _trend(zoom, self.zoom.ends, trends, derivative=1))


def fit_tame_surfaces(
    zooms: npt.ArrayLike,
    focuses: npt.ArrayLike,
    values: npt.ArrayLike,
    covariances: npt.ArrayLike,
    *,
    estimate_noise: bool = False,
    log_smoothing: npt.ArrayLike | None = None,
    powers: npt.ArrayLike | None = None,
    mixing: npt.ArrayLike | None = None,
    roughening: npt.ArrayLike | None = None,
    roughening_free: bool = False,
) -> TameSurfaces:
    """Fit surfaces in the coordinates in which they are tame.

    Parameters
    ----------
    zooms, focuses
        (N,) settings of the samples.
    values
        (N, Q) what was measured there: logarithms where the power is not 0.
    covariances
        (N, Q, Q) its covariance, positive definite.
    estimate_noise
        Whether the covariances are known only up to a common factor, which is then estimated.
    log_smoothing
        (Q, 2) to keep a smoothing that was chosen before; None to let the data choose.
    powers
        (Q,) see `TameSurfaces`; None for 0.
    mixing
        (Q, Q) see `TameSurfaces`; None for the identity.
    roughening, roughening_free
        See `lenscal.maps.surface.fit_surfaces`.

    Returns
    -------
    TameSurfaces
        The surfaces.
    """
    zoom, focus = (frozen_array(n, v, ("N",)) for n, v in (("zoom", zooms), ("focus", focuses)))
    measured, spread, mixed = unmix(values, covariances, mixing)
    bent = np.zeros(measured.shape[1]) if powers is None else np.asarray(powers, dtype=np.float64)
    ends = float(zoom.min()), float(zoom.max())
    trends = np.where(bent != 0, _quadratic(zoom, ends, measured), 0.0)
    strip = Strip.through(zoom, focus)
    coordinate = np.where(
        bent != 0, np.exp(bent * (measured - _trend(zoom, ends, trends))), measured
    )
    steepness = _steepness(coordinate, bent)
    found = fit_surfaces(
        zoom,
        strip.across(zoom, focus),
        coordinate,
        spread * steepness[:, :, None] * steepness[:, None, :],
        estimate_noise=estimate_noise,
        log_smoothing=log_smoothing,
        roughening=roughening,
        roughening_free=roughening_free,
    )
    return TameSurfaces(
        zoom=found.zoom,
        focus=found.focus,
        coefficients=found.coefficients,
        covariance=found.covariance,
        log_smoothing=found.log_smoothing,
        noise_scale=found.noise_scale,
        criterion=found.criterion,
        roughening=found.roughening,
        strip=strip,
        powers=bent,
        trends=trends,
        mixing=mixed,
    )


def tame_coordinates(
    zooms: npt.ArrayLike,
    focuses: npt.ArrayLike,
    logarithms: FloatArray,
    covariances: FloatArray,
    *,
    estimate_noise: bool = False,
    roughening_free: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose for each quantity the power, and the roughening, with which the data are most likely.

    The derivatives of all coordinates by the logarithm have the geometric mean 1 over the samples,
    since the trend is a fit by least squares, so that their restricted likelihoods compare (Box and
    Cox 1964).

    Parameters
    ----------
    zooms, focuses
        (N,) settings of the samples.
    logarithms
        (N, Q) of the quantities.
    covariances
        (N, Q, Q) of the logarithms.
    estimate_noise
        Whether the covariances are known only up to a common factor.

    Returns
    -------
    powers : FloatArray
        (Q,) 1 or −1 where that is clearly better than 0, the logarithm.
    roughening : FloatArray
        (Q, 2) see `lenscal.maps.surface.Surfaces`; 0 where the samples are too few to tell.
    criteria : FloatArray
        (Q,) minus twice the restricted log-likelihood of each with these.
    """
    chosen = []
    for i in range(logarithms.shape[1]):
        tried = [
            fit_tame_surfaces(
                zooms,
                focuses,
                logarithms[:, i : i + 1],
                covariances[:, i : i + 1, i : i + 1],
                estimate_noise=estimate_noise,
                powers=[power],
                roughening_free=roughening_free,
            )
            for power in _POWERS
        ]
        best = min(tried, key=lambda surfaces: surfaces.criterion)
        chosen.append(best if best.criterion < tried[0].criterion - _WORTH_IT else tried[0])
    return (
        np.array([surfaces.powers[0] for surfaces in chosen]),
        np.array([surfaces.roughening[0] for surfaces in chosen]),
        np.array([surfaces.criterion for surfaces in chosen]),
    )


def _steepness(coordinate: FloatArray, powers: FloatArray) -> FloatArray:
    """Derivative of the coordinates (..., Q) by what was fitted."""
    return np.where(powers != 0, powers * coordinate, 1.0)


def unmix(
    values: npt.ArrayLike, covariances: npt.ArrayLike, mixing: npt.ArrayLike | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Turn what was measured into what splines stand for.

    Parameters
    ----------
    values
        (N, Q) what was measured.
    covariances
        (N, Q, Q) its covariance.
    mixing
        (Q, Q) what was measured of what splines stand for; None for the identity.

    Returns
    -------
    values, covariances, mixing : FloatArray
        In the shapes of the parameters.
    """
    measured = frozen_array("values", values, ("N", "Q"))
    mixed = np.eye(measured.shape[1]) if mixing is None else np.asarray(mixing, dtype=np.float64)
    back = np.linalg.inv(mixed)
    return measured @ back.T, back @ np.asarray(covariances) @ back.T, mixed


def _quadratic(zoom: FloatArray, ends: tuple[float, float], values: FloatArray) -> FloatArray:
    """(3, Q) coefficients of the parabolas over the zoom that are nearest to (N, Q) values."""
    degree = min(2, len(np.unique(zoom)) - 1)
    found = np.zeros((3, values.shape[1]))
    found[: degree + 1] = chebyshev.chebfit(_scaled(zoom, ends), values, degree)
    return found


def _trend(
    zoom: FloatArray, ends: tuple[float, float], trends: FloatArray, derivative: int = 0
) -> FloatArray:
    """(..., Q) trends at (...) zooms, or their slopes."""
    scale = 2 / (ends[1] - ends[0]) if ends[1] > ends[0] else 0.0
    series = scale * chebyshev.chebder(trends) if derivative else trends
    return np.moveaxis(chebyshev.chebval(_scaled(zoom, ends), series), 0, -1)


def _scaled(zoom: FloatArray, ends: tuple[float, float]) -> FloatArray:
    low, high = ends
    return 2 * (zoom - low) / (high - low) - 1 if high > low else 0.0 * zoom
