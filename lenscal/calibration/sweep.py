"""All settings of a recording: one calibration each, one table of all."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version

import numpy as np
import numpy.typing as npt
import pandas as pd

from lenscal.calibration.calibration import Calibration, axial_distance_mm
from lenscal.calibration.refine import calibrate_views
from lenscal.calibration.table import COLUMNS, PAIRS, CalibrationTable, Failure
from lenscal.document import Json, digest
from lenscal.errors import CalibrationError, InputError, LensCalError
from lenscal.progress import Progress
from lenscal.recording import Head, Recording, SettingRecord, head_to_json, setting_to_json

Row = dict[str, float | str]


@dataclass(frozen=True, slots=True)
class SweepOptions:
    """How every setting is calibrated; see `calibrate_views`.

    Parameters
    ----------
    principal_point_px
        Where it is held fixed, or None to estimate it.
    radial_terms
        How many radial coefficients are estimated.
    decentring
        Whether p1 and p2 are estimated.
    """

    principal_point_px: tuple[float, float] | None = None
    radial_terms: int = 1
    decentring: bool = False


def calibrate_recording(
    recording: Recording,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    principal_point_px: npt.ArrayLike | None = None,
    radial_terms: int = 1,
    decentring: bool = False,
) -> CalibrationTable:
    """Calibrate every setting of a recording.

    Parameters
    ----------
    recording
        The recording, complete or broken off.
    workers
        Processes to share the work; None for this one alone, which is quicker up to some dozens of
        settings.
    progress
        Told after each setting how many are done, of how many, and which was the last.
    principal_point_px
        (2,) where it is known and to be held fixed; None to estimate it at every setting.
    radial_terms
        How many radial coefficients are estimated.
    decentring
        Whether p1 and p2 are estimated.

    Returns
    -------
    CalibrationTable
        One row per setting that could be calibrated; the others are among its failures.

    Raises
    ------
    InputError
        When the recording has no settings.
    CalibrationError
        When no setting could be calibrated.
    """
    total = len(recording.settings)
    if not total:
        raise InputError("the recording has no finished setting; record a session first")
    fixed = None
    if principal_point_px is not None:
        x, y = np.asarray(principal_point_px, dtype=np.float64)
        fixed = float(x), float(y)
    work = partial(
        calibrate_setting,
        recording.head,
        options=SweepOptions(fixed, radial_terms, decentring),
    )
    rows: list[Row] = []
    evidence: list[Json] = []
    failures: list[Failure] = []
    outcomes = _outcomes(work, recording.settings, workers)
    for done, (record, outcome) in enumerate(zip(recording.settings, outcomes, strict=True), 1):
        if isinstance(outcome, str):
            failures.append(Failure(record.setting.zoom, record.setting.focus, outcome))
        else:
            rows.append(outcome[0])
            evidence.append(outcome[1])
        if progress is not None:
            progress(done, total, str(record.setting))
    if not rows:
        raise CalibrationError(
            f"none of the {total} settings could be calibrated; the first "
            f"({recording.settings[0].setting}): {failures[0].reason}"
        )
    return CalibrationTable(
        rows=pd.DataFrame(rows, columns=list(COLUMNS)),
        sensor=recording.head.sensor,
        reference_setting=recording.head.reference_setting,
        recording_sha256=_hash(recording),
        failures=tuple(failures),
        evidence=tuple(evidence),
        versions={name: version(name) for name in ("lenscal", "numpy", "scipy")},
    )


def calibrate_setting(
    head: Head, record: SettingRecord, options: SweepOptions
) -> tuple[Row, Json] | str:
    """Calibrate one setting.

    Parameters
    ----------
    head
        What holds for all settings.
    record
        The setting.
    options
        How.

    Returns
    -------
    row, evidence
        A row of the table and what stands behind it; or a sentence that says why there is none.
    """
    try:
        if record.focus_view is None:
            raise CalibrationError("its focus view was lost, so that D is not known")
        calibration = calibrate_views(
            [view.observation.points_mm for view in record.views],
            [view.observation.pixels for view in record.views],
            head.sensor,
            focus_view=record.focus_view,
            principal_point_px=options.principal_point_px,
            radial_terms=options.radial_terms,
            decentring=options.decentring,
        )
        if calibration.focus_view is None:
            raise CalibrationError("its focus view was rejected, so that D is not known")
        return _row(head, record, calibration), _evidence(record, calibration)
    except LensCalError as error:
        return str(error)


def standoff_mm(head: Head, record: SettingRecord) -> float:
    """Tell how far the reference projection centre stood from the target plane in the focus view.

    Parameters
    ----------
    head
        With the hand-eye calibration and the place of the target.
    record
        The setting.

    Returns
    -------
    float
        Along the optical axis in mm, from the robot's poses alone; NaN where there are none.
    """
    hand = None if record.focus_view is None else record.views[record.focus_view].base_from_hand
    if hand is None or head.hand_from_camera is None or head.base_from_target is None:
        return np.nan
    reference_from_target = (hand @ head.hand_from_camera).inverse() @ head.base_from_target
    return axial_distance_mm(reference_from_target)


def _outcomes(
    work: Callable[[SettingRecord], tuple[Row, Json] | str],
    records: tuple[SettingRecord, ...],
    workers: int | None,
) -> Iterator[tuple[Row, Json] | str]:
    if workers is None or workers < 2:
        yield from map(work, records)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        yield from pool.map(work, records, chunksize=max(1, len(records) // (4 * workers)))


def _row(head: Head, record: SettingRecord, calibration: Calibration) -> Row:
    standoff = standoff_mm(head, record)
    sharpest = np.nan if record.focus is None else record.focus.sigma_mm
    row: Row = {
        "zoom": record.setting.zoom,
        "focus": record.setting.focus,
        "iris": np.nan if record.setting.iris is None else record.setting.iris,
        "magnification": calibration.magnification,
        "object_distance_mm": calibration.object_distance_mm,
        "image_distance_mm": calibration.image_distance_mm,
        "focal_length_mm": calibration.focal_length_mm,
        "standoff_mm": standoff,
        "nodal_offset_mm": calibration.object_distance_mm - standoff,
        "principal_point_x_px": float(calibration.camera.centre_px[0]),
        "principal_point_y_px": float(calibration.camera.centre_px[1]),
        "k1_per_mm2": calibration.camera.k1_per_mm2,
        "rms_px": calibration.rms_px,
        "views": sum(bool(used.any()) for used in calibration.inliers),
        "corners": sum(int(used.sum()) for used in calibration.inliers),
        "rejected_corners": sum(int((~used).sum()) for used in calibration.inliers),
        "approach": record.approach.value,
        "sigma_standoff_mm": np.nan if np.isnan(standoff) else sharpest,
        "sigma_sharpest_mm": sharpest,
    }
    # The nodal offset inherits the error of D: the standoff is known so much better.
    source = {"nodal_offset_mm": "object_distance_mm"}
    known = {q for q in row if q in calibration.quantities} | source.keys()
    for quantity in known:
        row[f"sigma_{quantity}"] = calibration.sigma(source.get(quantity, quantity))
    for a, b in PAIRS:
        pair = [source.get(a, a), source.get(b, b)]
        row[f"cov_{a}_{b}"] = float(calibration.covariance(pair)[0, 1])
    if np.isnan(standoff):
        for column in row:
            if "nodal_offset_mm" in column:
                row[column] = np.nan
    return row


def _evidence(record: SettingRecord, calibration: Calibration) -> Json:
    names = list(calibration.quantities)
    return {
        "zoom": record.setting.zoom,
        "focus": record.setting.focus,
        "noise_px": calibration.noise_px,
        "quantities": names,
        "covariance": calibration.covariance(names).tolist(),
        "poses": [pose.matrix.tolist() for pose in calibration.poses],
        "rms_px_of_views": [
            float(np.sqrt((r[i] ** 2).sum(axis=1).mean())) if i.any() else None
            for r, i in zip(calibration.residuals_px, calibration.inliers, strict=True)
        ],
        "rejected": [
            {
                "view": r.view,
                "point_id": None
                if r.point is None
                else int(record.views[r.view].observation.ids[r.point]),
                "residual_px": r.residual_px if np.isfinite(r.residual_px) else None,
                "reason": r.reason,
            }
            for r in calibration.rejected
        ],
        "warnings": list(calibration.warnings),
    }


def _hash(recording: Recording) -> str:
    return digest(
        {
            "head": head_to_json(recording.head),
            "settings": [setting_to_json(record) for record in recording.settings],
        }
    )
