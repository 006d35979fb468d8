"""``lenscal calibrate``: from a recorded session, or from a folder of photographs."""

from __future__ import annotations

import json
import math
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import click

if TYPE_CHECKING:
    from lenscal.calibration.calibration import Repeatability
    from lenscal.calibration.photographs import PhotographCalibration
    from lenscal.calibration.table import CalibrationTable
    from lenscal.recording import Recording

#: Settings from which processes of their own are worth their start.
_SETTINGS_TO_SHARE: Final = 48
#: Units that the repeatability of a robot's rotation is given in.
_RAD_PER_UNIT: Final = {"urad": 1e-6, "µrad": 1e-6, "mrad": 1e-3, "rad": 1.0}
_ANGLE: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Zµ]*)\s*")


class _Column(NamedTuple):
    """A column of the printed table."""

    heading: str
    name: str
    width: int
    form: str

    def cell(self, value: float) -> str:
        text = "–" if math.isnan(value) else format(value, self.form)
        return f"{text:>{self.width}}"


_COLUMNS: Final = tuple(
    _Column(*column)
    for column in (
        ("zoom", "zoom", 6, "g"),
        ("focus", "focus", 6, "g"),
        ("d/D", "magnification", 8, ".5f"),
        ("± %", "percent", 6, ".3f"),
        ("D mm", "object_distance_mm", 8, ".2f"),
        ("±", "sigma_object_distance_mm", 5, ".2f"),
        ("d mm", "image_distance_mm", 8, ".3f"),
        ("f mm", "focal_length_mm", 8, ".3f"),
        ("offset", "nodal_offset_mm", 8, ".2f"),
        ("±", "sigma_nodal_offset_mm", 5, ".2f"),
        ("standoff", "standoff_mm", 9, ".3f"),
        ("±", "sigma_standoff_mm", 6, ".3f"),
        ("rms px", "rms_px", 6, ".3f"),
        ("corners", "corners", 7, ".0f"),
    )
)


@click.command()
@click.argument("session", required=False, type=click.Path(path_type=Path))
@click.option("--images", metavar="PATTERN", help="Photographs instead, such as 'DIR/left*.jpg'.")
@click.option("--target", "target_spec", metavar="TARGET", help="Such as chessboard:9x6:25mm.")
@click.option("--pitch-um", type=float, help="Pixel pitch in µm; without it, lengths are in px.")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Session: table.csv. Photographs: camera.json, or camera.yml for OpenCV.",
)
@click.option(
    "--plots",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Write figures of residuals and uncertainty to this folder.",
)
@click.option(
    "--no-robot",
    is_flag=True,
    help="Leave the robot's poses of a session aside: D rests on perspective alone.",
)
@click.option(
    "--free-scale-factor",
    is_flag=True,
    help="Estimate the scale factor at every setting of a session.",
)
@click.option(
    "--robot-repeatability",
    metavar="MM,MRAD",
    help="How well the robot repeats, 1 σ of each coordinate and rotation, such as 0.02mm,0.1mrad; "
    "estimated from the session if not given.",
)
@click.option(
    "--mount",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Session: write how the camera sits on the hand, for `hand_eye` of a task's [placement]: "
    "as the rig stated it, or else as measured by the views of the reference setting.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes to share a session; if not given, one per core from "
    f"{_SETTINGS_TO_SHARE} settings on, else this one alone.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def calibrate(
    session: Path | None,
    images: str | None,
    target_spec: str | None,
    pitch_um: float | None,
    out: Path | None,
    plots: Path | None,
    no_robot: bool,
    free_scale_factor: bool,
    robot_repeatability: str | None,
    mount: Path | None,
    workers: int | None,
    as_json: bool,
) -> None:
    """Calibrate every setting of SESSION, or one camera from photographs.

    \b
    Examples:
      lenscal calibrate run1 -o run1/table.csv
      lenscal calibrate run1 --plots run1/figures
      lenscal calibrate run1 --robot-repeatability 0.02mm,0.1mrad
      lenscal calibrate run1 --mount mount.json
      lenscal calibrate --images 'DIR/left*.jpg' --target chessboard:9x6:25mm --pitch-um 10
      lenscal calibrate --images 'DIR/left*.jpg' --target chessboard:9x6:25mm --plots figures
    """
    from lenscal.errors import InputError

    if (session is None) == (images is None):
        raise InputError("name either a SESSION folder or --images 'PATTERN'")
    if session is not None:
        if target_spec is not None or pitch_um is not None:
            raise InputError(
                "a session knows its target and its sensor; leave --target and --pitch-um"
            )
        if no_robot and robot_repeatability is not None:
            raise InputError(
                "--no-robot leaves aside the robot that --robot-repeatability describes; leave one"
            )
        _calibrate_session(
            session,
            out or session / "table.csv",
            plots,
            as_json,
            workers=workers,
            free_scale_factor=free_scale_factor,
            use_robot=not no_robot,
            mount=mount,
            repeatability=_repeatability(robot_repeatability),
        )
        return
    if no_robot or free_scale_factor or robot_repeatability is not None or mount is not None:
        raise InputError(
            "--no-robot, --free-scale-factor, --robot-repeatability and --mount are for a session; "
            "leave them for photographs"
        )
    if target_spec is None:
        raise InputError(
            "say what the photographs show: --target chessboard:9x6:25mm, for instance"
        )
    _calibrate_images(str(images), target_spec, pitch_um, out, plots, as_json)


def _repeatability(text: str | None) -> Repeatability | None:
    from lenscal.arrays import positive
    from lenscal.calibration.calibration import Repeatability
    from lenscal.errors import InputError
    from lenscal.units import parse_length_mm

    if text is None:
        return None
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError(
            f"cannot read the repeatability {text!r}; give a length and an angle with their units, "
            "such as 0.02mm,0.1mrad"
        )
    length_mm, angle_rad = parse_length_mm(parts[0]), _angle_rad(parts[1])
    return Repeatability(
        rotation_rad=positive("the rotation of --robot-repeatability", angle_rad, "rad"),
        translation_mm=positive("the translation of --robot-repeatability", length_mm, "mm"),
    )


def _angle_rad(text: str) -> float:
    from lenscal.errors import UnitError

    match = _ANGLE.fullmatch(text)
    if match is None or match[2] not in _RAD_PER_UNIT:
        raise UnitError(
            f"cannot read {text!r} as an angle; write a number and one of "
            f"{', '.join(_RAD_PER_UNIT)}, such as '0.1 mrad'"
        )
    return float(match[1]) * _RAD_PER_UNIT[match[2]]


def _calibrate_session(
    session: Path,
    out: Path,
    plots: Path | None,
    as_json: bool,
    *,
    workers: int | None,
    free_scale_factor: bool,
    use_robot: bool,
    mount: Path | None,
    repeatability: Repeatability | None,
) -> None:
    from lenscal.calibration.sweep import SweepOptions, calibrate_recording
    from lenscal.progress import progress_bar
    from lenscal.recording import Recording

    recording = Recording.load(session)
    if repeatability is not None:
        _refuse_without_poses(recording)
    if plots is not None:
        _make_folder(plots)
    if workers is None and len(recording.settings) >= _SETTINGS_TO_SHARE:
        workers = os.cpu_count()
    options = SweepOptions(None, 1, False, free_scale_factor, use_robot, repeatability)
    with progress_bar("calibrating") as progress:
        table = calibrate_recording(
            recording,
            workers=workers,
            progress=progress,
            free_scale_factor=free_scale_factor,
            use_robot=use_robot,
            repeatability=repeatability,
        )
    table.save(out)
    mounted = None if mount is None else _write_mount(recording, mount, repeatability)
    figures: list[Path] = []
    if plots is not None:
        from lenscal.plots.calibration_table import save_session_figures

        figures = save_session_figures(recording, table, options, plots)
    robot = _robot_of(table)
    if as_json:
        _print_json(
            {
                **_figures_entry(figures),
                **({} if mount is None else {"mount": str(mount)}),
                "table": str(out),
                "settings": len(table),
                "failures": [
                    {"zoom": f.zoom, "focus": f.focus, "reason": f.reason} for f in table.failures
                ],
                "worst_rms_px": float(table.rows["rms_px"].max()),
                "robot_repeatability_mm": robot and robot.translation_mm,
                "robot_repeatability_mrad": robot and 1e3 * robot.rotation_rad,
            }
        )
        return
    _print_table(table)
    if robot is not None:
        origin = "estimated" if repeatability is None else "as given"
        click.echo(
            f"robot: {robot.translation_mm:.3f} mm, {1e3 * robot.rotation_rad:.2f} mrad ({origin})"
        )
    if free_scale_factor:
        values, sigma = table.rows["scale_factor"], table.rows["sigma_scale_factor"].median()
        click.echo(
            f"scale factor: {values.min():.5f} to {values.max():.5f}, each ± {sigma:.5f} or so"
        )
    click.echo(f"{len(table)} of {len(recording.settings)} settings calibrated: {out}")
    for failure in table.failures:
        click.echo(f"  left out: zoom {failure.zoom:g}, focus {failure.focus:g}: {failure.reason}")
    if mounted is not None:
        click.echo(mounted)
    _print_figures(figures)


def _write_mount(recording: Recording, path: Path, repeatability: Repeatability | None) -> str:
    """Write how the camera sits on the hand, and say where that is known from."""
    import numpy as np

    from lenscal.calibration.mount import measured_mount, stated_mount

    found = stated_mount(recording)
    origin = "as the rig stated it"
    if found is None:
        found = measured_mount(recording, repeatability)
        origin = "measured at the reference setting"
    found.save(path)
    sigma = np.sqrt(np.diag(found.covariance))
    return (
        f"camera on the hand at {found.reference_setting}, {origin}: {path} "
        f"(σ up to {sigma[3:].max():.3f} mm and {1e3 * sigma[:3].max():.3f} mrad)"
    )


def _refuse_without_poses(recording: Recording) -> None:
    from lenscal.errors import InputError

    if all(view.base_from_hand is None for r in recording.settings for view in r.views):
        raise InputError("the session holds no poses of a robot; leave --robot-repeatability")


def _robot_of(table: CalibrationTable) -> Repeatability | None:
    """Tell how well the robot repeats, the same at all settings; None where it was not used."""
    from lenscal.calibration.calibration import Repeatability

    for entry in table.evidence:
        if (robot := entry["robot"]) is not None:
            return Repeatability(
                rotation_rad=robot["repeatability_rad"], translation_mm=robot["repeatability_mm"]
            )
    return None


def _print_table(table: CalibrationTable) -> None:
    click.echo(" ".join(f"{column.heading:>{column.width}}" for column in _COLUMNS))
    for row in table.rows.to_dict("records"):
        row["percent"] = 100 * row["sigma_magnification"] / row["magnification"]
        click.echo(" ".join(column.cell(row[column.name]) for column in _COLUMNS))
    for entry in table.evidence:
        for warning in entry["warnings"]:
            click.echo(f"  zoom {entry['zoom']:g}, focus {entry['focus']:g}: {warning}")


def _calibrate_images(
    pattern: str,
    target_spec: str,
    pitch_um: float | None,
    out: Path | None,
    plots: Path | None,
    as_json: bool,
) -> None:
    from lenscal.arrays import positive
    from lenscal.calibration.photographs import calibrate_photographs
    from lenscal.detection import load_images
    from lenscal.plate import parse_target

    target = parse_target(target_spec)
    pitch_mm = None if pitch_um is None else positive("--pitch-um", pitch_um, "µm") / 1000
    writer = None if out is None else _writer(out)
    images = load_images(pattern)
    if plots is not None:
        _make_folder(plots)
    result = calibrate_photographs(images, target, pitch_mm)
    if writer is not None:
        writer(result)
    figures = [] if plots is None else _plot_photographs(result, plots)
    if as_json:
        _print_json(result.summary() | _figures_entry(figures))
    else:
        _print_camera(result.summary())
        if out is not None:
            click.echo(f"written: {out}")
        _print_figures(figures)


def _make_folder(plots: Path) -> None:
    """Before any work is done, so that none is lost."""
    from lenscal.plots.figure_files import make_folder

    make_folder(plots)


def _plot_photographs(result: PhotographCalibration, plots: Path) -> list[Path]:
    from lenscal.plots.figure_files import save_figures

    return save_figures(result.calibration, result.names, plots)


def _figures_entry(figures: list[Path]) -> dict[str, list[str]]:
    return {"figures": [str(path) for path in figures]} if figures else {}


def _print_figures(figures: list[Path]) -> None:
    if figures:
        names = ", ".join(path.name for path in figures)
        click.echo(f"figures written to {figures[0].parent}: {names}")


def _writer(out: Path) -> Any:
    """Choose how a camera is written, before any work is done."""
    from lenscal.document import write_document
    from lenscal.errors import FileError
    from lenscal.formats.opencv_yaml import write_opencv_yaml

    def as_json(result: PhotographCalibration) -> None:
        write_document(out, "camera", 1, result.summary())

    def as_yaml(result: PhotographCalibration) -> None:
        write_opencv_yaml(out, result.calibration.camera)

    writers = {".json": as_json, ".yml": as_yaml, ".yaml": as_yaml}
    if out.suffix not in writers:
        raise FileError(f"a camera is written as .json, .yml or .yaml, but {out.name!r} was named")
    return writers[out.suffix]


def _print_camera(summary: dict[str, Any]) -> None:
    sigma = summary["sigma"]
    lines = [("f", f"{summary['focal_length_px']:.2f} ± {sigma['focal_length_px']:.2f} px")]
    if "image_distance_mm" in summary:
        value, deviation = summary["image_distance_mm"], sigma["image_distance_mm"]
        lines.append(("", f"{value:.4f} ± {deviation:.4f} mm"))
    x, y = summary["principal_point_px"]
    lines.append(
        (
            "principal point",
            f"({x:.2f} ± {sigma['principal_point_x_px']:.2f}, "
            f"{y:.2f} ± {sigma['principal_point_y_px']:.2f}) px",
        )
    )
    for name, value in summary["distortion"].items():
        lines.append((f"distortion {name}", f"{value:.5f} ± {sigma[name]:.5f}"))
    if "k1_per_mm2" in summary:
        value, deviation = summary["k1_per_mm2"], sigma["k1_per_mm2"]
        lines.append(("κ1", f"{value:.4g} ± {deviation:.2g} /mm²"))
    lines.append(("rms", f"{summary['rms_px']:.3f} px"))
    lines.append(("used", f"{summary['corners']} corners in {len(summary['views'])} photographs"))
    for label, text in lines:
        click.echo(f"{label:16s} {text}")
    click.echo("distortion runs from distorted to undistorted, in image coordinates divided by f")
    click.echo("rejected" + ("" if summary["rejected"] else "         nothing"))
    for item in summary["rejected"]:
        corner = "" if item.get("point") is None else f", corner {item['point']}"
        click.echo(f"  {item['view']}{corner}: {item['reason']}")
    for warning in summary["warnings"]:
        click.echo(f"warning: {warning}")


def _print_json(content: dict[str, Any]) -> None:
    click.echo(json.dumps(content, indent=1, allow_nan=False))
