"""Visibility: the projection centre lies in the region from which the target is seen whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lenscal.errors import InputError
from lenscal.sensor import Sensor
from planning.requirements.margin import Margin, margin_over
from planning.views import Views


@dataclass(frozen=True, slots=True)
class Visibility:
    """The whole target is seen, and stays so when the camera misses its place by a distance.

    Parameters
    ----------
    distance_mm
        How far from the boundary of the region the projection centre must stay, in mm.

    Raises
    ------
    InputError
        When the distance is negative.
    """

    distance_mm: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.distance_mm) and self.distance_mm >= 0):
            raise InputError(
                f"distance_mm must be zero or a positive number, but is {self.distance_mm} mm"
            )

    @property
    def name(self) -> str:
        """``visibility``."""
        return "visibility"

    @property
    def judges_all_at_once(self) -> bool:
        """True: the region is asked once for all projection centres."""
        return True

    def margin(self, views: Views) -> Margin:
        """Judge views.

        Parameters
        ----------
        views
            V × S views.

        Returns
        -------
        Margin
            (V, S) signed distance in mm from the boundary of the region, that with the workspace
            included, less the distance that is asked; the share is of D: a shift of the camera by
            that share of D also changes the magnification by it.

        Raises
        ------
        InputError
            When the subject has no region.
        """
        spare = views.region_distance_mm.T - self.distance_mm
        share = spare / views.states.object_distance_mm[:, None]
        return margin_over(views, spare, "mm", share, self.describe(views.states.sensor))

    def describe(self, sensor: Sensor) -> str:  # noqa: ARG002
        """Say what is asked.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "visibility of the whole target, 2 mm inside its region".
        """
        inside = f", {self.distance_mm:g} mm inside its region" if self.distance_mm else ""
        return f"visibility of the whole target{inside}"
