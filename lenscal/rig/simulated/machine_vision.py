"""A motorised 12–50 mm lens of today on a 5 megapixel camera, made up from four thin groups.

Positive, negative, positive, positive: the first group and the third stand still, the zoom motor
drives the variator between them on a screw, and the focus motor drives the last group on another.
No cam couples the two, so the lens is not parfocal: at each zoom only a band of focus settings
images finite distances, and these bands form a strip that bends down and then up towards the long
end. Found by a search for 12 to 50 mm at infinity with physical gaps; travels and steps are those
of a Theia TL1250 class lens, the optics are not. Larger zoom numbers mean longer focal lengths,
larger focus numbers nearer planes, larger iris numbers wider openings.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.rig.simulated.body import LensBody
from lenscal.rig.simulated.laws import Imperfections
from lenscal.rig.simulated.zoom_lens import MovingGroup, ZoomLens, standing_still
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting, LensTravel

#: 2/3-inch chip with square pixels, every one of which arrives in the computer.
SENSOR: Final = Sensor(2448, 2048, 0.00345, 0.00345)

#: In steps. Below 5 the blades of the iris are shut.
TRAVEL: Final = LensTravel(zoom=(0.0, 3227.0), focus=(0.0, 8390.0), iris=(5.0, 75.0))

REFERENCE: Final = LensSetting(1600.0, 6500.0, 75.0)

#: Where the motors put their groups at the first and at the last step, mm behind the first group.
_VARIATOR_MM: Final = (2.54, 31.37)
_FOCUS_GROUP_MM: Final = (48.2, 37.5)

#: The barrel reaches back to the flange of a CS-mount. Assumed.
_BODY: Final = LensBody(
    front_mm=53.354, glass_radius_mm=26.0, barrel_radius_mm=32.0, barrel_length_mm=50.0
)

#: Barrel at the wide end (2.6 % in the corner), pincushion at the long end; a wander of up to
#: 15 px; corners up to 20 % dark wide open at the wide end.
_IMPERFECTIONS: Final = Imperfections(
    distortion_per_mm2=(8e-4, -1.1e-3, 1e-4),
    wander_x_px=(-8.0, 0.0, 20.0, 3.0, 0.0),
    wander_y_px=(10.0, -15.0, 0.0, 0.0, -4.0),
    corner_loss=(0.05, 0.14, 0.01),
)


def machine_vision_lens() -> ZoomLens:
    """Assemble the lens.

    Returns
    -------
    ZoomLens
        Lens and sensor of the preset.
    """
    return ZoomLens(
        name="12-50 mm f/1.8 motorised, not parfocal (simulated)",
        travel=TRAVEL,
        groups=(
            MovingGroup("front group", 51.24, standing_still(0.0)),
            MovingGroup("variator", -20.44, _on_the_zoom_screw),
            MovingGroup("fixed group", 54.96, standing_still(35.41)),
            MovingGroup("focus group", 23.54, _on_the_focus_screw),
        ),
        stop_group="fixed group",
        stop_behind_mm=-1.5,
        stop_diameter_mm=0.145,
        sensor_position_mm=62.27,
        clearance_mm=2.0,
        sensor=SENSOR,
        reference_setting=REFERENCE,
        imperfections=_IMPERFECTIONS,
        body=_BODY,
    )


def _on_the_zoom_screw(zoom: FloatArray, focus: FloatArray) -> FloatArray:  # noqa: ARG001
    return np.asarray(np.interp(zoom, TRAVEL.zoom, _VARIATOR_MM))


def _on_the_focus_screw(zoom: FloatArray, focus: FloatArray) -> FloatArray:  # noqa: ARG001
    return np.asarray(np.interp(focus, TRAVEL.focus, _FOCUS_GROUP_MM))
