"""The sharpest place of a focus curve: its fit, its uncertainty, and whether there is a peak.

The blur of a plane at distance z is a·d·|1/z − 1/D|, so the squared width of an edge is a parabola
in 1/z whose vertex is 1/D. What moves is known as a position x, such as the standoff, and z is x
plus an unknown constant. With κ = 1/z in the middle of the curve, where x is taken as zero, the
variable t = x / (1 + κ x) is linear in 1/z and has the unit of x. κ is how fast the image of the
disk shrinks: one over its size is linear in x. κ = 0 makes t = x.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import FocusError

#: A curve that falls by less than this towards a side has no clear peak on that side.
_LEAST_FALL: Final = 0.15
#: The curvature of a peak is at least so many times its σ.
_LEAST_SIGNIFICANCE: Final = 4.0
#: A vergence is believed when its σ is below this share of one over the position.
_VERGENCE_TRUST: Final = 0.5


class Verdict(enum.Enum):
    """What a focus curve shows."""

    CLEAR = "a clear peak"
    FLAT = "no clear peak"
    BELOW = "a peak at its low end or beyond"
    ABOVE = "a peak at its high end or beyond"


@dataclass(frozen=True, slots=True, eq=False)
class PeakFit:
    """A parabola fitted to the squared edge width of a focus curve.

    Parameters
    ----------
    position
        Of the peak: mm of standoff, or units of the lens controller.
    sigma
        Its standard deviation from the scatter about the fit and from that of κ.
    middle
        Position at which x is zero.
    vergence
        κ there.
    coefficients
        (3,) of the squared width as a polynomial of t, constant first.
    width_power
        Of the measure.
    """

    position: float
    sigma: float
    middle: float
    vergence: float
    coefficients: FloatArray
    width_power: float

    @property
    def reach(self) -> float:
        """Way from the peak over which the squared edge width doubles."""
        constant, slope, bend = self.coefficients
        least = max(float(constant - slope**2 / (4 * bend)), 0.0)
        return float(np.sqrt(least / bend))

    def sharpness(self, positions: FloatArray) -> FloatArray:
        """Compute the fitted curve.

        Parameters
        ----------
        positions
            (...) positions.

        Returns
        -------
        FloatArray
            (...) sharpness; NaN where the parabola is not positive.
        """
        t = _linearised(positions - self.middle, self.vergence)
        squared_width = np.polynomial.polynomial.polyval(t, self.coefficients)
        positive = np.where(squared_width > 0, squared_width, np.nan)
        curve: FloatArray = positive ** (-self.width_power / 2)
        return curve


def judge(sharpness: FloatArray) -> Verdict:
    """Tell whether a focus curve has a clear peak.

    Parameters
    ----------
    sharpness
        (N,) along the sweep; NaN where there was nothing to measure, which counts as not sharp.

    Returns
    -------
    Verdict
        Clear when the curve falls by 15 % at least to both sides of its peak.
    """
    scores = np.nan_to_num(sharpness)
    best = int(scores.argmax())
    if scores[best] <= 0:
        return Verdict.FLAT
    falls_below = 1 - scores[: best + 1].min() / scores[best] >= _LEAST_FALL
    falls_above = 1 - scores[best:].min() / scores[best] >= _LEAST_FALL
    if falls_below and falls_above:
        return Verdict.CLEAR
    if not falls_below and not falls_above:
        return Verdict.FLAT
    return Verdict.ABOVE if falls_below else Verdict.BELOW


def confidence(sharpness: FloatArray) -> float:
    """Tell how far a curve falls from its peak to its higher end.

    Parameters
    ----------
    sharpness
        (N,) along the sweep; NaN counts as not sharp.

    Returns
    -------
    float
        0 for a peak at an end or a flat curve, towards 1 for a high one.
    """
    scores = np.nan_to_num(sharpness)
    peak = float(scores.max())
    return float(1 - max(scores[0], scores[-1]) / peak) if peak > 0 else 0.0


def vergence_from_growth(
    positions: FloatArray, sizes: FloatArray, at: float
) -> tuple[float, float]:
    """Estimate 1/z from how the image of the disk shrinks as the camera moves away.

    Parameters
    ----------
    positions
        (N,) standoffs in mm.
    sizes
        (N,) sizes of the image, in any unit; NaN where it was not found.
    at
        Standoff at which 1/z is wanted.

    Returns
    -------
    vergence, sigma : float
        κ = 1/z there and its σ in 1/mm. Where the growth does not tell, the projection centre is
        taken to be the reference one, 1/`at`, give or take as much.
    """
    found = np.isfinite(sizes)
    if found.sum() > 3:
        x, inverse_size = positions[found] - at, 1 / sizes[found]
        design = np.stack([np.ones_like(x), x], axis=-1)
        (level, slope), *_ = np.linalg.lstsq(design, inverse_size)
        residual = inverse_size - design @ (level, slope)
        variance = float(residual @ residual) / (len(x) - 2)
        gradient = np.array([-slope / level**2, 1 / level])
        covariance = variance * np.linalg.inv(design.T @ design)
        sigma = float(np.sqrt(gradient @ covariance @ gradient))
        if sigma < _VERGENCE_TRUST / at and slope / level > 0:
            return float(slope / level), sigma
    return 1 / at, 1 / at


def fit_peak(
    positions: FloatArray,
    sharpness: FloatArray,
    *,
    vergence: tuple[float, float] = (0.0, 0.0),
    width_power: float = 1.0,
) -> PeakFit:
    """Fit the vertex of a focus curve.

    Parameters
    ----------
    positions
        (N,) where the pictures were taken, N at least 5.
    sharpness
        (N,) found there, positive.
    vergence
        κ in the middle of the positions, per unit of position, and its σ.
    width_power
        Power of one over the edge width that the measure goes with.

    Returns
    -------
    PeakFit
        The peak.

    Raises
    ------
    FocusError
        When there are too few points, or the curve has no peak within the positions.
    """
    if len(positions) < 5:
        raise FocusError(
            f"a focus curve needs five pictures with a measurable disk, but has {len(positions)}; "
            "search around the sharp distance, or take a larger disk"
        )
    kappa, sigma_kappa = vergence
    middle = float(positions.mean())
    squared_width = sharpness ** (-2.0 / width_power)
    vertex, sigma, coefficients = _vertex(positions - middle, squared_width, kappa)
    if not np.isfinite(sigma) or abs(vertex) > np.abs(positions - middle).max():
        raise FocusError(
            f"the focus curve has no peak between {positions.min():.1f} and {positions.max():.1f}; "
            "open the iris or search a longer range"
        )
    # What another κ would have given, one σ of it away.
    moved, _, _ = _vertex(positions - middle, squared_width, kappa + sigma_kappa)
    return PeakFit(
        middle + vertex,
        float(np.hypot(sigma, moved - vertex)),
        middle,
        kappa,
        coefficients,
        width_power,
    )


def _linearised(x: FloatArray, vergence: float) -> FloatArray:
    t: FloatArray = x / (1 + vergence * x)
    return t


def _vertex(
    x: FloatArray, squared_width: FloatArray, vergence: float
) -> tuple[float, float, FloatArray]:
    """Fit the parabola: vertex and its σ in x, infinite without a vertex, and coefficients in t."""
    t = _linearised(x, vergence)
    # Relative errors are alike all along the curve, so a width weighs by its reciprocal.
    design = np.stack([np.ones_like(t), t, t**2], axis=-1) / squared_width[:, None]
    target = np.ones_like(t)
    coefficients: FloatArray = np.linalg.lstsq(design, target)[0].astype(np.float64)
    residual = target - design @ coefficients
    variance = float(residual @ residual) / max(1, len(t) - 3)
    covariance = variance * np.linalg.inv(design.T @ design)
    _, slope, bend = coefficients
    if bend <= _LEAST_SIGNIFICANCE * np.sqrt(covariance[2, 2]):
        return np.inf, np.inf, coefficients
    vertex = -slope / (2 * bend)
    gradient = np.array([0.0, -1 / (2 * bend), slope / (2 * bend**2)])
    sigma = float(np.sqrt(gradient @ covariance @ gradient))
    stretch = 1 - vergence * vertex  # x = t / (1 − κ t)
    return float(vertex / stretch), float(sigma / stretch**2), coefficients
