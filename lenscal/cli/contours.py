"""``lenscal contours``: trace and draw the contours of a lens map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

import click

if TYPE_CHECKING:
    from lenscal.maps.contours import SettingCurve
    from lenscal.maps.lens_map import LensMap

#: What is traced: of which quantity, at which level.
_Level = tuple[str, float]
_Curves = dict[_Level, "list[SettingCurve]"]

_FIGURES: Final = (".png", ".pdf", ".svg")


@click.command()
@click.argument("lens_map", metavar="MAP", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--quantity",
    help="What to draw.  [default: magnification, or what the map knows first]",
)
@click.option("--level", "levels", type=float, multiple=True, help="A level; may be repeated.")
@click.option(
    "--limit",
    "limits",
    type=(str, float),
    multiple=True,
    metavar="QUANTITY LEVEL",
    help="A level of another quantity, on top; may be repeated.",
)
@click.option(
    "--within",
    "bands",
    type=(str, float, float),
    multiple=True,
    metavar="QUANTITY LOW HIGH",
    help="Keep of each --level only where this quantity is in this band; may be repeated.",
)
@click.option("--surface", is_flag=True, help="Draw the quantity as a surface in space instead.")
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="The figure (.png, .pdf, .svg), or the curves as a table (.csv).",
)
def contours(
    lens_map: Path,
    quantity: str | None,
    levels: tuple[float, ...],
    limits: tuple[_Level, ...],
    bands: tuple[tuple[str, float, float], ...],
    surface: bool,
    out: Path,
) -> None:
    """Draw contours of MAP, or write them as a table with all quantities along them.

    \b
    Examples:
      lenscal contours map.json --quantity magnification --level 0.192 -o contours.png
      lenscal contours map.json --quantity focal_length_mm --level 127 \
          --within magnification 0.192 0.327 -o admissible.csv
      lenscal contours map.json --quantity object_distance_mm --surface -o surface.png
    """
    from lenscal.errors import InputError
    from lenscal.maps.lens_map import LensMap

    if out.suffix not in (*_FIGURES, ".csv"):
        raise InputError(f"cannot write contours to {out.name}; end it in .png, .pdf, .svg or .csv")
    if surface and (levels or limits or bands or out.suffix == ".csv"):
        raise InputError(
            "--surface draws a figure of the whole quantity, so it goes with no --level, --limit, "
            "--within or table; leave one of them out"
        )
    if bands and not levels:
        raise InputError("--within cuts contours, so it needs at least one --level")
    loaded = LensMap.load(lens_map)
    quantity = quantity or loaded.quantities[0]
    curves: _Curves = {}
    for level in levels:
        pieces = loaded.contour(quantity, level)
        for band in bands:
            pieces = [part for piece in pieces for part in piece.within(*band)]
        curves[quantity, level] = pieces
    curves |= {(name, level): loaded.contour(name, level) for name, level in limits}
    if out.suffix == ".csv":
        _write_table(curves, out)
    else:
        _draw(loaded, quantity, curves, surface, out)
    click.echo(f"contours of {quantity} written to {out}")


def _write_table(curves: _Curves, out: Path) -> None:
    """Write a row per vertex of each curve, with all quantities."""
    import pandas as pd

    from lenscal.errors import InputError

    if not curves:
        raise InputError("a table of contours needs at least one --level")
    tables = []
    for (name, level), pieces in curves.items():
        for i, curve in enumerate(pieces):
            table = curve.to_dataframe()
            table.insert(0, "quantity", name)
            table.insert(1, "level", level)
            table.insert(2, "piece", i)
            tables.append(table)
    if not tables:
        raise InputError(
            "no contour keeps within the bands asked for, so there is nothing to write; "
            "widen --within"
        )
    pd.concat(tables).to_csv(out, index=False)


def _draw(lens_map: LensMap, quantity: str, curves: _Curves, surface: bool, out: Path) -> None:
    """Draw a map with curves on top, or its surface."""
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from lenscal.plots.figure_files import save_figure
    from lenscal.plots.maps import draw_contours, draw_curves, draw_surface

    figure = Figure(figsize=(5.6, 4.5), layout="constrained")
    if surface:
        space = cast(Axes3D, figure.add_subplot(projection="3d"))
        draw_surface(space, lens_map, quantity)
    else:
        plane = draw_contours(figure.add_subplot(), lens_map, quantity)
        if curves:
            draw_curves(plane, {_label(*key): pieces for key, pieces in curves.items()})
    save_figure(figure, out)


def _label(quantity: str, level: float) -> str:
    """Name a contour: what is constant along it, its value and unit."""
    from lenscal.maps.quantities import QUANTITIES

    words, _, unit = QUANTITIES[quantity].partition(" (")
    return f"{words} = {level:g} {unit.rstrip(')')}".strip()
