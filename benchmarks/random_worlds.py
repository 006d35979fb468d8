"""Random tasks that a planted view satisfies, for `random_tasks`.

Every task is a polygon on a block, random boxes about it, a workspace, and requirements that the
planted view satisfies, each by three of its σ or more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import map_accuracy
import numpy as np
import trimesh
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
from planning.camera_body import CameraBody
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.margin import Requirement
from planning.requirements.resolution import Resolution
from planning.requirements.unvignetted import Unvignetted
from planning.requirements.visibility import Visibility
from planning.robot_cell import RobotCell
from planning.robustness import robustness_of
from planning.scene import Scene
from planning.setting_space import MapSettings
from planning.solid import Solid, box_workspace
from planning.target import Target
from planning.task import Task
from planning.view_errors import ViewErrors
from planning.view_search import FoundViews, sigmas
from planning.view_space import GeneralStarts
from planning.views import Subject
from planning.visibility.audit import sees_whole_target
from planning.visibility.methods import visibility_region

HERE = Path(__file__).parents[1]
SLIP = Repeatability(translation_mm=0.05, rotation_rad=2e-4)
#: All requirements shall hold together with this probability, or with that of the planted view
#: where it is smaller; beyond it the truth may differ.
CONFIDENCE = 0.999
PLANTED_SIGMAS = 3.0


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
    sure = robustness_of([*requirements, Visibility()], planted.as_views()[0], errors)
    task = Task(
        planted.subject.target,
        feature,
        requirements,
        workspace,
        views="general",
        confidence=min(CONFIDENCE, float(sure.probability[0])),
    )
    return World(lens, task, scene, planted)


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
