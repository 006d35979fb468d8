"""COLMAP's ``cameras.txt``. Its pixel (0, 0) is a corner: our centre c lies at c + 0.5 there."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.document import write_whole
from lenscal.errors import FileError, InputError
from lenscal.formats.distortion import ConvertedCamera, camera_from_matrix
from lenscal.formats.exported import ExportedSetting, WrittenFile
from lenscal.formats.reading import blamed_on, number, read_text, whole

_HEAD = (
    "# Camera list with one line of data per camera:",
    "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
)
#: Parameters of a model by their name; f stands for f_x and f_y, k for k1.
_PARAMETERS: Final[dict[str, str]] = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
}
_COEFFICIENTS: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def write_colmap(path: Path | str, exported: Sequence[ExportedSetting]) -> WrittenFile:
    """Write cameras for COLMAP, one per setting, numbered from 1.

    Parameters
    ----------
    path
        The file, for COLMAP ``cameras.txt``.
    exported
        The settings.

    Returns
    -------
    WrittenFile
        The file and the worst error of the conversion to FULL_OPENCV, which comments in it state
        for each camera.

    Raises
    ------
    InputError
        When there is no setting.
    """
    if not exported:
        raise InputError("there is no setting to export; give at least one")
    lines, worst = [*_HEAD, f"# Number of cameras: {len(exported)}"], 0.0
    for i, one in enumerate(exported, 1):
        converted = one.camera.to_opencv()
        sensor = one.camera.sensor
        parameters = [
            *np.diag(converted.matrix)[:2].tolist(),
            *(converted.matrix[:2, 2] + 0.5).tolist(),
        ]
        model = "PINHOLE"
        if np.any(converted.distortion):
            model = "FULL_OPENCV"
            parameters += [*converted.distortion.tolist(), 0.0, 0.0, 0.0]
        lines.append(
            f"# camera {i}: {one.setting}; worst error of the conversion "
            f"{converted.worst_error_px:.2g} px"
        )
        words = [str(i), model, str(sensor.width_px), str(sensor.height_px)]
        lines.append(" ".join([*words, *map(repr, parameters)]))
        worst = max(worst, converted.worst_error_px)
    return WrittenFile(write_whole(Path(path), "\n".join(lines) + "\n"), worst)


def read_colmap(path: Path | str, pitch_mm: float) -> dict[int, ConvertedCamera]:
    """Read cameras of COLMAP.

    Parameters
    ----------
    path
        The file ``cameras.txt``.
    pitch_mm
        Spacing of the sensor elements, which the file does not tell.

    Returns
    -------
    dict
        CAMERA_ID to camera, and what the conversion of its distortion lost.

    Raises
    ------
    FileError
        When the file cannot be read, holds no camera, or a line is not what it has to be.
    """
    path = Path(path)
    cameras: dict[int, ConvertedCamera] = {}
    for line, text in enumerate(read_text(path).splitlines(), 1):
        words = text.split()
        if not words or words[0].startswith("#"):
            continue
        where = Path(f"{path}, line {line}")
        identity, size, matrix, distortion = _parse(where, words)
        if identity in cameras:
            raise FileError(f"{where}: CAMERA_ID {identity} stands there a second time")
        with blamed_on(where):
            cameras[identity] = camera_from_matrix(matrix, distortion, size, pitch_mm)
    if not cameras:
        raise FileError(f"{path} holds no camera; wanted are lines CAMERA_ID MODEL WIDTH HEIGHT …")
    return cameras


def _parse(where: Path, words: list[str]) -> tuple[int, tuple[int, int], FloatArray, list[float]]:
    if len(words) < 4:
        raise FileError(
            f"{where}: wanted are CAMERA_ID MODEL WIDTH HEIGHT PARAMS…, but there are "
            f"{len(words)} words; was the file cut short?"
        )
    names = _PARAMETERS.get(words[1], "").split()
    if not names:
        raise FileError(
            f"{where}: the model {words[1]!r:.40} is not read; {', '.join(_PARAMETERS)} are"
        )
    if len(words) != 4 + len(names):
        raise FileError(
            f"{where}: {words[1]} has {len(names)} parameters ({' '.join(names)}), but "
            f"{len(words) - 4} stand there; was the file cut short?"
        )
    value = {name: number(where, word, name) for name, word in zip(names, words[4:], strict=True)}
    matrix = np.diag([value.get("fx", value.get("f", 0)), value.get("fy", value.get("f", 0)), 1.0])
    matrix[:2, 2] = [value["cx"] - 0.5, value["cy"] - 0.5]
    size = (whole(where, words[2], "WIDTH"), whole(where, words[3], "HEIGHT"))
    identity = whole(where, words[0], "CAMERA_ID")
    return identity, size, matrix, [value.get(name, 0.0) for name in _COEFFICIENTS]
