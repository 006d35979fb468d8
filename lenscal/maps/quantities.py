"""The quantities of a lens map, and how they follow from its three core surfaces."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

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
}
#: Quantities of the camera that are surfaces of their own.
CAMERA_QUANTITIES: Final = ("principal_point_x_px", "principal_point_y_px", "k1_per_mm2")


def from_core(quantity: str, core: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Value of a quantity, and its derivatives with respect to ln(d/D), ln D, ln standoff.

    Parameters
    ----------
    quantity
        One of the core quantities or what follows from them.
    core
        (..., Q) values of the core surfaces, Q = 2 or 3.

    Returns
    -------
    value : FloatArray
        (...).
    weights : FloatArray
        (..., Q).
    """
    ratio, distance = np.exp(core[..., 0]), np.exp(core[..., 1])
    none = np.zeros_like(ratio)
    weights: list[Any]
    if quantity == "magnification":
        value, weights = ratio, [ratio, none, none]
    elif quantity == "object_distance_mm":
        value, weights = distance, [none, distance, none]
    elif quantity == "image_distance_mm":
        value = ratio * distance
        weights = [value, value, none]
    elif quantity == "focal_length_mm":  # 1/f = 1/D + 1/d with d = D · (d/D)
        value = ratio * distance / (1 + ratio)
        weights = [value / (1 + ratio), value, none]
    else:
        standoff = np.exp(core[..., 2])
        if quantity == "standoff_mm":
            value, weights = standoff, [none, none, standoff]
        else:
            value, weights = distance - standoff, [none, distance, -standoff]
    return np.asarray(value), np.stack(weights[: core.shape[-1]], axis=-1)
