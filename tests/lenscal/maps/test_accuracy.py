"""From corners to maps, against the simulated truth: a short form of benchmarks/map_accuracy.py."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.sweep import calibrate_recording
from lenscal.maps.fit import fit_lens_map

BENCHMARK = Path(__file__).parents[3] / "benchmarks" / "map_accuracy.py"
DENSE = 25


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("map_accuracy", BENCHMARK)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope="module")
def strip(study):
    return study.strip(dense=DENSE)


@pytest.fixture(scope="module")
def strip_map(study, strip):
    return study.fit_session(strip, np.random.default_rng(1))


def test_a_curved_strip_is_mapped_within_the_bars(study, strip, strip_map):
    for name, error in study.errors(strip, strip_map).items():
        assert not np.isnan(error).any(), name
        if name in study.BARS:
            assert np.abs(error).max() < study.BARS[name], name


def test_corners_at_held_out_settings_are_predicted(study, strip, strip_map):
    refitted, worst, with_robot = study.held_out_distances_px(
        strip, strip_map, np.random.default_rng(2)
    )
    # 0.1 px of noise along both axes leave 0.125 px, were nothing refitted.
    assert 0.11 < refitted < 0.14
    assert worst < 0.14
    # The robot's own slips, 0.02 mm and 0.1 mrad, are all but a little of this.
    assert 0.2 < with_robot < 4


def test_stated_intervals_hold_over_a_regular_grid(study):
    plan = study.rectangle(dense=DENSE)
    rng = np.random.default_rng(3)
    table = calibrate_recording(study.record(plan.settings, rng))
    # The robot is the same in all of them: how well it repeats is estimated from the first.
    robot = table.evidence[0]["robot"]
    known = Repeatability(
        rotation_rad=robot["repeatability_rad"], translation_mm=robot["repeatability_mm"]
    )
    sessions = [fit_lens_map(table), *(study.fit_session(plan, rng, known) for _ in range(2))]
    for name in study.QUANTITIES:
        inside = np.array([study.held(plan, lens_map)[name] for lens_map in sessions])
        assert 0.85 < inside.mean() <= 1.0, name
        error = np.array([study.errors(plan, lens_map)[name] for lens_map in sessions])
        assert np.abs(error).max() < study.BARS.get(name, 3e-3), name


def test_sigmas_are_not_merely_large(study, strip, strip_map):
    sigma = strip_map.sigma("magnification", strip.zoom, strip.focus)
    assert np.median(sigma / strip.truth["magnification"]) < 3e-4
    sigma = strip_map.sigma("object_distance_mm", strip.zoom, strip.focus)
    assert np.median(sigma / strip.truth["object_distance_mm"]) < 1e-3
