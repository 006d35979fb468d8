"""Viewpoints as a table for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from rich import box
from rich.table import Table

if TYPE_CHECKING:
    import pandas as pd

#: Heading and format of the columns of a plan's table; margins of requirements are shares.
_SHOWN: Final = {
    "zoom": ("zoom", ".1f"),
    "focus": ("focus", ".1f"),
    "magnification": ("d/D", ".4f"),
    "object_distance_mm": ("D\nmm", ".1f"),
    "nodal_offset_mm": ("offset\nmm", ".1f"),
    "standoff_mm": ("standoff\nmm", ".1f"),
    "x_mm": ("x\nmm", ".0f"),
    "y_mm": ("y\nmm", ".0f"),
    "z_mm": ("z\nmm", ".0f"),
    "resolution_margin": ("resol.\nmargin", "+.1%"),
    "field_of_view_margin": ("view\nmargin", "+.1%"),
    "visibility_margin_mm": ("visible\nby mm", ".1f"),
}


def viewpoint_table(
    title: str,
    viewpoints: pd.DataFrame,
    columns: Sequence[str] = tuple(_SHOWN),
    more: Mapping[str, Sequence[str]] | None = None,
) -> Table:
    """Lay viewpoints out, one a line.

    Parameters
    ----------
    title
        What stands above.
    viewpoints
        The table of a plan.
    columns
        Which of its columns to show, as far as it has them.
    more
        Further columns: heading to one text per viewpoint.

    Returns
    -------
    Table
        To be printed with rich.
    """
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    shown = [name for name in columns if name in viewpoints and viewpoints[name].notna().any()]
    extra = more or {}
    for heading in (*(_SHOWN[name][0] for name in shown), *extra):
        table.add_column(heading, justify="right", no_wrap=True)
    for number, (_, row) in enumerate(viewpoints.iterrows()):
        cells = [format(row[name], _SHOWN[name][1]) for name in shown]
        table.add_row(*cells, *(texts[number] for texts in extra.values()))
    return table
