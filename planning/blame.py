"""Why there is no viewpoint: which requirement would have to give, and by how much.

For each requirement the best that it can come to is sought while all others hold. Where that is
possible at all, giving way by what it lacks there makes the task feasible; the requirement that
lacks the smallest share is named first. It is a search: what it finds can be had, and something
better may exist.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from lenscal.arrays import FloatArray
from planning.requirements.margin import Requirement
from planning.solid import Solid
from planning.view_search import FoundViews, improved
from planning.view_space import Starts

#: Views from which to search, when of each limit an (R,) share is kept.
FindStarts = Callable[[FloatArray], Starts]

#: Views from which each requirement is raised.
_STARTS: Final = 5
#: How many steps.
_ROUNDS: Final = 40
#: By how little a requirement that is held may miss, as a share.
_SLACK: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Relaxation:
    """By how much one requirement would have to give, all others being met.

    Parameters
    ----------
    index
        Which of the requirements.
    name
        Its name.
    lacking
        What it lacks at best, in its unit; positive.
    unit
        The unit.
    lacking_share
        The same as a share of what is asked.
    words
        What is asked, in words.
    place_mm
        Projection centre of the view at which it lacks so little.
    is_asked
        Whether the task states it; that the feature is in the image and visible is wanted of any
        view.
    """

    index: int
    name: str
    lacking: float
    unit: str
    lacking_share: float
    words: str
    place_mm: tuple[float, float, float]
    is_asked: bool = True

    def __str__(self) -> str:
        lacking, unit = self.lacking, "" if self.unit == "d/D" else f" {self.unit}"
        if self.unit == "rad":
            lacking, unit = np.degrees(lacking), "°"
        return (
            f"the {self.words} would have to give by {lacking:.3g}{unit} ({self.lacking_share:.1%})"
        )

    def to_dict(self) -> dict[str, Any]:
        """Give it as JSON can hold it.

        Returns
        -------
        dict
            Requirement, what it lacks, its unit and the share, and where.
        """
        return {
            "requirement": self.name,
            "lacking": self.lacking,
            "unit": self.unit,
            "lacking_share": self.lacking_share,
            "place_mm": list(self.place_mm),
        }


def relaxations(
    requirements: Sequence[Requirement],
    found: FoundViews[Starts],
    kept: FloatArray,
    asked: int,
    find_starts: FindStarts,
) -> tuple[Relaxation, ...]:
    """Find the single requirements whose giving way would make a task feasible.

    Parameters
    ----------
    requirements
        R of them.
    found
        Views at which the smallest margin is as large as can be, none of them positive throughout.
    kept
        (R,) the share of each limit that is kept besides.
    asked
        How many of the requirements, the first ones, the task states.
    find_starts
        Gives views from which to search, when of each limit an (R,) share is kept.

    Returns
    -------
    tuple of Relaxation
        First those that the task states, the one that lacks the smallest share in front; empty when
        no single one would do.
    """
    order = np.argsort(-(found.shares - kept).min(axis=1), kind="stable")[:_STARTS]
    starts = found.some(order)
    count = len(requirements)
    first = _raised(requirements, [starts.views] * count, kept)
    # Where it may lack as much as that, other views are as good, and some lead farther.
    given = kept + np.zeros((count, 1))
    lacking = [best.shares[0, k] if len(best) else -1.0 for k, best in enumerate(first)]
    np.fill_diagonal(given, lacking)
    second = _raised(requirements, [find_starts(row) for row in given], kept)
    single = []
    for index, both in enumerate(zip(first, second, strict=True)):
        possible = [best for best in both if len(best)]
        if possible:
            best = max(possible, key=lambda found: float(found.values[0, index]))
            single.append(_relaxation(requirements, index, best, kept))
    stated = [replace(relaxation, is_asked=relaxation.index < asked) for relaxation in single]
    return tuple(sorted(stated, key=lambda r: (not r.is_asked, r.lacking_share)))


def why_none(
    blamed: Sequence[Relaxation],
    requirements: Sequence[Requirement],
    found: FoundViews[Any],
    kept: FloatArray,
    workspace: Solid,
) -> str:
    """Say why there is no view.

    Parameters
    ----------
    blamed
        What `relaxations` gave.
    requirements
        R of them.
    found
        The views that come nearest.
    kept
        (R,) the share of each limit that is kept besides.
    workspace
        Where the projection centre may be.

    Returns
    -------
    str
        A sentence that begins with the name of what is to blame.
    """
    if blamed:
        named = [_in_words(relaxation, workspace) for relaxation in blamed]
        # What would have to give all that is asked is no alternative.
        more = "".join(
            f"; or {words}"
            for relaxation, (_, words) in zip(blamed[1:], named[1:], strict=True)
            if relaxation.lacking_share < 1
        )
        return f"{named[0][0]}: no view satisfies everything; {named[0][1]}{more}"
    spare = found.shares - kept
    best = spare[int(np.argmax(spare.min(axis=1)))]
    short = ", ".join(
        f"{r.name} lacks {-share:.1%}"
        for r, share in zip(requirements, best, strict=True)
        if share < 0
    )
    return (
        "several requirements together: no single one could give way and make the task possible; "
        f"in the view that comes nearest {short}"
    )


def _in_words(relaxation: Relaxation, workspace: Solid) -> tuple[str, str]:
    """What is to blame, and what would have to change."""
    if relaxation.name != "visibility":
        return relaxation.name, str(relaxation)
    place = np.array(relaxation.place_mm)
    where = ", ".join(f"{x:.1f}" for x in place)
    if not workspace.contains(place):
        beyond = float(workspace.distance_to_surface_mm(place))
        return (
            "workspace",
            f"the workspace would have to reach {beyond:.3g} mm farther, to ({where}) mm",
        )
    if relaxation.is_asked:
        return relaxation.name, str(relaxation)
    return (
        "visibility",
        f"the part would have to be open {relaxation.lacking:.3g} mm farther, for a view from "
        f"({where}) mm",
    )


def _relaxation(
    requirements: Sequence[Requirement], index: int, best: FoundViews[Starts], kept: FloatArray
) -> Relaxation:
    """What one requirement lacks in the one view that is best for it."""
    value, share = float(best.values[0, index]), float(best.shares[0, index])
    # What is kept besides is a share of the limit, in the unit as much as that.
    limit = value / share if share else 0.0
    view = best.views.as_views()[0]
    x, y, z = view.positions_mm[0, 0]
    return Relaxation(
        index,
        requirements[index].name,
        max(kept[index] * limit - value, 0.0),
        requirements[index].margin(view).unit,
        max(float(kept[index]) - share, 0.0),
        requirements[index].describe(view.states.sensor),
        (float(x), float(y), float(z)),
    )


def _raised(
    requirements: Sequence[Requirement], starts: Sequence[Starts], kept: FloatArray
) -> list[FoundViews[Starts]]:
    """For each requirement the view, or none, at which it is best while all others hold.

    All are sought at once, from starts for each.
    """
    whose = np.repeat(np.arange(len(requirements)), [len(views) for views in starts])
    raised = whose[:, None] == np.arange(len(requirements))
    together = starts[0].joined(starts[1:])
    found = improved(
        requirements, together, kept=kept, raised=raised, by_value=True, rounds=_ROUNDS
    )
    others = np.where(raised, np.inf, found.shares - kept).min(axis=1)
    value = found.values[np.arange(len(found)), whose]
    possible = (others >= -_SLACK) & np.isfinite(value)
    best = []
    for index in range(len(requirements)):
        rows = np.flatnonzero(possible & (whose == index))
        best.append(found.some(rows[np.argsort(-value[rows], kind="stable")[:1]]))
    return best
