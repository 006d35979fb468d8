"""The simulated rig: three devices around one world, made from a preset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from lenscal.errors import InputError
from lenscal.imaging.detector import Detector
from lenscal.imaging.texture import TargetSurface
from lenscal.plate import parse_target
from lenscal.pose import Pose
from lenscal.rig.interfaces import Rig
from lenscal.rig.simulated.camera import SimulatedCamera
from lenscal.rig.simulated.lens import SimulatedLens
from lenscal.rig.simulated.positioner import SimulatedPositioner, Workspace
from lenscal.rig.simulated.vicon_1990 import vicon_lens
from lenscal.rig.simulated.world import PoseNoise, World
from lenscal.rig.simulated.zoom_lens import LensTruth, ZoomLens
from lenscal.setting import LensSetting

#: Scatter of every move of the arm, where the caller does not say.
REPEATABILITY: Final = PoseNoise(0.02, 1e-4)

#: Error of the stated hand-eye calibration and of the taught place of the target.
MOUNTING_ERROR: Final = PoseNoise(0.05, 2e-4)


@dataclass(frozen=True, slots=True)
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
    """

    lens: Callable[[], ZoomLens]
    detector: Detector
    target: str


PRESETS: Final[dict[str, RigPreset]] = {
    "vicon-1990": RigPreset(
        vicon_lens,
        # White paper at f/8 fills half the well in 10 ms; 8 bits of a frame grabber.
        Detector(
            full_well_e=20_000.0,
            read_noise_e=12.0,
            black_level_dn=4.0,
            bit_depth=8,
            electrons_per_second=64e6,
        ),
        "charuco:17x13:3mm:2.25mm@0,0+disk:6mm@0,27",
    )
}


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedRig(Rig):
    """A rig in a world of its own, whose truth can be asked for.

    Parameters
    ----------
    world
        What lens, camera and positioner share.
    """

    world: World = field(kw_only=True)

    @classmethod
    def preset(
        cls,
        name: str,
        seed: int = 0,
        *,
        repeatability: PoseNoise = REPEATABILITY,
        mounting_error: PoseNoise = MOUNTING_ERROR,
    ) -> SimulatedRig:
        """Build a rig, switched on, at its reference setting, facing the sharp target.

        Parameters
        ----------
        name
            "vicon-1990".
        seed
            Of everything random in it.
        repeatability
            Scatter of every move of the arm.
        mounting_error
            Scatter of the true hand-eye and of the true place of the target about the stated ones.

        Returns
        -------
        SimulatedRig
            The rig.

        Raises
        ------
        InputError
            When there is no such preset.
        """
        if name not in PRESETS:
            raise InputError(
                f"there is no simulated rig {name!r}; the presets are {', '.join(PRESETS)}"
            )
        preset = PRESETS[name]
        lens, target = preset.lens(), parse_target(preset.target)
        reference, rng = lens.reference_setting, np.random.default_rng(seed)
        hand_from_camera, base_from_target = _hand_from_camera(), _base_from_target()
        standoff = np.array([0.0, 0.0, lens.truth(reference).standoff_mm])
        facing = Pose(np.eye(3), standoff)
        base_from_hand = base_from_target @ facing.inverse() @ hand_from_camera.inverse()
        world = World(
            lens,
            TargetSurface(target),
            hand_from_camera @ mounting_error.draw(rng),
            base_from_target @ mounting_error.draw(rng),
            base_from_hand,
            reference,
            rng,
        )
        return cls(
            SimulatedLens(world),
            SimulatedCamera(world, preset.detector),
            SimulatedPositioner(world, _workspace(), repeatability),
            target,
            reference,
            hand_from_camera,
            base_from_target,
            {"rig": f"simulated {name}, seed {seed}"},
            world=world,
        )

    def truth(self, setting: LensSetting) -> LensTruth:
        """Tell the truth about a setting.

        Parameters
        ----------
        setting
            A setting within the travel; an iris of None means the iris as it stands.

        Returns
        -------
        LensTruth
            The truth.
        """
        iris = self.world.setting.iris if setting.iris is None else setting.iris
        return self.world.lens.truth(setting.with_iris(iris))

    def true_camera_from_target(self) -> Pose:
        """Tell where the target truly is in the frame of the camera as the lens stands.

        Returns
        -------
        Pose
            The truth.
        """
        return self.world.camera_from_target()


def _hand_from_camera() -> Pose:
    """Place the camera in the hand: beside and ahead of it, a quarter turn about the axis."""
    return Pose.from_rotation_vector([0.0, 0.0, np.pi / 2], [30.0, -20.0, 80.0])


def _base_from_target() -> Pose:
    """Lay the plate on the bench: face up, so that its z axis points down, and turned a little."""
    face_up = Pose.from_rotation_vector([np.pi, 0.0, 0.0], [600.0, 100.0, 200.0])
    return face_up @ Pose.from_rotation_vector([0.0, 0.0, np.radians(8.0)])


def _workspace() -> Workspace:
    """Reach that holds cameras 200 to 900 mm above the plate, tilted up to 35 degrees about it."""
    return Workspace(np.array([-100.0, -600.0, 250.0]), np.array([1300.0, 800.0, 1300.0]), 45.0)
