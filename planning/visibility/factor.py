"""A factor of a region: from where one convex piece of the target is seen whole."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from manifold3d import Manifold

from lenscal.arrays import BoolArray, FloatArray
from planning.boolean import from_manifold
from planning.solid import Solid
from planning.visibility.frame import TargetFrame
from planning.visibility.star import StarShaped


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


@dataclass(frozen=True, eq=False)
class PlacedFactor:
    """A factor where it stands in the part's frame, ready to be asked what lies inside.

    Parameters
    ----------
    factor
        The factor, in the target's frame.
    frame
        That frame.
    """

    factor: Factor
    frame: TargetFrame

    @cached_property
    def solid(self) -> Solid:
        """All viewpoints that see the piece, within the extent, in mm."""
        vertices, faces = from_manifold(self.factor.solid)
        return Solid(self.frame.to_part(vertices), faces)

    def contains(self, points_mm: FloatArray) -> BoolArray:
        """Tell from which points the piece is seen.

        Parameters
        ----------
        points_mm
            (N, 3) points in mm, within the extent of the frame.

        Returns
        -------
        BoolArray
            (N,). On the boundary itself either answer may come.
        """
        local = self.frame.to_local(points_mm)
        if len(self.factor.corners) == 2:
            return self._star.contains(local)
        inside = local[:, 2] > 0
        if inside.all():
            return self._star.contains(local)
        inside[inside] = self._star.contains(local[inside])
        return inside

    @cached_property
    def _star(self) -> StarShaped:
        vertices, faces = from_manifold(self.factor.solid)
        return StarShaped(vertices[faces], self.factor.corners.mean(axis=0))
