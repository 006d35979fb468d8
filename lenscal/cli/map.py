"""``lenscal map``: fit a lens map to a table of calibrated settings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    import pandas as pd

    from lenscal.calibration.table import CalibrationTable


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
    """Fit a map to TABLE, the CSV that `lenscal calibrate` wrote.

    \b
    Example:
      lenscal map fit table.csv -o map.json
    """
    from lenscal.calibration.table import CalibrationTable
    from lenscal.errors import InputError
    from lenscal.maps.fit import fit_lens_map

    if out.resolve() == table.with_suffix(".json").resolve():
        raise InputError(
            f"{out} holds the evidence of {table}, which the map would overwrite; "
            "give the map another name"
        )
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
    """Print what MAP says of one setting, with 1 σ.

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


@map_command.command()
@click.argument("table", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--folds",
    type=click.IntRange(min=2),
    metavar="K",
    help="Deal the settings into K parts; if not given, one setting is left out at a time.",
)
@click.option(
    "--choose-smoothing",
    is_flag=True,
    help="Choose the smoothing anew whenever settings are left out (slower).",
)
@click.option(
    "--figure",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="PNG",
    help="Draw both over the (zoom, focus) plane (.png, .pdf, .svg).",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def validate(
    table: Path, folds: int | None, choose_smoothing: bool, figure: Path | None, as_json: bool
) -> None:
    """Predict each setting of TABLE by the others, and flag those that disagree with them.

    TABLE is what `lenscal calibrate` wrote, or any CSV with columns zoom, focus and quantities of a
    lens such as focal_length_mm. The status is 0 whatever is flagged.

    \b
    Examples:
      lenscal map validate table.csv
      lenscal map validate table.csv --folds 5 --figure validation.png
    """
    from lenscal.errors import InputError
    from lenscal.maps.consistency import check_consistency
    from lenscal.maps.validation import cross_validate, summarise

    if figure is not None and figure.suffix not in (".png", ".pdf", ".svg"):
        raise InputError(f"cannot draw to {figure.name}; end it in .png, .pdf or .svg")
    settings = _settings(table)
    validation = cross_validate(settings, folds=folds, choose_smoothing=choose_smoothing)
    consistency = check_consistency(settings)
    summary = summarise(validation)
    if as_json:
        click.echo(
            json.dumps(
                {
                    "settings": _records(validation),
                    "summary": _records(summary),
                    "consistency": _records(consistency),
                    "flagged": _records(consistency.loc[consistency["flagged"], ["zoom", "focus"]]),
                },
                indent=1,
                ensure_ascii=False,
                allow_nan=False,
            )
        )
    else:
        click.echo(
            "\n".join(
                [*_summary_lines(summary, folds, len(validation)), "", *_flag_lines(consistency)]
            )
        )
    if figure is not None:
        from matplotlib.figure import Figure

        from lenscal.plots.figure_files import save_figure
        from lenscal.plots.validation import draw_validation

        drawn = draw_validation(
            Figure(figsize=(14, 8), layout="constrained"), validation, consistency
        )
        click.echo(f"drawn to {save_figure(drawn, figure)}", err=as_json)


def _settings(path: Path) -> CalibrationTable | pd.DataFrame:
    """Read a calibration table, or a CSV of other origin, which has no JSON beside it."""
    from lenscal.calibration.table import CalibrationTable
    from lenscal.errors import FileError

    if not path.exists():
        raise FileError(f"there is no table {path}; name the CSV that `lenscal calibrate` wrote")
    if path.suffix != ".csv" or path.with_suffix(".json").exists():
        return CalibrationTable.load(path)
    import pandas as pd

    try:
        return pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise FileError(f"cannot read {path} as a table: {error}") from error


def _records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows as JSON can hold them: null for what is not known."""
    return [
        {str(k): None if isinstance(v, float) and v != v else v for k, v in row.items()}
        for row in frame.to_dict("records")
    ]


def _summary_lines(summary: pd.DataFrame, folds: int | None, count: int) -> list[str]:
    how = "each setting by all others" if folds is None else f"in {folds} folds"
    if summary.empty:
        what = "calibrate more settings: several focus settings at several zooms"
        return [
            f"Prediction errors, {how}: nothing can be validated",
            f"  without a setting the rest of the {count} do not determine a surface that tells it",
            f"  {what}{'' if folds is None else ', or deal them into more folds'}",
        ]
    lines = [
        f"Prediction errors, {how} (edge: by extrapolation)",
        f"{'quantity':22s} {'where':6s} {'settings':>8s} {'rms':>12s} {'worst':>12s} "
        f"{'rms in σ':>9s}  at zoom, focus",
    ]
    for row in summary.itertuples(index=False):
        rms, worst = (
            f"{100 * value:.4g} %" if row.relative else f"{value:.4g}"
            for value in (float(str(row.rms_error)), float(str(row.worst_error)))
        )
        sigmas = float(str(row.rms_sigmas))
        lines.append(
            f"{row.quantity!s:22s} {'edge' if row.edge else 'inside':6s} {row.settings:8d} "
            f"{rms:>12s} {worst:>12s} {'–' if sigmas != sigmas else format(sigmas, '.2f'):>9s}  "
            f"{row.worst_zoom:g}, {row.worst_focus:g}"
        )
    return lines


def _flag_lines(consistency: pd.DataFrame) -> list[str]:
    known = consistency[consistency["sigmas"].notna()]
    if known.empty:
        return [f"Consistency: {len(consistency)} settings are too few to judge one by the others"]
    threshold = float(known["threshold"].iloc[0])
    flagged = consistency[consistency["flagged"]]
    if flagged.empty:
        worst = known.iloc[int(known["sigmas"].abs().to_numpy().argmax())]
        return [
            f"Consistency: no setting of {len(consistency)} disagrees with the others by more than "
            f"{threshold:.1f} σ",
            f"  nearest to it: zoom {worst['zoom']:g}, focus {worst['focus']:g}, "
            f"{worst['worst_quantity']} by {worst['sigmas']:+.1f} σ",
        ]
    lines = [
        f"Consistency: {len(flagged)} of {len(consistency)} settings disagree with the others by "
        f"more than {threshold:.1f} σ",
        f"  {'zoom':>8s} {'focus':>8s}  {'quantity':22s} {'measured':>12s} {'expected':>12s} "
        f"{'off by σ':>9s}",
    ]
    lines += [
        f"  {row.zoom:8g} {row.focus:8g}  {row.worst_quantity!s:22s} {row.measured:12.6g} "
        f"{row.expected:12.6g} {row.sigmas:+9.1f}"
        for row in flagged.itertuples(index=False)
    ]
    return [*lines, "  measure these again, or leave them out of the map"]
