"""A cylinder with flat ends as a piece of a camera body: how near it comes, how far it goes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, frozen_array, positive
from lenscal.errors import InputError
from planning.vectors import along

#: A direction that is less off the axis than this runs along it.
_NO_LENGTH: Final = 1e-12


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A closed cylinder, such as a barrel or a ring light.

    Parameters
    ----------
    start_mm, end_mm
        (3,) middles of its end faces in mm, in the frame of the reference camera.
    radius_mm
        Its radius in mm.

    Raises
    ------
    InputError
        When the radius is not positive, or both ends are one.
    """

    start_mm: FloatArray
    end_mm: FloatArray
    radius_mm: float

    def __post_init__(self) -> None:
        for name in ("start_mm", "end_mm"):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), (3,)))
        positive("radius_mm", self.radius_mm, "mm")
        if not np.linalg.norm(self.end_mm - self.start_mm) > 0:
            raise InputError("a cylinder needs a length, but its ends are the same point")

    @cached_property
    def centre_mm(self) -> FloatArray:
        """(3,) its centre."""
        return (self.start_mm + self.end_mm) / 2

    @cached_property
    def axis(self) -> FloatArray:
        """(3,) unit vector along it."""
        lengthwise = self.end_mm - self.start_mm
        unit: FloatArray = lengthwise / np.linalg.norm(lengthwise)
        return unit

    @cached_property
    def frame(self) -> FloatArray:
        """(3, 3) unit vectors as rows: two across it, and its axis."""
        across = np.eye(3)[np.abs(self.axis).argmin()]
        across = across - (across @ self.axis) * self.axis
        across /= np.linalg.norm(across)
        return np.stack([across, np.cross(self.axis, across), self.axis])

    @cached_property
    def half_length_mm(self) -> float:
        """Half its length."""
        return float(np.linalg.norm(self.end_mm - self.start_mm)) / 2

    @cached_property
    def extent_mm(self) -> tuple[float, float, float]:
        """Lowest and highest z, and largest distance from the z axis, of what holds it."""
        rise = self.radius_mm * np.hypot(self.axis[0], self.axis[1])
        ends = np.stack([self.start_mm, self.end_mm])
        # A disk about an end face's middle reaches no farther than its radius.
        away = float(np.linalg.norm(ends[:, :2], axis=1).max()) + self.radius_mm
        return float(ends[:, 2].min() - rise), float(ends[:, 2].max() + rise), away

    def support_mm(self, directions: FloatArray) -> FloatArray:
        """Give how far it reaches in directions.

        Parameters
        ----------
        directions
            (3, K) unit vectors.

        Returns
        -------
        FloatArray
            (K,) the largest u · p over its points p.
        """
        cosine = along(self.axis, directions)
        sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        reach: FloatArray = (
            along(self.centre_mm, directions)
            + self.half_length_mm * np.abs(cosine)
            + self.radius_mm * sine
        )
        return reach

    def farthest_mm(self, directions: FloatArray) -> FloatArray:
        """Give the point that reaches farthest in directions.

        Parameters
        ----------
        directions
            (3, K) unit vectors.

        Returns
        -------
        FloatArray
            (3, K) in mm; one of them where there are several.
        """
        cosine = along(self.axis, directions)
        across = directions - cosine * self.axis[:, None]
        across *= self.radius_mm / np.maximum(np.sqrt(along(across, across)), _NO_LENGTH)
        ahead: FloatArray = self.half_length_mm * np.sign(cosine) * self.axis[:, None]
        return self.centre_mm[:, None] + ahead + across

    def nearest_mm(self, points_mm: FloatArray) -> FloatArray:
        """Give the nearest of its points, which is the point itself inside.

        Parameters
        ----------
        points_mm
            (3, K) in mm.

        Returns
        -------
        FloatArray
            (3, K) in mm.
        """
        lengthwise, across = self._parted(points_mm)
        distance = np.sqrt(along(across, across))
        across *= self.radius_mm / np.maximum(distance, self.radius_mm)
        kept = np.clip(lengthwise, -self.half_length_mm, self.half_length_mm)
        across += self.centre_mm[:, None]
        across += kept * self.axis[:, None]
        return across

    def distance_mm(self, points_mm: FloatArray) -> FloatArray:
        """Measure how far points are from it.

        Parameters
        ----------
        points_mm
            (3, K) in mm.

        Returns
        -------
        FloatArray
            (K,) in mm, zero inside.
        """
        lengthwise, across = self._parted(points_mm)
        beyond = np.maximum(np.abs(lengthwise) - self.half_length_mm, 0.0)
        beside = np.maximum(np.sqrt(along(across, across)) - self.radius_mm, 0.0)
        return np.asarray(np.sqrt(beyond**2 + beside**2))

    def directions_towards(self, corners_mm: FloatArray) -> list[FloatArray]:
        """Suggest directions in which it may be parted from faces: along it and across it.

        What has the same direction as one of them, or the opposite one, is covered.

        Parameters
        ----------
        corners_mm
            (C, 3, K) corners of convex faces in mm.

        Returns
        -------
        list of FloatArray
            (3, K) unit vectors each.
        """
        axis = np.broadcast_to(self.axis[:, None], corners_mm.shape[1:])
        towards, least = axis, np.full(axis.shape[1], np.inf)
        for _, across in self._feet(corners_mm):
            squared = along(across, across)
            towards = np.where((squared < least) & (squared > 0), across, towards)
            np.minimum(least, squared, out=least)
        return [axis, towards / np.sqrt(along(towards, towards))]

    def points_near(self, corners_mm: FloatArray) -> list[FloatArray]:
        """Suggest points of faces that may be the nearest: of each edge, that nearest to the axis.

        Parameters
        ----------
        corners_mm
            (C, 3, K) corners of convex faces in mm.

        Returns
        -------
        list of FloatArray
            (3, K) points each.
        """
        following = np.roll(corners_mm, -1, axis=0)
        return [
            start + share * (stop - start)
            for (share, _), start, stop in zip(
                self._feet(corners_mm), corners_mm, following, strict=True
            )
        ]

    def _parted(self, points_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(K,) how far along the axis points lie from the centre, and (3, K) what is across it."""
        away = points_mm - self.centre_mm[:, None]
        lengthwise = along(self.axis, away)
        away -= lengthwise * self.axis[:, None]
        return lengthwise, away

    def _feet(self, corners_mm: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Where on each edge, as a share, it is nearest to the axis, and (3, K) how far across."""
        across = [self._parted(corner)[1] for corner in corners_mm]
        for start, stop in zip(across, [*across[1:], across[0]], strict=True):
            edge = stop - start
            squared = along(edge, edge)
            share = np.clip(-along(start, edge) / np.where(squared > 0, squared, 1.0), 0.0, 1.0)
            yield share, start + share * edge
