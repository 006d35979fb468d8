"""What every requirement says about views, and what every requirement can be asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.sensor import Axis, Sensor
from planning.fixed_lens import FixedLens
from planning.half_spaces import HalfSpaces
from planning.lens_states import LensStates
from planning.views import Subject, Views


@dataclass(frozen=True, slots=True, eq=False)
class Margin:
    """By how much a requirement is satisfied.

    Parameters
    ----------
    value
        (V, S) positive: satisfied, zero: just so, negative: not; −inf where the view cannot be had
        at all, because the feature is not in front of the camera.
    unit
        Unit of the value.
    share
        (V, S) the same as a share of what is asked, with the same sign: what margins of different
        requirements are compared by.
    binds
        What binds, in words.
    """

    value: FloatArray
    unit: str
    share: FloatArray
    binds: str

    @property
    def holds(self) -> npt.NDArray[np.bool_]:
        """(V, S) whether the requirement is satisfied, the limit included."""
        return np.asarray(self.value >= 0)


@runtime_checkable
class Requirement(Protocol):
    """Anything that a view must satisfy."""

    @property
    def name(self) -> str:
        """Short name, as in the columns of a plan."""

    def margin(self, views: Views) -> Margin:
        """Judge views with the whole camera model: distortion, principal point, any direction.

        Parameters
        ----------
        views
            V × S views.

        Returns
        -------
        Margin
            (V, S).
        """

    def describe(self, sensor: Sensor) -> str:
        """Say what is asked, and what it means for d/D where it does.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "resolution of 3 px on 0.254 mm along x (d/D ≥ 0.1919)".
        """


@runtime_checkable
class BoundsMagnification(Protocol):
    """A requirement that bounds d/D of an orthogonal, centred view, as (9) and (11) do."""

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

    def orthogonal_margin(self, magnification: npt.ArrayLike, sensor: Sensor) -> Margin:
        """Judge magnifications, for an orthogonal, centred view without distortion.

        Parameters
        ----------
        magnification
            (...) d/D.
        sensor
            The sensor.

        Returns
        -------
        Margin
            (...), a share of the limit.
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


@runtime_checkable
class BoundsObjectDistance(Protocol):
    """A requirement that bounds D of a fixed lens in an orthogonal, centred view by itself."""

    def object_distance_bounds_mm(self, lens: FixedLens) -> tuple[float, float]:
        """Give the nearest and farthest D at which an orthogonal, centred view satisfies it.

        Parameters
        ----------
        lens
            The lens.

        Returns
        -------
        tuple of float
            In mm; the focal length and infinity where there is none.
        """

    def describe(self, sensor: Sensor) -> str:
        """Say what is asked.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            A few words.
        """


@runtime_checkable
class Polyhedral(Protocol):
    """A requirement that, for fixed directions of the camera, is half-spaces of positions."""

    def half_spaces(self, rotation: FloatArray, states: LensStates, subject: Subject) -> HalfSpaces:
        """Give the half-spaces that the projection centre must lie in.

        Parameters
        ----------
        rotation
            (3, 3) of part_from_camera.
        states
            One lens state.
        subject
            What is looked at.

        Returns
        -------
        HalfSpaces
            Whatever lies in all of them satisfies the requirement.
        """


def margin_over(
    views: Views, value: FloatArray, unit: str, share: FloatArray, binds: str
) -> Margin:
    """Bring what was computed with viewpoints innermost into a margin.

    Parameters
    ----------
    views
        The views.
    value, share
        (S or 1, V); NaN becomes −inf.
    unit
        Unit of the value.
    binds
        What binds, in words.

    Returns
    -------
    Margin
        (V, S), read-only.
    """
    viewpoints, states = views.shape
    arrays = []
    for array in (value, share):
        if np.isnan(array).any():
            array = np.where(np.isnan(array), -np.inf, array)
        arrays.append(np.broadcast_to(array, (states, viewpoints)).T)
    return Margin(arrays[0], unit, arrays[1], binds)
