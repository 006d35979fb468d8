"""How distortion, principal point and light fall-off vary over zoom and focus: stated formulae.

Thin groups have no aberrations. What a real lens shows of them varies smoothly with the settings,
so each is a polynomial in the shares of the travel: u of zoom, w of focus, o of the iris, each 0 at
the low and 1 at the high end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.sensor import Sensor

#: How the loss of light at the corner is split between r² and r⁴.
_SQUARE_SHARE = 0.7
#: Loss stopped down over loss wide open: closing the iris cures vignetting, not cos⁴.
_STOPPED_DOWN = 0.4


@dataclass(frozen=True, slots=True)
class Imperfections:
    """What the lens does beyond Gaussian optics.

    Parameters
    ----------
    distortion_per_mm2
        (k, ku, kw) of κ1 = k + ku u + kw w.
    wander_x_px, wander_y_px
        (p, pu, puu, pw, pww) of the principal point's way from the centre of the frame,
        p + pu u + puu u² + pw w + pww w².
    corner_loss
        (q, qu, qw) of the light lost wide open at half the diagonal of the sensor,
        q + qu (1 − u)² + qw w.
    """

    distortion_per_mm2: tuple[float, float, float]
    wander_x_px: tuple[float, float, float, float, float]
    wander_y_px: tuple[float, float, float, float, float]
    corner_loss: tuple[float, float, float]

    def k1_per_mm2(self, u: float, w: float) -> float:
        """Give the distortion.

        Parameters
        ----------
        u, w
            Shares of the travel of zoom and focus.

        Returns
        -------
        float
            κ1 in mm⁻².
        """
        constant, by_zoom, by_focus = self.distortion_per_mm2
        return constant + by_zoom * u + by_focus * w

    def principal_point_shift_px(self, u: float, w: float) -> FloatArray:
        """Give the way of the principal point from the centre of the frame.

        Parameters
        ----------
        u, w
            Shares of the travel of zoom and focus.

        Returns
        -------
        FloatArray
            (2,) in px.
        """
        terms = np.array([1.0, u, u * u, w, w * w])
        return np.asarray(np.array([self.wander_x_px, self.wander_y_px]) @ terms)

    def falloff(self, u: float, w: float, o: float, sensor: Sensor) -> tuple[float, float]:
        """Give the coefficients of the relative illumination 1 + c2 r² + c4 r⁴.

        Parameters
        ----------
        u, w, o
            Shares of the travel of zoom, focus and iris; o is 1 wide open.
        sensor
            The sensor.

        Returns
        -------
        c2, c4 : float
            In mm⁻² and mm⁻⁴, r from the principal point; negative, since light is lost.
        """
        constant, wide, close = self.corner_loss
        wide_open = constant + wide * (1.0 - u) ** 2 + close * w
        loss = wide_open * (_STOPPED_DOWN + (1.0 - _STOPPED_DOWN) * o)
        corner_mm2 = (sensor.width_mm**2 + sensor.height_mm**2) / 4.0
        return -_SQUARE_SHARE * loss / corner_mm2, -(1.0 - _SQUARE_SHARE) * loss / corner_mm2**2
