"""Writes previews: a GLB file for other programs, and one page that opens without a network."""

from __future__ import annotations

import base64
import html
import json
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import trimesh

from lenscal.document import write_whole
from planning.layers import Layer
from planning.preview import Preview

_MM_PER_METRE: Final = 1000.0


def write_glb(path: Path | str, preview: Preview) -> Path:
    """Write the faces of a preview as GLB, in metres as that format demands.

    The axes are those of the part, so that positions can be compared; programs that take y for up
    show it lying on its side.

    Parameters
    ----------
    path
        The file.
    preview
        What to write. Every layer becomes a node of its name, beneath one of the name of its group.

    Returns
    -------
    Path
        The file.
    """
    path = Path(path)
    scene = trimesh.Scene()
    scene.metadata.update({"unit": "m", "title": preview.title, "facts": list(preview.facts)})
    for group in dict.fromkeys(layer.group for layer in preview.layers if layer.group):
        scene.graph.update(group, scene.graph.base_frame)
    for layer in preview.layers:
        if not len(layer.faces):
            continue
        mesh = trimesh.Trimesh(layer.vertices_mm / _MM_PER_METRE, layer.faces, process=False)
        mesh.visual = trimesh.visual.TextureVisuals(material=_material(layer))
        scene.add_geometry(
            mesh, node_name=layer.name, geom_name=layer.name, parent_node_name=layer.group or None
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(scene.export(file_type="glb"))
    return path


def write_html(path: Path | str, preview: Preview) -> Path:
    """Write a preview as one page that holds all it needs.

    Parameters
    ----------
    path
        The file.
    preview
        What to show.

    Returns
    -------
    Path
        The file.
    """
    path = Path(path)
    template = resources.files("planning").joinpath("viewer.html").read_text(encoding="utf-8")
    # "<" cannot end the element that holds the data when it is written as an escape.
    data = json.dumps(_page_data(preview), separators=(",", ":")).replace("<", "\\u003c")
    page = template.replace("@TITLE@", html.escape(preview.title), 1).replace("@DATA@", data, 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(path, page)


def _material(layer: Layer) -> trimesh.visual.material.PBRMaterial:
    return trimesh.visual.material.PBRMaterial(
        name=layer.name,
        baseColorFactor=[*layer.rgb, layer.opacity],
        metallicFactor=0.0,
        roughnessFactor=0.8,
        alphaMode="OPAQUE" if layer.opacity == 1 else "BLEND",
        doubleSided=True,
    )


def _page_data(preview: Preview) -> dict[str, Any]:
    # Positions are kept about the target, where single precision is finest.
    origin = np.asarray(preview.target_mm)

    def about(point: npt.ArrayLike) -> list[float]:
        return [float(v) for v in np.asarray(point) - origin]

    return {
        "title": preview.title,
        "unit": "mm",
        "origin": origin.tolist(),
        "target": about(preview.target_mm),
        "viewpoint": None if preview.viewpoint_mm is None else about(preview.viewpoint_mm),
        "facts": [list(fact) for fact in preview.facts],
        "labels": [{"text": text, "at": about(place)} for text, place in preview.labels],
        "layers": [
            {
                "name": layer.name,
                "group": layer.group,
                "role": layer.role,
                "colour": layer.colour,
                "opacity": layer.opacity,
                "visible": layer.is_visible,
                "closed": layer.is_closed,
                "points": _packed(layer.vertices_mm - origin, "<f4"),
                "faces": _packed(layer.faces, "<u4"),
                "lines": _packed(layer.drawn_lines, "<u4"),
            }
            for layer in preview.layers
        ],
    }


def _packed(array: npt.NDArray[Any], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode("ascii")
