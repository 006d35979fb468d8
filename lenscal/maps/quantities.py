"""The quantities of a lens map, and how they follow from its three core surfaces."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray

#: The quantities that every map has, in words and units for labels.
QUANTITIES: Final[dict[str, str]] = {
    "magnification": "magnification d/D",
    "object_distance_mm": "object distance D (mm)",
    "image_distance_mm": "image distance d (mm)",
    "focal_length_mm": "focal length f (mm)",
    "standoff_mm": "standoff (mm)",
    "nodal_offset_mm": "nodal offset (mm)",
    "principal_point_x_px": "principal point x (px)",
    "principal_point_y_px": "principal point y (px)",
    "k1_per_mm2": "distortion κ1 (mm⁻²)",
    "scale_factor": "scale factor",
    "nodal_x_mm": "projection centre, x (mm)",
    "nodal_y_mm": "projection centre, y (mm)",
    "sharpest_confidence": "confidence of sharpest focus",
}
#: Quantities of the camera besides d.
CAMERA_QUANTITIES: Final = (
    "principal_point_x_px",
    "principal_point_y_px",
    "k1_per_mm2",
    "scale_factor",
)
#: Where the projection centre wanders to across the axis, in the frame of the reference camera.
LATERAL: Final = ("nodal_x_mm", "nodal_y_mm")
#: How clear the autofocus saw its peak, from 0 to 1.
CONFIDENCE: Final = "sharpest_confidence"
#: Quantities that are surfaces of their own, fitted apart.
SINGLE: Final = (*CAMERA_QUANTITIES, *LATERAL, CONFIDENCE)
#: Of these the ones that a table often states as one number for all settings: no surface then.
_OFTEN_CONSTANT: Final = ("scale_factor", *LATERAL, CONFIDENCE)


#: Quantities that take a core surface each, where d/D and D are known, and the standoff too; and
#: where only d is, as from most foreign files.
CORE: Final = ("magnification", "object_distance_mm", "standoff_mm")
CORE_WITHOUT_DISTANCE: Final = ("image_distance_mm",)

#: Which core surfaces (ln d/D, ln D, ln standoff) a quantity is made of.
CORE_SURFACES: Final[dict[str, tuple[int, ...]]] = {
    "magnification": (0,),
    "object_distance_mm": (1,),
    "image_distance_mm": (0, 1),
    "focal_length_mm": (0, 1),
    "standoff_mm": (2,),
    "nodal_offset_mm": (1, 2),
}


def varies(samples: pd.DataFrame, quantity: str) -> bool:
    """Tell whether a table knows a quantity in a way that is worth a surface of its own.

    Parameters
    ----------
    samples
        One row per setting.
    quantity
        One of `SINGLE`.

    Returns
    -------
    bool
        Whether it is known anywhere, and, of the scale factor, the lateral wander and the
        confidence, which may be one number for all settings, not the same everywhere.
    """
    if quantity not in samples or samples[quantity].isna().all():
        return False
    return quantity not in _OFTEN_CONSTANT or samples[quantity].nunique() > 1


def single_value(quantity: str, surface: FloatArray) -> FloatArray:
    """Turn the value of a surface of its own into that of the quantity.

    Parameters
    ----------
    quantity
        One of `SINGLE`.
    surface
        (...) value of its surface.

    Returns
    -------
    FloatArray
        (...) the same; a confidence is kept from 0 to 1, where a smooth surface may overshoot.
    """
    return np.clip(surface, 0.0, 1.0) if quantity == CONFIDENCE else surface


def core_surfaces(quantity: str, count: int) -> tuple[int, ...]:
    """Tell which core surfaces of a map a quantity is made of.

    Parameters
    ----------
    quantity
        One of `CORE_SURFACES`.
    count
        How many core surfaces the map has; the one of a map without distances is ln d.

    Returns
    -------
    tuple of int
        Their indices.
    """
    return (0,) if count == 1 else CORE_SURFACES[quantity]


def from_logarithms(
    quantity: str, logarithms: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Value of a core quantity, and its derivatives with respect to the surfaces it is made of.

    Parameters
    ----------
    quantity
        One of `CORE_SURFACES`.
    logarithms
        (..., S) values of those surfaces, in the order of `core_surfaces`.

    Returns
    -------
    value : FloatArray
        (...).
    weights : tuple of FloatArray
        S arrays of that shape.
    """
    first = logarithms[..., 0]
    if quantity == "image_distance_mm" and logarithms.shape[-1] == 2:
        value = np.exp(first + logarithms[..., 1])
        return value, (value, value)
    if quantity == "focal_length_mm":  # 1/f = 1/D + 1/d with d = D · (d/D)
        above = 1 + np.exp(first)
        value = np.exp(first + logarithms[..., 1]) / above
        return value, (value / above, value)
    if quantity == "nodal_offset_mm":
        distance, standoff = np.exp(first), np.exp(logarithms[..., 1])
        return np.asarray(distance - standoff), (distance, -standoff)
    value = np.exp(first)
    return value, (value,)


def from_core(quantity: str, core: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Value of a quantity, and its derivatives with respect to all core surfaces of a map.

    Parameters
    ----------
    quantity
        One of `CORE_SURFACES`.
    core
        (..., Q) values of the core surfaces: ln(d/D), ln D and, for Q = 3, ln standoff; or ln d.

    Returns
    -------
    value : FloatArray
        (...).
    weights : FloatArray
        (..., Q).
    """
    surfaces = list(core_surfaces(quantity, core.shape[-1]))
    value, some = from_logarithms(quantity, core[..., surfaces])
    weights = np.zeros(core.shape)
    weights[..., surfaces] = np.stack(some, axis=-1)
    return np.asarray(value), weights


def all_from_core(core: FloatArray) -> dict[str, FloatArray]:
    """Values of all quantities that follow from the core surfaces of a map.

    Parameters
    ----------
    core
        (..., Q) values of the core surfaces: ln(d/D), ln D and, for Q = 3, ln standoff; or ln d.

    Returns
    -------
    dict
        Name to (...) values.
    """
    plain = [np.asarray(np.exp(core[..., i])) for i in range(core.shape[-1])]
    if len(plain) == 1:
        return {"image_distance_mm": plain[0]}
    ratio, distance = plain[:2]
    image_distance = ratio * distance
    known = {
        "magnification": ratio,
        "object_distance_mm": distance,
        "image_distance_mm": image_distance,
        "focal_length_mm": image_distance / (1 + ratio),
    }
    if len(plain) == 3:
        known |= {"standoff_mm": plain[2], "nodal_offset_mm": distance - plain[2]}
    return known
