"""Surfaces in the coordinates in which a lens is tame: focus across the strip, and powers.

At a zoom, 1/D and d/D of a lens whose last group focuses are nearly straight lines over the focus
setting, and run through zero where the lens sees infinity; their logarithms fall off a cliff there.
Of a lens that is focused by its distance scale the logarithms are the tamer. The data choose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from lenscal.arrays import BoolArray, FloatArray, IntArray, frozen_array
from lenscal.maps.strip import Strip
from lenscal.maps.surface import Surfaces, fit_surfaces

#: Powers of a positive quantity that are tried; 0 is the logarithm.
_POWERS: Final = (0.0, 1.0, -1.0)
#: Samples from which the data choose how roughness grows, or the power on a grid.
ENOUGH_TO_TELL: Final = 36
#: Which spline counts, and how much.
_Share = tuple[int, float]
#: By how much minus twice the log-likelihood must be better to leave the logarithm.
_WORTH_IT: Final = 4.0


class _Wanted(NamedTuple):
    """What some surfaces are made of, found out once.

    Surface ``place`` is a copy of a spline, or a sum: of logarithms of splines times shares, of
    splines times weights, and of a trend.
    """

    rows: FloatArray  # (Q, K) of the mixing
    splines: list[int]  # (K,) which splines are needed
    powers: FloatArray  # (K,)
    trends: FloatArray  # (3, K)
    copied: tuple[list[int], list[int]]  # surfaces, and the splines that they are
    summed: list[tuple[int, list[_Share], list[_Share], FloatArray]]

    @property
    def are_splines(self) -> bool:
        """Whether all surfaces are the splines that are needed, in their order."""
        return self.copied[0] == self.copied[1] == list(range(len(self.rows)))

    @classmethod
    def of(
        cls, rows: FloatArray, splines: IntArray, powers: FloatArray, trends: FloatArray
    ) -> _Wanted:
        copied: tuple[list[int], list[int]] = ([], [])
        summed = []
        for place, row in enumerate(rows):
            sources = np.flatnonzero(row).tolist()
            if len(sources) == 1 and row[sources[0]] == 1 and powers[sources[0]] == 0:
                copied[0].append(place)
                copied[1].append(sources[0])
                continue
            shares = [(s, float(row[s] / powers[s])) for s in sources if powers[s] != 0]
            weights = [(s, float(row[s])) for s in sources if powers[s] == 0]
            summed.append((place, shares, weights, trends @ row))
        return cls(rows, splines.tolist(), powers, trends, copied, summed)


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
        wanted = self._wanted(only)
        across = self.strip.across(zoom, focus)
        found = super().value(zoom, across, only=wanted.splines)
        if derivative == (0, 0):
            return self._sums_of_bent(zoom, found, wanted)
        return _sums(wanted.rows, self._slopes(zoom, focus, across, found, derivative, wanted))

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
        wanted = self._wanted(only)
        across = self.strip.across(zoom, focus)
        found = None
        if wanted.powers.any():
            found = super().value(zoom, across, only=wanted.splines)
        return self._spread(zoom, across, found, wanted)

    def with_covariance(
        self, zoom: FloatArray, focus: FloatArray, *, only: Sequence[int] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Evaluate surfaces and their posterior covariance, for little more than the latter.

        Parameters
        ----------
        zoom, focus
            (...) settings of equal shape; NaN gives NaN.
        only
            Indices of the surfaces wanted; None for all Q.

        Returns
        -------
        values, covariance : FloatArray
            As `value` and `covariance_at`.
        """
        wanted = self._wanted(only)
        across = self.strip.across(zoom, focus)
        found = super().value(zoom, across, only=wanted.splines)
        spread = self._spread(zoom, across, found, wanted)
        return self._sums_of_bent(zoom, found, wanted), spread

    def _wanted(self, only: Sequence[int] | None) -> _Wanted:
        """Tell what the surfaces that are wanted are made of."""
        key = None if only is None else tuple(only)
        if key not in self._recipes:
            rows = self.mixing if only is None else self.mixing[list(only)]
            needed = np.flatnonzero(rows.any(axis=0))
            self._recipes[key] = _Wanted.of(
                rows[:, needed], needed, self.powers[needed], self.trends[:, needed]
            )
        return self._recipes[key]

    @cached_property
    def _recipes(self) -> dict[tuple[int, ...] | None, _Wanted]:
        """What was wanted before."""
        return {}

    def _spread(
        self,
        zoom: FloatArray,
        across: FloatArray,
        found: FloatArray | None,
        wanted: _Wanted,
    ) -> FloatArray:
        """(..., Q, Q) covariance of sums of what the splines stand for, given the splines."""
        covariance = super().covariance_at(zoom, across, only=wanted.splines)
        if found is not None and wanted.powers.any():
            steepness = _steepness(found, wanted.powers)
            covariance = covariance / (steepness[..., :, None] * steepness[..., None, :])
        return _sums(wanted.rows, np.moveaxis(_sums(wanted.rows, covariance), -1, -2))

    def _sums_of_bent(self, zoom: FloatArray, found: FloatArray, wanted: _Wanted) -> FloatArray:
        """(..., Q) sums of what the splines stand for; NaN where a coordinate is not positive."""
        if wanted.are_splines:
            return found
        sums = np.zeros((len(wanted.rows), *np.shape(zoom)))
        first = np.moveaxis(found, -1, 0)
        places, sources = wanted.copied
        sums[places] = first[sources]
        scaled = _scaled(zoom, self.zoom.ends)
        for place, shares, weights, (constant, linear, square) in wanted.summed:
            total = sums[place, ...]
            if shares:
                # One logarithm of a product does for several.
                product: FloatArray | float = 1.0
                positive: BoolArray | bool = True
                for source, share in shares:
                    factor, positive = first[source], positive & (first[source] > 0)
                    if abs(share) != 1.0:
                        factor = np.abs(factor) ** abs(share)
                    product = product * factor if share > 0 else product / factor
                with np.errstate(invalid="ignore", divide="ignore"):
                    np.log(product, out=total)
                total += (2 * square * scaled + linear) * scaled + (constant - square)
                if not np.all(positive):
                    total[~positive] = np.nan
            for source, weight in weights:
                total += weight * first[source]
        return np.moveaxis(sums, 0, -1)

    def _slopes(
        self,
        zoom: FloatArray,
        focus: FloatArray,
        across: FloatArray,
        found: FloatArray,
        derivative: tuple[int, int],
        wanted: _Wanted,
    ) -> FloatArray:
        """(..., K) slopes of what the splines stand for, along zoom (1, 0) or focus (0, 1)."""
        by_zoom, by_focus = self.strip.slopes(zoom, focus)
        along_focus = super().value(zoom, across, (0, 1), only=wanted.splines)
        steepness = _steepness(found, wanted.powers)
        if derivative == (0, 1):
            return np.asarray(by_focus[..., None] * along_focus / steepness)
        along_zoom = super().value(zoom, across, (1, 0), only=wanted.splines)
        slope = (along_zoom + by_zoom[..., None] * along_focus) / steepness
        return np.asarray(slope + _trend(zoom, self.zoom.ends, wanted.trends, 1))


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


def _sums(rows: FloatArray, values: FloatArray) -> FloatArray:
    """(..., Q) sums of (..., K) values with the weights of Q rows; each in one piece of memory."""
    if np.array_equal(rows, np.eye(*rows.shape)):
        return values
    sums = np.zeros((len(rows), *values.shape[:-1]))
    for i, place in np.argwhere(rows):
        sums[i, ...] += rows[i, place] * values[..., place]
    return np.moveaxis(sums, 0, -1)


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
