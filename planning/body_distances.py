"""How far a piece of a camera is from faces, at many places and in many lens states at once.

A piece slides along the axis with the lens state. Most places end at a bound that holds for all
states at once; of the rest, the face that seems to be nearest is measured first, and others only
where they may be nearer still.
"""

from __future__ import annotations

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


def _settled(piece: Piece, faces: FloatArray, places: Places, enough_mm: float) -> FloatArray:
    count, states = places.origins_mm.shape[1], len(places.shifts_mm)
    found = np.full((states, count), np.inf)
    place, face, bounds = _candidates(piece, faces, places, enough_mm)
    if not len(place):
        return found

    def shifted(state: IntArray, pair: IntArray) -> FloatArray:
        corners = places.in_camera(faces, place[pair], face[pair])
        corners += places.shifts_mm[state].T
        return corners

    starts = np.flatnonzero(np.diff(place, prepend=-1))
    of_place = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(place)))
    lowest = np.minimum.reduceat(bounds, starts, axis=1)
    # First, in each place and state, what seems to be nearest.
    state, pair = np.nonzero((bounds == lowest.take(of_place, 1)) & (bounds < enough_mm))
    group = state * count + place[pair]
    first = np.diff(group, prepend=-1) > 0
    state, pair, group = state[first], pair[first], group[first]
    flat = found.reshape(-1)
    flat[group], direction = separation_mm(
        piece, shifted(state, pair), group, enough_mm, bounds[state, pair]
    )
    bounds[state, pair] = np.inf
    directions = np.zeros((3, found.size))
    directions[:, group] = direction
    # Then what may be nearer still, one by one: not what lies beyond in a direction that was found.
    limit = np.minimum(found.take(place[starts], 1), enough_mm)
    state, pair = np.nonzero(bounds < limit.take(of_place, 1))
    group, corners, known = state * count + place[pair], shifted(state, pair), bounds[state, pair]
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
) -> tuple[IntArray, IntArray, FloatArray]:
    """Places and faces that are not known to be far enough, and (S, P) lower bounds in mm."""
    shifts = places.shifts_mm
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((len(shifts), 0)))]
    step = max(1, _LOOKED_AT // faces.shape[2])
    for begin in range(0, places.origins_mm.shape[1], step):
        block = places.some(slice(begin, begin + step))
        near, of = _near(piece, faces, block, enough_mm)
        for start in range(0, len(near), _BOUNDED):
            place, face = near[start : start + _BOUNDED], of[start : start + _BOUNDED]
            corners = block.in_camera(faces, place, face)
            bounds = _bounds(piece, corners, shifts)
            kept = np.flatnonzero(bounds.min(axis=0) < enough_mm)
            found.append((place[kept] + begin, face[kept], bounds[:, kept]))
    place, face = (np.concatenate([part[k] for part in found]) for k in range(2))
    return place, face, np.concatenate([part[2] for part in found], axis=1)


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
