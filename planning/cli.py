"""The commands of the planner: ``visibility``, ``settings``, ``plan`` and ``demo``.

What is heavy is imported when a command runs, so that ``--help`` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from planning.visibility_command import visibility

if TYPE_CHECKING:
    from lenscal.sensor import Axis
    from planning.planner import Plan
    from planning.requirements.margin import Requirement
    from planning.robot_cell import RobotCell
    from planning.settings import AdmissibleSettings

__all__ = ["demo", "plan", "settings", "visibility"]

_FILE = click.Path(path_type=Path, dir_okay=False)
_AXIS = click.Choice(["any", "x", "y"])


@click.command()
@click.argument("lens_map", metavar="MAP.json", type=_FILE)
@click.option("--resolution", metavar="N px/LENGTH", help='Such as "3px/0.01in".')
@click.option("--fov", metavar="LENGTH", help='Length that must fit in the image, such as "1in".')
@click.option("--axis", type=_AXIS, default="any", show_default=True, help="Image axis.")
@click.option("--safety", default=0.0, show_default=True, help="Share by which limits are kept.")
def settings(
    lens_map: Path, resolution: str | None, fov: str | None, axis: Axis, safety: float
) -> None:
    """Show at which zoom and focus a feature is resolved and inside the image.

    \b
    Example:
      lenscal settings map.json --resolution 3px/0.01in --fov 1in --axis x
    """
    from lenscal.errors import PlanningError
    from lenscal.maps.lens_map import LensMap
    from planning.settings import admissible_settings

    requirements = _requirements(resolution, fov, axis)
    found = admissible_settings(LensMap.load(lens_map), requirements, safety=safety)
    if found.is_empty:
        raise PlanningError(found.why_empty)
    _show_settings(found)


@click.command()
@click.argument("task_file", metavar="TASK.toml", type=_FILE)
@click.option(
    "-o", "--out", type=_FILE, default=Path("plan.json"), show_default=True, help="The plan."
)
@click.option(
    "--sequence",
    type=_FILE,
    help="What `lenscal rig run` carries out; sequence.json beside the plan if not given.",
)
@click.option(
    "--placements", type=_FILE, help="Poses of the hand with their σ as a table (.csv or .json)."
)
@click.option("--safety", default=0.005, show_default=True, help="Share by which limits are kept.")
@click.option("--seed", default=0, show_default=True, help="Seed of the audit's viewpoints.")
def plan(
    task_file: Path,
    out: Path,
    sequence: Path | None,
    placements: Path | None,
    safety: float,
    seed: int,
) -> None:
    """Plan viewpoints and settings for a task.

    TASK.toml names the part, its unit, the lens map, the target, the workspace and the
    requirements; every length in it carries its unit. With a table [placement], which says where
    the part lies and how the camera sits on the hand, the poses of the robot are written too.

    \b
    Example:
      lenscal plan task.toml -o plan.json
    """
    from lenscal.errors import PlanningError
    from planning.planner import plan as make_plan
    from planning.task_file import load_cell, load_task

    task, lens, scene = load_task(task_file)
    cell = load_cell(task_file)
    if cell is None and (sequence is not None or placements is not None):
        raise PlanningError(
            f"{task_file} does not say where the robot stands; add a table [placement], or leave "
            "out --sequence and --placements"
        )
    found = make_plan(task, lens, scene, safety=safety, seed=seed)
    found.save(out)
    if found.why_empty:
        raise PlanningError(f"no viewpoint: {found.why_empty} (what was found is in {out})")
    _show_plan(found)
    click.echo(f"wrote {out}")
    if cell is not None:
        _write_placements(found, cell, sequence or out.with_name("sequence.json"), placements)


@click.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("lenscal-demo"),
    show_default=True,
    help="Folder for all results.",
)
@click.option("--seed", default=0, show_default=True, help="Seed of the simulated rig.")
def demo(out: Path, seed: int) -> None:
    """Calibrate a simulated zoom lens and place a camera with it, from end to end.

    \b
    Example:
      lenscal demo --out lenscal-demo
    """
    from planning.demo import run_demo

    run_demo(out, seed)


def _requirements(resolution: str | None, fov: str | None, axis: Axis) -> list[Requirement]:
    from lenscal.errors import InputError
    from lenscal.units import parse_length_mm
    from planning.requirements.field_of_view import FieldOfView
    from planning.requirements.resolution import Resolution

    found: list[Requirement] = []
    if resolution is not None:
        pixels, _, length = resolution.partition("/")
        try:
            count = float(pixels.strip().removesuffix("px"))
        except ValueError as error:
            raise InputError(
                f"cannot read --resolution {resolution!r}; write pixels and a length, "
                "such as 3px/0.01in"
            ) from error
        found.append(Resolution(count, parse_length_mm(length), axis))
    if fov is not None:
        found.append(FieldOfView(parse_length_mm(fov), axis))
    if not found:
        raise InputError("nothing is required; give --resolution 3px/0.01in, --fov 1in, or both")
    return found


def _show_settings(found: AdmissibleSettings) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title="Admissible settings")
    for heading in ("quantity", "from", "to"):
        table.add_column(heading, justify="right" if heading != "quantity" else "left")
    table.add_row("d/D", *(f"{v:.4f}" for v in found.magnification_bounds))
    outlines = [polygon.outline for polygon in found.polygons]
    for name, column in (("zoom", 0), ("focus", 1)):
        values = [v for outline in outlines for v in outline[:, column]]
        table.add_row(name, f"{min(values):.2f}", f"{max(values):.2f}")
    for name, bounds in (
        ("D, object distance (mm)", found.object_distance_bounds_mm),
        ("D - offset, standoff (mm)", found.standoff_bounds_mm),
    ):
        if bounds is not None:
            table.add_row(name, *(f"{v:.2f}" for v in bounds))
    Console().print(table)


def _show_plan(found: Plan) -> None:
    from rich.console import Console

    from planning.viewpoint_table import viewpoint_table

    columns = (
        *("zoom", "focus", "magnification", "object_distance_mm", "standoff_mm"),
        *("x_mm", "y_mm", "z_mm"),
        *("resolution_margin", "field_of_view_margin", "visibility_margin_mm"),
    )
    title = f"Viewpoints {found.task.name}".strip()
    Console().print(viewpoint_table(title, found.viewpoints, columns))


def _write_placements(
    found: Plan, cell: RobotCell, sequence: Path, placements: Path | None
) -> None:
    from planning.placement import place_plan
    from planning.placement_export import as_sequence, save_placements

    placed = place_plan(found, cell)
    for note in placed.notes:
        click.echo(f"note: {note}")
    for one in placed.unreachable:
        click.echo(f"viewpoint {one.viewpoint} is left out: {one.reason}")
    if placements is not None:
        save_placements(placed, placements)
        click.echo(f"wrote {placements}")
    as_sequence(placed).save(sequence)
    click.echo(f"wrote {sequence}; next: lenscal rig run {sequence} --rig rig.toml -o pictures")
