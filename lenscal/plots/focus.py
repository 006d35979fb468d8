"""Figures of focus curves and of measures of sharpness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from lenscal.arrays import FloatArray
from lenscal.recording import FocusResult
from lenscal.session.focus_peak import fit_peak
from lenscal.session.sharpness import MEASURES, Measure

#: Okabe and Ito's colours, told apart by colour-blind eyes; line styles tell them apart in grey.
_COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
_STYLES = ("-", "--", "-", "-.", ":", "--")
_COARSE, _FINE = _COLOURS[1], _COLOURS[2]


def draw_focus_curve(axes: Axes, result: FocusResult) -> Axes:
    """Draw a focus curve, the parabola fitted to its fine sweep, and the sharpest standoff.

    Parameters
    ----------
    axes
        Where to draw.
    result
        What autofocus found. A record that does not say which points are of the fine sweep is drawn
        without a fit.

    Returns
    -------
    Axes
        The same axes.
    """
    measure = MEASURES[Measure(result.measure)]
    coarse, fine = np.split(result.curve, [len(result.curve) - result.fine])
    axes.plot(*coarse.T, "o", color=_COARSE, markerfacecolor="none", label="coarse sweep")
    if len(fine):
        axes.plot(*fine.T, "o", color=_FINE, markersize=4, label="fine sweep")
        fit = fit_peak(
            *fine.T,
            vergence=(result.vergence_per_mm or 0.0, 0.0),
            width_power=measure.width_power,
        )
        standoffs_mm = np.linspace(fine[:, 0].min(), fine[:, 0].max(), 200)
        label = "fit: 1/sharpness² is a parabola in 1/z"
        axes.plot(standoffs_mm, fit.sharpness(standoffs_mm), color="black", label=label)
    sharpest = f"sharpest: {result.distance_mm:.2f} ± {result.sigma_mm:.2f} mm"
    axes.axvline(result.distance_mm, color="black", linestyle=":", label=sharpest)
    axes.set(xlabel="standoff (mm)", ylabel=measure.label)
    axes.set_ylim(0, 1.1 * float(result.curve_sharpness.max()))
    axes.legend(frameon=False, loc="lower center")
    return axes


def draw_measures(
    axes: Axes, from_sharpest_mm: FloatArray, scores: Mapping[Measure, FloatArray]
) -> Axes:
    """Draw measures of sharpness over distance, each as a share of its highest score.

    Parameters
    ----------
    axes
        Where to draw.
    from_sharpest_mm
        (N,) way of the camera from the sharpest place, positive away from the target.
    scores
        (N,) scores of each measure there.

    Returns
    -------
    Axes
        The same axes.
    """
    for measure, values in scores.items():
        axes.plot(from_sharpest_mm, values / values.max(), **_style(measure))
    axes.axvline(0, color="grey", linewidth=0.8)
    axes.set(xlabel="camera moved away from the sharpest place (mm)", ylabel="share of the peak")
    axes.set_ylim(0, 1.05)
    _legend_below(axes)
    return axes


def draw_errors(
    axes: Axes, depth_of_field_mm: FloatArray, errors_mm: Mapping[Measure, FloatArray]
) -> Axes:
    """Draw how far beside the true distance each measure finds its peak.

    Parameters
    ----------
    axes
        Where to draw.
    depth_of_field_mm
        (N,) one-sided one-pixel depth of field of each setting.
    errors_mm
        (N,) error of each measure there, negative too near; NaN where it has no peak.

    Returns
    -------
    Axes
        The same axes; a fifth of the depth of field is shaded.
    """
    fifth = depth_of_field_mm / 5
    label = "a fifth of the depth of field"
    axes.fill_between(depth_of_field_mm, -fifth, fifth, color="0.88", label=label)
    for measure, values in errors_mm.items():
        axes.plot(depth_of_field_mm, values, **_style(measure), marker="o", markersize=3)
    axes.set_yscale("symlog", linthresh=0.1)
    axes.set(
        xlabel="one-pixel depth of field (mm)",
        ylabel="sharpest place found, less the true one (mm)",
    )
    _legend_below(axes)
    return axes


def _legend_below(axes: Axes) -> None:
    below = (0.5, -0.13)
    axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=below, ncols=2)


def _style(measure: Measure) -> dict[str, Any]:
    """Give each measure its line and name."""
    index = list(Measure).index(measure)
    return {
        "color": _COLOURS[index],
        "linestyle": _STYLES[index],
        "linewidth": 2.4 if measure is Measure.EDGE_WIDTH else 1.3,
        "label": MEASURES[measure].label.partition(" (")[0],
    }
