"""What a picture in space is made of: named layers of faces and lines, each with its look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.errors import InputError

Role = Literal["part", "target", "region", "workspace", "other"]

#: Edges where the surface bends by less are not drawn.
_BEND_RAD: Final = np.radians(12.0)


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """Faces, lines, or both, that are shown and hidden together.

    Parameters
    ----------
    name
        What people call it; it names the node in a GLB file.
    vertices_mm
        (V, 3) corners in mm.
    faces
        (F, 3) indices of the corners of each triangle.
    lines
        (L, 2) indices of the ends of each line; by default the edges where the faces bend.
    colour
        Such as "#56b4e9".
    opacity
        1 opaque, 0 not seen.
    is_visible
        Whether it is shown at first.
    is_closed
        Whether the faces bound a solid, so that a section through it is filled.
    role
        What it means; viewers treat region and target apart.
    group
        Layers of one group stand together.

    Raises
    ------
    InputError
        When the colour is not written as "#rrggbb", or the opacity is not between 0 and 1.
    """

    name: str
    vertices_mm: FloatArray
    faces: IntArray
    lines: IntArray | None = None
    colour: str = "#999999"
    opacity: float = 1.0
    is_visible: bool = True
    is_closed: bool = False
    role: Role = "other"
    group: str = ""

    def __post_init__(self) -> None:
        vertices = frozen_array("vertices_mm", self.vertices_mm, ("V", 3))
        faces = np.array(self.faces, dtype=np.int64).reshape(-1, 3)
        lines = bent_edges(vertices, faces) if self.lines is None else self.lines
        digits = self.colour.removeprefix("#")
        if len(self.colour) != 7 or len(digits) != 6 or set(digits) - set("0123456789abcdefABCDEF"):
            raise InputError(
                f"the colour of layer {self.name} must be written as '#rrggbb', but is "
                f"{self.colour!r}"
            )
        if not 0 <= self.opacity <= 1:
            raise InputError(
                f"the opacity of layer {self.name} must lie between 0 and 1 (opaque), but is "
                f"{self.opacity:g}"
            )
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "lines", np.array(lines, dtype=np.int64).reshape(-1, 2))

    @property
    def drawn_lines(self) -> IntArray:
        """(L, 2) indices of the ends of each line."""
        return np.zeros((0, 2), dtype=np.int64) if self.lines is None else self.lines

    @property
    def rgb(self) -> FloatArray:
        """(3,) colour, each from 0 to 1."""
        return np.array([int(self.colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])


def bounds_of(layers: Sequence[Layer]) -> FloatArray:
    """Measure what layers fill.

    Parameters
    ----------
    layers
        The layers; at least one.

    Returns
    -------
    FloatArray
        (2, 3) lowest and highest corner in mm.
    """
    points = np.concatenate([layer.vertices_mm for layer in layers])
    return np.stack([points.min(axis=0), points.max(axis=0)])


def bent_edges(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> IntArray:
    """Find the edges of a surface that a drawing of it shows.

    Parameters
    ----------
    vertices
        (V, 3) corners.
    faces
        (F, 3) indices.

    Returns
    -------
    IntArray
        (L, 2) ends of the edges where faces meet at an angle, and of those that only one has.
    """
    corners, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces).reshape(-1, 3)
    if not len(triangles):
        return np.zeros((0, 2), dtype=np.int64)
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = normals / np.where(length > 0, length, 1.0)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=-1).reshape(-1, 2)
    owner = np.repeat(np.arange(len(triangles)), 3)
    key = edges[:, 0] * len(corners) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    # The faces that share an edge stand next to each other now.
    here, there = owner[order[first]], owner[order[first + (count > 1)]]
    cosine = np.einsum("ei,ei->e", normals[here], normals[there])
    drawn: IntArray = edges[order[first]][(count != 2) | (cosine < np.cos(_BEND_RAD))]
    return drawn
