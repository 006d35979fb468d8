"""The quantities of a lens map, and how they follow from its three core surfaces."""

from __future__ import annotations

from typing import Final

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


#: Which core surfaces (ln d/D, ln D, ln standoff) a quantity is made of.
CORE_SURFACES: Final[dict[str, tuple[int, ...]]] = {
    "magnification": (0,),
    "object_distance_mm": (1,),
    "image_distance_mm": (0, 1),
    "focal_length_mm": (0, 1),
    "standoff_mm": (2,),
    "nodal_offset_mm": (1, 2),
}


def from_logarithms(
    quantity: str, logarithms: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Value of a core quantity, and its derivatives with respect to the surfaces it is made of.

    Parameters
    ----------
    quantity
        One of `CORE_SURFACES`.
    logarithms
        (..., S) values of those surfaces, in that order.

    Returns
    -------
    value : FloatArray
        (...).
    weights : tuple of FloatArray
        S arrays of that shape.
    """
    first = logarithms[..., 0]
    if quantity == "image_distance_mm":
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
    """Value of a quantity, and its derivatives with respect to ln(d/D), ln D, ln standoff.

    Parameters
    ----------
    quantity
        One of `CORE_SURFACES`.
    core
        (..., Q) values of the core surfaces, Q = 2 or 3.

    Returns
    -------
    value : FloatArray
        (...).
    weights : FloatArray
        (..., Q).
    """
    surfaces = list(CORE_SURFACES[quantity])
    value, some = from_logarithms(quantity, core[..., surfaces])
    weights = np.zeros(core.shape)
    weights[..., surfaces] = np.stack(some, axis=-1)
    return np.asarray(value), weights
