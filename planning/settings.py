"""Admissible settings: where resolution and field of view hold, in the (zoom, focus) plane.

For a fixed lens the two limits on d/D bound the object distance directly, (4a) and (8a). For a zoom
lens they are two contours of d/D; between them, inside the domain of the map, lie the admissible
settings, and the map of D over that area gives the object distances (section 1.5.3.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lenscal import optics
from lenscal.arrays import BoolArray
from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.fixed_lens import FixedLens
from planning.requirements.magnification import (
    Stated,
    bounding,
    contradiction,
    required_magnification,
)
from planning.requirements.margin import BoundsObjectDistance
from planning.setting_area import (
    Bounds,
    MagnificationGrid,
    Quantity,
    SettingPolygon,
    extremes,
    trace_area,
)

if TYPE_CHECKING:
    from lenscal.maps.contours import SettingCurve
    from lenscal.maps.lens_map import LensMap


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
        The area; its border follows the contours of d/D and the outline of the domain exactly.
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

    def along(self, quantity: str, level: float) -> list[SettingCurve]:
        """Restrict the settings to a contour, such as f = 5 in of the paper's 1.5.3.3.

        Parameters
        ----------
        quantity
            What is to be constant, one of the map's quantities.
        level
            Its value, in its unit.

        Returns
        -------
        list of SettingCurve
            The pieces of the contour within the area, with every quantity along them; none when it
            never enters the area.

        Raises
        ------
        InputError
            For a fixed lens, and for a level that the map does not reach.
        """
        if isinstance(self.lens, FixedLens):
            raise InputError("a fixed lens has no zoom and focus settings; ask for a lens map's")
        if self.is_empty:
            return []
        return [
            piece
            for curve in self.lens.contour(quantity, level)
            for piece in curve.within("magnification", *self.magnification_bounds)
        ]


def object_distance_bounds_mm(
    focal_length_mm: float,
    sensor: Sensor,
    requirements: Stated,
    entrance_pupil_diameter_mm: float | None = None,
) -> Bounds:
    """Solve for the object distances of a fixed lens, (4a) and (8a).

    Parameters
    ----------
    focal_length_mm
        f in mm.
    sensor
        The sensor.
    requirements
        Resolution bounds D from above, field of view and depth of field from below.
    entrance_pupil_diameter_mm
        a in mm, which depth of field needs.

    Returns
    -------
    tuple of float
        Smallest and largest D in mm: the focal length and infinity where nothing bounds it.

    Raises
    ------
    PlanningError
        When the requirements contradict each other.
    """
    lens = FixedLens(focal_length_mm, sensor, entrance_pupil_diameter_mm)
    found = admissible_settings(lens, requirements)
    if found.object_distance_bounds_mm is None:
        raise PlanningError(found.why_empty)
    return found.object_distance_bounds_mm


def admissible_settings(
    lens: LensMap | FixedLens,
    requirements: Stated,
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
        By which share of itself each limit on d/D, and on D, is kept.

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
        return _of_fixed(lens, requirements, limits, safety)
    return _from_map(lens, sensor, requirements, limits)


def _of_fixed(
    lens: FixedLens, requirements: Stated, limits: Bounds, safety: float
) -> AdmissibleSettings:
    low, high = limits
    nearest = float(optics.object_distance_mm(high, lens.focal_length_mm))
    farthest = float(optics.object_distance_mm(low, lens.focal_length_mm)) if low > 0 else np.inf
    for requirement in requirements:
        if not isinstance(requirement, BoundsObjectDistance):
            continue
        own = requirement.object_distance_bounds_mm(lens)[0] * (1 + safety)
        if own > farthest:
            demanding = max(
                bounding(requirements), key=lambda r: r.magnification_bounds(lens.sensor)
            )
            return AdmissibleSettings(
                lens,
                limits,
                why_empty=(
                    f"the requirements contradict each other with this lens: "
                    f"{demanding.describe(lens.sensor)} needs D of at most {farthest:.1f} mm, and "
                    f"{requirement.describe(lens.sensor)} at least {own:.1f} mm; close the iris, "
                    "or relax one of them"
                ),
            )
        nearest = max(nearest, own)
    return AdmissibleSettings(lens, limits, (nearest, farthest))


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
    lens: LensMap, sensor: Sensor, requirements: Stated, limits: Bounds
) -> AdmissibleSettings:
    grid = MagnificationGrid.over(lens)
    reached = grid.reached
    if limits[0] > reached[1] or limits[1] < reached[0]:
        return AdmissibleSettings(
            lens, limits, why_empty=_out_of_reach(sensor, requirements, limits, reached)
        )
    polygons = trace_area(grid, limits)

    def bounds(quantity: Quantity) -> Bounds:
        return extremes(grid, polygons, quantity, limits)

    return AdmissibleSettings(
        lens,
        limits,
        bounds(lens.object_distance_mm),
        bounds(lens.standoff_mm) if lens.has_standoff else None,
        polygons,
    )


def _out_of_reach(sensor: Sensor, requirements: Stated, limits: Bounds, reached: Bounds) -> str:
    too_demanding = limits[0] > reached[1]
    if too_demanding:
        blocking = max(bounding(requirements), key=lambda r: r.magnification_bounds(sensor)[0])
        missing = limits[0] / reached[1] - 1
    else:
        blocking = min(bounding(requirements), key=lambda r: r.magnification_bounds(sensor)[1])
        missing = 1 - limits[1] / reached[0]
    direction = "higher" if too_demanding else "lower"
    return (
        f"no setting of this lens satisfies the {blocking.describe(sensor)}: its map reaches d/D "
        f"from {reached[0]:.4f} to {reached[1]:.4f}, and {missing:.1%} {direction} is needed; "
        "relax that requirement or calibrate more of the lens"
    )
