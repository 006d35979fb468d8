"""How sure a view is: errors are drawn as the map knows them, and probabilities mean what they say.

What the planner states is held against draws made here: the logarithms of d/D, D and standoff from
the map's covariance, the robot's slip as a motion of its own, and corners projected one by one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lenscal.calibration.calibration import Repeatability
from lenscal.camera import Camera
from lenscal.camera_mount import CameraMount
from lenscal.maps.lens_map import LensMap
from lenscal.pose import Pose
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
from planning.view_search import FoundViews, improved, sigmas
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
DRAWS = 2000


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


def redrawn_alone(lens, cell, views, rng):
    """True cameras, poses and sharp planes of one view, by the algebra of the conventions."""
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
    for k in range(DRAWS):
        slip = Pose.from_rotation_vector(
            rng.normal(scale=SLIP.rotation_rad, size=3),
            rng.normal(scale=SLIP.translation_mm, size=3),
        )
        part = rng.normal(scale=PART_SIGMA)
        lies = Pose.from_rotation_vector(part[:3], part[3:])
        # base ← hand with the robot's slip, hand ← camera; and the part not where it was taken for.
        truly = lies.inverse() @ reference @ hand.inverse() @ slip @ hand
        lateral = point.lateral_mm + point.sigma_lateral_mm * rng.normal(size=2)
        centre = np.array([*lateral, standoff[k] - distance[k]])
        errors = of_camera * rng.normal(size=3)
        camera = Camera(
            nominal.sensor,
            float(image_distance[k]),
            nominal.k1_per_mm2 + errors[2],
            nominal.centre_px + errors[:2],
        )
        yield camera, truly @ Pose(np.eye(3), centre), float(distance[k])


def satisfied(camera, pose, distance, pupil, subject) -> bool:
    """Everything but visibility, by projecting and by similar triangles."""
    feature = subject.seen_feature.vertices_mm
    back = pose.inverse()
    share = np.linspace(0, 1, 201)[:, None]
    along = back.transform(feature[0] + share * (feature[1] - feature[0]))
    pixels = camera.project(along)
    if not camera.sensor.contains(pixels).all():
        return False
    # Pieces of a hundredth of the feature, as asked.
    pieces = np.linalg.norm((pixels[2:] - pixels[:-2]) * camera.sensor.sample_pitch_mm, axis=1)
    if pieces.min() / camera.sensor.sample_pitch_mm.max() < 3.0:
        return False
    depths = np.concatenate([along[[0, -1], 2] - 0.5, along[[0, -1], 2] + 0.5])
    blur = pupil * camera.image_distance_mm * np.abs(1 / depths - 1 / distance)
    if blur.max() > 2.4 * camera.sensor.sample_pitch_mm.min():
        return False
    away = pose.translation_mm - feature
    cosine = away @ subject.target.normal / np.linalg.norm(away, axis=1)
    return bool(np.degrees(np.arccos(cosine)).max() <= 75)


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
    alone = [pose.transform(-nominal) for _, pose, _ in redrawn_alone(lens, cell, views, rng)]
    # Along the axis the origin is not told by the projection centre alone; across it is.
    across = views.rotations[0, 0][:, :2]
    ours, theirs = np.cov((origins @ across).T), np.cov((np.array(alone) @ across).T)
    np.testing.assert_allclose(np.diag(ours), np.diag(theirs), rtol=0.15)


@pytest.mark.parametrize(
    ("confidence", "low", "high", "direction"),
    [(0.80, 0.77, 0.83, 3), (0.95, 0.93, 0.97, 1), (0.99, 0.98, 1.0, 2)],
)
def test_the_stated_probability_is_the_frequency(
    lens, cell, subject, confidence, low, high, direction
) -> None:
    """A good view is moved until the planner says so much, where several requirements bind."""
    errors = ViewErrors(lens, cell)
    best = improved(REQUIREMENTS, start(subject, lens), errors=errors, rounds=15).views
    way = np.random.default_rng(direction).normal(size=best.size)
    way[: best.settings.size] *= 0.3

    def probability(share: float) -> float:
        views = best.moved(share * way[None, None]).as_views()[0]
        return float(robustness_of(REQUIREMENTS, views, errors, 4096).probability[0])

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
    good, places = [], []
    for camera, pose, distance in redrawn_alone(lens, cell, views, rng):
        good.append(satisfied(camera, pose, distance, pupil, subject))
        places.append(pose.translation_mm)
    seen = sees_whole_target(np.array(places), subject.target, subject.scene)
    frequency = (np.array(good) & seen).mean()
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
    by_sigma = improved(REQUIREMENTS, start(subject, lens), errors=errors, rounds=20)

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
