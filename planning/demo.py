"""The whole story on a simulated rig: a session becomes maps, contours and a plan.

The only part of planning that knows a rig: it calibrates the simulated lens, plans with the map,
sends the simulated robot there, and asks the truth whether the camera sees what was promised.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from rich.console import Console

from lenscal.arrays import FloatArray
from lenscal.calibration.calibration import Repeatability
from lenscal.document import write_whole
from lenscal.errors import PlanningError, SessionError
from lenscal.maps.lens_map import LensMap
from lenscal.pose import Pose
from lenscal.progress import progress_bar
from lenscal.recording import Recording
from lenscal.rig.simulated import SimulatedRig
from lenscal.rig.simulated.simulated_rig import MOUNTING_ERROR, REPEATABILITY
from lenscal.setting import LensSetting
from lenscal.units import MM_PER_INCH
from lenscal.workflow import SessionPlan, calibrate_lens
from planning.enclosure import example_part
from planning.figures import save_figures
from planning.image_check import ImageCheck, check_view
from planning.placement import Placement, place_plan
from planning.placement_export import as_sequence
from planning.placement_file import mount_of_session
from planning.planner import Plan, plan
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.margin import Requirement
from planning.requirements.resolution import Resolution
from planning.robot_cell import RobotCell
from planning.task import Task
from planning.true_view import TrueView
from planning.verify import Verification, verify_viewpoint
from planning.viewpoint_table import viewpoint_table

#: The session: finer where the lens is steep, towards its long end.
SESSION: Final[dict[str, Any]] = {
    "zoom": (92.0, 95.5, 99.0, 102.0, 104.5, 106.5, 108.0, 109.0),
    "focus": (60.0, 80.0, 100.0, 120.0, 140.0),
    "autofocus": {"nearest": "362 mm", "farthest": "386 mm", "step": "1.5 mm", "iris": 100},
    "views": {"tilted": 4, "tilt_deg": 25, "iris": 20},
}
#: The paper's requirements: 3 px for 0.01 in (9), and an inch within the 512 px of a line (11).
REQUIREMENTS: Final[tuple[Requirement, ...]] = (
    Resolution(3, 0.01 * MM_PER_INCH, axis="x"),
    FieldOfView(1.0 * MM_PER_INCH, axis="x"),
)
#: Settings per axis at which the map is held against the truth.
_DENSE: Final = 41
#: The part lies where the target lay, seen from its other side: its z points to the camera.
_PART_FROM_TARGET: Final = Pose.from_rotation_vector([np.pi, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Summary:
    """What the demo found, as `summary.json` holds it.

    Parameters
    ----------
    settings
        How many settings were calibrated.
    worst_magnification_error, worst_object_distance_error
        Worst relative error of the map against the truth over a dense grid of settings.
    worst_standoff_error_mm, worst_nodal_offset_error_mm
        Worst error in mm over the same grid.
    viewpoints
        How many viewpoints the planner found.
    viewpoints_verified
        How many of them satisfy everything in truth.
    worst_pictured_error_px
        How far the inch is from its planned length, measured in the pictures of two viewpoints.
    """

    settings: int
    worst_magnification_error: float
    worst_object_distance_error: float
    worst_standoff_error_mm: float
    worst_nodal_offset_error_mm: float
    viewpoints: int
    viewpoints_verified: int
    worst_pictured_error_px: float


def run_demo(out: Path, seed: int) -> Summary:
    """Run the demo, write everything it makes, and print what came of it.

    Parameters
    ----------
    out
        Folder for session, table, map, figures, plan and summary; it must not hold a session.
    seed
        Seed of the simulated rig.

    Returns
    -------
    Summary
        What came of it.

    Raises
    ------
    SessionError
        When the folder holds something already.
    PlanningError
        When the planner found no viewpoint.
    """
    if out.exists() and any(out.iterdir()):
        raise SessionError(
            f"{out} is not empty: it may hold another session; choose another folder with --out, "
            "or move that one away"
        )
    console = Console()
    rig = SimulatedRig.preset("vicon-1990", seed=seed)
    session = SessionPlan.model_validate(SESSION)
    console.print(f"Calibrating a simulated zoom lens at {len(session.settings())} settings")
    lens = calibrate_lens(session, rig, out, progress=progress_bar)
    console.print("Planning where to put it, so that a part's hidden face is seen")
    part = example_part()
    task = Task(part.target, part.feature, REQUIREMENTS, part.workspace, "top face T")
    found = plan(task, lens.lens_map, part.scene, seed=seed)
    found.save(out / "plan.json")
    if found.why_empty:
        raise PlanningError(f"the demo found no viewpoint: {found.why_empty}")
    placed = place_plan(found, robot_cell(rig, lens.recording))
    as_sequence(placed).save(out / "sequence.json")
    rig.lay_down([], placed.cell.base_from_part)
    checks = [verify_in_truth(rig, found, one) for one in placed.placements]
    pictures = take_pictures(rig, found, placed.placements, out)
    errors = worst_errors(lens.lens_map, rig)
    summary = Summary(
        settings=len(lens.lens_map.samples),
        worst_magnification_error=errors["magnification"],
        worst_object_distance_error=errors["object_distance_mm"],
        worst_standoff_error_mm=errors["standoff_mm"],
        worst_nodal_offset_error_mm=errors["nodal_offset_mm"],
        viewpoints=len(checks),
        viewpoints_verified=sum(check.satisfied for check in checks),
        worst_pictured_error_px=max(abs(p.feature_px - p.planned_px) for p in pictures),
    )
    write_whole(out / "summary.json", json.dumps(asdict(summary), indent=1) + "\n")
    save_figures(out, lens.lens_map, found)
    _show(console, found, checks)
    _tell(console, summary, out)
    return summary


def robot_cell(rig: SimulatedRig, recording: Recording) -> RobotCell:
    """Describe the cell: the part lies where the target lay, seen from its other side.

    Parameters
    ----------
    rig
        The rig that was calibrated.
    recording
        The session, whose rig stated how the camera sits on the hand.

    Returns
    -------
    RobotCell
        As far as the rig can know it.
    """
    part_sigma = np.repeat([MOUNTING_ERROR.rotation_rad, MOUNTING_ERROR.translation_mm], 3)
    return RobotCell(
        mount_of_session(recording),
        rig.base_from_target @ _PART_FROM_TARGET.inverse(),
        np.diag(part_sigma**2),
        Repeatability(
            rotation_rad=REPEATABILITY.rotation_rad, translation_mm=REPEATABILITY.translation_mm
        ),
        iris=SESSION["views"]["iris"],
    )


def verify_in_truth(rig: SimulatedRig, found: Plan, placement: Placement) -> Verification:
    """Send the simulated robot to a viewpoint and look through the true camera.

    The robot knows the standoff only: it puts the reference projection centre there, with the
    hand-eye calibration as stated. Where the true projection centre comes to lie is the lens's.

    Parameters
    ----------
    rig
        The rig that was calibrated, with the part on its bench.
    found
        The plan.
    placement
        One of its viewpoints.

    Returns
    -------
    Verification
        What the true camera sees.
    """
    view = true_view(rig, placement)
    task = found.task
    return verify_viewpoint(
        view.camera,
        view.part_from_camera,
        task.target,
        task.seen_feature,
        task.requirements,
        found.scene,
    )


def true_view(rig: SimulatedRig, placement: Placement) -> TrueView:
    """Send the simulated robot to a viewpoint, set the lens, and tell what decides the picture.

    Parameters
    ----------
    rig
        The rig, with the part on its bench.
    placement
        Where to go.

    Returns
    -------
    TrueView
        The truth.
    """
    rig.lens.move_to(placement.setting, placement.approach)
    rig.positioner.move_to(placement.base_from_hand)
    truth = rig.truth(placement.setting)
    return TrueView(
        truth.camera,
        rig.true_part_from_camera(),
        truth.object_distance_mm,
        truth.entrance_pupil_diameter_mm,
        truth.falloff,
    )


def take_pictures(
    rig: SimulatedRig, found: Plan, placements: Sequence[Placement], out: Path
) -> list[ImageCheck]:
    """Look at a ruler on the target from where it is seen smallest and largest, and measure it.

    Parameters
    ----------
    rig
        The rig, with the part on its bench.
    found
        The plan.
    placements
        Its viewpoints.
    out
        Folder for ``picture-<viewpoint>.png``.

    Returns
    -------
    list of ImageCheck
        One per picture.
    """
    task = found.task
    by_size = sorted(placements, key=lambda p: found.viewpoints["magnification"][p.viewpoint])
    checks = []
    for placement in (by_size[0], by_size[-1]):
        ends = found.camera(placement.viewpoint).project(
            placement.part_from_camera.inverse().transform(task.seen_feature.vertices_mm)
        )
        planned_px = float(np.linalg.norm(ends[1] - ends[0]))
        view = true_view(rig, placement)
        check = check_view(view, found.scene, task.seen_feature, task.target, planned_px)
        grey = np.rint(255 * np.clip(check.image, 0.0, 1.0)).astype(np.uint8)
        cv2.imwrite(str(out / f"picture-{placement.viewpoint}.png"), grey)
        checks.append(check)
    return checks


def worst_errors(lens_map: LensMap, rig: SimulatedRig) -> dict[str, float]:
    """Hold a map against the simulated truth over a dense grid inside its domain.

    Parameters
    ----------
    lens_map
        The map.
    rig
        The rig that it was made with.

    Returns
    -------
    dict
        Worst relative error of d/D and D, worst error of standoff and nodal offset in mm.
    """
    zoom, focus = (values.ravel() for values in lens_map.domain.grid(_DENSE))
    inside = lens_map.domain.contains(zoom, focus)
    zoom, focus = zoom[inside], focus[inside]
    truths = [rig.truth(LensSetting(z, f)) for z, f in zip(zoom, focus, strict=True)]

    def error(quantity: str) -> FloatArray:
        truth = np.array([getattr(t, quantity) for t in truths])
        difference = np.abs(lens_map.value(quantity, zoom, focus) - truth)
        relative = quantity in ("magnification", "object_distance_mm")
        return np.asarray(difference / truth if relative else difference)

    quantities = ("magnification", "object_distance_mm", "standoff_mm", "nodal_offset_mm")
    return {quantity: float(error(quantity).max()) for quantity in quantities}


def _show(console: Console, found: Plan, checks: Sequence[Verification]) -> None:
    columns = (
        *("zoom", "focus", "magnification", "object_distance_mm", "nodal_offset_mm"),
        *("resolution_margin", "field_of_view_margin", "visibility_margin_mm"),
    )
    truth = {
        "1 in\nimages to": [f"{check.feature_px:.1f} px" for check in checks],
        "ok": ["yes" if check.satisfied else "NO" for check in checks],
    }
    title = "Planned viewpoints; the last two columns are what the true camera sees"
    console.print(viewpoint_table(title, found.viewpoints, columns, truth))


def _tell(console: Console, summary: Summary, out: Path) -> None:
    console.print(
        f"{summary.viewpoints_verified} of {summary.viewpoints} viewpoints satisfy resolution, "
        "field of view and visibility in truth.\n"
        f"Worst error of the map: d/D {summary.worst_magnification_error:.2%}, "
        f"D {summary.worst_object_distance_error:.2%}, "
        f"standoff {summary.worst_standoff_error_mm:.2f} mm, "
        f"offset {summary.worst_nodal_offset_error_mm:.1f} mm.\n"
        "In two pictures of a ruler on the target the inch is within "
        f"{summary.worst_pictured_error_px:.2f} px of its planned length.\n"
        f"Session, table, map, figures, plan, sequence and pictures are in {out}."
    )
