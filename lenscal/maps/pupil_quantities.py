"""The entrance pupil as methods of a lens map: its diameter a = d · (a/d), and σ of that."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.errors import MapError
from lenscal.maps.domain import Domain
from lenscal.maps.evaluation import Outside, supported
from lenscal.maps.named_quantities import NamedQuantities
from lenscal.maps.pupil import PupilMap


class PupilQuantities(NamedQuantities, Protocol):
    """Diameter of the entrance pupil, for whatever knows d and the aperture ratio a/d.

    Parameters
    ----------
    domain
        Where d may be asked for.
    pupil
        The aperture ratio, or None where it is not known.
    """

    domain: Domain
    pupil: PupilMap | None

    def sigma(
        self,
        quantity: str,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        *,
        outside: Outside = "raise",
    ) -> FloatArray:
        """Give the standard deviation of a quantity.

        Parameters
        ----------
        quantity
            Its name.
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            1 σ in the unit of the quantity, of the broadcast shape.
        """
        ...

    def entrance_pupil_diameter_mm(
        self,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        iris: npt.ArrayLike | None = None,
        *,
        outside: Outside = "raise",
    ) -> FloatArray:
        """Give the diameter a of the entrance pupil; blur is a · d · |1/z − 1/D|.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        iris
            The iris, of those at which the autofocus was made or between them; it broadcasts with
            the settings. None where only one is known.
        outside
            What to do beyond the domain, or at an iris that is not known: raise, or give NaN there.

        Returns
        -------
        FloatArray
            a in mm, of the broadcast shape.

        Raises
        ------
        MapError
            When no sample tells the entrance pupil.
        InputError
            When several irises are known and none is named.
        OutOfDomainError
            When a setting lies outside, or the iris is not known.
        """
        return self._pupil(zoom, focus, iris, outside)[0]

    def sigma_entrance_pupil_diameter_mm(
        self,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        iris: npt.ArrayLike | None = None,
        *,
        outside: Outside = "raise",
    ) -> FloatArray:
        """Give the standard deviation of the diameter of the entrance pupil.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        iris
            The iris, of those at which the autofocus was made or between them; it broadcasts with
            the settings. None where only one is known.
        outside
            What to do beyond the domain, or at an iris that is not known: raise, or give NaN there.

        Returns
        -------
        FloatArray
            1 σ in mm, of the broadcast shape.

        Raises
        ------
        MapError
            When no sample tells the entrance pupil.
        InputError
            When several irises are known and none is named.
        OutOfDomainError
            When a setting lies outside, or the iris is not known.
        """
        return self._pupil(zoom, focus, iris, outside)[1]

    def _pupil(
        self,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        iris: npt.ArrayLike | None,
        outside: Outside,
    ) -> tuple[FloatArray, FloatArray]:
        """Give a = d · (a/d) and its σ."""
        if self.pupil is None:
            raise MapError(
                "this map has no entrance pupil: no focus curve of its samples tells it; record a "
                "session whose autofocus measures by edge_width and calibrate it anew"
            )
        settings = supported(self.domain, zoom, focus, outside)
        settings = supported(self.pupil.domain, *settings, outside)
        ratio, sigma = self.pupil.aperture_ratio(*settings, iris, outside=outside)
        distance = self.image_distance_mm(*settings, outside="nan")
        doubt = self.sigma("image_distance_mm", *settings, outside="nan")
        # a/d knows nothing of the error of d, see docs/derivations.md.
        return distance * ratio, np.hypot(distance * sigma, doubt * ratio)
