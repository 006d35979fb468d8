"""Figures of a plan: the section through the feature, which reads best, and the view in space."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from manifold3d import Manifold
from matplotlib.patches import Annulus

from lenscal.arrays import FloatArray
from planning.boolean import from_manifold, to_manifold
from planning.planner import Plan
from planning.sections import draw_target, fill_section, named_direction
from planning.solid import Solid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Colours of Okabe and Ito, which people tell apart whatever their colour vision.
_PART: Final = "#4d4d4d"
_TARGET: Final = "#d55e00"
_REGION: Final = "#56b4e9"
_RING: Final = "#e69f00"
_VIEWPOINT: Final = "#0072b2"
#: How much more than the ring is shown.
_ROOM: Final = 1.08


def plot_section(axes: Axes, plan: Plan, reach_mm: float | None = None) -> Axes:
    """Draw the plane through the feature's midpoint in which the projection centres lie.

    Parameters
    ----------
    axes
        Plain axes.
    plan
        The plan; without a region only part and ring are drawn.
    reach_mm
        How far from the feature to draw, in mm; None for all of the ring. A small one shows the
        part.

    Returns
    -------
    Axes
        The same axes, in mm from the midpoint of the feature.
    """
    across, up = _section_axes(plan)
    plane = np.stack([across, up, np.cross(across, up)])
    middle = plan.ring.midpoint_mm
    if plan.region is not None and not plan.region.is_empty:
        fill_section(
            axes, [plan.region.solid], plane, middle, _REGION, 0.35, "sees the whole target"
        )
    bounds = plan.settings.object_distance_bounds_mm
    reach = _reach(plan) if reach_mm is None else reach_mm
    if bounds is not None and np.isfinite(bounds[1]):
        label = f"ring, D {bounds[0]:.0f} to {bounds[1]:.0f} mm"
        ring = Annulus((0, 0), bounds[1], bounds[1] - bounds[0], fc=_RING, alpha=0.3, label=label)
        axes.add_patch(ring)
    fill_section(axes, plan.scene.bodies, plane, middle, _PART, 1.0, "part")
    draw_target(axes, plan.task.target, plane, middle)
    places = (_positions(plan) - middle) @ plane[:2].T
    for x, y in places:
        axes.plot([0, x], [0, y], color=_VIEWPOINT, linewidth=0.5, alpha=0.5)
    if len(places):
        axes.plot(*places.T, "o", color=_VIEWPOINT, markersize=4, label=f"{len(places)} viewpoints")
    axes.set_aspect("equal")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach / 2 if reach_mm else -0.12 * reach, reach)
    axes.set_xlabel(f"{named_direction(across)} from the feature (mm)")
    axes.set_ylabel(f"{named_direction(up)} from the feature (mm)")
    axes.set_title("Section through the feature's midpoint, perpendicular to it")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3, frameon=False)
    return axes


def plot_plan(axes: Any, plan: Plan) -> Any:
    """Draw part, target, region, ring and viewpoints in space.

    Parameters
    ----------
    axes
        Three-dimensional axes (``projection="3d"``).
    plan
        The plan; without a region it is left out.

    Returns
    -------
    Axes3D
        The same axes, in mm in the part's frame.
    """
    reach, middle = _reach(plan), plan.ring.midpoint_mm
    shown_points: list[FloatArray] = []
    if plan.region is not None and not plan.region.is_empty:
        shown = _clipped(plan.region.solid, middle, reach)
        shown_points.append(shown.vertices_mm)
        axes.plot_trisurf(
            *shown.vertices_mm.T,
            triangles=shown.faces,
            color=_REGION,
            alpha=0.25,
            linewidth=0,
            label="sees the whole target",
        )
    for body in plan.scene.bodies:
        axes.plot_trisurf(
            *body.vertices_mm.T, triangles=body.faces, color=_PART, alpha=0.6, linewidth=0
        )
    target = plan.task.target.vertices_mm
    axes.plot(*target[np.r_[0 : len(target), 0]].T, color=_TARGET, linewidth=2, label="target")
    bounds = plan.settings.object_distance_bounds_mm
    angles = np.linspace(-np.pi / 2, np.pi / 2, 181)
    if bounds is not None and plan.ring.is_full:
        for distance, label in zip(bounds, ("ring, smallest and largest D", None), strict=True):
            circle = plan.ring.positions(min(distance, reach), angles)
            shown_points.append(circle)
            axes.plot(*circle.T, color=_RING, linewidth=1.5, label=label)
    places = _positions(plan)
    for place in places:
        axes.plot(*np.stack([middle, place]).T, color=_VIEWPOINT, linewidth=0.6, alpha=0.6)
    if len(places):
        label = f"{len(places)} viewpoints"
        axes.plot(*places.T, "o", color=_VIEWPOINT, markersize=4, label=label)
    drawn = np.concatenate([*shown_points, places, plan.scene.bounds_mm])
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low)
    axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    for axis in "xyz":
        axes.locator_params(axis=axis, nbins=max(2, round(7 * _share(low, high, axis))))
    axes.view_init(elev=22, azim=-28)
    axes.legend(loc="upper left", frameon=False)
    return axes


def _share(low: FloatArray, high: FloatArray, axis: str) -> float:
    """Length of a side of the box that is drawn, as a share of its longest."""
    sides = high - low
    return float(sides["xyz".index(axis)] / sides.max())


def _clipped(solid: Solid, middle: FloatArray, reach: float) -> Solid:
    cube = Manifold.cube([2 * reach] * 3, center=True).translate(middle)
    return Solid(*from_manifold(to_manifold("the region", solid.vertices_mm, solid.faces) ^ cube))


def _section_axes(plan: Plan) -> tuple[FloatArray, FloatArray]:
    across = plan.ring.axes[1]
    main = np.argmax(np.abs(across))
    return (across if across[main] > 0 else -across), plan.ring.axes[0]


def _reach(plan: Plan) -> float:
    """How far from the feature there is something to show, in mm."""
    bounds = plan.settings.object_distance_bounds_mm
    if bounds is not None and np.isfinite(bounds[1]):
        return _ROOM * bounds[1]
    corners = plan.scene.bounds_mm - plan.ring.midpoint_mm
    return 3 * float(np.abs(corners).max())


def _positions(plan: Plan) -> FloatArray:
    places: FloatArray = plan.viewpoints[["x_mm", "y_mm", "z_mm"]].to_numpy(dtype=np.float64)
    return places
