"""The file ``task.toml`` that a person writes: what to see, how well, with which lens.

Every length carries its unit, or is refused::

    part = "part.stl"                # or a scene.toml with several bodies
    unit = "mm"                      # of the numbers in the part's file; STEP and TOML state theirs
    lens = "map.json"

    target = { near = ["0 mm", "0 mm", "0 mm"] }                  # or face = "top", for STEP
                                                                  # or vertices = [[…], […], […]]
    feature = [["-0.5 in", "0 in", "0 in"], ["0.5 in", "0 in", "0 in"]]   # left out: the target
    workspace = { low = ["-30 cm", "-80 cm", "5 cm"], high = ["30 cm", "80 cm", "1 m"] }
    views = "orthogonal"             # or "general": from anywhere in any direction
    confidence = "99 %"              # with which all requirements hold together; left out: any

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

Several targets stand each in a table of its own, in place of ``target`` and ``feature``::

    [[targets]]
    name = "pocket 1"
    near = ["0 mm", "0 mm", "0 mm"]                               # or face, or vertices
    feature = [["-4 mm", "0 mm", "0 mm"], ["4 mm", "0 mm", "0 mm"]]     # left out: the target

    [[targets]]
    name = "label"
    face = "label"
    [[targets.requirements]]         # in place of the requirements of the file
    kind = "resolution"
    pixels = 2
    length = "0.1 mm"

A table ``[placement]``, see `planning.placement_file`, says in which robot cell.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from lenscal.errors import InputError
from lenscal.handwritten import Handwritten, load_toml
from planning.fixed_lens import FixedLens
from planning.placement_file import PlacementSpec
from planning.requirement_specs import PointMm, RequirementSpec, percent, requirement
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


class NamedTargetSpec(TargetSpec):
    """One of several targets.

    Parameters
    ----------
    name
        What people call it.
    feature
        What of it is to be resolved; None for the target.
    requirements
        What its image must satisfy; None for the requirements of the file.
    """

    name: str = Field(min_length=1)
    feature: list[PointMm] | None = None
    requirements: list[RequirementSpec] | None = Field(default=None, min_length=1)


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
        What is to be seen whole; None where there are several.
    targets
        Several targets; None where there is one.
    feature
        Ends of the segment, or corners of the face, that is to be resolved; None for the target.
    workspace
        Where the projection centre may be.
    requirements
        What the image of the feature must satisfy; may be left out where every one of several
        targets has its own.
    placement
        The robot cell that the plan is to be carried out in; None to plan only.
    views
        Whether the feature is seen orthogonally, as in the paper, or from anywhere.
    confidence
        The probability with which all requirements shall hold together; None to ask for none.
    """

    name: str = ""
    part: Path
    unit: str | None = None
    lens: Path
    target: TargetSpec | None = None
    targets: list[NamedTargetSpec] | None = Field(default=None, min_length=1)
    feature: list[PointMm] | None = None
    workspace: WorkspaceSpec
    requirements: list[RequirementSpec] | None = Field(default=None, min_length=1)
    placement: PlacementSpec | None = None
    views: Literal["orthogonal", "general"] = "orthogonal"
    confidence: Annotated[float, BeforeValidator(percent)] | None = None

    @model_validator(mode="after")
    def _one_or_several(self) -> TaskFile:
        if (self.target is None) == (self.targets is None):
            raise ValueError("give either one target or several as [[targets]]")
        several = self.targets or []
        if several and self.feature is not None:
            raise ValueError("with several targets the feature stands in the table of its target")
        bare = [t.name for t in several if t.requirements is None] if several else ["the target"]
        if self.requirements is None and bare:
            raise ValueError(
                f"nothing is required of {bare[0]}; add [[requirements]] to the file"
                + (", or [[targets.requirements]] to the target" if several else "")
            )
        names = [target.name for target in several]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(
                f"several targets are called {twice[0]!r}; give each a name of its own"
            )
        return self

    def build(self, scene: Scene, folder: Path = Path()) -> tuple[Task, ...]:
        """Make the tasks, one per target.

        Parameters
        ----------
        scene
            The part, in which the target is looked up.
        folder
            Where the files that it names are.

        Returns
        -------
        tuple of Task
            The tasks in mm. Those that share requirements share the very same ones.
        """
        workspace = box_workspace(self.workspace.low, self.workspace.high)
        shared = [requirement(spec, folder) for spec in self.requirements or ()]
        if self.target is not None:
            feature = _feature(self.feature)
            whole = self.target.build(scene)
            return (
                Task(whole, feature, shared, workspace, self.name, self.views, self.confidence),
            )
        return tuple(
            Task(
                target.build(scene),
                _feature(target.feature),
                shared
                if target.requirements is None
                else [requirement(spec, folder) for spec in target.requirements],
                workspace,
                target.name,
                self.views,
                self.confidence,
            )
            for target in self.targets or ()
        )


def _feature(points: list[PointMm] | None) -> Target | None:
    return None if points is None else Target(np.array(points))


def load_task(path: Path | str) -> tuple[Task, LensMap | FixedLens, Scene]:
    """Read a task file of one target and the part and lens map that it names.

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
        When it says something that is not understood, or has several targets.
    """
    tasks, lens, scene = load_tasks(path)
    if len(tasks) > 1:
        raise InputError(
            f"{path} has {len(tasks)} targets where one is wanted; read it with load_tasks and "
            "plan it with plan_all"
        )
    return tasks[0], lens, scene


def load_tasks(path: Path | str) -> tuple[tuple[Task, ...], LensMap | FixedLens, Scene]:
    """Read a task file of one or several targets and the part and lens map that it names.

    Parameters
    ----------
    path
        The TOML file. Names of files in it are relative to its folder.

    Returns
    -------
    tasks : tuple of Task
        One per target.
    lens : LensMap
        The lens map.
    scene : Scene
        The part.

    Raises
    ------
    FileError
        When a file is missing or cannot be used.
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
