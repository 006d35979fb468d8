"""The fewest viewpoints that cover all targets, as an integer programme.

x_v is 1 where viewpoint v is chosen. The sum of x is made as small as it can be, while the sum over
the viewpoints that cover a target is at least 1 for every target (set cover). Among the choices
that are as small, the one is taken whose weakest target has the largest margin, and among those the
one whose viewpoints are the most robust.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from lenscal.arrays import BoolArray, FloatArray, IntArray, frozen_array
from lenscal.errors import InputError, PlanningError

#: Seconds after which the solver gives the best choice so far.
_SECONDS: Final = 60.0
#: By how much less time each of the later searches has, which only make the choice more robust.
_REFINED: Final = 10.0
#: How much the robustness of viewpoints may count against one viewpoint more: less than one in all.
_LITTLE: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """Viewpoints that cover targets.

    Parameters
    ----------
    chosen
        (C,) the viewpoints, in their order.
    uncovered
        (U,) the targets that no viewpoint covers.
    at_least
        How many viewpoints any cover of the other targets needs, as the solver proved.
    smallest_margin
        Margin of the weakest target that is covered; infinite where there is none.
    """

    chosen: IntArray
    uncovered: IntArray
    at_least: int
    smallest_margin: float

    @property
    def is_proven(self) -> bool:
        """Whether no cover has fewer viewpoints."""
        return len(self.chosen) == self.at_least


def fewest_viewpoints(margins: FloatArray, seconds: float = _SECONDS) -> Cover:
    """Choose as few viewpoints as cover all targets that can be covered.

    Parameters
    ----------
    margins
        (V, T) how robustly a viewpoint satisfies all that is asked of a target; negative or −inf
        where it does not.
    seconds
        After how many seconds of search the best choice so far is taken; then it may have more
        viewpoints than needed, and is not made more robust.

    Returns
    -------
    Cover
        The viewpoints. Targets that none of them covers are told, and do not disturb the others.

    Raises
    ------
    InputError
        When a margin is NaN.
    PlanningError
        When the solver finds no choice within its time.
    """
    margins = frozen_array("margins", margins, ("V", "T"), finite=False)
    if np.isnan(margins).any():
        raise InputError(
            "a margin of a viewpoint is NaN; give −inf where it does not cover a target"
        )
    coverable = (margins >= 0).any(axis=0) if len(margins) else np.zeros(margins.shape[1], bool)
    uncovered = np.flatnonzero(~coverable)
    wanted = margins[:, coverable]
    if not wanted.shape[1]:
        return Cover(np.zeros(0, dtype=np.int64), uncovered, 0, np.inf)
    plain = np.ones(len(wanted))
    chosen, at_least = _solve(wanted >= 0, plain, seconds)
    if len(chosen) > at_least:
        return Cover(chosen, uncovered, at_least, float(wanted[chosen].max(axis=0).min()))
    seconds /= _REFINED
    least = _largest_least_margin(wanted, len(chosen), seconds)
    # Of equally few, the sum of how far each is from the most robust decides.
    best = np.where(wanted >= least, wanted, -np.inf).max(axis=1)
    ranks = np.argsort(np.argsort(-best, kind="stable"), kind="stable") / len(best)
    robust, _ = _solve(wanted >= least, plain + _LITTLE * ranks / len(chosen), seconds)
    if len(robust) == len(chosen):
        chosen = robust
    return Cover(chosen, uncovered, at_least, float(wanted[chosen].max(axis=0).min()))


def _largest_least_margin(wanted: FloatArray, count: int, seconds: float) -> float:
    """Halve the margins: the largest that so many viewpoints keep for every target."""
    # No cover keeps more than what the target that is hardest to see has at best.
    levels = np.unique(wanted[(wanted >= 0) & (wanted <= wanted.max(axis=0).min())])
    low, high = 0, len(levels)
    while high - low > 1:
        middle = (low + high) // 2
        chosen, _ = _solve(wanted >= levels[middle], np.ones(len(wanted)), seconds)
        low, high = (middle, high) if len(chosen) == count else (low, middle)
    return float(levels[low])


def _solve(covers: BoolArray, cost: FloatArray, seconds: float) -> tuple[IntArray, int]:
    """Indices of the cheapest cover, and how many viewpoints any cover needs."""
    kept = _undominated(covers, cost)
    rows = csr_array(covers[kept].T.astype(np.float64))
    found = milp(
        cost[kept],
        integrality=np.ones(len(kept), dtype=np.int64),
        bounds=Bounds(0, 1),
        constraints=LinearConstraint(rows, lb=1.0),
        options={"time_limit": seconds},
    )
    if found.x is None:
        raise PlanningError(
            f"no cover of {covers.shape[1]} targets by {len(covers)} viewpoints was found within "
            f"{seconds:g} s ({found.message}); give the search more time or fewer viewpoints"
        )
    bound = found.mip_dual_bound if found.mip_dual_bound is not None else 0.0
    return kept[np.flatnonzero(found.x > 0.5)], int(np.ceil(bound - 1e-6))


def _undominated(covers: BoolArray, cost: FloatArray) -> IntArray:
    """Of viewpoints that cover the same targets, the cheapest; none that covers nothing."""
    order = np.argsort(cost, kind="stable")
    packed = np.packbits(covers[order], axis=1)
    _, first = np.unique(packed, axis=0, return_index=True)
    kept = np.sort(order[first])
    return kept[covers[kept].any(axis=1)]
