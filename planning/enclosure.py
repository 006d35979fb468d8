"""The example part, after figure 15 of the paper: a block inside an enclosure with two holes.

The top face T of the block, 1 in by 0.75 in, is to be seen; its width L lies along x. The roof of
the enclosure has a small and a large hole, SH and LH, both cut by the plane through the midpoint of
T perpendicular to L. All of it lies within 62 mm of T: a lens front 150 mm away stays clear.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import trimesh
from manifold3d import Manifold, OpType

from lenscal.units import MM_PER_INCH
from planning.boolean import from_manifold
from planning.scene import Scene
from planning.solid import Solid, box_workspace
from planning.target import Target

_WIDTH: Final = 1.0 * MM_PER_INCH
_DEPTH: Final = 0.75 * MM_PER_INCH
#: Lowest and highest corner of each box in mm; T is at z = 0.
_BLOCK: Final = ((-_WIDTH / 2, -_DEPTH / 2, -20.0), (_WIDTH / 2, _DEPTH / 2, 0.0))
_OUTSIDE: Final = ((-28.0, -40.0, -24.0), (28.0, 45.0, 32.0))
_INSIDE: Final = ((-25.0, -37.0, -20.0), (25.0, 42.0, 29.0))
_SMALL_HOLE: Final = ((-14.5, -31.5, 28.0), (14.5, -9.5, 33.0))
_LARGE_HOLE: Final = ((-20.0, 1.0, 28.0), (20.0, 38.0, 33.0))


class Example(NamedTuple):
    """A part, what is to be seen of it, and where the camera may be.

    Parameters
    ----------
    scene
        Block and enclosure.
    target
        T, the top face of the block, facing +z with its centroid at the origin.
    feature
        L, the width of T, through its midpoint along x.
    workspace
        Where the projection centre may be.
    """

    scene: Scene
    target: Target
    feature: Target
    workspace: Solid


def example_part() -> Example:
    """Make the part of figure 15.

    Returns
    -------
    Example
        In mm.
    """
    room = Manifold.batch_boolean(
        [_box(corners) for corners in (_OUTSIDE, _INSIDE, _SMALL_HOLE, _LARGE_HOLE)],
        OpType.Subtract,
    )
    enclosure = trimesh.Trimesh(*from_manifold(room), process=False)
    block = trimesh.creation.box(bounds=_BLOCK)
    x, y = _WIDTH / 2, _DEPTH / 2
    return Example(
        Scene([block, enclosure], ["block", "enclosure"]),
        Target(np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])),
        Target.segment((-x, 0, 0), (x, 0, 0)),
        box_workspace((-300, -800, 33), (300, 800, 1000)),
    )


def _box(corners: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Manifold:
    low, high = np.array(corners)
    return Manifold.cube(high - low).translate(low)
