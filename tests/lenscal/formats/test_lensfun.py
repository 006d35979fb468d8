import numpy as np
import pytest

from lenscal.errors import FileError
from lenscal.formats.lensfun import read_lensfun

DATABASE = """<!DOCTYPE lensdatabase SYSTEM "lensfun-database.dtd">
<lensdatabase version="2">
  <lens>
    <maker>Maker</maker><model>Zoom 18-55</model><mount>M</mount><cropfactor>1.5</cropfactor>
    <calibration>
      <distortion model="ptlens" focal="18" real-focal="18.14" a="0.014" b="-0.04" c="0.012"/>
      <distortion model="poly3" focal="35" k1="-0.004"/>
      <distortion model="poly5" focal="55" k1="0.002" k2="0.0005"/>
      <tca model="poly3" focal="55" vr="1.0001"/>
    </calibration>
  </lens>
  <lens>
    <maker>Maker</maker><model>Prime 50</model><mount>M</mount><cropfactor>1</cropfactor>
    <aspect-ratio>4:3</aspect-ratio>
  </lens>
  <lens>
    <maker>Maker</maker><model>Fish</model><mount>M</mount><type>fisheye</type>
    <cropfactor>1</cropfactor>
    <calibration><distortion model="poly3" focal="8" k1="0.1"/></calibration>
  </lens>
</lensdatabase>
"""
SIZE = (6000, 4000)


def written(tmp_path, text=DATABASE):
    path = tmp_path / "db.xml"
    path.write_text(text)
    return path


def test_a_set_is_read(tmp_path):
    table = read_lensfun(written(tmp_path), SIZE, "18-55")
    samples = table.samples
    assert samples["zoom"].tolist() == [18, 35, 55]
    # Where no focal length was measured, the engraved one times what a line near the axis shows.
    np.testing.assert_allclose(samples["image_distance_mm"], [18.14, 35 * 1.004, 55], rtol=1e-12)
    assert table.sensor.width_mm == pytest.approx(24)
    assert table.sensor.height_mm == pytest.approx(16)
    assert not table.has_object_distance
    assert "at 2 of 3 focal lengths" in table.missing[1]
    assert samples["conversion_error_px"].between(1e-3, 60).all()


def test_kappa_is_of_the_other_direction_and_in_mm(tmp_path):
    """Poly5 to first order: r_d = r_u (1 + k1 (r_u / 8 mm)²), so κ1 = −k1 / 64 mm²."""
    text = DATABASE.replace('k1="0.002" k2="0.0005"', 'k1="0.0001"')
    samples = read_lensfun(written(tmp_path, text), SIZE, "18-55").samples
    assert samples["k1_per_mm2"][2] == pytest.approx(-0.0001 / 64, rel=2e-3)


def test_a_barrel_of_ptlens_is_followed(tmp_path):
    """The camera's distortion against the database's own formula, at radii of no grid."""
    from lenscal.camera import Camera

    table = read_lensfun(written(tmp_path), SIZE, "18-55")
    row = table.samples.iloc[0]
    camera = Camera(table.sensor, row["image_distance_mm"], row["k1_per_mm2"])
    a, b, c = 0.014, -0.04, 0.012
    linear = 1 - a - b - c
    undistorted = np.array([0.21, 0.77, 1.31])
    distorted = undistorted * (a * undistorted**3 + b * undistorted**2 + c * undistorted + linear)
    points = np.column_stack([undistorted * 8 * linear, np.zeros(3), np.full(3, 18.14)])
    found = (camera.project(points)[:, 0] - camera.centre_px[0]) * camera.sensor.sample_pitch_x_mm
    error_px = np.abs(found - distorted * 8) / camera.sensor.sample_pitch_x_mm
    assert error_px.max() <= row["conversion_error_px"] * 1.1


@pytest.mark.parametrize(
    ("change", "lens", "message"),
    [
        (lambda t: t[:600], "18-55", r"db.xml, line \d+: no XML .*cut short"),
        (lambda t: t, None, "no lens was named, which fits 3 of 3 lenses; name one of: Zoom 18-55"),
        (lambda t: t, "24-70", "asked for is '24-70', which fits 0 of 3"),
        (lambda t: t, "Prime", "'Prime 50' has no distortion set"),
        (lambda t: t, "Fish", "'Fish' is fisheye; only rectilinear"),
        (lambda t: t.replace('version="2"', 'version="3"'), "Fish", "has version 3.*install a new"),
        (
            lambda t: t.replace("poly5", "acm"),
            "18-55",
            "the model 'acm' of distortion set 2 is not",
        ),
        (lambda t: t.replace('a="0.014"', 'a="big"'), "18-55", "a of distortion set 0 must be a f"),
        (lambda t: t.replace('focal="35"', ""), "18-55", "focal of distortion set 1 must be a pos"),
        (lambda t: t.replace('focal="35"', 'focal="55"'), "18-55", "stands more than once"),
        (lambda t: t.replace("1.5<", "<"), "18-55", "cropfactor must be a positive number"),
        (lambda t: t.replace('a="0.014"', 'a="-0.6"'), "18-55", "set 0 folds within the image"),
        (lambda t: t.replace("lensdatabase", "lenses"), "18-55", "holds <lenses>, not the <lensd"),
        (lambda t: '<!DOCTYPE x [<!ENTITY a "b">]><x/>', "18-55", "declares entities"),
    ],
)
def test_garbled_files(tmp_path, change, lens, message):
    with pytest.raises(FileError, match=message):
        read_lensfun(written(tmp_path, change(DATABASE)), SIZE, lens)
