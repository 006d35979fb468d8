"""Figures of lens maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from lenscal.maps.lens_map import LensMap
from lenscal.maps.quantities import QUANTITIES

#: Perceptually even, and read alike by colour-blind eyes and on grey paper.
_COLOURS = "cividis"
_LIMIT_STYLES = ("-", "--", ":", "-.")


def draw_contours(
    axes: Axes, lens_map: LensMap, quantity: str, levels: Sequence[float] | int = 12
) -> Axes:
    """Draw a quantity of a map over the (zoom, focus) plane, with labelled contours.

    Parameters
    ----------
    axes
        Where to draw.
    lens_map
        The map.
    quantity
        One of its quantities.
    levels
        Levels of the contours, or about how many round ones to choose.

    Returns
    -------
    Axes
        The same axes.
    """
    zoom, focus = lens_map.domain.grid(161)
    values = np.ma.masked_invalid(lens_map.value(quantity, zoom, focus, outside="nan"))
    if isinstance(levels, int):
        chosen = MaxNLocator(levels).tick_values(float(values.min()), float(values.max()))
        levels = [float(level) for level in chosen]
    image = axes.pcolormesh(zoom, focus, values, cmap=_COLOURS, shading="gouraud", rasterized=True)
    lines = axes.contour(zoom, focus, values, levels=levels, colors="white", linewidths=0.8)
    axes.clabel(lines, fontsize=8)
    samples = lens_map.samples
    axes.plot(
        samples["zoom"],
        samples["focus"],
        linestyle="none",
        marker="o",
        markersize=4,
        markerfacecolor="white",
        markeredgecolor="black",
        markeredgewidth=0.7,
        clip_on=False,
        zorder=3,
        label="calibrated settings",
    )
    axes.set(xlabel="zoom setting", ylabel="focus setting", title=QUANTITIES[quantity])
    axes.figure.colorbar(image, ax=axes, label=QUANTITIES[quantity])
    return axes


def draw_limits(axes: Axes, lens_map: LensMap, quantity: str, limits: dict[str, float]) -> Axes:
    """Draw contours of a quantity as limits on top of another figure of the same map.

    Parameters
    ----------
    axes
        Where to draw.
    lens_map
        The map.
    quantity
        One of its quantities.
    limits
        Label to level; a level that the map never reaches is named in the legend as such.

    Returns
    -------
    Axes
        The same axes, with a legend below them.
    """
    low, high = lens_map.range_of(quantity)
    for style, (label, level) in zip(_LIMIT_STYLES, limits.items(), strict=False):
        curves = lens_map.contour(quantity, level) if low <= level <= high else []
        if not curves:
            axes.plot([], [], linestyle="none", label=f"{label} (beyond this map)")
        for i, curve in enumerate(curves):
            axes.plot(
                curve.zoom,
                curve.focus,
                color="black",
                linestyle=style,
                linewidth=1.8,
                path_effects=[withStroke(linewidth=4, foreground="white")],
                label=label if i == 0 else None,
            )
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, frameon=False, fontsize=8)
    return axes
