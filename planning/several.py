"""Several targets: the fewest viewpoints that cover all, in an order that is short to travel.

Every target is planned by itself. Its viewpoints, and others that are aimed between neighbours, are
candidates; each is judged by what is asked of every target that it may see. The fewest that cover
all targets are chosen and put in order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd

from lenscal.arrays import IntArray
from lenscal.document import versions, write_document
from lenscal.errors import PlanningError
from lenscal.pose import Pose
from lenscal.progress import ProgressMaker, silent
from planning.cover import Cover, fewest_viewpoints
from planning.coverage import coverage, margin_matrix
from planning.fixed_lens import FixedLens
from planning.plan_record import Plan
from planning.planner import plan
from planning.preconditions import refuse_unknown
from planning.requirements.margin import Requirement
from planning.robot_cell import RobotCell
from planning.route import LEVER_MM, Route, shortest_route, travel_between_mm
from planning.scene import Scene
from planning.settings import AdmissibleSettings, admissible_settings
from planning.shared_views import own_candidates, shared_candidates, with_irises
from planning.stated_views import poses_of, records_of
from planning.task import Task
from planning.visibility.exact_test import ExactTest

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

KIND: Final = "covering-plan"
VERSION: Final = 1
#: Viewpoints of its own plan that each target offers.
_EACH: Final = 8


@dataclass(frozen=True, slots=True, eq=False)
class CoveringPlan:
    """Viewpoints that together satisfy several tasks.

    Parameters
    ----------
    plans
        What was found for each task by itself.
    viewpoints
        One row per viewpoint, in the order in which they are visited: setting and pose as in a
        plan; targets, the names of those that it covers; smallest_margin, the least over them.
    coverage
        One row per viewpoint and target that it covers: viewpoint, the row above; target, its
        index among the tasks; a margin for each kind of requirement as a share of its limit;
        visibility_margin_mm; smallest_margin; probability where a confidence is asked for.
    cover
        How the viewpoints were chosen: `Cover.at_least` says whether fewer might do.
    route
        How they were put in order, and how far the hand travels.
    candidates
        Among how many viewpoints was chosen.
    safety
        By which share of itself each limit on d/D is kept.
    """

    plans: tuple[Plan, ...]
    viewpoints: pd.DataFrame
    coverage: pd.DataFrame
    cover: Cover
    route: Route
    candidates: int
    safety: float

    @property
    def tasks(self) -> tuple[Task, ...]:
        """What was asked, one per target."""
        return tuple(plan.task for plan in self.plans)

    @property
    def lens(self) -> LensMap | FixedLens:
        """The lens that was planned with."""
        return self.plans[0].lens

    @property
    def scene(self) -> Scene:
        """What can hide the targets."""
        return self.plans[0].scene

    @property
    def poses(self) -> tuple[Pose, ...]:
        """part_from_camera of each viewpoint, in the order of the table."""
        return poses_of(self.viewpoints)

    @property
    def uncovered(self) -> dict[str, str]:
        """Names of the targets that no viewpoint satisfies, and why."""
        plans = [self.plans[index] for index in self.cover.uncovered]
        return {plan.task.name: plan.why_empty for plan in plans}

    @property
    def reasons(self) -> dict[str, list[str]]:
        """The reasons why targets are not covered, and the names of the targets."""
        found: dict[str, list[str]] = {}
        for name, why in self.uncovered.items():
            found.setdefault(why, []).append(name)
        return found

    @property
    def why_empty(self) -> str:
        """Why there is no viewpoint at all; empty when there are some."""
        if len(self.viewpoints):
            return ""
        reasons = "; ".join(f"{', '.join(names)}: {why}" for why, names in self.reasons.items())
        return f"none of the {len(self.plans)} targets can be seen as asked; {reasons}"

    @property
    def made_from(self) -> dict[str, str]:
        """Digests of what the plan was made from."""
        tasks = {f"task {plan.task.name}": plan.task.digest for plan in self.plans}
        rest = {name: d for name, d in self.plans[0].made_from.items() if name != "task"}
        return tasks | rest

    def save(self, path: Path | str) -> Path:
        """Write the plan with its evidence.

        Parameters
        ----------
        path
            The JSON file.

        Returns
        -------
        Path
            The file.
        """
        names = [task.name for task in self.tasks]
        covered = self.coverage.assign(target=[names[t] for t in self.coverage["target"]])
        body: dict[str, Any] = {
            "made_from": self.made_from,
            "tasks": [task.to_dict() for task in self.tasks],
            "safety": self.safety,
            "viewpoints": records_of(self.viewpoints),
            "coverage": records_of(covered),
            "uncovered": self.uncovered,
            "candidates": self.candidates,
            "at_least": self.cover.at_least,
            "travel_mm": self.route.travel_mm,
            "is_shortest": self.route.is_shortest,
            "regions": {
                plan.task.name: plan.region
                and {"volume_mm3": plan.region.volume_mm3, "audit": plan.region.audit.to_dict()}
                for plan in self.plans
            },
            "made_with": versions("lenscal", "manifold3d", "numpy", "scipy"),
        }
        return write_document(path, KIND, VERSION, body)


def plan_all(
    tasks: Sequence[Task],
    lens: LensMap | FixedLens,
    scene: Scene,
    *,
    cell: RobotCell | None = None,
    safety: float = 0.005,
    settings_tried: int = 9,
    audit_points: int = 2_000,
    seed: int = 0,
    lever_mm: float = LEVER_MM,
    mm_per_step: float = 0.0,
    progress: ProgressMaker = silent,
) -> CoveringPlan:
    """Find the fewest viewpoints that satisfy several tasks, and an order to visit them.

    Parameters
    ----------
    tasks
        One per target, each with a name of its own.
    lens
        The calibrated lens.
    scene
        The part and what stands about it.
    cell
        The robot cell, whose errors count with those of the lens map where a task asks for a
        confidence; None for a camera that stands exactly where it is wanted.
    safety
        By which share of itself each limit on d/D is kept.
    settings_tried
        How many settings are spread over the admissible ones of every target.
    audit_points
        How many random viewpoints check the visibility region of every target.
    seed
        Seed of those viewpoints.
    lever_mm
        What a rotation of the camera by one radian counts as travel, in mm.
    mm_per_step
        What one unit of zoom or focus counts as travel, in mm; zero to leave the lens out.
    progress
        Makes what is told how far each stage has come.

    Returns
    -------
    CoveringPlan
        The viewpoints. A target that nothing satisfies is among its `uncovered`, with the reason.

    Raises
    ------
    PlanningError
        When there is no task, two have the same name, or a requirement needs something that is not
        known of the lens.
    """
    _refuse_unnamed(tasks)
    for task in tasks:
        refuse_unknown(task.requirements, lens)
    plans: list[Plan] = []
    settings: dict[tuple[Requirement, ...], AdmissibleSettings] = {}
    exact_test = ExactTest(scene)
    with progress("planning") as tell:
        for task in tasks:
            asked = tuple(task.requirements)
            if asked not in settings:
                settings[asked] = admissible_settings(lens, asked, safety=safety)
            plans.append(
                plan(
                    task,
                    lens,
                    scene,
                    cell=None if task.confidence is None else cell,
                    safety=safety,
                    settings_tried=settings_tried,
                    audit_points=audit_points,
                    seed=seed,
                    settings=settings[asked],
                    exact_test=exact_test,
                )
            )
            tell(len(plans), len(tasks), task.name)
    candidates = _candidates(plans)
    with progress("judging") as tell:
        covered = coverage(plans, candidates, safety, cell, tell)
    cover = fewest_viewpoints(margin_matrix(covered, len(candidates), len(plans)))
    chosen = candidates.iloc[cover.chosen]
    travel = travel_between_mm(
        _carried(chosen), lever_mm, chosen[["zoom", "focus"]].to_numpy(), mm_per_step
    )
    route = shortest_route(travel)
    viewpoints, kept = _tables(candidates, covered, cover.chosen[route.order], tasks)
    return CoveringPlan(tuple(plans), viewpoints, kept, cover, route, len(candidates), safety)


def _refuse_unnamed(tasks: Sequence[Task]) -> None:
    if not tasks:
        raise PlanningError("there is no target to plan for; give one task or more")
    names = [task.name for task in tasks]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise PlanningError(
            f"several targets are called {twice[0]!r}; give each a name of its own, so that the "
            "plan can say which one is seen from where"
        )


def _candidates(plans: Sequence[Plan]) -> pd.DataFrame:
    tasks, lens = [plan.task for plan in plans], plans[0].lens
    own = own_candidates(plans, _EACH)
    both = [table for table in (own, shared_candidates(tasks, own)) if len(table)]
    candidates = pd.concat(both, ignore_index=True) if both else own
    pupil = None if isinstance(lens, FixedLens) else lens.pupil
    return candidates if pupil is None else with_irises(candidates, tasks, pupil.irises)


def _carried(viewpoints: pd.DataFrame) -> list[Pose]:
    """Poses of the reference camera, which sits still on the hand, where the offset is known."""
    offsets = viewpoints["nodal_offset_mm"].fillna(0.0)
    return [
        pose @ Pose(np.eye(3), np.array([0.0, 0.0, offset]))
        for pose, offset in zip(poses_of(viewpoints), offsets, strict=True)
    ]


def _tables(
    candidates: pd.DataFrame, covered: pd.DataFrame, order: IntArray, tasks: Sequence[Task]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Viewpoints in their order, and what they cover."""
    place = {int(candidate): row for row, candidate in enumerate(order)}
    kept = covered[covered["candidate"].isin(place)].copy()
    kept.insert(0, "viewpoint", [place[int(c)] for c in kept.pop("candidate")])
    kept["target"] = kept["target"].astype(np.int64)
    kept = kept.sort_values(["viewpoint", "target"], ignore_index=True)
    viewpoints = candidates.iloc[order].drop(columns="aimed_at").reset_index(drop=True)
    groups = kept.groupby("viewpoint")
    viewpoints["targets"] = [
        ", ".join(tasks[t].name for t in groups.get_group(k)["target"])
        for k in range(len(viewpoints))
    ]
    viewpoints["smallest_margin"] = groups["smallest_margin"].min().to_numpy()
    return viewpoints, kept
