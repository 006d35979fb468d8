"""The direct method: shadows of convex pieces, each exact, subtracted from all there is."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold

from lenscal.arrays import FloatArray, IntArray
from lenscal.progress import Progress
from planning.boolean import subtract
from planning.scene import Scene
from planning.target import Target
from planning.visibility.convex import ConvexPieces
from planning.visibility.factor import Factor
from planning.visibility.frame import TargetFrame
from planning.visibility.occluding import inflated, occluding_pieces
from planning.visibility.perspective import Perspective
from planning.visibility.reach import Girth, Reach
from planning.visibility.shadows import Shadows

#: How many pieces are cut before the others are looked at again, at first; then twice as many.
_AT_ONCE: Final = 64
#: From how many pieces on it is cheaper to ask which of them matter than to cut them all.
_WORTH_ASKING: Final = 32
#: Cells along each side of a window of the reach; half of them for few triangles.
_CELLS, _FEW = 128, 500


def direct_factors(
    scene: Scene,
    target: Target,
    frame: TargetFrame,
    guarded: bool = True,
    margin: float = 0.0,
    progress: Progress | None = None,
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
    margin
        By how much all that can hide the target is made larger first, in units of the frame.
    progress
        Told how many convex pieces are done with.

    Returns
    -------
    list of Factor
        One for each convex piece of the target.

    Raises
    ------
    GeometryError
        When the boolean operations fail.
    """
    pieces = occluding_pieces(scene, target, frame)
    if margin > 0:
        pieces = inflated(pieces, margin, target.is_segment)
    extent = frame.extent(target)
    return [
        _factor(pieces, corners, extent, frame.tolerance, guarded, progress)
        for corners in frame.target_pieces(target)
    ]


def _factor(
    pieces: ConvexPieces,
    corners: FloatArray,
    extent: Manifold,
    tolerance: float,
    guarded: bool,
    progress: Progress | None,
) -> Factor:
    """Cut until no piece sticks into what is left.

    The pieces that do not are left out, for good: what is left only shrinks.
    """
    perspective = Perspective.of(corners)
    shadows = Shadows(pieces, corners, tolerance, perspective)
    middle = corners.mean(axis=0)
    solid, worst, repairs = perspective.image(extent), 0.0, 0
    remaining, count = np.arange(len(pieces)), _AT_ONCE
    while len(remaining) and not solid.is_empty():
        cutters = [shadows.cutter(int(i)) for i in remaining[:count]]
        solid, imbalance, repeated = subtract(solid, cutters, guarded, perspective.volume)
        worst, repairs = max(worst, imbalance), repairs + repeated
        remaining, count = remaining[count:], 2 * count
        if len(remaining) > _WORTH_ASKING:
            surface = perspective.triangles(solid) - middle
            remaining = _sticking_in(surface, pieces, remaining, middle)
        if progress is not None:
            progress(len(pieces) - len(remaining), len(pieces), "")
    return Factor(corners, perspective.original(solid), worst / extent.volume(), repairs)


def _sticking_in(
    surface: FloatArray, pieces: ConvexPieces, among: IntArray, middle: FloatArray
) -> IntArray:
    """Keep the pieces that may reach into a solid that is star-shaped about a point."""
    low, high = pieces.boxes_of(among)
    among = among[~Girth.of(surface).misses(low - middle, high - middle)]
    chosen = np.zeros(len(pieces), dtype=bool)
    chosen[among] = True
    which = np.flatnonzero(chosen[pieces.owners])
    # Cells cost as much as hundreds of triangles.
    cells = _CELLS if len(which) > _FEW else _CELLS // 2
    entered = Reach.of(surface, cells).entered_by(pieces.triangles[which] - middle)
    return np.unique(pieces.owners[which[entered]])
