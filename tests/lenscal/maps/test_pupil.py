import numpy as np
import pandas as pd
import pytest

from lenscal.errors import InputError, MapError, OutOfDomainError
from lenscal.maps.pupil_fit import PUPIL_COLUMNS, fit_pupil, fit_pupil_of_table

ZOOM, FOCUS = (
    axis.ravel() for axis in np.meshgrid(np.linspace(90, 110, 6), np.linspace(60, 140, 5))
)
RELATIVE = 0.01


def ratio(zoom, focus, iris):
    """An invented a/d: a stop that opens in its own way, seen through the lens."""
    opening = 1 - np.exp(-iris / 60)
    return 0.4 * opening * np.exp(0.02 * (zoom - 100) + 0.002 * (focus - 100)) + 0 * iris


def fit(iris, rng=None, zoom=ZOOM, focus=FOCUS, **options):
    exact = ratio(zoom, focus, iris)
    noise = 1.0 if rng is None else 1 + RELATIVE * rng.normal(size=zoom.shape)
    return fit_pupil(zoom, focus, iris, exact * noise, RELATIVE * exact, **options)


def several(irises):
    """Every iris at every setting."""
    count = len(irises)
    zoom, focus = np.tile(ZOOM, count), np.tile(FOCUS, count)
    return np.repeat(irises, len(ZOOM)).astype(float), zoom, focus


def test_one_iris_is_answered_for_and_no_other():
    pupil = fit(np.full(ZOOM.shape, 100.0))
    zoom, focus = np.array([93.0, 105.0]), np.array([70.0, 111.0])
    values, sigmas = pupil.aperture_ratio(zoom, focus, 100.0)
    np.testing.assert_allclose(values, ratio(zoom, focus, 100.0), rtol=2e-3)
    assert (sigmas > 0.01 * values).all()
    assert (sigmas < 0.02 * values).all()
    np.testing.assert_array_equal(pupil.aperture_ratio(zoom, focus)[0], values)
    with pytest.raises(
        OutOfDomainError, match="at iris 50 is not known: it was measured at iris 100 only; search"
    ) as caught:
        pupil.aperture_ratio(zoom, focus, np.array([100.0, 50.0]))
    np.testing.assert_array_equal(caught.value.mask, [False, True])
    assert caught.value.domain == (100.0, 100.0)
    some, sigma = pupil.aperture_ratio(zoom, focus, np.array([100.0, 50.0]), outside="nan")
    assert some[0] == values[0]
    assert np.isnan([some[1], sigma[1]]).all()


def test_irises_broadcast_with_the_settings():
    pupil = fit(np.full(ZOOM.shape, 100.0))
    zoom = np.full((2, 1), 97.0)
    assert pupil.aperture_ratio(zoom, zoom, np.full(3, 100.0))[0].shape == (2, 3)
    with pytest.raises(InputError, match=r"of shape \(2, 1\) and irises of shape \(3, 2\) do not"):
        pupil.aperture_ratio(zoom, zoom, np.full((3, 2), 100.0))


def test_an_iris_that_is_read_back_with_noise_is_one():
    rng = np.random.default_rng(0)
    pupil = fit(100 + 0.01 * rng.normal(size=ZOOM.shape))
    assert len(pupil.irises) == 1
    assert np.isfinite(pupil.aperture_ratio(np.array(100.0), np.array(100.0), 100.02)[0])


def test_between_two_irises_nothing_is_known_but_the_direction():
    irises, zoom, focus = several([20.0, 100.0])
    pupil = fit(irises, zoom=zoom, focus=focus)
    asked = np.linspace(20, 100, 33)
    where = np.full(33, 97.0), np.full(33, 88.0)
    values, sigmas = pupil.aperture_ratio(*where, asked)
    truth = ratio(*where, asked)
    np.testing.assert_allclose(values[[0, -1]], truth[[0, -1]], rtol=2e-3)
    assert (np.abs(values - truth) < 2 * sigmas).all()
    assert (np.diff(values) > 0).all()
    # Half way, the σ of a uniform distribution between the ends.
    step = truth[-1] - truth[0]
    assert sigmas[16] == pytest.approx(step / np.sqrt(12), rel=0.02)


def test_several_irises_are_interpolated_and_their_bend_says_how_well():
    irises, zoom, focus = several([20.0, 50.0, 100.0])
    pupil = fit(irises, zoom=zoom, focus=focus)
    asked = np.linspace(20, 100, 33)
    where = np.full(33, 97.0), np.full(33, 88.0)
    values, sigmas = pupil.aperture_ratio(*where, asked)
    truth = ratio(*where, asked)
    at_known = np.isin(asked, (20, 50, 100))
    assert at_known.sum() == 3
    np.testing.assert_allclose(values[at_known], truth[at_known], rtol=2e-3)
    assert (np.abs(values - truth) < 2 * sigmas).all()
    assert sigmas[at_known].max() < 0.015 * values.max()
    assert 0.02 * values.max() < sigmas.max() < 0.1 * values.max()
    for beyond in (19.0, 101.0):
        with pytest.raises(OutOfDomainError, match="at the irises 20, 50, 100, and between them"):
            pupil.aperture_ratio(where[0], where[1], beyond)
    with pytest.raises(InputError, match="depends on the iris, and is known at the irises 20, 50"):
        pupil.aperture_ratio(*where)


def test_irises_may_be_measured_at_different_settings():
    """A second session at every other setting, or one iris here and another there."""
    rng = np.random.default_rng(3)
    pupil = fit(np.where(np.arange(len(ZOOM)) % 2 == 0, 40.0, 100.0), rng)
    for iris in (40.0, 100.0):
        values, sigmas = pupil.aperture_ratio(ZOOM, FOCUS, iris)
        assert (np.abs(values - ratio(ZOOM, FOCUS, iris)) < 3 * sigmas).all()


def test_the_ratio_of_irises_has_the_sigma_that_is_stated():
    rng = np.random.default_rng(4)
    irises, zoom, focus = several([40.0, 100.0])
    keep = np.concatenate([np.arange(30) % 3 == 0, np.ones(30, bool)])
    fits = [
        fit(irises[keep], rng, zoom[keep], focus[keep], log_smoothing=[[2.0, 2.0]])
        for _ in range(150)
    ]
    found = np.array([pupil.log_ratios[1] for pupil in fits])
    truth = np.log(ratio(100, 100, 100.0) / ratio(100, 100, 40.0))
    sigma = np.sqrt(fits[0].covariance[0, 0])
    assert found.std() == pytest.approx(sigma, rel=0.2)
    assert abs(found.mean() - truth) < 4 * sigma / np.sqrt(150)


def test_both_irises_together_are_what_least_squares_gives():
    """Without a penalty that matters: a plane and an offset, against numpy."""
    rng = np.random.default_rng(5)
    iris = np.where(rng.random(len(ZOOM)) < 0.5, 40.0, 100.0)
    pupil = fit(iris, rng, log_smoothing=[[15.0, 15.0]])
    values = np.log(pupil.aperture_ratio(ZOOM, FOCUS, iris)[0])
    design = np.stack([np.ones(30), ZOOM, FOCUS, ZOOM * FOCUS, iris == 100.0], axis=-1)
    again = np.random.default_rng(5)
    again.random(len(ZOOM))
    factor = 1 + RELATIVE * again.normal(
        size=30
    )  # and σ over the measured value goes with 1/factor
    measured = np.log(ratio(ZOOM, FOCUS, iris) * factor)
    solution = np.linalg.lstsq(design * factor[:, None], measured * factor)[0]
    np.testing.assert_allclose(values, design @ solution, atol=2e-6)


def test_the_same_smoothing_gives_the_same_map():
    irises, zoom, focus = several([20.0, 100.0])
    first = fit(irises, np.random.default_rng(6), zoom, focus)
    again = fit(
        irises, np.random.default_rng(6), zoom, focus, log_smoothing=first.surface.log_smoothing
    )
    np.testing.assert_allclose(again.surface.coefficients, first.surface.coefficients, rtol=1e-12)
    np.testing.assert_allclose(again.log_ratios, first.log_ratios, rtol=1e-12)


def test_a_lens_that_does_not_tell_its_iris_is_asked_without_one():
    exact = ratio(ZOOM, FOCUS, 100.0)
    pupil = fit_pupil(ZOOM, FOCUS, np.full(30, np.nan), exact, RELATIVE * exact)
    assert np.isfinite(pupil.aperture_ratio(np.array(100.0), np.array(100.0))[0])
    with pytest.raises(OutOfDomainError, match="was measured without a record of the iris .ask wi"):
        pupil.aperture_ratio(np.array(100.0), np.array(100.0), 100.0)


def test_samples_without_a_pupil_are_left_out_and_bound_the_domain():
    exact = np.where(ZOOM > 105, np.nan, ratio(ZOOM, FOCUS, 100.0))
    pupil = fit_pupil(ZOOM, FOCUS, np.full(30, 100.0), exact, RELATIVE * exact)
    assert pupil.domain.zoom == (90.0, 102.0)
    with pytest.raises(MapError, match="no sample has an entrance pupil with its σ"):
        fit_pupil(ZOOM, FOCUS, np.full(30, 100.0), np.full(30, np.nan), np.full(30, 1.0))


def test_bad_samples_are_refused():
    exact = ratio(ZOOM, FOCUS, 100.0)
    iris = np.full(30, 100.0)
    with pytest.raises(
        InputError, match="the σ of the aperture ratio a/d must be positive, but is 0;"
    ):
        fit_pupil(ZOOM, FOCUS, iris, exact, 0 * exact)
    with pytest.raises(InputError, match="the aperture ratio a/d must be positive, but is -"):
        fit_pupil(ZOOM, FOCUS, iris, -exact, exact)
    with pytest.raises(InputError, match="1 of 30 samples of the entrance pupil do not state"):
        fit_pupil(ZOOM, FOCUS, np.where(np.arange(30) == 4, np.nan, 100.0), exact, exact)


def test_irises_that_cannot_be_told_from_the_settings_are_refused():
    """Two wide settings at one iris and two long ones at another: the plane takes it all."""
    zoom, focus = np.array([90.0, 90, 110, 110]), np.array([60.0, 140, 60, 140])
    with pytest.raises(MapError, match="the samples do not tell the iris from zoom and focus"):
        fit(np.where(zoom < 100, 40.0, 100.0), zoom=zoom, focus=focus)


def table(distance_error=0.0):
    """A calibration table: D, and with it a and d, is known to 2 %."""
    image_distance = 60 + (ZOOM - 90) + 0.05 * FOCUS
    exact = image_distance * ratio(ZOOM, FOCUS, 100.0)
    return pd.DataFrame(
        {
            "zoom": ZOOM,
            "focus": FOCUS,
            "image_distance_mm": image_distance * (1 + distance_error),
            "sigma_image_distance_mm": 0.02 * image_distance,
            "pupil_iris": 100.0,
            "entrance_pupil_diameter_mm": exact * (1 + distance_error),
            "sigma_entrance_pupil_diameter_mm": np.hypot(0.01, 0.02) * exact,
        }
    )


def test_a_table_gives_the_ratio_without_the_error_of_the_distance():
    rng = np.random.default_rng(7)
    pupil = fit_pupil_of_table(table(0.02 * rng.normal(size=30)))
    values, sigmas = pupil.aperture_ratio(ZOOM, FOCUS, 100.0)
    np.testing.assert_allclose(values, ratio(ZOOM, FOCUS, 100.0), rtol=2e-3)
    assert (sigmas < 0.013 * values).all()


def test_d_may_be_stated_as_its_factors():
    rows = table()
    rows["magnification"], rows["object_distance_mm"] = rows["image_distance_mm"] / 500, 500.0
    again = rows.drop(columns="image_distance_mm")
    np.testing.assert_allclose(
        fit_pupil_of_table(again.drop(columns="sigma_image_distance_mm")).surface.coefficients,
        fit_pupil_of_table(rows).surface.coefficients,
        atol=5e-3,
    )


@pytest.mark.parametrize("column", PUPIL_COLUMNS)
def test_a_table_that_knows_no_pupil_gives_none(column):
    assert fit_pupil_of_table(table().drop(columns=column)) is None
    if column != "pupil_iris":
        assert fit_pupil_of_table(table().assign(**{column: np.nan})) is None


def test_a_table_with_a_negative_sigma_or_no_diameter_is_refused():
    rows = table()
    rows.loc[3, "sigma_entrance_pupil_diameter_mm"] = -1.0
    with pytest.raises(InputError, match="σ of the aperture ratio a/d must be positive, but is -"):
        fit_pupil_of_table(rows)
    rows = table()
    rows.loc[4, "entrance_pupil_diameter_mm"] = 0.0
    with pytest.raises(InputError, match="_diameter_mm must be positive, but is 0 in row 4 of the"):
        fit_pupil_of_table(rows)
