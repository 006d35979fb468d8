"""Views as points of a space that a search moves through: where the camera stands, how it is set.

Whatever the search tries, the middle of the feature's depth, in dioptres, lies in the sharp plane,
unless depth of field is asked for: then the sharp plane may lie anywhere.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final, Self

import numpy as np
from scipy.spatial.transform import Rotation

from lenscal.arrays import BoolArray, FloatArray, IntArray
from lenscal.sensor import Axis
from planning.setting_space import SettingSpace
from planning.viewpoints import Ring
from planning.views import Subject, Views

#: By what share of 1/D the sharp plane leaves the middle of the feature in a move of 1.
_DEFOCUS: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Starts(ABC):
    """K views from which a search moves away.

    Parameters
    ----------
    subject
        What is looked at.
    settings
        What the lens can be set to.
    shares
        (K, S) settings; the first S numbers of a move change them.
    """

    #: Fields with one entry per view.
    per_view: ClassVar[tuple[str, ...]] = ("shares",)

    subject: Subject
    settings: SettingSpace
    shares: FloatArray

    @property
    @abstractmethod
    def size(self) -> int:
        """How many numbers make a move."""

    @abstractmethod
    def moved(self, moves: FloatArray) -> Self:
        """Move away from them.

        Parameters
        ----------
        moves
            (K, J, size) from each.

        Returns
        -------
        Starts
            K · J views.
        """

    @abstractmethod
    def as_views(self) -> tuple[Views, BoolArray]:
        """Give them as views.

        Returns
        -------
        views : Views
            One pose, at K states each with its own place: shape (1, K).
        valid : BoolArray
            (K,) whether the lens can be set so.
        """

    @property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """(K, size) lowest and highest moves: the ends of the settings."""
        free = np.full((len(self), self.size - self.settings.size), np.inf)
        low = np.concatenate([-self.shares, -free], axis=1)
        return low, np.concatenate([1 - self.shares, free], axis=1)

    def some(self, which: IntArray | BoolArray) -> Self:
        """Take some of them.

        Parameters
        ----------
        which
            Indices or a mask.

        Returns
        -------
        Starts
            Those.
        """
        return replace(self, **{name: getattr(self, name)[which] for name in self.per_view})

    def merged(self, other: Self, taken: BoolArray) -> Self:
        """Take some from others.

        Parameters
        ----------
        other
            As many views.
        taken
            (K,) which of them are taken from there.

        Returns
        -------
        Starts
            As many.
        """
        chosen = {name: getattr(self, name).copy() for name in self.per_view}
        for name, array in chosen.items():
            array[taken] = getattr(other, name)[taken]
        return replace(self, **chosen)

    def joined(self, others: Sequence[Self]) -> Self:
        """Put others behind them.

        Parameters
        ----------
        others
            Of the same subject and settings.

        Returns
        -------
        Starts
            All.
        """
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(starts, name) for starts in (self, *others)])
            for name in self.per_view
        }
        return replace(self, **joined)

    def _moved_shares(self, moves: FloatArray) -> FloatArray:
        """(K · J, S) settings after moves, within their ends."""
        count = self.settings.size
        shares = np.clip(self.shares[:, None] + moves[..., :count], 0.0, 1.0)
        return np.asarray(shares.reshape(-1, count))

    def __len__(self) -> int:
        return len(self.shares)


@dataclass(frozen=True, slots=True, eq=False)
class GeneralStarts(Starts):
    """Views from anywhere in any direction, neither orthogonal nor centred.

    Parameters
    ----------
    subject
        What is looked at.
    settings
        What the lens can be set to.
    shares
        (K, S) settings.
    rotations
        (K, 3, 3) of part_from_camera.
    aims
        (K, 2) x/z and y/z at which the camera sees the feature's centroid.
    defocus
        (K,) by which share 1/D exceeds the dioptres of the middle of the feature.
    is_free
        Whether the sharp plane may leave that middle.
    """

    per_view: ClassVar[tuple[str, ...]] = ("shares", "rotations", "aims", "defocus")

    rotations: FloatArray
    aims: FloatArray
    defocus: FloatArray
    is_free: bool

    @property
    def size(self) -> int:
        """Settings, three rotations, two aims and, where it is free, the sharp plane."""
        return self.settings.size + 5 + self.is_free

    def moved(self, moves: FloatArray) -> GeneralStarts:
        """Start from where moves end.

        Parameters
        ----------
        moves
            (K, J, size) from the start of each.

        Returns
        -------
        GeneralStarts
            K · J starts.
        """
        count = self.settings.size
        turns = Rotation.from_rotvec(moves[..., count : count + 3].reshape(-1, 3)).as_matrix()
        turned = self.rotations[:, None] @ turns.reshape(*moves.shape[:2], 3, 3)
        aims = self.aims[:, None] + moves[..., count + 3 : count + 5]
        defocus = np.broadcast_to(self.defocus[:, None], moves.shape[:2])
        if self.is_free:
            defocus = defocus + _DEFOCUS * moves[..., count + 5]
        return replace(
            self,
            shares=self._moved_shares(moves),
            rotations=turned.reshape(-1, 3, 3),
            aims=aims.reshape(-1, 2),
            defocus=defocus.reshape(-1),
        )

    def as_views(self) -> tuple[Views, BoolArray]:
        """Give the views at the starts themselves.

        Returns
        -------
        views : Views
            Of shape (1, K).
        valid : BoolArray
            (K,) whether the lens can be set so.
        """
        states, valid = self.settings.states(self.shares)
        places = sharp_positions(
            self.subject, self.rotations, self.aims, states.object_distance_mm, self.defocus
        )
        return Views(places[None], self.rotations[None], states, self.subject), valid


def sharp_positions(
    subject: Subject,
    rotations: FloatArray,
    aims: FloatArray,
    object_distance_mm: FloatArray,
    defocus: FloatArray,
) -> FloatArray:
    """Place cameras so that the middle of the feature's depth is where they are sharp.

    The middle is that in dioptres, (1/z_min + 1/z_max)/2 = (1 − defocus)/D, at which nearest and
    farthest corner are blurred alike.

    Parameters
    ----------
    subject
        What is looked at.
    rotations
        (N, 3, 3) of part_from_camera.
    aims
        (N, 2) x/z and y/z of the feature's centroid.
    object_distance_mm
        (N,) D in mm.
    defocus
        (N,) by which share 1/D exceeds the dioptres of the middle.

    Returns
    -------
    FloatArray
        (N, 3) projection centres in mm in the part's frame.
    """
    feature = subject.seen_feature
    centroid = feature.centroid_mm
    depths = (feature.vertices_mm - centroid) @ rotations[..., 2].T
    nearest, spread = depths.min(axis=0), np.ptp(depths, axis=0)
    wanted = object_distance_mm / np.maximum(1 - defocus, 0.1)
    # With z that of the nearest corner, 1/z + 1/(z + s) = 2/D is quadratic in z.
    less = wanted - spread
    first = (less + np.sqrt(less**2 + 2 * spread * wanted)) / 2
    depth = first - nearest
    line = np.concatenate([aims, np.ones((len(aims), 1))], axis=1)
    away = np.einsum("nij,nj->ni", rotations, line)
    places: FloatArray = centroid - depth[:, None] * away
    return places


@dataclass(frozen=True, slots=True, eq=False)
class OrthogonalStarts(Starts):
    """Views of the orthogonal case: on the ring about the feature, centred on it.

    Parameters
    ----------
    subject
        What is looked at.
    settings
        What the lens can be set to.
    shares
        (K, S) settings.
    angles
        (K,) on the ring in radians.
    ring
        The directions.
    axis
        The image axis that the feature lies along.
    """

    per_view: ClassVar[tuple[str, ...]] = ("shares", "angles")

    angles: FloatArray
    ring: Ring
    axis: Axis

    @property
    def size(self) -> int:
        """Settings and, on a whole ring, the angle."""
        return self.settings.size + self.ring.is_full

    def moved(self, moves: FloatArray) -> OrthogonalStarts:
        """Move away from the views.

        Parameters
        ----------
        moves
            (K, J, size) from each.

        Returns
        -------
        OrthogonalStarts
            K · J views.
        """
        count = self.settings.size
        angles = np.broadcast_to(self.angles[:, None], moves.shape[:2])
        if self.ring.is_full:
            angles = angles + moves[..., count]
        return replace(self, shares=self._moved_shares(moves), angles=angles.reshape(-1))

    def as_views(self) -> tuple[Views, BoolArray]:
        """Give the views.

        Returns
        -------
        views : Views
            Of shape (1, K).
        valid : BoolArray
            (K,) whether the lens can be set so.
        """
        states, valid = self.settings.states(self.shares)
        places = self.ring.positions(states.object_distance_mm, self.angles)
        turned = self.ring.rotations(places, self.axis)
        return Views(places[None], turned[None], states, self.subject), valid
