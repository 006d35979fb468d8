"""The methods by which a visibility region is computed, and what they have in common.

A method gives one *factor* for each convex piece of the target: all viewpoints of a convex extent,
larger than the workspace, that see the piece. The workspace and the factors are intersected, and an
independent test audits what comes out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from manifold3d import Manifold

from lenscal.errors import GeometryError, InputError
from planning.boolean import from_manifold, intersect, to_manifold
from planning.scene import Scene
from planning.solid import Solid
from planning.target import Target
from planning.visibility.audit import Audit, random_viewpoints, sees_whole_target
from planning.visibility.decomposition import decomposition_factors
from planning.visibility.direct import direct_factors
from planning.visibility.factor import Factor
from planning.visibility.frame import TargetFrame
from planning.visibility.region import Region

#: How near to the boundary, as a share of the workspace's diagonal, the audit does not look.
_AUDIT_TOLERANCE: Final = 1e-6
#: How far in front of the target, as a share of its size, there must be no material.
_JUST_IN_FRONT: Final = 1e-6

#: Computes a factor for each convex piece of a target within the frame's extent.
Method = Callable[[Scene, Target, TargetFrame], list[Factor]]

METHODS: Final[dict[str, Method]] = {
    "direct": direct_factors,
    "decomposition": decomposition_factors,
}


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
        "direct": shadows of convex pieces are subtracted from the workspace. "decomposition": the
        paper's algorithm on faces with holes, several times slower.
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
    if method not in METHODS:
        raise InputError(
            f"unknown method {method!r} of computing visibility; available are "
            f"{', '.join(map(repr, METHODS))}"
        )
    _refuse_covered(scene, target)
    frame = TargetFrame.around(target, workspace)
    local = to_manifold("the workspace", frame.to_local(workspace.vertices_mm), workspace.faces)
    whole = local.volume()
    in_front = target.is_segment or not local.trim_by_plane([0.0, 0.0, 1.0], 0.0).is_empty()
    if target.is_segment:
        local = _without_material(local, scene, frame)
    factors = METHODS[method](scene, target, frame) if in_front else []
    imbalances = [factor.imbalance for factor in factors]
    for factor in factors:
        local, imbalance = intersect(local, factor.solid)
        imbalances.append(imbalance / whole)
    if not in_front:
        local = Manifold()
    vertices, faces = from_manifold(local)
    solid = Solid(frame.to_part(vertices), faces)
    repairs = sum(factor.repairs for factor in factors)
    audit = _audited(
        scene, target, workspace, solid, audit_points, seed, max(imbalances, default=0.0), repairs
    )
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
