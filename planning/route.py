"""The order in which viewpoints are visited, so that the hand travels little.

From pose to pose the travel is the translation in mm plus the angle of rotation times a lever, and,
where it is asked for, how far the motors of the lens go times a rate. The path is open: it starts
where it is best, or at a stated pose, and ends anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.errors import InputError
from lenscal.pose import Pose

#: What a rotation by one radian counts, in mm: about the length from wrist to lens.
LEVER_MM: Final = 200.0
#: Up to how many viewpoints the shortest route is found for certain.
EXACT_UP_TO: Final = 12
#: From how many viewpoints routes are started, at most.
_STARTS: Final = 16
#: How many neighbours in a row or-opt moves.
_SEGMENT: Final = 3
#: What a move must gain, as a share of the whole, lest rounding moves for ever.
_GAIN: Final = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """An order of viewpoints.

    Parameters
    ----------
    order
        (N,) indices.
    travel_mm
        Sum of the travel from each to the next.
    is_shortest
        Whether no order is shorter for certain.
    """

    order: IntArray
    travel_mm: float
    is_shortest: bool


def travel_between_mm(
    poses: Sequence[Pose],
    lever_mm: float = LEVER_MM,
    settings: npt.ArrayLike | None = None,
    mm_per_step: float = 0.0,
) -> FloatArray:
    """Measure the travel from every pose to every other.

    Parameters
    ----------
    poses
        N poses.
    lever_mm
        What a rotation by one radian counts, in mm.
    settings
        (N, K) settings of the lens there, such as zoom and focus; None to leave the lens out.
    mm_per_step
        What one unit of the setting that changes most counts, in mm.

    Returns
    -------
    FloatArray
        (N, N) mm, symmetric.

    Raises
    ------
    InputError
        When lever or rate is negative.
    """
    for name, value in (("lever_mm", lever_mm), ("mm_per_step", mm_per_step)):
        if not (np.isfinite(value) and value >= 0):
            raise InputError(f"{name} must be zero or positive, but is {value:g}")
    places = np.array([pose.translation_mm for pose in poses]).reshape(-1, 3)
    turns = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
    shift = np.linalg.norm(places[:, None] - places, axis=-1)
    # tr(Aᵀ B) = 1 + 2 cos φ loses digits where A and B are close: ‖A − B‖ = 2 √2 sin(φ/2) does not.
    apart = np.linalg.norm((turns[:, None] - turns).reshape(len(turns), len(turns), 9), axis=-1)
    angle = 2 * np.arcsin(np.minimum(apart / np.sqrt(8.0), 1.0))
    travel: FloatArray = shift + lever_mm * angle
    if settings is not None and mm_per_step > 0:
        steps = frozen_array("settings", settings, (len(places), "K"), finite=False)
        moved = np.abs(np.nan_to_num(steps)[:, None] - np.nan_to_num(steps)).max(axis=-1)
        travel = travel + mm_per_step * moved
    return travel


def shortest_route(travel_mm: FloatArray, start: int | None = None) -> Route:
    """Order viewpoints so that the way through all of them is short.

    Up to twelve the shortest way of all is found, by the recursion of Held and Karp (1962). Beyond
    that, ways by nearest neighbours from several starts are improved by turning stretches around
    (2-opt) and moving up to three neighbours elsewhere (or-opt) until neither helps.

    Parameters
    ----------
    travel_mm
        (N, N) travel between them, symmetric.
    start
        Which one is the first; None for whichever is best.

    Returns
    -------
    Route
        The order; the same for the same input.

    Raises
    ------
    InputError
        When the travel is not symmetric, or there is no such start.
    """
    travel = frozen_array("travel_mm", travel_mm, ("N", "N"))
    count = len(travel)
    if travel.shape != (count, count) or not np.allclose(travel, travel.T, rtol=1e-9, atol=1e-9):
        raise InputError(
            f"travel must be the same from one viewpoint to another and back, an (N, N) symmetric "
            f"matrix, but was given with shape {travel.shape}; make it with travel_between_mm"
        )
    if start is not None and not 0 <= start < count:
        raise InputError(f"there is no viewpoint {start} to start from; there are {count}")
    if count < 2:
        return Route(np.arange(count), 0.0, True)
    if count <= EXACT_UP_TO:
        order = _exact(travel, start)
    else:
        starts = dict.fromkeys(i * count // _STARTS for i in range(_STARTS))
        found = [_improved(_nearest(travel, s), travel, start) for s in starts]
        order = min(found, key=lambda o: _length(o, travel))
    # Forth and back are as long: the lower end comes first.
    if start is None and order[0] > order[-1]:
        order = order[::-1]
    return Route(order, _length(order, travel), count <= EXACT_UP_TO)


def _length(order: IntArray, travel: FloatArray) -> float:
    return float(travel[order[:-1], order[1:]].sum())


def _exact(travel: FloatArray, start: int | None) -> IntArray:
    """The shortest way that visits a set and ends at one of it, for ever larger sets."""
    count = len(travel)
    members = (np.arange(2**count)[:, None] >> np.arange(count)) & 1 == 1
    length = np.full((2**count, count), np.inf)
    before = np.full((2**count, count), -1, dtype=np.int64)
    for first in range(count) if start is None else (start,):
        length[1 << first, first] = 0.0
    sizes = members.sum(axis=1)
    for size in range(2, count + 1):
        sets = np.flatnonzero(sizes == size)
        for end in range(count):
            with_end = sets[members[sets, end]]
            ways = length[with_end ^ (1 << end)] + travel[:, end]
            best = ways.argmin(axis=1)
            length[with_end, end] = ways[np.arange(len(best)), best]
            before[with_end, end] = best
    visited = 2**count - 1
    end = int(length[visited].argmin())
    order = []
    while end >= 0:
        order.append(end)
        visited, end = visited ^ (1 << end), int(before[visited, end])
    return np.array(order[::-1])


def _nearest(travel: FloatArray, start: int) -> IntArray:
    left = np.ones(len(travel), dtype=bool)
    order = [start]
    left[start] = False
    while left.any():
        order.append(int(np.where(left, travel[order[-1]], np.inf).argmin()))
        left[order[-1]] = False
    return np.array(order)


def _improved(order: IntArray, travel: FloatArray, start: int | None) -> IntArray:
    """Apply the best of all moves until none helps; a stated start stays where it is."""
    # Two more places end the way, at no distance from all: what lies beside them is free to move.
    # If the start is stated, the first of the two is far from all others.
    count = len(order)
    padded = np.zeros((count + 2, count + 2))
    padded[:count, :count] = travel
    if start is not None:
        order = np.concatenate([[start], order[order != start]])
        far = np.where(np.arange(count) == start, 0.0, 1.0 + float(travel.sum()))
        padded[count, :count] = padded[:count, count] = far
    way = np.concatenate([[count], order, [count + 1]])
    least = _GAIN * float(travel.max()) * count
    while True:
        gain, changed = max(_turned(way, padded), _moved(way, padded), key=lambda move: move[0])
        if gain <= least:
            return way[1:-1]
        way = changed


def _turned(way: IntArray, travel: FloatArray) -> tuple[float, IntArray]:
    """2-opt: turn the stretch i … j around."""
    legs = travel[way[:-1], way[1:]]
    inner, last = way[1:-1], len(way) - 2
    before, after = way[:-2], way[2:]
    new = travel[before[:, None], inner[None, :]] + travel[inner[:, None], after[None, :]]
    gain = np.triu(legs[:last, None] + legs[None, 1:] - new, k=1)
    i, j = np.unravel_index(int(gain.argmax()), gain.shape)
    changed = way.copy()
    changed[i + 1 : j + 2] = changed[i + 1 : j + 2][::-1]
    return float(gain[i, j]), changed


def _moved(way: IntArray, travel: FloatArray) -> tuple[float, IntArray]:
    """Or-opt: take up to three neighbours out and put them between two others, either way round."""
    best, changed = 0.0, way
    legs = travel[way[:-1], way[1:]]
    for size in range(1, min(_SEGMENT, len(way) - 3) + 1):
        first = np.arange(1, len(way) - size)
        last = first + size - 1
        freed = legs[first - 1] + legs[last] - travel[way[first - 1], way[last + 1]]
        gap = np.arange(len(way) - 1)
        # A gap that the stretch itself touches is none.
        own = (gap >= first[:, None] - 1) & (gap <= last[:, None])
        for one, other in ((first, last), (last, first)):
            joined = travel[way[gap], way[one][:, None]] + travel[way[other][:, None], way[gap + 1]]
            gain = np.where(own, -np.inf, freed[:, None] - (joined - legs))
            i, g = np.unravel_index(int(gain.argmax()), gain.shape)
            if gain[i, g] > best:
                best = float(gain[i, g])
                stretch = way[first[i] : last[i] + 1]
                stretch = stretch if one is first else stretch[::-1]
                rest = np.delete(way, np.s_[first[i] : last[i] + 1])
                at = g + 1 if g < first[i] else g + 1 - size
                changed = np.insert(rest, at, stretch)
    return best, changed
