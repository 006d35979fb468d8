"""What is exported: cameras of a lens map at chosen settings, with the distances it knows there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.maps.lens_map import LensMap
from lenscal.setting import LensSetting


class WrittenFile(NamedTuple):
    """A file that was written, and what it could not hold.

    Parameters
    ----------
    path
        The file.
    worst_error_px
        Largest distance on the sensor between the cameras in it and those that were given; 0 where
        the format holds them as they are.
    """

    path: Path
    worst_error_px: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class ExportedSetting:
    """The camera at one setting.

    Parameters
    ----------
    setting
        The setting.
    camera
        The camera there.
    object_distance_mm
        D in mm, or None where it is not known.
    nodal_offset_mm
        How far the projection centre lies behind that of the reference setting, or None.
    """

    setting: LensSetting
    camera: Camera
    object_distance_mm: float | None = None
    nodal_offset_mm: float | None = None


def settings_of(lens_map: LensMap, settings: Iterable[LensSetting]) -> list[ExportedSetting]:
    """Ask a map for the cameras at some settings.

    Parameters
    ----------
    lens_map
        The map; it needs a sensor.
    settings
        The settings, within the domain.

    Returns
    -------
    list of ExportedSetting
        One per setting, in their order.
    """
    distances, offsets = lens_map.has_object_distance, lens_map.has_standoff
    return [
        ExportedSetting(
            s,
            lens_map.camera_at(s.zoom, s.focus),
            float(lens_map.object_distance_mm(s.zoom, s.focus)) if distances else None,
            float(lens_map.nodal_offset_mm(s.zoom, s.focus)) if offsets else None,
        )
        for s in settings
    ]


def common_sensor_checked(exported: list[ExportedSetting]) -> list[ExportedSetting]:
    """Make sure that there is something to export, all on one sensor.

    Parameters
    ----------
    exported
        The settings.

    Returns
    -------
    list of ExportedSetting
        The same.

    Raises
    ------
    InputError
        When there are none, or their sensors differ.
    """
    if not exported:
        raise InputError("there is no setting to export; give at least one within the map's domain")
    sensors = {e.camera.sensor for e in exported}
    if len(sensors) > 1:
        raise InputError(
            f"the settings have {len(sensors)} different sensors, but the format holds one for "
            "all; export them one sensor at a time, or, where the scale factor was mapped, fit "
            "the map to a table without the column scale_factor, so that one stands for all"
        )
    return exported
