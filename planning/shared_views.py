"""Candidates for viewpoints that several targets share.

A camera that is aimed at one target sees its neighbours off-centre; one that is aimed between them
sees more of them. Whether it sees them well enough is not decided here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray, IntArray
from lenscal.pose import Pose
from planning.choices import COLUMNS
from planning.plan_record import Plan
from planning.preconditions import asking_of_pupil
from planning.requirements.magnification import image_axis
from planning.stated_views import PLACE, pose_columns, poses_of
from planning.task import Task

#: Targets that are looked at together: a target and its nearest neighbours.
_GROUPS: Final = (2, 3, 4, 6, 9)
#: Targets face the same way when the cosine of the angle between their views is larger.
_SAME_WAY: Final = float(np.cos(np.radians(30)))
#: Distinct d/D of a target's viewpoints that are tried for its group.
_SETTINGS: Final = 3


def own_candidates(plans: Sequence[Plan], each: int) -> pd.DataFrame:
    """Take the viewpoints of every target's own plan: the most robust, and the widest view.

    Parameters
    ----------
    plans
        One per target.
    each
        How many of each.

    Returns
    -------
    pandas.DataFrame
        Columns of a plan that state setting, iris and pose, and aimed_at, the index of the target.
    """
    tables = []
    for index, plan in enumerate(plans):
        table = plan.viewpoints
        widest = table.nsmallest(1, "magnification")
        chosen = table.loc[table.head(each - 1).index.union(widest.index)]
        tables.append(chosen.assign(aimed_at=float(index)))
    names = [*COLUMNS, "iris", *pose_columns(Pose.identity()), "aimed_at"]
    filled = [table[names] for table in tables if len(table)]
    return pd.concat(filled, ignore_index=True) if filled else pd.DataFrame(columns=names)


def shared_candidates(tasks: Sequence[Task], own: pd.DataFrame) -> pd.DataFrame:
    """Aim between neighbours that are seen from the same side.

    Parameters
    ----------
    tasks
        One per target.
    own
        What `own_candidates` gave.

    Returns
    -------
    pandas.DataFrame
        The same columns; aimed_at is −1.
    """
    planned = own["aimed_at"].to_numpy().astype(np.int64)
    # The first of each target is its most robust one: from there its group is looked at.
    first = own.groupby("aimed_at", sort=True).head(1)
    index = [int(target) for target in first["aimed_at"]]
    middles = np.array([tasks[i].seen_feature.centroid_mm for i in index]).reshape(-1, 3)
    towards = first[list(PLACE)].to_numpy() - middles
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    rows: list[dict[str, float]] = []
    seen: set[tuple[int, ...]] = set()
    for k, target in enumerate(index):
        settings = _spread(own[planned == target])
        for group in _groups(k, middles, towards):
            if tuple(sorted(group)) in seen:
                continue
            seen.add(tuple(sorted(group)))
            low, high = middles[group].min(axis=0), middles[group].max(axis=0)
            view = towards[group].mean(axis=0)
            for row, pose in zip(settings.to_dict("records"), poses_of(settings), strict=True):
                distance = float(row["object_distance_mm"])
                turned = _looking(pose, (low + high) / 2, view, distance, tasks[target])
                stated = {str(name): float(value) for name, value in row.items()}
                rows.append(stated | pose_columns(turned) | {"aimed_at": -1.0})
    return pd.DataFrame(rows, columns=list(own.columns), dtype=np.float64)


def with_irises(
    candidates: pd.DataFrame, tasks: Sequence[Task], irises: FloatArray
) -> pd.DataFrame:
    """Where a target asks something of the pupil, try every iris on record for open ones.

    Parameters
    ----------
    candidates
        The candidates; their iris is NaN where their own target does not ask.
    tasks
        All of them.
    irises
        Those on record.

    Returns
    -------
    pandas.DataFrame
        The candidates, those with an open iris several times.
    """
    asked = any(asking_of_pupil(task.requirements) for task in tasks)
    if not asked or len(irises) < 2:
        return candidates
    left_open = candidates["iris"].isna()
    expanded = [candidates[left_open].assign(iris=float(iris)) for iris in irises]
    return pd.concat([candidates[~left_open], *expanded], ignore_index=True)


def _groups(k: int, middles: FloatArray, towards: FloatArray) -> list[IntArray]:
    """A target with its nearest neighbours that are seen from the same side."""
    alike = np.flatnonzero(towards @ towards[k] > _SAME_WAY)
    away = np.linalg.norm(middles[alike] - middles[k], axis=-1)
    nearest = alike[np.argsort(away, kind="stable")]
    return [nearest[:size] for size in _GROUPS if size <= len(nearest)]


def _spread(own: pd.DataFrame) -> pd.DataFrame:
    """The lowest, a middle and the highest d/D; the lowest sees the most."""
    table = own.sort_values("magnification", kind="stable")
    picked = np.unique(np.linspace(0, len(table) - 1, _SETTINGS).round().astype(int))
    return table.iloc[picked]


def _looking(own: Pose, at: FloatArray, view: FloatArray, distance_mm: float, task: Task) -> Pose:
    """Look at a point from a side, rolled as the target's own viewpoint is."""
    z = -view / np.linalg.norm(view)
    column = 1 if image_axis(task.requirements) == "y" else 0
    along = own.rotation[:, column]
    along = along - (along @ z) * z
    along /= np.linalg.norm(along)
    other = np.cross(z, along) if column == 0 else np.cross(along, z)
    columns = [along, other, z] if column == 0 else [other, along, z]
    return Pose(np.stack(columns, axis=-1), at - distance_mm * z)
