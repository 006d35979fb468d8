"""An independent exact test of "sees the whole target", and the audit of a region by it.

A viewpoint v sees all of a convex T when the pyramid hull(v, T) and the faces of the scene do not
meet. Here this is decided by the separating-axis theorem, on the faces as they are: nothing is
merged, cut or left out, no shadow is built, so that a fault there cannot hide here.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import reduce
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from planning.solid import Solid
from planning.target import Target

#: Pairs of viewpoint and triangle that are worked on at once.
_PAIRS_AT_ONCE: Final = 5_000
#: Contact, not penetration, in units of the largest distance between viewpoint and target.
_CONTACT: Final = 1e-12


@dataclass(frozen=True, slots=True)
class Audit:
    """What an independent test found about a region.

    Parameters
    ----------
    viewpoints
        How many random viewpoints were tried.
    disagreements
        How many of them region and exact test judge differently although they lie farther from the
        boundary of the region than the tolerance.
    near_boundary
        How many are judged differently within the tolerance of the boundary.
    tolerance_mm
        That distance in mm.
    visible
        How many the exact test found to see the whole target.
    imbalance
        By how much, as a share of the workspace, the volumes of the boolean operations fail to add
        up at worst.
    repairs
        How many boolean operations had to be repeated.
    """

    viewpoints: int
    disagreements: int
    near_boundary: int
    tolerance_mm: float
    visible: int
    imbalance: float
    repairs: int

    def to_dict(self) -> dict[str, Any]:
        """Give the record as JSON can hold it.

        Returns
        -------
        dict
            Names and values.
        """
        return asdict(self)


class Occluders(Protocol):
    """What can hide a target: a scene, or a sheet without thickness."""

    @property
    def triangles_mm(self) -> FloatArray:
        """(F, 3, 3) corners of all faces in mm."""

    def inside_material(self, points_mm: npt.ArrayLike) -> BoolArray:
        """Tell which points lie inside of bodies."""


def sees_whole_target(viewpoints_mm: npt.ArrayLike, target: Target, scene: Occluders) -> BoolArray:
    """Decide exactly which viewpoints see all of a target.

    Parameters
    ----------
    viewpoints_mm
        (..., 3) projection centres in mm, in the part's frame.
    target
        The target, convex or not.
    scene
        All bodies, the part that the target belongs to among them.

    Returns
    -------
    BoolArray
        (...). A viewpoint in the plane of a polygon or behind it sees nothing; nor does one inside
        of a body.
    """
    given = frozen_array("viewpoints_mm", viewpoints_mm, ("...", 3))
    points = given.reshape(-1, 3)
    if target.is_segment:
        sees = ~scene.inside_material(points)
        contact = _CONTACT
    else:
        sees = (points - target.centroid_mm) @ target.normal > target.flatness_mm
        reach = np.linalg.norm(points - target.centroid_mm, axis=-1).max(initial=target.size_mm)
        contact = max(_CONTACT, 4 * target.flatness_mm / float(reach))
    origin = target.centroid_mm
    triangles = scene.triangles_mm - origin
    if not target.is_segment:
        triangles = triangles[(triangles @ target.normal > 0).any(axis=1)]
    # What is near the target hides most: viewpoints that are known to be blocked drop out early.
    triangles = triangles[np.argsort(np.linalg.norm(triangles, axis=-1).min(axis=1))]
    for piece in target.pieces:
        corners = target.vertices_mm[piece] - origin
        if not target.is_segment:
            corners = corners - np.outer(corners @ target.normal, target.normal)
        _drop_blocked(sees, points - origin, corners, triangles, contact)
    return sees.reshape(given.shape[:-1])


def random_viewpoints(
    workspace: Solid, region: Solid, count: int, generator: np.random.Generator
) -> FloatArray:
    """Draw viewpoints, half of them all over the workspace, half about the region.

    Parameters
    ----------
    workspace
        Where the camera may be.
    region
        The region to be audited; it may be small or empty.
    count
        How many.
    generator
        The source of randomness.

    Returns
    -------
    FloatArray
        (count, 3) points in mm, all inside the workspace.
    """
    half = count // 2 if not region.is_empty else 0
    return np.concatenate(
        [
            _inside(workspace, workspace.bounds_mm, count - half, generator),
            _inside(workspace, region.bounds_mm, half, generator),
        ]
    )


def _inside(
    workspace: Solid, bounds: FloatArray, count: int, generator: np.random.Generator
) -> FloatArray:
    found = np.zeros((0, 3))
    while len(found) < count:
        drawn = generator.uniform(bounds[0], bounds[1], (2 * count, 3))
        found = np.concatenate([found, drawn[workspace.contains(drawn)]])
    return found[:count]


def _drop_blocked(
    sees: BoolArray,
    points: FloatArray,
    corners: FloatArray,
    triangles: FloatArray,
    contact: float,
) -> None:
    """Clear `sees` where a triangle reaches into the pyramid of a viewpoint."""
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    step = max(1, 40 * _PAIRS_AT_ONCE // max(1, len(points)))
    for start in range(0, len(triangles), step):
        left = np.flatnonzero(sees)
        if not len(left):
            return
        part = slice(start, start + step)
        pyramid_low = np.minimum(points[left], corners.min(axis=0))[:, None]
        pyramid_high = np.maximum(points[left], corners.max(axis=0))[:, None]
        meets = ((pyramid_low <= high[part]) & (low[part] <= pyramid_high)).all(axis=-1)
        viewpoint, triangle = np.nonzero(meets)
        for first in range(0, len(viewpoint), _PAIRS_AT_ONCE):
            pair = slice(first, first + _PAIRS_AT_ONCE)
            who = left[viewpoint[pair]]
            blocked = _penetrates(points[who], corners, triangles[start + triangle[pair]], contact)
            sees[who[blocked]] = False


def _penetrates(
    apexes: FloatArray, base: FloatArray, triangles: FloatArray, contact: float
) -> BoolArray:
    """(K,) whether the inside of each pyramid meets its triangle, by the separating-axis theorem.

    Two convex bodies are apart when the normal of a face of either, or the cross product of an edge
    of each, has one on each side. The normals settle most pairs, the products are for the rest.
    """
    rim = (np.roll(base, -1, axis=0) - base)[: 1 if len(base) == 2 else None]
    sides = apexes[:, None] - base
    edges = np.roll(triangles, -1, axis=1) - triangles
    normals = [np.cross(rim, sides[:, : len(rim)]), np.cross(edges[:, :1], edges[:, 1:2])]
    if len(base) > 2:
        base_normal = np.cross(rim[0], base[2] - base[0])
        normals.append(np.broadcast_to(base_normal, (len(apexes), 1, 3)))
    limit = -contact * np.linalg.norm(sides, axis=-1).max(axis=1)
    inside: BoolArray = (
        _widest_gap(np.concatenate(normals, axis=1), apexes, base, triangles) < limit
    )
    open_ = np.flatnonzero(inside)
    all_edges = np.concatenate(
        [np.broadcast_to(rim, (len(open_), *rim.shape)), sides[open_]], axis=1
    )
    products = np.cross(all_edges[:, :, None], edges[open_][:, None])
    products = products.reshape(len(open_), 3 * all_edges.shape[1], 3)
    gap = _widest_gap(products, apexes[open_], base, triangles[open_])
    inside[open_] = gap < limit[open_]
    return inside


def _widest_gap(
    axes: FloatArray, apexes: FloatArray, base: FloatArray, triangles: FloatArray
) -> FloatArray:
    """(K,) widest gap between pyramid and triangle along (K, A, 3) axes; negative: they overlap."""
    length = np.sqrt(np.einsum("kai,kai->ka", axes, axes))
    with np.errstate(divide="ignore"):
        scale = np.where(length > 0, 1.0 / length, 0.0)
    pyramid = [np.einsum("kai,ki->ka", axes, apexes), *(axes @ corner for corner in base)]
    triangle = [np.einsum("kai,ki->ka", axes, triangles[:, k]) for k in range(3)]
    gap = np.maximum(
        reduce(np.minimum, pyramid) - reduce(np.maximum, triangle),
        reduce(np.minimum, triangle) - reduce(np.maximum, pyramid),
    )
    # An axis of no length (parallel edges) separates nothing.
    widest: FloatArray = np.where(length > 0, gap * scale, -np.inf).max(axis=1)
    return widest
