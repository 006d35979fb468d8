"""The one place above both wings: from a rig and a plan to a recording, a table and a map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lenscal.calibration.sweep import calibrate_recording
from lenscal.calibration.table import CalibrationTable
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.progress import ProgressMaker, silent
from lenscal.recording import Recording
from lenscal.rig.interfaces import Rig
from lenscal.session.plan import SessionPlan
from lenscal.session.runner import run_session


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedLens:
    """What the way from rig to map leaves behind.

    Parameters
    ----------
    recording
        The session.
    table
        One calibration per setting.
    lens_map
        The smooth map through them.
    """

    recording: Recording
    table: CalibrationTable
    lens_map: LensMap


def calibrate_lens(
    plan: SessionPlan, rig: Rig, folder: Path | str, *, progress: ProgressMaker = silent
) -> CalibratedLens:
    """Record a session, calibrate every setting and fit the map; everything is saved on the way.

    Parameters
    ----------
    plan
        What to visit.
    rig
        What to visit it with.
    folder
        Gets ``session/``, ``table.csv`` with ``table.json``, and ``map.json``.
    progress
        Makes what is told of each stage.

    Returns
    -------
    CalibratedLens
        Recording, table and map.
    """
    path = Path(folder)
    with progress("recording") as tell:
        recording = run_session(plan, rig, path / "session", progress=tell)
    with progress("calibrating") as tell:
        table = calibrate_recording(recording, progress=tell)
    table.save(path / "table.csv")
    lens_map = fit_lens_map(table)
    lens_map.save(path / "map.json")
    return CalibratedLens(recording, table, lens_map)


__all__ = ["CalibratedLens", "SessionPlan", "calibrate_lens"]
