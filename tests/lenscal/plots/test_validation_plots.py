from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from lenscal import check_consistency, cross_validate
from lenscal.calibration.table import CalibrationTable
from lenscal.plots.validation import draw_consistency, draw_prediction_error, draw_validation

VICON = Path(__file__).parents[3] / "data" / "vicon-1990" / "table.csv"


@pytest.fixture(scope="module")
def found():
    table = CalibrationTable.load(VICON)
    rows = table.to_dataframe()
    rows.loc[17, ["object_distance_mm", "image_distance_mm", "focal_length_mm"]] *= 1.03
    return cross_validate(rows, sensor=table.sensor), check_consistency(rows)


def test_the_flagged_setting_is_named(found):
    figure = draw_validation(Figure(figsize=(14, 8), layout="constrained"), *found)
    figure.savefig("/dev/null", format="png")
    assert "40 settings, 1 flagged" in figure.get_suptitle()
    first = figure.axes[0]
    assert [text.get_text() for text in first.texts] == ["102, 100"]
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert titles[1:3] == ["magnification d/D", "object distance D"]
    assert titles[-1] == "corner of the image"


def test_units_are_in_the_labels(found):
    axes = Figure().add_subplot()
    draw_prediction_error(axes, found[0], "k1_per_mm2")
    assert axes.figure.axes[1].get_ylabel() == "prediction error (mm⁻²)"
    assert axes.get_xlabel() == "zoom setting"


def test_what_is_not_known_is_drawn_too():
    unknown = pd.DataFrame({"zoom": [1.0, 2.0], "focus": 0.0, "sigmas": np.nan, "flagged": False})
    axes = draw_consistency(Figure().add_subplot(), unknown.assign(threshold=4.0))
    assert len(axes.texts) == 0
    errors = unknown.assign(edge=True, error_focal_length_mm=np.nan)
    errors["relative_error_focal_length_mm"] = np.nan
    draw_prediction_error(Figure().add_subplot(), errors, "focal_length_mm")
