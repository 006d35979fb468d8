"""Resolution: a short piece of the feature must cover so many samples, (9) and (10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, positive
from lenscal.camera import Camera
from lenscal.optics import resolution_limit
from lenscal.pose import Pose
from lenscal.sensor import Axis, Sensor
from planning.requirements.margin import Margin


@dataclass(frozen=True, slots=True)
class Resolution:
    """At least so many frame-buffer samples on every piece of the feature of a given length.

    Parameters
    ----------
    pixels
        How many samples.
    length_mm
        The length l that they must cover, in mm.
    axis
        The image axis along which the feature lies; "any" when the roll of the camera is unknown:
        then the coarser pitch counts.

    Raises
    ------
    InputError
        When a number is not positive.
    """

    pixels: float
    length_mm: float
    axis: Axis = "any"

    def __post_init__(self) -> None:
        positive("pixels", self.pixels, "px")
        positive("length_mm", self.length_mm, "mm")

    @property
    def name(self) -> str:
        """``resolution``."""
        return "resolution"

    def magnification_bounds(self, sensor: Sensor) -> tuple[float, float]:
        """Give the lowest d/D that resolves, w/l of (9).

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        tuple of float
            w/l and infinity.
        """
        return resolution_limit(sensor, self.pixels, self.length_mm, self.axis), float("inf")

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
            (...) by which share d/D exceeds w/l.
        """
        limit = self.magnification_bounds(sensor)[0]
        value: FloatArray = np.asarray(magnification, dtype=np.float64) / limit - 1.0
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
            (N, 3) corners of the feature in the part's frame in mm; every edge must be resolved.

        Returns
        -------
        Margin
            By which share the worst piece exceeds what it must cover; NaN when it is not in front.
        """
        edges = zip(feature_mm, np.roll(feature_mm, -1, axis=0), strict=True)
        pitch = camera.sensor.sample_pitch_mm
        shares = []
        for start, end in edges:
            count = max(1, round(float(np.linalg.norm(end - start)) / self.length_mm))
            points = start + np.linspace(0, 1, count + 1)[:, None] * (end - start)
            pixels = camera.project(camera_from_part.transform(points))
            covered_mm = np.abs(np.diff(pixels, axis=0)) * pitch
            along = (
                covered_mm[:, "xy".index(self.axis)]
                if self.axis != "any"
                else np.linalg.norm(covered_mm, axis=-1)
            )
            piece_mm = float(np.linalg.norm(end - start)) / count
            shares.append(float(along.min()) / piece_mm)
        return self.margin(np.min(shares), camera.sensor)

    def describe(self, sensor: Sensor) -> str:
        """Say what is asked and what it means for d/D.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "resolution of 3 px on 0.254 mm along x (d/D ≥ 0.1919)".
        """
        along = "" if self.axis == "any" else f" along {self.axis}"
        limit = self.magnification_bounds(sensor)[0]
        return (
            f"resolution of {self.pixels:g} px on {self.length_mm:g} mm{along} (d/D ≥ {limit:.4f})"
        )
