"""What a single polygon hides, and what a single hole shows: the tasks of the paper as regions.

`occlusion_steps` and `face_steps` give the solids on the way, from which figures 1 to 8 and 16 of
the paper are drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from manifold3d import Manifold, OpType

from lenscal.arrays import BoolArray, FloatArray
from planning.boolean import from_manifold, intersect, subtract, to_manifold
from planning.scene import Scene
from planning.solid import Solid
from planning.target import Target
from planning.visibility.audit import Audit, random_viewpoints, sees_whole_target
from planning.visibility.decomposition import faces_in_front, factor_past
from planning.visibility.frame import TargetFrame
from planning.visibility.gulfs import Part, face_part, hole_part
from planning.visibility.loops import FlatFace, axes_across
from planning.visibility.part_regions import PartRegions, plane_sides
from planning.visibility.region import Region
from planning.visibility.sheet import Sheet

#: How near to the boundary, as a share of the workspace's diagonal, the audit does not look.
_AUDIT_TOLERANCE: Final = 1e-6
#: Half the side of the screen about a hole that the audit looks past, in units of the frame beyond
#: the distance of the hole: more than workspace and target span.
_SCREEN: Final = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One task of the decomposition, for one convex piece of the target.

    Parameters
    ----------
    name
        Where it stands, such as "material/gulf 0/rest 1".
    is_material
        Whether the polygon hides; otherwise it is a hole.
    piece
        Which convex piece of the target.
    outline_mm
        (N, 3) corners of the polygon; an equivalent hole ends beyond all lines of sight.
    hull_mm
        (H, 3) corners of its convex hull.
    hull_region
        What the hull hides or shows: the convex task.
    region
        What the polygon hides or shows: the same less the regions of what is inside.
    """

    name: str
    is_material: bool
    piece: int
    outline_mm: FloatArray
    hull_mm: FloatArray
    hull_region: Solid
    region: Solid


def occluded_region(
    occluder_polygon: npt.ArrayLike,
    target: Target,
    workspace: Solid,
    holes: Sequence[npt.ArrayLike] = (),
    audit_points: int = 10_000,
    seed: int = 0,
) -> Region:
    """Compute from where in a workspace a polygon hides some of a target.

    Parameters
    ----------
    occluder_polygon
        (N, 3) corners of a planar polygon in order, in mm; it may be concave.
    target
        A polygon, or a segment.
    workspace
        Where the projection centre may be. What lies behind a polygon target is left out.
    holes
        (M, 3) corners of each hole; a hole within a hole is an island.
    audit_points
        How many random viewpoints are compared with the independent exact test.
    seed
        Seed of those viewpoints.

    Returns
    -------
    Region
        The viewpoints in front of the target that do not see all of it; equation (1) of the paper.

    Raises
    ------
    GeometryError
        When the polygon cannot be used, or the boolean operations fail.
    """
    sheet = _sheet(occluder_polygon, holes)
    frame = TargetFrame.around(target, workspace)
    space = _space(workspace, target, frame)
    faces = sheet.faces_in_front(target, frame)
    visible, imbalances, repairs = space, [0.0], 0
    for corners in frame.target_pieces(target):
        factor = factor_past(faces, target, frame, corners)
        visible, imbalance = intersect(visible, factor.solid)
        imbalances += [imbalance, factor.imbalance]
        repairs += factor.repairs
    hidden, imbalance, again = subtract(space, [lambda _: visible])

    def truth(points: FloatArray) -> BoolArray:
        return _in_front(points, target) & ~sees_whole_target(points, target, sheet)

    return _region(
        frame,
        hidden,
        workspace,
        truth,
        (audit_points, seed),
        (max([*imbalances, imbalance]), repairs + again),
        "the polygon hides the target from no viewpoint in the workspace",
    )


def viewing_region(
    hole_polygon: npt.ArrayLike,
    target: Target,
    workspace: Solid,
    audit_points: int = 10_000,
    seed: int = 0,
) -> Region:
    """Compute from where in a workspace all of a target is seen through a hole.

    Parameters
    ----------
    hole_polygon
        (N, 3) corners of a planar polygon in order, in mm; it may be concave. All the rest of its
        plane is taken to be material.
    target
        A polygon, or a segment.
    workspace
        Where the projection centre may be.
    audit_points
        How many random viewpoints are compared with the independent exact test.
    seed
        Seed of those viewpoints.

    Returns
    -------
    Region
        The viewpoints beyond the plane of the hole that see the target through it.

    Raises
    ------
    GeometryError
        When the polygon cannot be used, or the boolean operations fail.
    """
    hole = _sheet(hole_polygon, ())
    frame = TargetFrame.around(target, workspace)
    seen, imbalances, repairs = _space(workspace, target, frame), [0.0], 0
    faces = hole.faces_in_front(target, frame)
    for corners in frame.target_pieces(target):
        makers = _makers(faces, corners, frame)
        through = Manifold.batch_boolean(
            [
                maker.region(hole_part(face.outline, face.normal))
                for face, own in zip(faces, makers, strict=True)
                for maker in own
            ]
            or [Manifold()],
            OpType.Add,
        )
        seen, imbalance = intersect(seen, through)
        imbalances += [imbalance, *(maker.imbalance for own in makers for maker in own)]
        repairs += sum(maker.repairs for own in makers for maker in own)
    screen = _screen(hole, frame)

    def truth(points: FloatArray) -> BoolArray:
        height = (points - hole.vertices_mm[0]) @ hole.normal
        of_target = (target.vertices_mm - hole.vertices_mm[0]) @ hole.normal
        tolerance = frame.tolerance * frame.scale_mm
        beyond = (height > 0) & (of_target.min() < -tolerance)
        beyond |= (height < 0) & (of_target.max() > tolerance)
        sees: BoolArray = beyond & sees_whole_target(points, target, screen)
        return sees

    return _region(
        frame,
        seen,
        workspace,
        truth,
        (audit_points, seed),
        (max(imbalances), repairs),
        "no viewpoint in the workspace sees the whole target through the hole",
    )


def occlusion_steps(
    occluder_polygon: npt.ArrayLike,
    target: Target,
    workspace: Solid,
    holes: Sequence[npt.ArrayLike] = (),
) -> Iterator[Step]:
    """Give the tasks into which the occluded region of a polygon is decomposed, with their solids.

    Parameters
    ----------
    occluder_polygon, target, workspace, holes
        As for `occluded_region`.

    Yields
    ------
    Step
        First the material as a whole, then its gulfs, holes and all that is inside of them; the
        same for each island, each part in front and each convex piece of the target.
    """
    sheet = _sheet(occluder_polygon, holes)
    frame = TargetFrame.around(target, workspace)
    space = _space(workspace, target, frame)
    faces = sheet.faces_in_front(target, frame)
    for piece, corners in enumerate(frame.target_pieces(target)):
        for face, makers in zip(faces, _makers(faces, corners, frame), strict=True):
            yield from _steps(face_part(face), "", piece, makers, space, frame)


def face_steps(scene: Scene, target: Target, workspace: Solid) -> Iterator[Step]:
    """Give what each face of a scene hides, such as that of the top face in figure 16.

    Parameters
    ----------
    scene, target, workspace
        As for `visibility_region`.

    Yields
    ------
    Step
        The material of each face in front of the target, nearest first, without what is inside.
    """
    frame = TargetFrame.around(target, workspace)
    space = _space(workspace, target, frame)
    faces = faces_in_front(scene, target, frame)
    for piece, corners in enumerate(frame.target_pieces(target)):
        for face, makers in zip(faces, _makers(faces, corners, frame), strict=True):
            yield next(_steps(face_part(face), "", piece, makers, space, frame))


def _steps(
    part: Part,
    path: str,
    piece: int,
    makers: list[PartRegions],
    space: Manifold,
    frame: TargetFrame,
) -> Iterator[Step]:
    def in_part(solids: list[Manifold]) -> Solid:
        whole = Manifold.batch_boolean(solids or [Manifold()], OpType.Add)
        vertices, faces = from_manifold(intersect(space, whole)[0])
        return Solid(frame.to_part(vertices), faces)

    name = f"{path}{part.name}"
    yield Step(
        name,
        part.is_material,
        piece,
        frame.to_part(part.outline),
        frame.to_part(part.hull),
        in_part([maker.hull_region(part) for maker in makers]),
        in_part([maker.region(part) for maker in makers]),
    )
    for inner in part.inside:
        yield from _steps(inner, f"{name}/", piece, makers, space, frame)


def _makers(
    faces: list[FlatFace], corners: FloatArray, frame: TargetFrame
) -> list[list[PartRegions]]:
    return [
        [
            PartRegions(side)
            for side in plane_sides(face.normal, face.offset, corners, frame.tolerance)
        ]
        for face in faces
    ]


def _sheet(outline: npt.ArrayLike, holes: Sequence[npt.ArrayLike]) -> Sheet:
    loops = [np.asarray(loop, dtype=np.float64) for loop in (outline, *holes)]
    return Sheet(loops[0], loops[1:])


def _space(workspace: Solid, target: Target, frame: TargetFrame) -> Manifold:
    """The workspace, as far as it is in front of the target."""
    space = to_manifold("the workspace", frame.to_local(workspace.vertices_mm), workspace.faces)
    return space if target.is_segment else space.trim_by_plane([0.0, 0.0, 1.0], 0.0)


def _in_front(points: FloatArray, target: Target) -> BoolArray:
    if target.is_segment:
        return np.ones(len(points), dtype=bool)
    front: BoolArray = (points - target.centroid_mm) @ target.normal > target.flatness_mm
    return front


def _screen(hole: Sheet, frame: TargetFrame) -> Sheet:
    """All of the hole's plane that lines of sight can meet, with the hole in it."""
    middle = hole.vertices_mm.mean(axis=0)
    size = float(np.ptp(hole.vertices_mm, axis=0).max())
    far = np.linalg.norm(middle - frame.origin_mm) + size + _SCREEN * frame.scale_mm
    square = np.array([[-far, -far], [far, -far], [far, far], [-far, far]])
    return Sheet(middle + square @ axes_across(hole.normal), [hole.vertices_mm])


def _region(
    frame: TargetFrame,
    local: Manifold,
    workspace: Solid,
    truth: Callable[[FloatArray], BoolArray],
    audit_points_and_seed: tuple[int, int],
    imbalance_and_repairs: tuple[float, int],
    why_empty: str,
) -> Region:
    vertices, faces = from_manifold(local)
    solid = Solid(frame.to_part(vertices), faces)
    count, seed = audit_points_and_seed
    tolerance = _AUDIT_TOLERANCE * float(np.linalg.norm(np.ptp(workspace.bounds_mm, axis=0)))
    points = random_viewpoints(workspace, solid, count, np.random.default_rng(seed))
    truly = truth(points)
    different = points[truly != solid.contains(points)]
    away = solid.distance_to_surface_mm(different) > tolerance
    audit = Audit(
        viewpoints=count,
        disagreements=int(away.sum()),
        near_boundary=int((~away).sum()),
        tolerance_mm=tolerance,
        visible=int(truly.sum()),
        imbalance=imbalance_and_repairs[0],
        repairs=imbalance_and_repairs[1],
    )
    return Region(solid, workspace, audit, why_empty if solid.is_empty else "")
