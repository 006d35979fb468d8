"""The area between two contours of d/D in the (zoom, focus) plane, with exact borders."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import contourpy
import numpy as np
from scipy.optimize import elementwise

from lenscal.arrays import FloatArray

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

Bounds = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class SettingPolygon:
    """A connected area of settings.

    Parameters
    ----------
    outline
        (N, 2) zoom, focus around the area.
    holes
        (M, 2) zoom, focus around each hole in it.
    """

    outline: FloatArray
    holes: tuple[FloatArray, ...] = ()


def trace_area(
    lens: LensMap, zoom: FloatArray, focus: FloatArray, ratio: FloatArray, limits: Bounds
) -> tuple[SettingPolygon, ...]:
    """Trace the area between two levels of d/D inside the domain of a map.

    Parameters
    ----------
    lens
        The map.
    zoom, focus
        (Z,), (F,) the lines of a grid over the domain.
    ratio
        (F, Z) d/D at its nodes, NaN outside of the domain.
    limits
        Lowest and highest d/D.

    Returns
    -------
    tuple of SettingPolygon
        The areas; what lies on a contour lies on it exactly.
    """
    generator = contourpy.contour_generator(
        z=np.ma.masked_invalid(ratio), fill_type=contourpy.FillType.OuterOffset, corner_mask=False
    )
    top = max(limits[1], np.nextafter(float(np.nanmax(ratio)), np.inf))
    high = limits[1] if np.isfinite(limits[1]) else top
    rings, offsets = generator.filled(limits[0], high)
    polygons = []
    for points, ends in zip(rings, offsets, strict=True):
        exact = _onto_contours(lens, zoom, focus, np.asarray(points, dtype=np.float64), limits)
        outline, *holes = (exact[a:b] for a, b in pairwise(ends))
        polygons.append(SettingPolygon(outline, tuple(holes)))
    return tuple(polygons)


def _onto_contours(
    lens: LensMap, zoom: FloatArray, focus: FloatArray, index: FloatArray, limits: Bounds
) -> FloatArray:
    """Turn grid coordinates into settings; what lies on a contour is moved onto it exactly.

    The tracer interpolates linearly along the edges of the grid. Each such point lies between two
    nodes on either side of a contour, and the map is solved for it on that edge.
    """
    # The tracer's interpolation may pass the last line of the grid by its rounding.
    index = np.clip(index, 0.0, (len(zoom) - 1, len(focus) - 1))
    low, high = np.floor(index).astype(int), np.ceil(index).astype(int)
    between = (low != high).any(axis=1)
    start, stop = (np.stack([zoom[i[:, 0]], focus[i[:, 1]]], axis=-1) for i in (low, high))
    share = (index - low).max(axis=1)
    settings: FloatArray = start + share[:, None] * (stop - start)
    # Between two nodes inside, the border of a curved domain may cut across their edge.
    traced = lens.magnification(*settings.T, outside="nan")
    level = np.where(np.abs(traced - limits[0]) <= np.abs(traced - limits[1]), *limits)
    a, b = start[between], stop[between]

    def excess(along: FloatArray, *ends: FloatArray) -> FloatArray:
        zoom_a, focus_a, zoom_b, focus_b, wanted = ends
        ratio = lens.magnification(
            np.clip(zoom_a + along * (zoom_b - zoom_a), zoom_a, zoom_b),
            np.clip(focus_a + along * (focus_b - focus_a), focus_a, focus_b),
            outside="nan",
        )
        return np.asarray(ratio - wanted, dtype=np.float64)

    if between.any():
        ends = (np.zeros(len(a)), np.ones(len(a)))
        solved = elementwise.find_root(excess, ends, args=(*a.T, *b.T, level[between]))
        exact = a + solved.x[:, None] * (b - a)
        # A contour through a node, to rounding, brackets nothing; there the tracer is exact.
        settings[between] = np.where(solved.success[:, None], exact, settings[between])
    return settings
