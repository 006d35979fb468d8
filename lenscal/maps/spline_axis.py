"""Spline bases along one motor, and their products over both."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import linalg
from scipy.interpolate import BSpline

from lenscal.arrays import FloatArray, IntArray

#: Distinct values along an axis, and samples in all, from which a third derivative is worth having.
_SMOOTH_VALUES: Final = 7
_SMOOTH_SAMPLES: Final = 36
#: Share of the range by which values may differ and are still one.
_ROUNDING: Final = 1e-6
#: More knot intervals than this per axis serve no lens and cost time.
_MOST_INTERVALS: Final = 24

#: Intervals, or cells, are few: short integers are counted and sorted fast.
Intervals = npt.NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class SplineAxis:
    """A spline basis along one motor.

    Parameters
    ----------
    knots
        (K + degree + 1,) knots in controller units, ends repeated.
    degree
        Degree of the pieces, at most 5; 0 means that the axis has one sampled value only.
    """

    knots: FloatArray
    degree: int

    @classmethod
    def through(cls, values: FloatArray) -> SplineAxis:
        """Make a basis that can follow the sampled values, with knots among them.

        Parameters
        ----------
        values
            (N,) sampled settings, in any order, repeated or not.

        Returns
        -------
        SplineAxis
            Cubic from four different values on, lower below; quintic where samples are many.
        """
        unique = np.unique(values)
        # What differs by rounding is one value.
        apart = np.diff(unique, prepend=-np.inf) > _ROUNDING * np.ptp(values)
        unique = unique[apart | (len(unique) == 1)]
        if len(unique) == 1:
            return cls(np.array([unique[0] - 0.5, unique[0] + 0.5]), 0)
        many = len(unique) >= _SMOOTH_VALUES and len(values) >= _SMOOTH_SAMPLES
        degree = 5 if many else min(3, len(unique) - 1)
        breaks = unique
        if len(unique) - 1 > _MOST_INTERVALS:
            breaks = np.quantile(unique, np.linspace(0, 1, _MOST_INTERVALS + 1))
        return cls(np.concatenate([[breaks[0]] * degree, breaks, [breaks[-1]] * degree]), degree)

    @property
    def size(self) -> int:
        """Count of basis functions K."""
        return len(self.knots) - self.degree - 1

    @property
    def penalised_derivative(self) -> int:
        """Which derivative is roughness: the second, and the third of quintics."""
        return 3 if self.degree == 5 else 2

    @property
    def ends(self) -> tuple[float, float]:
        """First and last sampled value."""
        if self.degree == 0:
            middle = float(self.knots.mean())
            return middle, middle
        return float(self.knots[0]), float(self.knots[-1])

    def design(self, values: FloatArray) -> FloatArray:
        """Evaluate all basis functions.

        Parameters
        ----------
        values
            (N,) settings within the ends.

        Returns
        -------
        FloatArray
            (N, K).
        """
        inside = np.clip(values, self.knots[0], self.knots[-1])
        matrix: FloatArray = BSpline.design_matrix(inside, self.knots, self.degree).toarray()
        return matrix

    @cached_property
    def breaks(self) -> FloatArray:
        """(M + 1,) borders of the M intervals between different knots."""
        return np.unique(self.knots)

    @cached_property
    def widths(self) -> FloatArray:
        """(M,) widths of the intervals."""
        return np.diff(self.breaks)

    def supports(self) -> IntArray:
        """(M, degree + 1) indices of the basis functions that are not zero on each interval."""
        last = np.searchsorted(self.knots, self.breaks[:-1], side="right") - 1
        return np.asarray(last[:, None] + np.arange(-self.degree, 1), dtype=np.int64)

    def pieces(self) -> FloatArray:
        """Give the basis functions as polynomials on each interval.

        Returns
        -------
        FloatArray
            (M, degree + 1, degree + 1) coefficients of t^k (1 − t)^(degree − k) on each interval,
            t being the place, of the basis functions that `supports` names, last.
        """
        nodes = np.linspace(0, 1, self.degree + 1) if self.degree else np.array([0.5])
        where = self.breaks[:-1, None] + self.widths[:, None] * nodes
        values = self.design(where.ravel()).reshape(*where.shape, self.size)
        local = np.take_along_axis(values, self.supports()[:, None, :], axis=2)
        power = np.arange(self.degree + 1)
        at_nodes = nodes[:, None] ** power * (1 - nodes[:, None]) ** power[::-1]
        return np.asarray(np.linalg.solve(at_nodes, local))

    def interval(self, values: FloatArray) -> Intervals:
        """Find the interval of each setting.

        Parameters
        ----------
        values
            (N,) settings; those beyond the ends belong to the outermost intervals.

        Returns
        -------
        Intervals
            (N,) 0 to M − 1.
        """
        # So few borders are compared one by one in a tenth of the time that a search takes.
        found = np.zeros(values.shape, dtype=np.uint16)
        for border in self.breaks[1:-1]:
            found += values >= border
        return found

    def place(
        self, values: FloatArray, interval: Intervals | int, *, continued: bool
    ) -> FloatArray:
        """Find the place of each setting within its interval.

        Parameters
        ----------
        values
            (N,) settings.
        interval
            (N,) that of each, or the one of all.
        continued
            Whether a place may lie beyond its interval; else it is that of the nearest end.

        Returns
        -------
        FloatArray
            (N,) 0 to 1 over the interval, NaN for NaN.
        """
        place = (values - self.breaks[interval]) / self.widths[interval]
        return place if continued else np.clip(place, 0.0, 1.0)

    def roughness(self, roughening: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Diagonalise the integral of the squared derivative that is penalised.

        Parameters
        ----------
        roughening
            By how much the logarithm of the derivative that is to be expected grows from one end
            of the axis to the other: where more is expected, the same costs less.

        Returns
        -------
        basis : FloatArray
            (K, K) whose columns are orthonormal functions over the axis, scaled to unit length.
        eigenvalues : FloatArray
            (K,) roughness of each column, ascending; 0 for polynomials that the penalty spares.
        """
        order = self.penalised_derivative
        if self.degree < order:
            return np.eye(self.size), np.zeros(self.size)
        half_values, bends, place = self._sampled
        expected = np.exp(roughening * (place - 0.5))
        # Singular values keep the small ones apart from the rounding of the large ones.
        to_unit = np.linalg.inv(np.linalg.cholesky(half_values.T @ half_values)).T
        _, values, rotation = linalg.svd(bends / expected[:, None] @ to_unit, full_matrices=False)
        eigenvalues = values[::-1] ** 2
        eigenvalues[:order] = 0.0
        return np.asarray(to_unit @ rotation[::-1].T), np.asarray(eigenvalues)

    @cached_property
    def _sampled(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Basis and its penalised derivative at the nodes of an integral, weighted; the nodes."""
        order = self.penalised_derivative
        span = self.knots[-1] - self.knots[0]
        nodes, weights = np.polynomial.legendre.leggauss(self.degree + 1)
        breaks = np.unique(self.knots)
        half = np.diff(breaks)[:, None] / 2
        where = (breaks[:-1, None] + half * (nodes + 1)).ravel()
        root = np.sqrt((half * weights).ravel() / span)[:, None]
        splines = BSpline(self.knots, np.eye(self.size), self.degree)
        bends = span**order * splines.derivative(order)(where)
        return root * self.design(where), root * bends, (where - self.knots[0]) / span


def tensor_design(
    zoom: SplineAxis, focus: SplineAxis, zooms: FloatArray, focuses: FloatArray
) -> FloatArray:
    """Evaluate all products of basis functions.

    Parameters
    ----------
    zoom, focus
        The axes.
    zooms, focuses
        (N,) settings.

    Returns
    -------
    FloatArray
        (N, K_zoom · K_focus).
    """
    product = zoom.design(zooms)[:, :, None] * focus.design(focuses)[:, None, :]
    return product.reshape(len(zooms), -1)
