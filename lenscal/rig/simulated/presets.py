"""The rigs that can be had by name: lens, camera, target, and how they are mounted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.imaging.detector import Detector
from lenscal.pose import Pose
from lenscal.reach import Reach
from lenscal.rig.simulated.machine_vision import machine_vision_lens
from lenscal.rig.simulated.vicon_1990 import vicon_lens
from lenscal.rig.simulated.zoom_lens import ZoomLens


@dataclass(frozen=True, slots=True, eq=False)
class RigPreset:
    """What makes one simulated rig different from another.

    Parameters
    ----------
    lens
        Makes its lens and sensor.
    detector
        The pixels of its camera.
    target
        The target on its bench, as `lenscal.plate.parse_target` reads it.
    hand_from_camera
        The camera at the reference setting in the hand, as calibrated.
    base_from_target
        The target in the base, as taught.
    workspace
        What the positioner can reach.
    """

    lens: Callable[[], ZoomLens]
    detector: Detector
    target: str
    hand_from_camera: Pose
    base_from_target: Pose
    workspace: Reach


#: The camera sits beside and ahead of the hand, a quarter turn about the axis.
_HAND_FROM_CAMERA: Final = Pose.from_rotation_vector([0.0, 0.0, np.pi / 2], [30.0, -20.0, 80.0])

#: The plate lies on the bench face up, so that its z axis points down, and turned a little.
_BASE_FROM_TARGET: Final = Pose.from_rotation_vector(
    [np.pi, 0.0, 0.0], [600.0, 100.0, 200.0]
) @ Pose.from_rotation_vector([0.0, 0.0, np.radians(8.0)])

#: Small squares for the long end up close, large ones for the wide end far away, and beside each
#: board a disk to focus on. Every d/D from 0.005 to 0.2 shows squares of 45 to 235 px.
_BOARDS: Final = "+".join(
    (
        "charuco:13x10:40mm:30mm:DICT_4X4_250:0@-100,0",
        "disk:80mm@285,130",
        "charuco:13x10:10mm:7.5mm:DICT_4X4_250:65@270,-165",
        "disk:20mm@270,-80",
        "charuco:13x10:3mm:2.25mm:DICT_4X4_250:130@270,0",
        "disk:6mm@270,30",
    )
)

PRESETS: Final[dict[str, RigPreset]] = {
    "vicon-1990": RigPreset(
        lens=vicon_lens,
        # White paper at f/8 fills half the well in 10 ms; 8 bits of a frame grabber.
        detector=Detector(
            full_well_e=20_000.0,
            read_noise_e=12.0,
            black_level_dn=4.0,
            bit_depth=8,
            electrons_per_second=64e6,
        ),
        target="charuco:17x13:3mm:2.25mm@0,0+disk:6mm@0,27",
        hand_from_camera=_HAND_FROM_CAMERA,
        base_from_target=_BASE_FROM_TARGET,
        # Holds cameras 200 to 900 mm above the plate, tilted up to 35 degrees about it.
        workspace=Reach(np.array([-100.0, -600.0, 250.0]), np.array([1300.0, 800.0, 1300.0]), 45.0),
    ),
    "machine-vision": RigPreset(
        lens=machine_vision_lens,
        # A global-shutter chip with 3.45 µm pixels; white at f/8 fills half the well in 10 ms.
        detector=Detector(
            full_well_e=10_500.0,
            read_noise_e=2.4,
            black_level_dn=60.0,
            bit_depth=12,
            electrons_per_second=33.6e6,
        ),
        target=_BOARDS,
        hand_from_camera=_HAND_FROM_CAMERA,
        base_from_target=_BASE_FROM_TARGET,
        # A gantry for distances of 0.3 to 2.5 m, tilted up to 30 degrees about the plate.
        workspace=Reach(
            np.array([-1200.0, -1700.0, 300.0]), np.array([2400.0, 1900.0, 3000.0]), 45.0
        ),
    ),
}
