"""A handful of settings that stand for all admissible ones."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from planning.fixed_lens import FixedLens
from planning.settings import AdmissibleSettings

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: Nodes per side of the grid from which settings are taken.
_GRID: Final = 61
#: How far, as a share, d/D may be beyond its bounds by rounding.
_ROUNDING: Final = 1e-9
#: Object distances of a fixed lens that nothing bounds from above end at so many times the nearest.
_FAR: Final = 4.0

COLUMNS: Final = (
    "zoom",
    "focus",
    "magnification",
    "object_distance_mm",
    "image_distance_mm",
    "nodal_offset_mm",
    "standoff_mm",
)


def choose_settings(settings: AdmissibleSettings, count: int) -> pd.DataFrame:
    """Spread a few settings over the admissible ones.

    First come one near the lowest and one near the highest d/D that can be had, and one in the
    middle; the others each lie as far as possible from all that are chosen.

    Parameters
    ----------
    settings
        The admissible settings; not empty.
    count
        How many; at least three.

    Returns
    -------
    pandas.DataFrame
        One row per setting. Zoom and focus of a fixed lens are NaN; so are offset and standoff
        where they are not known.
    """
    return _chosen(settings, count).copy()


@lru_cache(maxsize=8)
def _chosen(settings: AdmissibleSettings, count: int) -> pd.DataFrame:
    """Many targets ask for the same: settings are told apart by identity."""
    if isinstance(settings.lens, FixedLens):
        return _of_fixed_lens(settings, settings.lens, count)
    lens = settings.lens
    candidates = _candidates(settings, lens)
    ratio = lens.magnification(*candidates.T)
    low, high = settings.magnification_bounds
    kept = (ratio >= low * (1 - _ROUNDING)) & (ratio <= high * (1 + _ROUNDING))
    candidates, ratio = candidates[kept], ratio[kept]
    zoom, focus = candidates[_spread(candidates, ratio, count)].T
    return pd.DataFrame(
        {
            "zoom": zoom,
            "focus": focus,
            "magnification": lens.magnification(zoom, focus),
            "object_distance_mm": lens.object_distance_mm(zoom, focus),
            "image_distance_mm": lens.image_distance_mm(zoom, focus),
            "nodal_offset_mm": lens.nodal_offset_mm(zoom, focus) if lens.has_standoff else np.nan,
            "standoff_mm": lens.standoff_mm(zoom, focus) if lens.has_standoff else np.nan,
        }
    )


def _candidates(settings: AdmissibleSettings, lens: LensMap) -> FloatArray:
    """(N, 2) settings inside of the area and on its outline."""
    zoom, focus = np.meshgrid(
        np.linspace(*lens.domain.zoom, _GRID), np.linspace(*lens.domain.focus, _GRID)
    )
    inside = settings.contains(zoom, focus)
    grid = np.stack([zoom[inside], focus[inside]], axis=-1)
    return np.concatenate([grid, *(polygon.outline for polygon in settings.polygons)])


def _spread(candidates: FloatArray, ratio: FloatArray, count: int) -> list[int]:
    """Indices of settings that lie far from each other."""
    size = np.ptp(candidates, axis=0)
    place = (candidates - candidates.mean(axis=0)) / np.where(size > 0, size, 1.0)
    span = float(np.ptp(ratio)) or 1.0
    coordinates = np.column_stack([place, (ratio - ratio.min()) / span])
    # Among equal ratios the most central setting: there the map is known best.
    off_centre = 1e-2 * np.linalg.norm(place, axis=-1)
    wanted = (0.0, 1.0, 0.5)
    chosen = [int(np.argmin(np.abs(coordinates[:, 2] - w) + off_centre)) for w in wanted]
    chosen = list(dict.fromkeys(chosen))
    nearest = np.linalg.norm(coordinates[:, None] - coordinates[chosen], axis=-1).min(axis=1)
    while len(chosen) < count and nearest.max() > 0:
        chosen.append(int(np.argmax(nearest)))
        to_last = np.linalg.norm(coordinates - coordinates[chosen[-1]], axis=-1)
        nearest = np.minimum(nearest, to_last)
    return chosen


def _of_fixed_lens(settings: AdmissibleSettings, lens: FixedLens, count: int) -> pd.DataFrame:
    nearest, farthest = settings.object_distance_bounds_mm or (lens.focal_length_mm, np.inf)
    # Nothing is imaged at the focal length itself, nor can everything at infinity be tried.
    nearest = max(nearest, lens.focal_length_mm * (1 + 1e-6))
    distance = np.linspace(nearest, farthest if np.isfinite(farthest) else _FAR * nearest, count)
    image_distance = 1.0 / (1.0 / lens.focal_length_mm - 1.0 / distance)
    unknown = np.full(count, np.nan)
    values = (
        unknown,
        unknown,
        image_distance / distance,
        distance,
        image_distance,
        unknown,
        unknown,
    )
    return pd.DataFrame(dict(zip(COLUMNS, values, strict=True)))
