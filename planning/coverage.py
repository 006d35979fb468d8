"""Which viewpoints satisfy all that is asked of which targets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray, IntArray
from lenscal.progress import Progress
from planning.judgement import judge
from planning.plan_record import Plan
from planning.requirements.clearance import Clearance
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.margin import BoundsMagnification, Requirement
from planning.requirements.visibility import Visibility
from planning.robot_cell import RobotCell
from planning.robustness import robustness_of
from planning.stated_views import PLACE, poses_of, states_of
from planning.view_errors import ViewErrors
from planning.views import Subject, Views

#: How far beyond the corner of the sensor, as a share, a feature's middle is still looked for.
_BEYOND: Final = 1.5


def coverage(
    plans: Sequence[Plan],
    candidates: pd.DataFrame,
    safety: float,
    cell: RobotCell | None = None,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Judge candidates by all that is asked of every target that they may see.

    A viewpoint that is not the target's own must have the target's whole feature in its image, even
    where no field of view is asked for, and keeps the limits of resolution and field of view by the
    safety.

    Parameters
    ----------
    plans
        One per target, with the region from which it is seen.
    candidates
        V viewpoints: setting, iris, pose and aimed_at.
    safety
        By which share of itself such limits are kept.
    cell
        The robot cell, whose errors count where a task asks for a confidence.
    progress
        Told how many targets are done with.

    Returns
    -------
    pandas.DataFrame
        One row per candidate and target that it covers: candidate, target, a margin for each kind
        of requirement as a share, visibility_margin_mm and smallest_margin; where a task asks for
        a confidence, probability.
    """
    rotations = np.array([pose.rotation for pose in poses_of(candidates)]).reshape(-1, 3, 3)
    names = dict.fromkeys(f"{r.name}_margin" for p in plans for r in p.task.requirements)
    columns = ["candidate", "target", *names, "visibility_margin_mm", "smallest_margin"]
    columns += ["probability"] if any(p.task.confidence is not None for p in plans) else []
    tables = [pd.DataFrame(columns=columns, dtype=np.float64)]
    for target, plan in enumerate(plans):
        near = _may_see(plan, candidates, rotations)
        if len(near):
            needs = np.where(candidates["aimed_at"].to_numpy()[near] == target, 0.0, safety)
            found = _judged(plan, candidates.iloc[near], rotations[near], needs, cell)
            tables.append(found.assign(candidate=near[found.index], target=target))
        if progress is not None:
            progress(target + 1, len(plans), plan.task.name)
    filled = [table.reindex(columns=columns) for table in tables if len(table)]
    whole = pd.concat(filled, ignore_index=True) if filled else tables[0]
    for clearance in dict.fromkeys(r for p in plans for r in _clearances(p.task.requirements)):
        whole = _that_clear(whole, clearance, plans, candidates, rotations)
    return whole


def margin_matrix(covered: pd.DataFrame, candidates: int, targets: int) -> FloatArray:
    """Lay the smallest margins out.

    Parameters
    ----------
    covered
        What `coverage` gave.
    candidates, targets
        How many there are.

    Returns
    -------
    FloatArray
        (V, T), −inf where a candidate does not cover a target.
    """
    margins = np.full((candidates, targets), -np.inf)
    rows, columns = (covered[name].to_numpy(dtype=np.int64) for name in ("candidate", "target"))
    margins[rows, columns] = covered["smallest_margin"]
    return margins


def _may_see(plan: Plan, candidates: pd.DataFrame, rotations: FloatArray) -> IntArray:
    """Candidates in whose field the middle of the feature may lie."""
    if plan.region is None or plan.region.is_empty or not len(candidates):
        return np.zeros(0, dtype=np.int64)
    towards = plan.task.seen_feature.centroid_mm - candidates[list(PLACE)].to_numpy()
    depth = np.einsum("vi,vi->v", towards, rotations[:, :, 2])
    aside = np.linalg.norm(towards - depth[:, None] * rotations[:, :, 2], axis=-1)
    sensor = states_of(plan.lens, candidates.iloc[:1]).sensor
    half = np.hypot(sensor.width_mm, sensor.height_mm) / 2
    reach = _BEYOND * half * depth / candidates["image_distance_mm"].to_numpy()
    return np.flatnonzero((depth > 0) & (aside <= reach))


def _judged(
    plan: Plan,
    candidates: pd.DataFrame,
    rotations: FloatArray,
    needs: FloatArray,
    cell: RobotCell | None,
) -> pd.DataFrame:
    """Margins of one target in those candidates that hold, clearance left out.

    ``needs`` is the safety: zero for the viewpoints of the target's own plan, which has seen to it.
    """
    views = _views(plan, candidates, rotations)
    sees = np.flatnonzero(views.region_distance_mm[0] > 0)
    candidates, rotations, needs = candidates.iloc[sees], rotations[sees], needs[sees]
    if not len(sees):
        return pd.DataFrame()
    views = _views(plan, candidates, rotations)
    requirements = [r for r in plan.task.requirements if not isinstance(r, Clearance)]
    in_image = FieldOfView(plan.task.seen_feature.size_mm)
    judged = judge([*requirements, in_image], views)
    holds = (needs == 0) | (judged.margins[-1].share[0] >= needs)
    depth_mm = views.region_distance_mm[0]
    shares: dict[str, FloatArray] = {}
    for requirement, margin in zip(requirements, judged.margins, strict=False):
        share = margin.share[0]
        holds &= share >= (needs if isinstance(requirement, BoundsMagnification) else 0.0)
        name = f"{requirement.name}_margin"
        shares[name] = np.minimum(shares.get(name, np.inf), share)
    smallest = np.minimum.reduce([*shares.values(), depth_mm / views.states.object_distance_mm])
    table = pd.DataFrame(
        {**shares, "visibility_margin_mm": depth_mm, "smallest_margin": smallest}, index=sees
    )
    held: pd.DataFrame = table[holds]
    if plan.task.confidence is None or not len(held):
        return held
    sure = held.assign(probability=_probability(plan, candidates[holds], rotations[holds], cell))
    confident: pd.DataFrame = sure[sure["probability"] >= plan.task.confidence]
    return confident


def _probability(
    plan: Plan, candidates: pd.DataFrame, rotations: FloatArray, cell: RobotCell | None
) -> FloatArray:
    """(K,) with which all that is asked of a target holds together."""
    asked = [*plan.task.requirements, Visibility()]
    views = _views(plan, candidates, rotations)
    return robustness_of(asked, views, ViewErrors(plan.lens, cell)).probability


def _views(plan: Plan, candidates: pd.DataFrame, rotations: FloatArray) -> Views:
    """Every candidate at its own state, as one row of views."""
    subject = Subject(plan.task.target, plan.task.seen_feature, plan.scene, plan.region)
    places = candidates[list(PLACE)].to_numpy()
    return Views(places[None], rotations[None], states_of(plan.lens, candidates), subject)


def _clearances(requirements: Sequence[Requirement]) -> list[Clearance]:
    return [r for r in requirements if isinstance(r, Clearance)]


def _that_clear(
    covered: pd.DataFrame,
    clearance: Clearance,
    plans: Sequence[Plan],
    candidates: pd.DataFrame,
    rotations: FloatArray,
) -> pd.DataFrame:
    """Keep the rows whose candidate stays clear, where the target asks for it.

    What a body touches does not depend on the target, so each candidate is judged once.
    """
    asks = np.array([clearance in _clearances(plan.task.requirements) for plan in plans])
    asked = asks[covered["target"].to_numpy(dtype=np.int64)]
    which = np.unique(covered["candidate"].to_numpy(dtype=np.int64)[asked])
    if not len(which):
        return covered
    views = _views(plans[int(np.argmax(asks))], candidates.iloc[which], rotations[which])
    share = np.full(len(candidates), np.inf)
    share[which] = clearance.margin(views).share[0]
    of_row = np.where(asked, share[covered["candidate"].to_numpy(dtype=np.int64)], np.inf)
    known = covered["clearance_margin"].fillna(np.inf)
    covered = covered.assign(
        clearance_margin=np.where(asked, np.minimum(known, of_row), covered["clearance_margin"]),
        smallest_margin=np.minimum(covered["smallest_margin"], of_row),
    )
    return covered[of_row >= 0].reset_index(drop=True)
