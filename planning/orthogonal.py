"""The orthogonal case: viewpoints on the ring about the feature, at settings between two contours.

Section 1.5.3 of the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol, runtime_checkable

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.sensor import Sensor
from planning.choices import choose_settings
from planning.fixed_lens import FixedLens
from planning.judgement import judge
from planning.preconditions import asking_of_pupil
from planning.requirements.magnification import image_axis
from planning.requirements.margin import BoundsMagnification, Margin, Requirement
from planning.requirements.visibility import Visibility
from planning.setting_space import SettingSpace, lattice
from planning.settings import AdmissibleSettings
from planning.stated_views import states_of
from planning.task import Task
from planning.view_search import FoundViews
from planning.view_space import OrthogonalStarts
from planning.viewpoint_rows import as_table, rows_of
from planning.viewpoints import Ring, visible_arcs
from planning.views import Subject, Views
from planning.visibility.region import Region

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: Settings along each axis, and angles, from which a search for what blocks starts.
_NODES: Final = 9
_ANGLES: Final = 72


def orthogonal_viewpoints(
    task: Task,
    ring: Ring,
    settings: AdmissibleSettings,
    settings_tried: int,
    subject: Subject,
    region: Region,
) -> pd.DataFrame:
    """Find where the ring crosses the region, for a handful of settings.

    Parameters
    ----------
    task
        What is asked.
    ring
        The directions.
    settings
        The admissible settings, not empty.
    settings_tried
        How many of them are looked at.
    subject
        What is looked at.
    region
        From where it is seen whole.

    Returns
    -------
    pandas.DataFrame
        One row for each arc at each setting, as in a plan, also where a margin is negative.
    """
    choices = choose_settings(settings, settings_tried)
    found = [
        (setting, arc.deepest)
        for setting, distance_mm in enumerate(choices["object_distance_mm"])
        for arc in visible_arcs(region, ring, float(distance_mm))
    ]
    if not found:
        return as_table(task, [])
    which, angles = np.array([k for k, _ in found]), np.array([angle for _, angle in found])
    chosen = choices.iloc[which].reset_index(drop=True)
    places = ring.positions(chosen["object_distance_mm"].to_numpy(), angles)
    turned = ring.rotations(places, image_axis(task.requirements))
    chosen["iris"] = _best_iris(task, settings.lens, chosen, places, turned, subject)
    views = Views(places[None], turned[None], states_of(settings.lens, chosen), subject)
    judged = orthogonal_requirements(task.requirements)
    return rows_of(task, views, judged, judge(judged, views).shares[0], angles)


def _best_iris(
    task: Task,
    lens: LensMap | FixedLens,
    chosen: pd.DataFrame,
    places: FloatArray,
    turned: FloatArray,
    subject: Subject,
) -> FloatArray:
    """(K,) the iris on record that is best for everything in each view; NaN where it is left."""
    count = len(chosen)
    if isinstance(lens, FixedLens) or lens.pupil is None or not asking_of_pupil(task.requirements):
        return np.full(count, np.nan)
    irises = lens.pupil.irises
    if len(irises) == 1:
        return np.full(count, irises[0])
    each = chosen.loc[chosen.index.repeat(len(irises))].assign(iris=np.tile(irises, count))
    views = Views(
        np.repeat(places, len(irises), axis=0)[None],
        np.repeat(turned, len(irises), axis=0)[None],
        states_of(lens, each),
        subject,
    )
    smallest = judge(task.requirements, views).smallest_share[0].reshape(count, len(irises))
    best: FloatArray = irises[smallest.argmax(axis=1)]
    return best


@runtime_checkable
class OnMagnification(Requirement, BoundsMagnification, Protocol):
    """A requirement on views that also bounds d/D."""


@dataclass(frozen=True, slots=True)
class InBothWays:
    """A requirement on d/D, judged by d/D as in the paper, and in the view as it is.

    Parameters
    ----------
    requirement
        The requirement.
    """

    requirement: OnMagnification

    @property
    def name(self) -> str:
        """That of the requirement."""
        return self.requirement.name

    def margin(self, views: Views) -> Margin:
        """Judge views by whichever is worse.

        Parameters
        ----------
        views
            V × S views.

        Returns
        -------
        Margin
            (V, S).
        """
        states = views.states
        by_ratio = self.requirement.orthogonal_margin(states.magnification, states.sensor)
        seen = self.requirement.margin(views)
        # By the ratio one knows the share; in the view's own unit it is as much of the limit.
        with np.errstate(divide="ignore", invalid="ignore"):
            limit = np.where(seen.share != 0, seen.value / seen.share, 0.0)
        share = np.minimum(seen.share, by_ratio.share)
        value = np.where(share < seen.share, share * limit, seen.value)
        return Margin(value, seen.unit, share, seen.binds)

    def describe(self, sensor: Sensor) -> str:
        """Say what is asked.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            As the requirement says it.
        """
        return self.requirement.describe(sensor)


def orthogonal_requirements(requirements: Sequence[Requirement]) -> list[Requirement]:
    """Give what an orthogonal view is judged by.

    Parameters
    ----------
    requirements
        What is asked.

    Returns
    -------
    list of Requirement
        Each, those on d/D in both ways, and visibility.
    """
    judged: list[Requirement] = [
        InBothWays(r) if isinstance(r, OnMagnification) else r for r in requirements
    ]
    if not any(isinstance(r, Visibility) for r in requirements):
        judged.append(Visibility())
    return judged


def orthogonal_starts(
    task: Task,
    ring: Ring,
    settings: SettingSpace,
    requirements: Sequence[Requirement],
    subject: Subject,
    count: int,
    kept: FloatArray,
) -> OrthogonalStarts:
    """Choose the best of many orthogonal views, whether they satisfy the task or not.

    Parameters
    ----------
    task
        What is asked.
    ring
        The directions.
    settings
        What the lens can be set to.
    requirements
        What views are judged by.
    subject
        What is looked at, with its region.
    count
        How many views.
    kept
        (R,) the share of each limit that is kept besides; negative for one that may be missed.

    Returns
    -------
    OrthogonalStarts
        The best first.
    """
    shares = lattice(settings, _NODES)
    angles = np.linspace(-np.pi, np.pi, _ANGLES, endpoint=False) if ring.is_full else np.zeros(1)
    starts = OrthogonalStarts(
        subject,
        settings,
        np.repeat(shares, len(angles), axis=0),
        np.tile(angles, len(shares)),
        ring,
        image_axis(task.requirements),
    )
    smallest = (FoundViews.judged(requirements, starts).shares - kept).min(axis=1)
    return starts.some(np.argsort(-smallest, kind="stable")[:count])
