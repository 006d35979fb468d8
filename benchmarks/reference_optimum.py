"""The best that one requirement can come to while all others hold, by a search of another kind.

Differential evolution over the settings, three rotations, two aims and the sharp plane, from the
best of many random views of the target's front; then COBYQA, with every other margin a constraint.
Neither has anything in common with how `planning` searches, except the margins.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from random_worlds import World
from scipy.optimize import NonlinearConstraint, differential_evolution, minimize
from scipy.spatial.transform import Rotation

from lenscal.arrays import FloatArray
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.incidence import Incidence
from planning.requirements.margin import Requirement
from planning.requirements.resolution import Resolution
from planning.requirements.visibility import Visibility
from planning.view_search import FoundViews
from planning.view_space import GeneralStarts

#: Random views, how many of them evolve, and for how long.
_DRAWN, _POPULATION, _GENERATIONS = 12_000, 80, 300
#: How far from the normal the random views look.
_TILT = np.radians(75)
#: How far aims and sharp plane may go.
_AIM, _DEFOCUS = 0.3, 0.3

Judge = Callable[[FloatArray], FoundViews[GeneralStarts]]


def tightened(requirement: Requirement, best: float, share: float) -> Requirement:
    """Ask for more than the best value of what it limits, by a share of that."""
    match requirement:
        case Resolution():
            return replace(requirement, pixels=best * (1 + share))
        case DepthOfField():
            return replace(requirement, blur_px=best * (1 - share))
        case Incidence():
            return replace(requirement, max_angle_deg=float(np.degrees(best)) * (1 - share))
        case Clearance() | Visibility():
            return replace(requirement, distance_mm=best * (1 + share))
    raise AssertionError(requirement)


def limited(requirement: Requirement, value: float) -> float:
    """What a requirement limits, from its margin: samples, blur, angle in rad, distance."""
    match requirement:
        case Resolution():
            return value + requirement.pixels
        case DepthOfField():
            return requirement.blur_px - value
        case Incidence():
            return float(np.radians(requirement.max_angle_deg)) - value
        case Clearance() | Visibility():
            return value + requirement.distance_mm
    raise AssertionError(requirement)


def optimum(world: World, index: int, rng: np.random.Generator) -> float:
    """Best margin of one requirement while all others hold."""
    requirements = [*world.task.requirements, Visibility()]
    start, count = world.planted, world.planted.settings.size
    bare = replace(start, shares=np.zeros((1, count)), aims=np.zeros((1, 2)))
    high = np.array([1.0] * count + [np.pi] * 3 + [_AIM] * 2 + [_DEFOCUS])[: start.size]
    low = np.where(np.arange(start.size) < count, 0.0, -high)

    def judged(moves: FloatArray) -> FoundViews[GeneralStarts]:
        return FoundViews.judged(requirements, bare.moved(moves[None]))

    planted = np.concatenate([start.shares[0], np.zeros(3), start.aims[0], np.zeros(1)])
    views = np.concatenate([planted[None, : start.size], _random_views(start, low, high, rng)])
    lacking = np.concatenate([_lacking(judged(v), index) for v in np.array_split(views, 12)])
    best = differential_evolution(
        lambda moves: _lacking(judged(moves.T), index),
        list(zip(low, high, strict=True)),
        init=views[np.argsort(lacking)[:_POPULATION]],
        maxiter=_GENERATIONS,
        tol=1e-6,
        vectorized=True,
        updating="deferred",
        polish=False,
        rng=rng,
    )
    return max(-float(best.fun), _polished(judged, index, best.x, low, high))


def _random_views(
    start: GeneralStarts, low: FloatArray, high: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """(N, size) moves to random views of the front, at random settings."""
    views = rng.uniform(low, high, (_DRAWN, start.size))
    first = start.settings.size
    tilt = np.arccos(rng.uniform(np.cos(_TILT), 1.0, (_DRAWN, 1)))
    around, roll = rng.uniform(-np.pi, np.pi, (2, _DRAWN, 1))
    facing = Rotation.from_euler("z", around) * Rotation.from_euler("x", np.pi)
    turned = facing * Rotation.from_euler("y", tilt) * Rotation.from_euler("z", roll)
    planted = Rotation.from_matrix(start.rotations[0])
    views[:, first : first + 3] = (planted.inv() * turned).as_rotvec()
    views[:, first + 3 :] *= 0.3
    return np.asarray(views)


def _lacking(found: FoundViews[GeneralStarts], index: int) -> FloatArray:
    """What evolution makes small: first what others lack, then the margin itself, negative."""
    others = np.delete(found.shares, index, axis=1).min(axis=1)
    value = np.maximum(np.nan_to_num(found.values[:, index], neginf=-1e6), -1e6)
    return np.where(others >= 0, -value, 1e7 - np.maximum(others, -1e3))


def _polished(
    judged: Judge, index: int, start: FloatArray, low: FloatArray, high: FloatArray
) -> float:
    """Go on from there by COBYQA; −inf where it finds nothing at which the others hold."""
    seen: dict[bytes, tuple[float, FloatArray]] = {}

    def at(moves: FloatArray) -> tuple[float, FloatArray]:
        key = moves.tobytes()
        if key not in seen:
            found = judged(np.clip(moves, low, high)[None])
            others = np.nan_to_num(np.delete(found.shares[0], index), neginf=-10.0)
            seen[key] = max(float(found.values[0, index]), -1e6), np.clip(others, -10.0, 10.0)
        return seen[key]

    scale = abs(at(start)[0]) + 1e-9
    minimize(
        lambda moves: -at(moves)[0] / scale,
        start,
        method="COBYQA",
        bounds=list(zip(low, high, strict=True)),
        constraints=[NonlinearConstraint(lambda moves: at(moves)[1], 0.0, np.inf)],
        options={"initial_tr_radius": 0.03, "final_tr_radius": 1e-6, "maxfev": 1500},
    )
    return max((value for value, others in seen.values() if (others >= 0).all()), default=-np.inf)
