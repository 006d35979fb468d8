"""The lens map: smooth d/D, D, standoff and the camera itself over (zoom, focus), with their σ.

The surfaces live in coordinates in which a lens is tame: ln(d/D), ln D and ln standoff. They are
fitted together, so that everything derived from them — d = D · (d/D), f by (3a), offset = D −
standoff — gets its uncertainty with all correlations. Of a lens of which only d is known, as from
most foreign files, ln d is the one surface, and the map says what it cannot tell.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, overload

import numpy as np
import numpy.typing as npt
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.cameras import Cameras
from lenscal.document import digest
from lenscal.errors import InputError, MapError
from lenscal.maps.domain import Domain
from lenscal.maps.evaluation import Motor, Outside, slopes_at, supported, value_at, variance_at
from lenscal.maps.pupil import PupilMap
from lenscal.maps.pupil_quantities import PupilQuantities
from lenscal.maps.quantities import CAMERA_QUANTITIES, QUANTITIES, SINGLE
from lenscal.maps.surface import Surfaces
from lenscal.maps.tame_surfaces import TameSurfaces
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting

if TYPE_CHECKING:
    from lenscal.maps.contours import SettingCurve
    from lenscal.maps.inverse import SettingSolution

#: Quantities that are not known without the object distance, and without robot poses.
_OF_DISTANCE: Final = ("magnification", "object_distance_mm", "focal_length_mm")
_OF_ROBOT: Final = ("standoff_mm", "nodal_offset_mm")
_NO_SENSOR: Final = (
    "this map was fitted without a sensor, so it has no camera; give fit_lens_map(..., sensor=...)"
)


@dataclass(frozen=True, eq=False)
class LensMap(PupilQuantities):
    """What a lens does at every setting that samples support. Made by `fit_lens_map`.

    Parameters
    ----------
    samples
        The table that the map was fitted to.
    core
        Surfaces of ln(d/D), ln D and, where the robot is known, ln standoff; or of ln d alone where
        the samples carry no object distance.
    single_surfaces
        One surface each of the quantities `lenscal.maps.quantities.SINGLE` that were measured.
    domain
        Where the map may be asked.
    sensor
        The sensor that the camera maps are for, or None.
    reference_setting
        The setting for which hand-eye was calibrated, or None.
    notes
        What a user should know, in words.
    pupil
        The entrance pupil, or None where no sample tells it.
    pupil_samples
        Samples of the entrance pupil besides those in `samples`, at other irises; or None.
    identity
        Names of the devices that the samples were recorded with, by role, as far as known.
    """

    samples: pd.DataFrame
    core: TameSurfaces
    single_surfaces: Mapping[str, Surfaces]
    domain: Domain
    sensor: Sensor | None = None
    reference_setting: LensSetting | None = None
    notes: tuple[str, ...] = field(default=())
    pupil: PupilMap | None = None
    pupil_samples: pd.DataFrame | None = None
    identity: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_object_distance(self) -> bool:
        """Whether D was known, so that d/D and f can be told, and not d alone."""
        return bool(self.core.coefficients.shape[2] > 1)

    @property
    def has_standoff(self) -> bool:
        """Whether robot poses were known, so that standoff and nodal offset can be told."""
        return bool(self.core.coefficients.shape[2] == 3)

    @cached_property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities that this map can give."""
        robot = () if self.has_standoff else _OF_ROBOT
        distance = () if self.has_object_distance else _OF_DISTANCE
        absent = {*robot, *distance, *(set(SINGLE) - set(self.single_surfaces))}
        return tuple(name for name in QUANTITIES if name not in absent)

    def value(
        self,
        quantity: str,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        *,
        outside: Outside = "raise",
    ) -> FloatArray:
        """Give any quantity by its name.

        Parameters
        ----------
        quantity
            One of `quantities`.
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            Of the broadcast shape.
        """
        self._require(quantity)
        return value_at(self, quantity, *supported(self.domain, zoom, focus, outside))

    def gradient(
        self,
        quantity: str,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        *,
        outside: Outside = "raise",
    ) -> tuple[FloatArray, FloatArray]:
        """Differentiate a quantity with respect to the settings.

        Parameters
        ----------
        quantity
            One of `quantities`.
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        along_zoom, along_focus : FloatArray
            Derivatives per controller unit; 0 along an axis that was sampled at one value only.
        """
        self._require(quantity)
        zooms, focuses = supported(self.domain, zoom, focus, outside)
        along_zoom, along_focus = slopes_at(self, quantity, zooms, focuses, ("zoom", "focus"))
        return along_zoom, along_focus

    def derivative(
        self,
        quantity: str,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        *,
        by: Motor,
        outside: Outside = "raise",
    ) -> FloatArray:
        """Differentiate a quantity with respect to one motor.

        Parameters
        ----------
        quantity
            One of `quantities`.
        zoom, focus
            Settings; they broadcast.
        by
            The motor.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            Per controller unit, of the broadcast shape; 0 where that motor was sampled at one value
            only.

        Raises
        ------
        InputError
            When there is no such motor.
        """
        if by not in ("zoom", "focus"):
            raise InputError(f"a map is differentiated by 'zoom' or by 'focus', not by {by!r}")
        self._require(quantity)
        zooms, focuses = supported(self.domain, zoom, focus, outside)
        return slopes_at(self, quantity, zooms, focuses, (by,))[0]

    def sigma(
        self,
        quantity: str,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        *,
        outside: Outside = "raise",
    ) -> FloatArray:
        """Give the standard deviation of a quantity of the map.

        Parameters
        ----------
        quantity
            One of `quantities`.
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            1 σ in the unit of the quantity, of the broadcast shape.
        """
        self._require(quantity)
        zooms, focuses = supported(self.domain, zoom, focus, outside)
        return np.sqrt(variance_at(self, quantity, zooms, focuses))

    @overload
    def camera_at(
        self, zoom: float, focus: float, *, outside: Literal["raise"] = "raise"
    ) -> Camera: ...

    @overload
    def camera_at(self, zoom: float, focus: float, *, outside: Outside) -> Camera | None: ...

    def camera_at(self, zoom: float, focus: float, *, outside: Outside = "raise") -> Camera | None:
        """Give the camera at one setting.

        Parameters
        ----------
        zoom, focus
            The setting.
        outside
            What to do beyond the domain: raise, or give None, since no camera has NaN in it.

        Returns
        -------
        Camera
            With image distance, and with principal point, κ1 and the sensor's scale factor where
            they were mapped.

        Raises
        ------
        MapError
            When the map was made without a sensor.
        """
        if self.sensor is None:
            raise MapError(_NO_SENSOR)
        if np.isnan(self.image_distance_mm(zoom, focus, outside=outside)):
            return None
        camera = self.cameras_at([zoom], [focus])[0]
        if "scale_factor" not in self.single_surfaces:
            return camera
        scale_factor = float(self.value("scale_factor", zoom, focus))
        return replace(camera, sensor=replace(self.sensor, scale_factor=scale_factor))

    def cameras_at(self, zoom: npt.ArrayLike, focus: npt.ArrayLike) -> Cameras:
        """Give the cameras at many settings.

        Parameters
        ----------
        zoom, focus
            (S,) settings.

        Returns
        -------
        Cameras
            One per setting, as `camera_at` gives it, save that the scale factor is one for all:
            that of `sensor`.

        Raises
        ------
        MapError
            When the map was made without a sensor.
        OutOfDomainError
            When a setting lies outside of the map.
        """
        if self.sensor is None:
            raise MapError(_NO_SENSOR)
        distances = self.image_distance_mm(zoom, focus)
        known = {
            name: self.value(name, zoom, focus)
            for name in CAMERA_QUANTITIES
            if name in self.single_surfaces
        }
        centre = self.sensor.centre_px
        k1, x, y = (
            np.broadcast_to(known.get(name, unmapped), distances.shape)
            for name, unmapped in (
                ("k1_per_mm2", 0.0),
                ("principal_point_x_px", centre[0]),
                ("principal_point_y_px", centre[1]),
            )
        )
        return Cameras(
            self.sensor,
            distances,
            np.stack([x, y], axis=-1),
            k1[:, None],
            np.zeros((len(distances), 2)),
        )

    def contour(self, quantity: str, level: float) -> list[SettingCurve]:
        """Trace the settings at which a quantity has a value.

        Parameters
        ----------
        quantity
            One of `quantities`.
        level
            The value, in the unit of the quantity.

        Returns
        -------
        list of SettingCurve
            The pieces of the contour within the domain.
        """
        from lenscal.maps.contours import trace

        return trace(self, quantity, level)

    def settings_for(self, **wanted: float) -> list[SettingSolution]:
        """Find the settings at which two quantities have the wanted values.

        Parameters
        ----------
        **wanted
            Two of `quantities`, such as ``magnification=0.2, focal_length_mm=127``.

        Returns
        -------
        list of SettingSolution
            All solutions within the domain, each with its covariance; none when the list is empty.
        """
        from lenscal.maps.inverse import settings_for

        return settings_for(self, wanted)

    def range_of(self, quantity: str) -> tuple[float, float]:
        """Give the smallest and the largest value on a fine grid over the domain.

        Parameters
        ----------
        quantity
            One of `quantities`.

        Returns
        -------
        tuple of float
            Lowest and highest value.
        """
        values = self.value(quantity, *self.domain.grid(), outside="nan")
        return float(np.nanmin(values)), float(np.nanmax(values))

    @property
    def digest(self) -> str:
        """SHA-256 of everything that the map says, for the evidence of what is made with it."""
        from lenscal.maps.map_file import to_json

        return digest(to_json(self))

    def save(self, path: Path | str) -> Path:
        """Write the map to one JSON file that can be read and diffed.

        Parameters
        ----------
        path
            The file.

        Returns
        -------
        Path
            The file.
        """
        from lenscal.maps.map_file import save

        return save(self, path)

    @classmethod
    def load(cls, path: Path | str) -> LensMap:
        """Read a map. The covariance is made again from the samples and compared.

        Parameters
        ----------
        path
            The file.

        Returns
        -------
        LensMap
            The map that was saved.
        """
        from lenscal.maps.map_file import load

        return load(path)

    def _require(self, quantity: str) -> None:
        if quantity in self.quantities:
            return
        if quantity in (*_OF_DISTANCE, *_OF_ROBOT) and not self.has_object_distance:
            raise MapError(
                f"this map has no {quantity}: its samples lack the column object_distance_mm; "
                "measure D at each setting, add the column, and fit the map again"
            )
        if quantity in _OF_ROBOT:
            raise MapError(
                f"this map has no {quantity}: its samples carry no standoff, since no robot poses "
                "were recorded; record a session with a positioner"
            )
        raise InputError(
            f"unknown quantity {quantity!r}; this map has {', '.join(self.quantities)}"
        )
