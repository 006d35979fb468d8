"""Input that no calibration should survive in silence, at every door of stage 3."""

from dataclasses import replace

import numpy as np
import pytest

from lenscal.calibration.refine import calibrate_views
from lenscal.calibration.sweep import calibrate_recording
from lenscal.calibration.table import CalibrationTable
from lenscal.calibration.tsai import calibrate_tsai
from lenscal.camera import Camera
from lenscal.document import read_document, write_document
from lenscal.errors import CalibrationError, DegenerateGeometryError, FileError, InputError
from lenscal.journal import JournalWriter
from lenscal.pose import Pose
from lenscal.recording import (
    JOURNAL,
    FocusResult,
    Head,
    Observation,
    Recording,
    SettingRecord,
    View,
    head_to_json,
)
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting
from lenscal.target import Chessboard


@pytest.fixture
def views(tele):
    """Points, noisy pixels and sensor of six views, to be spoilt."""
    pixels, _ = tele.noisy(np.random.default_rng(0), 0.1)
    return [p.copy() for p in tele.points], pixels, tele.camera.sensor


@pytest.fixture
def solid():
    """Points in space before a camera, to be spoilt."""
    sensor = Sensor(576, 384, 0.023, 0.023)
    points = np.random.default_rng(3).uniform(-40, 40, (40, 3))
    pose = Pose.from_rotation_vector((0.3, -0.2, 0.4), (10.0, 15.0, 900.0))
    return points, Camera(sensor, 100.0).project(pose.transform(points)), sensor


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("which", ["points_mm", "pixels"])
def test_a_single_nan_is_found(views, solid, which, value):
    points, pixels, sensor = views
    {"points_mm": points, "pixels": pixels}[which][1][3, 0] = value
    with pytest.raises(
        InputError, match=rf"{which}\[1\] must be finite, but 1 of .* at index \(3, 0\)"
    ):
        calibrate_views(points, pixels, sensor)
    points, pixels, sensor = solid
    {"points_mm": points, "pixels": pixels}[which][7, 1] = value
    with pytest.raises(InputError, match=rf"{which} must be finite, but 1 of .* at index \(7, 1\)"):
        calibrate_tsai(points, pixels, sensor)


def test_shapes_must_match(views, solid):
    points, pixels, sensor = views
    with pytest.raises(InputError, match="one array a view, at least one; given are 6 and 5"):
        calibrate_views(points, pixels[:5], sensor)
    with pytest.raises(InputError, match="view 2 has 140 points, but 139 pixels; give one each"):
        calibrate_views(points, [*pixels[:2], pixels[2][1:], *pixels[3:]], sensor)
    with pytest.raises(
        InputError, match=r"points_mm\[0\] must have shape \(N, 3\), but has .*, 2\)"
    ):
        calibrate_views([p[:, :2] for p in points], pixels, sensor)
    with pytest.raises(InputError, match=r"pixels\[0\] must have shape \(N, 2\), but has .*, 3\)"):
        calibrate_views(points, points, sensor)
    points, pixels, sensor = solid
    with pytest.raises(InputError, match="there are 40 points, but 39 pixels; give one each"):
        calibrate_tsai(points, pixels[1:], sensor)
    with pytest.raises(InputError, match=r"points_mm must have shape \(N, 3\)"):
        calibrate_tsai(points[:, :2], pixels, sensor)


def test_a_bent_target_is_refused(views):
    """A plane is promised; one that is off by more than a target may be bent is another thing."""
    points, pixels, sensor = views
    points[4][:, 2] = 0.05 * np.abs(points[4][:, 0])
    with pytest.raises(
        InputError, match="the points of view 4 are not in the plane z = 0, off by up to 0.8"
    ):
        calibrate_views(points, pixels, sensor)


def test_too_few_points_are_refused(views, solid):
    points, pixels, sensor = views
    with pytest.raises(DegenerateGeometryError, match="view 0 shows 3 points, and at least 4"):
        calibrate_views([points[0][:3]], [pixels[0][:3]], sensor)
    points, pixels, sensor = solid
    with pytest.raises(DegenerateGeometryError, match="6 points are too few: Tsai's method needs"):
        calibrate_tsai(points[:6], pixels[:6], sensor)
    with pytest.raises(DegenerateGeometryError, match="10 points are too few for the full method"):
        calibrate_tsai(points[:10], pixels[:10], sensor)


def test_no_points_at_all_are_refused(solid):
    points, pixels, sensor = solid
    with pytest.raises(DegenerateGeometryError, match="the 0 points lie on a line; spread them"):
        calibrate_tsai(points[:0], pixels[:0], sensor)


def test_the_same_picture_twice_is_refused(views):
    points, pixels, sensor = views
    pixels[4], points[4] = pixels[2], points[2]
    with pytest.raises(InputError, match="views 2 and 4 are the same to the last digit; give each"):
        calibrate_views(points, pixels, sensor)


def test_a_camera_that_never_moved_is_no_worse_than_its_sigma(tele):
    """Six pictures of one tilted view differ by noise alone: as good as one, and no more is said.

    What is wrong with that one place, a bent target for instance, no repetition shows.
    """
    exact, board = tele.pixels[5], tele.points[5]
    distance, sensor = tele.camera.image_distance_mm, tele.camera.sensor
    off, sigmas = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        seen = [exact + 0.1 * rng.standard_normal(exact.shape) for _ in range(6)]
        still = calibrate_views([board] * 6, seen, sensor)
        sigmas.append(still.sigma("image_distance_mm"))
        off.append((still.image_distance_mm - distance) / sigmas[-1])
    assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.4
    # Six views that differ are worth more than six that do not.
    pixels, _ = tele.noisy(np.random.default_rng(0), 0.1)
    moved = calibrate_views(tele.points, pixels, sensor)
    assert np.median(sigmas) > 1.2 * moved.sigma("image_distance_mm")


def test_a_camera_that_never_moved_before_a_square_target_is_refused(tele):
    rng = np.random.default_rng(0)
    exact = tele.pixels[0]
    seen = [exact + 0.1 * rng.standard_normal(exact.shape) for _ in range(6)]
    with pytest.raises(
        DegenerateGeometryError, match="f and T_z are inseparable: the target plane"
    ):
        calibrate_views(tele.points[:1] * 6, seen, tele.camera.sensor)


def test_parts_of_boards_are_used_whatever_their_order(views):
    """Every view has its own corners, in an order of its own."""
    points, pixels, sensor = views
    rng = np.random.default_rng(1)
    counts = (140, 60, 20, 30, 90, 15)
    some = [rng.permutation(len(p))[:n] for p, n in zip(points, counts, strict=True)]
    result = calibrate_views(
        [p[s] for p, s in zip(points, some, strict=True)],
        [q[s] for q, s in zip(pixels, some, strict=True)],
        sensor,
    )
    assert result.rejected == ()
    assert [int(i.sum()) for i in result.inliers] == list(counts)
    assert abs(result.image_distance_mm - 130.0) < 4 * result.sigma("image_distance_mm")


def test_swapped_corners_do_not_move_the_result(views):
    points, pixels, sensor = views
    clean = calibrate_views(points, pixels, sensor)
    pixels[1][[5, 6]] = pixels[1][[6, 5]]
    pixels[2][[10, 50, 90]] = pixels[2][[50, 90, 10]]
    result = calibrate_views(points, pixels, sensor)
    assert [(r.view, r.point) for r in result.rejected] == [
        (1, 5),
        (1, 6),
        (2, 10),
        (2, 50),
        (2, 90),
    ]
    shift = abs(result.image_distance_mm - clean.image_distance_mm)
    assert shift < 0.3 * clean.sigma("image_distance_mm")


@pytest.mark.parametrize("kind", ["scattered", "in one place"])
def test_a_view_with_all_corners_bad_is_left_out(views, kind):
    points, pixels, sensor = views
    nonsense = np.random.default_rng(1).uniform(0, 2000, pixels[2].shape)
    pixels[2] = nonsense if kind == "scattered" else np.full_like(pixels[2], 512.0)
    result = calibrate_views(points, pixels, sensor)
    (rejection,) = result.rejected
    assert (rejection.view, rejection.point) == (2, None)
    assert "corners agree with the other views" in rejection.reason or (
        "points of view 2 lie on a line or do not fit a plane" in rejection.reason
    )
    assert not result.inliers[2].any()
    assert abs(result.image_distance_mm - 130.0) < 4 * result.sigma("image_distance_mm")


def test_a_board_numbered_backwards_does_no_harm(views):
    """Turned by 180° a whole board is a true picture of a turned board."""
    points, pixels, sensor = views
    straight = calibrate_views(points, pixels, sensor)
    pixels[3] = pixels[3][::-1]
    result = calibrate_views(points, pixels, sensor)
    assert result.rejected == ()
    assert result.image_distance_mm == pytest.approx(straight.image_distance_mm, rel=1e-9)
    turn = straight.poses[3].rotation.T @ result.poses[3].rotation
    np.testing.assert_allclose(turn, np.diag([-1.0, -1.0, 1.0]), atol=1e-9)


SENSOR = Sensor(1224, 1024, 0.0069, 0.0069)
BOARD = Chessboard(12, 9, 3.0)
HAND_FROM_CAMERA = Pose.from_rotation_vector((0.02, -0.01, 0.5), (10.0, 20.0, 80.0))
BASE_FROM_TARGET = Pose.from_rotation_vector((1.0, 0.2, -0.1), (400.0, 50.0, 20.0))
TILTS_DEG = ((0, 0), (22, 0), (-22, 0), (0, 22), (0, -22))


def _record(zoom, rng):
    camera = Camera(SENSOR, 60.0, 3e-4, (620.0, 505.0))
    seen = []
    for tilt_deg in TILTS_DEG:
        pose = Pose.from_rotation_vector(np.radians([*tilt_deg, 5.0]), (0.2, -0.1, 420.0))
        exact = camera.project(pose.transform(BOARD.points_mm))
        base_from_hand = BASE_FROM_TARGET @ pose.inverse() @ HAND_FROM_CAMERA.inverse()
        inside = SENSOR.contains(exact)
        pixels = (exact + 0.1 * rng.standard_normal(exact.shape))[inside]
        seen.append(View(Observation.of(BOARD, BOARD.ids()[inside], pixels), base_from_hand, 3.0))
    focus = FocusResult(420.0, 0.2, 0.9, 1.0, np.zeros(0), np.zeros(0))
    return SettingRecord(LensSetting(zoom, 1.0), tuple(seen), focus=focus)


@pytest.fixture(scope="module")
def recording():
    rng = np.random.default_rng(0)
    head = Head(SENSOR, BOARD, LensSetting(10.0, 1.0), HAND_FROM_CAMERA, BASE_FROM_TARGET)
    return Recording(head, (_record(10.0, rng), _record(20.0, rng)))


@pytest.fixture(scope="module")
def table(recording):
    return calibrate_recording(recording)


def _part(view, count):
    """Keep the first corners of a view."""
    seen = view.observation
    part = Observation(seen.ids[:count], seen.points_mm[:count], seen.pixels[:count])
    return replace(view, observation=part)


def test_a_recording_with_holes_gives_what_it_can(recording, tmp_path):
    """A setting without pictures, one without its focus, one whose robot was silent at times."""
    whole, other = recording.settings
    silent = replace(other.views[2], base_from_hand=None)
    holes = (
        whole,
        replace(other, setting=LensSetting(30.0, 1.0), views=(), focus_view=None, focus=None),
        replace(other, setting=LensSetting(40.0, 1.0), focus=None),
        replace(
            other,
            setting=LensSetting(50.0, 1.0),
            views=(*other.views[:2], silent, *other.views[3:], _part(other.views[1], 3)),
        ),
        replace(other, setting=LensSetting(60.0, 1.0), views=other.views[:1]),
    )
    table = calibrate_recording(replace(recording, settings=holes))
    rows = table.to_dataframe()
    assert rows["zoom"].tolist()[:3] == [10.0, 40.0, 50.0]
    assert rows["sigma_sharpest_mm"].isna().tolist()[:3] == [False, True, False]
    error = (rows["image_distance_mm"] - 60.0).abs() / rows["sigma_image_distance_mm"]
    assert (error < 4).all()
    assert table.failures[0].zoom == 30.0
    assert table.failures[0].reason == "its focus view was lost, so that D is not known"
    # Evidence of what was missing is kept with the table.
    again = CalibrationTable.load(table.save(tmp_path / "table.csv"))
    assert again.failures == table.failures


def test_a_recording_that_ends_in_the_middle_of_a_line_is_used_up_to_there(recording, tmp_path):
    folder = recording.save(tmp_path / "session")
    journal = folder / JOURNAL
    journal.write_bytes(journal.read_bytes()[:-40])
    table = calibrate_recording(Recording.load(folder))
    assert table.to_dataframe()["zoom"].tolist() == [10.0]


def test_a_recording_without_settings_is_refused(recording, tmp_path):
    with JournalWriter(tmp_path / JOURNAL) as journal:
        journal.append(head_to_json(recording.head))
    with pytest.raises(InputError, match="the recording has no finished setting; record a session"):
        calibrate_recording(Recording.load(tmp_path))


def test_a_recording_of_nonsense_names_the_first_setting(recording):
    rng = np.random.default_rng(1)
    spoilt = tuple(
        replace(
            record,
            views=tuple(
                replace(
                    view,
                    observation=replace(
                        view.observation,
                        pixels=rng.uniform(0, 1000, view.observation.pixels.shape),
                    ),
                )
                for view in record.views
            ),
        )
        for record in recording.settings
    )
    words = (
        r"none of the 2 settings could be calibrated; the first \(zoom 10, focus 1\): .* no camera"
    )
    with pytest.raises(CalibrationError, match=words):
        calibrate_recording(replace(recording, settings=spoilt))


def test_a_newer_table_is_refused_and_left_alone(table, tmp_path):
    path = table.save(tmp_path / "table.csv")
    document = path.with_suffix(".json")
    kind = "calibration-table"
    body = read_document(document, kind, 99)
    version = body.pop("version")
    write_document(document, kind, version + 1, {**body, "something_new": 1})
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    with pytest.raises(
        FileError, match=rf"has version {version + 1} of the {kind} form; this lenscal reads up to"
    ):
        CalibrationTable.load(path)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize("name", ["table.csv", "table.json"])
def test_a_table_that_was_cut_short_is_refused(table, tmp_path, name):
    path = table.save(tmp_path / "table.csv")
    file = tmp_path / name
    file.write_bytes(file.read_bytes()[:-30])
    with pytest.raises(FileError, match=r"its checksum does not match|is cut short or no JSON"):
        CalibrationTable.load(path)


def test_a_table_that_cannot_be_written_leaves_no_part(table, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match=r"cannot write .*file/table\.(csv|json): "):
        table.save(tmp_path / "file" / "table.csv")
    assert [file.name for file in tmp_path.iterdir()] == ["file"]
