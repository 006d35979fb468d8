"""Figures of one calibration: its residuals, and how uncertain its projection is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.calibration import Calibration
from lenscal.calibration.projection_uncertainty import projection_sigma_map
from lenscal.errors import InputError

#: Two of Okabe and Ito's colours, told apart by colour-blind eyes; shapes tell them apart in grey.
_USED, _REJECTED = "#0072B2", "#D55E00"
#: Perceptually even, and read alike by colour-blind eyes and on grey paper.
_COLOURS: Final = "cividis"
#: Length of the arrow that shows the scale, as a share of the width of the image.
_KEY_SHARE: Final = 0.06
#: Longest arrow of a rejected corner, in such arrows; its length is written beside it.
_LONGEST: Final = 3.0
#: How many rejected corners of a view get their length written beside them, the worst ones.
_LABELLED: Final = 8
#: Cells across the image in which residuals are averaged, and the fewest corners for an average.
_CELLS, _LEAST_IN_CELL = 10, 4
_HALO: Final = (withStroke(linewidth=2.5, foreground="white"),)


def draw_view_residuals(axes: Axes, calibration: Calibration, view: int, name: str = "") -> Axes:
    """Draw the residuals of one view as arrows from each observed corner to where it was predicted.

    Parameters
    ----------
    axes
        Where to draw.
    calibration
        The calibration. Its noise sets the scale, so that views can be compared.
    view
        Index of the view.
    name
        What the view is called; its number when empty.

    Returns
    -------
    Axes
        The same axes. Arrows of rejected corners, in another colour and from a circle, are cut
        short where they are long, and the worst have their length beside them.

    Raises
    ------
    InputError
        When there is no such view.
    """
    if not 0 <= view < len(calibration.pixels):
        raise InputError(f"view {view} is not among the {len(calibration.pixels)} views")
    seen, missed = calibration.pixels[view], calibration.residuals_px[view]
    used = calibration.inliers[view]
    rejected = ~used & np.isfinite(missed).all(axis=1)
    _show_image_plane(axes, calibration)
    _draw_arrows(axes, calibration, seen[used], missed[used])
    _draw_rejected(axes, calibration, seen[rejected], missed[rejected])
    words = [f"{used.sum()} corners"] if used.any() else ["rejected as a whole"]
    if used.any():
        words.append(f"rms {np.sqrt((missed[used] ** 2).sum(axis=1).mean()):.2g} px")
    if used.any() and not used.all():
        words.append(f"{(~used).sum()} rejected")
    axes.set_title(f"{name or f'view {view}'}: {', '.join(words)}", fontsize=9, loc="left")
    return axes


def draw_residuals_over_image(axes: Axes, calibration: Calibration) -> Axes:
    """Draw the residuals of all views over the image.

    What a wrong lens model leaves behind repeats from view to view, and shows in averages.

    Parameters
    ----------
    axes
        Where to draw.
    calibration
        The calibration.

    Returns
    -------
    Axes
        The same axes: the used corners coloured by the length of their residuals, and arrows for
        the mean residual of cells with enough corners.
    """
    seen = _used(calibration, calibration.pixels)
    missed = _used(calibration, calibration.residuals_px)
    length_px = np.linalg.norm(missed, axis=1)
    order = np.argsort(length_px)
    _show_image_plane(axes, calibration)
    x, y = seen[order].T
    dots = axes.scatter(x, y, c=length_px[order], s=9, cmap=_COLOURS, linewidths=0)
    _colour_bar(axes, dots, "residual of a corner (px)")
    places, means = _cell_means(calibration, seen, missed)
    _draw_arrows(axes, calibration, places, means, halo=True)
    axes.set_title("Residuals (dots), local means (arrows)", loc="left", fontsize=11)
    return axes


def draw_residual_histogram(axes: Axes, calibration: Calibration) -> Axes:
    """Draw how the residuals of used corners are distributed, beside the Gaussian of their noise.

    Parameters
    ----------
    axes
        Where to draw.
    calibration
        The calibration.

    Returns
    -------
    Axes
        The same axes: residuals along x and along y, and the Gaussian with σ = `noise_px`.
    """
    missed = _used(calibration, calibration.residuals_px)
    noise_px = max(calibration.noise_px, np.finfo(float).tiny)
    reach = max(4.0, 1.05 * float(np.abs(missed).max(initial=0.0)) / noise_px)
    edges = noise_px * np.linspace(-reach, reach, int(np.clip(len(missed) / 12, 12, 60)) + 1)
    for axis, name, colour, style in ((0, "x", _USED, "-"), (1, "y", _REJECTED, "--")):
        axes.hist(
            missed[:, axis],
            edges.tolist(),
            histtype="step",
            color=colour,
            linestyle=style,
            label=f"along {name}",
        )
    along = np.linspace(edges[0], edges[-1], 300)
    density = np.exp(-0.5 * (along / noise_px) ** 2) / (noise_px * np.sqrt(2 * np.pi))
    expected = density * len(missed) * (edges[1] - edges[0])
    label = f"Gaussian, σ = {calibration.noise_px:.3g} px"
    axes.plot(along, expected, color="black", linewidth=1.2, label=label)
    axes.set(
        xlabel="residual (px): predicted less observed",
        ylabel="corners in a bin",
        xlim=(edges[0], edges[-1]),
    )
    axes.set_title("Distribution of residuals", loc="left", fontsize=11)
    axes.set_ylim(top=1.35 * axes.get_ylim()[1])
    axes.legend(frameon=False, fontsize=9, loc="upper right")
    return axes


def draw_projection_uncertainty(
    axes: Axes, calibration: Calibration, distance_mm: float | None = None
) -> Axes:
    """Draw how uncertain the projection is over the image, with labelled contours in px.

    Parameters
    ----------
    axes
        Where to draw.
    calibration
        A calibration with covariance.
    distance_mm
        Distance of the scene, or None for infinity; see `projection_sigma_px`.

    Returns
    -------
    Axes
        The same axes.

    Raises
    ------
    CalibrationError
        When the calibration has no covariance.
    InputError
        When the distance is not positive.
    """
    x, y, sigma_px = projection_sigma_map(calibration, distance_mm)
    values = np.ma.masked_invalid(sigma_px)
    image = axes.pcolormesh(x, y, values, cmap=_COLOURS, shading="gouraud", rasterized=True)
    low, high = float(values.min()), float(values.max())
    if high > low:
        levels = _round_numbers(low, high)
        if len(levels) < 2:
            levels = list(MaxNLocator(5).tick_values(low, high))
        lines = axes.contour(x, y, values, levels=levels, colors="white", linewidths=0.9)
        axes.clabel(lines, fontsize=8, fmt="%g px")
    _colour_bar(axes, image, "1 σ in the worst direction (px)")
    _show_image_plane(axes, calibration)
    scene = "at infinity" if distance_mm is None else f"on a plane {distance_mm:g} mm away"
    axes.set_title(f"Projection uncertainty, scene {scene}", loc="left", fontsize=11)
    return axes


def _used(calibration: Calibration, values: Sequence[FloatArray]) -> FloatArray:
    """(N, 2) values of the used corners of all views."""
    return np.concatenate([v[i] for v, i in zip(values, calibration.inliers, strict=True)])


def _show_image_plane(axes: Axes, calibration: Calibration) -> None:
    sensor = calibration.camera.sensor
    axes.set(
        xlim=(-0.5, sensor.width_px - 0.5),
        ylim=(sensor.height_px - 0.5, -0.5),
        aspect="equal",
        xlabel="x (px)",
        ylabel="y (px)",
    )


def _key_px(calibration: Calibration) -> float:
    """Choose the length of the arrow that shows the scale: a round one, about twice the noise."""
    noise_px = max(calibration.noise_px, 1e-12)
    return _round_numbers(0.7 * noise_px, 2 * noise_px)[-1]


def _round_numbers(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten in a range, of three decades at most."""
    decades = 10.0 ** (np.floor(np.log10(high)) + np.arange(-2, 1))
    return [float(n) for n in np.outer(decades, [1.0, 2.0, 5.0]).flat if low <= n <= high]


def _draw_arrows(
    axes: Axes, calibration: Calibration, places: FloatArray, residuals_px: FloatArray,
    halo: bool = False,
) -> None:  # fmt: skip
    """Draw residuals to the scale of the noise, and an arrow with its length beside the axes."""
    key_px = _key_px(calibration)
    scale = key_px / (_KEY_SHARE * calibration.camera.sensor.width_px)
    arrows = axes.quiver(
        *places.T, *residuals_px.T, angles="xy", scale_units="xy", scale=scale, width=0.004,
        color="black" if halo else _USED, path_effects=list(_HALO) if halo else None, zorder=3,
    )  # fmt: skip
    key = axes.quiverkey(
        arrows,
        1 - _KEY_SHARE,
        1.04,
        key_px,
        f"{key_px:g} px",
        labelpos="W",
        fontproperties={"size": 9},
    )
    arrows.set_in_layout(False)
    key.set_in_layout(False)


def _draw_rejected(
    axes: Axes, calibration: Calibration, places: FloatArray, residuals_px: FloatArray
) -> None:
    width_px = calibration.camera.sensor.width_px
    longest_px = _LONGEST * _key_px(calibration)
    length_px = np.linalg.norm(residuals_px, axis=1)
    direction = residuals_px / length_px[:, None]
    shown = direction * np.minimum(length_px, longest_px)[:, None]
    scale = _key_px(calibration) / (_KEY_SHARE * width_px)
    axes.quiver(
        *places.T, *shown.T, angles="xy", scale_units="xy", scale=scale, width=0.005,
        color=_REJECTED, zorder=4,
    ).set_in_layout(False)  # fmt: skip
    axes.plot(*places.T, "o", color=_REJECTED, markerfacecolor="none", markersize=8)
    for index in np.argsort(-length_px)[:_LABELLED]:
        # On the other side than the arrow; the y axis of the image points down.
        axes.annotate(
            f"{length_px[index]:.1f}", places[index], (0, 12 if direction[index, 1] > 0 else -12),
            textcoords="offset points", ha="center", va="center", fontsize=8, color=_REJECTED,
            path_effects=list(_HALO), zorder=5,
        ).set_in_layout(False)  # fmt: skip


def _cell_means(
    calibration: Calibration, seen: FloatArray, residuals_px: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Average places and residuals over square cells of the image."""
    cell_px = calibration.camera.sensor.width_px / _CELLS
    cells, member = np.unique(np.floor((seen + 0.5) / cell_px), axis=0, return_inverse=True)
    count = np.bincount(member, minlength=len(cells))

    def mean(values: FloatArray) -> FloatArray:
        sums = [np.bincount(member, values[:, i], minlength=len(cells)) for i in (0, 1)]
        return np.stack(sums, axis=-1) / count[:, None]

    enough: BoolArray = count >= _LEAST_IN_CELL
    return mean(seen)[enough], mean(residuals_px)[enough]


def _colour_bar(axes: Axes, drawn: ScalarMappable, label: str) -> None:
    """Below the figure, as wide as it, so that its height stays that of its neighbours."""
    axes.figure.colorbar(drawn, ax=axes, label=label, location="bottom", aspect=30)
