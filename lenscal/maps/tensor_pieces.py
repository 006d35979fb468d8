"""Tensor-product splines as polynomials on the cells between knots, for many points at once.

At a point only (degree + 1)² basis functions matter, so within a cell a surface is one polynomial,
and the posterior variance, a square of the basis, is one of twice the degree. In Bernstein form
over the cell neither the conversion nor the evaluation loses digits to cancellation.
"""

from __future__ import annotations

from math import comb
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.maps.spline_axis import SplineAxis

#: Points evaluated at a time: their coefficients should fit into the processor's cache.
_CHUNK: Final = 4096


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
        (Q, P, R, C) Bernstein coefficients along zoom and focus in each of C cells, focus fastest.
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
        (1, 2 P − 1, 2 R − 1, C) Bernstein coefficients of the covariance of the two surfaces.
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
        (Q, P, R, C) Bernstein coefficients.
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
    count = len(pieces)
    result = np.zeros((count, len(zoom)))
    for start in range(0, len(zoom), _CHUNK):
        part = slice(start, start + _CHUNK)
        (row, along_zoom), (column, along_focus) = (
            axis.place(values[part], continued=continued)
            for axis, values in zip(axes, (zoom, focus), strict=True)
        )
        cell = row * (len(axes[1].breaks) - 1) + column
        zoom_basis = bernstein(pieces.shape[1] - 1, along_zoom)
        focus_basis = bernstein(pieces.shape[2] - 1, along_focus)
        for surface, values in zip(pieces, result, strict=True):
            along = np.einsum("prn,rn->pn", surface.take(cell, axis=2), focus_basis)
            np.einsum("pn,pn->n", along, zoom_basis, out=values[part])
    # A constant piece does not notice a place that is NaN.
    result[:, np.isnan(zoom) | np.isnan(focus)] = np.nan
    return result


def bernstein(degree: int, at: FloatArray) -> FloatArray:
    """Evaluate the Bernstein polynomials of a degree.

    Parameters
    ----------
    degree
        The degree.
    at
        (N,) places, 0 to 1 over the interval.

    Returns
    -------
    FloatArray
        (degree + 1, N).
    """
    rising, falling = np.ones((2, degree + 1, len(at)))
    rest = 1.0 - at
    for power in range(1, degree + 1):
        np.multiply(rising[power - 1], at, out=rising[power])
        np.multiply(falling[power - 1], rest, out=falling[power])
    weights = np.array([comb(degree, k) for k in range(degree + 1)], dtype=np.float64)
    rising *= falling[::-1]
    rising *= weights[:, None]
    return rising


def _differentiated(axis: SplineAxis, order: int) -> FloatArray:
    """(M, P, degree + 1) Bernstein coefficients of a derivative of each local basis function."""
    pieces = axis.pieces()
    for _ in range(order):
        degree = pieces.shape[1] - 1
        if degree == 0:
            return np.zeros_like(pieces)
        pieces = degree * np.diff(pieces, axis=1) / np.diff(axis.breaks)[:, None, None]
    return pieces


def _product(degree: int) -> FloatArray:
    """(P, P, 2 P − 1) products of two Bernstein polynomials in those of twice the degree."""
    product = np.zeros((degree + 1, degree + 1, 2 * degree + 1))
    for i in range(degree + 1):
        for k in range(degree + 1):
            product[i, k, i + k] = comb(degree, i) * comb(degree, k) / comb(2 * degree, i + k)
    return product
