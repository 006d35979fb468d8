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
from planning.polygons import area_vectors, is_thin, merge_convex
from planning.solid import Solid

#: A body whose hull is larger by less than this share of its volume is convex.
_CONVEX: Final = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class FlatFaces:
    """Convex polygons with the same number of corners.

    Parameters
    ----------
    corners
        (N, K) indices of their corners in order.
    normals
        (N, 3) unit normals; zero for a polygon so thin that its normal is unsure.
    offsets_mm
        (N,) normal · point of each.
    """

    corners: IntArray
    normals: FloatArray
    offsets_mm: FloatArray

    @classmethod
    def of(cls, vertices_mm: FloatArray, corners: IntArray) -> FlatFaces:
        """Work out the planes of polygons.

        Parameters
        ----------
        vertices_mm
            (V, 3) points in mm.
        corners
            (N, K) indices.

        Returns
        -------
        FlatFaces
            The polygons.
        """
        points = vertices_mm[corners]
        vectors = area_vectors(points)
        area = np.linalg.norm(vectors, axis=-1, keepdims=True)
        sure = ~is_thin(points)[:, None]
        normals = np.divide(vectors, area, out=np.zeros_like(vectors), where=sure)
        return cls(corners, normals, np.einsum("ni,ni->n", normals, points.mean(axis=1)))


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
        Of faces that do not: convex polygons, neighbours in one plane merged, together by number
        of corners.
    """

    faces: IntArray
    is_convex: bool
    polygons: tuple[FlatFaces, ...]


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
        return (_flat(surface, vertices, surface.faces),)
    return tuple(
        SurfacePart(faces, True, ())
        if is_convex_body(vertices, faces)
        else _flat(surface, vertices, faces)
        for faces in connected_faces(surface)
    )


def _flat(surface: Solid, vertices: FloatArray, faces: IntArray) -> SurfacePart:
    loops = merge_convex(vertices, faces)
    sizes = np.array([len(loop) for loop in loops])
    batches = (
        np.array([loops[i] for i in np.flatnonzero(sizes == size)]) for size in np.unique(sizes)
    )
    polygons = tuple(FlatFaces.of(surface.vertices_mm, corners) for corners in batches)
    return SurfacePart(faces, False, polygons)


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
