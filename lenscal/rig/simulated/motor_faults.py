"""What can be wrong with the motors of a simulated lens, each with a number.

All are off by default, and in the units of the lens controller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from lenscal.errors import InputError


@dataclass(frozen=True, slots=True)
class MotorFaults:
    """What is wrong with one motor, in its controller units; by default nothing.

    Parameters
    ----------
    step
        Size of a step: targets are rounded to whole steps. 0 for none.
    backlash
        Play of the gear: the glass rests this much higher after a move down than after a move up.
    hysteresis
        Wind-up of the drive: the same, but built up gradually on the way after a reversal.
    hysteresis_way
        Way after a reversal on which the wind-up comes to 1 − 1/e of `hysteresis`.
    repeatability
        Standard deviation of the place where the glass rests, drawn anew by every move.
    drift_per_hour
        How fast the glass creeps upwards while nothing moves it.
    lost_step_probability
        Chance of a move to lose steps.
    lost_steps
        How far a move that loses steps stays behind its target. The controller does not notice;
        the error stays. A stepper loses a whole electrical cycle, four full steps.

    Raises
    ------
    InputError
        When a number is negative or not finite, or the probability is above 1.
    """

    step: float = 0.0
    backlash: float = 0.0
    hysteresis: float = 0.0
    hysteresis_way: float = 1.0
    repeatability: float = 0.0
    drift_per_hour: float = 0.0
    lost_step_probability: float = 0.0
    lost_steps: float = 4.0

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self)):
            value = getattr(self, name)
            may_be_negative = name == "drift_per_hour"
            if not math.isfinite(value) or (value < 0 and not may_be_negative):
                raise InputError(
                    f"{name} of a motor must be finite and not negative, but is {value}"
                )
        if self.lost_step_probability > 1:
            raise InputError(
                "lost_step_probability of a motor is a chance between 0 and 1, but is "
                f"{self.lost_step_probability:g}"
            )
        if self.hysteresis and not self.hysteresis_way:
            raise InputError("hysteresis needs a hysteresis_way above 0 on which it builds up")

    @property
    def take_up(self) -> float:
        """How far the controller overshoots so that slack and wind-up are gone to within 2 %.

        Half as much again as the play, and four times the way on which the wind-up builds up.
        """
        return 1.5 * self.backlash + (4.0 * self.hysteresis_way if self.hysteresis else 0.0)


@dataclass(frozen=True, slots=True)
class LensFaults:
    """What is wrong with the motors of a lens; by default nothing.

    Parameters
    ----------
    zoom, focus, iris
        Faults of each motor.
    """

    zoom: MotorFaults = MotorFaults()
    focus: MotorFaults = MotorFaults()
    iris: MotorFaults = MotorFaults()
