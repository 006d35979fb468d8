"""Margins of general views against plain loops: 20 000 random cases per requirement."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.errors import InputError, PlanningError
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from planning.fixed_lens import FixedLens
from planning.judgement import judge
from planning.lens_states import LensStates
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.resolution import Resolution
from planning.target import Target
from planning.views import Subject, Views

SENSOR = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)
SQUARE = Target(np.array([[-12.0, -8, 0], [12, -8, 0], [10, 9, 0], [-12, 8, 0]]))
SEGMENT = Target.segment((-12, 1, 0), (12, -2, 0))
POSES, STATES = 200, 100


def random_states(generator, count, k1=0.0, radial=(), decentring=0.0) -> LensStates:
    cameras = [
        Camera(
            SENSOR,
            generator.uniform(60, 180),
            generator.uniform(-k1, k1),
            SENSOR.centre_px + generator.uniform(-12, 12, 2),
            radial,
            tuple(generator.uniform(-decentring, decentring, 2)),
        )
        for _ in range(count)
    ]
    return LensStates(
        tuple(cameras),
        generator.uniform(450, 750, count),
        entrance_pupil_diameter_mm=generator.uniform(5, 40, count),
    )


def random_views(generator, states, subject, count=POSES, tilt=0.9) -> Views:
    """From all about the front, aimed near the feature, rolled at random."""
    angle, around = generator.uniform(0, tilt, count), generator.uniform(-np.pi, np.pi, count)
    direction = np.stack(
        [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=-1
    )
    places = generator.uniform(400, 800, count)[:, None] * direction
    z = generator.uniform(-8, 8, (count, 3)) - places
    z /= np.linalg.norm(z, axis=-1, keepdims=True)
    x = np.cross(z, generator.normal(size=(count, 3)))
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    turns = np.stack([x, np.cross(z, x), z], axis=-1)
    return Views(places[:, None], turns[:, None], states, subject)


def pixel(camera: Camera, position, rotation, point) -> tuple[float, float]:
    """Projection of one point in plain arithmetic, the distortion by bisection."""
    away = [point[i] - position[i] for i in range(3)]
    x, y, z = (sum(rotation[i][j] * away[i] for i in range(3)) for j in range(3))
    u, v = camera.image_distance_mm * x / z, camera.image_distance_mm * y / z
    wanted = math.hypot(u, v)
    low, high = 0.0, 2 * wanted
    for _ in range(200 if camera.k1_per_mm2 else 0):
        middle = (low + high) / 2
        if middle * (1 + camera.k1_per_mm2 * middle**2) < wanted:
            low = middle
        else:
            high = middle
        if high - low < 1e-14:
            break
    share = (low + high) / 2 / wanted if camera.k1_per_mm2 and wanted else 1.0
    pitch = camera.sensor.sample_pitch_mm
    return u * share / pitch[0] + camera.centre_px[0], v * share / pitch[1] + camera.centre_px[1]


def between(a, b, share):
    return [a[i] + share * (b[i] - a[i]) for i in range(3)]


def all_views(views: Views):
    for v in range(views.shape[0]):
        for s, camera in enumerate(views.states.cameras):
            yield v, s, camera, views.positions_mm[v, 0].tolist(), views.rotations[v, 0].tolist()


def test_resolution_of_a_segment_is_that_of_its_worst_piece() -> None:
    """Pinhole, exactly: both end pieces, and none of those between is worse."""
    generator = np.random.default_rng(3)
    views = random_views(generator, random_states(generator, STATES), Subject(SQUARE, SEGMENT))
    a, b = SEGMENT.vertices_mm.tolist()
    piece = 0.5 / math.dist(a, b)
    pitch = SENSOR.sample_pitch_mm
    worst = {axis: np.full(views.shape, np.inf) for axis in ("any", "x", "y")}
    for v, s, camera, place, turn in all_views(views):
        for start in (0.0, 1 - piece) if s % 50 else np.linspace(0, 1 - piece, 21):
            p = pixel(camera, place, turn, between(a, b, start))
            q = pixel(camera, place, turn, between(a, b, start + piece))
            across, down = abs(p[0] - q[0]), abs(p[1] - q[1])
            length = math.hypot(across * pitch[0], down * pitch[1]) / max(pitch)
            for axis, samples in (("x", across), ("y", down), ("any", length)):
                worst[axis][v, s] = min(worst[axis][v, s], samples)
    for axis, expected in worst.items():
        margin = Resolution(3, 0.5, axis).margin(views)
        np.testing.assert_allclose(margin.value, expected - 3, atol=1e-9)
        np.testing.assert_allclose(margin.share, margin.value / 3)
        assert (margin.holds == (margin.value >= 0)).all()


def test_resolution_under_distortion_is_never_too_good() -> None:
    generator = np.random.default_rng(4)
    states = random_states(generator, 20, k1=1.5e-3)
    views = random_views(generator, states, Subject(SQUARE, SEGMENT), count=15)
    margin = Resolution(3, 0.5).margin(views)
    a, b = SEGMENT.vertices_mm.tolist()
    piece = 0.5 / math.dist(a, b)
    pitch = SENSOR.sample_pitch_mm
    worst = np.full(views.shape, np.inf)
    for v, s, camera, place, turn in all_views(views):
        for start in np.linspace(0, 1 - piece, 25):
            p = pixel(camera, place, turn, between(a, b, start))
            q = pixel(camera, place, turn, between(a, b, start + piece))
            length = math.hypot((p[0] - q[0]) * pitch[0], (p[1] - q[1]) * pitch[1]) / max(pitch)
            worst[v, s] = min(worst[v, s], length)
    assert (margin.value <= worst - 3 + 1e-9).all()
    np.testing.assert_allclose(margin.value, worst - 3, atol=5e-3 * worst.max())


@pytest.mark.parametrize("k1", [0.0, 1.5e-3])
def test_resolution_of_a_face_is_that_of_its_worst_direction(k1) -> None:
    """Short pieces in 36 directions at 60 places of the face, by finite differences."""
    generator = np.random.default_rng(5)
    states = random_states(generator, 10, k1)
    views = random_views(generator, states, Subject(SQUARE), count=20)
    margin = Resolution(3, 0.5).margin(views)
    corners = SQUARE.vertices_mm
    inside = generator.dirichlet(np.full(4, 0.5), 60) @ corners
    places = np.concatenate([corners, inside])
    angle = np.linspace(0, np.pi, 36, endpoint=False)
    step = 1e-4 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    pitch = SENSOR.sample_pitch_mm
    for v in range(20):
        camera_from_part = Pose(views.rotations[v, 0], views.positions_mm[v, 0]).inverse()
        for s, camera in enumerate(states.cameras):
            ends = [
                camera.project(camera_from_part.transform(places[:, None] + side * step))
                for side in (-1, 1)
            ]
            length = np.linalg.norm((ends[1] - ends[0]) * pitch, axis=-1) / 2e-4
            worst = length.min() * 0.5 / pitch.max()
            assert margin.value[v, s] <= worst - 3 + 1e-5
            assert margin.value[v, s] == pytest.approx(worst - 3, abs=0.03 * worst)


def test_face_seen_squarely_has_the_paper_s_resolution() -> None:
    states = LensStates((Camera(SENSOR, 130.0),), [650.0])
    pose = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 650.0]))
    for requirement in (Resolution(3, 0.254), Resolution(3, 0.254, "x"), Resolution(2, 0.1, "y")):
        margin = requirement.margin(Views.of(pose, states, Subject(SQUARE)))
        ideal = requirement.orthogonal_margin(0.2, SENSOR)
        assert margin.share[0, 0] == pytest.approx(float(ideal.share), abs=1e-12)


def test_field_of_view_is_the_outermost_corner() -> None:
    generator = np.random.default_rng(6)
    views = random_views(generator, random_states(generator, STATES), Subject(SQUARE))
    margin = FieldOfView(24.0).margin(views)
    expected = np.zeros((2, *views.shape))
    for v, s, camera, place, turn in all_views(views):
        spare, share = math.inf, math.inf
        for corner in SQUARE.vertices_mm.tolist():
            for at, size in zip(pixel(camera, place, turn, corner), (512, 480), strict=True):
                spare = min(spare, at + 0.5, size - 0.5 - at)
                share = min(share, (at + 0.5) / (size / 2), (size - 0.5 - at) / (size / 2))
        expected[:, v, s] = spare, share
    np.testing.assert_allclose(margin.value, expected[0], atol=1e-8)
    np.testing.assert_allclose(margin.share, expected[1], atol=1e-10)


@pytest.mark.parametrize(("k1", "radial"), [(2e-3, ()), (1e-3, (2e-5,)), (-2e-3, (1e-5, 1e-8))])
def test_bulging_edges_do_not_leave_the_sensor_unnoticed(k1, radial) -> None:
    generator = np.random.default_rng(7)
    states = random_states(generator, 20, abs(k1), radial)
    views = random_views(generator, states, Subject(SQUARE), count=50)
    margin = FieldOfView(24.0).margin(views)
    share = np.linspace(0, 1, 81)[:, None]
    corners = SQUARE.vertices_mm
    outline = np.concatenate(
        [a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
    bulged = 0
    for v in range(50):
        points = Pose(views.rotations[v, 0], views.positions_mm[v, 0]).inverse().transform(outline)
        for s, camera in enumerate(states.cameras):
            at = camera.project(points) + 0.5
            spare = np.minimum(at, [512, 480] - at)
            if np.isnan(spare).any():
                # Beyond the fold nothing is imaged.
                assert margin.value[v, s] == -np.inf
                continue
            assert margin.value[v, s] <= spare.min() + 1e-8
            assert margin.value[v, s] > spare.min() - 0.02 * (256 - spare.min())
            bulged += spare[::81].min() > spare.min() + 0.05
    assert bulged > 3, "the vertices alone would have been wrong"


def test_decentring_is_projected_as_the_camera_does() -> None:
    generator = np.random.default_rng(8)
    states = random_states(generator, 5, 1e-3, decentring=2e-4)
    views = random_views(generator, states, Subject(SQUARE), count=5)
    margin = FieldOfView(24.0).margin(views)
    for v in range(5):
        points = (
            Pose(views.rotations[v, 0], views.positions_mm[v, 0])
            .inverse()
            .transform(SQUARE.vertices_mm)
        )
        for s, camera in enumerate(states.cameras):
            at = camera.project(points) + 0.5
            spare = np.minimum(at, [512, 480] - at).min()
            assert spare - 0.5 < margin.value[v, s] <= spare + 1e-9
    # A face that is squarely seen has the stretch of the distortion, decentring included.
    face = Resolution(3, 0.5).margin(views)
    assert np.isfinite(face.value).all()


def test_depth_of_field_is_the_worst_corner_s_circle_of_confusion() -> None:
    generator = np.random.default_rng(9)
    views = random_views(generator, random_states(generator, STATES), Subject(SQUARE))
    requirement = DepthOfField(3.0, 2.0)
    margin = requirement.margin(views)
    smallest, largest = requirement.aperture_bounds_mm(views)
    states = views.states
    expected = np.zeros((2, *views.shape))
    for v, s, camera, place, turn in all_views(views):
        blur, aperture = 0.0, math.inf
        for corner in SQUARE.vertices_mm.tolist():
            depth = sum(turn[i][2] * (corner[i] - place[i]) for i in range(3))
            for z in (depth - 1.5, depth + 1.5):
                # The thin-lens construction: where the cone of rays meets the sensor.
                image = 1 / (
                    1 / states.object_distance_mm[s] + 1 / camera.image_distance_mm - 1 / z
                )
                spread = abs(image - camera.image_distance_mm) / image
                blur = max(blur, states.entrance_pupil_diameter_mm[s] * spread)
                aperture = min(aperture, 2.0 * 0.01375 / spread)
        expected[:, v, s] = 2.0 - blur / 0.01375, aperture
    np.testing.assert_allclose(margin.value, expected[0], atol=1e-8)
    np.testing.assert_allclose(largest, expected[1], rtol=1e-9)
    assert (smallest == 0).all()
    np.testing.assert_allclose(margin.share, margin.value / 2.0)


def test_incidence_is_that_of_the_worst_corner() -> None:
    generator = np.random.default_rng(10)
    subject = Subject(SQUARE, SEGMENT)
    views = random_views(generator, random_states(generator, 1), subject, 20_000, tilt=2.5)
    margin = Incidence(30).margin(views)
    expected = []
    for place in views.positions_mm[:, 0].tolist():
        worst = 0.0
        for corner in SEGMENT.vertices_mm.tolist():
            cosine = (place[2] - corner[2]) / math.dist(place, corner)
            worst = max(worst, math.acos(cosine))
        expected.append(math.radians(30) - worst)
    np.testing.assert_allclose(margin.value[:, 0], expected, atol=1e-7)
    assert (Incidence(90).margin(views).holds[:, 0] == (views.positions_mm[:, 0, 2] >= 0)).all()


poses = st.builds(
    lambda vector, shift: Pose.from_rotation_vector(vector, shift),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-1e3, 1e3)] * 3),
)


@settings(max_examples=25, deadline=None)
@given(poses, st.integers(0, 10))
def test_margins_do_not_change_under_rigid_motion(motion: Pose, seed: int) -> None:
    generator = np.random.default_rng(seed)
    states = random_states(generator, 3, k1=1e-3)
    for feature in (None, SEGMENT):
        views = random_views(generator, states, Subject(SQUARE, feature), count=4)
        moved = Views(
            motion.transform(views.positions_mm),
            np.einsum("ij,vpjk->vpik", motion.rotation, views.rotations),
            states,
            Subject(
                Target(motion.transform(SQUARE.vertices_mm)),
                feature and Target(motion.transform(feature.vertices_mm)),
            ),
        )
        requirements = [
            Resolution(3, 0.5, "x" if feature else "any"),
            FieldOfView(24.0),
            DepthOfField(2.0, 1.5, 550),
            Incidence(40),
        ]
        here, there = judge(requirements, views), judge(requirements, moved)
        for a, b in zip(here.margins, there.margins, strict=True):
            np.testing.assert_allclose(a.value, b.value, rtol=1e-7, atol=1e-7)


@settings(max_examples=40, deadline=None)
@given(st.floats(300, 900), st.floats(1.001, 1.5), st.floats(-0.6, 0.6))
def test_margins_are_monotone(distance: float, factor: float, tilt: float) -> None:
    """Farther away: less resolution, more field of view. A wider pupil: less depth of field."""
    z = np.array([-np.sin(tilt), 0.0, -np.cos(tilt)])
    rotation = np.stack([np.cross((0, 1, 0), z), (0, 1, 0), z], axis=-1)
    states = LensStates((Camera(SENSOR, 120.0),), [600.0], entrance_pupil_diameter_mm=[12.0])
    near, far = (
        Views.of(Pose(rotation, -scale * distance * z), states, Subject(SQUARE))
        for scale in (1.0, factor)
    )
    assert Resolution(3, 0.5).margin(far).value < Resolution(3, 0.5).margin(near).value
    assert FieldOfView(24).margin(far).value > FieldOfView(24).margin(near).value
    wide = Views.of(
        Pose(rotation, -distance * z),
        states.with_iris(50.0, np.array([12.0 * factor])),
        Subject(SQUARE),
    )
    depth = DepthOfField(2.0, 1.5)
    assert depth.margin(wide).value < depth.margin(near).value
    assert wide.states.iris == [50.0]


def test_margins_are_zero_at_their_limits() -> None:
    square = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 600.0]))
    feature = Target.segment((-10, 0, 0), (10, 0, 0))
    for ratio, requirement in (
        (0.2, Resolution(0.2 * 0.5 / SENSOR.sample_pitch_x_mm, 0.5, "x")),
        (SENSOR.width_mm / 20, FieldOfView(20.0, "x")),
    ):
        states = LensStates((Camera(SENSOR, 600 * ratio),), [600.0])
        views = Views.of(square, states, Subject(SQUARE, feature))
        assert requirement.margin(views).value[0, 0] == pytest.approx(0, abs=1e-9)
    depth = DepthOfField(4.0, 1.5)
    states = LensStates((Camera(SENSOR, 120.0),), [600.0], entrance_pupil_diameter_mm=[1.0])
    views = Views.of(square, states, Subject(SQUARE, feature))
    largest = depth.aperture_bounds_mm(views)[1][0]
    opened = Views.of(square, states.with_iris(1, largest), Subject(SQUARE, feature))
    assert depth.margin(opened).value[0, 0] == pytest.approx(0, abs=1e-9)


def test_what_is_not_in_front_has_no_margin_at_all() -> None:
    behind = Pose(np.eye(3), np.array([0, 0, 600.0]))
    states = LensStates((Camera(SENSOR, 120.0),), [600.0], entrance_pupil_diameter_mm=[5.0])
    views = Views.of(behind, states, Subject(SQUARE, SEGMENT))
    found = judge([Resolution(3, 1), FieldOfView(24), DepthOfField(1, 1)], views)
    assert all(margin.value[0, 0] == -np.inf for margin in found.margins)
    assert found.smallest_share[0, 0] == -np.inf
    assert not found.holds.any()


def test_blocks_change_nothing_and_positions_may_differ_from_state_to_state() -> None:
    generator = np.random.default_rng(11)
    states = random_states(generator, 30, k1=1e-3)
    views = random_views(generator, states, Subject(SQUARE, SEGMENT), count=700)
    requirements = [Resolution(3, 0.5), FieldOfView(24.0), DepthOfField(2.0, 1.5), Incidence(40)]
    whole = judge(requirements, views)
    assert whole.smallest_share.shape == (700, 30)
    one = judge(requirements, views.some(slice(401, 402)))
    for a, b in zip(whole.margins, one.margins, strict=True):
        np.testing.assert_array_equal(a.value[401], b.value[0])
        assert (a.unit, a.binds) == (b.unit, b.binds)
    stacked = np.stack([margin.share for margin in whole.margins])
    np.testing.assert_array_equal(whole.binding, stacked.argmin(axis=0))
    each = Views(
        np.repeat(views.positions_mm, 30, axis=1),
        np.repeat(views.rotations, 30, axis=1),
        states,
        views.subject,
    )
    apart = judge(requirements, each)
    for a, b in zip(whole.margins, apart.margins, strict=True):
        np.testing.assert_allclose(a.value, b.value, rtol=1e-12, atol=1e-9)


def test_views_look_where_they_are_told() -> None:
    states = random_states(np.random.default_rng(0), 2)
    places = np.array([[0.0, -300, 400], [100, 0, 500]])
    views = Views.looking_at(places, (1, 2, 3), (1, 0, 0), states, Subject(SQUARE, SEGMENT))
    x, y, z = views.in_camera(np.array([[1.0, 2, 3], [9.0, 2, 3]]))
    np.testing.assert_allclose(x[0, 0], 0, atol=1e-12)
    np.testing.assert_allclose(y[0], 0, atol=1e-12)
    np.testing.assert_allclose(z[0, 0], np.linalg.norm(places - [1, 2, 3], axis=1))
    assert (x[0, 1] > 0).all()
    assert views.shape == (2, 2)
    through = Views.through(
        Camera(SENSOR, 100.0), Pose(np.diag([1.0, -1, -1]), (0, 0, 500)), Subject(SQUARE)
    )
    assert through.states.object_distance_mm == pytest.approx([500 - SQUARE.centroid_mm[2]])


def test_largest_aperture_and_best_focus() -> None:
    """The closed form, against a search over D."""
    from planning.requirements.depth_of_field import largest_aperture_mm

    distance, aperture = largest_aperture_mm(580.0, 640.0, 120.0, 0.02)
    tried = np.linspace(585, 635, 20_001)
    opened = 0.02 / (120 * np.maximum(1 / 580 - 1 / tried, 1 / tried - 1 / 640))
    assert distance == pytest.approx(tried[opened.argmax()], abs=3e-3)
    assert aperture == pytest.approx(opened.max(), rel=1e-4)
    assert largest_aperture_mm(600.0, 600.0, 120.0, 0.02)[1] == np.inf
    with pytest.raises(InputError, match="the nearest before the farthest"):
        largest_aperture_mm(640.0, 580.0, 120.0, 0.02)
    with pytest.raises(InputError, match="blur_mm must be a positive number"):
        largest_aperture_mm(580.0, 640.0, 120.0, 0.0)


def test_diffraction_bounds_the_aperture_from_both_sides() -> None:
    square = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 600.0]))
    states = LensStates((Camera(SENSOR, 120.0),), [600.0], entrance_pupil_diameter_mm=[6.0])
    subject = Subject(SQUARE, SEGMENT)
    depth = DepthOfField(8.0, 2.5, 550)
    smallest, largest = depth.aperture_bounds_mm(Views.of(square, states, subject))
    assert 0 < smallest < largest
    for pupil in (smallest[0], largest[0]):
        margin = depth.margin(Views.of(square, states.with_iris(1, pupil), subject))
        assert margin.value[0, 0] == pytest.approx(0, abs=1e-9)
    middle = depth.margin(Views.of(square, states, subject)).value[0, 0]
    assert middle == pytest.approx(
        2.5 - math.hypot(6 * 120 * (1 / 596 - 1 / 600), 2.44 * 550e-6 * 120 / 6) / 0.01375
    )
    hopeless = DepthOfField(80.0, 1.0, 550).aperture_bounds_mm(Views.of(square, states, subject))
    assert np.isnan(hopeless).all()


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: DepthOfField(-1, 1), InputError, "depth_mm must be zero or a positive number"),
        (lambda: DepthOfField(float("nan"), 1), InputError, "depth_mm must be zero or a positive"),
        (lambda: DepthOfField(1, 0), InputError, "blur_px must be a positive number, but is 0 px"),
        (lambda: DepthOfField(1, 1, -5), InputError, "wavelength_nm must be a positive number"),
        (lambda: Incidence(0), InputError, "max_angle_deg must be above 0 and at most 90 degrees"),
        (lambda: Incidence(float("nan")), InputError, "max_angle_deg must be above 0 and at most"),
        (
            lambda: LensStates((), []),
            InputError,
            "a view needs a lens setting, but there is none",
        ),
        (
            lambda: LensStates((Camera(SENSOR, 1), Camera(Sensor(9, 9, 1, 1), 1)), [1, 1]),
            InputError,
            "the cameras have different sensors",
        ),
        (
            lambda: LensStates((Camera(SENSOR, 1),), [-600.0]),
            InputError,
            "object_distance_mm must be positive, but is -600 mm; check the sign",
        ),
        (
            lambda: LensStates((Camera(SENSOR, 1),), [600.0], entrance_pupil_diameter_mm=[0.0]),
            InputError,
            "entrance_pupil_diameter_mm must be positive",
        ),
        (
            lambda: LensStates.of_fixed(FixedLens(100, SENSOR), 90.0),
            InputError,
            "a lens of f = 100 mm images nothing at a distance of 90 mm",
        ),
        (lambda: judge([], None), PlanningError, "views are judged by requirements, but there are"),
    ],
)
def test_what_makes_no_sense_is_refused(make, error, message) -> None:
    with pytest.raises(error, match=message):
        make()


def test_views_refuse_wrong_shapes_and_directions() -> None:
    states = random_states(np.random.default_rng(0), 3)
    subject = Subject(SQUARE)
    with pytest.raises(InputError, match="do not fit 3 lens states"):
        Views(np.zeros((4, 2, 3)), np.zeros((4, 2, 3, 3)), states, subject)
    with pytest.raises(InputError, match="rotations must be orthonormal matrices"):
        Views(np.zeros((1, 1, 3)), 2 * np.eye(3)[None, None], states, subject)
    with pytest.raises(InputError, match="one is a reflection"):
        Views(np.zeros((1, 1, 3)), np.diag([1.0, 1, -1])[None, None], states, subject)
    with pytest.raises(InputError, match="cannot look at its own projection centre"):
        Views.looking_at([[1.0, 2, 3]], (1, 2, 3), (1, 0, 0), states, subject)
    with pytest.raises(InputError, match="the line of sight runs along the direction"):
        Views.looking_at([[9.0, 0, 0]], (0, 0, 0), (1, 0, 0), states, subject)


def test_missing_knowledge_is_named() -> None:
    states = LensStates((Camera(SENSOR, 120.0),), [600.0])
    square = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 600.0]))
    views = Views.of(square, states, Subject(SEGMENT))
    with pytest.raises(PlanningError, match="need the entrance-pupil diameter, which is not known"):
        DepthOfField(1, 1).margin(views)
    with pytest.raises(PlanningError, match="the target is a segment and has none"):
        Incidence(30).margin(views)
    assert DepthOfField(1, 1.5, 550).describe(SENSOR) == (
        "depth of field of 1 mm within 1.5 px of blur at 550 nm"
    )
    assert Incidence(30).describe(SENSOR) == "incidence of at most 30°"
