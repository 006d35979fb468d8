"""Spline bases along one motor."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.maps.spline_axis import SplineAxis
from lenscal.maps.tensor_pieces import bernstein

lists = st.lists(st.integers(0, 3000), min_size=1, max_size=40, unique=True)


@settings(deadline=None, max_examples=50)
@given(lists)
def test_the_pieces_are_the_basis(values):
    axis = SplineAxis.through(np.array(values, dtype=float))
    where = np.linspace(*axis.ends, 57)
    interval, place = axis.place(where, continued=True)
    local = np.einsum(
        "npk,pn->nk", axis.pieces()[interval], bernstein(axis.degree, place), optimize=True
    )
    found = np.zeros((len(where), axis.size))
    np.put_along_axis(found, axis.supports()[interval], local, axis=1)
    np.testing.assert_allclose(found, axis.design(where), atol=1e-12)


@settings(deadline=None, max_examples=50)
@given(lists)
def test_the_basis_sums_to_one(values):
    axis = SplineAxis.through(np.array(values, dtype=float))
    np.testing.assert_allclose(axis.pieces().sum(axis=2), 1.0, atol=1e-12)
    np.testing.assert_allclose(axis.design(np.linspace(*axis.ends, 31)).sum(axis=1), 1.0)


@pytest.mark.parametrize(("values", "degree"), [(1, 0), (2, 1), (3, 2), (4, 3), (9, 3)])
def test_the_degree_follows_the_number_of_values(values, degree):
    axis = SplineAxis.through(np.linspace(90, 110, values))
    assert axis.degree == degree
    assert axis.size == (values + degree - 1 if degree else 1)
    assert axis.pieces().shape == (len(axis.breaks) - 1, degree + 1, degree + 1)


def test_places_beyond_the_ends():
    axis = SplineAxis.through(np.linspace(90, 110, 5))
    interval, place = axis.place(np.array([85.0, 115.0, np.nan]), continued=True)
    assert interval[:2].tolist() == [0, 3]
    np.testing.assert_allclose(place, [-1, 2, np.nan])
    np.testing.assert_allclose(
        axis.place(np.array([85.0, 115.0, np.nan]), continued=False)[1], [0, 1, np.nan]
    )


def test_straight_functions_are_not_rough():
    axis = SplineAxis.through(np.array([0.0, 1.0, 4.0, 5.0, 9.0]))
    basis, eigenvalues = axis.roughness()
    assert (eigenvalues[:2] == 0).all()
    assert (eigenvalues[2:] > 0).all()
    where = np.linspace(0, 9, 19)
    straight = axis.design(where) @ basis[:, :2]
    np.testing.assert_allclose(np.diff(straight, 2, axis=0), 0, atol=1e-9)
