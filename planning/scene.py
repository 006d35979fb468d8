"""The part and what stands about it: closed bodies in one frame, in millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import trimesh

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from lenscal.document import digest, reason
from lenscal.errors import FileError, GeometryError
from lenscal.units import unit_in_mm
from planning.solid import Solid

#: What can be read, by the ending of the file.
FILE_TYPES: Final = ("stl", "obj", "ply", "glb")


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Bodies that can hide a target, the part itself among them.

    Parameters
    ----------
    meshes
        Closed triangle meshes in mm, all in the frame of the part.
    names
        What each body is called; by default "body 0" and so on.

    Raises
    ------
    GeometryError
        When there is no mesh, or one is empty, open, flat or inside out, or names are too few.
    """

    meshes: Sequence[trimesh.Trimesh]
    names: Sequence[str] = ()
    bodies: tuple[Solid, ...] = field(init=False)

    def __post_init__(self) -> None:
        meshes = tuple(self.meshes)
        if not meshes:
            raise GeometryError("a scene needs at least one body, but none was given")
        names = tuple(self.names) or tuple(f"body {i}" for i in range(len(meshes)))
        if len(names) != len(meshes):
            raise GeometryError(
                f"there are {len(meshes)} bodies but {len(names)} names; give each body one"
            )
        bodies = tuple(
            Solid.closed(name, mesh.vertices, mesh.faces)
            for name, mesh in zip(names, meshes, strict=True)
        )
        object.__setattr__(self, "meshes", meshes)
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "bodies", bodies)

    @classmethod
    def load(cls, path: Path | str, unit: str) -> Scene:
        """Read a file of CAD triangles.

        Parameters
        ----------
        path
            An STL, OBJ, PLY or GLB file. Each of its meshes becomes a body.
        unit
            The unit of its numbers: these files do not say it reliably, so the caller must.

        Returns
        -------
        Scene
            The bodies in mm.

        Raises
        ------
        FileError
            When the file is missing, of another kind, or no mesh.
        UnitError
            When the unit is not known.
        """
        path = Path(path)
        scale = unit_in_mm(unit)
        if path.suffix.lower().lstrip(".") not in FILE_TYPES:
            raise FileError(
                f"cannot read {path} as a part: its name ends in {path.suffix or 'nothing'!r}; "
                f"known are {', '.join(FILE_TYPES)}"
            )
        try:
            loaded = trimesh.load_scene(path, process=False)
            meshes = loaded.dump() if len(loaded.geometry) else []
        # The readers of trimesh raise whatever their parsers happen to raise.
        except Exception as error:
            raise FileError(f"cannot read {path} as a mesh: {reason(error)}") from error
        bodies = [m for m in meshes if isinstance(m, trimesh.Trimesh) and len(m.faces)]
        if not bodies:
            raise FileError(f"{path} holds no mesh; export the part as triangles")
        names = [f"{path.name} body {i}" if i else path.name for i in range(len(bodies))]
        return cls([_scaled(m, scale) for m in bodies], names)

    @property
    def bounds_mm(self) -> FloatArray:
        """(2, 3) lowest and highest corner of all bodies in mm."""
        bounds = np.stack([body.bounds_mm for body in self.bodies])
        return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])

    @property
    def triangles_mm(self) -> FloatArray:
        """(F, 3, 3) faces of all bodies in mm."""
        return np.concatenate([body.triangles_mm for body in self.bodies])

    @property
    def digest(self) -> str:
        """SHA-256 of all bodies and their names, in hexadecimal."""
        return digest({"names": list(self.names), "bodies": [b.digest for b in self.bodies]})

    def inside_material(self, points_mm: npt.ArrayLike) -> BoolArray:
        """Tell which points lie inside a body.

        Parameters
        ----------
        points_mm
            (..., 3) points in mm.

        Returns
        -------
        BoolArray
            (...).
        """
        points = frozen_array("points_mm", points_mm, ("...", 3))
        inside = np.zeros(points.shape[:-1], dtype=bool)
        for body in self.bodies:
            inside |= body.contains(points)
        return inside


def _scaled(mesh: trimesh.Trimesh, scale: float) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices * scale, mesh.faces, process=False)
