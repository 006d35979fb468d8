"""Targets and workspaces as people type them, such as ``"0,0,12 mm"`` or ``"face:top"``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import GeometryError, InputError, UnitError
from lenscal.units import MM_PER_UNIT, parse_length_mm
from planning.mesh_file import FILE_TYPES, read_bodies
from planning.picking import flat_faces
from planning.scene import Scene
from planning.solid import Solid, box_workspace
from planning.target import Target

#: How far the workspace reaches from the target if none is given, in sizes of the scene.
_REACH: Final = 5.0
_HOW: Final = (
    'write a point near a flat face, such as "0,0,12 mm", or a polygon, such as '
    '"0,0,0; 9,0,0; 9,9,0 mm", or face:NAME for a STEP file'
)


def spoken_targets(
    texts: Sequence[str], scene: Scene, fill_holes: bool = False
) -> tuple[Target, ...]:
    """Read what is to be seen.

    Parameters
    ----------
    texts
        Each a point near a face, ``face:NAME``, ``face:BODY/NAME``, a polygon, a segment, or
        ``line:`` and points.
    scene
        The part, in which faces are looked up.
    fill_holes
        Whether holes of a picked face count as part of it.

    Returns
    -------
    tuple of Target
        At least one; a line gives one for each of its segments.

    Raises
    ------
    InputError
        When there is none, or one cannot be read.
    """
    if not texts:
        names = flat_faces(scene)
        there = f"; faces are {', '.join(names[:12])}" if names else ""
        raise InputError(f"there is no --target; {_HOW}{there}")
    return tuple(target for text in texts for target in _targets(text.strip(), scene, fill_holes))


def spoken_workspace(
    text: str | None, scene: Scene, targets: Sequence[Target]
) -> tuple[Solid, str]:
    """Read where the camera may be.

    Parameters
    ----------
    text
        Two corners of a box, or a mesh file and its unit; None for a box about the target.
    scene
        The scene, whose size the box is measured by.
    targets
        What the box is about.

    Returns
    -------
    workspace : Solid
        A closed solid in mm.
    said : str
        What to tell the user when it was chosen for him, else empty.

    Raises
    ------
    InputError
        When the text cannot be read.
    GeometryError
        When the mesh is no closed solid.
    """
    if text is None:
        centre = np.mean([target.centroid_mm for target in targets], axis=0)
        reach = _REACH * float(np.ptp(scene.bounds_mm, axis=0).max())
        return box_workspace(centre - reach, centre + reach), (
            f"workspace: {reach:g} mm to all sides of the target's centre; --workspace sets another"
        )
    file, colon, unit = text.rpartition(":")
    if colon and Path(file).suffix:
        bodies, _ = read_bodies(Path(file), unit.strip())
        if len(bodies) != 1:
            raise GeometryError(
                f"a workspace is one solid, but {file} holds {len(bodies)}; unite them"
            )
        return Solid.closed(f"the workspace {file}", bodies[0].vertices_mm, bodies[0].faces), ""
    if text.rpartition(".")[2].lower() in FILE_TYPES:
        raise InputError(
            f"the mesh {text} as a workspace has no unit; write it behind a colon, such as "
            f"'{text}:mm'"
        )
    corners = _lengths_mm(text, 6, "--workspace")
    return box_workspace(corners[:3], corners[3:]), ""


def _targets(text: str, scene: Scene, fill_holes: bool) -> tuple[Target, ...]:
    kind, colon, rest = text.partition(":")
    if colon and kind == "face":
        body, slash, name = rest.rpartition("/")
        face: int | str = int(name) if name.isdecimal() else name
        picked = Target.from_face(
            scene, face=face, body=body if slash else None, fill_holes=fill_holes
        )
        return (picked,)
    if colon and kind == "line":
        return Target.polyline(_points_mm(rest))
    if colon:
        raise InputError(f"cannot read --target {text!r}; {_HOW}")
    if not re.search(r"\d", text):
        raise InputError(f"cannot read --target {text!r}; {_HOW}")
    points = _points_mm(text)
    if len(points) == 1:
        return (Target.from_face(scene, points[0], fill_holes=fill_holes),)
    return (Target(points),)


def _points_mm(text: str) -> FloatArray:
    """Read points between semicolons; those without a unit have that of the last."""
    words = [word.strip() for word in text.strip().rstrip(";").split(";")]
    unit = _unit_at_end(words[-1])
    return np.array([_lengths_mm(w if _unit_at_end(w) else w + unit, 3, "--target") for w in words])


def _lengths_mm(text: str, count: int, option: str) -> list[float]:
    """Read numbers between commas; one without a unit has that of the last."""
    words = [word.strip() for word in text.split(",")]
    unit = _unit_at_end(words[-1])
    if len(words) != count:
        raise InputError(
            f"{option} needs {count} numbers between commas, but {text!r} has {len(words)}; write "
            f"'{','.join(['0'] * count)} mm'"
        )
    if not unit:
        raise UnitError(
            f"{option} needs {count} numbers between commas and a unit, but {text!r} has no unit; "
            f"write one of {', '.join(MM_PER_UNIT)} behind it"
        )
    return [parse_length_mm(w if _unit_at_end(w) else w + unit) for w in words]


def _unit_at_end(word: str) -> str:
    found = re.search(r"[a-zA-Zµ]*$", word)
    return found.group() if found else ""
