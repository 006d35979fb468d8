"""Viewpoints as tables for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from rich import box
from rich.table import Table

if TYPE_CHECKING:
    import pandas as pd

#: Heading and format of the columns of a plan's table.
_SHOWN: Final = {
    "zoom": ("zoom", ".1f"),
    "focus": ("focus", ".1f"),
    "iris": ("iris", ".1f"),
    "magnification": ("d/D", ".4f"),
    "object_distance_mm": ("D\nmm", ".1f"),
    "nodal_offset_mm": ("offset\nmm", ".1f"),
    "standoff_mm": ("standoff\nmm", ".1f"),
    "x_mm": ("x\nmm", ".0f"),
    "y_mm": ("y\nmm", ".0f"),
    "z_mm": ("z\nmm", ".0f"),
    "visibility_margin_mm": ("visible\nby mm", ".1f"),
    "smallest_margin": ("least\nmargin", "+.1%"),
    "probability": ("holds\nwith", ".1%"),
}
#: What margins are called where their own name is too long; they are shares.
_MARGINS: Final = {
    "resolution": "resol.",
    "field_of_view": "view",
    "depth_of_field": "depth",
    "incidence": "angle",
    "clearance": "clear",
    "unvignetted": "pupil",
    "visibility": "inside",
}
_OF_MARGIN: Final = "_margin"
#: Setting and place, and what stands behind the margins.
_WHERE: Final = (
    *("zoom", "focus", "iris", "magnification", "object_distance_mm", "standoff_mm"),
    *("x_mm", "y_mm", "z_mm"),
)
_LAST: Final = ("visibility_margin_mm", "probability")
#: More margins than these get a table of their own.
_BESIDE: Final = 2


def margin_columns(viewpoints: pd.DataFrame) -> tuple[str, ...]:
    """Name the margins that a table of viewpoints has.

    Parameters
    ----------
    viewpoints
        The table of a plan.

    Returns
    -------
    tuple of str
        One column for each kind of requirement, in the order of the table.
    """
    names = (str(name) for name in viewpoints)
    return tuple(n for n in names if n.endswith(_OF_MARGIN) and n != "smallest_margin")


def viewpoint_tables(title: str, viewpoints: pd.DataFrame) -> list[Table]:
    """Lay out all that people want to see of a plan: settings, places, and every margin.

    Parameters
    ----------
    title
        What stands above.
    viewpoints
        The table of a plan.

    Returns
    -------
    list of Table
        One, or two where there are many margins, the viewpoints numbered the same in both.
    """
    margins = margin_columns(viewpoints)
    wide = any(n in viewpoints and viewpoints[n].notna().any() for n in ("iris", "probability"))
    if len(margins) <= _BESIDE and not wide:
        return [viewpoint_table(title, viewpoints, (*_WHERE, *margins, *_LAST))]
    numbers = {"": [str(number) for number in range(len(viewpoints))]}
    return [
        viewpoint_table(title, viewpoints, _WHERE, before=numbers),
        viewpoint_table(
            "Margins, as shares of what is asked",
            viewpoints,
            (*margins, *_LAST, "smallest_margin"),
            before=numbers,
        ),
    ]


def viewpoint_table(
    title: str,
    viewpoints: pd.DataFrame,
    columns: Sequence[str] = (*_WHERE, *_LAST),
    more: Mapping[str, Sequence[str]] | None = None,
    before: Mapping[str, Sequence[str]] | None = None,
) -> Table:
    """Lay viewpoints out, one a line.

    Parameters
    ----------
    title
        What stands above.
    viewpoints
        The table of a plan.
    columns
        Which of its columns to show, as far as it has them and knows something there.
    more, before
        Further columns behind and in front: heading to one text per viewpoint.

    Returns
    -------
    Table
        To be printed with rich.
    """
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    shown = [name for name in columns if name in viewpoints and viewpoints[name].notna().any()]
    first, last = before or {}, more or {}
    for heading in (*first, *(_shown(name)[0] for name in shown), *last):
        table.add_column(heading, justify="right", no_wrap=True)
    for number, (_, row) in enumerate(viewpoints.iterrows()):
        table.add_row(
            *(texts[number] for texts in first.values()),
            *(_cell(row[name], _shown(name)[1]) for name in shown),
            *(texts[number] for texts in last.values()),
        )
    return table


def _shown(column: str) -> tuple[str, str]:
    """Heading and format of a column."""
    if column in _SHOWN:
        return _SHOWN[column]
    name = column.removesuffix(_OF_MARGIN)
    return f"{_MARGINS.get(name, name)}\nmargin", "+.1%"


def _cell(value: float, form: str) -> str:
    return "–" if value != value else format(value, form)
