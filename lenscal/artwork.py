"""Drawing of flat patterns, texel by texel: what a printer would put on the plate.

Every texel is the mean over its area, whatever the resolution and whatever part is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray

#: (rows, columns) reflectance, 0 black to 255 white.
Artwork = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class TexelGrid:
    """Square texels over a part of the plane of a target.

    Parameters
    ----------
    left_mm, top_mm
        Outer corner of the first texel in the target frame.
    texels_per_mm
        Resolution.
    columns, rows
        Count of texels.
    """

    left_mm: float
    top_mm: float
    texels_per_mm: float
    columns: int
    rows: int

    @classmethod
    def over(cls, size_mm: tuple[float, float], texels_per_mm: float) -> TexelGrid:
        """Cover a sheet about the origin.

        Parameters
        ----------
        size_mm
            Width and height of the sheet.
        texels_per_mm
            Resolution.

        Returns
        -------
        TexelGrid
            The whole number of texels that is nearest to the size.
        """
        columns, rows = (round(side * texels_per_mm) for side in size_mm)
        return cls(
            -columns / texels_per_mm / 2, -rows / texels_per_mm / 2, texels_per_mm, columns, rows
        )

    @property
    def x_edges_mm(self) -> FloatArray:
        """(columns + 1,) borders between texels."""
        return self.left_mm + np.arange(self.columns + 1) / self.texels_per_mm

    @property
    def y_edges_mm(self) -> FloatArray:
        """(rows + 1,) borders between texels."""
        return self.top_mm + np.arange(self.rows + 1) / self.texels_per_mm


@dataclass(frozen=True, slots=True, eq=False)
class Mosaic:
    """Rectangles of grey on white paper: squares, and the cells of markers.

    Parameters
    ----------
    cells
        (rows, columns) reflectance of each, 0 to 255.
    x_edges_mm, y_edges_mm
        (columns + 1,) and (rows + 1,) ascending borders between them in the target frame.
    """

    cells: Artwork
    x_edges_mm: FloatArray
    y_edges_mm: FloatArray

    def moved(self, x_mm: float, y_mm: float) -> Mosaic:
        """Shift the pattern.

        Parameters
        ----------
        x_mm, y_mm
            By how much.

        Returns
        -------
        Mosaic
            The shifted pattern.
        """
        return Mosaic(self.cells, self.x_edges_mm + x_mm, self.y_edges_mm + y_mm)

    def draw_into(self, drawing: Artwork, grid: TexelGrid) -> None:
        """Draw the pattern.

        Parameters
        ----------
        drawing
            White paper; it is drawn into.
        grid
            Where its texels lie.
        """
        columns, cell_columns, across = _overlaps(self.x_edges_mm, grid.x_edges_mm)
        rows, cell_rows, down = _overlaps(self.y_edges_mm, grid.y_edges_mm)
        if not (across.size and down.size):
            return
        ink = (255 - self.cells[cell_rows, cell_columns].astype(np.float32)) @ across
        # Most rows of texels lie in one row of cells: those are copied, the others mixed.
        inner = drawing[rows, columns]
        cell_row, share = down.argmax(axis=0), down.max(axis=0)
        np.take(_grey(ink), cell_row, axis=0, out=inner, mode="clip")
        mixed = np.flatnonzero(share < 1 - 1e-6)
        inner[mixed] = _grey(down[:, mixed].T @ ink)


@dataclass(frozen=True, slots=True, eq=False)
class Dots:
    """Round black dots on white paper.

    Parameters
    ----------
    centres_mm
        (N, 2) centres in the target frame.
    diameter_mm
        Their diameter.
    """

    centres_mm: FloatArray
    diameter_mm: float

    def moved(self, x_mm: float, y_mm: float) -> Dots:
        """Shift the dots.

        Parameters
        ----------
        x_mm, y_mm
            By how much.

        Returns
        -------
        Dots
            The shifted dots.
        """
        return Dots(self.centres_mm + np.array([x_mm, y_mm]), self.diameter_mm)

    def draw_into(self, drawing: Artwork, grid: TexelGrid) -> None:
        """Draw the dots; texels on a rim are grey in proportion to the share that is covered.

        Parameters
        ----------
        drawing
            White paper; it is drawn into.
        grid
            Where its texels lie.
        """
        scale = grid.texels_per_mm
        radius = self.diameter_mm / 2 * scale
        for centre in (self.centres_mm - (grid.left_mm, grid.top_mm)) * scale - 0.5:
            first = np.maximum(np.floor(centre - radius - 1).astype(int), 0)
            last = np.minimum(
                np.ceil(centre + radius + 1).astype(int), (grid.columns - 1, grid.rows - 1)
            )
            if (last < first).any():
                continue
            x, y = (
                (np.arange(low, high + 1) - middle).astype(np.float32)
                for low, high, middle in zip(first, last, centre, strict=True)
            )
            part = drawing[first[1] : last[1] + 1, first[0] : last[0] + 1]
            squared = x**2 + (y**2)[:, None]
            part[squared < max(radius - 1, 0) ** 2] = 0
            rim = np.abs(squared - (radius**2 + 1)) <= 2 * radius
            covered = np.clip(radius - np.sqrt(squared[rim]) + 0.5, 0.0, 1.0)
            part[rim] = np.round(255 * (1 - covered))


#: What can be printed.
Pattern = Mosaic | Dots


def draw(patterns: Sequence[Pattern], grid: TexelGrid) -> Artwork:
    """Draw patterns on white paper.

    Parameters
    ----------
    patterns
        What is printed; their rectangles do not overlap.
    grid
        The texels wanted.

    Returns
    -------
    Artwork
        (rows, columns) reflectance.
    """
    drawing = np.full((grid.rows, grid.columns), 255, np.uint8)
    for pattern in patterns:
        pattern.draw_into(drawing, grid)
    return drawing


def chessboard(squares: tuple[int, int], square_mm: float) -> Mosaic:
    """Lay out a chessboard about the origin; its top-left square is black.

    Parameters
    ----------
    squares
        Count of squares across and down.
    square_mm
        Their side.

    Returns
    -------
    Mosaic
        One cell per square.
    """
    row, column = np.indices(squares[::-1])
    cells = ((row + column) % 2 * 255).astype(np.uint8)

    def edges(count: int) -> FloatArray:
        return np.asarray(square_mm * (np.arange(count + 1) - count / 2), dtype=np.float64)

    return Mosaic(cells, edges(squares[0]), edges(squares[1]))


def with_markers(
    board: Mosaic, square_mm: float, marker_mm: float, markers: Sequence[Artwork]
) -> Mosaic:
    """Print markers into the white squares of a chessboard, row by row.

    Parameters
    ----------
    board
        The chessboard, one cell per square.
    square_mm, marker_mm
        Side of a square and of a marker.
    markers
        One (n, n) picture per marker, its black border included.

    Returns
    -------
    Mosaic
        n + 2 cells along each side of a square.
    """
    n = len(markers[0])
    cells = np.kron(board.cells, np.ones((n + 2, n + 2), np.uint8))
    for marker, (row, column) in zip(markers, np.argwhere(board.cells), strict=True):
        top, left = (n + 2) * row + 1, (n + 2) * column + 1
        cells[top : top + n, left : left + n] = marker
    margin = (square_mm - marker_mm) / 2
    within = np.append(0.0, margin + marker_mm / n * np.arange(n + 1))

    def divided(edges: FloatArray) -> FloatArray:
        finer: FloatArray = np.append(np.add.outer(edges[:-1], within), edges[-1])
        return finer

    return Mosaic(cells, divided(board.x_edges_mm), divided(board.y_edges_mm))


def _overlaps(
    cell_edges: FloatArray, texel_edges: FloatArray
) -> tuple[slice, slice, npt.NDArray[np.float32]]:
    """Give the texels and the cells that meet, and the share of each texel in each cell."""
    texels = _meeting(texel_edges, cell_edges)
    cells = _meeting(cell_edges, texel_edges)
    edges = texel_edges[texels.start : texels.stop + 1]
    borders = cell_edges[cells.start : cells.stop + 1]
    inside = np.clip(edges, borders[:-1, None], borders[1:, None])
    pitch = texel_edges[1] - texel_edges[0]
    return texels, cells, (np.diff(inside, axis=1) / pitch).astype(np.float32)


def _meeting(edges: FloatArray, others: FloatArray) -> slice:
    """Give the intervals between ascending edges that reach into the span of others."""
    first, last = np.searchsorted(edges, others[[0, -1]], side="right")
    return slice(max(int(first) - 1, 0), max(min(int(last), len(edges) - 1), 0))


def _grey(ink: npt.NDArray[np.float32]) -> Artwork:
    return np.rint(255 - ink).astype(np.uint8)
