"""Image formation: a camera, a lens and a flat target become relative irradiance, without noise."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from lenscal.arrays import FloatArray, positive
from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.imaging.blur import BlurFloor, blur, blur_margin_px
from lenscal.imaging.plane_mapping import points_on_plane
from lenscal.imaging.texture import Float32Image, TargetSurface, Texture
from lenscal.optics import blur_diameter_mm
from lenscal.pose import Pose
from lenscal.sensor import Sensor, Window

#: Samples per pixel along each axis; a texel is as large as the space between two of them.
SAMPLES_PER_PIXEL: Final = 4

#: Rows of pixels that are sampled at a time, so that their samples stay in the cache.
_BAND_PX: Final = 24


def render(
    camera: Camera,
    camera_from_target: Pose,
    surface: TargetSurface,
    *,
    object_distance_mm: float,
    entrance_pupil_diameter_mm: float,
    window: Window | None = None,
    floor: BlurFloor | None = None,
) -> Float32Image:
    """Form the image of a flat target.

    Every pixel is the mean of 4 × 4 samples of the plane that its rays meet, blurred by a disk of
    diameter a·d·|1/z − 1/D| (see `lenscal.optics.blur_diameter_mm`) at the depth z of that pixel,
    with the floor in quadrature. The bench around the plate is as deep as the nearest or farthest
    corner of the artwork at most. A blur larger than the diagonal of the frame is drawn as large as
    that.

    Parameters
    ----------
    camera
        The camera at this lens setting; its frame has its origin in the entrance pupil.
    camera_from_target
        Where the target is.
    surface
        What the target looks like.
    object_distance_mm
        D of the plane in sharpest focus.
    entrance_pupil_diameter_mm
        a of the iris.
    window
        The part of the image wanted, None for all of it; the pixels are those of the full image.
    floor
        Diffraction and aberration, None for the defaults of `BlurFloor`.

    Returns
    -------
    Float32Image
        (height, width) irradiance of the window; white paper gives 1. A target that lies behind the
        camera, out of view or with its back to it leaves its surroundings.

    Raises
    ------
    InputError
        When the window leaves the frame, a length is not positive, or the target is too large to
        be drawn as finely as the view asks for.
    """
    positive("object_distance_mm", object_distance_mm, "mm")
    positive("entrance_pupil_diameter_mm", entrance_pupil_diameter_mm, "mm")
    view = window_inside(window, camera.sensor)
    depths = _corner_depths_mm(camera_from_target, surface)
    if not (depths > 0).any() or not _shows_its_front(camera_from_target):
        return np.full((view.height, view.width), surface.surroundings, np.float32)

    pitch_mm = camera.sensor.sample_pitch_mm
    depth_range = float(depths[depths > 0].min()), float(depths.max())

    def blur_mm(depth_mm: FloatArray) -> FloatArray:
        defocus = blur_diameter_mm(
            np.clip(depth_mm, *depth_range),
            object_distance_mm,
            camera.image_distance_mm,
            entrance_pupil_diameter_mm,
        )
        f_number = camera.image_distance_mm / entrance_pupil_diameter_mm
        total = (floor or BlurFloor()).add_to(defocus, f_number)
        return np.minimum(total, np.hypot(camera.sensor.width_mm, camera.sensor.height_mm))

    # 1/z is linear over the undistorted image, so the largest blur lies on the rim of the window.
    rim = [points_on_plane(camera, camera_from_target, side).depth_mm for side in _rim(view)]
    margin_x, margin_y = blur_margin_px(max(float(blur_mm(z).max()) for z in rim), pitch_mm)
    wide = _widened(view, margin_x, margin_y)
    seen = points_on_plane(camera, camera_from_target, _widened(wide, 1, 1))
    texture = surface.texture(_texel_mm(camera, camera_from_target, depth_range))
    depth_mm = seen.depth_mm[1 + margin_y : -1 - margin_y, 1 + margin_x : -1 - margin_x]
    return blur(_sharp_image(seen.position_mm, texture), blur_mm(depth_mm), pitch_mm)


def window_inside(window: Window | None, sensor: Sensor) -> Window:
    """Check that a window lies in the frame.

    Parameters
    ----------
    window
        The window, or None for the whole frame.
    sensor
        The sensor.

    Returns
    -------
    Window
        The window.

    Raises
    ------
    InputError
        When it is empty or leaves the frame.
    """
    if window is None:
        return Window(0, 0, sensor.width_px, sensor.height_px)
    fits = (
        window.width > 0
        and window.height > 0
        and window.left >= 0
        and window.top >= 0
        and window.left + window.width <= sensor.width_px
        and window.top + window.height <= sensor.height_px
    )
    if not fits:
        raise InputError(
            f"the window of {window.width} × {window.height} px at ({window.left}, {window.top}) "
            f"does not lie in the frame of {sensor.width_px} × {sensor.height_px} px"
        )
    return window


def _sharp_image(position_mm: FloatArray, texture: Texture) -> Float32Image:
    """Integrate the texture over every pixel, as a lens without any blur would.

    The rays of pixel centres come with a rim of one pixel more than the image. Within a pixel the
    mapping is linear to 1e-4 px.
    """
    texels = (position_mm * texture.texels_per_mm + texture.origin_texel).astype(np.float32)
    rows, columns = position_mm.shape[0] - 2, position_mm.shape[1] - 2
    image = np.zeros((rows, columns), np.float32)
    for top in range(0, rows, _BAND_PX):
        bottom = min(top + _BAND_PX, rows)
        image[top:bottom] = _band(texels[top : bottom + 2], texture)
    return image


def _band(texels: Float32Image, texture: Texture) -> Float32Image:
    """Average 4 × 4 samples per pixel; texel coordinates come with a rim of one pixel."""
    n = SAMPLES_PER_PIXEL
    rows, columns = texels.shape[:2]
    samples_at = cv2.resize(texels, (columns * n, rows * n), interpolation=cv2.INTER_LINEAR)
    samples = cv2.remap(  # type: ignore[call-overload]  # OpenCV takes one map, its types do not
        texture.reflectance,
        samples_at[n:-n, n:-n],
        None,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=texture.surroundings,
    )
    pixels = cv2.resize(samples, (columns - 2, rows - 2), interpolation=cv2.INTER_AREA)
    return np.asarray(pixels, dtype=np.float32)


def _shows_its_front(camera_from_target: Pose) -> bool:
    """Tell whether the projection centre is before the plane, since z of the target points away."""
    into_plate = camera_from_target.rotation[:, 2]
    return bool(into_plate @ camera_from_target.translation_mm > 0)


def _corner_depths_mm(camera_from_target: Pose, surface: TargetSurface) -> FloatArray:
    width, height = surface.target.size_mm
    corners = np.array([[x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
    depths: FloatArray = camera_from_target.transform(corners * (width, height, 0.0))[:, 2]
    return depths


def _texel_mm(camera: Camera, camera_from_target: Pose, depth_range: tuple[float, float]) -> float:
    """Space between samples on the target, at the depth of its middle."""
    depth = float(np.clip(camera_from_target.translation_mm[2], *depth_range))
    pitch = float(np.sqrt(np.prod(camera.sensor.sample_pitch_mm)))
    return pitch * depth / camera.image_distance_mm / SAMPLES_PER_PIXEL


def _widened(window: Window, x: int, y: int) -> Window:
    return Window(window.left - x, window.top - y, window.width + 2 * x, window.height + 2 * y)


def _rim(window: Window) -> list[Window]:
    """First and last row and column of a window."""
    right, bottom = window.left + window.width - 1, window.top + window.height - 1
    rows = [Window(window.left, top, window.width, 1) for top in (window.top, bottom)]
    columns = [Window(left, window.top, 1, window.height) for left in (window.left, right)]
    return rows + columns
