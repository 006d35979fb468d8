"""The motors of a simulated lens: where the controller believes the glass to be, and where it is.

The controller counts what it told a motor to do. Between that count and the glass stand, in this
order, steps that were lost, the play of the gear, the wind-up of the drive, scatter and drift.
Positions are in controller units throughout. Zero is set from below: without lost steps, scatter
and drift a long move upwards brings the glass exactly to where the controller believes it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from lenscal.errors import InputError
from lenscal.rig.simulated.motor_faults import LensFaults, MotorFaults
from lenscal.setting import ApproachSide, LensSetting, LensTravel

_SECONDS_PER_HOUR: Final = 3600.0


@dataclass(slots=True, eq=False)
class Motor:
    """One motor, the count of its controller and the glass that it drives.

    Parameters
    ----------
    faults
        What is wrong with it.
    believed
        Where the controller believes the glass to be; at the start it is there.
    side
        From which side the last move ended.
    """

    faults: MotorFaults
    believed: float
    side: ApproachSide = ApproachSide.FROM_BELOW
    _shaft: float = field(init=False)
    _glass: float = field(init=False)
    _wind_up: float = field(init=False, default=0.0)
    _scatter: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self._shaft = self._glass = self.believed

    def move_to(self, target: float, side: ApproachSide, rng: np.random.Generator) -> float:
        """Drive the glass to a target such that the last bit of the way comes from one side.

        A motor that is told to go where it stands, as it came there, does not move.

        Parameters
        ----------
        target
            Where to.
        side
            The side from which to end the move; it matters to a motor with slack only.
        rng
            Source of scatter and lost steps; a motor without them does not ask it.

        Returns
        -------
        float
            Way that the motor made, overshoot included.
        """
        step = self.faults.step
        goal = step * round(target / step) if step else target
        if goal == self.believed and (side == self.side or not self.faults.take_up):
            return 0.0
        legs = self._legs(goal, side)
        lost = self._lost_steps(rng)
        for leg in legs:
            slipped = math.copysign(min(lost, abs(leg)), leg)
            self._turn(leg - slipped)
            lost = 0.0
        self.believed, self.side = goal, side
        if self.faults.repeatability:
            self._scatter = float(rng.normal(0.0, self.faults.repeatability))
        return sum(abs(leg) for leg in legs)

    def position(self, clock_s: float) -> float:
        """Tell where the glass really is.

        Parameters
        ----------
        clock_s
            Seconds since the rig was switched on.

        Returns
        -------
        float
            Its position; hard stops are not taken into account.
        """
        drift = self.faults.drift_per_hour * clock_s / _SECONDS_PER_HOUR
        return self._glass + self._wind_up + self._scatter + drift

    def _legs(self, goal: float, side: ApproachSide) -> list[float]:
        """Split the way so that the last leg comes from the side asked for, and takes up slack."""
        way = goal - self.believed
        towards = 1.0 if side is ApproachSide.FROM_BELOW else -1.0
        if way * towards >= self.faults.take_up or not self.faults.take_up:
            return [way]
        back = -towards * self.faults.take_up
        return [way + back, -back]

    def _turn(self, way: float) -> None:
        """Turn the shaft: the play lets the glass stay behind, the drive winds up."""
        self._shaft += way
        self._glass = min(max(self._glass, self._shaft), self._shaft + self.faults.backlash)
        if self.faults.hysteresis:
            settled = self.faults.hysteresis if way < 0 else 0.0
            remaining = math.exp(-abs(way) / self.faults.hysteresis_way)
            self._wind_up = settled + (self._wind_up - settled) * remaining

    def _lost_steps(self, rng: np.random.Generator) -> float:
        chance = self.faults.lost_step_probability
        return self.faults.lost_steps if chance and rng.random() < chance else 0.0


@dataclass(slots=True, eq=False)
class LensMotors:
    """The three motors of a lens.

    Parameters
    ----------
    travel
        How far they go. Hard stops at its ends hold the glass; the shafts have room to overshoot.
    zoom, focus, iris
        The motors.
    """

    travel: LensTravel
    zoom: Motor
    focus: Motor
    iris: Motor

    @classmethod
    def at(cls, setting: LensSetting, travel: LensTravel, faults: LensFaults) -> LensMotors:
        """Home three motors to a setting.

        Parameters
        ----------
        setting
            Where they stand, iris included.
        travel
            How far they go.
        faults
            What is wrong with them.

        Returns
        -------
        LensMotors
            The motors.

        Raises
        ------
        InputError
            When the iris is not stated.
        OutOfRangeError
            When the setting lies beyond the travel.
        """
        travel.check(setting)
        if setting.iris is None:
            raise InputError(f"the motors must be homed to an iris too, but {setting} has none")
        return cls(
            travel,
            Motor(faults.zoom, setting.zoom),
            Motor(faults.focus, setting.focus),
            Motor(faults.iris, setting.iris),
        )

    @property
    def believed(self) -> LensSetting:
        """Where the controller believes them to be."""
        return LensSetting(self.zoom.believed, self.focus.believed, self.iris.believed)

    def true_setting(self, clock_s: float) -> LensSetting:
        """Tell where the glass really is.

        Parameters
        ----------
        clock_s
            Seconds since the rig was switched on.

        Returns
        -------
        LensSetting
            Within the travel, whose hard stops hold what would go beyond.
        """
        zoom, focus, iris = (
            float(np.clip(motor.position(clock_s), *ends))
            for motor, ends in (
                (self.zoom, self.travel.zoom),
                (self.focus, self.travel.focus),
                (self.iris, self.travel.iris),
            )
        )
        return LensSetting(zoom, focus, iris)

    def move_to(self, setting: LensSetting, side: ApproachSide, rng: np.random.Generator) -> float:
        """Drive all motors at once.

        Parameters
        ----------
        setting
            Where to, within the travel; an iris of None leaves the iris alone.
        side
            The side from which every motor ends its move.
        rng
            Source of scatter and lost steps.

        Returns
        -------
        float
            The longest way as a share of its motor's travel.

        Raises
        ------
        OutOfRangeError
            When the setting lies beyond the travel; nothing has moved then.
        """
        self.travel.check(setting)
        moves = [
            (self.zoom, setting.zoom, self.travel.zoom),
            (self.focus, setting.focus, self.travel.focus),
        ]
        if setting.iris is not None:
            moves.append((self.iris, setting.iris, self.travel.iris))
        return max(
            motor.move_to(target, side, rng) / (high - low) for motor, target, (low, high) in moves
        )
