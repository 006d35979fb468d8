"""The files that figures of calibrations are saved as, laid out on pages, and their folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from lenscal.calibration.calibration import Calibration
from lenscal.document import reason
from lenscal.errors import FileError, InputError
from lenscal.plots.calibration import (
    draw_projection_uncertainty,
    draw_residual_histogram,
    draw_residuals_over_image,
    draw_view_residuals,
)

_VIEWS_A_PAGE, _COLUMNS = 9, 3
_DPI: Final = 150


def draw_summary(figure: Figure, calibration: Calibration) -> Figure:
    """Lay out the residuals over the image, their distribution, and the projection uncertainty.

    Parameters
    ----------
    figure
        Where to draw; about three times as wide as high.
    calibration
        A calibration. Without covariance, its projection uncertainty is left out.

    Returns
    -------
    Figure
        The same figure.
    """
    panels = figure.subplots(1, 2 + (calibration.quantity_covariance is not None))
    sensor = calibration.camera.sensor
    panels[1].set_box_aspect(sensor.height_px / sensor.width_px)
    draw_residuals_over_image(panels[0], calibration)
    draw_residual_histogram(panels[1], calibration)
    for axes in panels[2:]:
        draw_projection_uncertainty(axes, calibration)
    used = sum(int(mask.sum()) for mask in calibration.inliers)
    rejected = sum(int((~mask).sum()) for mask in calibration.inliers)
    views = sum(bool(mask.any()) for mask in calibration.inliers)
    figure.suptitle(
        f"{used} corners in {views} views, {rejected} rejected, "
        f"rms distance {calibration.rms_px:.3g} px"
    )
    return figure


def draw_views(calibration: Calibration, names: Sequence[str]) -> list[Figure]:
    """Draw the residuals of every view, some to a page.

    Parameters
    ----------
    calibration
        The calibration.
    names
        What the views are called.

    Returns
    -------
    list of Figure
        The pages.

    Raises
    ------
    InputError
        When there is not one name a view.
    """
    if len(names) != len(calibration.pixels):
        raise InputError(
            f"{len(names)} names were given for {len(calibration.pixels)} views; give one each"
        )
    sensor = calibration.camera.sensor
    pages = []
    for views in np.array_split(np.arange(len(names)), -(-len(names) // _VIEWS_A_PAGE)):
        rows = -(-len(views) // _COLUMNS)
        height = rows * (4.0 * sensor.height_px / sensor.width_px + 0.9) + 0.5
        page = Figure(figsize=(4.8 * _COLUMNS, height), layout="constrained")
        panels = page.subplots(rows, _COLUMNS, squeeze=False).ravel()
        for axes, view in zip(panels, views, strict=False):
            draw_view_residuals(axes, calibration, int(view), names[view])
        for axes in panels[len(views) :]:
            axes.set_axis_off()
        page.suptitle(
            "Residuals, from observed to predicted corners; circles: rejected, with length in px"
        )
        pages.append(page)
    return pages


def make_folder(folder: Path) -> Path:
    """Make a folder for figures, if it is not there.

    Parameters
    ----------
    folder
        The folder.

    Returns
    -------
    Path
        The same.

    Raises
    ------
    FileError
        When it is a file, or cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise FileError(
            f"figures are written to a folder, but {folder} is a file; name another place"
        ) from error
    except OSError as error:
        raise FileError(f"cannot make the folder {folder} for figures: {reason(error)}") from error
    return folder


def save_figures(calibration: Calibration, names: Sequence[str], folder: Path) -> list[Path]:
    """Save the summary of a calibration and the residuals of its views as PNG files.

    Parameters
    ----------
    calibration
        The calibration.
    names
        What the views are called.
    folder
        Where to; made when it is missing. Files of the same names are replaced.

    Returns
    -------
    list of Path
        ``summary.png``, ``views-1.png``, ``views-2.png`` …

    Raises
    ------
    FileError
        When the folder cannot be made or written to.
    InputError
        When there is not one name a view.
    """
    summary = Figure(figsize=(15, 5.2), layout="constrained")
    draw_summary(summary, calibration)
    pages = draw_views(calibration, names)
    figures = {"summary.png": summary} | {
        f"views-{number}.png": page for number, page in enumerate(pages, 1)
    }
    return [save_figure(figure, make_folder(folder) / name) for name, figure in figures.items()]


def save_figure(figure: Figure, path: Path) -> Path:
    """Save a figure.

    Parameters
    ----------
    figure
        The figure.
    path
        Where to, in a folder that is there; the end of its name says in which format.

    Returns
    -------
    Path
        The same.

    Raises
    ------
    FileError
        When it cannot be written.
    """
    try:
        figure.savefig(path, dpi=_DPI)
    except OSError as error:
        raise FileError(f"cannot write {path}: {reason(error)}") from error
    return path
