"""What all settings of a session know together of the robot and of how camera and target sit.

The directions of the camera in the hand and the place of the target are the same at every setting,
and so is the robot. Each setting measures them for itself; here these measurements are weighed
together, and every setting is given what the *others* know: its own pixels are not counted twice,
and with them the result is that of one large fit of all settings.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.stats import chi2

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.calibration import Repeatability, RobotEvidence
from lenscal.calibration.slips import SHARED_BY_SETTINGS, MountingPrior

#: How often a session in which nothing moved may be told that something did.
_FALSE_ALARMS: Final = 1e-3


class Pool(NamedTuple):
    """What the settings of a session give one another.

    Parameters
    ----------
    priors
        One per setting: what the others know of the mounting, or None when nobody else does.
    notes
        One per setting: a sentence when its mounting disagrees with that of the others.
    everybody
        What all that agree know together, for a setting that could not measure.
    """

    priors: tuple[MountingPrior | None, ...]
    notes: tuple[str | None, ...]
    everybody: MountingPrior


def pool_repeatability(evidence: Sequence[RobotEvidence]) -> Repeatability:
    """Estimate the repeatability of the robot from all settings.

    Parameters
    ----------
    evidence
        One per setting, weighed by the repeatability believed so far.

    Returns
    -------
    Repeatability
        The sum of the squared slips over their redundancy; once this is what they were weighed by,
        it is the estimate of highest restricted likelihood.
    """
    slips = np.concatenate([e.slips[e.believed] for e in evidence]).reshape(-1, 2, 3)
    redundancy = sum(e.redundancy for e in evidence)
    rotation, translation = np.sqrt((slips**2).sum(axis=(0, 2)) / redundancy)
    return Repeatability(rotation_rad=float(rotation), translation_mm=float(translation))


def pool_settings(evidence: Sequence[RobotEvidence]) -> Pool:
    """Weigh the settings of a session together.

    Parameters
    ----------
    evidence
        One per setting, each from its own views alone; at least one.

    Returns
    -------
    Pool
        What each learns from the others.
    """
    measured = _Measured.of(evidence)
    notes: list[str | None] = [None] * len(evidence)
    agreeing = np.ones(len(evidence), dtype=bool)
    limit = chi2.isf(_FALSE_ALARMS / len(evidence), len(SHARED_BY_SETTINGS))
    # One at a time: one that moved makes the others look as if they had.
    while agreeing.sum() > 2:
        distances = [
            measured.disagreement(i, agreeing) if agreeing[i] else 0.0 for i in range(len(evidence))
        ]
        worst = int(np.argmax(distances))
        if distances[worst] <= limit:
            break
        agreeing[worst] = False
        notes[worst] = _note(measured.away(worst, agreeing))
    priors = tuple(
        measured.prior(i, agreeing) if agreeing[i] and agreeing.sum() > 1 else None
        for i in range(len(evidence))
    )
    return Pool(priors, tuple(notes), measured.prior(None, agreeing))


class _Measured(NamedTuple):
    """The mountings as steps from that of the first setting, and the information behind them."""

    origin: RobotEvidence
    steps: FloatArray
    information: FloatArray

    @classmethod
    def of(cls, evidence: Sequence[RobotEvidence]) -> _Measured:
        origin = evidence[0]
        steps = [origin.mounting.step_to(e.mounting)[SHARED_BY_SETTINGS] for e in evidence]
        covariances = np.stack(
            [
                e.mounting_covariance[np.ix_(SHARED_BY_SETTINGS, SHARED_BY_SETTINGS)]
                for e in evidence
            ]
        )
        return cls(origin, np.array(steps), np.linalg.inv(covariances))

    def others(self, index: int | None, agreeing: BoolArray) -> tuple[FloatArray, FloatArray]:
        """(9,) mean and (9, 9) information of all that agree, but one."""
        chosen = agreeing.copy()
        if index is not None:
            chosen[index] = False
        total = self.information[chosen].sum(axis=0)
        weighted = (self.information[chosen] @ self.steps[chosen][..., None]).sum(axis=0)[:, 0]
        return np.linalg.solve(total, weighted), total

    def away(self, index: int, agreeing: BoolArray) -> FloatArray:
        away: FloatArray = self.steps[index] - self.others(index, agreeing)[0]
        return away

    def disagreement(self, index: int, agreeing: BoolArray) -> float:
        """Squared distance from the others, in units of its covariance."""
        _, total = self.others(index, agreeing)
        away = self.away(index, agreeing)
        covariance = np.linalg.inv(self.information[index]) + np.linalg.inv(total)
        return float(away @ np.linalg.solve(covariance, away))

    def prior(self, index: int | None, agreeing: BoolArray) -> MountingPrior:
        mean, total = self.others(index, agreeing)
        step = np.zeros(self.origin.mounting_covariance.shape[0])
        step[SHARED_BY_SETTINGS] = mean
        return MountingPrior(self.origin.mounting.moved(step), total)


def _note(away: FloatArray) -> str:
    turn_x, turn_y, shift = away[:3], away[3:6], away[6:]
    return (
        f"the target lies {np.linalg.norm(shift):.2g} mm and {1e3 * np.linalg.norm(turn_y):.2g} "
        f"mrad, and the camera is turned {1e3 * np.linalg.norm(turn_x):.2g} mrad, from where the "
        "other settings see them; was something knocked? This setting was calibrated by itself"
    )
