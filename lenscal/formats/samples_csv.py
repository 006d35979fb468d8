"""A table of a lens as CSV: the quantities of a map at chosen settings, and anybody's samples."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.calibration.table import COLUMNS, COUNTS
from lenscal.document import write_whole
from lenscal.errors import FileError, InputError
from lenscal.formats.exported import WrittenFile
from lenscal.formats.imported import (
    NO_OBJECT_DISTANCE,
    NO_SIGMA,
    ImportedTable,
    with_magnification,
)
from lenscal.formats.reading import blamed_on, read_text
from lenscal.maps.lens_map import LensMap
from lenscal.maps.quantities import CONFIDENCE, from_core
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting

#: Quantities whose covariances a map can be fitted with again.
_FITTED: Final = ("magnification", "object_distance_mm", "standoff_mm")
_POSITIVE: Final = (*_FITTED, "image_distance_mm", "focal_length_mm")
_TEXTS: Final = ("approach",)
#: What a table of samples may say: a calibration has no σ of its confidence, a map has.
_KNOWN: Final = (*COLUMNS, f"sigma_{CONFIDENCE}")


def write_samples_csv(
    path: Path | str, lens_map: LensMap, settings: Iterable[LensSetting]
) -> WrittenFile:
    """Write the quantities of a map, their σ and covariances, to the last digit.

    Parameters
    ----------
    path
        The file.
    lens_map
        The map.
    settings
        The settings, within the domain.

    Returns
    -------
    WrittenFile
        The file. The errors of its rows hang together, which a table of rows cannot say.

    Raises
    ------
    InputError
        When there is no setting.
    """
    chosen = list(settings)
    if not chosen:
        raise InputError("there is no setting to export; give at least one")
    zoom = np.array([float(s.zoom) for s in chosen])
    focus = np.array([float(s.focus) for s in chosen])
    table = {"zoom": zoom, "focus": focus}
    table |= {name: lens_map.value(name, zoom, focus) for name in lens_map.quantities}
    table |= {f"sigma_{name}": lens_map.sigma(name, zoom, focus) for name in lens_map.quantities}
    table |= _covariances(lens_map, zoom, focus)
    text = pd.DataFrame(table).to_csv(index=False, lineterminator="\n")
    return WrittenFile(write_whole(Path(path), text))


def read_samples_csv(path: Path | str, sensor: Sensor | None = None) -> ImportedTable:
    """Read a table of samples.

    Parameters
    ----------
    path
        A CSV file with the columns zoom and focus, and any columns of a calibration table
        (`lenscal.calibration.table.COLUMNS`), which carry their unit in their name. Empty cells and
        ``nan`` are not known; columns of other names are left aside.
    sensor
        The sensor, which the file does not tell.

    Returns
    -------
    ImportedTable
        One row per line.

    Raises
    ------
    FileError
        When the file cannot be read, lacks zoom or focus, or a line is not what it has to be.
    """
    path = Path(path)
    reader = csv.reader(io.StringIO(read_text(path)), strict=True)
    try:
        lines = [(reader.line_num, row) for row in reader if any(word.strip() for word in row)]
    except csv.Error as error:
        raise FileError(f"{path}, line {reader.line_num}: no CSV ({error})") from error
    header = [word.strip() for word in lines[0][1]] if lines else []
    for name in ("zoom", "focus"):
        if header.count(name) != 1:
            raise FileError(
                f"{path}, line 1: wanted is one column {name}, but there are {header.count(name)}; "
                f"its columns are {', '.join(header):.200}"
            )
    known = [name for name in header if name in _KNOWN and name not in (*COUNTS, *_TEXTS)]
    if len(set(known)) < len(known):
        raise FileError(f"{path}, line 1: a column stands there twice: {', '.join(known):.200}")
    rows = [_row(path, line, header, known, words) for line, words in lines[1:]]
    if not rows:
        raise FileError(f"{path} holds no line of values; was it cut short?")
    # A column without a value says no more than one that is not there.
    samples = with_magnification(pd.DataFrame(rows).dropna(axis="columns", how="all"))
    missing = []
    aside = [name for name in header if name not in known and name not in (*COUNTS, *_TEXTS)]
    if aside:
        missing.append(f"columns of unknown meaning were left aside: {', '.join(aside)}")
    if "object_distance_mm" not in samples or samples["object_distance_mm"].isna().any():
        missing.append(NO_OBJECT_DISTANCE)
    if not any(str(name).startswith("sigma_") for name in samples):
        missing.append(NO_SIGMA)
    if sensor is None:
        missing.append("the size of the sensor is not stated")
    with blamed_on(path):
        return ImportedTable(samples, tuple(missing), sensor)


def _covariances(lens_map: LensMap, zoom: FloatArray, focus: FloatArray) -> dict[str, FloatArray]:
    names = [name for name in _FITTED if name in lens_map.quantities]
    core = lens_map.core.value(zoom, focus)
    covariance = lens_map.core.covariance_at(zoom, focus)
    weights = {name: from_core(name, core)[1] for name in names}
    return {
        f"cov_{a}_{b}": np.einsum("ni,nij,nj->n", weights[a], covariance, weights[b])
        for a, b in combinations(names, 2)
    }


def _row(
    path: Path, line: int, header: list[str], known: list[str], words: list[str]
) -> dict[str, float]:
    if len(words) != len(header):
        raise FileError(
            f"{path}, line {line}: wanted are {len(header)} values ({', '.join(header):.120}), but "
            f"the line holds {len(words)}; was the file cut short?"
        )
    row = {}
    for name, word in zip(header, words, strict=True):
        if name not in known:
            continue
        try:
            value = float(word.strip() or "nan")
        except ValueError:
            value = np.inf
        must = name in ("zoom", "focus")
        if np.isinf(value) or (must and np.isnan(value)) or (name in _POSITIVE and value <= 0):
            wanted = "a positive number" if name in _POSITIVE else "a number"
            empty = "" if must else ", or nothing where it is not known"
            raise FileError(
                f"{path}, line {line}: {name} is {word.strip()!r:.40}; wanted is {wanted}{empty}"
            )
        row[name] = value
    return row
