"""Field of view: the whole feature must land on the sensor, (11) and (12) of the paper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, positive
from lenscal.camera import Camera
from lenscal.optics import field_of_view_limit
from lenscal.pose import Pose
from lenscal.sensor import Axis, Sensor
from planning.requirements.margin import Margin


@dataclass(frozen=True, slots=True)
class FieldOfView:
    """A feature of a given length fits on the sensor when it is centred.

    Parameters
    ----------
    length_mm
        The length L in mm.
    axis
        The image axis along which the feature lies; "any" when the roll of the camera is unknown:
        then the smaller side of the sensor counts.

    Raises
    ------
    InputError
        When the length is not positive.
    """

    length_mm: float
    axis: Axis = "any"

    def __post_init__(self) -> None:
        positive("length_mm", self.length_mm, "mm")

    @property
    def name(self) -> str:
        """``field_of_view``."""
        return "field_of_view"

    def magnification_bounds(self, sensor: Sensor) -> tuple[float, float]:
        """Give the highest d/D that does not truncate, I_min/L of (11).

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        tuple of float
            0 and I_min/L.
        """
        return 0.0, field_of_view_limit(sensor, self.length_mm, self.axis)

    def margin(self, magnification: npt.ArrayLike, sensor: Sensor) -> Margin:
        """Judge magnifications, for an orthogonal, centred view.

        Parameters
        ----------
        magnification
            (...) d/D.
        sensor
            The sensor.

        Returns
        -------
        Margin
            (...) by which share d/D stays below I_min/L.
        """
        limit = self.magnification_bounds(sensor)[1]
        value: FloatArray = 1.0 - np.asarray(magnification, dtype=np.float64) / limit
        return Margin(value, "1", self.describe(sensor))

    def image_margin(
        self, camera: Camera, camera_from_part: Pose, feature_mm: FloatArray
    ) -> Margin:
        """Judge one view with the whole camera model.

        Parameters
        ----------
        camera
            The camera.
        camera_from_part
            Its pose.
        feature_mm
            (N, 3) corners of the feature in the part's frame in mm.

        Returns
        -------
        Margin
            Distance of the outermost corner from the border of the sensor, as a share of half its
            size; NaN when a corner is not in front.
        """
        pixels = camera.project(camera_from_part.transform(feature_mm))
        half = np.array([camera.sensor.width_px, camera.sensor.height_px]) / 2
        value = (1.0 - np.abs(pixels - camera.sensor.centre_px) / half).min()
        return Margin(np.asarray(value), "1", self.describe(camera.sensor))

    def describe(self, sensor: Sensor) -> str:
        """Say what is asked and what it means for d/D.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "field of view of 25.4 mm along x (d/D ≤ 0.3275)".
        """
        along = "" if self.axis == "any" else f" along {self.axis}"
        limit = self.magnification_bounds(sensor)[1]
        return f"field of view of {self.length_mm:g} mm{along} (d/D ≤ {limit:.4f})"
