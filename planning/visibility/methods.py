"""The methods by which a visibility region is computed, and what they have in common.

A method gives one *factor* for each convex piece of the target: all viewpoints of a convex extent,
larger than the workspace, that see the piece. The workspace and the factors are intersected, and an
independent test audits what comes out.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from manifold3d import Manifold

from lenscal.document import digest, versions
from lenscal.errors import GeometryError, InputError
from lenscal.progress import Progress
from planning.boolean import from_manifold, intersect, to_manifold
from planning.scene import Scene
from planning.solid import Solid
from planning.target import Target
from planning.visibility.audit import TOLERANCE, Audit, random_viewpoints
from planning.visibility.decomposition import decomposition_factors
from planning.visibility.diagnosis import why_hidden
from planning.visibility.direct import direct_factors
from planning.visibility.exact_test import ExactTest
from planning.visibility.factor import Factor, PlacedFactor
from planning.visibility.frame import TargetFrame
from planning.visibility.region import Region

#: How far in front of the target, as a share of its size, there must be no material.
_JUST_IN_FRONT: Final = 1e-6
#: How many viewpoints are tried to find out what hides a target from everywhere.
_DIAGNOSED: Final = 500

#: How it may be computed.
METHODS: Final = ("direct", "decomposition")


def visibility_region(
    scene: Scene,
    target: Target,
    workspace: Solid,
    method: str = "direct",
    audit_points: int = 10_000,
    seed: int = 0,
    exact_test: ExactTest | None = None,
    margin_mm: float = 0.0,
    progress: Progress | None = None,
    guarded: bool = True,
) -> Region:
    """Compute exactly from where in a workspace the whole of a target is seen.

    Parameters
    ----------
    scene
        All that can hide the target, the part it belongs to included.
    target
        A polygon, or a segment, which has no plane and so no front.
    workspace
        Where the projection centre may be, in the part's frame: a box, or any closed solid.
    method
        "direct": shadows of convex pieces are subtracted from the workspace. "decomposition": the
        paper's algorithm on faces with holes, several times slower.
    audit_points
        How many random viewpoints are compared with the independent exact test.
    seed
        Seed of those viewpoints.
    exact_test
        The scene prepared for that test, where the caller has it for many targets.
    margin_mm
        By how much, in mm, all that can hide the target is made larger first, for parts that are
        not quite as drawn. What the region then holds is on the safe side: the audit makes sure
        that nothing in it is hidden by the scene as it is. Only for the direct method.
    progress
        Told how many of the scene's convex pieces are done with.
    guarded
        Whether boolean operations that lose volume are repeated. Only for showing, with the direct
        method, what happens without: the audit counts it.

    Returns
    -------
    Region
        The region; empty, with the reason, when the target is hidden from everywhere.

    Raises
    ------
    InputError
        When the method is not known, or has no margin, or the margin is negative.
    GeometryError
        When material covers the target, the workspace is no closed solid, or the boolean operations
        fail.
    """
    if method not in METHODS:
        raise InputError(
            f"unknown method {method!r} of computing visibility; available are "
            f"{', '.join(map(repr, METHODS))}"
        )
    if not (np.isfinite(margin_mm) and margin_mm >= 0):
        raise InputError(f"margin_mm must be zero or positive, but is {margin_mm:g} mm")
    if margin_mm > 0 and method != "direct":
        raise InputError(
            f"a margin of {margin_mm:g} mm is only known to the method 'direct', but the method is "
            f"{method!r}; leave one of both out"
        )
    workspace = Solid.closed("the workspace", workspace.vertices_mm, workspace.faces)
    _refuse_covered(scene, target)
    frame = TargetFrame.around(target, workspace)
    local = to_manifold("the workspace", frame.to_local(workspace.vertices_mm), workspace.faces)
    whole = local.volume()
    in_front = target.is_segment or not local.trim_by_plane([0.0, 0.0, 1.0], 0.0).is_empty()
    if target.is_segment:
        local = _without_material(local, scene, frame)
    factors: list[Factor] = []
    if in_front and method == "direct":
        margin = margin_mm / frame.scale_mm
        factors = direct_factors(scene, target, frame, guarded, margin, progress)
    elif in_front:
        factors = decomposition_factors(scene, target, frame)
    imbalances = [factor.imbalance for factor in factors]
    for factor in factors:
        local, imbalance = intersect(local, factor.solid, guarded)
        imbalances.append(imbalance / whole)
    vertices, faces = from_manifold(local if in_front else Manifold())
    solid = Solid(frame.to_part(vertices), faces)
    region = Region(
        solid,
        workspace,
        _unaudited(workspace, imbalances, factors, margin_mm),
        _why_empty(scene, target, workspace, solid, in_front, margin_mm),
        tuple(PlacedFactor(factor, frame) for factor in factors),
        excluded=tuple(scene.bodies) if target.is_segment else (),
        evidence=_evidence(scene, target, method, seed),
    )
    if not audit_points:
        return region
    points = random_viewpoints(workspace, solid, audit_points, np.random.default_rng(seed))
    sees = (exact_test or ExactTest(scene)).sees(points, target)
    return replace(region, audit=region.audit.with_viewpoints(region, points, sees))


def _unaudited(
    workspace: Solid, imbalances: list[float], factors: list[Factor], margin_mm: float
) -> Audit:
    tolerance = TOLERANCE * float(np.linalg.norm(np.ptp(workspace.bounds_mm, axis=0)))
    repairs = sum(factor.repairs for factor in factors)
    return Audit(0, 0, 0, tolerance, 0, max(imbalances, default=0.0), repairs, margin_mm)


def _refuse_covered(scene: Scene, target: Target) -> None:
    """Of a polygon, the front must be free; a segment may lie on material, but not in it."""
    middles = np.array([target.vertices_mm[piece].mean(axis=0) for piece in target.pieces])
    away = _JUST_IN_FRONT * target.size_mm
    if target.is_segment:
        covered = scene.inside_material(middles)
        for body in scene.bodies:
            covered &= body.distance_to_surface_mm(middles) > away
        advice = "a segment may lie on the surface of the part, but not inside of it"
    else:
        covered = scene.inside_material(middles + away * target.normal)
        advice = (
            "its vertices must go around it counter-clockwise seen from outside of the part, and "
            "nothing may cover it"
        )
    if covered.any():
        x, y, z = middles[np.argmax(covered)]
        raise GeometryError(f"material lies on the target at ({x:g}, {y:g}, {z:g}) mm; {advice}")


def _without_material(local: Manifold, scene: Scene, frame: TargetFrame) -> Manifold:
    """No camera is inside of a body; for a polygon the faces of bodies see to that."""
    for body in scene.bodies:
        if body.is_closed:
            local = local - to_manifold(body.name, frame.to_local(body.vertices_mm), body.faces)
    return local


def _why_empty(
    scene: Scene,
    target: Target,
    workspace: Solid,
    solid: Solid,
    in_front: bool,
    margin_mm: float,
) -> str:
    if not solid.is_empty:
        return ""
    if not in_front:
        return "the whole workspace lies behind the plane of the target"
    tried = random_viewpoints(workspace, solid, _DIAGNOSED, np.random.default_rng(0))
    if margin_mm > 0 and ExactTest(scene).sees(tried, target).any():
        return (
            f"occluders that are larger by the margin of {margin_mm:g} mm hide the target from "
            "everywhere, those that touch it among them; ask for a smaller margin, or a target "
            "that keeps away from its borders"
        )
    return why_hidden(scene, target, tried)


def _evidence(scene: Scene, target: Target, method: str, seed: int) -> dict[str, Any]:
    return {
        "method": method,
        "audit_seed": seed,
        "scene_digest": scene.digest,
        "target_digest": digest({"vertices_mm": target.vertices_mm.tolist()}),
        "made_with": versions("lenscal", "manifold3d", "numpy"),
    }
