"""Finding what is sharpest: by moving the camera away from the target, or with the focus motor.

The camera is the paper's way: the object distance is what is looked for, at a fixed lens setting.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import numpy as np

from lenscal.recording import FocusResult
from lenscal.rig.interfaces import Rig
from lenscal.session.focus_movers import CameraMover, FocusMotorMover
from lenscal.session.focus_search import FocusPeak, FocusSearch, SearchOptions
from lenscal.session.sharpness import Measure
from lenscal.setting import ApproachSide, LensSetting

#: σ with which a robot arm comes back to a standoff, where the caller does not say.
REPEATABILITY_MM: Final = 0.02


def autofocus(
    rig: Rig,
    standoffs_mm: Sequence[float],
    *,
    point_mm: tuple[float, float] = (0.0, 0.0),
    measure: Measure | str = Measure.EDGE_WIDTH,
    extensions: int = 2,
    repeatability_mm: float = REPEATABILITY_MM,
    check_iris: float | None = None,
    approach: ApproachSide = ApproachSide.FROM_BELOW,
) -> FocusResult:
    """Find the standoff at which the disk is sharpest, at the lens setting of the moment.

    The camera is left there, having come from the near side as in the sweeps; iris and exposure are
    as they were before. When nothing is found, the camera goes back to where it stood.

    Parameters
    ----------
    rig
        Lens, camera and positioner. Open the iris first: the peak is narrower. Where it shows no
        clear peak, it is opened to its widest for the search.
    standoffs_mm
        (N,) standoffs of the coarse sweep, ascending, at least five.
    point_mm
        (x, y) of the disk in the target frame.
    measure
        What sharpness is measured by.
    extensions
        How many times the sweep may be made longer, by half its length, when the peak lies at its
        end. It can then go nearer than asked: the workspace of the positioner must keep the lens
        off the target.
    repeatability_mm
        Standard deviation with which the positioner comes back to a standoff: what the focus curve
        cannot see of the last move, and part of σ.
    check_iris
        A second iris, such as that of the views, at which the fine sweep is repeated: a note then
        says how far the sharpest standoff lies from the other.
    approach
        Side from which the motors of the lens end their moves when the iris is changed.

    Returns
    -------
    FocusResult
        The sharpest standoff with its σ, how clear the peak was, and the whole focus curve.

    Raises
    ------
    FocusError
        When the sweep is empty or too short, no disk is found, the picture is too dark or too
        bright, the peak lies beyond what can be reached, or there is no clear one.
    """
    options = SearchOptions(Measure(measure), extensions, repeatability_mm, check_iris, approach)
    before = rig.lens.setting
    with _putting_back(rig, approach):
        search = FocusSearch(rig, CameraMover(rig, point_mm), options)
        peak = search.run(np.array(standoffs_mm, dtype=np.float64))
        if rig.lens.setting != before:
            rig.lens.move_to(before, approach)
    return FocusResult(
        distance_mm=peak.position,
        sigma_mm=peak.sigma,
        confidence=peak.confidence,
        iris=peak.iris,
        curve_standoff_mm=peak.curve_position,
        curve_sharpness=peak.curve_sharpness,
        notes=peak.notes,
        measure=options.measure.value,
        fine=peak.fine,
        vergence_per_mm=peak.fit.vergence,
    )


def autofocus_lens(
    rig: Rig,
    focus_settings: Sequence[float],
    *,
    measure: Measure | str = Measure.EDGE_WIDTH,
    extensions: int = 2,
    repeatability: float = 0.0,
    check_iris: float | None = None,
    approach: ApproachSide = ApproachSide.FROM_BELOW,
) -> FocusPeak:
    """Find the focus setting at which the disk is sharpest, with the camera where it stands.

    The lens is left at that setting, with its iris as before. When nothing is found, it goes back
    to where it stood.

    Parameters
    ----------
    rig
        Lens and camera; the axis meets the disk.
    focus_settings
        (N,) focus settings of the coarse sweep, ascending, at least five.
    measure
        What sharpness is measured by.
    extensions
        How many times the sweep may be made longer, by half its length, when the peak lies at its
        end; the travel of the lens bounds it.
    repeatability
        Standard deviation with which the motor comes back to a setting; part of σ.
    check_iris
        A second iris at which the fine sweep is repeated.
    approach
        Side from which every move ends; backlash makes the two sides differ.

    Returns
    -------
    FocusPeak
        The sharpest focus setting in units of the lens controller, with its σ and the focus curve.

    Raises
    ------
    FocusError
        As for `autofocus`.
    """
    options = SearchOptions(Measure(measure), extensions, repeatability, check_iris, approach)
    iris = rig.lens.setting.iris
    with _putting_back(rig, approach):
        search = FocusSearch(rig, FocusMotorMover(rig, approach), options)
        peak = search.run(np.array(focus_settings, dtype=np.float64))
        now = rig.lens.setting
        if now.iris != iris:
            rig.lens.move_to(LensSetting(now.zoom, now.focus, iris), approach)
    return peak


@contextmanager
def _putting_back(rig: Rig, approach: ApproachSide) -> Iterator[None]:
    """Restore the exposure afterwards, and after an error or a break also lens and camera."""
    setting, place, exposure_s = (
        rig.lens.setting,
        rig.positioner.base_from_hand,
        rig.camera.exposure_s,
    )
    try:
        yield
    except BaseException:
        if rig.lens.setting != setting:
            rig.lens.move_to(setting, approach)
        rig.positioner.move_to(place)
        raise
    finally:
        rig.camera.set_exposure_s(exposure_s)
