"""What a lens controller is told: zoom, focus and iris, and how far each of them can go."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from lenscal.errors import InputError, OutOfRangeError


@dataclass(frozen=True, slots=True, order=True)
class LensSetting:
    """One setting of a programmable lens, in the units of its controller.

    Parameters
    ----------
    zoom
        Zoom setting z_s.
    focus
        Focus setting f_s.
    iris
        Iris setting, or None where it does not matter.

    Raises
    ------
    InputError
        When a value is not finite.
    """

    zoom: float
    focus: float
    iris: float | None = None

    def __post_init__(self) -> None:
        for name in ("zoom", "focus", "iris"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise InputError(f"{name} must be a finite controller value, but is {value}")

    def with_iris(self, iris: float | None) -> LensSetting:
        """Change the iris alone.

        Parameters
        ----------
        iris
            The new iris setting.

        Returns
        -------
        LensSetting
            The same zoom and focus at that iris.
        """
        return LensSetting(self.zoom, self.focus, iris)

    def __str__(self) -> str:
        iris = "" if self.iris is None else f", iris {self.iris:g}"
        return f"zoom {self.zoom:g}, focus {self.focus:g}{iris}"


class ApproachSide(enum.StrEnum):
    """The side from which a motor reaches its target; backlash makes the two sides differ."""

    FROM_BELOW = "from_below"
    FROM_ABOVE = "from_above"


@dataclass(frozen=True, slots=True)
class LensTravel:
    """How far the motors of a lens can go, ends included, in controller units.

    Parameters
    ----------
    zoom, focus, iris
        Lowest and highest setting.

    Raises
    ------
    InputError
        When a range is empty or not finite.
    """

    zoom: tuple[float, float]
    focus: tuple[float, float]
    iris: tuple[float, float]

    def __post_init__(self) -> None:
        for name in ("zoom", "focus", "iris"):
            low, high = getattr(self, name)
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise InputError(
                    f"the travel of {name} must run from low to high, but is {low} to {high}"
                )

    def check(self, setting: LensSetting) -> None:
        """Refuse a setting beyond the travel; nothing is ever clipped.

        Parameters
        ----------
        setting
            The setting that is asked for.

        Raises
        ------
        OutOfRangeError
            When zoom, focus or iris lies beyond its ends.
        """
        for name in ("zoom", "focus", "iris"):
            value, (low, high) = getattr(setting, name), getattr(self, name)
            if value is not None and not low <= value <= high:
                raise OutOfRangeError(
                    f"{name} {value:g} lies outside the travel {low:g} to {high:g} of this lens; "
                    "nothing was moved",
                    value,
                    (low, high),
                )
