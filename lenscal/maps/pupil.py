"""The entrance pupil of a lens map: a/d over (zoom, focus), at the irises that were measured.

The cone of light that meets the sensor has the working f-number d/a. Zoom and focus hardly change
it, where a itself may double; and a focus curve tells it without the error of D. The iris sets the
diameter of the stop, zoom and focus how large the lens shows it: ln(a/d) is a surface over (zoom,
focus) plus one number per iris. Derivation: ``docs/derivations.md``, "The entrance pupil".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from lenscal.arrays import FloatArray, frozen_array
from lenscal.calibration.pupil import SHAPE_SIGMA
from lenscal.errors import InputError, OutOfDomainError
from lenscal.maps.domain import Domain
from lenscal.maps.surface import Surfaces

#: Irises that differ by less than this share of the largest are one, read back with a little noise.
SAME_IRIS: Final = 1e-3


@dataclass(frozen=True, eq=False)
class PupilMap:
    """The aperture ratio a/d, one over the working f-number. Made by `lenscal.maps.pupil_fit`.

    Parameters
    ----------
    surface
        ln(a/d) at the first iris.
    effects
        What a unit of the logarithm at every further iris does to that surface; None for one iris.
    irises
        (K,) irises at which focus was searched, ascending; NaN alone for a lens that does not tell.
    log_ratios
        (K,) ln(a/d) less that at the first iris.
    covariance
        (K − 1, K − 1) covariance of those of the further irises.
    domain
        Settings at which it was measured.
    """

    surface: Surfaces
    effects: Surfaces | None
    irises: FloatArray
    log_ratios: FloatArray
    covariance: FloatArray
    domain: Domain

    def __post_init__(self) -> None:
        irises = frozen_array("irises", self.irises, ("K",), finite=False)
        further = len(irises) - 1
        object.__setattr__(self, "irises", irises)
        object.__setattr__(
            self, "log_ratios", frozen_array("log_ratios", self.log_ratios, (len(irises),))
        )
        object.__setattr__(
            self, "covariance", frozen_array("covariance", self.covariance, (further, further))
        )

    def aperture_ratio(
        self,
        zoom: FloatArray,
        focus: FloatArray,
        iris: npt.ArrayLike | None = None,
        *,
        outside: Literal["raise", "nan"] = "raise",
    ) -> tuple[FloatArray, FloatArray]:
        """Give a/d and its standard deviation.

        Parameters
        ----------
        zoom, focus
            (...) settings of equal shape within `domain`; NaN gives NaN.
        iris
            The iris; it broadcasts with them. None for the one that is known.
        outside
            What to do at an iris beyond those that are known: raise, or give NaN.

        Returns
        -------
        ratio, sigma : FloatArray
            (...). Between irises σ holds what is not known of the iris there: with two, all but
            that it opens steadily; with more, what a curvature as large as theirs would change.

        Raises
        ------
        InputError
            When several irises are known and none is named, or they do not broadcast.
        OutOfDomainError
            When the iris is not known.
        """
        irises = self._known(iris, outside)
        try:
            zooms, focuses, irises = np.broadcast_arrays(zoom, focus, irises)
        except ValueError as error:
            raise InputError(
                f"settings of shape {zoom.shape} and irises of shape {irises.shape} do not "
                "broadcast; give one iris per setting, or one for all"
            ) from error
        ratio, weights, doubt = self._ratio(irises)
        value = np.exp(self.surface.value(zooms, focuses)[..., 0]) * ratio
        variance = self.surface.covariance_at(zooms, focuses)[..., 0, 0]
        if self.effects is not None:
            gradient = weights[..., 1:] - self.effects.value(zooms, focuses)
            variance = variance + np.einsum("...i,ij,...j", gradient, self.covariance, gradient)
        relative = np.sqrt(variance + doubt**2 + SHAPE_SIGMA**2)
        return np.asarray(value), np.asarray(relative * value)

    def _ratio(self, iris: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Give a over that at the first iris, d ln a / d log_ratios, and what else is not known."""
        if len(self.irises) == 1:
            one = np.where(np.isnan(iris) & np.isfinite(self.irises[0]), np.nan, 1.0)
            return one, one[..., None], np.zeros(iris.shape)
        ratios = np.exp(self.log_ratios)
        ratio = np.asarray(PchipInterpolator(self.irises, ratios)(iris))
        upper = np.clip(np.searchsorted(self.irises, iris), 1, len(ratios) - 1)
        low, high = self.irises[upper - 1], self.irises[upper]
        share = ((iris - low) / (high - low))[..., None]
        below = np.arange(len(ratios)) == upper[..., None] - 1
        above = np.arange(len(ratios)) == upper[..., None]
        weights = (below * (1 - share) + above * share) * ratios / ratio[..., None]
        # In the middle between two irises any value between theirs is as good: Δ/√12 is its σ.
        step = np.abs(ratios[upper] - ratios[upper - 1])
        steadily = step * np.sqrt(share * (1 - share) / 3)[..., 0]
        if len(ratios) < 3:
            return ratio, weights, steadily / ratio
        smoothly = self._bend * (iris - low) * (high - iris) / 2
        return ratio, weights, np.minimum(steadily, smoothly) / ratio

    @cached_property
    def _bend(self) -> float:
        """The largest second derivative of a, over that at the first iris, with the iris."""
        steps, ratios = np.diff(self.irises), np.exp(self.log_ratios)
        slope = np.diff(np.eye(len(ratios)), axis=0) / steps[:, None]
        bending = np.diff(slope, axis=0) / ((steps[1:] + steps[:-1]) / 2)[:, None]
        noise = bending[:, 1:] * ratios[1:]
        variance = np.einsum("ki,ij,kj->k", noise, self.covariance, noise)
        return float(np.sqrt((bending @ ratios) ** 2 + variance).max())

    def _known(self, iris: npt.ArrayLike | None, outside: Literal["raise", "nan"]) -> FloatArray:
        """Check the irises that are asked for."""
        if iris is None:
            if len(self.irises) > 1:
                raise InputError(
                    f"the entrance pupil depends on the iris, and is known {self._which}; say at "
                    "which iris it is wanted"
                )
            return np.asarray(self.irises[0])
        asked = frozen_array("iris", iris, ("...",), finite=False)
        slack = SAME_IRIS * float(np.abs(self.irises).max())
        low, high = self.irises[0], self.irises[-1]
        known = (asked >= low - slack) & (asked <= high + slack)
        if outside == "raise" and not known.all():
            first = asked[~known].flat[0]
            raise OutOfDomainError(
                f"the entrance pupil at iris {first:g} is not known: it was measured {self._which};"
                ' search the focus at that iris too, or ask with outside="nan"',
                (float(low), float(high)),
                ~known,
            )
        return np.where(known, np.clip(asked, low, high), np.nan)

    @property
    def _which(self) -> str:
        if np.isnan(self.irises[0]):
            return "without a record of the iris (ask without one)"
        listed = ", ".join(f"{iris:g}" for iris in self.irises)
        if len(self.irises) == 1:
            return f"at iris {listed} only"
        return f"at the irises {listed}, and between them"
