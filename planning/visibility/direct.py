"""The direct method: shadows of convex pieces, each exact, subtracted from all there is."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold

from lenscal.arrays import FloatArray, IntArray
from planning.boolean import from_manifold, subtract
from planning.scene import Scene
from planning.target import Target
from planning.visibility.convex import Occluders, occluding_pieces
from planning.visibility.factor import Factor
from planning.visibility.frame import TargetFrame
from planning.visibility.reach import Reach
from planning.visibility.shadows import Shadows

#: How many pieces are cut before the others are looked at again, at first; then twice as many.
_AT_ONCE: Final = 64


def direct_factors(
    scene: Scene, target: Target, frame: TargetFrame, guarded: bool = True
) -> list[Factor]:
    """Subtract the shadows of the scene for each convex piece of a target.

    Parameters
    ----------
    scene
        All that can hide the target.
    target
        The target.
    frame
        Its frame.
    guarded
        Whether boolean operations that lose volume are repeated.

    Returns
    -------
    list of Factor
        One for each convex piece of the target.

    Raises
    ------
    GeometryError
        When the boolean operations fail.
    """
    occluders = occluding_pieces(scene, target, frame)
    extent = frame.extent(target)
    return [
        _factor(occluders, corners, extent, frame.tolerance, guarded)
        for corners in frame.target_pieces(target)
    ]


def _factor(
    occluders: Occluders, corners: FloatArray, extent: Manifold, tolerance: float, guarded: bool
) -> Factor:
    """Cut until no piece sticks into what is left.

    The pieces that do not are left out, for good: what is left only shrinks.
    """
    shadows = Shadows(occluders, corners, tolerance)
    middle = corners.mean(axis=0)
    solid, worst, repairs = extent, 0.0, 0
    remaining, count = np.arange(len(occluders)), _AT_ONCE
    while len(remaining) and not solid.is_empty():
        remaining = _sticking_in(solid, occluders, remaining, middle)
        nearest, remaining = remaining[:count], remaining[count:]
        count *= 2
        cutters = [shadows.cutter(int(i)) for i in nearest]
        solid, imbalance, repeated = subtract(solid, cutters, guarded)
        worst, repairs = max(worst, imbalance), repairs + repeated
    return Factor(corners, solid, worst / extent.volume(), repairs)


def _sticking_in(
    solid: Manifold, occluders: Occluders, among: IntArray, middle: FloatArray
) -> IntArray:
    """Keep the pieces that may reach into a solid that is star-shaped about a point."""
    vertices, faces = from_manifold(solid)
    chosen = np.zeros(len(occluders), dtype=bool)
    chosen[among] = True
    which = np.flatnonzero(chosen[occluders.owners])
    entered = Reach.of(vertices[faces] - middle).entered_by(occluders.triangles[which] - middle)
    return np.unique(occluders.owners[which[entered]])
