"""Which settings disagree with their neighbours by more than their σ allow."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats
from scipy.spatial import ConvexHull, QhullError

from lenscal.arrays import BoolArray, FloatArray, IntArray
from lenscal.maps.kriging import coordinates, leave_one_out
from lenscal.maps.tame_samples import TameQuantity, checked_settings, derived, tame_quantities

if TYPE_CHECKING:
    from lenscal.calibration.table import CalibrationTable

#: In how many of consistent tables a setting may be flagged all the same.
_FALSE_ALARMS: Final = 1e-3
#: At most this share of the settings, and this many, are set aside as suspects.
_MOST_SUSPECTS: Final = (0.15, 10)
#: Where nothing is further off than this, no pair of bad settings hides behind another.
_NOTHING_SUSPICIOUS: Final = 3.5
#: A quantity of a bad setting that is off by more than this is set aside with it.
_DOUBTFUL: Final = 2.0
#: By how much further the end of a curve, or the border of a strip, may be off: a lens may turn
#: there as it likes.
_END: Final = 2.0
#: Quantities that change by a factor across a strip, as the sharp plane goes to infinity.
_TO_INFINITY: Final = ("magnification", "object_distance_mm", "standoff_mm")
#: Settings of a motor closer than this share of its range are one.
_SAME_SETTING: Final = 1e-3
#: Relative differences up to this are the rounding of a table.
_ROUNDING: Final = 1e-5
#: Median of the absolute value of a standard normal variable.
_NORMAL_MEDIAN: Final = 0.6745


def check_consistency(table: pd.DataFrame | CalibrationTable) -> pd.DataFrame:
    """Compare every setting with what the others say of it.

    Each quantity of a setting is predicted from the other settings by kriging in a tame coordinate,
    with the smoothness that those others make likely. What a setting's own σ and that of the
    prediction do not allow is its disagreement. Bad settings are set aside one at a time, the worst
    first, and all are then judged by the good ones alone, so that a bad setting does not make its
    neighbours look bad. Where the table states d or f beside d/D and D, it is also asked whether
    they fit together.

    Parameters
    ----------
    table
        A calibration table, or a frame with the columns zoom, focus and at least one of
        magnification, object_distance_mm, image_distance_mm, focal_length_mm, standoff_mm,
        principal_point_x_px, principal_point_y_px, k1_per_mm2; and, as far as they are known,
        sigma_<quantity>, sigma_sharpest_mm, cov_magnification_object_distance_mm. Where σ are not
        known, the scatter about a smooth surface stands for them.

    Returns
    -------
    pd.DataFrame
        One row per setting, in the order of the table: zoom, focus; worst_quantity, the quantity
        that disagrees most; sigmas, by how many σ (measured less expected); flagged; measured and
        expected value of that quantity; error, relative except for principal point and κ1; and
        threshold, the σ from which a setting is flagged, so that one consistent table in a thousand
        would raise an alarm if all errors were normal. Where the settings are too few to tell,
        sigmas is NaN and nothing is flagged.

    Raises
    ------
    InputError
        When columns are missing, values are not finite or not positive, or settings are repeated.
    MapError
        When the table has one setting only.
    """
    samples = checked_settings(table if isinstance(table, pd.DataFrame) else table.to_dataframe())
    points = samples[["zoom", "focus"]].to_numpy(float)
    quantities = [*tame_quantities(samples), *_contradictions(samples)]
    threshold = _threshold(len(samples) * len(quantities))
    comparison = _Comparison(points, coordinates(points), quantities)
    bad, out = comparison.suspects(threshold)
    findings = comparison.judge(out)
    while kept := [row for row in bad if abs(findings[row].sigmas) > threshold]:
        if len(kept) == len(bad):
            break
        # A suspect that the good ones agree with joins them.
        bad, out = kept, [rows & frozenset(kept) for rows in out]
        findings = comparison.judge(out)
    if not kept:
        bad, findings = [], comparison.judge([frozenset()] * len(quantities))
    return pd.DataFrame(
        {
            "zoom": points[:, 0],
            "focus": points[:, 1],
            "worst_quantity": [f.quantity for f in findings],
            "sigmas": [f.sigmas for f in findings],
            "flagged": np.isin(np.arange(len(points)), bad),
            "measured": [f.measured for f in findings],
            "expected": [f.expected for f in findings],
            "error": [f.error for f in findings],
            "threshold": threshold,
        }
    )


class _Finding(NamedTuple):
    """The worst disagreement of one setting."""

    quantity: str = ""
    sigmas: float = np.nan
    measured: float = np.nan
    expected: float = np.nan
    error: float = np.nan

    @classmethod
    def of(cls, quantity: TameQuantity, place: int, sigmas: float, expected: float) -> _Finding:
        """Put it into the unit of the quantity."""
        wanted = quantity.in_unit(expected, place)
        measured = quantity.in_unit(float(quantity.values[place]), place)
        error = measured - wanted
        return cls(
            quantity.name,
            sigmas,
            measured,
            wanted,
            error / wanted if quantity.is_logarithm else error,
        )


def _threshold(comparisons: int) -> float:
    return float(stats.norm.isf(_FALSE_ALARMS / (2 * comparisons)))


class _Told(NamedTuple):
    """What is said of one quantity at each setting: by how many σ it is off, and what is expected.

    NaN for settings where the quantity is not known or was left out.
    """

    sigmas: FloatArray
    expected: FloatArray


@dataclass(frozen=True)
class _Comparison:
    """The settings, their quantities, and what was found out about them so far."""

    points: FloatArray
    planes: list[FloatArray]
    quantities: list[TameQuantity]
    known: dict[tuple[int, frozenset[int]], _Told] = field(default_factory=dict)

    def suspects(self, threshold: float) -> tuple[list[int], list[frozenset[int]]]:
        """Rows to set aside, and for each quantity those of them in which it is doubtful.

        They are found one after the other (Rosner's generalised extreme deviates). It goes on past
        the first that looks well, since two bad settings can hide each other.
        """
        share, most = _MOST_SUSPECTS
        out = [frozenset[int]()] * len(self.quantities)
        found: list[int] = []
        kept: tuple[list[int], list[frozenset[int]]] = [], out
        while len(found) < max(1, min(most, int(share * len(self.points)))):
            sigmas = np.abs(np.stack([self.told(q, rows).sigmas for q, rows in enumerate(out)]))
            sigmas[:, found] = np.nan
            sigmas = np.nan_to_num(sigmas)
            row = int(np.argmax(sigmas.max(axis=0)))
            worst = float(sigmas[:, row].max())
            if worst < _NOTHING_SUSPICIOUS:
                break
            found = [*found, row]
            # What is not doubtful stays: without it, its neighbours would be told worse.
            out = [
                rows | {row} if sigmas[q, row] > _DOUBTFUL else rows for q, rows in enumerate(out)
            ]
            if worst > threshold:
                kept = found, out
        return kept

    def judge(self, out: list[frozenset[int]]) -> list[_Finding]:
        """Findings of all settings, each held against the good ones."""
        findings = [_Finding()] * len(self.points)
        for q, quantity in enumerate(self.quantities):
            for place, row in enumerate(quantity.rows.tolist()):
                told = self.told(q, out[q] - {row})
                sigmas = float(told.sigmas[row])
                if abs(sigmas) >= np.nan_to_num(abs(findings[row].sigmas)):
                    expected = float(told.expected[row])
                    findings[row] = _Finding.of(quantity, place, sigmas, expected)
        return findings

    def told(self, q: int, out: frozenset[int]) -> _Told:
        """Hold each setting against the others, leaving some out."""
        if (q, out) not in self.known:
            self.known[q, out] = self._told(self.quantities[q], out)
        return self.known[q, out]

    def _told(self, quantity: TameQuantity, out: frozenset[int]) -> _Told:
        places = np.flatnonzero(~np.isin(quantity.rows, list(out)))
        rows = quantity.rows[places]
        variances = None if quantity.variances is None else quantity.variances[places]
        found = leave_one_out(
            self.points[rows],
            quantity.values[places],
            variances,
            logarithms=quantity.is_logarithm,
            planes=[plane[rows] for plane in self.planes],
        )
        sigmas, expected = np.full((2, len(self.points)), np.nan)
        if np.isfinite(found.sigmas).all():
            # Where the lens is less smooth than a surface can be, that counts as scatter too.
            scatter = float(np.median(np.abs(found.sigmas))) / _NORMAL_MEDIAN
            alone = _lonely_ends(self.points[rows])
            if quantity.name in _TO_INFINITY:
                alone |= _borders_of_strip(self.planes, rows)
            ends = np.where(alone, _END, 1.0)
            sigmas[rows] = found.sigmas / (max(1.0, scatter) * ends)
            expected[rows] = found.value
        return _Told(sigmas, expected)


def _lonely_ends(points: FloatArray) -> BoolArray:
    """Tell which settings lie at the end of a curve: no others surround them, or share a motor."""
    spans = np.ptp(points, axis=0)
    scaled = points[:, spans > 0] / spans[spans > 0]
    ends = np.zeros(len(points), dtype=bool)
    if scaled.shape[1] == 1:
        ends[[np.argmin(scaled), np.argmax(scaled)]] = True
        return ends
    try:
        ends[ConvexHull(scaled).vertices] = True
    except QhullError:
        ends[[np.argmin(scaled[:, 0]), np.argmax(scaled[:, 0])]] = True
    for row in np.flatnonzero(ends):
        beside = np.abs(np.delete(scaled, row, axis=0) - scaled[row]).min() <= _SAME_SETTING
        ends[row] = not beside
    return ends


def _borders_of_strip(planes: list[FloatArray], rows: IntArray) -> BoolArray:
    """Tell which settings are the first or last of their zoom, or of a first or last zoom.

    On a grid other settings share their motors; on a strip they are told by extrapolation, along
    the motor that takes the lens to infinity.
    """
    if len(planes) < 2:
        return np.zeros(len(rows), dtype=bool)
    place = planes[-1][rows]
    low, high = place.min(axis=0), place.max(axis=0)
    near = _SAME_SETTING * (high - low)
    return np.asarray(((place <= low + near) | (place >= high - near)).any(axis=1))


def _contradictions(samples: pd.DataFrame) -> list[TameQuantity]:
    """Stated d and f over those that follow from d/D and D of the same setting."""
    if not {"magnification", "object_distance_mm"} <= set(samples):
        return []
    found = []
    by_name = {quantity.name: quantity for quantity in tame_quantities(samples)}
    for name, values in derived(samples).items():
        if name not in samples or samples[name].isna().any() or np.isnan(values).any():
            continue
        ratio = np.log(samples[name].to_numpy(float) / values)
        if np.ptp(ratio) <= _ROUNDING:
            continue
        # A column that is off throughout is another quantity, such as a nominal focal length.
        same = float(np.median(np.abs(ratio))) <= _ROUNDING
        variances = by_name[name].variances if same else None
        found.append(TameQuantity(name, np.arange(len(samples)), ratio, variances, np.log(values)))
    return found
