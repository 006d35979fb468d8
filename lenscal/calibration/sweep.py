"""All settings of a recording: one calibration each, one table of all.

Where a robot carried the camera, the settings are calibrated twice: first each from its own views,
then with what the others know of the robot and of how camera and target are mounted.
"""

from __future__ import annotations

import dataclasses
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from lenscal.calibration.calibration import Calibration, Repeatability, RobotEvidence
from lenscal.calibration.pooling import pool_repeatability, pool_settings
from lenscal.calibration.refine import calibrate_views
from lenscal.calibration.slips import MountingPrior
from lenscal.calibration.summary import RobotWord
from lenscal.calibration.table import COLUMNS, CalibrationTable, Failure
from lenscal.calibration.table_row import Row, evidence_of, row_of
from lenscal.document import Json, digest
from lenscal.errors import CalibrationError, InputError, LensCalError
from lenscal.progress import Progress
from lenscal.recording import Head, Recording, SettingRecord, head_to_json, setting_to_json
from lenscal.setting import LensSetting

Mapper = Callable[[Callable[["Job"], Any], Sequence["Job"]], Iterator[Any]]

#: Settings that are enough to learn how well a robot repeats.
_ROBOT_SETTINGS: Final = 16
#: Rounds of doing so, and the relative change at which it is known.
_ROBOT_ROUNDS: Final = 8
_STEADY: Final = 0.03


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
    free_scale_factor
        Whether the scale factor is estimated.
    use_robot
        Whether the poses that the robot reported tie the views.
    repeatability
        Of the robot; None to estimate it.
    """

    principal_point_px: tuple[float, float] | None = None
    radial_terms: int = 1
    decentring: bool = False
    free_scale_factor: bool = False
    use_robot: bool = True
    repeatability: Repeatability | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """One setting to be calibrated, with what the others say.

    Parameters
    ----------
    record
        The setting.
    repeatability
        Of the robot; None to estimate it.
    prior
        What other settings know of the mounting.
    note
        A warning to go on record.
    """

    record: SettingRecord
    repeatability: Repeatability | None = None
    prior: MountingPrior | None = None
    note: str | None = None


def calibrate_recording(
    recording: Recording,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    principal_point_px: npt.ArrayLike | None = None,
    radial_terms: int = 1,
    decentring: bool = False,
    free_scale_factor: bool = False,
    use_robot: bool = True,
    repeatability: Repeatability | None = None,
) -> CalibrationTable:
    """Calibrate every setting of a recording.

    Parameters
    ----------
    recording
        The recording, complete or broken off.
    workers
        Processes to share the work; None for this one alone, which is quicker up to some dozens of
        settings. A script that asks for more has to keep its own work under
        ``if __name__ == "__main__":``, as always with processes.
    progress
        Told after each setting how many are done, of how many, and which was the last.
    principal_point_px
        (2,) where it is known and to be held fixed; None to estimate it at every setting.
    radial_terms
        How many radial coefficients are estimated.
    decentring
        Whether p1 and p2 are estimated.
    free_scale_factor
        Whether the scale factor is estimated at every setting, starting from that of the sensor.
    use_robot
        Whether the poses that the robot reported tie the views of each setting, where there are
        any. Without them D and the nodal offset rest on perspective alone.
    repeatability
        Of the robot; None to estimate it from all settings.

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
    options = SweepOptions(
        fixed, radial_terms, decentring, free_scale_factor, use_robot, repeatability
    )
    with _mapper(workers, total) as run:
        jobs = _jobs(recording, options, run)
        rows: list[Row] = []
        evidence: list[Json] = []
        failures: list[Failure] = []
        outcomes = run(partial(calibrate_setting, recording.head, options=options), jobs)
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
        identity=recording.head.identity,
    )


def calibrate_setting(head: Head, job: Job, options: SweepOptions) -> tuple[Row, Json] | str:
    """Calibrate one setting.

    Parameters
    ----------
    head
        What holds for all settings.
    job
        The setting.
    options
        How.

    Returns
    -------
    row, evidence
        A row of the table and what stands behind it; or a sentence that says why there is none.
    """
    try:
        if job.record.focus_view is None:
            raise CalibrationError("its focus view was lost, so that D is not known")
        calibration = _calibrate(head, job, options)
        if calibration.focus_view is None:
            raise CalibrationError("its focus view was rejected, so that D is not known")
        return row_of(head, job.record, calibration), evidence_of(job.record, calibration)
    except LensCalError as error:
        return str(error)


def robot_words(
    recording: Recording, options: SweepOptions | None = None
) -> tuple[RobotWord | None, ...]:
    """Tell what the robot says of each setting, with what the other settings know.

    Parameters
    ----------
    recording
        The recording.
    options
        How settings are calibrated to learn it; None for the usual way.

    Returns
    -------
    tuple of RobotWord or None
        One per setting; None where no robot took its focus view, or none was used.
    """
    chosen = options or SweepOptions()
    return tuple(
        RobotWord(
            tuple(view.base_from_hand for view in job.record.views),
            job.repeatability,
            job.prior,
            recording.head.hand_from_camera,
        )
        if chosen.use_robot and _has_robot(job.record) and job.repeatability is not None
        else None
        for job in _jobs(recording, chosen, map)
    )


def calibration_of(
    recording: Recording, setting: LensSetting, options: SweepOptions | None = None
) -> Calibration:
    """Calibrate one setting of a recording as the sweep does, to look at its residuals.

    Parameters
    ----------
    recording
        The recording.
    setting
        Zoom and focus of the setting.
    options
        How; None for the usual way.

    Returns
    -------
    Calibration
        With what the other settings know of the robot.

    Raises
    ------
    InputError
        When the setting was not recorded.
    CalibrationError, ConvergenceError
        When it cannot be calibrated.
    """
    chosen = options or SweepOptions()
    wanted = setting.zoom, setting.focus
    for job in _jobs(recording, chosen, map):
        if (job.record.setting.zoom, job.record.setting.focus) == wanted:
            return _calibrate(recording.head, job, chosen)
    raise InputError(
        f"zoom {setting.zoom:g}, focus {setting.focus:g} is not among the "
        f"{len(recording.settings)} settings of the recording"
    )


def _calibrate(head: Head, job: Job, options: SweepOptions) -> Calibration:
    """Calibrate with the robot, or say why not and calibrate without."""
    solve = partial(
        calibrate_views,
        [view.observation.points_mm for view in job.record.views],
        [view.observation.pixels for view in job.record.views],
        head.sensor,
        focus_view=job.record.focus_view,
        principal_point_px=options.principal_point_px,
        radial_terms=options.radial_terms,
        decentring=options.decentring,
        free_scale_factor=options.free_scale_factor,
    )
    if not (options.use_robot and _has_robot(job.record)):
        return solve()
    try:
        calibration = solve(
            hand_poses=[view.base_from_hand for view in job.record.views],
            hand_from_camera=head.hand_from_camera,
            hand_eye_sigma=_hand_eye_sigma(head),
            repeatability=job.repeatability,
            mounting_prior=job.prior,
        )
        notes = () if job.note is None else (job.note,)
    except CalibrationError as error:
        calibration = solve()
        notes = (f"the poses of the robot were not used: {error}",)
    return replace(calibration, warnings=(*notes, *calibration.warnings))


def _measure(head: Head, job: Job, options: SweepOptions) -> RobotEvidence | None:
    """Tell what one setting knows of the robot by itself; None when it knows nothing."""
    try:
        return _calibrate(head, job, options).robot
    except LensCalError:
        return None  # calibrate_setting will meet the same trouble and report it


def _jobs(recording: Recording, options: SweepOptions, run: Mapper) -> Sequence[Job]:
    """List the settings, each with what the others know where a robot took the views."""
    jobs = [Job(record, options.repeatability) for record in recording.settings]
    if not (options.use_robot and any(_has_robot(record) for record in recording.settings)):
        return jobs
    return _informed(jobs, partial(_measure, recording.head, options=options), run)


def _informed(
    jobs: Sequence[Job], measure: Callable[[Job], RobotEvidence | None], run: Mapper
) -> Sequence[Job]:
    """Give every setting what the others know."""
    repeatability = jobs[0].repeatability or _repeatability(jobs, measure, run)
    if repeatability is None:
        return jobs
    jobs = [replace(job, repeatability=repeatability) for job in jobs]
    measured = list(run(measure, jobs))
    known = [evidence for evidence in measured if evidence is not None]
    if not known:
        return jobs
    pool = pool_settings(known)
    shared = iter(zip(pool.priors, pool.notes, strict=True))
    informed = []
    for job, evidence in zip(jobs, measured, strict=True):
        prior, note = (pool.everybody, None) if evidence is None else next(shared)
        informed.append(replace(job, prior=prior, note=note))
    return informed


def _repeatability(
    jobs: Sequence[Job], measure: Callable[[Job], RobotEvidence | None], run: Mapper
) -> Repeatability | None:
    """Estimate the repeatability of the robot from some settings, all together."""
    stride = -(-len(jobs) // _ROBOT_SETTINGS)
    believed: Repeatability | None = None
    for _ in range(_ROBOT_ROUNDS):
        sample = [replace(job, repeatability=believed) for job in jobs[::stride]]
        known = [evidence for evidence in run(measure, sample) if evidence is not None]
        if not known:
            return None
        previous, believed = believed, pool_repeatability(known)
        if previous is not None and np.allclose(
            dataclasses.astuple(previous), dataclasses.astuple(believed), rtol=_STEADY
        ):
            break
    return believed


def _hand_eye_sigma(head: Head) -> tuple[float, float] | None:
    if head.hand_eye_sigma_rad is None or head.hand_eye_sigma_mm is None:
        return None
    return head.hand_eye_sigma_rad, head.hand_eye_sigma_mm


def _has_robot(record: SettingRecord) -> bool:
    """Tell whether a robot said where it took the focus view."""
    focus_view = record.focus_view
    return focus_view is not None and record.views[focus_view].base_from_hand is not None


@contextmanager
def _mapper(workers: int | None, total: int) -> Iterator[Mapper]:
    """Give a function that maps jobs, here or in processes of their own, in order."""
    if workers is None or workers < 2:
        yield map
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        yield partial(pool.map, chunksize=max(1, total // (4 * workers)))


def _hash(recording: Recording) -> str:
    return digest(
        {
            "head": head_to_json(recording.head),
            "settings": [setting_to_json(record) for record in recording.settings],
        }
    )
