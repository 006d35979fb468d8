"""Where in the (zoom, focus) plane samples support a map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray, IntArray, frozen_array
from lenscal.maps.support import outline_of

#: Share of the sampled range by which a setting may lie outside, to allow for rounding.
_ROUNDING: Final = 1e-9
#: Cuts up to which comparing with each is quicker than a search.
_MANY_CUTS: Final = 40


@dataclass(frozen=True, eq=False)
class Domain:
    """The settings that samples support: the inside of one polygon, without holes.

    Parameters
    ----------
    outline
        (V, 2) its corners (zoom, focus) in order; two for samples on a line, one for a single one.
    """

    outline: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "outline", frozen_array("outline", self.outline, ("V", 2)))

    @classmethod
    def around(cls, zoom: FloatArray, focus: FloatArray) -> Domain:
        """Draw the outline of what samples support.

        Parameters
        ----------
        zoom, focus
            (N,) sampled settings.

        Returns
        -------
        Domain
            The domain, which holds them all. A grid is a full rectangle, also with settings missing
            here and there; samples in columns of equal zoom support what lies between the ends of
            neighbouring columns; scattered ones their hull without its wide bays.
        """
        return cls(outline_of(zoom, focus))

    @property
    def zoom(self) -> tuple[float, float]:
        """Lowest and highest zoom anywhere in the domain."""
        return float(self.outline[:, 0].min()), float(self.outline[:, 0].max())

    @property
    def focus(self) -> tuple[float, float]:
        """Lowest and highest focus anywhere in the domain."""
        return float(self.outline[:, 1].min()), float(self.outline[:, 1].max())

    @property
    def area(self) -> float:
        """Area in controller units of zoom times those of focus; 0 for samples on a line."""
        zoom, focus = (self.outline - self.outline[0]).T
        return float(abs(zoom @ np.roll(focus, -1) - focus @ np.roll(zoom, -1)) / 2)

    @property
    def is_rectangle(self) -> bool:
        """Whether all settings between the ends of zoom and focus belong to it."""
        (z0, z1), (f0, f1) = self.zoom, self.focus
        rectangle = (z1 - z0) * (f1 - f0)
        flat = rectangle == 0
        return flat or self.area > (1 - _ROUNDING) * rectangle

    def contains(self, zoom: npt.ArrayLike, focus: npt.ArrayLike) -> BoolArray:
        """Tell which settings are supported.

        Parameters
        ----------
        zoom, focus
            Settings; they broadcast.

        Returns
        -------
        BoolArray
            True inside and on the border, False outside and for NaN.
        """
        zooms, focuses = np.broadcast_arrays(
            np.asarray(zoom, dtype=np.float64), np.asarray(focus, dtype=np.float64)
        )
        if len(self.outline) < 3:
            return self._on_line(zooms, focuses)
        slabs = self._slabs
        inside = slabs.contain(zooms, focuses, slabs.index(zooms))
        if slabs.has_turns:
            # What lies on a cut may be supported from one side of it only.
            for side in (-slabs.zoom_tolerance, slabs.zoom_tolerance):
                inside |= slabs.contain(zooms, focuses, slabs.index(zooms + side))
        return inside

    def grid(self, count: int = 101) -> tuple[FloatArray, FloatArray]:
        """Lay a regular grid over the domain's bounding rectangle.

        Parameters
        ----------
        count
            Points along an axis that has an extent; an axis without one gets a single point.

        Returns
        -------
        zoom, focus : FloatArray
            (n_focus, n_zoom) each: focus along rows, zoom along columns; some may lie outside.
        """
        axes = [
            np.linspace(low, high, count if high > low else 1)
            for low, high in (self.zoom, self.focus)
        ]
        zoom, focus = np.meshgrid(*axes)
        return zoom, focus

    def __str__(self) -> str:
        (z0, z1), (f0, f1) = self.zoom, self.focus
        part = "" if self.is_rectangle else "a part of "
        return f"{part}zoom {z0:g} to {z1:g} and focus {f0:g} to {f1:g}"

    def _on_line(self, zooms: FloatArray, focuses: FloatArray) -> BoolArray:
        """Whether settings lie on the line between the two ends, or are the single one."""
        start = self.outline[0]
        span = np.ptp(self.outline, axis=0)
        scale = np.where(span > 0, span, np.maximum(1.0, np.abs(start)))
        along = (self.outline[-1] - start) / scale
        points = (np.stack([zooms, focuses], axis=-1) - start) / scale
        share = np.clip(points @ along / max(float(along @ along), 1.0), 0.0, 1.0)
        away = np.abs(points - share[..., None] * along)
        return np.asarray((away <= _ROUNDING).all(axis=-1))

    @cached_property
    def _slabs(self) -> _Slabs:
        return _Slabs.of(self.outline)


@dataclass(frozen=True, eq=False)
class _Slabs:
    """A polygon cut at the zoom of each corner: between two cuts its inside is a few intervals.

    Interval k of slab m runs from ``low[k, m]`` to ``high[k, m]`` in focus, with the slopes given;
    these are where its sides, made longer, meet the first cut of all. Slabs of fewer intervals are
    filled up with empty ones.
    """

    cuts: FloatArray  # (M + 1,)
    low: FloatArray  # (K, M), lowered by the tolerance
    low_slope: FloatArray  # (K, M)
    high: FloatArray  # (K, M), raised by the tolerance
    high_slope: FloatArray  # (K, M)
    zoom_tolerance: float
    has_turns: (
        bool  # whether the outline turns back, or runs along a cut, between the outermost ones
    )

    @classmethod
    def of(cls, outline: FloatArray) -> _Slabs:
        span = np.ptp(outline, axis=0)
        cuts = np.unique(outline[:, 0])
        # Cuts within rounding of each other are one, or slabs without width would follow.
        cuts = cuts[np.concatenate([[True], np.diff(cuts) > _ROUNDING * span[0]])]
        cut = np.abs(cuts - outline[:, :1]).argmin(axis=1)
        ahead = np.sign(np.roll(cut, -1) - cut)
        turns = ahead != np.roll(ahead, 1)
        start, stop = outline, np.roll(outline, -1, axis=0)
        start, stop = np.where(ahead[:, None] >= 0, (start, stop), (stop, start))
        first, last = np.sort([cut, np.roll(cut, -1)], axis=0)
        slabs: list[list[tuple[float, float, float]]] = [[] for _ in cuts[1:]]
        for a, b, i, j in zip(start, stop, first, last, strict=True):
            for m in range(i, j):
                slope = (b[1] - a[1]) / (b[0] - a[0])
                middle = (cuts[m] + cuts[m + 1]) / 2
                at_cut = a[1] + slope * (cuts[0] - a[0])
                slabs[m].append((a[1] + slope * (middle - a[0]), at_cut, slope))
        count = max(map(len, slabs))
        sides = np.full((count, 2, len(slabs)), np.nan)
        for m, slab in enumerate(slabs):
            sides[: len(slab), :, m] = [side[1:] for side in sorted(slab)]
        tolerance = _ROUNDING * (span[1] + np.abs(sides[:, 1]) * span[0])
        return cls(
            cuts=cuts,
            low=(sides[:, 0] - tolerance)[::2],
            low_slope=sides[::2, 1],
            high=(sides[:, 0] + tolerance)[1::2],
            high_slope=sides[1::2, 1],
            zoom_tolerance=float(_ROUNDING * span[0]),
            has_turns=bool((turns & (cut > 0) & (cut < len(cuts) - 1)).any()),
        )

    def index(self, zooms: FloatArray) -> IntArray:
        """(...) slab of each zoom; the outermost ones also beyond their ends."""
        inner = self.cuts[1:-1]
        if len(inner) > _MANY_CUTS:
            return np.asarray(np.searchsorted(inner, zooms, side="right"))
        found = np.zeros(zooms.shape, np.uint16)
        for cut in inner:
            found += zooms >= cut
        return found.astype(np.int64)

    def contain(self, zooms: FloatArray, focuses: FloatArray, slab: IntArray) -> BoolArray:
        """(...) whether settings are inside, each seen from the slab given."""
        beyond = zooms - self.cuts[0]
        inside = np.zeros(zooms.shape, dtype=bool)
        for low, low_slope, high, high_slope in zip(
            self.low, self.low_slope, self.high, self.high_slope, strict=True
        ):
            inside |= (focuses >= low[slab] + low_slope[slab] * beyond) & (
                focuses <= high[slab] + high_slope[slab] * beyond
            )
        inside &= (zooms >= self.cuts[0] - self.zoom_tolerance) & (
            zooms <= self.cuts[-1] + self.zoom_tolerance
        )
        return inside
