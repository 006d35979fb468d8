"""Reads STEP, the format of CAD programs, through cascadio (the extra ``[step]``).

What the triangles do not carry is read from the text of the file: its unit, and the names of faces.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import trimesh

from lenscal.arrays import FloatArray
from lenscal.errors import FileError, UnitError
from lenscal.units import unit_in_mm
from planning.body import CadFaces
from planning.mesh_file import RawBody, parse_scene, placed_meshes

#: cascadio writes metres, whatever the unit of the file.
_MM_PER_METRE: Final = 1000.0
#: Angle between neighbouring triangles of a curved face, at most.
_ANGLE_RAD: Final = 0.5
#: How well, as a share of the size of the body, a face's plane must agree with the text.
_SAME_PLACE: Final = 1e-5
#: How far apart single precision may put the same coordinate, as a share of the largest.
_SINGLE_PRECISION: Final = 2.0**-22
#: Normals that differ by less belong to one plane.
_SAME_PLANE: Final = 1e-6
_ENTITY: Final = re.compile(r"#(\d+)\s*=\s*(.*?);\s*(?=#\d+\s*=|ENDSEC)", re.DOTALL)
_PREFIXES: Final = {"": "m", "MILLI": "mm", "CENTI": "cm", "MICRO": "um"}
_CONVERTED: Final = {
    "INCH": "in", "FOOT": "ft", "MILLIMETRE": "mm", "MILLIMETER": "mm",
    "CENTIMETRE": "cm", "CENTIMETER": "cm", "METRE": "m", "METER": "m",
}  # fmt: skip


class _NamedShell(NamedTuple):
    """Faces of a shell in the order of the file: names, and where their planes lie in mm."""

    names: list[str]
    planes: list[FloatArray | None]


def read_step(
    path: Path, content: bytes, unit: str | None, chord_tolerance_mm: float
) -> tuple[list[RawBody], str]:
    """Read a STEP file.

    Parameters
    ----------
    path
        Its name, for messages.
    content
        What it holds.
    unit
        What the caller thinks its unit is; None when it is to be taken from the file.
    chord_tolerance_mm
        How far triangles may leave curved surfaces.

    Returns
    -------
    bodies : list of RawBody
        The bodies in mm, with the CAD faces of their triangles.
    unit : str
        The unit that the file states.

    Raises
    ------
    FileError
        When cascadio is not installed, or the file is no STEP or holds no body.
    UnitError
        When the file states another unit than the caller, or none that is known.
    """
    try:
        import cascadio
    except ImportError as error:
        raise FileError(
            f"cannot read {path}: STEP needs cascadio; install it with pip install 'lenscal[step]'"
        ) from error
    if not content.lstrip().startswith(b"ISO-10303-21"):
        raise FileError(f"{path} is no STEP file: it does not begin with ISO-10303-21")
    if b"END-ISO-10303-21" not in content[-200:]:
        raise FileError(f"{path} is cut short: END-ISO-10303-21 is missing; export the part anew")
    entities = dict(_ENTITY.findall(content.decode("latin-1")))
    stated = _stated_unit(path, entities)
    if unit is not None and unit_in_mm(unit) != unit_in_mm(stated):
        raise UnitError(
            f"{path} states its lengths in {stated}, but {unit} is given; leave the unit out, or "
            "export the part anew if the file is wrong"
        )
    glb = parse_scene(
        path,
        lambda: cascadio.load(
            content,
            tol_linear=chord_tolerance_mm,
            tol_angular=_ANGLE_RAD,
            include_brep=True,
        ),
    )
    if not glb:
        raise FileError(f"{path} cannot be read as STEP: it holds no body, or is cut short")
    loaded = parse_scene(path, lambda: trimesh.load_scene(io.BytesIO(glb), file_type="glb"))
    shells = _named_shells(entities, unit_in_mm(stated))
    for mesh in loaded.geometry.values():
        _put_onto_planes(mesh)
    bodies = [
        RawBody(name, vertices * _MM_PER_METRE, mesh.faces, _cad_faces(mesh, shells))
        for name, mesh, vertices in placed_meshes(loaded)
    ]
    if not bodies:
        raise FileError(f"{path} holds no body with faces; export the part as a solid")
    return bodies, stated


def _stated_unit(path: Path, entities: dict[str, str]) -> str:
    """The unit of length that the file's representations are in; they must all agree."""
    found = set()
    for text in entities.values():
        assigned = re.search(r"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\((.*?)\)", text, re.DOTALL)
        for number in re.findall(r"#(\d+)", assigned[1]) if assigned else []:
            unit = entities.get(number, "")
            if "LENGTH_UNIT" not in unit:
                continue
            converted = re.search(r"CONVERSION_BASED_UNIT\s*\(\s*'([^']*)'", unit)
            metric = re.search(r"SI_UNIT\s*\(\s*(?:\.(\w+)\.|\$)\s*,\s*\.METRE\.", unit)
            if converted:
                found.add(_CONVERTED.get(converted[1].upper(), converted[1]))
            elif metric:
                found.add(_PREFIXES.get(metric[1] or "", f"{metric[1]} metre"))
    if len(found) != 1:
        given = f"several, {', '.join(sorted(found))}" if found else "none"
        raise UnitError(
            f"{path} must state one unit of length, but states {given}; export the part anew, in "
            "one of mm, cm, m, in"
        )
    unit = found.pop()
    unit_in_mm(unit)
    return unit


def _named_shells(entities: dict[str, str], mm_per_unit: float) -> list[_NamedShell]:
    shells = []
    for text in entities.values():
        if not re.match(r"(CLOSED|OPEN)_SHELL\b", text):
            continue
        names, planes = [], []
        for number in re.findall(r"#(\d+)", text):
            face = entities.get(number, "")
            named = re.match(r"ADVANCED_FACE\s*\(\s*'((?:[^']|'')*)'", face)
            names.append(named[1].replace("''", "'") if named else "")
            planes.append(_plane_origin(face, entities, mm_per_unit))
        shells.append(_NamedShell(names, planes))
    return shells


def _plane_origin(face: str, entities: dict[str, str], scale: float) -> FloatArray | None:
    """Follow a face to its plane, the plane to its placement, and that to its point."""
    surface = re.search(r"#(\d+)\s*,\s*\.[TF]\.\s*\)\s*$", face)
    text = entities.get(surface[1], "") if surface else ""
    for wanted in ("PLANE", "AXIS2_PLACEMENT_3D"):
        following = re.match(rf"{wanted}\s*\(\s*'[^']*'\s*,\s*#(\d+)", text)
        text = entities.get(following[1], "") if following else ""
    point = re.match(r"CARTESIAN_POINT\s*\(\s*'[^']*'\s*,\s*\((.*?)\)", text)
    return np.array([float(v) for v in point[1].split(",")]) * scale if point else None


def _cad_faces(mesh: trimesh.Trimesh, shells: list[_NamedShell]) -> CadFaces | None:
    of_triangle = mesh.face_attributes.get("brep_index")
    described = mesh.metadata.get("cascadio", {}).get("brep_faces")
    if of_triangle is None or described is None:
        return None
    count = int(np.max(of_triangle)) + 1
    kinds, origins = ["free-form"] * count, [None] * count
    for face in described:
        if face["face_index"] < count:
            kinds[face["face_index"]] = face["type"]
            if face["type"] == "plane":
                origins[face["face_index"]] = np.array(face["origin"]) * _MM_PER_METRE
    size = float(np.ptp(mesh.vertices, axis=0).max()) * _MM_PER_METRE
    # Names are taken from the shell whose planes lie, in order, where those of the body do.
    matching = [shell for shell in shells if _matches(shell, origins, _SAME_PLACE * size)]
    names = matching[0].names if matching else [""] * count
    return CadFaces(np.asarray(of_triangle, dtype=np.int64), tuple(kinds), tuple(names))


def _put_onto_planes(mesh: trimesh.Trimesh) -> None:
    """Give the corners of flat faces back the digits that single precision took from them.

    GLB holds positions in single precision, but the planes of the faces in double. A corner moves
    by the least that puts it onto all planes it lies on, and by no more than that rounding.
    """
    described = mesh.metadata.get("cascadio", {}).get("brep_faces")
    of_triangle = mesh.face_attributes.get("brep_index")
    if described is None or of_triangle is None:
        return
    planes = {f["face_index"]: f for f in described if f["type"] == "plane"}
    # Corners of neighbouring faces are apart in the file; those at one place share their planes.
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    places, of_vertex = np.unique(vertices, axis=0, return_inverse=True)
    corners = of_vertex.reshape(-1)[mesh.faces]
    on: dict[int, set[int]] = {}
    for number in planes:
        for place in np.unique(corners[of_triangle == number]):
            on.setdefault(int(place), set()).add(number)
    alike: dict[tuple[int, ...], list[int]] = {}
    for place, numbers in on.items():
        alike.setdefault(tuple(sorted(numbers)), []).append(place)
    moved = places.copy()
    for together, members in alike.items():
        normals = np.array([planes[k]["normal"] for k in together])
        heights = np.einsum("ki,ki->k", normals, [planes[k]["origin"] for k in together])
        # Planes that are the same but for rounding count once.
        back = np.linalg.pinv(normals, rcond=_SAME_PLANE)
        moved[members] += (heights - places[members] @ normals.T) @ back.T
    step = np.abs(moved - places).max(axis=1)
    rounding = _SINGLE_PRECISION * float(np.abs(places).max())
    moved = np.where((step <= rounding)[:, None], moved, places)
    mesh.vertices = moved[of_vertex.reshape(-1)]


def _matches(shell: _NamedShell, origins: list[Any], tolerance: float) -> bool:
    if len(shell.planes) != len(origins):
        return False
    return all(
        (read is None) == (meshed is None)
        and (read is None or bool(np.abs(read - meshed).max() <= tolerance))
        for read, meshed in zip(shell.planes, origins, strict=True)
    )
