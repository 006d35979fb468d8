"""ROS camera_info YAML: one file per setting, and the zoom set of camera_info_manager_py.

A zoom set is one file per whole zoom setting, named by a template with ``%d``; it knows no focus.
Its InterpolatingZoomCameraInfoManager weighs the two neighbours the wrong way round (the nearer
counts less), so that it is right only at the samples and midway between them: export densely and
use ApproximateZoomCameraInfoManager.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.document import write_whole
from lenscal.errors import FileError, InputError
from lenscal.formats.distortion import ConvertedCamera, camera_from_matrix
from lenscal.formats.exported import ExportedSetting, WrittenFile
from lenscal.formats.imported import (
    NO_OBJECT_DISTANCE,
    NO_SIGMA,
    ImportedTable,
    camera_row,
    worst_error_sentence,
)
from lenscal.formats.reading import blamed_on, checked, field, numbers, parse_yaml, read_text, whole
from lenscal.setting import LensSetting

_MODELS = {"plumb_bob": (0, 4, 5), "rational_polynomial": (8,)}


def write_camera_info(
    path: Path | str, camera: Camera, *, name: str = "camera", setting: LensSetting | None = None
) -> WrittenFile:
    """Write a camera as ROS's camera_info.

    Parameters
    ----------
    path
        The file.
    camera
        The camera; its distortion is converted by `Camera.to_opencv` to ``plumb_bob``.
    name
        Name of the camera: letters, digits and underscores.
    setting
        The lens setting, to be stated in the file.

    Returns
    -------
    WrittenFile
        The file and the worst error of the conversion, which a comment in it states too.

    Raises
    ------
    InputError
        When ROS would refuse the name.
    """
    if not re.fullmatch(r"[A-Za-z0-9_]+", name):
        raise InputError(
            f"a camera of ROS is named by letters, digits and _, but given is {name!r}"
        )
    converted = camera.to_opencv()
    projection = np.column_stack([converted.matrix, np.zeros(3)])
    lines = [
        f"# worst error of the conversion to plumb_bob: {converted.worst_error_px:.2g} px",
        *([] if setting is None else [f"# lens setting: {setting}"]),
        f"image_width: {camera.sensor.width_px}",
        f"image_height: {camera.sensor.height_px}",
        f"camera_name: {name}",
        *_matrix("camera_matrix", converted.matrix),
        "distortion_model: plumb_bob",
        *_matrix("distortion_coefficients", converted.distortion[None, :]),
        *_matrix("rectification_matrix", np.eye(3)),
        *_matrix("projection_matrix", projection),
    ]
    written = write_whole(Path(path), "\n".join(lines) + "\n")
    return WrittenFile(written, converted.worst_error_px)


def write_zoom_set(
    template: Path | str, exported: Sequence[ExportedSetting], *, name: str = "camera"
) -> list[WrittenFile]:
    """Write a zoom set: one file per zoom setting, at one focus setting.

    Parameters
    ----------
    template
        The files; ``%d`` in the name stands for the zoom setting.
    exported
        Cameras at whole zoom settings, all at the same focus setting.
    name
        Name of the camera.

    Returns
    -------
    list of WrittenFile
        The files, in the order given.

    Raises
    ------
    InputError
        When the template has no ``%d``, a zoom setting is not whole or repeated, or the focus
        settings differ.
    """
    template = Path(template)
    _template(template)
    zooms = [e.setting.zoom for e in exported]
    focuses = sorted({e.setting.focus for e in exported})
    if len(focuses) > 1:
        raise InputError(
            f"a zoom set of ROS knows no focus, but the settings have focus {focuses[0]:g} to "
            f"{focuses[-1]:g}; write one set per focus setting"
        )
    if len(set(zooms)) < len(zooms) or any(z != int(z) for z in zooms):
        raise InputError(
            "a zoom set of ROS numbers its files by whole, different zoom settings, but given are "
            f"{', '.join(f'{z:g}' for z in zooms)}"
        )
    return [
        write_camera_info(
            template.with_name(template.name.replace("%d", str(int(e.setting.zoom)))),
            e.camera,
            name=name,
            setting=e.setting,
        )
        for e in exported
    ]


def read_camera_info(path: Path | str, pitch_mm: float) -> ConvertedCamera:
    """Read a camera_info file.

    Parameters
    ----------
    path
        The file.
    pitch_mm
        Spacing of the sensor elements, which the file does not tell.

    Returns
    -------
    ConvertedCamera
        The camera, and what the conversion of its distortion lost.

    Raises
    ------
    FileError
        When the file cannot be read, is cut short, or a field is not what it has to be.
    """
    path = Path(path)
    size, matrix, distortion = _read(path)
    with blamed_on(path):
        return camera_from_matrix(matrix, distortion, size, pitch_mm)


def read_zoom_set(template: Path | str, pitch_mm: float) -> ImportedTable:
    """Read a zoom set.

    Parameters
    ----------
    template
        The files; ``%d`` in the name stands for the zoom setting.
    pitch_mm
        Spacing of the sensor elements, which the files do not tell.

    Returns
    -------
    ImportedTable
        One row per file, at focus 0. Its sensor has the median of f_y / f_x as scale factor.

    Raises
    ------
    InputError
        When the template has no ``%d``.
    FileError
        When no file fits the template, one of them cannot be read, or their image sizes differ.
    """
    template = Path(template)
    pattern = _template(template)
    folder = template.parent
    found = {
        int(match[1]): path
        for path in (folder.iterdir() if folder.is_dir() else ())
        if (match := pattern.fullmatch(path.name))
    }
    if not found:
        raise FileError(f"no file in {folder} is named {template.name} with a number for %d")
    read = {zoom: _read(found[zoom]) for zoom in sorted(found)}
    sizes = {size for size, _, _ in read.values()}
    if len(sizes) > 1:
        raise FileError(f"the files {template} have different image sizes: {sorted(sizes)}")
    ratio = float(np.median([matrix[1, 1] / matrix[0, 0] for _, matrix, _ in read.values()]))
    rows, sensor = [], None
    for zoom, (size, matrix, distortion) in read.items():
        with blamed_on(found[zoom]):
            converted = camera_from_matrix(matrix, distortion, size, pitch_mm)
            converted = converted.with_kappa_alone(ratio)
        sensor = converted.camera.sensor
        rows.append(camera_row(float(zoom), 0.0, converted))
    samples = pd.DataFrame(rows)
    missing = (
        NO_OBJECT_DISTANCE,
        "a zoom set knows no focus: all rows are at focus 0",
        worst_error_sentence(samples),
        NO_SIGMA,
    )
    return ImportedTable(samples, missing, sensor)


def _read(path: Path) -> tuple[tuple[int, int], FloatArray, FloatArray]:
    content = parse_yaml(path, read_text(path))
    size = (
        whole(path, field(path, content, "image_width"), "image_width"),
        whole(path, field(path, content, "image_height"), "image_height"),
    )
    matrix = numbers(
        path, field(path, content, "camera_matrix", "data"), "camera_matrix.data", (9,)
    )
    name = "distortion_model"
    model = checked(path, content.get(name, "plumb_bob"), name, str)
    if model not in _MODELS:
        raise FileError(
            f"{path}: distortion_model is {model!r:.60}, but only {' and '.join(_MODELS)} are read"
        )
    stated = field(path, content, "distortion_coefficients", "data")
    distortion = numbers(path, stated, "distortion_coefficients.data", _MODELS[model])
    matrix = matrix.reshape(3, 3)
    if not (np.diag(matrix) > 0).all():
        raise FileError(
            f"{path}: camera_matrix has focal lengths {np.diag(matrix)[:2].tolist()}, not positive "
            "ones: the camera was never calibrated"
        )
    return size, matrix, distortion


def _template(template: Path) -> re.Pattern[str]:
    before, mark, after = template.name.partition("%d")
    if not mark or "%d" in after:
        raise InputError(
            f"a zoom set is named by a template with %d for the zoom setting, such as "
            f"lens_zoom_%d.yaml, but given is {template.name}"
        )
    return re.compile(re.escape(before) + r"(-?\d+)" + re.escape(after))


def _matrix(name: str, values: Any) -> list[str]:
    rows, columns = values.shape
    return [
        f"{name}:",
        f"  rows: {rows}",
        f"  cols: {columns}",
        f"  data: [{', '.join(repr(float(v)) for v in values.ravel())}]",
    ]
