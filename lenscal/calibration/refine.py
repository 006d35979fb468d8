"""Many views at one setting: joint refinement of the camera and every pose on pixel residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from lenscal.calibration.bundle import covariance, fit, residuals
from lenscal.calibration.calibration import Calibration
from lenscal.calibration.diagnosis import diagnose, inseparable
from lenscal.calibration.initial import homographies, initial_state, state_of
from lenscal.calibration.projection import (
    CENTRE_X,
    CENTRE_Y,
    DECENTRING_1,
    PERSPECTIVE,
    RADIAL,
    SCALE_FACTOR,
    camera_of,
)
from lenscal.calibration.rejection import Rejection, Selection, fit_robustly
from lenscal.calibration.uncertainty import quantity_covariance, quantity_names
from lenscal.calibration.views import State, Views
from lenscal.camera import Camera
from lenscal.errors import (
    CalibrationError,
    ConvergenceError,
    DegenerateGeometryError,
    InputError,
)
from lenscal.sensor import Sensor

#: How far from its plane a target may be bent, as a share of its extent.
_FLAT: Final = 0.01
#: Noise, as a share of the diagonal of the frame buffer, that no detector makes.
_NONSENSE: Final = 0.02


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
) -> Calibration:
    """Calibrate a camera from several views of a flat target.

    Minimises the squared pixel distance of predicted and observed points over d, the principal
    point, the distortion and one pose a view.

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
    return conclude(views, _among_all(selection, views, usable), sensor, free, focus_view)


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
    sensor = camera.sensor
    undistorted = [
        camera.undistort((np.asarray(p) - camera.centre_px) * sensor.sample_pitch_mm)
        / sensor.sample_pitch_mm
        + camera.centre_px
        for p in pixels
    ]
    views = _checked_views(points_mm, pixels, sensor)
    matrices, usable = homographies(_checked_views(points_mm, undistorted, sensor))
    if not usable.all():
        raise DegenerateGeometryError(_too_little(views, int(np.argmin(usable))))
    start = state_of(camera, matrices)
    none = np.zeros(len(start.intrinsics), dtype=bool)
    result = fit(views, start, none, views.present.astype(float))
    return tuple(r[:, p].T for r, p in zip(result.residuals_px, views.present, strict=True))


def conclude(
    views: Views, selection: Selection, sensor: Sensor, free: BoolArray, focus_view: int | None
) -> Calibration:
    """Turn a fit into a calibration: noise, covariance, diagnosis.

    Parameters
    ----------
    views
        All observations.
    selection
        The fit, with what it believed.
    sensor
        The sensor.
    free
        (K,) which intrinsics were estimated.
    focus_view
        The view D is measured to, or None.

    Returns
    -------
    Calibration
        The result.

    Raises
    ------
    CalibrationError
        When no camera explains the observations.
    DegenerateGeometryError
        When there are not more observations than parameters, or they do not determine the camera.
    ConvergenceError
        When the fit did not settle.
    """
    state, inliers = selection.state, selection.inliers
    missed = residuals(views, state)
    squares = float((missed**2).sum(axis=1)[inliers].sum())
    used = inliers.any(axis=1)
    freedom = 2 * int(inliers.sum()) - int(free.sum()) - 6 * int(used.sum())
    if freedom <= 0:
        raise DegenerateGeometryError(
            f"{int(inliers.sum())} points in {int(used.sum())} views are too few for the "
            f"{int(free.sum()) + 6 * int(used.sum())} parameters asked for; add views or "
            "points, or hold the principal point fixed"
        )
    noise_px = float(np.sqrt(squares / freedom))
    if not noise_px < _NONSENSE * np.hypot(sensor.width_px, sensor.height_px):
        raise CalibrationError(
            f"the views agree with no camera: at best, points miss by {noise_px:.0f} px; check "
            "that the target is described as it is, and that zoom and focus were left alone "
            "between the pictures"
        )
    if not state.intrinsics[PERSPECTIVE] > 0:
        flipped = replace(state, intrinsics=np.abs(state.intrinsics))
        raise DegenerateGeometryError(inseparable(flipped.poses(views.middles_mm), np.inf))
    camera = camera_of(state.intrinsics, sensor)
    if not selection.settled:
        raise ConvergenceError(
            "the fit did not settle; hold the principal point fixed or estimate fewer distortion "
            "terms",
            camera,
            squares,
            0,
        )
    notes: list[str] = []
    if focus_view is not None and focus_view not in np.flatnonzero(used):
        notes.append(f"the focus view (view {focus_view}) was rejected, so that D is not known")
        focus_view = None
    unit = covariance(views, state, free, inliers.astype(float))
    result = Calibration(
        camera=camera,
        poses=state.poses(views.middles_mm),
        residuals_px=tuple(r[:, p].T for r, p in zip(missed, views.present, strict=True)),
        inliers=tuple(i[p] for i, p in zip(inliers, views.present, strict=True)),
        rejected=selection.rejections,
        noise_px=noise_px,
        focus_view=focus_view,
        quantities=quantity_names(len(free), focus_view is not None),
        quantity_covariance=quantity_covariance(
            state, views.middles_mm, unit, noise_px, focus_view
        ),
    )
    return replace(result, warnings=(*notes, *diagnose(result)))


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
        height, extent = np.abs(world[-1][:, 2]), np.ptp(world[-1], axis=0)
        if len(height) and height.max() > _FLAT * np.linalg.norm(extent):
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
