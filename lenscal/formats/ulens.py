"""Unreal's ``.ulens``, the exchange file of its lens files: tables over (focus, zoom) as text.

Fx and Fy are our image distance over width and height of the sensor, Cx and Cy the principal point
over width and height of the image, measured from its corner. Distortion is OpenCV's, from
undistorted to distorted. The engine reads numbers in single precision.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.document import write_whole
from lenscal.errors import FileError
from lenscal.formats.distortion import camera_from_matrix
from lenscal.formats.exported import ExportedSetting, WrittenFile, common_sensor_checked
from lenscal.formats.imported import (
    NO_OBJECT_DISTANCE,
    NO_SIGMA,
    ImportedTable,
    camera_row,
    with_magnification,
    worst_error_sentence,
)
from lenscal.formats.reading import (
    blamed_on,
    checked,
    field,
    number,
    optional,
    parse_json,
    read_text,
    whole,
)

VERSION: Final = "0.0.0"
_SETTING: Final = ("FocusEncoder", "ZoomEncoder")
_VALUES: Final = {
    "FocalLengthTable": ("Fx", "Fy"),
    "ImageCenterTable": ("Cx", "Cy"),
    "NodalOffsetTable": ("Qx", "Qy", "Qz", "Qw", "Tx", "Ty", "Tz"),
    "DistortionTable": ("K1", "K2", "K3", "P1", "P2"),
}
_Table = dict[tuple[float, ...], FloatArray]


def write_ulens(
    path: Path | str, exported: Sequence[ExportedSetting], *, name: str = "lenscal"
) -> WrittenFile:
    """Write a lens file for Unreal.

    Parameters
    ----------
    path
        The file.
    exported
        The settings. NodalOffsetTable is written where all nodal offsets are known: the projection
        centre, in cm, from that of the reference setting. The table of focus distances is written
        where each focus setting has one D, as at a single zoom setting.
    name
        Name of the lens file.

    Returns
    -------
    WrittenFile
        The file and the worst error of the conversion of distortion, which the file states too.
    """
    settings = common_sensor_checked(list(exported))
    sensor = settings[0].camera.sensor
    converted = [one.camera.to_opencv() for one in settings]
    worst = max(c.worst_error_px for c in converted)
    size = np.array([sensor.width_px, sensor.height_px])
    tables: dict[str, list[list[float]]] = {
        "FocalLengthTable": [(np.diag(c.matrix)[:2] / size).tolist() for c in converted],
        "ImageCenterTable": [((c.matrix[:2, 2] + 0.5) / size).tolist() for c in converted],
        "DistortionTable": [c.distortion[[0, 1, 4, 2, 3]].tolist() for c in converted],
    }
    offsets = [one.nodal_offset_mm for one in settings]
    if None not in offsets:
        tables["NodalOffsetTable"] = [
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -offset / 10] for offset in offsets if offset is not None
        ]
    body = {
        "metadata": {
            "type": "LensFile",
            "version": VERSION,
            "lensInfo": {"serialNumber": "", "modelName": name, "distortionModel": "Spherical"},
            "name": name,
            "nodalOffsetCoordinateSystem": "OpenCV",
            "fxFyUnits": "Normalized",
            "cxCyUnits": "Normalized",
            "userMetadata": [{"name": "conversionErrorPx", "value": f"{worst:.2g}"}],
        },
        "sensorDimensions": {
            "width": sensor.width_mm,
            "height": sensor.height_mm,
            "units": "Millimeters",
        },
        "imageDimensions": {"width": sensor.width_px, "height": sensor.height_px},
        "cameraParameterTables": [
            _table(
                table,
                (*_SETTING, *_VALUES[table]),
                [
                    [one.setting.focus, one.setting.zoom, *values]
                    for one, values in zip(settings, tables[table], strict=True)
                ],
            )
            for table in _VALUES
            if table in tables
        ],
        "encoderTables": _encoder_tables(settings),
    }
    return WrittenFile(write_whole(Path(path), json.dumps(body, indent="\t") + "\n"), worst)


def read_ulens(path: Path | str) -> ImportedTable:
    """Read a lens file of Unreal.

    Parameters
    ----------
    path
        The file. Where a table stands there more than once, as older exporters write it, the last
        one counts.

    Returns
    -------
    ImportedTable
        One row per row of FocalLengthTable; where Fx and Fy disagree, d is their mean. D is that of
        the table of focus distances, interpolated between its rows, where there is one.

    Raises
    ------
    FileError
        When the file cannot be read, is cut short, of another version, or a field is not what it
        has to be.
    """
    path = Path(path)
    content = parse_json(path, read_text(path))
    _check_metadata(path, content)
    size = _pair(path, content, "imageDimensions", whole)
    extent = _pair(path, content, "sensorDimensions", _positive)
    tables = _camera_tables(path, content)
    if "FocalLengthTable" not in tables:
        raise FileError(f"{path} lacks the FocalLengthTable in cameraParameterTables")
    if not tables["FocalLengthTable"]:
        raise FileError(f"{path}: the FocalLengthTable has no rows")
    unit = np.array(size) if _units(path, content, "fxFyUnits") else np.array(size) / extent
    missing, rows, sensor = [], [], None
    ratio = extent[0] / size[0] / (extent[1] / size[1])
    unnamed: set[str] = set()
    for (focus, zoom), focal in tables["FocalLengthTable"].items():
        matrix = np.diag([*(focal * unit), 1.0])
        centre = tables.get("ImageCenterTable", {}).get((focus, zoom))
        distortion = tables.get("DistortionTable", {}).get((focus, zoom))
        matrix[:2, 2] = np.array(size) * (0.5 if centre is None else centre) - 0.5
        coefficients = np.zeros(5) if distortion is None else distortion[[0, 1, 3, 4, 2]]
        with blamed_on(path):
            converted = camera_from_matrix(matrix, coefficients, size, extent[1] / size[1])
            converted = converted.with_kappa_alone(ratio)
        sensor = converted.camera.sensor
        row = camera_row(zoom, focus, converted)
        if centre is None:
            row["principal_point_x_px"] = row["principal_point_y_px"] = np.nan
            unnamed.add("ImageCenterTable")
        if distortion is None:
            row["k1_per_mm2"] = np.nan
            unnamed.add("DistortionTable")
        offset = tables.get("NodalOffsetTable", {}).get((focus, zoom))
        if offset is not None:
            row["nodal_offset_mm"] = -10 * float(offset[6])
        rows.append(row)
    samples = pd.DataFrame(rows)
    focus_table = _focus_distances(path, content)
    if focus_table is None:
        missing.append(NO_OBJECT_DISTANCE)
    else:
        distance = np.interp(samples["focus"], *focus_table, left=np.nan, right=np.nan)
        samples = with_magnification(samples.assign(object_distance_mm=10 * distance))
        missing.append("D is what the file's table of focus distances says at each focus setting")
    missing += [f"{table} does not have all settings" for table in sorted(unnamed)]
    missing += [worst_error_sentence(samples), NO_SIGMA]
    with blamed_on(path):
        return ImportedTable(samples, tuple(missing), sensor)


def _table(name: str, header: Sequence[str], rows: list[list[float]]) -> dict[str, str]:
    data = "; ".join(", ".join(repr(float(v)) for v in row) for row in rows)
    return {"parameterName": name, "header": ", ".join(header), "data": data}


def _encoder_tables(settings: list[ExportedSetting]) -> list[dict[str, str]]:
    distances = {(s.setting.focus, s.object_distance_mm) for s in settings}
    focuses = {focus for focus, _ in distances}
    if len(focuses) != len(distances) or any(d is None for _, d in distances):
        return []
    rows = [[focus, distance / 10] for focus, distance in sorted(distances) if distance is not None]
    return [_table("Focus", ("FocusEncoder", "FocusCM"), rows)]


def _check_metadata(path: Path, content: Any) -> None:
    for name, wanted in (("type", "LensFile"), ("version", VERSION)):
        found = field(path, content, "metadata", name)
        if found != wanted:
            raise FileError(
                f"{path}: metadata.{name} is {found!r:.40}, but this lenscal reads {wanted!r}; is "
                "it of a newer version?"
            )
    model = field(path, content, "metadata", "lensInfo", "distortionModel")
    if str(model).lower() != "spherical":
        raise FileError(f"{path}: the distortion model is {model!r:.40}; only Spherical is read")


def _units(path: Path, content: Any, name: str) -> bool:
    """Tell whether values are shares of the image (true) or mm (false)."""
    found = content["metadata"].get(name, "Normalized")
    if found not in ("Normalized", "Millimeters"):
        raise FileError(
            f"{path}: metadata.{name} is {found!r:.40}; wanted is Normalized or Millimeters"
        )
    return bool(found == "Normalized")


def _pair(
    path: Path, content: Any, name: str, check: Callable[[Path, Any, str], Any]
) -> tuple[Any, Any]:
    width, height = (
        check(path, field(path, content, name, axis), f"{name}.{axis}")
        for axis in ("width", "height")
    )
    return width, height


def _positive(path: Path, value: Any, name: str) -> float:
    return number(path, value, name, positive=True)


def _camera_tables(path: Path, content: Any) -> dict[str, _Table]:
    found: dict[str, _Table] = {}
    name = "cameraParameterTables"
    for entry in checked(path, field(path, content, name), name, list):
        name = checked(path, field(path, entry, "parameterName"), "parameterName", str)
        if name in _VALUES:
            found[name] = _rows(path, entry, name, _SETTING, _VALUES[name])
    return found


def _focus_distances(path: Path, content: Any) -> tuple[FloatArray, FloatArray] | None:
    for entry in optional(path, content, "encoderTables", list):
        if field(path, entry, "parameterName") == "Focus":
            table = _rows(path, entry, "Focus", ("FocusEncoder",), ("FocusCM",))
            if table:
                encoders = np.array(sorted(key[0] for key in table))
                return encoders, np.array([table[(e,)][0] for e in encoders])
    return None


def _rows(path: Path, entry: Any, name: str, keys: Sequence[str], values: Sequence[str]) -> _Table:
    header = [word.strip() for word in str(field(path, entry, "header")).split(",")]
    lacking = [word for word in (*keys, *values) if word not in header]
    if lacking:
        raise FileError(f"{path}: the header of {name} lacks {', '.join(lacking)}")
    table: _Table = {}
    for i, row in enumerate(str(field(path, entry, "data")).split(";")):
        if not row.strip():
            continue
        words = row.split(",")
        if len(words) != len(header):
            raise FileError(
                f"{path}: row {i} of {name} has {len(words)} values, but its header has "
                f"{len(header)} ({', '.join(header)}); was the file cut short?"
            )
        value = {
            word: number(path, text.strip(), f"{word} in row {i} of {name}")
            for word, text in zip(header, words, strict=True)
        }
        # A nodal offset that older exporters repeat counts as it stands last.
        table[tuple(value[k] for k in keys)] = np.array([value[v] for v in values])
    return table
