"""The audit of a region: random viewpoints, judged by the region and by an independent exact test.

Half of them lie anywhere in the workspace, a quarter about the region, and a quarter close to its
boundary, on either side, where a fault would show.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray
from planning.membership import Membership
from planning.solid import Solid
from planning.target import Target
from planning.visibility.exact_test import ExactTest, Occluders
from planning.visibility.perspective import Perspective

if TYPE_CHECKING:
    from planning.visibility.region import Region

#: How near to the boundary, as a share of the workspace's diagonal, the audit does not judge.
TOLERANCE: Final = 1e-6
#: How far from the boundary, as shares of the workspace's diagonal, viewpoints close to it lie.
_CLOSE: Final = (3e-6, 3e-2)
#: How far behind the plane of a target a region may seem to reach, in units of the target's frame.
_IN_FRONT: Final = 1e-9


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
    margin_mm
        By how much occluders were made larger, in mm. Then the region is meant to be smaller than
        what the test finds, and only viewpoints in it that the test finds blocked disagree.
    """

    viewpoints: int
    disagreements: int
    near_boundary: int
    tolerance_mm: float
    visible: int
    imbalance: float
    repairs: int
    margin_mm: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Give the record as JSON can hold it.

        Returns
        -------
        dict
            Names and values.
        """
        return asdict(self)

    def with_viewpoints(self, region: Region, points_mm: FloatArray, sees: BoolArray) -> Audit:
        """Compare a region with what an exact test found, and add that to the record.

        The region is asked in both ways that it can be: by its factors, and by its solid.

        Parameters
        ----------
        region
            The region.
        points_mm
            (N, 3) viewpoints in mm, inside of the workspace.
        sees
            (N,) whether the exact test found that they see the whole target.

        Returns
        -------
        Audit
            A new record.
        """
        claims = (region.contains(points_mm), _solid_contains(region, points_mm))
        wrong = (claims[0] | claims[1]) & ~sees
        if self.margin_mm == 0:
            wrong |= ~(claims[0] & claims[1]) & sees
        away = np.zeros(0, dtype=bool)
        if wrong.any():
            away = region.solid.distance_to_surface_mm(points_mm[wrong]) > self.tolerance_mm
        return replace(
            self,
            viewpoints=self.viewpoints + len(points_mm),
            disagreements=self.disagreements + int(away.sum()),
            near_boundary=self.near_boundary + int((~away).sum()),
            visible=self.visible + int(sees.sum()),
        )

    def combined(self, other: Audit, imbalance: float) -> Audit:
        """Add up the records of two regions that were intersected.

        Parameters
        ----------
        other
            The record of the other region.
        imbalance
            By how much the volumes of the intersection fail to add up.

        Returns
        -------
        Audit
            Counts are added, the larger of tolerances, imbalances and margins is kept.
        """
        return Audit(
            viewpoints=self.viewpoints + other.viewpoints,
            disagreements=self.disagreements + other.disagreements,
            near_boundary=self.near_boundary + other.near_boundary,
            tolerance_mm=max(self.tolerance_mm, other.tolerance_mm),
            visible=self.visible + other.visible,
            imbalance=max(self.imbalance, other.imbalance, imbalance),
            repairs=self.repairs + other.repairs,
            margin_mm=max(self.margin_mm, other.margin_mm),
        )


def _solid_contains(region: Region, points_mm: FloatArray) -> BoolArray:
    """Ask the solid, where that is possible in a perspective that makes its walls upright.

    Most of its faces run along lines of sight. The boxes about them are thin there.
    """
    if region.is_empty or not region.factors:
        return region.solid.contains(points_mm)
    factor = region.factors[0]
    perspective = Perspective.of(factor.factor.corners)
    vertices, points = (factor.frame.to_local(p) for p in (region.solid.vertices_mm, points_mm))
    if perspective.behind is None or vertices[:, 2].min() < -_IN_FRONT:
        return region.solid.contains(points_mm)
    inside = points[:, 2] > 0
    images = perspective.forward(vertices)[region.solid.faces]
    upright = Membership(images, np.eye(3))
    inside[inside] = upright.contains(perspective.forward(points[inside]))
    return inside


def sees_whole_target(viewpoints_mm: npt.ArrayLike, target: Target, scene: Occluders) -> BoolArray:
    """Decide exactly which viewpoints see all of a target.

    For many targets of one scene, keep an `ExactTest` instead.

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
    return ExactTest(scene).sees(viewpoints_mm, target)


def random_viewpoints(
    workspace: Solid, region: Solid, count: int, generator: np.random.Generator
) -> FloatArray:
    """Draw viewpoints all over the workspace, about the region, and close to its boundary.

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
    about = 0 if region.is_empty else count // 4
    close = _close_to_boundary(workspace, region, about, generator)
    bounds = region.bounds_mm if about else workspace.bounds_mm
    return np.concatenate(
        [
            close,
            _inside(workspace, bounds, about, generator),
            _inside(workspace, workspace.bounds_mm, count - about - len(close), generator),
        ]
    )


def _inside(
    workspace: Solid, bounds: FloatArray, count: int, generator: np.random.Generator
) -> FloatArray:
    found = np.zeros((0, 3))
    while len(found) < count:
        drawn = generator.uniform(bounds[0], bounds[1], (2 * (count - len(found)) + 16, 3))
        found = np.concatenate([found, drawn[workspace.contains(drawn)]])
    return found[:count]


def _close_to_boundary(
    workspace: Solid, region: Solid, count: int, generator: np.random.Generator
) -> FloatArray:
    """Up to (count, 3) points on either side of the boundary; those outside of the workspace go."""
    if not count:
        return np.zeros((0, 3))
    triangles = region.triangles_mm
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normals, axis=-1)
    which = generator.choice(len(area), count, p=area / area.sum())
    places = np.einsum("kj,kji->ki", generator.dirichlet(np.ones(3), count), triangles[which])
    diagonal = float(np.linalg.norm(np.ptp(workspace.bounds_mm, axis=0)))
    away = diagonal * np.exp(generator.uniform(np.log(_CLOSE[0]), np.log(_CLOSE[1]), count))
    away *= generator.choice([-1.0, 1.0], count)
    points: FloatArray = places + (away / area[which])[:, None] * normals[which]
    return points[workspace.contains(points)]
