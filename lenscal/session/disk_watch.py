"""Looking at a disk while camera or lens move: windows that follow it, and a score for each."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from lenscal.errors import FocusError
from lenscal.rig.interfaces import CameraDevice, Frame, Window
from lenscal.session.disk_search import DiskImage, find_disk
from lenscal.session.sharpness import MEASURES, Measure

#: Room around the disk, in its semi-axes, and at least so many px.
_ROOM: Final = 1.7
_ROOM_PX: Final = 16
#: Where nothing is known, the disk is looked for in this share of the image each way.
_SEARCH_SHARE: Final = 0.5
#: The disk lies this near to the middle of the image at first, as a share of its width: hand-eye
#: calibration and principal point are known as well as that. Other disks lie farther off.
_AIM: Final = 0.06


@dataclass(frozen=True, slots=True)
class Look:
    """What one picture says.

    Parameters
    ----------
    position
        Where it was taken.
    sharpness
        The score; NaN when no disk could be measured.
    size_px
        Radius of the disk; NaN likewise.
    """

    position: float
    sharpness: float
    size_px: float


@dataclass(slots=True, eq=False)
class DiskWatch:
    """Takes pictures of the disk alone, as large as the last ones say it is.

    Parameters
    ----------
    camera
        The camera.
    measure
        What sharpness is measured by.
    trouble
        Why the last picture without a score had none.
    """

    camera: CameraDevice
    measure: Measure
    trouble: FocusError | None = None
    _known: dict[float, DiskImage] = field(default_factory=dict)

    def look(self, position: float) -> Look:
        """Take a picture and score it.

        Parameters
        ----------
        position
            Where camera or motor stand; the disk seen nearest to there says where to look.

        Returns
        -------
        Look
            The score; without a disk that can be measured it is NaN.
        """
        disk = self._expected(position)
        windows = [_middle_of(self.camera)]
        if disk is not None:
            windows.insert(0, _window_about(disk, self.camera))
        for window in windows:
            try:
                return self._score(position, self.camera.grab(window), disk)
            except FocusError as error:
                self.trouble = error
        return Look(position, np.nan, np.nan)

    def _expected(self, position: float) -> DiskImage | None:
        if not self._known:
            return None
        return self._known[min(self._known, key=lambda known: abs(known - position))]

    def _score(self, position: float, frame: Frame, expected: DiskImage | None) -> Look:
        """Find the disk and measure it."""
        left, top = frame.window.left, frame.window.top
        if expected is None:
            sensor = self.camera.sensor
            near = (sensor.width_px - 1) / 2 - left, (sensor.height_px - 1) / 2 - top
            disk = find_disk(frame.image, near, within_px=_AIM * sensor.width_px)
        else:
            there = expected.shifted(-left, -top)
            disk = find_disk(frame.image, there.centre_px, there.radius_px, within_px=0.0)
        sharpness = MEASURES[self.measure].score(frame.image, disk)
        self._known[position] = disk.shifted(left, top)
        return Look(position, sharpness if sharpness > 0 else np.nan, disk.radius_px)


def _middle_of(camera: CameraDevice) -> Window:
    width, height = camera.sensor.width_px, camera.sensor.height_px
    w, h = round(width * _SEARCH_SHARE), round(height * _SEARCH_SHARE)
    return Window((width - w) // 2, (height - h) // 2, w, h)


def _window_about(disk: DiskImage, camera: CameraDevice) -> Window:
    """The part of the image that holds the disk, with room for a change of scale."""
    centre, axes = np.array(disk.centre_px), np.array(disk.semi_axes_px)
    reach = np.maximum(_ROOM * axes, axes + _ROOM_PX)
    size = np.array([camera.sensor.width_px, camera.sensor.height_px])
    low = np.clip(np.floor(centre - reach), 0, size - 1).astype(int)
    high = np.clip(np.ceil(centre + reach) + 1, 1, size).astype(int)
    return Window(int(low[0]), int(low[1]), *(int(v) for v in high - low))
