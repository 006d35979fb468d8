"""A tree of boxes about many small things, asked by many questions at once.

The tree is complete and binary, so it needs no pointers: the children of box k are 2 k and 2 k + 1
of the next level. It is asked breadth first, all pairs of a question and a box as arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray

#: Things in a box that is not divided further.
_LEAF: Final = 4
#: The first level whose boxes are tried: those above it sort out nothing.
_FIRST: Final = 3
#: Pairs of question and box that are worked on at once, so that they stay in the cache.
_PAIRS_AT_ONCE: Final = 16_384
#: By how much boxes grow, as a share of their coordinates, lest rounding makes them too small.
_ROUNDING: Final = 1e-15

#: Tells which pairs may meet, given as (K,) questions and (K, 3) centres and half sizes of boxes.
Meets = Callable[[IntArray, FloatArray, FloatArray], BoolArray]


class BoxTree:
    """Boxes within boxes.

    Parameters
    ----------
    low, high
        (N, 3) corners of the box about each thing; at least one.
    """

    def __init__(self, low: FloatArray, high: FloatArray) -> None:
        count = len(low)
        depth = max(0, int(np.ceil(np.log2(count / _LEAF))))
        leaf = -(-count // 2**depth)
        slots = leaf * 2**depth
        # Some things stand twice, next to themselves, so that all leaves are of one size.
        thing = np.arange(slots) * count // slots
        low, high = low[thing], high[thing]
        middles = (low + high) / 2
        order = np.arange(slots)
        for level in range(depth):
            rows = order.reshape(2**level, -1)
            extent = np.stack([np.ptp(middles[:, k][rows], axis=1) for k in range(3)], axis=-1)
            key = middles[rows, extent.argmax(axis=1)[:, None]]
            split = np.argpartition(key, rows.shape[1] // 2, axis=1)
            order = np.take_along_axis(rows, split, axis=1).ravel()
        leaves = order.reshape(2**depth, leaf)
        repeated = np.diff(thing, prepend=-1) == 0
        self._leaves: IntArray = np.where(repeated, -1, thing)[leaves]
        lows, highs = [low[leaves].min(axis=1)], [high[leaves].max(axis=1)]
        for _ in range(depth):
            lows.append(np.minimum(lows[-1][::2], lows[-1][1::2]))
            highs.append(np.maximum(highs[-1][::2], highs[-1][1::2]))
        self._centres = [(a + b) / 2 for a, b in zip(lows[::-1], highs[::-1], strict=True)]
        self._halves = [
            (b - a) / 2 + _ROUNDING * (np.abs(a) + np.abs(b))
            for a, b in zip(lows[::-1], highs[::-1], strict=True)
        ]

    def pairs(self, questions: IntArray, meets: Meets) -> Iterator[tuple[IntArray, IntArray]]:
        """Find all pairs of a question and a thing whose boxes meet.

        Parameters
        ----------
        questions
            (Q,) numbers of the questions; they are handed on to `meets`.
        meets
            Judges pairs. It is asked again at every level and may change its mind: a question
            that has been answered meanwhile need not be followed any further.

        Yields
        ------
        questions : IntArray
            (K,) numbers of questions.
        things : IntArray
            (K,) indices of things; no pair comes twice.
        """
        last = len(self._centres) - 1
        first = min(last, _FIRST)
        boxes = np.arange(2**first)
        step = max(1, _PAIRS_AT_ONCE // len(boxes))
        parts = [questions[start : start + step] for start in range(0, len(questions), step)]
        stack = [(first, np.repeat(q, len(boxes)), np.tile(boxes, len(q))) for q in parts]
        while stack:
            level, asked, box = stack.pop()
            centre, half = self._centres[level].take(box, 0), self._halves[level].take(box, 0)
            met = np.flatnonzero(meets(asked, centre, half))
            if not len(met):
                continue
            asked, box = asked[met], box[met]
            if level == last:
                things = self._leaves.take(box, 0)
                row, column = np.nonzero(things >= 0)
                yield asked[row], things[row, column]
                continue
            asked, children = np.repeat(asked, 2), np.stack([2 * box, 2 * box + 1], -1).ravel()
            for start in range(0, len(asked), _PAIRS_AT_ONCE):
                part = slice(start, start + _PAIRS_AT_ONCE)
                stack.append((level + 1, asked[part], children[part]))


def squared_distance(points: FloatArray, centres: FloatArray, halves: FloatArray) -> FloatArray:
    """Measure how far points are from boxes.

    Parameters
    ----------
    points
        (K, 3) points.
    centres, halves
        (K, 3) centre and half size of a box for each.

    Returns
    -------
    FloatArray
        (K,) squared distances, zero inside.
    """
    beyond = np.abs(centres - points) - halves
    np.maximum(beyond, 0.0, out=beyond)
    squared: FloatArray = np.einsum("ki,ki->k", beyond, beyond)
    return squared
