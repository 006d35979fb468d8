"""How sure a view is: errors are drawn as the map knows them, and probabilities mean what they say.

What the planner states is held against draws made here: the logarithms of d/D, D and standoff from
the map's covariance, the robot's slip as a motion of its own, and corners projected one by one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lenscal.calibration.calibration import Repeatability
from lenscal.camera import Camera
from lenscal.camera_mount import CameraMount
from lenscal.maps.lens_map import LensMap
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from planning.enclosure import example_part
from planning.fixed_lens import FixedLens
from planning.nodal import nodal_point
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.resolution import Resolution
from planning.requirements.visibility import Visibility
from planning.robot_cell import RobotCell
from planning.robustness import robustness_of
from planning.setting_space import FixedSettings, MapSettings
from planning.view_errors import ViewErrors
from planning.view_search import FoundViews, improved, improved_in_sigma, sigmas
from planning.view_space import GeneralStarts
from planning.views import Subject
from planning.visibility.audit import sees_whole_target
from planning.visibility.methods import visibility_region

SLIP = Repeatability(translation_mm=0.8, rotation_rad=2e-3)
PART_SIGMA = np.repeat([1e-3, 0.5], 3)
REQUIREMENTS = (
    Resolution(3.0, 0.254),
    FieldOfView(25.4),
    Visibility(),
    DepthOfField(1.0, 2.4),
    Incidence(75),
)
#: They tell a probability of 0.8 to within 0.6 %, one standard deviation, and one of 0.99 to 0.2 %.
DRAWS = 4000


@pytest.fixture(scope="module")
def lens(request) -> LensMap:
    return LensMap.load(request.config.rootpath / "data" / "vicon-1990" / "map.json")


@pytest.fixture(scope="module")
def cell(lens) -> RobotCell:
    setting = lens.reference_setting
    mount = CameraMount(
        Pose.from_rotation_vector([0.1, -0.2, 0.3], [20, -30, 60]), np.zeros((6, 6)), setting
    )
    return RobotCell(mount, Pose.identity(), np.diag(PART_SIGMA**2), SLIP)


@pytest.fixture(scope="module")
def subject() -> Subject:
    part = example_part()
    region = visibility_region(part.scene, part.target, part.workspace, audit_points=0)
    return Subject(part.target, part.feature, part.scene, region)


def start(subject: Subject, lens: LensMap, angle: float = 0.72) -> GeneralStarts:
    """A view through the large hole, a little off the middle."""
    tilt = Rotation.from_euler("x", np.pi + angle).as_matrix()
    return GeneralStarts(
        subject,
        MapSettings(lens),
        np.array([[0.45, 0.2]]),
        tilt[None] @ Rotation.from_euler("z", 0.1).as_matrix(),
        np.array([[0.005, -0.01]]),
        np.zeros(1),
        True,
    )


@dataclass(frozen=True, eq=False)
class Drawn:
    """True cameras, poses and sharp planes of one view, one row per draw."""

    sensor: Sensor
    image_distance_mm: np.ndarray
    k1_per_mm2: np.ndarray
    centre_px: np.ndarray
    part_from_camera: np.ndarray  # (N, 4, 4)
    object_distance_mm: np.ndarray

    def camera(self, k: int) -> Camera:
        return Camera(
            self.sensor,
            float(self.image_distance_mm[k]),
            float(self.k1_per_mm2[k]),
            self.centre_px[k],
        )

    def seen(self, points_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points of the part in the camera, (N, M, 3), and their pixels, by similar triangles.

        Tsai's distortion, undistorted = distorted (1 + κ1 r²), is undone step by step; it is
        small here, so that each step takes two digits away from the error.
        """
        turns, places = self.part_from_camera[:, :3, :3], self.part_from_camera[:, :3, 3]
        # (Rᵀ (x − t))ᵀ = (x − t)ᵀ R.
        points = (points_mm - places[:, None]) @ turns
        ideal = self.image_distance_mm[:, None, None] * points[..., :2] / points[..., 2:]
        image = ideal
        for _ in range(8):
            squared = (image**2).sum(axis=-1, keepdims=True)
            image = ideal / (1 + self.k1_per_mm2[:, None, None] * squared)
        return points, self.centre_px[:, None] + image / self.sensor.sample_pitch_mm


def motions(vectors: np.ndarray) -> np.ndarray:
    """(N, 4, 4) of (N, 6) rotation vectors and translations."""
    moved = np.tile(np.eye(4), (len(vectors), 1, 1))
    moved[:, :3, :3] = Rotation.from_rotvec(vectors[:, :3]).as_matrix()
    moved[:, :3, 3] = vectors[:, 3:]
    return moved


def redrawn_alone(lens, cell, views, rng) -> Drawn:
    """What one view truly is, by the algebra of the conventions."""
    states = views.states
    zoom, focus = float(states.zoom[0]), float(states.focus[0])
    covariance = lens.core.covariance_at(states.zoom, states.focus)[0]
    drawn = np.linalg.cholesky(covariance) @ rng.normal(size=(3, DRAWS))
    values = [float(lens.value(n, zoom, focus)) for n in ("magnification", "object_distance_mm")]
    standoff = float(lens.standoff_mm(zoom, focus)) * np.exp(drawn[2])
    distance = values[1] * np.exp(drawn[1])
    image_distance = distance * values[0] * np.exp(drawn[0])
    point = nodal_point(lens, zoom, focus)
    nominal = states.cameras[0]
    of_camera = [
        float(lens.sigma(name, zoom, focus))
        for name in ("principal_point_x_px", "principal_point_y_px", "k1_per_mm2")
    ]
    planned = Pose(views.rotations[0, 0], views.positions_mm[0, 0])
    reference = planned @ Pose(np.eye(3), point.centre_mm).inverse()
    hand = cell.mount.hand_from_camera
    slip_sigma = np.repeat([SLIP.rotation_rad, SLIP.translation_mm], 3)
    slips = motions(slip_sigma * rng.normal(size=(DRAWS, 6)))
    lies = motions(PART_SIGMA * rng.normal(size=(DRAWS, 6)))
    lateral = point.lateral_mm + point.sigma_lateral_mm * rng.normal(size=(DRAWS, 2))
    centres = np.concatenate([lateral, (standoff - distance)[:, None]], axis=1)
    errors = of_camera * rng.normal(size=(DRAWS, 3))
    # base ← hand with the robot's slip, hand ← camera; and the part not where it was taken for.
    truly = (
        np.linalg.inv(lies)
        @ (reference @ hand.inverse()).matrix
        @ slips
        @ hand.matrix
        @ motions(np.concatenate([np.zeros((DRAWS, 3)), centres], axis=1))
    )
    return Drawn(
        nominal.sensor,
        image_distance,
        nominal.k1_per_mm2 + errors[:, 2],
        nominal.centre_px + errors[:, :2],
        truly,
        distance,
    )


def satisfied(drawn: Drawn, pupil, subject) -> np.ndarray:
    """(N,) everything but visibility, by projecting and by similar triangles."""
    feature, sensor = subject.seen_feature.vertices_mm, drawn.sensor
    share = np.linspace(0, 1, 201)[:, None]
    along, pixels = drawn.seen(feature[0] + share * (feature[1] - feature[0]))
    # Pieces of a hundredth of the feature, as asked.
    lengths = (pixels[:, 2:] - pixels[:, :-2]) * sensor.sample_pitch_mm
    pieces = np.linalg.norm(lengths, axis=-1).min(axis=1) / sensor.sample_pitch_mm.max()
    ends = along[:, [0, -1], 2]
    depths = np.concatenate([ends - 0.5, ends + 0.5], axis=1)
    sharp = 1 / drawn.object_distance_mm[:, None]
    blur = pupil * drawn.image_distance_mm[:, None] * np.abs(1 / depths - sharp)
    away = drawn.part_from_camera[:, None, :3, 3] - feature
    cosines = away @ subject.target.normal / np.linalg.norm(away, axis=-1)
    return (
        sensor.contains(pixels).all(axis=1)
        & (pieces >= 3.0)
        & (blur.max(axis=1) <= 2.4 * sensor.sample_pitch_mm.min())
        & (np.degrees(np.arccos(cosines)).max(axis=1) <= 75)
    )


@pytest.fixture(scope="module")
def best(lens, cell, subject) -> GeneralStarts:
    """The surest view found from one start."""
    errors = ViewErrors(lens, cell)
    return improved_in_sigma(REQUIREMENTS, start(subject, lens), errors, rounds=18)[0].views


def test_draws_made_here_are_seen_as_a_camera_projects(lens, cell, subject, best) -> None:
    """Many cameras at once, by a formula of the tests, against one camera after the other."""
    drawn = redrawn_alone(lens, cell, best.as_views()[0], np.random.default_rng(7))
    corners = subject.target.vertices_mm
    points, pixels = drawn.seen(corners)
    for k in range(0, DRAWS, 100):
        back = Pose.from_matrix(drawn.part_from_camera[k]).inverse()
        np.testing.assert_allclose(points[k], back.transform(corners), atol=1e-9)
        np.testing.assert_allclose(pixels[k], drawn.camera(k).project(points[k]), atol=1e-9)


def test_an_error_of_the_distance_hardly_changes_the_image(lens, subject) -> None:
    """σ of the image scale is that of d/D and of the standoff; σ of D alone is ten times larger."""
    views = start(subject, lens, angle=0.0).as_views()[0]
    drawn = ViewErrors(lens).redrawn(views, ViewErrors(lens).normals(4096, 1))
    middle = drawn.states.image_distance_mm / (
        (subject.seen_feature.centroid_mm - drawn.positions_mm[0]) * drawn.rotations[0, :, :, 2]
    ).sum(axis=-1)
    settings = views.states.zoom[0], views.states.focus[0]
    scatter = np.log(middle).std()
    shift = float(lens.sigma("standoff_mm", *settings) / lens.object_distance_mm(*settings))
    covariance = lens.core.covariance_at(*settings)
    share = float(lens.standoff_mm(*settings) / lens.object_distance_mm(*settings))
    expected = np.sqrt(covariance[0, 0] + 2 * share * covariance[0, 2] + shift**2)
    assert scatter == pytest.approx(expected, rel=0.03)
    of_distance = float(
        lens.sigma("object_distance_mm", *settings) / lens.object_distance_mm(*settings)
    )
    assert scatter < of_distance / 2
    distances = drawn.states.object_distance_mm
    assert np.log(distances).std() == pytest.approx(of_distance, rel=0.03)


def test_draws_of_the_pose_have_the_stated_covariance(lens, cell, subject) -> None:
    """The centre of the reference camera slips as robot and part let it."""
    views = start(subject, lens).as_views()[0]
    errors = ViewErrors(lens, cell)
    drawn = errors.redrawn(views, errors.normals(8192, 0))
    origins = drawn.positions_mm[0] - np.einsum(
        "kij,kj->ki", drawn.rotations[0], drawn.states.projection_centre_mm
    )
    rng = np.random.default_rng(3)
    nominal = nodal_point(lens, views.states.zoom[0], views.states.focus[0]).centre_mm
    poses = redrawn_alone(lens, cell, views, rng).part_from_camera
    alone = poses[:, :3, 3] - poses[:, :3, :3] @ nominal
    # Along the axis the origin is not told by the projection centre alone; across it is.
    across = views.rotations[0, 0][:, :2]
    ours, theirs = np.cov((origins @ across).T), np.cov((alone @ across).T)
    np.testing.assert_allclose(np.diag(ours), np.diag(theirs), rtol=0.15)


@pytest.mark.parametrize(
    ("confidence", "low", "high", "direction"),
    [(0.80, 0.77, 0.83, 3), (0.95, 0.93, 0.97, 1), (0.99, 0.98, 1.0, 2)],
)
def test_the_stated_probability_is_the_frequency(
    lens, cell, subject, best, confidence, low, high, direction
) -> None:
    """A good view is moved until the planner says so much, where several requirements bind."""
    errors = ViewErrors(lens, cell)
    way = np.random.default_rng(direction).normal(size=best.size)
    way[: best.settings.size] *= 0.3

    def probability(share: float) -> float:
        # Only looks for the place; what is stated there is asked again, of other and more draws.
        views = best.moved(share * way[None, None]).as_views()[0]
        return float(robustness_of(REQUIREMENTS, views, errors, 1024).probability[0])

    inside, outside = 0.0, 0.01
    assert probability(inside) > confidence, "the start is sure enough to be moved away from"
    while probability(outside) > confidence:
        inside, outside = outside, 2 * outside
    for _ in range(8):
        middle = (inside + outside) / 2
        if probability(middle) > confidence:
            inside = middle
        else:
            outside = middle
    views = best.moved(inside * way[None, None]).as_views()[0]
    pupil = float(views.states.entrance_pupil_diameter_mm[0])
    rng = np.random.default_rng(11)
    drawn = redrawn_alone(lens, cell, views, rng)
    places = drawn.part_from_camera[:, :3, 3]
    seen = sees_whole_target(places, subject.target, subject.scene)
    frequency = (satisfied(drawn, pupil, subject) & seen).mean()
    assert low <= frequency <= high
    stated = robustness_of(REQUIREMENTS, views, errors, seed=5)
    assert stated.probability[0] == pytest.approx(frequency, abs=0.02)
    assert stated.each.min() >= stated.probability[0]
    assert stated.sigma_probability[0] < 0.01


def test_without_errors_everything_is_sure(paper_sensor, subject) -> None:
    """A fixed lens that stands where it should is as good as it looks."""
    fixed = FixedLens(127.0, paper_sensor, 5.0)
    starts = replace(start(subject, None), settings=FixedSettings(fixed, 127.0, np.inf))
    starts = replace(starts, shares=np.array([[0.2]]))
    found = FoundViews.judged(REQUIREMENTS, starts)
    stated = robustness_of(REQUIREMENTS, starts.as_views()[0], ViewErrors(fixed), 16)
    assert stated.probability[0] == (found.shares.min() >= 0)
    np.testing.assert_allclose(stated.sigma_share, 0, atol=1e-12)


def test_margins_in_sigma_lead_elsewhere_than_shares(lens, cell, subject) -> None:
    errors = ViewErrors(lens, cell)
    by_share = improved(REQUIREMENTS, start(subject, lens), rounds=20)
    by_sigma = improved_in_sigma(REQUIREMENTS, start(subject, lens), errors, rounds=24)[0]

    def in_sigma(found):
        return (found.shares / sigmas(REQUIREMENTS, found.views, errors)).min()

    assert in_sigma(by_sigma) > in_sigma(by_share)
    assert by_share.shares.min() > by_sigma.shares.min()


def test_a_map_without_a_robot_moves_until_the_image_is_sharp(lens, subject) -> None:
    """No standoff: the camera is taken to be moved to where its true sharp plane is."""

    class Unplaced:
        has_standoff = False

        def __getattr__(self, name):
            return getattr(lens, name)

    views = start(subject, Unplaced(), angle=0.0).as_views()[0]
    assert views.states.projection_centre_mm is None
    errors = ViewErrors(Unplaced())
    drawn = errors.redrawn(views, errors.normals(64, 0))
    assert drawn.states.projection_centre_mm is None
    depth = ((subject.seen_feature.centroid_mm - drawn.positions_mm[0]) *
             drawn.rotations[0, :, :, 2]).sum(axis=-1)  # fmt: skip
    np.testing.assert_allclose(depth, drawn.states.object_distance_mm, rtol=1e-9)
