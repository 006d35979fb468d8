"""The inverse of a map: all solutions, folds included, and how well they are known."""

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq

from lenscal.errors import InputError, MapError
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.setting import LensSetting

PAIRS = [
    ("magnification", "focal_length_mm"),
    ("magnification", "object_distance_mm"),
    ("magnification", "standoff_mm"),
    ("object_distance_mm", "standoff_mm"),
]


@pytest.fixture(scope="module")
def vicon():
    return LensMap.load(Path(__file__).parents[3] / "data" / "vicon-1990" / "map.json")


@pytest.fixture(scope="module")
def folded():
    """A map none of whose quantities is monotone: pairs of them meet up to four times."""
    zoom, focus = (a.ravel() for a in np.meshgrid(np.linspace(90, 110, 9), np.linspace(60, 140, 7)))
    x, y = (zoom - 90) / 20, (focus - 60) / 80
    values = {
        "magnification": 0.2 * np.exp(0.4 * x - 0.8 * (y - 0.5 + 0.2 * x) ** 2),
        "object_distance_mm": 500 * np.exp(0.9 * (x - 0.45) ** 2 + 0.3 * np.sin(2.5 * y)),
        "standoff_mm": 400 * np.exp(0.05 * np.cos(3 * y + x)),
    }
    sigmas = {f"sigma_{name}": 1e-4 * value for name, value in values.items()}
    columns = {"zoom": zoom, "focus": focus, "sigma_sharpest_mm": np.full(zoom.shape, 0.1)}
    return fit_lens_map(pd.DataFrame(columns | values | sigmas))


def spans(lens_map):
    return np.array([np.ptp(lens_map.domain.zoom), np.ptp(lens_map.domain.focus)])


def wanted_at(lens_map, pair, zoom, focus):
    return {name: float(lens_map.value(name, zoom, focus)) for name in pair}


def distances(lens_map, found, zoom, focus):
    """How far each solution lies from a setting, as share of the ranges."""
    settings = np.array([(s.zoom, s.focus) for s in found]).reshape(-1, 2)
    return np.abs((settings - (zoom, focus)) / spans(lens_map)).max(axis=1)


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("name", ["vicon", "folded"])
def test_random_settings_are_found_again(request, name, pair):
    """One hundred and twenty for each of four pairs and two maps."""
    lens_map = request.getfixturevalue(name)
    rng = np.random.default_rng(PAIRS.index(pair))
    zooms, focuses = (
        rng.uniform(*ends, 120) for ends in (lens_map.domain.zoom, lens_map.domain.focus)
    )
    for zoom, focus in zip(zooms, focuses, strict=True):
        wanted = wanted_at(lens_map, pair, zoom, focus)
        found = lens_map.settings_for(**wanted)
        assert distances(lens_map, found, zoom, focus).min() < 1e-6
        for solution in found:
            for quantity, value in wanted.items():
                assert float(lens_map.value(quantity, solution.zoom, solution.focus)) == (
                    pytest.approx(value, rel=1e-11)
                )


@pytest.mark.parametrize("pair", [PAIRS[0], PAIRS[3]])
def test_no_solution_is_missed(folded, pair):
    """Against what one contour, cut finely, says of the other quantity's crossings."""
    rng = np.random.default_rng(8)
    counts = []
    for zoom, focus in zip(rng.uniform(91, 109, 40), rng.uniform(64, 136, 40), strict=True):
        wanted = wanted_at(folded, pair, zoom, focus)
        (first, level), (second, value) = wanted.items()
        crossings = sum(
            int((np.diff(np.sign(curve.value(second) - value)) != 0).sum())
            for curve in folded.contour(first, level)
        )
        found = folded.settings_for(**wanted)
        # The contour cannot see two crossings between neighbouring vertices.
        assert len(found) >= crossings
        assert (len(found) - crossings) % 2 == 0
        counts.append(len(found))
    assert max(counts) >= 3


@pytest.mark.parametrize("pair", [PAIRS[0], PAIRS[3]])
@pytest.mark.parametrize("apart", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
def test_both_solutions_beside_a_fold_are_found(folded, pair, apart):
    """Settings at a known distance from the line along which the map folds."""

    def slope(zoom, focus):
        rows = [[float(g) for g in folded.gradient(q, zoom, focus)] for q in pair]
        return np.array(rows) * spans(folded)

    tried = 0
    for zoom in np.linspace(92, 108, 9):
        focuses = np.linspace(65, 135, 15)
        turns = np.sign([np.linalg.det(slope(zoom, focus)) for focus in focuses])
        for i in np.flatnonzero(turns[1:] != turns[:-1]):
            fold = brentq(lambda f, z=zoom: np.linalg.det(slope(z, f)), *focuses[i : i + 2])
            at_fold = slope(zoom, fold)
            unit = at_fold / np.linalg.norm(at_fold, axis=1, keepdims=True)
            across = np.linalg.svd(unit)[2][1]
            start = np.array([zoom, fold]) + apart * across * spans(folded)
            away = distances(folded, folded.settings_for(**wanted_at(folded, pair, *start)), *start)
            assert away.min() < 1e-6
            near = np.sort(away)[:2]
            # The twin lies about as far on the other side.
            assert apart < near[1] < 8 * apart
            tried += 1
    assert tried >= 5


def test_solutions_on_the_border_count(folded):
    for zoom, focus in [(90.0, 60.0), (110.0, 95.0), (97.0, 140.0), (110.0, 140.0)]:
        found = folded.settings_for(**wanted_at(folded, PAIRS[0], zoom, focus))
        assert distances(folded, found, zoom, focus).min() < 1e-9


def test_solutions_outside_a_narrower_domain_do_not_count(folded):
    """The rectangle less a half: what was found there is gone, the rest stays."""

    class Half:
        zoom, focus = folded.domain.zoom, folded.domain.focus
        grid = folded.domain.grid

        def contains(self, zoom, focus):
            return folded.domain.contains(zoom, focus) & (np.asarray(focus) <= 100)

    half = dataclasses.replace(folded, domain=Half())
    rng = np.random.default_rng(3)
    cut = 0
    for zoom, focus in zip(rng.uniform(91, 109, 30), rng.uniform(64, 99, 30), strict=True):
        wanted = wanted_at(folded, PAIRS[3], zoom, focus)
        everywhere = folded.settings_for(**wanted)
        here = half.settings_for(**wanted)
        expected = [(s.zoom, s.focus) for s in everywhere if s.focus <= 100]
        np.testing.assert_allclose([(s.zoom, s.focus) for s in here], expected, rtol=1e-9)
        cut += len(everywhere) - len(here)
    assert cut > 0


def test_solutions_are_settings_by_zoom(folded):
    found = folded.settings_for(**wanted_at(folded, PAIRS[3], 95.0, 90.0))
    assert len(found) > 1
    assert found == sorted(found)
    assert isinstance(found[0], LensSetting)
    assert found[0].iris is None
    assert found[0].with_iris(3.0) == LensSetting(found[0].zoom, found[0].focus, 3.0)


@pytest.mark.parametrize("pair", [PAIRS[0], PAIRS[2], ("standoff_mm", "k1_per_mm2")])
def test_sigma_of_a_solution_agrees_with_sampling(vicon, pair):
    """Draws of both quantities from the map's posterior, each solved by the map's own slope."""
    zoom, focus = 101.0, 97.0
    (solution,) = vicon.settings_for(**wanted_at(vicon, pair, zoom, focus))
    rng = np.random.default_rng(1)
    at = np.array(zoom), np.array(focus)
    draws = rng.multivariate_normal(vicon.core.value(*at), vicon.core.covariance_at(*at), 40_000)
    ratio, distance, standoff = np.exp(draws).T
    k1 = vicon.single_surfaces["k1_per_mm2"]
    told = {
        "magnification": ratio,
        "focal_length_mm": ratio * distance / (1 + ratio),
        "standoff_mm": standoff,
        "k1_per_mm2": rng.normal(
            k1.value(*at)[0], np.sqrt(k1.covariance_at(*at)[0, 0]), len(ratio)
        ),
    }
    shift = np.stack([told[q] - float(vicon.value(q, zoom, focus)) for q in pair], axis=-1)
    slope = np.array([[float(g) for g in vicon.gradient(q, zoom, focus)] for q in pair])
    moved = np.linalg.solve(slope, shift.T)
    np.testing.assert_allclose(solution.covariance, np.cov(moved), rtol=0.06, atol=1e-12)
    assert solution.sigma_zoom == pytest.approx(moved[0].std(), rel=0.03)
    assert solution.sigma_focus == pytest.approx(moved[1].std(), rel=0.03)


def test_a_field_of_view_at_a_working_distance(vicon):
    """The image of a length as wide as the field fills the frame buffer."""
    distance = float(vicon.object_distance_mm(101.0, 97.0))
    standoff = float(vicon.standoff_mm(101.0, 97.0))
    width = vicon.sensor.width_mm / float(vicon.magnification(101.0, 97.0))
    height = width * vicon.sensor.height_mm / vicon.sensor.width_mm
    for wanted in (
        {"field_width_mm": width, "object_distance_mm": distance},
        {"field_height_mm": height, "object_distance_mm": distance},
        {"standoff_mm": standoff, "field_width_mm": width},
    ):
        found = vicon.settings_for(**wanted)
        assert distances(vicon, found, 101.0, 97.0).min() < 1e-9
    camera = vicon.camera_at(101.0, 97.0)
    plain = dataclasses.replace(camera, k1_per_mm2=0.0)
    ends = plain.project([[0.0, 0.0, distance], [width, 0.0, distance]])
    assert ends[1, 0] - ends[0, 0] == pytest.approx(vicon.sensor.width_px, rel=1e-9)


def test_what_cannot_be_wanted(vicon, lens, grid):
    with pytest.raises(InputError, match="but 3 were given .*; give two of .*field_width_mm"):
        vicon.settings_for(magnification=0.2, focal_length_mm=100.0, standoff_mm=370.0)
    with pytest.raises(InputError, match="field_width_mm and magnification both state the magnif"):
        vicon.settings_for(field_width_mm=40.0, magnification=0.2)
    with pytest.raises(InputError, match="field_width_mm must be positive, but is -4"):
        vicon.settings_for(field_width_mm=-4.0, standoff_mm=370.0)
    with pytest.raises(InputError, match="magnification must be a finite number, but is nan"):
        vicon.settings_for(magnification=np.nan, standoff_mm=370.0)
    with pytest.raises(InputError, match="unknown quantity 'zoomness'"):
        vicon.settings_for(zoomness=4.0, standoff_mm=370.0)
    with pytest.raises(InputError, match="magnification never is 1.* it runs from 0.1"):
        vicon.settings_for(field_width_mm=vicon.sensor.width_mm, standoff_mm=370.0)
    with pytest.raises(MapError, match="fitted without a sensor, so it cannot tell a field_width"):
        dataclasses.replace(vicon, sensor=None).settings_for(field_width_mm=4.0, standoff_mm=370.0)


def test_a_quantity_that_is_the_same_everywhere_finds_no_setting(lens, grid):
    table = lens.sample(*grid)
    table["k1_per_mm2"] = 1e-4
    constant = fit_lens_map(table)
    surfaces = constant.single_surfaces["k1_per_mm2"]
    flat = dataclasses.replace(surfaces, coefficients=np.full(surfaces.coefficients.shape, 1e-4))
    constant = dataclasses.replace(constant, single_surfaces={"k1_per_mm2": flat})
    with pytest.raises(InputError, match="k1_per_mm2 is 0.0001 everywhere on this map"):
        constant.settings_for(magnification=0.2, k1_per_mm2=1e-4)


def test_on_a_fold_the_setting_is_not_known_at_all(lens, grid):
    """Two quantities that depend on zoom alone say nothing about focus."""
    table = lens.sample(*grid)
    for name in ("magnification", "object_distance_mm", "standoff_mm"):
        table[name] = getattr(lens, name)(table["zoom"], 100.0)
    by_zoom = fit_lens_map(table)
    flat = by_zoom.core.coefficients.mean(axis=1, keepdims=True)
    flat = np.broadcast_to(flat, by_zoom.core.coefficients.shape)
    by_zoom = dataclasses.replace(
        by_zoom, core=dataclasses.replace(by_zoom.core, coefficients=flat)
    )
    for solution in by_zoom.settings_for(**wanted_at(by_zoom, PAIRS[1], 100.0, 100.0)):
        assert solution.zoom == pytest.approx(100.0, abs=1e-6)
        assert solution.sigma_focus == np.inf or solution.sigma_focus > 1e3
