"""Looking at rulers on targets; the paper's experiment has a file of its own."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from lenscal.camera import Camera
from lenscal.errors import DetectionError, PlanningError
from lenscal.pose import Pose
from lenscal.sensor import Sensor, Window
from planning.enclosure import example_part
from planning.image_check import check_view, ruler_decal, ruler_on
from planning.picture_plots import draw_check
from planning.target import Target
from planning.true_view import TrueView, bodies_for_pictures

CAMERA = Camera(Sensor(512, 480, 0.0162, 0.0162), 120.0)
BAND = Window(0, 140, 512, 200)


def view(distance_mm: float, shift_mm=(0.0, 0.0)) -> TrueView:
    """Straight down on the target of a bare block, from a distance."""
    down = Pose.from_rotation_vector([np.pi, 0, 0]).rotation
    return TrueView(CAMERA, Pose(down, np.array([*shift_mm, distance_mm])), distance_mm, 3.0)


@pytest.fixture(scope="module")
def block():
    part = example_part()
    return type(part.scene)(part.scene.meshes[:1], ["block"])


def test_what_is_measured_is_what_a_pinhole_gives(block) -> None:
    part = example_part()
    wanted = 120 * 25.4 / 620 / 0.0162
    check = check_view(view(620.0), block, part.feature, part.target, wanted, BAND)
    assert check.feature_px == pytest.approx(wanted, abs=0.1)
    assert check.edges_px == pytest.approx(wanted, abs=0.2)
    np.testing.assert_allclose(check.step_px, wanted / 50, atol=0.02)
    assert check.planned_step_px == pytest.approx(wanted / 50)
    assert check.cover == pytest.approx(wanted / 512, abs=1e-3)
    assert check.image.shape == (200, 512)


def test_a_figure_shows_what_was_measured(block) -> None:
    part = example_part()
    check = check_view(view(620.0), block, part.feature, part.target, 303.5, BAND)
    axes = draw_check(Figure().add_subplot(), check, "from above")
    words = [text.get_text() for text in axes.texts]
    assert f"{check.feature_px:.1f} px (planned 303.5)" in words
    assert f"{check.step_px[1]:.2f} px" in words
    assert (axes.get_title(), axes.get_ylabel()) == ("from above", "y (px)")
    axes.figure.canvas.draw()


def test_a_feature_inside_the_target_has_no_edges(block) -> None:
    target = example_part().target
    inner = Target.segment((-10.16, 0, 0), (10.16, 0, 0))
    wanted = 120 * 20.32 / 620 / 0.0162
    check = check_view(view(620.0), block, inner, target, wanted, BAND)
    assert check.feature_px == pytest.approx(wanted, abs=0.1)
    assert np.isnan(check.edges_px)


def test_a_target_that_leaves_the_picture_is_noticed(block) -> None:
    part = example_part()
    with pytest.raises(
        DetectionError, match="ticks of a ruler that has 51; it must lie in the pic"
    ):
        check_view(view(620.0, (9.0, 0.0)), block, part.feature, part.target, 300.0, BAND)


def test_only_the_body_of_the_target_is_bright() -> None:
    part = example_part()
    bright, dark = bodies_for_pictures(part.scene, part.target)
    assert np.min(bright.reflectance) > 2 * np.max(dark.reflectance)


def test_a_ruler_needs_a_segment() -> None:
    part = example_part()
    assert len(ruler_on(part.feature).ticks_mm) == 51
    decal = ruler_decal(part.feature, part.target)
    np.testing.assert_allclose(decal.scene_from_decal.rotation[:, 2], [0, 0, -1], atol=1e-12)
    with pytest.raises(PlanningError, match="a ruler measures along a segment, but the feature is"):
        ruler_on(part.target)
