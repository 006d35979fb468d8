"""Where the camera sits in the hand: the hand-eye equation AX = XB, solved in closed form.

Between two views the hand moves by A and the camera by B; X, ``hand_from_camera``, is the same in
all: A X = X B. All pairs of views are used, both ways, so that their order does not matter; but not
half turns, the sign of whose axis is not known.

- ``park``: Park and Martin, IEEE Trans. Robotics and Automation 10(5), 1994;
- ``tsai-lenz``: Tsai and Lenz, ibid. 5(3), 1989;
- ``horaud``: Horaud and Dornaika, Int. J. Robotics Research 14(3), 1995, their closed form;
- ``andreff``: Andreff, Horaud and Espiau, *On-line hand-eye calibration*, 3DIM 1999;
- ``daniilidis``: Daniilidis, Int. J. Robotics Research 18(3), 1999.

The first three find the rotation from rotations and then the translation. The last two use the
translations for both; of ``andreff`` the translation is found again when its matrix has become a
rotation, which makes it two to three times better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lenscal.arrays import BoolArray, FloatArray
from lenscal.errors import DegenerateGeometryError, InputError
from lenscal.pose import Pose

METHODS: Final = ("park", "tsai-lenz", "horaud", "andreff", "daniilidis")

#: Fewest poses that can turn about two axes.
_FEWEST: Final = 3
#: Turn about a second axis under which the equation counts as degenerate.
_LEAST_TURN_DEG: Final = 3.0
#: Turns beyond this may come out with the opposite axis; the rotation is found without them.
_HALF_TURN_DEG: Final = 170.0
#: How far the scale that a linear solution gives to a rotation may be from one, as a factor.
_SCALE: Final = 2.0
#: Rounds of weighing that find the middle rotation.
_ROUNDS: Final = 20
#: Views closer than this to the middle rotation are not told apart.
_FINEST_RAD: Final = 1e-9
_WHAT_TO_DO: Final = "give three poses or more, turned about two different axes by 10° or more"


class _Motions(NamedTuple):
    """What moved between the two views of each pair: A and B, K of each."""

    hand: Rotation
    hand_mm: FloatArray
    camera: Rotation
    camera_mm: FloatArray

    @property
    def typical_mm(self) -> float:
        """Root mean square length of the translations; one when nothing was translated."""
        lengths = np.concatenate([self.hand_mm, self.camera_mm])
        return float(np.sqrt(np.mean(np.sum(lengths**2, axis=1)))) or 1.0


def solve_hand_eye_equation(
    camera_from_target: Sequence[Pose], base_from_hand: Sequence[Pose], method: str = "park"
) -> Pose:
    """Find where the camera sits in the hand.

    Neither the frame of the base nor that of the target matters, nor the order of the views, nor
    the unit of length.

    Parameters
    ----------
    camera_from_target
        Three or more poses of the target, which stands still, as seen.
    base_from_hand
        The pose of the hand for each of them, as the robot reports it.
    method
        One of `METHODS`.

    Returns
    -------
    Pose
        ``hand_from_camera``.

    Raises
    ------
    InputError
        When the counts disagree, or there is no such method.
    DegenerateGeometryError
        When the hand was turned too little (see `refuse_too_little_turning`), or the target as seen
        was, or the poses contradict each other, which ``andreff`` notices.
    """
    if method not in METHODS:
        raise InputError(
            f"there is no hand-eye method {method!r}; choose one of {', '.join(METHODS)}"
        )
    _refuse_unpaired(camera_from_target, base_from_hand)
    refuse_too_little_turning(base_from_hand)
    motions = _motions(camera_from_target, base_from_hand)
    _refuse_unseen_turning(motions)
    if method == "daniilidis":
        return _daniilidis(motions)
    return _with_translation(_ROTATIONS[method](motions), motions)


def base_from_target(
    hand_from_camera: Pose, camera_from_target: Sequence[Pose], base_from_hand: Sequence[Pose]
) -> Pose:
    """Find where the target stands: the middle of what the views say.

    The translation is the median of each coordinate, the rotation the one whose angles to those of
    the views have the least sum, so that one bad view does not matter.

    Parameters
    ----------
    hand_from_camera
        Where the camera sits in the hand.
    camera_from_target
        One or more poses of the target as seen.
    base_from_hand
        The pose of the hand for each of them.

    Returns
    -------
    Pose
        ``base_from_target``.

    Raises
    ------
    InputError
        When the counts disagree, or there is no view.
    """
    _refuse_unpaired(camera_from_target, base_from_hand)
    if not base_from_hand:
        raise InputError("no view was given; give at least one to tell where the target stands")
    told = [
        hand @ hand_from_camera @ seen
        for hand, seen in zip(base_from_hand, camera_from_target, strict=True)
    ]
    rotation = _middle_rotation(_rotations(told)).as_matrix()
    return Pose(rotation, np.median(_translations_mm(told), axis=0))


def refuse_too_little_turning(base_from_hand: Sequence[Pose]) -> None:
    """Refuse poses of the hand that cannot show where the camera sits in it.

    Translations show nothing of where it sits, and turns about one axis do not show how far along
    it. Turns of half a circle do not count, as the sign of their axis is not known.

    Parameters
    ----------
    base_from_hand
        The poses, of the views that are used.

    Raises
    ------
    DegenerateGeometryError
        When there are fewer than three, or they are turned by less than 3° about a second axis.
    """
    count = len(base_from_hand)
    if count < _FEWEST:
        raise DegenerateGeometryError(
            f"{count} pose{'s' * (count != 1)} of the hand cannot show where the camera sits in "
            f"it; {_WHAT_TO_DO}"
        )
    first, second = np.triu_indices(count, 1)
    rotations = _rotations(base_from_hand)
    turns = rotations[second].inv() * rotations[first]
    largest_deg, across_deg = _turning_deg(turns[_certain(turns)])
    if across_deg >= _LEAST_TURN_DEG:
        return
    if _turning_deg(turns)[1] >= _LEAST_TURN_DEG:
        raise DegenerateGeometryError(
            f"too many of the {count} poses of the hand are half turns of each other (by more than "
            f"{_HALF_TURN_DEG:g}°), which do not show the sign of their axis; give further poses "
            "in between"
        )
    raise DegenerateGeometryError(
        f"the {count} poses of the hand are turned by at most {largest_deg:.1f}°, and by "
        f"{across_deg:.1f}° about a second axis, which does not show where the camera sits in the "
        f"hand; {_WHAT_TO_DO}"
    )


def _refuse_unpaired(seen: Sequence[Pose], hands: Sequence[Pose]) -> None:
    if len(seen) != len(hands):
        raise InputError(
            f"camera_from_target and base_from_hand must have one pose a view each, but there are "
            f"{len(seen)} and {len(hands)}; leave out the views of which only one is known"
        )


def _refuse_unseen_turning(motions: _Motions) -> None:
    largest_deg, across_deg = _turning_deg(motions.camera)
    # Noise must not make the difference to what the hand was allowed.
    if across_deg < _LEAST_TURN_DEG / 2:
        raise DegenerateGeometryError(
            f"the hand was turned about two axes, but the camera saw the target turn by at most "
            f"{largest_deg:.1f}°, and by {across_deg:.1f}° about a second axis; see whether each "
            "pose of the hand belongs to its view, and whether the target stood still"
        )


def _turning_deg(turns: Rotation) -> tuple[float, float]:
    """Largest angle, and largest share of one that is not about the main axis."""
    vectors = turns.as_rotvec(degrees=True)
    if not len(vectors):
        return 0.0, 0.0
    _, _, axes = np.linalg.svd(vectors, full_matrices=False)
    across = vectors - np.outer(vectors @ axes[0], axes[0])
    lengths = [np.linalg.norm(each, axis=1).max() for each in (vectors, across)]
    return float(lengths[0]), float(lengths[1])


def _certain(turns: Rotation) -> BoolArray:
    """Which turns are not half turns, or nearly."""
    return np.asarray(turns.magnitude() <= np.radians(_HALF_TURN_DEG))


def _rotations(poses: Sequence[Pose]) -> Rotation:
    return Rotation.from_matrix(np.stack([pose.rotation for pose in poses]))


def _translations_mm(poses: Sequence[Pose]) -> FloatArray:
    return np.stack([pose.translation_mm for pose in poses])


def _motions(seen: Sequence[Pose], hands: Sequence[Pose]) -> _Motions:
    """A and B of all pairs of views but half turns, both ways: with noise, the ways differ."""
    first, second = np.nonzero(~np.eye(len(hands), dtype=bool))
    hand, camera = _rotations(hands), _rotations(seen)
    hand_mm, camera_mm = _translations_mm(hands), _translations_mm(seen)
    hand_turn = hand[second].inv() * hand[first]
    camera_turn = camera[second] * camera[first].inv()
    certain = _certain(hand_turn)
    return _Motions(
        hand_turn[certain],
        hand[second].inv().apply(hand_mm[first] - hand_mm[second])[certain],
        camera_turn[certain],
        (camera_mm[second] - camera_turn.apply(camera_mm[first]))[certain],
    )


def _with_translation(rotation: Rotation, motions: _Motions) -> Pose:
    """Least squares over all pairs; those that turned further count for more, as they should."""
    design = motions.hand.as_matrix() - np.eye(3)
    wanted = rotation.apply(motions.camera_mm) - motions.hand_mm
    solution = np.linalg.lstsq(design.reshape(-1, 3), wanted.reshape(-1))[0]
    return Pose(rotation.as_matrix(), np.asarray(solution, dtype=np.float64))


def _park(motions: _Motions) -> Rotation:
    """The rotation that best turns the rotation vectors of the camera into those of the hand."""
    products = motions.hand.as_rotvec().T @ motions.camera.as_rotvec()
    return _nearest_rotation(products)


def _nearest_rotation(matrix: FloatArray) -> Rotation:
    left, _, right = np.linalg.svd(matrix)
    left[:, 2] *= np.linalg.det(left @ right)
    return Rotation.from_matrix(left @ right)


def _tsai_lenz(motions: _Motions) -> Rotation:
    """Linear in the Rodrigues vector of X.

    It is infinite for half a turn, so the equation is also solved in hand frames that are turned
    by half about x, y or z, and the best conditioned is taken: in one of them X turns by 120° or
    less.
    """
    camera = _half_sines(motions.camera)
    frames = Rotation.from_quat(np.eye(4))
    systems = []
    for frame in frames:
        hand = frame.apply(_half_sines(motions.hand), inverse=True)
        design = _cross(hand + camera).reshape(-1, 3)
        systems.append((np.linalg.norm(design, -2), design, (camera - hand).reshape(-1), frame))
    _, design, wanted, frame = max(systems, key=lambda system: system[0])
    rodrigues = np.linalg.lstsq(design, wanted)[0]
    return frame * Rotation.from_quat(np.append(rodrigues, 1.0))


def _half_sines(turns: Rotation) -> FloatArray:
    """(K, 3) axis times the sine of half the angle, the vector part of the quaternion."""
    return np.asarray(turns.as_quat(canonical=True)[:, :3])


def _cross(vectors: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices that multiply by a vector product from the left."""
    return np.cross(vectors[..., None, :], np.eye(3)).swapaxes(-1, -2)


def _horaud(motions: _Motions) -> Rotation:
    """The unit quaternion q with the least sum of ‖a q − q b‖², a and b weighed by half sines."""
    blocks = _commutators(_half_sines(motions.hand), _half_sines(motions.camera))
    _, _, right = np.linalg.svd(blocks.reshape(-1, 4), full_matrices=False)
    return Rotation.from_quat(right[3])


def _commutators(hand: FloatArray, camera: FloatArray) -> FloatArray:
    """(K, 4, 4) matrices of q → a q − q b for vectors a, b and q = (x, y, z, w)."""
    blocks = np.zeros((len(hand), 4, 4))
    blocks[:, :3, :3] = _cross(hand + camera)
    blocks[:, :3, 3] = hand - camera
    blocks[:, 3, :3] = camera - hand
    return blocks


def _andreff(motions: _Motions) -> Rotation:
    """Linear in the nine elements of the rotation and the translation, made a rotation after.

    Lengths are measured in that of a typical motion, so that their unit does not matter.
    """
    hand, camera = motions.hand.as_matrix(), motions.camera.as_matrix()
    camera_shift = motions.camera_mm / motions.typical_mm
    design, wanted = np.zeros((len(hand), 12, 12)), np.zeros((len(hand), 12))
    kronecker = np.einsum("kil,kjm->kijlm", hand, camera)
    design[:, :9, :9] = np.eye(9) - kronecker.reshape(-1, 9, 9)
    design[:, 9:, :9] = np.einsum("il,km->kilm", np.eye(3), camera_shift).reshape(-1, 3, 9)
    design[:, 9:, 9:] = np.eye(3) - hand
    wanted[:, 9:] = motions.hand_mm / motions.typical_mm
    solution = np.linalg.lstsq(design.reshape(-1, 12), wanted.reshape(-1))[0]
    matrix = np.asarray(solution[:9].reshape(3, 3), dtype=np.float64)
    scale = float(np.cbrt(np.linalg.det(matrix)))
    if not 1 / _SCALE < scale < _SCALE:
        raise DegenerateGeometryError(
            f"andreff gives the rotation of the camera in the hand a scale of {scale:.2g}, which "
            "should be 1: either the camera was turned but hardly moved, or the poses of the hand "
            "and those of the target contradict each other; move it between the turns, or use "
            "another method"
        )
    return _nearest_rotation(matrix)


def _daniilidis(motions: _Motions) -> Pose:
    """The unit dual quaternion q + ε q′ of X, in the plane of the two least singular vectors.

    Lengths are measured in that of a typical motion, so that their unit does not matter.
    """
    unit_mm = motions.typical_mm
    hand, camera = _half_sines(motions.hand), _half_sines(motions.camera)
    real = _commutators(hand, camera)[:, :3]
    dual = _commutators(
        _dual_vectors(motions.hand, motions.hand_mm / unit_mm),
        _dual_vectors(motions.camera, motions.camera_mm / unit_mm),
    )[:, :3]
    design = np.block([[real, np.zeros_like(real)], [dual, real]]).reshape(-1, 8)
    _, _, right = np.linalg.svd(design, full_matrices=False)
    quaternion, shift = _unit_dual_quaternion(right[6:].T)
    rotation = Rotation.from_quat(quaternion)
    # t = 2 q′ q̄, of which the scalar part is zero.
    vector, scalar = quaternion[:3], quaternion[3]
    translation = 2 * (scalar * shift[:3] - shift[3] * vector - np.cross(shift[:3], vector))
    return Pose(rotation.as_matrix(), unit_mm * translation)


def _dual_vectors(turns: Rotation, translations: FloatArray) -> FloatArray:
    """(K, 3) vector part of ½ t q, the dual part of a motion."""
    quaternions = turns.as_quat(canonical=True)
    across = np.cross(translations, quaternions[:, :3])
    return np.asarray(0.5 * (quaternions[:, 3:] * translations + across))


def _unit_dual_quaternion(basis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Combine two columns (8, 2) so that q · q′ = 0 and ‖q‖ = 1, in the solution with the larger q.

    The other solution is the spurious one without q. When noise leaves none, the nearest.
    """
    real, dual = basis[:4], basis[4:]
    form = real.T @ dual
    (low, high), axes = np.linalg.eigh(form + form.T)
    roots = np.sqrt(max(high, 0.0)), np.sqrt(max(-low, 0.0))
    factors = axes @ np.array([[roots[0], roots[0]], [roots[1], -roots[1]]])
    lengths = np.linalg.norm(real @ factors, axis=0)
    best = int(np.argmax(lengths))
    chosen = basis @ factors[:, best] / lengths[best]
    return chosen[:4], chosen[4:]


def _middle_rotation(rotations: Rotation) -> Rotation:
    """Weiszfeld's iteration to the least sum of angles."""
    middle = rotations.mean()
    for _ in range(_ROUNDS):
        distances = (middle.inv() * rotations).magnitude()
        middle = rotations.mean(1 / np.maximum(distances, _FINEST_RAD))
    return middle


_ROTATIONS: Final[dict[str, Callable[[_Motions], Rotation]]] = {
    "park": _park,
    "tsai-lenz": _tsai_lenz,
    "horaud": _horaud,
    "andreff": _andreff,
}
