"""Raising the smallest margin: on landscapes whose summit another solver knows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from planning.ascent import raise_smallest

SIZE, REQUIREMENTS, PIECES = 6, 4, 5


def landscape(seed: int):
    """Margins that are each the smallest of a few concave pieces, full of ridges."""
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=(REQUIREMENTS, PIECES, SIZE))
    heights = rng.uniform(0.1, 1.0, (REQUIREMENTS, PIECES))

    def pieces(at):
        bend = 0.5 * (at**2).sum(axis=-1)[..., None, None]
        return np.einsum("rpn,...n->...rp", slopes, at) + heights - bend

    return pieces


def summit(pieces, raised) -> float:
    """Largest smallest margin by sequential quadratic programming on the smooth pieces."""

    def room(point):
        values = pieces(point[:-1])
        return np.concatenate([(values[raised] - point[-1]).ravel(), values[~raised].ravel()])

    found = minimize(
        lambda point: -point[-1],
        np.zeros(SIZE + 1),
        constraints={"type": "ineq", "fun": room},
        options={"maxiter": 500, "ftol": 1e-12},
    )
    assert found.success
    return float(found.x[-1])


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("held", [0, 1])
def test_climbs_to_the_summit_over_all_ridges(seed: int, held: int) -> None:
    pieces = landscape(seed)
    raised = np.arange(REQUIREMENTS) >= held
    starts = np.random.default_rng(seed).normal(size=(3, SIZE)) / 5

    def margins(which, moves):
        return pieces(starts[which][:, None] + moves).min(axis=-1)

    end = raise_smallest(margins, (3, SIZE), raised=raised, rounds=60)
    best = summit(pieces, raised)
    np.testing.assert_allclose(end.margins[:, raised].min(axis=1), best, atol=3e-3 * abs(best))
    assert (end.margins[:, ~raised] >= 0).all()
    np.testing.assert_allclose(end.margins, margins(np.arange(3), end.moves[:, None])[:, 0])


def test_what_is_held_is_restored_first() -> None:
    """The start violates what is held: it climbs back, and raises the other only afterwards."""

    def margins(which, moves):
        x, y = moves[..., 0] - 1.0, moves[..., 1]
        return np.stack([x, 2.0 - x - np.abs(y)], axis=-1)

    end = raise_smallest(margins, (1, 2), raised=np.array([False, True]))
    np.testing.assert_allclose(end.margins, [[0.0, 2.0]], atol=1e-4)


def test_limits_are_kept_and_reached() -> None:
    def margins(which, moves):
        return moves.sum(axis=-1, keepdims=True)

    low, high = np.full((2, 2), -1.0), np.array([[0.3, 0.0], [0.0, 0.7]])
    end = raise_smallest(margins, (2, 2), raised=np.array([True]), limits=(low, high))
    np.testing.assert_allclose(end.moves, high, atol=1e-9)


def test_at_an_upper_limit_slopes_are_taken_from_inside() -> None:
    """A share of 1 can only fall; a difference to beyond the limit would say nothing changes."""

    def margins(which, moves):
        return -np.minimum(moves, 0.0)

    limits = (np.full((1, 1), -1.0), np.zeros((1, 1)))
    end = raise_smallest(margins, (1, 1), raised=np.array([True]), limits=limits)
    np.testing.assert_allclose(end.margins, 1.0)


def test_weights_change_what_is_smallest() -> None:
    def margins(which, moves):
        return np.concatenate([moves, 1.0 - moves], axis=-1)

    weights = np.array([[1.0, 1.0], [1.0, 3.0]])
    end = raise_smallest(margins, (2, 1), raised=np.array([True, True]), weights=weights)
    np.testing.assert_allclose(end.moves[:, 0], [0.5, 0.75], atol=1e-6)


def test_each_point_raises_what_it_is_told_to() -> None:
    """On one line, with x and 1 − x: the first raises one, the second the other, the third both."""

    def margins(which, moves):
        return np.concatenate([moves, 1.0 - moves], axis=-1)

    raised = np.array([[True, False], [False, True], [True, True]])
    end = raise_smallest(margins, (3, 1), raised=raised)
    np.testing.assert_allclose(end.moves[:, 0], [1.0, 0.0, 0.5], atol=1e-4)


def test_views_that_cannot_be_had_are_left_alone() -> None:
    """Where a margin is −inf or NaN nothing is learned, and nobody goes there."""

    def margins(which, moves):
        x = moves[..., 0]
        return np.where(x > 0.2, np.where(x > 0.3, np.nan, -np.inf), x)[..., None]

    end = raise_smallest(margins, (1, 1), raised=np.array([True]))
    assert 0.19 < end.margins[0, 0] <= 0.2
