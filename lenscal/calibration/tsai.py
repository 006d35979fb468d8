"""Tsai's calibration from one image of points in a plane or in space."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array, positive
from lenscal.calibration.bundle import fit
from lenscal.calibration.calibration import Calibration
from lenscal.calibration.conclusion import conclude
from lenscal.calibration.projection import (
    CENTRE_X,
    CENTRE_Y,
    DECENTRING_1,
    RADIAL,
    SCALE_FACTOR,
)
from lenscal.calibration.radial_alignment import TwoStage, two_stage
from lenscal.calibration.rejection import Selection
from lenscal.calibration.scale_factor import WORTHLESS, scale_factor_doubt
from lenscal.calibration.views import State, Views
from lenscal.errors import DegenerateGeometryError, InputError
from lenscal.sensor import Sensor

Method = Literal["full", "two_stage"]

#: Fewest coplanar points for the full optimisation, as Willson advises.
_LEAST_FULL: Final = 11


def calibrate_tsai(
    points_mm: npt.ArrayLike,
    pixels: npt.ArrayLike,
    sensor: Sensor,
    *,
    principal_point_px: npt.ArrayLike | None = None,
    scale_factor: float | None = None,
    method: Method = "full",
) -> Calibration:
    """Calibrate from a single image, as Tsai published it.

    Whether the points lie in a plane is recognised. D is measured to the plane z = 0 of the world.

    Parameters
    ----------
    points_mm
        (N, 3) points in the world.
    pixels
        (N, 2) where they were seen.
    sensor
        The sensor.
    principal_point_px
        (2,) where it is known and to be held fixed. None: estimated by the full method, taken to be
        the centre of the frame buffer by the two-stage method.
    scale_factor
        Where it is known and to be held fixed. None: estimated from points in space; that of the
        sensor with coplanar points, which cannot show it, and with points so nearly coplanar that
        it would be known to no better than 1 %, which a warning tells.
    method
        "two_stage" stops after the radial alignment and the refinement of d, T_z and κ1; "full"
        goes on to minimise the squared pixel residual over all parameters, and knows how good
        they are.

    Returns
    -------
    Calibration
        With one view. The two-stage solution warns when the world's origin is seen near the middle
        of the image or level with it, where Tsai's T_y vanishes: it is then solved about another
        point, and given for the world's origin all the same.

    Raises
    ------
    InputError
        When shapes do not match, a value is not finite, or the method is not known.
    DegenerateGeometryError
        When there are too few points, they lie on a line, or their plane is parallel to the sensor,
        or all but, so that d and T_z cannot be told apart.
    """
    points = frozen_array("points_mm", points_mm, ("N", 3))
    seen = frozen_array("pixels", pixels, ("N", 2))
    if len(points) != len(seen):
        raise InputError(f"there are {len(points)} points, but {len(seen)} pixels; give one each")
    if method not in ("full", "two_stage"):
        raise InputError(f"method must be 'full' or 'two_stage', but is {method!r}")
    centre = sensor.centre_px if principal_point_px is None else principal_point_px
    fixed = frozen_array("principal_point_px", centre, (2,))
    if scale_factor is not None:
        sensor = replace(sensor, scale_factor=positive("scale_factor", scale_factor))
    start = two_stage(points, seen, sensor, fixed, free_scale_factor=scale_factor is None)
    if method == "two_stage":
        return _as_it_is(points, seen, start)
    if len(points) < _LEAST_FULL:
        raise DegenerateGeometryError(
            f"{len(points)} points are too few for the full method, which needs {_LEAST_FULL}; "
            "use method='two_stage'"
        )
    free_centre = principal_point_px is None
    if start.coplanar or scale_factor is not None:
        return _optimised(points, seen, start, free_centre=free_centre, free_scale_factor=False)
    result = _optimised(points, seen, start, free_centre=free_centre, free_scale_factor=True)
    doubt = scale_factor_doubt(result)
    if doubt <= WORTHLESS:
        return result
    start = two_stage(points, seen, sensor, fixed, free_scale_factor=False)
    held = _optimised(points, seen, start, free_centre=free_centre, free_scale_factor=False)
    sentence = (
        f"the points are too nearly in one plane to show the scale factor (σ {100 * doubt:.2g} %); "
        f"that of the sensor, {sensor.scale_factor:g}, was kept"
    )
    return replace(held, warnings=(sentence, *held.warnings))


def _as_it_is(points: FloatArray, seen: FloatArray, start: TwoStage) -> Calibration:
    predicted = start.camera.project(start.camera_from_world.transform(points))
    missed = predicted - seen
    return Calibration(
        camera=start.camera,
        poses=(start.camera_from_world,),
        pixels=(seen,),
        residuals_px=(missed,),
        inliers=(np.ones(len(points), dtype=bool),),
        rejected=(),
        noise_px=float(np.sqrt(np.mean(missed**2))),
        focus_view=0,
        quantities=(),
        quantity_covariance=None,
        warnings=() if start.origin_mm is None else (_near_axis(start.origin_mm),),
    )


def _near_axis(origin_mm: FloatArray) -> str:
    x, y, z = origin_mm
    return (
        "T_y is near zero: the origin of the world is seen near the middle of the image, or level "
        f"with it, and Tsai's linear system divides by T_y; it was solved about ({x:.6g}, {y:.6g}, "
        f"{z:.6g}) mm instead"
    )


def _optimised(
    points: FloatArray,
    seen: FloatArray,
    start: TwoStage,
    *,
    free_centre: bool,
    free_scale_factor: bool,
) -> Calibration:
    sensor = start.camera.sensor
    views = Views.pad([points], [seen], np.array([sensor.pitch_x_mm, sensor.pitch_y_mm]))
    free = np.ones(RADIAL + 1, dtype=bool)
    free[[CENTRE_X, CENTRE_Y]] = free_centre
    free[SCALE_FACTOR] = free_scale_factor
    free[DECENTRING_1:RADIAL] = False
    first = State.of(start.camera, start.camera_from_world, views.middles_mm[0])
    result = fit(views, first, free, views.present.astype(float))
    selection = Selection(result.state, views.present, (), result.settled)
    return conclude(views, selection, sensor, free, focus_view=0)
