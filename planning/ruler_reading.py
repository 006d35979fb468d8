"""Reading a ruler and the edges of a target in a picture, to a fraction of a pixel.

Nothing is projected: all that is known of the picture is that a ruler with so many ticks runs
across it about from left to right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import DetectionError

#: Ticks over which the local scale is taken: a straight line through so many.
_LOCAL: Final = 5
#: Places of the profile per pixel in which the edges of ticks are sought.
_FINE: Final = 32
#: A dark bar that is so many times wider than most is no tick.
_WIDEST: Final = 1.6
#: One that is paler than most by this share of their contrast is none either.
_PALEST: Final = 0.35
#: Rows that are smoothed together to find the ruler, in px.
_ROWS: Final = 3.0
#: Rows beside the ruler in which the edges of the target are sought, as multiples of its height.
_NEAR, _FAR = 2.0, 4.0
#: How far on both sides of the last tick the edge of the target is sought, in px.
_REACH: Final = 8


@dataclass(frozen=True, slots=True, eq=False)
class RulerReading:
    """What a picture shows of a ruler.

    Parameters
    ----------
    ticks_px
        (N,) columns of the middles of the ticks, from left to right.
    row_px
        Row of the line that is measured.
    height_px
        Rows that the plain ticks take.
    """

    ticks_px: FloatArray
    row_px: float
    height_px: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "ticks_px", frozen_array("ticks_px", self.ticks_px, ("N",)))

    @property
    def length_px(self) -> float:
        """From the first to the last tick."""
        return float(self.ticks_px[-1] - self.ticks_px[0])

    @property
    def step_px(self) -> FloatArray:
        """(3,) px per step at the left end, in the middle and at the right end."""
        middle = (len(self.ticks_px) - _LOCAL) // 2
        firsts = (0, middle, len(self.ticks_px) - _LOCAL)
        steps = np.arange(_LOCAL)
        return np.array([np.polyfit(steps, self.ticks_px[f : f + _LOCAL], 1)[0] for f in firsts])


def read_ruler(image: npt.NDArray[np.generic], ticks: int) -> RulerReading:
    """Find the ticks of a ruler.

    Parameters
    ----------
    image
        (rows, columns) grey values.
    ticks
        How many ticks the ruler has; five at least.

    Returns
    -------
    RulerReading
        Where they are.

    Raises
    ------
    DetectionError
        When not exactly so many are seen.
    """
    grey = np.asarray(image, dtype=np.float64)
    top, bottom = _plain_rows(grey)
    inner = (bottom - top) // 4
    profile = grey[top + inner : bottom - inner].mean(axis=0)
    found = _dark_bars(profile, ticks)
    if len(found) != ticks:
        raise DetectionError(
            f"the picture shows {len(found)} ticks of a ruler that has {ticks}; it must lie in the "
            "picture whole, sharp, and about along its rows"
        )
    return RulerReading(found, (top + bottom - 1) / 2, float(bottom - top))


def edge_to_edge_px(image: npt.NDArray[np.generic], ruler: RulerReading) -> float:
    """Measure the target that a ruler lies on, from its left to its right edge.

    The edges are followed above and below the ruler, where the target is bright before something
    dark, and joined by a straight line across it.

    Parameters
    ----------
    image
        (rows, columns) grey values.
    ruler
        Where the ruler is.

    Returns
    -------
    float
        Length along the line that the ruler measures, in px.

    Raises
    ------
    DetectionError
        When the edges are not in the picture.
    """
    grey = np.asarray(image, dtype=np.float64)
    away = np.arange(_NEAR * ruler.height_px, _FAR * ruler.height_px)
    rows = np.rint(np.concatenate([ruler.row_px - away, ruler.row_px + away])).astype(int)
    rows = rows[(rows >= 0) & (rows < len(grey))]
    sides = []
    for end, outward in ((ruler.ticks_px[0], -1), (ruler.ticks_px[-1], 1)):
        edges = np.array([_falling_edge(grey[row], end, outward) for row in rows])
        seen = np.isfinite(edges)
        if seen.sum() < 4:
            raise DetectionError(
                "an edge of the target is not to be seen beside the ruler; the target must lie in "
                "the picture whole and before something darker"
            )
        sides.append(np.polyval(np.polyfit(rows[seen], edges[seen], 1), ruler.row_px))
    return float(sides[1] - sides[0])


def _plain_rows(grey: FloatArray) -> tuple[int, int]:
    """First row of the ruler's plain ticks and the row after the last: the most ups and downs."""
    ups_and_downs = gaussian_filter1d(np.abs(np.diff(grey, axis=1)).sum(axis=1), _ROWS)
    many = ups_and_downs > ups_and_downs.max() / 2
    best = int(np.argmax(ups_and_downs))
    few = np.flatnonzero(~many)
    top = few[few < best].max(initial=-1) + 1
    bottom = few[few > best].min(initial=len(grey))
    return int(top), int(bottom)


def _dark_bars(profile: FloatArray, ticks: int) -> FloatArray:
    """Middles of the dark bars: half way between the edges, each where it is half way down."""
    columns = np.arange(len(profile))
    fine = np.linspace(0, len(profile) - 1, _FINE * (len(profile) - 1) + 1)
    curve = CubicSpline(columns, profile)(fine)
    # A window of less than two steps holds one bar and its white; steps are at most this wide.
    window = round(1.2 * _FINE * len(profile) / ticks) | 1
    high, low = maximum_filter1d(curve, window), minimum_filter1d(curve, window)
    # What varies less than the strongest third of it is no tick: the target, and what lies behind.
    contrast = np.percentile(high - low, 75)
    dark = (curve < (high + low) / 2) & (high - low > contrast / 3)
    starts = np.flatnonzero(dark[1:] & ~dark[:-1]) + 1
    ends = np.flatnonzero(~dark[1:] & dark[:-1])
    if len(ends) and len(starts) and ends[0] < starts[0]:
        ends = ends[1:]
    bars = list(zip(starts, ends, strict=False))
    if not bars:
        return np.zeros(0)
    width = np.array([fine[end] - fine[start] for start, end in bars])
    floor = np.array([curve[start:end].min() for start, end in bars])
    white = float(np.median([high[start] for start, _ in bars]))
    # What is dark beside the ruler is wider than a tick, or not as dark.
    black = float(np.median(floor))
    tick = (width < _WIDEST * np.median(width)) & (floor < black + _PALEST * (white - black))
    chosen = [bar for bar, is_tick in zip(bars, tick, strict=True) if is_tick]
    places = [_middle(curve, int(start), int(end), white) for start, end in chosen]
    return np.array(places) / _FINE


def _middle(curve: FloatArray, start: int, end: int, white: float) -> float:
    """Half way between the two places where a bar is half way between its black and white.

    One level for both sides: what lies beyond the last tick is another white than that between.
    """
    darkest = start + int(np.argmin(curve[start:end]))
    level = (curve[darkest] + white) / 2
    right = darkest + int(np.argmax(curve[darkest:] > level))
    left = darkest - int(np.argmax(curve[darkest::-1] > level))
    # The curve is all but straight between its fine places.
    right_at = right - (curve[right] - level) / (curve[right] - curve[right - 1])
    left_at = left + (curve[left] - level) / (curve[left] - curve[left + 1])
    return float(left_at + right_at) / 2


def _falling_edge(row: FloatArray, start: float, outward: int) -> float:
    """Where a row falls to half of what it was, going outward from a place; NaN if it does not."""
    columns = np.arange(len(row))
    inside = row[_between(start - outward * _REACH, start - outward * 2)]
    outside = row[_between(start + outward * 2, start + outward * _REACH)]
    if not (len(inside) and len(outside)) or outside.min() > 0.7 * np.median(inside):
        return float("nan")
    level = (np.median(inside) + outside.min()) / 2
    way = columns[_between(start - outward * _REACH, start + outward * _REACH)][::outward]
    values = row[way]
    first = int(np.argmax(values < level))
    if not first:
        return float("nan")
    share = (values[first - 1] - level) / (values[first - 1] - values[first])
    return float(way[first - 1] + outward * share)


def _between(a: float, b: float) -> slice:
    low, high = sorted((round(a), round(b)))
    return slice(max(low, 0), max(high + 1, 0))
