"""``lenscal map``: fit a lens map to a table of calibrated settings."""

from __future__ import annotations

from pathlib import Path

import click


@click.group(name="map")
def map_command() -> None:
    """Fit lens maps and ask them."""


@map_command.command()
@click.argument("table", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="The map to write, a JSON file.",
)
def fit(table: Path, out: Path) -> None:
    r"""Fit a map to TABLE, the CSV that `lenscal calibrate` wrote.

    \b
    Example:
      lenscal map fit table.csv -o map.json
    """
    from lenscal.calibration.table import CalibrationTable
    from lenscal.maps.fit import fit_lens_map

    lens_map = fit_lens_map(CalibrationTable.load(table))
    lens_map.save(out)
    click.echo(f"{len(lens_map.samples)} settings mapped over {lens_map.domain}: {out}")
    for note in lens_map.notes:
        click.echo(f"  note: {note}")
    for quantity in lens_map.quantities:
        low, high = lens_map.range_of(quantity)
        click.echo(f"  {quantity:22s} {low:12.6g} to {high:.6g}")


@map_command.command()
@click.argument("lens_map", metavar="MAP", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--zoom", type=float, required=True, help="Zoom setting.")
@click.option("--focus", type=float, required=True, help="Focus setting.")
def show(lens_map: Path, zoom: float, focus: float) -> None:
    r"""Print what MAP says of one setting, with 1 σ.

    \b
    Example:
      lenscal map show map.json --zoom 98 --focus 131
    """
    from lenscal.maps.lens_map import LensMap

    loaded = LensMap.load(lens_map)
    for quantity in loaded.quantities:
        value = float(loaded.value(quantity, zoom, focus))
        sigma = float(loaded.sigma(quantity, zoom, focus))
        click.echo(f"{quantity:22s} {value:12.6g} ± {sigma:.2g}")
