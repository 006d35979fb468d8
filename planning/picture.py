"""One picture of a visibility region: in space, from far and near, and in two sections."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh
from manifold3d import Manifold
from matplotlib.figure import Figure

from lenscal.arrays import FloatArray, frozen_array
from planning.boolean import from_manifold, to_manifold
from planning.layers import Layer
from planning.preview import Preview
from planning.raycast import render
from planning.scene import Scene
from planning.sections import draw_section, part_reach_mm, section_axes
from planning.target import Target
from planning.visibility.region import Region

_DPI: Final = 110


def save_picture(
    path: Path | str,
    preview: Preview,
    scene: Scene,
    target: Target,
    region: Region,
    view_px: tuple[int, int] = (640, 560),
) -> Path:
    """Draw a region in space and in sections, as PNG.

    Parameters
    ----------
    path
        The file.
    preview
        The layers.
    scene
        The part and what stands about it.
    target
        The target through whose centre the sections go.
    region
        The region.
    view_px
        Width and height of each view in space.

    Returns
    -------
    Path
        The file.
    """
    path = Path(path)
    right, up = section_axes(target)
    aside = np.cross(right, up)
    towards = 0.8 * aside + 0.75 * right + 0.7 * up
    near = [layer for layer in preview.layers if layer.role in ("part", "target")]
    figure = Figure(figsize=(13, 11.2), layout="constrained")
    far_axes, near_axes, whole_axes, part_axes = figure.subplots(2, 2).flat
    views = (
        (far_axes, preview.layers, None, "All of the region"),
        (
            near_axes,
            cut_away(preview.layers, target.centroid_mm, aside),
            near,
            "The part, cut through the centre of the target",
        ),
    )
    for axes, layers, fit, title in views:
        axes.imshow(render(layers, towards, view_px, fit, up))
        axes.set_axis_off()
        axes.set_title(title)
    for axes, reach, title in (
        (whole_axes, None, "Section across the target's longest side"),
        (part_axes, part_reach_mm(scene, target), "The same, near the part"),
    ):
        draw_section(axes, scene, target, region, right, reach)
        axes.set_title(title)
    whole_axes.legend(loc="best", frameon=False)
    figure.suptitle(f"{preview.title}   ({'; '.join(_first_facts(preview))})", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=_DPI)
    return path


def cut_away(
    layers: Sequence[Layer], point_mm: npt.ArrayLike, normal: npt.ArrayLike
) -> list[Layer]:
    """Take away what lies on one side of a plane, so that the inside is seen.

    Parameters
    ----------
    layers
        The layers; solids are cut and stay closed, workspaces stay whole.
    point_mm
        (3,) a point of the plane in mm.
    normal
        (3,) the side that is taken away.

    Returns
    -------
    list of Layer
        What is left.
    """
    point = frozen_array("point_mm", point_mm, (3,))
    away = frozen_array("normal", normal, (3,))
    away = away / np.linalg.norm(away)
    kept = []
    for layer in layers:
        if layer.role == "workspace":
            kept.append(layer)
            continue
        if not layer.is_closed:
            vertices, faces, *_ = trimesh.intersections.slice_faces_plane(
                layer.vertices_mm, layer.faces, -away, point
            )
            if len(faces):
                kept.append(_with_faces(layer, vertices, faces))
            continue
        solid = to_manifold(layer.name, layer.vertices_mm - point, layer.faces)
        rest: Manifold = solid.trim_by_plane((-away).tolist(), 0.0)
        if not rest.is_empty():
            vertices, faces = from_manifold(rest)
            kept.append(_with_faces(layer, vertices + point, faces))
    return kept


def _with_faces(layer: Layer, vertices: FloatArray, faces: npt.NDArray[np.int64]) -> Layer:
    return Layer(
        layer.name,
        vertices,
        faces,
        colour=layer.colour,
        opacity=layer.opacity,
        is_visible=layer.is_visible,
        is_closed=layer.is_closed,
        role=layer.role,
        group=layer.group,
    )


def _first_facts(preview: Preview) -> list[str]:
    shown = []
    for name, value in preview.facts:
        if name in ("target", "region"):
            shown.append(f"{name} {value}")
    return shown
