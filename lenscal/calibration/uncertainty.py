"""From the covariance of the solver's parameters to that of the quantities people ask for.

All parameters are moved a little at once, one per line of a batch, so that the derivatives of every
quantity cost one evaluation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.calibration.mounting import SHIFT_X, SHIFT_Y, TURN_X, TURN_Y, Mounting, turns
from lenscal.calibration.projection import CENTRE_X, PERSPECTIVE, RADIAL
from lenscal.pose import Pose

#: Quantities of the camera alone; higher radial coefficients follow, ``k2_per_mm4`` and so on.
_OF_CAMERA: Final = (
    "image_distance_mm",
    "principal_point_x_px",
    "principal_point_y_px",
    "scale_factor",
    "p1_per_mm",
    "p2_per_mm",
    "k1_per_mm2",
)
#: Quantities that need the focus view; the translation is that of the target's origin there.
_OF_FOCUS_VIEW: Final = (
    "object_distance_mm",
    "magnification",
    "focal_length_mm",
    "translation_x_mm",
    "translation_y_mm",
    "translation_z_mm",
)
#: Quantities that need a robot too, and the place of the reference camera in its hand: where the
#: projection centre lies in the frame of the reference camera, axially by minus the nodal offset.
_OF_ROBOT: Final = ("nodal_x_mm", "nodal_y_mm", "nodal_offset_mm", "standoff_mm")
#: Step of the differences in σ of each parameter: small against curvature, large against rounding.
_STEP: Final = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class FocusPlane:
    """The plane that D is measured to, as a function of the parameters of a fit.

    Either one view alone shows it, with a pose of its own, or the robot says where it is.

    Parameters
    ----------
    rotation
        (3, 3) of the view.
    placement
        (3,) of the view.
    middle_mm
        (3,) the middle of the view in the target frame.
    mounting
        Where a robot ties the views, and the plane is that of its reported pose; or None.
    base_from_hand
        That pose.
    hand_from_camera
        The reference camera in the hand, or None where it is not known.
    hand_eye_sigma
        σ of its rotation in rad and of its place in mm.
    """

    rotation: FloatArray
    placement: FloatArray
    middle_mm: FloatArray
    mounting: Mounting | None = None
    base_from_hand: Pose | None = None
    hand_from_camera: Pose | None = None
    hand_eye_sigma: tuple[float, float] = (0.0, 0.0)

    @property
    def has_reference(self) -> bool:
        """Whether nodal offset and standoff can be told."""
        return self.mounting is not None and self.hand_from_camera is not None

    def quantities(self, perspective: FloatArray, steps: FloatArray) -> FloatArray:
        """Evaluate the quantities of the focus view.

        Parameters
        ----------
        perspective
            (S,) 1/d.
        steps
            (S, 12) steps of the mounting, or (S, 6) of the view's rotation and placement.

        Returns
        -------
        FloatArray
            (S, Q) in the order of `quantity_names`.
        """
        if self.mounting is None or self.base_from_hand is None:
            rotation, shift = self._of_view(perspective, steps)
            return _of_plane(perspective, rotation, shift)
        x, y = self.mounting.camera_from_hand, self.mounting.base_from_target
        turn_x = turns(steps[:, TURN_X]) @ x.rotation
        turn_y = turns(steps[:, TURN_Y]) @ y.rotation
        shift_x = x.translation_mm + steps[:, SHIFT_X]
        shift_y = y.translation_mm + steps[:, SHIFT_Y]
        hand_from_base = self.base_from_hand.inverse()
        rotation = turn_x @ hand_from_base.rotation @ turn_y
        at_hand = shift_y @ hand_from_base.rotation.T + hand_from_base.translation_mm
        plane = _of_plane(perspective, rotation, _times(turn_x, at_hand) + shift_x)
        if self.hand_from_camera is None:
            return plane
        centre_in_hand = -_times(turn_x.mT, shift_x)
        centre = self.hand_from_camera.inverse().transform(centre_in_hand)
        offset = -centre[:, 2:]
        return np.concatenate([plane, centre[:, :2], offset, plane[:, :1] - offset], axis=1)

    def reference_variance(self, quantities: FloatArray) -> FloatArray:
        """Tell how much the nodal translation owes to the stated place of the reference camera.

        Parameters
        ----------
        quantities
            (Q,) in the order of `quantity_names`, those of the camera left out.

        Returns
        -------
        FloatArray
            (Q,) variances; none for the standoff, which is counted from that place as stated.
        """
        variances = np.zeros(len(quantities))
        if self.has_reference:
            turn, shift = self.hand_eye_sigma
            offset = quantities[-2]
            # A reference camera turned by ε sees a centre that lies `offset` behind it ε aside.
            lateral = shift**2 + (turn * offset) ** 2
            variances[-4:] = lateral, lateral, shift**2, 0.0
        return variances

    def _of_view(self, perspective: FloatArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
        rotation = turns(steps[:, :3]) @ self.rotation
        placement = self.placement + steps[:, 3:]
        middle = np.concatenate([placement[:, :2], 1.0 / perspective[:, None]], axis=1)
        return rotation, middle / placement[:, 2:] - rotation @ self.middle_mm


def quantity_names(intrinsics_count: int, plane: FocusPlane | None) -> tuple[str, ...]:
    """Name the quantities whose covariance is known.

    Parameters
    ----------
    intrinsics_count
        Length of the intrinsics vector.
    plane
        What D is measured to, or None.

    Returns
    -------
    tuple of str
        Names with units.
    """
    higher = range(2, intrinsics_count - RADIAL + 1)
    radial = tuple(f"k{i}_per_mm{2 * i}" for i in higher)
    of_focus_view = () if plane is None else _OF_FOCUS_VIEW
    of_robot = _OF_ROBOT if plane is not None and plane.has_reference else ()
    return _OF_CAMERA + radial + of_focus_view + of_robot


def evaluate_quantities(
    intrinsics: FloatArray, plane: FocusPlane | None, joint: FloatArray, noise_px: float
) -> tuple[FloatArray, FloatArray]:
    """Give the named quantities and propagate the covariance of the parameters to first order.

    Parameters
    ----------
    intrinsics
        (K,) of the solution.
    plane
        What D is measured to, or None.
    joint
        (K + n, K + n) covariance of the intrinsics and of what the plane depends on, for unit
        noise.
    noise_px
        σ of one observed coordinate.

    Returns
    -------
    values : FloatArray
        (Q,) in the order of `quantity_names`.
    covariance : FloatArray
        (Q, Q).
    """
    count = len(intrinsics)

    def evaluate(steps: FloatArray) -> FloatArray:
        moved = intrinsics + steps[:, :count]
        camera = np.concatenate([1.0 / moved[:, :1], moved[:, CENTRE_X:]], axis=1)
        if plane is None:
            return camera
        of_plane = plane.quantities(moved[:, PERSPECTIVE], steps[:, count:])
        return np.concatenate([camera, of_plane], axis=1)

    values = evaluate(np.zeros((1, len(joint))))[0]
    gradient = _gradient(evaluate, noise_px * np.sqrt(np.maximum(np.diag(joint), 0.0)))
    propagated: FloatArray = noise_px**2 * gradient @ joint @ gradient.T
    if plane is not None:
        propagated[count:, count:] += np.diag(plane.reference_variance(values[count:]))
    return values, (propagated + propagated.T) / 2


def _gradient(evaluate: Callable[[FloatArray], FloatArray], sigmas: FloatArray) -> FloatArray:
    """(Q, P) derivatives by differences in steps of σ; zero for what does not move."""
    sizes = _STEP * sigmas
    moving = np.flatnonzero(sizes > 0)
    steps = np.zeros((len(moving), len(sizes)))
    steps[np.arange(len(moving)), moving] = sizes[moving]
    differences = evaluate(np.concatenate([steps, -steps]))
    ahead, behind = np.split(differences, 2)
    gradient = np.zeros((differences.shape[1], len(sizes)))
    gradient[:, moving] = ((ahead - behind) / (2 * sizes[moving, None])).T
    return gradient


def _of_plane(perspective: FloatArray, rotation: FloatArray, shift: FloatArray) -> FloatArray:
    """D, d/D, f and the translation of a target."""
    normal = rotation[:, :, 2]
    distance = (normal * shift).sum(axis=1) / normal[:, 2]
    ratio = 1.0 / (perspective * distance)
    focal_length = 1.0 / (1.0 / distance + perspective)  # (3a)
    return np.column_stack([distance, ratio, focal_length, shift])


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    product: FloatArray = (matrices @ vectors[..., None])[..., 0]
    return product
