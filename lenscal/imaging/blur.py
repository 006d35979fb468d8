"""Blur by the circle of confusion, whose size varies over the image."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray
from lenscal.camera import Camera
from lenscal.imaging.aperture import CUBIC_REACH, ROUND, Aperture, blur_kernel, convolved
from lenscal.imaging.ladder import (
    level_diameter_px,
    level_of,
    mean_pitch_mm,
    share_of_level,
)
from lenscal.imaging.texture import Float32Image

#: The image is blurred in tiles of this size, so that each one needs only the levels it shows.
_TILE_PX: Final = 128
#: Where the weight of a level differs by less than this over a tile, it is taken for the same.
_SAME_SHARE: Final = 1e-5


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


def signed_blur_mm(
    depth_mm: npt.ArrayLike,
    camera: Camera,
    object_distance_mm: float,
    entrance_pupil_diameter_mm: float,
    floor: BlurFloor,
) -> Float32Image:
    """Give the diameter of the blur on the sensor, a·d·|1/z − 1/D| with the floor in quadrature.

    Parameters
    ----------
    depth_mm
        (...) z of the points.
    camera
        Gives d; a blur larger than the diagonal of its frame is made as large as that.
    object_distance_mm
        D.
    entrance_pupil_diameter_mm
        a.
    floor
        What remains in the sharp plane.

    Returns
    -------
    Float32Image
        (...) diameters, negative for points nearer than the sharp plane.
    """
    image_distance_mm = camera.image_distance_mm
    defocus = (
        entrance_pupil_diameter_mm
        * image_distance_mm
        * (1 / object_distance_mm - 1 / np.asarray(depth_mm))
    )
    total = floor.add_to(defocus, image_distance_mm / entrance_pupil_diameter_mm)
    diagonal_mm = np.hypot(camera.sensor.width_mm, camera.sensor.height_mm)
    signed: Float32Image = np.copysign(np.minimum(total, diagonal_mm), defocus).astype(np.float32)
    return signed


def blur_margin_px(
    largest_mm: float, sample_pitch_mm: FloatArray, aperture: Aperture = ROUND
) -> tuple[int, int]:
    """Tell how far beyond a window the light that is blurred into it comes from.

    Parameters
    ----------
    largest_mm
        Largest diameter of the blur on the sensor.
    sample_pitch_mm
        (2,) spacing of samples along x and y.
    aperture
        Shape of the blur.

    Returns
    -------
    tuple of int
        Margin along x and y in px.
    """
    scale = mean_pitch_mm(sample_pitch_mm)
    widest_mm = level_diameter_px(math.floor(level_of(largest_mm / scale)) + 1) * scale
    x, y = (
        CUBIC_REACH + math.floor(aperture.reach * widest_mm / 2 / pitch)
        for pitch in sample_pitch_mm
    )
    return x, y


def blur(
    image: Float32Image,
    diameter_mm: Float32Image,
    sample_pitch_mm: FloatArray,
    aperture: Aperture = ROUND,
    cells_per_pixel: int = 1,
) -> Float32Image:
    """Blur an image by the shape of the iris, of a size that varies from pixel to pixel.

    A pixel's value is mixed from two images blurred by neighbouring diameters of a fixed ladder,
    in proportion to the squared diameter: the second moment of the blur is exact everywhere, and
    nothing depends on which part of the image is asked for.

    Parameters
    ----------
    image
        (n · (height + 2 · margin y), n · (width + 2 · margin x)) sharp cells, n of them along each
        side of a pixel, with the margins of `blur_margin_px` for the largest diameter.
    diameter_mm
        (height, width) diameter on the sensor; negative for points nearer than the sharp plane,
        which show the iris turned by half a turn.
    sample_pitch_mm
        (2,) spacing of samples along x and y; where they differ a disk is an ellipse of pixels.
    aperture
        Shape of the blur.
    cells_per_pixel
        n.

    Returns
    -------
    Float32Image
        (height, width) blurred pixels, each the mean of its cells.
    """
    n = cells_per_pixel
    phases = [np.ascontiguousarray(image[y::n, x::n]) for y in range(n) for x in range(n)]
    margins = tuple(
        (padded - inner) // 2
        for padded, inner in zip(phases[0].shape, diameter_mm.shape, strict=True)
    )
    blurred = np.zeros(diameter_mm.shape, np.float32)
    for rows, columns in _tiles(*diameter_mm.shape):
        tile = diameter_mm[rows, columns]
        out = blurred[rows, columns]
        near = np.signbit(tile)
        for shape, here in _sides(aperture, near):
            for kernel, share in _mixture(np.abs(tile), sample_pitch_mm, shape, n):
                for phase, part in zip(phases, _phase_kernels(kernel, n), strict=True):
                    out += _filtered(phase, part, (rows, columns), margins) * share * here
    return blurred


def _sides(aperture: Aperture, near: BoolArray) -> list[tuple[Aperture, BoolArray | bool]]:
    """Pair the iris and the iris turned with the pixels that show it so."""
    if aperture.turned == aperture or not near.any():
        return [(aperture, True)]
    if near.all():
        return [(aperture.turned, True)]
    return [(aperture, ~near), (aperture.turned, near)]


def _mixture(
    diameter_mm: Float32Image, sample_pitch_mm: FloatArray, aperture: Aperture, n: int
) -> list[tuple[Float32Image, Float32Image | float]]:
    """List the kernels of cells that a tile is blurred with, and the weight of each everywhere."""
    scale = mean_pitch_mm(sample_pitch_mm)
    diameter_px = diameter_mm / np.float32(scale)
    lowest, highest = (
        math.floor(level_of(extreme)) for extreme in (diameter_px.min(), diameter_px.max())
    )
    pitches = float(sample_pitch_mm[0]) / n, float(sample_pitch_mm[1]) / n
    levels = range(lowest, highest + 2)
    kernels = [blur_kernel(level_diameter_px(k) * scale, *pitches, aperture) for k in levels]
    shares = [share_of_level(k, diameter_px) for k in levels]
    if all(float(np.ptp(share)) < _SAME_SHARE for share in shares):
        one: Float32Image = np.zeros_like(kernels[-1])
        for kernel, share in zip(kernels, shares, strict=True):
            y, x = (
                (large - small) // 2 for large, small in zip(one.shape, kernel.shape, strict=True)
            )
            one[y : one.shape[0] - y, x : one.shape[1] - x] += kernel * share.flat[0]
        return [(one, 1.0)]
    return list(zip(kernels, shares, strict=True))


def _phase_kernels(kernel: Float32Image, n: int) -> list[Float32Image]:
    """Split a blur of cells, averaged over the n × n cells of a pixel, by place in the pixel.

    Cell (n p + s) of the image meets pixel i through tap n (i − p) + t − s of the blur, summed over
    the cells t of the pixel; so the cells at one place s are filtered on the grid of pixels.
    """
    reach_y, reach_x = (side // 2 for side in kernel.shape)
    rows, columns = ((reach + n - 1) // n for reach in (reach_y, reach_x))
    wide = np.zeros((2 * n * (rows + 1) + 1, 2 * n * (columns + 1) + 1))
    y, x = n * (rows + 1), n * (columns + 1)
    wide[y - reach_y : y + reach_y + 1, x - reach_x : x + reach_x + 1] = kernel
    parts = []
    for place_y in range(n):
        for place_x in range(n):
            part = np.zeros((2 * rows + 1, 2 * columns + 1))
            for cell_y in range(n):
                for cell_x in range(n):
                    top, left = n + cell_y - place_y, n + cell_x - place_x
                    part += wide[top::n, left::n][: 2 * rows + 1, : 2 * columns + 1]
            parts.append((part / n**2).astype(np.float32))
    return parts


def _tiles(height: int, width: int) -> Iterator[tuple[slice, slice]]:
    for top in range(0, height, _TILE_PX):
        for left in range(0, width, _TILE_PX):
            yield (
                slice(top, min(top + _TILE_PX, height)),
                slice(left, min(left + _TILE_PX, width)),
            )


def _filtered(
    image: Float32Image,
    kernel: Float32Image,
    tile: tuple[slice, slice],
    margins: tuple[int, ...],
) -> Float32Image:
    """Filter one tile, reading as far around it as the kernel reaches."""
    reach_y, reach_x = (side // 2 for side in kernel.shape)
    (rows, columns), (margin_y, margin_x) = tile, margins
    source = image[
        rows.start + margin_y - reach_y : rows.stop + margin_y + reach_y,
        columns.start + margin_x - reach_x : columns.stop + margin_x + reach_x,
    ]
    filtered = convolved(source, kernel, cv2.BORDER_CONSTANT)
    return filtered[reach_y : filtered.shape[0] - reach_y, reach_x : filtered.shape[1] - reach_x]
