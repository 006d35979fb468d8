"""Picks a flat face of a part: the one nearest to a point, or one that the CAD file names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.errors import GeometryError
from planning.body import Body, CadFaces
from planning.polygons import without_straight_corners
from planning.scene import Scene

#: How far, as a share of the size of the body, triangles of one face may be off its plane.
_COPLANAR: Final = 1e-7
#: How many names a message lists.
_SHOWN: Final = 12
#: How far, as a share of the size of a loop, a corner on a straight side may be off it.
_STRAIGHT: Final = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class PickedFace:
    """A flat face of a body: its outline, and the outlines of its holes.

    Parameters
    ----------
    outline_mm
        (N, 3) corners in mm, counter-clockwise seen from outside.
    holes_mm
        (M, 3) corners of each hole in mm, clockwise seen from outside.
    """

    outline_mm: FloatArray
    holes_mm: tuple[FloatArray, ...]


def face_near(scene: Scene, near: npt.ArrayLike, body: str | None = None) -> PickedFace:
    """Pick the flat face nearest to a point.

    Parameters
    ----------
    scene
        The part and what stands about it.
    near
        (3,) a point in mm. Where it is equally near to several faces, the first counts.
    body
        The body it belongs to; None to look at all of them.

    Returns
    -------
    PickedFace
        The face of the CAD model where the file knew its faces; else all triangles that lie in one
        plane and hang together.

    Raises
    ------
    GeometryError
        When there is no such body, or the CAD face is curved.
    """
    point = frozen_array("near", near, (3,))
    bodies = scene.bodies if body is None else (scene.body(body),)
    nearest = [_nearest_triangle(b, point) for b in bodies]
    which = int(np.argmin([distance for _, distance in nearest]))
    found, triangle = bodies[which], nearest[which][0]
    if found.cad is not None:
        number = int(found.cad.of_triangle[triangle])
        place = ", ".join(f"{v:g}" for v in point)
        return _cad_face(found, found.cad, number, f" nearest to ({place}) mm")
    return _outlined(found, _coplanar_with(found, triangle))


def face_called(scene: Scene, face: int | str, body: str | None = None) -> PickedFace:
    """Pick a face by what the CAD file calls it.

    Parameters
    ----------
    scene
        The part and what stands about it.
    face
        Its number, from 0 in the order of the file, or its name.
    body
        The body it belongs to; None to look in all of them.

    Returns
    -------
    PickedFace
        The face.

    Raises
    ------
    GeometryError
        When there is no such face, or several, or it is curved, or the file knew no faces.
    """
    bodies = scene.bodies if body is None else (scene.body(body),)
    knowing = [(b, b.cad) for b in bodies if b.cad is not None]
    if not knowing:
        raise GeometryError(
            f"no face can be picked as {face!r}: the file holds triangles, not CAD faces; pick it "
            "by a point near it, or read the part from STEP"
        )
    found = [
        (b, cad, number)
        for b, cad in knowing
        for number in range(len(cad.kinds))
        if (cad.names[number] == face if isinstance(face, str) else number == face)
    ]
    if len(found) != 1:
        raise GeometryError(_not_one(face, found, flat_faces(scene, body)))
    return _cad_face(*found[0], where="")


def flat_faces(scene: Scene, body: str | None = None) -> list[str]:
    """List what can be picked: flat CAD faces, by name where they have one, else by number.

    Parameters
    ----------
    scene
        The part and what stands about it.
    body
        The body; None for all of them.

    Returns
    -------
    list of str
        Such as "plate: top", "plate: 3".
    """
    return [
        f"{b.name}: {b.cad.names[k] or k}"
        for b in scene.bodies
        if b.cad is not None and (body is None or b.name == body)
        for k in range(len(b.cad.kinds))
        if b.cad.kinds[k] == "plane"
    ]


def _not_one(face: int | str, found: list[tuple[Body, CadFaces, int]], names: list[str]) -> str:
    if found:
        where = ", ".join(f"{b.name}: {number}" for b, _, number in found[:_SHOWN])
        return f"{len(found)} faces are called {face!r} ({where}); give the body, or the number"
    shown = ", ".join(names[:_SHOWN]) + (", …" if len(names) > _SHOWN else "")
    return f"there is no face {face!r}; flat faces are {shown or 'not there at all'}"


def _nearest_triangle(body: Body, point: FloatArray) -> tuple[int, float]:
    triangles = body.triangles_mm
    closest = trimesh.triangles.closest_point(triangles, np.tile(point, (len(triangles), 1)))
    distance = np.linalg.norm(closest - point, axis=-1)
    return int(np.argmin(distance)), float(distance.min())


def _cad_face(body: Body, cad: CadFaces, number: int, where: str) -> PickedFace:
    name = f" {cad.names[number]!r}" if cad.names[number] else ""
    if cad.kinds[number] != "plane":
        raise GeometryError(
            f"face {number}{name} of {body.name}{where} is no plane but a {cad.kinds[number]} "
            "surface; pick a flat face, or give the corners of a polygon or the ends of a segment "
            "on it"
        )
    return _outlined(body, np.flatnonzero(cad.of_triangle == number))


def _coplanar_with(body: Body, seed: int) -> IntArray:
    """Triangles that lie in the plane of one of them and hang together with it."""
    mesh = body.to_mesh()
    corner, normal = mesh.triangles[seed, 0], mesh.face_normals[seed]
    size = float(np.ptp(mesh.vertices, axis=0).max())
    in_plane = (np.abs((mesh.triangles - corner) @ normal) <= _COPLANAR * size).all(axis=1)
    in_plane &= mesh.face_normals @ normal > 0
    pairs = mesh.face_adjacency[in_plane[mesh.face_adjacency].all(axis=1)]
    groups = trimesh.graph.connected_components(pairs, nodes=np.flatnonzero(in_plane))
    facet: IntArray = next(group for group in groups if seed in group)
    return facet


def _outlined(body: Body, triangles: IntArray) -> PickedFace:
    faces = body.faces[triangles]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    directed = {(int(a), int(b)) for a, b in edges}
    following: dict[int, list[int]] = {}
    for a, b in edges:
        if (int(b), int(a)) not in directed:
            following.setdefault(int(a), []).append(int(b))
    loops = []
    while following:
        loop = [next(iter(following))]
        while loop[-1] in following:
            ends = following[loop[-1]]
            if len(ends) == 1:
                del following[loop[-1]]
            loop.append(ends.pop())
        corners = body.vertices_mm[np.array(loop[:-1])]
        size = float(np.ptp(corners, axis=0).max())
        loops.append(without_straight_corners(corners, _STRAIGHT * size))
    # The outline encloses the most; what runs the other way around are holes.
    corners = body.vertices_mm[faces]
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    loops.sort(key=lambda loop: -_area_along(loop, up))
    return PickedFace(loops[0], tuple(loops[1:]))


def _area_along(loop: FloatArray, up: FloatArray) -> float:
    local = loop - loop[0]
    return float(np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0) @ up)
