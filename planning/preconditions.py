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
    of_pupil = [r for r in requirements if isinstance(r, DepthOfField | Unvignetted)]
    fixed = isinstance(lens, FixedLens)
    known = lens.entrance_pupil_diameter_mm if isinstance(lens, FixedLens) else lens.pupil
    if of_pupil and known is None:
        way = (
            "give FixedLens(..., entrance_pupil_diameter_mm=...) or FixedLens.with_f_number"
            if fixed
            else "calibrate a session whose autofocus measures by edge_width, wide open, and fit the "
            "map again"
        )
        raise PlanningError(
            f"to judge {of_pupil[0].name} planning needs the entrance-pupil diameter, which is not known of this lens; {way}, or leave "
            f"{of_pupil[0].name} out"
        )
    clearances = [r for r in requirements if isinstance(r, Clearance)]
    if clearances and not isinstance(lens, FixedLens) and not lens.has_standoff:
        raise PlanningError(
            "clearance needs to know where the projection centre lies in the lens, but this map has "
            "no nodal offsets, since no robot poses were recorded; record a session with a "
            "positioner and fit the map again, or leave clearance out"
        )
