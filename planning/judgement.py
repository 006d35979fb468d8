"""All requirements at once: the margins of many views, block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, IntArray
from lenscal.errors import PlanningError
from planning.requirements.margin import Margin, Requirement
from planning.views import Views

#: Views that are judged at once, so that what is computed on the way stays in the cache.
_AT_ONCE: Final = 8192


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """The margins of V × S views, one of each requirement.

    Parameters
    ----------
    margins
        One per requirement, in their order.
    """

    margins: tuple[Margin, ...]

    @property
    def shares(self) -> FloatArray:
        """(V, S, R) the share of each requirement."""
        return np.stack([margin.share for margin in self.margins], axis=-1)

    @property
    def smallest_share(self) -> FloatArray:
        """(V, S) the smallest share of all requirements: how robustly a view satisfies them."""
        return np.asarray(np.minimum.reduce([margin.share for margin in self.margins]))

    @property
    def binding(self) -> IntArray:
        """(V, S) which requirement has the smallest share, as an index."""
        return np.asarray(np.argmin([margin.share for margin in self.margins], axis=0))

    @property
    def holds(self) -> npt.NDArray[np.bool_]:
        """(V, S) whether all requirements are satisfied, their limits included."""
        return np.asarray(self.smallest_share >= 0)


def judge(requirements: Sequence[Requirement], views: Views) -> Judgement:
    """Judge views by all requirements.

    Parameters
    ----------
    requirements
        One or more.
    views
        V × S views.

    Returns
    -------
    Judgement
        A margin of shape (V, S) for each.

    Raises
    ------
    PlanningError
        When there is no requirement.
    """
    if not requirements:
        raise PlanningError(
            "views are judged by requirements, but there are none; give one, such as "
            "Resolution(3, 0.254)"
        )
    viewpoints, states = views.shape
    step = max(1, _AT_ONCE // states)
    # A block keeps what one requirement computed for the next.
    blocks = [views.some(slice(start, start + step)) for start in range(0, viewpoints, step)]
    return Judgement(
        tuple(
            requirement.margin(views)
            if len(blocks) < 2 or getattr(requirement, "judges_all_at_once", False)
            else _by_blocks(requirement, blocks, views)
            for requirement in requirements
        )
    )


def _by_blocks(requirement: Requirement, blocks: Sequence[Views], views: Views) -> Margin:
    viewpoints, states = views.shape
    value, share = np.zeros((states, viewpoints)), np.zeros((states, viewpoints))
    start = 0
    for block in blocks:
        margin = requirement.margin(block)
        part = slice(start, start := start + block.shape[0])
        value[:, part], share[:, part] = margin.value.T, margin.share.T
    return Margin(value.T, margin.unit, share.T, margin.binds)
