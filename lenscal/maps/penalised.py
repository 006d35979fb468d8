"""Normal equations of surfaces with a roughness penalty, and what smoothing is most likely.

How rough a surface is along an axis, and by how much more so towards one of its ends, are not
known beforehand: what makes the data most likely is taken (REML). Derivation:
``docs/derivations.md``, "Lens maps".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from scipy import linalg
from scipy.optimize import minimize

from lenscal.arrays import FloatArray
from lenscal.errors import MapError
from lenscal.maps.spline_axis import SplineAxis, tensor_design

#: Range of the logarithm of smoothing, about the value at which data and penalty weigh the same.
_SMOOTHING_RANGE: Final = (-20.0, 15.0)
#: Where the search for the smoothing starts.
_SMOOTHING_STARTS: Final = (-12.0, -6.0, 0.0)
#: σ of what is believed of the roughening beforehand, and farthest that is tried.
_ROUGHENING_SIGMA: Final = 3.0
_MOST_ROUGHENING: Final = 6.0
#: Step by which the criterion is differentiated with respect to it.
_ROUGHENING_STEP: Final = 1e-3
#: Criterion of a smoothing with which the equations cannot be solved.
_HOPELESS: Final = 1e12


class Solution(NamedTuple):
    """Solution of the normal equations.

    Parameters
    ----------
    coefficients
        (K·Q,) in the basis in which the penalty is diagonal.
    half
        (K·Q, K·Q) L⁻¹ with the normal matrix L Lᵀ.
    log_determinant
        Of the normal matrix.
    misfit
        Weighted sum of squares, with the penalty.
    """

    coefficients: FloatArray
    half: FloatArray
    log_determinant: float
    misfit: float


@dataclass(frozen=True, eq=False)
class PenalisedProblem:
    """Normal equations in the bases in which the penalties are diagonal.

    Parameters
    ----------
    axes
        Zoom and focus.
    places
        (N, K) products of splines at the samples.
    values, weights
        (N, Q) what was measured, and (N, Q, Q) the inverses of its covariances.
    roughening
        (Q, 2) growth of the roughness that is expected, see `lenscal.maps.surface.Surfaces`.
    """

    axes: tuple[SplineAxis, SplineAxis]
    places: FloatArray
    values: FloatArray
    weights: FloatArray
    roughening: FloatArray

    @classmethod
    def of(
        cls,
        zooms: FloatArray,
        focuses: FloatArray,
        values: FloatArray,
        covariances: FloatArray,
        roughening: FloatArray,
    ) -> PenalisedProblem:
        """Set up the equations.

        Parameters
        ----------
        zooms, focuses
            (N,) settings.
        values, covariances
            (N, Q) and (N, Q, Q) what was measured there.
        roughening
            (Q, 2) growth of the roughness.

        Returns
        -------
        PenalisedProblem
            The problem.

        Raises
        ------
        MapError
            When the samples are fewer than the functions that no penalty holds.
        """
        axes = SplineAxis.through(zooms), SplineAxis.through(focuses)
        weights = np.asarray(np.linalg.inv(covariances), dtype=np.float64)
        problem = cls(axes, tensor_design(*axes, zooms, focuses), values, weights, roughening)
        if len(zooms) < problem.free:
            raise MapError(
                f"{len(zooms)} samples cannot determine a surface over zoom and focus; at least "
                f"{problem.free} are needed, spread over both"
            )
        return problem

    @property
    def count(self) -> int:
        """Count of surfaces Q."""
        return int(self.values.shape[1])

    @cached_property
    def _bases(self) -> tuple[FloatArray, FloatArray]:
        """(Q, K, K) spline coefficients of each diagonal function, (2, K, Q) their roughness."""
        bases, bends = [], []
        for growth in self.roughening:
            (zoom, zoom_bend), (focus, focus_bend) = (
                axis.roughness(float(g)) for axis, g in zip(self.axes, growth, strict=True)
            )
            bases.append(np.kron(zoom, focus))
            bends.append(
                [np.repeat(zoom_bend, len(focus_bend)), np.tile(focus_bend, len(zoom_bend))]
            )
        return np.array(bases), np.moveaxis(np.array(bends), 0, -1)

    @cached_property
    def _equations(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(Q, N, K) designs, (K·Q, K·Q) information and (K·Q,) right side of the data."""
        designs = np.asarray(self.places @ self._bases[0])
        count, _, size = designs.shape
        information = np.zeros((size, count, size, count))
        for q in range(count):
            for r in range(q + 1):
                block = designs[q].T @ (self.weights[:, q, r, None] * designs[r])
                information[:, q, :, r] = block
                information[:, r, :, q] = block.T
        weighted = np.einsum("nqr,nr->nq", self.weights, self.values)
        right = np.einsum("qnk,nq->kq", designs, weighted)
        return designs, information.reshape(size * count, size * count), right.ravel()

    @cached_property
    def free(self) -> int:
        """Count of functions of a surface that no penalty holds."""
        return int((self._bases[1][:, :, 0] == 0).all(axis=0).sum())

    @property
    def degrees_of_freedom(self) -> int:
        """Count of data less what no penalty holds."""
        return max(1, self.count * (len(self.values) - self.free))

    @property
    def bendable(self) -> tuple[bool, bool]:
        """Whether there is roughness along zoom and along focus."""
        zoom, focus = self._bases[1]
        return bool(zoom.any()), bool(focus.any())

    @cached_property
    def _scaled_bends(self) -> FloatArray:
        """(2, K, Q) roughness times the smoothing at which data and penalty weigh the same."""
        bends = self._bases[1]
        weight = np.diag(self._equations[1]).reshape(-1, self.count).sum(axis=0)
        total = bends.sum(axis=1)
        return np.asarray(bends * (weight / np.where(total > 0, total, 1.0))[:, None, :])

    def penalties(self, log_smoothing: FloatArray) -> FloatArray:
        """Give the diagonals of the penalties.

        Parameters
        ----------
        log_smoothing
            (Q, 2) natural logarithm of the smoothing, about the neutral one.

        Returns
        -------
        FloatArray
            (2, K, Q) along zoom and along focus; their sum counts.
        """
        return np.asarray(np.exp(log_smoothing).T[:, None, :] * self._scaled_bends)

    def solve(self, log_smoothing: FloatArray) -> Solution:
        """Solve the equations.

        Parameters
        ----------
        log_smoothing
            (Q, 2) natural logarithm of the smoothing.

        Returns
        -------
        Solution
            The solution.

        Raises
        ------
        MapError
            When the samples do not determine the surfaces.
        """
        designs, information, right = self._equations
        penalty = self.penalties(log_smoothing).sum(axis=0).ravel()
        try:
            factor = linalg.cholesky(information + np.diag(penalty), lower=True)
        except linalg.LinAlgError as error:
            raise MapError(
                f"the {len(self.values)} samples do not determine the surfaces: they lie on a line "
                "or in too few places; add settings that differ in zoom and in focus"
            ) from error
        half = np.asarray(linalg.lapack.dtrtri(factor, lower=1)[0])
        solution = half.T @ (half @ right)
        fitted = np.einsum("qnk,kq->nq", designs, solution.reshape(-1, self.count))
        residual = self.values - fitted
        misfit = np.einsum("nq,nqr,nr->", residual, self.weights, residual)
        return Solution(
            solution,
            half,
            float(2 * np.log(np.diag(factor)).sum()),
            float(misfit + penalty @ solution**2),
        )

    def of_splines(self, solution: Solution) -> tuple[FloatArray, FloatArray]:
        """Turn a solution into coefficients of splines.

        Parameters
        ----------
        solution
            What `solve` gave.

        Returns
        -------
        coefficients, covariance : FloatArray
            (K, Q) and (K·Q, K·Q).
        """
        bases = self._bases[0]
        count, size, _ = bases.shape
        coefficients = np.einsum("qjk,kq->jq", bases, solution.coefficients.reshape(size, count))
        half = solution.half.reshape(-1, size, count)
        spread = np.einsum("mkq,qjk->mjq", half, bases, optimize=True).reshape(len(half), -1)
        return coefficients, spread.T @ spread

    def criterion(
        self, log_smoothing: FloatArray, estimate_noise: bool
    ) -> tuple[float, FloatArray]:
        """Minus twice the restricted log-likelihood (REML), and its slope.

        Parameters
        ----------
        log_smoothing
            (Q, 2) natural logarithm of the smoothing.
        estimate_noise
            Whether the covariances are known only up to a common factor.

        Returns
        -------
        value : float
            Up to a constant.
        slope : FloatArray
            (Q, 2) by the logarithm of the smoothing.
        """
        found = self.solve(log_smoothing)
        penalties = self.penalties(log_smoothing)
        both = penalties.sum(axis=0)
        held = both > 0
        complexity = found.log_determinant - np.log(both[held]).sum()
        value, gain = found.misfit + complexity, 1.0
        if estimate_noise:
            freedom, misfit = self.degrees_of_freedom, max(found.misfit, 1e-300)
            value, gain = freedom * np.log(misfit / freedom) + complexity, freedom / misfit
        squares = gain * found.coefficients**2 + np.einsum("mk,mk->k", found.half, found.half)
        slopes = squares.reshape(both.shape) - np.where(held, 1 / np.where(held, both, 1.0), 0.0)
        return float(value), np.einsum("akq,kq->qa", penalties, slopes)


def most_likely(
    problem: PenalisedProblem, estimate_noise: bool, roughening_free: bool
) -> tuple[PenalisedProblem, FloatArray]:
    """Find the smoothing, and the roughening if wanted, that the data make most likely.

    Parameters
    ----------
    problem
        The problem, with the roughening to begin with.
    estimate_noise
        Whether the covariances are known only up to a common factor.
    roughening_free
        Whether the roughening is looked for as well.

    Returns
    -------
    problem : PenalisedProblem
        With the roughening found.
    log_smoothing : FloatArray
        (Q, 2).
    """
    count = problem.count
    # An axis that cannot bend has no smoothing to choose.
    bendable = np.tile(problem.bendable, count)
    if not bendable.any():
        return problem, np.zeros((count, 2))
    size = int(bendable.sum())

    def full(free: FloatArray) -> FloatArray:
        everything = np.zeros(2 * count)
        everything[bendable] = free
        return everything.reshape(count, 2)

    def at(free: FloatArray) -> PenalisedProblem:
        return replace(problem, roughening=full(free[size:])) if roughening_free else problem

    def badness(free: FloatArray) -> tuple[float, FloatArray]:
        try:
            here = at(free)
            value, slope = here.criterion(full(free[:size]), estimate_noise)
            along = slope.ravel()[bendable]
            if not roughening_free:
                return value, along
            ahead = [
                at(free + _ROUGHENING_STEP * e).criterion(full(free[:size]), estimate_noise)[0]
                for e in np.eye(2 * size)[size:]
            ]
        except MapError:
            return _HOPELESS, np.zeros(len(free))
        growth = free[size:] / _ROUGHENING_SIGMA
        across = (np.array(ahead) - value) / _ROUGHENING_STEP + 2 * growth / _ROUGHENING_SIGMA
        return value + float(growth @ growth), np.concatenate([along, across])

    bounds = [_SMOOTHING_RANGE] * size
    starts = [np.full(size, start) for start in _SMOOTHING_STARTS]
    if roughening_free:
        # Equal roughness is quickly found, and a good place to begin.
        _, equal = most_likely(problem, estimate_noise, roughening_free=False)
        starts = [np.concatenate([part.ravel()[bendable] for part in (equal, problem.roughening)])]
        bounds += [(-_MOST_ROUGHENING, _MOST_ROUGHENING)] * size
    fits = [
        minimize(badness, start, jac=True, method="L-BFGS-B", bounds=bounds) for start in starts
    ]
    best = np.asarray(min(fits, key=lambda fit: float(fit.fun)).x)
    return at(best), full(best[:size])
