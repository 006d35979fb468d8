"""A factor of a region: from where one convex piece of the target is seen whole."""

from __future__ import annotations

from dataclasses import dataclass

from manifold3d import Manifold

from lenscal.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """All viewpoints of the frame's extent that see one convex piece of a target.

    Nothing but the extent bounds it, so it is star-shaped about every point of the piece.

    Parameters
    ----------
    corners
        (M, 3) corners of the piece in order, in the target's frame; two for a segment.
    solid
        The viewpoints, in the target's frame.
    imbalance
        By how much, as a share of the extent, the volumes of the boolean operations fail to add up
        at worst.
    repairs
        How many boolean operations had to be repeated.
    """

    corners: FloatArray
    solid: Manifold
    imbalance: float
    repairs: int
