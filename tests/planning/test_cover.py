"""The fewest viewpoints, against trying all choices."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.errors import InputError, PlanningError
from planning.cover import fewest_viewpoints


def by_trying(margins: np.ndarray) -> tuple[int, float]:
    """The fewest, and the largest margin of the weakest target among as few."""
    wanted = margins[:, (margins >= 0).any(axis=0)]
    for count in range(wanted.shape[1] + 1):
        least = [
            wanted[list(choice)].max(axis=0, initial=-np.inf).min(initial=np.inf)
            for choice in itertools.combinations(range(len(wanted)), count)
        ]
        if max(least, default=-1.0) >= 0:
            return count, max(least)
    raise AssertionError


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 9), st.integers(1, 7), st.floats(0.1, 0.7))
def test_no_choice_is_better(seed: int, viewpoints: int, targets: int, share: float) -> None:
    generator = np.random.default_rng(seed)
    margins = generator.uniform(0, 1, (viewpoints, targets))
    margins[generator.random(margins.shape) > share] = -np.inf
    found = fewest_viewpoints(margins)
    count, least = by_trying(margins)
    assert len(found.chosen) == found.at_least == count
    assert found.is_proven
    assert found.smallest_margin == least
    covered = (margins[found.chosen] >= 0).any(axis=0)
    np.testing.assert_array_equal(np.flatnonzero(~covered), found.uncovered)


def test_of_equally_good_choices_the_more_robust_one_is_taken() -> None:
    margins = np.array([[0.3, -1, 0.2], [-1, 0.4, -1], [0.9, -1, 0.2], [-1, 0.2, -1]])
    found = fewest_viewpoints(margins)
    assert found.chosen.tolist() == [1, 2]
    assert found.smallest_margin == pytest.approx(0.2)


def test_nothing_to_cover() -> None:
    found = fewest_viewpoints(np.full((3, 2), -np.inf))
    assert found.chosen.tolist() == []
    assert found.uncovered.tolist() == [0, 1]
    assert found.is_proven
    assert fewest_viewpoints(np.zeros((0, 2))).uncovered.tolist() == [0, 1]


def test_what_is_no_margin_is_refused() -> None:
    with pytest.raises(InputError, match="a margin of a viewpoint is NaN; give −inf"):
        fewest_viewpoints(np.array([[np.nan]]))


def test_without_time_the_gap_is_told_or_nothing_found() -> None:
    """A cover that is hard to prove: what is given then covers, and says what is not proved."""
    generator = np.random.default_rng(0)
    margins = np.where(generator.random((600, 120)) < 0.05, 1.0, -np.inf)
    with pytest.raises(PlanningError, match="of 120 targets by 600 viewpoints was found within 1e"):
        fewest_viewpoints(margins, seconds=1e-9)
    found = fewest_viewpoints(margins, seconds=0.5)
    assert (margins[found.chosen] >= 0).any(axis=0).all()
    assert found.at_least < len(found.chosen)
    assert not found.is_proven
