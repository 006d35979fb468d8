"""The camera at several lens settings at once, as arrays: what views are judged with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lenscal import optics
from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.camera import Camera
from lenscal.cameras import Cameras
from lenscal.errors import InputError
from lenscal.sensor import Sensor
from planning.nodal import LATERAL
from planning.sensor_points import SensorPoints

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap
    from planning.fixed_lens import FixedLens


@dataclass(frozen=True, eq=False)
class LensStates:
    """S states of a lens and its camera.

    Parameters
    ----------
    cameras
        S cameras with the same sensor: image distance, principal point, distortion.
    object_distance_mm
        (S,) D of the sharp plane in mm.
    projection_centre_mm
        (S, 3) the projection centre in the frame of the reference camera, (x, y, −offset) in mm; it
        lies at negative z where it is further from the object. None where nobody knows it.
    entrance_pupil_diameter_mm
        (S,) a in mm. None where nobody knows it.
    zoom, focus, iris
        (S,) settings in controller units, NaN where there are none; None for a fixed lens.

    Raises
    ------
    InputError
        When there is no camera, their sensors differ, a shape is wrong, or a distance or diameter
        is not positive.
    """

    cameras: Sequence[Camera]
    object_distance_mm: FloatArray
    projection_centre_mm: FloatArray | None = None
    entrance_pupil_diameter_mm: FloatArray | None = None
    zoom: FloatArray | None = None
    focus: FloatArray | None = None
    iris: FloatArray | None = None

    def __post_init__(self) -> None:
        if not len(self.cameras):
            raise InputError("a view needs a lens setting, but there is none; give one or more")
        cameras = Cameras.of(self.cameras)
        object.__setattr__(self, "cameras", cameras)
        count = len(cameras)
        for name in ("object_distance_mm", "entrance_pupil_diameter_mm"):
            value = getattr(self, name)
            if value is None:
                continue
            array = frozen_array(name, value, (count,))
            if (array <= 0).any():
                raise InputError(
                    f"{name} must be positive, but is {array.min():g} mm; check the sign and the "
                    "unit"
                )
            object.__setattr__(self, name, array)
        if self.projection_centre_mm is not None:
            centre = frozen_array("projection_centre_mm", self.projection_centre_mm, (count, 3))
            object.__setattr__(self, "projection_centre_mm", centre)
        for name in ("zoom", "focus", "iris"):
            value = getattr(self, name)
            array = frozen_array(
                name, np.full(count, np.nan) if value is None else value, (count,), finite=False
            )
            object.__setattr__(self, name, array)

    @classmethod
    def of_map(
        cls,
        lens: LensMap,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        iris: npt.ArrayLike | None = None,
    ) -> LensStates:
        """Ask a lens map.

        Parameters
        ----------
        lens
            The map; it must know its sensor.
        zoom, focus
            (S,) settings.
        iris
            (S,) or one iris setting. None: where the map knows one iris, that; where it knows
            several, the entrance pupil is left open.

        Returns
        -------
        LensStates
            With the projection centre where the map knows the nodal offset, its lateral wander
            included where that is mapped, and the entrance pupil where it knows that.

        Raises
        ------
        MapError
            When the map was made without a sensor.
        OutOfDomainError
            When a setting lies outside of the map.
        """
        zooms, focuses = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(s, dtype=np.float64)) for s in (zoom, focus))
        )
        cameras = lens.cameras_at(zooms, focuses)
        centre = None
        if lens.has_standoff:
            offset = lens.nodal_offset_mm(zooms, focuses)
            lateral = (
                [lens.value(name, zooms, focuses) for name in LATERAL]
                if set(LATERAL) <= set(lens.quantities)
                else [np.zeros_like(offset)] * 2
            )
            centre = np.stack([*lateral, -offset], axis=-1)
        irises = None if iris is None else np.broadcast_to(np.asarray(iris, float), zooms.shape)
        pupil = None
        if lens.pupil is not None and (iris is not None or len(lens.pupil.irises) == 1):
            pupil = lens.entrance_pupil_diameter_mm(zooms, focuses, irises)
            irises = np.full(zooms.shape, lens.pupil.irises[0]) if iris is None else irises
        return cls(
            cameras,
            lens.object_distance_mm(zooms, focuses),
            centre,
            pupil,
            zooms,
            focuses,
            irises,
        )

    @classmethod
    def of_fixed(cls, lens: FixedLens, object_distance_mm: npt.ArrayLike) -> LensStates:
        """Focus a fixed lens at several distances.

        Its projection centre is its own reference: the offset is zero.

        Parameters
        ----------
        lens
            The lens.
        object_distance_mm
            (S,) D in mm, beyond the focal length.

        Returns
        -------
        LensStates
            The states.

        Raises
        ------
        InputError
            When a distance is not beyond the focal length.
        """
        distance = np.atleast_1d(np.asarray(object_distance_mm, dtype=np.float64))
        if not (distance > lens.focal_length_mm).all():
            raise InputError(
                f"a lens of f = {lens.focal_length_mm:g} mm images nothing at a distance of "
                f"{distance.min():g} mm; it must be larger than f"
            )
        image_distance = 1.0 / (1.0 / lens.focal_length_mm - 1.0 / distance)
        pupil = lens.entrance_pupil_diameter_mm
        return cls(
            tuple(Camera(lens.sensor, float(d)) for d in image_distance),
            distance,
            np.zeros((len(distance), 3)),
            None if pupil is None else np.full(len(distance), pupil),
        )

    @property
    def settings(self) -> FloatArray:
        """(3, S) zoom, focus and iris, NaN where there are none."""
        return np.array([self.zoom, self.focus, self.iris])

    @property
    def sensor(self) -> Sensor:
        """The sensor of all cameras."""
        return self._stack.sensor

    @cached_property
    def sensor_points(self) -> SensorPoints:
        """The image planes of all cameras."""
        return SensorPoints(self._stack)

    @property
    def image_distance_mm(self) -> FloatArray:
        """(S,) d in mm."""
        return self._stack.image_distance_mm

    @property
    def magnification(self) -> FloatArray:
        """(S,) d/D."""
        return optics.magnification(self.object_distance_mm, self.image_distance_mm)

    @property
    def principal_point_mm(self) -> FloatArray:
        """(S, 2) principal point from the middle of the sensor, in mm."""
        offset = self._stack.principal_point_px - self.sensor.centre_px
        mm: FloatArray = offset * self.sensor.sample_pitch_mm
        return mm

    @property
    def _stack(self) -> Cameras:
        return Cameras.of(self.cameras)

    def with_iris(self, iris: npt.ArrayLike, entrance_pupil_diameter_mm: FloatArray) -> LensStates:
        """Change the iris alone.

        Parameters
        ----------
        iris
            (S,) or one setting.
        entrance_pupil_diameter_mm
            (S,) a there, in mm.

        Returns
        -------
        LensStates
            The same states with another pupil.
        """
        return LensStates(
            self.cameras,
            self.object_distance_mm,
            self.projection_centre_mm,
            entrance_pupil_diameter_mm,
            self.zoom,
            self.focus,
            np.broadcast_to(np.asarray(iris, dtype=np.float64), (len(self),)),
        )

    def some(self, which: slice | IntArray) -> LensStates:
        """Take some of the states.

        Parameters
        ----------
        which
            Which of the S; one may be taken more than once.

        Returns
        -------
        LensStates
            Those.
        """
        arrays = (
            self.projection_centre_mm,
            self.entrance_pupil_diameter_mm,
            self.zoom,
            self.focus,
            self.iris,
        )
        return LensStates(
            self._stack.take(which),
            self.object_distance_mm[which],
            *(None if array is None else array[which] for array in arrays),
        )

    def __len__(self) -> int:
        return len(self.cameras)
