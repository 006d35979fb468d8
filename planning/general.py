"""General views: viewpoints from anywhere in any direction, at the best of all margins."""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, IntArray
from planning.candidates import Candidates
from planning.view_errors import ViewErrors
from planning.view_search import FoundViews, improved, improved_in_sigma
from planning.view_space import GeneralStarts

#: Starts, how many steps all of them are followed, and how many of them to the end.
_STARTS, _FIRST_STEPS, _FOLLOWED, _STEPS = 12, 6, 6, 24
#: Views nearer than this share of D, and turned and set by less than this, are one.
_SAME: Final = 0.02


def general_views(
    candidates: Candidates, kept: FloatArray, errors: ViewErrors | None
) -> FoundViews[GeneralStarts]:
    """Search for the views whose smallest margin is largest.

    Parameters
    ----------
    candidates
        Where the search may start; what shall hold, visibility among it.
    kept
        (R,) the share of each limit that is kept besides.
    errors
        How well lens and robot are known: then margins count in σ.

    Returns
    -------
    FoundViews
        Views that differ from each other, the most robust first, whether they satisfy all or not.
    """
    starts, requirements = candidates.best(_STARTS, kept), candidates.requirements
    for rounds in (_FIRST_STEPS, _STEPS):
        if errors is None:
            found = improved(requirements, starts, kept=kept, rounds=rounds)
            smallest: FloatArray = (found.shares - kept).min(axis=1)
        else:
            found, smallest = improved_in_sigma(
                requirements, starts, errors, kept=kept, rounds=rounds
            )
        found = found.some(_distinct(found, smallest)[:_FOLLOWED])
        starts = found.views
    return found


def _distinct(found: FoundViews[GeneralStarts], promise: FloatArray) -> IntArray:
    """Indices of the views that differ, the most promising first."""
    views = found.views.as_views()[0]
    places = views.positions_mm[0] / views.states.object_distance_mm[:, None]
    features = np.concatenate(
        [places, views.rotations[0].reshape(-1, 9), found.views.shares], axis=1
    )
    chosen: list[int] = []
    for k in np.argsort(-promise, kind="stable"):
        if not (np.abs(features[chosen] - features[k]) < _SAME).all(axis=1).any():
            chosen.append(int(k))
    return np.array(chosen, dtype=np.intp)
