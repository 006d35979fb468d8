"""A tree of boxes about many small things, asked by many questions at once.

The tree is complete and binary, so it needs no pointers: the children of box k are 2 k and 2 k + 1
of the next level. It is asked breadth first, all pairs of a question and a box as arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import reduce
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray

#: Things in a box that is not divided further.
_LEAF: Final = 4
#: The first level whose boxes are tried: those above it sort out nothing.
_FIRST: Final = 3
#: Pairs of question and box that are worked on at once, so that they stay in the cache.
_PAIRS_AT_ONCE: Final = 16_384
#: Rows that are shorter are reduced column by column.
_SHORT: Final = 64
#: By how much boxes grow, as a share of their coordinates, lest rounding makes them too small.
_ROUNDING: Final = 1e-15

#: Tells which pairs may meet, given as (K,) questions, (3, K) centres and half sizes of boxes, and
#: (K,) one thing of each box, near its centre.
Meets = Callable[[IntArray, FloatArray, FloatArray, IntArray], BoolArray]


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
        middles = np.ascontiguousarray((low + high).T / 2)
        order, places = np.arange(slots), middles.take(thing, 1)
        for level in range(depth):
            rows = places.reshape(3, 2**level, -1)
            width = rows.shape[-1]
            axis = (_over_rows(np.maximum, rows) - _over_rows(np.minimum, rows)).argmax(axis=0)
            key = rows[axis, np.arange(2**level)]
            split = np.argpartition(key, width // 2, axis=1)
            split += np.arange(0, slots, width)[:, None]
            order, places = order.take(split.ravel()), places.take(split.ravel(), 1)
        of_slot = thing.take(order)
        repeated = np.diff(thing, prepend=-1) == 0
        self._leaves: IntArray = np.where(repeated.take(order), -1, of_slot).reshape(-1, leaf)
        in_leaves = of_slot.reshape(-1, leaf)
        lows = _over_rows(np.minimum, np.moveaxis(low.take(in_leaves, 0), -1, 0))
        highs = _over_rows(np.maximum, np.moveaxis(high.take(in_leaves, 0), -1, 0))
        chosen = in_leaves[:, 0]
        #: For each level (6, boxes): centres, then half sizes; and one thing near each centre.
        self._boxes: list[FloatArray] = []
        self._things: list[IntArray] = []
        for level in range(depth, -1, -1):
            if level < depth:
                lows = np.minimum(lows[:, ::2], lows[:, 1::2])
                highs = np.maximum(highs[:, ::2], highs[:, 1::2])
                first, second = chosen[::2], chosen[1::2]
                away, other = (
                    np.abs(middles.take(k, 1) - (lows + highs) / 2).sum(axis=0)
                    for k in (first, second)
                )
                chosen = np.where(away <= other, first, second)
            halves = (highs - lows) / 2 + _ROUNDING * (np.abs(lows) + np.abs(highs))
            self._boxes.insert(0, np.concatenate([(lows + highs) / 2, halves]))
            self._things.insert(0, chosen)

    @classmethod
    def about(cls, triangles: FloatArray) -> BoxTree:
        """Put boxes about triangles.

        Parameters
        ----------
        triangles
            (N, 3, 3) corners; at least one triangle.

        Returns
        -------
        BoxTree
            The tree.
        """
        corners = np.moveaxis(triangles, 1, -1)
        return cls(_over_rows(np.minimum, corners), _over_rows(np.maximum, corners))

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
        last = len(self._boxes) - 1
        first = min(last, _FIRST)
        boxes = np.arange(2**first)
        step = max(1, _PAIRS_AT_ONCE // len(boxes))
        parts = [questions[start : start + step] for start in range(0, len(questions), step)]
        stack = [(first, np.repeat(q, len(boxes)), np.tile(boxes, len(q))) for q in parts]
        while stack:
            level, asked, box = stack.pop()
            where = self._boxes[level].take(box, 1)
            met = np.flatnonzero(meets(asked, where[:3], where[3:], self._things[level].take(box)))
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


def _over_rows(choose: np.ufunc, rows: FloatArray) -> FloatArray:
    """Reduce along the last axis; numpy itself is slow where that is short."""
    if rows.shape[-1] > _SHORT:
        return np.asarray(choose.reduce(rows, axis=-1))
    return np.asarray(reduce(choose, np.moveaxis(rows, -1, 0)))


def squared_distance(points: FloatArray, centres: FloatArray, halves: FloatArray) -> FloatArray:
    """Measure how far points are from boxes.

    Parameters
    ----------
    points
        (3, K) points.
    centres, halves
        (3, K) centre and half size of a box for each.

    Returns
    -------
    FloatArray
        (K,) squared distances, zero inside.
    """
    beyond = np.abs(centres - points) - halves
    np.maximum(beyond, 0.0, out=beyond)
    squared: FloatArray = np.einsum("ik,ik->k", beyond, beyond)
    return squared
