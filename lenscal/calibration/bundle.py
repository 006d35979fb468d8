"""Least squares over one camera and the poses of all views, by Levenberg and Marquardt.

Every residual depends on the intrinsics and on one pose, so the normal equations are an arrow: the
6 × 6 blocks of the poses are eliminated view by view (Schur complement) and only a system of the
size of the intrinsics is solved.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.projection import Projection, project
from lenscal.calibration.views import State, Views
from lenscal.errors import DegenerateGeometryError

#: Steps after which a fit is left where it is; a well-posed one settles in less than ten.
_STEPS: Final = 100
#: A fit has settled when a whole step lowers the sum of squares by no more than this share: far
#: less than one parameter's worth of noise, and convergence is quadratic.
_SETTLED: Final = 1e-11
#: Or when the residuals are rounding, in px.
_ROUNDING_PX: Final = 1e-9
#: Damping to begin with: next to none, because first values are good.
_FIRST_DAMPING: Final = 1e-7
_LEAST_DAMPING: Final = 1e-12
#: Damping at which no descent direction is left.
_MOST_DAMPING: Final = 1e12
#: Reciprocal condition, after scaling, under which a system is not determined.
_SINGULAR: Final = 1e-15


def residuals(views: Views, state: State) -> FloatArray:
    """Subtract what was seen from what the parameters predict.

    Parameters
    ----------
    views
        The observations.
    state
        The parameters.

    Returns
    -------
    FloatArray
        (V, M, 2) px; zero in the padding, NaN where a point cannot be projected.
    """
    return _residuals(views, _project(views, state))


class Fit(NamedTuple):
    """Where a fit ended.

    Parameters
    ----------
    state
        The parameters.
    residuals_px
        (V, M, 2) prediction minus observation there.
    cost
        Weighted sum of squared residuals in px².
    settled
        Whether it converged, rather than ran out of steps.
    """

    state: State
    residuals_px: FloatArray
    cost: float
    settled: bool


def fit(
    views: Views, start: State, free: BoolArray, weights: FloatArray, steps: int = _STEPS
) -> Fit:
    """Minimise the weighted sum of squared pixel residuals.

    Parameters
    ----------
    views
        The observations.
    start
        First parameters.
    free
        (K,) which intrinsics may move; poses always do.
    weights
        (V, M) weight of each observation; those of weight zero, the padding too, are not looked at.
    steps
        How many steps may be taken.

    Returns
    -------
    Fit
        The best parameters reached.
    """
    point = _Point.at(views, start, weights)
    floor = _ROUNDING_PX**2 * float(weights.sum())
    damping, settled = _FIRST_DAMPING, False
    for _ in range(steps):
        system = _normal_equations(point.projection, point.residual, free, weights)
        while damping < _MOST_DAMPING:
            step = _step(system, free, damping)
            trial = _Point.at(views, point.state.moved(*step), weights)
            if trial.cost > point.cost:
                # Along a direction that the data hardly hold, the curvature that Gauss and Newton
                # neglect is as large as theirs, and a whole step overshoots again and again.
                share = _vertex(point.cost, _slope(system, free, step), trial.cost)
                shorter = point.state.moved(share * step[0], share * step[1])
                trial = min(trial, _Point.at(views, shorter, weights), key=lambda p: p.cost)
            # Rounding alone moves the cost of a finished fit.
            if trial.cost <= point.cost * (1 + _SETTLED) + floor:
                break
            damping *= 10
        else:
            return Fit(point.state, point.residual, point.cost, True)
        settled = point.cost - trial.cost <= _SETTLED * point.cost + floor and damping < 1.0
        point, damping = trial, max(damping / 10, _LEAST_DAMPING)
        if settled:
            break
    return Fit(point.state, point.residual, point.cost, settled)


class Covariance(NamedTuple):
    """Covariance of the parameters for residuals of unit variance.

    Parameters
    ----------
    intrinsics
        (K, K), zero for those held fixed.
    poses
        (V, 6, 6) of rotation vector and placement.
    cross
        (V, K, 6) between the two.
    """

    intrinsics: FloatArray
    poses: FloatArray
    cross: FloatArray

    def joint(self, view: int) -> FloatArray:
        """Put intrinsics and one pose together.

        Parameters
        ----------
        view
            The index of the view.

        Returns
        -------
        FloatArray
            (K + 6, K + 6).
        """
        return np.block(
            [[self.intrinsics, self.cross[view]], [self.cross[view].T, self.poses[view]]]
        )


def covariance(views: Views, state: State, free: BoolArray, weights: FloatArray) -> Covariance:
    """Invert the normal equations at a solution.

    Parameters
    ----------
    views
        The observations.
    state
        The solution.
    free
        (K,) which intrinsics moved.
    weights
        (V, M) weight of each observation.

    Returns
    -------
    Covariance
        To be multiplied by the variance of the noise.

    Raises
    ------
    DegenerateGeometryError
        When the observations leave a parameter undetermined.
    """
    projection = _project(views, state)
    system = _normal_equations(projection, _residuals(views, projection), free, weights)
    reduced, eliminated = _reduce(system.intrinsics, system.cross, system.poses)
    scale = np.sqrt(np.diag(system.intrinsics))
    normalised = reduced / np.outer(scale, scale)
    if not np.isfinite(normalised).all() or np.linalg.eigvalsh(normalised)[0] < _SINGULAR:
        raise DegenerateGeometryError(
            "the views do not determine the camera: two of its parameters have the same effect on "
            "every point; add views tilted by 20° or more in different directions, or hold the "
            "principal point fixed"
        )
    moved = np.linalg.inv(normalised) / np.outer(scale, scale)
    free_cross = -moved @ eliminated
    poses = np.linalg.inv(_solvable(system.poses)) - eliminated.transpose(0, 2, 1) @ free_cross
    count = len(free)
    full, cross = np.zeros((count, count)), np.zeros((len(poses), count, 6))
    full[np.ix_(free, free)] = moved
    cross[:, free] = free_cross
    return Covariance(full, poses, cross)


class _Point(NamedTuple):
    """Parameters, and what they predict."""

    state: State
    projection: Projection
    residual: FloatArray
    cost: float

    @classmethod
    def at(cls, views: Views, state: State, weights: FloatArray) -> _Point:
        projection = _project(views, state)
        residual = _residuals(views, projection)
        return cls(state, projection, residual, _cost(residual, weights))


def _slope(system: _System, free: BoolArray, step: tuple[FloatArray, FloatArray]) -> float:
    """Derivative of the cost along a step, at its start."""
    intrinsics = float(system.intrinsics_slope @ step[0][free])
    return 2 * (intrinsics + float((system.pose_slopes * step[1]).sum()))


def _vertex(cost: float, slope: float, ahead: float) -> float:
    """Where a parabola with this value and slope at 0 and that value at 1 is lowest."""
    if not np.isfinite(ahead) or slope >= 0:
        return 0.1
    return float(np.clip(-slope / (2 * (ahead - cost - slope)), 0.1, 1.0))


class _System(NamedTuple):
    """The blocks of the normal equations."""

    intrinsics: FloatArray
    cross: FloatArray
    poses: FloatArray
    intrinsics_slope: FloatArray
    pose_slopes: FloatArray


def _project(views: Views, state: State) -> Projection:
    return project(
        views.points_mm,
        state.intrinsics,
        state.rotations,
        state.placements,
        views.element_pitch_mm,
    )


def _residuals(views: Views, projection: Projection) -> FloatArray:
    return np.where(views.present[..., None], projection.pixels - views.pixels, 0.0)


def _cost(residual: FloatArray, weights: FloatArray) -> float:
    squared = np.where(weights > 0, (residual**2).sum(axis=-1) * weights, 0.0)
    return float(np.where(np.isnan(squared), np.inf, squared).sum())


def _normal_equations(
    projection: Projection, residual: FloatArray, free: BoolArray, weights: FloatArray
) -> _System:
    root = np.sqrt(weights)[..., None, None]
    jacobian = np.concatenate([projection.by_intrinsics[..., free], projection.by_pose], axis=-1)
    jacobian = np.where(root > 0, root * jacobian, 0.0)
    weighted = np.where(root[..., 0] > 0, root[..., 0] * residual, 0.0)
    views, width = len(jacobian), jacobian.shape[-1]
    rows = jacobian.reshape(views, -1, width)
    square = rows.transpose(0, 2, 1) @ rows
    slope = (rows.transpose(0, 2, 1) @ weighted.reshape(views, -1, 1))[..., 0]
    k = width - 6
    return _System(
        square[:, :k, :k].sum(axis=0),
        square[:, :k, k:],
        square[:, k:, k:],
        slope[:, :k].sum(axis=0),
        slope[:, k:],
    )


def _step(system: _System, free: BoolArray, damping: float) -> tuple[FloatArray, FloatArray]:
    """Solve the damped normal equations; Marquardt's scaling makes units irrelevant."""
    intrinsics = system.intrinsics + damping * np.diag(np.diag(system.intrinsics))
    poses = system.poses + damping * system.poses * np.eye(6)
    full = np.zeros(len(free))
    if free.any():
        reduced, eliminated = _reduce(intrinsics, system.cross, poses)
        slope = system.intrinsics_slope - np.einsum("vkp,vp->k", eliminated, system.pose_slopes)
        scale = np.sqrt(np.maximum(np.diag(intrinsics), np.finfo(float).tiny))
        normalised = reduced / np.outer(scale, scale)
        full[free] = np.linalg.lstsq(normalised, -slope / scale, rcond=1e-15)[0] / scale
    pull = system.pose_slopes + np.einsum("vkp,k->vp", system.cross, full[free])
    return full, -np.linalg.solve(_solvable(poses), pull[..., None])[..., 0]


def _reduce(
    intrinsics: FloatArray, cross: FloatArray, poses: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Eliminate the poses: the Schur complement, and cross · poses⁻¹."""
    eliminated = np.linalg.solve(_solvable(poses), cross.mT).mT.astype(np.float64)
    return intrinsics - np.einsum("vkp,vlp->kl", eliminated, cross), eliminated


def _solvable(poses: FloatArray) -> FloatArray:
    """Give the pose of a view without weight something to rest on."""
    empty = ~(np.abs(poses).max(axis=(1, 2)) > 0)
    solvable: FloatArray = poses + empty[:, None, None] * np.eye(6)
    return solvable
