"""The direct method: shadows of convex pieces, each exact, subtracted from all there is."""

from __future__ import annotations

from planning.boolean import subtract
from planning.scene import Scene
from planning.target import Target
from planning.visibility.convex import occluding_pieces
from planning.visibility.factor import Factor
from planning.visibility.frame import TargetFrame
from planning.visibility.shadows import shadow_cutters


def direct_factors(scene: Scene, target: Target, frame: TargetFrame) -> list[Factor]:
    """Subtract the shadows of the scene for each convex piece of a target.

    Parameters
    ----------
    scene
        All that can hide the target.
    target
        The target.
    frame
        Its frame.

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
    extent = frame.extent(target)
    factors = []
    for corners in frame.target_pieces(target):
        cutters = shadow_cutters(pieces, corners, frame.tolerance)
        solid, imbalance, repairs = subtract(extent, cutters)
        factors.append(Factor(corners, solid, imbalance / extent.volume(), repairs))
    return factors
