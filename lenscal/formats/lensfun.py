"""Distortion sets of the lensfun database: one per focal length of a photographic zoom lens.

Its radii are shares of half the shorter side of the sensor, and run from undistorted to distorted.
What it calls focal length is the number engraved on the lens unless it states a ``real-focal``,
which is our image distance.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.errors import FileError
from lenscal.formats.distortion import ConvertedCamera, fit_distortion, pixel_grid
from lenscal.formats.imported import (
    NO_OBJECT_DISTANCE,
    NO_SIGMA,
    ImportedTable,
    camera_row,
    worst_error_sentence,
)
from lenscal.formats.reading import blamed_on, number, read_text
from lenscal.sensor import Sensor

_NEWEST: Final = 2
#: Coefficients of each model, and to which power of r_u they belong in r_d.
_POWERS: Final[dict[str, dict[str, int]]] = {
    "ptlens": {"a": 4, "b": 3, "c": 2},
    "poly3": {"k1": 3},
    "poly5": {"k1": 3, "k2": 5},
}
_FULL_FRAME_MM: Final = (36.0, 24.0)
_NEWTON_STEPS: Final = 50


def read_lensfun(
    path: Path | str, size_px: tuple[int, int], lens: str | None = None
) -> ImportedTable:
    """Read the distortion set of one lens.

    Parameters
    ----------
    path
        An XML file of the database.
    size_px
        Width and height of an image, which the file does not tell.
    lens
        A part of the name of the model; None when the file holds one lens only.

    Returns
    -------
    ImportedTable
        One row per focal length: zoom is the focal length in mm, focus is 0. κ1 is fitted to the
        set's distortion over the sensor of the stated crop factor and aspect ratio.

    Raises
    ------
    FileError
        When the file cannot be read, is cut short, newer, does not hold the lens, or a field is not
        what it has to be.
    """
    path = Path(path)
    element = _lens(path, _root(path), lens)
    sensor = _sensor(path, element, size_px)
    sets = element.findall("calibration/distortion")
    if not sets:
        raise FileError(f"{path}: the lens {_name(element)!r} has no distortion set")
    kind = (element.findtext("type") or "rectilinear").strip()
    if kind != "rectilinear":
        raise FileError(f"{path}: {_name(element)!r} is {kind}; only rectilinear lenses are read")
    rows = []
    for i, entry in enumerate(sets):
        focal = _attribute(path, entry, i, "focal")
        with blamed_on(path):
            rows.append(camera_row(focal, 0.0, _camera(path, entry, i, sensor)))
    samples = pd.DataFrame(rows).drop(columns=["principal_point_x_px", "principal_point_y_px"])
    nominal = sum("real-focal" not in entry.attrib for entry in sets)
    missing = [
        NO_OBJECT_DISTANCE,
        "lensfun knows no focus setting and no principal point: all rows are at focus 0; zoom is "
        "the focal length in mm",
        worst_error_sentence(samples),
        NO_SIGMA,
    ]
    if nominal:
        missing.insert(
            1,
            f"at {nominal} of {len(sets)} focal lengths the image distance comes from the number "
            "engraved on the lens, not from a measurement",
        )
    with blamed_on(path):
        return ImportedTable(samples, tuple(missing), sensor)


def _root(path: Path) -> ElementTree.Element:
    text = read_text(path)
    if "<!ENTITY" in text:
        raise FileError(f"{path} declares entities, which the database of lensfun never does")
    try:
        root = ElementTree.fromstring(text.encode())
    except ElementTree.ParseError as error:
        raise FileError(
            f"{path}, line {error.position[0]}: no XML ({error}); was the file cut short?"
        ) from error
    if root.tag != "lensdatabase":
        raise FileError(f"{path} holds <{root.tag}>, not the <lensdatabase> of lensfun")
    version = number(path, root.get("version", "1"), "the version of lensdatabase")
    if version > _NEWEST:
        raise FileError(
            f"{path} has version {version:g} of the database of lensfun; this lenscal reads up to "
            f"{_NEWEST}: install a newer one"
        )
    return root


def _lens(path: Path, root: ElementTree.Element, wanted: str | None) -> ElementTree.Element:
    every = root.findall("lens")
    found = [e for e in every if wanted is None or wanted.lower() in _name(e).lower()]
    exact = [e for e in found if wanted is not None and _name(e).lower() == wanted.lower()]
    found = exact or found
    if len(found) != 1:
        names = "; ".join(_name(e) for e in (found or every))
        asked = "no lens was named" if wanted is None else f"asked for is {wanted!r:.60}"
        raise FileError(
            f"{path}: {asked}, which fits {len(found)} of {len(every)} lenses; name one of: "
            f"{names:.300}"
        )
    return found[0]


def _name(element: ElementTree.Element) -> str:
    return (element.findtext("model") or "").strip()


def _sensor(path: Path, element: ElementTree.Element, size_px: tuple[int, int]) -> Sensor:
    crop = number(path, element.findtext("cropfactor"), "cropfactor", positive=True)
    text = (element.findtext("aspect-ratio") or "3:2").strip()
    terms = [number(path, word, "aspect-ratio", positive=True) for word in text.split(":")]
    aspect = terms[0] / (terms[1] if len(terms) > 1 else 1.0)
    height = float(np.hypot(*_FULL_FRAME_MM)) / crop / float(np.hypot(aspect, 1.0))
    with blamed_on(path):
        width_px, height_px = size_px
        return Sensor(width_px, height_px, height * aspect / width_px, height / height_px)


def _attribute(
    path: Path, entry: ElementTree.Element, i: int, name: str, default: float | None = None
) -> float:
    if name not in entry.attrib and default is not None:
        return default
    return number(path, entry.get(name), f"{name} of distortion set {i}", positive=default is None)


def _camera(path: Path, entry: ElementTree.Element, i: int, sensor: Sensor) -> ConvertedCamera:
    model = entry.get("model", "")
    if model not in _POWERS:
        raise FileError(
            f"{path}: the model {model!r:.40} of distortion set {i} is not read; "
            f"{', '.join(_POWERS)} are"
        )
    terms = {
        power: _attribute(path, entry, i, name, default=0.0)
        for name, power in _POWERS[model].items()
    }
    # What a straight line near the axis is scaled by; poly5 has no such term.
    linear = 1.0 if model == "poly5" else 1.0 - sum(terms.values())
    distance = _attribute(path, entry, i, "focal") * linear
    if "real-focal" in entry.attrib:
        distance = _attribute(path, entry, i, "real-focal")
    camera = Camera(sensor, distance)
    distorted = (pixel_grid(sensor) - sensor.centre_px) * sensor.sample_pitch_mm
    radius = np.linalg.norm(distorted, axis=-1)
    half = sensor.height_mm / 2
    undistorted = _undistort(path, i, radius / half, linear, terms) * half * linear
    ratio = np.where(radius > 0, undistorted / np.where(radius > 0, radius, 1.0), 1.0)
    directions = distorted * ratio[:, None] / distance
    return fit_distortion(camera, directions, 1, decentred=False)


def _undistort(
    path: Path, i: int, wanted: FloatArray, linear: float, terms: dict[int, float]
) -> FloatArray:
    polynomial = np.zeros(6)
    polynomial[1] = linear
    for power, value in terms.items():
        polynomial[power] = value
    slope = np.polynomial.polynomial.polyder(polynomial)
    radius = wanted.copy()
    for _ in range(_NEWTON_STEPS):
        steepness = np.polynomial.polynomial.polyval(radius, slope)
        if not (steepness > 1e-3).all():
            break
        step = (np.polynomial.polynomial.polyval(radius, polynomial) - wanted) / steepness
        radius = radius - step
        if np.abs(step).max() < 1e-14:
            break
    left = np.abs(np.polynomial.polynomial.polyval(radius, polynomial) - wanted).max()
    if not left < 1e-9:
        raise FileError(f"{path}: distortion set {i} folds within the image and has no inverse")
    return np.asarray(radius)
