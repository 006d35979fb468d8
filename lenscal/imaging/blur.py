"""Blur by the circle of confusion: a uniform disk whose size varies over the image."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.imaging.texture import Float32Image

#: Blur levels in px of diameter stand at A · sinh(k · h): half a pixel apart near sharpness, then
#: an eighth of the diameter apart. Between two levels, the images are mixed.
_STRETCH_PX: Final = 4.0
_STEP: Final = 0.125
#: The image is blurred in tiles of this size, so that each one needs only the levels it shows.
_TILE_PX: Final = 128
#: Pixels beyond the rim of the disk that cubic interpolation reaches.
_CUBIC_REACH: Final = 2
#: Diameter in px below which a disk is a point to double precision.
_POINT_PX: Final = 2e-3


@dataclass(frozen=True, slots=True)
class BlurFloor:
    """What remains of the blur in the sharp plane: diffraction and residual aberration.

    Parameters
    ----------
    wavelength_mm
        λ of the light; the diameter of the Airy disk is 2.44 λ N.
    aberration_mm
        Diameter of the aberration's spot on the sensor.
    """

    wavelength_mm: float = 0.55e-3
    aberration_mm: float = 0.004

    def add_to(self, defocus_mm: npt.ArrayLike, f_number: float) -> FloatArray:
        """Add the floor to the blur of defocus, in quadrature.

        Parameters
        ----------
        defocus_mm
            (...) diameter of the circle of confusion on the sensor.
        f_number
            Working f-number N = d/a, image distance over entrance-pupil diameter.

        Returns
        -------
        FloatArray
            (...) diameter of the whole blur on the sensor in mm.
        """
        airy_mm = 2.44 * self.wavelength_mm * f_number
        floor_squared = airy_mm**2 + self.aberration_mm**2
        total: FloatArray = np.sqrt(np.square(defocus_mm) + floor_squared)
        return total


def blur_margin_px(largest_mm: float, sample_pitch_mm: FloatArray) -> tuple[int, int]:
    """Tell how far beyond a window the light that is blurred into it comes from.

    Parameters
    ----------
    largest_mm
        Largest diameter of the blur on the sensor.
    sample_pitch_mm
        (2,) spacing of samples along x and y.

    Returns
    -------
    tuple of int
        Margin along x and y in px.
    """
    scale = _mean_pitch_mm(sample_pitch_mm)
    reach = _level_diameter_px(math.floor(_level(largest_mm / scale)) + 1) / 2 * scale
    x, y = (_CUBIC_REACH + math.floor(reach / pitch) for pitch in sample_pitch_mm)
    return x, y


def blur(image: Float32Image, diameter_mm: FloatArray, sample_pitch_mm: FloatArray) -> Float32Image:
    """Blur an image by a uniform disk of a diameter that varies from pixel to pixel.

    A pixel's value is mixed from two images blurred by neighbouring diameters of a fixed ladder,
    in proportion to the squared diameter: the second moment of the blur is exact everywhere, and
    nothing depends on which part of the image is asked for.

    Parameters
    ----------
    image
        (height + 2 · margin y, width + 2 · margin x) sharp pixels, with the margins of
        `blur_margin_px` for the largest diameter.
    diameter_mm
        (height, width) diameter on the sensor.
    sample_pitch_mm
        (2,) spacing of samples along x and y; where they differ the disk is an ellipse of pixels.

    Returns
    -------
    Float32Image
        (height, width) blurred pixels.
    """
    scale = _mean_pitch_mm(sample_pitch_mm)
    margin_x, margin_y = (
        (padded - inner) // 2
        for padded, inner in zip(image.shape[::-1], diameter_mm.shape[::-1], strict=True)
    )
    diameter_px = diameter_mm / scale
    level = _level(diameter_px)
    blurred = np.zeros(diameter_mm.shape, np.float32)
    for tile in _tiles(*diameter_mm.shape):
        lowest, highest = math.floor(level[tile].min()), math.floor(level[tile].max()) + 1
        for k in range(lowest, highest + 1):
            kernel = disk_kernel(_level_diameter_px(k) * scale, *map(float, sample_pitch_mm))
            share = _share_of_level(k, diameter_px[tile])
            blurred[tile] += share * _filtered(image, kernel, tile, margin_x, margin_y)
    return blurred


@lru_cache(maxsize=256)
def disk_kernel(diameter_mm: float, pitch_x_mm: float, pitch_y_mm: float) -> Float32Image:
    """Give the weights of pixels that blur an image by a uniform disk.

    The disk is integrated over a cubic interpolation (Keys, 1981) of the pixels, which reproduces
    parabolas: whatever the diameter, the weights sum to 1 and their second moments are those of the
    disk, diameter²/16. Sampling the disk itself would add the size of a pixel to it.

    Parameters
    ----------
    diameter_mm
        Diameter of the disk.
    pitch_x_mm, pitch_y_mm
        Spacing of samples.

    Returns
    -------
    Float32Image
        (rows, columns), both odd.
    """
    radius_x, radius_y = (
        max(diameter_mm / pitch, _POINT_PX) / 2 for pitch in (pitch_x_mm, pitch_y_mm)
    )
    taps_x, taps_y = (
        np.arange(-n, n + 1) for n in (int(r) + _CUBIC_REACH for r in (radius_x, radius_y))
    )
    # Rows of the disk by Gauss-Chebyshev quadrature; along a row, the chord exactly.
    count = 64 + 8 * math.ceil(radius_y)
    angle = np.pi * np.arange(1, count + 1)[:, None] / (count + 1)
    share = 2 / (count + 1) * np.sin(angle) ** 2
    half_chord = radius_x * np.sin(angle)
    along_x = _cubic_integral(half_chord - taps_x) - _cubic_integral(-half_chord - taps_x)
    along_y = _cubic(radius_y * np.cos(angle) - taps_y)
    kernel = (share * along_y).T @ (along_x / (2 * half_chord))
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


def _filtered(
    image: Float32Image,
    kernel: Float32Image,
    tile: tuple[slice, slice],
    margin_x: int,
    margin_y: int,
) -> Float32Image:
    """Filter one tile, reading as far around it as the kernel reaches."""
    reach_y, reach_x = (side // 2 for side in kernel.shape)
    rows, columns = tile
    source = image[
        rows.start + margin_y - reach_y : rows.stop + margin_y + reach_y,
        columns.start + margin_x - reach_x : columns.stop + margin_x + reach_x,
    ]
    filtered = cv2.filter2D(source, cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT)
    inner = filtered[reach_y : filtered.shape[0] - reach_y, reach_x : filtered.shape[1] - reach_x]
    return np.asarray(inner, dtype=np.float32)


def _share_of_level(k: int, diameter_px: FloatArray) -> Float32Image:
    """Tell how much of blur level k a diameter is: a tent over the squared diameter."""
    below, here, above = (_level_diameter_px(i) ** 2 for i in (k - 1, k, k + 1))
    squared = np.square(diameter_px)
    falling = (above - squared) / (above - here)
    if k == 0:
        share = falling
    else:
        share = np.where(squared < here, (squared - below) / (here - below), falling)
    return np.clip(share, 0.0, 1.0).astype(np.float32)


def _level(diameter_px: npt.ArrayLike) -> FloatArray:
    level: FloatArray = np.arcsinh(np.asarray(diameter_px) / _STRETCH_PX) / _STEP
    return level


def _level_diameter_px(level: int) -> float:
    return _STRETCH_PX * math.sinh(level * _STEP)


def _mean_pitch_mm(sample_pitch_mm: FloatArray) -> float:
    return float(np.sqrt(np.prod(sample_pitch_mm)))


def _tiles(height: int, width: int) -> Iterator[tuple[slice, slice]]:
    for top in range(0, height, _TILE_PX):
        for left in range(0, width, _TILE_PX):
            yield (
                slice(top, min(top + _TILE_PX, height)),
                slice(left, min(left + _TILE_PX, width)),
            )


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
