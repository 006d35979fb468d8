"""Drawing of flat patterns, texel by texel: what a printer would put on the plate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, IntArray

#: (rows, columns) reflectance, 0 black to 255 white.
Artwork = npt.NDArray[np.uint8]


def blank(size_mm: tuple[float, float], texels_per_mm: int) -> Artwork:
    """Make white paper.

    Parameters
    ----------
    size_mm
        Width and height.
    texels_per_mm
        Resolution.

    Returns
    -------
    Artwork
        (rows, columns) of 255.
    """
    x, y = texel_centres(size_mm, texels_per_mm)
    return np.full((len(y), len(x)), 255, np.uint8)


def texel_centres(
    size_mm: tuple[float, float], texels_per_mm: int
) -> tuple[FloatArray, FloatArray]:
    """Tell where the texels lie.

    Parameters
    ----------
    size_mm
        Width and height.
    texels_per_mm
        Resolution.

    Returns
    -------
    x, y : FloatArray
        (columns,) and (rows,) in mm from the middle.
    """
    across, down = (round(v * texels_per_mm) for v in size_mm)
    x = (np.arange(across) + 0.5 - across / 2) / texels_per_mm
    y = (np.arange(down) + 0.5 - down / 2) / texels_per_mm
    return x, y


def chessboard(
    squares: tuple[int, int], square_mm: float, size_mm: tuple[float, float], texels_per_mm: int
) -> Artwork:
    """Draw a chessboard in the middle of white paper; its top-left square is black.

    Parameters
    ----------
    squares
        Count of squares across and down.
    square_mm
        Their side.
    size_mm
        Width and height of the paper.
    texels_per_mm
        Resolution.

    Returns
    -------
    Artwork
        (rows, columns) reflectance.
    """
    x, y = texel_centres(size_mm, texels_per_mm)
    column = np.floor(x / square_mm + squares[0] / 2).astype(int)
    row = np.floor(y / square_mm + squares[1] / 2).astype(int)
    # Two one-dimensional patterns, 0 and 255, of which a square is black where they agree.
    across, down = ((index % 2 * 255).astype(np.uint8) for index in (column, row))
    drawing = across ^ down[:, None]
    drawing[(row < 0) | (row >= squares[1])] = 255
    drawing[:, (column < 0) | (column >= squares[0])] = 255
    return drawing


def add_markers(
    drawing: Artwork,
    squares: tuple[int, int],
    square_mm: float,
    marker_mm: float,
    patterns: Sequence[Artwork],
    texels_per_mm: int,
) -> None:
    """Draw markers into the white squares of a chessboard, row by row.

    Parameters
    ----------
    drawing
        The chessboard; it is drawn into.
    squares
        Count of squares across and down.
    square_mm, marker_mm
        Side of a square and of a marker.
    patterns
        One (cells, cells) picture per marker, its black border included.
    texels_per_mm
        Resolution of the drawing.
    """
    size_mm = drawing.shape[1] / texels_per_mm, drawing.shape[0] / texels_per_mm
    x, y = texel_centres(size_mm, texels_per_mm)
    across, down = x / square_mm + squares[0] / 2, y / square_mm + squares[1] / 2
    white = [(r, c) for r in range(squares[1]) for c in range(squares[0]) if (r + c) % 2]
    for pattern, (row, column) in zip(patterns, white, strict=True):
        cell_x = _cells(across - column, marker_mm / square_mm, len(pattern))
        cell_y = _cells(down - row, marker_mm / square_mm, len(pattern))
        columns, rows = np.flatnonzero(cell_x >= 0), np.flatnonzero(cell_y >= 0)
        drawing[np.ix_(rows, columns)] = pattern[np.ix_(cell_y[rows], cell_x[columns])]


def dots(
    centres_mm: FloatArray, diameter_mm: float, size_mm: tuple[float, float], texels_per_mm: int
) -> Artwork:
    """Draw round dots; texels on the rim are grey in proportion to the share that is covered.

    Parameters
    ----------
    centres_mm
        (N, 3) centres from the middle of the paper.
    diameter_mm
        Their diameter.
    size_mm
        Width and height of the paper.
    texels_per_mm
        Resolution.

    Returns
    -------
    Artwork
        (rows, columns) reflectance.
    """
    x, y = texel_centres(size_mm, texels_per_mm)
    drawing = blank(size_mm, texels_per_mm)
    reach = diameter_mm / 2 + 1 / texels_per_mm
    for centre_x, centre_y, _ in centres_mm:
        columns = np.flatnonzero(np.abs(x - centre_x) <= reach)
        rows = np.flatnonzero(np.abs(y - centre_y) <= reach)
        radius = np.hypot(x[columns] - centre_x, (y[rows] - centre_y)[:, None])
        covered = np.clip((diameter_mm / 2 - radius) * texels_per_mm + 0.5, 0.0, 1.0)
        drawing[np.ix_(rows, columns)] = np.round(255 * (1 - covered)).astype(np.uint8)
    return drawing


def _cells(share_of_square: FloatArray, marker_share: float, count: int) -> IntArray:
    """Cell index of a marker along one side, −1 outside of it."""
    cell = np.floor((share_of_square - (1 - marker_share) / 2) / marker_share * count).astype(int)
    return np.where((cell >= 0) & (cell < count), cell, -1)
