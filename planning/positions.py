"""Where a camera may stand that looks in a chosen direction: an exact solid.

For a fixed direction, roll and lens state, field of view and depth of field are half-spaces of
positions of the projection centre; incidence is held by a pyramid, and resolution where the feature
is seen perpendicularly by a plane. All of them are cut out of the region of visibility.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import PlanningError
from planning.half_spaces import HalfSpaces
from planning.lens_states import LensStates
from planning.requirements.margin import Polyhedral, Requirement
from planning.solid import Solid
from planning.views import Subject


def positions_for(
    requirements: Sequence[Requirement],
    subject: Subject,
    states: LensStates,
    rotation: FloatArray,
) -> Solid:
    """Give all positions from which a direction satisfies what is polyhedral of the requirements.

    Parameters
    ----------
    requirements
        What shall hold. Clearance and an unvignetted pupil are not polyhedral, nor is resolution of
        a feature that is seen obliquely or through distortion: there the margin of a view has the
        last word.
    subject
        What is looked at, with its region.
    states
        One lens state.
    rotation
        (3, 3) of part_from_camera.

    Returns
    -------
    Solid
        Positions of the projection centre in the part's frame; empty when there are none. From a
        position outside of it the requirements do not hold, apart from what incidence gives up
        for its pyramid and field of view for the bulges of distortion.

    Raises
    ------
    PlanningError
        When the subject has no region, or there is not exactly one lens state.
    """
    if subject.region is None:
        raise PlanningError(
            "positions are cut out of the region of visibility, but there is none; compute it with "
            "visibility_region(...) and give Subject(..., region=...)"
        )
    if len(states) != 1:
        raise PlanningError(
            f"positions are those of one lens state, but there are {len(states)}; ask for each"
        )
    bounds = HalfSpaces.everywhere()
    for requirement in requirements:
        if isinstance(requirement, Polyhedral):
            bounds = bounds & requirement.half_spaces(np.asarray(rotation), states, subject)
    return bounds.cut(subject.region.solid)
