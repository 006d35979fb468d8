"""Image formation: a camera, a lens and a flat target become relative irradiance, without noise."""

from __future__ import annotations

import numpy as np

from lenscal.arrays import FloatArray, positive
from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.imaging.aperture import ROUND, Aperture
from lenscal.imaging.blur import BlurFloor, blur, blur_margin_px, signed_blur_mm
from lenscal.imaging.falloff import shaded
from lenscal.imaging.plane_mapping import points_on_plane
from lenscal.imaging.sampling import CELLS_PER_PIXEL, sharp_image
from lenscal.imaging.texture import Float32Image, TargetSurface
from lenscal.pose import Pose
from lenscal.sensor import Sensor, Window


def render(
    camera: Camera,
    camera_from_target: Pose,
    surface: TargetSurface,
    *,
    object_distance_mm: float,
    entrance_pupil_diameter_mm: float,
    window: Window | None = None,
    floor: BlurFloor | None = None,
    falloff: tuple[float, float] = (0.0, 0.0),
    aperture: Aperture = ROUND,
) -> Float32Image:
    """Form the image of a flat target.

    Every pixel is the mean of 4 × 4 samples of the plane that its rays meet, blurred by the iris
    with a diameter of a·d·|1/z − 1/D| (see `lenscal.optics.blur_diameter_mm`) at the depth z of
    that pixel, with the floor in quadrature. The bench around the plate is as deep as the nearest
    or farthest corner of the artwork at most. A blur larger than the diagonal of the frame is drawn
    as large as that.

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
    falloff
        Coefficients of the relative illumination, see `lenscal.imaging.falloff`.
    aperture
        Shape of the iris; a is the diameter of the disk of the same area.

    Returns
    -------
    Float32Image
        (height, width) irradiance of the window; white paper gives 1. A target that lies behind the
        camera, out of view or with its back to it leaves its surroundings.

    Raises
    ------
    InputError
        When the window leaves the frame, or a length is not positive.
    """
    positive("object_distance_mm", object_distance_mm, "mm")
    positive("entrance_pupil_diameter_mm", entrance_pupil_diameter_mm, "mm")
    view = window_inside(window, camera.sensor)
    depths = _corner_depths_mm(camera_from_target, surface)
    if not (depths > 0).any() or not _shows_its_front(camera_from_target):
        image = np.full((view.height, view.width), surface.surroundings, np.float32)
        return shaded(image, camera, view, falloff)

    nearest, farthest = float(depths[depths > 0].min()), float(depths.max())

    def blur_mm(depth_mm: Float32Image | FloatArray) -> Float32Image:
        return signed_blur_mm(
            np.clip(depth_mm, nearest, farthest),
            camera,
            object_distance_mm,
            entrance_pupil_diameter_mm,
            floor or BlurFloor(),
        )

    # 1/z is linear over the undistorted image, so the largest blur lies on the rim of the window.
    rim = [points_on_plane(camera, camera_from_target, side).depth_mm for side in _rim(view)]
    largest_mm = max(float(np.abs(blur_mm(z)).max()) for z in rim)
    pitch_mm = camera.sensor.sample_pitch_mm
    margin_x, margin_y = blur_margin_px(largest_mm, pitch_mm, aperture)
    wide = Window(
        view.left - margin_x,
        view.top - margin_y,
        view.width + 2 * margin_x,
        view.height + 2 * margin_y,
    )
    sharp, depth_mm = sharp_image(camera, camera_from_target, surface, wide)
    inner = depth_mm[margin_y : margin_y + view.height, margin_x : margin_x + view.width]
    blurred = blur(sharp, blur_mm(inner), pitch_mm, aperture, CELLS_PER_PIXEL)
    return shaded(blurred, camera, view, falloff)


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


def _shows_its_front(camera_from_target: Pose) -> bool:
    """Tell whether the projection centre is before the plane, since z of the target points away."""
    into_plate = camera_from_target.rotation[:, 2]
    return bool(into_plate @ camera_from_target.translation_mm > 0)


def _corner_depths_mm(camera_from_target: Pose, surface: TargetSurface) -> FloatArray:
    width, height = surface.target.size_mm
    corners = np.array([[x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
    depths: FloatArray = camera_from_target.transform(corners * (width, height, 0.0))[:, 2]
    return depths


def _rim(window: Window) -> list[Window]:
    """First and last row and column of a window."""
    right, bottom = window.left + window.width - 1, window.top + window.height - 1
    rows = [Window(window.left, top, window.width, 1) for top in (window.top, bottom)]
    columns = [Window(left, window.top, 1, window.height) for left in (window.left, right)]
    return rows + columns
