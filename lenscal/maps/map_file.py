"""The file of a lens map: samples, smoothing and coefficients, as JSON that can be read and diffed.

The covariance is not in it: samples and smoothing give it again, and with it the coefficients,
which are compared with those in the file.
"""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.document import Json, read_document, write_document
from lenscal.errors import FileError
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.maps.pupil import PupilMap
from lenscal.maps.surface import Surfaces
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
    surfaces = {"core": lens_map.core, **lens_map.single_surfaces}
    if lens_map.pupil is not None:
        surfaces["pupil"] = lens_map.pupil.surface
    further = lens_map.pupil_samples
    sensor, setting = lens_map.sensor, lens_map.reference_setting
    return {
        "sensor": sensor and dataclasses.asdict(sensor),
        "reference_setting": setting and dataclasses.astuple(setting),
        **({"identity": dict(lens_map.identity)} if lens_map.identity else {}),
        "notes": list(lens_map.notes),
        "domain": lens_map.domain.outline.tolist(),
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
        "core_coordinates": {
            "powers": lens_map.core.powers.tolist(),
            "mixing": lens_map.core.mixing.tolist(),
            "roughening": lens_map.core.roughening.tolist(),
        },
        "irises": lens_map.pupil and _irises(lens_map.pupil),
        "samples": _columns(lens_map.samples),
        "pupil_samples": None if further is None else _columns(further),
    }


def _columns(samples: pd.DataFrame) -> Json:
    known = samples.replace({np.nan: None})
    return {str(c): known[c].tolist() for c in known.columns}


def _irises(pupil: PupilMap) -> Json:
    irises = [None if np.isnan(iris) else iris for iris in pupil.irises.tolist()]
    return {"iris": irises, "log_ratio": pupil.log_ratios.tolist()}


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
        When the file cannot be used, or its samples do not give its coefficients or its domain.
    """
    body = read_document(path, KIND, VERSION)
    setting, further = body["reference_setting"], body.get("pupil_samples")
    found = fit_lens_map(
        pd.DataFrame(body["samples"]).astype({"zoom": float, "focus": float}),
        sensor=body["sensor"] and Sensor(**body["sensor"]),
        reference_setting=setting and LensSetting(*setting),
        log_smoothing=_chosen(body),
        # Older maps lack what follows.
        pupil_samples=None if further is None else pd.DataFrame(further),
        identity=body.get("identity"),
    )
    # A file says what was mapped when it was written, though its samples may tell more by now.
    singles = {n: s for n, s in found.single_surfaces.items() if n in body["surfaces"]}
    found = replace(found, single_surfaces=singles)
    for name, stated in body["surfaces"].items():
        mine, its = _surfaces(found, name, path).coefficients, np.array(stated["coefficients"])
        if mine.shape != its.shape or not np.allclose(mine, its, rtol=1e-6, atol=1e-9):
            raise FileError(
                f"{path} disagrees with itself: its samples do not give its coefficients of "
                f"{name}; fit the map again from the table"
            )
    # Files of the first maps do not state their domain.
    stated = body.get("domain", found.domain.outline.tolist())
    if not _same(found.domain.outline, stated):
        raise FileError(
            f"{path} disagrees with itself: its samples do not give its domain; fit the map again "
            "from the table"
        )
    return found


def _chosen(body: Json) -> dict[str, npt.ArrayLike]:
    """What the data chose when the map was fitted, so that it need not be chosen again."""
    chosen = {name: surface["log_smoothing"] for name, surface in body["surfaces"].items()}
    coordinates = body.get("core_coordinates", {})
    return chosen | {f"core_{name}": np.array(value) for name, value in coordinates.items()}


def _same(outline: FloatArray, stated: list[list[float]]) -> bool:
    """Whether the outline of a domain is the one stated, to rounding."""
    other = np.asarray(stated, dtype=np.float64)
    return other.shape == outline.shape and np.allclose(other, outline, rtol=1e-9, atol=1e-12)


def _surfaces(lens_map: LensMap, name: str, path: Path | str) -> Surfaces:
    if name == "core":
        return lens_map.core
    if name != "pupil":
        return lens_map.single_surfaces[name]
    if lens_map.pupil is None:
        raise FileError(
            f"{path} disagrees with itself: it has an entrance pupil, but its samples give none; "
            "fit the map again from the table"
        )
    return lens_map.pupil.surface
