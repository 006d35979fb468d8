"""Where a search for general views starts: directions in which the region extends, and settings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from lenscal.arrays import BoolArray, FloatArray, IntArray
from planning.judgement import judge
from planning.requirements.magnification import image_axis, required_magnification
from planning.requirements.margin import BoundsMagnification, Requirement
from planning.setting_space import SettingSpace, lattice
from planning.view_space import GeneralStarts
from planning.viewpoints import Ring
from planning.views import Subject
from planning.visibility.region import Region

#: Directions spread evenly, and directions to places of the region.
_EVEN, _TO_REGION = 500, 700
#: Nodes per axis of the lattice of settings, and how many of them are tried with each direction.
_NODES, _SETTINGS = 9, 36
#: How far d/D may lie beyond the bounds of an orthogonal view: an oblique one may do with it.
_BEYOND: Final = 1.35
#: Pairs of direction and setting that are judged, and that are judged by everything.
_JUDGED, _JUDGED_BY_ALL = 6000, 500
#: Requirements that cost much to judge.
_COSTLY: Final = ("visibility", "unvignetted", "clearance")
#: How far along or across the feature a line of sight must be for its roll to be known.
_SINE: Final = 0.05
#: Share of 1 that counts as close, for settings and for directions (radians).
_CLOSE: Final = 0.1


class Candidates:
    """Many views, of which the best that are far from each other are given as starts.

    Parameters
    ----------
    subject
        What is looked at.
    region
        From where it is seen whole.
    settings
        What the lens can be set to.
    requirements
        R that shall hold.
    rng
        Draws directions.
    """

    def __init__(
        self,
        subject: Subject,
        region: Region,
        settings: SettingSpace,
        requirements: Sequence[Requirement],
        rng: np.random.Generator,
    ) -> None:
        self.requirements = tuple(requirements)
        self._settings, self._rng = settings, rng
        self._costly = np.array([r.name in _COSTLY for r in requirements])
        self._bounding = np.array([isinstance(r, BoundsMagnification) for r in requirements])
        self._directions = _directions(subject, region, rng)
        is_free = any(r.name == "depth_of_field" for r in requirements)
        self._aimed = partial(_aimed, subject, region, settings, requirements, rng, is_free)
        self._pools: dict[bytes, tuple[GeneralStarts, FloatArray]] = {}

    def best(self, count: int, kept: FloatArray, by_direction: bool = False) -> GeneralStarts:
        """Choose views from which a search may start.

        Parameters
        ----------
        count
            How many, at most.
        kept
            (R,) the share of each limit that is kept besides; negative for one that may be missed.
        by_direction
            Whether all look from different sides, not also with other settings from the same.

        Returns
        -------
        GeneralStarts
            The starts, the most promising first.
        """
        tried, shares = self._pool(self._bounding & (kept >= 0))
        promise = (shares - kept[~self._costly]).min(axis=1, initial=np.inf)
        most = np.argsort(-promise, kind="stable")[:_JUDGED_BY_ALL]
        tried, promise = tried.some(most), promise[most]
        costly = self._shares(tried, self._costly) - kept[self._costly]
        promise = np.minimum(promise, costly.min(axis=1, initial=np.inf))
        return tried.some(_apart(tried, promise, count, by_direction))

    def _pool(self, firm: BoolArray) -> tuple[GeneralStarts, FloatArray]:
        """Views at settings that may meet the firm bounds on d/D, and their cheap margins."""
        key = firm.tobytes()
        if key not in self._pools:
            bounds = [r for r, is_firm in zip(self.requirements, firm, strict=True) if is_firm]
            tried = self._aimed(_settings(self._settings, bounds, self._rng), self._directions)
            self._pools[key] = tried, self._shares(tried, ~self._costly)
        return self._pools[key]

    def _shares(self, starts: GeneralStarts, asked: BoolArray) -> FloatArray:
        """(K, A) margins of the requirements asked."""
        which = [r for r, is_asked in zip(self.requirements, asked, strict=True) if is_asked]
        if not which:
            return np.zeros((len(starts), 0))
        views, valid = starts.as_views()
        # Of what is far from holding nothing is said apart.
        shares = np.maximum(judge(which, views).shares[0], -10.0)
        return np.where(valid[:, None], shares, -np.inf)


def _settings(
    settings: SettingSpace, requirements: Sequence[Requirement], rng: np.random.Generator
) -> FloatArray:
    """(S, size) a lattice of settings, of those whose d/D may do."""
    shares = lattice(settings, _NODES)
    states, valid = settings.states(shares)
    low, high = required_magnification(requirements, states.sensor)
    ratio = states.magnification
    may_do = valid & (ratio >= low / _BEYOND) & (ratio <= high * _BEYOND)
    if not may_do.any():
        # Nothing will do; what does best is near that which is nearest to the bounds.
        off = np.maximum(low / ratio, ratio / high)
        may_do = valid & (off <= np.sort(off[valid])[:_NODES].max())
    chosen = np.flatnonzero(may_do)
    if len(chosen) > _SETTINGS:
        chosen = np.sort(rng.choice(chosen, _SETTINGS, replace=False))
    return shares[chosen]


def _directions(subject: Subject, region: Region, rng: np.random.Generator) -> FloatArray:
    """(N, 3) unit vectors from the feature towards where a camera may stand."""
    number = np.arange(_EVEN) + 0.5
    polar = np.arccos(1 - 2 * number / _EVEN)
    around = np.pi * (1 + np.sqrt(5)) * number
    even = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1
    )
    triangles = region.solid.triangles_mm
    areas = np.linalg.norm(
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=-1
    )
    # Half by area, half by triangle, so that no small window is forgotten.
    share = areas / areas.sum() / 2 + 0.5 / len(areas)
    picked = triangles[rng.choice(len(triangles), 2 * _TO_REGION, p=share)]
    weights = rng.dirichlet(np.ones(3), 2 * _TO_REGION)
    places = np.einsum("nk,nkj->nj", weights, picked)
    # What lies between two places of the surface is farther inside than either.
    places = (places[:_TO_REGION] + places[_TO_REGION:]) / 2
    away = places - subject.seen_feature.centroid_mm
    length = np.linalg.norm(away, axis=-1, keepdims=True)
    away = away[length[:, 0] > 0] / length[length > 0][:, None]
    directions = np.concatenate([even, away])
    if not subject.target.is_segment:
        directions = directions[directions @ subject.target.normal > 0]
    along = Ring.about(subject.seen_feature, subject.target).along
    across = np.linalg.norm(np.cross(directions, along), axis=-1)
    kept: FloatArray = directions[across > _SINE]
    return kept


def _aimed(
    subject: Subject,
    region: Region,
    settings: SettingSpace,
    requirements: Sequence[Requirement],
    rng: np.random.Generator,
    is_free: bool,
    shares: FloatArray,
    directions: FloatArray,
) -> GeneralStarts:
    """Look at the feature's centroid along directions at settings, from inside of the region."""
    distances = settings.states(shares)[0].object_distance_mm
    centroid = subject.seen_feature.centroid_mm
    places = centroid + distances[:, None] * directions[:, None]
    inside = region.contains(places)
    direction, setting = np.nonzero(inside)
    if len(direction) > _JUDGED:
        chosen = rng.choice(len(direction), _JUDGED, replace=False)
        direction, setting = direction[chosen], setting[chosen]
    elif len(direction) < _JUDGED_BY_ALL:
        # The region is narrow, or out of reach: what is nearest to it is tried too.
        outside = np.flatnonzero(~inside.ravel())
        outside = outside[rng.permutation(len(outside))[:_JUDGED]]
        off = -region.distance_to_boundary(places.reshape(-1, 3)[outside])
        near = outside[np.argsort(off, kind="stable")[:_JUDGED_BY_ALL]]
        direction = np.concatenate([direction, near // len(shares)])
        setting = np.concatenate([setting, near % len(shares)])
    ring = Ring.about(subject.seen_feature, subject.target)
    axis = image_axis(requirements)
    upright = ring.rotations(centroid + directions[direction], axis)
    rolls = [np.eye(3)]
    if axis == "any":
        rolls += [Rotation.from_euler("z", turn).as_matrix() for turn in (np.pi / 2, np.pi / 4)]
    count = len(rolls)
    return GeneralStarts(
        subject,
        settings,
        np.tile(shares[setting], (count, 1)),
        np.concatenate([upright @ roll for roll in rolls]),
        np.zeros((count * len(setting), 2)),
        np.zeros(count * len(setting)),
        is_free,
    )


def _apart(starts: GeneralStarts, promise: FloatArray, count: int, by_direction: bool) -> IntArray:
    """Indices of good starts that are not close to each other."""
    order = np.argsort(-promise, kind="stable")
    towards, shares = starts.rotations[..., 2], starts.shares
    chosen: list[int] = []
    close = _CLOSE
    while len(chosen) < min(count, len(order)):
        for k in order:
            turned = np.linalg.norm(towards[chosen] - towards[k], axis=-1)
            if by_direction and (turned < close).any():
                continue
            changed = np.abs(shares[chosen] - shares[k]).max(axis=-1, initial=0.0)
            rolled = np.abs(
                np.einsum("nj,j->n", starts.rotations[chosen][..., 0], starts.rotations[k][..., 0])
            )
            if not ((turned < close) & (changed < close) & (rolled > 1 - close)).any():
                chosen.append(int(k))
                if len(chosen) == count:
                    break
        close /= 2
    return np.array(chosen, dtype=np.intp)
