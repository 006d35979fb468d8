import copy
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure

from lenscal.calibration.table import CalibrationTable, Failure
from lenscal.errors import FileError, InputError
from lenscal.plots.calibration_table import draw_slips, draw_table, save_table_figures

TABLE = Path(__file__).parents[3] / "data" / "vicon-1990" / "table.csv"
#: Of the robot in the tables of these tests.
SIGMA_MM, SIGMA_RAD = 0.02, 1e-4


@pytest.fixture(scope="module")
def shared():
    return CalibrationTable.load(TABLE)


@pytest.fixture
def table(shared):
    """The shared table with slips that the test knows: five views at each of 40 settings."""
    rng = np.random.default_rng(0)
    sigmas = np.r_[np.full(3, SIGMA_RAD), np.full(3, SIGMA_MM)]
    evidence = copy.deepcopy(shared.evidence)
    for entry in evidence:
        entry["robot"] = {
            "repeatability_rad": SIGMA_RAD,
            "repeatability_mm": SIGMA_MM,
            "slips": (rng.normal(size=(5, 6)) * sigmas).tolist(),
        }
    return replace(shared, evidence=evidence)


def _without_robot(table):
    return replace(table, evidence=tuple(entry | {"robot": None} for entry in table.evidence))


def _slips(table):
    return np.array([slip for entry in table.evidence for slip in entry["robot"]["slips"]])


def _drawn(axes):
    """(V, 3) components that were drawn."""
    lines = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
    return np.stack([lines[name] for name in "xyz"], axis=-1)


def _bands(axes):
    return [np.abs(band.get_paths()[0].vertices[:, 1]).max() for band in axes.collections]


def test_a_table_is_drawn_setting_by_setting(table):
    lost = replace(table, failures=(Failure(95.0, 130.0, "too dark"),))
    figure = draw_table(Figure(), lost)
    panels, bars = figure.axes[:6], figure.axes[6:]
    rows = table.rows
    share = 100 * rows["sigma_object_distance_mm"] / rows["object_distance_mm"]
    shown = [axes.collections[0].get_array() for axes in panels]
    np.testing.assert_allclose(shown[0], rows["rms_px"])
    np.testing.assert_allclose(shown[2], share)
    np.testing.assert_allclose(shown[4], rows["sigma_standoff_mm"])
    np.testing.assert_allclose(shown[5], rows["sigma_nodal_offset_mm"])
    worst = rows.loc[rows["sigma_nodal_offset_mm"].idxmax()]
    assert panels[5].get_title() == (
        f"σ of the nodal offset\nworst: {worst['sigma_nodal_offset_mm']:.3g} mm at zoom "
        f"{worst['zoom']:g}, focus {worst['focus']:g}"
    )
    assert panels[3].get_title() == "rejected corners\nnone"
    units = ["px", "% of d/D", "% of D", "corners", "mm", "mm"]
    assert [bar.get_ylabel() for bar in bars] == units
    assert all(axes.get_xlabel() == "zoom setting" for axes in panels)
    assert "40 settings, 1 failed (crosses)" in figure.get_suptitle()
    assert panels[0].get_lines()[0].get_xdata() == [95.0]


def test_a_table_without_a_number_says_so_and_is_grey(table):
    rows = table.rows.assign(sigma_standoff_mm=np.nan, rejected_corners=3)
    figure = draw_table(Figure(), replace(table, rows=rows))
    figure.draw_without_rendering()
    unknown, counts = figure.axes[4], figure.axes[3]
    assert unknown.get_title() == "σ of the standoff\nnot known"
    colours = unknown.collections[0].get_facecolors()
    assert len(colours) == 40
    np.testing.assert_allclose(colours[:, :3], colours[0, 0])
    assert "worst: 3 corners at" in counts.get_title()


def test_slips_stand_over_bands_of_the_repeatability(table):
    figure = draw_slips(Figure(layout="constrained"), table)
    translation, rotation = figure.axes
    slips = _slips(table)
    np.testing.assert_allclose(_drawn(translation), slips[:, 3:])
    np.testing.assert_allclose(_drawn(rotation), 1e3 * slips[:, :3])
    np.testing.assert_allclose(_bands(translation), [3 * SIGMA_MM, SIGMA_MM])
    np.testing.assert_allclose(_bands(rotation), [3e3 * SIGMA_RAD, 1e3 * SIGMA_RAD])
    assert (translation.get_ylabel(), rotation.get_ylabel()) == (
        "translation (mm)",
        "rotation (mrad)",
    )
    assert figure.get_suptitle() == (
        "Slips of the robot in 200 views of 40 settings; repeatability 0.020 mm, 0.10 mrad"
    )
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["x of the hand", "y of the hand", "z of the hand", "±1 σ", "±3 σ"]
    # Every second setting is named, at its first view.
    ticks = rotation.get_xticks()
    np.testing.assert_array_equal(ticks, np.arange(0, 200, 10))
    rows = table.rows.iloc[2]
    assert rotation.get_xticklabels()[1].get_text() == f"{rows['zoom']:g}, {rows['focus']:g}"
    low, high = translation.get_ylim()
    assert low < slips[:, 3:].min()
    assert high > slips[:, 3:].max()


def test_poses_that_were_not_used_are_crossed(table):
    """View 7 was not believed, and the third setting, views 10 to 14, did without the robot."""
    evidence = copy.deepcopy(table.evidence)
    evidence[1]["robot"]["slips"][2] = None
    evidence[2]["robot"] = None
    figure = draw_slips(Figure(layout="constrained"), replace(table, evidence=evidence))
    for axes in figure.axes:
        (crosses,) = (line for line in axes.get_lines() if line.get_marker() == "x")
        np.testing.assert_array_equal(crosses.get_xdata(), [7, 10, 11, 12, 13, 14])
        assert np.isnan(_drawn(axes)[crosses.get_xdata()]).all()
    assert figure.get_suptitle().startswith("Slips of the robot in 194 views of 40 settings")
    assert figure.legends[0].get_texts()[-1].get_text() == "pose not used"
    figure.draw_without_rendering()


def test_the_figures_are_saved_with_slips_where_there_was_a_robot(table, tmp_path):
    paths = save_table_figures(table, tmp_path / "new")
    assert [path.name for path in paths] == ["table.png", "robot-slips.png"]
    for path in paths:
        image = matplotlib.image.imread(path)
        assert image.shape[1] == 2250
        assert image[..., :3].std() > 0.05
    alone = save_table_figures(_without_robot(table), tmp_path)
    assert alone == [tmp_path / "table.png"]


def test_evidence_of_the_first_version_knows_no_robot(table, tmp_path):
    for entry in table.evidence:
        del entry["robot"]
    assert [p.name for p in save_table_figures(table, tmp_path)] == ["table.png"]


def test_without_a_robot_there_is_nothing_to_draw(table):
    with pytest.raises(InputError, match="no robot's poses went into the table; calibrate a rec"):
        draw_slips(Figure(), _without_robot(table))


def test_a_file_that_cannot_be_written_is_named(table, tmp_path):
    (tmp_path / "table.png").mkdir()
    with pytest.raises(FileError, match="cannot write .*table.png: Is a directory"):
        save_table_figures(table, tmp_path)
