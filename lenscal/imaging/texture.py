"""The artwork of a flat target as reflectance over its plane, as densely as a view asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import positive
from lenscal.artwork import Artwork
from lenscal.errors import InputError
from lenscal.target import Target

Float32Image = npt.NDArray[np.float32]

#: Artwork is drawn at multiples of this many texels per mm: lengths of whole 25 µm are exact.
_DRAWING_STEP: Final = 40
#: A drawing is at least this much denser than the texture averaged from it.
_DRAWING_MARGIN: Final = 1.25
#: Texture densities stand on a ladder with this many rungs per octave, so that views share them.
_RUNGS_PER_OCTAVE: Final = 4
#: Texels of surroundings about the artwork, wider than the reach of the sharpening.
_BORDER: Final = 2
#: Largest side of an image that OpenCV resamples.
_LARGEST_SIDE: Final = 32000


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """Reflectance of the target plane on a grid, to be interpolated linearly.

    Parameters
    ----------
    reflectance
        (rows, columns), white 1. Every texel is the mean over its area, sharpened by as much as
        linear interpolation will blur.
    texels_per_mm
        Density along x and along y.
    surroundings
        Reflectance beyond the artwork.
    """

    reflectance: Float32Image
    texels_per_mm: tuple[float, float]
    surroundings: float

    @property
    def origin_texel(self) -> tuple[float, float]:
        """Texel coordinates (x, y) of the origin of the target frame."""
        rows, columns = self.reflectance.shape
        return (columns - 1) / 2, (rows - 1) / 2


@dataclass(frozen=True, slots=True)
class TargetSurface:
    """A target as light meets it: ink, paper, and what lies around the plate.

    Parameters
    ----------
    target
        The target; its artwork includes the white quiet zone.
    ink
        Reflectance of the black parts, where white is 1.
    surroundings
        Reflectance of the grey bench around the artwork.

    Raises
    ------
    InputError
        When a reflectance is not between 0 and 1.
    """

    target: Target
    ink: float = 0.04
    surroundings: float = 0.3

    def __post_init__(self) -> None:
        for name in ("ink", "surroundings"):
            value = getattr(self, name)
            if not 0 <= value <= 1:
                raise InputError(
                    f"{name} must be a reflectance between 0 and 1 (white), but is {value:g}"
                )

    def texture(self, texel_mm: float) -> Texture:
        """Draw the surface with texels of about a wanted size; drawings are kept for the next view.

        Parameters
        ----------
        texel_mm
            Size of a texel; it is met within a tenth.

        Returns
        -------
        Texture
            The reflectance, ready to be sampled.

        Raises
        ------
        InputError
            When the target is too large to be drawn that finely.
        """
        rung = round(-math.log2(positive("texel_mm", texel_mm, "mm")) * _RUNGS_PER_OCTAVE)
        return _texture(self, rung)


@lru_cache(maxsize=2)
def _texture(surface: TargetSurface, rung: int) -> Texture:
    density = 2 ** (rung / _RUNGS_PER_OCTAVE)
    drawing_density = _DRAWING_STEP * math.ceil(_DRAWING_MARGIN * density / _DRAWING_STEP)
    width_mm, height_mm = surface.target.size_mm
    if max(width_mm, height_mm) * drawing_density > _LARGEST_SIDE:
        raise InputError(
            f"a target of {width_mm:g} × {height_mm:g} mm cannot be drawn with {density:.0f} "
            "texels per mm, which this view asks for; take a smaller target"
        )
    columns, rows = (max(1, round(side * density)) for side in (width_mm, height_mm))
    drawing = _drawing(surface.target, drawing_density)
    shares = cv2.resize(drawing, (columns, rows), interpolation=cv2.INTER_AREA)
    grey_levels = np.linspace(surface.ink, 1.0, 256, dtype=np.float32)
    reflectance = cv2.copyMakeBorder(
        grey_levels[shares],
        _BORDER,
        _BORDER,
        _BORDER,
        _BORDER,
        cv2.BORDER_CONSTANT,
        value=surface.surroundings,
    )
    return Texture(
        _sharpened_for_linear_interpolation(np.asarray(reflectance, np.float32)),
        (columns / width_mm, rows / height_mm),
        surface.surroundings,
    )


@lru_cache(maxsize=2)
def _drawing(target: Target, texels_per_mm: int) -> Artwork:
    return target.artwork(texels_per_mm)


def _sharpened_for_linear_interpolation(reflectance: Float32Image) -> Float32Image:
    """Take away the variance that linear interpolation adds: a sixth of a texel² on average."""
    taps = np.array([-1 / 12, 7 / 6, -1 / 12])
    sharpened = cv2.sepFilter2D(
        reflectance, cv2.CV_32F, taps, taps, borderType=cv2.BORDER_REPLICATE
    )
    return np.asarray(sharpened, dtype=np.float32)
