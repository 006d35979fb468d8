"""``lenscal export``: write a lens map for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lenscal.formats.exported import ExportedSetting, WrittenFile
    from lenscal.maps.lens_map import LensMap
    from lenscal.setting import LensSetting

FORMATS: Final = ("opentrackio", "ros", "opencv", "ulens", "mrcal", "colmap", "csv")
#: Formats that hold one camera per file, with the ending of the files in a folder.
_ENDINGS: Final = {"opencv": ".yml", "ros": ".yaml", "mrcal": ".cameramodel"}


@click.command(name="export")
@click.argument("lens_map", metavar="MAP", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--format", "form", type=click.Choice(FORMATS), required=True, help="Which format.")
@click.option("--zoom", "zooms", type=float, multiple=True, help="Zoom setting; may be repeated.")
@click.option("--focus", "focuses", type=float, multiple=True, help="Focus setting; likewise.")
@click.option(
    "--grid",
    metavar="NxM",
    help="N zoom by M focus settings over the domain, in place of --zoom and --focus; those "
    "outside it are left out. ROS and OpenTrackIO hold whole settings: there the grid is rounded.",
)
@click.option(
    "--image-plane-distance",
    metavar="LENGTH",
    help="From the projection centre of the reference setting back to the image plane, such as "
    "'85 mm': OpenTrackIO then gets entrancePupilOffset and focusDistance.",
)
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    help="The file. OpenCV (.yml or .json), ROS and mrcal hold one camera per file: for several "
    "settings this is a folder, in which ROS gets a zoom set per focus setting.",
)
def export(
    lens_map: Path,
    form: str,
    zooms: tuple[float, ...],
    focuses: tuple[float, ...],
    grid: str | None,
    image_plane_distance: str | None,
    out: Path,
) -> None:
    """Write cameras of MAP at some settings for another program.

    What other programs call focal length is the image distance d.

    \b
    Examples:
      lenscal export map.json --format opencv --zoom 98 --focus 131 -o camera.yml
      lenscal export map.json --format ulens --grid 7x5 -o lens.ulens
      lenscal export map.json --format ros --grid 9x1 -o zoom_set
    """
    from lenscal.errors import InputError
    from lenscal.formats.exported import settings_of
    from lenscal.maps.lens_map import LensMap

    if image_plane_distance is not None and form != "opentrackio":
        raise InputError(f"--image-plane-distance is for opentrackio, not for {form}")
    loaded = LensMap.load(lens_map)
    settings = _settings(loaded, zooms, focuses, grid, whole=form in ("ros", "opentrackio"))
    if form == "csv":
        from lenscal.formats.samples_csv import write_samples_csv

        written = [write_samples_csv(out, loaded, settings)]
    elif form in _ENDINGS:
        written = _one_camera_per_file(form, out, settings_of(loaded, settings))
    else:
        cameras = settings_of(loaded, settings)
        written = [_one_file(form, out, cameras, loaded, image_plane_distance)]
    worst = max(file.worst_error_px for file in written)
    where = str(out) if len(written) == 1 else f"{len(written)} files in {out}"
    click.echo(f"{len(settings)} settings exported as {form}: {where}")
    if form in ("csv", "opentrackio"):
        return
    click.echo(f"  worst error of the conversion of distortion: {worst:.2g} px")
    if form == "ros" and len(settings) > 1:
        click.echo(
            "  note: the interpolating manager of ROS mixes up its weights; use the approximate one"
        )


def _settings(
    lens_map: LensMap,
    zooms: Sequence[float],
    focuses: Sequence[float],
    grid: str | None,
    *,
    whole: bool,
) -> list[LensSetting]:
    import numpy as np

    from lenscal.errors import InputError
    from lenscal.setting import LensSetting

    if grid is None:
        if not zooms or not focuses:
            raise InputError("say which settings: --zoom and --focus, or --grid such as 7x5")
        return [LensSetting(z, f) for f in focuses for z in zooms]
    if zooms or focuses:
        raise InputError("--grid stands in place of --zoom and --focus; give one or the other")
    counts = grid.lower().replace("×", "x").split("x")
    if len(counts) != 2 or not all(c.isdigit() and int(c) > 0 for c in counts):
        raise InputError(f"--grid is written as two whole numbers, such as 7x5, not {grid!r}")
    axes = []
    for count, (low, high) in zip(
        counts, (lens_map.domain.zoom, lens_map.domain.focus), strict=True
    ):
        n = int(count)
        values = np.linspace(low, high, n) if n > 1 else np.array([(low + high) / 2])
        # Settings within 0 to 1 are shares of the travel, which formats hold as they are.
        axes.append(np.unique(np.rint(values)) if whole and max(low, high) > 1 else values)
    zoom, focus = np.meshgrid(*axes)
    inside = lens_map.domain.contains(zoom, focus)
    if not inside.any():
        raise InputError(
            f"no setting of a grid {grid} lies in the domain ({lens_map.domain}); "
            "give more settings, or name them by --zoom and --focus"
        )
    pairs = zip(zoom[inside].tolist(), focus[inside].tolist(), strict=True)
    return [LensSetting(z, f) for z, f in pairs]


def _one_camera_per_file(
    form: str, out: Path, exported: list[ExportedSetting]
) -> list[WrittenFile]:
    if len(exported) == 1:
        return [_camera_file(form, out, exported[0])]
    if form == "ros":
        from lenscal.formats.camera_info import write_zoom_set

        files = []
        for focus in sorted({e.setting.focus for e in exported}):
            chosen = [e for e in exported if e.setting.focus == focus]
            files += write_zoom_set(out / f"focus_{focus:.12g}_zoom_%d.yaml", chosen)
        return files
    return [
        _camera_file(
            form,
            out / f"zoom_{e.setting.zoom:.12g}_focus_{e.setting.focus:.12g}{_ENDINGS[form]}",
            e,
        )
        for e in exported
    ]


def _camera_file(form: str, path: Path, one: ExportedSetting) -> WrittenFile:
    from lenscal.formats.camera_info import write_camera_info
    from lenscal.formats.mrcal_model import write_mrcal
    from lenscal.formats.opencv_yaml import write_opencv_json, write_opencv_yaml

    if form == "ros":
        return write_camera_info(path, one.camera, setting=one.setting)
    if form == "mrcal":
        return write_mrcal(path, one.camera, one.setting)
    write = write_opencv_json if path.suffix == ".json" else write_opencv_yaml
    return write(path, one.camera, one.setting)


def _one_file(
    form: str,
    out: Path,
    exported: list[ExportedSetting],
    lens_map: LensMap,
    image_plane_distance: str | None,
) -> WrittenFile:
    from lenscal.formats.colmap import write_colmap
    from lenscal.formats.opentrackio import write_opentrackio
    from lenscal.formats.ulens import write_ulens
    from lenscal.units import parse_length_mm

    if form == "colmap":
        return write_colmap(out, exported)
    if form == "ulens":
        return write_ulens(out, exported, name=out.stem)
    distance = None if image_plane_distance is None else parse_length_mm(image_plane_distance)
    history = [f"lenscal map {lens_map.digest}"]
    return write_opentrackio(out, exported, image_plane_distance_mm=distance, history=history)
