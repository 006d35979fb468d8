"""A flat target as light meets it, drawn as finely as a part of the image asks for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.artwork import Artwork, Mosaic, Pattern, TexelGrid, draw
from lenscal.errors import InputError
from lenscal.target import Target

Float32Image = npt.NDArray[np.float32]

#: Largest side of a drawing; a plane seen so obliquely that it would take more is drawn coarser.
_LARGEST_SIDE: Final = 4096
#: Texels drawn beyond what is wanted, for interpolation to reach.
_RIM: Final = 3


class Box(NamedTuple):
    """A rectangle in the plane of a target.

    Parameters
    ----------
    low_mm, high_mm
        (2,) its corners (x, y).
    """

    low_mm: FloatArray
    high_mm: FloatArray


class Texture(NamedTuple):
    """A part of a surface on a grid of texels.

    Parameters
    ----------
    origin_mm
        (x, y) of the middle of the first texel in the target frame.
    texels_per_mm
        Density.
    paper
        (rows, columns) share that is white paper, 255 for all; none of it lies beyond the sheet.
    sheet
        (rows, columns) share that lies on the sheet, 255 for all; None where all does.
    """

    origin_mm: tuple[float, float]
    texels_per_mm: float
    paper: Artwork
    sheet: Artwork | None


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

    def meets(self, part: Box) -> bool:
        """Tell whether a part of the plane shows any of the sheet.

        Parameters
        ----------
        part
            The part.

        Returns
        -------
        bool
            False where it shows surroundings only.
        """
        half = np.array(self.target.size_mm) / 2
        return bool((part.low_mm < half).all() and (part.high_mm > -half).all())

    def texture(self, part: Box, sample_mm: float) -> Texture:
        """Draw a part of the plane, ready to be sampled by linear interpolation.

        Every texel is the mean over a square of the space between samples, and twice as dense: the
        samples of a pixel then cover it without gap or overlap, and interpolation adds little.

        Parameters
        ----------
        part
            What is wanted; of what lies beyond the sheet only a rim is drawn.
        sample_mm
            Space between samples. A drawing that would have more than 4096 texels a side is made
            coarser.

        Returns
        -------
        Texture
            The drawing.
        """
        half = np.array(self.target.size_mm) / 2
        seen = np.minimum(part.high_mm, half) - np.maximum(part.low_mm, -half)
        texel_mm = max(sample_mm / 2, float(seen.max()) / (_LARGEST_SIDE - 2 * _RIM - 2))
        # Texels lie on whole multiples of their size: other parts are drawn on the same ones.
        first = np.floor(np.maximum(part.low_mm, -half) / texel_mm).astype(int) - _RIM
        last = np.ceil(np.minimum(part.high_mm, half) / texel_mm).astype(int) + _RIM
        low, high = first * texel_mm, last * texel_mm
        columns, rows = (int(n) for n in last - first)
        grid = TexelGrid(float(low[0]), float(low[1]), 1 / texel_mm, columns, rows)
        paper, sheet = draw(_patterns(self.target), grid), None
        if (low < -half).any() or (high > half).any():
            bounds = [np.array([-side, side]) for side in half]
            beyond = draw([Mosaic(np.zeros((1, 1), np.uint8), *bounds)], grid)
            sheet = _mean_of_four(255 - beyond)
            # White reaches to the rim of the sheet, and no farther.
            paper = np.minimum(paper, 255 - beyond)
        return Texture(
            (low[0] + texel_mm, low[1] + texel_mm), 1 / texel_mm, _mean_of_four(paper), sheet
        )


def _mean_of_four(drawing: Artwork) -> Artwork:
    """Average every texel with its neighbours to the right and below."""
    means = cv2.blur(drawing, (2, 2), anchor=(0, 0), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(means, dtype=np.uint8)


@lru_cache(maxsize=8)
def _patterns(target: Target) -> tuple[Pattern, ...]:
    return target.patterns()
