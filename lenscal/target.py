"""Flat targets that cameras are calibrated and focused on.

The target frame: origin in the middle of the target, x right and y down as printed, z into the
plate, away from the viewer. A camera that faces the target squarely has the identity rotation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from lenscal import artwork
from lenscal.arrays import FloatArray, IntArray, positive
from lenscal.artwork import Artwork, Dots, Pattern, TexelGrid
from lenscal.errors import InputError

if TYPE_CHECKING:
    import cv2

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
        """The words that `lenscal.plate.parse_target` turns into this target again."""

    @abstractmethod
    def patterns(self) -> tuple[Pattern, ...]:
        """List what is printed on the white paper.

        Returns
        -------
        tuple of Pattern
            Patterns in the target frame, within `size_mm`.
        """

    def artwork(self, texels_per_mm: float = _TEXELS_PER_MM) -> Artwork:
        """Draw the target as it is printed.

        Parameters
        ----------
        texels_per_mm
            Resolution of the drawing; texels that an edge crosses are grey.

        Returns
        -------
        Artwork
            (rows, columns) reflectance, 0 black to 255 white, of `size_mm`.
        """
        return artwork.draw(self.patterns(), TexelGrid.over(self.size_mm, texels_per_mm))

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

    def patterns(self) -> tuple[Pattern, ...]:
        """Lay the squares out; the top-left one is black.

        Returns
        -------
        tuple of Pattern
            One chessboard.
        """
        return (artwork.chessboard((self.columns + 1, self.rows + 1), self.square_mm),)


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

    def patterns(self) -> tuple[Pattern, ...]:
        """Lay the squares out; the top-left one is black, markers stand in the white ones.

        Returns
        -------
        tuple of Pattern
            One chessboard with its markers.
        """
        import cv2

        markers = self.markers()
        cells = markers.markerSize + 2
        pictures = [
            cv2.aruco.generateImageMarker(markers, self.first_id + i, cells).astype(np.uint8)
            for i in range(self.columns * self.rows // 2)
        ]
        board = artwork.chessboard((self.columns, self.rows), self.square_mm)
        return (artwork.with_markers(board, self.square_mm, self.marker_mm, pictures),)


@dataclass(frozen=True, slots=True)
class CircleGrid(Target):
    """Black dots on white, in straight or in staggered rows.

    Parameters
    ----------
    columns, rows
        Count of dots, as OpenCV counts.
    spacing_mm
        Distance of neighbouring dots in a row in mm; staggered rows lie half as far apart.
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
                f"dots of {self.diameter_mm:g} mm touch each other at {closest:g} mm between "
                "centres; make them smaller or their spacing larger"
            )

    @property
    def points_mm(self) -> FloatArray:
        """(N, 3) centres of the dots, row by row."""
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        shift, height = ((row % 2) / 2, row / 2) if self.staggered else (np.zeros(row.shape), row)
        x, y = self.spacing_mm * (column + shift), self.spacing_mm * height
        points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        return np.asarray(points - middle, dtype=np.float64)

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

    def patterns(self) -> tuple[Pattern, ...]:
        """Lay the dots out.

        Returns
        -------
        tuple of Pattern
            All dots.
        """
        return (Dots(self.points_mm[:, :2], self.diameter_mm),)


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

    def patterns(self) -> tuple[Pattern, ...]:
        """Lay the disk out.

        Returns
        -------
        tuple of Pattern
            The disk.
        """
        return (Dots(self.points_mm[:, :2], self.diameter_mm),)


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
