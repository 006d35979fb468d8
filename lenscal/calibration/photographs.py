"""One camera from a folder of photographs: detect, choose the distortion terms, calibrate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.calibration.calibration import Calibration
from lenscal.calibration.distortion_choice import DistortionModel, choose_distortion
from lenscal.calibration.refine import calibrate_views
from lenscal.detection import detect
from lenscal.document import Json
from lenscal.errors import DetectionError
from lenscal.sensor import Sensor
from lenscal.target import Target

#: Pitch that stands in for an unknown one; nothing in mm on the sensor is told then.
_STAND_IN_PITCH_MM: Final = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class PhotographCalibration:
    """A camera calibrated from photographs.

    Parameters
    ----------
    calibration
        The result; its views are those of `names`.
    names
        Photographs in which the target was found.
    without_target
        Photographs in which it was not.
    model
        The distortion terms that were estimated.
    pitch_mm
        The pitch of the sensor, or None when it is not known; image lengths in mm are then
        meaningless.
    """

    calibration: Calibration
    names: tuple[str, ...]
    without_target: tuple[str, ...]
    model: DistortionModel
    pitch_mm: float | None

    def summary(self) -> Json:
        """Tell everything in the units of the image, and in mm where the pitch is known.

        Distortion is that of image coordinates divided by d, distorted to undistorted, so that it
        does not depend on the pitch.

        Returns
        -------
        dict
            What JSON can hold.
        """
        calibration = self.calibration
        camera, pitch = calibration.camera, calibration.camera.sensor.pitch_x_mm
        distortion, sigma = _normalised_distortion(calibration, self.model)
        sigma |= {
            "focal_length_px": calibration.sigma("image_distance_mm") / pitch,
            "principal_point_x_px": calibration.sigma("principal_point_x_px"),
            "principal_point_y_px": calibration.sigma("principal_point_y_px"),
        }
        body: Json = {
            "focal_length_px": camera.image_distance_mm / pitch,
            "principal_point_px": camera.centre_px.tolist(),
            "distortion": distortion,
            "rms_px": calibration.rms_px,
            "noise_px": calibration.noise_px,
            "sigma": sigma,
            "image_size_px": [camera.sensor.width_px, camera.sensor.height_px],
            "views": list(self.names),
            "corners": sum(int(used.sum()) for used in calibration.inliers),
            "rejected": [
                *(
                    {"view": name, "reason": "the target was not found"}
                    for name in self.without_target
                ),
                *(
                    {
                        "view": self.names[r.view],
                        "point": r.point,
                        "residual_px": r.residual_px if np.isfinite(r.residual_px) else None,
                        "reason": r.reason,
                    }
                    for r in calibration.rejected
                ),
            ],
            "warnings": list(calibration.warnings),
        }
        if self.pitch_mm is not None:
            body["image_distance_mm"] = camera.image_distance_mm
            body["k1_per_mm2"] = camera.k1_per_mm2
            for name in ("image_distance_mm", "k1_per_mm2"):
                sigma[name] = calibration.sigma(name)
        return body


def calibrate_photographs(
    images: list[tuple[str, npt.NDArray[np.uint8]]], target: Target, pitch_mm: float | None = None
) -> PhotographCalibration:
    """Calibrate from photographs of a target.

    Parameters
    ----------
    images
        Names and (rows, columns) grey values, all of one size.
    target
        What they show.
    pitch_mm
        Pitch of the (square) pixels, or None when it is not known.

    Returns
    -------
    PhotographCalibration
        The camera, and what was made of each photograph.

    Raises
    ------
    DetectionError
        When the target is in none of them.
    """
    found, without = {}, []
    for name, image in images:
        try:
            found[name] = detect(image, target)
        except DetectionError:
            without.append(name)
    if not found:
        raise DetectionError(
            f"{target.spec} was found in none of the {len(images)} images; check the counts (a "
            "chessboard is counted in inner corners) and that the whole target is in the picture"
        )
    rows, columns = images[0][1].shape
    pitch = _STAND_IN_PITCH_MM if pitch_mm is None else pitch_mm
    sensor = Sensor(columns, rows, pitch, pitch)
    points = [observation.points_mm for observation in found.values()]
    pixels = [observation.pixels for observation in found.values()]
    model = choose_distortion(points, pixels, sensor)
    calibration = calibrate_views(
        points,
        pixels,
        sensor,
        focus_view=None,
        radial_terms=model.radial_terms,
        decentring=model.decentring,
    )
    return PhotographCalibration(calibration, tuple(found), tuple(without), model, pitch_mm)


def _normalised_distortion(
    calibration: Calibration, model: DistortionModel
) -> tuple[dict[str, float], dict[str, float]]:
    """Coefficients times the power of d that makes them pure numbers, with σ."""
    camera, distance = calibration.camera, calibration.image_distance_mm
    known = {
        f"k{i}": (f"k{i}_per_mm{2 * i}", coefficient, 2 * i)
        for i, coefficient in enumerate((camera.k1_per_mm2, *camera.radial), 1)
    }
    if model.decentring:
        known |= {
            f"p{i}": (f"p{i}_per_mm", coefficient, 1)
            for i, coefficient in enumerate(camera.decentring, 1)
        }
    values, sigma = {}, {}
    for name, (quantity, coefficient, power) in known.items():
        values[name] = coefficient * distance**power
        gradient = np.array([distance**power, power * coefficient * distance ** (power - 1)])
        covariance = calibration.covariance([quantity, "image_distance_mm"])
        sigma[name] = float(np.sqrt(gradient @ covariance @ gradient))
    return values, sigma
