"""Stage 5: planning. Reads: LensMap, Scene, Task. Gives: Plan.

Settings that meet resolution and field of view fix the object distance; the ring at that distance
is intersected with the region from which the whole target is seen (section 1.5.3 of the paper).
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.document import write_document
from lenscal.pose import Pose
from planning.choices import COLUMNS, choose_settings
from planning.fixed_lens import FixedLens
from planning.judgement import judge
from planning.lens_states import LensStates
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.magnification import bounding, image_axis
from planning.requirements.unvignetted import Unvignetted
from planning.scene import Scene
from planning.settings import AdmissibleSettings, admissible_settings
from planning.task import Task
from planning.viewpoints import Arc, Ring, visible_arcs
from planning.views import Subject, Views
from planning.visibility.methods import visibility_region
from planning.visibility.region import Region

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

PLAN_KIND: Final = "plan"
PLAN_VERSION: Final = 1


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Viewpoints that satisfy a task, or the reason why there are none.

    Parameters
    ----------
    task
        What was asked.
    lens
        The lens map or fixed lens that was planned with.
    scene
        What can hide the target.
    settings
        The admissible settings, with the safety margin taken off.
    region
        From where the whole target is seen; None when there are no settings to look with.
    ring
        The directions of the orthogonal case.
    viewpoints
        One row per viewpoint, the most robust first. zoom, focus, iris (NaN where nothing that is
        asked depends on it); magnification,
        object_distance_mm, image_distance_mm, nodal_offset_mm, standoff_mm; x_mm, y_mm, z_mm of
        the projection centre and rotation_x, rotation_y, rotation_z (rotation vector in radians) of
        part_from_camera;
        angle on the ring in radians; a margin for each kind of requirement (as a share of its
        limit), visibility_margin_mm (distance from the boundary of the region) and smallest_margin
        (the smallest of them all, visibility counted as a share of D).
    safety
        By which share of itself each limit on d/D is kept.
    why_empty
        A sentence that names the requirement that makes it impossible; empty when there are
        viewpoints.
    """

    task: Task
    lens: LensMap | FixedLens
    scene: Scene
    settings: AdmissibleSettings
    region: Region | None
    ring: Ring
    viewpoints: pd.DataFrame
    safety: float
    why_empty: str = ""

    @property
    def poses(self) -> tuple[Pose, ...]:
        """part_from_camera of each viewpoint, in the order of the table."""
        turns = self.viewpoints[["rotation_x", "rotation_y", "rotation_z"]].to_numpy()
        places = self.viewpoints[["x_mm", "y_mm", "z_mm"]].to_numpy()
        return tuple(
            Pose.from_rotation_vector(turn, place)
            for turn, place in zip(turns, places, strict=True)
        )

    def camera(self, index: int) -> Camera:
        """Give the camera of a viewpoint as the lens map knows it.

        Parameters
        ----------
        index
            Row of the table.

        Returns
        -------
        Camera
            The camera.
        """
        return _camera(self.lens, self.viewpoints.iloc[index])

    def save(self, path: Path | str) -> Path:
        """Write the plan with its evidence.

        Parameters
        ----------
        path
            The JSON file.

        Returns
        -------
        Path
            The file.
        """
        lens: dict[str, Any] = (
            {"focal_length_mm": self.lens.focal_length_mm}
            if isinstance(self.lens, FixedLens)
            else {"map_digest": self.lens.digest}
        )
        settings, region = self.settings, self.region
        body = {
            "task": self.task.to_dict(),
            "task_digest": self.task.digest,
            "scene_digest": self.scene.digest,
            "lens": lens,
            "safety": self.safety,
            "settings": {
                "magnification_bounds": _finite(settings.magnification_bounds),
                "object_distance_bounds_mm": _finite(settings.object_distance_bounds_mm),
                "standoff_bounds_mm": _finite(settings.standoff_bounds_mm),
            },
            "region": region and {"volume_mm3": region.volume_mm3, "audit": region.audit.to_dict()},
            "viewpoints": [
                {str(k): float(v) if np.isfinite(v) else None for k, v in row.items()}
                for row in self.viewpoints.to_dict("records")
            ],
            "why_empty": self.why_empty,
            "made_with": {
                name: importlib.metadata.version(name)
                for name in ("lenscal", "manifold3d", "numpy")
            },
        }
        return write_document(path, PLAN_KIND, PLAN_VERSION, body)


def plan(
    task: Task,
    lens: LensMap | FixedLens,
    scene: Scene,
    *,
    safety: float = 0.005,
    settings_tried: int = 9,
    audit_points: int = 10_000,
    seed: int = 0,
) -> Plan:
    """Find viewpoints and settings at which a feature is visible, resolved and inside the image.

    Parameters
    ----------
    task
        What is asked.
    lens
        The calibrated lens.
    scene
        The part and what stands about it.
    safety
        By which share of itself each limit on d/D is kept.
    settings_tried
        How many settings are spread over the admissible ones.
    audit_points
        How many random viewpoints check the visibility region.
    seed
        Seed of those viewpoints.

    Returns
    -------
    Plan
        The viewpoints, the most robust first; none, with the reason, when it cannot be done.
    """
    settings = admissible_settings(lens, task.requirements, safety=safety)
    ring = Ring.about(task.seen_feature, task.target)
    nothing = _table(task, [])
    if settings.is_empty:
        why = settings.why_empty
        return Plan(task, lens, scene, settings, None, ring, nothing, safety, why)
    region = visibility_region(
        scene, task.target, task.workspace, audit_points=audit_points, seed=seed
    )
    if region.is_empty:
        why = f"visibility: {region.why_empty}"
        return Plan(task, lens, scene, settings, region, ring, nothing, safety, why)
    choices = choose_settings(settings, settings_tried)
    subject = Subject(task.target, task.seen_feature, scene, region)
    seen = [
        _viewpoint(task, lens, ring, choice, arc, subject)
        for _, choice in choices.iterrows()
        for arc in visible_arcs(region, ring, float(choice["object_distance_mm"]))
    ]
    table = _table(task, seen)
    good = table[table["smallest_margin"] > 0].reset_index(drop=True)
    why = "" if len(good) else _why_none(task, ring, choices, table)
    return Plan(task, lens, scene, settings, region, ring, good, safety, why)


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
    row |= dict(zip(("x_mm", "y_mm", "z_mm"), map(float, position), strict=True))
    names = ("rotation_x", "rotation_y", "rotation_z")
    row |= dict(zip(names, map(float, pose.rotation_vector), strict=True))
    row["angle"] = arc.deepest
    row |= _margins(task, Views.of(pose, _states(lens, choice), subject), row["magnification"])
    row["visibility_margin_mm"] = arc.depth_mm
    shares = [row[name] for name in _margin_names(task)] + [arc.depth_mm / distance]
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
    depends = any(isinstance(r, DepthOfField | Unvignetted) for r in task.requirements)
    iris = views.states.iris if depends else None
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


def _margin_names(task: Task) -> list[str]:
    return list(dict.fromkeys(f"{r.name}_margin" for r in task.requirements))


def _table(task: Task, rows: Sequence[dict[str, float]]) -> pd.DataFrame:
    columns = [
        *COLUMNS,
        "iris",
        *("x_mm", "y_mm", "z_mm", "rotation_x", "rotation_y", "rotation_z", "angle"),
        *_margin_names(task),
        *("visibility_margin_mm", "smallest_margin"),
    ]
    table = pd.DataFrame(list(rows), columns=columns, dtype=np.float64)
    return table.sort_values("smallest_margin", ascending=False, ignore_index=True)


def _why_none(task: Task, ring: Ring, choices: pd.DataFrame, seen: pd.DataFrame) -> str:
    distances = choices["object_distance_mm"]
    span = f"{distances.min():.1f} to {distances.max():.1f} mm"
    if len(seen):
        # What the camera cannot image at all lacks everything.
        best = seen[_margin_names(task)].max().clip(lower=-1.0)
        blocking = str(best.idxmin())
        return (
            f"{blocking.removesuffix('_margin')}: the target is seen at D from {span}, but "
            f"lens distortion and principal point leave a margin of {best[blocking]:.2%} at "
            "best; relax that requirement"
        )
    angles = np.linspace(-np.pi, np.pi, 360) if ring.is_full else np.zeros(1)
    places: FloatArray = ring.positions(distances.to_numpy()[:, None], angles)
    inside = float(task.workspace.contains(places).mean())
    if inside == 0:
        return (
            f"workspace: the settings that resolve and contain the feature need D from {span}, and "
            "nowhere at that distance, looking straight at the feature, does the workspace reach; "
            "enlarge it or choose another lens"
        )
    return (
        f"visibility: at D from {span}, which resolution and field of view need, the whole target "
        f"is seen from nowhere on the ring about the feature, although {inside:.0%} of it lies in "
        "the workspace; open the part or use another lens"
    )


def _camera(lens: LensMap | FixedLens, choice: pd.Series[float]) -> Camera:
    if isinstance(lens, FixedLens):
        return Camera(lens.sensor, float(choice["image_distance_mm"]))
    return lens.camera_at(float(choice["zoom"]), float(choice["focus"]))


def _finite(bounds: tuple[float, float] | None) -> list[float | None] | None:
    if bounds is None:
        return None
    return [value if np.isfinite(value) else None for value in bounds]
