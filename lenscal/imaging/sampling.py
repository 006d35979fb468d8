"""The sharp image of a flat target: every pixel the mean over its area on the plane."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import cv2
import numpy as np

from lenscal.arrays import FloatArray
from lenscal.artwork import Artwork
from lenscal.camera import Camera
from lenscal.imaging.plane_mapping import PlanePoints, points_on_plane
from lenscal.imaging.texture import Box, Float32Image, TargetSurface, Texture
from lenscal.pose import Pose
from lenscal.sensor import Window

#: Samples per pixel along each axis.
SAMPLES_PER_PIXEL: Final = 4
#: Cells per pixel along each axis that are kept apart until the blur has been applied: an edge that
#: runs along the pixels would else carry the same error all along.
CELLS_PER_PIXEL: Final = 2

#: The image is drawn in blocks of this many px a side, so that texture and samples of a block stay
#: in the cache, and memory does not grow with the image.
_BLOCK_PX: Final = 192


def sharp_image(
    camera: Camera, camera_from_target: Pose, surface: TargetSurface, window: Window
) -> tuple[Float32Image, Float32Image]:
    """Integrate a surface over the cells of every pixel, as a lens without any blur would.

    Rays are followed exactly at the centres of pixels; within a pixel the mapping is linear, which
    is true to 1e-4 px.

    Parameters
    ----------
    camera
        The camera.
    camera_from_target
        Where the target is.
    surface
        What it looks like.
    window
        The pixels; they may lie beyond the sensor.

    Returns
    -------
    irradiance : Float32Image
        (height · `CELLS_PER_PIXEL`, width · `CELLS_PER_PIXEL`).
    depth_mm : Float32Image
        (height, width) z of the plane in the camera frame, infinite where the ray of a pixel does
        not meet it.
    """
    n = CELLS_PER_PIXEL
    image = np.full((window.height * n, window.width * n), surface.surroundings, np.float32)
    depth_mm = np.zeros((window.height, window.width), np.float32)
    for block in _blocks_of(window):
        rows = slice(block.top - window.top, block.top - window.top + block.height)
        columns = slice(block.left - window.left, block.left - window.left + block.width)
        with_rim = Window(block.left - 1, block.top - 1, block.width + 2, block.height + 2)
        seen = points_on_plane(camera, camera_from_target, with_rim)
        depth_mm[rows, columns] = seen.depth_mm[1:-1, 1:-1]
        part = _box_around(seen)
        if part is not None and surface.meets(part):
            pixel_mm = _pixel_mm(camera, camera_from_target, block)
            texture = surface.texture(part, pixel_mm / SAMPLES_PER_PIXEL)
            cells = slice(rows.start * n, rows.stop * n), slice(columns.start * n, columns.stop * n)
            image[cells] = _cells(surface, texture, seen.position_mm)
    return image, depth_mm


def _blocks_of(window: Window) -> Iterator[Window]:
    """Cut a window along a grid that is fixed to the sensor: a part shows what the whole shows."""
    right, bottom = window.left + window.width, window.top + window.height
    for top in _cuts(window.top, bottom):
        for left in _cuts(window.left, right):
            yield Window(
                left,
                top,
                min(_next_cut(left), right) - left,
                min(_next_cut(top), bottom) - top,
            )


def _cuts(first: int, last: int) -> Iterator[int]:
    while first < last:
        yield first
        first = _next_cut(first)


def _next_cut(first: int) -> int:
    return (first // _BLOCK_PX + 1) * _BLOCK_PX


def _cells(surface: TargetSurface, texture: Texture, position_mm: FloatArray) -> Float32Image:
    """Average the samples of every cell; the points of pixels come with a rim of one pixel."""
    samples_at = _samples_at(position_mm, texture)
    # Of a cell, `paper` is the share that is white paper and `sheet` the share on the sheet.
    paper = _mean_of_samples(texture.paper, samples_at)
    image = np.float32((1 - surface.ink) / 255) * paper
    if texture.sheet is None:
        return np.asarray(image + np.float32(surface.ink), dtype=np.float32)
    sheet = _mean_of_samples(texture.sheet, samples_at)
    beyond = np.float32((surface.ink - surface.surroundings) / 255) * sheet
    return np.asarray(image + beyond + np.float32(surface.surroundings), dtype=np.float32)


def _samples_at(position_mm: FloatArray, texture: Texture) -> Float32Image:
    """Spread samples evenly over the pixels, in texel coordinates; the rim is dropped."""
    n = SAMPLES_PER_PIXEL
    texels = ((position_mm - texture.origin_mm) * texture.texels_per_mm).astype(np.float32)
    rows, columns = position_mm.shape[:2]
    fine = cv2.resize(texels, (columns * n, rows * n), interpolation=cv2.INTER_LINEAR)
    return np.asarray(fine[n:-n, n:-n], dtype=np.float32)


def _mean_of_samples(texture: Artwork, samples_at: Float32Image) -> Float32Image:
    n = SAMPLES_PER_PIXEL // CELLS_PER_PIXEL
    samples = cv2.remap(  # type: ignore[call-overload]  # OpenCV takes one map, its types do not
        texture,
        samples_at,
        None,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    rows, columns = samples.shape
    size = columns // n, rows // n
    means = cv2.resize(samples.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(means, dtype=np.float32)


def _box_around(seen: PlanePoints) -> Box | None:
    """Bound the points that a block sees; where all of it sees the plane, its rim does."""
    met = np.isfinite(seen.depth_mm)
    x, y = np.moveaxis(seen.position_mm, -1, 0)
    if met.all():
        x, y = (np.concatenate([v[0], v[-1], v[:, 0], v[:, -1]]) for v in (x, y))
    elif met.any():
        x, y = x[met], y[met]
    else:
        return None
    return Box(np.array([x.min(), y.min()]), np.array([x.max(), y.max()]))


def _pixel_mm(camera: Camera, camera_from_target: Pose, block: Window) -> float:
    """Side of a square with the area that the middle pixel of a block covers on the plane.

    The block counts as a whole, whatever part of it is drawn. Where its middle does not meet the
    plane the answer is 0: as fine as can be.
    """
    x, y = ((first // _BLOCK_PX) * _BLOCK_PX + _BLOCK_PX // 2 for first in (block.left, block.top))
    seen = points_on_plane(camera, camera_from_target, Window(x, y, 2, 2))
    if not np.isfinite(seen.depth_mm).all():
        return 0.0
    here, right, below = seen.position_mm[0, 0], seen.position_mm[0, 1], seen.position_mm[1, 0]
    (a, b), (c, d) = right - here, below - here
    return float(np.sqrt(abs(a * d - b * c)))
