from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from lenscal.plots.focus import draw_errors, draw_focus_curve, draw_measures
from lenscal.recording import FocusResult, Recording
from lenscal.session.sharpness import Measure

SESSION = Path(__file__).parents[3] / "data" / "vicon-1990" / "session"


@pytest.fixture
def axes():
    return Figure().add_subplot()


def test_a_focus_curve_is_drawn_with_its_fit(axes):
    coarse, fine = np.linspace(360, 380, 11), np.linspace(367, 375, 13)
    standoffs = np.concatenate([coarse, fine])
    sharpness = 1 / np.sqrt(1 + ((standoffs - 371) / 4) ** 2)
    result = FocusResult(371.0, 0.03, 0.8, 100.0, standoffs, sharpness, fine=13)
    assert draw_focus_curve(axes, result) is axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("standoff (mm)", "1 / edge width (1/px)")
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert "sharpest: 371.00 ± 0.03 mm" in labels
    fit = next(line for line in axes.get_lines() if line.get_label().startswith("fit"))
    assert fit.get_xdata()[np.argmax(fit.get_ydata())] == pytest.approx(371, abs=0.05)


def test_a_record_of_an_older_session_is_drawn_without_a_fit(axes):
    record = Recording.load(SESSION).settings[0]
    draw_focus_curve(axes, record.focus)
    labels = [line.get_label() for line in axes.get_lines()]
    assert labels[0] == "coarse sweep"
    assert len(labels) == 2 + 2 * (record.focus.fine > 0)


def test_measures_are_drawn_as_shares_of_their_peaks(axes):
    places = np.linspace(-5, 5, 11)
    scores = {measure: (i + 1) / (1 + places**2) for i, measure in enumerate(Measure)}
    draw_measures(axes, places, scores)
    curves = axes.get_lines()[: len(Measure)]
    assert all(max(line.get_ydata()) == 1 for line in curves)
    assert len({(line.get_color(), line.get_linestyle()) for line in curves}) == len(Measure)
    assert axes.get_xlabel().endswith("(mm)")


def test_errors_are_drawn_beside_a_fifth_of_the_depth_of_field(axes):
    field = np.array([0.5, 1.0, 2.0])
    draw_errors(axes, field, {Measure.EDGE_WIDTH: np.array([0.0, 0.01, np.nan])})
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["a fifth of the depth of field", "1 / edge width"]
    assert axes.get_ylabel().endswith("(mm)")
