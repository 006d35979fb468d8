"""Willson's files of 1995, and what his logs say about them."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.errors import FileError, InputError
from lenscal.formats.tsai import (
    TsaiParameters,
    read_tsai_data,
    read_tsai_parameters,
    write_tsai_data,
    write_tsai_parameters,
)
from lenscal.pose import Pose
from lenscal.sensor import Sensor

SIZE = 576, 384


@pytest.fixture
def folder(reference_data):
    return reference_data / "tsai-willson-v3.0b3"


@pytest.mark.parametrize(
    ("data", "parameters", "distorted", "undistorted", "mean", "largest"),
    [
        ("cc_cd", "cc_cpcc", 1.213781, 1.161217, 0.096750, 0.280107),
        ("ncc_cd", "ncc_cpcc", 2.401149, 2.364177, None, None),
    ],
)
def test_published_parameters_give_the_published_errors(
    folder, data, parameters, distorted, undistorted, mean, largest
):
    """Sums of squares, to the 6 decimals of ccal.log and nccal.log."""
    points, seen = read_tsai_data(folder / f"{data}.dat")
    willson = read_tsai_parameters(folder / f"{parameters}.dat")
    camera, in_camera = willson.camera(*SIZE), willson.camera_from_world.transform(points)
    missed = camera.project(in_camera) - seen
    assert (missed**2).sum() == pytest.approx(distorted, abs=6e-7)
    pitch = camera.sensor.sample_pitch_mm
    straight = camera.undistort((seen - camera.centre_px) * pitch)
    ideal = camera.image_distance_mm * in_camera[:, :2] / in_camera[:, 2:]
    assert (((ideal - straight) / pitch) ** 2).sum() == pytest.approx(undistorted, abs=6e-7)
    if mean is not None:
        lengths = np.linalg.norm(missed, axis=1)
        assert lengths.mean() == pytest.approx(mean, abs=6e-7)
        assert lengths.max() == pytest.approx(largest, abs=6e-7)


def test_the_rotation_is_that_of_the_log(folder):
    rotation = read_tsai_parameters(folder / "cc_cpcc.dat").camera_from_world.rotation
    printed = [
        [0.034697, -0.937965, 0.344990],
        [0.995550, 0.062700, 0.070344],
        [-0.087611, 0.341014, 0.935967],
    ]
    np.testing.assert_allclose(rotation, printed, atol=6e-7)


def test_the_title_that_one_of_the_programs_prints_is_passed_over(folder):
    willson = read_tsai_parameters(folder / "encccpcc.dat")
    assert willson.sx == 1.0001750178
    # Tsai's s_x divides.
    assert willson.sensor(*SIZE).scale_factor == 1 / 1.0001750178


@pytest.mark.parametrize("name", ["cc_cpcc", "ncc_cpcc"])
def test_files_come_back_to_the_last_digit(folder, tmp_path, name):
    willson = read_tsai_parameters(folder / f"{name}.dat")
    again = read_tsai_parameters(write_tsai_parameters(tmp_path / "new" / "cpcc.dat", willson))
    assert again == willson
    points, seen = read_tsai_data(folder / "cc_cd.dat")
    path = write_tsai_data(tmp_path / "cd.dat", points, seen)
    for ours, theirs in zip(read_tsai_data(path), (points, seen), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_the_frame_grabber_of_the_paper():
    """384 elements become 512 samples, and s_x 1.0617: 0.70642 in the paper's direction."""
    camera = Camera(Sensor(512, 480, 0.023, 0.01375, 0.70642), 40.0, 1e-4, (250.5, 241.25))
    written = TsaiParameters.of(camera, Pose.identity(), elements_per_line=384)
    assert written.dpx == 0.023 * 384 / 512
    assert written.sx == pytest.approx(384 / 512 / 0.70642, rel=1e-15)
    assert written.sx == pytest.approx(1.0617, abs=5e-5)
    # Without a count of elements, s_x has it all.
    assert TsaiParameters.of(camera, Pose.identity()).sx == pytest.approx(1 / 0.70642, rel=1e-15)


numbers = st.floats(-1e3, 1e3)


@given(
    st.tuples(*3 * [st.floats(-1.7, 1.7)]),
    st.tuples(*3 * [numbers]),
    st.floats(0.3, 3.0),
    st.floats(1.0, 500.0),
    st.floats(-1e-3, 1e-3),
    st.sampled_from([None, 384, 1000.5]),
)
def test_cameras_survive_the_conversion(vector, shift, factor, distance, k1, elements):
    sensor = Sensor(512, 480, 0.023, 0.01375, factor)
    camera = Camera(sensor, distance, k1, (250.5, 241.25))
    pose = Pose.from_rotation_vector(vector, shift)
    written = TsaiParameters.of(camera, pose, elements_per_line=elements)
    again, pose_again = written.camera(512, 480), written.camera_from_world
    # What is a number in both comes back to the last digit, what is divided or turned by rounding.
    assert again.image_distance_mm == distance
    assert again.k1_per_mm2 == k1
    np.testing.assert_array_equal(again.centre_px, camera.centre_px)
    np.testing.assert_array_equal(pose_again.translation_mm, pose.translation_mm)
    assert again.sensor.scale_factor == pytest.approx(factor, rel=1e-15)
    np.testing.assert_allclose(pose_again.rotation, pose.rotation, atol=1e-15)


@pytest.mark.parametrize("about_y", [np.pi / 2, -np.pi / 2])
def test_a_quarter_turn_leaves_one_angle_free(about_y):
    """Where Rx and Rz do the same, some pair of them is given, and it is right."""
    turn = Pose.from_rotation_vector((0, about_y, 0)) @ Pose.from_rotation_vector((0.4, 0, 0))
    camera = Camera(Sensor(*SIZE, 0.01, 0.01), 10.0)
    written = TsaiParameters.of(camera, turn)
    np.testing.assert_allclose(written.camera_from_world.rotation, turn.rotation, atol=1e-15)


def test_what_the_model_cannot_hold_is_refused():
    sensor = Sensor(*SIZE, 0.01, 0.01)
    for camera in (
        Camera(sensor, 10.0, radial=(1e-6,)),
        Camera(sensor, 10.0, decentring=(0, 1e-5)),
    ):
        with pytest.raises(InputError, match="Tsai's model has κ1 alone, but the camera has furt"):
            TsaiParameters.of(camera, Pose.identity())
    with pytest.raises(InputError, match="ncx must be a positive number, but is -3"):
        TsaiParameters.of(Camera(sensor, 10.0), Pose.identity(), elements_per_line=-3)
    good = TsaiParameters.of(Camera(sensor, 10.0), Pose.identity())
    with pytest.raises(InputError, match="tz must be finite, but is inf"):
        dataclasses.replace(good, tz=np.inf)
    with pytest.raises(InputError, match="p1 and p2 must be zero, but are 0.001 and 0: Willson's"):
        dataclasses.replace(good, p1=1e-3)
    with pytest.raises(InputError, match="there are 2 points, but 1 pixels; give one each"):
        write_tsai_data("nowhere", np.zeros((2, 3)), np.zeros((1, 2)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty; wanted are lines of 5 numbers xw yw zw Xf Yf"),
        ("1 2 0 5 6\n\n1 2 0 5\n", "line 3: wanted are 5 numbers xw yw zw Xf Yf, but the line hol"),
        ("1 2 0 5 6\n1 2 x 5 6\n", "line 2: 'x' is no finite number; wanted is 5 numbers xw yw"),
        ("1 2 nan 5 6\n", "line 1: 'nan' is no finite number"),
    ],
)
def test_poor_data_files_are_refused(tmp_path, text, words):
    (tmp_path / "cd.dat").write_text(text)
    with pytest.raises(FileError, match=words):
        read_tsai_data(tmp_path / "cd.dat")


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda lines: lines[:10], "line 10: the file ends after 10 of 19 numbers; wanted next is"),
        (lambda lines: [], "line 0: the file ends after 0 of 19 numbers; wanted next is ncx"),
        (
            lambda lines: [*lines[:9], "f = 257", *lines[10:]],
            "line 10: 'f' is no finite number; wanted is f",
        ),
        (
            lambda lines: [*lines, "7"],
            r"line 20: wanted are 19 numbers in all, but more follow \('7",
        ),
        (
            lambda lines: [*lines[:9], "-257", *lines[10:]],
            "cpcc.dat: f must be a positive number, but is -257",
        ),
    ],
)
def test_poor_parameter_files_are_refused(tmp_path, edit, words):
    good = TsaiParameters.of(Camera(Sensor(*SIZE, 0.01, 0.01), 10.0), Pose.identity())
    path = write_tsai_parameters(tmp_path / "cpcc.dat", good)
    path.write_text("\n".join(edit(path.read_text().split())) + "\n")
    with pytest.raises(FileError, match=words):
        read_tsai_parameters(path)


def test_files_that_cannot_be_read_are_named(tmp_path):
    with pytest.raises(FileError, match=r"cannot read .*missing.dat: No such file"):
        read_tsai_parameters(tmp_path / "missing.dat")
    (tmp_path / "picture.dat").write_bytes(b"\xff\xd8\xff")
    with pytest.raises(FileError, match=r"cannot read .*picture.dat: "):
        read_tsai_data(tmp_path / "picture.dat")
