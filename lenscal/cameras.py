"""Many cameras with one sensor, as arrays: what thousands of views are judged with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self, overload

import numpy as np

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class Cameras(Sequence[Camera]):
    """S cameras that differ in all but their sensor.

    Parameters
    ----------
    sensor
        The sensor of all.
    image_distance_mm
        (S,) d in mm.
    principal_point_px
        (S, 2) in px.
    radial
        (S, N) κ1 in mm⁻², κ2 in mm⁻⁴, and so on; one column at least.
    decentring
        (S, 2) p1, p2.

    Raises
    ------
    InputError
        When there is no camera, a shape is wrong, a value is not finite, or d is not positive.
    """

    sensor: Sensor
    image_distance_mm: FloatArray
    principal_point_px: FloatArray
    radial: FloatArray
    decentring: FloatArray

    def __post_init__(self) -> None:
        count = len(self.image_distance_mm)
        if not count:
            raise InputError("there is no camera; give one or more")
        for name, shape in (
            ("image_distance_mm", (count,)),
            ("principal_point_px", (count, 2)),
            ("radial", (count, "N")),
            ("decentring", (count, 2)),
        ):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), shape))
        if (self.image_distance_mm <= 0).any():
            raise InputError(
                f"image_distance_mm must be positive, but is {self.image_distance_mm.min():g} mm; "
                "check the sign and the unit"
            )

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> Cameras:
        """Put cameras together.

        Parameters
        ----------
        cameras
            One or more, with the same sensor.

        Returns
        -------
        Cameras
            The same.

        Raises
        ------
        InputError
            When there is none, or their sensors differ.
        """
        if isinstance(cameras, Cameras):
            return cameras
        if not cameras:
            raise InputError("there is no camera; give one or more")
        sensor = cameras[0].sensor
        others = [camera.sensor for camera in cameras if camera.sensor != sensor]
        if others:
            raise InputError(
                f"the cameras have different sensors, {sensor} and {others[0]}; take one sensor "
                "at a time"
            )
        terms = [(camera.k1_per_mm2, *camera.radial) for camera in cameras]
        count = max(map(len, terms))
        return cls(
            sensor,
            np.array([camera.image_distance_mm for camera in cameras]),
            np.stack([camera.centre_px for camera in cameras]),
            np.array([term + (0.0,) * (count - len(term)) for term in terms]),
            np.array([camera.decentring for camera in cameras]),
        )

    def take(self, which: slice | IntArray) -> Self:
        """Take some of them.

        Parameters
        ----------
        which
            Which of the S; one may be taken more than once.

        Returns
        -------
        Cameras
            Those.
        """
        return type(self)(
            self.sensor,
            self.image_distance_mm[which],
            self.principal_point_px[which],
            self.radial[which],
            self.decentring[which],
        )

    @overload
    def __getitem__(self, index: int) -> Camera: ...

    @overload
    def __getitem__(self, index: slice) -> Self: ...

    def __getitem__(self, index: int | slice) -> Camera | Self:
        if isinstance(index, slice):
            return self.take(index)
        k1, *more = self.radial[index]
        used = len(more) - int(np.argmax([*(c != 0 for c in more[::-1]), True]))
        return Camera(
            self.sensor,
            float(self.image_distance_mm[index]),
            float(k1),
            self.principal_point_px[index],
            tuple(float(c) for c in more[:used]),
            (float(self.decentring[index, 0]), float(self.decentring[index, 1])),
        )

    def __iter__(self) -> Iterator[Camera]:
        return (self[k] for k in range(len(self)))

    def __len__(self) -> int:
        return len(self.image_distance_mm)
