"""Cameras at which foreign focal length, our d and the paper's f are three different numbers."""

import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.formats.exported import ExportedSetting
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting

SENSOR = Sensor(512, 480, 0.023, 0.01375, 0.70642)


def exported_at(zoom, focus, magnification=0.3, offset=None):
    """D = 400 mm, d = D · d/D; f is smaller by 1 + d/D."""
    camera = Camera(
        SENSOR,
        400.0 * magnification,
        4.2e-4 + 1e-5 * zoom,
        np.array([250.3 + zoom / 7, 241.9 - focus / 9]),
    )
    return ExportedSetting(LensSetting(zoom, focus), camera, 400.0, offset)


@pytest.fixture
def one():
    return exported_at(98, 131)


@pytest.fixture
def several():
    return [
        exported_at(zoom, focus, 0.2 + zoom / 100, 3.0 * zoom + focus / 7)
        for focus in (5, 8)
        for zoom in (1, 2, 7)
    ]


def pixels_of(camera, count=9):
    """A grid over the whole image."""
    sensor = camera.sensor
    across = np.linspace(-0.5, sensor.width_px - 0.5, count)
    down = np.linspace(-0.5, sensor.height_px - 0.5, count)
    return np.stack(np.meshgrid(across, down), -1).reshape(-1, 2)


@pytest.fixture
def largest_difference_px():
    """How far rays of one camera land from their pixels in another one."""

    def measure(camera, other):
        pixels = pixels_of(camera)
        return np.linalg.norm(other.project(camera.unproject(pixels)) - pixels, axis=-1).max()

    return measure
