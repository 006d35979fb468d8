"""Looking a plate over before focusing: which disk suits, and about where it is sharp.

On a plate with several disks the right one depends on the magnification, and that on the distance
that is yet to be found. One look tells how the size of the image goes with the distance. Then the
sweep of the plan is made once, at each standoff with the disk that suits there; the sharpest
picture says where to focus, and on which disk. All this is done with the iris as it is for the
views: much blurred disks are no disks any more. Where the depth of field is then too long to tell,
the sweep is repeated at the iris to focus at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import FocusError, OutOfRangeError
from lenscal.rig.interfaces import Rig, Window
from lenscal.session.aim import hand_pose
from lenscal.session.disk_search import find_disk
from lenscal.session.disk_watch import DiskWatch, Look
from lenscal.session.exposure import expose
from lenscal.session.focus_peak import Verdict, judge
from lenscal.session.plan import SessionPlan
from lenscal.session.plate_parts import PlateDisk, disk_to_focus_on, disks_of, mean_pitch_mm
from lenscal.session.sharpness import MEASURES, Measure
from lenscal.setting import LensSetting

#: Half the side of a window in radii of the disk: room for blur and for the error of the estimate.
_ROOM: Final = 2.0
#: How far the disk may lie from where the axis should meet it, as a share of the image's width.
_AIM: Final = 0.06
#: The search that follows reaches to so many places of the sweep on either side, in half steps.
_NEIGHBOURS: Final = 2


@dataclass(frozen=True, slots=True)
class Survey:
    """What a look at a plate says about a lens setting.

    Parameters
    ----------
    disk
        The disk to focus on.
    standoffs_mm
        Where to search: the coarse sweep of the autofocus.
    image_distance_mm
        d, as far as sizes in the image tell, with the projection centre taken to be the reference
        one. Good to choose a part by and for nothing else.
    """

    disk: PlateDisk
    standoffs_mm: tuple[float, ...]
    image_distance_mm: float

    def magnification(self, standoff_mm: float) -> float:
        """Tell about how large things appear.

        Parameters
        ----------
        standoff_mm
            Distance of the plate from the reference projection centre.

        Returns
        -------
        float
            d/z.
        """
        return self.image_distance_mm / standoff_mm


def survey_disks(rig: Rig, plan: SessionPlan, setting: LensSetting) -> Survey:
    """Look the disks of a plate over at one lens setting.

    The lens is left at the iris to focus at, the camera where it looked last.

    Parameters
    ----------
    rig
        The rig; its target is a plate with disks.
    plan
        Says where to search and at which irises to focus and to look.
    setting
        Zoom and focus.

    Returns
    -------
    Survey
        What was found.

    Raises
    ------
    FocusError
        When no disk can be seen.
    """
    standoffs_mm = plan.autofocus.standoffs_mm()
    measure = plan.autofocus.measure
    rig.lens.move_to(setting.with_iris(plan.views.iris), plan.approach)
    image_distance_mm = _image_distance_mm(rig, standoffs_mm, measure)
    seen = _sweep(rig, standoffs_mm, image_distance_mm, measure)
    rig.lens.move_to(setting.with_iris(plan.autofocus.iris), plan.approach)
    if judge(_sharpness(seen)) is Verdict.FLAT:
        seen = _sweep(rig, standoffs_mm, image_distance_mm, measure)
    if not np.isfinite(_sharpness(seen)).any():
        raise FocusError(
            f"none of the disks is sharp enough to be seen from {standoffs_mm[0]:.0f} to "
            f"{standoffs_mm[-1]:.0f} mm at {setting}; search a longer range, or in smaller steps"
        )
    best = int(np.nan_to_num(_sharpness(seen)).argmax())
    disk, look = seen[best]
    size_mm = 2 * look.size_px * mean_pitch_mm(rig.camera.sensor)
    return Survey(disk, _about(standoffs_mm, best), look.position * size_mm / disk.diameter_mm)


def _image_distance_mm(rig: Rig, standoffs_mm: list[float], measure: Measure) -> float:
    """Measure the image of the largest disk that fits in, from the middle of the search."""
    last = len(standoffs_mm) - 1
    before_s = rig.camera.exposure_s
    trouble: Exception | None = None
    for index in (last // 2, last // 4, 3 * last // 4, 0, last):
        standoff_mm = standoffs_mm[index]
        for disk in sorted(disks_of(rig.target), key=lambda d: -d.diameter_mm):
            rig.camera.set_exposure_s(before_s)
            try:
                rig.positioner.move_to(hand_pose(rig, standoff_mm, disk.centre_mm))
                expose(rig.camera)
            except (FocusError, OutOfRangeError) as error:
                trouble = error
                continue
            watch = DiskWatch(rig.camera, measure)
            radius_px = watch.look(standoff_mm).size_px
            if np.isfinite(radius_px):
                size_mm = 2 * radius_px * mean_pitch_mm(rig.camera.sensor)
                return standoff_mm * size_mm / disk.diameter_mm
            trouble = watch.trouble
    raise FocusError(
        f"no disk of the plate can be seen from {standoffs_mm[0]:.0f} to {standoffs_mm[-1]:.0f} mm "
        f"at {rig.lens.setting}; the last one: {trouble}"
    )


def _sweep(
    rig: Rig, standoffs_mm: list[float], image_distance_mm: float, measure: Measure
) -> list[tuple[PlateDisk, Look]]:
    """Look at the disk that suits each standoff; what cannot be reached or seen scores NaN."""
    seen = []
    exposed = False
    for standoff_mm in standoffs_mm:
        magnification = image_distance_mm / standoff_mm
        disk = disk_to_focus_on(rig.target, rig.camera.sensor, magnification)
        look = Look(standoff_mm, np.nan, np.nan)
        try:
            rig.positioner.move_to(hand_pose(rig, standoff_mm, disk.centre_mm))
            if not exposed:
                expose(rig.camera)
                exposed = True
            radius_px = disk.diameter_px(magnification, rig.camera.sensor) / 2
            look = Look(standoff_mm, *_look(rig, radius_px, measure))
        except (FocusError, OutOfRangeError):
            pass  # out of reach, or too blurred to be a disk
        seen.append((disk, look))
    return seen


def _sharpness(seen: list[tuple[PlateDisk, Look]]) -> FloatArray:
    return np.array([look.sharpness for _, look in seen])


def _look(rig: Rig, radius_px: float, measure: Measure) -> tuple[float, float]:
    """Take a picture of the disk in the middle; give its sharpness and its radius."""
    sensor = rig.camera.sensor
    size = np.array([sensor.width_px, sensor.height_px])
    aim_px = _AIM * sensor.width_px
    # Sample pitches differ between x and y; a mean radius is stretched along one of them.
    stretch = mean_pitch_mm(sensor) / sensor.sample_pitch_mm
    half = np.minimum(_ROOM * radius_px * stretch + aim_px, (size - 1) / 2)
    low = np.floor((size - 1) / 2 - half).astype(int)
    width, height = (size - 2 * low).tolist()
    frame = rig.camera.grab(Window(int(low[0]), int(low[1]), width, height))
    disk = find_disk(frame.image, None, radius_px, within_px=aim_px)
    sharpness = MEASURES[measure].score(frame.image, disk)
    return (sharpness if sharpness > 0 else np.nan), disk.radius_px


def _about(standoffs_mm: list[float], best: int) -> tuple[float, ...]:
    """Lay a sweep about one place of another one, in half its steps, evenly in 1/standoff."""
    first = int(np.clip(best - _NEIGHBOURS, 0, len(standoffs_mm) - 1 - 2 * _NEIGHBOURS))
    last = first + 2 * _NEIGHBOURS
    nearest, farthest = standoffs_mm[first], standoffs_mm[last]
    return tuple((1 / np.linspace(1 / nearest, 1 / farthest, 4 * _NEIGHBOURS + 1)).tolist())
