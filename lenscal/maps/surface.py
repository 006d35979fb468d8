"""Smooth surfaces over the (zoom, focus) plane: penalised tensor-product splines.

Several surfaces are fitted together, because the errors of one sample's quantities are correlated.
How smooth each is along each axis is what the data make most likely (REML). Derivation:
``docs/derivations.md``, "Lens maps".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import linalg
from scipy.optimize import minimize

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import MapError
from lenscal.maps.spline_axis import SplineAxis, tensor_design
from lenscal.maps.tensor_pieces import covariance_pieces, evaluate, surface_pieces

#: Range of the logarithm of smoothing, about the value at which data and penalty weigh the same.
_SMOOTHING_RANGE: Final = (-20.0, 15.0)
#: Where the search for the smoothing starts.
_SMOOTHING_STARTS: Final = (-12.0, -6.0, 0.0)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Q surfaces over (zoom, focus) with the covariance of their coefficients.

    Parameters
    ----------
    zoom, focus
        The two axes.
    coefficients
        (K_zoom, K_focus, Q) B-spline coefficients.
    covariance
        (K_zoom · K_focus · Q) squared covariance of the coefficients, in that order.
    log_smoothing
        (Q, 2) natural logarithm of the smoothing along zoom and focus, about the neutral value.
    noise_scale
        Variance of the data over the stated one; 1 unless it had to be estimated.
    criterion
        Minus twice the restricted log-likelihood, up to a constant.
    """

    zoom: SplineAxis
    focus: SplineAxis
    coefficients: FloatArray
    covariance: FloatArray
    log_smoothing: FloatArray
    noise_scale: float = 1.0
    criterion: float = np.nan

    def __post_init__(self) -> None:
        shape = (self.zoom.size, self.focus.size, "Q")
        values = frozen_array("coefficients", self.coefficients, shape)
        object.__setattr__(self, "coefficients", values)
        for name in ("covariance", "log_smoothing"):
            array = frozen_array(name, getattr(self, name), ("N", "M"))
            object.__setattr__(self, name, array)

    @cached_property
    def _pieces(self) -> dict[tuple[int, int], FloatArray]:
        """Surfaces per cell by order of derivative, as they were needed."""
        return {}

    @cached_property
    def _covariance_pieces(self) -> dict[tuple[int, int], FloatArray]:
        """Covariance of two surfaces per cell, as they were needed."""
        return {}

    def value(
        self,
        zoom: FloatArray,
        focus: FloatArray,
        derivative: tuple[int, int] = (0, 0),
        *,
        only: Sequence[int] | None = None,
    ) -> FloatArray:
        """Evaluate surfaces or their derivatives.

        Parameters
        ----------
        zoom, focus
            (...) settings of equal shape; NaN gives NaN. Beyond the knots the outermost polynomials
            go on.
        derivative
            How often to differentiate along zoom and along focus.
        only
            Indices of the surfaces wanted; None for all Q.

        Returns
        -------
        FloatArray
            (..., Q), or as many as are wanted.
        """
        if derivative not in self._pieces:
            self._pieces[derivative] = surface_pieces(
                self.zoom, self.focus, self.coefficients, derivative
            )
        pieces = self._pieces[derivative]
        if only is not None:
            pieces = pieces[list(only)]
        values = evaluate(
            (self.zoom, self.focus), pieces, np.ravel(zoom), np.ravel(focus), continued=True
        )
        return np.moveaxis(values, 0, -1).reshape(*np.shape(zoom), len(pieces))

    def covariance_at(
        self, zoom: FloatArray, focus: FloatArray, *, only: Sequence[int] | None = None
    ) -> FloatArray:
        """Give the posterior covariance of surfaces at each setting.

        Parameters
        ----------
        zoom, focus
            (...) settings of equal shape; NaN gives NaN. Beyond the knots the values at their ends
            are kept.
        only
            Indices of the surfaces wanted; None for all Q.

        Returns
        -------
        FloatArray
            (..., Q, Q), or as many as are wanted.
        """
        chosen = range(self.coefficients.shape[2]) if only is None else only
        pairs = [(a, b) for a in range(len(chosen)) for b in range(a + 1)]
        pieces = np.concatenate([self._covariance_of(chosen[a], chosen[b]) for a, b in pairs])
        values = evaluate(
            (self.zoom, self.focus), pieces, np.ravel(zoom), np.ravel(focus), continued=False
        )
        result = np.zeros((len(chosen), len(chosen), values.shape[1]))
        for (a, b), shared in zip(pairs, values, strict=True):
            result[a, b] = result[b, a] = shared
        return np.moveaxis(result, -1, 0).reshape(*np.shape(zoom), len(chosen), len(chosen))

    def _covariance_of(self, first: int, second: int) -> FloatArray:
        """Covariance of two surfaces as polynomials per cell."""
        if (first, second) not in self._covariance_pieces:
            shape = self.coefficients.shape
            blocks = self.covariance.reshape(*shape, *shape)
            self._covariance_pieces[first, second] = covariance_pieces(
                self.zoom, self.focus, blocks[:, :, first, :, :, second]
            )
        return self._covariance_pieces[first, second]


def fit_surfaces(
    zooms: npt.ArrayLike,
    focuses: npt.ArrayLike,
    values: npt.ArrayLike,
    covariances: npt.ArrayLike,
    *,
    estimate_noise: bool = False,
    log_smoothing: npt.ArrayLike | None = None,
) -> Surfaces:
    """Fit Q surfaces to scattered samples by generalised least squares with a roughness penalty.

    Parameters
    ----------
    zooms, focuses
        (N,) settings of the samples.
    values
        (N, Q) what was measured there.
    covariances
        (N, Q, Q) its covariance, positive definite.
    estimate_noise
        Whether the covariances are known only up to a common factor, which is then estimated.
    log_smoothing
        (Q, 2) to keep a smoothing that was chosen before; None to let the data choose.

    Returns
    -------
    Surfaces
        The surfaces.

    Raises
    ------
    MapError
        When the samples are too few or lie so that they do not determine the surfaces.
    """
    zooms, focuses = (frozen_array(n, v, ("N",)) for n, v in (("zoom", zooms), ("focus", focuses)))
    measured = frozen_array("values", values, (len(zooms), "Q"))
    count = measured.shape[1]
    problem = _Problem.of(
        zooms, focuses, measured, frozen_array("covariances", covariances, ("N", count, count))
    )
    if log_smoothing is None:
        log_smoothing = problem.most_likely_smoothing(estimate_noise)
    smoothing = frozen_array("log_smoothing", log_smoothing, (count, 2))
    factor, solution, misfit = problem.solve(smoothing)
    scale = misfit / problem.degrees_of_freedom if estimate_noise else 1.0
    half = linalg.solve_triangular(factor, np.eye(len(factor)), lower=True)
    to_splines = np.kron(problem.basis, np.eye(count))
    spread = half @ to_splines.T
    axes = problem.axes
    return Surfaces(
        *axes,
        coefficients=(to_splines @ solution).reshape(axes[0].size, axes[1].size, count),
        covariance=scale * (spread.T @ spread),
        log_smoothing=smoothing,
        noise_scale=scale,
        criterion=problem.criterion(smoothing, estimate_noise),
    )


@dataclass(frozen=True, eq=False)
class _Problem:
    """Normal equations in the basis in which the penalty is diagonal."""

    axes: tuple[SplineAxis, SplineAxis]
    basis: FloatArray  # (K, K) spline coefficients of each diagonal function
    bends: FloatArray  # (2, K) roughness along zoom and along focus
    design: FloatArray  # (N, K) of the samples in that basis
    values: FloatArray  # (N, Q)
    weights: FloatArray  # (N, Q, Q) inverse covariances
    information: FloatArray  # (K·Q, K·Q) of the data
    right: FloatArray  # (K·Q,)

    @classmethod
    def of(
        cls, zooms: FloatArray, focuses: FloatArray, values: FloatArray, covariances: FloatArray
    ) -> _Problem:
        axes = SplineAxis.through(zooms), SplineAxis.through(focuses)
        (zoom_basis, zoom_bend), (focus_basis, focus_bend) = (a.roughness() for a in axes)
        basis = np.asarray(np.kron(zoom_basis, focus_basis), dtype=np.float64)
        bends = np.stack([np.repeat(zoom_bend, axes[1].size), np.tile(focus_bend, axes[0].size)])
        free = int((bends == 0).all(axis=0).sum())
        if len(zooms) < free:
            raise MapError(
                f"{len(zooms)} samples cannot determine a surface over zoom and focus; at least "
                f"{free} are needed, spread over both"
            )
        design = tensor_design(*axes, zooms, focuses) @ basis
        weights = np.asarray(np.linalg.inv(covariances), dtype=np.float64)
        size, count = design.shape[1], values.shape[1]
        information = np.einsum("nk,nl,nqr->kqlr", design, design, weights, optimize=True)
        weighted = np.einsum("nqr,nr->nq", weights, values)
        return cls(
            axes=axes,
            basis=basis,
            bends=bends,
            design=design,
            values=values,
            weights=weights,
            information=information.reshape(size * count, size * count),
            right=(design.T @ weighted).ravel(),
        )

    @property
    def samples(self) -> int:
        """Count of samples N."""
        return len(self.values)

    @property
    def count(self) -> int:
        """Count of surfaces Q."""
        return int(self.values.shape[1])

    @property
    def degrees_of_freedom(self) -> int:
        """Count of data less what no penalty holds."""
        free = int((self.bends == 0).all(axis=0).sum())
        return max(1, self.count * (self.samples - free))

    @cached_property
    def neutral(self) -> FloatArray:
        """(Q, 2) smoothing at which data and penalty weigh the same."""
        weight = np.diag(self.information).reshape(-1, self.count).sum(axis=0)
        total = self.bends.sum(axis=1)
        bend = np.where(total > 0, total, 1.0)
        ratio: FloatArray = weight[:, None] / bend
        return ratio

    def penalty(self, log_smoothing: FloatArray) -> FloatArray:
        """(K·Q,) diagonal of the penalty."""
        strength = np.exp(log_smoothing) * self.neutral
        diagonal: FloatArray = (strength @ self.bends).T.ravel()
        return diagonal

    def solve(self, log_smoothing: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Cholesky factor, solution, and the misfit with its penalty."""
        penalty = self.penalty(log_smoothing)
        normal = self.information + np.diag(penalty)
        try:
            factor = linalg.cholesky(normal, lower=True)
        except linalg.LinAlgError as error:
            raise MapError(
                f"the {self.samples} samples do not determine the surfaces: they lie on a line or "
                "in too few places; add settings that differ in zoom and in focus"
            ) from error
        solution = linalg.cho_solve((factor, True), self.right)
        residual = self.values - self.design @ solution.reshape(-1, self.count)
        misfit = np.einsum("nq,nqr,nr->", residual, self.weights, residual)
        return factor, solution, float(misfit + penalty @ solution**2)

    def criterion(self, log_smoothing: FloatArray, estimate_noise: bool) -> float:
        """Minus twice the restricted log-likelihood, up to a constant (REML)."""
        factor, _, misfit = self.solve(log_smoothing)
        penalty = self.penalty(log_smoothing)
        complexity = 2 * np.log(np.diag(factor)).sum() - np.log(penalty[penalty > 0]).sum()
        if estimate_noise:
            freedom = self.degrees_of_freedom
            return float(freedom * np.log(max(misfit, 1e-300) / freedom) + complexity)
        return float(misfit + complexity)

    def most_likely_smoothing(self, estimate_noise: bool) -> FloatArray:
        """(Q, 2) smoothing that the data make most likely."""
        # An axis that cannot bend has no smoothing to choose.
        bendable = np.tile(self.bends.any(axis=1), self.count)
        if not bendable.any():
            return np.zeros((self.count, 2))

        def full(free: FloatArray) -> FloatArray:
            everything = np.zeros(2 * self.count)
            everything[bendable] = free
            return everything.reshape(self.count, 2)

        def badness(free: FloatArray) -> float:
            return self.criterion(full(free), estimate_noise)

        size = int(bendable.sum())
        bounds = [_SMOOTHING_RANGE] * size
        fits = [
            minimize(badness, np.full(size, start), method="L-BFGS-B", bounds=bounds)
            for start in _SMOOTHING_STARTS
        ]
        return full(min(fits, key=lambda fit: float(fit.fun)).x)
