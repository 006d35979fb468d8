"""Flat targets that cameras are calibrated and focused on.

The target frame: origin in the middle of the target, x right and y down as printed, z into the
plate, away from the viewer. A camera that faces the target squarely has the identity rotation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, IntArray, positive
from lenscal.errors import InputError
from lenscal.units import parse_length_mm

if TYPE_CHECKING:
    import cv2

Artwork = npt.NDArray[np.uint8]

#: Texels per mm of printed artwork, where the caller does not say.
_TEXELS_PER_MM: Final = 20


class Target(ABC):
    """A flat pattern with known points; every kind can draw itself."""

    @property
    @abstractmethod
    def points_mm(self) -> FloatArray:
        """(N, 3) feature points in the target frame, z = 0; row i has id i."""

    @property
    @abstractmethod
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the artwork, quiet zone included."""

    @property
    @abstractmethod
    def spec(self) -> str:
        """The words that `parse_target` turns into this target again."""

    @abstractmethod
    def artwork(self, texels_per_mm: int = _TEXELS_PER_MM) -> Artwork:
        """Draw the target as it is printed.

        Parameters
        ----------
        texels_per_mm
            Resolution of the drawing. Edges fall on texel borders where lengths times this are
            whole numbers.

        Returns
        -------
        Artwork
            (rows, columns) reflectance, 0 black to 255 white, of `size_mm`.
        """

    def ids(self) -> IntArray:
        """Number the points.

        Returns
        -------
        IntArray
            (N,) 0 to N − 1.
        """
        return np.arange(len(self.points_mm))


@dataclass(frozen=True, slots=True)
class Chessboard(Target):
    """A plain chessboard; all of it must be seen, since its corners carry no names.

    Parameters
    ----------
    columns, rows
        Count of *inner* corners, as OpenCV counts.
    square_mm
        Side of a square in mm.
    """

    columns: int
    rows: int
    square_mm: float

    def __post_init__(self) -> None:
        _check_grid("a chessboard", self.columns, self.rows, 3)
        positive("square_mm", self.square_mm, "mm")

    @property
    def points_mm(self) -> FloatArray:
        """(N, 3) inner corners, row by row."""
        return _centred_grid(self.columns, self.rows, self.square_mm)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Squares and a quiet zone of one square."""
        return (self.columns + 3) * self.square_mm, (self.rows + 3) * self.square_mm

    @property
    def spec(self) -> str:
        """Such as ``chessboard:9x6:25mm``."""
        return f"chessboard:{self.columns}x{self.rows}:{self.square_mm:g}mm"

    def artwork(self, texels_per_mm: int = _TEXELS_PER_MM) -> Artwork:
        """Draw the chessboard; its top-left square is black.

        Parameters
        ----------
        texels_per_mm
            Resolution of the drawing.

        Returns
        -------
        Artwork
            (rows, columns) reflectance.
        """
        width, height = self.size_mm
        x, y = _texel_centres(width, height, texels_per_mm)
        column = np.floor(x / self.square_mm + (self.columns + 1) / 2).astype(int)
        row = np.floor(y / self.square_mm + (self.rows + 1) / 2).astype(int)
        on_board = (
            (column >= 0) & (column <= self.columns) & ((row >= 0) & (row <= self.rows))[:, None]
        )
        black = on_board & ((column + row[:, None]) % 2 == 0)
        return np.where(black, 0, 255).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class Charuco(Target):
    """A chessboard with markers in its white squares, so that a part of it is enough.

    Parameters
    ----------
    columns, rows
        Count of *squares*, as OpenCV counts for this kind.
    square_mm
        Side of a square in mm.
    marker_mm
        Side of a marker in mm.
    dictionary
        Name of the marker dictionary in OpenCV.
    first_id
        Id of the first marker, so that several boards can share a plate.
    """

    columns: int
    rows: int
    square_mm: float
    marker_mm: float
    dictionary: str = "DICT_4X4_250"
    first_id: int = 0

    def __post_init__(self) -> None:
        _check_grid("a ChArUco board", self.columns, self.rows, 3)
        positive("square_mm", self.square_mm, "mm")
        if not 0 < self.marker_mm < self.square_mm:
            raise InputError(
                f"the markers of a ChArUco board must be smaller than its squares; "
                f"given {self.marker_mm:g} mm in {self.square_mm:g} mm"
            )
        self.markers()

    @property
    def points_mm(self) -> FloatArray:
        """(N, 3) inner corners, row by row."""
        return _centred_grid(self.columns - 1, self.rows - 1, self.square_mm)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Squares and a quiet zone of half a square."""
        return (self.columns + 1) * self.square_mm, (self.rows + 1) * self.square_mm

    @property
    def spec(self) -> str:
        """Such as ``charuco:11x8:3mm:2.25mm:DICT_4X4_250:0``."""
        return (
            f"charuco:{self.columns}x{self.rows}:{self.square_mm:g}mm:{self.marker_mm:g}mm:"
            f"{self.dictionary}:{self.first_id}"
        )

    def markers(self) -> cv2.aruco.Dictionary:
        """Look the marker dictionary up.

        Returns
        -------
        cv2.aruco.Dictionary
            OpenCV's dictionary.

        Raises
        ------
        InputError
            When the dictionary is not known or has too few markers.
        """
        import cv2

        code = getattr(cv2.aruco, self.dictionary, None)
        if code is None or not self.dictionary.startswith("DICT_"):
            raise InputError(
                f"unknown marker dictionary {self.dictionary!r}; use a name of OpenCV's such as "
                "DICT_4X4_250"
            )
        markers = cv2.aruco.getPredefinedDictionary(code)
        last, available = self.first_id + self.columns * self.rows // 2, len(markers.bytesList)
        if self.first_id < 0 or last > available:
            raise InputError(
                f"the board needs markers {self.first_id} to {last - 1}, but {self.dictionary} has "
                f"0 to {available - 1}; take a larger dictionary or a smaller board"
            )
        return markers

    def board(self) -> cv2.aruco.CharucoBoard:
        """Make OpenCV's own description of the board.

        Returns
        -------
        cv2.aruco.CharucoBoard
            With its origin in a corner, unlike the target frame; ids of corners agree.
        """
        import cv2

        ids = self.first_id + np.arange(self.columns * self.rows // 2)
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square_mm, self.marker_mm, self.markers(), ids
        )

    def artwork(self, texels_per_mm: int = _TEXELS_PER_MM) -> Artwork:
        """Draw the board; its top-left square is black, markers stand in the white squares.

        Parameters
        ----------
        texels_per_mm
            Resolution of the drawing.

        Returns
        -------
        Artwork
            (rows, columns) reflectance.
        """
        import cv2

        markers = self.markers()
        cells = markers.markerSize + 2
        patterns = [
            cv2.aruco.generateImageMarker(markers, self.first_id + i, cells)
            for i in range(self.columns * self.rows // 2)
        ]
        width, height = self.size_mm
        x, y = _texel_centres(width, height, texels_per_mm)
        square_x = x / self.square_mm + self.columns / 2
        square_y = y / self.square_mm + self.rows / 2
        drawing = np.full((len(y), len(x)), 255, np.uint8)
        marker_share = self.marker_mm / self.square_mm
        number = 0
        for row in range(self.rows):
            in_row = np.flatnonzero(np.floor(square_y) == row)
            for column in range(self.columns):
                in_column = np.flatnonzero(np.floor(square_x) == column)
                if (row + column) % 2 == 0:
                    drawing[np.ix_(in_row, in_column)] = 0
                    continue
                cell_x = _marker_cell(square_x[in_column] - column, marker_share, cells)
                cell_y = _marker_cell(square_y[in_row] - row, marker_share, cells)
                inside_x, inside_y = cell_x >= 0, cell_y >= 0
                drawing[np.ix_(in_row[inside_y], in_column[inside_x])] = patterns[number][
                    np.ix_(cell_y[inside_y], cell_x[inside_x])
                ]
                number += 1
        return drawing


@dataclass(frozen=True, slots=True)
class CircleGrid(Target):
    """Black dots on white, in straight or in staggered rows.

    Parameters
    ----------
    columns, rows
        Count of dots, as OpenCV counts.
    spacing_mm
        Distance of neighbouring dots in a row in mm; rows of a staggered grid lie half as far apart.
    diameter_mm
        Diameter of a dot in mm.
    staggered
        Whether every other row is shifted by half the spacing (OpenCV's asymmetric grid).
    """

    columns: int
    rows: int
    spacing_mm: float
    diameter_mm: float
    staggered: bool = False

    def __post_init__(self) -> None:
        _check_grid("a circle grid", self.columns, self.rows, 2)
        positive("spacing_mm", self.spacing_mm, "mm")
        closest = self.spacing_mm / (np.sqrt(2) if self.staggered else 1)
        if not 0 < self.diameter_mm < closest:
            raise InputError(
                f"dots of {self.diameter_mm:g} mm touch each other at {closest:g} mm from centre to "
                "centre; make them smaller or their spacing larger"
            )

    @property
    def points_mm(self) -> FloatArray:
        """(N, 3) centres of the dots, row by row."""
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        if self.staggered:
            x, y = self.spacing_mm * (column + (row % 2) / 2), self.spacing_mm / 2 * row
        else:
            x, y = self.spacing_mm * column, self.spacing_mm * row
        points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(np.float64)
        centred: FloatArray = points - (points.min(axis=0) + points.max(axis=0)) / 2
        return centred

    @property
    def size_mm(self) -> tuple[float, float]:
        """Dots and a quiet zone of one spacing."""
        width, height = 2 * self.points_mm.max(axis=0)[:2] + 2 * self.spacing_mm
        return float(width), float(height)

    @property
    def spec(self) -> str:
        """Such as ``circles:7x5:4mm:2mm`` or ``staggered-circles:4x11:4mm:2mm``."""
        kind = "staggered-circles" if self.staggered else "circles"
        return f"{kind}:{self.columns}x{self.rows}:{self.spacing_mm:g}mm:{self.diameter_mm:g}mm"

    def artwork(self, texels_per_mm: int = _TEXELS_PER_MM) -> Artwork:
        """Draw the dots.

        Parameters
        ----------
        texels_per_mm
            Resolution of the drawing.

        Returns
        -------
        Artwork
            (rows, columns) reflectance.
        """
        return _dots(self.points_mm, self.diameter_mm, self.size_mm, texels_per_mm)


@dataclass(frozen=True, slots=True)
class Disk(Target):
    """The high-contrast disk that the paper focuses on.

    Parameters
    ----------
    diameter_mm
        Diameter of the black disk in mm.
    """

    diameter_mm: float

    def __post_init__(self) -> None:
        positive("diameter_mm", self.diameter_mm, "mm")

    @property
    def points_mm(self) -> FloatArray:
        """(1, 3) its centre."""
        return np.zeros((1, 3))

    @property
    def size_mm(self) -> tuple[float, float]:
        """The disk and a quiet zone of half its diameter."""
        return 2 * self.diameter_mm, 2 * self.diameter_mm

    @property
    def spec(self) -> str:
        """Such as ``disk:6mm``."""
        return f"disk:{self.diameter_mm:g}mm"

    def artwork(self, texels_per_mm: int = _TEXELS_PER_MM) -> Artwork:
        """Draw the disk.

        Parameters
        ----------
        texels_per_mm
            Resolution of the drawing.

        Returns
        -------
        Artwork
            (rows, columns) reflectance.
        """
        return _dots(self.points_mm, self.diameter_mm, self.size_mm, texels_per_mm)


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
        return np.concatenate([t.points_mm + (*centre, 0.0) for t, centre in self.parts])

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

    def artwork(self, texels_per_mm: int = _TEXELS_PER_MM) -> Artwork:
        """Draw all parts on a white plate.

        Parameters
        ----------
        texels_per_mm
            Resolution of the drawing.

        Returns
        -------
        Artwork
            (rows, columns) reflectance.
        """
        width, height = self.size_mm
        x, y = _texel_centres(width, height, texels_per_mm)
        drawing = np.full((len(y), len(x)), 255, np.uint8)
        for target, centre in self.parts:
            part = target.artwork(texels_per_mm)
            corner = (np.array([width, height]) - target.size_mm) / 2 + centre
            left, top = np.round(corner * texels_per_mm).astype(int)
            drawing[top : top + part.shape[0], left : left + part.shape[1]] = part
        return drawing


def parse_target(text: str) -> Target:
    """Read a target from the words that people type.

    Parameters
    ----------
    text
        ``chessboard:9x6:25mm``, ``charuco:11x8:3mm:2.25mm[:DICTIONARY[:FIRST_ID]]``,
        ``circles:7x5:4mm:2mm``, ``staggered-circles:4x11:4mm:2mm``, ``disk:6mm``, or several of them
        on a plate: ``charuco:…@0,0+disk:6mm@0,40``.

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
        return _PARSERS[kind](*fields)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"cannot read the target {text!r}; write chessboard:9x6:25mm, "
            "charuco:11x8:3mm:2.25mm, circles:7x5:4mm:2mm, staggered-circles:4x11:4mm:2mm or disk:6mm"
        ) from error


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


def _parse_circles(counts: str, spacing: str, diameter: str, staggered: bool = False) -> CircleGrid:
    lengths = parse_length_mm(spacing), parse_length_mm(diameter)
    return CircleGrid(*_counts(counts), *lengths, staggered)


_PARSERS: Final[dict[str, Any]] = {
    "chessboard": lambda counts, square: Chessboard(*_counts(counts), parse_length_mm(square)),
    "charuco": _parse_charuco,
    "circles": lambda *fields: _parse_circles(*fields),
    "staggered-circles": lambda *fields: _parse_circles(*fields, staggered=True),
    "disk": lambda diameter: Disk(parse_length_mm(diameter)),
}


def _check_grid(kind: str, columns: int, rows: int, least: int) -> None:
    if columns < least or rows < least:
        raise InputError(
            f"{kind} needs at least {least} × {least}, but {columns} × {rows} is given"
        )


def _centred_grid(columns: int, rows: int, spacing_mm: float) -> FloatArray:
    x = spacing_mm * (np.arange(columns) - (columns - 1) / 2)
    y = spacing_mm * (np.arange(rows) - (rows - 1) / 2)
    grid = np.stack([*np.meshgrid(x, y), np.zeros((rows, columns))], axis=-1)
    points: FloatArray = grid.reshape(-1, 3)
    return points


def _texel_centres(
    width_mm: float, height_mm: float, texels_per_mm: int
) -> tuple[FloatArray, FloatArray]:
    across, down = (round(v * texels_per_mm) for v in (width_mm, height_mm))
    x = (np.arange(across) + 0.5 - across / 2) / texels_per_mm
    y = (np.arange(down) + 0.5 - down / 2) / texels_per_mm
    return x, y


def _marker_cell(share_of_square: FloatArray, marker_share: float, cells: int) -> IntArray:
    """Cell index of a marker along one side, −1 outside of it."""
    cell = np.floor((share_of_square - (1 - marker_share) / 2) / marker_share * cells).astype(int)
    return np.where((cell >= 0) & (cell < cells), cell, -1)


def _dots(
    centres_mm: FloatArray, diameter_mm: float, size_mm: tuple[float, float], texels_per_mm: int
) -> Artwork:
    """Draw round dots; texels on the rim are grey in proportion to the share that is covered."""
    x, y = _texel_centres(*size_mm, texels_per_mm)
    drawing = np.full((len(y), len(x)), 255, np.uint8)
    for centre_x, centre_y, _ in centres_mm:
        reach = diameter_mm / 2 + 1 / texels_per_mm
        columns = np.flatnonzero(np.abs(x - centre_x) <= reach)
        rows = np.flatnonzero(np.abs(y - centre_y) <= reach)
        radius = np.hypot(x[columns] - centre_x, (y[rows] - centre_y)[:, None])
        covered = np.clip((diameter_mm / 2 - radius) * texels_per_mm + 0.5, 0.0, 1.0)
        drawing[np.ix_(rows, columns)] = np.round(255 * (1 - covered)).astype(np.uint8)
    return drawing
