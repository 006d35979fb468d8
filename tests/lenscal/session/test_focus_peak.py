import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.errors import FocusError
from lenscal.session.focus_peak import (
    Verdict,
    confidence,
    fit_peak,
    judge,
    vergence_from_growth,
)


def curve(standoffs, sharpest, offset, reach):
    """One over the edge width for a blur that is linear in 1/z; it is √2 at `reach` from D."""
    z, peak = standoffs + offset, sharpest + offset
    blur = (1 / z - 1 / peak) * peak**2 / reach
    return 1 / np.sqrt(1 + blur**2)


@settings(max_examples=60, deadline=None)
@given(
    sharpest=st.floats(360, 380),
    offset=st.floats(-80, 400),
    reach=st.floats(0.3, 12),
    decentred=st.floats(-0.5, 0.5),
)
def test_the_vertex_of_a_perfect_curve_is_exact(sharpest, offset, reach, decentred):
    standoffs = sharpest + reach * (decentred + np.linspace(-1.5, 1.5, 13))
    kappa = 1 / (standoffs.mean() + offset)
    sharpness = curve(standoffs, sharpest, offset, reach)
    fit = fit_peak(standoffs, sharpness, vergence=(kappa, 0.0))
    assert fit.position == pytest.approx(sharpest, abs=1e-7)
    assert fit.sigma < 1e-6
    assert fit.reach == pytest.approx(reach, rel=0.1)
    np.testing.assert_allclose(fit.sharpness(standoffs), sharpness, rtol=1e-6)


def test_without_the_projection_centre_the_vertex_is_off_by_the_cubic_term():
    """About 0.6 r²/D for a sweep of half-length r, and σ of κ brings it back into σ."""
    standoffs = 370.0 + np.linspace(-12, 12, 13)
    sharpness = curve(standoffs, 370.0, 0.0, 6.0)
    plain = fit_peak(standoffs, sharpness)
    assert 0.1 < abs(plain.position - 370.0) < 0.6 * 12**2 / 370
    honest = fit_peak(standoffs, sharpness, vergence=(0.0, 1 / 370))
    assert abs(honest.position - 370.0) == pytest.approx(honest.sigma, rel=0.1)


@settings(max_examples=40, deadline=None)
@given(factor=st.floats(1e-3, 1e3), power=st.sampled_from([1.0, 3.0]))
def test_neither_unit_nor_power_of_the_measure_moves_the_peak(factor, power):
    standoffs = np.linspace(365, 378, 13)
    sharpness = factor * curve(standoffs, 371.3, 200.0, 3.0) ** power
    fit = fit_peak(standoffs, sharpness, vergence=(1 / 571.5, 0.0), width_power=power)
    assert fit.position == pytest.approx(371.3, abs=1e-6)


def test_the_stated_sigma_is_the_spread_of_the_vertex():
    rng = np.random.default_rng(0)
    standoffs = np.linspace(368, 375, 13)
    noise = 1 + 0.01 * rng.normal(size=(400, 13))
    fits = [
        fit_peak(standoffs, row, vergence=(1 / 571.5, 0.0))
        for row in curve(standoffs, 371.3, 200.0, 3.0) * noise
    ]
    found, sigma = np.array([(fit.position, fit.sigma) for fit in fits]).T
    assert found.std() == pytest.approx(np.sqrt((sigma**2).mean()), rel=0.15)
    assert abs(found.mean() - 371.3) < 0.02


def test_a_curve_without_a_peak_is_refused():
    standoffs = np.linspace(365, 370, 9)
    with pytest.raises(FocusError, match=r"no peak between 365\.0 and 370\.0; open the iris"):
        fit_peak(standoffs, curve(standoffs, 390.0, 200.0, 3.0))
    noise = 1 + 0.01 * np.random.default_rng(1).normal(size=9)
    with pytest.raises(FocusError, match="no peak"):
        fit_peak(standoffs, noise)
    with pytest.raises(FocusError, match="needs five pictures .*, but has 4"):
        fit_peak(standoffs[:4], noise[:4])


@pytest.mark.parametrize(
    ("sharpness", "verdict"),
    [
        ([1, 2, 3, 2, 1], Verdict.CLEAR),
        ([1, 2, 3, 4, 5], Verdict.ABOVE),
        ([1, 2, 3, 4, 3.9], Verdict.ABOVE),
        ([5, 4, 3, 2, 1], Verdict.BELOW),
        ([1, 1.05, 1.1, 1.05, 1], Verdict.FLAT),
        ([np.nan, np.nan, 1, np.nan, np.nan], Verdict.CLEAR),
        ([np.nan] * 5, Verdict.FLAT),
    ],
)
def test_what_a_curve_shows(sharpness, verdict):
    assert judge(np.array(sharpness, float)) is verdict


def test_confidence_runs_from_0_to_1():
    assert confidence(np.array([1.0, 2.0, 4.0, 2.0, 2.0])) == 0.5
    assert confidence(np.array([5.0, 4.0, 3.0])) == 0
    assert confidence(np.array([np.nan, 4.0, np.nan])) == 1
    assert confidence(np.full(5, np.nan)) == 0


def test_the_growth_of_the_disk_tells_the_projection_centre():
    rng = np.random.default_rng(2)
    standoffs = np.linspace(362, 386, 17)
    sizes = 30_000 / (standoffs + 290)
    vergence, _ = vergence_from_growth(standoffs, sizes, 370.0)
    assert vergence == pytest.approx(1 / 660, rel=1e-9)
    found = [
        vergence_from_growth(standoffs, sizes * (1 + 1e-3 * rng.normal(size=17)), 370.0)
        for _ in range(200)
    ]
    values, sigmas = np.array(found).T
    assert values.std() == pytest.approx(np.sqrt((sigmas**2).mean()), rel=0.2)


def test_a_growth_that_tells_nothing_leaves_the_reference_projection_centre():
    standoffs = np.linspace(362, 386, 7)
    sizes = 50 + 5 * np.random.default_rng(3).normal(size=7)
    assert vergence_from_growth(standoffs, sizes, 370.0) == (1 / 370, 1 / 370)
    assert vergence_from_growth(standoffs, np.full(7, np.nan), 370.0) == (1 / 370, 1 / 370)
