"""The lens of the paper: a 12.5–75 mm zoom with a 6 dioptre close-up lens, made up from groups.

Nobody published the optics of that lens. This one was found by a search for four thin groups that
keep 2 mm apart over the whole travel and give the paper's three viewpoints; the paper's values do
not fit one Gaussian lens exactly, so d/D comes out within 5.2 %, D and offset within 0.08 inch.
The stop rides in the cell of the compensator. Without the close-up lens, the Gaussian focal length
runs from 14 to 66 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.rig.simulated.body import LensBody
from lenscal.rig.simulated.laws import Imperfections
from lenscal.rig.simulated.zoom_lens import MovingGroup, ZoomLens, standing_still
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting, LensTravel

#: 2/3-inch chip with 23 µm elements; a frame grabber puts 512 samples on a line. The vertical pitch
#: is an assumption, the paper does not give it.
SENSOR: Final = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)

TRAVEL: Final = LensTravel(zoom=(45.0, 110.5), focus=(0.0, 140.0), iris=(5.0, 100.0))

#: Where the entrance pupil lies 216.1047 mm behind the close-up lens, the reference of the search.
REFERENCE: Final = LensSetting(72.53245878506645, 100.0, 100.0)

_CLOSE_UP_DIOPTRES: Final = 6.0

#: The close-up lens is the front glass; a barrel of 80 mm reaches back to the C-mount. Assumed.
_BODY: Final = LensBody(
    front_mm=216.1047, glass_radius_mm=32.0, barrel_radius_mm=40.0, barrel_length_mm=150.0
)

#: Barrel at the wide end (1.4 % in the corner), a little pincushion at the long end; a wander of a
#: few px, as decentred groups make the axis do; 15 % dark corners wide open at the wide end.
_IMPERFECTIONS: Final = Imperfections(
    distortion_per_mm2=(5e-4, -7e-4, 1e-4),
    wander_x_px=(-3.0, 0.0, 6.0, 0.8, 0.0),
    wander_y_px=(2.5, -3.5, 0.0, 0.0, -1.0),
    corner_loss=(0.04, 0.10, 0.01),
)


@dataclass(frozen=True, slots=True)
class ViconCams:
    """The cams: zoom moves variator and compensator, focus moves the front group.

    Positions are mm behind the close-up lens.

    Parameters
    ----------
    front_focal_length_mm, variator_focal_length_mm, compensator_focal_length_mm
        Of the groups that the compensator's cam is computed from.
    relay_focal_length_mm
        Of the group that stands still before the sensor.
    front_mm
        The front group when it is focused on infinity.
    front_extension_mm
        Coefficients of F and F², F = focus/100: how far focus moves the front group forward.
    zoom_range
        Zoom settings at which the variator is at its first and at its last position.
    variator_mm
        Those two positions.
    cam_bend, cam_power
        Share and exponent of the bent part of the variator's cam, the rest is straight.
    relay_mm
        Position of the relay.
    relay_vergence_per_mm
        Vergence of the light that reaches the relay, kept constant by the compensator.
    back_focus_error_mm
        How far the sensor stands behind the image of infinity.
    """

    front_focal_length_mm: float = 30.00105
    variator_focal_length_mm: float = -15.69817
    compensator_focal_length_mm: float = 140.0
    relay_focal_length_mm: float = 36.83711
    front_mm: float = 6.000294
    front_extension_mm: tuple[float, float] = (0.100001, 0.1819984)
    zoom_range: tuple[float, float] = (45.00062, 110.5442)
    variator_mm: tuple[float, float] = (12.72458, 18.54387)
    cam_bend: float = 0.2751093
    cam_power: float = 8.998349
    relay_mm: float = 132.2902
    relay_vergence_per_mm: float = 0.0008840139
    back_focus_error_mm: float = 0.03630134

    def front(self, zoom: FloatArray, focus: FloatArray) -> FloatArray:  # noqa: ARG002
        """Place the front group, which focus moves towards the object.

        Parameters
        ----------
        zoom, focus
            Settings.

        Returns
        -------
        FloatArray
            Position in mm.
        """
        hundredths = focus / 100.0
        linear, square = self.front_extension_mm
        return np.asarray(self.front_mm - hundredths * (linear + hundredths * square))

    def variator(self, zoom: FloatArray, focus: FloatArray) -> FloatArray:  # noqa: ARG002
        """Place the variator, on a cam that gets steep towards the long end.

        Parameters
        ----------
        zoom, focus
            Settings.

        Returns
        -------
        FloatArray
            Position in mm.
        """
        first, last = self.zoom_range
        share = (zoom - first) / (last - first)
        bent = np.abs(share) ** self.cam_power
        start, end = self.variator_mm
        way = (1.0 - self.cam_bend) * share + self.cam_bend * bent
        return np.asarray(start + (end - start) * way)

    def compensator(self, zoom: FloatArray, focus: FloatArray) -> FloatArray:
        """Place the compensator such that an object at infinity stays sharp over zoom.

        It takes the image that front group and variator form of infinity to the fixed object point
        of the relay; of its two places, the one nearer to the variator is taken.

        Parameters
        ----------
        zoom, focus
            Settings.

        Returns
        -------
        FloatArray
            Position in mm; NaN where no place serves.
        """
        variator = self.variator(zoom, focus)
        object_mm = self.front_mm + self.front_focal_length_mm - variator
        f = self.variator_focal_length_mm
        intermediate = variator + object_mm * f / (f + object_mm)
        relay_object = self.relay_mm + 1.0 / self.relay_vergence_per_mm
        throw = relay_object - intermediate
        ratio = self.compensator_focal_length_mm / throw
        nearer = 2.0 * self.compensator_focal_length_mm / (1.0 + np.sqrt(1.0 - 4.0 * ratio))
        return np.asarray(intermediate + nearer)

    @property
    def sensor_mm(self) -> float:
        """Position of the sensor."""
        vergence = self.relay_vergence_per_mm + 1.0 / self.relay_focal_length_mm
        return self.relay_mm + 1.0 / vergence + self.back_focus_error_mm


def vicon_lens() -> ZoomLens:
    """Assemble the lens.

    Returns
    -------
    ZoomLens
        Lens and sensor of the preset.
    """
    cams = ViconCams()
    return ZoomLens(
        name="Vicon 12.5-75 mm with 6 dioptre close-up (simulated)",
        travel=TRAVEL,
        groups=(
            MovingGroup("close-up lens", 1000.0 / _CLOSE_UP_DIOPTRES, standing_still(0.0)),
            MovingGroup("front group", cams.front_focal_length_mm, cams.front),
            MovingGroup("variator", cams.variator_focal_length_mm, cams.variator),
            MovingGroup("compensator", cams.compensator_focal_length_mm, cams.compensator),
            MovingGroup("relay", cams.relay_focal_length_mm, standing_still(cams.relay_mm)),
        ),
        stop_group="compensator",
        stop_behind_mm=1.500075,
        stop_diameter_mm=0.1,
        sensor_position_mm=cams.sensor_mm,
        clearance_mm=2.0,
        sensor=SENSOR,
        reference_setting=REFERENCE,
        imperfections=_IMPERFECTIONS,
        body=_BODY,
    )
