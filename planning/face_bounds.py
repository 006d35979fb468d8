"""How far pieces of a camera are from faces at least, for all lens states at once.

The bound of a face is the largest of the gaps in a few directions: its normal, and those that the
piece suggests. As the lens state changes, the scene only shifts in the frame of the camera, and
each gap is linear in that. So what costs is done once for each viewpoint: not with the corners of
all faces, but with the vertices and edges that they share.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np

from lenscal.arrays import FloatArray, IntArray
from planning.camera_body import Piece
from planning.cylinder import Cylinder
from planning.face_groups import FaceGroup
from planning.separation import directions_apart
from planning.vectors import along


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where reference cameras stand, components outermost.

    Parameters
    ----------
    rotations
        (3, 3, N) of part_from_camera.
    origins_mm
        (3, N) their origins in the frame of the part in mm.
    shifts_mm
        (S, 3) by how much, in the frame of the camera, everything moves in each lens state.
    """

    rotations: FloatArray
    origins_mm: FloatArray
    shifts_mm: FloatArray


#: The components of a direction, and how far faces lie beyond a piece in it and opposite to it.
_Gaps = tuple[tuple[FloatArray | float, ...], FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Corners of faces, and of each edge the point nearest to the axis of a cylinder.

    Parameters
    ----------
    which
        (C, F) which points lie on each face.
    beside_mm, heights_mm
        (P, N) how far they are outside of the cylinder if that were long enough, and how high along
        its axis they are above its centre, before any shift.
    half_length_mm
        Of the cylinder.
    """

    which: IntArray
    beside_mm: FloatArray
    heights_mm: FloatArray
    half_length_mm: float

    def reached(self, face: IntArray, place: IntArray, shift_mm: FloatArray) -> FloatArray:
        """(K,) how far the nearest point is; zero also where it lies between two of them."""
        points = self.which[:, face]
        beside = self.beside_mm[points, place]
        heights = self.heights_mm[points, place] + shift_mm
        beyond = np.maximum(np.abs(heights) - self.half_length_mm, 0.0)
        distance = np.sqrt((beside**2 + beyond**2).min(axis=0))
        # A cylinder without ends is convex: what lies between points within it is within it.
        inner = beside == 0
        low = np.where(inner, heights, np.inf).min(axis=0)
        high = np.where(inner, heights, -np.inf).max(axis=0)
        between = (low <= self.half_length_mm) & (high >= -self.half_length_mm)
        return np.where(between, 0.0, distance)


class FaceBounds:
    """Lower bounds of the distance of a piece and faces, at some places in all states.

    Parameters
    ----------
    piece
        A convex piece.
    group
        F faces.
    places
        N places, S states.
    """

    def __init__(self, piece: Piece, group: FaceGroup, places: Places) -> None:
        shape = (len(group.numbers), places.origins_mm.shape[1])
        #: What is known of some points of the faces, where the shift is along a cylinder.
        self._points: _Points | None = None
        if isinstance(piece, Cylinder):
            frame = piece.frame
            self._shifts = places.shifts_mm @ frame.T
            axes = np.einsum("ijn,kj->kin", places.rotations, frame)
            origins = np.einsum("ijn,j->in", places.rotations, piece.centre_mm)
            origins += places.origins_mm
            gaps = self._from_cylinder(piece, group, axes, origins)
        else:
            self._shifts = places.shifts_mm
            gaps = _from_any(piece, group, places)
        moving = np.atleast_1d(self._shifts.any(axis=0))
        self._still = np.full(shape, -np.inf)
        self._gaps: list[_Gaps] = []
        for direction, forwards, backwards in gaps:
            if any(moves and np.any(part) for moves, part in zip(moving, direction, strict=True)):
                self._gaps.append((direction, forwards, backwards))
            else:
                np.maximum(self._still, forwards, out=self._still)
                np.maximum(self._still, backwards, out=self._still)
        self._moving = np.flatnonzero(moving)

    def in_states(self) -> FloatArray:
        """Give the bounds.

        Returns
        -------
        FloatArray
            (S, F, N) in mm; where they are negative, by how much the sets overlap at most, as far
            as the directions say.
        """
        bounds = np.repeat(self._still[None], len(self._shifts), axis=0)
        moved, gap = np.zeros_like(self._still), np.zeros_like(self._still)
        for shift, bound in zip(self._shifts, bounds, strict=True):
            for direction, forwards, backwards in self._gaps:
                by: FloatArray | float = 0.0
                for k in self._moving:
                    part = direction[k]
                    if isinstance(part, float):
                        by = by + shift[k] * part
                    elif isinstance(by, float) and by == 0.0:
                        by = np.multiply(part, shift[k], out=moved)
                    else:
                        by = np.add(by, part * shift[k], out=moved)
                np.maximum(bound, np.add(forwards, by, out=gap), out=bound)
                np.maximum(bound, np.subtract(backwards, by, out=gap), out=bound)
        return bounds

    def reached(self, state: IntArray, face: IntArray, place: IntArray) -> FloatArray:
        """Give upper bounds of the distance.

        Parameters
        ----------
        state, face, place
            (K,) triples.

        Returns
        -------
        FloatArray
            (K,) in mm: zero where a point of the face certainly lies in the piece, infinite where
            nothing is known.
        """
        if self._points is None:
            return np.full(len(state), np.inf)
        return self._points.reached(face, place, self._shifts[state, 2])

    def _from_cylinder(
        self, piece: Cylinder, group: FaceGroup, axes: FloatArray, origins: FloatArray
    ) -> list[_Gaps]:
        """Look along the face's normal, along the cylinder, and across it towards the face.

        The frame is that of the cylinder: its centre is the origin, z its axis.
        """
        radius, half_length = piece.radius_mm, piece.half_length_mm
        away = group.centre_mm[:, None] - origins
        u, v, w = (group.vertices_mm @ axis + along(axis, away) for axis in axes)
        # The normal.
        cosine = group.normals.T @ axes[2]
        support = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        support *= radius
        support += half_length * np.abs(cosine)
        ahead = group.normals.T @ away
        low, high = group.heights_mm[..., None]
        sideways: tuple[FloatArray | float, ...] = (0.0, 0.0)
        if self._shifts[:, :2].any():
            sideways = (group.normals.T @ axes[0], group.normals.T @ axes[1])
        normal = ((*sideways, cosine), low + ahead - support, -high - ahead - support)
        # The axis.
        corners = [w[corner] for corner in group.corners]
        least, most = _least(corners), _most(corners)
        lengthwise = ((0.0, 0.0, 1.0), least - half_length, -most - half_length)
        # Of each edge, the point nearest to the axis; of each face, the nearest of those.
        start, stop = group.ends
        u_foot, v_foot = u[start], v[start]
        u_edge, v_edge = u[stop] - u_foot, v[stop] - v_foot
        squared = u_edge**2 + v_edge**2
        squared[squared == 0] = 1.0
        share = u_foot * u_edge
        share += v_foot * v_edge
        share /= squared
        np.negative(share, out=share)
        np.clip(share, 0.0, 1.0, out=share)
        u_foot += share * u_edge
        v_foot += share * v_edge
        distance = u_foot**2 + v_foot**2
        nearest = np.full_like(cosine, np.inf)
        u_towards, v_towards = np.zeros_like(cosine), np.zeros_like(cosine)
        for edge in group.edges:
            of_edge = distance[edge]
            nearer = (of_edge < nearest) & (of_edge > 0)
            np.copyto(u_towards, u_foot[edge], where=nearer)
            np.copyto(v_towards, v_foot[edge], where=nearer)
            np.copyto(nearest, of_edge, where=nearer)
        # A face on the axis has no direction across it: any one is valid.
        u_towards[np.isinf(nearest)], nearest[np.isinf(nearest)] = 1.0, 1.0
        length = np.sqrt(nearest)
        u_towards /= length
        v_towards /= length
        corners = [u[corner] * u_towards + v[corner] * v_towards for corner in group.corners]
        across = ((u_towards, v_towards, 0.0), _least(corners) - radius, -_most(corners) - radius)
        if not self._shifts[:, :2].any():
            beside = np.sqrt(np.concatenate([u**2 + v**2, distance])) - radius
            heights = np.concatenate([w, w[start] + share * (w[stop] - w[start])])
            which = np.concatenate([group.corners, len(w) + group.edges])
            self._points = _Points(which, np.maximum(beside, 0.0), heights, half_length)
        return [normal, lengthwise, across]


def _from_any(piece: Piece, group: FaceGroup, places: Places) -> list[_Gaps]:
    """Look in the directions that the piece suggests, each face at each place by itself."""
    away = group.centre_mm[:, None] - places.origins_mm
    camera = np.stack(
        [
            group.vertices_mm @ places.rotations[:, k] + along(places.rotations[:, k], away)
            for k in range(3)
        ]
    )
    shape = (len(group.numbers), camera.shape[2])
    corners = camera[:, group.corners].swapaxes(0, 1).reshape(4, 3, -1)
    return [
        (tuple(direction.reshape(3, *shape)), forwards.reshape(shape), backwards.reshape(shape))
        for direction, forwards, backwards in directions_apart(piece, corners)
    ]


def _least(arrays: Iterable[FloatArray]) -> FloatArray:
    return reduce(np.minimum, arrays)


def _most(arrays: Iterable[FloatArray]) -> FloatArray:
    return reduce(np.maximum, arrays)
