"""Spline bases along one motor."""

from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.maps.spline_axis import SplineAxis
from lenscal.maps.tensor_pieces import evaluate, shares, surface_pieces

lists = st.lists(st.integers(0, 3000), min_size=1, max_size=40, unique=True)


@settings(deadline=None, max_examples=50)
@given(lists)
def test_the_pieces_are_the_basis(values):
    axis = SplineAxis.through(np.array(values, dtype=float))
    where = np.linspace(*axis.ends, 57)
    interval = axis.interval(where)
    place = axis.place(where, interval, continued=True)
    local = np.einsum(
        "npk,pn->nk", axis.pieces()[interval], shares(axis.degree, place), optimize=True
    )
    found = np.zeros((len(where), axis.size))
    np.put_along_axis(found, axis.supports()[interval], local, axis=1)
    np.testing.assert_allclose(found, axis.design(where), atol=1e-12)


@settings(deadline=None, max_examples=50)
@given(lists)
def test_the_basis_sums_to_one(values):
    axis = SplineAxis.through(np.array(values, dtype=float))
    binomials = np.array([comb(axis.degree, k) for k in range(axis.degree + 1)])
    one = axis.pieces().sum(axis=2) / binomials
    np.testing.assert_allclose(one, 1.0, atol=1e-12)
    np.testing.assert_allclose(axis.design(np.linspace(*axis.ends, 31)).sum(axis=1), 1.0)


@pytest.mark.parametrize(("values", "degree"), [(1, 0), (2, 1), (3, 2), (4, 3), (9, 3)])
def test_the_degree_follows_the_number_of_values(values, degree):
    axis = SplineAxis.through(np.linspace(90, 110, values))
    assert axis.degree == degree
    assert axis.size == (values + degree - 1 if degree else 1)
    assert axis.pieces().shape == (len(axis.breaks) - 1, degree + 1, degree + 1)


def test_places_beyond_the_ends():
    axis = SplineAxis.through(np.linspace(90, 110, 5))
    where = np.array([85.0, 115.0, np.nan])
    interval = axis.interval(where)
    assert interval[:2].tolist() == [0, 3]
    np.testing.assert_allclose(axis.place(where, interval, continued=True), [-1, 2, np.nan])
    np.testing.assert_allclose(axis.place(where, interval, continued=False), [0, 1, np.nan])


@settings(deadline=None, max_examples=30)
@given(lists, lists, st.integers(0, 2**32 - 1))
def test_many_points_are_evaluated_as_each_alone(zooms, focuses, seed):
    """Many are sorted into cells, few are not: the values are the same, beyond the ends too."""
    rng = np.random.default_rng(seed)
    axes = tuple(SplineAxis.through(np.array(v, dtype=float)) for v in (zooms, focuses))
    coefficients = rng.normal(size=(axes[0].size, axes[1].size, 2))
    pieces = surface_pieces(*axes, coefficients)
    count = 64 * pieces.shape[3]
    points = [rng.uniform(a - 1, b + 1, count) for a, b in (axis.ends for axis in axes)]
    points[0][0] = np.nan
    for continued in (False, True):
        together = evaluate(axes, pieces, *points, continued=continued)
        few = slice(0, 63)
        alone = evaluate(axes, pieces, points[0][few], points[1][few], continued=continued)
        scale = np.nanmax(np.abs(together), initial=1.0)
        np.testing.assert_allclose(together[:, few], alone, atol=1e-12 * scale)
        assert np.isnan(together[:, 0]).all()


def test_straight_functions_are_not_rough():
    axis = SplineAxis.through(np.array([0.0, 1.0, 4.0, 5.0, 9.0]))
    basis, eigenvalues = axis.roughness()
    assert (eigenvalues[:2] == 0).all()
    assert (eigenvalues[2:] > 0).all()
    where = np.linspace(0, 9, 19)
    straight = axis.design(where) @ basis[:, :2]
    np.testing.assert_allclose(np.diff(straight, 2, axis=0), 0, atol=1e-9)
