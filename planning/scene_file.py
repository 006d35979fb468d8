"""The file ``scene.toml`` that a person writes: several bodies, each with its file and its pose.

Every length carries its unit, or is refused::

    [[bodies]]
    file = "part.step"               # beside this file; STEP states its unit itself

    [[bodies]]
    name = "clamp"                   # left out: the name in the file
    file = "clamp.stl"
    unit = "mm"                      # of the numbers in the file
    pose = { translation = ["0 mm", "40 mm", "0 mm"], rotation_deg = [0, 0, 90] }

    [[bodies]]
    name = "arm"                     # moves while the camera looks: it stands at all of these
    file = "arm.stl"
    unit = "in"
    poses = [{ translation = ["0 mm", "0 mm", "9 cm"] }, { translation = ["5 cm", "0 mm", "9 cm"] }]

A pose puts the body into the frame of the part, part_from_body; the rotation is a vector along the
axis, as long as the angle in degrees.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, model_validator

from lenscal.handwritten import Handwritten, LengthMm, load_toml
from lenscal.pose import Pose

if TYPE_CHECKING:
    import trimesh

    from planning.mesh_file import Source
    from planning.scene import Scene


class PoseSpec(Handwritten):
    """A pose as it is written.

    Parameters
    ----------
    translation
        Where the origin of the body lies in the frame of the part.
    rotation_deg
        Rotation vector in degrees: its direction is the axis, its length the angle.
    """

    translation: tuple[LengthMm, LengthMm, LengthMm] = (0.0, 0.0, 0.0)
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def build(self) -> Pose:
        """Make the pose.

        Returns
        -------
        Pose
            part_from_body.
        """
        return Pose.from_rotation_vector(np.radians(self.rotation_deg), self.translation)


class BodySpec(Handwritten):
    """A body as it is written.

    Parameters
    ----------
    file
        Its file, beside the scene file.
    unit
        Unit of the numbers in its file; left out for STEP.
    name
        What people call it; left out, the name in the file.
    pose
        Where it stands; left out, where the file puts it.
    poses
        Several places at all of which it stands.
    """

    file: Path
    unit: str | None = None
    name: str | None = None
    pose: PoseSpec | None = None
    poses: list[PoseSpec] | None = Field(default=None, min_length=1)

    @model_validator(mode="after")
    def _one_of_both(self) -> BodySpec:
        if self.pose is not None and self.poses is not None:
            raise ValueError("give either pose or poses")
        return self


class SceneFile(Handwritten):
    """What ``scene.toml`` may say.

    Parameters
    ----------
    bodies
        All that can hide a target.
    """

    bodies: list[BodySpec] = Field(min_length=1)


def load_scene_file(path: Path, as_faces: bool, chord_tolerance_mm: float) -> Scene:
    """Read a scene file and all files that it names.

    Parameters
    ----------
    path
        The TOML file.
    as_faces
        Take meshes that are no solids as bare faces.
    chord_tolerance_mm
        How far triangles may leave the curved surfaces of STEP files.

    Returns
    -------
    Scene
        The bodies, each at its pose.

    Raises
    ------
    FileError
        When a file is missing or not what it should be.
    InputError
        When the scene file says something that is not understood.
    """
    from planning.scene import Scene

    meshes: list[trimesh.Trimesh] = []
    names: list[str] = []
    poses: list[Pose] = []
    sources: list[Source] = []
    for spec in load_toml(path, SceneFile, "scene").bodies:
        loaded = Scene.load(
            path.parent / spec.file,
            spec.unit,
            as_faces=as_faces,
            chord_tolerance_mm=chord_tolerance_mm,
        )
        places = [p.build() for p in spec.poses or [spec.pose or PoseSpec()]]
        for in_file, mesh, pose in zip(loaded.names, loaded.meshes, loaded.poses, strict=True):
            name = in_file if spec.name is None else spec.name
            if spec.name is not None and len(loaded.names) > 1:
                name = f"{spec.name}: {in_file}"
            meshes += [mesh] * len(places)
            names += [f"{name} @ {k}" for k in range(len(places))] if len(places) > 1 else [name]
            poses += [place @ pose for place in places]
        sources += loaded.sources
    return Scene(meshes, names, poses, as_faces, sources)
