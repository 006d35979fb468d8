"""Which focus settings put the sharp plane where it can be used: the strip of a zoom lens.

A lens that is not parfocal images finite distances over a small part of its focus travel only, and
which part depends on the zoom. Vergences 1/D are used, since they pass smoothly through infinity.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.optimize import brentq

#: Pieces of the travel that are searched for the ends of the strip, one end per piece at most.
_PIECES: Final = 96
#: Ends of the strip are met to this many controller units.
_TOLERANCE: Final = 1e-10

Function = Callable[[float], float]


def interval_between(
    value: Function, low: Function, high: Function, travel: tuple[float, float]
) -> tuple[float, float] | None:
    """Find where a function lies between two others, however short that interval is.

    Parameters
    ----------
    value
        The function; it may have poles.
    low, high
        The functions that it has to lie between.
    travel
        Where to look.

    Returns
    -------
    tuple of float, or None
        Ends of the first such interval; None when there is none.
    """
    ends = [travel[0], travel[1]]
    for limit in (low, high):
        ends += _crossings(lambda x, limit=limit: value(x) - limit(x), travel)  # type: ignore[misc]
    pieces = [
        (start, end)
        for start, end in pairwise(sorted(ends))
        if end > start and low(middle := (start + end) / 2) <= value(middle) <= high(middle)
    ]
    if not pieces:
        return None
    first, last = pieces[0]
    for start, end in pieces[1:]:
        last = end if start == last else last
    return first, last


def _crossings(difference: Function, travel: tuple[float, float]) -> list[float]:
    """Find where a function changes its sign: at roots, and at poles, which do no harm here."""
    places = np.linspace(*travel, _PIECES + 1)
    signs = np.sign([difference(float(x)) for x in places])
    return [
        float(brentq(difference, places[i], places[i + 1], xtol=_TOLERANCE))
        for i in np.flatnonzero(signs[:-1] * signs[1:] < 0)
    ]
