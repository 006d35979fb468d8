"""A lens in closed form, smooth and curved, that maps can be judged by."""

import numpy as np
import pandas as pd
import pytest

from lenscal.sensor import Sensor
from lenscal.setting import LensSetting


class ClosedFormLens:
    """Quantities of an invented zoom lens; nothing in it is a spline."""

    def magnification(self, zoom, focus):
        return 0.12 * np.exp(0.04 * (zoom - 90) + 0.002 * (focus - 60)) + 2e-5 * (zoom - 90) ** 2

    def object_distance_mm(self, zoom, focus):
        return 500 + 10 * (zoom - 90) + 0.5 * (focus - 60) + 0.3 * (zoom - 90) ** 2

    def standoff_mm(self, zoom, focus):
        return 380 - 0.1 * (focus - 60) + 0.02 * (zoom - 90)

    def sample(self, zoom, focus, rng=None, sigma=1e-4):
        """One row per setting with the noise that the columns state."""
        zoom, focus = np.ravel(zoom), np.ravel(focus)
        values = {
            name: getattr(self, name)(zoom, focus)
            for name in ("magnification", "object_distance_mm", "standoff_mm")
        }
        relative = {"magnification": sigma, "object_distance_mm": 30 * sigma}
        sharpest = 0.3 * np.ones(zoom.shape)
        table = {"zoom": zoom, "focus": focus, "sigma_sharpest_mm": sharpest}
        slip = np.zeros(zoom.shape) if rng is None else rng.normal(0, sharpest)
        for name, value in values.items():
            table[name] = value
            if name in relative:
                table[f"sigma_{name}"] = relative[name] * value
                if rng is not None:
                    table[name] = value * (1 + relative[name] * rng.normal(size=zoom.shape))
        distance = values["object_distance_mm"]
        table["object_distance_mm"] = table["object_distance_mm"] + slip
        table["standoff_mm"] = table["standoff_mm"] + slip
        table["magnification"] = table["magnification"] * (1 - slip / distance)
        return pd.DataFrame(table)


@pytest.fixture(scope="session")
def lens():
    return ClosedFormLens()


@pytest.fixture(scope="session")
def grid():
    zoom, focus = np.meshgrid(np.linspace(90, 110, 7), np.linspace(60, 140, 5))
    return zoom.ravel(), focus.ravel()


@pytest.fixture(scope="session")
def lens_map(lens, grid):
    from lenscal.maps.fit import fit_lens_map

    table = lens.sample(*grid)
    table["k1_per_mm2"] = 1e-4 + 1e-6 * (table["zoom"] - 90)
    table["principal_point_x_px"] = 250 + 0.1 * (table["zoom"] - 90)
    table["principal_point_y_px"] = 240 - 0.01 * (table["focus"] - 60)
    sensor = Sensor(512, 480, 0.023, 0.01375, 0.70642)
    return fit_lens_map(table, sensor=sensor, reference_setting=LensSetting(98, 131))
