"""Figures 1 to 8 of the paper for any polygon: what it hides, and how that is put together."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from lenscal.arrays import FloatArray
from planning.solid import Solid, box_workspace
from planning.target import Target
from planning.visibility.polygon_regions import Step, occlusion_steps
from planning.visibility.sheet import Sheet

# Colours of Okabe and Ito, which people tell apart whatever their colour vision.
_MATERIAL: Final = "#4d4d4d"
_TARGET: Final = "#d55e00"
_HIDDEN: Final = "#999999"
_SEEN: Final = "#56b4e9"
#: Angle in rad above which the edge between two faces is drawn.
_CREASE: Final = 1e-3


def plot_step(
    axes: Any, step: Step, target: Target, bounds_mm: FloatArray, whole_hull: bool = False
) -> Any:
    """Draw a polygon or hole, the target, and the region that it hides or shows.

    Parameters
    ----------
    axes
        Three-dimensional axes (``projection="3d"``).
    step
        What to draw, of `occlusion_steps`.
    target
        The target.
    bounds_mm
        (2, 3) lowest and highest corner of what is shown; an equivalent hole goes on beyond.
    whole_hull
        Whether to draw the convex hull and its region instead.

    Returns
    -------
    Axes3D
        The same axes, in mm.
    """
    region = step.hull_region if whole_hull else step.region
    outline = step.hull_mm if whole_hull else step.outline_mm
    _draw_solid(axes, region, _HIDDEN if step.is_material else _SEEN)
    draw_polygon(axes, outline, bounds_mm, step.is_material)
    return _framed(axes, target, bounds_mm)


def draw_polygon(axes: Any, outline_mm: FloatArray, bounds_mm: FloatArray, filled: bool) -> None:
    """Draw a planar polygon, as far as it lies within bounds along x and y.

    Parameters
    ----------
    axes
        Three-dimensional axes.
    outline_mm
        (N, 3) corners.
    bounds_mm
        (2, 3) lowest and highest corner of what is shown.
    filled
        Whether it is material; a hole is drawn as its outline.
    """
    shown = _within(outline_mm, bounds_mm)
    colour = _MATERIAL if filled else _SEEN
    face = _MATERIAL if filled else "none"
    axes.add_collection3d(
        Poly3DCollection([shown], facecolor=face, edgecolor=colour, linewidth=1.4, alpha=0.85)
    )


def decomposition_figure(steps: list[Step], target: Target, bounds_mm: FloatArray) -> Figure:
    """Draw the first level of a decomposition in six panels.

    Parameters
    ----------
    steps
        The steps of a polygon with a gulf and a hole, for a convex target.
    target
        The target.
    bounds_mm
        (2, 3) lowest and highest corner of what is shown.

    Returns
    -------
    Figure
        Polygon and target; what its hull hides; what the hole shows; the equivalent hole of the
        gulf; what that shows; and what is hidden when both are taken out.
    """
    named = {step.name: step for step in steps}
    material, gulf, hole = (
        named[name] for name in ("material", "material/gulf 0", "material/hole 0")
    )
    figure = Figure(figsize=(11.5, 6.8), layout="constrained")
    panels = [figure.add_subplot(2, 3, k + 1, projection="3d") for k in range(6)]
    sheet = Sheet(material.outline_mm, [hole.outline_mm])
    for axes in (panels[0], panels[3]):
        _draw_sheet(axes, sheet)
        _framed(axes, target, bounds_mm)
    draw_polygon(panels[3], gulf.outline_mm, bounds_mm, filled=False)
    plot_step(panels[1], material, target, bounds_mm, whole_hull=True)
    plot_step(panels[2], hole, target, bounds_mm)
    plot_step(panels[4], gulf, target, bounds_mm)
    _draw_solid(panels[5], material.region, _HIDDEN)
    _draw_sheet(panels[5], sheet)
    _framed(panels[5], target, bounds_mm)
    titles = (
        "a polygon with a hole and a gulf, and the target",
        "what its convex hull hides",
        "what sees the target through the hole",
        "the gulf and its equivalent hole",
        "what sees the target through that",
        "what the polygon hides",
    )
    for number, (axes, title) in enumerate(zip(panels, titles, strict=True), start=1):
        axes.set_title(f"{number}. {title}", fontsize=10)
    return figure


def example_figure() -> Figure:
    """Draw the decomposition of an example after figures 1 to 8.

    Returns
    -------
    Figure
        A plate with a hole and a gulf that widens inside, over a target of 8 mm by 6 mm.
    """
    target = Target(np.array([[-4.0, -3, 0], [4, -3, 0], [4, 3, 0], [-4, 3, 0]]))
    outline = [(-16, -11), (16, -11), (16, 11), (-1, 11), (2, 0), (-2, -3), (-8, 2), (-9, 11)]
    outline.append((-16, 11))
    hole = [(4, -9), (14, -9), (14, 8), (4, 6)]
    workspace = box_workspace((-36, -28, 0), (36, 28, 38))
    loops = [np.column_stack([loop, np.full(len(loop), 12.0)]) for loop in (outline, hole)]
    steps = list(occlusion_steps(loops[0], target, workspace, [loops[1]]))
    return decomposition_figure(steps, target, workspace.bounds_mm)


def _draw_sheet(axes: Any, sheet: Sheet) -> None:
    axes.add_collection3d(
        Poly3DCollection(sheet.triangles_mm, facecolor=_MATERIAL, edgecolor="none", alpha=0.85)
    )
    for loop in (sheet.outline_mm, *sheet.holes_mm):
        axes.plot(*np.concatenate([loop, loop[:1]]).T, color="black", linewidth=1.2)


def _framed(axes: Any, target: Target, bounds_mm: FloatArray) -> Any:
    corners = target.vertices_mm
    axes.add_collection3d(
        Poly3DCollection([corners], facecolor=_TARGET, edgecolor=_TARGET, linewidth=1.0)
    )
    (x0, y0, z0), (x1, y1, z1) = bounds_mm
    axes.set(xlim=(x0, x1), ylim=(y0, y1), zlim=(z0, z1))
    axes.set_box_aspect(bounds_mm[1] - bounds_mm[0], zoom=1.02)
    axes.view_init(elev=22, azim=-62)
    axes.set_axis_off()
    return axes


def _draw_solid(axes: Any, solid: Solid, colour: str) -> None:
    if solid.is_empty:
        return
    mesh = solid.to_mesh()
    creased = mesh.face_adjacency_edges[mesh.face_adjacency_angles > _CREASE]
    axes.add_collection3d(
        Poly3DCollection(mesh.triangles, facecolor=colour, edgecolor="none", alpha=0.22)
    )
    axes.add_collection3d(
        Line3DCollection(mesh.vertices[creased], colors=colour, linewidths=0.7, alpha=0.9)
    )


def _within(outline_mm: FloatArray, bounds_mm: FloatArray) -> FloatArray:
    """Cut a polygon at the bounds along x and y (Sutherland and Hodgman 1974)."""
    polygon = outline_mm
    for axis in (0, 1):
        for limit, sign in zip(bounds_mm[:, axis], (1.0, -1.0), strict=True):
            height = sign * (polygon[:, axis] - limit)
            cut = []
            for k in range(len(polygon)):
                here, there = height[k - 1], height[k]
                if here * there < 0:
                    share = here / (here - there)
                    cut.append(polygon[k - 1] + share * (polygon[k] - polygon[k - 1]))
                if there >= 0:
                    cut.append(polygon[k])
            polygon = np.array(cut).reshape(-1, 3)
            if not len(polygon):
                return polygon
    return polygon
