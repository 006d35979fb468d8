"""The image sensor and the frame buffer that its samples land in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray, frozen_array, positive
from lenscal.errors import InputError

Axis = Literal["any", "x", "y"]


@dataclass(frozen=True, slots=True)
class Sensor:
    """A frame buffer of samples, and what one sample is on the chip.

    Parameters
    ----------
    width_px, height_px
        Size of the frame buffer in samples.
    pitch_x_mm, pitch_y_mm
        Spacing of the sensor elements in mm.
    scale_factor
        Spacing of the frame-buffer samples over that of the elements, along x: a frame grabber
        samples the analogue line at its own rate. This is the paper's direction (10), (12); Tsai's
        own s_x is its inverse up to the ratio of the counts. Digital cameras have 1.

    Raises
    ------
    InputError
        When a size is not a positive whole number, or a pitch or the factor is not positive.
    """

    width_px: int
    height_px: int
    pitch_x_mm: float
    pitch_y_mm: float
    scale_factor: float = 1.0

    def __post_init__(self) -> None:
        for name in ("width_px", "height_px"):
            value = getattr(self, name)
            if int(value) != value or value < 1:
                raise InputError(f"{name} must be a positive whole number, but is {value}")
            object.__setattr__(self, name, int(value))
        for name in ("pitch_x_mm", "pitch_y_mm", "scale_factor"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))

    @property
    def sample_pitch_x_mm(self) -> float:
        """Spacing of frame-buffer samples along x, on the chip, in mm."""
        return self.pitch_x_mm * self.scale_factor

    @property
    def sample_pitch_y_mm(self) -> float:
        """Spacing of frame-buffer samples along y, on the chip, in mm."""
        return self.pitch_y_mm

    @property
    def sample_pitch_mm(self) -> FloatArray:
        """(2,) spacing of samples along x and y in mm."""
        return np.array([self.sample_pitch_x_mm, self.sample_pitch_y_mm])

    @property
    def width_mm(self) -> float:
        """Width of the frame buffer on the chip in mm."""
        return self.width_px * self.sample_pitch_x_mm

    @property
    def height_mm(self) -> float:
        """Height of the frame buffer on the chip in mm."""
        return self.height_px * self.sample_pitch_y_mm

    @property
    def centre_px(self) -> FloatArray:
        """(2,) centre of the frame buffer; pixel (0, 0) is the centre of the top-left pixel."""
        return np.array([(self.width_px - 1) / 2, (self.height_px - 1) / 2])

    def extent_mm(self, axis: Axis = "any") -> float:
        """Give the usable size of the chip, I of the paper's (7c).

        Parameters
        ----------
        axis
            "x" or "y" for that side; "any" when the roll of the camera is unknown: the smaller one.

        Returns
        -------
        float
            The size in mm.
        """
        sizes = {"x": self.width_mm, "y": self.height_mm}
        return min(sizes.values()) if axis == "any" else sizes[_known(axis)]

    def sample_spacing_mm(self, axis: Axis = "any") -> float:
        """Give the spacing of samples that a resolution has to reckon with.

        Parameters
        ----------
        axis
            "x" or "y" for that direction; "any" when the roll is unknown: the coarser one.

        Returns
        -------
        float
            The spacing in mm.
        """
        pitches = {"x": self.sample_pitch_x_mm, "y": self.sample_pitch_y_mm}
        return max(pitches.values()) if axis == "any" else pitches[_known(axis)]

    def contains(self, pixels: npt.ArrayLike, margin_px: float = 0.0) -> BoolArray:
        """Tell which image points fall on the sensor.

        Parameters
        ----------
        pixels
            (..., 2) points (x, y) in px.
        margin_px
            How far inside the outer edge of the border pixels they must lie.

        Returns
        -------
        BoolArray
            (...), False for NaN.
        """
        points = frozen_array("pixels", pixels, ("...", 2), finite=False)
        low, high = margin_px - 0.5, np.array([self.width_px, self.height_px]) - 0.5 - margin_px
        return np.asarray(((points >= low) & (points <= high)).all(axis=-1))


@dataclass(frozen=True, slots=True)
class Window:
    """A part of the image, in whole pixels.

    Parameters
    ----------
    left, top
        Its first column and row.
    width, height
        Its size in px.
    """

    left: int
    top: int
    width: int
    height: int


def _known(axis: str) -> str:
    if axis not in ("x", "y"):
        raise InputError(f"axis must be 'any', 'x' or 'y', but is {axis!r}")
    return axis
