"""What a fit looks at and what it moves: padded observations, and the parameters of all views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.mounting import UNKNOWN, Mounting
from lenscal.calibration.projection import PERSPECTIVE, intrinsics_of
from lenscal.camera import Camera
from lenscal.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """Observations of all views, padded to the longest.

    Parameters
    ----------
    points_mm
        (V, 3, M) target points relative to the middle of their view; zero where there is none.
    middles_mm
        (V, 3) the middle of each view in the target frame.
    pixels
        (V, 2, M) where they were seen.
    present
        (V, M) which places of the padding hold an observation.
    element_pitch_mm
        (2,) spacing of the sensor's elements.
    """

    points_mm: FloatArray
    middles_mm: FloatArray
    pixels: FloatArray
    present: BoolArray
    element_pitch_mm: FloatArray

    @classmethod
    def pad(
        cls,
        points_mm: Sequence[FloatArray],
        pixels: Sequence[FloatArray],
        element_pitch_mm: FloatArray,
    ) -> Views:
        """Stack views of different length.

        Parameters
        ----------
        points_mm
            V times (N, 3) in the target frame.
        pixels
            V times (N, 2).
        element_pitch_mm
            (2,) spacing of the sensor's elements.

        Returns
        -------
        Views
            The same observations, each view about its own middle.
        """
        count, longest = len(points_mm), max((len(p) for p in points_mm), default=0)
        points, seen = np.zeros((count, 3, longest)), np.zeros((count, 2, longest))
        present = np.zeros((count, longest), dtype=bool)
        middles = np.zeros((count, 3))
        for view, (world, image) in enumerate(zip(points_mm, pixels, strict=True)):
            if len(world):
                middles[view] = world.mean(axis=0)
            points[view, :, : len(world)] = (world - middles[view]).T
            seen[view, :, : len(image)] = image.T
            present[view, : len(world)] = True
        return cls(points, middles, seen, present, element_pitch_mm)

    def select(self, chosen: BoolArray) -> Views:
        """Keep some views.

        Parameters
        ----------
        chosen
            (V,) which ones.

        Returns
        -------
        Views
            Those views.
        """
        return Views(
            self.points_mm[chosen],
            self.middles_mm[chosen],
            self.pixels[chosen],
            self.present[chosen],
            self.element_pitch_mm,
        )


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """All parameters of a fit.

    Parameters
    ----------
    intrinsics
        (K,) as `lenscal.calibration.projection` orders them.
    rotations
        (V, 3, 3) camera from target.
    placements
        (V, 3) a, b, s of the middle of each view.
    mounting
        How camera and target are mounted, where a robot carried the camera.
    """

    intrinsics: FloatArray
    rotations: FloatArray
    placements: FloatArray
    mounting: Mounting = UNKNOWN

    @classmethod
    def of(cls, camera: Camera, camera_from_target: Pose, middle_mm: FloatArray) -> State:
        """Express a camera and the pose of a single view.

        Parameters
        ----------
        camera
            The camera.
        camera_from_target
            Its pose.
        middle_mm
            (3,) the middle of the view in the target frame.

        Returns
        -------
        State
            The same in the solver's parameters.
        """
        intrinsics = intrinsics_of(camera)
        placement = placement_of(camera_from_target, middle_mm, intrinsics)
        return cls(intrinsics, camera_from_target.rotation[None], placement[None])

    def moved(self, shared_step: FloatArray, pose_steps: FloatArray) -> State:
        """Take a step.

        Parameters
        ----------
        shared_step
            (K,) added to the intrinsics; (K + 12,) with a mounting, see `Mounting.moved`.
        pose_steps
            (V, 6) rotation vectors applied on the left, and additions to the placements.

        Returns
        -------
        State
            The new parameters.
        """
        turns = Rotation.from_rotvec(pose_steps[:, :3]).as_matrix()
        count = len(self.intrinsics)
        return State(
            self.intrinsics + shared_step[:count],
            turns @ self.rotations,
            self.placements + pose_steps[:, 3:],
            self.mounting.moved(shared_step[count:]) if len(shared_step) > count else self.mounting,
        )

    def select(self, chosen: BoolArray) -> State:
        """Keep the poses of some views.

        Parameters
        ----------
        chosen
            (V,) which ones.

        Returns
        -------
        State
            The same intrinsics with those poses.
        """
        return replace(self, rotations=self.rotations[chosen], placements=self.placements[chosen])

    def poses(self, middles_mm: FloatArray) -> tuple[Pose, ...]:
        """Turn rotations and placements into poses.

        Parameters
        ----------
        middles_mm
            (V, 3) the middle of each view in the target frame.

        Returns
        -------
        tuple of Pose
            ``camera_from_target`` of each view.
        """
        shifts = translations_mm(
            self.intrinsics[PERSPECTIVE], self.rotations, self.placements, middles_mm
        )
        # Many small turns leave a rotation off orthonormal by rounding alone.
        rotations = Rotation.from_matrix(self.rotations).as_matrix()
        return tuple(Pose(r, t) for r, t in zip(rotations, shifts, strict=True))


def placement_of(
    camera_from_target: Pose, middle_mm: FloatArray, intrinsics: FloatArray
) -> FloatArray:
    """Place the middle of a view.

    Parameters
    ----------
    camera_from_target
        Where the target is.
    middle_mm
        (3,) the middle in the target frame.
    intrinsics
        (K,) of the camera.

    Returns
    -------
    FloatArray
        (3,) a, b, s.
    """
    x, y, z = camera_from_target.transform(middle_mm)
    scale = 1.0 / (intrinsics[PERSPECTIVE] * z)
    return np.array([scale * x, scale * y, scale])


def translations_mm(
    perspective_per_mm: FloatArray,
    rotations: FloatArray,
    placements: FloatArray,
    middles: FloatArray,
) -> FloatArray:
    """Give the translations that placements stand for.

    Parameters
    ----------
    perspective_per_mm
        1/d.
    rotations
        (..., 3, 3).
    placements
        (..., 3) a, b, s.
    middles
        (..., 3) in mm in the target frame.

    Returns
    -------
    FloatArray
        (..., 3) origin of the target in the camera frame in mm.
    """
    distance = np.broadcast_to(1.0 / np.asarray(perspective_per_mm), placements.shape[:-1])
    middle = np.concatenate([placements[..., :2], distance[..., None]], axis=-1)
    shift: FloatArray = middle / placements[..., 2:] - (rotations @ middles[..., None])[..., 0]
    return shift
