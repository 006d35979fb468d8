"""Quantities that are surfaces of their own: camera, lateral wander, confidence of the focus."""

import json

import numpy as np
import pytest

from lenscal.errors import InputError
from lenscal.formats.exported import settings_of
from lenscal.formats.ulens import write_ulens
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting
from planning.lens_states import LensStates
from planning.nodal import nodal_point

SENSOR = Sensor(640, 480, 0.01, 0.01, scale_factor=0.7)
AT = (97.0, 101.0)


def _wander(zoom, focus):
    return 0.02 * (zoom - 100) + 1e-5 * (focus - 100) ** 2, 0.1 - 0.0005 * focus


def _scale_factor(zoom):
    return 0.7 + 1e-4 * (zoom - 100)


@pytest.fixture
def table(lens, grid):
    zoom, focus = grid
    x, y = _wander(zoom, focus)
    return lens.sample(zoom, focus).assign(
        nodal_x_mm=x,
        nodal_y_mm=y,
        sigma_nodal_x_mm=1e-3,
        sigma_nodal_y_mm=1e-3,
        scale_factor=_scale_factor(zoom),
        sigma_scale_factor=1e-5,
        sharpest_confidence=np.clip(1.3 - 0.004 * focus, 0.0, 1.0),
    )


@pytest.fixture
def mapped(table):
    return fit_lens_map(table, sensor=SENSOR)


def test_the_projection_centre_wanders_as_the_samples_do(mapped):
    for name, truth in zip(("nodal_x_mm", "nodal_y_mm"), _wander(*AT), strict=True):
        assert mapped.value(name, *AT) == pytest.approx(truth, abs=2e-3)
        assert 0 < mapped.sigma(name, *AT) < 1e-3
    states = LensStates.of_map(mapped, *AT)
    offset = mapped.nodal_offset_mm(*AT)
    np.testing.assert_allclose(states.projection_centre_mm[0], [*_wander(*AT), -offset], atol=2e-3)
    point = nodal_point(mapped, *AT)
    np.testing.assert_allclose(point.centre_mm, states.projection_centre_mm[0], atol=1e-12)
    assert point.notes == ()


def test_contours_carry_them_and_are_traced_of_them(mapped):
    (curve,) = mapped.contour("nodal_y_mm", 0.05)
    np.testing.assert_allclose(curve.focus, 100.0, atol=1.0)
    for name in mapped.quantities:
        np.testing.assert_allclose(
            curve.value(name), mapped.value(name, curve.zoom, curve.focus), rtol=1e-9, atol=1e-12
        )


def test_the_scale_factor_goes_into_the_camera_of_each_setting(mapped):
    camera = mapped.camera_at(*AT)
    assert camera.sensor.scale_factor == pytest.approx(_scale_factor(AT[0]), abs=1e-5)
    # What can have one sensor only gets a scale factor between them.
    assert mapped.sensor.scale_factor == pytest.approx(0.7, abs=1e-6)
    states = LensStates.of_map(mapped, [92.0, 108.0], [100.0, 100.0])
    assert {camera.sensor for camera in states.cameras} == {mapped.sensor}


def test_formats_with_one_sensor_say_what_to_do_about_many(mapped, tmp_path):
    exported = settings_of(mapped, [LensSetting(z, f) for z in (92, 108) for f in (70, 130)])
    with pytest.raises(InputError, match=r"4 different sensors|2 different sensors.*scale_factor"):
        write_ulens(tmp_path / "lens.ulens", exported)


def test_a_confidence_stays_between_none_and_full(mapped, grid):
    zoom, focus = mapped.domain.grid(60)
    confidence = mapped.value("sharpest_confidence", zoom, focus)
    assert confidence.max() == 1.0
    assert confidence.min() == pytest.approx(0.74, abs=0.02)
    assert mapped.range_of("sharpest_confidence")[1] == 1.0


def test_what_is_one_number_for_all_settings_is_no_surface(table):
    same = table.assign(scale_factor=0.7, nodal_x_mm=0.0, sharpest_confidence=0.9)
    known = fit_lens_map(same, sensor=SENSOR)
    assert not {"scale_factor", "nodal_x_mm", "sharpest_confidence"} & set(known.quantities)
    assert "nodal_y_mm" in known.quantities
    assert known.camera_at(*AT).sensor == SENSOR
    with pytest.raises(InputError, match="unknown quantity 'scale_factor'; this map has"):
        known.value("scale_factor", *AT)


def test_what_is_unknown_at_some_settings_is_named(table):
    table.loc[3:5, "nodal_x_mm"] = np.nan
    gaps = fit_lens_map(table, sensor=SENSOR)
    assert "nodal_x_mm" not in gaps.quantities
    assert "nodal_x_mm is not mapped: it is unknown at 3 of 35 settings" in gaps.notes


def test_a_map_saved_before_they_were_mapped_is_still_that_map(mapped, tmp_path):
    path = mapped.save(tmp_path / "map.json")
    again = LensMap.load(path)
    assert again.digest == mapped.digest
    assert again.quantities == mapped.quantities
    body = json.loads(path.read_text())
    for name in ("nodal_x_mm", "nodal_y_mm", "scale_factor", "sharpest_confidence"):
        del body["surfaces"][name]
    for key in ("lenscal", "version", "sha256"):
        del body[key]
    from lenscal.document import write_document

    older = LensMap.load(write_document(tmp_path / "older.json", "lens-map", 1, body))
    assert set(mapped.quantities) - set(older.quantities) == {
        "nodal_x_mm",
        "nodal_y_mm",
        "scale_factor",
        "sharpest_confidence",
    }
    assert "does not map the lateral wander" in nodal_point(older, *AT).notes[0]
