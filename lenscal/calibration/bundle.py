"""Least squares over one camera and the poses of all views, by Levenberg and Marquardt.

Every residual depends on what the views share and on one pose, so the normal equations are an
arrow: the 6 × 6 blocks of the poses are eliminated view by view (Schur complement), and only a
system of the size of what is shared is solved. Shared are the intrinsics and, where a robot carried
the camera, the mounting; what the robot knows of the poses enters as `Knowledge` besides the
pixels.
"""

from __future__ import annotations

from typing import Final, NamedTuple, Protocol

import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.projection import Projection, project, project_with_derivatives
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


class System(NamedTuple):
    """The blocks of normal equations.

    Parameters
    ----------
    shared
        (k, k) of the free shared parameters.
    cross
        (V, k, 6) between these and each pose.
    poses
        (V, 6, 6).
    shared_slope
        (k,) half the derivative of the cost.
    pose_slopes
        (V, 6) the same of each pose.
    """

    shared: FloatArray
    cross: FloatArray
    poses: FloatArray
    shared_slope: FloatArray
    pose_slopes: FloatArray

    def plus(self, other: System) -> System:
        """Add the equations of further observations.

        Parameters
        ----------
        other
            Theirs, of the same parameters.

        Returns
        -------
        System
            The equations of both.
        """
        return System(*(mine + its for mine, its in zip(self, other, strict=True)))


class Knowledge(Protocol):
    """What is known besides the pixels, as a sum of squares in the weight of pixels."""

    def cost(self, state: State) -> float:
        """Sum the squares.

        Parameters
        ----------
        state
            The parameters.

        Returns
        -------
        float
            The sum in px².
        """

    def system(self, state: State, free: BoolArray) -> System:
        """Linearise.

        Parameters
        ----------
        state
            The parameters.
        free
            (K,) or (K + 12,) which shared parameters move.

        Returns
        -------
        System
            The normal equations of the sum.
        """


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
        (V, 2, M) px; zero in the padding, NaN where a point cannot be projected.
    """
    pixels = project(
        views.points_mm,
        state.intrinsics,
        state.rotations,
        state.placements,
        views.element_pitch_mm,
    )
    return _residuals(views, pixels)


class Fit(NamedTuple):
    """Where a fit ended.

    Parameters
    ----------
    state
        The parameters.
    residuals_px
        (V, 2, M) prediction minus observation there.
    jacobian
        (V, k + 6, 2, M) its derivatives by what was free.
    cost
        Weighted sum of squared residuals in px², with what else is known.
    settled
        Whether it converged, rather than ran out of steps.
    """

    state: State
    residuals_px: FloatArray
    jacobian: FloatArray
    cost: float
    settled: bool


def fit(
    views: Views,
    start: State | Fit,
    free: BoolArray,
    weights: FloatArray,
    *,
    knowledge: Knowledge | None = None,
    steps: int = _STEPS,
) -> Fit:
    """Minimise the weighted sum of squared pixel residuals.

    Parameters
    ----------
    views
        The observations.
    start
        First parameters, or an earlier fit with the same free ones, which saves its work.
    free
        (K,) which intrinsics may move, (K + 12,) with those of the mounting; poses always do.
    weights
        (V, M) weight of each observation; those of weight zero, the padding too, are not looked at.
    knowledge
        What is known besides.
    steps
        How many steps may be taken.

    Returns
    -------
    Fit
        The best parameters reached.
    """
    problem = _Problem(views, free, weights, knowledge)
    point = problem.at(start) if isinstance(start, State) else problem.resume(start)
    floor = _ROUNDING_PX**2 * float(weights.sum())
    damping, settled = _FIRST_DAMPING, False
    for _ in range(steps):
        system = problem.system(point)
        while damping < _MOST_DAMPING:
            step = _step(system, free, damping)
            if -_slope(system, free, step) <= _SETTLED * point.cost + floor and damping < 1.0:
                return Fit(*point, settled=True)
            trial = problem.at(point.state.moved(*step))
            if trial.cost > point.cost:
                # Along a direction that the data hardly hold, the curvature that Gauss and Newton
                # neglect is as large as theirs, and a whole step overshoots again and again.
                share = _vertex(point.cost, _slope(system, free, step), trial.cost)
                shorter = problem.at(point.state.moved(share * step[0], share * step[1]))
                trial = min(trial, shorter, key=lambda p: p.cost)
            # Rounding alone moves the cost of a finished fit.
            if trial.cost <= point.cost * (1 + _SETTLED) + floor:
                break
            damping *= 10
        else:
            return Fit(*point, settled=True)
        settled = point.cost - trial.cost <= _SETTLED * point.cost + floor and damping < 1.0
        point, damping = trial, max(damping / 10, _LEAST_DAMPING)
        if settled:
            break
    return Fit(*point, settled=settled)


class Covariance(NamedTuple):
    """Covariance of the parameters for residuals of unit variance.

    Parameters
    ----------
    shared
        (K, K) or (K + 12, K + 12), zero for those held fixed.
    poses
        (V, 6, 6) of rotation vector and placement.
    cross
        (V, K, 6) between the two.
    """

    shared: FloatArray
    poses: FloatArray
    cross: FloatArray

    def joint(self, view: int) -> FloatArray:
        """Put shared parameters and one pose together.

        Parameters
        ----------
        view
            The index of the view.

        Returns
        -------
        FloatArray
            (K + 6, K + 6).
        """
        return np.block([[self.shared, self.cross[view]], [self.cross[view].T, self.poses[view]]])


def covariance(
    views: Views,
    state: State,
    free: BoolArray,
    weights: FloatArray,
    knowledge: Knowledge | None = None,
) -> Covariance:
    """Invert the normal equations at a solution.

    Parameters
    ----------
    views
        The observations.
    state
        The solution.
    free
        (K,) or (K + 12,) which shared parameters moved.
    weights
        (V, M) weight of each observation.
    knowledge
        What is known besides.

    Returns
    -------
    Covariance
        To be multiplied by the variance of the noise.

    Raises
    ------
    DegenerateGeometryError
        When the observations leave a parameter undetermined.
    """
    problem = _Problem(views, free, weights, knowledge)
    return _inverted(problem.system(problem.at(state)), free)


def _inverted(system: System, free: BoolArray) -> Covariance:
    """Invert normal equations, or refuse those that leave a parameter undetermined."""
    inverse_poses: FloatArray = np.linalg.inv(_solvable(system.poses)).astype(np.float64)
    reduced, eliminated = _reduce(system.shared, system.cross, inverse_poses)
    scale = np.sqrt(np.diag(system.shared))
    with np.errstate(invalid="ignore", divide="ignore"):
        normalised = reduced / np.outer(scale, scale)
    if not np.isfinite(normalised).all() or np.linalg.eigvalsh(normalised)[0] < _SINGULAR:
        raise DegenerateGeometryError(
            "the views do not determine the camera: two of its parameters have the same effect on "
            "every point; add views tilted by 20° or more in different directions, or hold the "
            "principal point fixed"
        )
    moved = np.linalg.inv(normalised) / np.outer(scale, scale)
    free_cross = -moved @ eliminated
    poses = inverse_poses - eliminated.mT @ free_cross
    count = len(free)
    full, cross = np.zeros((count, count)), np.zeros((len(poses), count, 6))
    full[np.ix_(free, free)] = moved
    cross[:, free] = free_cross
    return Covariance(full, poses, cross)


class OneStep(NamedTuple):
    """The normal equations at some parameters, solved once.

    Parameters
    ----------
    shared_step
        (K,) or (K + 12,), zero for those held fixed.
    pose_steps
        (V, 6).
    covariance
        For unit noise.
    start_squares
        Weighted sum of the squared pixel residuals at the start in px².
    cost
        The cost that the linear model expects after the step, in px².
    """

    shared_step: FloatArray
    pose_steps: FloatArray
    covariance: Covariance
    start_squares: float
    cost: float


def solve_once(
    views: Views,
    state: State,
    free: BoolArray,
    weights: FloatArray,
    knowledge: Knowledge | None = None,
) -> OneStep:
    """Take one step of Gauss and Newton, and say how well it is known where it leads.

    Parameters
    ----------
    views
        The observations.
    state
        Where to linearise.
    free
        (K,) or (K + 12,) which shared parameters may move.
    weights
        (V, M) weight of each observation.
    knowledge
        What is known besides.

    Returns
    -------
    OneStep
        The step and its covariance.

    Raises
    ------
    DegenerateGeometryError
        When the observations leave a parameter undetermined.
    """
    problem = _Problem(views, free, weights, knowledge)
    point = problem.at(state)
    system = problem.system(point)
    step = _step(system, free, 0.0)
    squares = np.where(weights > 0, weights * (point.residual**2).sum(axis=1), 0.0)
    return OneStep(
        *step,
        _inverted(system, free),
        float(squares.sum()),
        point.cost + _slope(system, free, step) / 2,
    )


class _Point(NamedTuple):
    """Parameters, and what they predict."""

    state: State
    residual: FloatArray
    jacobian: FloatArray
    cost: float


class _Problem:
    """What stays the same while parameters move."""

    def __init__(
        self, views: Views, free: BoolArray, weights: FloatArray, knowledge: Knowledge | None
    ) -> None:
        self._views, self._free, self._knowledge = views, free, knowledge
        self._counted = weights > 0
        self._root = np.sqrt(np.where(self._counted, weights, 0.0))[:, None]

    def at(self, state: State) -> _Point:
        intrinsics = state.intrinsics
        projection: Projection = project_with_derivatives(
            self._views.points_mm,
            intrinsics,
            state.rotations,
            state.placements,
            self._views.element_pitch_mm,
            self._free[: len(intrinsics)],
        )
        residual = _residuals(self._views, projection.pixels)
        return _Point(state, residual, projection.jacobian, self._cost(state, residual))

    def resume(self, fit: Fit) -> _Point:
        cost = self._cost(fit.state, fit.residuals_px)
        return _Point(fit.state, fit.residuals_px, fit.jacobian, cost)

    def _cost(self, state: State, residual: FloatArray) -> float:
        weighted = np.where(self._counted[:, None], residual, 0.0) * self._root
        cost = float((weighted**2).sum())
        if self._knowledge is not None:
            cost += self._knowledge.cost(state)
        return np.inf if np.isnan(cost) else cost

    def system(self, point: _Point) -> System:
        # A point that cannot be projected pulls nowhere.
        valid = np.isfinite(point.residual) & self._counted[:, None]
        views = len(valid)
        weighted = np.where(valid, point.residual, 0.0) * self._root
        rows = (point.jacobian * (self._root * valid)[:, None]).reshape(views, -1, valid[0].size)
        square = rows @ rows.transpose(0, 2, 1)
        slope = (rows @ weighted.reshape(views, -1, 1))[..., 0]
        # The mounting stands after the intrinsics and moves no pixel of its own.
        k, total = rows.shape[1] - 6, int(self._free.sum())
        shared, cross = np.zeros((total, total)), np.zeros((views, total, 6))
        shared_slope = np.zeros(total)
        shared[:k, :k] = square[:, :k, :k].sum(axis=0)
        cross[:, :k] = square[:, :k, k:]
        shared_slope[:k] = slope[:, :k].sum(axis=0)
        system = System(shared, cross, square[:, k:, k:], shared_slope, slope[:, k:])
        if self._knowledge is None:
            return system
        return system.plus(self._knowledge.system(point.state, self._free))


def _slope(system: System, free: BoolArray, step: tuple[FloatArray, FloatArray]) -> float:
    """Derivative of the cost along a step, at its start."""
    shared = float(system.shared_slope @ step[0][free])
    return 2 * (shared + float((system.pose_slopes * step[1]).sum()))


def _vertex(cost: float, slope: float, ahead: float) -> float:
    """Where a parabola with this value and slope at 0 and that value at 1 is lowest."""
    if not np.isfinite(ahead) or slope >= 0:
        return 0.1
    return float(np.clip(-slope / (2 * (ahead - cost - slope)), 0.1, 1.0))


def _residuals(views: Views, pixels: FloatArray) -> FloatArray:
    return np.where(views.present[:, None], pixels - views.pixels, 0.0)


def _step(system: System, free: BoolArray, damping: float) -> tuple[FloatArray, FloatArray]:
    """Solve the damped normal equations; Marquardt's scaling makes units irrelevant."""
    shared = system.shared + damping * np.diag(np.diag(system.shared))
    damped = system.poses + damping * system.poses * np.eye(6)
    poses = np.linalg.inv(_solvable(damped)).astype(np.float64)
    full = np.zeros(len(free))
    if free.any():
        reduced, eliminated = _reduce(shared, system.cross, poses)
        slope = system.shared_slope - (eliminated @ system.pose_slopes[..., None]).sum(axis=0)[:, 0]
        scale = np.sqrt(np.maximum(np.diag(shared), np.finfo(float).tiny))
        normalised = reduced / np.outer(scale, scale)
        full[free] = np.linalg.lstsq(normalised, -slope / scale, rcond=1e-15)[0] / scale
    pull = system.pose_slopes + full[free] @ system.cross
    return full, -(poses @ pull[..., None])[..., 0]


def _reduce(
    shared: FloatArray, cross: FloatArray, inverse_poses: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Eliminate the poses: the Schur complement, and cross · poses⁻¹."""
    eliminated = cross @ inverse_poses
    return shared - (eliminated @ cross.mT).sum(axis=0), eliminated


def _solvable(poses: FloatArray) -> FloatArray:
    """Give the pose of a view without weight something to rest on."""
    empty = ~(np.abs(poses).max(axis=(1, 2)) > 0)
    solvable: FloatArray = poses + empty[:, None, None] * np.eye(6)
    return solvable
