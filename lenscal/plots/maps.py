"""Figures of lens maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from lenscal.arrays import FloatArray
from lenscal.maps.contours import SettingCurve
from lenscal.maps.lens_map import LensMap
from lenscal.maps.quantities import QUANTITIES

#: Perceptually even, and read alike by colour-blind eyes and on grey paper.
_COLOURS: Final = "cividis"
_LIMIT_STYLES: Final = ("-", "--", ":", "-.")
#: Where along contours their labels take turns, so that those of neighbours do not collide, nor do
#: they with samples at round shares.
_LABEL_SHARES: Final = (0.38, 0.62)
#: Contours shorter than this get no label, nor do places nearer than this to the border; shares of
#: the ranges.
_SHORTEST_LABELLED, _CLEAR_OF_BORDER = 0.2, 0.02
#: Lines per axis of a surface in space.
_LINES: Final = 41


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
    image = axes.pcolormesh(zoom, focus, values, cmap=_COLOURS, shading="nearest", rasterized=True)
    draw_lines(axes, lens_map, quantity, levels, colour="white")
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


def draw_lines(
    axes: Axes,
    lens_map: LensMap,
    quantity: str,
    levels: Sequence[float] | int = 12,
    *,
    colour: str = "black",
) -> ContourSet:
    """Draw exact contours of a map as thin labelled lines, up to the border of its domain.

    Parameters
    ----------
    axes
        Where to draw.
    lens_map
        The map.
    quantity
        One of its quantities.
    levels
        Levels of the contours, or about how many round ones to choose; those that the map never
        reaches are left out.
    colour
        Colour of lines and labels.

    Returns
    -------
    ContourSet
        What was drawn.
    """
    low, high = lens_map.range_of(quantity)
    if isinstance(levels, int):
        levels = [float(level) for level in MaxNLocator(levels).tick_values(low, high)]
    reached = [level for level in sorted(levels) if low <= level <= high]
    pieces = [
        [np.stack([c.zoom, c.focus], axis=-1) for c in lens_map.contour(quantity, level)]
        for level in reached
    ]
    lines = ContourSet(axes, reached, pieces, colors=colour, linewidths=0.8)
    axes.clabel(lines, fontsize=8, manual=_label_places(lens_map, pieces), zorder=4)
    halo = "black" if colour == "white" else "white"
    for text in lines.labelTexts:
        # Legible on every colour, and where a thick line passes below.
        text.set_path_effects([withStroke(linewidth=1.5, foreground=halo, alpha=0.6)])
    return lines


def _label_places(
    lens_map: LensMap, pieces: Sequence[Sequence[FloatArray]]
) -> list[tuple[float, float]]:
    """Where to label contours: on the longest piece of each level, at heights that take turns."""
    low, high = np.transpose([lens_map.domain.zoom, lens_map.domain.focus])
    places = []
    for of_level, share in zip(pieces, cycle(_LABEL_SHARES), strict=False):
        lengths = [np.r_[0.0, _steps(piece, high - low).cumsum()] for piece in of_level]
        longest = max(range(len(of_level)), key=lambda i: lengths[i][-1], default=None)
        if longest is None:
            continue
        along, piece = lengths[longest], of_level[longest]
        place = piece[np.searchsorted(along, share * along[-1])]
        clear = np.minimum(place - low, high - place) / (high - low)
        if along[-1] > _SHORTEST_LABELLED and clear.min() > _CLEAR_OF_BORDER:
            places.append((float(place[0]), float(place[1])))
    return places


def _steps(points: FloatArray, span: FloatArray) -> FloatArray:
    """(N − 1,) distances between neighbouring points, in shares of the ranges of both motors."""
    return np.asarray(np.linalg.norm(np.diff(points, axis=0) / span, axis=1))


def draw_limits(axes: Axes, lens_map: LensMap, quantity: str, limits: Mapping[str, float]) -> Axes:
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
    return draw_curves(
        axes,
        {
            label: lens_map.contour(quantity, level) if low <= level <= high else []
            for label, level in limits.items()
        },
    )


def draw_curves(axes: Axes, curves: Mapping[str, Sequence[SettingCurve]]) -> Axes:
    """Draw curves of settings as thick lines, each in a style of its own.

    Parameters
    ----------
    axes
        Where to draw.
    curves
        Label to the pieces of a contour; one without any is named in the legend as beyond the map.

    Returns
    -------
    Axes
        The same axes, with a legend below them.
    """
    for style, (label, pieces) in zip(cycle(_LIMIT_STYLES), curves.items(), strict=False):
        if not pieces:
            axes.plot([], [], linestyle="none", label=f"{label} (beyond this map)")
        for i, curve in enumerate(pieces):
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


def draw_surface(axes: Axes3D, lens_map: LensMap, quantity: str) -> Axes3D:
    """Draw a quantity of a map as a surface above the (zoom, focus) plane.

    Parameters
    ----------
    axes
        Where to draw: axes with ``projection="3d"``.
    lens_map
        The map; it must extend along both zoom and focus.
    quantity
        One of its quantities.

    Returns
    -------
    Axes3D
        The same axes. The surface ends with the domain.
    """
    zoom, focus = lens_map.domain.grid(_LINES)
    values = lens_map.value(quantity, zoom, focus, outside="nan")
    axes.plot_surface(
        zoom,
        focus,
        values,
        cmap=_COLOURS,
        vmin=float(np.nanmin(values)),
        vmax=float(np.nanmax(values)),
        rcount=_LINES,
        ccount=_LINES,
        edgecolor="black",
        linewidth=0.2,
    )
    axes.set(xlabel="zoom setting", ylabel="focus setting")
    axes.set_zlabel(QUANTITIES[quantity], labelpad=9)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(5))
    axes.view_init(elev=26, azim=-125)
    axes.set_box_aspect(None, zoom=0.9)
    return axes
