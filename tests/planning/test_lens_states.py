"""Lens states of maps and fixed lenses, and the iris that opens widest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lenscal.errors import InputError, OutOfDomainError, PlanningError
from lenscal.maps.lens_map import LensMap
from planning.fixed_lens import FixedLens
from planning.lens_states import LensStates
from planning.requirements.depth_of_field import widest_iris

DEMO = Path(__file__).parents[2] / "data" / "vicon-1990" / "map.json"


@pytest.fixture(scope="module")
def demo_map() -> LensMap:
    return LensMap.load(DEMO)


def test_states_of_a_map_are_what_the_map_says(demo_map: LensMap) -> None:
    zoom, focus = np.array([95.0, 102.0]), np.array([80.0, 120.0])
    states = LensStates.of_map(demo_map, zoom, focus)
    np.testing.assert_allclose(states.magnification, demo_map.magnification(zoom, focus))
    np.testing.assert_array_equal(
        states.object_distance_mm, demo_map.object_distance_mm(zoom, focus)
    )
    np.testing.assert_allclose(states.image_distance_mm, demo_map.image_distance_mm(zoom, focus))
    offset = demo_map.nodal_offset_mm(zoom, focus)
    wander = [demo_map.value(name, zoom, focus) for name in ("nodal_x_mm", "nodal_y_mm")]
    np.testing.assert_array_equal(
        states.projection_centre_mm, np.stack([*wander, -offset], axis=-1)
    )
    pupil = demo_map.entrance_pupil_diameter_mm(zoom, focus, 100.0)
    np.testing.assert_array_equal(states.entrance_pupil_diameter_mm, pupil)
    assert states.iris.tolist() == [100.0, 100.0]
    assert states.sensor == demo_map.sensor
    camera = demo_map.camera_at(102.0, 120.0)
    np.testing.assert_array_equal(states.cameras[1].centre_px, camera.centre_px)
    shift = (camera.centre_px - camera.sensor.centre_px) * camera.sensor.sample_pitch_mm
    np.testing.assert_allclose(states.principal_point_mm[1], shift)
    with pytest.raises(OutOfDomainError, match="lies outside the map"):
        LensStates.of_map(demo_map, 10.0, 80.0)
    with pytest.raises(OutOfDomainError, match="the entrance pupil at iris 40 is not known"):
        LensStates.of_map(demo_map, 95.0, 80.0, 40.0)


def test_states_of_a_map_without_robot_or_pupil(lens) -> None:
    states = LensStates.of_map(lens, 100.0, 90.0)
    assert states.entrance_pupil_diameter_mm is None
    assert np.isnan(states.iris).all()
    blind = LensStates.of_map(replace(lens, has_standoff=False), 100.0, 90.0)
    assert blind.projection_centre_mm is None


def test_states_of_a_fixed_lens_follow_the_lens_law(paper_sensor) -> None:
    states = LensStates.of_fixed(FixedLens(127, paper_sensor, 16.0), [500.0, 700.0])
    np.testing.assert_allclose(
        1 / states.image_distance_mm + 1 / states.object_distance_mm, 1 / 127
    )
    assert states.entrance_pupil_diameter_mm.tolist() == [16.0, 16.0]
    assert not states.projection_centre_mm.any()
    assert np.isnan(states.zoom).all()
    assert (
        LensStates.of_fixed(FixedLens(127, paper_sensor), 500.0).entrance_pupil_diameter_mm is None
    )
    with pytest.raises(InputError, match="images nothing at a distance of 100 mm"):
        LensStates.of_fixed(FixedLens(127, paper_sensor), [100.0, 500.0])


@dataclass(frozen=True)
class Irises:
    """A map whose pupil is the iris over ten."""

    irises: tuple[float, ...]

    @property
    def pupil(self):
        return SimpleNamespace(irises=np.array(self.irises)) if self.irises else None

    def entrance_pupil_diameter_mm(self, zoom, focus, iris):
        return np.full(np.shape(zoom), 7.0 if iris is None else iris / 10)


def test_widest_iris_that_depth_of_field_allows() -> None:
    zoom = focus = np.zeros(4)
    largest = np.array([9.0, 5.0, 4.9, 1.0])
    iris, pupil = widest_iris(Irises((20.0, 50.0, 80.0)), zoom, focus, largest)
    np.testing.assert_array_equal(iris, [80, 50, 20, np.nan])
    np.testing.assert_array_equal(pupil, [8, 5, 2, np.nan])
    iris, pupil = widest_iris(Irises((np.nan,)), zoom, focus, largest)
    assert np.isnan(iris).all(), "a lens that does not tell its iris"
    np.testing.assert_array_equal(pupil, [7, np.nan, np.nan, np.nan])
    with pytest.raises(PlanningError, match="need the entrance-pupil diameter"):
        widest_iris(Irises(()), zoom, focus, largest)
