"""How the light falls off from the axis to the corners of the image."""

from __future__ import annotations

import numpy as np

from lenscal.camera import Camera
from lenscal.imaging.texture import Float32Image
from lenscal.sensor import Window


def relative_illumination(
    camera: Camera, window: Window, falloff: tuple[float, float]
) -> Float32Image:
    """Give the light at every pixel relative to that at the principal point.

    Parameters
    ----------
    camera
        Gives the sensor and the principal point.
    window
        The pixels.
    falloff
        c2 in mm⁻² and c4 in mm⁻⁴ of 1 + c2 r² + c4 r⁴, with r in mm on the sensor from the
        principal point, in distorted coordinates: where the pixel is. Negative where light is lost.

    Returns
    -------
    Float32Image
        (height, width), never below 0.
    """
    squared_mm2 = [
        ((first + np.arange(count) - centre) * pitch) ** 2
        for first, count, centre, pitch in zip(
            (window.left, window.top),
            (window.width, window.height),
            camera.centre_px,
            camera.sensor.sample_pitch_mm,
            strict=True,
        )
    ]
    radius_squared = (squared_mm2[0] + squared_mm2[1][:, None]).astype(np.float32)
    c2, c4 = (np.float32(c) for c in falloff)
    share: Float32Image = np.maximum(1 + radius_squared * (c2 + c4 * radius_squared), 0)
    return share


def shaded(
    image: Float32Image, camera: Camera, window: Window, falloff: tuple[float, float]
) -> Float32Image:
    """Darken an image as `relative_illumination` says.

    Parameters
    ----------
    image
        (height, width) irradiance; it is overwritten.
    camera, window, falloff
        See `relative_illumination`.

    Returns
    -------
    Float32Image
        The image.
    """
    if any(falloff):
        image *= relative_illumination(camera, window, falloff)
    return image
