"""The quantities of any table of settings, in coordinates in which a lens is tame."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray, IntArray
from lenscal.errors import InputError, MapError
from lenscal.maps.numbers import in_numbers
from lenscal.maps.quantities import CAMERA_QUANTITIES, LATERAL, varies

#: Positive quantities: their errors are relative, so their logarithms are looked at.
POSITIVE: Final = (
    "magnification",
    "object_distance_mm",
    "image_distance_mm",
    "focal_length_mm",
    "standoff_mm",
)


class TameQuantity(NamedTuple):
    """One quantity at the settings where it is known.

    Parameters
    ----------
    name
        Its name.
    rows
        (M,) rows of the table.
    values
        (M,) the quantity, or its logarithm where it is among `POSITIVE`.
    variances
        (M,) of these, autofocus included; None where they are not known.
    offset
        (M,) what to add to the values before they are turned back into the quantity.
    """

    name: str
    rows: IntArray
    values: FloatArray
    variances: FloatArray | None
    offset: FloatArray

    @property
    def is_logarithm(self) -> bool:
        """Whether the values are logarithms."""
        return self.name in POSITIVE

    def in_unit(self, value: float, place: int) -> float:
        """Turn a value in the tame coordinate into the quantity.

        Parameters
        ----------
        value
            The value.
        place
            Which of the M settings it belongs to.

        Returns
        -------
        float
            In the unit of the quantity.
        """
        shifted = value + self.offset[place]
        return float(np.exp(shifted) if self.is_logarithm else shifted)


def tame_quantities(samples: pd.DataFrame) -> list[TameQuantity]:
    """Find the quantities of a table, d and f being derived where they are not stated.

    Parameters
    ----------
    samples
        A table that `checked_settings` has passed.

    Returns
    -------
    list of TameQuantity
        Those of which a value is known.
    """
    frame = samples.copy()
    if {"magnification", "object_distance_mm"} <= set(frame):
        for name, values in derived(frame).items():
            frame[name] = frame[name] if name in frame else values
    known = [n for n in POSITIVE if n in frame and frame[n].notna().any()]
    known += [n for n in (*CAMERA_QUANTITIES, *LATERAL) if varies(frame, n)]
    found = []
    for name in known:
        rows = np.flatnonzero(frame[name].notna())
        part = frame.iloc[rows]
        values = part[name].to_numpy(float)
        variances = _variances(part, name)
        if name in POSITIVE:
            values = np.log(values)
        found.append(TameQuantity(name, rows, values, variances, np.zeros(len(rows))))
    return found


def derived(samples: pd.DataFrame) -> dict[str, FloatArray]:
    """Give d and f as they follow from d/D and D.

    Parameters
    ----------
    samples
        With the columns magnification and object_distance_mm.

    Returns
    -------
    dict
        Name to (N,) values.
    """
    ratio, distance = (
        samples[name].to_numpy(float) for name in ("magnification", "object_distance_mm")
    )
    return {
        "image_distance_mm": np.asarray(ratio * distance),
        "focal_length_mm": np.asarray(ratio * distance / (1 + ratio)),
    }


def checked_settings(table: pd.DataFrame) -> pd.DataFrame:
    """Refuse a table whose settings or numbers cannot be used.

    Parameters
    ----------
    table
        One row per setting: zoom, focus, and any quantities of a lens.

    Returns
    -------
    pd.DataFrame
        The same with rows counted from 0.

    Raises
    ------
    InputError
        When columns are missing, values not finite or not positive, σ not positive, or settings
        repeated.
    MapError
        When there is one setting only.
    """
    samples = in_numbers(table)
    missing = [name for name in ("zoom", "focus") if name not in samples]
    if missing or not any(name in samples for name in (*POSITIVE, *CAMERA_QUANTITIES, *LATERAL)):
        wanted = ", ".join(missing) if missing else f"any of {', '.join(POSITIVE)}"
        raise InputError(
            f"the table of settings lacks {wanted}; it has {', '.join(map(str, samples.columns))}"
        )
    present = [n for n in POSITIVE if n in samples and samples[n].notna().any()]
    for name in ("zoom", "focus", *present):
        bad = samples.index[~np.isfinite(samples[name].to_numpy(float))]
        if len(bad):
            raise InputError(
                f"{name} is not finite in row {bad[0]} of the table ({len(bad)} such rows); leave "
                "these settings out or measure them again"
            )
    sigmas = [n for n in map(str, samples.columns) if n.startswith("sigma_")]
    for name in (*present, *sigmas):
        bad = samples.index[samples[name] <= 0]
        if len(bad):
            raise InputError(
                f"{name} must be positive, but is {samples[name][bad[0]]:g} in row {bad[0]} of the "
                "table; leave this setting out, or this column"
            )
    repeated = samples.index[samples.duplicated(["zoom", "focus"])]
    if len(repeated):
        row = samples.loc[repeated[0]]
        raise InputError(
            f"the setting zoom {row['zoom']:g}, focus {row['focus']:g} stands more than once "
            "in the table; keep one row per setting"
        )
    if len(samples) < 2:
        raise MapError(
            f"settings are judged by their neighbours, but the table has {len(samples)}; "
            "calibrate more"
        )
    return samples


def _column(samples: pd.DataFrame, name: str) -> FloatArray | None:
    if name not in samples or samples[name].isna().any():
        return None
    return np.asarray(samples[name].to_numpy(float))


def _variances(samples: pd.DataFrame, name: str) -> FloatArray | None:
    """Variance in the tame coordinate: of calibration, and of where the autofocus stopped.

    The stop leaves d alone, moves D by as much as it errs and so d/D the other way, and f by
    d/D / (1 + d/D) of that; the σ of the standoff holds it already.
    """
    sigma = _column(samples, f"sigma_{name}")
    ratio, distance = (_column(samples, n) for n in ("magnification", "object_distance_mm"))
    if sigma is None and name == "standoff_mm":
        sigma = _column(samples, "sigma_sharpest_mm")
    if name not in POSITIVE:
        return None if sigma is None else sigma**2
    if sigma is not None:
        variance = np.asarray((sigma / samples[name].to_numpy(float)) ** 2)
    elif name in ("image_distance_mm", "focal_length_mm"):
        propagated = _propagated(samples, name)
        if propagated is None:
            return None
        variance = propagated
    else:
        return None
    stop = _column(samples, "sigma_sharpest_mm")
    if stop is None or ratio is None or distance is None:
        return variance
    none, whole = np.zeros(len(samples)), np.ones(len(samples))
    share = {
        "magnification": whole,
        "object_distance_mm": whole,
        "focal_length_mm": ratio / (1 + ratio),
    }
    return np.asarray(variance + (share.get(name, none) * stop / distance) ** 2)


def _propagated(samples: pd.DataFrame, name: str) -> FloatArray | None:
    """Variance of ln d or ln f from that of d/D and D."""
    columns = [
        _column(samples, f"{prefix}{n}")
        for prefix in ("", "sigma_")
        for n in ("magnification", "object_distance_mm")
    ]
    ratio, distance, sigma_ratio, sigma_distance = columns
    if ratio is None or distance is None or sigma_ratio is None or sigma_distance is None:
        return None
    shared = _column(samples, "cov_magnification_object_distance_mm")
    covariance = np.zeros(len(samples)) if shared is None else shared
    weight = 1 / (1 + ratio) if name == "focal_length_mm" else np.ones(len(samples))
    first, second = weight * sigma_ratio / ratio, sigma_distance / distance
    both = 2 * weight * covariance / (ratio * distance)
    return np.asarray(np.maximum(first**2 + second**2 + both, 1e-20))
