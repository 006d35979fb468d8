"""The rows of a plan: one per viewpoint, made of views and their margins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from lenscal.arrays import FloatArray
from planning.choices import COLUMNS
from planning.preconditions import asking_of_pupil
from planning.requirements.margin import Requirement
from planning.stated_views import PLACE, TURN
from planning.task import Task
from planning.views import Views

#: Decimals to which margins, settings and places count as equal.
_DIGITS: Final = 6


def margin_names(task: Task) -> list[str]:
    """Name the columns of margins.

    Parameters
    ----------
    task
        What is asked.

    Returns
    -------
    list of str
        One per kind of requirement.
    """
    return list(dict.fromkeys(f"{r.name}_margin" for r in task.requirements))


def as_table(task: Task, rows: Sequence[Mapping[str, float]]) -> pd.DataFrame:
    """Bring rows into the table of a plan.

    Parameters
    ----------
    task
        What is asked.
    rows
        One per viewpoint.

    Returns
    -------
    pandas.DataFrame
        The most robust first.
    """
    columns = [
        *COLUMNS,
        "iris",
        *PLACE,
        *TURN,
        "angle",
        *margin_names(task),
        *("visibility_margin_mm", "smallest_margin"),
    ]
    table = pd.DataFrame(list(rows), columns=columns, dtype=np.float64)
    # What differs by rounding only is ordered by the setting and the place, on every machine alike.
    order = np.lexsort(
        [
            *(table[name].round(_DIGITS) for name in (*PLACE[::-1], "focus", "zoom")),
            -table["smallest_margin"].round(_DIGITS),
        ]
    )
    return table.iloc[order].reset_index(drop=True)


def rows_of(
    task: Task,
    views: Views,
    requirements: Sequence[Requirement],
    shares: FloatArray,
    angles: FloatArray | None = None,
) -> pd.DataFrame:
    """Bring views into the table of a plan.

    Parameters
    ----------
    task
        What is asked.
    views
        (1, K) views, each at its own place, of a subject with a region.
    requirements
        R that they were judged by.
    shares
        (K, R) their margins as shares.
    angles
        (K,) on the ring in radians; None for general views.

    Returns
    -------
    pandas.DataFrame
        The most robust first.
    """
    states = views.states
    unknown = np.full(len(states), np.nan)
    zoom, focus, iris = states.settings
    centre = states.projection_centre_mm
    # The projection centre of a fixed lens is its own reference: there is no offset to speak of.
    offset = unknown if centre is None else np.where(np.isnan(zoom), np.nan, -centre[:, 2])
    columns: dict[str, FloatArray] = {
        "zoom": zoom,
        "focus": focus,
        "magnification": states.magnification,
        "object_distance_mm": states.object_distance_mm,
        "image_distance_mm": states.image_distance_mm,
        "nodal_offset_mm": offset,
        "standoff_mm": states.object_distance_mm - offset,
        "iris": iris if asking_of_pupil(task.requirements) else unknown,
        "angle": unknown if angles is None else angles,
    }
    turns = Rotation.from_matrix(views.rotations[0]).as_rotvec()
    places = np.concatenate([views.positions_mm[0], turns], axis=1)
    columns |= dict(zip((*PLACE, *TURN), places.T, strict=True))
    for k, requirement in enumerate(requirements):
        name = f"{requirement.name}_margin"
        columns[name] = np.minimum(columns.get(name, np.inf), shares[:, k])
    columns["visibility_margin_mm"] = views.region_distance_mm[0]
    columns["smallest_margin"] = shares.min(axis=1)
    values = zip(*columns.values(), strict=True)
    return as_table(task, [dict(zip(columns, map(float, row), strict=True)) for row in values])
