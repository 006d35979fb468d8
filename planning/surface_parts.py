"""The surface of a body in parts that hang together: convex bodies, or convex polygons.

None of it depends on what is looked at, so it is found once for each body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from manifold3d import Manifold
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lenscal.arrays import FloatArray, IntArray
from planning.polygons import merge_convex
from planning.solid import Solid

#: A body whose hull is larger by less than this share of its volume is convex.
_CONVEX: Final = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePart:
    """Faces that hang together.

    Parameters
    ----------
    faces
        (F, 3) indices of their corners.
    is_convex
        Whether they bound a convex body.
    polygons
        Of faces that do not: convex polygons, neighbours in one plane merged, as (N, K) indices of
        corners in order, one array for each number of corners.
    """

    faces: IntArray
    is_convex: bool
    polygons: tuple[IntArray, ...]


def surface_parts(surface: Solid, is_closed: bool) -> tuple[SurfacePart, ...]:
    """Part a surface.

    Parameters
    ----------
    surface
        The surface.
    is_closed
        Whether it bounds a solid; otherwise its faces stay together, and none is a convex body.

    Returns
    -------
    tuple of SurfacePart
        The parts.
    """
    # About the middle and of size one, so that tolerances mean the same wherever a body is.
    low, high = surface.bounds_mm
    vertices = (surface.vertices_mm - (low + high) / 2) / float((high - low).max())
    if not is_closed:
        return (SurfacePart(surface.faces, False, _polygons(vertices, surface.faces)),)
    return tuple(_part(vertices, faces) for faces in connected_faces(surface))


def _part(vertices: FloatArray, faces: IntArray) -> SurfacePart:
    convex = is_convex_body(vertices, faces)
    return SurfacePart(faces, convex, () if convex else _polygons(vertices, faces))


def _polygons(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, ...]:
    loops = merge_convex(vertices, faces)
    sizes = np.array([len(loop) for loop in loops])
    return tuple(
        np.array([loops[i] for i in np.flatnonzero(sizes == size)]) for size in np.unique(sizes)
    )


def connected_faces(body: Solid) -> list[IntArray]:
    """Part the faces of a body that hang together by their vertices.

    Parameters
    ----------
    body
        The body.

    Returns
    -------
    list of IntArray
        (F, 3) indices of each component.
    """
    ends = body.faces[:, [0, 1, 2, 0]]
    start, stop = ends[:, :3].ravel(), ends[:, 1:].ravel()
    count = len(body.vertices_mm)
    graph = coo_array((np.ones(len(start)), (start, stop)), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    of_face = label[body.faces[:, 0]]
    order = np.argsort(of_face, kind="stable")
    ends_at = np.searchsorted(of_face[order], np.arange(1, number))
    return [faces for faces in np.split(body.faces[order], ends_at) if len(faces)]


def is_convex_body(vertices: FloatArray, faces: IntArray) -> bool:
    """Tell whether a closed surface bounds a convex body.

    Parameters
    ----------
    vertices
        (V, 3) points.
    faces
        (F, 3) indices.

    Returns
    -------
    bool
        False also for a cavity, whose faces point inwards.
    """
    volume = Solid(vertices, faces).volume_mm3
    used = np.ascontiguousarray(vertices[np.unique(faces)])
    # A hull of less volume has lost corners: that of a thin plate does.
    return volume > 0 and abs(Manifold.hull_points(used).volume() - volume) <= _CONVEX * volume
