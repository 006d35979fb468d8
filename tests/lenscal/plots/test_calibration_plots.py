from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver, QuiverKey

from lenscal.calibration.calibration import Calibration
from lenscal.calibration.projection_uncertainty import projection_sigma_px
from lenscal.calibration.rejection import Rejection
from lenscal.camera import Camera
from lenscal.errors import CalibrationError, FileError, InputError
from lenscal.plots.calibration import (
    draw_projection_uncertainty,
    draw_residual_histogram,
    draw_residuals_over_image,
    draw_view_residuals,
)
from lenscal.plots.figure_files import draw_summary, draw_views, make_folder, save_figures
from lenscal.sensor import Sensor

SENSOR = Sensor(640, 480, 0.01, 0.01)
NOISE_PX = 0.12


@pytest.fixture
def axes():
    return Figure().add_subplot()


@pytest.fixture
def pixels():
    rng = np.random.default_rng(0)
    return [rng.uniform((20, 20), (620, 460), (60, 2)) for _ in range(11)]


@pytest.fixture
def calibration(pixels):
    """Eleven views; two bad corners in view 1, and view 2 rejected as a whole."""
    rng = np.random.default_rng(1)
    residuals = [rng.normal(0, NOISE_PX, p.shape) for p in pixels]
    inliers = [np.ones(len(p), dtype=bool) for p in pixels]
    residuals[1][[4, 9]] = [[3.0, 4.0], [-0.6, 0.8]]
    inliers[1][[4, 9]] = False
    inliers[2][:] = False
    names = ("image_distance_mm", "principal_point_x_px", "k1_per_mm2")
    return Calibration(
        camera=Camera(SENSOR, 5.3, -0.01),
        poses=(),
        pixels=tuple(pixels),
        residuals_px=tuple(residuals),
        inliers=tuple(inliers),
        rejected=(Rejection(1, 4, 5.0, "far"), Rejection(1, 9, 1.0, "far")),
        noise_px=NOISE_PX,
        focus_view=None,
        quantities=names,
        quantity_covariance=np.diag([0.005, 0.5, 1e-4]) ** 2,
    )


def _quivers(axes):
    return [artist for artist in axes.collections if isinstance(artist, Quiver)]


def _key(axes):
    (key,) = (artist for artist in axes.get_children() if isinstance(artist, QuiverKey))
    return key


def test_arrows_of_a_view_tell_used_and_rejected_corners_apart(axes, calibration, pixels):
    assert draw_view_residuals(axes, calibration, 1, "left02.jpg") is axes
    used, rejected = _quivers(axes)
    np.testing.assert_allclose(used.U, calibration.residuals_px[1][calibration.inliers[1], 0])
    np.testing.assert_allclose(used.XY, pixels[1][calibration.inliers[1]])
    np.testing.assert_allclose(rejected.XY, pixels[1][[4, 9]])
    assert used.get_facecolor().tolist() != rejected.get_facecolor().tolist()
    # Both are too long to be shown to scale: they keep their direction, and say how long they are.
    np.testing.assert_allclose(rejected.U / rejected.V, [0.75, -0.75])
    np.testing.assert_allclose(np.hypot(rejected.U, rejected.V), 0.6)
    assert [text.get_text() for text in axes.texts] == ["5.0", "1.0"]
    assert axes.get_title(loc="left").startswith("left02.jpg: 58 corners, rms 0.1")
    assert axes.get_title(loc="left").endswith("2 rejected")


def test_the_scale_arrow_has_its_length_in_px_and_is_the_same_in_all_views(
    axes, calibration, pixels
):
    draw_view_residuals(axes, calibration, 0)
    key, (used,) = _key(axes), _quivers(axes)[:1]
    assert (key.U, key.text.get_text()) == (0.2, "0.2 px")
    other = Figure().add_subplot()
    draw_view_residuals(other, calibration, 1)
    assert _quivers(other)[0].scale == used.scale == pytest.approx(0.2 / (0.06 * 640))
    assert axes.yaxis_inverted()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (px)", "y (px)")
    coarse = replace(calibration, noise_px=30.0)
    draw_view_residuals(other, coarse, 0)
    assert "50 px" in [k.text.get_text() for k in other.get_children() if isinstance(k, QuiverKey)]


def test_a_rejected_view_is_called_so(axes, calibration):
    draw_view_residuals(axes, calibration, 2)
    assert axes.get_title(loc="left") == "view 2: rejected as a whole"
    unknown = [
        r if i != 2 else np.full_like(r, np.nan) for i, r in enumerate(calibration.residuals_px)
    ]
    draw_view_residuals(axes, replace(calibration, residuals_px=tuple(unknown)), 2)


def test_a_lens_model_that_is_wrong_shows_in_local_means(axes, calibration, pixels):
    """A shift that all views share in one quarter of the image survives averaging."""
    shifted = [
        r + np.where((p < (320, 240)).all(axis=1)[:, None], (0.5, 0.0), 0.0)
        for r, p in zip(calibration.residuals_px, pixels, strict=True)
    ]
    wrong = replace(calibration, residuals_px=tuple(shifted))
    assert draw_residuals_over_image(axes, wrong) is axes
    (means,) = _quivers(axes)
    quarter = (means.XY < (310, 230)).all(axis=1) & (means.XY < (256, 192)).all(axis=1)
    assert quarter.sum() >= 6
    np.testing.assert_allclose(means.U[quarter], 0.5, atol=0.25)
    assert np.abs(means.U[(means.XY > (320, 256)).all(axis=1)]).max() < 0.25
    (dots,) = (c for c in axes.collections if isinstance(c, PathCollection))
    assert len(dots.get_offsets()) == 11 * 60 - 2 - 60
    assert axes.figure.axes[1].get_xlabel() == "residual of a corner (px)"


def test_the_histogram_counts_used_corners_beside_a_gaussian_of_their_number(axes, calibration):
    assert draw_residual_histogram(axes, calibration) is axes
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert set(labels) == {"along x", "along y", "Gaussian, σ = 0.12 px"}
    assert "px" in axes.get_xlabel()
    (gaussian,) = axes.get_lines()
    x, y = gaussian.get_data()
    outline = axes.patches[0].get_xy()
    bin_px = np.diff(np.unique(outline[:, 0]))[0]
    used = sum(int(mask.sum()) for mask in calibration.inliers)
    assert np.trapezoid(y, x) / bin_px == pytest.approx(used, rel=1e-3)
    heights = outline[1:-1:2, 1]
    assert heights.sum() == pytest.approx(used)
    assert x[0] <= -4 * NOISE_PX


def test_the_uncertainty_map_is_that_of_the_calculation_with_labels_in_px(axes, calibration):
    assert draw_projection_uncertainty(axes, calibration) is axes
    mesh = axes.collections[0]
    corner = projection_sigma_px(calibration, [-0.5, -0.5])
    assert mesh.get_array()[0, 0] == pytest.approx(corner)
    assert {"0.2 px", "0.5 px"} <= {text.get_text() for text in axes.texts}
    assert axes.get_title(loc="left").endswith("at infinity")
    assert axes.figure.axes[1].get_xlabel() == "1 σ in the worst direction (px)"
    near = draw_projection_uncertainty(Figure().add_subplot(), calibration, 250.0)
    assert near.get_title(loc="left").endswith("on a plane 250 mm away")


@pytest.mark.parametrize("sigma", [0.0, 1e-7])
def test_an_uncertainty_without_round_levels_is_still_drawn(axes, calibration, sigma):
    flat = replace(calibration, quantity_covariance=np.diag([sigma, 0, 0]) ** 2)
    draw_projection_uncertainty(axes, flat)
    axes.figure.draw_without_rendering()


def test_the_summary_has_three_panels_or_two_without_covariance(calibration):
    figure = draw_summary(Figure(), calibration)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert [bool(title) for title in titles] == [True, True, True, False, False]
    assert "598 corners in 10 views, 62 rejected" in figure.get_suptitle()
    bare = replace(calibration, quantities=(), quantity_covariance=None)
    assert len(draw_summary(Figure(), bare).axes) == 3
    with pytest.raises(CalibrationError, match="comes without uncertainty"):
        draw_projection_uncertainty(Figure().add_subplot(), bare)


def test_every_view_is_on_a_page(calibration):
    names = [f"left{i:02d}.jpg" for i in range(11)]
    pages = draw_views(calibration, names)
    titles = [
        a.get_title(loc="left") for page in pages for a in page.axes if a.get_title(loc="left")
    ]
    assert len(pages) == 2
    assert [title.partition(":")[0] for title in titles] == names


def test_figures_are_saved_whole(calibration, tmp_path):
    names = [f"view{i}" for i in range(11)]
    paths = save_figures(calibration, names, tmp_path / "new" / "folder")
    assert [path.name for path in paths] == ["summary.png", "views-1.png", "views-2.png"]
    for path in paths:
        image = matplotlib.image.imread(path)
        assert image.shape[1] > 1500
        assert image[..., :3].std() > 0.05


def test_views_and_names_must_be_those_of_the_calibration(axes, calibration):
    with pytest.raises(InputError, match="view 11 is not among the 11 views"):
        draw_view_residuals(axes, calibration, 11)
    with pytest.raises(InputError, match="2 names were given for 11 views; give one each"):
        draw_views(calibration, ["a", "b"])


def test_a_place_that_cannot_be_written_to_is_named(calibration, tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(FileError, match="figures are written to a folder, but .*file is a file"):
        make_folder(file)
    with pytest.raises(FileError, match="cannot make the folder .*file/below for figures: Not a d"):
        make_folder(file / "below")
    (tmp_path / "summary.png").mkdir()
    with pytest.raises(FileError, match="cannot write .*summary.png: Is a directory"):
        save_figures(calibration, [""] * 11, tmp_path)
