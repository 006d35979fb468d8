"""What the other settings say of each one: leave-one-out kriging over the (zoom, focus) plane.

A quantity is taken as a trend (constant, zoom, focus) plus a Gaussian process with a Matérn-5/2
covariance per axis. How fast and how far it bends is not chosen once: every choice on a grid counts
as much as the *other* settings make it likely, so that a bad setting cannot vouch for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from scipy import stats

from lenscal.arrays import FloatArray, IntArray

#: Correlation lengths that are tried, over the sampled range of an axis.
_LENGTHS: Final = (0.2, 0.5, 1.2, 3.0, 7.0)
#: Amplitudes that are tried, over the scatter about the trend.
_AMPLITUDES: Final = tuple(float(a) for a in np.geomspace(0.5, 60.0, 6))
#: Variances of the noise that are tried where it is not known, over that of the process.
_NOISE_RATIOS: Final = tuple(float(r) for r in np.geomspace(1e-9, 1.0, 7))
#: Powers of a positive quantity among which its tamest coordinate is sought; 0 is the logarithm.
_POWERS: Final = (-1.0, 0.0, 1.0)
#: What is added to the covariance against rounding, over the variance of the process.
_ROUNDING: Final = 1e-10
#: No lens is a Gaussian process, and the more settings, the surer likelihoods are of a wrong one.
#: They count as if of this many settings, so that choices that disagree, as they do where a corner
#: can only be extrapolated, both keep a say. Found by trial on clean tables of simulated lenses.
_MOST_TO_BELIEVE: Final = 7
#: How well a covariance matrix times its inverse must be one for the inverse to count.
_INVERTED: Final = 1e-2
#: Settings from which the choice is made once, by a part of them this large.
_MOST_TO_JUDGE: Final = 150
#: Zoom settings closer than this share of their range are one, read back with a little noise.
_SAME_ZOOM: Final = 1e-3


class Prediction(NamedTuple):
    """What the others say of each of N settings.

    Parameters
    ----------
    value
        (N,) predicted values.
    sigma
        (N,) standard deviation of measured minus predicted, noise of the measurement included.
    sigmas
        (N,) measured minus predicted over that; where the noise had to be estimated, Student's t is
        turned into the normal deviate that is as rare. NaN where the others cannot tell.
    """

    value: FloatArray
    sigma: FloatArray
    sigmas: FloatArray


def leave_one_out(
    points: FloatArray,
    values: FloatArray,
    variances: FloatArray | None,
    *,
    logarithms: bool = False,
    planes: Sequence[FloatArray] | None = None,
) -> Prediction:
    """Predict each value from all others.

    Parameters
    ----------
    points
        (N, 2) settings (zoom, focus), all different.
    values
        (N,) what was measured there.
    variances
        (N,) variances of the measurements; None where they are not known but alike.
    logarithms
        Whether the values are logarithms of a quantity that may be tamer as it is, or inverted.
    planes
        What `coordinates` gave for these settings, where they are part of a larger set: the strip
        of a lens does not become narrower when a setting at its border is left out.

    Returns
    -------
    Prediction
        NaN where the others are too few, at least two more than the trend has terms being needed;
        and where the values follow the trend to the last digit.
    """
    planes = coordinates(points) if planes is None else planes
    count = len(values)
    freedom = count - 1 - planes[0].shape[1]
    nothing = np.full(count, np.nan)
    if freedom < 2:
        return Prediction(nothing, nothing, nothing)
    if np.ptp(values) <= 1e-14 * float(np.abs(values).max()):
        return Prediction(values.copy(), np.zeros(count), np.zeros(count))
    forms = [_Form.of(values, variances, p) for p in (_POWERS if logarithms else (None,))]
    strengths = _NOISE_RATIOS if variances is None else _AMPLITUDES
    lengths = np.array(list(product(*[_LENGTHS] * planes[0].shape[1])))
    choices = [(plane, form, s, lengths) for plane, form, s in product(planes, forms, strengths)]
    if count > _MOST_TO_JUDGE:
        some = np.linspace(0, count - 1, _MOST_TO_JUDGE).round().astype(int)
        part = np.lexsort(points.T[::-1])[some]
        judged = [_Trial.of(p[part], form.part(part), s, lengths) for p, form, s, _ in choices]
        likelihood = np.stack([trial.log_likelihood for trial in judged])
        best, length = np.unravel_index(np.argmax(likelihood), likelihood.shape)
        choices = [(*choices[best][:3], lengths[length : length + 1])]
    trials = [_Trial.of(*choice) for choice in choices]
    if not any(np.isfinite(trial.log_likelihood).any() for trial in trials):
        return Prediction(nothing, nothing, nothing)
    error, sigma = _averaged(trials)
    sigmas = error / sigma
    if variances is None:
        tail = np.maximum(stats.t.sf(np.abs(sigmas), freedom - 1), 1e-300)
        sigmas = np.sign(sigmas) * stats.norm.isf(tail)
    return Prediction(values - error, sigma, sigmas)


class _Form(NamedTuple):
    """The values in a coordinate to choose, over their scatter."""

    values: FloatArray
    noise: FloatArray | None
    slope: FloatArray

    @classmethod
    def of(cls, values: FloatArray, variances: FloatArray | None, power: float | None) -> _Form:
        """Transform so that the product of all slopes is one: likelihoods can be compared."""
        slope, transformed = np.ones(len(values)), values - values.mean()
        if power:
            # Box and Cox, "An analysis of transformations", 1964.
            slope = np.exp(power * transformed)
            transformed = (slope - 1.0) / power
        spread = float(np.std(values))
        noise = None if variances is None else variances * (slope / spread) ** 2
        return cls(transformed / spread, noise, slope / spread)

    def part(self, chosen: IntArray) -> _Form:
        """Give some of the values."""
        noise = None if self.noise is None else self.noise[chosen]
        return _Form(self.values[chosen], noise, self.slope[chosen])


class _Trial(NamedTuple):
    """Leave-one-out results with C choices of lengths, alike in all else.

    Parameters
    ----------
    error, variance
        (C, N) measured minus predicted, and its variance.
    log_likelihood, of_others
        (C,) restricted log-likelihood of all values, and (C, N) of all but one.
    """

    error: FloatArray
    variance: FloatArray
    log_likelihood: FloatArray
    of_others: FloatArray

    @classmethod
    def of(cls, points: FloatArray, form: _Form, strength: float, lengths: FloatArray) -> _Trial:
        """Compute them."""
        values, noise, slope = form
        count = len(points)
        apart = np.abs(points[:, None] - points)
        covariance = _matern(apart / lengths[:, None, None]).prod(axis=-1)
        diagonal = np.full(count, strength + _ROUNDING)
        if noise is not None:
            covariance *= strength**2
            diagonal = noise + strength**2 * _ROUNDING
        covariance[:, range(count), range(count)] += diagonal
        trend = np.concatenate([np.ones((count, 1)), points], axis=1)
        inverse = np.linalg.inv(covariance)
        weighted = inverse @ trend
        inner = trend.T @ weighted
        # Dubrule, "Cross validation of kriging in a unique neighbourhood", 1983.
        projected = inverse - weighted @ np.linalg.solve(inner, weighted.transpose(0, 2, 1))
        precision = np.diagonal(projected, axis1=1, axis2=2)
        dual = projected @ values
        misfit = dual @ values
        signs, volume = np.linalg.slogdet(covariance)
        inner_signs, inner_volume = np.linalg.slogdet(inner)
        # Choices beyond what double precision can tell do not count.
        rest = np.abs(inverse @ covariance - np.eye(count)).max(axis=(1, 2))
        sound = (
            (rest < _INVERTED)
            & (precision > 0).all(axis=1)
            & (misfit > 0)
            & (signs > 0)
            & (inner_signs > 0)
        )
        precision = np.where(sound[:, None], precision, 1.0)
        misfit = np.where(sound, misfit, 1.0)[:, None]
        error, variance = dual / precision, 1.0 / precision
        volume = (volume + inner_volume)[:, None]
        freedom = count - trend.shape[1]
        if noise is not None:
            whole = -0.5 * (volume + misfit)
            others = whole + 0.5 * (np.log(variance) + error**2 / variance)
        else:
            whole = -0.5 * (volume + freedom * np.log(misfit))
            rest = np.maximum(misfit - error**2 / variance, 1e-14 * misfit)
            others = -0.5 * (volume - np.log(variance) + (freedom - 1) * np.log(rest))
            variance = variance * rest / (freedom - 1)
        return cls(
            error / slope,
            variance / slope**2,
            np.where(sound, whole[:, 0], -np.inf),
            np.where(sound[:, None], others, -np.inf),
        )


def _averaged(trials: list[_Trial]) -> tuple[FloatArray, FloatArray]:
    """Error and σ of each setting, every choice weighing as much as the others make it likely."""
    errors, variances, _, likelihood = (np.concatenate(part) for part in zip(*trials, strict=True))
    tempered = min(1.0, _MOST_TO_BELIEVE / likelihood.shape[1])
    weight = np.exp(tempered * (likelihood - likelihood.max(axis=0)))
    weight /= weight.sum(axis=0)
    error = (weight * errors).sum(axis=0)
    between = (weight * (errors - error) ** 2).sum(axis=0)
    return error, np.sqrt((weight * variances).sum(axis=0) + between)


def coordinates(points: FloatArray) -> list[FloatArray]:
    """Coordinates to choose from: the settings and, if focus strips differ, shares of the strip.

    A lens that is not parfocal is sampled along a curved strip. Its f follows the motors; its D
    follows how far into the strip focus is.

    Parameters
    ----------
    points
        (N, 2) settings (zoom, focus).

    Returns
    -------
    list of FloatArray
        (N, A) each, A being the count of motors that move.
    """
    spans = np.ptp(points, axis=0)
    moving = spans > 0
    centred = (points - points.mean(axis=0)) / np.where(moving, spans, 1.0)
    planes: list[FloatArray] = [centred[:, moving]]
    if not moving.all():
        return planes
    zoom = points[:, 0]
    group = np.cumsum(np.diff(np.sort(zoom), prepend=-np.inf) > _SAME_ZOOM * spans[0])
    member = group[np.argsort(np.argsort(zoom, kind="stable"))]
    share = np.zeros(len(points))
    ends = []
    for number in np.unique(member):
        inside = member == number
        low, high = points[inside, 1].min(), points[inside, 1].max()
        if low == high:
            return planes
        share[inside] = (points[inside, 1] - low) / (high - low) - 0.5
        ends.append((low, high))
    if np.ptp(ends, axis=0).max() > _SAME_ZOOM * spans[1]:
        planes.append(np.stack([planes[0][:, 0], share], axis=1))
    return planes


def _matern(distance: FloatArray) -> FloatArray:
    root = np.sqrt(5.0) * distance
    covariance: FloatArray = (1.0 + root + root**2 / 3.0) * np.exp(-root)
    return covariance
