"""The camera at one lens setting: Tsai's model, both ways.

Distortion maps *distorted to undistorted* sensor millimetres (D-U), as Tsai's κ1 and OpenTrackIO's
"Brown-Conrady D-U" do::

    undistorted = distorted · (1 + κ1 r² + radial[0] r⁴ + radial[1] r⁶ + …) + decentring terms,
    decentring terms = (2 p1 x y + p2 (r² + 2 x²),  p1 (r² + 2 y²) + 2 p2 x y),

with x, y and r = |(x, y)| in distorted mm from the principal point. So pixels become rays in closed
form, and projection inverts the polynomial.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from lenscal.arrays import FloatArray, frozen_array, positive
from lenscal.sensor import Sensor

#: Newton steps that the inversion of the distortion may take; it converges quadratically.
_NEWTON_STEPS: Final = 30
#: Grid points per side on which the conversion to OpenCV is fitted and judged.
_GRID: Final = 25


class OpenCVCamera(NamedTuple):
    """A camera in OpenCV's terms, whose distortion maps undistorted to distorted.

    Parameters
    ----------
    matrix
        (3, 3) camera matrix in px.
    distortion
        (5,) k1, k2, p1, p2, k3 of normalised coordinates.
    worst_error_px
        Largest distance on the sensor between this fit and the camera it was made from.
    """

    matrix: FloatArray
    distortion: FloatArray
    worst_error_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole with distortion, in its own frame: x right, y down, z along the axis to the scene.

    Parameters
    ----------
    sensor
        The sensor and its frame buffer.
    image_distance_mm
        d: what OpenCV, ROS and others call focal length, there in px.
    k1_per_mm2
        κ1 of Tsai's distortion in mm⁻².
    principal_point_px
        (2,) where the axis meets the image, in px; None for the centre of the frame buffer.
    radial
        Further radial coefficients, of r⁴ (mm⁻⁴), r⁶ (mm⁻⁶), and so on.
    decentring
        p1, p2 in mm⁻¹.

    Raises
    ------
    InputError
        When the image distance is not positive, or a value is not finite.
    """

    sensor: Sensor
    image_distance_mm: float
    k1_per_mm2: float = 0.0
    principal_point_px: FloatArray | None = None
    radial: tuple[float, ...] = ()
    decentring: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        point = (
            self.sensor.centre_px if self.principal_point_px is None else self.principal_point_px
        )
        coefficients = frozen_array("distortion", [self.k1_per_mm2, *self.radial], ("N",))
        decentring = frozen_array("decentring", self.decentring, (2,))
        for name, value in {
            "image_distance_mm": positive("image_distance_mm", self.image_distance_mm, "mm"),
            "k1_per_mm2": float(coefficients[0]),
            "principal_point_px": frozen_array("principal_point_px", point, (2,)),
            "radial": tuple(float(c) for c in coefficients[1:]),
            "decentring": (float(decentring[0]), float(decentring[1])),
        }.items():
            object.__setattr__(self, name, value)

    @property
    def centre_px(self) -> FloatArray:
        """(2,) principal point in px, whether it was stated or not."""
        point = self.principal_point_px
        return self.sensor.centre_px if point is None else point

    @property
    def image_distance_px(self) -> FloatArray:
        """(2,) d over the sample pitch along x and y: f_x, f_y of other programs."""
        pixels: FloatArray = self.image_distance_mm / self.sensor.sample_pitch_mm
        return pixels

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) camera matrix in px, without distortion."""
        matrix = np.diag([*self.image_distance_px, 1.0])
        matrix[:2, 2] = self.centre_px
        return matrix

    @property
    def radius_limit_mm(self) -> float:
        """Distorted radius up to which the radial polynomial rises, so that it can be inverted."""
        slope = np.array(
            [(2 * i + 1) * c for i, c in enumerate((self.k1_per_mm2, *self.radial), 1)]
        )
        # In units of the sensor's diagonal, terms too small to matter drop out of the polynomial.
        scale = np.hypot(self.sensor.width_mm, self.sensor.height_mm) ** 2
        slope = np.concatenate([[1.0], slope * scale ** np.arange(1, len(slope) + 1)])
        slope[np.abs(slope) < 1e-12] = 0.0
        roots = np.roots(slope[::-1])
        real = roots[np.abs(roots.imag) < 1e-12 * np.abs(roots)].real
        rising = real[real > 0]
        return float(np.sqrt(scale * rising.min())) if len(rising) else np.inf

    def project(self, points_camera_mm: npt.ArrayLike) -> FloatArray:
        """Project points to pixels.

        Parameters
        ----------
        points_camera_mm
            (..., 3) points in the camera frame in mm.

        Returns
        -------
        FloatArray
            (..., 2) pixels (x, y), on the sensor or beyond it; NaN for points that are not in front
            of the projection centre, and for those beyond the radius at which the distortion folds.
        """
        points = frozen_array("points_camera_mm", points_camera_mm, ("...", 3), finite=False)
        depth = points[..., 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            ideal = np.where(depth > 0, self.image_distance_mm * points[..., :2] / depth, np.nan)
        return self._to_pixels(self.distort(ideal))

    def unproject(self, pixels: npt.ArrayLike) -> FloatArray:
        """Turn pixels into rays from the projection centre.

        Parameters
        ----------
        pixels
            (..., 2) pixels (x, y).

        Returns
        -------
        FloatArray
            (..., 3) unit vectors in the camera frame. Beyond the radius at which the distortion
            folds they are still computed, although `project` refuses to come back from there.
        """
        points = frozen_array("pixels", pixels, ("...", 2), finite=False)
        ideal = self.undistort((points - self.centre_px) * self.sensor.sample_pitch_mm)
        depth = np.full((*ideal.shape[:-1], 1), self.image_distance_mm)
        rays = np.concatenate([ideal, depth], axis=-1)
        unit: FloatArray = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return unit

    def undistort(self, distorted_mm: npt.ArrayLike) -> FloatArray:
        """Map distorted to undistorted sensor coordinates, in closed form.

        Parameters
        ----------
        distorted_mm
            (..., 2) mm from the principal point.

        Returns
        -------
        FloatArray
            (..., 2) mm from the principal point.
        """
        xy = np.asarray(distorted_mm, dtype=np.float64)
        squared = (xy**2).sum(axis=-1, keepdims=True)
        undistorted: FloatArray = xy * self._gain(squared)
        if any(self.decentring):
            undistorted = undistorted + self._decentring_terms(xy, squared)
        return undistorted

    def distort(self, undistorted_mm: npt.ArrayLike) -> FloatArray:
        """Map undistorted to distorted sensor coordinates, the inverse of `undistort`.

        Parameters
        ----------
        undistorted_mm
            (..., 2) mm from the principal point.

        Returns
        -------
        FloatArray
            (..., 2) mm from the principal point; NaN where the radial polynomial never gets to.
        """
        ideal = np.asarray(undistorted_mm, dtype=np.float64)
        distorted = self._distort_radially(ideal)
        if not any(self.decentring):
            return distorted
        # Decentring is a small correction of the radial inverse: the iteration contracts.
        for _ in range(_NEWTON_STEPS):
            squared = (distorted**2).sum(axis=-1, keepdims=True)
            last = distorted
            distorted = self._distort_radially(ideal - self._decentring_terms(distorted, squared))
            if not np.nanmax(np.abs(distorted - last), initial=0.0) > 1e-15 * self.sensor.width_mm:
                break
        return distorted

    def to_opencv(self) -> OpenCVCamera:
        """Convert to OpenCV's model, whose distortion runs the other way, by a fit over the sensor.

        Returns
        -------
        OpenCVCamera
            Matrix, distortion and the worst error of the conversion in px.
        """
        across = np.linspace(-0.5, self.sensor.width_px - 0.5, _GRID)
        down = np.linspace(-0.5, self.sensor.height_px - 0.5, _GRID)
        pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
        distorted = (pixels - self.centre_px) * self.sensor.sample_pitch_mm / self.image_distance_mm
        ideal = self.undistort(distorted * self.image_distance_mm) / self.image_distance_mm
        x, y = ideal.T
        squared = x**2 + y**2
        # Distorted minus ideal is linear in k1, k2, p1, p2, k3.
        columns_x = [x * squared, x * squared**2, 2 * x * y, squared + 2 * x**2, x * squared**3]
        columns_y = [y * squared, y * squared**2, squared + 2 * y**2, 2 * x * y, y * squared**3]
        design = np.concatenate([np.stack(columns_x, -1), np.stack(columns_y, -1)])
        wanted = (distorted - ideal).T.ravel()
        scale = np.linalg.norm(design, axis=0)
        coefficients = np.linalg.lstsq(design / scale, wanted, rcond=None)[0] / scale
        error = (design @ coefficients - wanted).reshape(2, -1).T * self.image_distance_px
        return OpenCVCamera(self.matrix, coefficients, float(np.linalg.norm(error, axis=-1).max()))

    @classmethod
    def from_opencv(
        cls, matrix: npt.ArrayLike, distortion: npt.ArrayLike, sensor: Sensor, terms: int = 2
    ) -> Camera:
        """Convert from OpenCV's model by a fit over the sensor.

        Parameters
        ----------
        matrix
            (3, 3) camera matrix in px. The mean of f_x · pitch_x and f_y · pitch_y becomes d.
        distortion
            k1, k2, p1, p2[, k3] of normalised coordinates; may be empty.
        sensor
            The sensor.
        terms
            How many radial terms the camera gets, κ1 included.

        Returns
        -------
        Camera
            The camera.
        """
        full = frozen_array("matrix", matrix, (3, 3))
        stated = frozen_array("distortion", np.ravel(np.asarray(distortion)), ("N",))
        k1, k2, p1, p2, k3 = (*stated, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        distance = float(np.mean(np.diag(full)[:2] * sensor.sample_pitch_mm))
        corner = np.array([sensor.width_mm, sensor.height_mm]) / 2 / distance
        x, y = (
            np.stack(np.meshgrid(*(np.linspace(-c, c, _GRID) for c in corner)), axis=-1)
            .reshape(-1, 2)
            .T
        )
        squared = x**2 + y**2
        gain = 1 + k1 * squared + k2 * squared**2 + k3 * squared**3
        ideal = np.stack([x, y], -1) * distance
        distorted = distance * np.stack(
            [
                x * gain + 2 * p1 * x * y + p2 * (squared + 2 * x**2),
                y * gain + p1 * (squared + 2 * y**2) + 2 * p2 * x * y,
            ],
            axis=-1,
        )
        scale = np.array([np.max(np.abs(distorted)) ** -(2 * i) for i in range(1, terms + 1)])

        def camera(parameters: FloatArray) -> Camera:
            radial = parameters[:terms] * scale
            return cls(
                sensor,
                distance,
                float(radial[0]),
                full[:2, 2],
                tuple(radial[1:]),
                (float(parameters[terms]), float(parameters[terms + 1])),
            )

        def misfit(parameters: FloatArray) -> FloatArray:
            return (camera(parameters).undistort(distorted) - ideal).ravel()

        fit = least_squares(misfit, np.zeros(terms + 2))
        return camera(fit.x)

    def _gain(self, squared: FloatArray) -> FloatArray:
        gain = np.zeros_like(squared)
        for coefficient in (self.k1_per_mm2, *self.radial)[::-1]:
            gain = (gain + coefficient) * squared
        total: FloatArray = 1.0 + gain
        return total

    def _decentring_terms(self, xy: FloatArray, squared: FloatArray) -> FloatArray:
        p1, p2 = self.decentring
        product = 2 * xy[..., :1] * xy[..., 1:]
        terms: FloatArray = np.concatenate(
            [
                p1 * product + p2 * (squared + 2 * xy[..., :1] ** 2),
                p1 * (squared + 2 * xy[..., 1:] ** 2) + p2 * product,
            ],
            axis=-1,
        )
        return terms

    def _distort_radially(self, ideal: FloatArray) -> FloatArray:
        if not self.k1_per_mm2 and not any(self.radial):
            return ideal
        wanted = np.linalg.norm(ideal, axis=-1, keepdims=True)
        limit = self.radius_limit_mm
        reach = np.inf if np.isinf(limit) else limit * float(self._gain(np.array(limit**2)))
        target = np.where(wanted <= reach, wanted, np.nan)
        slope_factors = [
            (2 * i + 1) * c for i, c in enumerate((1.0, self.k1_per_mm2, *self.radial))
        ]
        radius = np.minimum(target, 0.999 * limit)
        for _ in range(_NEWTON_STEPS):
            squared = radius**2
            slope = np.polynomial.polynomial.polyval(squared, slope_factors)
            with np.errstate(invalid="ignore", divide="ignore"):
                step = (radius * self._gain(squared) - target) / slope
            updated = np.clip(radius - step, 0.0, limit)
            moved = np.nanmax(np.abs(updated - radius), initial=0.0)
            radius = updated
            if not moved > 1e-15 * self.sensor.width_mm:
                break
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(wanted > 0, radius / wanted, 1.0)
        distorted: FloatArray = ideal * ratio
        return distorted

    def _to_pixels(self, distorted_mm: FloatArray) -> FloatArray:
        pixels: FloatArray = distorted_mm / self.sensor.sample_pitch_mm + self.centre_px
        return pixels

    def __repr__(self) -> str:
        c_x, c_y = self.centre_px
        return (
            f"Camera(d {self.image_distance_mm:.6g} mm, κ1 {self.k1_per_mm2:.4g} /mm², "
            f"principal point ({c_x:.2f}, {c_y:.2f}) px, {self.sensor.width_px} × "
            f"{self.sensor.height_px} px)"
        )
