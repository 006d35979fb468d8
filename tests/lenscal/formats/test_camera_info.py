import numpy as np
import pytest
import yaml

from lenscal.errors import FileError, InputError
from lenscal.formats.camera_info import (
    read_camera_info,
    read_zoom_set,
    write_camera_info,
    write_zoom_set,
)

FIVE_ZOOMS = [1, 2, 5, 11, 30]


def test_focal_length_is_the_image_distance(tmp_path, one):
    path, worst = write_camera_info(tmp_path / "c.yaml", one.camera, setting=one.setting)
    content = yaml.safe_load(path.read_text())
    assert content["camera_matrix"]["data"][0] == pytest.approx(120 / (0.023 * 0.70642))
    assert content["projection_matrix"]["data"][5] == pytest.approx(120 / 0.01375)
    assert content["distortion_model"] == "plumb_bob"
    assert f"worst error of the conversion to plumb_bob: {worst:.2g} px" in path.read_text()
    assert "zoom 98, focus 131" in path.read_text()


def test_a_camera_comes_back(tmp_path, one, largest_difference_px):
    path, worst = write_camera_info(tmp_path / "c.yaml", one.camera)
    camera, lost, _ = read_camera_info(path, 0.01375)
    np.testing.assert_allclose(camera.matrix, one.camera.matrix, rtol=1e-14)
    assert largest_difference_px(one.camera, camera) <= worst + lost + 1e-9


def test_a_zoom_set_comes_back(tmp_path, several):
    chosen = [e for e in several if e.setting.focus == 5]
    files = write_zoom_set(tmp_path / "set" / "lens_%d.yaml", chosen)
    assert [f.path.name for f in files] == ["lens_1.yaml", "lens_2.yaml", "lens_7.yaml"]
    table = read_zoom_set(tmp_path / "set" / "lens_%d.yaml", 0.01375)
    assert table.samples["zoom"].tolist() == [1, 2, 7]
    distances = [e.camera.image_distance_mm for e in chosen]
    np.testing.assert_allclose(table.samples["image_distance_mm"], distances, rtol=1e-13)
    kappas = [e.camera.k1_per_mm2 for e in chosen]
    np.testing.assert_allclose(table.samples["k1_per_mm2"], kappas, rtol=1e-5)
    assert table.samples["conversion_error_px"].max() < 1e-3
    assert table.sensor.sample_pitch_x_mm == pytest.approx(0.023 * 0.70642)
    assert not table.has_object_distance
    assert "the object distance D is not known" in table.missing[0]


def test_the_published_zoom_set_is_interpolated_the_right_way_round(reference_data):
    """Between zoom 1 (fx 259.8) and 9999 (fx 1259.8); upstream tests the midpoint alone."""
    template = reference_data / "ros-zoom" / "test_calibration_zoom_%d.yaml"
    table = read_zoom_set(template, 0.005)
    samples = table.samples
    assert samples["zoom"].tolist() == [1, 9999]
    focal = samples["image_distance_mm"] / 0.005
    for zoom, expected in ((2, 259.9), (2500, 509.8)):
        # Ours is the mean of f_x and f_y, 0.9 px smaller than f_x.
        found = np.interp(zoom, samples["zoom"], focal)
        assert found == pytest.approx(expected - 0.9, abs=1.5)
    assert samples["conversion_error_px"].max() > 1
    assert any("differ from that by up to" in sentence for sentence in table.missing)


def test_names_and_settings_that_ros_cannot_hold(tmp_path, several, one):
    with pytest.raises(InputError, match="named by letters, digits and _"):
        write_camera_info(tmp_path / "c.yaml", one.camera, name="my lens")
    with pytest.raises(InputError, match="knows no focus, but the settings have focus 5 to 8"):
        write_zoom_set(tmp_path / "c_%d.yaml", several)
    with pytest.raises(InputError, match="whole, different zoom settings, but given are 98, 98"):
        write_zoom_set(tmp_path / "c_%d.yaml", [one, one])
    with pytest.raises(InputError, match="a template with %d"):
        write_zoom_set(tmp_path / "c.yaml", [one])
    with pytest.raises(InputError, match="a template with %d"):
        read_zoom_set(tmp_path / "c.yaml", 0.01)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[:300], "cut short"),
        (lambda t: t.replace("plumb_bob\n", "equidistant\n"), "distortion_model is 'equidistant'"),
        (lambda t: t.replace("image_height: 480", "image_height: 0"), "image_height must be a pos"),
        (
            lambda t: t.replace("data: [7385", "data: [0, 7385"),
            r"list of 9 numbers, but found is 10",
        ),
        (lambda t: t.replace("data: [7385", "data: [-7385"), "the camera was never calibrated"),
        (lambda t: t.replace("\n", "\n\t"), r"c_3.yaml, line \d+: no YAML"),
    ],
)
def test_garbled_files(tmp_path, one, change, message):
    path, _ = write_camera_info(tmp_path / "c_3.yaml", one.camera)
    path.write_text(change(path.read_text()))
    for read, name in ((read_camera_info, path), (read_zoom_set, tmp_path / "c_%d.yaml")):
        with pytest.raises(FileError, match=message):
            read(name, 0.01)


def test_sets_that_are_none(tmp_path, one):
    with pytest.raises(FileError, match="no file in .* is named c_%d.yaml with a number"):
        read_zoom_set(tmp_path / "c_%d.yaml", 0.01)
    path, _ = write_camera_info(tmp_path / "c_1.yaml", one.camera)
    other = path.read_text().replace("image_width: 512", "image_width: 640")
    (tmp_path / "c_2.yaml").write_text(other)
    with pytest.raises(FileError, match="different image sizes"):
        read_zoom_set(tmp_path / "c_%d.yaml", 0.01)
