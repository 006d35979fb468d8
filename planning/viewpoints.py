"""Viewpoints of the orthogonal case: on the ring about the feature, through the visibility region.

For a segment feature AB with midpoint M the projection centre lies in the plane through M
perpendicular to AB, at the object distance D of the setting, and the optical axis passes through M:
a circle for each setting, all of them together the ring D_min ≤ |r − M| ≤ D_max of the paper. For a
face it lies on the normal through the centroid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray
from lenscal.pose import Pose
from lenscal.sensor import Axis
from planning.target import Target
from planning.visibility.region import Region

#: Directions that are tried around the ring.
_DIRECTIONS: Final = 1440
#: How often a step between a direction inside and one outside is parted, and into how many pieces:
#: as good as 40 halvings, and quicker, since points are asked together.
_PARTINGS: Final = 8
_PIECES: Final = 32
#: Directions along an arc among which the deepest one is sought.
_ALONG_ARC: Final = 65


@dataclass(frozen=True, slots=True, eq=False)
class Ring:
    """Directions from which a feature is seen orthogonally.

    Parameters
    ----------
    midpoint_mm
        (3,) M in mm.
    axes
        (2, 3) unit vectors at angle 0 (the target's normal, as near as possible) and π/2.
    along
        (3,) unit vector along the feature, for the roll of the camera.
    is_full
        Whether all angles count, as for a segment, or only angle 0, as for a face.
    """

    midpoint_mm: FloatArray
    axes: FloatArray
    along: FloatArray
    is_full: bool

    @classmethod
    def about(cls, feature: Target, target: Target) -> Ring:
        """Make the ring about a feature.

        Parameters
        ----------
        feature
            A segment, or a face.
        target
            The face that is to be seen whole; its normal has angle 0.

        Returns
        -------
        Ring
            The ring.
        """
        edges = np.roll(feature.vertices_mm, -1, axis=0) - feature.vertices_mm
        along = edges[np.argmax(np.linalg.norm(edges, axis=-1))]
        along = along / np.linalg.norm(along)
        zero = _facing(along, target) if feature.is_segment else feature.normal
        axes = np.stack([zero, np.cross(along, zero)])
        return cls(feature.centroid_mm, axes, along, feature.is_segment)

    def positions(self, distance_mm: npt.ArrayLike, angle: npt.ArrayLike) -> FloatArray:
        """Place projection centres.

        Parameters
        ----------
        distance_mm
            (...) distance from M in mm.
        angle
            (...) radians, from the target's normal towards the second axis; they broadcast.

        Returns
        -------
        FloatArray
            (..., 3) in mm, in the part's frame.
        """
        directions = (
            np.cos(angle)[..., None] * self.axes[0] + np.sin(angle)[..., None] * self.axes[1]
        )
        centres: FloatArray = self.midpoint_mm + np.asarray(distance_mm)[..., None] * directions
        return centres

    def rotations(self, positions_mm: FloatArray, axis: Axis) -> FloatArray:
        """Point cameras at M.

        Parameters
        ----------
        positions_mm
            (..., 3) projection centres in mm.
        axis
            The image axis that the feature shall lie along; "any" takes x.

        Returns
        -------
        FloatArray
            (..., 3, 3) rotations of part_from_camera.
        """
        z = self.midpoint_mm - positions_mm
        z = z / np.linalg.norm(z, axis=-1, keepdims=True)
        along = self.along - (z @ self.along)[..., None] * z
        along = along / np.linalg.norm(along, axis=-1, keepdims=True)
        x = np.cross(along, z) if axis == "y" else along
        rotations: FloatArray = np.stack([x, np.cross(z, x), z], axis=-1)
        return rotations

    def pose(self, position_mm: FloatArray, axis: Axis) -> Pose:
        """Point the camera at M.

        Parameters
        ----------
        position_mm
            (3,) projection centre in mm.
        axis
            The image axis that the feature shall lie along; "any" takes x.

        Returns
        -------
        Pose
            part_from_camera.
        """
        return Pose(self.rotations(position_mm, axis), position_mm)


@dataclass(frozen=True, slots=True)
class Arc:
    """Directions on the ring, at one distance, from which the whole target is seen.

    Parameters
    ----------
    start, stop
        Ends in radians; stop exceeds start, and may exceed π.
    deepest
        The angle farthest inside the region.
    depth_mm
        How far that is from the boundary of the region in mm.
    """

    start: float
    stop: float
    deepest: float
    depth_mm: float


def visible_arcs(region: Region, ring: Ring, distance_mm: float) -> list[Arc]:
    """Find where the ring at one distance lies in the visibility region.

    Arcs narrower than 1/4 degree may be missed.

    Parameters
    ----------
    region
        The visibility region.
    ring
        The ring.
    distance_mm
        Distance from M in mm.

    Returns
    -------
    list of Arc
        The arcs, by angle.
    """
    if not ring.is_full:
        depth = float(region.distance_to_boundary(ring.positions(distance_mm, np.array(0.0))))
        return [Arc(0.0, 0.0, 0.0, depth)] if depth > 0 else []
    angles = np.linspace(-np.pi, np.pi, _DIRECTIONS, endpoint=False)
    inside = region.contains(ring.positions(distance_mm, angles))
    if inside.all():
        return [_deepest(region, ring, distance_mm, -np.pi, np.pi)]
    step = 2 * np.pi / _DIRECTIONS
    enters = np.flatnonzero(inside & ~np.roll(inside, 1))
    leaves = np.flatnonzero(inside & ~np.roll(inside, -1))
    inner = angles[np.concatenate([enters, leaves])]
    outer = inner + np.repeat([-step, step], [len(enters), len(leaves)])
    start, stop = np.split(_edge(region, ring, distance_mm, inner, outer), [len(enters)])
    # Each arc ends at the first end after its start, which may lie beyond the seam at ±π.
    ends = [min(np.where(stop > a, stop, stop + 2 * np.pi)) for a in start]
    return [
        _deepest(region, ring, distance_mm, float(a), float(b))
        for a, b in zip(start, ends, strict=True)
    ]


def _facing(along: FloatArray, target: Target) -> FloatArray:
    """Unit vector perpendicular to a segment, towards the target's front where it has one."""
    candidates = [] if target.is_segment else [target.normal]
    candidates.append(np.eye(3)[np.argmin(np.abs(along))])
    across = [c - (c @ along) * along for c in candidates]
    best = next(c for c in across if np.linalg.norm(c) > 1e-6)
    unit: FloatArray = best / np.linalg.norm(best)
    return unit


def _edge(
    region: Region, ring: Ring, distance_mm: float, inner: FloatArray, outer: FloatArray
) -> FloatArray:
    shares = np.linspace(0.0, 1.0, _PIECES + 1)
    edges = np.arange(len(inner))
    for _ in range(_PARTINGS):
        angles = inner[:, None] + shares * (outer - inner)[:, None]
        inside: BoolArray = region.contains(ring.positions(distance_mm, angles[:, 1:-1]))
        # The piece that starts inside and whose end is the first outside.
        piece = np.where(inside.all(axis=1), _PIECES - 1, inside.argmin(axis=1))
        inner, outer = angles[edges, piece], angles[edges, piece + 1]
    return inner


def _deepest(region: Region, ring: Ring, distance_mm: float, start: float, stop: float) -> Arc:
    angles = np.linspace(start, stop, _ALONG_ARC)
    depth = region.distance_to_boundary(ring.positions(distance_mm, angles))
    best = int(np.argmax(depth))
    return Arc(start, stop, float(angles[best]), float(depth[best]))
