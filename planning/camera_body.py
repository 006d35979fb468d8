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
import trimesh

from lenscal.arrays import FloatArray, frozen_array, positive
from lenscal.errors import InputError
from planning.solid import Solid


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A closed cylinder, such as a barrel or a ring light.

    Parameters
    ----------
    start_mm, end_mm
        (3,) middles of its end faces in mm, in the frame of the reference camera.
    radius_mm
        Its radius in mm.

    Raises
    ------
    InputError
        When the radius is not positive, or both ends are one.
    """

    start_mm: FloatArray
    end_mm: FloatArray
    radius_mm: float

    def __post_init__(self) -> None:
        for name in ("start_mm", "end_mm"):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), (3,)))
        positive("radius_mm", self.radius_mm, "mm")
        if not np.linalg.norm(self.end_mm - self.start_mm) > 0:
            raise InputError("a cylinder needs a length, but its ends are the same point")

    @cached_property
    def centre_mm(self) -> FloatArray:
        """(3,) its centre."""
        return (self.start_mm + self.end_mm) / 2

    @cached_property
    def axis(self) -> FloatArray:
        """(3,) unit vector along it."""
        along = self.end_mm - self.start_mm
        unit: FloatArray = along / np.linalg.norm(along)
        return unit

    @cached_property
    def half_length_mm(self) -> float:
        """Half its length."""
        return float(np.linalg.norm(self.end_mm - self.start_mm)) / 2

    @cached_property
    def extent_mm(self) -> tuple[float, float, float]:
        """Lowest and highest z, and largest distance from the z axis, of what holds it."""
        rise = self.radius_mm * np.hypot(self.axis[0], self.axis[1])
        ends = np.stack([self.start_mm, self.end_mm])
        # A disk about an end face's middle reaches no farther than its radius.
        away = float(np.linalg.norm(ends[:, :2], axis=1).max()) + self.radius_mm
        return float(ends[:, 2].min() - rise), float(ends[:, 2].max() + rise), away

    def support_mm(self, directions: FloatArray) -> FloatArray:
        """Give how far it reaches in directions.

        Parameters
        ----------
        directions
            (K, 3) unit vectors.

        Returns
        -------
        FloatArray
            (K,) the largest u · p over its points p.
        """
        along = directions @ self.axis
        across = np.sqrt(np.maximum(1.0 - along**2, 0.0))
        reach: FloatArray = (
            directions @ self.centre_mm
            + self.half_length_mm * np.abs(along)
            + self.radius_mm * across
        )
        return reach

    def nearest_mm(self, points_mm: FloatArray) -> FloatArray:
        """Give the nearest of its points, which is the point itself inside.

        Parameters
        ----------
        points_mm
            (K, 3) in mm.

        Returns
        -------
        FloatArray
            (K, 3) in mm.
        """
        away = points_mm - self.centre_mm
        along = away @ self.axis
        across = away - along[:, None] * self.axis
        distance = np.linalg.norm(across, axis=1)
        shrink = self.radius_mm / np.maximum(distance, self.radius_mm)
        kept = np.clip(along, -self.half_length_mm, self.half_length_mm)
        nearest: FloatArray = self.centre_mm + kept[:, None] * self.axis + shrink[:, None] * across
        return nearest

    def directions_towards(self, triangles_mm: FloatArray) -> list[FloatArray]:
        """Suggest directions in which it may be parted from triangles: along it and across it.

        Parameters
        ----------
        triangles_mm
            (K, 3, 3) in mm.

        Returns
        -------
        list of FloatArray
            (K, 3) unit vectors each.
        """
        count = len(triangles_mm)
        found = [np.tile(self.axis, (count, 1)), np.tile(-self.axis, (count, 1))]
        away = triangles_mm - self.centre_mm
        across = away - (away @ self.axis)[..., None] * self.axis
        for k in range(3):
            start, along = across[:, k], across[:, (k + 1) % 3] - across[:, k]
            squared = np.einsum("ij,ij->i", along, along)
            foot = -np.einsum("ij,ij->i", start, along) / np.where(squared > 0, squared, 1.0)
            nearest = start + np.clip(foot, 0.0, 1.0)[:, None] * along
            length = np.linalg.norm(nearest, axis=1, keepdims=True)
            found.append(np.where(length > 0, nearest / np.where(length > 0, length, 1), self.axis))
        return found


@dataclass(frozen=True, eq=False)
class Hull:
    """The convex hull of a mesh, such as a camera housing from CAD.

    Parameters
    ----------
    mesh
        A closed solid in mm, in the frame of the reference camera.

    Raises
    ------
    InputError
        When the mesh is empty.
    """

    mesh: Solid

    def __post_init__(self) -> None:
        if self.mesh.is_empty:
            raise InputError("a camera body needs a mesh with faces, but it is empty")

    @cached_property
    def _hull(self) -> trimesh.Trimesh:
        return self.mesh.to_mesh().convex_hull

    @cached_property
    def centre_mm(self) -> FloatArray:
        """(3,) a point inside."""
        return np.asarray(self._hull.vertices.mean(axis=0))

    @cached_property
    def extent_mm(self) -> tuple[float, float, float]:
        """Lowest and highest z, and largest distance from the z axis, of what holds it."""
        corners = np.asarray(self._hull.vertices)
        away = float(np.linalg.norm(corners[:, :2], axis=1).max())
        return float(corners[:, 2].min()), float(corners[:, 2].max()), away

    def support_mm(self, directions: FloatArray) -> FloatArray:
        """Give how far it reaches in directions.

        Parameters
        ----------
        directions
            (K, 3) unit vectors.

        Returns
        -------
        FloatArray
            (K,) the largest u · p over its points p.
        """
        reach: FloatArray = (directions @ np.asarray(self._hull.vertices).T).max(axis=1)
        return reach

    def nearest_mm(self, points_mm: FloatArray) -> FloatArray:
        """Give the nearest of its points, which is the point itself inside.

        Parameters
        ----------
        points_mm
            (K, 3) in mm.

        Returns
        -------
        FloatArray
            (K, 3) in mm.
        """
        faces = np.asarray(self._hull.triangles)
        pairs = trimesh.triangles.closest_point(
            np.tile(faces, (len(points_mm), 1, 1)), np.repeat(points_mm, len(faces), axis=0)
        ).reshape(len(points_mm), len(faces), 3)
        best = np.linalg.norm(pairs - points_mm[:, None], axis=-1).argmin(axis=1)
        nearest = pairs[np.arange(len(points_mm)), best]
        beyond = points_mm @ self._normals.T - self._offsets
        inside = np.asarray(beyond <= 0).all(axis=1, keepdims=True)
        return np.where(inside, points_mm, nearest)

    def directions_towards(self, triangles_mm: FloatArray) -> list[FloatArray]:
        """Suggest directions in which it may be parted from triangles: its own normals.

        Parameters
        ----------
        triangles_mm
            (K, 3, 3) in mm.

        Returns
        -------
        list of FloatArray
            (K, 3) unit vectors each.
        """
        return [np.tile(normal, (len(triangles_mm), 1)) for normal in self._normals]

    @cached_property
    def _normals(self) -> FloatArray:
        return np.unique(np.asarray(self._hull.face_normals).round(12), axis=0)

    @cached_property
    def _offsets(self) -> FloatArray:
        return np.asarray((np.asarray(self._hull.vertices) @ self._normals.T).max(axis=0))


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
