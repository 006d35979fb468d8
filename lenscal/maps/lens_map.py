"""The lens map: smooth d/D, D, standoff and the camera itself over (zoom, focus), with their σ.

The surfaces live in coordinates in which a lens is tame: ln(d/D), ln D and ln standoff. They are
fitted together, so that everything derived from them — d = D · (d/D), f by (3a), offset = D −
standoff — gets its uncertainty with all correlations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd

from lenscal.arrays import FloatArray, frozen_array
from lenscal.camera import Camera
from lenscal.document import digest
from lenscal.errors import InputError, MapError, OutOfDomainError
from lenscal.maps.domain import Domain
from lenscal.maps.quantities import CAMERA_QUANTITIES, QUANTITIES, from_core
from lenscal.maps.surface import Surfaces
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting

if TYPE_CHECKING:
    from lenscal.maps.contours import SettingCurve

Outside = Literal["raise", "nan"]


@dataclass(frozen=True, eq=False)
class LensMap:
    """What a lens does at every setting that samples support. Made by `fit_lens_map`.

    Parameters
    ----------
    samples
        The table that the map was fitted to.
    core
        Surfaces of ln(d/D), ln D and, where the robot is known, ln standoff.
    camera_surfaces
        One surface each of `CAMERA_QUANTITIES` that were measured.
    domain
        Where the map may be asked.
    sensor
        The sensor that the camera maps are for, or None.
    reference_setting
        The setting for which hand-eye was calibrated, or None.
    notes
        What a user should know, in words.
    """

    samples: pd.DataFrame
    core: Surfaces
    camera_surfaces: Mapping[str, Surfaces]
    domain: Domain
    sensor: Sensor | None = None
    reference_setting: LensSetting | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def has_standoff(self) -> bool:
        """Whether robot poses were known, so that standoff and nodal offset can be told."""
        return bool(self.core.coefficients.shape[2] == 3)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities that this map can give."""
        robot = () if self.has_standoff else ("standoff_mm", "nodal_offset_mm")
        absent = {*robot, *(set(CAMERA_QUANTITIES) - set(self.camera_surfaces))}
        return tuple(name for name in QUANTITIES if name not in absent)

    def magnification(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the magnification ratio d/D.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            d/D, of the broadcast shape.
        """
        return self.value("magnification", zoom, focus, outside=outside)

    def object_distance_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the object distance D = g1(z_s, f_s), (5a).

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            D in mm, of the broadcast shape.
        """
        return self.value("object_distance_mm", zoom, focus, outside=outside)

    def image_distance_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the image distance d = g2(z_s, f_s), (5b).

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            d in mm, of the broadcast shape.
        """
        return self.value("image_distance_mm", zoom, focus, outside=outside)

    def focal_length_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the focal length f = g3(z_s, f_s), (5c), of 1/f = 1/D + 1/d.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            f in mm, of the broadcast shape.
        """
        return self.value("focal_length_mm", zoom, focus, outside=outside)

    def nodal_offset_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give how far the projection centre lies behind that of the reference setting.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            The offset in mm, of the broadcast shape.
        """
        return self.value("nodal_offset_mm", zoom, focus, outside=outside)

    def standoff_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the distance from the reference projection centre to the sharp plane, D − offset.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            The standoff in mm, of the broadcast shape.
        """
        return self.value("standoff_mm", zoom, focus, outside=outside)

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
        zooms, focuses = self._supported(zoom, focus, outside)
        if quantity in CAMERA_QUANTITIES:
            return np.asarray(self.camera_surfaces[quantity].value(zooms, focuses)[..., 0])
        return from_core(quantity, self.core.value(zooms, focuses))[0]

    def gradient(
        self, quantity: str, zoom: npt.ArrayLike, focus: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Differentiate a quantity with respect to the settings.

        Parameters
        ----------
        quantity
            One of `quantities`.
        zoom, focus
            Settings within the domain; they broadcast.

        Returns
        -------
        along_zoom, along_focus : FloatArray
            Derivatives per controller unit; 0 along an axis that was sampled at one value only.
        """
        self._require(quantity)
        zooms, focuses = self._supported(zoom, focus, "raise")
        surfaces = self.camera_surfaces.get(quantity, self.core)
        slopes = [
            surfaces.value(zooms, focuses, derivative) if axis.degree else np.zeros(1)
            for axis, derivative in ((surfaces.zoom, (1, 0)), (surfaces.focus, (0, 1)))
        ]
        if quantity in CAMERA_QUANTITIES:
            along = [np.broadcast_to(slope[..., 0], zooms.shape) for slope in slopes]
        else:
            weights = from_core(quantity, surfaces.value(zooms, focuses))[1]
            along = [(weights * slope).sum(axis=-1) for slope in slopes]
        return np.asarray(along[0]), np.asarray(along[1])

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
        zooms, focuses = self._supported(zoom, focus, outside)
        if quantity in CAMERA_QUANTITIES:
            variance = self.camera_surfaces[quantity].covariance_at(zooms, focuses)[..., 0, 0]
        else:
            weights = from_core(quantity, self.core.value(zooms, focuses))[1]
            covariance = self.core.covariance_at(zooms, focuses)
            variance = np.einsum("...i,...ij,...j->...", weights, covariance, weights)
        return np.sqrt(np.maximum(variance, 0.0))

    def camera_at(self, zoom: float, focus: float) -> Camera:
        """Give the camera at one setting.

        Parameters
        ----------
        zoom, focus
            The setting.

        Returns
        -------
        Camera
            With image distance, and with principal point and κ1 where they were mapped.

        Raises
        ------
        MapError
            When the map was made without a sensor.
        """
        if self.sensor is None:
            raise MapError(
                "this map was fitted without a sensor, so it has no camera; "
                "give fit_lens_map(..., sensor=...)"
            )
        known = {name: float(self.value(name, zoom, focus)) for name in self.camera_surfaces}
        centre = self.sensor.centre_px
        return Camera(
            self.sensor,
            float(self.image_distance_mm(zoom, focus)),
            known.get("k1_per_mm2", 0.0),
            np.array(
                [
                    known.get("principal_point_x_px", centre[0]),
                    known.get("principal_point_y_px", centre[1]),
                ]
            ),
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

    def settings_for(self, **wanted: float) -> list[LensSetting]:
        """Find the settings at which two quantities have the wanted values.

        Parameters
        ----------
        **wanted
            Two of `quantities`, such as ``magnification=0.2, focal_length_mm=127``.

        Returns
        -------
        list of LensSetting
            All solutions within the domain; none when the list is empty.
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
        if quantity in ("standoff_mm", "nodal_offset_mm"):
            raise MapError(
                f"this map has no {quantity}: its samples carry no standoff, since no robot poses "
                "were recorded; record a session with a positioner"
            )
        raise InputError(
            f"unknown quantity {quantity!r}; this map has {', '.join(self.quantities)}"
        )

    def _supported(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, outside: Outside
    ) -> tuple[FloatArray, FloatArray]:
        zooms, focuses = np.broadcast_arrays(
            frozen_array("zoom", zoom, ("...",), finite=False),
            frozen_array("focus", focus, ("...",), finite=False),
        )
        inside = self.domain.contains(zooms, focuses)
        if inside.all():
            return zooms, focuses
        if outside == "nan":
            return np.where(inside, zooms, np.nan), np.where(inside, focuses, np.nan)
        first = np.flatnonzero(~inside.ravel())[0]
        named = f"zoom {zooms.ravel()[first]:g}, focus {focuses.ravel()[first]:g}"
        which = (
            f"the setting ({named}) lies"
            if inside.size == 1
            else f"{(~inside).sum()} of {inside.size} settings, the first at {named}, lie"
        )
        raise OutOfDomainError(
            f"{which} outside the map ({self.domain}); a map is never extrapolated: sample there, "
            'or ask with outside="nan"',
            self.domain,
            ~inside,
        )
