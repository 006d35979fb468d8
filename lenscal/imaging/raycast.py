"""Which surface a ray meets first, and how bright it is: triangles in the frame of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.errors import InputError
from lenscal.pose import Pose

#: Embree counts in float32: the scene is scaled so that its farthest vertex lies this far away.
_EXTENT: Final = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A thing made of triangles, dull as chalk.

    Parameters
    ----------
    vertices_mm
        (N, 3) in the frame of the scene.
    faces
        (M, 3) indices of the corners of each triangle; which way round does not matter.
    reflectance
        Of the whole body, or (M,) one of each face; white paper has 1.

    Raises
    ------
    InputError
        When there is no face, a face names a vertex that is not there, or a reflectance is not
        between 0 and 1.
    """

    vertices_mm: FloatArray
    faces: IntArray
    reflectance: npt.ArrayLike = 0.6

    def __post_init__(self) -> None:
        vertices = frozen_array("vertices_mm", self.vertices_mm, ("N", 3))
        faces = np.array(self.faces, dtype=np.int64).reshape(-1, 3)
        if not (faces.size and faces.min() >= 0 and faces.max() < len(vertices)):
            raise InputError(
                f"a body needs faces that name some of its {len(vertices)} vertices, but it has "
                f"{len(faces)} faces"
                + (f" with indices {faces.min()} to {faces.max()}" if faces.size else "")
            )
        stated = np.broadcast_to(np.asarray(self.reflectance, np.float64), (len(faces),))
        reflectance = frozen_array("reflectance", stated, ("M",))
        if not ((reflectance >= 0) & (reflectance <= 1)).all():
            raise InputError(
                "the reflectance of a body must lie between 0 and 1 (white), but "
                f"{reflectance.min():g} to {reflectance.max():g} are given"
            )
        faces.setflags(write=False)
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "reflectance", reflectance)


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """What rays from the projection centre meet first.

    Parameters
    ----------
    depth_mm
        (N,) z in the camera frame, infinite where a ray meets nothing.
    normal
        (N, 3) unit normal in the camera frame, towards the camera.
    reflectance
        (N,) of the surface there.
    """

    depth_mm: FloatArray
    normal: FloatArray
    reflectance: FloatArray


class TriangleScene:
    """Bodies before a camera, ready to be looked at.

    Parameters
    ----------
    bodies
        What is there.
    camera_from_scene
        Where the scene is.
    """

    def __init__(self, bodies: Sequence[Body], camera_from_scene: Pose) -> None:
        corners = [camera_from_scene.transform(b.vertices_mm)[b.faces] for b in bodies]
        self._corners = np.concatenate([np.zeros((0, 3, 3)), *corners])
        self._reflectance = np.concatenate(
            [np.zeros(0), *(np.asarray(b.reflectance) for b in bodies)]
        )
        first, second, third = np.moveaxis(self._corners, 1, 0)
        self._normal = np.cross(second - first, third - first)
        length = np.linalg.norm(self._normal, axis=-1, keepdims=True)
        self._normal /= np.where(length > 0, length, 1.0)
        self._embree = rtcore_scene.EmbreeScene()
        if len(self._corners):
            scale = _EXTENT / np.abs(self._corners).max()
            TriangleMesh(self._embree, (self._corners * scale).astype(np.float32))

    def hits(self, rays: FloatArray) -> Hits:
        """Follow rays from the projection centre.

        Embree finds the triangle; the depth is computed from its plane in double precision.

        Parameters
        ----------
        rays
            (N, 3) directions with z = 1 in the camera frame.

        Returns
        -------
        Hits
            What they meet.
        """
        count = len(rays)
        depth = np.full(count, np.inf)
        normal = np.broadcast_to(np.array([0.0, 0.0, -1.0]), (count, 3)).copy()
        reflectance = np.zeros(count)
        if len(self._corners):
            origins = np.zeros((count, 3), np.float32)
            triangle = np.asarray(self._embree.run(origins, rays.astype(np.float32)))
            met = np.flatnonzero(triangle >= 0)
            triangle = triangle[met]
            towards = np.einsum("ij,ij->i", self._normal[triangle], rays[met])
            edge_on = towards == 0
            met, triangle, towards = met[~edge_on], triangle[~edge_on], towards[~edge_on]
            height = np.einsum("ij,ij->i", self._normal[triangle], self._corners[triangle, 0])
            depth[met] = height / towards
            normal[met] = -np.sign(towards)[:, None] * self._normal[triangle]
            reflectance[met] = self._reflectance[triangle]
        return Hits(depth, normal, reflectance)
