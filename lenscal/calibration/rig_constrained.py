"""One setting seen from a robot: the views are tied by where the robot says it stood.

The intrinsics, the mounting and a pose a view are fitted together, the slips of the robot weighed
by its repeatability. Displacements along the axis, which the robot knows, then show D apart from d,
and turns of the hand show where the projection centre lies in it. The repeatability is estimated
from the slips themselves, as a variance component (Förstner 1979): the sum of their squares over
the number of them that no parameter follows. Views in which the robot slipped by far more are found
and stand for themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.bundle import Covariance, covariance, fit, residuals
from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.hand_eye_equation import (
    base_from_target,
    refuse_too_little_turning,
    solve_hand_eye_equation,
)
from lenscal.calibration.mounting import COUNT, Mounting
from lenscal.calibration.projection import PERSPECTIVE
from lenscal.calibration.rejection import Selection
from lenscal.calibration.slips import MountingPrior, Slips
from lenscal.calibration.views import State, Views, placement_of
from lenscal.errors import DegenerateGeometryError, InputError
from lenscal.pose import Pose

#: Rounds of fitting and weighing; some five are needed.
_ROUNDS: Final = 30
#: Relative change of the weights at which they have settled.
_STEADY: Final = 0.01
#: What an industrial arm does, in rad and mm, and as how many observations this counts. A few views
#: tell a turn of the hand from a shift so badly that one of the two could come out as nothing.
_TYPICAL: Final = np.array([1e-4, 0.02])
_TYPICAL_COUNT: Final = 1.0
#: Fewest poses that mount a camera, and the share of them that has to agree.
_LEAST_POSES: Final = 3
_LEAST_BELIEVED: Final = 0.7
#: How often a faultless session may lose a good pose.
_FALSE_ALARMS: Final = 1e-4
#: How many times the noise of the corners may grow when the robot is believed.
_GROWTH: Final = 1.5
#: Residuals that are rounding, in px.
_ROUNDING_PX: Final = 1e-6
#: Repeatability in rad, or as a share of the distance, from which it is none.
_NONSENSE: Final = 0.02
#: Share of a slip that a fit leaves free at least, in the eyes of the test for plausibility.
_LEAST_SHARE: Final = 0.01
#: Median length of a three-dimensional Gaussian vector, in σ.
_MEDIAN_LENGTH: Final = float(np.sqrt(chi2.median(3)))


class RobotFit(NamedTuple):
    """What came of the fit with a robot.

    Parameters
    ----------
    state
        The parameters, with the mounting.
    settled
        Whether the last fit converged.
    noise_px
        σ of one observed coordinate.
    repeatability
        Of the robot, as estimated or as given.
    redundancy
        (2,) observations of rotations and translations of the robot that the fit leaves free: how
        much stands behind the estimate of the repeatability.
    slips
        (V, 6) of each view, rotation in rad and translation in mm, in the frame of the hand; NaN
        where no pose was told.
    believed
        (V,) which poses of the robot were used.
    notes
        Which were not, and why, in words.
    covariance
        Of all parameters, for unit noise.
    """

    state: State
    settled: bool
    noise_px: float
    repeatability: Repeatability
    redundancy: FloatArray
    slips: FloatArray
    believed: BoolArray
    notes: tuple[str, ...]
    covariance: Covariance


def fit_with_robot(
    views: Views,
    selection: Selection,
    free: BoolArray,
    hands: Sequence[Pose | None],
    *,
    repeatability: Repeatability | None = None,
    prior: MountingPrior | None = None,
) -> RobotFit:
    """Fit intrinsics, mounting and poses to the pixels and to what the robot said.

    Parameters
    ----------
    views
        The observations.
    selection
        A fit without the robot, with what it believed; the corners stay as chosen there.
    free
        (K,) which intrinsics may move.
    hands
        V times ``base_from_hand`` as reported, or None.
    repeatability
        Of the robot, where it is known; None to estimate it.
    prior
        What other settings know of the mounting.

    Returns
    -------
    RobotFit
        The result.

    Raises
    ------
    DegenerateGeometryError
        When the hand was not turned enough to show how the camera sits on it.
    """
    told = np.array([hand is not None for hand in hands]) & selection.inliers.any(axis=1)
    start = _start(views, selection, hands, told, prior)
    all_free = np.concatenate([free, np.ones(COUNT, dtype=bool)])
    weights = selection.inliers.astype(float)
    first_px = noise_px = _first_noise(selection, views, free)
    untied = Slips.of(hands, views.middles_mm, noise_px, (1.0, 1.0), told, prior)
    free_poses = replace(selection.state, mounting=start.mounting)
    sigma = repeatability or _typical(untied.measure(free_poses)[told])
    believed, state, settled = told, start, False
    for _ in range(_ROUNDS):
        slips = Slips.of(hands, views.middles_mm, noise_px, _pair(sigma), believed, prior)
        result = fit(views, state, all_free, weights, knowledge=slips)
        state, settled = result.state, result.settled
        unit = covariance(views, state, all_free, weights, slips)
        measured = slips.measure(state)
        followed = _followed(slips, state, unit, noise_px, sigma)
        share = np.clip(np.diagonal(followed, axis1=1, axis2=2), 0.0, 1.0).reshape(-1, 2, 3)
        redundancy = (1 - share[believed]).sum(axis=(0, 2))
        pixels = float((result.residuals_px**2).sum(axis=1)[selection.inliers].sum())
        free_pixels = _pixel_redundancy(selection, all_free, believed, redundancy, prior)
        updated_px = float(np.sqrt(pixels / free_pixels))
        updated = repeatability or _components(measured, believed, redundancy)
        keep = told & _plausible(
            measured, followed, believed, sigma, known=repeatability is not None
        )
        steady = _steady((noise_px, *_pair(sigma)), (updated_px, *_pair(updated))) and bool(
            (keep == believed).all()
        )
        if steady:
            break
        noise_px, sigma, believed = updated_px, updated, keep
        _refuse_few(believed, told)
    _refuse_nonsense(sigma, state, noise_px / max(first_px, _ROUNDING_PX))
    measured = np.where(told[:, None], measured, np.nan)
    return RobotFit(
        state,
        settled,
        noise_px,
        sigma,
        redundancy,
        measured,
        believed,
        _notes(measured, told & ~believed, sigma),
        unit,
    )


def check_hands(hands: Sequence[Pose | None], views: int) -> None:
    """Refuse poses that do not go with the views.

    Parameters
    ----------
    hands
        The poses of the hand.
    views
        How many views there are.

    Raises
    ------
    InputError
        When the counts disagree.
    """
    if len(hands) != views:
        raise InputError(
            f"hand_poses must hold one pose a view (or None where it is not known), but there are "
            f"{len(hands)} for {views} views"
        )


def _start(
    views: Views,
    selection: Selection,
    hands: Sequence[Pose | None],
    told: BoolArray,
    prior: MountingPrior | None,
) -> State:
    """Mount the camera by what others know, or else by the closed form."""
    poses = selection.state.poses(views.middles_mm)
    seen = [pose for pose, used in zip(poses, told, strict=True) if used]
    reported = [hand for hand, used in zip(hands, told, strict=True) if used and hand is not None]
    if prior is not None and reported:
        mounting = _mounted(prior.mean, seen, reported)
    else:
        refuse_too_little_turning(reported)
        hand_from_camera = solve_hand_eye_equation(seen, reported)
        mounting = Mounting(
            hand_from_camera.inverse(), base_from_target(hand_from_camera, seen, reported)
        )
    state = replace(selection.state, mounting=mounting)
    # A target seen squarely fits two poses, tilted either way; the robot knows which is meant.
    rotations, placements = state.rotations.copy(), state.placements.copy()
    for view, hand in enumerate(hands):
        if hand is None or not told[view]:
            continue
        pose = mounting.camera_from_target(hand)
        rotations[view] = pose.rotation
        placements[view] = placement_of(pose, views.middles_mm[view], state.intrinsics)
    return replace(state, rotations=rotations, placements=placements)


def _mounted(mean: Mounting, seen: Sequence[Pose], reported: Sequence[Pose]) -> Mounting:
    """Keep directions and target of a mounting, and place the camera where the views have it."""
    target_from_base = mean.base_from_target.inverse()
    hands = [
        pose.transform(target_from_base.transform(hand.translation_mm))
        for pose, hand in zip(seen, reported, strict=True)
    ]
    return Mounting(
        Pose(mean.camera_from_hand.rotation, np.median(hands, axis=0)), mean.base_from_target
    )


def _first_noise(selection: Selection, views: Views, free: BoolArray) -> float:
    """σ of a pixel in the fit without the robot."""
    squares = (residuals(views, selection.state) ** 2).sum(axis=1)[selection.inliers].sum()
    fitted = int(free.sum()) + 6 * int(selection.inliers.any(axis=1).sum())
    return float(np.sqrt(squares / max(2 * int(selection.inliers.sum()) - fitted, 1)))


def _typical(slips: FloatArray) -> Repeatability:
    """Judge the robot by its middling views, which one wild pose does not move."""
    lengths = np.linalg.norm(slips.reshape(-1, 2, 3), axis=2)
    rotation, translation = np.maximum(np.median(lengths, axis=0) / _MEDIAN_LENGTH, _TYPICAL)
    return Repeatability(rotation_rad=float(rotation), translation_mm=float(translation))


def _pair(sigma: Repeatability) -> tuple[float, float]:
    return sigma.rotation_rad, sigma.translation_mm


def _followed(
    slips: Slips, state: State, unit: Covariance, noise_px: float, sigma: Repeatability
) -> FloatArray:
    """(V, 6, 6) covariance of the slips as fitted, in units of the repeatability."""
    by_shared, by_pose = slips.jacobians(state)
    scale = noise_px / np.repeat(_pair(sigma), 3)
    jacobian = scale[:, None] * np.concatenate([by_shared, by_pose], axis=2)
    joint = np.stack([unit.joint(view) for view in range(len(jacobian))])
    followed: FloatArray = jacobian @ joint @ jacobian.mT
    return followed


def _pixel_redundancy(
    selection: Selection,
    free: BoolArray,
    believed: BoolArray,
    redundancy: FloatArray,
    prior: MountingPrior | None,
) -> float:
    """Count the pixel coordinates that no parameter follows."""
    observed = 2 * int(selection.inliers.sum()) + 6 * int(believed.sum())
    fitted = int(free.sum()) + 6 * int(selection.inliers.any(axis=1).sum())
    known = 0 if prior is None else int(np.linalg.matrix_rank(prior.information))
    return max(observed + known - fitted - float(redundancy.sum()), 1.0)


def _components(measured: FloatArray, believed: BoolArray, redundancy: FloatArray) -> Repeatability:
    """Estimate the two variances from the slips, and a little from what robots are like."""
    squares = (measured[believed].reshape(-1, 2, 3) ** 2).sum(axis=(0, 2))
    squares, count = squares + _TYPICAL_COUNT * _TYPICAL**2, redundancy + _TYPICAL_COUNT
    rotation, translation = np.sqrt(squares / count)
    return Repeatability(rotation_rad=float(rotation), translation_mm=float(translation))


def _plausible(
    measured: FloatArray,
    followed: FloatArray,
    believed: BoolArray,
    sigma: Repeatability,
    *,
    known: bool,
) -> BoolArray:
    """(V,) whether chance makes such a slip.

    Where the repeatability is not known, each view is judged by that of the others, of rotations
    and of translations apart: a wild pose makes the whole robot look wild, itself excepted.
    """
    scaled = (measured / np.repeat(_pair(sigma), 3)).reshape(-1, 2, 3)
    # Poses that were used pull the fit towards them; it knows nothing of those left out.
    sign = np.where(believed, -1.0, 1.0)[:, None, None, None]
    blocks = np.stack([followed[:, :3, :3], followed[:, 3:, 3:]], axis=1)
    spread = (1 + _LEAST_SHARE) * np.eye(3) + sign * blocks
    squared = (scaled[..., None, :] @ np.linalg.solve(spread, scaled[..., None]))[..., 0, 0]
    alarms = _FALSE_ALARMS / (2 * max(int(believed.sum()), 1))
    if known:
        return np.asarray((squared <= chi2.isf(alarms, 3)).all(axis=1))
    own = np.clip(np.trace(spread, axis1=2, axis2=3), 0.0, 3.0) * believed[:, None]
    others = own.sum(axis=0) - own
    lengths = (scaled**2).sum(axis=2) * believed[:, None]
    variance = (lengths.sum(axis=0) - lengths) / np.maximum(others, 1.0)
    limit = 3 * variance * f_distribution.isf(alarms, 3, np.maximum(others, 1.0))
    return np.asarray((squared <= limit).all(axis=1))


def _refuse_nonsense(sigma: Repeatability, state: State, growth: float) -> None:
    """Refuse poses that no robot could have reported of these pictures."""
    distance = float(np.median(1.0 / (state.intrinsics[PERSPECTIVE] * state.placements[:, 2])))
    wild = sigma.rotation_rad > _NONSENSE or sigma.translation_mm > _NONSENSE * abs(distance)
    if wild or growth > _GROWTH:
        raise DegenerateGeometryError(
            "the poses that the robot reported do not go with the pictures: it would stand "
            f"{sigma.translation_mm:.3g} mm and {np.degrees(sigma.rotation_rad):.2g}° from where "
            f"it said, and corners would miss by {growth:.2g} times as much as without it; "
            "check that each pose belongs to its picture, that it is base_from_hand and "
            "not its inverse, that the target stood still, and that lengths are in mm"
        )


def _steady(before: tuple[float, ...], after: tuple[float, ...]) -> bool:
    return bool(np.allclose(before, after, rtol=_STEADY, atol=0.0))


def _refuse_few(believed: BoolArray, told: BoolArray) -> None:
    if believed.sum() < max(_LEAST_POSES, _LEAST_BELIEVED * told.sum()):
        raise DegenerateGeometryError(
            f"only {int(believed.sum())} of the {int(told.sum())} poses that the robot reported "
            "agree with one another and with the pictures; check that each pose belongs to its "
            "picture and that the target stood still"
        )


def _notes(measured: FloatArray, lost: BoolArray, sigma: Repeatability) -> tuple[str, ...]:
    return tuple(
        f"in view {view} the robot stood {np.linalg.norm(measured[view, 3:]):.3g} mm and "
        f"{1e3 * np.linalg.norm(measured[view, :3]):.3g} mrad from where it said (repeatability "
        f"{sigma.translation_mm:.2g} mm, {1e3 * sigma.rotation_rad:.2g} mrad); the picture was "
        "used without the pose"
        for view in np.flatnonzero(lost)
    )
