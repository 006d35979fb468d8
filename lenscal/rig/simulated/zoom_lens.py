"""A zoom lens as groups on cams, and the truth about every setting of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, frozen_array
from lenscal.camera import Camera
from lenscal.errors import InputError, OutOfRangeError
from lenscal.optics import focal_length_mm
from lenscal.rig.simulated.body import LensBody
from lenscal.rig.simulated.focus_strip import interval_between
from lenscal.rig.simulated.laws import Imperfections
from lenscal.rig.simulated.lens_truth import LensTruth
from lenscal.rig.simulated.optics import OpticalSystem, ThinGroup
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting, LensTravel

#: A position in mm as a function of zoom and focus, which may be arrays.
Cam = Callable[[FloatArray, FloatArray], FloatArray]

#: Settings per axis at which a description is searched for collisions.
_CHECKS: Final = (263, 29)
#: Sharp planes farther than this are no use on a bench; nor are those beyond infinity.
FARTHEST_MM: Final = 20_000.0


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


def standing_still(position_mm: float) -> Cam:
    """Make the cam of a group that neither zoom nor focus moves.

    Parameters
    ----------
    position_mm
        Where it stands.

    Returns
    -------
    Cam
        The cam.
    """
    return lambda zoom, focus: np.asarray(position_mm)  # noqa: ARG005


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
        How far behind that group the stop stands; negative in front of it.
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
    imperfections
        What it does beyond Gaussian optics.
    body
        What it looks like from outside.
    focus_shift_dioptres
        Spherical aberration as a photographer meets it: how much larger 1/D is, in 1/m, with a
        closed iris than with an open one, in proportion to the way of the iris from its high end.
        The projection stays, only the sharp plane moves.

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
    imperfections: Imperfections
    body: LensBody
    focus_shift_dioptres: float = 0.0

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

    def nodal_offset_mm(self, setting: LensSetting) -> float:
        """Tell how far the projection centre lies behind that of the reference setting.

        Parameters
        ----------
        setting
            A setting within the travel, whether it can be focused there or not.

        Returns
        -------
        float
            Way of the entrance pupil; positive = further from the object.

        Raises
        ------
        OutOfRangeError
            When the setting lies beyond the travel.
        """
        reference = self.system(self.reference_setting)
        return self.system(setting).entrance_pupil_mm - reference.entrance_pupil_mm

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
            When the setting lies beyond the travel, or nothing between the front glass and
            `FARTHEST_MM` is sharp there; ``allowed`` are the focus settings of this zoom then.
        """
        if setting.iris is None:
            raise InputError(f"the truth about {setting} needs the iris too; use with_iris")
        system = self.system(setting)
        object_mm = 1.0 / self._vergence_per_mm(system, setting.iris)
        front_depth_mm = system.entrance_pupil_mm - system.front_mm
        if not max(0.0, front_depth_mm) < object_mm <= FARTHEST_MM * (1.0 + 1e-9):
            raise self._nothing_sharp(setting, object_mm)
        image_mm = abs(system.object_distance_mm * system.lateral_magnification)
        offset_mm = self.nodal_offset_mm(setting)
        u, w = (
            _share(setting.zoom, self.travel.zoom),
            _share(setting.focus, self.travel.focus),
        )
        law = self.imperfections
        principal_point = self.sensor.centre_px + law.principal_point_shift_px(u, w)
        stop_mm = self.stop_diameter_mm * setting.iris
        return LensTruth(
            setting=setting,
            magnification=image_mm / object_mm,
            object_distance_mm=object_mm,
            image_distance_mm=image_mm,
            focal_length_mm=float(focal_length_mm(object_mm, image_mm)),
            nodal_offset_mm=offset_mm,
            standoff_mm=object_mm - offset_mm,
            working_distance_mm=object_mm - front_depth_mm,
            gaussian_focal_length_mm=system.gaussian_focal_length_mm,
            principal_object_distance_mm=(
                object_mm + system.front_principal_mm - system.entrance_pupil_mm
            ),
            entrance_pupil_diameter_mm=stop_mm * system.entrance_pupil_magnification,
            exit_pupil_diameter_mm=stop_mm * system.exit_pupil_magnification,
            exit_pupil_distance_mm=system.exit_pupil_distance_mm,
            falloff=law.falloff(u, w, _share(setting.iris, self.travel.iris), self.sensor),
            principal_point_px=frozen_array("principal_point_px", principal_point, (2,)),
            camera=Camera(self.sensor, image_mm, law.k1_per_mm2(u, w), principal_point),
        )

    def focus_range(
        self,
        zoom: float,
        nearest_mm: float = 1.0,
        farthest_mm: float = FARTHEST_MM,
        *,
        iris: float | None = None,
    ) -> tuple[float, float]:
        """Tell which focus settings give object distances within limits at a zoom.

        Parameters
        ----------
        zoom
            Within the travel.
        nearest_mm, farthest_mm
            Limits of D; nothing nearer than the front glass counts.
        iris
            Matters only with a focus shift; None for open.

        Returns
        -------
        low, high : float
            Focus settings, ends included.

        Raises
        ------
        InputError
            When there is no such focus setting, or the limits are not in order.
        OutOfRangeError
            When the zoom lies beyond the travel.
        """
        if not 0 < nearest_mm < farthest_mm:
            raise InputError(
                "object distances must run from a positive nearest_mm to a larger farthest_mm, "
                f"but are {nearest_mm:g} to {farthest_mm:g} mm"
            )
        opening = self.travel.iris[1] if iris is None else iris

        def system(focus: float) -> OpticalSystem:
            return self.system(LensSetting(zoom, focus, opening))

        def nearest_vergence(focus: float) -> float:
            here = system(focus)
            return 1.0 / max(nearest_mm, here.entrance_pupil_mm - here.front_mm)

        found = interval_between(
            lambda focus: self._vergence_per_mm(system(focus), opening),
            lambda _: 1.0 / farthest_mm,
            nearest_vergence,
            self.travel.focus,
        )
        if found is None:
            raise InputError(
                f"at zoom {zoom:g} no focus between {self.travel.focus[0]:g} and "
                f"{self.travel.focus[1]:g} gives an object distance of {nearest_mm:g} to "
                f"{farthest_mm:g} mm before the front glass; take another zoom or wider limits"
            )
        return found

    def _vergence_per_mm(self, system: OpticalSystem, iris: float) -> float:
        """Give 1/D with the focus shift; negative when the sharp plane lies beyond infinity."""
        closed = 1.0 - iris / self.travel.iris[1]
        return 1.0 / system.object_distance_mm + 1e-3 * self.focus_shift_dioptres * closed

    def _nothing_sharp(self, setting: LensSetting, object_mm: float) -> OutOfRangeError:
        """Say why there is no truth, and which focus has one."""
        low, high = self.focus_range(setting.zoom, iris=setting.iris)
        where = "beyond infinity" if object_mm < 0 else f"at {object_mm:.0f} mm"
        return OutOfRangeError(
            f"focus {setting.focus:g} at zoom {setting.zoom:g} puts the sharp plane {where}, not "
            f"between the front glass and {FARTHEST_MM:g} mm; at this zoom the focus can go from "
            f"{low:.1f} to {high:.1f}",
            setting.focus,
            (low, high),
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


def _share(value: float, travel: tuple[float, float]) -> float:
    low, high = travel
    return (value - low) / (high - low)
