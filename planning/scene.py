"""The part and what stands about it: bodies in one frame, in millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from lenscal.document import digest
from lenscal.errors import GeometryError
from lenscal.pose import Pose
from planning.body import Body, CadFaces
from planning.mesh_file import CHORD_TOLERANCE_MM, FILE_TYPES, Source, read_bodies

__all__ = ["FILE_TYPES", "Scene"]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Bodies that can hide a target, the part itself among them.

    Parameters
    ----------
    meshes
        Triangle meshes in mm, each in the frame of its body.
    names
        What each body is called; by default "body 0" and so on.
    poses
        part_from_body of each; by default every body is in the frame of the part.
    as_faces
        Take meshes that are open, inside out, or cross themselves as bare faces, which hide from
        both sides and have no inside. Otherwise they are refused.
    sources
        The files that the bodies came from.

    Raises
    ------
    GeometryError
        When there is no mesh, or one is empty or no solid, or names or poses are too few, or two
        bodies have one name.
    """

    meshes: Sequence[trimesh.Trimesh]
    names: Sequence[str] = ()
    poses: Sequence[Pose] = ()
    as_faces: bool = False
    sources: Sequence[Source] = ()
    bodies: tuple[Body, ...] = field(init=False)

    def __post_init__(self) -> None:
        meshes = tuple(self.meshes)
        if not meshes:
            raise GeometryError("a scene needs at least one body, but none was given")
        names = tuple(self.names) or tuple(f"body {i}" for i in range(len(meshes)))
        poses = tuple(self.poses) or (Pose.identity(),) * len(meshes)
        for given, word in ((names, "names"), (poses, "poses")):
            if len(given) != len(meshes):
                raise GeometryError(
                    f"there are {len(meshes)} bodies but {len(given)} {word}; give each body one"
                )
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise GeometryError(
                f"two bodies are called {twice!r}; give each a name of its own, so that it can be "
                "moved and picked"
            )
        bodies = tuple(
            Body.from_triangles(
                name, pose.transform(mesh.vertices), mesh.faces, _cad_of(mesh), self.as_faces
            )
            for mesh, name, pose in zip(meshes, names, poses, strict=True)
        )
        for name, value in (
            ("meshes", meshes),
            ("names", names),
            ("poses", poses),
            ("sources", tuple(self.sources)),
            ("bodies", bodies),
        ):
            object.__setattr__(self, name, value)

    @classmethod
    def load(
        cls,
        path: Path | str,
        unit: str | None = None,
        *,
        as_faces: bool = False,
        chord_tolerance_mm: float = CHORD_TOLERANCE_MM,
    ) -> Scene:
        """Read a file of CAD.

        Parameters
        ----------
        path
            An STL, OBJ, PLY, GLB or STEP file; each of its meshes or solids becomes a body. Or a
            TOML file that names such files with their poses (see `planning.scene_file`).
        unit
            The unit of its numbers. Files of triangles do not say it reliably, so it must be given
            for them; a STEP file and a TOML file state it.
        as_faces
            Take meshes that are no solids as bare faces.
        chord_tolerance_mm
            How far triangles may leave the curved surfaces of a STEP file.

        Returns
        -------
        Scene
            The bodies in mm.

        Raises
        ------
        FileError
            When the file is missing, of another kind, or no mesh.
        UnitError
            When the unit is missing, not known, or not that of the STEP file.
        GeometryError
            When a body is no solid.
        """
        path = Path(path)
        if path.suffix.lower() == ".toml":
            from planning.scene_file import load_scene_file

            return load_scene_file(path, as_faces, chord_tolerance_mm)
        raw, source = read_bodies(path, unit, chord_tolerance_mm)
        meshes, names = [], []
        for k, body in enumerate(raw):
            mesh = trimesh.Trimesh(body.vertices_mm, body.faces, process=False)
            if body.cad is not None:
                mesh.metadata["cad"] = body.cad
            name = body.name or (f"{path.name} body {k}" if k else path.name)
            names.append(name if name not in names else f"{name} ({k})")
            meshes.append(mesh)
        return cls(meshes, names, as_faces=as_faces, sources=(source,))

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
        """Tell which points lie inside a closed body.

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

    def body(self, name: str) -> Body:
        """Look a body up.

        Parameters
        ----------
        name
            What it is called.

        Returns
        -------
        Body
            The body.

        Raises
        ------
        GeometryError
            When there is none of this name.
        """
        return self.bodies[self._index(name)]

    def moved(self, name: str, *part_from_body: Pose) -> Scene:
        """Put a body somewhere else.

        Parameters
        ----------
        name
            What it is called.
        *part_from_body
            Where it is now, in place of where it was. Several poses: it stands at all of them, as
            when it moves while the camera looks; what lies between the poses is not filled.

        Returns
        -------
        Scene
            A new scene. At several poses the body becomes "name @ 0" and so on.

        Raises
        ------
        GeometryError
            When there is no such body, or no pose.
        """
        index = self._index(name)
        if not part_from_body:
            raise GeometryError(f"{name} cannot be moved without a pose; give one or several")
        several = len(part_from_body) > 1
        kept = [i for i in range(len(self.bodies)) if i != index]
        return Scene(
            [self.meshes[i] for i in kept] + [self.meshes[index]] * len(part_from_body),
            [self.names[i] for i in kept]
            + ([f"{name} @ {k}" for k in range(len(part_from_body))] if several else [name]),
            [self.poses[i] for i in kept] + list(part_from_body),
            self.as_faces,
            self.sources,
        )

    def without(self, name: str) -> Scene:
        """Take a body away.

        Parameters
        ----------
        name
            What it is called.

        Returns
        -------
        Scene
            A new scene.

        Raises
        ------
        GeometryError
            When there is no such body, or no other.
        """
        index = self._index(name)
        if len(self.bodies) == 1:
            raise GeometryError(f"{name} is the only body; a scene without it would be empty")
        kept = [i for i in range(len(self.bodies)) if i != index]
        return Scene(
            [self.meshes[i] for i in kept],
            [self.names[i] for i in kept],
            [self.poses[i] for i in kept],
            self.as_faces,
            self.sources,
        )

    def joined(self, other: Scene) -> Scene:
        """Put the bodies of two scenes together.

        Parameters
        ----------
        other
            A scene in the same frame.

        Returns
        -------
        Scene
            All bodies of both.

        Raises
        ------
        GeometryError
            When a body of either has the name of one of the other.
        """
        return Scene(
            [*self.meshes, *other.meshes],
            [*self.names, *other.names],
            [*self.poses, *other.poses],
            self.as_faces or other.as_faces,
            [*self.sources, *other.sources],
        )

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise GeometryError(
                f"there is no body {name!r}; the bodies are {', '.join(map(repr, self.names))}"
            )
        return list(self.names).index(name)


def _cad_of(mesh: trimesh.Trimesh) -> CadFaces | None:
    cad = mesh.metadata.get("cad")
    return cad if isinstance(cad, CadFaces) else None
