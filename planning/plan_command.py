"""``lenscal plan``: viewpoints and settings for one target or several.

What is heavy is imported when the command runs, so that ``--help`` is quick.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from rich.table import Table

    from lenscal.progress import ProgressMaker
    from planning.placement import Placeable
    from planning.planner import Plan
    from planning.robot_cell import RobotCell
    from planning.several import CoveringPlan

_FILE = click.Path(path_type=Path, dir_okay=False)
#: Names of targets that stand in a row of the table; the others are counted.
_NAMED: Final = 4
#: Up to how many targets the margins of each are shown; the plan's file has them in any case.
_ONE_BY_ONE: Final = 20


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
@click.option(
    "--lever",
    metavar="LENGTH",
    default="200 mm",
    show_default=True,
    help="Several targets: what turning the camera by one radian counts as travel.",
)
@click.option("--seed", default=0, show_default=True, help="Seed of the audit's viewpoints.")
def plan(
    task_file: Path,
    out: Path,
    sequence: Path | None,
    placements: Path | None,
    safety: float,
    lever: str,
    seed: int,
) -> None:
    """Plan viewpoints and settings for a task.

    TASK.toml names the part, its unit, the lens map, the target, the workspace and the
    requirements; every length in it carries its unit. With several [[targets]], the fewest
    viewpoints that cover all of them are found, and put in an order that is short to travel. With a
    table [placement], which says where the part lies and how the camera sits on the hand, the poses
    of the robot are written too.

    \b
    Example:
      lenscal plan task.toml -o plan.json
    """
    from lenscal.errors import PlanningError
    from lenscal.progress import progress_bar, silent
    from lenscal.units import parse_length_mm
    from planning.placement import placeable
    from planning.planner import plan as plan_one
    from planning.several import plan_all
    from planning.task_file import load_cell, load_tasks

    lever_mm = parse_length_mm(lever)
    tasks, lens, scene = load_tasks(task_file)
    cell = load_cell(task_file)
    if cell is None and (sequence is not None or placements is not None):
        raise PlanningError(
            f"{task_file} does not say where the robot stands; add a table [placement], or leave "
            "out --sequence and --placements"
        )
    if cell is not None:
        placeable(lens, cell)
    found: Plan | CoveringPlan
    if len(tasks) == 1:
        found = plan_one(tasks[0], lens, scene, cell=cell, safety=safety, seed=seed)
        _save(found, out)
        _show_plan(found)
    else:
        shown: ProgressMaker = progress_bar if sys.stderr.isatty() else silent
        start = time.perf_counter()
        found = plan_all(
            tasks,
            lens,
            scene,
            cell=cell,
            safety=safety,
            seed=seed,
            lever_mm=lever_mm,
            progress=shown,
        )
        took_s = time.perf_counter() - start
        _save(found, out)
        _show_covering(found, took_s)
    click.echo(f"wrote {out}")
    if cell is not None:
        _write_placements(found, cell, sequence or out.with_name("sequence.json"), placements)


def _save(found: Plan | CoveringPlan, out: Path) -> None:
    """Write the plan, also where it is empty; that is an error then."""
    from lenscal.errors import PlanningError

    found.save(out)
    if found.why_empty:
        raise PlanningError(f"no viewpoint: {found.why_empty} (what was found is in {out})")


def _show_plan(found: Plan) -> None:
    from rich.console import Console

    from planning.viewpoint_table import viewpoint_tables

    for table in viewpoint_tables(f"Viewpoints {found.task.name}".strip(), found.viewpoints):
        Console().print(table)


def _show_covering(found: CoveringPlan, took_s: float) -> None:
    from rich.console import Console

    from planning.viewpoint_table import viewpoint_table

    columns = ("zoom", "focus", "iris", "object_distance_mm", "x_mm", "y_mm", "z_mm")
    names = [_short(targets) for targets in found.viewpoints["targets"]]
    table = viewpoint_table(
        "Viewpoints in the order in which they are visited",
        found.viewpoints,
        (*columns, "smallest_margin"),
        more={"covers": names},
        before={"": [str(number) for number in range(len(names))]},
    )
    table.columns[-1].justify = "left"
    Console().print(table)
    if len(found.plans) <= _ONE_BY_ONE:
        Console().print(_margins_by_target(found))
    cover, route = found.cover, found.route
    covered, count = len(found.plans) - len(found.uncovered), len(found.viewpoints)
    click.echo(
        f"{covered} of {len(found.plans)} targets by {_counted(count, 'viewpoint')} of "
        f"{found.candidates} tried, "
        + ("the fewest that do" if cover.is_proven else f"at least {cover.at_least} are needed")
    )
    click.echo(
        f"travel {route.travel_mm:.0f} mm"
        + (", the shortest" if route.is_shortest else "")
        + f"; planned in {took_s:.1f} s"
    )
    for why, left_out in found.reasons.items():
        click.echo(f"not covered: {_short(', '.join(left_out))}: {why}")


def _margins_by_target(found: CoveringPlan) -> Table:
    """Every target beside the viewpoints that cover it."""
    from planning.viewpoint_table import margin_columns, viewpoint_table

    covered = found.coverage
    columns = (*margin_columns(covered), "visibility_margin_mm", "probability", "smallest_margin")
    table = viewpoint_table(
        "Margins, as shares of what is asked",
        covered,
        columns,
        before={
            "": [str(number) for number in covered["viewpoint"]],
            "target": [found.tasks[target].name for target in covered["target"]],
        },
    )
    table.columns[1].justify = "left"
    return table


def _short(targets: str) -> str:
    names = targets.split(", ")
    if len(names) <= _NAMED + 1:
        return targets
    return f"{', '.join(names[:_NAMED])} and {len(names) - _NAMED} more"


def _counted(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def _write_placements(
    found: Placeable, cell: RobotCell, sequence: Path, placements: Path | None
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
