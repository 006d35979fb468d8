"""``lenscal calibrate``: from a recorded session, or from a folder of photographs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from lenscal.calibration.photographs import PhotographCalibration
    from lenscal.calibration.table import CalibrationTable


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
@click.option("--workers", type=click.IntRange(min=1), help="Processes to share a session.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def calibrate(
    session: Path | None,
    images: str | None,
    target_spec: str | None,
    pitch_um: float | None,
    out: Path | None,
    workers: int | None,
    as_json: bool,
) -> None:
    """Calibrate every setting of SESSION, or one camera from photographs.

    \b
    Examples:
      lenscal calibrate run1 -o run1/table.csv
      lenscal calibrate --images 'DIR/left*.jpg' --target chessboard:9x6:25mm --pitch-um 10
    """  # noqa: D301 - \b is click's mark for lines that are not to be wrapped
    from lenscal.errors import InputError

    if (session is None) == (images is None):
        raise InputError("name either a SESSION folder or --images 'PATTERN'")
    if session is not None:
        if target_spec is not None or pitch_um is not None:
            raise InputError(
                "a session knows its target and its sensor; leave --target and --pitch-um"
            )
        _calibrate_session(session, out or session / "table.csv", workers, as_json)
        return
    if target_spec is None:
        raise InputError(
            "say what the photographs show: --target chessboard:9x6:25mm, for instance"
        )
    _calibrate_images(str(images), target_spec, pitch_um, out, as_json)


def _calibrate_session(session: Path, out: Path, workers: int | None, as_json: bool) -> None:
    from lenscal.calibration.sweep import calibrate_recording
    from lenscal.progress import progress_bar
    from lenscal.recording import Recording

    recording = Recording.load(session)
    with progress_bar("calibrating") as progress:
        table = calibrate_recording(recording, workers=workers, progress=progress)
    table.save(out)
    if as_json:
        _print_json(
            {
                "table": str(out),
                "settings": len(table),
                "failures": [
                    {"zoom": f.zoom, "focus": f.focus, "reason": f.reason} for f in table.failures
                ],
                "worst_rms_px": float(table.rows["rms_px"].max()),
            }
        )
        return
    _print_table(table)
    click.echo(f"{len(table)} of {len(recording.settings)} settings calibrated: {out}")
    for failure in table.failures:
        click.echo(f"  left out: zoom {failure.zoom:g}, focus {failure.focus:g}: {failure.reason}")


def _print_table(table: CalibrationTable) -> None:
    click.echo(
        f"{'zoom':>8} {'focus':>8} {'d/D':>9} {'± %':>6} {'D mm':>9} {'±':>7} {'d mm':>9} "
        f"{'f mm':>9} {'offset':>8} {'rms px':>7} {'corners':>8}"
    )
    for row in table.rows.to_dict("records"):
        share = 100 * row["sigma_magnification"] / row["magnification"]
        click.echo(
            f"{row['zoom']:8g} {row['focus']:8g} {row['magnification']:9.5f} {share:6.3f} "
            f"{row['object_distance_mm']:9.2f} {row['sigma_object_distance_mm']:7.2f} "
            f"{row['image_distance_mm']:9.3f} {row['focal_length_mm']:9.3f} "
            f"{row['nodal_offset_mm']:8.2f} {row['rms_px']:7.3f} {row['corners']:8.0f}"
        )
    for entry in table.evidence:
        for warning in entry["warnings"]:
            click.echo(f"  zoom {entry['zoom']:g}, focus {entry['focus']:g}: {warning}")


def _calibrate_images(
    pattern: str, target_spec: str, pitch_um: float | None, out: Path | None, as_json: bool
) -> None:
    from lenscal.arrays import positive
    from lenscal.calibration.photographs import calibrate_photographs
    from lenscal.detection import load_images
    from lenscal.plate import parse_target

    target = parse_target(target_spec)
    pitch_mm = None if pitch_um is None else positive("--pitch-um", pitch_um, "µm") / 1000
    writer = None if out is None else _writer(out)
    result = calibrate_photographs(load_images(pattern), target, pitch_mm)
    if writer is not None:
        writer(result)
    if as_json:
        _print_json(result.summary())
    else:
        _print_camera(result.summary())
        if out is not None:
            click.echo(f"written: {out}")


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
