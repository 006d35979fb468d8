"""For a fixed direction of the camera, requirements are half-spaces of positions."""

from __future__ import annotations

import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.half_spaces import HalfSpaces
from planning.lens_states import LensStates
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.margin import Polyhedral
from planning.requirements.resolution import Resolution
from planning.solid import box_workspace
from planning.target import Target
from planning.views import Subject, Views

SENSOR = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)
FACE = Target(np.array([[-12.0, -8, 0], [12, -8, 0], [10, 9, 0], [-12, 8, 0]]))
SEGMENT = Target.segment((-12, 1, 0), (12, 1, 0))


def one_state(k1: float = 0.0, pupil: float = 8.0) -> LensStates:
    camera = Camera(SENSOR, 120.0, k1, SENSOR.centre_px + np.array([8.0, -5.0]))
    return LensStates((camera,), [600.0], entrance_pupil_diameter_mm=[pupil])


def direction(generator) -> np.ndarray:
    z = np.array([*generator.uniform(-0.4, 0.4, 2), -1.0])
    z /= np.linalg.norm(z)
    x = np.cross(z, generator.normal(size=3))
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def views_from(places, rotation, states, subject) -> Views:
    turns = np.broadcast_to(rotation, (len(places), 1, 3, 3))
    return Views(places[:, None], turns, states, subject)


@pytest.mark.parametrize(
    "requirement", [FieldOfView(24), DepthOfField(4, 1.5), DepthOfField(2, 2.5, 550)]
)
def test_half_spaces_are_where_the_margin_is_positive(requirement) -> None:
    """20 000 positions, to and fro about the limits; the pinhole exactly."""
    generator = np.random.default_rng(0)
    assert isinstance(requirement, Polyhedral)
    held = 0
    for _ in range(20):
        rotation, subject = direction(generator), Subject(FACE)
        spaces = requirement.half_spaces(rotation, one_state(), subject)
        places = -600 * rotation[:, 2] + generator.normal(size=(1000, 3)) * [15, 15, 60]
        margin = requirement.margin(views_from(places, rotation, one_state(), subject))
        clear = np.abs(margin.value[:, 0]) > 1e-9
        np.testing.assert_array_equal(spaces.contains(places)[clear], margin.holds[clear, 0])
        held += margin.holds.sum()
    assert 500 < held < 19_500


@pytest.mark.parametrize("k1", [2e-3, -1e-3])
def test_distorted_field_of_view_is_held_by_a_rectangle_inside(k1) -> None:
    generator = np.random.default_rng(1)
    tight = lost = 0
    for _ in range(10):
        rotation, subject = direction(generator), Subject(FACE)
        spaces = FieldOfView(24).half_spaces(rotation, one_state(k1), subject)
        places = -600 * rotation[:, 2] + generator.normal(size=(2000, 3)) * [15, 15, 60]
        share = FieldOfView(24).margin(views_from(places, rotation, one_state(k1), subject)).share
        inside = spaces.contains(places)
        assert (share[inside, 0] > -2e-3).all(), "but for what the margin itself takes off"
        tight += (share[inside, 0] < 0.02).sum()
        lost += (share[~inside, 0] > 0.1).sum()
    assert tight > 10
    assert lost == 0


def test_incidence_is_held_by_a_pyramid_inside_the_cone() -> None:
    generator = np.random.default_rng(2)
    places = generator.uniform((-500, -500, 0), (500, 500, 600), (20_000, 3))
    subject, rotation = Subject(FACE, SEGMENT), direction(generator)
    margin = Incidence(35).margin(views_from(places, rotation, one_state(), subject))
    inside = Incidence(35).half_spaces(rotation, one_state(), subject).contains(places)
    assert margin.holds[inside].all()
    assert not (margin.share[~inside, 0] > 0.01).any()
    front = Incidence(90).half_spaces(rotation, one_state(), subject)
    assert len(front) == 1
    assert front.contains(places).all()


def test_resolution_is_a_plane_where_the_feature_is_perpendicular() -> None:
    rotation = np.diag([1.0, -1.0, -1.0])
    requirement = Resolution(3, 0.254, "x")
    spaces = requirement.half_spaces(rotation, one_state(), Subject(FACE, SEGMENT))
    limit = 120.0 / requirement.magnification_bounds(SENSOR)[0]
    assert spaces.contains((0, 0, limit - 1e-6))
    assert not spaces.contains((0, 0, limit + 1e-6))
    assert not spaces.contains((0, 0, -1.0))
    places = np.array([[3.0, 5, limit - 1e-6], [3, 5, limit + 1e-6]])
    margin = requirement.margin(views_from(places, rotation, one_state(), Subject(FACE, SEGMENT)))
    assert margin.holds[:, 0].tolist() == [True, False]
    oblique = direction(np.random.default_rng(3))
    assert len(requirement.half_spaces(oblique, one_state(), Subject(FACE, SEGMENT))) == 0
    assert len(requirement.half_spaces(rotation, one_state(1e-3), Subject(FACE, SEGMENT))) == 0
    face = Resolution(3, 0.254).half_spaces(rotation, one_state(), Subject(FACE))
    assert face.contains((0, 0, limit - 1e-6))


def test_solids_are_cut_exactly() -> None:
    box = box_workspace((-10, -10, 0), (10, 10, 100))
    slab = HalfSpaces.slab((0, 0, -1), (0, 0, 0), 20, 60)
    assert slab.cut(box).volume_mm3 == pytest.approx(400 * 40, rel=1e-12)
    corner = HalfSpaces(np.array([[2.0, 0, 0]]), np.array([10.0]))
    assert (slab & corner).cut(box).volume_mm3 == pytest.approx(5 * 20 * 40, rel=1e-12)
    assert corner.distance_mm((8, 0, 0)) == pytest.approx(3)
    assert HalfSpaces.slab((0, 0, -1), (0, 0, 0), 200, np.inf).cut(box).is_empty
    assert (
        HalfSpaces.slab((0, 0, -1), (0, 0, 0), 200, np.inf).cut(corner.cut(slab.cut(box))).is_empty
    )
    everywhere = HalfSpaces.everywhere()
    assert everywhere.cut(box).volume_mm3 == pytest.approx(box.volume_mm3)
    assert everywhere.distance_mm((0, 0, 0)) == np.inf
    empty = slab.cut(HalfSpaces.slab((0, 0, -1), (0, 0, 0), 70, 90).cut(box))
    assert empty.is_empty
    assert slab.cut(empty).is_empty


def test_region_is_cut_and_stays_inside(bench) -> None:
    """The region of a camera that looks straight down, with field of view and depth of field."""
    from planning.visibility.methods import visibility_region

    workspace = box_workspace((-50, -50, 400), (50, 50, 900))
    scene = bench.scene(bench.block, bench.box((8, -50, 100), (9, 50, 110)))
    region = visibility_region(scene, bench.target, workspace, audit_points=0)
    rotation, subject = np.diag([1.0, -1.0, -1.0]), Subject(bench.target, None, scene, region)
    states = one_state()
    spaces = FieldOfView(10).half_spaces(rotation, states, subject) & DepthOfField(
        1, 2
    ).half_spaces(rotation, states, subject)
    left = spaces.cut(region.solid)
    generator = np.random.default_rng(4)
    places = generator.uniform((-20, -20, 550), (20, 20, 700), (4000, 3))
    expected = region.contains(places) & spaces.contains(places)
    np.testing.assert_array_equal(left.contains(places), expected)
    assert 50 < expected.sum() < 3900


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(InputError, match="the normal of a half-space must not be zero"):
        HalfSpaces(np.zeros((1, 3)), np.zeros(1))
    two = LensStates(
        (Camera(SENSOR, 120.0),) * 2, [600.0, 600.0], entrance_pupil_diameter_mm=[1, 1]
    )
    for requirement in (FieldOfView(24), DepthOfField(1, 1)):
        with pytest.raises(InputError, match="those of one lens state, but there are 2"):
            requirement.half_spaces(np.eye(3), two, Subject(FACE))
    with pytest.raises(PlanningError, match="diffraction alone blurs by .* open the iris"):
        DepthOfField(1, 1, 550).half_spaces(np.eye(3), one_state(pupil=1.0), Subject(FACE))
    with pytest.raises(PlanningError, match="the target is a segment and has none"):
        Incidence(30).half_spaces(np.eye(3), one_state(), Subject(SEGMENT))
