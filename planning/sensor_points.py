"""Where many cameras image many points, and how their distortion stretches what is near a point.

Arrays run (states, points, viewpoints), so that the longest axis is the innermost: that is what
makes numpy fast here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.cameras import Cameras

#: Newton steps that the inversion of the distortion may take; two or three are usual.
_NEWTON_STEPS: Final = 50
#: Relative step at which it ends; the error is of the order of its square.
_SETTLED: Final = 1e-8
#: Distortion that bends by less than this share over the sensor folds nowhere.
_FOLDS: Final = 1e-12


@dataclass(frozen=True, eq=False)
class SensorPoints:
    """The image plane of S cameras.

    Parameters
    ----------
    cameras
        The cameras.
    """

    cameras: Cameras

    @cached_property
    def distorts(self) -> bool:
        """Whether any of the cameras has distortion."""
        return bool(self._radial.any()) or self._decentres

    def project(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Project points.

        Parameters
        ----------
        x, y
            (S or 1, N, V) coordinates over depth; NaN for what is not in front.

        Returns
        -------
        x_mm, y_mm : FloatArray
            (S, N, V) on the sensor, in mm from the principal point, distortion included; NaN for
            what is not in front, and beyond the radius at which the distortion folds.
        """
        distance = self._image_distance_mm
        if not self.distorts:
            return distance * x, distance * y
        if self._decentres:
            return self._one_by_one(x, y)
        ratio = self._ratio(x, y)
        ratio *= distance
        return ratio * x, ratio * y

    def stretch(
        self, x_mm: FloatArray, y_mm: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Differentiate the distorted point by the ideal one.

        Parameters
        ----------
        x_mm, y_mm
            (S, N, V) what `project` gives, in mm.

        Returns
        -------
        xx, xy, yx, yy : FloatArray
            (S, N, V) or broadcasting to it: derivatives of the distorted mm by x d and y d.
        """
        if not self.distorts:
            one, zero = np.ones((1, 1, 1)), np.zeros((1, 1, 1))
            return one, zero, zero, one
        # The model runs from distorted to undistorted: its Jacobian is inverted.
        squared = x_mm**2 + y_mm**2
        gain, slope = np.ones_like(squared), np.zeros_like(squared)
        for power, coefficient in enumerate(self._radial, 1):
            gain += coefficient * squared**power
            slope += 2 * power * coefficient * squared ** (power - 1)
        p1, p2 = self._decentring
        xx = gain + slope * x_mm**2 + 2 * p1 * y_mm + 6 * p2 * x_mm
        yy = gain + slope * y_mm**2 + 6 * p1 * y_mm + 2 * p2 * x_mm
        xy = slope * x_mm * y_mm + 2 * p1 * x_mm + 2 * p2 * y_mm
        determinant = xx * yy - xy**2
        return yy / determinant, -xy / determinant, -xy / determinant, xx / determinant

    def _ratio(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Distorted over undistorted radius; NaN beyond the fold.

        With g that ratio and k_i the coefficients times the undistorted radius to the power 2 i,
        g (1 + k_1 g² + k_2 g⁴ + …) = 1. For κ1 alone the start lies on the side from which Newton's
        method runs monotonically.
        """
        squared = (x**2 + y**2) * self._image_distance_mm**2
        scaled = [c * squared**power for power, c in enumerate(self._radial, 1)]
        first = sum(scaled[1:], start=scaled[0])
        ratio: FloatArray = 1.0 - first / (1.0 + np.maximum(first, 0.0))
        for _ in range(_NEWTON_STEPS):
            inner = ratio * ratio
            error, slope = self._polynomials(scaled, inner)
            error *= ratio
            error -= 1.0
            error /= slope
            ratio -= error
            np.abs(error, out=error)
            if not np.nanmax(error, initial=0.0) > _SETTLED:
                break
        if np.isfinite(self._reach_mm).any():
            ratio[np.broadcast_to(squared > self._reach_mm**2, ratio.shape)] = np.nan
        return ratio

    @staticmethod
    def _polynomials(scaled: list[FloatArray], inner: FloatArray) -> tuple[FloatArray, FloatArray]:
        """1 + Σ k_i g^2i, and 1 + Σ (2 i + 1) k_i g^2i."""
        if len(scaled) == 1:
            first = scaled[0] * inner
            slope = 3.0 * first
            slope += 1.0
            first += 1.0
            return first, slope
        value, slope = np.zeros_like(inner), np.zeros_like(inner)
        for power in range(len(scaled), 0, -1):
            value = (value + scaled[power - 1]) * inner
            slope = (slope + (2 * power + 1) * scaled[power - 1]) * inner
        return 1.0 + value, 1.0 + slope

    def _one_by_one(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        shape = np.broadcast_shapes(x.shape, (len(self.cameras), 1, 1))
        ideal = np.stack(np.broadcast_arrays(x, y), axis=-1)
        ideal = np.broadcast_to(ideal, (*shape, 2))
        points = np.stack(
            [c.distort(c.image_distance_mm * i) for c, i in zip(self.cameras, ideal, strict=True)]
        )
        return np.ascontiguousarray(points[..., 0]), np.ascontiguousarray(points[..., 1])

    @cached_property
    def _image_distance_mm(self) -> FloatArray:
        return self.cameras.image_distance_mm[:, None, None]

    @cached_property
    def _radial(self) -> FloatArray:
        """(K, S, 1, 1) coefficients of r², r⁴, and so on."""
        table = self.cameras.radial
        used = max(1, int(np.flatnonzero(table.any(axis=0)).max(initial=0)) + 1)
        return table[:, :used].T[:, :, None, None]

    @cached_property
    def _decentring(self) -> FloatArray:
        """(2, S, 1, 1) p1, p2."""
        return self.cameras.decentring.T[:, :, None, None]

    @cached_property
    def _decentres(self) -> bool:
        return bool(self._decentring.any())

    @cached_property
    def _reach_mm(self) -> FloatArray:
        """(S, 1, 1) undistorted radius that is imaged at the fold."""
        sensor = self.cameras.sensor
        if len(self._radial) == 1 and not self._decentres:
            # r (1 + κ1 r²) rises up to r² = −1/(3 κ1), where it is two thirds of r.
            k1 = self._radial[0]
            folds = -3 * k1 * np.hypot(sensor.width_mm, sensor.height_mm) ** 2 >= _FOLDS
            return np.where(folds, 2 / 3 / np.sqrt(np.where(folds, -3 * k1, 1.0)), np.inf)
        limits = [c.radius_limit_mm for c in self.cameras]
        reach = [
            limit if np.isinf(limit) else float(np.linalg.norm(c.undistort(np.array([limit, 0.0]))))
            for c, limit in zip(self.cameras, limits, strict=True)
        ]
        return np.array(reach)[:, None, None]
