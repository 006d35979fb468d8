"""The file of a lens map: samples, smoothing and coefficients, as JSON that can be read and diffed.

The covariance is not in it: samples and smoothing give it again, and with it the coefficients,
which are compared with those in the file.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from lenscal.document import Json, read_document, write_document
from lenscal.errors import FileError
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting

KIND: Final = "lens-map"
VERSION: Final = 1


def to_json(lens_map: LensMap) -> Json:
    """Turn a map into what JSON can hold.

    Parameters
    ----------
    lens_map
        The map.

    Returns
    -------
    dict
        The body of its file.
    """
    samples = lens_map.samples.replace({np.nan: None})
    surfaces = {"core": lens_map.core, **lens_map.camera_surfaces}
    sensor, setting = lens_map.sensor, lens_map.reference_setting
    return {
        "sensor": sensor and dataclasses.asdict(sensor),
        "reference_setting": setting and dataclasses.astuple(setting),
        "notes": list(lens_map.notes),
        "surfaces": {
            name: {
                "zoom_knots": s.zoom.knots.tolist(),
                "focus_knots": s.focus.knots.tolist(),
                "degrees": [s.zoom.degree, s.focus.degree],
                "log_smoothing": s.log_smoothing.tolist(),
                "coefficients": s.coefficients.tolist(),
            }
            for name, s in surfaces.items()
        },
        "samples": {str(c): samples[c].tolist() for c in samples.columns},
    }


def save(lens_map: LensMap, path: Path | str) -> Path:
    """Write a map.

    Parameters
    ----------
    lens_map
        The map.
    path
        The file.

    Returns
    -------
    Path
        The file.
    """
    return write_document(path, KIND, VERSION, to_json(lens_map))


def load(path: Path | str) -> LensMap:
    """Read a map.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    LensMap
        The map that was saved.

    Raises
    ------
    FileError
        When the file cannot be used, or its samples do not give its coefficients.
    """
    body = read_document(path, KIND, VERSION)
    setting = body["reference_setting"]
    found = fit_lens_map(
        pd.DataFrame(body["samples"]).astype({"zoom": float, "focus": float}),
        sensor=body["sensor"] and Sensor(**body["sensor"]),
        reference_setting=setting and LensSetting(*setting),
        log_smoothing={n: s["log_smoothing"] for n, s in body["surfaces"].items()},
    )
    for name, stated in body["surfaces"].items():
        surfaces = found.core if name == "core" else found.camera_surfaces[name]
        if not np.allclose(surfaces.coefficients, stated["coefficients"], rtol=1e-6, atol=1e-9):
            raise FileError(
                f"{path} disagrees with itself: its samples do not give its coefficients of "
                f"{name}; fit the map again from the table"
            )
    return found
