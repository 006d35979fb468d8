"""How far a piece of a camera is from faces, at many places and in many lens states at once.

Groups of faces that no lens state brings near are left out at once. Of the rest, every face is
bounded in all states; where the one that seems to be nearest certainly overlaps, no more is to be
known. Elsewhere the one that seems to be nearest is measured first, and others only where they may
be nearer still.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.camera_body import Piece
from planning.face_bounds import FaceBounds, Places
from planning.face_groups import FaceGroup, face_groups
from planning.separation import gap_mm, separation_mm
from planning.vectors import along

#: How large a group of faces may be, as a share of how far it may be from the axis and count.
_SIZE: Final = 3.0
#: Pairs of place and face that are bounded at once, and that are turned at once, so that they stay
#: in the cache; pairs of place and state that are settled together.
_BOUNDED: Final = 32_768
_TURNED: Final = 8_192
_SETTLED: Final = 2_000_000
#: What is nearer by less is as near.
_ROUNDING_MM: Final = 1e-9


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
    groups = face_groups(faces, _SIZE * (enough_mm + piece.extent_mm[2]))
    step = max(1, _SETTLED // states)
    for start in range(0, count, step):
        part = slice(start, start + step)
        some = _some(places, part)
        candidates = _Candidates(some)
        for group in groups:
            candidates.look_at(piece, group, enough_mm)
        found[:, part] = _settled(piece, faces, some, candidates, enough_mm)
    return found


class _Candidates:
    """What may be the nearest face, at each place in each state.

    Parameters
    ----------
    places
        N places, S states.
    """

    def __init__(self, places: Places) -> None:
        self._places = places
        shape = (len(places.shifts_mm), places.origins_mm.shape[1])
        #: (S, N) the lowest bound, and the face that has it.
        self.lowest: FloatArray = np.full(shape, np.inf)
        self.face: IntArray = np.zeros(shape, dtype=int)
        #: (S, N) the distance of what certainly overlaps, and what the nearest of all is at most.
        self.overlap: FloatArray = np.full(shape, np.inf)
        self.at_most: FloatArray = np.full(shape, np.inf)
        #: States, places, faces and bounds of what has to be measured.
        self._to_measure: list[tuple[IntArray, IntArray, IntArray, FloatArray]] = []

    def look_at(self, piece: Piece, group: FaceGroup, enough_mm: float) -> None:
        """Bound the faces of a group wherever it may be near."""
        near = _near(piece, group, self._places, enough_mm)
        step = max(1, _BOUNDED // len(group.numbers))
        for start in range(0, len(near), step):
            which = near[start : start + step]
            bounds = FaceBounds(piece, group, _some(self._places, which))
            self._note(bounds, group.numbers, which, enough_mm)

    def to_measure(self) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
        """States, places, faces and bounds of all that has to be measured."""
        nothing = np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0, dtype=int)
        lists = [(*nothing, np.zeros(0)), *self._to_measure]
        state, place, face, bound = (np.concatenate(column) for column in zip(*lists, strict=True))
        kept = self._wanted(state, place, face, bound)
        return state[kept], place[kept], face[kept], bound[kept]

    def _wanted(
        self, state: IntArray, place: IntArray, face: IntArray, bounds: FloatArray
    ) -> BoolArray:
        """Tell what may be as near as what is known, unless that certainly overlaps."""
        near = bounds <= self.at_most[state, place] + _ROUNDING_MM
        near |= self.face[state, place] == face
        return np.asarray(near & (bounds < self.overlap[state, place]))

    def _note(
        self, bounds: FaceBounds, numbers: IntArray, which: IntArray, enough_mm: float
    ) -> None:
        in_states = bounds.in_states()
        lowest = in_states.min(axis=1)
        known = self.lowest[:, which]
        state, column = np.nonzero(lowest < np.minimum(known, enough_mm))
        place = which[column]
        if len(state):
            face = in_states[state, :, column].argmin(axis=1)
            self.lowest[state, place] = bound = lowest[state, column]
            self.face[state, place] = numbers[face]
            reached = bounds.reached(state, face, column)
            # What overlaps is as negative as its bound.
            overlap = np.where(reached > 0, np.inf, bound)
            self.overlap[state, place] = np.minimum(self.overlap[state, place], overlap)
            at_most = np.minimum(reached, overlap)
            self.at_most[state, place] = np.minimum(self.at_most[state, place], at_most)
        # What may be nearest, unless that is known.
        state, column = np.nonzero(lowest < np.minimum(self.overlap[:, which], enough_mm))
        if len(state):
            each, place = in_states[state, :, column], which[column]
            row, face = np.nonzero(each < enough_mm)
            state, place, face, bound = state[row], place[row], numbers[face], each[row, face]
            kept = self._wanted(state, place, face, bound)
            self._to_measure.append((state[kept], place[kept], face[kept], bound[kept]))


def _settled(
    piece: Piece, faces: FloatArray, places: Places, candidates: _Candidates, enough_mm: float
) -> FloatArray:
    found = candidates.overlap
    state, place, face, known = candidates.to_measure()
    # Only places and states where something is to be measured are numbered.
    measured = np.zeros(found.shape, dtype=bool)
    measured[state, place] = True
    group = np.cumsum(measured).reshape(found.shape)[state, place] - 1
    nearest = np.full(np.count_nonzero(measured), np.inf)
    directions = np.zeros((3, len(nearest)))

    def corners_of(which: IntArray) -> FloatArray:
        corners = _in_camera(faces, places, place[which], face[which])
        corners += places.shifts_mm[state[which]].T
        return corners

    # First, in each place and state, what seems to be nearest.
    first = candidates.face[state, place] == face
    which = np.flatnonzero(first)
    nearest[group[which]], directions[:, group[which]] = separation_mm(
        piece, corners_of(which), group[which], enough_mm, known[which]
    )
    # Then what may be nearer still, one by one: not what lies beyond in a direction that was found.
    which = np.flatnonzero(~first & (known < np.minimum(nearest[group], enough_mm)))
    parts = np.array_split(which, len(which) // _TURNED + 1)
    faced: list[tuple[FloatArray, IntArray, FloatArray]] = []
    for part in parts:
        corners = corners_of(part)
        bound, left = _not_beyond(piece, corners, group[part], known[part], nearest, directions)
        faced.append((corners[..., left], group[part[left]], bound[left]))
    corners, group, known = (np.concatenate(column, axis=-1) for column in zip(*faced, strict=True))
    while len(group):
        ordered = np.lexsort((known, group))
        group, corners, known = group[ordered], corners[..., ordered], known[ordered]
        first = np.diff(group, prepend=-1) > 0
        distance, directions[:, group[first]] = separation_mm(
            piece, corners[..., first], group[first], enough_mm, known[first]
        )
        nearest[group[first]] = np.minimum(nearest[group[first]], distance)
        group, corners, known = group[~first], corners[..., ~first], known[~first]
        known, left = _not_beyond(piece, corners, group, known, nearest, directions)
        group, corners, known = group[left], corners[..., left], known[left]
    found[measured] = np.minimum(found[measured], nearest)
    return found


def _not_beyond(
    piece: Piece,
    corners: FloatArray,
    group: IntArray,
    known: FloatArray,
    found: FloatArray,
    directions: FloatArray,
) -> tuple[FloatArray, IntArray]:
    """(K,) better bounds by directions that were found, and which may be nearer than was found."""
    direction = directions[:, group]
    gap = gap_mm(piece, corners, direction)
    bounds = np.where(direction.any(axis=0), np.maximum(known, gap), known)
    return bounds, np.flatnonzero(bounds < found[group] - _ROUNDING_MM)


def _near(piece: Piece, group: FaceGroup, places: Places, enough_mm: float) -> IntArray:
    """(P,) places where a group of faces may be nearer than what is enough in some state.

    The piece, sweeping through all states, is held in a cylinder about the axis, the group in a
    ball.
    """
    away = group.centre_mm[:, None] - places.origins_mm
    x, y, z = (along(places.rotations[:, k], away) for k in range(3))
    low, high, radius = piece.extent_mm
    lowest, highest = places.shifts_mm.min(axis=0), places.shifts_mm.max(axis=0)
    middle, spread = (lowest + highest) / 2, (highest - lowest) / 2
    x += middle[0]
    y += middle[1]
    z += middle[2] - (low + high) / 2
    sideways = np.sqrt(x**2 + y**2) - (radius + np.hypot(spread[0], spread[1]))
    ahead = np.abs(z) - (spread[2] + (high - low) / 2)
    np.maximum(sideways, 0.0, out=sideways)
    np.maximum(ahead, 0.0, out=ahead)
    near = sideways**2 + ahead**2 < (enough_mm + group.radius_mm) ** 2
    return np.flatnonzero(near)


def _in_camera(faces: FloatArray, places: Places, place: IntArray, face: IntArray) -> FloatArray:
    """(4, 3, P) corners of faces in the frames of reference cameras, before any shift, in mm."""
    away = faces.take(face, 2)
    away -= places.origins_mm.take(place, 1)
    turned = places.rotations.take(place, 2)
    return np.stack([along(turned[:, k], away.transpose(1, 0, 2)) for k in range(3)], axis=1)


def _some(places: Places, which: slice | IntArray) -> Places:
    return Places(places.rotations[..., which], places.origins_mm[:, which], places.shifts_mm)
