"""How sharp the rim of a disk is: one interface, several measures.

The camera moves while it focuses, so the disk grows and shrinks in the image, and a measure that is
summed over pixels changes with it. The edge width does not: it is taken per length of rim and per
squared contrast. Source of the paper's criterion: its section on autofocus and its reference 12
(gradient magnitude, thresholded); the others are the usual ones, taken over the ring at the rim.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.errors import FocusError
from lenscal.session.disk_search import DiskImage, Grey

#: Half width of the ring in px, at least, and as a share of the disk's radius.
_LEAST_HALF_WIDTH: Final = 4.0
_HALF_WIDTH_SHARE: Final = 0.35
#: Pixels in the paper's evaluation window.
_PAPER_WINDOW_PX: Final = 800.0

_Mask = npt.NDArray[np.bool_]


class Measure(enum.StrEnum):
    """What sharpness is measured by."""

    EDGE_WIDTH = "edge_width"
    GRADIENT_MAGNITUDE = "gradient_magnitude"
    TENENGRAD = "tenengrad"
    LAPLACIAN_VARIANCE = "laplacian_variance"
    BRENNER = "brenner"
    NORMALISED_VARIANCE = "normalised_variance"


@dataclass(frozen=True, slots=True)
class SharpnessMeasure:
    """A measure, and how it falls as the edge widens.

    Parameters
    ----------
    score
        From (rows, columns) grey values and the disk in them: larger is sharper.
    width_power
        The score goes as edge width to minus this power, where the measure obeys one.
    label
        Name and unit, for figures.
    """

    score: Callable[[Grey, DiskImage], float]
    width_power: float
    label: str


def ring_sharpness(image: Grey, disk: DiskImage) -> float:
    """Measure one over the width of the edge.

    Parameters
    ----------
    image
        (rows, columns) grey values.
    disk
        Where the disk is in it.

    Returns
    -------
    float
        Squared gradient over the ring, less that of noise, per length of rim and squared contrast:
        one over the width of the edge, in 1/px.

    Raises
    ------
    FocusError
        When the ring has no contrast.
    """
    grey = image.astype(np.float32)
    distance = disk.rim_distance_px(image.shape)
    half = max(_LEAST_HALF_WIDTH, _HALF_WIDTH_SHARE * min(disk.semi_axes_px))
    inside = (distance < -0.6 * half) & (distance > -1.4 * half)
    outside = (distance > 0.6 * half) & (distance < 1.4 * half)
    if not inside.any() or not outside.any():
        raise FocusError(
            f"the disk of {disk.radius_px:.0f} px radius has no room about its rim in the picture; "
            "take a larger disk, or point the camera at its middle"
        )
    contrast = float(np.median(grey[outside]) - np.median(grey[inside]))
    if contrast <= 0:
        raise FocusError("the disk has no contrast to its surroundings; check light and exposure")
    squared = _squared_gradient(grey)
    noise = _noise_variance(grey, inside | outside)
    # Central differences of white noise have half its variance along each axis.
    signal = float((squared[np.abs(distance) <= half] - noise).sum())
    return signal / (disk.perimeter_px * contrast**2)


def ring_gradient_magnitude(image: Grey, disk: DiskImage, threshold: float = 0.0) -> float:
    """Sum the gradient magnitude over the ring at the rim: the criterion of the paper.

    Parameters
    ----------
    image
        (rows, columns) grey values.
    disk
        Where the disk is in it.
    threshold
        Magnitudes up to this many grey levels per px are left out; the paper used none.

    Returns
    -------
    float
        The sum in grey levels, over the 800 px that lie nearest to the rim on both sides.
    """
    magnitude = np.sqrt(_squared_gradient(image.astype(np.float32)))
    half = _PAPER_WINDOW_PX / 2 / disk.perimeter_px
    ring = np.abs(disk.rim_distance_px(image.shape)) <= half
    return float(magnitude[ring & (magnitude > threshold)].sum())


def _tenengrad(image: Grey, disk: DiskImage) -> float:
    """Sum the squared Sobel gradient over the ring."""
    grey = image.astype(np.float32)
    across, down = (cv2.Sobel(grey, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    return float((across**2 + down**2)[_ring(image, disk)].sum(dtype=np.float64))


def _laplacian_variance(image: Grey, disk: DiskImage) -> float:
    """Take the variance of the Laplacian over the ring."""
    laplacian = cv2.Laplacian(image.astype(np.float32), cv2.CV_32F)
    return float(laplacian[_ring(image, disk)].var(dtype=np.float64))


def _brenner(image: Grey, disk: DiskImage) -> float:
    """Sum the squared difference of columns two apart over the ring."""
    grey = image.astype(np.float64)
    difference = np.zeros(grey.shape)
    difference[:, 1:-1] = grey[:, 2:] - grey[:, :-2]
    return float((difference**2)[_ring(image, disk)].sum())


def _normalised_variance(image: Grey, disk: DiskImage) -> float:
    """Take the variance of the grey values over the ring, divided by their mean."""
    values = image[_ring(image, disk)].astype(np.float64)
    return float(values.var() / values.mean()) if values.any() else 0.0


MEASURES: Final[dict[Measure, SharpnessMeasure]] = {
    Measure.EDGE_WIDTH: SharpnessMeasure(ring_sharpness, 1.0, "1 / edge width (1/px)"),
    Measure.GRADIENT_MAGNITUDE: SharpnessMeasure(
        ring_gradient_magnitude, 1.0, "gradient magnitude, as published (grey levels)"
    ),
    Measure.TENENGRAD: SharpnessMeasure(_tenengrad, 1.0, "Tenengrad (grey levels²)"),
    Measure.LAPLACIAN_VARIANCE: SharpnessMeasure(
        _laplacian_variance, 3.0, "variance of the Laplacian (grey levels²)"
    ),
    Measure.BRENNER: SharpnessMeasure(_brenner, 1.0, "Brenner (grey levels²)"),
    Measure.NORMALISED_VARIANCE: SharpnessMeasure(
        _normalised_variance, 1.0, "normalised variance (grey levels)"
    ),
}


def _ring(image: Grey, disk: DiskImage) -> _Mask:
    """Choose the pixels about the rim."""
    half = max(_LEAST_HALF_WIDTH, _HALF_WIDTH_SHARE * min(disk.semi_axes_px))
    ring: _Mask = np.abs(disk.rim_distance_px(image.shape)) <= half
    return ring


def _squared_gradient(grey: npt.NDArray[np.float32]) -> FloatArray:
    """Squared magnitude of the gradient by central differences."""
    across = np.zeros(grey.shape)
    down = np.zeros(grey.shape)
    across[:, 1:-1] = (grey[:, 2:] - grey[:, :-2]) / 2
    down[1:-1] = (grey[2:] - grey[:-2]) / 2
    return across**2 + down**2


def _noise_variance(grey: npt.NDArray[np.float32], flat: _Mask) -> float:
    """Variance of pixel noise where the picture is flat, from second differences."""
    second = grey[:, 2:] - 2 * grey[:, 1:-1] + grey[:, :-2]
    chosen = second[flat[:, 1:-1]]
    if chosen.size == 0:
        return 0.0
    spread = 1.4826 * float(np.median(np.abs(chosen - np.median(chosen))))
    return spread**2 / 6
