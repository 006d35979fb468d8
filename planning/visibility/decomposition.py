"""The paper's algorithm: faces as polygons with holes, decomposed into convex tasks (section 1.2).

Of every face in front of the target the region is computed that it hides: the occluded region of
its hull less the viewing regions of its holes, (1), and of its gulfs, (2), each of which is the
viewing region of a hull less the occluded regions of what remains of it, and so on. Their union is
hidden.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lenscal.arrays import FloatArray
from planning.boolean import Cutter, subtract
from planning.scene import Scene
from planning.target import Target
from planning.visibility.factor import Factor
from planning.visibility.frame import TargetFrame
from planning.visibility.gulfs import face_part
from planning.visibility.loops import FlatFace, cut_in_front, flat_faces
from planning.visibility.part_regions import PartRegions, plane_sides


def decomposition_factors(scene: Scene, target: Target, frame: TargetFrame) -> list[Factor]:
    """Subtract what each face of the scene hides, for each convex piece of a target.

    Parameters
    ----------
    scene
        All that can hide the target.
    target
        The target.
    frame
        Its frame.

    Returns
    -------
    list of Factor
        One for each convex piece of the target.

    Raises
    ------
    GeometryError
        When the boolean operations fail.
    """
    faces = faces_in_front(scene, target, frame)
    return [factor_past(faces, target, frame, corners) for corners in frame.target_pieces(target)]


def faces_in_front(scene: Scene, target: Target, frame: TargetFrame) -> list[FlatFace]:
    """Give the flat faces that can hide a target, cut at its plane.

    Parameters
    ----------
    scene
        The bodies. Their faces count wherever they face.
    target
        The target; a segment has no plane, so nothing is cut.
    frame
        Its frame; the faces are given in it.

    Returns
    -------
    list of FlatFace
        The faces, nearest to the target first.
    """
    found: list[FlatFace] = []
    for body in scene.bodies:
        vertices, triangles = frame.to_local(body.vertices_mm), body.faces
        if not target.is_segment:
            vertices[np.abs(vertices[:, 2]) <= frame.tolerance, 2] = 0.0
            vertices, triangles = cut_in_front(vertices, triangles)
        found += flat_faces(vertices, triangles)
    distance = [float(np.linalg.norm(face.outline, axis=-1).min()) for face in found]
    return [found[i] for i in np.argsort(distance, kind="stable")]


def factor_past(
    faces: Sequence[FlatFace], target: Target, frame: TargetFrame, corners: FloatArray
) -> Factor:
    """Subtract what faces hide of one convex piece of a target from the extent of its frame.

    Parameters
    ----------
    faces
        The faces.
    target
        The target.
    frame
        The frame of the target.
    corners
        (M, 3) corners of the piece.

    Returns
    -------
    Factor
        What sees the piece past all the faces.

    Raises
    ------
    GeometryError
        When the boolean operations fail.
    """
    makers: list[PartRegions] = []
    cutters: list[Cutter] = []
    for face in faces:
        part = face_part(face)
        for side in plane_sides(face.normal, face.offset, corners, frame.tolerance):
            makers.append(PartRegions(side))
            cutters.append(makers[-1].cutter(part))
    extent = frame.extent(target)
    solid, imbalance, repairs = subtract(extent, cutters)
    worst = max([imbalance, *(maker.imbalance for maker in makers)])
    return Factor(
        corners,
        solid,
        worst / extent.volume(),
        repairs + sum(maker.repairs for maker in makers),
    )
