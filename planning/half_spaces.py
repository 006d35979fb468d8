"""Half-spaces of positions: what requirements are for a camera that does not turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import InputError
from planning.boolean import from_manifold, to_manifold
from planning.solid import Solid


@dataclass(frozen=True, slots=True, eq=False)
class HalfSpaces:
    """All points r with n · r ≥ b for each of M pairs of n and b: a convex set.

    Parameters
    ----------
    normals
        (M, 3) unit vectors that point into the set. Others are scaled, with their offsets.
    offsets_mm
        (M,) n · r of each boundary plane in mm.

    Raises
    ------
    InputError
        When a shape is wrong, a value is not finite, or a normal is zero.
    """

    normals: FloatArray
    offsets_mm: FloatArray

    def __post_init__(self) -> None:
        normals = frozen_array("normals", self.normals, ("M", 3))
        offsets = frozen_array("offsets_mm", self.offsets_mm, (len(normals),))
        length = np.linalg.norm(normals, axis=-1)
        if not (length > 0).all():
            raise InputError("the normal of a half-space must not be zero; leave it out")
        for name, value in (
            ("normals", normals / length[:, None]),
            ("offsets_mm", offsets / length),
        ):
            object.__setattr__(self, name, frozen_array(name, value, value.shape))

    @classmethod
    def everywhere(cls) -> HalfSpaces:
        """Make the set without any bound.

        Returns
        -------
        HalfSpaces
            No half-space.
        """
        return cls(np.zeros((0, 3)), np.zeros(0))

    @classmethod
    def slab(
        cls, axis: npt.ArrayLike, point_mm: npt.ArrayLike, low_mm: float, high_mm: float
    ) -> HalfSpaces:
        """Bound the distance of a point along an axis: D of an orthogonal view.

        Parameters
        ----------
        axis
            (3,) unit vector along the optical axis, from the camera to the point.
        point_mm
            (3,) the point in mm.
        low_mm, high_mm
            Nearest and farthest in mm; an infinite one is left out.

        Returns
        -------
        HalfSpaces
            Where the point lies between low and high ahead.
        """
        axis, point = frozen_array("axis", axis, (3,)), frozen_array("point_mm", point_mm, (3,))
        sides = [(-axis, low_mm - axis @ point)]
        if np.isfinite(high_mm):
            sides.append((axis, axis @ point - high_mm))
        return cls(np.stack([n for n, _ in sides]), np.array([b for _, b in sides]))

    def distance_mm(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Measure how far inside points are.

        Parameters
        ----------
        points_mm
            (..., 3) points in mm.

        Returns
        -------
        FloatArray
            (...) distance from the nearest plane in mm, negative outside, infinite without planes.
        """
        points = frozen_array("points_mm", points_mm, ("...", 3))
        distance: FloatArray = (points @ self.normals.T - self.offsets_mm).min(
            axis=-1, initial=np.inf
        )
        return distance

    def contains(self, points_mm: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Tell which points lie in all of them, the planes included.

        Parameters
        ----------
        points_mm
            (..., 3) points in mm.

        Returns
        -------
        BoolArray
            (...).
        """
        return np.asarray(self.distance_mm(points_mm) >= 0)

    def cut(self, solid: Solid) -> Solid:
        """Cut a solid down to what lies in all of them.

        Parameters
        ----------
        solid
            A workspace or a visibility region.

        Returns
        -------
        Solid
            What is left; empty when nothing is.
        """
        if solid.is_empty:
            return solid
        low, high = solid.bounds_mm
        # In a frame of the size of the solid, where manifold3d's tolerances are small.
        centre, scale = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        left = to_manifold("the region", (solid.vertices_mm - centre) / scale, solid.faces)
        for normal, offset in zip(self.normals, self.offsets_mm, strict=True):
            left = left.trim_by_plane(normal, float((offset - normal @ centre) / scale))
        vertices, faces = from_manifold(left)
        return Solid(vertices * scale + centre, faces)

    def __and__(self, other: HalfSpaces) -> HalfSpaces:
        return HalfSpaces(
            np.concatenate([self.normals, other.normals]),
            np.concatenate([self.offsets_mm, other.offsets_mm]),
        )

    def __len__(self) -> int:
        return len(self.normals)
