"""What requirements together leave of d/D for an orthogonal, centred view, as in section 1.5.2."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lenscal.errors import PlanningError
from lenscal.sensor import Axis, Sensor
from planning.requirements.margin import BoundsMagnification, Requirement

Stated = Sequence[Requirement | BoundsMagnification]


def bounding(requirements: Stated) -> list[BoundsMagnification]:
    """Pick the requirements that bound d/D.

    Parameters
    ----------
    requirements
        All of them.

    Returns
    -------
    list of BoundsMagnification
        Those, in their order.
    """
    return [r for r in requirements if isinstance(r, BoundsMagnification)]


def required_magnification(
    requirements: Stated, sensor: Sensor, safety: float = 0.0
) -> tuple[float, float]:
    """Combine the bounds that all requirements put on d/D, (9) and (11).

    Parameters
    ----------
    requirements
        All of them.
    sensor
        The sensor.
    safety
        By which share of itself each bound is tightened.

    Returns
    -------
    tuple of float
        Lowest and highest d/D; the lowest is above the highest when they contradict each other.
    """
    bounds = [requirement.magnification_bounds(sensor) for requirement in bounding(requirements)]
    low = max((b[0] for b in bounds), default=0.0)
    high = min((b[1] for b in bounds), default=float("inf"))
    return low * (1 + safety), high * (1 - safety)


def contradiction(
    requirements: Stated, sensor: Sensor, safety: float = 0.0, *, roll_is_free: bool = False
) -> str:
    """Say which two requirements no lens can satisfy together.

    Parameters
    ----------
    requirements
        All of them.
    sensor
        The sensor.
    safety
        By which share of itself each bound is tightened.
    roll_is_free
        Whether the camera may be rolled so that a feature with axis "any" lies as it suits best:
        along the diagonal of the sensor and the finer pitch. Otherwise it may lie as it suits
        least.

    Returns
    -------
    str
        A sentence, empty when there is none.
    """
    named = bounding(requirements)
    if not named:
        return ""
    bounds = [
        _favourable(r, sensor) if roll_is_free else r.magnification_bounds(sensor) for r in named
    ]
    lows, highs = (np.array(column) for column in zip(*bounds, strict=True))
    low, high = lows.max() * (1 + safety), highs.min() * (1 - safety)
    if low <= high:
        return ""
    demanding, limiting = named[int(lows.argmax())], named[int(highs.argmin())]
    kept = f", each kept by {safety:.3g} of itself," if safety else ""
    return (
        f"the requirements contradict each other whatever the lens: {demanding.describe(sensor)} "
        f"and {limiting.describe(sensor)}{kept} leave no d/D between them; ask for at "
        f"least {1 - high / low:.1%} less resolution or see a smaller feature"
    )


def _favourable(requirement: BoundsMagnification, sensor: Sensor) -> tuple[float, float]:
    """Bounds on d/D at the roll that suits best."""
    low, high = requirement.magnification_bounds(sensor)
    if requirement.axis != "any":
        return low, high
    # Along the finer pitch, and along the diagonal instead of the shorter side.
    pitches, sides = sensor.sample_pitch_mm, np.array([sensor.width_mm, sensor.height_mm])
    finer = float(pitches.min() / pitches.max())
    longer = float(np.hypot(*sides) / sides.min())
    return low * finer, high * longer


def image_axis(requirements: Stated) -> Axis:
    """Tell along which image axis the feature has to lie.

    Parameters
    ----------
    requirements
        All of them.

    Returns
    -------
    Axis
        "x", "y", or "any" when none says.

    Raises
    ------
    PlanningError
        When one wants x and another y.
    """
    named: set[Axis] = {r.axis for r in bounding(requirements) if r.axis != "any"}
    if len(named) > 1:
        raise PlanningError(
            "one requirement is along x and another along y, but one feature cannot lie along "
            "both; plan them as two tasks, or use axis 'any'"
        )
    return named.pop() if named else "any"
