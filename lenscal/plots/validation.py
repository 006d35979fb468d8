"""Figures of how well a lens map predicts, and of the settings that disagree with the others."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from lenscal.maps.quantities import QUANTITIES
from lenscal.maps.tame_samples import POSITIVE

#: Perceptually even, and read alike by colour-blind eyes and on grey paper.
_COLOURS: Final = "cividis"
#: Of Okabe and Ito's colours, the one for what went wrong.
_FLAG: Final = "#D55E00"
#: What is drawn where it is there, in this order.
_PANELS: Final = (
    "magnification",
    "object_distance_mm",
    "focal_length_mm",
    "image_distance_mm",
    "standoff_mm",
    "k1_per_mm2",
)
_MOST_PANELS: Final = 4


def draw_validation(figure: Figure, validation: pd.DataFrame, consistency: pd.DataFrame) -> Figure:
    """Draw consistency and prediction errors over the (zoom, focus) plane.

    Parameters
    ----------
    figure
        Where to draw; about three to two.
    validation
        What `cross_validate` gave.
    consistency
        What `check_consistency` gave for the same table.

    Returns
    -------
    Figure
        The same figure: how far each setting is off in σ, with flagged ones ringed and named, and
        the absolute prediction errors of up to four quantities and of the image's corner. Squares
        stand for settings that could only be extrapolated to.
    """
    names = [name for name in _PANELS if f"error_{name}" in validation][:_MOST_PANELS]
    pixels = [name for name in ("error_corner_px",) if name in validation]
    count = 1 + len(names) + len(pixels)
    rows = 1 if count <= 3 else 2
    panels = figure.subplots(rows, -(-count // rows), squeeze=False).ravel()
    draw_consistency(panels[0], consistency)
    for axes, name in zip(panels[1:], [*names, *pixels], strict=False):
        draw_prediction_error(axes, validation, name)
    for axes in panels[count:]:
        axes.set_axis_off()
    flagged = int(consistency["flagged"].sum())
    figure.suptitle(
        f"{len(consistency)} settings, {flagged or 'none'} flagged (rings); "
        "squares: predicted by extrapolation"
    )
    return figure


def draw_consistency(axes: Axes, consistency: pd.DataFrame) -> Axes:
    """Draw by how many σ each setting disagrees with the others.

    Parameters
    ----------
    axes
        Where to draw.
    consistency
        What `check_consistency` gave.

    Returns
    -------
    Axes
        The same axes; flagged settings are ringed and named.
    """
    threshold = float(consistency["threshold"].iloc[0])
    sigmas = consistency["sigmas"].abs()
    marks = axes.scatter(
        consistency["zoom"],
        consistency["focus"],
        c=sigmas,
        cmap=_COLOURS,
        vmin=0,
        vmax=threshold,
        edgecolors="black",
        linewidths=0.6,
        s=45,
    )
    known = bool(sigmas.notna().any())
    over = "max" if known and sigmas.max() > threshold else "neither"
    axes.figure.colorbar(marks, ax=axes, label="off by (σ)", extend=over)
    middle = float(consistency["zoom"].median())
    for setting in consistency[consistency["flagged"]].itertuples():
        zoom, focus = float(setting.zoom), float(setting.focus)  # type: ignore[arg-type]
        axes.plot(zoom, focus, "o", markersize=15, color=_FLAG, fillstyle="none", mew=2)
        left = zoom > middle
        axes.annotate(
            f"{zoom:g}, {focus:g}",
            (zoom, focus),
            xytext=(-11 if left else 11, 0),
            textcoords="offset points",
            ha="right" if left else "left",
            va="center",
            fontsize=8,
            bbox={"facecolor": "white", "edgecolor": _FLAG, "pad": 1.5},
        )
    axes.margins(0.12)
    axes.set(xlabel="zoom setting", ylabel="focus setting", title="disagreement with the others")
    return axes


def draw_prediction_error(axes: Axes, validation: pd.DataFrame, name: str) -> Axes:
    """Draw the absolute error with which each setting was predicted by the others.

    Parameters
    ----------
    axes
        Where to draw.
    validation
        What `cross_validate` gave.
    name
        A quantity, or one of its columns of pixels.

    Returns
    -------
    Axes
        The same axes. Grey: not predicted.
    """
    if name in validation:
        errors, title = validation[name], f"{name.split('_')[1]} of the image"
        label = "moves by (px)"
    elif name in POSITIVE:
        errors, title = 100 * validation[f"relative_error_{name}"], QUANTITIES[name]
        title, label = title.rsplit(" (", 1)[0], "prediction error (%)"
    else:
        title, _, unit = QUANTITIES[name].partition(" (")
        errors = validation[f"error_{name}"]
        label = f"prediction error ({unit}" if unit else "prediction error"
    size = errors.abs().to_numpy(float)
    positive = size[np.isfinite(size) & (size > 0)]
    least, most = (positive.min(), positive.max()) if len(positive) else (0.1, 1.0)
    low = max(least, 1e-3 * most)
    norm = LogNorm(low, max(most, 1.01 * low))
    edge = validation["edge"].to_numpy(bool)
    for marker, chosen in (("o", ~edge), ("s", edge)):
        marks = axes.scatter(
            validation["zoom"][chosen],
            validation["focus"][chosen],
            c=np.maximum(size[chosen], low),
            cmap=_COLOURS,
            norm=norm,
            marker=marker,
            edgecolors="black",
            linewidths=0.6,
            s=45,
            plotnonfinite=True,
        )
    axes.figure.colorbar(marks, ax=axes, label=label, format=LogFormatter(labelOnlyBase=False))
    axes.margins(0.12)
    axes.set(xlabel="zoom setting", ylabel="focus setting", title=title)
    return axes
