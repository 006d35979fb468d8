"""Lens settings as numbers between 0 and 1, so that a search can move through them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from planning.fixed_lens import FixedLens
from planning.lens_states import LensStates

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: Share of a range by which the ends are kept, so that rounding leads to no setting beyond them.
_ROUNDING: Final = 1e-9
#: A fixed lens is focused no nearer than this share beyond its focal length.
_NEAREST: Final = 1e-3


class SettingSpace(Protocol):
    """The settings of a lens, as points of a cube."""

    @property
    def size(self) -> int:
        """How many numbers make a setting."""

    def states(self, shares: FloatArray) -> tuple[LensStates, BoolArray]:
        """Give the lens at settings.

        Parameters
        ----------
        shares
            (N, size) between 0 and 1.

        Returns
        -------
        states : LensStates
            N states.
        valid : BoolArray
            (N,) whether the lens can be set so; where not, the state is one of the others.
        """


def lattice(space: SettingSpace, nodes: int) -> FloatArray:
    """Spread settings evenly over a cube.

    Parameters
    ----------
    space
        The settings.
    nodes
        How many along each of its axes, ends included.

    Returns
    -------
    FloatArray
        (nodes ** size, size) between 0 and 1.
    """
    axes = [np.linspace(0.0, 1.0, nodes)] * space.size
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, space.size)


@dataclass(frozen=True, eq=False)
class MapSettings:
    """Zoom, focus and, where it matters and several are known, iris of a lens map.

    The first number runs through the zooms of the map's domain, the second through the focuses that
    it supports at that zoom, the third through the irises. An axis without extent takes no number.

    Parameters
    ----------
    lens
        The map.
    with_iris
        Whether the entrance pupil matters.
    """

    lens: LensMap
    with_iris: bool = False

    @property
    def size(self) -> int:
        """How many numbers make a setting."""
        return sum(self._extends)

    def states(self, shares: FloatArray) -> tuple[LensStates, BoolArray]:
        """Give the lens at settings.

        Parameters
        ----------
        shares
            (N, size) between 0 and 1.

        Returns
        -------
        states : LensStates
            N states.
        valid : BoolArray
            (N,) whether the map supports the setting.
        """
        # Many views share a setting, and asking the map costs more than finding that out.
        distinct, which = np.unique(shares, axis=0, return_inverse=True)
        states, valid = self._states(distinct)
        return states.some(which.reshape(-1)), valid[which.reshape(-1)]

    def _states(self, shares: FloatArray) -> tuple[LensStates, BoolArray]:
        columns = iter(np.clip(shares, 0.0, 1.0).T)
        zero = np.zeros(len(shares))
        zoom_share, focus_share, iris_share = (
            next(columns) if extends else zero for extends in self._extends
        )
        zoom = _between(self.lens.domain.zoom, zoom_share)
        low, high = self._focus_span(zoom)
        focus = low + (high - low) * np.clip(focus_share, _ROUNDING, 1 - _ROUNDING)
        valid = self.lens.domain.contains(zoom, focus)
        if not valid.all() and valid.any():
            first = int(np.argmax(valid))
            zoom, focus = np.where(valid, zoom, zoom[first]), np.where(valid, focus, focus[first])
        iris = None
        if self._irises is not None:
            iris = _between((self._irises[0], self._irises[-1]), iris_share)
        return LensStates.of_map(self.lens, zoom, focus, iris), valid

    @cached_property
    def _irises(self) -> FloatArray | None:
        pupil = self.lens.pupil
        several = self.with_iris and pupil is not None and len(pupil.irises) > 1
        return pupil.irises if several and pupil is not None else None

    @cached_property
    def _extends(self) -> tuple[bool, bool, bool]:
        (z0, z1), (f0, f1) = self.lens.domain.zoom, self.lens.domain.focus
        # Settings on a slanted line are one number: zoom leads, and focus follows it.
        slanted = z1 > z0 and not self.lens.domain.is_rectangle and self.lens.domain.area == 0
        return z1 > z0, f1 > f0 and not slanted, self._irises is not None

    def _focus_span(self, zoom: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N,) lowest and highest focus that the domain supports at each zoom."""
        domain = self.lens.domain
        if domain.is_rectangle:
            return np.full(len(zoom), domain.focus[0]), np.full(len(zoom), domain.focus[1])
        start, stop = domain.outline, np.roll(domain.outline, -1, axis=0)
        run = stop[:, 0] - start[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (zoom[:, None] - start[:, 0]) / run
        on_edge = (run != 0) & (share >= -_ROUNDING) & (share <= 1 + _ROUNDING)
        focus = start[:, 1] + np.where(on_edge, share, 0.0) * (stop[:, 1] - start[:, 1])
        return (
            np.where(on_edge, focus, np.inf).min(axis=1),
            np.where(on_edge, focus, -np.inf).max(axis=1),
        )


@dataclass(frozen=True)
class FixedSettings:
    """The distance at which a fixed lens is focused: f/D between its bounds.

    Parameters
    ----------
    lens
        The lens.
    nearest_mm, farthest_mm
        Bounds on D in mm; the farthest may be infinite, which is taken as 1,000 f.
    """

    lens: FixedLens
    nearest_mm: float
    farthest_mm: float

    @property
    def size(self) -> int:
        """One."""
        return 1

    def states(self, shares: FloatArray) -> tuple[LensStates, BoolArray]:
        """Give the lens focused at distances.

        Parameters
        ----------
        shares
            (N, 1) between 0, the farthest, and 1.

        Returns
        -------
        states : LensStates
            N states.
        valid : BoolArray
            (N,) True.
        """
        focal = self.lens.focal_length_mm
        nearest = max(self.nearest_mm, focal * (1 + _NEAREST))
        farthest = max(min(self.farthest_mm, 1000 * focal), nearest)
        inverse = _between((1 / farthest, 1 / nearest), np.clip(shares[:, 0], 0.0, 1.0))
        return LensStates.of_fixed(self.lens, 1 / inverse), np.ones(len(shares), dtype=bool)


def _between(ends: tuple[float, float], share: FloatArray) -> FloatArray:
    """Values so far between two ends, and never beyond them."""
    low, high = ends
    return np.clip(low + (high - low) * share, low, high)
