"""The commands of the planner: ``visibility``, ``settings``, ``plan`` and ``demo``.

What is heavy is imported when a command runs, so that ``--help`` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from planning.plan_command import plan
from planning.visibility_command import visibility

if TYPE_CHECKING:
    from lenscal.sensor import Axis
    from planning.requirements.margin import Requirement
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
