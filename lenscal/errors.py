"""Every error that lenscal and planning raise on purpose: one tree, in one file.

A message says what was given, what was wanted, what is available, and what to do. Programs read the
attributes, people read the sentence. Commands print it as one line and end with a non-zero status.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


class LensCalError(Exception):
    """Root of all errors of lenscal and planning."""


class InputError(LensCalError, ValueError):
    """An argument cannot be used: wrong shape, not finite, contradictory."""


class UnitError(InputError):
    """A length without a unit, or with one that is not known."""


class OutOfRangeError(InputError):
    """A motor target beyond the travel; nothing was moved.

    Parameters
    ----------
    message
        The sentence for a person.
    given
        The value that was asked for.
    allowed
        Lowest and highest value that may be asked for.
    """

    def __init__(self, message: str, given: float, allowed: tuple[float, float]) -> None:
        super().__init__(message)
        self.given = given
        self.allowed = allowed


class OutOfDomainError(InputError):
    """A map was asked where no sample supports it.

    Parameters
    ----------
    message
        The sentence for a person.
    domain
        The domain of the map.
    mask
        True where the request lies outside; the shape is that of the request.
    """

    def __init__(self, message: str, domain: Any, mask: npt.NDArray[np.bool_]) -> None:
        super().__init__(message)
        self.domain = domain
        self.mask = mask


class FileError(LensCalError):
    """A file is missing, cut short, altered, of another kind, or from a newer version."""


class DetectionError(LensCalError):
    """A target was not found in the images."""


class CalibrationError(LensCalError):
    """The observations do not determine the camera."""


class DegenerateGeometryError(CalibrationError):
    """A named degeneracy: too few points, a plane parallel to the sensor, points on a line."""


class ConvergenceError(LensCalError):
    """An iteration did not settle.

    Parameters
    ----------
    message
        The sentence for a person.
    best
        The best solution reached, in the caller's own parameters.
    residual
        The size of the residual there.
    iterations
        How many iterations were made.
    """

    def __init__(self, message: str, best: Any, residual: float, iterations: int) -> None:
        super().__init__(message)
        self.best = best
        self.residual = residual
        self.iterations = iterations


class FocusError(LensCalError):
    """No sharpest distance: no peak, a peak at the end of travel, too dark, saturated."""


class SessionError(LensCalError):
    """A session cannot start or go on, for instance because its folder holds another one."""


class DeviceError(LensCalError):
    """A camera, lens or positioner refused, failed or does not answer."""


class MapError(LensCalError):
    """The samples do not support the map that is asked for."""


class PlanningError(LensCalError):
    """A task cannot be planned as it is stated."""


class GeometryError(PlanningError):
    """A mesh or polygon cannot be used: open, degenerate, not planar, inside material."""
