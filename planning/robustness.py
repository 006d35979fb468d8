"""How likely views satisfy everything at once, when lens and robot are only so well known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, frozen_array
from planning.judgement import judge
from planning.requirements.margin import Requirement
from planning.view_errors import ViewErrors
from planning.views import Views

#: Views that are drawn at once.
_AT_ONCE: Final = 16_384
#: A margin that says −inf counts as this, so that σ stays a number.
_NOTHING: Final = -10.0


@dataclass(frozen=True, slots=True, eq=False)
class Robustness:
    """What errors of lens and robot leave of K views.

    Parameters
    ----------
    probability
        (K,) share of the draws in which all requirements hold together.
    sigma_share
        (K, R) standard deviation of each margin as a share.
    each
        (K, R) share of the draws in which each requirement holds by itself.
    draws
        How many draws there were.
    """

    probability: FloatArray
    sigma_share: FloatArray
    each: FloatArray
    draws: int

    def __post_init__(self) -> None:
        for name, shape in (
            ("probability", ("K",)),
            ("sigma_share", ("K", "R")),
            ("each", ("K", "R")),
        ):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), shape))

    @property
    def sigma_probability(self) -> FloatArray:
        """(K,) σ of the probability, were the draws independent; evenly spread, they are better."""
        return np.asarray(np.sqrt(self.probability * (1 - self.probability) / self.draws))


def robustness_of(
    requirements: Sequence[Requirement],
    views: Views,
    errors: ViewErrors,
    draws: int = 4096,
    seed: int = 0,
) -> Robustness:
    """Draw what views may really be, and judge each draw by everything.

    Nothing is taken to be linear: each draw is a camera of its own at a place of its own, and the
    same draws serve all requirements, so that what fails together counts once.

    Parameters
    ----------
    requirements
        R of them; visibility only counts where it is among them.
    views
        (1, K) views, each at its own place.
    errors
        How well lens and robot are known.
    draws
        How many draws for each view; best a power of two.
    seed
        Of the draws.

    Returns
    -------
    Robustness
        One row per view.
    """
    normals = errors.normals(draws, seed)
    count = views.shape[1]
    step = max(1, _AT_ONCE // draws)
    shares = []
    for start in range(0, count, step):
        redrawn = errors.redrawn(views.some_states(slice(start, start + step)), normals)
        judged = judge(requirements, redrawn).shares
        shares.append(judged.reshape(-1, draws, len(requirements)))
    drawn = np.maximum(np.concatenate(shares), _NOTHING)
    holds = drawn >= 0
    return Robustness(holds.all(axis=-1).mean(axis=1), drawn.std(axis=1), holds.mean(axis=1), draws)
