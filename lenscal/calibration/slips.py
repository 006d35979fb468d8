"""What a robot knows of the views: that it slipped by no more than its repeatability.

The slip of a view, X⁻¹ · ``camera_from_target`` · Y⁻¹ · B (`lenscal.calibration.mounting`), is a
small rotation, measured by its axis times its sine, and a small translation; both are linearised
exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.bundle import System
from lenscal.calibration.mounting import COUNT, SHIFT_X, SHIFT_Y, TURN_X, TURN_Y, Mounting
from lenscal.calibration.projection import PERSPECTIVE
from lenscal.calibration.views import State
from lenscal.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class MountingPrior:
    """What other settings of the same session know of the mounting.

    Turns of X and Y and the place of Y are the same at all settings; the translation of X is not,
    because the projection centre travels.

    Parameters
    ----------
    mean
        The mounting as they see it; the translation of its X counts for nothing.
    information
        (9, 9) inverse covariance of the rotation vectors of X and Y and of the translation of Y.
    """

    mean: Mounting
    information: FloatArray


#: Where the parameters of a prior stand in a step of a mounting.
SHARED_BY_SETTINGS = np.r_[TURN_X, TURN_Y, SHIFT_Y]


@dataclass(frozen=True, slots=True, eq=False)
class Slips:
    """The robot's word, as knowledge for a fit.

    Parameters
    ----------
    hand_rotations, hand_translations_mm
        (V, 3, 3) and (V, 3) of ``base_from_hand``, as reported.
    middles_mm
        (V, 3) the middle of each view in the target frame.
    weights
        (V, 2) σ of a pixel over that of a rotation in rad, and over that of a translation in mm;
        zero where the robot is not to be believed.
    prior
        What else is known of the mounting.
    noise_px
        σ of a pixel, which the prior is weighed against.
    """

    hand_rotations: FloatArray
    hand_translations_mm: FloatArray
    middles_mm: FloatArray
    weights: FloatArray
    prior: MountingPrior | None = None
    noise_px: float = 1.0

    @classmethod
    def of(
        cls,
        hands: Sequence[Pose | None],
        middles_mm: FloatArray,
        noise_px: float,
        repeatability: tuple[float, float],
        believed: BoolArray,
        prior: MountingPrior | None = None,
    ) -> Slips:
        """Weigh reported poses.

        Parameters
        ----------
        hands
            V times ``base_from_hand``, or None.
        middles_mm
            (V, 3) the middle of each view in the target frame.
        noise_px
            σ of a pixel.
        repeatability
            σ of the robot: of each rotation in rad, and of each translation in mm.
        believed
            (V,) which poses count.
        prior
            What else is known of the mounting.

        Returns
        -------
        Slips
            The knowledge.
        """
        poses = [hand or Pose.identity() for hand in hands]
        told = believed & np.array([hand is not None for hand in hands])
        return cls(
            np.stack([pose.rotation for pose in poses]),
            np.stack([pose.translation_mm for pose in poses]),
            middles_mm,
            told[:, None] * noise_px / np.array(repeatability),
            prior,
            noise_px,
        )

    def measure(self, state: State) -> FloatArray:
        """Measure how far each view slipped.

        Parameters
        ----------
        state
            The parameters.

        Returns
        -------
        FloatArray
            (V, 6) rotation in rad and translation in mm, in the frame of the hand.
        """
        return np.concatenate(self._slips(state)[:2], axis=1)

    def cost(self, state: State) -> float:
        """Sum the weighted squares of the slips and of what the prior holds.

        Parameters
        ----------
        state
            The parameters.

        Returns
        -------
        float
            The sum in px².
        """
        slips = self.measure(state) * np.repeat(self.weights, 3, axis=1)
        total = float((slips**2).sum())
        if self.prior is not None:
            away = self._away(state, self.prior)
            total += self.noise_px**2 * float(away @ self.prior.information @ away)
        return total

    def system(self, state: State, free: BoolArray) -> System:
        """Linearise.

        Parameters
        ----------
        state
            The parameters, with a mounting.
        free
            (K + 12,) which shared parameters move.

        Returns
        -------
        System
            The normal equations.
        """
        by_shared, by_pose = self.jacobians(state)
        weights = np.repeat(self.weights, 3, axis=1)
        residual = weights * self.measure(state)
        by_shared = weights[..., None] * by_shared[..., free]
        by_pose = weights[..., None] * by_pose
        transposed = by_shared.transpose(0, 2, 1)
        square, slope = transposed @ by_shared, transposed @ residual[..., None]
        shared, shared_slope = square.sum(axis=0), slope.sum(axis=0)[:, 0]
        if self.prior is not None:
            places = len(state.intrinsics) + SHARED_BY_SETTINGS
            prior, prior_slope = np.zeros((len(free), len(free))), np.zeros(len(free))
            weighted = self.noise_px**2 * self.prior.information
            prior[np.ix_(places, places)] = weighted
            prior_slope[places] = weighted @ self._away(state, self.prior)
            shared, shared_slope = shared + prior[free][:, free], shared_slope + prior_slope[free]
        pose_rows = by_pose.transpose(0, 2, 1)
        return System(
            shared,
            transposed @ by_pose,
            pose_rows @ by_pose,
            shared_slope,
            (pose_rows @ residual[..., None])[..., 0],
        )

    def jacobians(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Differentiate the slips.

        Parameters
        ----------
        state
            The parameters.

        Returns
        -------
        by_shared : FloatArray
            (V, 6, K + 12) by what the views share.
        by_pose : FloatArray
            (V, 6, 6) by each pose.
        """
        _, _, turned, arm, at_hand = self._slips(state)
        mounting = state.mounting
        x, y = mounting.camera_from_hand.rotation, mounting.base_from_target.rotation
        views, count = len(turned), len(state.intrinsics)
        by_shared, by_pose = np.zeros((views, 6, count + COUNT)), np.zeros((views, 6, 6))
        # exp(ω) to the left of a rotation R moves vee(R) by ½ (tr(R) − R) ω.
        gain = (np.trace(turned, axis1=1, axis2=2)[:, None, None] * np.eye(3) - turned) / 2
        by_pose[:, :3, :3] = gain @ x.T
        in_base = turned @ self.hand_rotations.mT
        mounting_part = by_shared[..., count:]
        mounting_part[:, :3, TURN_X] = -gain @ x.T
        mounting_part[:, :3, TURN_Y] = -gain @ in_base

        perspective = state.intrinsics[PERSPECTIVE]
        scale = state.placements[:, 2]
        by_pose[:, 3:, :3] = -x.T @ _cross(arm)
        by_pose[:, 3:, 3:5] = x.T[:, :2] / scale[:, None, None]
        by_pose[:, 3:, 5] = -(_middles(state) / scale[:, None]) @ x
        by_shared[:, 3:, PERSPECTIVE] = -x.T[:, 2] / (perspective**2 * scale)[:, None]
        mounting_part[:, 3:, TURN_X] = x.T @ _cross(at_hand)
        mounting_part[:, 3:, SHIFT_X] = -x.T
        to_hand = x.T @ state.rotations @ y.T
        from_target = self.hand_translations_mm - mounting.base_from_target.translation_mm
        mounting_part[:, 3:, TURN_Y] = to_hand @ _cross(from_target)
        mounting_part[:, 3:, SHIFT_Y] = -to_hand
        return by_shared, by_pose

    @staticmethod
    def _away(state: State, prior: MountingPrior) -> FloatArray:
        """(9,) from the mean of the prior to the mounting; its derivative is taken as one."""
        return prior.mean.step_to(state.mounting)[SHARED_BY_SETTINGS]

    def _slips(
        self, state: State
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Rotation (V, 3) and translation (V, 3); then what their derivatives are made of.

        That is the rotation (V, 3, 3) of the slip, the hand relative to the target's middle in the
        camera's directions (V, 3), and the hand in the camera frame relative to where X puts it.
        """
        mounting = state.mounting
        x, y = mounting.camera_from_hand, mounting.base_from_target
        turned = x.rotation.T @ state.rotations @ y.rotation.T @ self.hand_rotations
        in_target = (self.hand_translations_mm - y.translation_mm) @ y.rotation
        arm = (state.rotations @ (in_target - self.middles_mm)[..., None])[..., 0]
        at_hand = arm + _middles(state) - x.translation_mm
        return _vee(turned), at_hand @ x.rotation, turned, arm, at_hand


def _middles(state: State) -> FloatArray:
    """(V, 3) the middle of each view in the camera frame in mm."""
    distance = np.full(len(state.placements), 1.0 / state.intrinsics[PERSPECTIVE])
    scaled = np.column_stack([state.placements[:, :2], distance])
    middles: FloatArray = scaled / state.placements[:, 2:]
    return middles


def _vee(rotations: FloatArray) -> FloatArray:
    """(V, 3) axis times sine of the angle."""
    return (
        np.stack(
            [
                rotations[:, 2, 1] - rotations[:, 1, 2],
                rotations[:, 0, 2] - rotations[:, 2, 0],
                rotations[:, 1, 0] - rotations[:, 0, 1],
            ],
            axis=1,
        )
        / 2
    )


def _cross(vectors: FloatArray) -> FloatArray:
    """(..., 3, 3) such that the matrix times a vector is the vector product."""
    matrices = np.zeros((*vectors.shape, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    matrices[..., 0, 1], matrices[..., 0, 2] = -z, y
    matrices[..., 1, 0], matrices[..., 1, 2] = z, -x
    matrices[..., 2, 0], matrices[..., 2, 1] = -y, x
    return matrices
