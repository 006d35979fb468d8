"""Gaussian optics by ray-transfer matrices: thin groups, gaps and a stop, in air.

A ray is (height, slope). Positions run along the axis from the object side to the sensor; distances
in front of a lens are counted away from it. Source: any textbook, such as Gerrard and Burch,
Introduction to Matrix Methods in Optics (1975).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import InputError


@dataclass(frozen=True, slots=True)
class ThinGroup:
    """A group of lenses taken as one thin lens.

    Parameters
    ----------
    focal_length_mm
        Positive when it collects light.
    position_mm
        Where it stands on the axis.
    """

    focal_length_mm: float
    position_mm: float


@dataclass(frozen=True, slots=True)
class OpticalSystem:
    """Thin groups in line, a stop among them, and a sensor behind them.

    Parameters
    ----------
    groups
        From the object side to the sensor, at rising positions.
    stop_position_mm
        Where the stop stands.
    sensor_position_mm
        Where the sensor stands, behind the last group.

    Raises
    ------
    InputError
        When there is no group, or positions do not rise up to the sensor, or the stop stands behind
        the sensor.
    """

    groups: tuple[ThinGroup, ...]
    stop_position_mm: float
    sensor_position_mm: float

    def __post_init__(self) -> None:
        positions = [*(group.position_mm for group in self.groups), self.sensor_position_mm]
        if not self.groups or not np.all(np.diff(positions) > 0):
            raise InputError(
                "the groups of a lens must stand one behind the other, and the sensor behind them; "
                f"given are positions {positions} mm, the sensor last"
            )
        if not self.stop_position_mm < self.sensor_position_mm:
            raise InputError(
                f"the stop at {self.stop_position_mm:g} mm must stand in front of the sensor at "
                f"{self.sensor_position_mm:g} mm"
            )

    @property
    def front_mm(self) -> float:
        """Position of the first group: the front of the lens."""
        return self.groups[0].position_mm

    @property
    def matrix(self) -> FloatArray:
        """(2, 2) transfer from just before the first group to just behind the last one."""
        return _transfer(self.groups, self.front_mm, self.groups[-1].position_mm)

    @property
    def gaussian_focal_length_mm(self) -> float:
        """Gaussian focal length; negative when the image of a distant object stands upright."""
        return float(-1.0 / self.matrix[1, 0])

    @property
    def front_principal_mm(self) -> float:
        """Position of the front principal plane, in air also of the front nodal point."""
        (_, _), (c, d) = self.matrix
        return float(self.front_mm + (d - 1.0) / c)

    @property
    def rear_principal_mm(self) -> float:
        """Position of the rear principal plane, in air also of the rear nodal point."""
        (a, _), (c, _) = self.matrix
        return float(self.groups[-1].position_mm + (1.0 - a) / c)

    @property
    def working_distance_mm(self) -> float:
        """Distance from the first group out to the plane that is sharp on the sensor."""
        (a, b), _ = self._to_sensor
        return float(-b / a)

    @property
    def lateral_magnification(self) -> float:
        """Image size over object size in the sharp plane; negative when the image is inverted."""
        return float(self._to_sensor[0, 0])

    @property
    def principal_object_distance_mm(self) -> float:
        """Distance from the sharp plane to the front principal plane."""
        return self.working_distance_mm + self.front_principal_mm - self.front_mm

    @property
    def principal_image_distance_mm(self) -> float:
        """Distance from the rear principal plane to the sensor."""
        return self.sensor_position_mm - self.rear_principal_mm

    @property
    def entrance_pupil_mm(self) -> float:
        """Position of the entrance pupil, infinite for a lens telecentric towards the object."""
        (a, b), _ = self._to_stop
        return self.front_mm + _ratio(b, a)

    @property
    def entrance_pupil_magnification(self) -> float:
        """Diameter of the entrance pupil over that of the stop."""
        return abs(_ratio(1.0, self._to_stop[0, 0]))

    @property
    def exit_pupil_mm(self) -> float:
        """Position of the exit pupil, infinite for a lens telecentric towards the sensor."""
        (_, b), (_, d) = self._from_stop
        return self.groups[-1].position_mm - _ratio(b, d)

    @property
    def exit_pupil_magnification(self) -> float:
        """Diameter of the exit pupil over that of the stop."""
        return abs(_ratio(1.0, self._from_stop[1, 1]))

    @property
    def exit_pupil_distance_mm(self) -> float:
        """Distance from the exit pupil to the sensor."""
        return self.sensor_position_mm - self.exit_pupil_mm

    @property
    def object_distance_mm(self) -> float:
        """Perspective D: distance from the sharp plane to the entrance pupil."""
        return self.working_distance_mm + self.entrance_pupil_mm - self.front_mm

    @property
    def _to_sensor(self) -> FloatArray:
        return _transfer(self.groups, self.front_mm, self.sensor_position_mm)

    @property
    def _to_stop(self) -> FloatArray:
        before = [g for g in self.groups if g.position_mm <= self.stop_position_mm]
        return _transfer(before, self.front_mm, self.stop_position_mm)

    @property
    def _from_stop(self) -> FloatArray:
        behind = [g for g in self.groups if g.position_mm > self.stop_position_mm]
        end = max(self.groups[-1].position_mm, self.stop_position_mm)
        transfer = _transfer(behind, self.stop_position_mm, end)
        return _gap(self.groups[-1].position_mm - end) @ transfer


def _transfer(groups: Sequence[ThinGroup], start_mm: float, end_mm: float) -> FloatArray:
    """Follow a ray through groups from one position to another."""
    matrix, here_mm = np.eye(2), start_mm
    for group in groups:
        matrix = _lens(group.focal_length_mm) @ _gap(group.position_mm - here_mm) @ matrix
        here_mm = group.position_mm
    return _gap(end_mm - here_mm) @ matrix


def _lens(focal_length_mm: float) -> FloatArray:
    return np.array([[1.0, 0.0], [-1.0 / focal_length_mm, 1.0]])


def _gap(length_mm: float) -> FloatArray:
    return np.array([[1.0, length_mm], [0.0, 1.0]])


def _ratio(numerator: float, denominator: float) -> float:
    """Divide; what a telecentric lens has at infinity is infinite."""
    return float(numerator / denominator) if denominator else math.inf
