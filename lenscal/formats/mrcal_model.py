"""The ``.cameramodel`` of mrcal: text of a Python dictionary, read as data and never run."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np

from lenscal.camera import Camera
from lenscal.document import write_whole
from lenscal.errors import FileError
from lenscal.formats.distortion import ConvertedCamera, camera_from_matrix
from lenscal.formats.exported import WrittenFile
from lenscal.formats.reading import blamed_on, checked, field, numbers, read_text, whole
from lenscal.setting import LensSetting

_DISTORTIONS = {f"LENSMODEL_OPENCV{n}": n for n in (4, 5, 8, 12)} | {"LENSMODEL_PINHOLE": 0}


def write_mrcal(
    path: Path | str, camera: Camera, setting: LensSetting | None = None
) -> WrittenFile:
    """Write a camera for mrcal, as LENSMODEL_OPENCV5 at the origin of the reference frame.

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
        The file and the worst error of the conversion, which a comment in it states too.
    """
    converted = camera.to_opencv()
    intrinsics = [
        *np.diag(converted.matrix)[:2].tolist(),
        *converted.matrix[:2, 2].tolist(),
        *converted.distortion.tolist(),
    ]
    lines = [
        f"# worst error of the conversion to this lens model: {converted.worst_error_px:.2g} px",
        *([] if setting is None else [f"# lens setting: {setting}"]),
        "{",
        "    'lensmodel':  'LENSMODEL_OPENCV5',",
        "",
        "    # intrinsics are fx,fy,cx,cy,k1,k2,p1,p2,k3",
        f"    'intrinsics': {intrinsics!r},",
        "",
        "    # extrinsics are rt_fromref",
        "    'extrinsics': [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],",
        "",
        f"    'imagersize': [{camera.sensor.width_px}, {camera.sensor.height_px}],",
        "}",
    ]
    written = write_whole(Path(path), "\n".join(lines) + "\n")
    return WrittenFile(written, converted.worst_error_px)


def read_mrcal(path: Path | str, pitch_mm: float) -> ConvertedCamera:
    """Read a camera of mrcal.

    Parameters
    ----------
    path
        The file, with a pinhole or OpenCV lens model; its pose is left aside.
    pitch_mm
        Spacing of the sensor elements, which the file does not tell.

    Returns
    -------
    ConvertedCamera
        The camera, and what the conversion of its distortion lost.

    Raises
    ------
    FileError
        When the file cannot be read, is cut short, has another lens model, or a field is not what
        it has to be.
    """
    path = Path(path)
    text = read_text(path)
    try:
        content = ast.literal_eval(text.lstrip())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        line = getattr(error, "lineno", None)
        where = f", line {line}" if line else ""
        raise FileError(
            f"{path}{where}: no dictionary of plain values, as mrcal writes it; was it cut short?"
        ) from error
    if not isinstance(content, dict):
        raise FileError(f"{path} holds no dictionary, as mrcal writes it")
    model = checked(path, field(path, content, "lensmodel"), "lensmodel", str)
    if model not in _DISTORTIONS:
        raise FileError(
            f"{path}: lensmodel is {model!r:.80}, but only {', '.join(sorted(_DISTORTIONS))} are "
            "read; convert it with mrcal-convert-lensmodel"
        )
    values = numbers(
        path, field(path, content, "intrinsics"), "intrinsics", (4 + _DISTORTIONS[model],)
    )
    size = field(path, content, "imagersize")
    numbers(path, size, "imagersize", (2,))
    width, height = (whole(path, size[i], f"imagersize[{i}]") for i in range(2))
    matrix = np.diag([values[0], values[1], 1.0])
    matrix[:2, 2] = values[2:4]
    with blamed_on(path):
        return camera_from_matrix(matrix, values[4:], (width, height), pitch_mm)
