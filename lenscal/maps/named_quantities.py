"""The quantities of a lens map as methods that bear their names."""

from __future__ import annotations

from typing import Protocol

import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.maps.evaluation import Outside


class NamedQuantities(Protocol):
    """A method for each of the paper's quantities, for whatever can give a quantity by its name."""

    def value(
        self,
        quantity: str,
        zoom: npt.ArrayLike,
        focus: npt.ArrayLike,
        *,
        outside: Outside = "raise",
    ) -> FloatArray:
        """Give any quantity by its name.

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
            Of the broadcast shape.
        """
        ...

    def magnification(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the magnification ratio d/D.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            d/D, of the broadcast shape.
        """
        return self.value("magnification", zoom, focus, outside=outside)

    def object_distance_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the object distance D = g1(z_s, f_s), (5a).

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            D in mm, of the broadcast shape.
        """
        return self.value("object_distance_mm", zoom, focus, outside=outside)

    def image_distance_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the image distance d = g2(z_s, f_s), (5b).

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            d in mm, of the broadcast shape.
        """
        return self.value("image_distance_mm", zoom, focus, outside=outside)

    def focal_length_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the focal length f = g3(z_s, f_s), (5c), of 1/f = 1/D + 1/d.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            f in mm, of the broadcast shape.
        """
        return self.value("focal_length_mm", zoom, focus, outside=outside)

    def nodal_offset_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give how far the projection centre lies behind that of the reference setting.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            The offset in mm, of the broadcast shape.
        """
        return self.value("nodal_offset_mm", zoom, focus, outside=outside)

    def standoff_mm(
        self, zoom: npt.ArrayLike, focus: npt.ArrayLike, *, outside: Outside = "raise"
    ) -> FloatArray:
        """Give the distance from the reference projection centre to the sharp plane, D − offset.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.
        outside
            What to do beyond the domain: raise, or give NaN there.

        Returns
        -------
        FloatArray
            The standoff in mm, of the broadcast shape.
        """
        return self.value("standoff_mm", zoom, focus, outside=outside)
