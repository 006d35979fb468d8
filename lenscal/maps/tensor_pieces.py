"""Tensor-product splines as polynomials on the cells between knots, for many points at once.

At a point only (degree + 1)² basis functions matter, so within a cell a surface is one polynomial,
and the posterior variance, a square of the basis, is one of twice the degree. In Bernstein form
over the cell neither the conversion nor the evaluation loses digits to cancellation; the binomials
are left with the coefficients.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.maps.spline_axis import Intervals, SplineAxis

#: Points evaluated at a time: their basis should fit into the processor's cache.
_CHUNK: Final = 4096
#: Points per cell below which sorting them into cells does not pay.
_FEW_PER_CELL: Final = 64


def surface_pieces(
    zoom: SplineAxis,
    focus: SplineAxis,
    coefficients: FloatArray,
    derivative: tuple[int, int] = (0, 0),
) -> FloatArray:
    """Turn B-spline coefficients into polynomials per cell.

    Parameters
    ----------
    zoom, focus
        The axes.
    coefficients
        (K_zoom, K_focus, Q) of Q surfaces.
    derivative
        How often to differentiate along zoom and along focus.

    Returns
    -------
    FloatArray
        (Q, P, R, C) coefficients along zoom and focus in each of C cells, focus fastest.
    """
    zoom_pieces = _differentiated(zoom, derivative[0])
    focus_pieces = _differentiated(focus, derivative[1])
    local = coefficients[zoom.supports()[:, None, :, None], focus.supports()[None, :, None, :]]
    pieces = np.einsum("mpi,nrj,mnijq->qprmn", zoom_pieces, focus_pieces, local, optimize=True)
    return np.ascontiguousarray(pieces.reshape(*pieces.shape[:3], -1))


def covariance_pieces(zoom: SplineAxis, focus: SplineAxis, covariance: FloatArray) -> FloatArray:
    """Turn the covariance of B-spline coefficients of two surfaces into polynomials per cell.

    Parameters
    ----------
    zoom, focus
        The axes.
    covariance
        (K_zoom, K_focus, K_zoom, K_focus) between the coefficients of one surface and another.

    Returns
    -------
    FloatArray
        (1, 2 P − 1, 2 R − 1, C) coefficients of the covariance of the two surfaces.
    """
    rows, columns = zoom.supports(), focus.supports()
    zoom_pieces, focus_pieces = zoom.pieces(), focus.pieces()
    zoom_product, focus_product = _product(zoom.degree), _product(focus.degree)
    cells = []
    # Cell by cell along zoom, since the blocks of all cells together may be large.
    for row, piece in zip(rows, zoom_pieces, strict=True):
        near = covariance[row][:, :, row]
        # (N, R, R, P, P): pairs along focus in each cell, then pairs along zoom.
        local = near[:, columns[:, :, None], :, columns[:, None, :]]
        along_zoom = np.einsum("ai,bk,abp->ikp", piece, piece, zoom_product)
        along_focus = np.einsum("nai,nbk,abr->nikr", focus_pieces, focus_pieces, focus_product)
        cells.append(
            np.einsum("njlik,ikp,njlr->prn", local, along_zoom, along_focus, optimize=True)
        )
    pieces = np.stack(cells, axis=2)[None]
    return np.ascontiguousarray(pieces.reshape(*pieces.shape[:3], -1))


def evaluate(
    axes: tuple[SplineAxis, SplineAxis],
    pieces: FloatArray,
    zoom: FloatArray,
    focus: FloatArray,
    *,
    continued: bool,
) -> FloatArray:
    """Evaluate polynomials per cell at points.

    Parameters
    ----------
    axes
        The axes.
    pieces
        (Q, P, R, C) coefficients.
    zoom, focus
        (N,) settings; NaN gives NaN.
    continued
        Whether the outermost polynomials go on beyond the knots; else their values at the border
        are kept there.

    Returns
    -------
    FloatArray
        (Q, N).
    """
    row, column = (axis.interval(v) for axis, v in zip(axes, (zoom, focus), strict=True))
    cell = row * np.uint16(len(axes[1].widths)) + column
    if len(zoom) < _FEW_PER_CELL * pieces.shape[3]:
        result = _point_by_point(axes, pieces, (zoom, focus), (row, column), cell, continued)
    else:
        result = _cell_by_cell(axes, pieces, (zoom, focus), cell, continued)
    if 0 in _degrees(pieces):
        # What is constant does not notice a place that is NaN.
        result[:, np.isnan(zoom) | np.isnan(focus)] = np.nan
    return result


def _point_by_point(
    axes: tuple[SplineAxis, SplineAxis],
    pieces: FloatArray,
    settings: tuple[FloatArray, FloatArray],
    intervals: tuple[Intervals, Intervals],
    cell: Intervals,
    continued: bool,
) -> FloatArray:
    """(Q, N) values, the coefficients being fetched for each point."""
    zoom_basis, focus_basis = (
        shares(degree, axis.place(values, interval, continued=continued))
        for axis, values, interval, degree in zip(
            axes, settings, intervals, _degrees(pieces), strict=True
        )
    )
    along = np.einsum("qprn,rn->qpn", pieces.take(cell, axis=3), focus_basis)
    return np.asarray(np.einsum("qpn,pn->qn", along, zoom_basis))


def _cell_by_cell(
    axes: tuple[SplineAxis, SplineAxis],
    pieces: FloatArray,
    settings: tuple[FloatArray, FloatArray],
    cell: Intervals,
    continued: bool,
) -> FloatArray:
    """(Q, N) values, the points being sorted into cells, in each of which one product does."""
    cells = pieces.shape[3]
    # Short integers are sorted by counting them.
    order = np.argsort(cell, kind="stable")
    sorted_settings = [values.take(order) for values in settings]
    stops = np.cumsum(np.bincount(cell, minlength=cells))
    columns = len(axes[1].widths)
    found = np.zeros((len(pieces), len(cell)))
    count, across = pieces.shape[0], pieces.shape[2]
    for number in range(cells):
        # All surfaces at once: one product of matrices costs little more than another.
        piece = np.ascontiguousarray(pieces[..., number]).reshape(-1, across)
        intervals = divmod(number, columns)
        for start in range(stops[number - 1] if number else 0, stops[number], _CHUNK):
            part = slice(start, min(start + _CHUNK, stops[number]))
            zoom_basis, focus_basis = (
                shares(degree, axis.place(values[part], interval, continued=continued))
                for axis, values, interval, degree in zip(
                    axes, sorted_settings, intervals, _degrees(pieces), strict=True
                )
            )
            along = (piece @ focus_basis).reshape(count, len(zoom_basis), -1)
            np.einsum("qpn,pn->qn", along, zoom_basis, out=found[:, part])
    result = np.zeros_like(found)
    result[:, order] = found
    return result


def _degrees(pieces: FloatArray) -> tuple[int, int]:
    return pieces.shape[1] - 1, pieces.shape[2] - 1


def shares(degree: int, place: FloatArray) -> FloatArray:
    """Evaluate the products of powers of a place and of what is left to 1.

    Parameters
    ----------
    degree
        The degree n.
    place
        (N,) places t, 0 to 1 over the interval.

    Returns
    -------
    FloatArray
        (n + 1, N) t^k (1 − t)^(n − k), Bernstein's polynomials without their binomials.
    """
    found = np.ones((degree + 1, len(place)))
    for power in range(degree):
        np.multiply(found[power], place, out=found[power + 1])
    rest = 1.0 - place
    falling = rest.copy()
    for power in range(degree - 1, -1, -1):
        found[power] *= falling
        falling *= rest
    return found


def _differentiated(axis: SplineAxis, order: int) -> FloatArray:
    """(M, P, degree + 1) coefficients of a derivative of each local basis function."""
    pieces = axis.pieces()
    for _ in range(order):
        degree = pieces.shape[1] - 1
        if degree == 0:
            return np.zeros_like(pieces)
        rising = np.arange(1, degree + 1)[:, None]
        slopes = rising * pieces[:, 1:] - rising[::-1] * pieces[:, :-1]
        pieces = slopes / axis.widths[:, None, None]
    return pieces


def _product(degree: int) -> FloatArray:
    """(P, P, 2 P − 1) products of two `shares` in those of twice the degree."""
    first, second = np.indices((degree + 1, degree + 1))
    both = (first + second)[:, :, None] == np.arange(2 * degree + 1)
    return np.asarray(both, dtype=np.float64)
