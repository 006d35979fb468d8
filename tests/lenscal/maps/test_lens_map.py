import json

import numpy as np
import pytest

from lenscal.errors import FileError, InputError, MapError, OutOfDomainError
from lenscal.maps.domain import Domain
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap


def test_scalars_and_arrays_broadcast(lens_map):
    assert lens_map.magnification(95.0, 80.0).shape == ()
    assert lens_map.magnification(np.array([[91.0], [95.0]]), np.array([70.0, 80.0])).shape == (
        2,
        2,
    )


def test_outside_the_domain_is_refused_with_a_mask(lens_map):
    with pytest.raises(
        OutOfDomainError, match="1 of 3 settings, the first at zoom 111, .* lie outside the map"
    ):
        lens_map.magnification([95.0, 111.0, 100.0], 80.0)
    with pytest.raises(
        OutOfDomainError, match="the setting .zoom 95, focus 59. lies outside the map"
    ) as caught:
        lens_map.sigma("standoff_mm", 95.0, 59.0)
    assert caught.value.mask.all()
    assert caught.value.domain is lens_map.domain


def test_outside_may_be_nan(lens_map):
    values = lens_map.focal_length_mm([95.0, 111.0], 80.0, outside="nan")
    assert np.isfinite(values[0])
    assert np.isnan(values[1])
    assert np.isnan(lens_map.sigma("focal_length_mm", [95.0, 111.0], 80.0, outside="nan")[1])


def test_every_question_may_be_answered_with_nan(lens_map):
    zoom = [95.0, 111.0, np.nan]
    for quantity in lens_map.quantities:
        answers = [
            lens_map.value(quantity, zoom, 80.0, outside="nan"),
            lens_map.sigma(quantity, zoom, 80.0, outside="nan"),
            lens_map.derivative(quantity, zoom, 80.0, by="focus", outside="nan"),
            *lens_map.gradient(quantity, zoom, 80.0, outside="nan"),
        ]
        for answer in answers:
            assert np.isnan(answer).tolist() == [False, True, True], quantity
    named = ("magnification", "object_distance_mm", "image_distance_mm", "focal_length_mm")
    for name in (*named, "standoff_mm", "nodal_offset_mm"):
        np.testing.assert_array_equal(
            getattr(lens_map, name)(zoom, 80.0, outside="nan"),
            lens_map.value(name, zoom, 80.0, outside="nan"),
        )
    assert lens_map.camera_at(111.0, 80.0, outside="nan") is None
    inside = lens_map.camera_at(95.0, 80.0, outside="nan")
    assert inside.image_distance_mm == lens_map.camera_at(95.0, 80.0).image_distance_mm
    with pytest.raises(OutOfDomainError, match="the setting .zoom 111, focus 80. lies outside"):
        lens_map.camera_at(111.0, 80.0)


def test_questions_that_make_no_sense(lens_map):
    with pytest.raises(InputError, match="outside must be 'raise' or 'nan', but is 'clip'"):
        lens_map.magnification(95.0, 80.0, outside="clip")
    with pytest.raises(InputError, match=r"zoom of shape \(2,\) and focus of shape \(3,\) do not"):
        lens_map.magnification([95.0, 96.0], [80.0, 81.0, 82.0])
    with pytest.raises(InputError, match="by 'zoom' or by 'focus', not by 'iris'"):
        lens_map.derivative("magnification", 95.0, 80.0, by="iris")


def test_a_strip_is_not_bridged(lens):
    """At 100 the strip of a lens that is not parfocal bends; the hull would be asked there."""
    zoom = np.repeat(np.linspace(90, 110, 7), 5)
    low = 60 + 40 * (1 - ((zoom - 100) / 10) ** 2)
    samples = lens.sample(zoom, low + np.tile(np.linspace(0, 40, 5), 7))
    strip = fit_lens_map(samples, log_smoothing={"core": np.full((3, 2), -5.0)})
    assert np.isfinite(strip.sigma("focal_length_mm", [90.0, 100.0], [60.0, 100.0])).all()
    with pytest.raises(
        OutOfDomainError,
        match="1 of 2 settings, the first at zoom 100, focus 75, lie outside the map .a part of",
    ) as caught:
        strip.magnification([100.0, 100.0], [75.0, 120.0])
    assert caught.value.mask.tolist() == [True, False]


@pytest.mark.parametrize("quantity", ["magnification", "focal_length_mm", "nodal_offset_mm"])
def test_gradients_agree_with_differences(lens_map, quantity):
    step = 1e-5
    zoom, focus = 97.3, 83.1
    along = lens_map.gradient(quantity, zoom, focus)
    for i, (dz, df) in enumerate([(step, 0.0), (0.0, step)]):
        high = lens_map.value(quantity, zoom + dz, focus + df)
        low = lens_map.value(quantity, zoom - dz, focus - df)
        assert along[i] == pytest.approx((high - low) / (2 * step), rel=1e-5)


@pytest.mark.parametrize("quantity", ["image_distance_mm", "standoff_mm", "k1_per_mm2"])
def test_derivatives_by_one_motor_are_the_gradient(lens_map, quantity):
    zoom, focus = np.array([[91.0], [97.3]]), np.array([61.0, 83.1, 140.0])
    along = lens_map.gradient(quantity, zoom, focus)
    for motor, expected in zip(("zoom", "focus"), along, strict=True):
        found = lens_map.derivative(quantity, zoom, focus, by=motor)
        assert found.shape == (2, 3)
        np.testing.assert_array_equal(found, expected)


def test_a_motor_sampled_at_one_value_has_no_slope(lens):
    line = fit_lens_map(lens.sample(np.linspace(90, 110, 5), np.full(5, 80.0)))
    assert line.derivative("magnification", 95.0, 80.0, by="focus") == 0
    assert line.derivative("magnification", 95.0, 80.0, by="zoom") > 0


def test_sigma_of_derived_quantities_agrees_with_sampling(lens, grid):
    """σ(f) and σ(d) by propagation, against samples from the posterior of the core surfaces."""
    fitted = fit_lens_map(lens.sample(*grid, np.random.default_rng(4)))
    zoom, focus = np.array(97.0), np.array(91.0)
    mean = fitted.core.value(zoom, focus)
    draws = np.random.default_rng(5).multivariate_normal(
        mean, fitted.core.covariance_at(zoom, focus), size=20_000
    )
    ratio, distance, standoff = np.exp(draws).T
    for quantity, samples in {
        "image_distance_mm": ratio * distance,
        "focal_length_mm": ratio * distance / (1 + ratio),
        "nodal_offset_mm": distance - standoff,
    }.items():
        assert fitted.sigma(quantity, zoom, focus) == pytest.approx(samples.std(), rel=0.03)


def test_the_camera_at_a_setting(lens_map):
    camera = lens_map.camera_at(100.0, 100.0)
    assert camera.image_distance_mm == pytest.approx(lens_map.image_distance_mm(100.0, 100.0))
    np.testing.assert_allclose(camera.principal_point_px, (251.0, 239.6), atol=1e-6)
    assert camera.k1_per_mm2 == pytest.approx(1.1e-4)


def test_a_map_without_a_sensor_has_no_camera(lens, grid):
    with pytest.raises(MapError, match="fitted without a sensor"):
        fit_lens_map(lens.sample(*grid)).camera_at(95.0, 80.0)


def test_unknown_quantities_are_answered_with_the_known_ones(lens_map):
    with pytest.raises(InputError, match="unknown quantity 'zoomness'; this map has magnification"):
        lens_map.value("zoomness", 95.0, 80.0)


def test_a_map_round_trips_through_its_file(lens_map, tmp_path):
    loaded = LensMap.load(lens_map.save(tmp_path / "map.json"))
    assert loaded.digest == lens_map.digest
    for quantity in lens_map.quantities:
        for ask in (lens_map.value, lens_map.sigma):
            again = getattr(loaded, ask.__name__)(quantity, 97.0, 83.0)
            assert again == pytest.approx(float(ask(quantity, 97.0, 83.0)), rel=1e-9)


def test_a_file_that_disagrees_with_itself_is_refused(lens_map, tmp_path):
    from lenscal.document import write_document

    path = lens_map.save(tmp_path / "map.json")
    body = json.loads(path.read_text())
    for key in ("lenscal", "version", "sha256"):
        del body[key]
    body["surfaces"]["core"]["coefficients"][0][0][0] += 0.1
    write_document(path, "lens-map", 1, body)
    with pytest.raises(FileError, match="its samples do not give its coefficients of core"):
        LensMap.load(path)


def test_a_file_whose_domain_was_altered_is_refused(lens_map, tmp_path):
    from lenscal.document import write_document

    path = lens_map.save(tmp_path / "map.json")
    body = json.loads(path.read_text())
    for key in ("lenscal", "version", "sha256"):
        del body[key]
    assert body["domain"] == [[90, 60], [110, 60], [110, 140], [90, 140]]
    body["domain"][1] = [120, 60]
    write_document(path, "lens-map", 1, body)
    with pytest.raises(FileError, match="its samples do not give its domain; fit the map again"):
        LensMap.load(path)
    # Maps of the first versions do not state it.
    del body["domain"]
    write_document(path, "lens-map", 1, body)
    assert LensMap.load(path).digest == lens_map.digest


def test_contours_lie_on_their_level_and_end_at_the_border(lens_map):
    curves = lens_map.contour("magnification", 0.2)
    assert len(curves) == 1
    np.testing.assert_allclose(curves[0].value("magnification"), 0.2, rtol=1e-9)
    assert curves[0].value("focal_length_mm").shape == curves[0].zoom.shape == (len(curves[0]),)
    ends = curves[0].focus[[0, -1]]
    np.testing.assert_allclose(sorted(ends), lens_map.domain.focus, atol=1e-9)


def test_levels_beyond_the_map_are_answered_with_its_range(lens_map):
    with pytest.raises(InputError, match="magnification never is 3 on this map: it runs from 0.1"):
        lens_map.contour("magnification", 3.0)


def test_the_inverse_finds_where_it_came_from(lens_map):
    rng = np.random.default_rng(6)
    for zoom, focus in zip(rng.uniform(91, 109, 20), rng.uniform(62, 138, 20), strict=True):
        wanted = {
            "magnification": float(lens_map.magnification(zoom, focus)),
            "object_distance_mm": float(lens_map.object_distance_mm(zoom, focus)),
        }
        found = lens_map.settings_for(**wanted)
        assert any(abs(s.zoom - zoom) < 2e-5 and abs(s.focus - focus) < 8e-5 for s in found)


def test_the_inverse_wants_two_quantities_within_their_ranges(lens_map):
    with pytest.raises(InputError, match="two quantities determine a setting, but 1 were given"):
        lens_map.settings_for(magnification=0.2)
    with pytest.raises(InputError, match="object_distance_mm never is 1 on this map"):
        lens_map.settings_for(magnification=0.2, object_distance_mm=1.0)
    assert lens_map.settings_for(magnification=0.13, object_distance_mm=800.0) == []


def test_a_line_has_no_contours(lens):
    line = fit_lens_map(lens.sample(np.linspace(90, 110, 5), np.full(5, 80.0)))
    with pytest.raises(InputError, match="extends along one motor only"):
        line.contour("magnification", 0.2)


def test_few_scattered_settings_are_their_hull():
    domain = Domain.around(np.array([0.0, 2.0, 1.0, 1.0]), np.array([0.0, 0.0, 1.0, 0.5]))
    assert len(domain.outline) == 3
    inside = domain.contains([1.0, 0.1, 2.0, np.nan], [0.9, 0.9, 0.0, 0.0])
    assert inside.tolist() == [True, False, True, False]
    assert str(domain) == "a part of zoom 0 to 2 and focus 0 to 1"
