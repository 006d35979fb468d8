"""A lens of one focal length, the other kind of lens that can be planned with."""

from __future__ import annotations

from dataclasses import dataclass

from lenscal.arrays import positive
from lenscal.sensor import Sensor


@dataclass(frozen=True, slots=True)
class FixedLens:
    """A lens of one focal length, which is focused by moving the sensor.

    Parameters
    ----------
    focal_length_mm
        The perspective focal length f of (3a) in mm.
    sensor
        The sensor behind it.
    entrance_pupil_diameter_mm
        a in mm, or None where nobody knows it; depth of field needs it.

    Raises
    ------
    InputError
        When a length is not positive.
    """

    focal_length_mm: float
    sensor: Sensor
    entrance_pupil_diameter_mm: float | None = None

    def __post_init__(self) -> None:
        positive("focal_length_mm", self.focal_length_mm, "mm")
        if self.entrance_pupil_diameter_mm is not None:
            positive("entrance_pupil_diameter_mm", self.entrance_pupil_diameter_mm, "mm")

    @classmethod
    def with_f_number(cls, focal_length_mm: float, sensor: Sensor, f_number: float) -> FixedLens:
        """Make a simple thin lens from the f-number that is engraved on it, that at infinity.

        The stop of a thin lens stands in the lens, so that its entrance pupil lies at the principal
        planes. Then the perspective f is the Gaussian one, and a = f/N is right. It is not for a
        zoom lens: there take the entrance pupil that was measured.

        Parameters
        ----------
        focal_length_mm
            f in mm.
        sensor
            The sensor.
        f_number
            N.

        Returns
        -------
        FixedLens
            The lens with a = f/N.
        """
        pupil = positive("focal_length_mm", focal_length_mm, "mm") / positive("f_number", f_number)
        return cls(focal_length_mm, sensor, pupil)
