"""Smooth surfaces over the (zoom, focus) plane: penalised tensor-product splines.

Several surfaces are fitted together, because the errors of one sample's quantities are correlated.
How smooth each is along each axis is what the data make most likely (REML). Derivation:
``docs/derivations.md``, "Lens maps".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.maps.penalised import PenalisedProblem, most_likely
from lenscal.maps.spline_axis import SplineAxis
from lenscal.maps.tensor_pieces import covariance_pieces, evaluate, surface_pieces


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
    roughening
        (Q, 2) by how much the logarithm of the roughness that was expected grows along zoom and
        along focus, from one end to the other; empty for none.
    """

    zoom: SplineAxis
    focus: SplineAxis
    coefficients: FloatArray
    covariance: FloatArray
    log_smoothing: FloatArray
    noise_scale: float = 1.0
    criterion: float = np.nan
    roughening: FloatArray = ()  # type: ignore[assignment]

    def __post_init__(self) -> None:
        shape = (self.zoom.size, self.focus.size, "Q")
        values = frozen_array("coefficients", self.coefficients, shape)
        object.__setattr__(self, "coefficients", values)
        if not np.size(self.roughening):
            object.__setattr__(self, "roughening", np.zeros_like(self.log_smoothing))
        for name in ("covariance", "log_smoothing", "roughening"):
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
        # Each surface stays in one piece of memory.
        return np.moveaxis(values.reshape(len(pieces), *np.shape(zoom)), 0, -1)

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
        return np.moveaxis(result.reshape(*result.shape[:2], *np.shape(zoom)), (0, 1), (-2, -1))

    def with_covariance(
        self, zoom: FloatArray, focus: FloatArray, *, only: Sequence[int] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Evaluate surfaces and their posterior covariance.

        Parameters
        ----------
        zoom, focus
            (...) settings of equal shape; NaN gives NaN.
        only
            Indices of the surfaces wanted; None for all Q.

        Returns
        -------
        values, covariance : FloatArray
            As `value` and `covariance_at`.
        """
        return self.value(zoom, focus, only=only), self.covariance_at(zoom, focus, only=only)

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
    roughening: npt.ArrayLike | None = None,
    roughening_free: bool = False,
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
    roughening
        (Q, 2) see `Surfaces`; None for the same roughness everywhere.
    roughening_free
        Whether the data choose that as well, beginning from what was given.

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
    spread = frozen_array("covariances", covariances, (len(zooms), count, count))
    growth = np.zeros((count, 2)) if roughening is None else roughening
    problem = PenalisedProblem.of(
        zooms, focuses, measured, spread, frozen_array("roughening", growth, (count, 2))
    )
    if log_smoothing is None:
        problem, log_smoothing = most_likely(problem, estimate_noise, roughening_free)
    smoothing = frozen_array("log_smoothing", log_smoothing, (count, 2))
    solution = problem.solve(smoothing)
    scale = solution.misfit / problem.degrees_of_freedom if estimate_noise else 1.0
    coefficients, covariance = problem.of_splines(solution)
    axes = problem.axes
    return Surfaces(
        *axes,
        coefficients=coefficients.reshape(axes[0].size, axes[1].size, count),
        covariance=scale * covariance,
        log_smoothing=smoothing,
        noise_scale=scale,
        criterion=problem.criterion(smoothing, estimate_noise)[0],
        roughening=problem.roughening,
    )
