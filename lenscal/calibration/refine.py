"""Many views at one setting: joint refinement of the camera and every pose on pixel residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from lenscal.calibration.bundle import fit, residuals
from lenscal.calibration.calibration import Calibration, Repeatability
from lenscal.calibration.conclusion import (
    Reference,
    conclude,
    conclude_with_robot,
    refuse_nonsense,
)
from lenscal.calibration.initial import homographies, initial_state, state_before
from lenscal.calibration.projection import (
    CENTRE_X,
    CENTRE_Y,
    DECENTRING_1,
    RADIAL,
    SCALE_FACTOR,
)
from lenscal.calibration.rejection import Rejection, Selection, fit_robustly
from lenscal.calibration.rig_constrained import check_hands, fit_with_robot
from lenscal.calibration.scale_factor import (
    refuse_one_orientation,
    refuse_unseen_scale_factor,
)
from lenscal.calibration.slips import MountingPrior
from lenscal.calibration.views import State, Views
from lenscal.camera import Camera
from lenscal.errors import DegenerateGeometryError, InputError
from lenscal.pose import Pose
from lenscal.sensor import Sensor

#: How far from its plane a target may be bent, as a share of its extent.
_FLAT: Final = 0.01


def calibrate_views(
    points_mm: Sequence[npt.ArrayLike],
    pixels: Sequence[npt.ArrayLike],
    sensor: Sensor,
    *,
    focus_view: int | None = 0,
    principal_point_px: npt.ArrayLike | None = None,
    free_scale_factor: bool = False,
    radial_terms: int = 1,
    decentring: bool = False,
    reject_outliers: bool = True,
    hand_poses: Sequence[Pose | None] | None = None,
    hand_from_camera: Pose | None = None,
    hand_eye_sigma: tuple[float, float] | None = None,
    repeatability: Repeatability | None = None,
    mounting_prior: MountingPrior | None = None,
) -> Calibration:
    """Calibrate a camera from several views of a flat target.

    Minimises the squared pixel distance of predicted and observed points over d, the principal
    point, the distortion and one pose a view. Where a robot carried the camera, the poses are tied
    by what it said, each loosened by its repeatability (`lenscal.calibration.rig_constrained`):
    displacements of the camera then show D apart from d, and D is measured to the target plane
    where the robot says it was.

    Parameters
    ----------
    points_mm
        One (N, 3) array a view: the points seen there, in the target frame, z = 0.
    pixels
        One (N, 2) array a view: where they were seen.
    sensor
        The sensor.
    focus_view
        Index of the view that shows the plane in sharpest focus, which D is measured to; None when
        there is none.
    principal_point_px
        (2,) where it is known and to be held fixed; None to estimate it.
    free_scale_factor
        Whether the scale factor is estimated, starting from that of the sensor.
    radial_terms
        How many radial coefficients are estimated: 1 for κ1 alone, 0 for none.
    decentring
        Whether p1 and p2 are estimated.
    reject_outliers
        Whether bad corners and bad views are left out. Without it every point counts, and views of
        fewer than four points or with points on a line are an error.
    hand_poses
        ``base_from_hand`` of each view as the robot reported it, None for a view without; at least
        three, the hand turned about two axes.
    hand_from_camera
        The reference camera in the hand, which nodal offset and standoff are counted from; None
        where it is not known.
    hand_eye_sigma
        How well `hand_from_camera` is known: σ of its rotation about each axis in rad and of each
        coordinate in mm. It is part of σ of the nodal offset, not of that of the standoff, in which
        it cancels where the same statement places the camera. None to leave it out.
    repeatability
        Of the robot; None to estimate it from these views.
    mounting_prior
        What other settings of the session know of how camera and target are mounted.

    Returns
    -------
    Calibration
        The camera with its evidence.

    Raises
    ------
    InputError
        When views, points and pixels do not match, a value is not finite, a target is not flat, or
        an option makes no sense.
    CalibrationError
        When the views do not determine a camera; `DegenerateGeometryError` when a known degeneracy
        is to blame.
    ConvergenceError
        When the fit does not settle.
    """
    views = _checked_views(points_mm, pixels, sensor)
    if focus_view is not None and not 0 <= focus_view < len(views.present):
        raise InputError(f"focus_view {focus_view} is not among the {len(views.present)} views")
    if hand_poses is not None:
        check_hands(hand_poses, len(views.present))
    if radial_terms < 0:
        raise InputError(f"radial_terms must be 0 or more, but is {radial_terms}")
    terms = max(1, radial_terms)
    free = np.ones(RADIAL + terms, dtype=bool)
    free[[CENTRE_X, CENTRE_Y]] = principal_point_px is None
    free[SCALE_FACTOR] = free_scale_factor
    free[DECENTRING_1:RADIAL] = decentring
    free[RADIAL + radial_terms :] = False
    centre = sensor.centre_px if principal_point_px is None else principal_point_px

    matrices, usable = homographies(views)
    if not reject_outliers and not usable.all():
        raise DegenerateGeometryError(_too_little(views, int(np.argmin(usable))))
    if not usable.any():
        raise DegenerateGeometryError(f"no view can be used: {_too_little(views, 0)}")
    kept = views.select(usable)
    start = initial_state(
        kept, matrices[usable], sensor, frozen_array("principal_point_px", centre, (2,)), terms
    )
    if reject_outliers:
        selection = fit_robustly(kept, start, free)
    else:
        result = fit(kept, start, free, kept.present.astype(float))
        selection = Selection(result.state, kept.present, (), result.settled)
    selection = _among_all(selection, views, usable)
    if hand_poses is None:
        if free_scale_factor:
            refuse_one_orientation(selection.state.rotations[selection.inliers.any(axis=1)])
        return _seen(conclude(views, selection, sensor, free, focus_view))
    refuse_nonsense(residuals(views, selection.state), selection.inliers, sensor)
    robot = fit_with_robot(
        views, selection, free, hand_poses, repeatability=repeatability, prior=mounting_prior
    )
    focus_hand = None if focus_view is None else hand_poses[focus_view]
    return _seen(
        conclude_with_robot(
            views,
            selection,
            sensor,
            robot,
            Reference(focus_view, focus_hand, hand_from_camera, hand_eye_sigma or (0.0, 0.0)),
        )
    )


def fit_poses(
    camera: Camera, points_mm: Sequence[npt.ArrayLike], pixels: Sequence[npt.ArrayLike]
) -> tuple[FloatArray, ...]:
    """Fit the poses of some views to a known camera.

    Parameters
    ----------
    camera
        Held fixed.
    points_mm
        One (N, 3) array a view, flat.
    pixels
        One (N, 2) array a view.

    Returns
    -------
    tuple of FloatArray
        One (N, 2) array of residuals a view: predicted minus observed in px.

    Raises
    ------
    DegenerateGeometryError
        When a view has fewer than four points, or they lie on a line.
    """
    views = _checked_views(points_mm, pixels, camera.sensor)
    start, usable = state_before(camera, views)
    if not usable.all():
        raise DegenerateGeometryError(_too_little(views, int(np.argmin(usable))))
    none = np.zeros(len(start.intrinsics), dtype=bool)
    result = fit(views, start, none, views.present.astype(float))
    return tuple(r[:, p].T for r, p in zip(result.residuals_px, views.present, strict=True))


def _checked_views(
    points_mm: Sequence[npt.ArrayLike], pixels: Sequence[npt.ArrayLike], sensor: Sensor
) -> Views:
    if not len(points_mm) == len(pixels) or not len(points_mm):
        raise InputError(
            f"points_mm and pixels must hold one array a view, at least one; given are "
            f"{len(points_mm)} and {len(pixels)}"
        )
    world, image = [], []
    for view, (points, seen) in enumerate(zip(points_mm, pixels, strict=True)):
        world.append(frozen_array(f"points_mm[{view}]", points, ("N", 3)))
        image.append(frozen_array(f"pixels[{view}]", seen, ("N", 2)))
        if len(world[-1]) != len(image[-1]):
            raise InputError(
                f"view {view} has {len(world[-1])} points, but {len(image[-1])} pixels; give one "
                "each"
            )
        if not len(world[-1]):
            continue
        height, extent = np.abs(world[-1][:, 2]), np.ptp(world[-1], axis=0)
        if height.max() > _FLAT * np.linalg.norm(extent):
            raise InputError(
                f"the points of view {view} are not in the plane z = 0, off by up to "
                f"{height.max():.3g} mm; use calibrate_tsai for points in space"
            )
    _refuse_copies(image)
    return Views.pad(world, image, np.array([sensor.pitch_x_mm, sensor.pitch_y_mm]))


def _refuse_copies(pixels: Sequence[FloatArray]) -> None:
    """A picture given twice would pass for a second opinion."""
    first: dict[bytes, int] = {}
    for view, seen in enumerate(pixels):
        earlier = first.setdefault(seen.tobytes(), view)
        if earlier != view and len(seen):
            raise InputError(
                f"views {earlier} and {view} are the same to the last digit; give each picture once"
            )


def _too_little(views: Views, view: int) -> str:
    count = int(views.present[view].sum())
    if count < 4:
        return f"view {view} shows {count} points, and at least 4 are needed"
    return f"the {count} points of view {view} lie on a line or do not fit a plane"


def _among_all(selection: Selection, views: Views, usable: BoolArray) -> Selection:
    """Put the unusable views back in their places."""
    if usable.all():
        return selection
    count = len(usable)
    rotations, placements = np.tile(np.eye(3), (count, 1, 1)), np.ones((count, 3))
    inliers = np.zeros_like(views.present)
    rotations[usable] = selection.state.rotations
    placements[usable] = selection.state.placements
    inliers[usable] = selection.inliers
    number = np.flatnonzero(usable)
    rejections = [
        *(replace(r, view=int(number[r.view])) for r in selection.rejections),
        *(
            Rejection(int(view), None, np.nan, _too_little(views, int(view)))
            for view in np.flatnonzero(~usable)
        ),
    ]
    return Selection(
        State(selection.state.intrinsics, rotations, placements),
        inliers,
        tuple(sorted(rejections, key=lambda r: r.view)),
        selection.settled,
    )


def _seen(calibration: Calibration) -> Calibration:
    """Pass a calibration on unless its scale factor, where it was free, was not to be seen."""
    refuse_unseen_scale_factor(calibration)
    return calibration
