"""Admissible settings: where resolution and field of view hold, in the (zoom, focus) plane.

For a fixed lens the two limits on d/D bound the object distance directly, (4a) and (8a). For a zoom
lens they are two contours of d/D; between them, inside the domain of the map, lie the admissible
settings, and the map of D over that area gives the object distances (section 1.5.3.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from lenscal import optics
from lenscal.arrays import BoolArray, FloatArray, positive
from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.requirements.margin import Requirement, contradiction, required_magnification
from planning.setting_area import Bounds, SettingPolygon, trace_area

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: Nodes per side of the grid on which the area between the contours is traced.
_GRID: Final = 201


@dataclass(frozen=True, slots=True)
class FixedLens:
    """A lens of one focal length.

    Parameters
    ----------
    focal_length_mm
        The perspective focal length f of (3a) in mm.
    sensor
        The sensor behind it.

    Raises
    ------
    InputError
        When the focal length is not positive.
    """

    focal_length_mm: float
    sensor: Sensor

    def __post_init__(self) -> None:
        positive("focal_length_mm", self.focal_length_mm, "mm")


@dataclass(frozen=True, slots=True, eq=False)
class AdmissibleSettings:
    """Settings at which an orthogonal, centred view meets all requirements.

    Parameters
    ----------
    lens
        The lens map or the fixed lens.
    magnification_bounds
        Lowest and highest d/D that the requirements leave.
    object_distance_bounds_mm
        Smallest and largest D over the admissible settings in mm; None when there are none.
    standoff_bounds_mm
        The same of D − offset; None also for a fixed lens, and for a map that was
        made without robot poses.
    polygons
        The area. Where the domain of the map is not a rectangle, its border is followed from
        inside, to within a cell of 1/200 of its range.
    why_empty
        A sentence that names what makes it impossible; empty when there are settings.
    """

    lens: LensMap | FixedLens
    magnification_bounds: Bounds
    object_distance_bounds_mm: Bounds | None = None
    standoff_bounds_mm: Bounds | None = None
    polygons: tuple[SettingPolygon, ...] = ()
    why_empty: str = ""

    @property
    def is_empty(self) -> bool:
        """Whether no setting is admissible."""
        return bool(self.why_empty)

    def contains(self, zoom: npt.ArrayLike, focus: npt.ArrayLike) -> BoolArray:
        """Tell which settings are admissible, by the map itself and not by the polygons.

        Parameters
        ----------
        zoom, focus
            (...) settings; they broadcast.

        Returns
        -------
        BoolArray
            (...) False outside the domain of the map.

        Raises
        ------
        InputError
            For a fixed lens, which has no settings.
        """
        if isinstance(self.lens, FixedLens):
            raise InputError("a fixed lens has no zoom and focus settings; ask for a lens map's")
        magnification = self.lens.magnification(zoom, focus, outside="nan")
        low, high = self.magnification_bounds
        inside: BoolArray = (magnification >= low) & (magnification <= high)
        return inside


def object_distance_bounds_mm(
    focal_length_mm: float, sensor: Sensor, requirements: Sequence[Requirement]
) -> Bounds:
    """Solve for the object distances of a fixed lens, (4a) and (8a).

    Parameters
    ----------
    focal_length_mm
        f in mm.
    sensor
        The sensor.
    requirements
        Resolution bounds D from above, field of view from below.

    Returns
    -------
    tuple of float
        Smallest and largest D in mm: the focal length and infinity where nothing bounds it.

    Raises
    ------
    PlanningError
        When the requirements contradict each other.
    """
    positive("focal_length_mm", focal_length_mm, "mm")
    why = contradiction(requirements, sensor)
    if why:
        raise PlanningError(why)
    low, high = required_magnification(requirements, sensor)
    nearest = float(optics.object_distance_mm(high, focal_length_mm))
    farthest = float(optics.object_distance_mm(low, focal_length_mm)) if low > 0 else float("inf")
    return nearest, farthest


def admissible_settings(
    lens: LensMap | FixedLens,
    requirements: Sequence[Requirement],
    sensor: Sensor | None = None,
    safety: float = 0.0,
) -> AdmissibleSettings:
    """Find the settings at which all requirements hold.

    Parameters
    ----------
    lens
        The lens map or the fixed lens.
    requirements
        What the image must satisfy.
    sensor
        The sensor, where the lens map was made without one; None for the map's own.
    safety
        By which share of itself each limit on d/D is kept.

    Returns
    -------
    AdmissibleSettings
        The settings; empty, with the reason, when there are none.

    Raises
    ------
    InputError
        When there is no sensor, or it is not the one that the lens was calibrated with.
    """
    sensor = _agreed_sensor(lens.sensor, sensor)
    limits = required_magnification(requirements, sensor, safety)
    why = contradiction(requirements, sensor, safety)
    if why:
        return AdmissibleSettings(lens, limits, why_empty=why)
    if isinstance(lens, FixedLens):
        low, high = limits
        nearest = float(optics.object_distance_mm(high, lens.focal_length_mm))
        farthest = float("inf")
        if low > 0:
            farthest = float(optics.object_distance_mm(low, lens.focal_length_mm))
        return AdmissibleSettings(lens, limits, (nearest, farthest))
    return _from_map(lens, sensor, requirements, limits)


def _agreed_sensor(of_lens: Sensor | None, stated: Sensor | None) -> Sensor:
    if of_lens is not None and stated is not None and stated != of_lens:
        raise InputError(
            f"the sensor {stated} is not the one that the lens was calibrated with, {of_lens}; "
            "leave the sensor out, or calibrate the lens on that one"
        )
    sensor = of_lens or stated
    if sensor is None:
        raise InputError(
            "the lens map was made without a sensor, and resolution and field of view need one; "
            "give admissible_settings(..., sensor=...) or fit the map with its sensor"
        )
    return sensor


def _from_map(
    lens: LensMap, sensor: Sensor, requirements: Sequence[Requirement], limits: Bounds
) -> AdmissibleSettings:
    zoom = np.linspace(*lens.domain.zoom, _GRID)
    focus = np.linspace(*lens.domain.focus, _GRID)
    ratio = lens.magnification(*np.meshgrid(zoom, focus), outside="nan")
    reached = float(np.nanmin(ratio)), float(np.nanmax(ratio))
    if limits[0] > reached[1] or limits[1] < reached[0]:
        return AdmissibleSettings(
            lens, limits, why_empty=_out_of_reach(sensor, requirements, limits, reached)
        )
    polygons = trace_area(lens, zoom, focus, ratio, limits)
    inside = np.argwhere((ratio >= limits[0]) & (ratio <= limits[1]))
    settings = np.concatenate(
        [np.stack([zoom[inside[:, 1]], focus[inside[:, 0]]], axis=-1)]
        + [ring for p in polygons for ring in (p.outline, *p.holes)]
    )
    distance = lens.object_distance_mm(*settings.T, outside="nan")
    standoff = _range(lens.standoff_mm(*settings.T, outside="nan")) if lens.has_standoff else None
    return AdmissibleSettings(lens, limits, _range(distance), standoff, polygons)


def _out_of_reach(
    sensor: Sensor, requirements: Sequence[Requirement], limits: Bounds, reached: Bounds
) -> str:
    too_demanding = limits[0] > reached[1]
    if too_demanding:
        blocking = max(requirements, key=lambda r: r.magnification_bounds(sensor)[0])
        missing = limits[0] / reached[1] - 1
    else:
        blocking = min(requirements, key=lambda r: r.magnification_bounds(sensor)[1])
        missing = 1 - limits[1] / reached[0]
    direction = "higher" if too_demanding else "lower"
    return (
        f"no setting of this lens satisfies the {blocking.describe(sensor)}: its map reaches d/D "
        f"from {reached[0]:.4f} to {reached[1]:.4f}, and {missing:.1%} {direction} is needed; "
        "relax that requirement or calibrate more of the lens"
    )


def _range(values: FloatArray) -> Bounds:
    return float(np.nanmin(values)), float(np.nanmax(values))
