"""The scene as convex pieces: whole convex bodies, and convex polygons of all other faces."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
from manifold3d import Manifold

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.boolean import from_manifold
from planning.polygons import area_vectors, clip_polygons, is_thin
from planning.scene import Scene
from planning.surface_parts import FlatFaces
from planning.target import Target
from planning.visibility.convex import ConvexPieces
from planning.visibility.frame import TargetFrame

#: By how much, in units of the frame, a face must turn away from a target to be left out at once.
_CLEARLY: Final = 1e-6


def occluding_pieces(scene: Scene, target: Target, frame: TargetFrame) -> ConvexPieces:
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
    ConvexPieces
        The pieces, nearest to the target first.
    """
    target_corners = np.concatenate(frame.target_pieces(target))
    polygons: list[FloatArray] = []
    solids: list[tuple[FloatArray, IntArray]] = []
    for body in scene.bodies:
        closed = body.is_closed
        vertices = frame.to_local(body.vertices_mm)
        if not target.is_segment:
            vertices[np.abs(vertices[:, 2]) <= frame.tolerance, 2] = 0.0
        for part in body.parts:
            if part.is_convex:
                solids += _solid_piece(vertices, part.faces, target.is_segment)
                continue
            for faces in part.polygons:
                batch = vertices[faces.corners[_may_hide(faces, vertices, target, closed, frame)]]
                # A polygon without any area hides nothing that its neighbours do not hide.
                batch = batch[np.linalg.norm(area_vectors(batch), axis=-1) > 0]
                if not target.is_segment:
                    batch = _in_front(batch)
                    if closed:
                        batch = batch[_is_entered(batch, target_corners, frame.tolerance)]
                polygons.append(batch)
    return ConvexPieces.gathered(polygons, solids)


def _may_hide(
    faces: FlatFaces, vertices: FloatArray, target: Target, closed: bool, frame: TargetFrame
) -> IntArray:
    """Leave out at little cost polygons that lie behind a target, or are clearly not entered."""
    if target.is_segment:
        return np.arange(len(faces.corners))
    in_front = (vertices[:, 2] > 0)[faces.corners].any(axis=1)
    if closed:
        above = (faces.normals @ target.vertices_mm.T).max(axis=1) - faces.offsets_mm
        in_front &= above > -_CLEARLY * frame.scale_mm
    return np.flatnonzero(in_front)


def _in_front(polygons: FloatArray) -> FloatArray:
    """Cut polygons at the plane z = 0 and keep what is in front, its edge included."""
    height = polygons[..., 2]
    cut = (height < 0).any(axis=1)
    whole = polygons[~cut & (height > 0).any(axis=1)]
    clipped, _ = clip_polygons(polygons[cut & (height > 0).any(axis=1)], np.array([0.0, 0, 1]))
    # Rounding leaves the crossings off the plane by a hair.
    below = clipped[..., 2] < 1e-15
    clipped[below, 2] = 0.0
    padding = np.repeat(whole[:, :1], clipped.shape[1] - whole.shape[1], axis=1)
    joined = np.concatenate([np.concatenate([whole, padding], axis=1), clipped])
    kept: FloatArray = joined[np.linalg.norm(area_vectors(joined), axis=-1) > 0]
    return kept


def _is_entered(polygons: FloatArray, target_corners: FloatArray, tolerance: float) -> BoolArray:
    """(N,) whether polygons turn their outer side to some corner of the target."""
    vectors = area_vectors(polygons)
    area = np.linalg.norm(vectors, axis=-1)
    normals = vectors / area[:, None]
    offsets = np.einsum("ni,ni->n", normals, polygons.mean(axis=1))
    # Faces that are not needed do no harm: doubt counts as entered.
    entered: BoolArray = is_thin(polygons) | (
        (normals @ target_corners.T).max(axis=1) - offsets > tolerance
    )
    return entered


def inflated(pieces: ConvexPieces, margin: float, is_segment: bool) -> ConvexPieces:
    """Make pieces larger on all sides.

    Parameters
    ----------
    pieces
        Convex pieces; those of a polygon target end at its plane, and so do the larger ones.
    margin
        By how much, in units of the frame: each becomes the hull of cubes of twice that size about
        its corners, which holds all within the margin, and nothing farther than √3 times that.
    is_segment
        Whether the target is a segment, which has no plane.

    Returns
    -------
    ConvexPieces
        The larger pieces, nearest first.
    """
    cube = margin * np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    solids: list[tuple[FloatArray, IntArray]] = []
    for index in range(len(pieces)):
        points = (pieces.corners_of(index)[:, None] + cube).reshape(-1, 3)
        solids += _solid_piece(*from_manifold(Manifold.hull_points(points)), is_segment)
    return ConvexPieces.gathered([], solids)


def _solid_piece(
    vertices: FloatArray, faces: IntArray, is_segment: bool
) -> list[tuple[FloatArray, IntArray]]:
    """Cut a convex solid at the plane z = 0, unless the target is a segment."""
    number, faces_of_used = np.unique(faces, return_inverse=True)
    used = vertices[number]
    height = used[:, 2]
    if is_segment or (height >= 0).all():
        return [(used, faces_of_used.reshape(-1, 3))]
    if not (height > 0).any():
        return []
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = edges[(vertices[edges[:, 0], 2] < 0) & (vertices[edges[:, 1], 2] > 0)]
    below, above = vertices[edges[:, 0]], vertices[edges[:, 1]]
    share = (below[:, 2:] / (below[:, 2:] - above[:, 2:]))[:, :1]
    crossings = below + share * (above - below)
    crossings[:, 2] = 0.0
    rest = np.concatenate([used[height >= 0], crossings])
    return [from_manifold(Manifold.hull_points(rest))]
