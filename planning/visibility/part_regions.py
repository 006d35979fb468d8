"""What a part of a face hides, or shows, beyond its plane: solids made of convex ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from manifold3d import Manifold

from lenscal.arrays import FloatArray
from planning.boolean import Cutter, subtract, trimmed
from planning.visibility.convex import ConvexPiece
from planning.visibility.gulfs import Part
from planning.visibility.shadows import shadow_planes
from planning.visibility.viewing import viewing_planes

#: Half the side of the cube within which regions are made, and by how much it grows with every
#: level of the decomposition: what is taken out reaches beyond what it is taken out of, so that
#: their faces do not coincide there. The extent of the frame is 1.0005.
_CUBE: Final = 1.001
_LEVEL: Final = 0.001
#: How far all of this goes on below the plane of a polygon target.
_BELOW: Final = 0.25
#: Of normals of length one: rounding.
_UPRIGHT: Final = 1e-14


@dataclass(frozen=True, slots=True, eq=False)
class PlaneSide:
    """One side of the plane of a face, from where the target is seen through that plane.

    Parameters
    ----------
    normal, offset
        The plane; the normal points to the viewpoint's side.
    target
        (M, 3) corners of what lies on the other side of a convex piece of the target.
    tolerance
        How far a corner may be off the plane and still lie in it.
    """

    normal: FloatArray
    offset: float
    target: FloatArray
    tolerance: float


class PartRegions:
    """Makes the regions of the parts of one face, and keeps the books of the volumes.

    Parameters
    ----------
    side
        Where the viewpoint is.
    """

    def __init__(self, side: PlaneSide) -> None:
        self._side = side
        self._flat_target = len(side.target) > 2
        #: By how much the volumes of a step fail to add up at worst.
        self.imbalance = 0.0
        #: How many steps had to be repeated.
        self.repairs = 0

    def cutter(self, part: Part) -> Cutter:
        """Prepare the region of a part.

        Parameters
        ----------
        part
            Material or a hole.

        Returns
        -------
        Cutter
            Makes the region, larger by a distance.
        """
        return lambda growth: self.region(part, growth)

    def region(self, part: Part, growth: float = 0.0) -> Manifold:
        """Make the viewpoints beyond the plane from which a part hides the target, or shows it.

        Parameters
        ----------
        part
            Material, which hides some of the target, or a hole, through which all of it is seen.
        growth
            By how much larger, on all sides.

        Returns
        -------
        Manifold
            The region, within a cube a little larger than the frame's extent. Below the plane of a
            polygon target it means nothing.
        """
        made = self._region(part, growth, 0)
        return made if part.is_material else self._beyond(made, growth)

    def hull_region(self, part: Part) -> Manifold:
        """Make the same of the convex hull of a part: a convex region.

        Parameters
        ----------
        part
            Material or a hole.

        Returns
        -------
        Manifold
            The region, as above.
        """
        made = self._hull_region(part, 0.0, 0)
        return made if part.is_material else self._beyond(made, 0.0)

    def _beyond(self, solid: Manifold, growth: float) -> Manifold:
        """Cut at the plane of the face.

        What material hides is cut before anything is taken out of it; what a hole shows goes on
        below, since it is to be taken out. Were all cut at the end, the plane would go through
        every corner of every part, and films of rounding would close holes.
        """
        return trimmed(solid, self._side.normal, self._side.offset - growth)

    def _hull_region(self, part: Part, growth: float, level: int) -> Manifold:
        solid = self._cube(level)
        planes = self._hiding(part) if part.is_material else self._showing(part)
        if planes is None:
            return Manifold()
        if self._flat_target:
            # The plane of the target bounds what is looked at already.
            upright = (np.abs(planes[:, :2]) <= _UPRIGHT).all(axis=1) & (planes[:, 2] > 0)
            planes = planes[~(upright & (np.abs(planes[:, 3]) <= self._side.tolerance))]
        for *normal, offset in planes:
            solid = trimmed(solid, normal, offset - growth)
        return self._beyond(solid, growth) if part.is_material else solid

    def _region(self, part: Part, growth: float, level: int) -> Manifold:
        solid = self._hull_region(part, growth, level)
        if not part.inside or solid.is_empty():
            return solid
        # What is taken out shrinks where the whole is to grow.
        cutters = [self._inner(inner, growth, level + 1) for inner in part.inside]
        solid, imbalance, repairs = subtract(solid, cutters)
        self.imbalance = max(self.imbalance, imbalance)
        self.repairs += repairs
        return solid

    def _inner(self, part: Part, growth: float, level: int) -> Cutter:
        return lambda larger: self._region(part, larger - growth, level)

    def _hiding(self, part: Part) -> FloatArray:
        side = self._side
        planes = shadow_planes(ConvexPiece.polygon(part.hull), side.target, side.tolerance)
        # The plane of the face itself is the same for all of its parts.
        off = np.abs(planes[:, :3] @ part.hull.T - planes[:, 3:]).max(axis=1, initial=0.0)
        kept: FloatArray = planes[off > side.tolerance]
        return kept

    def _showing(self, part: Part) -> FloatArray | None:
        side = self._side
        return viewing_planes(
            part.hull, part.beyond, side.normal, side.offset, side.target, side.tolerance
        )

    def _cube(self, level: int) -> Manifold:
        half = _CUBE + level * _LEVEL
        cube = Manifold.cube([2.0, 2.0, 2.0], center=True).scale([half] * 3)
        if not self._flat_target:
            return cube
        return cube.trim_by_plane([0.0, 0.0, 1.0], -_BELOW - level * _LEVEL)


def plane_sides(
    normal: FloatArray, offset: float, target: FloatArray, tolerance: float
) -> list[PlaneSide]:
    """Part a convex target by a plane: what lies below it is seen through it from above.

    Parameters
    ----------
    normal, offset
        The plane.
    target
        (M, 3) corners of the convex target in order; two for a segment.
    tolerance
        How far a corner may be off the plane and still lie in it.

    Returns
    -------
    list of PlaneSide
        Both sides when the plane parts the target; none when the target lies in it.
    """
    sides = []
    for sign in (1.0, -1.0):
        height = sign * (target @ normal - offset)
        if height.min() >= -tolerance:
            continue
        below = target if height.max() <= tolerance else _below(target, height)
        sides.append(PlaneSide(sign * normal, sign * offset, below, tolerance))
    return sides


def _below(target: FloatArray, height: FloatArray) -> FloatArray:
    """What of a polygon or segment has no positive height."""
    count = len(target)
    corners = []
    for k in range(count):
        here, there = k, (k + 1) % count
        if height[here] <= 0:
            corners.append(target[here])
        if height[here] * height[there] < 0 and (count > 2 or k == 0):
            share = height[here] / (height[here] - height[there])
            corners.append(target[here] + share * (target[there] - target[here]))
    return np.array(corners)
