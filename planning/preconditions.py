"""What a lens must be known by for a task, checked before any work is done."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lenscal.errors import PlanningError
from planning.fixed_lens import FixedLens
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.margin import Requirement
from planning.requirements.unvignetted import Unvignetted

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap


def asking_of_pupil(requirements: Sequence[Requirement]) -> list[Requirement]:
    """Pick the requirements that depend on the entrance pupil, and so on the iris.

    Parameters
    ----------
    requirements
        All of them.

    Returns
    -------
    list of Requirement
        Those, in their order.
    """
    return [r for r in requirements if isinstance(r, DepthOfField | Unvignetted)]


def refuse_unknown(requirements: Sequence[Requirement], lens: LensMap | FixedLens) -> None:
    """Refuse requirements that cannot be judged with what is known of a lens.

    Parameters
    ----------
    requirements
        What is asked.
    lens
        The lens.

    Raises
    ------
    PlanningError
        When the entrance pupil is needed but not known, or the place of the projection centre in
        the lens.
    """
    of_pupil = [requirement.name for requirement in asking_of_pupil(requirements)]
    fixed = isinstance(lens, FixedLens)
    pupil = lens.entrance_pupil_diameter_mm if isinstance(lens, FixedLens) else lens.pupil
    if of_pupil and pupil is None:
        way = (
            "give FixedLens(..., entrance_pupil_diameter_mm=...)"
            if fixed
            else "calibrate a session whose autofocus measures by edge_width and fit the map again"
        )
        raise PlanningError(
            f"to judge {of_pupil[0]} planning needs the entrance-pupil diameter, which this "
            f"{'fixed lens' if fixed else 'lens map'} does not know; {way}, or leave {of_pupil[0]} "
            "out"
        )
    of_body = any(isinstance(r, Clearance) for r in requirements)
    if of_body and not isinstance(lens, FixedLens) and not lens.has_standoff:
        raise PlanningError(
            "to judge clearance planning needs to know where the projection centre lies in the "
            "lens, but this lens map has no nodal offsets, since no robot's poses were recorded; "
            "record a session with a positioner and fit the map again, or leave clearance out"
        )
