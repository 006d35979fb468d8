"""Several targets on one plate, and targets as people write them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.artwork import Pattern
from lenscal.errors import InputError
from lenscal.target import Charuco, Chessboard, CircleGrid, Disk, Target
from lenscal.units import parse_length_mm


@dataclass(frozen=True, slots=True)
class Plate(Target):
    """Several targets on one flat plate: boards for several magnifications, a disk to focus on.

    Parameters
    ----------
    parts
        Each target with the (x, y) of its middle in the frame of the plate, in mm. Ids of points
        count through the parts in this order.
    """

    parts: tuple[tuple[Target, tuple[float, float]], ...]

    def __post_init__(self) -> None:
        if not self.parts:
            raise InputError("a plate needs at least one target on it")
        boxes = [
            np.array([centre, centre]) + np.outer((-0.5, 0.5), target.size_mm)
            for target, centre in self.parts
        ]
        for i, first in enumerate(boxes):
            for j, second in enumerate(boxes[:i]):
                if (np.minimum(first[1], second[1]) - np.maximum(first[0], second[0]) > 1e-9).all():
                    raise InputError(
                        f"parts {j} ({self.parts[j][0].spec}) and {i} ({self.parts[i][0].spec}) of "
                        "the plate overlap; move them apart"
                    )

    @property
    def points_mm(self) -> FloatArray:
        """(N, 3) points of all parts."""
        return np.concatenate([t.points_mm + np.array([x, y, 0.0]) for t, (x, y) in self.parts])

    @property
    def size_mm(self) -> tuple[float, float]:
        """The smallest rectangle about the origin that holds all parts."""
        reach = [np.abs(centre) + np.array(t.size_mm) / 2 for t, centre in self.parts]
        width, height = 2 * np.max(reach, axis=0)
        return float(width), float(height)

    @property
    def spec(self) -> str:
        """Specs of the parts joined by ``+``, each with ``@x,y`` in mm."""
        return "+".join(f"{t.spec}@{x:g},{y:g}" for t, (x, y) in self.parts)

    def first_id(self, part: int) -> int:
        """Tell where the ids of a part begin.

        Parameters
        ----------
        part
            Its index.

        Returns
        -------
        int
            Id of its first point.
        """
        return sum(len(target.points_mm) for target, _ in self.parts[:part])

    def patterns(self) -> tuple[Pattern, ...]:
        """Gather what all parts print.

        Returns
        -------
        tuple of Pattern
            Each where its part lies.
        """
        return tuple(p.moved(*centre) for target, centre in self.parts for p in target.patterns())


def parse_target(text: str) -> Target:
    """Read a target from the words that people type.

    Parameters
    ----------
    text
        ``chessboard:9x6:25mm``, ``charuco:11x8:3mm:2.25mm[:DICTIONARY[:FIRST_ID]]``,
        ``circles:7x5:4mm:2mm``, ``staggered-circles:4x11:4mm:2mm``, ``disk:6mm``, or several on a
        plate: ``charuco:…@0,0+disk:6mm@0,40``.

    Returns
    -------
    Target
        The target.

    Raises
    ------
    InputError
        When the words are not understood, or a length has no unit.

    Examples
    --------
    >>> parse_target("chessboard:9x6:25mm")
    Chessboard(columns=9, rows=6, square_mm=25.0)
    """
    if "@" in text:
        return Plate(tuple(_parse_part(part) for part in text.split("+")))
    kind, *fields = text.strip().split(":")
    try:
        target: Target = _PARSERS[kind](*fields)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"cannot read the target {text!r}; write chessboard:9x6:25mm, "
            "charuco:11x8:3mm:2.25mm, circles:7x5:4mm:2mm, staggered-circles:4x11:4mm:2mm or "
            "disk:6mm"
        ) from error
    return target


def _parse_part(text: str) -> tuple[Target, tuple[float, float]]:
    spec, _, place = text.partition("@")
    try:
        x, y = (float(v) for v in place.split(","))
    except ValueError as error:
        raise InputError(
            f"cannot read the place of {text!r} on its plate; write TARGET@x,y in mm, "
            "such as disk:6mm@0,40"
        ) from error
    return parse_target(spec), (x, y)


def _counts(text: str) -> tuple[int, int]:
    columns, rows = text.split("x")
    return int(columns), int(rows)


def _parse_charuco(
    counts: str, square: str, marker: str, dictionary: str = "DICT_4X4_250", first_id: str = "0"
) -> Charuco:
    lengths = parse_length_mm(square), parse_length_mm(marker)
    return Charuco(*_counts(counts), *lengths, dictionary, int(first_id))


def _parse_circles(counts: str, spacing: str, diameter: str) -> CircleGrid:
    lengths = parse_length_mm(spacing), parse_length_mm(diameter)
    return CircleGrid(*_counts(counts), *lengths)


_PARSERS: Final[dict[str, Any]] = {
    "chessboard": lambda counts, square: Chessboard(*_counts(counts), parse_length_mm(square)),
    "charuco": _parse_charuco,
    "circles": _parse_circles,
    "staggered-circles": lambda *fields: replace(_parse_circles(*fields), staggered=True),
    "disk": lambda diameter: Disk(parse_length_mm(diameter)),
}
