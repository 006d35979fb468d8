"""The visibility region: all viewpoints in a workspace from which a whole target is seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh
from manifold3d import Manifold

from lenscal.arrays import BoolArray, FloatArray
from lenscal.errors import GeometryError, InputError
from planning.boolean import from_manifold, intersect, subtract, to_manifold
from planning.scene import Scene
from planning.solid import Solid
from planning.target import Target
from planning.visibility.audit import Audit, random_viewpoints, sees_whole_target
from planning.visibility.convex import occluding_pieces
from planning.visibility.frame import TargetFrame
from planning.visibility.shadows import shadow_cutters

#: How near to the boundary, as a share of the workspace's diagonal, the audit does not look.
_AUDIT_TOLERANCE: Final = 1e-6
#: How far in front of the target, as a share of its size, there must be no material.
_JUST_IN_FRONT: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A solid of viewpoints, with the evidence that it is right.

    Parameters
    ----------
    solid
        The region in mm, in the part's frame.
    workspace
        Where the camera may be.
    audit
        What the independent test found.
    why_empty
        A sentence, empty when the region is not.
    """

    solid: Solid
    workspace: Solid
    audit: Audit
    why_empty: str = ""

    @property
    def is_empty(self) -> bool:
        """Whether no viewpoint sees the whole target."""
        return self.solid.is_empty

    @property
    def volume_mm3(self) -> float:
        """Volume in mm³."""
        return self.solid.volume_mm3

    def contains(self, points: npt.ArrayLike) -> BoolArray:
        """Tell from which points the whole target is seen.

        Parameters
        ----------
        points
            (..., 3) projection centres in mm, in the part's frame.

        Returns
        -------
        BoolArray
            (...). On the boundary itself either answer may come.
        """
        return self.solid.contains(points)

    def distance_to_boundary(self, points: npt.ArrayLike) -> FloatArray:
        """Measure how far points are from the boundary, that with the workspace included.

        Parameters
        ----------
        points
            (..., 3) points in mm.

        Returns
        -------
        FloatArray
            (...) mm, positive inside, negative outside; minus infinity when the region is empty.
        """
        distance = self.solid.distance_to_surface_mm(points)
        signed: FloatArray = np.where(self.contains(points), distance, -distance)
        return signed

    def to_mesh(self) -> trimesh.Trimesh:
        """Hand the region over to trimesh.

        Returns
        -------
        trimesh.Trimesh
            A closed mesh in mm; it may have several components.
        """
        return self.solid.to_mesh()

    def intersect(self, other: Region) -> Region:
        """Keep the viewpoints that two regions share, such as those that see two targets.

        Parameters
        ----------
        other
            A region in the same frame.

        Returns
        -------
        Region
            What both share. Its audit adds up theirs: no viewpoint is tried again.
        """
        centre, scale = _centre_and_scale(self.workspace)
        common, imbalance = intersect(
            _local("the region", self.solid, centre, scale),
            _local("the other region", other.solid, centre, scale),
        )
        vertices, faces = from_manifold(common)
        solid = Solid(vertices * scale + centre, faces)
        first, second = self.audit, other.audit
        audit = Audit(
            first.viewpoints + second.viewpoints,
            first.disagreements + second.disagreements,
            first.near_boundary + second.near_boundary,
            max(first.tolerance_mm, second.tolerance_mm),
            first.visible + second.visible,
            max(first.imbalance, second.imbalance, imbalance),
            first.repairs + second.repairs,
        )
        why = self.why_empty or other.why_empty or "the two regions share no viewpoint"
        return Region(solid, self.workspace, audit, why if solid.is_empty else "")


def visibility_region(
    scene: Scene,
    target: Target,
    workspace: Solid,
    method: str = "direct",
    audit_points: int = 10_000,
    seed: int = 0,
) -> Region:
    """Compute exactly from where in a workspace the whole of a target is seen.

    Parameters
    ----------
    scene
        All that can hide the target, the part it belongs to included.
    target
        A polygon, or a segment, which has no plane and so no front.
    workspace
        Where the projection centre may be, a closed solid in the part's frame.
    method
        "direct": shadows of convex pieces are subtracted from the workspace.
    audit_points
        How many random viewpoints are compared with the independent exact test.
    seed
        Seed of those viewpoints.

    Returns
    -------
    Region
        The region; empty, with the reason, when the target is hidden from everywhere.

    Raises
    ------
    InputError
        When the method is not known.
    GeometryError
        When material covers the target, or the boolean operations fail.
    """
    if method != "direct":
        raise InputError(
            f"unknown method {method!r} of computing visibility; available is 'direct'"
        )
    _refuse_covered(scene, target)
    frame = TargetFrame.around(target, workspace)
    local = to_manifold("the workspace", frame.to_local(workspace.vertices_mm), workspace.faces)
    whole = local.volume()
    if not target.is_segment:
        local = local.trim_by_plane([0.0, 0.0, 1.0], 0.0)
    in_front = not local.is_empty()
    if target.is_segment:
        local = _without_material(local, scene, frame)
    pieces = occluding_pieces(scene, target, frame)
    imbalance, repairs = 0.0, 0
    for corners in frame.target_pieces(target):
        cutters = shadow_cutters(pieces, corners, frame.tolerance)
        local, worst, repeated = subtract(local, cutters)
        imbalance, repairs = max(imbalance, worst / whole), repairs + repeated
    vertices, faces = from_manifold(local)
    solid = Solid(frame.to_part(vertices), faces)
    audit = _audited(scene, target, workspace, solid, audit_points, seed, imbalance, repairs)
    return Region(solid, workspace, audit, _why_empty(solid, in_front))


def _audited(
    scene: Scene,
    target: Target,
    workspace: Solid,
    solid: Solid,
    count: int,
    seed: int,
    imbalance: float,
    repairs: int,
) -> Audit:
    tolerance = _AUDIT_TOLERANCE * float(np.linalg.norm(np.ptp(workspace.bounds_mm, axis=0)))
    points = random_viewpoints(workspace, solid, count, np.random.default_rng(seed))
    sees = sees_whole_target(points, target, scene)
    different = points[sees != solid.contains(points)]
    away = solid.distance_to_surface_mm(different) > tolerance
    return Audit(
        viewpoints=count,
        disagreements=int(away.sum()),
        near_boundary=int((~away).sum()),
        tolerance_mm=tolerance,
        visible=int(sees.sum()),
        imbalance=imbalance,
        repairs=repairs,
    )


def _refuse_covered(scene: Scene, target: Target) -> None:
    if target.is_segment:
        return
    middles = np.array([target.vertices_mm[piece].mean(axis=0) for piece in target.pieces])
    lifted = middles + _JUST_IN_FRONT * target.size_mm * target.normal
    covered = scene.inside_material(lifted)
    if covered.any():
        x, y, z = middles[np.argmax(covered)]
        raise GeometryError(
            f"material lies on the target at ({x:g}, {y:g}, {z:g}) mm; its vertices must go around "
            "it counter-clockwise seen from outside of the part, and nothing may cover it"
        )


def _without_material(local: Manifold, scene: Scene, frame: TargetFrame) -> Manifold:
    """No camera is inside of a body; for a polygon the faces of bodies see to that."""
    for name, body in zip(scene.names, scene.bodies, strict=True):
        local = local - to_manifold(name, frame.to_local(body.vertices_mm), body.faces)
    return local


def _why_empty(solid: Solid, in_front: bool) -> str:
    if not solid.is_empty:
        return ""
    if not in_front:
        return "the whole workspace lies behind the plane of the target"
    return "every viewpoint in the workspace has material between it and some point of the target"


def _centre_and_scale(workspace: Solid) -> tuple[FloatArray, float]:
    low, high = workspace.bounds_mm
    centre: FloatArray = (low + high) / 2
    return centre, float(np.linalg.norm(high - low)) / 2


def _local(name: str, solid: Solid, centre: FloatArray, scale: float) -> Manifold:
    if solid.is_empty:
        return Manifold()
    return to_manifold(name, (solid.vertices_mm - centre) / scale, solid.faces)
