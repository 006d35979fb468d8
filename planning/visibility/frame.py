"""The frame in which regions are computed: the target at the origin, facing z, all of size one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from manifold3d import Manifold

from lenscal.arrays import FloatArray
from planning.solid import Solid
from planning.target import Target

#: What rounding does to coordinates of size one after they were turned.
_ROUNDING: Final = 1e-12
#: How far the extent reaches, in units of the frame.
_BEYOND: Final = 1.0005


@dataclass(frozen=True, slots=True, eq=False)
class TargetFrame:
    """A similarity between the part's frame and one that fits target and workspace.

    Parameters
    ----------
    rotation
        (3, 3) rows are the axes of the frame, in the part's frame. z is the target's normal.
    origin_mm
        (3,) centroid of the target in mm.
    scale_mm
        What one unit is, in mm: the workspace reaches no further than one unit from the origin.
    tolerance
        How deep, in units, bodies may seem to reach into the target by rounding, or because the
        target is not quite flat: contact, not penetration.
    """

    rotation: FloatArray
    origin_mm: FloatArray
    scale_mm: float
    tolerance: float

    @classmethod
    def around(cls, target: Target, workspace: Solid) -> TargetFrame:
        """Choose the frame for a target and a workspace.

        Parameters
        ----------
        target
            The target.
        workspace
            Where the camera may be.

        Returns
        -------
        TargetFrame
            The frame.
        """
        origin = target.centroid_mm
        along = target.vertices_mm[1] - target.vertices_mm[0]
        if target.is_segment:
            x = along / np.linalg.norm(along)
            helper = np.eye(3)[np.argmin(np.abs(x))]
            z = np.cross(x, helper) / np.linalg.norm(np.cross(x, helper))
        else:
            z = target.normal
            x = along - (along @ z) * z
            x /= np.linalg.norm(x)
        corners = np.concatenate([workspace.vertices_mm, target.vertices_mm])
        scale = float(np.linalg.norm(corners - origin, axis=-1).max())
        return cls(
            np.stack([x, np.cross(z, x), z]),
            origin,
            scale,
            max(_ROUNDING, 4 * target.flatness_mm / scale),
        )

    def to_local(self, points_mm: FloatArray) -> FloatArray:
        """Bring points into the frame.

        Parameters
        ----------
        points_mm
            (..., 3) in mm, in the part's frame.

        Returns
        -------
        FloatArray
            (..., 3) in units of the frame.
        """
        local: FloatArray = (points_mm - self.origin_mm) @ self.rotation.T / self.scale_mm
        return local

    def to_part(self, points: FloatArray) -> FloatArray:
        """Bring points back into the part's frame.

        Parameters
        ----------
        points
            (..., 3) in units of the frame.

        Returns
        -------
        FloatArray
            (..., 3) in mm.
        """
        part: FloatArray = points @ self.rotation * self.scale_mm + self.origin_mm
        return part

    def extent(self, target: Target) -> Manifold:
        """Give the convex solid within which regions are computed before the workspace is cut out.

        Parameters
        ----------
        target
            The target that the frame was made for.

        Returns
        -------
        Manifold
            A cube about the target, a little larger than all that the workspace reaches; of a
            polygon the half in front of it. The target lies in it, or on its face.
        """
        cube = Manifold.cube([2.0, 2.0, 2.0], center=True).scale([_BEYOND] * 3)
        return cube if target.is_segment else cube.trim_by_plane([0.0, 0.0, 1.0], 0.0)

    def target_pieces(self, target: Target) -> list[FloatArray]:
        """Give the convex pieces of the target in the frame, exactly in the plane z = 0.

        Parameters
        ----------
        target
            The target that the frame was made for.

        Returns
        -------
        list of FloatArray
            (M, 3) corners of each piece.
        """
        local = self.to_local(target.vertices_mm)
        local[:, 2] = 0.0
        return [local[piece] for piece in target.pieces]
