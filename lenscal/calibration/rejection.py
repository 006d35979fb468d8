"""Which corners and views to believe: a robust fit first, then least squares on what agrees.

Corners are judged by the length of their residual, which for Gaussian noise of σ per coordinate,
σ known from ν degrees of freedom, exceeds kσ with probability (1 + k²/ν)^(−ν/2): the tail of
F(2, ν). The limit k is set so that a clean set of its size loses a corner once in twenty
calibrations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.bundle import Fit, fit
from lenscal.calibration.swapped import NOT_EXCHANGED, exchanged_with, numbering_in_list
from lenscal.calibration.views import State, Views

#: How often a clean calibration may lose a good corner.
_FALSE_ALARMS: Final = 0.05
#: Rounds of reweighting, each of a few steps, that lead from first values to the robust fit.
_ROBUST_ROUNDS, _STEPS_A_ROUND = 12, 2
#: Relative change of the noise at which the robust fit has done its work.
_STEADY: Final = 0.01
#: Width of the Cauchy weight in σ: it keeps 95 % of the efficiency of least squares.
_CAUCHY: Final = 2.4
#: Rounds in which corners may leave and come back.
_HARD_ROUNDS: Final = 20
#: Median length of a two-dimensional Gaussian residual, in σ.
_MEDIAN_LENGTH: Final = float(np.sqrt(2 * np.log(2)))
#: A view is dropped when fewer than this share of its corners is believed …
_LEAST_SHARE: Final = 0.5
#: … or when its typical residual exceeds that of the other views by this factor.
_VIEW_FACTOR: Final = 3.0
#: Residuals that are rounding, not disagreement, in px.
_ROUNDING_PX: Final = 1e-6
#: Share of a view's extent by which distortion may bend it, when the order of a list is judged.
_BENT: Final = 0.03
#: Share of its corners from whose loss on a view is asked for the order of its list.
_MANY: Final = 0.2
#: Fewest corners that a view may keep.
_LEAST_CORNERS: Final = 4


@dataclass(frozen=True, slots=True)
class Rejection:
    """One corner, or one whole view, that was not believed.

    Parameters
    ----------
    view
        Index of the view.
    point
        Index of the point within the view, or None for all of it.
    residual_px
        Distance from where the camera expects the point; rms of a whole view; NaN when no camera
        could be asked.
    reason
        Why, in words.
    """

    view: int
    point: int | None
    residual_px: float
    reason: str


class Selection(NamedTuple):
    """What a robust fit believes.

    Parameters
    ----------
    state
        The parameters fitted to it.
    inliers
        (V, M) which observations were used.
    rejections
        What was not, one by one.
    settled
        Whether the last fit converged.
    """

    state: State
    inliers: BoolArray
    rejections: tuple[Rejection, ...]
    settled: bool


def fit_robustly(views: Views, start: State, free: BoolArray) -> Selection:
    """Fit all parameters to the observations that agree with one another.

    Parameters
    ----------
    views
        The observations.
    start
        First parameters.
    free
        (K,) which intrinsics may move.

    Returns
    -------
    Selection
        Parameters, and what was believed.
    """
    result = _robust_fit(views, start, free)
    lengths = _lengths(result.residuals_px)
    usable = np.ones(len(views.present), dtype=bool)
    inliers, reasons = views.present, dict[int, str]()
    noise = _robust_noise(lengths, inliers, free)
    for _ in range(_HARD_ROUNDS):
        updated = (lengths <= _limits(noise, inliers, free)) & views.present & usable[:, None]
        bad = _bad_views(lengths, updated, views.present, usable)
        reasons |= bad
        usable[list(bad)] = False
        updated &= usable[:, None]
        unchanged = bool((updated == inliers).all())
        inliers = updated
        result = fit(views, result, free, inliers.astype(float))
        lengths = _lengths(result.residuals_px)
        if unchanged:
            break
        noise = _noise(lengths, inliers, free)
    limits = _limits(noise, inliers, free)
    rejections = _report(views, result.residuals_px, limits, inliers, reasons)
    return Selection(result.state, inliers, rejections, result.settled)


def _robust_fit(views: Views, start: State, free: BoolArray) -> Fit:
    """Iteratively reweighted least squares with Cauchy's weight, whose scale follows the fit."""
    result = fit(views, start, free, views.present.astype(float), steps=0)
    last = np.inf
    for _ in range(_ROBUST_ROUNDS):
        lengths = _lengths(result.residuals_px)
        noise = max(_robust_noise(lengths, views.present, free), np.finfo(float).tiny)
        limits = _limits(noise, views.present, free)
        # Where no corner stands out, least squares needs no leading.
        led = np.isfinite(last) and bool((lengths <= limits)[views.present].all())
        if led or abs(noise - last) < _STEADY * noise:
            break
        last = noise
        with np.errstate(over="ignore"):
            weights = np.where(views.present, 1 / (1 + (lengths / (_CAUCHY * noise)) ** 2), 0.0)
        result = fit(views, result, free, weights, steps=_STEPS_A_ROUND)
    return result


def _robust_noise(lengths: FloatArray, used: BoolArray, free: BoolArray) -> float:
    """σ of one coordinate in px, from residuals of which a minority may be nonsense."""
    share = _followed(used, free)
    return float(np.median(lengths[used]) / (_MEDIAN_LENGTH * np.sqrt(1 - share)))


def _noise(lengths: FloatArray, used: BoolArray, free: BoolArray) -> float:
    """σ of one coordinate in px, from residuals that are all believed."""
    return float(np.sqrt((lengths[used] ** 2).mean() / (2 * (1 - _followed(used, free)))))


def _followed(used: BoolArray, free: BoolArray) -> float:
    """Share of the noise that the fitted parameters follow, so that residuals do not show it."""
    observed = 2 * int(used.sum())
    fitted = int(free.sum()) + 6 * int(used.any(axis=1).sum())
    return min(fitted / max(observed, 1), 0.9)


def _limits(noise_px: float, used: BoolArray, free: BoolArray) -> FloatArray:
    """(V, M) longest residuals to be believed; corners that were not fitted miss by more."""
    share = _followed(used, free)
    count = max(int(used.sum()), 1)
    freedom = max(2 * count * (1 - share), 4.0)
    k = np.sqrt(freedom * ((count / _FALSE_ALARMS) ** (2 / freedom) - 1))
    # Data without noise keep all their corners: rounding is no reason to reject.
    longest = max(k * noise_px, _ROUNDING_PX)
    limits: FloatArray = longest * np.where(used, np.sqrt(1 - share), np.sqrt(1 + share))
    return limits


def _bad_views(
    lengths: FloatArray, inliers: BoolArray, present: BoolArray, usable: BoolArray
) -> dict[int, str]:
    """Name the views to be dropped, and why."""
    kept, had = inliers.sum(axis=1), present.sum(axis=1)
    typical = _medians(lengths, present)
    few = kept < np.maximum(_LEAST_CORNERS, _LEAST_SHARE * had)
    bad: dict[int, str] = {
        int(view): f"only {kept[view]} of its {had[view]} corners agree with the other views"
        for view in np.flatnonzero(usable & few)
    }
    # A view that is not worse than the middling one is not worse than the others.
    worse = typical > max(float(np.median(typical[usable])), _ROUNDING_PX)
    for view in np.flatnonzero(usable & ~few & worse):
        others = typical[usable & (np.arange(len(usable)) != view)]
        if len(others) > 1 and typical[view] > _VIEW_FACTOR * max(np.median(others), _ROUNDING_PX):
            bad[int(view)] = (
                f"its typical residual of {typical[view]:.2f} px is "
                f"{typical[view] / np.median(others):.1f} times that of the other views"
            )
    # One at a time: a bad view makes its neighbours look bad.
    worst = max(bad, key=lambda view: typical[view], default=None)
    return {} if worst is None else {worst: bad[worst]}


def _medians(values: FloatArray, counted: BoolArray) -> FloatArray:
    """(V,) of the counted values of each row; infinite where there are none."""
    ordered = np.sort(np.where(counted, values, np.inf), axis=1)
    count = counted.sum(axis=1)
    rows = np.arange(len(ordered))
    low, high = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, ordered.shape[1] - 1)
    return np.asarray((ordered[rows, low] + ordered[rows, high]) / 2)


def _lengths(missed: FloatArray) -> FloatArray:
    """(V, M) distance of prediction and observation in px; infinite without a prediction."""
    lengths = np.linalg.norm(missed, axis=1)
    return np.where(np.isnan(lengths), np.inf, lengths)


def _report(
    views: Views,
    missed: FloatArray,
    limits: FloatArray,
    inliers: BoolArray,
    reasons: dict[int, str],
) -> tuple[Rejection, ...]:
    present, lengths = views.present, _lengths(missed)
    order = {
        int(view): words
        for view in np.flatnonzero((present & ~inliers).sum(axis=1) > _MANY * present.sum(axis=1))
        if (words := _order(views, int(view))) is not None
    }
    reasons = {
        view: "; ".join([*filter(None, [reason, order.get(view)])])
        for view, reason in reasons.items()
    }
    whole = [
        Rejection(view, None, float(np.sqrt(np.mean(lengths[view, present[view]] ** 2))), reason)
        for view, reason in reasons.items()
    ]
    lost = present & ~inliers
    lost[list(reasons)] = False
    single = []
    for view in np.flatnonzero(lost.any(axis=1)):
        predicted, observed = (views.pixels[view] + missed[view]).T, views.pixels[view].T
        partners = exchanged_with(predicted, observed, lost[view], float(limits[view].max()))
        for point in np.flatnonzero(lost[view]):
            reason = (
                f"{lengths[view, point]:.2f} px from where the other corners put it (limit "
                f"{limits[view, point]:.2f} px)"
            )
            if partners[point] != NOT_EXCHANGED:
                reason += f"; looks swapped with corner {partners[point]}"
            elif view in order:
                reason += f"; {order[int(view)]}"
            single.append(Rejection(int(view), int(point), float(lengths[view, point]), reason))
    return tuple(
        sorted([*whole, *single], key=lambda r: (r.view, -1 if r.point is None else r.point))
    )


def _order(views: Views, view: int) -> str | None:
    """Name the order that the corners of a view look listed in, where it is another than meant."""
    present = views.present[view]
    seen = views.pixels[view][:, present].T
    limit_px = _BENT * float(np.linalg.norm(np.ptp(seen, axis=0)))
    return numbering_in_list(views.points_mm[view][:, present].T, seen, limit_px)
