"""Rigid transforms between named frames.

A transform is named target-first: ``camera_from_target`` maps target points into the camera frame,
so that a right chain reads like a fraction, ``camera_from_hand @ hand_from_base``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import InputError

#: How far RᵀR may be from the identity before a matrix is no rotation.
_ORTHONORMAL = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A rotation followed by a translation: ``y = rotation @ x + translation_mm``.

    Parameters
    ----------
    rotation
        (3, 3) rotation matrix, right-handed.
    translation_mm
        (3,) translation in mm.

    Raises
    ------
    InputError
        When the matrix is no rotation, or a shape is wrong, or a value is not finite.
    """

    rotation: FloatArray
    translation_mm: FloatArray

    def __post_init__(self) -> None:
        rotation = frozen_array("rotation", self.rotation, (3, 3))
        error = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if error > _ORTHONORMAL or np.linalg.det(rotation) < 0:
            kind = "a reflection" if error <= _ORTHONORMAL else f"off orthonormal by {error:.1e}"
            raise InputError(
                f"rotation must be a right-handed orthonormal matrix, but it is {kind}; "
                "use Pose.from_rotation_vector to make one"
            )
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(
            self, "translation_mm", frozen_array("translation_mm", self.translation_mm, (3,))
        )

    @classmethod
    def identity(cls) -> Pose:
        """Make the transform that changes nothing.

        Returns
        -------
        Pose
            No rotation, no translation.
        """
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Pose:
        """Read a homogeneous matrix.

        Parameters
        ----------
        matrix
            (4, 4), last row (0, 0, 0, 1), translation in mm.

        Returns
        -------
        Pose
            The same transform.
        """
        full = frozen_array("matrix", matrix, (4, 4))
        if not np.array_equal(full[3], (0.0, 0.0, 0.0, 1.0)):
            raise InputError(
                f"the last row of matrix must be (0, 0, 0, 1), but is {full[3].tolist()}"
            )
        return cls(full[:3, :3], full[:3, 3])

    @classmethod
    def from_rotation_vector(
        cls, rotation_vector: npt.ArrayLike, translation_mm: npt.ArrayLike = (0.0, 0.0, 0.0)
    ) -> Pose:
        """Make a pose from an axis times an angle.

        Parameters
        ----------
        rotation_vector
            (3,) in radians: its direction is the axis, its length the angle, right-handed.
        translation_mm
            (3,) in mm.

        Returns
        -------
        Pose
            The transform.
        """
        vector = frozen_array("rotation_vector", rotation_vector, (3,))
        return cls(Rotation.from_rotvec(vector.copy()).as_matrix(), np.asarray(translation_mm))

    @property
    def matrix(self) -> FloatArray:
        """(4, 4) homogeneous matrix."""
        full = np.eye(4)
        full[:3, :3] = self.rotation
        full[:3, 3] = self.translation_mm
        return full

    @classmethod
    def from_dict(cls, words: Mapping[str, npt.ArrayLike]) -> Pose:
        """Read what `to_dict` gave.

        Parameters
        ----------
        words
            ``rotation``, (3, 3), and ``translation_mm``, (3,).

        Returns
        -------
        Pose
            The same transform, to the last digit.
        """
        return cls(np.asarray(words["rotation"]), np.asarray(words["translation_mm"]))

    def to_dict(self) -> dict[str, list[float] | list[list[float]]]:
        """Give the transform as JSON can hold it.

        Returns
        -------
        dict
            ``rotation``, three rows, and ``translation_mm``.
        """
        return {
            "rotation": self.rotation.tolist(),
            "translation_mm": self.translation_mm.tolist(),
        }

    @property
    def rotation_vector(self) -> FloatArray:
        """(3,) axis times angle in radians, angle at most π."""
        vector: FloatArray = Rotation.from_matrix(self.rotation).as_rotvec()
        return vector

    def inverse(self) -> Pose:
        """Turn the transform around.

        Returns
        -------
        Pose
            ``b_from_a`` of an ``a_from_b``.
        """
        return Pose(self.rotation.T, -self.rotation.T @ self.translation_mm)

    def __matmul__(self, other: Pose) -> Pose:
        if not isinstance(other, Pose):
            return NotImplemented
        # A long chain drifts off orthonormality by rounding; one Newton step of the polar
        # decomposition brings it back.
        product = self.rotation @ other.rotation
        product = 0.5 * product @ (3 * np.eye(3) - product.T @ product)
        return Pose(product, self.rotation @ other.translation_mm + self.translation_mm)

    def transform(self, points: npt.ArrayLike) -> FloatArray:
        """Map points.

        Parameters
        ----------
        points
            (..., 3) in mm.

        Returns
        -------
        FloatArray
            (..., 3) in mm, in the frame that the pose is named after first.
        """
        array = frozen_array("points", points, ("...", 3), finite=False)
        moved: FloatArray = array @ self.rotation.T + self.translation_mm
        return moved

    def distance_to(self, other: Pose) -> tuple[float, float]:
        """Tell how far two poses of the same frames are apart.

        Parameters
        ----------
        other
            A pose between the same frames.

        Returns
        -------
        tuple of float
            Translation in mm and rotation angle in radians.
        """
        turn = Rotation.from_matrix(self.rotation.T @ other.rotation)
        return (
            float(np.linalg.norm(self.translation_mm - other.translation_mm)),
            float(turn.magnitude()),
        )

    def __repr__(self) -> str:
        vector = np.array2string(self.rotation_vector, precision=6, separator=", ")
        shift = np.array2string(self.translation_mm, precision=4, separator=", ")
        return f"Pose.from_rotation_vector({vector}, translation_mm={shift})"
