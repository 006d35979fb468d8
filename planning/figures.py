"""The figures that a demo or a report shows: contours of the map, and the region with the plan."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from lenscal.maps.lens_map import LensMap
from lenscal.plots.maps import draw_contours, draw_limits
from planning.planner import Plan
from planning.plots import plot_plan, plot_section
from planning.requirements.magnification import required_magnification

#: File name of each figure of the map, and what it shows.
MAP_FIGURES: Final = {
    "magnification.png": "magnification",
    "object_distance.png": "object_distance_mm",
    "focal_length.png": "focal_length_mm",
}
_DPI: Final = 130


def save_figures(folder: Path, lens_map: LensMap, plan: Plan) -> list[Path]:
    """Draw the maps with the limits of a plan, and the plan itself.

    Parameters
    ----------
    folder
        Where to write PNG files.
    lens_map
        The map.
    plan
        A plan that was made with it.

    Returns
    -------
    list of Path
        The files.
    """
    limits = {}
    if lens_map.sensor is not None:
        low, high = required_magnification(plan.task.requirements, lens_map.sensor)
        limits[f"resolution limit, d/D = {low:.4f}"] = low
        limits[f"field-of-view limit, d/D = {high:.4f}"] = high
    files = []
    for name, quantity in MAP_FIGURES.items():
        figure = Figure(figsize=(7.2, 5.4), layout="constrained")
        axes = draw_contours(figure.add_subplot(), lens_map, quantity)
        draw_limits(axes, lens_map, "magnification", limits)
        files.append(_save(figure, folder / name))
    figure = Figure(figsize=(13, 6.5), layout="constrained")
    plot_section(figure.add_subplot(1, 2, 1), plan)
    plot_plan(figure.add_subplot(1, 2, 2, projection="3d"), plan)
    files.append(_save(figure, folder / "region.png"))
    return files


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=_DPI)
    return path
