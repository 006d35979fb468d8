"""Raising the margins of views: where a camera stands best, and what is in the way when it cannot.

MVP searched eight parameters from a lucky start. Here the region of visibility says where to start,
see `planning.candidates`, and the smallest of all margins is raised from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.ascent import raise_smallest
from planning.judgement import judge
from planning.requirements.margin import Requirement
from planning.robustness import robustness_of
from planning.view_errors import ViewErrors
from planning.view_space import Starts

S = TypeVar("S", bound=Starts)

#: Draws from which σ of the margins is taken while searching.
_DRAWS: Final = 64
#: Steps for which σ counts as constant.
_STEPS_PER_SIGMA: Final = 6
#: σ of a margin counts as no less than this share, so that one that never changes stays finite.
_LEAST_SIGMA: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class FoundViews(Generic[S]):
    """Views and their margins.

    Parameters
    ----------
    views
        K views.
    shares
        (K, R) margin of each requirement as a share, −inf where the lens cannot be set so.
    values
        (K, R) the same in the requirement's unit.
    """

    views: S
    shares: FloatArray
    values: FloatArray

    @classmethod
    def judged(cls, requirements: Sequence[Requirement], views: S) -> FoundViews[S]:
        """Judge views.

        Parameters
        ----------
        requirements
            R of them.
        views
            K views.

        Returns
        -------
        FoundViews
            With their margins.
        """
        as_views, valid = views.as_views()
        judgement = judge(requirements, as_views)
        shares = judgement.shares[0]
        values = np.stack([margin.value[0] for margin in judgement.margins], axis=-1)
        return cls(
            views,
            np.where(valid[:, None], shares, -np.inf),
            np.where(valid[:, None], values, -np.inf),
        )

    def some(self, which: IntArray | BoolArray) -> FoundViews[S]:
        """Take some of them.

        Parameters
        ----------
        which
            Indices or a mask.

        Returns
        -------
        FoundViews
            Those.
        """
        return FoundViews(self.views.some(which), self.shares[which], self.values[which])

    def merged(self, other: FoundViews[S], taken: BoolArray) -> FoundViews[S]:
        """Take some from others.

        Parameters
        ----------
        other
            As many views.
        taken
            (K,) which of them are better.

        Returns
        -------
        FoundViews
            Those, and the own ones besides.
        """
        rows = taken[:, None]
        return FoundViews(
            self.views.merged(other.views, taken),
            np.where(rows, other.shares, self.shares),
            np.where(rows, other.values, self.values),
        )

    def __len__(self) -> int:
        return len(self.views)


def improved(
    requirements: Sequence[Requirement],
    starts: S,
    *,
    kept: FloatArray | float = 0.0,
    raised: BoolArray | None = None,
    by_value: bool = False,
    weights: FloatArray | None = None,
    rounds: int = 30,
) -> FoundViews[S]:
    """Move views to where the smallest of their margins is largest.

    Parameters
    ----------
    requirements
        R of them.
    starts
        K views.
    kept
        (R,) the share of each limit that is kept besides; it is taken off the margins.
    raised
        (R,) or (K, R) the margins whose smallest is raised, while the others are kept positive;
        None for all.
    by_value
        Whether what is raised counts in its unit, and not as a share.
    weights
        (K, R) what each margin is multiplied with; None for 1.
    rounds
        How many steps.

    Returns
    -------
    FoundViews
        K views, with their margins as they are.
    """
    shape = len(starts), len(requirements)
    raised = np.broadcast_to(True if raised is None else raised, shape)

    def margins(which: IntArray, moves: FloatArray) -> FloatArray:
        found = FoundViews.judged(requirements, starts.some(which).moved(moves))
        table = (found.shares - kept).reshape(*moves.shape[:2], len(requirements))
        if by_value:
            values = found.values.reshape(table.shape)
            table = np.where(raised[which, None], values, table)
        return table

    end = raise_smallest(
        margins,
        (len(starts), starts.size),
        raised=raised,
        limits=starts.limits,
        weights=weights,
        rounds=rounds,
    )
    return FoundViews.judged(requirements, starts.moved(end.moves[:, None]))


def improved_in_sigma(
    requirements: Sequence[Requirement],
    starts: S,
    errors: ViewErrors,
    *,
    kept: FloatArray | float = 0.0,
    rounds: int = 30,
) -> tuple[FoundViews[S], FloatArray]:
    """Move views to where the smallest of their margins, each in its own σ, is largest.

    σ changes from place to place. It is taken as constant for a few steps; where that led to a
    place with a larger one, so that nothing was won, the way is tried again with that.

    Parameters
    ----------
    requirements
        R of them.
    starts
        K views.
    errors
        How well lens and robot are known.
    kept
        (R,) the share of each limit that is kept besides; it is taken off the margins.
    rounds
        How many steps.

    Returns
    -------
    found : FoundViews
        K views, with their margins as they are.
    smallest : FloatArray
        (K,) the smallest margin of each in σ.
    """
    views = starts
    largest = np.maximum(sigmas(requirements, views, errors), _LEAST_SIGMA)
    found = FoundViews.judged(requirements, views)
    smallest = ((found.shares - kept) / largest).min(axis=1)
    for _ in range(max(1, rounds // _STEPS_PER_SIGMA)):
        tried = improved(
            requirements, views, kept=kept, weights=1.0 / largest, rounds=_STEPS_PER_SIGMA
        )
        sigma = np.maximum(sigmas(requirements, tried.views, errors), _LEAST_SIGMA)
        spare = ((tried.shares - kept) / sigma).min(axis=1)
        better = spare > smallest
        largest = np.maximum(largest, sigma)
        smallest = np.where(better, spare, smallest)
        found = found.merged(tried, better)
        views = found.views
    return found, smallest


def sigmas(requirements: Sequence[Requirement], views: Starts, errors: ViewErrors) -> FloatArray:
    """Give σ of the margins of views.

    Parameters
    ----------
    requirements
        R of them.
    views
        K views.
    errors
        How well lens and robot are known.

    Returns
    -------
    FloatArray
        (K, R) standard deviation of each margin as a share.
    """
    return robustness_of(requirements, views.as_views()[0], errors, _DRAWS).sigma_share
