"""The ladder of blur levels: images are blurred by its rungs, and mixed in between."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.imaging.texture import Float32Image

#: Blur levels in px of diameter stand at A · sinh(k · h): half a pixel apart near sharpness, then
#: an eighth of the diameter apart. Between two levels, the images are mixed.
_STRETCH_PX: Final = 4.0
_STEP: Final = 0.125


def level_of(diameter_px: npt.ArrayLike) -> FloatArray:
    """Tell where a diameter stands on the ladder of blur levels.

    Parameters
    ----------
    diameter_px
        (...) diameter in px, negative ones on the rungs below 0.

    Returns
    -------
    FloatArray
        (...) rung, with fractions.
    """
    level: FloatArray = np.arcsinh(np.asarray(diameter_px, np.float64) / _STRETCH_PX) / _STEP
    return level


def level_diameter_px(level: int) -> float:
    """Give the diameter of a rung of the ladder.

    Parameters
    ----------
    level
        The rung.

    Returns
    -------
    float
        Diameter in px.
    """
    return _STRETCH_PX * math.sinh(level * _STEP)


def share_of_level(k: int, diameter_px: Float32Image) -> Float32Image:
    """Tell how much of blur level k a diameter is: a tent over the squared diameter.

    Parameters
    ----------
    k
        The rung, not below 0.
    diameter_px
        (...) diameters, not below 0.

    Returns
    -------
    Float32Image
        (...) from 0 to 1; over all rungs they sum to 1.
    """
    below, here, above = (np.float32(level_diameter_px(i) ** 2) for i in (k - 1, k, k + 1))
    squared = np.square(diameter_px)
    share = (above - squared) / (above - here)
    if k > 0:
        share = np.minimum(share, (squared - below) / (here - below))
    return np.asarray(np.clip(share, 0.0, 1.0), dtype=np.float32)


def mean_pitch_mm(sample_pitch_mm: FloatArray) -> float:
    """Give the unit in which blur is counted in px: the geometric mean of both pitches.

    Parameters
    ----------
    sample_pitch_mm
        (2,) spacing of samples along x and y.

    Returns
    -------
    float
        In mm.
    """
    return float(np.sqrt(np.prod(sample_pitch_mm)))
