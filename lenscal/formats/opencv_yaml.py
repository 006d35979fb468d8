"""OpenCV's FileStorage, YAML and JSON, with the keys of its calibration sample."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.document import write_whole
from lenscal.errors import FileError
from lenscal.formats.distortion import ConvertedCamera, camera_from_matrix
from lenscal.formats.exported import WrittenFile
from lenscal.formats.reading import (
    blamed_on,
    field,
    numbers,
    parse_json,
    parse_yaml,
    read_text,
    whole,
)
from lenscal.setting import LensSetting


def write_opencv_yaml(
    path: Path | str, camera: Camera, setting: LensSetting | None = None
) -> WrittenFile:
    """Write a camera for OpenCV as YAML.

    Parameters
    ----------
    path
        The file.
    camera
        The camera; its distortion is converted by `Camera.to_opencv`.
    setting
        The lens setting, to be stated in the file.

    Returns
    -------
    WrittenFile
        The file and the worst error of the conversion, which the file states too.
    """
    converted = camera.to_opencv()
    lines = [
        "%YAML:1.0",
        "---",
        f"# worst error of the conversion to OpenCV's model: {converted.worst_error_px:.2g} px",
        *(f"{name}: {value!r}" for name, value in _head(camera, setting).items()),
        *_matrix("camera_matrix", converted.matrix),
        *_matrix("distortion_coefficients", converted.distortion[:, None]),
        f"conversion_error_px: {converted.worst_error_px!r}",
    ]
    return WrittenFile(write_whole(Path(path), "\n".join(lines) + "\n"), converted.worst_error_px)


def write_opencv_json(
    path: Path | str, camera: Camera, setting: LensSetting | None = None
) -> WrittenFile:
    """Write a camera for OpenCV as JSON.

    Parameters
    ----------
    path
        The file.
    camera
        The camera; its distortion is converted by `Camera.to_opencv`.
    setting
        The lens setting, to be stated in the file.

    Returns
    -------
    WrittenFile
        The file and the worst error of the conversion, which the file states too.
    """
    converted = camera.to_opencv()
    body: dict[str, Any] = {
        **_head(camera, setting),
        "camera_matrix": _json_matrix(converted.matrix),
        "distortion_coefficients": _json_matrix(converted.distortion[:, None]),
        "conversion_error_px": converted.worst_error_px,
    }
    return WrittenFile(
        write_whole(Path(path), json.dumps(body, indent=4) + "\n"), converted.worst_error_px
    )


def read_opencv(path: Path | str, pitch_mm: float) -> ConvertedCamera:
    """Read a camera that OpenCV or its calibration sample wrote, YAML or JSON.

    Parameters
    ----------
    path
        The file; one whose name ends in ``.json`` is JSON.
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
    text = read_text(path)
    content = parse_json(path, text) if path.suffix == ".json" else parse_yaml(path, text)
    size = (
        whole(path, field(path, content, "image_width"), "image_width"),
        whole(path, field(path, content, "image_height"), "image_height"),
    )
    matrix = _values(path, content, "camera_matrix", (9,))
    distortion = _values(path, content, "distortion_coefficients", (0, 4, 5, 8, 12, 14))
    with blamed_on(path):
        return camera_from_matrix(matrix.reshape(3, 3), distortion, size, pitch_mm)


def _head(camera: Camera, setting: LensSetting | None) -> dict[str, float]:
    size: dict[str, float] = {
        "image_width": camera.sensor.width_px,
        "image_height": camera.sensor.height_px,
    }
    if setting is not None:
        size |= {"lens_zoom": float(setting.zoom), "lens_focus": float(setting.focus)}
    return size


def _values(path: Path, content: Any, name: str, counts: tuple[int, ...]) -> FloatArray:
    values = numbers(path, field(path, content, name, "data"), f"{name}.data", counts)
    shape = [whole(path, field(path, content, name, n), f"{name}.{n}") for n in ("rows", "cols")]
    if shape[0] * shape[1] != len(values):
        raise FileError(
            f"{path}: {name} states {shape[0]} × {shape[1]} numbers, but {len(values)} stand there"
        )
    return values


def _matrix(name: str, values: FloatArray) -> list[str]:
    rows, columns = values.shape
    return [
        f"{name}: !!opencv-matrix",
        f"   rows: {rows}",
        f"   cols: {columns}",
        "   dt: d",
        f"   data: [ {', '.join(repr(float(v)) for v in values.ravel())} ]",
    ]


def _json_matrix(values: FloatArray) -> dict[str, Any]:
    rows, columns = values.shape
    return {
        "type_id": "opencv-matrix",
        "rows": rows,
        "cols": columns,
        "dt": "d",
        "data": values.ravel().tolist(),
    }
