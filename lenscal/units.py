"""Lengths as people write them, with their unit, and the millimetres that the code works in."""

from __future__ import annotations

import re
from typing import Final

from lenscal.errors import UnitError

MM_PER_INCH: Final = 25.4
MM_PER_UNIT: Final[dict[str, float]] = {
    "um": 1e-3,
    "µm": 1e-3,
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "in": MM_PER_INCH,
    "ft": 12 * MM_PER_INCH,
}

_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Zµ]*)\s*")


def parse_length_mm(text: str) -> float:
    """Read a length with its unit.

    Parameters
    ----------
    text
        A number followed by one of um, µm, mm, cm, m, in, ft; space between them is free.

    Returns
    -------
    float
        The length in mm.

    Raises
    ------
    UnitError
        When the unit is missing or unknown, or the number cannot be read.

    Examples
    --------
    >>> parse_length_mm("1 in")
    25.4
    """
    match = _LENGTH.fullmatch(str(text))
    if match is None:
        raise UnitError(
            f"cannot read {text!r} as a length; write a number and a unit, such as '25 mm'"
        )
    number, unit = match.groups()
    if not unit:
        raise UnitError(
            f"the length {text!r} has no unit; write one of {', '.join(MM_PER_UNIT)} behind it, "
            f"such as '{number} mm'"
        )
    return float(number) * unit_in_mm(unit)


def unit_in_mm(unit: str) -> float:
    """Look a unit of length up.

    Parameters
    ----------
    unit
        The name of the unit.

    Returns
    -------
    float
        How many mm one such unit is.

    Raises
    ------
    UnitError
        When the unit is not known.
    """
    if unit not in MM_PER_UNIT:
        raise UnitError(f"unknown unit of length {unit!r}; known are {', '.join(MM_PER_UNIT)}")
    return MM_PER_UNIT[unit]
