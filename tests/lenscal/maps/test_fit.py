import numpy as np
import pandas as pd
import pytest

from lenscal.errors import InputError, MapError
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.rig.simulated.machine_vision import TRAVEL, machine_vision_lens
from lenscal.setting import LensSetting


def dense(low=(90, 60), high=(110, 140)):
    return np.meshgrid(np.linspace(low[0], high[0], 41), np.linspace(low[1], high[1], 41))


@pytest.mark.parametrize("quantity", ["magnification", "object_distance_mm", "standoff_mm"])
def test_without_noise_the_map_is_the_lens_within_what_it_states(lens, lens_map, quantity):
    error = getattr(lens_map, quantity)(*dense()) - getattr(lens, quantity)(*dense())
    assert np.abs(error / lens_map.sigma(quantity, *dense())).max() < 2.0
    assert np.abs(error / getattr(lens, quantity)(*dense())).max() < 5e-3


def test_derived_quantities_follow_from_the_three(lens_map):
    d_over_d, far = lens_map.magnification(*dense()), lens_map.object_distance_mm(*dense())
    near = lens_map.image_distance_mm(*dense())
    np.testing.assert_allclose(near, d_over_d * far)
    np.testing.assert_allclose(1 / lens_map.focal_length_mm(*dense()), 1 / near + 1 / far)
    np.testing.assert_allclose(
        lens_map.nodal_offset_mm(*dense()), far - lens_map.standoff_mm(*dense())
    )


def test_stated_sigmas_cover_the_errors(lens, grid):
    """Over re-noised sessions the error over σ is one, within what 12 sessions can tell."""
    rng = np.random.default_rng(1)
    ratios = {q: [] for q in ("magnification", "object_distance_mm", "standoff_mm")}
    for _ in range(12):
        fitted = fit_lens_map(lens.sample(*grid, rng))
        for quantity, found in ratios.items():
            error = fitted.value(quantity, *dense()) - getattr(lens, quantity)(*dense())
            found.append((error / fitted.sigma(quantity, *dense())) ** 2)
    for quantity, found in ratios.items():
        assert 0.5 < np.sqrt(np.mean(found)) < 1.4, quantity


def test_magnification_is_not_spoilt_by_distance(lens, grid):
    """d/D is known 30 times better than D; the fit together must keep that."""
    fitted = fit_lens_map(lens.sample(*grid, np.random.default_rng(2)))
    relative = {
        q: (fitted.sigma(q, *dense()) / fitted.value(q, *dense())).mean()
        for q in ("magnification", "object_distance_mm")
    }
    # The autofocus slip of 0.3 mm in 600 is the floor of d/D.
    assert relative["magnification"] < 6e-4
    assert relative["object_distance_mm"] > 1e-3


def test_zoom_only_and_focus_only_tables_make_maps(lens):
    zoom = np.linspace(90, 110, 6)
    along = fit_lens_map(lens.sample(zoom, np.full(6, 80.0)))
    assert along.magnification(97.0, 80.0) == pytest.approx(
        lens.magnification(97.0, 80.0), rel=1e-3
    )
    assert not along.domain.contains(97.0, 81.0)
    focus = np.linspace(60, 140, 3)
    across = fit_lens_map(lens.sample(np.full(3, 95.0), focus))
    assert across.standoff_mm(95.0, 77.0) == pytest.approx(lens.standoff_mm(95.0, 77.0), rel=1e-3)


def test_two_samples_make_a_line(lens):
    line = fit_lens_map(lens.sample([90.0, 100.0], [80.0, 80.0]))
    middle = np.sqrt(lens.magnification(90, 80.0) * lens.magnification(100, 80.0))
    assert line.magnification(95.0, 80.0) == pytest.approx(middle, rel=1e-9)


def test_without_sigmas_the_noise_is_estimated_and_said(lens, grid):
    rng = np.random.default_rng(3)
    table = lens.sample(*grid)[["zoom", "focus", "magnification", "object_distance_mm"]]
    noise = np.exp(0.01 * rng.normal(size=(len(table), 2)))
    table[["magnification", "object_distance_mm"]] *= noise
    fitted = fit_lens_map(table)
    assert "the noise was estimated from the scatter" in fitted.notes[0]
    assert 0.006**2 < fitted.core.noise_scale < 0.014**2
    with pytest.raises(MapError, match="this map has no standoff_mm: .* no robot poses were"):
        fitted.standoff_mm(95.0, 80.0)


def test_absent_correlations_are_said(lens, grid):
    fitted = fit_lens_map(
        lens.sample(*grid).drop(columns="sigma_sharpest_mm").assign(sigma_standoff_mm=0.3)
    )
    assert any("autofocus was taken as exact" in note for note in fitted.notes)
    assert any("taken as uncorrelated" in note for note in fitted.notes)


def change(column, row, value):
    def apply(table):
        table.loc[row, column] = value
        return table

    return apply


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda t: t.drop(columns="magnification"), "lacks the columns magnification; it has zoom"),
        (change("magnification", 3, np.nan), "magnification is not finite in row 3"),
        (change("object_distance_mm", 2, -5.0), "object_distance_mm must be positive, but is -5"),
        (change("sigma_magnification", 1, 0.0), "a measurement without error does not exist"),
        (lambda t: pd.concat([t, t.iloc[[4]]]), "the setting zoom .* stands more than once"),
        (
            lambda t: t.drop(columns="sigma_sharpest_mm"),
            "has standoff_mm but neither sigma_standoff_mm nor sigma_sharpest_mm",
        ),
        (
            lambda t: t.assign(cov_magnification_object_distance_mm=1.0),
            "covariances of the samples contradict themselves",
        ),
    ],
)
def test_tables_that_cannot_be_used(lens, grid, spoil, message):
    with pytest.raises(InputError, match=message):
        fit_lens_map(spoil(lens.sample(*grid)))


def test_too_few_samples_are_refused(lens):
    with pytest.raises(MapError, match="a map needs at least 2 samples, but the table has 1"):
        fit_lens_map(lens.sample([90.0], [80.0]))
    with pytest.raises(MapError, match="3 samples cannot determine .* at least 4 are needed"):
        fit_lens_map(lens.sample([90.0, 95.0, 100.0], [60.0, 80.0, 70.0]))
    diagonal = np.linspace(0, 1, 5)
    with pytest.raises(MapError, match="they lie on a line or in too few places"):
        fit_lens_map(lens.sample(90 + 20 * diagonal, 60 + 80 * diagonal))


def _strip_of_a_lens_that_is_not_parfocal():
    lens, rows = machine_vision_lens(), []
    # Ends that differ in D: else D would be told by the strip itself.
    for zoom, far_mm in zip(np.linspace(*TRAVEL.zoom, 5), (1500, 700, 1100, 600, 900), strict=True):
        low, high = lens.focus_range(zoom, 300.0, far_mm)
        for focus in np.linspace(low, high, 5):
            truth = lens.truth(LensSetting(zoom, focus, 75.0))
            rows.append((zoom, focus, truth.magnification, truth.object_distance_mm))
    return pd.DataFrame(rows, columns=["zoom", "focus", "magnification", "object_distance_mm"])


def test_a_setting_that_knows_only_its_ratio_learns_its_distance_from_its_neighbours():
    """Along a strip D changes fourfold but d hardly does; the map finds out which is the spline."""
    truth = _strip_of_a_lens_that_is_not_parfocal()
    rng = np.random.default_rng(0)
    relative = np.full(len(truth), 1e-3)
    ends = [0, 24]
    relative[ends] = 1.0
    table = truth.assign(
        magnification=truth["magnification"] * np.exp(1e-4 * rng.normal(size=len(truth))),
        object_distance_mm=truth["object_distance_mm"]
        * np.exp(np.minimum(relative, 0.3) * rng.normal(size=len(truth))),
        sigma_magnification=1e-4 * truth["magnification"],
        sigma_object_distance_mm=relative * truth["object_distance_mm"],
        cov_magnification_object_distance_mm=0.0,
        sigma_sharpest_mm=0.02,
    )
    found = fit_lens_map(table)
    np.testing.assert_array_equal(found.core.mixing, [[1, 0], [-1, 1]])
    at = truth.iloc[ends]
    distance = found.object_distance_mm(at["zoom"], at["focus"])
    assert np.abs(distance / at["object_distance_mm"] - 1).max() < 0.02
    # The smoothing alone does not do it: D as its own spline must be told by extrapolation.
    apart = fit_lens_map(
        table, log_smoothing={"core_powers": np.zeros(2), "core_mixing": np.eye(2)}
    )
    guess = apart.object_distance_mm(at["zoom"], at["focus"])
    assert np.abs(guess / at["object_distance_mm"] - 1).max() > 0.03


def test_how_roughness_grows_is_kept_in_the_file(tmp_path, lens):
    zoom, focus = (a.ravel() for a in np.meshgrid(np.linspace(90, 110, 6), np.linspace(60, 140, 6)))
    fitted = fit_lens_map(lens.sample(zoom, focus, np.random.default_rng(5)))
    growth = fitted.core.roughening + np.array([[0.0, 0.0], [1.5, -0.5], [0.0, 0.0]])
    chosen = {
        "core_powers": fitted.core.powers,
        "core_mixing": fitted.core.mixing,
        "core_roughening": growth,
    }
    bent = fit_lens_map(fitted.samples, log_smoothing=chosen)
    again = LensMap.load(bent.save(tmp_path / "map.json"))
    np.testing.assert_array_equal(again.core.roughening, growth)
    np.testing.assert_allclose(
        again.object_distance_mm(*dense()), bent.object_distance_mm(*dense()), rtol=1e-9
    )
