"""Placement: the chain of frames, its errors, and a robot that is truly sent there."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.table import CalibrationTable
from lenscal.camera_mount import CameraMount
from lenscal.document import read_document
from lenscal.errors import FileError, PlanningError
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.pose import Pose
from lenscal.reach import Reach
from lenscal.rig.simulated import SimulatedRig
from lenscal.setting import ApproachSide, LensSetting
from planning.enclosure import example_part
from planning.fixed_lens import FixedLens
from planning.nodal import LATERAL, nodal_point
from planning.placement import place, place_plan
from planning.placement_export import as_sequence, placement_table, save_placements
from planning.planner import plan
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.resolution import Resolution
from planning.robot_cell import RobotCell
from planning.task import Task
from planning.task_file import load_cell

PAPER = (Resolution(3, 0.254, "x"), FieldOfView(25.4, "x"))


@pytest.fixture(scope="module")
def lens(request) -> LensMap:
    return LensMap.load(request.config.rootpath / "data" / "vicon-1990" / "map.json")


@pytest.fixture(scope="module")
def cell(request) -> RobotCell:
    return load_cell(request.config.rootpath / "data" / "task.toml")


@pytest.fixture(scope="module")
def found(lens):
    part = example_part()
    task = Task(part.target, part.feature, PAPER, part.workspace, "T")
    return plan(task, lens, part.scene, audit_points=0)


@pytest.fixture(scope="module")
def placed(found, cell):
    return place_plan(found, cell)


VALUES = {"nodal_x_mm": 0.3, "nodal_y_mm": -0.2, "nodal_offset_mm": 250.0, "standoff_mm": 370.0}
SIGMAS = {"nodal_x_mm": 0.04, "nodal_y_mm": 0.03, "nodal_offset_mm": 1.1, "standoff_mm": 0.05}


class WanderingLens:
    """A lens whose projection centre wanders sideways, as a map that knows it would say."""

    has_standoff = True
    quantities = ("standoff_mm", "nodal_offset_mm", *LATERAL)
    samples = pd.DataFrame({"zoom": [1.0]})

    def value(self, quantity, zoom, focus):
        return np.array(VALUES[quantity])

    def sigma(self, quantity, zoom, focus):
        return np.array(SIGMAS[quantity])

    def nodal_offset_mm(self, zoom, focus):
        return self.value("nodal_offset_mm", zoom, focus)

    def standoff_mm(self, zoom, focus):
        return self.value("standoff_mm", zoom, focus)


def test_the_chain_of_frames_closes(placed, found) -> None:
    """Going the chain from the base by hand leads to the planned projection centre."""
    cell = placed.cell
    for p in placed.placements:
        reference = p.base_from_hand @ cell.mount.hand_from_camera
        centre = reference.transform(p.nodal.centre_mm)
        wanted = cell.base_from_part.transform(found.poses[p.viewpoint].translation_mm)
        np.testing.assert_allclose(centre, wanted, atol=1e-9)
        sharp = reference.transform([*p.nodal.lateral_mm, p.standoff_mm])
        midpoint = cell.base_from_part.transform(found.task.seen_feature.centroid_mm)
        np.testing.assert_allclose(sharp, midpoint, atol=1e-9)
        row = found.viewpoints.iloc[p.viewpoint]
        assert p.standoff_mm == pytest.approx(row["standoff_mm"])
        assert p.setting == LensSetting(row["zoom"], row["focus"], 20.0)
        assert p.approach is ApproachSide.FROM_BELOW


def test_lateral_wander_is_undone() -> None:
    """With a wander of (0.3, -0.2) mm the projection centre still comes to lie where it shall."""
    mount = CameraMount(
        Pose.from_rotation_vector([0, 0, 1.5], [30, -20, 80]), np.zeros((6, 6)), LensSetting(1, 1)
    )
    cell = RobotCell(mount, Pose.from_rotation_vector([0.1, 0.2, 0.3], [600, 100, 200]))
    wanted = Pose.from_rotation_vector([3.0, 0.4, 0.1], [5, -300, 500])
    p = place(WanderingLens(), LensSetting(1, 1), wanted, cell, ApproachSide.FROM_BELOW)
    reference = p.base_from_hand @ mount.hand_from_camera
    centre = reference.transform([0.3, -0.2, -250])
    np.testing.assert_allclose(centre, cell.base_from_part.transform([5, -300, 500]), atol=1e-9)
    np.testing.assert_allclose(p.sigma_sharp_mm, [0.04, 0.03, 0.05], atol=1e-12)
    np.testing.assert_allclose(p.sigma_centre_mm, [0.04, 0.03, 1.1], atol=1e-12)
    np.testing.assert_array_equal(p.sigma_rotation_rad, 0)
    assert p.nodal.notes == ()


def rigid(rotations: np.ndarray, translations: np.ndarray) -> np.ndarray:
    """(N, 4, 4) of (N, 3, 3) and (N, 3)."""
    matrices = np.tile(np.eye(4), (len(rotations), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = rotations, translations
    return matrices


def motions(vectors: np.ndarray) -> np.ndarray:
    """(N, 4, 4) of (N, 6) rotation vectors and translations."""
    return rigid(Rotation.from_rotvec(vectors[:, :3]).as_matrix(), vectors[:, 3:])


@pytest.mark.parametrize("anchored", [False, True])
def test_covariances_are_those_of_the_drawn_chain(anchored: bool) -> None:
    """Mounting, robot and part drawn 2,000 times, and the motion of the camera measured."""
    rng = np.random.default_rng(3)
    square = rng.standard_normal((6, 6)) * np.repeat([2e-4, 0.05], 3)[:, None]
    hand_from_camera = Pose.from_rotation_vector([0.1, -0.2, 1.5], [30, -20, 80])
    mount = CameraMount(hand_from_camera, square @ square.T, LensSetting(1, 1), {}, anchored)
    part_covariance = np.diag([1e-8, 4e-8, 9e-8, 0.01, 0.0025, 0.0004])
    base_from_part = Pose.from_rotation_vector([0.1, 0.2, 0.3], [600, 100, 200])
    cell = RobotCell(
        mount,
        base_from_part,
        part_covariance,
        Repeatability(rotation_rad=1e-4, translation_mm=0.02),
    )
    wanted = Pose.from_rotation_vector([2.6, 0.4, 0.1], [5, -300, 500])
    lens = WanderingLens()
    p = place(lens, LensSetting(1, 1), wanted, cell, ApproachSide.FROM_BELOW)
    count = 2000
    mounts = rng.multivariate_normal(np.zeros(6), mount.covariance, count)
    slips = rng.standard_normal((count, 6)) * np.repeat([1e-4, 0.02], 3)
    parts = rng.multivariate_normal(np.zeros(6), part_covariance, count)
    offsets = 1.1 * rng.standard_normal(count)
    # D errs as the offset does, but for the standoff.
    standoffs = 0.05 * rng.standard_normal(count)
    wander = rng.standard_normal((count, 2)) * [0.04, 0.03]
    stated = np.array([0.3, -0.2, -250.0])
    turned = Rotation.from_rotvec(mounts[:, :3]).as_matrix() @ hand_from_camera.rotation
    if anchored:  # the place of the projection centre on the hand was measured
        origins = hand_from_camera.transform(stated) - turned @ stated
    else:
        origins = hand_from_camera.translation_mm + mounts[:, 3:]
    camera_moves = stated + np.column_stack([wander, -offsets])
    errors = (
        wanted.inverse().matrix
        @ np.linalg.inv(base_from_part.matrix @ motions(parts))
        @ p.base_from_hand.matrix
        @ motions(slips)
        @ rigid(turned, origins)
        @ rigid(np.tile(np.eye(3), (count, 1, 1)), camera_moves)
    )
    turns, places = errors[:, :3, :3], errors[:, :3, 3]
    vectors = Rotation.from_matrix(turns).as_rotvec()
    distances = (620.0 + offsets + standoffs)[:, None]
    centre = np.concatenate([vectors, places], axis=1)
    sharp = np.concatenate([vectors, distances * turns[:, :, 2] + places - [0, 0, 620]], axis=1)
    for samples, covariance in ((centre, p.centre_covariance), (sharp, p.sharp_covariance)):
        sigma = np.sqrt(np.diag(covariance))
        np.testing.assert_allclose(samples.std(axis=0), sigma, rtol=0.08)
        whole = np.corrcoef(samples.T) - covariance / np.outer(sigma, sigma)
        assert np.abs(whole).max() < 0.1


def test_the_camera_truly_stands_there(placed) -> None:
    """Sent with the standoff, the true projection centre is where the plan wants it, within 3 σ."""
    rig = SimulatedRig.preset("vicon-1990", seed=0)
    rig.lay_down([], placed.cell.base_from_part)
    scaled = []
    for p in placed.placements:
        rig.lens.move_to(p.setting, p.approach)
        rig.positioner.move_to(p.base_from_hand)
        error = p.part_from_camera.inverse() @ rig.true_part_from_camera()
        truth = rig.truth(p.setting)
        off_centre = error.translation_mm
        off_sharp = error.transform([0, 0, truth.object_distance_mm])
        off_sharp = off_sharp - [0, 0, p.standoff_mm + p.nodal.offset_mm]
        assert (np.abs(off_centre) < 3 * p.sigma_centre_mm).all()
        assert (np.abs(off_sharp) < 3 * p.sigma_sharp_mm).all()
        assert abs(off_sharp[2]) < 0.2, "the sharp plane is met to the standoff's error, not D's"
        scaled.append(np.r_[off_centre / p.sigma_centre_mm, off_sharp / p.sigma_sharp_mm])
    assert 0.3 < np.sqrt(np.mean(np.square(scaled))) < 1.3


def test_the_standoff_is_known_far_better_than_the_place_of_the_centre(placed) -> None:
    for p in placed.placements:
        assert p.sigma_centre_mm[2] > 10 * p.sigma_sharp_mm[2]


def test_a_map_without_wander_says_so(placed, lens) -> None:
    assert placed.notes == ()
    known = {n: s for n, s in lens.single_surfaces.items() if n not in LATERAL}
    (note,) = nodal_point(replace(lens, single_surfaces=known), 98.0, 131.0).notes
    assert "does not map the lateral wander" in note
    assert "its size among the samples" in note
    blind = SimpleNamespace(
        quantities=(),
        samples=pd.DataFrame({"zoom": [1.0]}),
        **{name: getattr(lens, name) for name in ("nodal_offset_mm", "standoff_mm", "sigma")},
    )
    (note,) = nodal_point(blind, 100, 100).notes
    assert "the samples do not tell it either" in note


def test_viewpoints_out_of_reach_are_named(found, cell) -> None:
    everywhere = place_plan(found, replace(cell, reach=None))
    heights = [p.base_from_hand.translation_mm[2] for p in everywhere.placements]
    low = Reach([-100, -600, 250], [1300, 800, np.median(heights)], 45)
    placed = place_plan(found, replace(cell, reach=low))
    assert placed.placements
    assert placed.unreachable
    numbers = [p.viewpoint for p in placed.placements]
    assert sorted(numbers + [u.viewpoint for u in placed.unreachable]) == list(
        range(len(found.viewpoints))
    )
    assert "of the hand lies outside the workspace 250 to" in placed.unreachable[0].reason
    assert "nothing was moved" not in placed.unreachable[0].reason
    none = Reach([0, 0, 0], [10, 10, 10])
    with pytest.raises(PlanningError, match="the robot reaches none of the .* viewpoint 0: x = "):
        place_plan(found, replace(cell, reach=none))


def test_the_plan_s_own_iris_counts(found, cell) -> None:
    with_iris = replace(found, viewpoints=found.viewpoints.assign(iris=33.0))
    assert place_plan(with_iris, cell).placements[0].setting.iris == 33.0
    unstated = place_plan(found, replace(cell, iris=None, approach=ApproachSide.FROM_ABOVE))
    assert unstated.placements[0].setting.iris is None
    assert unstated.placements[0].approach is ApproachSide.FROM_ABOVE


def test_hand_eye_of_another_rig_is_refused(found, cell, lens) -> None:
    mount = cell.mount
    for role in ("lens", "camera", "rig"):
        other = CameraMount(
            mount.hand_from_camera,
            mount.covariance,
            mount.reference_setting,
            {**mount.identity, role: "another"},
        )
        with pytest.raises(
            PlanningError, match=f"is of another rig .*: its {role} is 'another', th"
        ):
            place_plan(found, replace(cell, mount=other))
    elsewhere = CameraMount(
        mount.hand_from_camera, mount.covariance, LensSetting(50, 100), mount.identity
    )
    with pytest.raises(
        PlanningError, match="holds for zoom 50, focus 100, but the offsets .* from z"
    ):
        place_plan(found, replace(cell, mount=elsewhere))


def test_what_cannot_be_placed(found, cell, lens, paper_sensor) -> None:
    with pytest.raises(PlanningError, match="a fixed lens has no nodal offsets to place it by"):
        place_plan(replace(found, lens=FixedLens(127, paper_sensor)), cell)
    blind = SimpleNamespace(has_standoff=False)
    with pytest.raises(PlanningError, match="the lens map has no standoffs and nodal offsets"):
        place_plan(replace(found, lens=blind), cell)
    empty = replace(found, viewpoints=found.viewpoints.iloc[:0], why_empty="it is dark")
    with pytest.raises(PlanningError, match=r"nothing to place: the plan is empty \(it is dark\)"):
        place_plan(empty, cell)
    for sides, words in (
        (["from_below", "from_above"], r"both sides \(from_above, from_below\)"),
        (None, "a side that it does not state"),
    ):
        samples = lens.samples.drop(columns="approach")
        if sides is not None:
            samples = samples.assign(approach=(sides * len(samples))[: len(samples)])
        with pytest.raises(PlanningError, match=f"calibrated from {words}; state with approach"):
            place_plan(replace(found, lens=replace(lens, samples=samples)), cell)


def test_placements_are_written_as_a_table_and_with_their_covariances(placed, tmp_path) -> None:
    table = pd.read_csv(save_placements(placed, tmp_path / "p.csv"))
    pd.testing.assert_frame_equal(table, placement_table(placed), check_dtype=False)
    body = read_document(save_placements(placed, tmp_path / "p.json"), "placements", 1)
    first, p = body["placements"][0], placed.placements[0]
    np.testing.assert_array_equal(first["sharp_covariance_rad_mm"], p.sharp_covariance)
    np.testing.assert_array_equal(
        Pose.from_dict(first["base_from_hand"]).matrix, p.base_from_hand.matrix
    )
    assert first["hand_x_mm"] == p.base_from_hand.translation_mm[0]
    assert body["made_from"]["lens_map"] == placed.plan.lens.digest
    with pytest.raises(FileError, match="written as .csv or .json, but 'p.xml' was named"):
        save_placements(placed, tmp_path / "p.xml")
    unstated = place_plan(placed.plan, replace(placed.cell, iris=None))
    body = read_document(save_placements(unstated, tmp_path / "u.json"), "placements", 1)
    assert body["placements"][0]["iris"] is None


def test_the_sequence_is_the_placements(placed) -> None:
    sequence = as_sequence(placed)
    assert len(sequence) == len(placed)
    assert sequence.identity["rig"] == "simulated vicon-1990, seed 0"
    assert set(sequence.made_from) == {"task", "scene", "lens_map"}
    for station, p in zip(sequence.stations, placed.placements, strict=True):
        assert station.setting == p.setting
        assert station.standoff_mm == p.standoff_mm
        assert station.sigma_standoff_mm == p.sigma_sharp_mm[2]
        np.testing.assert_array_equal(station.base_from_hand.matrix, p.base_from_hand.matrix)


def test_the_map_knows_its_rig_from_the_session_on(request, lens, tmp_path) -> None:
    """The names of the devices go from the recording to the table, the map and its file."""
    table = CalibrationTable.load(request.config.rootpath / "data" / "vicon-1990" / "table.csv")
    assert table.identity["rig"] == "simulated vicon-1990, seed 0"
    assert fit_lens_map(table, log_smoothing=_smoothing(lens)).identity == table.identity
    assert lens.identity == table.identity
    assert LensMap.load(lens.save(tmp_path / "map.json")).identity == lens.identity
    nameless = replace(lens, identity={})
    assert nameless.digest != lens.digest
    assert LensMap.load(nameless.save(tmp_path / "older.json")).identity == {}


def _smoothing(lens: LensMap) -> dict[str, np.ndarray]:
    surfaces = {"core": lens.core, **lens.single_surfaces}
    chosen = {name: s.log_smoothing for name, s in surfaces.items()}
    return chosen | {"core_powers": lens.core.powers, "core_mixing": lens.core.mixing}
