"""The outside of camera and lens, fixed in the frame of the reference camera.

The body does not move with zoom and focus, the projection centre does: in the paper's lens it lies
half a metre behind the front glass at some settings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lenscal.arrays import positive
from lenscal.errors import InputError
from planning.cylinder import Cylinder
from planning.hull import Hull
from planning.solid import Solid

Piece = Cylinder | Hull


@dataclass(frozen=True, eq=False)
class CameraBody:
    """Camera and lens as a few convex pieces.

    Parameters
    ----------
    cylinders
        Barrels, ring lights and the like.
    meshes
        Closed solids, such as a housing. The convex hull of each counts: one with a hollow side
        becomes larger, and is best given in parts.

    Raises
    ------
    InputError
        When there is neither.
    """

    cylinders: Sequence[Cylinder] = ()
    meshes: Sequence[Solid] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "cylinders", tuple(self.cylinders))
        object.__setattr__(self, "meshes", tuple(self.meshes))
        if not self.pieces:
            raise InputError("a camera body needs a cylinder or a mesh, but has neither")

    @classmethod
    def barrel(cls, front_mm: float, radius_mm: float, length_mm: float) -> CameraBody:
        """Make a body of one barrel about the optical axis.

        Parameters
        ----------
        front_mm
            z of its front in the frame of the reference camera: how far the front glass stands
            before the reference projection centre.
        radius_mm
            Its radius.
        length_mm
            From the front backwards.

        Returns
        -------
        CameraBody
            The body.
        """
        back = front_mm - positive("length_mm", length_mm, "mm")
        return cls((Cylinder(np.array([0, 0, back]), np.array([0, 0, front_mm]), radius_mm),))

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """All convex pieces."""
        return (*self.cylinders, *(Hull(mesh) for mesh in self.meshes))

    def to_dict(self) -> dict[str, Any]:
        """Give the body as JSON can hold it.

        Returns
        -------
        dict
            Cylinders by their numbers, meshes by their digests.
        """
        return {
            "cylinders": [
                {
                    "start_mm": cylinder.start_mm.tolist(),
                    "end_mm": cylinder.end_mm.tolist(),
                    "radius_mm": cylinder.radius_mm,
                }
                for cylinder in self.cylinders
            ],
            "meshes": [mesh.digest for mesh in self.meshes],
        }
