"""Reads the bodies of a file: triangle meshes, and STEP through its own reader."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import trimesh

from lenscal.arrays import FloatArray, IntArray
from lenscal.document import reason
from lenscal.errors import FileError, UnitError
from lenscal.units import MM_PER_UNIT, unit_in_mm
from planning.body import CadFaces

#: Files of triangles, by the ending of the name; what can also be written.
FILE_TYPES: Final = ("stl", "obj", "ply", "glb")
STEP_TYPES: Final = ("step", "stp")
#: How far triangles may leave the curved surfaces of a STEP file.
CHORD_TOLERANCE_MM: Final = 0.01


class RawBody(NamedTuple):
    """A body as a file holds it, not checked yet.

    Parameters
    ----------
    name
        What the file calls it; empty when it has no name.
    vertices_mm
        (V, 3) corners in mm.
    faces
        (F, 3) indices.
    cad
        The CAD faces, where the file knows them.
    """

    name: str
    vertices_mm: FloatArray
    faces: IntArray
    cad: CadFaces | None


@dataclass(frozen=True, slots=True)
class Source:
    """Where bodies came from: the evidence that goes with everything computed from them.

    Parameters
    ----------
    file
        Name of the file.
    sha256
        Hash of its content.
    unit
        In which its numbers were taken to be.
    chord_tolerance_mm
        How far triangles may leave curved surfaces; None where the file already holds triangles,
        and that is not known.
    """

    file: str
    sha256: str
    unit: str
    chord_tolerance_mm: float | None


def read_bodies(
    path: Path, unit: str | None, chord_tolerance_mm: float = CHORD_TOLERANCE_MM
) -> tuple[list[RawBody], Source]:
    """Read what stands in a file.

    Parameters
    ----------
    path
        An STL, OBJ, PLY, GLB or STEP file.
    unit
        The unit of its numbers. Files of triangles do not say it reliably, so it must be given;
        a STEP file states it, so it may be None, and must agree when it is given.
    chord_tolerance_mm
        How far triangles may leave the curved surfaces of a STEP file.

    Returns
    -------
    bodies : list of RawBody
        The bodies in mm, where the file puts them.
    source : Source
        Which file they came from.

    Raises
    ------
    FileError
        When the file is missing, of another kind, or holds no mesh.
    UnitError
        When the unit is missing, not known, or not that of the STEP file.
    """
    ending = path.suffix.lower().lstrip(".")
    if unit is not None:
        unit_in_mm(unit)
    if ending not in (*FILE_TYPES, *STEP_TYPES):
        raise FileError(
            f"cannot read {path} as a part: its name ends in {path.suffix or 'nothing'!r}; "
            f"known are {', '.join((*FILE_TYPES, *STEP_TYPES))}"
        )
    if unit is None and ending in FILE_TYPES:
        raise UnitError(
            f"the unit of {path} is not known: a {ending} file does not say it reliably; give one "
            f"of {', '.join(MM_PER_UNIT)}"
        )
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot read {path} as a mesh: {reason(error)}") from error
    sha256 = hashlib.sha256(content).hexdigest()
    if ending in STEP_TYPES:
        from planning.step_file import read_step

        bodies, stated = read_step(path, content, unit, chord_tolerance_mm)
        return bodies, Source(path.name, sha256, stated, chord_tolerance_mm)
    scale = unit_in_mm(str(unit))
    loaded = parse_scene(path, lambda: trimesh.load_scene(path, process=False))
    bodies = [
        RawBody(name if len(loaded.geometry) > 1 else "", vertices * scale, mesh.faces, None)
        for name, mesh, vertices in placed_meshes(loaded)
    ]
    if not bodies:
        raise FileError(f"{path} holds no mesh; export the part as triangles")
    return bodies, Source(path.name, sha256, str(unit), None)


def parse_scene(path: Path, load: Callable[[], Any]) -> Any:
    """Call a reader of trimesh, which raises whatever its parsers happen to raise.

    Parameters
    ----------
    path
        The file, for the message.
    load
        The reader.

    Returns
    -------
    trimesh.Scene
        What it read.

    Raises
    ------
    FileError
        When it could not.
    """
    try:
        return load()
    except Exception as error:
        raise FileError(f"cannot read {path} as a mesh: {reason(error)}") from error


def placed_meshes(loaded: Any) -> Iterator[tuple[str, trimesh.Trimesh, FloatArray]]:
    """Go through the meshes of a scene of trimesh.

    Parameters
    ----------
    loaded
        The scene.

    Yields
    ------
    name : str
        Of the node.
    mesh : trimesh.Trimesh
        Its mesh, in its own frame.
    vertices : FloatArray
        Its vertices where the node puts them.
    """
    for node in loaded.graph.nodes_geometry:
        transform, geometry = loaded.graph[node]
        mesh = loaded.geometry[geometry]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            yield str(node), mesh, trimesh.transform_points(mesh.vertices, transform)
