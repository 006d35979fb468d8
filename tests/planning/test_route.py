"""Short routes, against trying all orders."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.errors import InputError
from lenscal.pose import Pose
from planning import route
from planning.route import shortest_route, travel_between_mm


def distances(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points, axis=-1)


def length(order, travel: np.ndarray) -> float:
    return float(sum(travel[a, b] for a, b in itertools.pairwise(order)))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 7), st.booleans())
def test_no_order_is_shorter(seed: int, count: int, stated: bool) -> None:
    travel = distances(np.random.default_rng(seed).normal(size=(count, 3)))
    start = count // 2 if stated else None
    found = shortest_route(travel, start)
    orders = (o for o in itertools.permutations(range(count)) if not stated or o[0] == start)
    assert found.travel_mm == pytest.approx(min(length(o, travel) for o in orders))
    assert found.is_shortest
    assert sorted(found.order) == list(range(count))
    assert length(found.order, travel) == pytest.approx(found.travel_mm)


@pytest.mark.parametrize("start", [None, 3])
def test_improved_routes_are_nearly_the_shortest(monkeypatch, start) -> None:
    """What is improved bit by bit, on tasks that are small enough to be solved for certain."""
    worst = 1.0
    for seed in range(20):
        travel = distances(np.random.default_rng(seed).normal(size=(11, 3)))
        exact = shortest_route(travel, start)
        monkeypatch.setattr(route, "EXACT_UP_TO", 2)
        found = shortest_route(travel, start)
        monkeypatch.undo()
        assert not found.is_shortest
        assert start is None or found.order[0] == start
        worst = max(worst, found.travel_mm / exact.travel_mm)
        assert found.travel_mm >= exact.travel_mm * (1 - 1e-12)
    assert worst < 1.05


def test_a_grid_is_walked_row_by_row() -> None:
    points = np.stack(np.meshgrid(np.arange(8.0), np.arange(9.0)), axis=-1).reshape(-1, 2)
    generator = np.random.default_rng(1)
    found = shortest_route(distances(generator.permutation(points)))
    assert found.travel_mm == pytest.approx(71)


def test_the_same_comes_out_again() -> None:
    travel = distances(np.random.default_rng(3).normal(size=(30, 3)))
    np.testing.assert_array_equal(shortest_route(travel).order, shortest_route(travel).order)


def test_travel_is_shift_and_turn_and_lens() -> None:
    poses = [
        Pose.identity(),
        Pose.from_rotation_vector([0, 0, 0.25], [3, 4, 0]),
        Pose.from_rotation_vector([np.pi, 0, 0], [0, 0, 0]),
        Pose.from_rotation_vector([1e-7, 0, 0], [0, 0, 0]),
    ]
    travel = travel_between_mm(poses, lever_mm=100)
    np.testing.assert_allclose(travel[0], [0, 5 + 25, 100 * np.pi, 1e-5], rtol=1e-7)
    np.testing.assert_array_equal(travel, travel.T)
    settings_ = [[10, 20], [12, 50], [10, 20], [np.nan, np.nan]]
    with_lens = travel_between_mm(poses, 100, settings_, mm_per_step=2)
    assert with_lens[0, 1] == pytest.approx(30 + 2 * 30)
    assert travel_between_mm([]).shape == (0, 0)


def test_few_need_no_order() -> None:
    assert shortest_route(np.zeros((0, 0))).order.tolist() == []
    assert shortest_route(np.zeros((1, 1))).order.tolist() == [0]


def test_what_is_no_travel_is_refused() -> None:
    with pytest.raises(InputError, match="must be the same from one viewpoint to another and back"):
        shortest_route(np.array([[0, 1.0], [2, 0]]))
    with pytest.raises(InputError, match=r"symmetric matrix, but was given with shape \(2, 3\)"):
        shortest_route(np.zeros((2, 3)))
    with pytest.raises(InputError, match="there is no viewpoint 2 to start from; there are 2"):
        shortest_route(np.zeros((2, 2)), 2)
    with pytest.raises(InputError, match="lever_mm must be zero or positive, but is -1"):
        travel_between_mm([], -1)
    with pytest.raises(InputError, match="mm_per_step must be zero or positive, but is nan"):
        travel_between_mm([], 1, None, np.nan)
