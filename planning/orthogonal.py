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
from planning.choices import COLUMNS, choose_settings
from planning.fixed_lens import FixedLens
from planning.judgement import judge
from planning.lens_states import LensStates
from planning.preconditions import asking_of_pupil
from planning.requirements.magnification import bounding, image_axis
from planning.requirements.margin import BoundsMagnification, Margin, Requirement
from planning.requirements.visibility import Visibility
from planning.setting_space import SettingSpace, lattice
from planning.settings import AdmissibleSettings
from planning.stated_views import pose_columns
from planning.task import Task
from planning.view_search import FoundViews
from planning.view_space import OrthogonalStarts
from planning.viewpoint_rows import as_table, margin_names
from planning.viewpoints import Arc, Ring, visible_arcs
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
    lens = settings.lens
    choices = choose_settings(settings, settings_tried)
    rows = [
        _viewpoint(task, lens, ring, choice, arc, subject)
        for _, choice in choices.iterrows()
        for arc in visible_arcs(region, ring, float(choice["object_distance_mm"]))
    ]
    return as_table(task, rows)


def _viewpoint(
    task: Task,
    lens: LensMap | FixedLens,
    ring: Ring,
    choice: pd.Series[float],
    arc: Arc,
    subject: Subject,
) -> dict[str, float]:
    distance = float(choice["object_distance_mm"])
    position = ring.positions(distance, np.array(arc.deepest))
    pose = ring.pose(position, image_axis(task.requirements))
    row = {name: float(choice[name]) for name in COLUMNS}
    row |= pose_columns(pose)
    row["angle"] = arc.deepest
    row |= _margins(task, Views.of(pose, _states(lens, choice), subject), row["magnification"])
    row["visibility_margin_mm"] = arc.depth_mm
    shares = [row[name] for name in margin_names(task)] + [arc.depth_mm / distance]
    row["smallest_margin"] = float(np.min(shares))
    return row


def _states(lens: LensMap | FixedLens, choice: pd.Series[float]) -> LensStates:
    """The setting at every iris whose entrance pupil is on record."""
    if isinstance(lens, FixedLens):
        return LensStates.of_fixed(lens, choice["object_distance_mm"])
    irises = None if lens.pupil is None or len(lens.pupil.irises) == 1 else lens.pupil.irises
    count = 1 if irises is None else len(irises)
    zoom, focus = np.full(count, choice["zoom"]), np.full(count, choice["focus"])
    return LensStates.of_map(lens, zoom, focus, irises)


def _margins(task: Task, views: Views, magnification: float) -> dict[str, float]:
    """The smallest share of each kind of requirement, at the iris that is best for all of them.

    By d/D as in the paper, and in the view as it is.
    """
    judgement = judge(task.requirements, views)
    best = int(np.argmax(judgement.smallest_share[0]))
    # Where nothing that is asked depends on the pupil, the iris is left to who takes the pictures.
    iris = views.states.iris if asking_of_pupil(task.requirements) else None
    margins: dict[str, float] = {"iris": np.nan if iris is None else float(iris[best])}
    in_view = [float(margin.share[0, best]) for margin in judgement.margins]
    by_ratio = [
        (r.name, float(r.orthogonal_margin(magnification, views.states.sensor).share))
        for r in bounding(task.requirements)
    ]
    named = [*zip((r.name for r in task.requirements), in_view, strict=True), *by_ratio]
    for name, share in named:
        column = f"{name}_margin"
        margins[column] = min(margins.get(column, np.inf), share)
    return margins


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
