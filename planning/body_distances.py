"""How far a piece of a camera is from faces, at many places and in many lens states at once.

A piece slides along the axis with the lens state. Most places end at a bound that holds for all
states at once; of the rest, the face that seems to be nearest is measured first, and others only
where they may be nearer still.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, IntArray
from planning.camera_body import Piece
from planning.separation import directions_apart, gap_mm, separation_mm
from planning.vectors import along

#: Pairs of place and face that are looked at at once, for all states and for each of them, so that
#: they stay in the cache; pairs of place and state that are settled together.
_LOOKED_AT: Final = 100_000
_BOUNDED: Final = 4_096
_SETTLED: Final = 400_000
#: What is nearer by less is as near.
_ROUNDING_MM: Final = 1e-9


#: States, places, faces, and lower bounds of their distance in mm.
_Chosen = tuple[IntArray, IntArray, IntArray, FloatArray]


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

    def some(self, which: slice) -> Places:
        """Take some of the places, at all states.

        Parameters
        ----------
        which
            Which of the N.

        Returns
        -------
        Places
            Those.
        """
        return Places(self.rotations[..., which], self.origins_mm[:, which], self.shifts_mm)

    def in_camera(self, faces: FloatArray, place: IntArray, face: IntArray) -> FloatArray:
        """Bring faces into the frames of reference cameras, before any shift.

        Parameters
        ----------
        faces
            (4, 3, F) corners in the frame of the part in mm.
        place, face
            (P,) pairs.

        Returns
        -------
        FloatArray
            (4, 3, P) corners in mm.
        """
        away = faces.take(face, 2)
        away -= self.origins_mm.take(place, 1)
        turned = self.rotations.take(place, 2)
        return np.stack([along(turned[:, k], away.transpose(1, 0, 2)) for k in range(3)], axis=1)


def distances_mm(piece: Piece, faces: FloatArray, places: Places, enough_mm: float) -> FloatArray:
    """Measure how far a piece is from the nearest of all faces.

    Parameters
    ----------
    piece
        A convex piece.
    faces
        (4, 3, F) corners in the frame of the part in mm.
    places
        N places, S states.
    enough_mm
        Distances beyond this are of no interest.

    Returns
    -------
    FloatArray
        (S, N) in mm, as far as that is not enough. Where they overlap, as negative as the
        directions say that are tried.
    """
    count, states = places.origins_mm.shape[1], len(places.shifts_mm)
    found = np.full((states, count), np.inf)
    step = max(1, _SETTLED // states)
    for start in range(0, count, step):
        part = slice(start, start + step)
        found[:, part] = _settled(piece, faces, places.some(part), enough_mm)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Candidates:
    """Places and faces that are not known to be far enough; few enough to stay in the cache.

    Parameters
    ----------
    place, face
        (P,) pairs, in the order of places.
    bounds
        (S, P) lower bounds of their distance in mm; what is measured becomes infinite.
    """

    place: IntArray
    face: IntArray
    bounds: FloatArray

    def nearest(self, enough_mm: float) -> _Chosen:
        """Take out, for each place and state, what seems to be nearest."""
        starts = np.flatnonzero(np.diff(self.place, prepend=-1))
        lowest = np.minimum.reduceat(self.bounds, starts, axis=1)
        of_place = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(self.place)))
        state, pair = np.nonzero(
            (self.bounds == lowest.take(of_place, 1)) & (self.bounds < enough_mm)
        )
        # Of several that are as near, the first.
        place = self.place[pair]
        first = (np.diff(place, prepend=-1) != 0) | (np.diff(state, prepend=-1) != 0)
        chosen = self._chosen(state[first], pair[first])
        self.bounds[state[first], pair[first]] = np.inf
        return chosen

    def below(self, limits: FloatArray) -> _Chosen:
        """Choose what may be nearer than limits, (S, N)."""
        return self._chosen(*np.nonzero(self.bounds < limits.take(self.place, 1)))

    def _chosen(self, state: IntArray, pair: IntArray) -> _Chosen:
        return state, self.place[pair], self.face[pair], self.bounds[state, pair]


def _settled(piece: Piece, faces: FloatArray, places: Places, enough_mm: float) -> FloatArray:
    count, states = places.origins_mm.shape[1], len(places.shifts_mm)
    found = np.full((states, count), np.inf)
    candidates = list(_candidates(piece, faces, places, enough_mm))
    if not candidates:
        return found

    def gathered(chosen: list[_Chosen]) -> tuple[IntArray, FloatArray, FloatArray]:
        """Numbers of place and state, corners, and bounds."""
        state, place, face, known = (np.concatenate(column) for column in zip(*chosen, strict=True))
        corners = places.in_camera(faces, place, face)
        corners += places.shifts_mm[state].T
        return state * count + place, corners, known

    # First, in each place and state, what seems to be nearest.
    group, corners, known = gathered([some.nearest(enough_mm) for some in candidates])
    flat, directions = found.reshape(-1), np.zeros((3, found.size))
    flat[group], directions[:, group] = separation_mm(piece, corners, group, enough_mm, known)
    # Then what may be nearer still, one by one: not what lies beyond in a direction that was found.
    limits = np.minimum(found, enough_mm)
    group, corners, known = gathered([some.below(limits) for some in candidates])
    while len(group):
        direction = directions[:, group]
        gap = gap_mm(piece, corners, direction)
        known = np.where(direction.any(axis=0), np.maximum(known, gap), known)
        left = np.flatnonzero(known < flat[group] - _ROUNDING_MM)
        left = left[np.lexsort((known[left], group[left]))]
        group, corners, known = group[left], corners[..., left], known[left]
        first = np.diff(group, prepend=-1) > 0
        distance, directions[:, group[first]] = separation_mm(
            piece, corners[..., first], group[first], enough_mm, known[first]
        )
        flat[group[first]] = np.minimum(flat[group[first]], distance)
        group, corners, known = group[~first], corners[..., ~first], known[~first]
    return found


def _candidates(
    piece: Piece, faces: FloatArray, places: Places, enough_mm: float
) -> Iterator[_Candidates]:
    step = max(1, _LOOKED_AT // faces.shape[2])
    for begin in range(0, places.origins_mm.shape[1], step):
        block = places.some(slice(begin, begin + step))
        near, of = _near(piece, faces, block, enough_mm)
        # All faces of a place stay together.
        starts = np.flatnonzero(np.diff(near, prepend=-1))
        wanted = np.searchsorted(starts, np.arange(0, len(near), _BOUNDED))
        cuts = starts[np.unique(wanted[wanted < len(starts)])]
        for start, stop in itertools.pairwise([*cuts, len(near)]):
            place, face = near[start:stop], of[start:stop]
            bounds = _bounds(piece, block.in_camera(faces, place, face), places.shifts_mm)
            kept = np.flatnonzero(bounds.min(axis=0) < enough_mm)
            if len(kept):
                yield _Candidates(place[kept] + begin, face[kept], bounds[:, kept])


def _near(
    piece: Piece, faces: FloatArray, places: Places, enough_mm: float
) -> tuple[IntArray, IntArray]:
    """(P,) places and faces that may be nearer than what is enough, in the order of places.

    The piece, sweeping through all states, is held in a cylinder about the axis, the face in a
    ball.
    """
    middles, radii = _balls(faces)
    shift = -np.einsum("in,ijn->jn", places.origins_mm, places.rotations)
    x, y, z = (middles.T @ places.rotations[:, k] + shift[k] for k in range(3))
    low, high, away = piece.extent_mm
    lowest, highest = places.shifts_mm.min(axis=0), places.shifts_mm.max(axis=0)
    middle, spread = (lowest + highest) / 2, (highest - lowest) / 2
    x += middle[0]
    y += middle[1]
    z += middle[2] - (low + high) / 2
    sideways = np.sqrt(x**2 + y**2) - (away + np.hypot(spread[0], spread[1]))
    ahead = np.abs(z) - (spread[2] + (high - low) / 2)
    np.maximum(sideways, 0.0, out=sideways)
    np.maximum(ahead, 0.0, out=ahead)
    near = sideways**2 + ahead**2 < (enough_mm + radii[:, None]) ** 2
    place, face = np.nonzero(np.ascontiguousarray(near.T))
    return place, face


def _bounds(piece: Piece, corners: FloatArray, shifts: FloatArray) -> FloatArray:
    """(S, P) lower bounds of the distance: those of a few directions are linear in the shift."""
    still = np.full(corners.shape[2], -np.inf)
    bounds = np.full((len(shifts), corners.shape[2]), -np.inf)
    # Most often everything moves along the axis alone.
    moving = np.flatnonzero(shifts.any(axis=0))
    buffer = np.empty_like(bounds)
    for direction, forwards, backwards in directions_apart(piece, corners):
        if not direction[moving].any():
            np.maximum(still, np.maximum(forwards, backwards), out=still)
            continue
        moved = shifts[:, moving] @ direction[moving]
        np.maximum(bounds, np.add(moved, forwards, out=buffer), out=bounds)
        np.maximum(bounds, np.subtract(backwards, moved, out=buffer), out=bounds)
    np.maximum(bounds, still, out=bounds)
    return bounds


def _balls(faces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(3, F) centres and (F,) radii of balls that hold faces, nearly the smallest."""
    pairs = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)])
    apart = faces[pairs[:, 0]] - faces[pairs[:, 1]]
    longest = np.einsum("pif,pif->pf", apart, apart).argmax(axis=0)
    # About the middle of what is farthest apart a rectangle is held by half of that, and so is a
    # triangle that is right or obtuse.
    ends = pairs[longest]
    index = np.arange(faces.shape[2])
    middles = (faces[ends[:, 0], :, index] + faces[ends[:, 1], :, index]).T / 2
    reach = np.linalg.norm(faces - middles, axis=1).max(axis=0)
    return middles, reach
