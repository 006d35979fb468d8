"""Does the planner find what exists, and blame what makes a task impossible? By random tasks.

Half of the tasks of `random_worlds` the planner is to solve: what it returns is then checked in the
simulated truth by `planning.verify`, which has nothing in common with what the planner judges by,
with the robot slipping as it may. In the other half one requirement is tightened past its optimum,
which `reference_optimum` has found: that one is to be named, and the amount it would have to give,
within 10 %.

    OMP_NUM_THREADS=1 python benchmarks/random_tasks.py --planted 250 --infeasible 250
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from random_worlds import SLIP, Lens, World, machine_vision, random_world, vicon
from reference_optimum import limited, optimum, tightened

from lenscal.pose import Pose
from lenscal.setting import LensSetting
from planning.judgement import judge
from planning.nodal import nodal_point
from planning.plan_record import Plan
from planning.planner import plan
from planning.requirements.clearance import Clearance
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.margin import Requirement
from planning.requirements.resolution import Resolution
from planning.requirements.unvignetted import Unvignetted
from planning.verify import verify_viewpoint

#: By which share of its optimum a requirement is tightened beyond it.
TIGHTENED = (0.05, 0.3)
#: The amount that would have to give is to be right to this share of it.
WITHIN = 0.10
#: How often a better optimum may turn up.
_TRIES = 4
TOO_SMALL = "amount too small"


def true_in_everything(world: World, found: Plan, row: int, rng: np.random.Generator) -> list[str]:
    """Send a slipping robot there, and name what the true camera does not satisfy."""
    table, task = found.viewpoints.iloc[row], world.task
    zoom, focus = float(table["zoom"]), float(table["focus"])
    point = nodal_point(world.lens.lens_map, zoom, focus)
    iris = float(table["iris"]) if np.isfinite(table["iris"]) else world.lens.truth.travel.iris[1]
    truth = world.lens.truth.truth(LensSetting(zoom, focus, iris))
    slip = Pose.from_rotation_vector(
        rng.normal(scale=SLIP.rotation_rad, size=3), rng.normal(scale=SLIP.translation_mm, size=3)
    )
    reference = found.poses[row] @ Pose(np.eye(3), point.centre_mm).inverse() @ slip
    centre = np.array([0.0, 0.0, -truth.nodal_offset_mm])
    pose = reference @ Pose(np.eye(3), centre)
    seen = verify_viewpoint(
        truth.camera,
        pose,
        task.target,
        task.seen_feature,
        task.requirements,
        world.scene,
        object_distance_mm=truth.object_distance_mm,
        entrance_pupil_diameter_mm=truth.entrance_pupil_diameter_mm,
        projection_centre_mm=centre,
        workspace=task.workspace,
    )
    return list(seen.failed)


@dataclass
class Tally:
    """What came of the tasks of one kind."""

    tasks: int = 0
    good: int = 0
    viewpoints: int = 0
    failed: Counter[str] = field(default_factory=Counter)
    bad_seeds: list[str] = field(default_factory=list)
    seconds: float = 0.0


def solve_planted(lens: Lens, seed: int, tally: Tally) -> None:
    """One task that can be solved."""
    rng = np.random.default_rng([seed, 1])
    world = random_world(lens, rng)
    begun = time.process_time()
    found = plan(world.task, lens.lens_map, world.scene, cell=lens.cell, safety=0.0, audit_points=0)
    tally.seconds += time.process_time() - begun
    tally.tasks += 1
    tally.viewpoints += len(found.viewpoints)
    if not len(found.viewpoints):
        tally.failed["none found"] += 1
        tally.bad_seeds.append(f"{lens.name} {seed}: {found.why_empty}")
        return
    wrong = [
        name
        for row in range(len(found.viewpoints))
        for name in true_in_everything(world, found, row, rng)
    ]
    tally.failed.update(wrong)
    if wrong:
        tally.bad_seeds.append(f"{lens.name} {seed}: {Counter(wrong)}")
    else:
        tally.good += 1


def blame_infeasible(lens: Lens, seed: int, tally: Tally) -> None:
    """One task that one requirement makes impossible."""
    rng = np.random.default_rng([seed, 2])
    while True:
        world = random_world(lens, rng)
        can = [
            k for k, r in enumerate(world.task.requirements)
            if not isinstance(r, FieldOfView | Unvignetted)
        ]  # fmt: skip
        index = int(rng.choice(can))
        requirement = world.task.requirements[index]
        best = limited(requirement, optimum(world, index, rng))
        # What a clearance says is cut off at twice what is asked: there is no optimum to be found.
        cut = isinstance(requirement, Clearance) and best > 1.9 * requirement.distance_mm
        if best > 0 and not cut:
            break
    share = float(rng.uniform(*TIGHTENED))
    begun = time.process_time()
    for _ in range(_TRIES):
        asked = tightened(requirement, best, share)
        found = plan_with(world, index, asked)
        # A view that is found proves that the optimum was none; it is the better one.
        better = best_of(found, asked) if len(found.viewpoints) else None
        if better is None and amount_wrong(found, index, wanted(asked, best)) == TOO_SMALL:
            better = better_than_reference(world, index, found, asked)
        if better is None:
            break
        tally.failed["reference was beaten"] += 1
        best = better
    tally.seconds += time.process_time() - begun
    tally.tasks += 1
    tally.viewpoints += len(found.viewpoints)
    outcome = amount_wrong(found, index, wanted(asked, best))
    if outcome:
        tally.failed[outcome] += 1
        tally.bad_seeds.append(f"{lens.name} {seed}: {requirement.name}; {found.why_empty}")
    else:
        tally.good += 1
        first = found.relaxations[0].index if found.relaxations else index
        tally.failed["another is named first"] += int(first != index)
        tally.failed["refused before any search"] += int(not found.relaxations)


def plan_with(world: World, index: int, asked: Requirement) -> Plan:
    """Ask for one requirement instead of the task's own."""
    requirements = list(world.task.requirements)
    requirements[index] = asked
    task = replace(world.task, requirements=requirements, confidence=None)
    return plan(task, world.lens.lens_map, world.scene, safety=0.0, audit_points=0)


def wanted(asked: Requirement, best: float) -> float:
    """By how much a requirement would have to give."""
    return abs(limited(asked, 0.0) - best)


def amount_wrong(found: Plan, index: int, amount: float) -> str:
    """What is wrong with what a plan blames; nothing where it is right."""
    if len(found.viewpoints):
        return "solved after all"
    at_least = refused_by(found, index)
    if at_least is not None:
        return "" if at_least <= amount * (1 + WITHIN) else "amount too large"
    named = {r.index: r.lacking for r in found.relaxations}
    if index not in named:
        return "not named"
    ratio = named[index] / amount
    if ratio < 1 - WITHIN:
        return TOO_SMALL
    return "" if ratio <= 1 + WITHIN else "amount too large"


def refused_by(found: Plan, index: int) -> float | None:
    """By how much resolution has to give at least, where it is refused before any search."""
    asked = found.task.requirements[index]
    said = re.search(r"contradict .* at least ([\d.]+)% less resolution", found.why_empty)
    if said is None or not isinstance(asked, Resolution):
        return None
    return float(said[1]) / 100 * asked.pixels


def better_than_reference(
    world: World, index: int, found: Plan, asked: Requirement
) -> float | None:
    """What a requirement comes to in a view that proves the amount; None where there is none."""
    amount = next(r.lacking for r in found.relaxations if r.index == index)
    # What lacks as much has that margin, negative.
    given = tightened(asked, limited(asked, -(1 + WITHIN) * amount), 0.0)
    relaxed = plan_with(world, index, given)
    return best_of(relaxed, given) if len(relaxed.viewpoints) else None


def best_of(found: Plan, asked: Requirement) -> float:
    """The best of what a requirement limits, in the views of a plan."""
    return limited(asked, float(judge([asked], found.views).margins[0].value[0].max()))


def main() -> None:
    """Print a table for each lens and kind of task."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--planted", type=int, default=250)
    parser.add_argument("--infeasible", type=int, default=250)
    parser.add_argument("--first", type=int, default=0, help="seed of the first task")
    parser.add_argument("--map", type=Path, help="keeps the machine-vision map between runs")
    given = parser.parse_args()
    lenses = [vicon(), machine_vision(given.map)]
    for kind, count, run in (
        ("planted", given.planted, solve_planted),
        ("infeasible", given.infeasible, blame_infeasible),
    ):
        tallies = [Tally() for _ in lenses]
        for number in range(count):
            lens = number % len(lenses)
            run(lenses[lens], given.first + number, tallies[lens])
            print(f"\r{kind} {number + 1}/{count}", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
        for lens_, tally in zip(lenses, tallies, strict=True):
            if not tally.tasks:
                continue
            print(
                f"{kind}, {lens_.name}: {tally.good} of {tally.tasks} right, "
                f"{tally.viewpoints} viewpoints, {tally.seconds / tally.tasks:.1f} CPU s each; "
                f"{dict(tally.failed)}"
            )
            for line in tally.bad_seeds:
                print(f"  {line}")


if __name__ == "__main__":
    main()
