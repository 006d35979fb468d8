"""The band of focus settings that was sampled at each zoom, as a coordinate.

A lens that is not parfocal images finite distances over a part of its focus travel only, and which
part depends on the zoom. Over (zoom, focus) such samples lie along a bent strip, most of the
rectangle around it is empty, and products of splines in zoom and focus have nothing to hold on to.
Counted across the strip, every zoom is sampled from 0 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import Final

import numpy as np
from scipy.interpolate import BSpline, PPoly, make_interp_spline

from lenscal.arrays import FloatArray

#: Zoom settings closer than this share of their range are one, read back with a little noise.
_SAME_ZOOM: Final = 1e-3
#: Degrees that are tried for the ends of the band; an odd one through all of them.
_DEGREES: Final = (5, 3, 1)
#: Narrowest the band may become between its samples, over the narrowest that was sampled.
_NARROWEST: Final = 0.5
#: How far beyond the sampled band the coordinate goes on, over the width of the band.
BEYOND: Final = 0.05


@dataclass(frozen=True, eq=False)
class Strip:
    """Focus counted across the band that was sampled at each zoom.

    Parameters
    ----------
    ends
        Spline of (low, high) focus over the zoom; None where focus itself is the coordinate.
    """

    ends: BSpline | None = None

    @classmethod
    def through(cls, zooms: FloatArray, focuses: FloatArray) -> Strip:
        """Find out whether each zoom was sampled at focus settings of its own.

        Parameters
        ----------
        zooms, focuses
            (N,) settings of the samples.

        Returns
        -------
        Strip
            Through the lowest and the highest focus of each zoom; focus itself when the zooms share
            their focus settings, or have fewer than two each.
        """
        order = np.argsort(zooms, kind="stable")
        gaps = np.diff(zooms[order]) > _SAME_ZOOM * np.ptp(zooms)
        groups = np.split(order, np.flatnonzero(gaps) + 1)
        bands = [np.sort(focuses[group]) for group in groups]
        shared = len(np.unique(focuses)) < 2 * max(len(band) for band in bands)
        if shared or len(groups) < 2 or min(float(np.ptp(band)) for band in bands) <= 0:
            return cls()
        middles = np.array([zooms[group].mean() for group in groups])
        limits = np.array([[band[0], band[-1]] for band in bands])
        between = np.linspace(middles[0], middles[-1], 20 * len(middles))
        for degree in (d for d in _DEGREES if d < len(middles)):
            ends = make_interp_spline(middles, limits, degree)
            widths = np.diff(ends(between), axis=1)
            if widths.min() >= _NARROWEST * np.diff(limits, axis=1).min():
                break
        return cls(ends)

    def across(self, zoom: FloatArray, focus: FloatArray) -> FloatArray:
        """Count focus across the band.

        Parameters
        ----------
        zoom, focus
            (...) settings of equal shape.

        Returns
        -------
        FloatArray
            (...) 0 at the low and 1 at the high end; focus itself where that is the coordinate.
        """
        if self._band is None:
            return focus
        low, width = np.moveaxis(self._band(zoom), -1, 0)
        share = np.asarray((focus - low) / width)
        return np.clip(share, -BEYOND, 1 + BEYOND, out=share)

    def slopes(self, zoom: FloatArray, focus: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Differentiate the coordinate with respect to zoom and focus.

        Parameters
        ----------
        zoom, focus
            (...) settings of equal shape.

        Returns
        -------
        along_zoom, along_focus : FloatArray
            (...) each.
        """
        if self._band is None:
            return np.zeros(zoom.shape), np.ones(zoom.shape)
        low, width = np.moveaxis(self._band(zoom), -1, 0)
        low_slope, width_slope = np.moveaxis(self._band(zoom, 1), -1, 0)
        share = (focus - low) / width
        return -(low_slope + share * width_slope) / width, 1 / width

    @cached_property
    def _band(self) -> PPoly | None:
        """Low end and width of the band over the zoom, as polynomials between knots: quick."""
        if self.ends is None:
            return None
        borders = np.unique(self.ends.t)
        orders = range(self.ends.k, -1, -1)
        terms = np.stack([self.ends(borders[:-1], order) / factorial(order) for order in orders])
        terms[..., 1] -= terms[..., 0]
        return PPoly(terms, borders)
