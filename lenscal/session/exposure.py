"""Setting the exposure so that white is bright but not full."""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.errors import FocusError
from lenscal.rig.interfaces import CameraDevice, Window

#: Where white should lie, as a share of saturation.
_WHITE: Final = 0.75
#: How near to it is near enough.
_TOLERANCE: Final = 0.1
_TRIES: Final = 8
#: Half the image is looked at each way, or so many px where that is less.
_WINDOW_PX: Final = 640
#: White is what this share of the pixels does not exceed; a few may glint.
_WHITE_PERCENTILE: Final = 95.0


def expose(camera: CameraDevice) -> float:
    """Choose the exposure time from pictures of what is in the middle of the image.

    Parameters
    ----------
    camera
        The camera; its exposure is left as chosen.

    Returns
    -------
    float
        The exposure time in seconds.

    Raises
    ------
    FocusError
        When the picture stays too dark or too bright at the end of the exposure range.
    """
    width, height = camera.sensor.width_px, camera.sensor.height_px
    # What is looked at lies in the middle, and a part of the pixels is quick.
    across, down = min(width // 2, _WINDOW_PX), min(height // 2, _WINDOW_PX)
    window = Window((width - across) // 2, (height - down) // 2, across, down)
    shortest, longest = camera.exposure_range_s
    for _ in range(_TRIES):
        frame = camera.grab(window)
        white = float(np.percentile(frame.image, _WHITE_PERCENTILE)) / frame.saturation
        if abs(white - _WHITE) <= _TOLERANCE * _WHITE:
            return camera.exposure_s
        # A full picture says only that it is too bright; black may hide a pedestal.
        factor = 0.25 if white >= 0.99 else _WHITE / max(white, 0.02)
        wanted = camera.exposure_s * factor
        if (wanted > longest and camera.exposure_s == longest) or (
            wanted < shortest and camera.exposure_s == shortest
        ):
            break
        camera.set_exposure_s(float(np.clip(wanted, shortest, longest)))
    dark = white < _WHITE
    word = "dark" if dark else "bright"
    remedy = "open the iris or add light" if dark else "close the iris or dim the light"
    raise FocusError(
        f"the picture is too {word}: white lies at {100 * white:.0f} % of saturation, exposed for "
        f"{camera.exposure_s:.3g} s (possible are {shortest:.3g} to {longest:.3g} s); "
        f"{remedy}"
    )
