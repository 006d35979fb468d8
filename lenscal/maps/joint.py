"""The map adjusted to all corners of all settings at once.

A sample of a map is what one setting's views say by themselves; where they say little — frontal
views, few corners — a calibration has no answer, and the map a hole. Here every setting is asked at
the camera that the map believes in (`lenscal.calibration.summary`): its normal equations, the poses
eliminated, say where the corners would have the quantities and with which covariance. The surfaces
are fitted to these, the settings are asked again at the new camera, and so on until nothing moves:
Gauss and Newton's method on the coefficients, with all poses. At the end the samples of the map are
those answers, so that a joint map is saved, loaded and evaluated as any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd

from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.summary import RobotWord, SettingSummary, summarise_views
from lenscal.calibration.sweep import SweepOptions, robot_words
from lenscal.calibration.table import PAIRS
from lenscal.camera import Camera
from lenscal.errors import DegenerateGeometryError, InputError, MapError, OutOfDomainError
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.maps.pupil_fit import PUPIL_COLUMNS
from lenscal.recording import Recording, SettingRecord

#: Rounds of asking and fitting; three or four are needed.
_ROUNDS: Final = 12
#: Change of ln D at the samples, in units of its σ, at which nothing moves any more.
_STEADY: Final = 0.02
#: Quantities that a sample of a map has.
_SAMPLED: Final = (
    "magnification",
    "object_distance_mm",
    "standoff_mm",
    "principal_point_x_px",
    "principal_point_y_px",
    "k1_per_mm2",
    "nodal_x_mm",
    "nodal_y_mm",
)


def refine_lens_map(
    lens_map: LensMap,
    recording: Recording,
    *,
    use_robot: bool = True,
    repeatability: Repeatability | None = None,
) -> LensMap:
    """Adjust a map to the corners of all settings of its recording.

    Parameters
    ----------
    lens_map
        The map to begin with, fitted to the settings that could be calibrated by themselves.
    recording
        The recording; settings without a focus view are left out.
    use_robot
        Whether the poses that the robot reported count. A map with standoffs needs them.
    repeatability
        Of the robot; None to estimate it.

    Returns
    -------
    LensMap
        The map adjusted. Its samples are what each setting says at it; settings that could not be
        calibrated by themselves are among them.

    Raises
    ------
    InputError
        When the recording has no setting with a focus view.
    MapError
        When the map has no sensor, or has standoffs and the robot is not to be used.
    """
    if lens_map.sensor is None:
        raise MapError("this map was fitted without a sensor, so it has no camera to refine")
    if lens_map.has_standoff and not use_robot:
        raise MapError(
            "a map with standoffs cannot be refined without the robot: fit the map to a table "
            "without standoff_mm, or let the robot be used"
        )
    options = SweepOptions(use_robot=use_robot, repeatability=repeatability)
    words = robot_words(recording, options)
    asked = [
        (record, word)
        for record, word in zip(recording.settings, words, strict=True)
        if record.focus_view is not None and (word is not None or not lens_map.has_standoff)
    ]
    if not asked:
        raise InputError(
            "the recording has no setting that can be asked: one with a focus view, and with the "
            "robot's poses where the map has standoffs"
        )
    current, pupil = lens_map, _pupil_samples(lens_map)
    for _ in range(_ROUNDS):
        rows = _asked(current, asked)
        refined = fit_lens_map(
            pd.DataFrame(rows),
            sensor=current.sensor,
            reference_setting=current.reference_setting,
            identity=current.identity,
            pupil_samples=pupil,
        )
        moved = _moved(current, refined)
        current = refined
        if moved < _STEADY:
            break
    return current


def _asked(
    lens_map: LensMap, asked: Sequence[tuple[SettingRecord, RobotWord | None]]
) -> list[dict[str, float]]:
    """Ask all settings at the map's cameras; those whose views do not go with it are left out."""
    rows = []
    for record, word in asked:
        camera = _camera(lens_map, record)
        try:
            summary = summarise_views(
                camera,
                [view.observation.points_mm for view in record.views],
                [view.observation.pixels for view in record.views],
                record.focus_view or 0,
                word,
            )
        except DegenerateGeometryError:
            continue
        rows.append(_row(record, summary, camera.sensor.scale_factor))
    return rows


def _pupil_samples(lens_map: LensMap) -> pd.DataFrame | None:
    """Keep what the focus curves said of the entrance pupil; corners say nothing of it."""
    samples = lens_map.samples
    columns = ["zoom", "focus", "image_distance_mm", *PUPIL_COLUMNS]
    own = samples[columns].dropna() if set(columns) <= set(samples.columns) else None
    parts = [part for part in (own, lens_map.pupil_samples) if part is not None and len(part)]
    return pd.concat(parts, ignore_index=True) if parts else None


def _camera(lens_map: LensMap, record: SettingRecord) -> Camera:
    """Give the camera that the map believes in; beyond its domain that of the nearest setting."""
    zoom, focus = record.setting.zoom, record.setting.focus
    try:
        return lens_map.camera_at(zoom, focus)
    except OutOfDomainError:
        samples = lens_map.samples
        settings = samples[["zoom", "focus"]].to_numpy(float)
        span = np.maximum(np.ptp(settings, axis=0), 1e-12)
        nearest = np.argmin((((settings - (zoom, focus)) / span) ** 2).sum(axis=1))
        return lens_map.camera_at(*(float(s) for s in settings[nearest]))


def _row(record: SettingRecord, summary: SettingSummary, scale_factor: float) -> dict[str, float]:
    """Write what a setting says as a sample of a map."""
    covariance = summary.covariance
    row: dict[str, float] = {
        "zoom": record.setting.zoom,
        "focus": record.setting.focus,
        "iris": np.nan if record.setting.iris is None else record.setting.iris,
        "rms_px": summary.rms_px,
        "corners": summary.corners,
        # Corners were asked with it, not for it.
        "scale_factor": scale_factor,
    }
    known = [name for name in _SAMPLED if name in summary.names]
    for name in known:
        place = summary.names.index(name)
        row[name] = summary.value(name)
        row[f"sigma_{name}"] = float(np.sqrt(covariance[place, place]))
    for a, b in PAIRS:
        if a in known and b in known:
            row[f"cov_{a}_{b}"] = float(covariance[summary.names.index(a), summary.names.index(b)])
    if record.focus is not None:
        row["sigma_sharpest_mm"] = record.focus.sigma_mm
        row["sharpest_confidence"] = record.focus.confidence
        if "standoff_mm" in known:
            total = np.hypot(row["sigma_standoff_mm"], record.focus.sigma_mm)
            row["sigma_standoff_mm"] = float(total)
    return row


def _moved(before: LensMap, after: LensMap) -> float:
    """Largest change of D at the samples, in its σ."""
    zoom, focus = (after.samples[name].to_numpy(float) for name in ("zoom", "focus"))
    inside = before.domain.contains(zoom, focus)
    if not inside.all():
        return np.inf
    quantity = "object_distance_mm"
    change = after.value(quantity, zoom, focus) - before.value(quantity, zoom, focus)
    return float(np.abs(change / after.sigma(quantity, zoom, focus)).max())
