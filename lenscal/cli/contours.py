"""``lenscal contours``: trace and draw the contours of a lens map."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("lens_map", metavar="MAP", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--quantity", default="magnification", show_default=True, help="What to draw.")
@click.option("--level", "levels", type=float, multiple=True, help="A level; may be repeated.")
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="The figure (.png, .pdf, .svg), or the curves as a table (.csv).",
)
def contours(lens_map: Path, quantity: str, levels: tuple[float, ...], out: Path) -> None:
    r"""Draw contours of MAP, or write them as a table with all quantities along them.

    \b
    Example:
      lenscal contours map.json --quantity magnification --level 0.192 -o contours.png
    """
    from lenscal.errors import InputError
    from lenscal.maps.lens_map import LensMap

    loaded = LensMap.load(lens_map)
    curves = {level: loaded.contour(quantity, level) for level in levels}
    if out.suffix == ".csv":
        import pandas as pd

        if not curves:
            raise InputError("a table of contours needs at least one --level")
        frames = [
            pd.DataFrame(
                {"level": level, "piece": i, "zoom": curve.zoom, "focus": curve.focus}
                | {name: curve.value(name) for name in loaded.quantities}
            )
            for level, pieces in curves.items()
            for i, curve in enumerate(pieces)
        ]
        pd.concat(frames).to_csv(out, index=False)
    elif out.suffix in (".png", ".pdf", ".svg"):
        from matplotlib.figure import Figure

        from lenscal.plots.maps import draw_contours, draw_limits

        figure = Figure(figsize=(7, 5), layout="constrained")
        axes = draw_contours(figure.add_subplot(), loaded, quantity)
        draw_limits(axes, loaded, quantity, {f"{quantity} {level:g}": level for level in levels})
        figure.savefig(out, dpi=150)
    else:
        raise InputError(f"cannot write contours to {out.name}; end it in .png, .pdf, .svg or .csv")
    click.echo(f"contours of {quantity} written to {out}")
