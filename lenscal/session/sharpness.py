"""How sharp the rim of a disk is: gradient magnitude over a ring around it.

The camera moves while it focuses, so the disk grows and shrinks in the image. The measure is
therefore taken per length of rim and per contrast: it is the reciprocal of the width of the edge in
px, and does not change with scale. Source of the criterion: the paper's section on autofocus and
its reference 12 (gradient magnitude, no threshold); what differs is the normalisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.errors import FocusError

#: Half width of the ring in px, at least, and as a share of the disk's radius.
_LEAST_HALF_WIDTH: Final = 4.0
_HALF_WIDTH_SHARE: Final = 0.35
#: A disk fills this much of its bounding ellipse; letters and squares do not.
_ROUNDNESS: Final = 0.93
_LEAST_AREA_PX: Final = 150
#: Contrast below this share of white is no disk.
_LEAST_CONTRAST: Final = 0.15

Grey = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class DiskImage:
    """A dark disk found in an image.

    Parameters
    ----------
    centre_px
        (x, y) of its middle.
    semi_axes_px
        Half its extent along x and y; they differ where the sample pitches do.
    """

    centre_px: tuple[float, float]
    semi_axes_px: tuple[float, float]


def find_disk(image: Grey, near_px: tuple[float, float] | None = None) -> DiskImage:
    """Find the dark disk in an image.

    Parameters
    ----------
    image
        (rows, columns) grey values.
    near_px
        Where to prefer it, (x, y); None for the middle of the image.

    Returns
    -------
    DiskImage
        The round dark spot nearest to there that lies wholly in the image.

    Raises
    ------
    FocusError
        When there is none, or the image has no contrast.
    """
    rows, columns = image.shape
    near = np.array(near_px if near_px is not None else ((columns - 1) / 2, (rows - 1) / 2))
    levels = np.percentile(image, (1, 99)).astype(float)
    if levels[1] <= 0 or (levels[1] - levels[0]) < _LEAST_CONTRAST * levels[1]:
        raise FocusError(
            f"no disk to focus on: the image has no contrast (grey values {levels[0]:.0f} to "
            f"{levels[1]:.0f}); point the camera at the disk and check light and exposure"
        )
    dark = (image < levels.mean()).astype(np.uint8)
    count, labels, stats, centroids = cv2.connectedComponentsWithStats(dark, connectivity=4)
    candidates = []
    for label in range(1, count):
        left, top, width, height, area = (int(v) for v in stats[label])
        whole = left > 0 and top > 0 and left + width < columns and top + height < rows
        round_area = np.pi / 4 * width * height
        if whole and area >= _LEAST_AREA_PX and _ROUNDNESS < area / round_area < 2 - _ROUNDNESS:
            candidates.append(label)
    if not candidates:
        raise FocusError(
            "no disk to focus on: no round dark spot lies wholly in the image; point the camera at "
            "the disk, or take a larger one"
        )
    best = min(candidates, key=lambda label: float(np.hypot(*(centroids[label] - near))))
    weight = labels == best
    y, x = np.nonzero(weight)
    centre = np.array([x.mean(), y.mean()])
    # A filled ellipse has a variance of a quarter of the squared semi-axis; a pixel adds 1/12.
    semi_axes = 2 * np.sqrt(np.maximum(np.array([x.var(), y.var()]) - 1 / 12, 0.0))
    return DiskImage(
        (float(centre[0]), float(centre[1])), (float(semi_axes[0]), float(semi_axes[1]))
    )


def ring_sharpness(image: Grey, disk: DiskImage) -> float:
    """Measure the sharpness of the rim of a disk.

    Parameters
    ----------
    image
        (rows, columns) grey values.
    disk
        Where the disk is in it.

    Returns
    -------
    float
        Squared gradient over the ring, per length of rim and squared contrast: one over the width
        of the edge, in 1/px.

    Raises
    ------
    FocusError
        When the ring has no contrast.
    """
    grey = image.astype(np.float32)
    rows, columns = grey.shape
    axes = np.array(disk.semi_axes_px)
    half = max(_LEAST_HALF_WIDTH, _HALF_WIDTH_SHARE * float(axes.min()))
    x = (np.arange(columns, dtype=np.float64) - disk.centre_px[0]) / axes[0]
    y = ((np.arange(rows, dtype=np.float64) - disk.centre_px[1]) / axes[1])[:, None]
    distance = (np.hypot(x, y) - 1.0) * float(axes.mean())
    ring = np.abs(distance) <= half
    inside = (distance < -0.6 * half) & (distance > -1.4 * half)
    outside = (distance > 0.6 * half) & (distance < 1.4 * half)
    contrast = float(np.median(grey[outside]) - np.median(grey[inside]))
    if contrast <= 0:
        raise FocusError("the disk has no contrast to its surroundings; check light and exposure")
    squared = _squared_gradient(grey)
    noise = _noise_variance(grey, inside | outside)
    # Central differences of white noise have half its variance along each axis.
    signal = float((squared[ring] - noise).sum())
    return signal / (_perimeter(axes) * contrast**2)


def _squared_gradient(grey: npt.NDArray[np.float32]) -> FloatArray:
    """Squared magnitude of the gradient by central differences."""
    across = np.zeros(grey.shape)
    down = np.zeros(grey.shape)
    across[:, 1:-1] = (grey[:, 2:] - grey[:, :-2]) / 2
    down[1:-1] = (grey[2:] - grey[:-2]) / 2
    return across**2 + down**2


def _noise_variance(grey: npt.NDArray[np.float32], flat: npt.NDArray[np.bool_]) -> float:
    """Variance of pixel noise where the picture is flat, from second differences."""
    second = grey[:, 2:] - 2 * grey[:, 1:-1] + grey[:, :-2]
    chosen = second[flat[:, 1:-1]]
    if chosen.size == 0:
        return 0.0
    spread = 1.4826 * float(np.median(np.abs(chosen - np.median(chosen))))
    return spread**2 / 6


def _perimeter(semi_axes: FloatArray) -> float:
    """Perimeter of an ellipse (Ramanujan's first approximation, better than 1e-5 here)."""
    a, b = semi_axes
    return float(np.pi * (3 * (a + b) - np.sqrt((3 * a + b) * (a + 3 * b))))
