"""The file ``task.toml`` that a person writes: what to see, how well, with which lens.

Every length carries its unit, or is refused::

    part = "part.stl"                # or a scene.toml with several bodies
    unit = "mm"                      # of the numbers in the part's file; STEP and TOML state theirs
    lens = "map.json"

    target = { near = ["0 mm", "0 mm", "0 mm"] }                  # or face = "top", for STEP
                                                                  # or vertices = [[…], […], […]]
    feature = [["-0.5 in", "0 in", "0 in"], ["0.5 in", "0 in", "0 in"]]   # left out: the target
    workspace = { low = ["-30 cm", "-80 cm", "5 cm"], high = ["30 cm", "80 cm", "1 m"] }

    [[requirements]]
    kind = "resolution"
    pixels = 3
    length = "0.01 in"
    axis = "x"

    [[requirements]]
    kind = "field_of_view"
    length = "1 in"
    axis = "x"

    [[requirements]]
    kind = "depth_of_field"
    depth = "2 mm"
    blur = "1.5 px"
    wavelength = "550 nm"            # left out: without diffraction

    [[requirements]]
    kind = "incidence"
    max_angle = "40 deg"

    [[requirements]]
    kind = "clearance"
    distance = "10 mm"
    cylinders = [{ start = "-100 mm", end = "235 mm", radius = "30 mm" }]   # z along the axis
    meshes = [{ file = "housing.stl", unit = "mm" }]

    [[requirements]]
    kind = "unvignetted"

    [[requirements]]
    kind = "visibility"
    distance = "2 mm"

A table ``[placement]``, see `planning.placement_file`, says in which robot cell.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, model_validator

from lenscal.handwritten import Handwritten, load_toml
from planning.fixed_lens import FixedLens
from planning.placement_file import PlacementSpec
from planning.requirement_specs import PointMm, RequirementSpec, requirement
from planning.robot_cell import RobotCell
from planning.scene import Scene
from planning.solid import box_workspace
from planning.target import Target
from planning.task import Task

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap


class TargetSpec(Handwritten):
    """How the target is given: the face nearest to a point, a CAD face, or its vertices.

    Parameters
    ----------
    near
        A point; the flat face nearest to it is the target.
    face
        Name or number of a face of a STEP file.
    vertices
        Corners of the target, counter-clockwise seen from outside; two for a segment.
    body
        The body that the face belongs to; left out, all are looked at.
    fill_holes
        Whether the holes of the face count as if they were part of it.
    """

    near: PointMm | None = None
    face: str | int | None = None
    vertices: list[PointMm] | None = None
    body: str | None = None
    fill_holes: bool = False

    @model_validator(mode="after")
    def _one_of_all(self) -> TargetSpec:
        if sum(given is not None for given in (self.near, self.face, self.vertices)) != 1:
            raise ValueError("give either near or face or vertices")
        if self.vertices is not None and (self.body is not None or self.fill_holes):
            raise ValueError("body and fill_holes go with near or face, not with vertices")
        return self

    def build(self, scene: Scene) -> Target:
        """Make the target.

        Parameters
        ----------
        scene
            The part, in which the face is looked up.

        Returns
        -------
        Target
            The target in mm.
        """
        if self.vertices is not None:
            return Target(np.array(self.vertices))
        return Target.from_face(
            scene,
            None if self.near is None else np.array(self.near),
            face=self.face,
            body=self.body,
            fill_holes=self.fill_holes,
        )


class WorkspaceSpec(Handwritten):
    """A box along the axes of the part.

    Parameters
    ----------
    low, high
        Opposite corners.
    """

    low: PointMm
    high: PointMm


class TaskFile(Handwritten):
    """What ``task.toml`` may say.

    Parameters
    ----------
    name
        What people call the task.
    part
        File of the part, beside the task file; a TOML file for several bodies.
    unit
        Unit of the numbers in the part's file; left out for STEP and TOML, which state theirs.
    lens
        File of the lens map, beside the task file.
    target
        What is to be seen whole.
    feature
        Ends of the segment, or corners of the face, that is to be resolved; None for the target.
    workspace
        Where the projection centre may be.
    requirements
        What the image of the feature must satisfy.
    placement
        The robot cell that the plan is to be carried out in; None to plan only.
    """

    name: str = ""
    part: Path
    unit: str | None = None
    lens: Path
    target: TargetSpec
    feature: list[PointMm] | None = None
    workspace: WorkspaceSpec
    requirements: list[RequirementSpec] = Field(min_length=1)
    placement: PlacementSpec | None = None

    def build(self, scene: Scene, folder: Path = Path()) -> Task:
        """Make the task.

        Parameters
        ----------
        scene
            The part, in which the target is looked up.
        folder
            Where the files that it names are.

        Returns
        -------
        Task
            The task in mm.
        """
        target = self.target.build(scene)
        feature = None if self.feature is None else Target(np.array(self.feature))
        workspace = box_workspace(self.workspace.low, self.workspace.high)
        requirements = [requirement(spec, folder) for spec in self.requirements]
        return Task(target, feature, requirements, workspace, self.name)


def load_task(path: Path | str) -> tuple[Task, LensMap | FixedLens, Scene]:
    """Read a task file and the part and lens map that it names.

    Parameters
    ----------
    path
        The TOML file. Names of files in it are relative to its folder.

    Returns
    -------
    task : Task
        The task.
    lens : LensMap
        The lens map.
    scene : Scene
        The part.

    Raises
    ------
    FileError
        When the file is missing or no TOML.
    InputError
        When it says something that is not understood.
    """
    from lenscal.maps.lens_map import LensMap

    path = Path(path)
    spec = load_toml(path, TaskFile, "task")
    scene = Scene.load(path.parent / spec.part, spec.unit)
    return spec.build(scene, path.parent), LensMap.load(path.parent / spec.lens), scene


def load_cell(path: Path | str) -> RobotCell | None:
    """Read the robot cell of a task file.

    Parameters
    ----------
    path
        The TOML file. Names of files in it are relative to its folder.

    Returns
    -------
    RobotCell or None
        The cell; None where the task has no table ``[placement]``.

    Raises
    ------
    FileError
        When a file is missing or cannot be used.
    InputError
        When it says something that is not understood.
    """
    spec = load_toml(path, TaskFile, "task").placement
    return None if spec is None else spec.build(Path(path).parent)
