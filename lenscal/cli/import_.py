"""``lenscal import``: make a table of samples from the files of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from lenscal.formats.distortion import ConvertedCamera
    from lenscal.formats.imported import ImportedTable

_TABLES: Final = ("opentrackio", "ulens", "ros", "lensfun", "csv")
_CAMERAS: Final = ("opencv", "mrcal", "colmap")


@click.command(name="import")
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=str)
@click.option(
    "--format",
    "form",
    type=click.Choice((*_TABLES, *_CAMERAS)),
    required=True,
    help="Which format.",
)
@click.option(
    "--pitch",
    metavar="LENGTH",
    help="Spacing of the sensor elements, such as '5.5 um', for formats in pixels: ros, opencv, "
    "mrcal, colmap, csv; for csv also along x and y, such as '16 um x 14 um'.",
)
@click.option("--size", metavar="WxH", help="Image size in px, for lensfun and csv.")
@click.option("--lens", help="Part of the name of the lens, for lensfun.")
@click.option(
    "--at",
    "settings",
    metavar="ZOOM,FOCUS",
    multiple=True,
    help="Setting of each camera, in their order, for opencv, mrcal, colmap.",
)
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="The table to write, a .csv file; a .json file with the evidence is put beside it.",
)
def import_command(
    files: tuple[str, ...],
    form: str,
    pitch: str | None,
    size: str | None,
    lens: str | None,
    settings: tuple[str, ...],
    out: Path,
) -> None:
    """Make a calibration table of what FILE says of a lens.

    The table is as `lenscal calibrate` writes it, for `lenscal map fit`, as far as the format
    knows; what it does not know is said. For ros, FILE is a template with %d for the zoom setting.

    \b
    Examples:
      lenscal import lens.ulens --format ulens -o table.csv
      lenscal import 'zoom_set/lens_%d.yaml' --format ros --pitch '5.5 um' -o table.csv
      lenscal import a.yml b.yml --format opencv --pitch 3.45um --at 0,0 --at 10,0 -o table.csv
    """
    from lenscal.errors import InputError

    if form in _CAMERAS:
        table = _from_cameras(form, files, _needed_pitch(form, pitch), settings)
    elif len(files) > 1 or settings:
        raise InputError(
            f"{form} holds a table with its settings in one file; give one FILE and no --at"
        )
    else:
        table = _from_table(form, files[0], pitch, size, lens)
    table.to_calibration_table(files[0]).save(out)
    click.echo(f"{len(table.samples)} settings imported from {form}: {out}")
    for sentence in table.missing:
        click.echo(f"  note: {sentence}")


def _from_table(
    form: str, name: str, pitch: str | None, size: str | None, lens: str | None
) -> ImportedTable:
    from lenscal.formats.camera_info import read_zoom_set
    from lenscal.formats.lensfun import read_lensfun
    from lenscal.formats.opentrackio_samples import read_opentrackio
    from lenscal.formats.samples_csv import read_samples_csv
    from lenscal.formats.ulens import read_ulens
    from lenscal.sensor import Sensor

    if form == "ros":
        return read_zoom_set(name, _needed_pitch(form, pitch))
    if form == "ulens":
        return read_ulens(name)
    if form == "lensfun":
        return read_lensfun(name, _needed_size(form, size), lens)
    if form == "csv":
        along = (pitch or "").split(" x ")
        spacings = [
            _needed_pitch(form, p or None) for p in (along * 2 if len(along) == 1 else along)
        ]
        return read_samples_csv(name, Sensor(*_needed_size(form, size), *spacings[:2]))
    return read_opentrackio(name)


def _from_cameras(
    form: str, files: Sequence[str], pitch_mm: float, settings: Sequence[str]
) -> ImportedTable:
    import numpy as np
    import pandas as pd

    from lenscal.errors import InputError
    from lenscal.formats.imported import (
        NO_OBJECT_DISTANCE,
        NO_SIGMA,
        ImportedTable,
        camera_row,
        worst_error_sentence,
    )

    cameras = [camera for name in files for camera in _cameras(form, name, pitch_mm)]
    places = [_setting(text) for text in settings]
    if len(places) != len(cameras):
        raise InputError(
            f"there are {len(cameras)} cameras, but {len(places)} settings; give --at ZOOM,FOCUS "
            "once for each camera, in their order"
        )
    sensors = [converted.camera.sensor for converted in cameras]
    if len({(s.width_px, s.height_px) for s in sensors}) > 1:
        raise InputError("the cameras have different image sizes; a table holds one sensor")
    # Ratios of f_x to f_y scatter from calibration to calibration; the sensor has one.
    ratio = float(np.median([s.scale_factor for s in sensors]))
    rows = []
    for (zoom, focus), converted in zip(places, cameras, strict=True):
        rows.append(camera_row(zoom, focus, converted.with_kappa_alone(ratio)))
    samples = pd.DataFrame(rows)
    missing = (NO_OBJECT_DISTANCE, worst_error_sentence(samples), NO_SIGMA)
    first = cameras[0].with_kappa_alone(ratio).camera.sensor
    return ImportedTable(samples, missing, first)


def _cameras(form: str, name: str, pitch_mm: float) -> list[ConvertedCamera]:
    from lenscal.formats.colmap import read_colmap
    from lenscal.formats.mrcal_model import read_mrcal
    from lenscal.formats.opencv_yaml import read_opencv

    if form == "colmap":
        return list(read_colmap(name, pitch_mm).values())
    return [(read_mrcal if form == "mrcal" else read_opencv)(name, pitch_mm)]


def _needed_pitch(form: str, pitch: str | None) -> float:
    from lenscal.errors import InputError
    from lenscal.units import parse_length_mm

    if pitch is None:
        raise InputError(
            f"{form} does not tell the size of a pixel; give --pitch, such as --pitch '5.5 um'"
        )
    return parse_length_mm(pitch)


def _needed_size(form: str, size: str | None) -> tuple[int, int]:
    from lenscal.errors import InputError

    words = (size or "").lower().replace("×", "x").split("x")
    if len(words) != 2 or not all(word.isdigit() for word in words):
        given = "" if size is None else f", not {size!r}"
        raise InputError(
            f"{form} does not tell the size of an image; give --size, such as 6000x4000{given}"
        )
    return int(words[0]), int(words[1])


def _setting(text: str) -> tuple[float, float]:
    from lenscal.errors import InputError

    try:
        zoom, focus = map(float, text.split(","))
    except ValueError:
        raise InputError(f"--at is written as ZOOM,FOCUS, such as 98,131, not {text!r}") from None
    return zoom, focus
