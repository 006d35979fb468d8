"""Whether a camera body stays clear of a scene, by cutting its surface into ever smaller patches.

A check of `planning.requirements.clearance`, which it has nothing in common with. The distance of a
point from the scene changes by no more than the point moves. A patch whose middle is d away, and
whose points are no farther than r from its middle, thus has nothing nearer than d − r: it is done
with if that is enough, and otherwise cut into four.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from lenscal.arrays import BoolArray, FloatArray
from lenscal.pose import Pose
from planning.camera_body import CameraBody
from planning.cylinder import Cylinder
from planning.scene import Scene

#: Patches smaller than this are not cut any more: what they leave open counts as clear.
TOLERANCE_MM: Final = 0.1
#: Angles that a cylinder is cut into at first.
_AROUND: Final = 8
#: Patches whose middles are measured at once.
_AT_ONCE: Final = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Pieces of a surface: (K, 2, 2) ranges of two parameters, on one of three kinds of surface.

    Parameters
    ----------
    ranges
        (K, 2, 2) lowest and highest of each parameter: angle and height of a barrel, angle and
        radius of an end face; of a triangle both are shares of its sides.
    cylinder
        The barrel; None for triangles.
    end
        −1 and 1 for the end faces of the cylinder, 0 for its barrel.
    triangles
        (K, 3, 3) in mm; empty for a cylinder.
    """

    ranges: FloatArray
    cylinder: Cylinder | None
    end: int
    triangles: FloatArray

    @property
    def middles_mm(self) -> FloatArray:
        """(K, 3) middles in mm, in the frame of the body."""
        if self.cylinder is None:
            return np.asarray(self.triangles.mean(axis=1))
        first, second = self.ranges.mean(axis=2).T
        return _on_cylinder(self.cylinder, self.end, first, second)

    @property
    def radii_mm(self) -> FloatArray:
        """(K,) distance in mm within which all points of a patch lie from its middle."""
        if self.cylinder is None:
            return np.asarray(
                np.linalg.norm(self.triangles - self.middles_mm[:, None], axis=-1).max(axis=1)
            )
        half = np.ptp(self.ranges, axis=2) / 2
        # Along an arc no farther than its length; radius or height adds at right angles at most.
        arc = half[:, 0] * (self.ranges[:, 1, 1] if self.end else self.cylinder.radius_mm)
        return np.asarray(np.hypot(arc, half[:, 1]) if not self.end else arc + half[:, 1])

    def cut(self, which: BoolArray) -> Patches:
        """Cut some patches into four each.

        Parameters
        ----------
        which
            (K,) which of them; the others are left out.

        Returns
        -------
        Patches
            The pieces.
        """
        if self.cylinder is None:
            corners = self.triangles[which]
            middles = (corners + np.roll(corners, -1, axis=1)) / 2
            outer = np.stack([corners, middles, np.roll(middles, 1, axis=1)], axis=2)
            pieces = np.concatenate([outer.reshape(-1, 3, 3), middles])
            return Patches(np.zeros((len(pieces), 2, 2)), None, 0, pieces)
        low, high = np.moveaxis(self.ranges[which], 2, 0)
        middle = (low + high) / 2
        halves = [np.stack([low, middle], axis=-1), np.stack([middle, high], axis=-1)]
        ranges = np.concatenate(
            [np.stack([a[:, 0], b[:, 1]], axis=1) for a in halves for b in halves]
        )
        return Patches(ranges, self.cylinder, self.end, self.triangles[:0])


def distance_as_far_as(
    body: CameraBody, part_from_body: Pose, scene: Scene, enough_mm: float
) -> float:
    """Measure how far a body is from a scene, as far as it matters.

    Parameters
    ----------
    body
        Lens and camera.
    part_from_body
        Where the frame of the body, that of the reference camera, lies.
    scene
        All that it could touch.
    enough_mm
        What distance is enough, in mm.

    Returns
    -------
    float
        Distance in mm of the nearest point that was looked at. It is less than what is enough where
        the true distance is, unless by less than `TOLERANCE_MM`. Zero where they overlap.
    """
    nearest = np.inf
    for patches in _surfaces(body):
        nearest = min(nearest, _nearest(patches, part_from_body, scene, enough_mm))
        if nearest == 0:
            return 0.0
    # Surfaces that do not meet may still lie one within the other.
    corners = part_from_body.inverse().transform(
        np.concatenate([solid.vertices_mm for solid in scene.bodies])
    )
    return 0.0 if _holds_some(body, corners) else nearest


def _surfaces(body: CameraBody) -> list[Patches]:
    found = []
    for cylinder in body.cylinders:
        turns = np.linspace(0, 2 * np.pi, _AROUND + 1)
        angles = np.stack([turns[:-1], turns[1:]], axis=-1)
        half, radius = cylinder.half_length_mm, cylinder.radius_mm
        for end, second in ((0, (-half, half)), (-1, (0.0, radius)), (1, (0.0, radius))):
            ranges = np.stack([angles, np.tile(second, (_AROUND, 1))], axis=1)
            found.append(Patches(ranges, cylinder, end, np.zeros((0, 3, 3))))
    for mesh in body.meshes:
        hull = trimesh.convex.convex_hull(mesh.vertices_mm)
        triangles = np.asarray(hull.triangles)
        found.append(Patches(np.zeros((len(triangles), 2, 2)), None, 0, triangles))
    return found


def _nearest(patches: Patches, part_from_body: Pose, scene: Scene, enough_mm: float) -> float:
    nearest = np.inf
    while len(patches.ranges):
        middles = part_from_body.transform(patches.middles_mm)
        radii, distance = patches.radii_mm, np.full(len(middles), np.inf)
        for start in range(0, len(middles), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            for solid in scene.bodies:
                away = solid.distance_to_surface_mm(middles[part])
                distance[part] = np.minimum(distance[part], away)
            if scene.inside_material(middles[part]).any():
                return 0.0
        nearest = min(nearest, float(distance.min()))
        if nearest < enough_mm:
            return nearest
        patches = patches.cut((distance - radii < enough_mm) & (radii > TOLERANCE_MM))
    return nearest


def _on_cylinder(cylinder: Cylinder, end: int, angle: FloatArray, second: FloatArray) -> FloatArray:
    first = np.cross(cylinder.axis, np.eye(3)[np.argmin(np.abs(cylinder.axis))])
    first /= np.linalg.norm(first)
    outward = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * np.cross(
        cylinder.axis, first
    )
    radius = second if end else np.full_like(second, cylinder.radius_mm)
    height = np.full_like(second, end * cylinder.half_length_mm) if end else second
    points: FloatArray = (
        cylinder.centre_mm + radius[:, None] * outward + height[:, None] * cylinder.axis
    )
    return points


def _holds_some(body: CameraBody, points: FloatArray) -> bool:
    """Whether any of the points lies in the body."""
    for cylinder in body.cylinders:
        away = points - cylinder.centre_mm
        along = away @ cylinder.axis
        across = np.linalg.norm(away - along[:, None] * cylinder.axis, axis=-1)
        if ((np.abs(along) < cylinder.half_length_mm) & (across < cylinder.radius_mm)).any():
            return True
    for mesh in body.meshes:
        planes = ConvexHull(mesh.vertices_mm).equations
        if (points @ planes[:, :3].T + planes[:, 3] < 0).all(axis=1).any():
            return True
    return False
