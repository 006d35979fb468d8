"""Figures of a calibrated lens: how good each setting is, and how far the robot slipped."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.sweep import SweepOptions, calibration_of
from lenscal.calibration.table import CalibrationTable
from lenscal.document import Json
from lenscal.errors import InputError
from lenscal.plots.figure_files import make_folder, save_figure, save_figures
from lenscal.recording import Recording
from lenscal.setting import LensSetting

#: Of the settings that failed, and of poses that were not used.
_LOST: Final = "#D55E00"
#: Perceptually even, and read alike by colour-blind eyes and on grey paper; grey: not known.
_COLOURS: Final = colormaps["cividis"].with_extremes(bad="lightgrey")
#: Three of Okabe and Ito's colours, and shapes to tell them apart in grey.
_AXES: Final = (("x", "#0072B2", "o"), ("y", "#E69F00", "^"), ("z", "#009E73", "s"))
_BANDS: Final = ((3, "0.93"), (1, "0.83"))
#: How many settings get a label below the slips.
_LABELLED: Final = 20


def draw_table(figure: Figure, table: CalibrationTable) -> Figure:
    """Draw how good the calibration of a lens is, over its (zoom, focus) settings.

    Parameters
    ----------
    figure
        Where to draw; about three to two.
    table
        The calibrations of all settings.

    Returns
    -------
    Figure
        The same figure, with panels for the rms of the residuals, rejected corners, and the σ of
        d/D, D, nodal offset and standoff, grey where they are not known. Crosses stand for settings
        that could not be calibrated.
    """
    for axes, panel in zip(figure.subplots(2, 3).flat, _panels(table), strict=True):
        _draw_settings(axes, table, panel)
    lost = f", {len(table.failures)} failed (crosses)" if table.failures else ""
    figure.suptitle(f"Calibration of {len(table)} settings{lost}")
    return figure


def draw_slips(figure: Figure, table: CalibrationTable) -> Figure:
    """Draw how far the hand of the robot stood from where the robot said, in every view.

    The slips are what is left after a fit, which follows them in part: the fewer views a setting
    has, the smaller they are beside the repeatability, whose estimate allows for that.

    Parameters
    ----------
    figure
        Where to draw; about twice as wide as high.
    table
        A table of settings with a robot.

    Returns
    -------
    Figure
        The same figure: translations and rotations along the axes of the hand, over bands of ±1 σ
        and ±3 σ of the repeatability. Crosses below stand for views whose pose was not used.

    Raises
    ------
    InputError
        When no robot's poses went into the table.
    """
    slips = _Slips.of(table)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, values, sigma, label in zip(
        panels,
        (slips.translations_mm, 1e3 * slips.rotations_rad),
        (slips.sigma_mm, 1e3 * slips.sigma_rad),
        ("translation (mm)", "rotation (mrad)"),
        strict=True,
    ):
        _draw_components(axes, values, sigma)
        axes.set_ylabel(label)
    _label_settings(panels[-1], table, slips.first_views)
    figure.legend(
        handles=_legend(bool(slips.unused.any())),
        loc="outside lower center",
        ncols=6,
        frameon=False,
    )
    figure.suptitle(
        f"Slips of the robot in {(~slips.unused).sum()} views of {len(table)} settings; "
        f"repeatability {np.median(slips.sigma_mm):#.2g} mm, "
        f"{1e3 * np.median(slips.sigma_rad):#.2g} mrad"
    )
    return figure


def save_session_figures(
    recording: Recording, table: CalibrationTable, options: SweepOptions, folder: Path
) -> list[Path]:
    """Save the figures of a table, and the residuals of the setting that fits worst.

    Parameters
    ----------
    recording
        What the table was made from.
    table
        The table.
    options
        How it was calibrated.
    folder
        Where to; made when it is missing.

    Returns
    -------
    list of Path
        Those of `save_table_figures` and of `lenscal.plots.figure_files.save_figures`.
    """
    worst = table.rows.iloc[int(table.rows["rms_px"].to_numpy(float).argmax())]
    setting = LensSetting(float(worst["zoom"]), float(worst["focus"]))
    calibration = calibration_of(recording, setting, options)
    at = f"zoom {setting.zoom:g}, focus {setting.focus:g}"
    names = [f"{at}: view {number}" for number in range(len(calibration.poses))]
    return [*save_table_figures(table, folder), *save_figures(calibration, names, folder)]


def save_table_figures(table: CalibrationTable, folder: Path) -> list[Path]:
    """Save the figures of a calibrated lens as PNG files.

    Parameters
    ----------
    table
        The calibrations of all settings.
    folder
        Where to; made when it is missing. Files of the same names are replaced.

    Returns
    -------
    list of Path
        ``table.png``, and ``robot-slips.png`` where a robot's poses were used.

    Raises
    ------
    FileError
        When the folder cannot be made or written to.
    """
    figures = {
        "table.png": draw_table(Figure(figsize=(15, 8.5), layout="constrained"), table),
    }
    if any(_robot(entry) for entry in table.evidence):
        slips = draw_slips(Figure(figsize=(15, 7.5), layout="constrained"), table)
        figures["robot-slips.png"] = slips
    return [save_figure(figure, make_folder(folder) / name) for name, figure in figures.items()]


class _Panel(NamedTuple):
    """What one panel of the table shows."""

    label: str
    unit: str
    values: FloatArray

    @property
    def whole(self) -> bool:
        return self.unit == "corners"

    def title(self, table: CalibrationTable) -> str:
        if not np.isfinite(self.values).any():
            return f"{self.label}\nnot known"
        if not (self.values > 0).any():
            return f"{self.label}\nnone"
        row = table.rows.iloc[int(np.nanargmax(self.values))]
        worst = f"{np.nanmax(self.values):.3g} {self.unit}"
        return f"{self.label}\nworst: {worst} at zoom {row['zoom']:g}, focus {row['focus']:g}"


def _panels(table: CalibrationTable) -> list[_Panel]:
    rows = table.rows
    columns = {
        ("rms of the residuals", "px"): rows["rms_px"],
        ("σ of d/D", "% of d/D"): 100 * rows["sigma_magnification"] / rows["magnification"],
        ("σ of D", "% of D"): 100 * rows["sigma_object_distance_mm"] / rows["object_distance_mm"],
        ("rejected corners", "corners"): rows["rejected_corners"],
        ("σ of the standoff", "mm"): rows["sigma_standoff_mm"],
        ("σ of the nodal offset", "mm"): rows["sigma_nodal_offset_mm"],
    }
    return [_Panel(*name, column.to_numpy(np.float64)) for name, column in columns.items()]


def _draw_settings(axes: Axes, table: CalibrationTable, panel: _Panel) -> None:
    highest = float(np.nanmax(panel.values, initial=0.0))
    if panel.whole or highest == 0.0:
        highest = max(highest, 1.0)
    dots = axes.scatter(
        table.rows["zoom"],
        table.rows["focus"],
        c=panel.values,
        s=float(np.clip(5000 / max(len(table), 1), 12, 200)),
        marker="s",
        cmap=_COLOURS,
        vmin=0.0,
        vmax=highest,
        edgecolors="white",
        linewidths=0.6,
        plotnonfinite=True,
    )
    known = bool(np.isfinite(panel.values).any())
    ticks: MaxNLocator | list[float] = MaxNLocator(6, integer=panel.whole) if known else []
    axes.figure.colorbar(dots, ax=axes, label=panel.unit, ticks=ticks)
    for failure in table.failures:
        axes.plot(failure.zoom, failure.focus, "x", color=_LOST, markersize=9)
    axes.set(xlabel="zoom setting", ylabel="focus setting")
    axes.set_title(panel.title(table), fontsize=10)
    axes.margins(0.08)


class _Slips(NamedTuple):
    """Slips of all views of a table, one after the other; NaN where a pose was not used."""

    rotations_rad: FloatArray
    translations_mm: FloatArray
    sigma_rad: FloatArray
    sigma_mm: FloatArray
    first_views: list[int]

    @classmethod
    def of(cls, table: CalibrationTable) -> _Slips:
        known = [robot for entry in table.evidence if (robot := _robot(entry))]
        if not known:
            raise InputError(
                "there are no slips to draw: no robot's poses went into the table; calibrate a "
                "recording that holds some, and let them be used"
            )
        slips: list[list[float]] = []
        sigma: list[list[float]] = []
        first_views: list[int] = []
        for entry in table.evidence:
            first_views.append(len(slips))
            robot = _robot(entry)
            views = [None] * len(entry["poses"]) if robot is None else robot["slips"]
            slips += [[np.nan] * 6 if slip is None else slip for slip in views]
            # Where one setting did without, the others still say what the robot does.
            told = known[0] if robot is None else robot
            sigma += [[told["repeatability_rad"], told["repeatability_mm"]]] * len(views)
        values = np.array(slips, dtype=np.float64)
        sigmas = np.array(sigma, dtype=np.float64)
        return cls(values[:, :3], values[:, 3:], sigmas[:, 0], sigmas[:, 1], first_views)

    @property
    def unused(self) -> BoolArray:
        """Views whose pose was not used."""
        return np.asarray(np.isnan(self.rotations_rad).any(axis=1))


def _robot(entry: Json) -> Json | None:
    """Give what a robot's poses contributed; tables of the first version know nothing of it."""
    robot: Json | None = entry.get("robot")
    return robot


def _draw_components(axes: Axes, values: FloatArray, sigma: FloatArray) -> None:
    """Draw (V, 3) slips over their bands."""
    views = np.arange(len(values))
    for factor, grey in _BANDS:
        # One step further at either end, so that the bands of the outer views are whole.
        edges = np.r_[views[0] - 0.5, views + 0.5]
        limit = factor * np.r_[sigma[0], sigma]
        axes.fill_between(edges, -limit, limit, step="pre", color=grey, linewidth=0)
    size = float(np.clip(900 / len(values), 2.0, 6.0))
    for axis, (name, colour, marker) in enumerate(_AXES):
        axes.plot(
            views, values[:, axis], marker, color=colour, markersize=size, linewidth=0, label=name
        )
    (unused,) = np.nonzero(np.isnan(values).any(axis=1))
    axes.plot(
        unused, np.full(len(unused), 0.03), "x", color=_LOST, transform=axes.get_xaxis_transform()
    )
    axes.axhline(0.0, color="0.4", linewidth=0.6)
    highest = max(float(np.nanmax(np.abs(values))), 3 * float(sigma.max()))
    axes.set(xlim=(-0.5, len(values) - 0.5), ylim=(-1.15 * highest, 1.15 * highest))


def _label_settings(axes: Axes, table: CalibrationTable, first_views: list[int]) -> None:
    """Name some settings at their first views."""
    stride = -(-len(first_views) // _LABELLED)
    rows = list(zip(table.rows["zoom"], table.rows["focus"], strict=True))[::stride]
    labels = [f"{zoom:g}, {focus:g}" for zoom, focus in rows]
    axes.set_xticks(first_views[::stride], labels, rotation=45, ha="right", rotation_mode="anchor")
    axes.set_xlabel("view, in the order of the settings (zoom, focus)")


def _legend(unused: bool) -> list[Artist]:
    dots: list[Artist] = [
        Line2D([], [], color=colour, marker=marker, linewidth=0, label=f"{name} of the hand")
        for name, colour, marker in _AXES
    ]
    bands = [Patch(color=grey, label=f"±{factor} σ") for factor, grey in reversed(_BANDS)]
    lost = [Line2D([], [], color=_LOST, marker="x", linewidth=0, label="pose not used")]
    return dots + bands + (lost if unused else [])
