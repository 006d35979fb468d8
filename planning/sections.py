"""Sections: what a plane cuts of part, target and region, drawn flat."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
import trimesh
from matplotlib.collections import LineCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from lenscal.arrays import FloatArray, frozen_array
from planning.body import Body
from planning.boolean import to_manifold
from planning.preview import REGION_COLOUR, TARGET_COLOUR
from planning.scene import Scene
from planning.solid import Solid
from planning.target import Target
from planning.visibility.region import Region

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PART_COLOUR: Final = "#4d4d4d"
#: How far around the part a section reaches that shows the part, in units of its size.
_ROOM: Final = 0.65


def draw_section(
    axes: Axes,
    scene: Scene,
    target: Target,
    region: Region,
    across: npt.ArrayLike | None = None,
    reach_mm: float | None = None,
) -> Axes:
    """Draw the plane through the target's centre that holds its normal and a direction on it.

    Parameters
    ----------
    axes
        Plain axes.
    scene
        The part and what stands about it.
    target
        The target; of a segment, the plane holds it.
    region
        Its region.
    across
        (3,) the direction that runs to the right; by default across the longest side of the
        target, so that the section is perpendicular to it.
    reach_mm
        How far from the centre to draw, in mm; None for all of the region.

    Returns
    -------
    Axes
        The same axes, in mm from the centre of the target.
    """
    right, up = section_axes(target, across)
    plane = np.stack([right, up, np.cross(right, up)])
    middle = target.centroid_mm
    if not region.is_empty:
        fill_section(axes, [region.solid], plane, middle, REGION_COLOUR, 0.45, "sees all of it")
    fill_section(axes, scene.bodies, plane, middle, PART_COLOUR, 1.0, "part")
    draw_target(axes, target, plane, middle)
    if reach_mm is None:
        corners = region.workspace.vertices_mm if region.is_empty else region.solid.vertices_mm
        shown = np.concatenate([corners, scene.bounds_mm]) - middle
        flat = shown @ plane[:2].T
        low, high = flat.min(axis=0), flat.max(axis=0)
        room = 0.04 * float(np.max(high - low))
    else:
        low, high, room = np.full(2, -reach_mm), np.full(2, reach_mm), 0.0
    axes.set_aspect("equal")
    axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))
    axes.set_xlabel(f"{named_direction(right)} from the centre of the target (mm)")
    axes.set_ylabel(f"{named_direction(up)} (mm)")
    return axes


def part_reach_mm(scene: Scene, target: Target) -> float:
    """Tell how far a section must reach to show the part.

    Parameters
    ----------
    scene
        The part and what stands about it.
    target
        The target, whose centre is the middle of sections.

    Returns
    -------
    float
        In mm.
    """
    corners = scene.bounds_mm - target.centroid_mm
    farthest = float(np.abs(corners).max())
    return min(2 * farthest, farthest * (1 + _ROOM / 4))


def section_axes(
    target: Target, across: npt.ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """Choose the directions of a section.

    Parameters
    ----------
    target
        The target.
    across
        (3,) what runs to the right; None to choose.

    Returns
    -------
    right : FloatArray
        (3,) unit vector in the plane of the target; along a segment.
    up : FloatArray
        (3,) its normal; of a segment, across it, as near to z as may be.
    """
    outline = target.outline_mm
    if target.is_segment:
        along = outline[1] - outline[0]
        right = along / np.linalg.norm(along)
        helper = np.array([0.0, 0.0, 1.0]) if abs(right[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
        up = helper - (helper @ right) * right
        return _pointing_ahead(right), up / np.linalg.norm(up)
    up = target.normal
    if across is None:
        sides = np.roll(outline, -1, axis=0) - outline
        longest = sides[np.argmax(np.linalg.norm(sides, axis=-1).round(9))]
        wanted = np.cross(up, longest)
    else:
        wanted = frozen_array("across", across, (3,))
    right = wanted - (wanted @ up) * up
    return _pointing_ahead(right / np.linalg.norm(right)), up


def fill_section(
    axes: Axes,
    solids: Sequence[Solid],
    plane: FloatArray,
    middle: FloatArray,
    colour: str,
    alpha: float,
    label: str,
) -> None:
    """Fill what a plane cuts of solids, and draw what it cuts of bare faces.

    Parameters
    ----------
    axes
        Plain axes.
    solids
        Solids, and bodies that may be bare faces.
    plane
        (3, 3) rows: to the right, up, towards the viewer.
    middle
        (3,) a point of the plane in mm, the origin of the drawing.
    colour, alpha
        How it looks.
    label
        For the legend.
    """
    points, codes = [], []
    for solid in solids:
        local = (solid.vertices_mm - middle) @ plane.T
        if isinstance(solid, Body) and not solid.is_closed:
            _draw_cut(axes, local[solid.faces], colour)
            continue
        # Loops around holes run the other way, so that they stay free.
        for loop in to_manifold("the section", local, solid.faces).slice(0.0).to_polygons():
            points.append(np.concatenate([loop, loop[:1]]))
            steps = np.full(len(loop) + 1, Outline.LINETO)
            steps[0], steps[-1] = Outline.MOVETO, Outline.CLOSEPOLY
            codes.append(steps)
    if points:
        outline = Outline(np.concatenate(points), np.concatenate(codes))
        axes.add_patch(PathPatch(outline, facecolor=colour, alpha=alpha, label=label, linewidth=0))


def draw_target(axes: Axes, target: Target, plane: FloatArray, middle: FloatArray) -> None:
    """Draw a target as it is seen edge-on.

    Parameters
    ----------
    axes
        Plain axes.
    target
        The target.
    plane
        (3, 3) rows: to the right, up, towards the viewer.
    middle
        (3,) the origin of the drawing in mm.
    """
    flat = (target.vertices_mm - middle) @ plane[:2].T
    ends = flat[[flat[:, 0].argmin(), flat[:, 0].argmax()]]
    axes.plot(*ends.T, color=TARGET_COLOUR, linewidth=4, solid_capstyle="butt", label="target")


def named_direction(vector: FloatArray) -> str:
    """Name a direction.

    Parameters
    ----------
    vector
        (3,) unit vector.

    Returns
    -------
    str
        Such as "y", "-z", or the components.
    """
    main = int(np.argmax(np.abs(vector)))
    if np.abs(vector[main]) > 1 - 1e-9:
        return f"{'-' if vector[main] < 0 else ''}{'xyz'[main]}"
    return f"along ({', '.join(f'{v:.2f}' for v in vector)})"


def _draw_cut(axes: Axes, triangles: FloatArray, colour: str) -> None:
    """Draw the line along which the plane z = 0 cuts bare faces."""
    mesh = trimesh.Trimesh(
        triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=False
    )
    lines = trimesh.intersections.mesh_plane(mesh, [0.0, 0.0, 1.0], [0.0, 0.0, 0.0])
    axes.add_collection(LineCollection(lines[:, :, :2], colors=colour, linewidths=1.5))


def _pointing_ahead(vector: FloatArray) -> FloatArray:
    return vector if vector[np.argmax(np.abs(vector))] > 0 else -vector
