"""The flat faces of a surface as the paper takes them: material within an outline, less its holes.

Triangles that lie in one plane and hang together by their edges are one face. Where loops of a face
touch in a corner they are parted so that each goes around one piece of free space: a line of sight
that fills an area cannot pass through a point.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.polygons import area_vectors, without_straight_corners

#: How far, as a share of the size of all vertices, a corner may be off the plane of its face.
_FLAT: Final = 1e-11


@dataclass(frozen=True, slots=True, eq=False)
class FlatFace:
    """A polygon with holes.

    Parameters
    ----------
    outline
        (N, 3) corners, counter-clockwise seen from the side that the normal points to.
    holes
        (M, 3) corners of each hole, counter-clockwise too.
    normal
        (3,) unit normal.
    offset
        normal · point of its plane.
    """

    outline: FloatArray
    holes: tuple[FloatArray, ...]
    normal: FloatArray
    offset: float


def cut_in_front(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Cut a surface at the plane z = 0 and keep what is in front, its edge there included.

    Parameters
    ----------
    vertices
        (V, 3) points.
    faces
        (F, 3) indices.

    Returns
    -------
    vertices : FloatArray
        (W, 3) points, the crossings of edges after those that were given.
    faces : IntArray
        (G, 3) indices; neighbours still share their vertices. Nothing of what lies in the plane.
    """
    height = vertices[:, 2]
    in_front = (height[faces] >= 0).all(axis=1) & (height[faces] > 0).any(axis=1)
    crossed = (height[faces] > 0).any(axis=1) & (height[faces] < 0).any(axis=1)
    points, index = list(vertices), {}
    kept = [tuple(face) for face in faces[in_front]]
    for face in faces[crossed].tolist():
        ring = []
        for here, there in zip(face, face[1:] + face[:1], strict=True):
            if height[here] >= 0:
                ring.append(here)
            if height[here] * height[there] < 0:
                edge = (min(here, there), max(here, there))
                if edge not in index:
                    index[edge] = len(points)
                    points.append(_crossing(vertices[edge[0]], vertices[edge[1]]))
                ring.append(index[edge])
        kept += [(ring[0], ring[k], ring[k + 1]) for k in range(1, len(ring) - 1)]
    return np.array(points).reshape(-1, 3), np.array(kept, dtype=np.int64).reshape(-1, 3)


def flat_faces(vertices: FloatArray, faces: IntArray) -> list[FlatFace]:
    """Merge triangles that lie in one plane and hang together into faces with holes.

    Parameters
    ----------
    vertices
        (V, 3) points.
    faces
        (F, 3) indices of an oriented surface, closed or not.

    Returns
    -------
    list of FlatFace
        The faces; triangles without an area belong to none of their own.
    """
    if not len(faces):
        return []
    tolerance = _FLAT * float(np.ptp(vertices, axis=0).max())
    found: list[FlatFace] = []
    for normal, group in _coplanar_groups(vertices, faces, tolerance):
        loops = [
            corners
            for loop in _loops(vertices, faces[group], normal)
            if len(corners := without_straight_corners(vertices[loop], tolerance)) >= 3
        ]
        found += _with_holes(loops, normal)
    return found


def axes_across(normal: FloatArray) -> FloatArray:
    """Choose two axes of a plane.

    Parameters
    ----------
    normal
        (3,) its unit normal.

    Returns
    -------
    FloatArray
        (2, 3) unit axes x and y with x × y the normal.
    """
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across = across / np.linalg.norm(across)
    return np.stack([across, np.cross(normal, across)])


def surrounds(polygon: FloatArray, points: FloatArray) -> BoolArray:
    """Tell which points of a plane a polygon goes around.

    Parameters
    ----------
    polygon
        (N, 2) corners in order.
    points
        (K, 2) points.

    Returns
    -------
    BoolArray
        (K,). On the outline itself either answer may come.
    """
    x, y = points[:, None, 0], points[:, None, 1]
    (x0, y0), (x1, y1) = polygon.T, np.roll(polygon, -1, axis=0).T
    straddles = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    inside: BoolArray = (straddles & (x < crossing)).sum(axis=1) % 2 == 1
    return inside


def _crossing(first: FloatArray, second: FloatArray) -> FloatArray:
    point = first + (second - first) * (first[2] / (first[2] - second[2]))
    return np.array([point[0], point[1], 0.0])


def _coplanar_groups(
    vertices: FloatArray, faces: IntArray, tolerance: float
) -> list[tuple[FloatArray, IntArray]]:
    """Normal and triangles of each face, grown from its largest triangle over shared edges."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normals, axis=-1)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    flat = doubled <= tolerance * longest
    normals = np.divide(normals, doubled[:, None], out=np.zeros_like(normals), where=~flat[:, None])
    neighbours = _neighbours(faces)
    free = np.ones(len(faces), dtype=bool)
    groups = []
    for seed in np.argsort(-doubled, kind="stable"):
        if not free[seed] or flat[seed]:
            continue
        normal, base = normals[seed], corners[seed, 0]
        fits = np.abs((corners - base) @ normal).max(axis=1) <= tolerance
        # A triangle without an area has no normal; it belongs to whichever face meets it first.
        fits &= free & (flat | (normals @ normal > 0))
        group, waiting = [], [int(seed)]
        free[seed] = fits[seed] = False
        while waiting:
            triangle = waiting.pop()
            group.append(triangle)
            for other in neighbours[triangle]:
                if fits[other]:
                    free[other] = fits[other] = False
                    waiting.append(other)
        groups.append((normal, np.array(group)))
    return groups


def _neighbours(faces: IntArray) -> dict[int, list[int]]:
    """Triangles on the other side of each edge, those that run along it the other way."""
    along: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    for number, (a, b, c) in enumerate(faces.tolist()):
        for edge in ((a, b), (b, c), (c, a)):
            along[edge].append(number)
    found: defaultdict[int, list[int]] = defaultdict(list)
    for (a, b), triangles in along.items():
        for triangle in triangles:
            found[triangle] += along.get((b, a), [])
    return found


def _loops(vertices: FloatArray, faces: IntArray, normal: FloatArray) -> list[list[int]]:
    """Loops of the edges that only one triangle has, with the material on their left."""
    edges = [e for a, b, c in faces.tolist() for e in ((a, b), (b, c), (c, a))]
    inner = set(edges)
    outer = [(a, b) for a, b in edges if (b, a) not in inner]
    leaving: defaultdict[int, list[int]] = defaultdict(list)
    for a, b in outer:
        leaving[a].append(b)
    flat = vertices @ axes_across(normal).T

    def following(a: int, b: int) -> tuple[int, int]:
        """The next edge around the same piece of free space: the first to the right of a → b."""
        if len(leaving[b]) == 1:
            return b, leaving[b][0]
        back = _angle(flat[a] - flat[b])
        return b, min(leaving[b], key=lambda c: (_angle(flat[c] - flat[b]) - back) % (2 * np.pi))

    loops, left = [], dict.fromkeys(outer)
    while left:
        first = edge = next(iter(left))
        loop = []
        while edge in left:
            del left[edge]
            loop.append(edge[0])
            edge = following(*edge)
        if edge == first:
            loops.append(loop)
    return loops


def _angle(direction: FloatArray) -> float:
    return float(np.arctan2(direction[1], direction[0]))


def _with_holes(loops: list[FloatArray], normal: FloatArray) -> list[FlatFace]:
    outlines = [loop for loop in loops if area_vectors(loop) @ normal > 0]
    holes = [loop[::-1] for loop in loops if area_vectors(loop) @ normal < 0]
    axes = axes_across(normal).T
    faces = []
    for outline in outlines:
        unit = area_vectors(outline) / np.linalg.norm(area_vectors(outline))
        own = [
            hole
            for hole in holes
            if len(outlines) == 1 or surrounds(outline @ axes, _middles(hole) @ axes).mean() > 0.5
        ]
        faces.append(FlatFace(outline, tuple(own), unit, float((outline @ unit).mean())))
    return faces


def _middles(corners: FloatArray) -> FloatArray:
    middles: FloatArray = (corners + np.roll(corners, -1, axis=0)) / 2
    return middles
