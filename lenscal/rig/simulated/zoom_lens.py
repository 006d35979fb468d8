"""A zoom lens as groups on cams, and the truth about every setting of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, frozen_array
from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.optics import focal_length_mm
from lenscal.rig.simulated.optics import OpticalSystem, ThinGroup
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting, LensTravel

#: A position in mm as a function of zoom and focus, which may be arrays.
Cam = Callable[[FloatArray, FloatArray], FloatArray]

#: Settings per axis at which a description is searched for collisions.
_CHECKS: Final = (263, 29)


@dataclass(frozen=True, slots=True)
class MovingGroup:
    """A lens group that rides on a cam.

    Parameters
    ----------
    name
        What the optician calls it.
    focal_length_mm
        Of the group.
    cam
        Its position on the axis in mm, from zoom and focus.
    """

    name: str
    focal_length_mm: float
    cam: Cam


@dataclass(frozen=True, slots=True)
class ZoomLens:
    """The description of a programmable zoom lens on a camera.

    Parameters
    ----------
    name
        Maker and model.
    travel
        How far its motors go.
    groups
        From the object side to the sensor; a close-up lens is a first group that stands still.
    stop_group
        Name of the group whose cell carries the stop.
    stop_behind_mm
        How far behind that group the stop stands.
    stop_diameter_mm
        Diameter of the stop per unit of the iris setting.
    sensor_position_mm
        Position of the sensor.
    clearance_mm
        Gap that neighbouring groups must keep.
    sensor
        The sensor behind the lens.
    reference_setting
        The setting that nodal offsets are counted from.
    k1_per_mm2
        κ1 of the distortion as a function of the shares of the travel of zoom and focus, 0 to 1.
    principal_point_shift_px
        (2,) way of the principal point from the centre of the frame, of the same shares.

    Raises
    ------
    InputError
        When groups collide or a cam has no solution somewhere in the travel.
    """

    name: str
    travel: LensTravel
    groups: tuple[MovingGroup, ...]
    stop_group: str
    stop_behind_mm: float
    stop_diameter_mm: float
    sensor_position_mm: float
    clearance_mm: float
    sensor: Sensor
    reference_setting: LensSetting
    k1_per_mm2: Callable[[float, float], float]
    principal_point_shift_px: Callable[[float, float], FloatArray]

    def __post_init__(self) -> None:
        if self.stop_group not in [group.name for group in self.groups]:
            raise InputError(
                f"the stop rides on {self.stop_group!r}, which is none of the groups "
                f"{', '.join(group.name for group in self.groups)}"
            )
        self._refuse_collisions()

    def system(self, setting: LensSetting) -> OpticalSystem:
        """Put every group where the cams put it.

        Parameters
        ----------
        setting
            A setting within the travel.

        Returns
        -------
        OpticalSystem
            The lens as it stands then.

        Raises
        ------
        OutOfRangeError
            When the setting lies beyond the travel.
        """
        self.travel.check(setting)
        zoom, focus = np.float64(setting.zoom), np.float64(setting.focus)
        groups = {
            g.name: ThinGroup(g.focal_length_mm, float(g.cam(np.asarray(zoom), np.asarray(focus))))
            for g in self.groups
        }
        stop_mm = groups[self.stop_group].position_mm + self.stop_behind_mm
        return OpticalSystem(tuple(groups.values()), stop_mm, self.sensor_position_mm)

    def truth(self, setting: LensSetting) -> LensTruth:
        """Compute everything about a setting.

        Parameters
        ----------
        setting
            A setting within the travel, with its iris.

        Returns
        -------
        LensTruth
            The truth.

        Raises
        ------
        InputError
            When the iris is not stated.
        OutOfRangeError
            When the setting lies beyond the travel.
        """
        if setting.iris is None:
            raise InputError(f"the truth about {setting} needs the iris too; use with_iris")
        system = self.system(setting)
        magnification = abs(system.lateral_magnification)
        object_mm = system.object_distance_mm
        image_mm = object_mm * magnification
        offset_mm = system.entrance_pupil_mm - self.system(self.reference_setting).entrance_pupil_mm
        shares = (
            _share(setting.zoom, self.travel.zoom),
            _share(setting.focus, self.travel.focus),
        )
        principal_point = self.sensor.centre_px + self.principal_point_shift_px(*shares)
        stop_mm = self.stop_diameter_mm * setting.iris
        return LensTruth(
            setting=setting,
            magnification=magnification,
            object_distance_mm=object_mm,
            image_distance_mm=image_mm,
            focal_length_mm=float(focal_length_mm(object_mm, image_mm)),
            nodal_offset_mm=offset_mm,
            standoff_mm=object_mm - offset_mm,
            working_distance_mm=system.working_distance_mm,
            gaussian_focal_length_mm=system.gaussian_focal_length_mm,
            principal_object_distance_mm=system.principal_object_distance_mm,
            entrance_pupil_diameter_mm=stop_mm * system.entrance_pupil_magnification,
            principal_point_px=frozen_array("principal_point_px", principal_point, (2,)),
            camera=Camera(self.sensor, image_mm, self.k1_per_mm2(*shares), principal_point),
        )

    def _refuse_collisions(self) -> None:
        zoom, focus = np.meshgrid(
            np.linspace(*self.travel.zoom, _CHECKS[0]), np.linspace(*self.travel.focus, _CHECKS[1])
        )
        ends = [np.full(zoom.shape, self.sensor_position_mm)]
        with np.errstate(invalid="ignore"):
            places = [np.broadcast_to(g.cam(zoom, focus), zoom.shape) for g in self.groups] + ends
        names = [group.name for group in self.groups] + ["sensor"]
        for i, name in enumerate(names[:-1]):
            # A cam without a solution gives NaN, which is no gap either.
            gap = np.nan_to_num(places[i + 1] - places[i], nan=-np.inf)
            worst = np.unravel_index(np.argmin(gap), gap.shape)
            if gap[worst] < self.clearance_mm:
                raise InputError(
                    f"{self.name}: {name} and {names[i + 1]} collide at zoom {zoom[worst]:g}, "
                    f"focus {focus[worst]:g}: their gap is {gap[worst]:.2f} mm and must be "
                    f"{self.clearance_mm:g} mm; shorten the travel or change the cams"
                )


@dataclass(frozen=True, slots=True, eq=False)
class LensTruth:
    """What is true of a lens at one setting; only a simulation knows it.

    Parameters
    ----------
    setting
        The setting, iris included.
    magnification
        d/D, in the sharp plane.
    object_distance_mm
        D, from the sharp plane to the entrance pupil.
    image_distance_mm
        d = D · (d/D), the camera constant.
    focal_length_mm
        f of (3a), 1/f = 1/D + 1/d; not the Gaussian one.
    nodal_offset_mm
        How far the entrance pupil lies behind that of the reference setting; positive = further
        from the object.
    standoff_mm
        D − offset, from the sharp plane to the reference projection centre.
    working_distance_mm
        From the sharp plane to the front of the lens.
    gaussian_focal_length_mm
        Between principal planes, with its sign.
    principal_object_distance_mm
        From the sharp plane to the front principal plane.
    entrance_pupil_diameter_mm
        a at this iris.
    principal_point_px
        (2,) where the axis meets the image.
    camera
        The pinhole with distortion that maps rays through the entrance pupil to pixels.
    """

    setting: LensSetting
    magnification: float
    object_distance_mm: float
    image_distance_mm: float
    focal_length_mm: float
    nodal_offset_mm: float
    standoff_mm: float
    working_distance_mm: float
    gaussian_focal_length_mm: float
    principal_object_distance_mm: float
    entrance_pupil_diameter_mm: float
    principal_point_px: FloatArray
    camera: Camera

    @property
    def f_number(self) -> float:
        """Working f-number d/a."""
        return self.image_distance_mm / self.entrance_pupil_diameter_mm

    @property
    def front_depth_mm(self) -> float:
        """Depth of the front of the lens in the camera frame: nearer than that nothing can be."""
        return self.object_distance_mm - self.working_distance_mm


def _share(value: float, travel: tuple[float, float]) -> float:
    low, high = travel
    return (value - low) / (high - low)
