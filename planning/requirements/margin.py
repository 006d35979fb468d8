"""What every requirement says about a viewpoint, and what every requirement can be asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.errors import PlanningError
from lenscal.pose import Pose
from lenscal.sensor import Axis, Sensor


@dataclass(frozen=True, slots=True, eq=False)
class Margin:
    """By how much a requirement is satisfied.

    Parameters
    ----------
    value
        (...) positive: satisfied, zero: just so, negative: not.
    unit
        Unit of the value; "1" for a share of the limit.
    binds
        What binds, in words.
    """

    value: FloatArray
    unit: str
    binds: str


@runtime_checkable
class Requirement(Protocol):
    """A requirement on the image of a feature."""

    @property
    def name(self) -> str:
        """Short name, as in the columns of a plan."""

    @property
    def axis(self) -> Axis:
        """Image axis along which the feature lies, or "any"."""

    def magnification_bounds(self, sensor: Sensor) -> tuple[float, float]:
        """Give the lowest and highest d/D at which an orthogonal, centred view satisfies it.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        tuple of float
            Bounds on d/D; 0 and infinity where there is none.
        """

    def margin(self, magnification: npt.ArrayLike, sensor: Sensor) -> Margin:
        """Judge magnifications, for an orthogonal, centred view.

        Parameters
        ----------
        magnification
            (...) d/D.
        sensor
            The sensor.

        Returns
        -------
        Margin
            (...) relative to the limit.
        """

    def image_margin(
        self, camera: Camera, camera_from_part: Pose, feature_mm: FloatArray
    ) -> Margin:
        """Judge one view with the whole camera model: distortion, principal point, any direction.

        Parameters
        ----------
        camera
            The camera.
        camera_from_part
            Its pose.
        feature_mm
            (N, 3) corners of the feature in the part's frame in mm.

        Returns
        -------
        Margin
            One value relative to the limit.
        """

    def describe(self, sensor: Sensor) -> str:
        """Say what is asked and what it means for d/D.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "resolution of 3 px on 0.254 mm along x (d/D ≥ 0.1919)".
        """


def required_magnification(
    requirements: Sequence[Requirement], sensor: Sensor, safety: float = 0.0
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
    bounds = [requirement.magnification_bounds(sensor) for requirement in requirements]
    low = max((b[0] for b in bounds), default=0.0)
    high = min((b[1] for b in bounds), default=float("inf"))
    return low * (1 + safety), high * (1 - safety)


def contradiction(requirements: Sequence[Requirement], sensor: Sensor, safety: float = 0.0) -> str:
    """Say which two requirements no lens can satisfy together.

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
    str
        A sentence, empty when there is none.
    """
    low, high = required_magnification(requirements, sensor, safety)
    if low <= high:
        return ""
    demanding = max(requirements, key=lambda r: r.magnification_bounds(sensor)[0])
    limiting = min(requirements, key=lambda r: r.magnification_bounds(sensor)[1])
    kept = f", each kept by {safety:.3g} of itself," if safety else ""
    return (
        f"the requirements contradict each other whatever the lens: {demanding.describe(sensor)} "
        f"and {limiting.describe(sensor)}{kept} leave no d/D between them; ask for "
        f"{1 - high / low:.1%} less resolution or see a smaller feature"
    )


def image_axis(requirements: Sequence[Requirement]) -> Axis:
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
    named: set[Axis] = {r.axis for r in requirements if r.axis != "any"}
    if len(named) > 1:
        raise PlanningError(
            "one requirement is along x and another along y, but one feature cannot lie along "
            "both; plan them as two tasks, or use axis 'any'"
        )
    return named.pop() if named else "any"
