"""Finding the dark disk that a session focuses on, among other things on the plate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.errors import FocusError

#: A disk fills this much of its bounding ellipse; letters and squares do not.
_ROUNDNESS: Final = 0.93
#: Sample pitches differ by less than this between x and y.
_LONGEST_ELLIPSE: Final = 1.6
_LEAST_AREA_PX: Final = 150
#: Contrast below this share of white is no disk.
_LEAST_CONTRAST: Final = 0.15
#: A disk as large as expected, give or take this factor.
_SIZE_TOLERANCE: Final = 1.6

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

    @property
    def radius_px(self) -> float:
        """Radius of the circle of the same area."""
        return float(np.sqrt(self.semi_axes_px[0] * self.semi_axes_px[1]))

    @property
    def perimeter_px(self) -> float:
        """Length of the rim (Ramanujan's first approximation, better than 1e-5 here)."""
        a, b = self.semi_axes_px
        return float(np.pi * (3 * (a + b) - np.sqrt((3 * a + b) * (a + 3 * b))))

    def shifted(self, x: float, y: float) -> DiskImage:
        """Tell where the disk is in an image whose corner lies elsewhere.

        Parameters
        ----------
        x, y
            Way of the disk in px.

        Returns
        -------
        DiskImage
            The same disk there.
        """
        return DiskImage((self.centre_px[0] + x, self.centre_px[1] + y), self.semi_axes_px)

    def rim_distance_px(self, shape: tuple[int, int]) -> FloatArray:
        """Measure how far every pixel lies outside the rim.

        Parameters
        ----------
        shape
            Rows and columns of the image.

        Returns
        -------
        FloatArray
            (rows, columns) distance in px of the mean radius, negative inside.
        """
        (x0, y0), (a, b) = self.centre_px, self.semi_axes_px
        x = (np.arange(shape[1], dtype=np.float64) - x0) / a
        y = ((np.arange(shape[0], dtype=np.float64) - y0) / b)[:, None]
        distance: FloatArray = (np.hypot(x, y) - 1.0) * ((a + b) / 2)
        return distance


def find_disk(
    image: Grey,
    near_px: tuple[float, float] | None = None,
    radius_px: float | None = None,
    within_px: float = np.inf,
) -> DiskImage:
    """Find the dark disk in an image.

    Parameters
    ----------
    image
        (rows, columns) grey values of any bit depth.
    near_px
        Where to prefer it, (x, y); None for the middle of the image.
    radius_px
        Radius to be expected; spots that are more than 1.6 times as large or small are passed over.
        None for any.
    within_px
        How far from there its middle may lie, besides its own radius.

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
    dark = (image < _middle_grey(image)).astype(np.uint8)
    _, labels, stats, centroids = cv2.connectedComponentsWithStats(dark, connectivity=4)
    left, top, width, height, area = stats.T.astype(np.float64)
    round_area = np.pi / 4 * width * height
    fits = (left > 0) & (top > 0) & (left + width < columns) & (top + height < rows)
    fits &= (area >= _LEAST_AREA_PX) & (np.abs(area / round_area - 1) < 1 - _ROUNDNESS)
    fits &= np.maximum(width, height) < _LONGEST_ELLIPSE * np.minimum(width, height)
    if radius_px is not None:
        ratio = np.sqrt(area / np.pi) / radius_px
        fits &= (ratio < _SIZE_TOLERANCE) & (ratio > 1 / _SIZE_TOLERANCE)
    apart = np.hypot(*(centroids - near).T)
    fits &= apart < within_px + np.sqrt(area / np.pi)
    fits[0] = False  # label 0 is what is not dark
    if not fits.any():
        size = "" if radius_px is None else f" of about {radius_px:.0f} px radius"
        raise FocusError(
            f"no disk to focus on: no round dark spot{size} lies wholly in the image; point the "
            "camera at the disk, or take a larger one"
        )
    y, x = np.nonzero(labels == int(np.where(fits, apart, np.inf).argmin()))
    # A filled ellipse has a variance of a quarter of the squared semi-axis; a pixel adds 1/12.
    a, b = 2 * np.sqrt(np.maximum(np.array([x.var(), y.var()]) - 1 / 12, 0.0))
    return DiskImage((float(x.mean()), float(y.mean())), (float(a), float(b)))


def _middle_grey(image: Grey) -> float:
    """Give the grey value half way between dark and bright."""
    dark, bright = np.percentile(image, (1, 99)).astype(float)
    if bright <= 0 or bright - dark < _LEAST_CONTRAST * bright:
        raise FocusError(
            f"no disk to focus on: the image has no contrast (grey values {dark:.0f} to "
            f"{bright:.0f}); point the camera at the disk and check light and exposure"
        )
    return float((dark + bright) / 2)
