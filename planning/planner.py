"""Stage 5: planning. Reads: LensMap, Scene, Task. Gives: Plan.

Settings that meet resolution and field of view fix the object distance; the ring at that distance
is intersected with the region from which the whole target is seen (section 1.5.3 of the paper).
General views are searched from that region instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from planning.blame import FindStarts, relaxations, why_none
from planning.candidates import Candidates
from planning.fixed_lens import FixedLens
from planning.general import general_views
from planning.judgement import judge
from planning.orthogonal import (
    orthogonal_requirements,
    orthogonal_starts,
    orthogonal_viewpoints,
)
from planning.plan_record import PLAN_KIND, PLAN_VERSION, Plan
from planning.preconditions import asking_of_pupil, refuse_unknown
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.magnification import contradiction
from planning.requirements.margin import BoundsMagnification, Requirement
from planning.requirements.visibility import Visibility
from planning.robot_cell import RobotCell
from planning.robustness import robustness_of
from planning.scene import Scene
from planning.setting_space import FixedSettings, MapSettings, SettingSpace
from planning.settings import AdmissibleSettings, admissible_settings
from planning.task import Task
from planning.view_errors import ViewErrors
from planning.view_search import FoundViews, improved, improved_in_sigma
from planning.viewpoint_rows import as_table, rows_of
from planning.viewpoints import Ring
from planning.views import Subject
from planning.visibility.exact_test import ExactTest
from planning.visibility.methods import visibility_region

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

__all__ = ["PLAN_KIND", "PLAN_VERSION", "Plan", "plan"]

#: Views that are followed when none satisfies the task.
_STARTS: Final = 6
#: Further steps at a time while no general view is sure enough.
_FURTHER: Final = 30


def plan(
    task: Task,
    lens: LensMap | FixedLens,
    scene: Scene,
    *,
    cell: RobotCell | None = None,
    safety: float = 0.005,
    settings_tried: int = 9,
    audit_points: int = 10_000,
    seed: int = 0,
    settings: AdmissibleSettings | None = None,
    exact_test: ExactTest | None = None,
) -> Plan:
    """Find viewpoints and settings at which a feature is visible, resolved and inside the image.

    Parameters
    ----------
    task
        What is asked.
    lens
        The calibrated lens.
    scene
        The part and what stands about it.
    cell
        The robot cell, whose errors count with those of the lens map; None for a camera that stands
        exactly where it is wanted. With a cell, or where the task asks for a confidence, margins
        are also told in σ, and the probability with which all requirements hold.
    safety
        By which share of itself each limit on d/D is kept.
    settings_tried
        How many settings are spread over the admissible ones, in the orthogonal case.
    audit_points
        How many random viewpoints check the visibility region.
    seed
        Seed of those viewpoints, and of where a search for general views starts.
    settings
        The admissible settings for these requirements and this safety, where the caller has them.
    exact_test
        The scene prepared for the audit, where the caller has it for many targets.

    Returns
    -------
    Plan
        The viewpoints, the most robust first; none, with the reason, when it cannot be done.

    Raises
    ------
    PlanningError
        When a requirement needs something that is not known of the lens.
    """
    refuse_unknown(task.requirements, lens)
    if settings is None:
        settings = admissible_settings(lens, task.requirements, safety=safety)
    ring = Ring.about(task.seen_feature, task.target)
    empty = Plan(task, lens, scene, settings, None, ring, as_table(task, []), safety)
    why = settings.why_empty
    if task.views == "general" and lens.sensor is not None:
        # Rolled as it suits, or seen obliquely, a feature may do with less.
        why = contradiction(task.requirements, lens.sensor, safety, roll_is_free=True)
    if why:
        return replace(empty, why_empty=why)
    region = visibility_region(
        scene,
        task.target,
        task.workspace,
        audit_points=audit_points,
        seed=seed,
        exact_test=exact_test,
    )
    if region.is_empty:
        return replace(empty, region=region, why_empty=f"visibility: {region.why_empty}")
    subject = Subject(task.target, task.seen_feature, scene, region)
    judged = _judged(task)
    kept = np.array(
        [safety if isinstance(r, BoundsMagnification) else 0.0 for r in task.requirements]
    )
    kept = np.concatenate([kept, np.zeros(len(judged) - len(kept))])
    space = _space(lens, task)
    errors = ViewErrors(lens, cell) if cell is not None or task.confidence else None
    found: FoundViews[Any]
    starts: FindStarts
    if task.views == "general":
        rng = np.random.default_rng(seed)
        candidates = Candidates(subject, region, space, judged, rng)
        starts = partial(candidates.best, _STARTS, by_direction=True)
        found = general_views(candidates, kept, errors)
        table = _rows(task, found, judged, kept)
    else:
        starts = partial(orthogonal_starts, task, ring, space, judged, subject, _STARTS)
        table = orthogonal_viewpoints(task, ring, settings, settings_tried, subject, region)
        table = table[table["smallest_margin"] > 0].reset_index(drop=True)
        if not len(table):
            found = improved(judged, starts(kept), kept=kept)
            table = _rows(task, found, judged, kept)
    made = replace(empty, region=region, viewpoints=table)
    if not len(table):
        blamed = relaxations(judged, found, kept, len(task.requirements), starts)
        why = why_none(blamed, judged, found, kept, task.workspace)
        return replace(made, relaxations=blamed, why_empty=why)
    if errors is None:
        return made
    made = _with_probabilities(made, judged, errors, seed)
    if task.views == "general":
        made = _made_surer(made, found, judged, kept, errors, seed)
    return _sure_enough(made, judged)


def _judged(task: Task) -> list[Requirement]:
    """What views are judged by: what is asked, and in any case that the feature is seen."""
    if task.views == "orthogonal":
        return orthogonal_requirements(task.requirements)
    judged = list(task.requirements)
    kinds = {type(requirement) for requirement in judged}
    # The camera may look aside, so that the feature has to be kept in the image.
    implied = (FieldOfView(task.seen_feature.size_mm), Visibility())
    return judged + [requirement for requirement in implied if type(requirement) not in kinds]


def _space(lens: LensMap | FixedLens, task: Task) -> SettingSpace:
    if isinstance(lens, FixedLens):
        return FixedSettings(lens, lens.focal_length_mm, np.inf)
    return MapSettings(lens, bool(asking_of_pupil(task.requirements)))


def _rows(
    task: Task, found: FoundViews[Any], judged: Sequence[Requirement], kept: FloatArray
) -> pd.DataFrame:
    good = found.some((found.shares - kept).min(axis=1) >= 0)
    if not len(good):
        return as_table(task, [])
    angles = getattr(good.views, "angles", None)
    return rows_of(task, good.views.as_views()[0], judged, good.shares, angles)


def _made_surer(
    made: Plan,
    found: FoundViews[Any],
    judged: Sequence[Requirement],
    kept: FloatArray,
    errors: ViewErrors,
    seed: int,
) -> Plan:
    """Go on with the search while no view is as sure as is asked, but each time a surer one."""
    wanted = made.task.confidence or 0.0
    best = made.viewpoints["probability"].max()
    while best < wanted:
        found, _ = improved_in_sigma(judged, found.views, errors, kept=kept, rounds=_FURTHER)
        table = _rows(made.task, found, judged, kept)
        further = _with_probabilities(replace(made, viewpoints=table), judged, errors, seed)
        surest = further.viewpoints["probability"].max()
        if surest <= best:
            break
        made, best = further, surest
    return made


def _with_probabilities(
    made: Plan, judged: Sequence[Requirement], errors: ViewErrors, seed: int
) -> Plan:
    """Say how sure every viewpoint is."""
    table = made.viewpoints.copy()
    views = made.views
    robustness = robustness_of(judged, views, errors, seed=seed)
    shares = judge(judged, views).shares[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        in_sigma = np.where(shares == 0, 0.0, shares / robustness.sigma_share)
    names = [r.name for r in judged]
    for name in dict.fromkeys(names):
        columns = [k for k, other in enumerate(names) if other == name]
        table[f"{name}_margin_sigmas"] = in_sigma[:, columns].min(axis=1)
    table["smallest_margin_sigmas"] = in_sigma.min(axis=1)
    table["probability"] = robustness.probability
    # At one setting many views are equally sure but for rounding: the larger margin goes first.
    in_order = (-table["smallest_margin"], -table["smallest_margin_sigmas"], -table["probability"])
    order = np.lexsort([column.round(4) for column in in_order])
    return replace(made, viewpoints=table.iloc[order].reset_index(drop=True))


def _sure_enough(made: Plan, judged: Sequence[Requirement]) -> Plan:
    """Leave out what is not as sure as is asked."""
    table, wanted = made.viewpoints, made.task.confidence
    if wanted is None:
        return made
    sure = table[table["probability"] >= wanted].reset_index(drop=True)
    why = ""
    if not len(sure):
        best = table.iloc[0]
        names = dict.fromkeys(r.name for r in judged)
        weakest = min(names, key=lambda n: best[f"{n}_margin_sigmas"])
        why = (
            f"confidence: {wanted:.4g} is asked, but the surest of {len(table)} viewpoints "
            f"satisfies everything with a probability of {best['probability']:.3f}; {weakest} is "
            f"the weakest there, at {best[f'{weakest}_margin_sigmas']:.2f} σ; relax it, calibrate "
            "better, or ask for less"
        )
    return replace(made, viewpoints=sure, why_empty=why)
