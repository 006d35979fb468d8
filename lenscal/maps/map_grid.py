"""A lens map on a grid over the rectangle that bounds its domain, and beyond the domain.

Contours and the inverse are searched on it. The surfaces of a map go on smoothly beyond the border
of its domain, which is what finds that border exactly; none of those values is given out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.linalg import block_diag

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from lenscal.errors import InputError
from lenscal.maps.evaluation import slopes_at, value_at
from lenscal.maps.quantities import all_from_core, single_value
from lenscal.maps.tame_surfaces import TameSurfaces

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: Nodes per axis; those of `LensMap.range_of` are among them.
_NODES: Final = 201


def gradient_at(
    lens_map: LensMap, quantity: str, zoom: FloatArray, focus: FloatArray
) -> FloatArray:
    """Differentiate a quantity whether the map supports it there or not.

    Parameters
    ----------
    lens_map
        The map.
    quantity
        One of its quantities.
    zoom, focus
        (...) settings of equal shape.

    Returns
    -------
    FloatArray
        (..., 2) derivatives along zoom and focus, per controller unit.
    """
    return np.stack(slopes_at(lens_map, quantity, zoom, focus, ("zoom", "focus")), axis=-1)


def all_quantities(lens_map: LensMap, zoom: FloatArray, focus: FloatArray) -> FloatArray:
    """Evaluate every quantity whether the map supports it there or not.

    Parameters
    ----------
    lens_map
        The map.
    zoom, focus
        (...) settings of equal shape.

    Returns
    -------
    FloatArray
        (..., K), in the order of the map's quantities.
    """
    found = _all_surfaces(lens_map).value(zoom, focus)
    core = lens_map.core.coefficients.shape[2]
    known = all_from_core(found[..., :core])
    for place, name in enumerate(lens_map.single_surfaces, start=core):
        known[name] = single_value(name, found[..., place])
    return np.stack([known[name] for name in lens_map.quantities], axis=-1)


@lru_cache(maxsize=4)
def _all_surfaces(lens_map: LensMap) -> TameSurfaces:
    """Core and single surfaces in one, without covariance: all are splines on the same knots."""
    core, singles = lens_map.core, list(lens_map.single_surfaces.values())
    count = len(singles)
    return replace(
        core,
        coefficients=np.concatenate([s.coefficients for s in (core, *singles)], axis=2),
        covariance=np.zeros((0, 0)),
        log_smoothing=np.zeros((len(core.powers) + count, 2)),
        roughening=np.zeros((len(core.powers) + count, 2)),
        powers=np.append(core.powers, np.zeros(count)),
        trends=np.append(core.trends, np.zeros((3, count)), axis=1),
        mixing=block_diag(core.mixing, np.eye(count)),
    )


@dataclass(frozen=True, eq=False)
class MapGrid:
    """A map at the nodes of a regular grid over the rectangle that bounds its domain.

    Parameters
    ----------
    lens_map
        The map.
    zoom, focus
        (Z,), (F,) the lines of the grid.
    inside
        (F, Z) whether the domain holds the node.
    """

    lens_map: LensMap
    zoom: FloatArray
    focus: FloatArray
    inside: BoolArray

    def values(self, quantity: str) -> FloatArray:
        """Give a quantity at all nodes, those outside of the domain included.

        Parameters
        ----------
        quantity
            One of the map's quantities.

        Returns
        -------
        FloatArray
            (F, Z), read-only.
        """
        return _grid_values(self, quantity)

    def range_of(self, quantity: str) -> tuple[float, float]:
        """Give the lowest and the highest value at the nodes within the domain.

        Parameters
        ----------
        quantity
            One of the map's quantities.

        Returns
        -------
        tuple of float
            Lowest and highest value.
        """
        return _grid_range(self, quantity)


@lru_cache(maxsize=4)
def grid_over(lens_map: LensMap) -> MapGrid:
    """Lay the grid over a map on which its contours and its inverse are searched.

    Parameters
    ----------
    lens_map
        The map; it must extend along both zoom and focus.

    Returns
    -------
    MapGrid
        The grid; that of the maps asked last is kept.

    Raises
    ------
    InputError
        When the map is a line.
    """
    zoom, focus = lens_map.domain.grid(_NODES)
    inside = lens_map.domain.contains(zoom, focus)
    if min(zoom.shape) < 2 or not inside.any():
        raise InputError(
            f"a map over {lens_map.domain} has no contours, since it extends along one motor only; "
            "sample both"
        )
    return MapGrid(lens_map, zoom[0], focus[:, 0], inside)


@lru_cache(maxsize=16)
def _grid_values(grid: MapGrid, quantity: str) -> FloatArray:
    zoom, focus = np.meshgrid(grid.zoom, grid.focus)
    return frozen_array("values", value_at(grid.lens_map, quantity, zoom, focus), ("F", "Z"))


@lru_cache(maxsize=16)
def _grid_range(grid: MapGrid, quantity: str) -> tuple[float, float]:
    values = grid.values(quantity)[grid.inside]
    return float(values.min()), float(values.max())
