"""Samples of OpenTrackIO as a table: one object, a list of them, or one a line."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.errors import FileError
from lenscal.formats.distortion import camera_from_matrix, fit_distortion, pixel_grid
from lenscal.formats.imported import (
    NO_OBJECT_DISTANCE,
    NO_SIGMA,
    ImportedTable,
    with_magnification,
    worst_error_sentence,
)
from lenscal.formats.reading import (
    blamed_on,
    checked,
    field,
    number,
    numbers,
    optional,
    parse_json,
    read_text,
    whole,
)
from lenscal.sensor import Sensor

_NEWEST: Final = 1
_MODELS: Final = ("Brown-Conrady D-U", "Brown-Conrady U-D")


class _Distortion(NamedTuple):
    """One entry of ``lens.distortion``, padded: above, below and across."""

    model: str
    above: FloatArray
    below: FloatArray
    tangential: FloatArray

    @property
    def is_kappa_alone(self) -> bool:
        rest = (*self.above[1:], *self.below, *self.tangential)
        return self.model == _MODELS[0] and not any(rest)


def read_opentrackio(path: Path | str) -> ImportedTable:
    """Read the lens of OpenTrackIO samples.

    Parameters
    ----------
    path
        A file with one sample, a JSON list of samples, or one sample a line. The zoom and focus are
        those of rawEncoders, or else those of encoders. Frames that say the same are one sample.

    Returns
    -------
    ImportedTable
        κ1 is the file's own k1 where that is all there is, and otherwise fitted to its model over
        the sensor. D is focusDistance − entrancePupilOffset, where both are stated.

    Raises
    ------
    FileError
        When the file cannot be read, is cut short, of a newer version, or a field is not what it
        has to be.
    """
    path = Path(path)
    samples = _samples(path)
    sensor = next((s for s in (_sensor(path, one) for one in samples) if s is not None), None)
    notes: dict[str, None] = {}
    rows = [_row(path, one, sensor, notes) for one in samples]
    table = pd.DataFrame(rows).drop_duplicates(ignore_index=True)
    known = [name for name in table if table[name].notna().any()]
    table = with_magnification(table[known])
    if "object_distance_mm" in table:
        notes["D is focusDistance − entrancePupilOffset, as the samples state them"] = None
    else:
        notes[NO_OBJECT_DISTANCE] = None
    if sensor is None:
        notes["the size of the sensor is not stated: pixels cannot be told"] = None
    elif "conversion_error_px" in table:
        notes[worst_error_sentence(table)] = None
    notes[NO_SIGMA] = None
    with blamed_on(path):
        return ImportedTable(table, tuple(notes), sensor)


def _samples(path: Path) -> list[Any]:
    text = read_text(path)
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    one_a_line = len(lines) > 1 and all(
        line.startswith("{") and line.rstrip().endswith("}") for _, line in lines
    )
    if one_a_line:
        content: Any = [parse_json(path, line, n) for n, line in lines]
    else:
        content = parse_json(path, text)
    samples = content if isinstance(content, list) else [content]
    for sample in samples:
        checked(path, sample, "a sample", dict)
        name = field(path, sample, "protocol", "name")
        version = numbers(
            path, field(path, sample, "protocol", "version"), "protocol.version", (3,)
        )
        if name != "OpenTrackIO":
            raise FileError(f"{path}: the protocol is {name!r:.40}, not OpenTrackIO")
        if version[0] > _NEWEST:
            shown = ".".join(f"{v:g}" for v in version)
            raise FileError(
                f"{path} has version {shown} of OpenTrackIO; this lenscal reads up to {_NEWEST}.x: "
                "install a newer one"
            )
    if not samples:
        raise FileError(f"{path} holds no sample")
    return samples


def _sensor(path: Path, sample: Any) -> Sensor | None:
    camera = optional(path, optional(path, sample, "static", dict), "camera", dict)
    names = ("activeSensorPhysicalDimensions", "activeSensorResolution")
    if any(name not in camera for name in names):
        return None
    size = {n: number(path, field(path, camera, names[0], n), n) for n in ("width", "height")}
    count = {n: whole(path, field(path, camera, names[1], n), n) for n in ("width", "height")}
    with blamed_on(path):
        return Sensor(
            count["width"],
            count["height"],
            size["width"] / count["width"],
            size["height"] / count["height"],
        )


def _row(
    path: Path, sample: Any, sensor: Sensor | None, notes: dict[str, None]
) -> dict[str, float]:
    lens = checked(path, field(path, sample, "lens"), "lens", dict)
    row = _setting(path, lens, notes)
    name = "pinholeFocalLength"
    distance = number(path, field(path, lens, name), f"lens.{name}", positive=True)
    row["image_distance_mm"] = distance
    if "focusDistance" in lens and "entrancePupilOffset" in lens:
        metres = number(path, lens["focusDistance"], "lens.focusDistance", positive=True)
        pupil = number(path, lens["entrancePupilOffset"], "lens.entrancePupilOffset")
        row["object_distance_mm"] = 1000 * (metres - pupil)
    centre = None
    if sensor is not None and "projectionOffset" in lens:
        offset = [
            number(path, field(path, lens, "projectionOffset", n), f"lens.projectionOffset.{n}")
            for n in ("x", "y")
        ]
        centre = sensor.centre_px + np.array(offset) / sensor.sample_pitch_mm
        row["principal_point_x_px"], row["principal_point_y_px"] = map(float, centre)
    shift = optional(path, lens, "distortionOffset", dict)
    if any(number(path, shift.get(n, 0), f"lens.distortionOffset.{n}") for n in ("x", "y")):
        notes["distortionOffset was left out: here distortion is centred on the axis"] = None
    if entries := optional(path, lens, "distortion", list):
        distortion = _distortion(path, entries)
        if distortion.is_kappa_alone:
            row["k1_per_mm2"], row["conversion_error_px"] = float(distortion.above[0]), 0.0
        elif sensor is not None:
            camera = Camera(sensor, distance, principal_point_px=centre)
            with blamed_on(path):
                row["k1_per_mm2"], row["conversion_error_px"] = _kappa(camera, distortion)
        else:
            notes["κ1 needs the size of the sensor: the distortion is not of κ1 alone"] = None
    return row


def _setting(path: Path, lens: Any, notes: dict[str, None]) -> dict[str, float]:
    for name in ("rawEncoders", "encoders"):
        stated = optional(path, lens, name, dict)
        if "zoom" not in stated and "focus" not in stated:
            continue
        for axis in ("zoom", "focus"):
            if axis not in stated:
                notes[f"the samples tell no {axis} encoder: all rows are at {axis} 0"] = None
        return {
            axis: number(path, stated.get(axis, 0), f"lens.{name}.{axis}")
            for axis in ("zoom", "focus")
        }
    raise FileError(
        f"{path}: a sample lacks lens.rawEncoders and lens.encoders, so that its setting is not "
        "known"
    )


def _distortion(path: Path, entries: list[Any]) -> _Distortion:
    """Take the first entry that goes from distorted to undistorted, or else the first."""
    stated = [checked(path, e, "lens.distortion", dict) for e in entries]
    names = [e.get("model", _MODELS[0]) for e in stated]
    unknown = [name for name in names if name not in _MODELS]
    if unknown:
        raise FileError(
            f"{path}: the distortion model {unknown[0]!r:.40} is not read; {' and '.join(_MODELS)} "
            "are"
        )
    chosen = names.index(_MODELS[0]) if _MODELS[0] in names else 0
    where = f"lens.distortion[{chosen}]"
    entry = stated[chosen]
    radial = numbers(path, field(path, entry, "radial"), f"{where}.radial", range(1, 7))
    tangential = numbers(path, entry.get("tangential", []), f"{where}.tangential", range(3))
    padded = np.concatenate([radial, np.zeros(6)])[:6]
    across = np.concatenate([tangential, np.zeros(2)])[:2]
    return _Distortion(names[chosen], padded[::2], padded[1::2], across)


def _kappa(camera: Camera, distortion: _Distortion) -> tuple[float, float]:
    """Fit κ1 to a model that has more; give it with the worst error in px."""
    if distortion.model == _MODELS[1]:
        distance = camera.image_distance_mm
        powers = distance ** np.array([2.0, 4.0, 6.0])
        (k1, k2, k3), (k4, k5, k6) = distortion.above * powers, distortion.below * powers
        p1, p2 = distortion.tangential * distance
        sensor = camera.sensor
        converted = camera_from_matrix(
            camera.matrix,
            [k1, k2, p1, p2, k3, k4, k5, k6],
            (sensor.width_px, sensor.height_px),
            sensor.pitch_y_mm,
        ).with_kappa_alone(sensor.sample_pitch_x_mm / sensor.pitch_y_mm)
        return converted.camera.k1_per_mm2, converted.worst_error_px
    xy = (pixel_grid(camera.sensor) - camera.centre_px) * camera.sensor.sample_pitch_mm
    squared = (xy**2).sum(axis=-1, keepdims=True)
    above, below = (
        1 + sum(c * squared**i for i, c in enumerate(terms, 1))
        for terms in (distortion.above, distortion.below)
    )
    p1, p2 = distortion.tangential
    decentring = Camera(camera.sensor, camera.image_distance_mm, decentring=(float(p1), float(p2)))
    ideal = xy * above / below + (decentring.undistort(xy) - xy)
    directions = ideal / camera.image_distance_mm
    fitted = fit_distortion(camera, directions, 1, decentred=False)
    return fitted.camera.k1_per_mm2, fitted.worst_error_px
