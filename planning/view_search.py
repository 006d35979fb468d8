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
from planning.view_errors import ViewErrors
from planning.view_space import Starts

S = TypeVar("S", bound=Starts)

#: Draws from which σ of the margins is taken while searching.
_DRAWS: Final = 64
#: σ of a margin counts as no less than this share, so that one that never changes stays finite.
LEAST_SIGMA: Final = 1e-6


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
        margins = judge(requirements, as_views).margins
        shares = np.stack([margin.share[0] for margin in margins], axis=-1)
        values = np.stack([margin.value[0] for margin in margins], axis=-1)
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

    def __len__(self) -> int:
        return len(self.views)


def improved(
    requirements: Sequence[Requirement],
    starts: S,
    *,
    kept: FloatArray | float = 0.0,
    raised: BoolArray | None = None,
    by_value: bool = False,
    errors: ViewErrors | None = None,
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
        (R,) the margins whose smallest is raised, while the others are kept positive; None for
        all.
    by_value
        Whether what is raised counts in its unit, and not as a share.
    errors
        How well lens and robot are known: then each margin counts in the σ that it has at the
        start. None: as a share.
    rounds
        How many steps.

    Returns
    -------
    FoundViews
        K views, with their margins as they are.
    """
    raised = np.ones(len(requirements), dtype=bool) if raised is None else raised
    weights = None
    if errors is not None:
        weights = 1.0 / np.maximum(sigmas(requirements, starts, errors), LEAST_SIGMA)

    def margins(which: IntArray, moves: FloatArray) -> FloatArray:
        found = FoundViews.judged(requirements, starts.some(which).moved(moves))
        table = found.shares - kept
        if by_value:
            table = np.where(raised, found.values, table)
        return table.reshape(*moves.shape[:2], len(requirements))

    end = raise_smallest(
        margins,
        (len(starts), starts.size),
        raised=raised,
        limits=starts.limits,
        weights=weights,
        rounds=rounds,
    )
    return FoundViews.judged(requirements, starts.moved(end.moves[:, None]))


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
    normals = errors.normals(_DRAWS, 0)
    redrawn = errors.redrawn(views.as_views()[0], normals)
    shares = [
        np.maximum(margin.share[0], -10.0).reshape(len(views), _DRAWS).std(axis=1)
        for margin in judge(requirements, redrawn).margins
    ]
    return np.stack(shares, axis=-1)
