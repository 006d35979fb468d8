"""The simulated rig: three devices around one world, made from a preset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from lenscal.errors import InputError
from lenscal.imaging.decal import Decal
from lenscal.imaging.raycast import Body
from lenscal.imaging.texture import TargetSurface
from lenscal.plate import parse_target
from lenscal.pose import Pose
from lenscal.rig.interfaces import Rig
from lenscal.rig.simulated.body import LensBody
from lenscal.rig.simulated.camera import SimulatedCamera
from lenscal.rig.simulated.lens import SimulatedLens
from lenscal.rig.simulated.lens_truth import LensTruth
from lenscal.rig.simulated.motor_faults import LensFaults
from lenscal.rig.simulated.motors import LensMotors
from lenscal.rig.simulated.positioner import SimulatedPositioner
from lenscal.rig.simulated.presets import PRESETS
from lenscal.rig.simulated.workpiece import Workpiece
from lenscal.rig.simulated.world import PoseNoise, World
from lenscal.setting import LensSetting

#: Scatter of every move of the arm, where the caller does not say.
REPEATABILITY: Final = PoseNoise(0.02, 1e-4)

#: Error of the stated hand-eye calibration and of the taught place of the target.
MOUNTING_ERROR: Final = PoseNoise(0.05, 2e-4)


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
        faults: LensFaults = LensFaults(),  # noqa: B008 - frozen
        focus_shift_dioptres: float = 0.0,
    ) -> SimulatedRig:
        """Build a rig, switched on, at its reference setting, facing the sharp target.

        Parameters
        ----------
        name
            "vicon-1990" or "machine-vision".
        seed
            Of everything random in it.
        repeatability
            Scatter of every move of the arm.
        mounting_error
            Scatter of the true hand-eye and of the true place of the target about the stated ones.
        faults
            What is wrong with the motors of the lens.
        focus_shift_dioptres
            How much larger 1/D is, in 1/m, with a closed iris than with an open one.

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
        lens = replace(preset.lens(), focus_shift_dioptres=focus_shift_dioptres)
        target = parse_target(preset.target)
        reference, rng = lens.reference_setting, np.random.default_rng(seed)
        standoff = np.array([0.0, 0.0, lens.truth(reference).standoff_mm])
        facing = Pose(np.eye(3), standoff)
        base_from_camera = preset.base_from_target @ facing.inverse()
        world = World(
            lens,
            TargetSurface(target),
            preset.hand_from_camera @ mounting_error.draw(rng),
            preset.base_from_target @ mounting_error.draw(rng),
            base_from_camera @ preset.hand_from_camera.inverse(),
            LensMotors.at(reference, lens.travel, faults),
            rng,
        )
        return cls(
            SimulatedLens(world),
            SimulatedCamera(world, preset.detector),
            SimulatedPositioner(world, preset.workspace, repeatability),
            target,
            reference,
            preset.hand_from_camera,
            preset.base_from_target,
            {"rig": f"simulated {name}, seed {seed}"},
            mounting_error.rotation_rad,
            mounting_error.translation_mm,
            world=world,
        )

    @property
    def body(self) -> LensBody:
        """Front glass and barrel of the lens, for planning clearance."""
        return self.world.lens.body

    def lay_down(
        self, bodies: Sequence[Body], base_from_part: Pose, decals: Sequence[Decal] = ()
    ) -> None:
        """Put a part on the bench in place of the target.

        Parameters
        ----------
        bodies
            Of the part, in its own frame.
        base_from_part
            Where it lies, as taught; in truth it is off by the same motion as the target.
        decals
            Pictures that lie on it, such as a ruler.
        """
        true_from_taught = self.world.base_from_target @ self.base_from_target.inverse()
        self.world.workpiece = Workpiece(bodies, true_from_taught @ base_from_part, decals)

    def true_part_from_camera(self) -> Pose:
        """Tell where the camera is in the frame of the part, as the lens stands.

        Returns
        -------
        Pose
            The truth.

        Raises
        ------
        InputError
            When no part lies on the bench.
        """
        if self.world.workpiece is None:
            raise InputError("no part lies on the bench; put one there with lay_down")
        return self.world.workpiece.base_from_part.inverse() @ self.world.base_from_camera()

    def truth(self, setting: LensSetting) -> LensTruth:
        """Tell the truth about a setting at which the glass would truly stand.

        Parameters
        ----------
        setting
            A setting within the travel; an iris of None means the iris as the controller has it.

        Returns
        -------
        LensTruth
            The truth.
        """
        iris = self.lens.setting.iris if setting.iris is None else setting.iris
        return self.world.lens.truth(setting.with_iris(iris))

    def true_setting(self) -> LensSetting:
        """Tell where the glass really stands, whatever the controller believes.

        Returns
        -------
        LensSetting
            The truth.
        """
        return self.world.true_setting

    def true_camera_from_target(self) -> Pose:
        """Tell where the target truly is in the frame of the camera as the lens stands.

        Returns
        -------
        Pose
            The truth.
        """
        return self.world.camera_from_target()
