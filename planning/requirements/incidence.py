"""Incidence: the feature is not seen too much from the side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.half_spaces import HalfSpaces
from planning.lens_states import LensStates
from planning.requirements.margin import Margin, margin_over
from planning.views import Subject, Views

#: Sides of the pyramid that stands for the cone: inside of it to 0.5 % of its angle.
_SIDES: Final = 32


@dataclass(frozen=True, slots=True)
class Incidence:
    """No line of sight to the feature leaves the normal of the target by more than an angle.

    The line of sight is that from a point of the feature to the projection centre; the worst point
    of a flat outline is a corner.

    Parameters
    ----------
    max_angle_deg
        The largest angle in degrees; 90 only keeps the camera in front of the face.

    Raises
    ------
    InputError
        When the angle is not above 0 and at most 90 degrees.
    """

    max_angle_deg: float

    def __post_init__(self) -> None:
        if not 0 < self.max_angle_deg <= 90:
            raise InputError(
                f"max_angle_deg must be above 0 and at most 90 degrees, but is {self.max_angle_deg}"
            )

    @property
    def name(self) -> str:
        """``incidence``."""
        return "incidence"

    def margin(self, views: Views) -> Margin:
        """Judge views.

        Parameters
        ----------
        views
            V × S views.

        Returns
        -------
        Margin
            (V, S) radians between the worst line of sight and the limit.

        Raises
        ------
        PlanningError
            When the target is a segment, which has no normal.
        """
        normal = _normal(views.subject)
        corners = views.subject.seen_feature.vertices_mm
        positions = views.positions_mm.transpose(1, 2, 0)
        height = np.einsum("pcv,c->pv", positions, normal)
        worst = np.zeros_like(height)
        for corner in corners:
            away = positions - corner[:, None]
            across = np.cross(away, normal, axisa=1, axisc=1)
            # The tangent keeps its digits where the cosine is near one.
            angle = np.arctan2(np.linalg.norm(across, axis=1), height - corner @ normal)
            np.maximum(worst, angle, out=worst)
        limit = np.radians(self.max_angle_deg)
        spare = limit - worst
        return margin_over(views, spare, "rad", spare / limit, self.describe(views.states.sensor))

    def half_spaces(self, rotation: FloatArray, states: LensStates, subject: Subject) -> HalfSpaces:  # noqa: ARG002
        """Bound the positions by pyramids inside the cones; the direction of the camera is free.

        Parameters
        ----------
        rotation
            (3, 3) of part_from_camera; it does not matter.
        states
            The lens state; it does not matter.
        subject
            What is looked at.

        Returns
        -------
        HalfSpaces
            32 for each corner of the feature; for 90 degrees one in all.

        Raises
        ------
        PlanningError
            When the target is a segment, which has no normal.
        """
        normal = _normal(subject)
        corners = subject.seen_feature.vertices_mm
        if self.max_angle_deg == 90:
            return HalfSpaces(normal[None], np.array([(corners @ normal).max()]))
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        first /= np.linalg.norm(first)
        around = 2 * np.pi * np.arange(_SIDES)[:, None] / _SIDES
        outward = np.cos(around) * first + np.sin(around) * np.cross(normal, first)
        slope = np.arctan(np.tan(np.radians(self.max_angle_deg)) * np.cos(np.pi / _SIDES))
        sides = np.sin(slope) * normal - np.cos(slope) * outward
        # Of parallel sides the one farthest in counts.
        return HalfSpaces(sides, (sides @ corners.T).max(axis=1))

    def describe(self, sensor: Sensor) -> str:  # noqa: ARG002
        """Say what is asked.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "incidence of at most 30°".
        """
        return f"incidence of at most {self.max_angle_deg:g}°"


def _normal(subject: Subject) -> FloatArray:
    if subject.target.is_segment:
        raise PlanningError(
            "incidence is measured from the normal of the target, but the target is a segment and "
            "has none; give the face that it lies on as the target"
        )
    return subject.target.normal
