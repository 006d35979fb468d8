"""Faces in groups that lie close together, so that they are dismissed or bounded at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, IntArray
from planning.separation import unit_normals

#: Faces of a group at most; and of one that is too large.
_FACES: Final = 48
_FACES_APART: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class FaceGroup:
    """Faces that lie close together, what they share only once.

    Parameters
    ----------
    numbers
        (F,) which of all faces they are.
    centre_mm, radius_mm
        (3,) and radius of a ball that holds them.
    vertices_mm
        (U, 3) their corners, in mm from that centre.
    corners
        (4, F) which vertices the corners of each face are.
    ends
        (2, E) which vertices the ends of each edge are.
    edges
        (4, F) which edges each face has, the first one from its first corner to its second.
    normals
        (3, F) unit vectors.
    heights_mm
        (2, F) how far the corners reach along the normal, in mm from the centre: least and most.
    """

    numbers: IntArray
    centre_mm: FloatArray
    radius_mm: float
    vertices_mm: FloatArray
    corners: IntArray
    ends: IntArray
    edges: IntArray
    normals: FloatArray
    heights_mm: FloatArray


def face_groups(faces: FloatArray, size_mm: float) -> list[FaceGroup]:
    """Part faces into groups.

    Parameters
    ----------
    faces
        (4, 3, F) corners in mm; a triangle has one of them twice.
    size_mm
        Groups whose middles are spread farther are parted even when they have few faces: what is
        small is dismissed more often.

    Returns
    -------
    list of FaceGroup
        Each face is in one of them.
    """
    middles, numbers = faces.mean(axis=0), np.arange(faces.shape[2])
    return [_group(faces, np.sort(some)) for some in _halves(middles, numbers, size_mm)]


def _halves(middles: FloatArray, numbers: IntArray, size_mm: float) -> Iterator[IntArray]:
    """Halve along where the middles are spread the most, until few are left."""
    small = len(numbers) == 0 or np.ptp(middles[:, numbers], axis=1).max() <= size_mm
    if len(numbers) <= (_FACES if small else _FACES_APART):
        if len(numbers):
            yield numbers
        return
    widest = np.ptp(middles[:, numbers], axis=1).argmax()
    ordered = numbers[np.argsort(middles[widest, numbers], kind="stable")]
    yield from _halves(middles, ordered[: len(ordered) // 2], size_mm)
    yield from _halves(middles, ordered[len(ordered) // 2 :], size_mm)


def _group(faces: FloatArray, numbers: IntArray) -> FaceGroup:
    corners = faces[..., numbers]
    points = corners.transpose(0, 2, 1).reshape(-1, 3)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    vertices, inverse = np.unique(points, axis=0, return_inverse=True)
    corner = inverse.reshape(4, -1)
    ends, edge = np.unique(
        np.sort(np.stack([corner, np.roll(corner, -1, axis=0)]), axis=0).reshape(2, -1),
        axis=1,
        return_inverse=True,
    )
    normals = unit_normals(corners)
    heights = np.einsum("if,cif->cf", normals, corners - centre[:, None])
    return FaceGroup(
        numbers=numbers,
        centre_mm=centre,
        radius_mm=float(np.linalg.norm(vertices - centre, axis=1).max()),
        vertices_mm=vertices - centre,
        corners=corner,
        ends=ends,
        edges=edge.reshape(4, -1),
        normals=normals,
        heights_mm=np.stack([heights.min(axis=0), heights.max(axis=0)]),
    )
