"""OpenTrackIO samples with the lens model of OpenLensIO, Brown-Conrady D-U.

That is our own model: ``radial`` is (k1, k2, k3, …) with k1, k3, k5 the coefficients of r², r⁴, r⁶
above the fraction line and k2, k4, k6 those below it, in distorted mm; so k1 is κ1, to the last
bit. ``pinholeFocalLength`` is our image distance d. ``projectionOffset`` is the principal point in
mm from the middle of the sensor, x right and y down.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from lenscal.camera import Camera
from lenscal.document import digest, write_whole
from lenscal.errors import InputError
from lenscal.formats.exported import ExportedSetting, WrittenFile, common_sensor_checked

PROTOCOL: Final = {"name": "OpenTrackIO", "version": [0, 9, 3]}
MODEL: Final = "Brown-Conrady D-U"
_LARGEST_ENCODER: Final = 2**32 - 1


def write_opentrackio(
    path: Path | str,
    exported: Sequence[ExportedSetting],
    *,
    image_plane_distance_mm: float | None = None,
    history: Sequence[str] = (),
) -> WrittenFile:
    """Write OpenTrackIO samples: one object for one setting, a list of them for several.

    Parameters
    ----------
    path
        The file.
    exported
        The settings: all whole numbers, written as rawEncoders, or all within 0 to 1, written as
        encoders.
    image_plane_distance_mm
        How far the nominal image plane lies behind the projection centre of the reference setting.
        A calibration cannot know it; entrancePupilOffset and focusDistance, both measured from the
        image plane, are written only when it is given.
    history
        Sentences for calibrationHistory.

    Returns
    -------
    WrittenFile
        The file; nothing is lost but what the format has no place for: the scale factor goes into
        the size of the sensor.

    Raises
    ------
    InputError
        When the settings cannot be held, there are none, a camera has more than three radial terms,
        or the nodal offset that the image plane needs is not known.
    """
    checked = common_sensor_checked(list(exported))
    encoders = _encoders(checked)
    samples = [_sample(one, *encoders, image_plane_distance_mm, list(history)) for one in checked]
    content = samples[0] if len(samples) == 1 else samples
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    return WrittenFile(write_whole(Path(path), text))


def _encoders(exported: list[ExportedSetting]) -> tuple[str, type[int] | type[float]]:
    values = [v for e in exported for v in (e.setting.zoom, e.setting.focus)]
    if all(v == int(v) and 0 <= v <= _LARGEST_ENCODER for v in values):
        return "rawEncoders", int
    if all(0 <= v <= 1 for v in values):
        return "encoders", float
    first = next(v for v in values if v != int(v) or not 0 <= v <= _LARGEST_ENCODER)
    raise InputError(
        "OpenTrackIO holds settings as whole encoder counts from 0, or as shares from 0 to 1, but "
        f"given is {first:g}; export at whole settings"
    )


def _sample(
    one: ExportedSetting,
    encoders: str,
    kind: type[int] | type[float],
    image_plane_distance_mm: float | None,
    history: list[str],
) -> dict[str, Any]:
    camera, sensor = one.camera, one.camera.sensor
    offset = (camera.centre_px - sensor.centre_px) * sensor.sample_pitch_mm
    lens: dict[str, Any] = {
        "distortion": [
            {
                "model": MODEL,
                "radial": _radial(camera),
                "tangential": list(camera.decentring),
            }
        ],
        encoders: {"focus": kind(one.setting.focus), "zoom": kind(one.setting.zoom)},
        "pinholeFocalLength": camera.image_distance_mm,
        "projectionOffset": {"x": float(offset[0]), "y": float(offset[1])},
    }
    if image_plane_distance_mm is not None:
        lens |= _distances(one, image_plane_distance_mm)
    body: dict[str, Any] = {
        "static": {
            "camera": {
                "activeSensorPhysicalDimensions": {
                    "height": sensor.height_mm,
                    "width": sensor.width_mm,
                },
                "activeSensorResolution": {
                    "height": sensor.height_px,
                    "width": sensor.width_px,
                },
            },
            **({"lens": {"calibrationHistory": history}} if history else {}),
        },
        "lens": lens,
        "protocol": PROTOCOL,
    }
    # The same sample has the same name, so that writing twice gives the same file.
    return {**body, "sampleId": uuid.uuid5(uuid.NAMESPACE_OID, digest(body)).urn}


def _radial(camera: Camera) -> list[float]:
    if len(camera.radial) > 2:
        raise InputError(
            f"OpenTrackIO holds 3 radial terms, but the camera has {1 + len(camera.radial)}; "
            "calibrate it with radial_terms=3 or fewer"
        )
    radial = [camera.k1_per_mm2]
    for coefficient in camera.radial:
        radial += [0.0, coefficient]
    return radial


def _distances(one: ExportedSetting, image_plane_distance_mm: float) -> dict[str, float]:
    if one.nodal_offset_mm is None or one.object_distance_mm is None:
        raise InputError(
            "the distance of the image plane is measured from the projection centre of the "
            "reference setting, but the nodal offset at "
            f"{one.setting} is not known; leave the distance out, or record a session with a "
            "positioner"
        )
    pupil_mm = image_plane_distance_mm - one.nodal_offset_mm
    return {
        "entrancePupilOffset": pupil_mm / 1000,
        "focusDistance": (pupil_mm + one.object_distance_mm) / 1000,
    }
