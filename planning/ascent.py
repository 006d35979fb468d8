"""Raising the smallest of several margins: a bundle method with linear programmes.

Every margin is itself the smallest of many — of corners, sides, triangles — so that the landscape
is full of ridges, on which a single gradient says nothing. So the slopes at all places that were
tried nearby are kept: each is a plane that the margin hardly exceeds, and a linear programme finds
the highest point under all planes within a trust region. What disappoints there adds the plane that
was missing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linprog

from lenscal.arrays import BoolArray, FloatArray, IntArray

#: (P,) which points, and (P, J, n) J moves of each, to (P, J, R) margins.
Margins = Callable[[IntArray, FloatArray], FloatArray]

#: Step of the differences.
_STEP: Final = 1e-6
#: Planes that are kept of each margin.
_PLANES: Final = 24
#: Planes from farther away than this many trust regions are left out.
_NEARBY: Final = 4.0
#: Shares of the step that the linear programme proposes at which the margins are looked at.
_TRIED: Final = np.array([1.0, 0.5, 0.2])
_GROW, _SHRINK = 2.0, 0.5
#: A margin that says −inf counts as this.
_NOTHING: Final = -1e3


@dataclass(frozen=True, slots=True, eq=False)
class Ascent:
    """Where K points ended.

    Parameters
    ----------
    moves
        (K, n) from the start of each.
    margins
        (K, R) there.
    """

    moves: FloatArray
    margins: FloatArray


def raise_smallest(
    margins: Margins,
    shape: tuple[int, int],
    *,
    raised: BoolArray,
    limits: tuple[FloatArray, FloatArray] | None = None,
    weights: FloatArray | None = None,
    radius: float = 0.1,
    rounds: int = 30,
    settled: float = 3e-5,
) -> Ascent:
    """Move K points so that the smallest of some margins becomes as large as can be nearby.

    Parameters
    ----------
    margins
        Gives (P, J, R) margins for P of the points and (P, J, n) moves, counted from the start of
        each.
    shape
        K and n.
    raised
        (R,) or (K, R) the margins whose smallest is raised. The others shall be positive: as long
        as one is not, the smallest of those is raised instead.
    limits
        (K, n) lowest and highest moves; None for none.
    weights
        (K, R) what each margin is multiplied with; None for 1.
    radius
        How far the first step may go along each axis.
    rounds
        How many steps.
    settled
        Trust region, and promised gain, at which a point has settled.

    Returns
    -------
    Ascent
        The ends; no point ends worse than it started.
    """
    count = shape[0]
    low, high = limits or (np.full(shape, -np.inf), np.full(shape, np.inf))
    at = np.zeros(shape)
    now, slopes, _ = _with_slopes(margins, np.arange(count), at, high)
    raised = np.broadcast_to(raised, now.shape)
    climbers = [_Climber(raised[k], radius, low[k], high[k]) for k in range(count)]
    if weights is None:
        weights = np.ones_like(now)
    for k, climber in enumerate(climbers):
        climber.learn(at[k], now[k], slopes[k])
    for _ in range(rounds):
        steps = np.zeros_like(at)
        for k, climber in enumerate(climbers):
            if climber.region > settled:
                steps[k], promised = climber.step(at[k], now[k], weights[k])
                climber.region *= promised > settled
        moving = np.flatnonzero([climber.region > settled for climber in climbers])
        if not len(moving):
            break
        shorter = at[moving, None] + _TRIED[1:, None] * steps[moving, None]
        found, slopes, less = _with_slopes(
            margins, moving, at[moving] + steps[moving], high, shorter
        )
        tried = np.concatenate([found[:, None], less], axis=1)
        merit = _merit(tried * weights[moving, None], raised[moving, None])
        before = _merit(now[moving] * weights[moving], raised[moving])
        best = merit.argmax(axis=1)
        missing = []
        for row, k in enumerate(map(int, moving)):
            climber = climbers[k]
            climber.learn(at[k] + steps[k], found[row], slopes[row])
            if merit[row, best[row]] > before[row]:
                at[k] = at[k] + _TRIED[best[row]] * steps[k]
                now[k] = tried[row, best[row]]
                if best[row] == 0:
                    climber.region *= _GROW
                else:
                    missing.append(k)
            else:
                climber.region *= _SHRINK
        if missing:
            found, slopes, _ = _with_slopes(margins, np.array(missing), at[missing], high)
            for row, k in enumerate(missing):
                climbers[k].learn(at[k], found[row], slopes[row])
    return Ascent(at, now)


class _Climber:
    """The planes that one point knows, and its trust region."""

    def __init__(self, raised: BoolArray, region: float, low: FloatArray, high: FloatArray) -> None:
        self.region = region
        self._raised, self._low, self._high = raised, low, high
        size = len(low)
        self._places = np.zeros((0, size))
        self._values = np.zeros((0, len(raised)))
        self._slopes = np.zeros((0, len(raised), size))

    def learn(self, place: FloatArray, values: FloatArray, slopes: FloatArray) -> None:
        """Keep the planes of all margins at a place."""
        kept = slice(-_PLANES + 1, None)
        self._places = np.concatenate([self._places[kept], place[None]])
        self._values = np.concatenate([self._values[kept], values[None]])
        self._slopes = np.concatenate([self._slopes[kept], slopes[None]])

    def step(
        self, at: FloatArray, now: FloatArray, weights: FloatArray
    ) -> tuple[FloatArray, float]:
        """Give the step to the highest point under all planes, and what they promise there."""
        raised, size = self._raised, len(at)
        held = ~raised
        if held.any() and (now[held] < 0).any():
            raised, held, weights = held, np.zeros_like(held), np.ones_like(weights)
        away = np.abs(self._places - at).max(axis=1)
        near = away <= _NEARBY * self.region
        slopes = self._slopes[near]
        # Heights of the planes here; where a margin bends upwards one may lie below it, and is
        # lifted to it.
        height = self._values[near] + np.einsum("bri,bi->br", slopes, at - self._places[near])
        height = np.maximum(height, now)
        planes = slopes[:, raised] * weights[raised, None]
        blocks = [np.concatenate([-planes, np.ones((*planes.shape[:2], 1))], axis=2)]
        limits = [height[:, raised] * weights[raised]]
        if held.any():
            planes = slopes[:, held]
            blocks.append(np.concatenate([-planes, np.zeros((*planes.shape[:2], 1))], axis=2))
            limits.append(height[:, held])
        objective = np.zeros(size + 1)
        objective[-1] = -1.0
        lowest = np.maximum(-self.region, self._low - at)
        highest = np.minimum(self.region, self._high - at)
        bounds = [*zip(lowest, highest, strict=True), (None, None)]
        found = linprog(
            objective,
            np.concatenate([b.reshape(-1, size + 1) for b in blocks]),
            np.concatenate([limit.reshape(-1) for limit in limits]),
            bounds=bounds,
            options={"presolve": False},
        )
        if found.x is None:
            return np.zeros(size), 0.0
        here = float((now[raised] * weights[raised]).min())
        return found.x[:size], float(found.x[-1]) - here


def _with_slopes(
    margins: Margins,
    which: IntArray,
    at: FloatArray,
    high: FloatArray,
    others: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(P, R) margins of points at (P, n) moves, (P, R, n) their slopes, and those of others."""
    size = at.shape[1]
    step = np.where(at + _STEP > high[which], -_STEP, _STEP)
    aside = np.concatenate([np.zeros((len(at), 1, size)), step[:, None] * np.eye(size)], axis=1)
    moves = at[:, None] + aside
    found = margins(which, moves if others is None else np.concatenate([moves, others], axis=1))
    found, others = _finite(found[:, : size + 1]), _finite(found[:, size + 1 :])
    slopes = (found[:, 1:] - found[:, :1]) / step[..., None]
    return found[:, 0], np.moveaxis(slopes, 1, 2), others


def _merit(margins: FloatArray, raised: BoolArray) -> FloatArray:
    """(...) how much (..., R) margins please: that the others hold counts first."""
    wanted = np.where(raised, margins, np.inf).min(axis=-1)
    held = np.where(raised, np.inf, margins).min(axis=-1)
    merit: FloatArray = np.where(held >= 0, np.maximum(wanted, _NOTHING), 2 * _NOTHING + held)
    return np.where(raised.all(axis=-1), wanted, merit)


def _finite(margins: FloatArray) -> FloatArray:
    numbers = np.nan_to_num(margins, nan=_NOTHING)
    return np.asarray(np.clip(numbers, _NOTHING, -_NOTHING), dtype=np.float64)
