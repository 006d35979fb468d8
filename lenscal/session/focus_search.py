"""The search for the sharpest position, whatever it is that moves.

A coarse sweep, longer where its peak lies at an end, wide open where it shows none; then fine
sweeps about the peak. All sweeps go in the same direction and every move ends from the same side,
the last one to the peak too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import FocusError, OutOfRangeError
from lenscal.rig.interfaces import Rig
from lenscal.session.disk_watch import DiskWatch, Look
from lenscal.session.exposure import expose
from lenscal.session.focus_movers import FocusMover
from lenscal.session.focus_peak import PeakFit, Verdict, confidence, fit_peak, judge
from lenscal.session.sharpness import MEASURES, Measure
from lenscal.setting import ApproachSide

#: Pictures of a fine sweep, and how many of them need to be of use.
_FINE: Final = 13
_LEAST_FINE: Final = 7
#: A fine sweep reaches to where the squared edge width has grown by this factor over the least.
_FINE_WIDTH_RATIO: Final = 2.3
#: Its half length in steps of the coarse sweep, at least and at most.
_FINE_STEPS: Final = (0.5, 4.0)
#: A fine sweep more than so many times as long as wanted is followed by a finer one.
_TOO_LONG: Final = 2.5
_MOST_FINE: Final = 4
#: A coarse sweep shows the disk at least so many times.
_LEAST_SEEN: Final = 3
#: An extension adds this share of the sweep's length.
_EXTENSION: Final = 0.5


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """How to search.

    Parameters
    ----------
    measure
        What sharpness is measured by.
    extensions
        How many times the coarse sweep may be made longer, by half its length each time.
    repeatability
        σ with which the mover comes back to a place, in its unit; it is part of σ of the peak,
        since no curve shows where the last move ended.
    check_iris
        A second iris, at which the fine sweep is repeated to see whether the focus shifts with the
        iris; None for none.
    approach
        Side from which the motors of the lens end their moves.
    """

    measure: Measure = Measure.EDGE_WIDTH
    extensions: int = 2
    repeatability: float = 0.0
    check_iris: float | None = None
    approach: ApproachSide = ApproachSide.FROM_BELOW


@dataclass(frozen=True, slots=True, eq=False)
class FocusPeak:
    """The sharpest position, and how it was found.

    Parameters
    ----------
    position, sigma
        Where, and its standard deviation: of the fit and of the mover.
    confidence
        0 to 1: how far the coarse curve falls from its peak.
    iris
        The iris it was searched at.
    curve_position, curve_sharpness
        (N,) the curve: the coarse sweep, ascending, then the last fine one; pictures without a disk
        that could be measured are left out.
    fit
        The parabola through the fine sweep.
    fine
        How many points of the curve, at its end, are of the fine sweep.
    notes
        What was out of the ordinary, in words.
    """

    position: float
    sigma: float
    confidence: float
    iris: float | None
    curve_position: FloatArray
    curve_sharpness: FloatArray
    fit: PeakFit
    fine: int
    notes: tuple[str, ...]


class FocusSearch:
    """One search; whoever starts it puts iris and exposure back afterwards.

    Parameters
    ----------
    rig
        Gives camera and iris.
    mover
        What is moved.
    options
        How.
    """

    def __init__(self, rig: Rig, mover: FocusMover, options: SearchOptions) -> None:
        self._rig = rig
        self._mover = mover
        self._options = options
        self._watch = DiskWatch(rig.camera, options.measure)
        self._notes: list[str] = []

    def run(self, positions: FloatArray) -> FocusPeak:
        """Search, and leave the mover at the peak.

        Parameters
        ----------
        positions
            (N,) of the coarse sweep, ascending, at least five.

        Returns
        -------
        FocusPeak
            The peak; the iris may stand elsewhere than before, which a note says.

        Raises
        ------
        FocusError
            When the sweep is empty or too short, no disk is found, the picture is too dark or too
            bright, the peak lies beyond what can be reached, or there is no clear one.
        """
        if len(positions) < 5 or (np.diff(positions) <= 0).any():
            listed = ", ".join(f"{p:g}" for p in positions[:6])
            raise FocusError(
                f"the sweep needs at least five ascending positions, but has {len(positions)}"
                + (f": {listed}{self._mover.unit}" if listed else "")
            )
        self._expose_within(positions)
        coarse = self._coarse(positions)
        fine, fit = self._fine(coarse)
        iris = self._rig.lens.setting.iris
        if self._options.check_iris is not None:
            self._compare_iris(self._options.check_iris, fine, fit)
        self._mover.move_to(fit.position)
        scored = [look for look in fine if np.isfinite(look.sharpness)]
        curve = [look for look in coarse if np.isfinite(look.sharpness)] + scored
        return FocusPeak(
            position=fit.position,
            sigma=float(np.hypot(fit.sigma, self._options.repeatability)),
            confidence=confidence(_sharpness(coarse)),
            iris=iris,
            curve_position=_positions(curve),
            curve_sharpness=_sharpness(curve),
            fit=fit,
            fine=len(scored),
            notes=tuple(self._notes),
        )

    def _expose_within(self, positions: FloatArray) -> None:
        """Expose in the middle of what the mover reaches."""
        middle = len(positions) // 2
        for position in sorted(positions, key=lambda p: abs(p - positions[middle])):
            try:
                self._mover.move_to(float(position))
            except OutOfRangeError as error:
                beyond = error
                continue
            expose(self._rig.camera)
            return
        raise FocusError(
            f"no {self._mover.what} from {self._place(positions[0])} to "
            f"{self._place(positions[-1])} can be reached: {beyond}"
        )

    def _coarse(self, positions: FloatArray) -> list[Look]:
        """Sweep until there is a clear peak, extending and opening the iris as it takes."""
        looks = self._sweep(positions)
        self._say_what_was_not_reached(positions, looks)
        self._refuse_without_disk(looks)
        extensions = 0
        while (verdict := judge(_sharpness(looks))) is not Verdict.CLEAR:
            if verdict is Verdict.FLAT and self._open_iris():
                looks = self._sweep(_positions(looks))
                continue
            if extensions == self._options.extensions:
                raise FocusError(self._complaint(verdict, looks))
            extensions += 1
            looks = self._extend(verdict, looks)
        return looks

    def _refuse_without_disk(self, looks: list[Look]) -> None:
        seen = int(np.isfinite(_sharpness(looks)).sum())
        if seen < _LEAST_SEEN:
            raise FocusError(
                f"only {seen} of {len(looks)} pictures from {self._place(looks[0].position)} to "
                f"{self._place(looks[-1].position)} show a disk at the middle; in the last one "
                f"without: {self._watch.trouble}"
            )

    def _sweep(self, positions: FloatArray) -> list[Look]:
        """Look at all positions that can be reached, in the mover's direction."""
        looks = []
        for position in positions if self._mover.ascending else positions[::-1]:
            try:
                self._mover.move_to(float(position))
            except OutOfRangeError:
                continue
            looks.append(self._watch.look(float(position)))
        return sorted(looks, key=lambda look: look.position)

    def _say_what_was_not_reached(self, positions: FloatArray, looks: list[Look]) -> None:
        missing = sorted(set(positions.tolist()) - {look.position for look in looks})
        if missing:
            self._notes.append(
                f"{len(missing)} of {len(positions)} places of the sweep, from "
                f"{self._place(missing[0])} to {self._place(missing[-1])}, cannot be reached"
            )

    def _open_iris(self) -> bool:
        """Open the iris to its widest; false when it stands there, or the lens does not say."""
        lens = self._rig.lens
        iris, widest = lens.setting.iris, lens.travel.iris[1]
        if iris is None or iris >= widest:
            return False
        lens.move_to(lens.setting.with_iris(widest), self._options.approach)
        expose(self._rig.camera)
        self._notes.append(
            f"no clear peak at iris {iris:g}; the iris was opened to {widest:g} to focus and "
            f"restored to {iris:g}"
        )
        return True

    def _extend(self, verdict: Verdict, looks: list[Look]) -> list[Look]:
        """Add to the end, or the ends, where the peak may lie."""
        places = _positions(looks)
        count = max(4, round(_EXTENSION * len(places)))
        steps = np.arange(1, count + 1)
        below = places[0] - steps[::-1] * (places[1] - places[0])
        above = places[-1] + steps * (places[-1] - places[-2])
        chosen = {Verdict.BELOW: [below], Verdict.ABOVE: [above]}.get(verdict, [below, above])
        added = self._sweep(np.concatenate(chosen))
        if not added:
            raise FocusError(
                f"{self._complaint(verdict, looks)}; it could not be extended: the travel ends"
            )
        looks = sorted([*looks, *added], key=lambda look: look.position)
        self._notes.append(
            f"{verdict.value} between {self._place(places[0])} and {self._place(places[-1])}; the "
            f"sweep was extended to {self._place(looks[0].position)} .. "
            f"{self._place(looks[-1].position)}"
        )
        return looks

    def _complaint(self, verdict: Verdict, looks: list[Look]) -> str:
        sharpness = np.nan_to_num(_sharpness(looks))
        low, high = self._place(looks[0].position), self._place(looks[-1].position)
        if verdict is Verdict.FLAT:
            fall = 100 * (1 - sharpness.min() / sharpness.max())
            return (
                f"no clear peak over the {self._mover.what} between {low} and {high} at "
                f"{self._rig.lens.setting}: sharpness falls by {fall:.0f} % only; open the iris or "
                "search a longer range"
            )
        end, place = ("lowest", low) if verdict is Verdict.BELOW else ("highest", high)
        return (
            f"the sharpest picture lies at the {end} {self._mover.what} of the search, {place}, or "
            "beyond; extend the search there"
        )

    def _fine(self, coarse: list[Look]) -> tuple[list[Look], PeakFit]:
        """Sweep about the peak, finer until the sweep is about as long as the peak is wide."""
        width_power = MEASURES[self._options.measure].width_power
        middle, reach = _first_guess(coarse, width_power)
        for _ in range(_MOST_FINE):
            looks = self._sweep(np.linspace(middle - reach, middle + reach, _FINE))
            fit = self._fit(looks, coarse)
            wanted = fit.reach * float(np.sqrt(_FINE_WIDTH_RATIO))
            if reach <= _TOO_LONG * wanted:
                break
            # The vertex of a long sweep is not known well enough for a very short one.
            middle, reach = fit.position, max(wanted, reach / _FINE * 2, 3 * fit.sigma)
        return looks, fit

    def _fit(self, looks: list[Look], others: list[Look]) -> PeakFit:
        seen = [look for look in looks if np.isfinite(look.sharpness)]
        if len(seen) < _LEAST_FINE:
            raise FocusError(
                f"only {len(seen)} of {_FINE} pictures about the peak were reached and show a "
                f"disk; search elsewhere or make room for the {self._mover.what} to go on"
            )
        positions, sharpness = _positions(seen), _sharpness(seen)
        everything = [*others, *looks]
        vergence = self._mover.vergence(
            _positions(everything),
            np.array([look.size_px for look in everything]),
            float(positions.mean()),
        )
        width_power = MEASURES[self._options.measure].width_power
        return fit_peak(positions, sharpness, vergence=vergence, width_power=width_power)

    def _compare_iris(self, iris: float, fine: list[Look], fit: PeakFit) -> None:
        """Repeat the fine sweep, twice as long, at another iris, and note where the peak is."""
        lens = self._rig.lens
        before = lens.setting
        lens.move_to(before.with_iris(iris), self._options.approach)
        expose(self._rig.camera)
        places = _positions(fine)
        try:
            other = self._fit(self._sweep(2 * places - places.mean()), fine)
        except FocusError as error:
            self._notes.append(f"at iris {iris:g} the focus could not be compared: {error}")
        else:
            sigma = np.hypot(fit.sigma, other.sigma)
            self._notes.append(
                f"at iris {iris:g} the sharpest {self._mover.what} is "
                f"{other.position - fit.position:+.3f} ± {sigma:.3f}{self._mover.unit} from that "
                f"at iris {before.iris:g}"
            )
        lens.move_to(before, self._options.approach)

    def _place(self, position: float) -> str:
        return f"{position:.1f}{self._mover.unit}"


def _first_guess(coarse: list[Look], width_power: float) -> tuple[float, float]:
    """Lay a fine sweep about the peak of the coarse one: its middle and half its length."""
    best = int(np.nan_to_num(_sharpness(coarse)).argmax())
    near = coarse[best - 1 : best + 2]
    x = _positions(near) - coarse[best].position
    step = float(np.abs(x).max())
    least, most = (share * step for share in _FINE_STEPS)
    if np.isnan(_sharpness(near)).any():
        return coarse[best].position, step
    bend, slope, constant = np.polyfit(x, _sharpness(near) ** (-2.0 / width_power), 2)
    if bend <= 0:
        return coarse[best].position, step
    vertex = float(np.clip(-slope / (2 * bend), x[0], x[-1]))
    lowest = max(constant - slope**2 / (4 * bend), 0.25 * constant)
    reach = np.sqrt(_FINE_WIDTH_RATIO * lowest / bend)
    return coarse[best].position + vertex, float(np.clip(reach, least, most))


def _positions(looks: list[Look]) -> FloatArray:
    return np.array([look.position for look in looks])


def _sharpness(looks: list[Look]) -> FloatArray:
    return np.array([look.sharpness for look in looks])
