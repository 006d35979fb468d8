"""The scene as convex pieces: whole convex bodies, and convex polygons of all other faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from manifold3d import Manifold
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lenscal.arrays import FloatArray, IntArray
from planning.boolean import from_manifold
from planning.polygons import clip_in_front, merge_convex
from planning.scene import Scene
from planning.solid import Solid
from planning.target import Target
from planning.visibility.frame import TargetFrame

#: A body whose hull is larger by less than this share of its volume is convex.
_CONVEX: Final = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPiece:
    """A convex polygon or polyhedron that hides what lies behind it.

    Parameters
    ----------
    vertices
        (V, 3) corners.
    edges
        (E, 2) indices of the ends of its edges.
    normals
        (F, 3) unit normals of its faces; one for a polygon.
    offsets
        (F,) normal · point of each face.
    """

    vertices: FloatArray
    edges: IntArray
    normals: FloatArray
    offsets: FloatArray

    @classmethod
    def polygon(cls, corners: FloatArray) -> ConvexPiece:
        """Make a piece of a polygon.

        Parameters
        ----------
        corners
            (N, 3) corners in order.

        Returns
        -------
        ConvexPiece
            The piece.
        """
        local = corners - corners[0]
        normal = np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)
        normal = normal / np.linalg.norm(normal)
        index = np.arange(len(corners))
        edges = np.stack([index, np.roll(index, -1)], axis=-1)
        return cls(corners, edges, normal[None], (corners @ normal).mean(keepdims=True))

    @classmethod
    def hull(cls, points: FloatArray) -> ConvexPiece:
        """Make a piece of the convex hull of points.

        Parameters
        ----------
        points
            (N, 3) points, not all in one plane.

        Returns
        -------
        ConvexPiece
            The piece.
        """
        vertices, faces = from_manifold(Manifold.hull_points(np.ascontiguousarray(points)))
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        pairs = mesh.face_adjacency
        turn = np.linalg.norm(
            np.cross(mesh.face_normals[pairs[:, 0]], mesh.face_normals[pairs[:, 1]]), axis=-1
        )
        # A corner in the middle of an edge makes a triangle without an area, thus without a normal.
        all_normals = np.asarray(mesh.face_normals)
        flat = np.linalg.norm(all_normals, axis=-1) == 0
        real = (turn > 1e-12) | flat[pairs].any(axis=1)
        normals = all_normals[~flat]
        offsets = np.einsum("fi,fi->f", normals, vertices[faces[~flat, 0]])
        return cls(vertices, np.asarray(mesh.face_adjacency_edges)[real], normals, offsets)


def occluding_pieces(scene: Scene, target: Target, frame: TargetFrame) -> list[ConvexPiece]:
    """Break the scene into convex pieces, as far as it can hide a target.

    In front of a polygon only what lies above its plane can hide it, so pieces are cut at that
    plane. Of closed bodies that are not convex only the faces that turn their outer side to some
    corner of the target matter: a line of sight that enters a body elsewhere has left it before. A
    segment has no plane and may lie on an edge of the part: all faces count.

    Parameters
    ----------
    scene
        The bodies.
    target
        The target.
    frame
        Its frame; the pieces are given in it.

    Returns
    -------
    list of ConvexPiece
        The pieces, nearest to the target first.
    """
    corners = np.concatenate(frame.target_pieces(target))
    pieces: list[ConvexPiece] = []
    for body in scene.bodies:
        vertices = frame.to_local(body.vertices_mm)
        if not target.is_segment:
            vertices[np.abs(vertices[:, 2]) <= frame.tolerance, 2] = 0.0
        for faces in connected_faces(body):
            if is_convex_body(vertices, faces):
                pieces += _solid_piece(vertices, faces, target.is_segment)
            else:
                pieces += _face_pieces(vertices, faces, corners, target.is_segment, frame.tolerance)
    distance = [float(np.linalg.norm(p.vertices, axis=-1).min()) for p in pieces]
    return [pieces[i] for i in np.argsort(distance, kind="stable")]


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
    return [body.faces[of_face == k] for k in range(number) if (of_face == k).any()]


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


def _solid_piece(vertices: FloatArray, faces: IntArray, is_segment: bool) -> list[ConvexPiece]:
    used = vertices[np.unique(faces)]
    if not is_segment:
        height = vertices[:, 2]
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        edges = edges[(height[edges[:, 0]] < 0) & (height[edges[:, 1]] > 0)]
        below, above = vertices[edges[:, 0]], vertices[edges[:, 1]]
        share = (below[:, 2:] / (below[:, 2:] - above[:, 2:]))[:, :1]
        crossings = below + share * (above - below)
        crossings[:, 2] = 0.0
        used = np.concatenate([used[used[:, 2] >= 0], crossings])
        if not (used[:, 2] > 0).any():
            return []
    return [ConvexPiece.hull(used)]


def _face_pieces(
    vertices: FloatArray,
    faces: IntArray,
    target_corners: FloatArray,
    is_segment: bool,
    tolerance: float,
) -> list[ConvexPiece]:
    pieces = []
    for loop in merge_convex(vertices, faces):
        polygon = vertices[loop]
        if not is_segment:
            polygon = clip_in_front(polygon)
        if len(polygon) < 3:
            continue
        piece = ConvexPiece.polygon(polygon)
        entered = (target_corners @ piece.normals[0] - piece.offsets[0]).max() > tolerance
        if is_segment or entered:
            pieces.append(piece)
    return pieces
