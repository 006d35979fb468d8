"""Does the planner find what exists, and blame what makes a task impossible? By random tasks.

Every task is a polygon on a block, random boxes about it, a workspace, and requirements that a
planted view satisfies, each by three of its σ or more. Half of them the planner is to solve: what
it returns is then checked in the simulated truth by `planning.verify`, which has nothing in common
with what the planner judges by, with the robot slipping as it may. In the other half one
requirement is tightened past its optimum, which differential evolution has found: that one is to be
named, and the amount it would have to give, within 10 %.

    OMP_NUM_THREADS=1 python benchmarks/random_tasks.py --planted 250 --infeasible 250
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import map_accuracy
import numpy as np
import trimesh
from scipy.optimize import differential_evolution
from scipy.spatial.transform import Rotation

from lenscal.arrays import FloatArray
from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.sweep import calibrate_recording
from lenscal.camera_mount import CameraMount
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.pose import Pose
from lenscal.rig.simulated.machine_vision import machine_vision_lens
from lenscal.rig.simulated.vicon_1990 import vicon_lens
from lenscal.rig.simulated.zoom_lens import ZoomLens
from lenscal.setting import LensSetting
from planning.camera_body import CameraBody
from planning.judgement import judge
from planning.nodal import nodal_point
from planning.plan_record import Plan
from planning.planner import plan
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.margin import Requirement
from planning.requirements.resolution import Resolution
from planning.requirements.unvignetted import Unvignetted
from planning.requirements.visibility import Visibility
from planning.robot_cell import RobotCell
from planning.scene import Scene
from planning.setting_space import MapSettings
from planning.solid import Solid, box_workspace
from planning.target import Target
from planning.task import Task
from planning.verify import verify_viewpoint
from planning.view_errors import ViewErrors
from planning.view_search import FoundViews, sigmas
from planning.view_space import GeneralStarts
from planning.views import Subject
from planning.visibility.audit import sees_whole_target
from planning.visibility.methods import visibility_region

HERE = Path(__file__).parents[1]
SLIP = Repeatability(translation_mm=0.05, rotation_rad=2e-4)
#: All requirements shall hold together with this probability; beyond it the truth may differ.
CONFIDENCE = 0.999
PLANTED_SIGMAS = 3.0
#: By which share of its optimum a requirement is tightened beyond it.
TIGHTENED = (0.05, 0.3)
#: The amount that would have to give is to be right to this share of it.
WITHIN = 0.10
#: How often a better optimum may turn up.
_TRIES = 4


@dataclass(frozen=True)
class Lens:
    """A lens, as it is known and as it is."""

    name: str
    lens_map: LensMap
    truth: ZoomLens
    body: CameraBody

    @property
    def cell(self) -> RobotCell:
        """A robot that slips, and a mounting that is known."""
        setting = self.lens_map.reference_setting or self.truth.reference_setting
        mount = CameraMount(Pose.identity(), np.zeros((6, 6)), setting)
        return RobotCell(mount, Pose.identity(), None, SLIP)


@cache
def vicon() -> Lens:
    """The lens of the paper, calibrated with pictures: the committed map."""
    lens = vicon_lens()
    body = CameraBody.barrel(front_mm=216.2, radius_mm=40.0, length_mm=150.0)
    path = HERE / "data" / "vicon-1990" / "map.json"
    return Lens("vicon-1990", LensMap.load(path), lens, body)


@cache
def machine_vision(path: Path | None) -> Lens:
    """A lens that is not parfocal, calibrated without pictures: its domain is a curved strip."""
    lens = machine_vision_lens()
    body = CameraBody.barrel(front_mm=53.4, radius_mm=32.0, length_mm=50.0)
    if path is not None and path.exists():
        return Lens("machine-vision", LensMap.load(path), lens, body)
    rng = np.random.default_rng(0)
    settings = map_accuracy.strip(8, 5).settings
    table = calibrate_recording(map_accuracy.record(settings, rng)).rows.copy()
    diameters = np.array(
        [map_accuracy.truth_at(z, f).entrance_pupil_diameter_mm for z, f in settings]
    )
    table["pupil_iris"] = map_accuracy.WIDE_OPEN
    table["sigma_entrance_pupil_diameter_mm"] = 0.01 * diameters
    table["entrance_pupil_diameter_mm"] = diameters * (1 + 0.01 * rng.normal(size=len(diameters)))
    lens_map = fit_lens_map(table, sensor=lens.sensor, reference_setting=lens.reference_setting)
    if path is not None:
        lens_map.save(path)
    return Lens("machine-vision", lens_map, lens, body)


@dataclass(frozen=True, eq=False)
class World:
    """A random task that a planted view satisfies."""

    lens: Lens
    task: Task
    scene: Scene
    planted: GeneralStarts
    subject: Subject = field(repr=False)


def random_world(lens: Lens, rng: np.random.Generator) -> World:
    """Draw tasks until one can be satisfied by three σ."""
    while True:
        world = _try_world(lens, rng)
        if world is not None:
            return world


def _try_world(lens: Lens, rng: np.random.Generator) -> World | None:
    settings = MapSettings(lens.lens_map, True)
    shares = rng.uniform(0.1, 0.9, (1, settings.size))
    state = settings.states(shares)[0]
    distance, sensor = float(state.object_distance_mm[0]), state.sensor
    field_mm = min(sensor.width_mm, sensor.height_mm) / float(state.magnification[0])
    target = _random_target(rng, field_mm * rng.uniform(0.1, 0.3))
    feature = target
    if rng.uniform() < 0.5:
        corners = target.vertices_mm
        ends = target.centroid_mm + rng.uniform(0.4, 0.9) * (corners[:2] - target.centroid_mm)
        feature = Target(ends)
    tilt = rng.uniform(0.0, np.radians(50))
    facing = Rotation.from_euler("x", np.pi) * Rotation.from_euler("y", tilt)
    turned = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)) * facing
    turned = turned * Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
    half = min(sensor.width_mm, sensor.height_mm) / 2 / float(state.image_distance_mm[0])
    bare = Subject(target, feature)
    planted = GeneralStarts(
        bare,
        settings,
        shares,
        turned.as_matrix()[None],
        rng.uniform(-0.3, 0.3, (1, 2)) * half,
        np.zeros(1),
        True,
    )
    place = planted.as_views()[0].positions_mm[0, 0]
    size = target.size_mm
    base = trimesh.creation.box(bounds=[[-size, -size, -size / 2], [size, size, 0.0]])
    meshes = [base, *_random_boxes(rng, base, target, place, distance)]
    scene = Scene(meshes)
    reach = 1.4 * distance
    workspace = box_workspace((-reach, -reach, 0.05 * distance), (reach, reach, reach))
    if not workspace.contains(place) or not sees_whole_target(place, target, scene):
        return None
    region = visibility_region(scene, target, workspace, audit_points=0)
    subject = Subject(target, feature, scene, region)
    planted = replace(planted, subject=subject)
    return _with_requirements(lens, rng, planted, scene, workspace)


def _random_target(rng: np.random.Generator, radius_mm: float) -> Target:
    count = int(rng.integers(3, 7))
    angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    while np.diff(angles, append=angles[0] + 2 * np.pi).max() > np.pi * 0.9:
        angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    radii = radius_mm * rng.uniform(0.5, 1.0, count)
    corners = np.stack([radii * np.cos(angles), radii * np.sin(angles), 0 * radii], axis=-1)
    return Target(corners)


def _random_boxes(
    rng: np.random.Generator,
    base: trimesh.Trimesh,
    target: Target,
    place: FloatArray,
    distance: float,
) -> list[trimesh.Trimesh]:
    """Boxes about the lines of sight, none of which is in the way of the planted view."""
    boxes: list[trimesh.Trimesh] = []
    wanted = int(rng.integers(2, 9))
    for _ in range(60):
        if len(boxes) == wanted:
            break
        sides = distance * rng.uniform(0.02, 0.25, 3)
        box = trimesh.creation.box(sides)
        turn = np.eye(4)
        turn[:3, :3] = Rotation.random(rng=rng).as_matrix()
        direction = place / np.linalg.norm(place) + rng.normal(scale=0.5, size=3)
        turn[:3, 3] = direction * distance * rng.uniform(0.05, 0.6)
        box.apply_transform(turn)
        low = box.bounds[0, 2]
        apart = all(not _touch(box, other) for other in [base, *boxes])
        if low <= 0.0 or not apart:
            continue
        if sees_whole_target(place, target, Scene([base, *boxes, box])):
            boxes.append(box)
    return boxes


def _touch(one: trimesh.Trimesh, other: trimesh.Trimesh) -> bool:
    """Whether the boxes about two bodies overlap: they are kept apart by more than is needed."""
    return bool(((one.bounds[0] <= other.bounds[1]) & (other.bounds[0] <= one.bounds[1])).all())


def _with_requirements(
    lens: Lens, rng: np.random.Generator, planted: GeneralStarts, scene: Scene, workspace: Solid
) -> World | None:
    """Ask for a little less than what the planted view has."""
    feature = planted.subject.seen_feature
    length = feature.size_mm * rng.uniform(0.02, 0.2)
    probes: list[Requirement] = [Resolution(1.0, length), FieldOfView(feature.size_mm)]
    optional: list[Requirement] = [
        DepthOfField(float(feature.size_mm * rng.uniform(0, 0.3)), 100.0),
        Incidence(90.0),
        Clearance(lens.body, 0.1 * float(planted.as_views()[0].states.object_distance_mm[0])),
        Unvignetted(),
        Visibility(),
    ]
    probes += [probe for probe in optional if rng.uniform() < 0.6]
    # Where no depth of field is asked for, the planner keeps the feature in the sharp plane.
    planted = replace(planted, is_free=any(isinstance(r, DepthOfField) for r in probes))
    found = FoundViews.judged(probes, planted)
    if not np.isfinite(found.values).all():
        return None
    slack = [float(s) for s in rng.uniform(0.02, 0.2, len(probes))]
    asked = [
        _less(probe, float(value), s)
        for probe, value, s in zip(probes, found.values[0], slack, strict=True)
    ]
    if any(requirement is None for requirement in asked):
        return None
    requirements = [requirement for requirement in asked if requirement is not None]
    errors = ViewErrors(lens.lens_map, lens.cell)
    judged = FoundViews.judged([*requirements, Visibility()], planted)
    sigma = sigmas([*requirements, Visibility()], planted, errors)
    if not (judged.shares >= PLANTED_SIGMAS * sigma).all():
        return None
    task = Task(
        planted.subject.target,
        feature,
        requirements,
        workspace,
        views="general",
        confidence=CONFIDENCE,
    )
    return World(lens, task, scene, planted, planted.subject)


def _less(probe: Requirement, value: float, slack: float) -> Requirement | None:
    """The requirement at which a view that gave this value has some slack; None where it cannot."""
    match probe:
        case Resolution():
            return replace(probe, pixels=(value + 1.0) * (1 - slack))
        case DepthOfField():
            return replace(probe, blur_px=(100.0 - value) * (1 + slack) + 0.2)
        case Incidence():
            angle = 90.0 - float(np.degrees(value))
            return replace(probe, max_angle_deg=min(angle * (1 + slack) + 0.5, 90.0))
        case Clearance():
            room = value + probe.distance_mm
            return replace(probe, distance_mm=room * (1 - slack)) if room > 0 else None
        case Visibility():
            return replace(probe, distance_mm=value * (1 - slack)) if value > 0 else None
        case _:
            return probe if value > 0 else None


def tightened(requirement: Requirement, best: float, share: float) -> Requirement:
    """Ask for more than the best value of what it limits, by a share of that."""
    match requirement:
        case Resolution():
            return replace(requirement, pixels=best * (1 + share))
        case DepthOfField():
            return replace(requirement, blur_px=best * (1 - share))
        case Incidence():
            return replace(requirement, max_angle_deg=float(np.degrees(best)) * (1 - share))
        case Clearance() | Visibility():
            return replace(requirement, distance_mm=best * (1 + share))
    raise AssertionError(requirement)


def limited(requirement: Requirement, value: float) -> float:
    """What a requirement limits, from its margin: samples, blur, angle in rad, distance."""
    match requirement:
        case Resolution():
            return value + requirement.pixels
        case DepthOfField():
            return requirement.blur_px - value
        case Incidence():
            return float(np.radians(requirement.max_angle_deg)) - value
        case Clearance() | Visibility():
            return value + requirement.distance_mm
    raise AssertionError(requirement)


def optimum(world: World, index: int, rng: np.random.Generator) -> float:
    """Best margin of one requirement while all others hold, by differential evolution."""
    requirements = [*world.task.requirements, Visibility()]
    start = world.planted
    count = start.settings.size
    bounds = [(0.0, 1.0)] * count + [(-0.7, 0.7)] * 3 + [(-0.3, 0.3)] * 2 + [(-0.3, 0.3)]
    bare = replace(start, shares=np.zeros((1, count)), aims=np.zeros((1, 2)))
    bounds = bounds[: start.size]
    x0 = np.concatenate([start.shares[0], np.zeros(3), start.aims[0], np.zeros(1)])[: start.size]

    def lacking(moves: FloatArray) -> FloatArray:
        found = FoundViews.judged(requirements, bare.moved(moves.T[None]))
        others = np.delete(found.shares, index, axis=1).min(axis=1)
        value = np.maximum(np.nan_to_num(found.values[:, index], neginf=-1e6), -1e6)
        return np.where(others >= 0, -value, 1e7 - np.maximum(others, -1e3))

    best = differential_evolution(
        lacking,
        bounds,
        x0=x0,
        popsize=10,
        maxiter=150,
        tol=1e-6,
        vectorized=True,
        updating="deferred",
        polish=False,
        rng=rng,
    )
    return -float(best.fun)


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
        wanted = abs(limited(asked, 0.0) - best)
        requirements = list(world.task.requirements)
        requirements[index] = asked
        task = replace(world.task, requirements=requirements, confidence=None)
        found = plan(task, lens.lens_map, world.scene, safety=0.0, audit_points=0)
        if not len(found.viewpoints):
            break
        # The view that was found proves that the optimum was none; it is the better one.
        tally.failed["reference was beaten by a view"] += 1
        values = judge([asked], found.views).margins[0].value[0]
        best = limited(asked, float(values.max()))
    tally.seconds += time.process_time() - begun
    tally.tasks += 1
    tally.viewpoints += len(found.viewpoints)
    named = {r.index: r for r in found.relaxations}
    if len(found.viewpoints):
        outcome = "solved after all"
    elif index not in named:
        outcome = f"{requirement.name} not named"
    else:
        # Less than what the other search thought necessary is right if it can be had: it can.
        ratio = named[index].lacking / wanted
        outcome = "" if ratio <= 1 + WITHIN else f"{requirement.name} amount too large"
        tally.failed["reference was beaten by more"] += int(ratio < 1 - WITHIN)
        tally.failed["another is named first"] += int(found.relaxations[0].index != index)
    if outcome:
        tally.failed[outcome] += 1
        tally.bad_seeds.append(f"{lens.name} {seed}: {outcome}; {found.why_empty}")
    else:
        tally.good += 1


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
