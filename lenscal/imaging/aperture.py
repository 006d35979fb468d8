"""The shape of the iris, which every blurred point of light takes on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.errors import InputError

#: Pixels beyond the rim of the blur that cubic interpolation reaches.
CUBIC_REACH: Final = 2
#: Diameter in px below which a blur is a point to double precision.
_POINT_PX: Final = 2e-3


@dataclass(frozen=True, slots=True)
class Aperture:
    """A round iris, or one of straight blades.

    Parameters
    ----------
    blades
        0 for a round iris, otherwise the number of corners. The polygon has the area of the disk
        whose diameter is stated: it lets as much light pass.
    rotation
        Angle of the first corner from the x axis of the image towards y, in radians, as points
        beyond the sharp plane show it. Nearer points show the polygon turned by half a turn.

    Raises
    ------
    InputError
        When there are one or two blades, or fewer than none.
    """

    blades: int = 0
    rotation: float = 0.0

    def __post_init__(self) -> None:
        if self.blades not in (0, *range(3, 100)):
            raise InputError(
                f"an iris has 0 blades (round) or 3 to 99, but {self.blades} are given"
            )

    @property
    def reach(self) -> float:
        """Radius of the farthest corner over that of the disk of the same area."""
        if not self.blades:
            return 1.0
        step = 2 * math.pi / self.blades
        return math.sqrt(step / math.sin(step))

    @property
    def turned(self) -> Aperture:
        """The iris turned by half a turn."""
        if self.blades % 2 == 0:
            return self
        return Aperture(self.blades, (self.rotation + math.pi) % (2 * math.pi))

    def chords(self, count: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Cut the shape of a disk of radius 1, or of its polygon, into lines along x.

        Parameters
        ----------
        count
            How many lines, for a polygon between any two corners.

        Returns
        -------
        y, left, right, weight : FloatArray
            (N,) height and ends of each line, and the share of dy that it stands for: integrals
            over y are sums with these weights, by Gauss's quadrature.
        """
        if not self.blades:
            angle = np.pi * np.arange(1, count + 1) / (count + 1)
            half = np.sin(angle)
            return np.cos(angle), -half, half, np.pi / (count + 1) * half
        corner = self.rotation + 2 * np.pi / self.blades * np.arange(self.blades)
        x, y = self.reach * np.cos(corner), self.reach * np.sin(corner)
        borders = np.unique(np.round(y, 12))
        node, share = np.polynomial.legendre.leggauss(count)
        half_heights = np.diff(borders)[:, None] / 2
        heights = (borders[:-1, None] + half_heights * (1 + node)).ravel()
        # Every line crosses two sides of the convex polygon.
        x_next, y_next = np.roll(x, -1), np.roll(y, -1)
        crossed = (np.minimum(y, y_next) <= heights[:, None]) & (
            heights[:, None] < np.maximum(y, y_next)
        )
        rise = np.where(y_next == y, 1.0, y_next - y)
        crossing = x + (heights[:, None] - y) / rise * (x_next - x)
        left = np.where(crossed, crossing, np.inf).min(axis=1)
        right = np.where(crossed, crossing, -np.inf).max(axis=1)
        return heights, left, right, (half_heights * share).ravel()


#: An iris without corners.
ROUND: Final = Aperture()


@lru_cache(maxsize=256)
def blur_kernel(
    diameter_mm: float, pitch_x_mm: float, pitch_y_mm: float, aperture: Aperture = ROUND
) -> npt.NDArray[np.float32]:
    """Give the weights of pixels that blur an image by the shape of an iris.

    The shape is integrated over a cubic interpolation (Keys, 1981) of the pixels, which reproduces
    parabolas: whatever the diameter, the weights sum to 1 and their second moments are those of the
    shape, diameter²/16 for a disk. Sampling the disk itself would add the size of a pixel to it.

    Parameters
    ----------
    diameter_mm
        Diameter of the disk, or of the disk of the same area as the polygon.
    pitch_x_mm, pitch_y_mm
        Spacing of samples.
    aperture
        The shape.

    Returns
    -------
    npt.NDArray[np.float32]
        (rows, columns), both odd.
    """
    radius_x, radius_y = (
        max(diameter_mm / pitch, _POINT_PX) / 2 for pitch in (pitch_x_mm, pitch_y_mm)
    )
    taps_x, taps_y = (
        np.arange(-n, n + 1)
        for n in (int(r * aperture.reach) + CUBIC_REACH for r in (radius_x, radius_y))
    )
    y, left, right, weight = (v[:, None] for v in aperture.chords(64 + 8 * math.ceil(radius_y)))
    # Along a line the integral is exact.
    along_x = _cubic_integral(radius_x * right - taps_x) - _cubic_integral(radius_x * left - taps_x)
    along_y = weight * _cubic(radius_y * y - taps_y)
    kernel = along_y.T @ along_x
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


def convolved(
    image: npt.NDArray[np.float32], kernel: npt.NDArray[np.float32], border: int
) -> npt.NDArray[np.float32]:
    """Put the kernel in the place of every pixel.

    Parameters
    ----------
    image
        (rows, columns).
    kernel
        (rows, columns), both odd.
    border
        OpenCV's code for what lies beyond the image.

    Returns
    -------
    npt.NDArray[np.float32]
        (rows, columns).
    """
    # OpenCV correlates, which is to convolve with the kernel turned by half a turn.
    filtered = cv2.filter2D(image, cv2.CV_32F, kernel[::-1, ::-1], borderType=border)
    return np.asarray(filtered, dtype=np.float32)


def _cubic(x: FloatArray) -> FloatArray:
    """Interpolate as Keys does: the cubic convolution kernel with slope −1/2."""
    x = np.abs(x)
    near = (1.5 * x - 2.5) * x**2 + 1
    far = ((-0.5 * x + 2.5) * x - 4) * x + 2
    weight: FloatArray = np.where(x < 1, near, np.where(x < 2, far, 0.0))
    return weight


def _cubic_integral(x: FloatArray) -> FloatArray:
    """Integrate `_cubic` from 0 to x."""
    size = np.minimum(np.abs(x), 2.0)
    near = ((0.375 * size - 2.5 / 3) * size**2 + 1) * size
    far = (((-0.125 * size + 2.5 / 3) * size - 2) * size + 2) * size - 1 / 6
    integral: FloatArray = np.copysign(np.where(size < 1, near, far), x)
    return integral
