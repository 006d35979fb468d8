"""A plan: the viewpoints at which a task is done, or why there are none, with the evidence."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd

from lenscal.camera import Camera
from lenscal.document import versions, write_document
from lenscal.pose import Pose
from planning.blame import Relaxation
from planning.fixed_lens import FixedLens
from planning.scene import Scene
from planning.settings import AdmissibleSettings
from planning.stated_views import PLACE, poses_of, records_of, states_of
from planning.task import Task
from planning.viewpoints import Ring
from planning.views import Subject, Views
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
        angle on the ring in radians, NaN for general views; a margin for each kind of requirement
        (as a share of its limit), visibility_margin_mm (distance from the boundary of the region)
        and smallest_margin (the smallest of them all, visibility counted as a share of D). Where it
        was asked how well lens and robot are known: each margin in its own σ (…_margin_sigmas), and
        probability, with which all requirements hold together.
    safety
        By which share of itself each limit on d/D is kept.
    why_empty
        A sentence that names the requirement that makes it impossible; empty when there are
        viewpoints.
    relaxations
        Each single requirement whose giving way would make an impossible task possible, and by how
        much; the one that has to give the smallest share first.
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
    relaxations: tuple[Relaxation, ...] = ()

    @property
    def poses(self) -> tuple[Pose, ...]:
        """part_from_camera of each viewpoint, in the order of the table."""
        return poses_of(self.viewpoints)

    @property
    def made_from(self) -> dict[str, str]:
        """Digests of what the plan was made from."""
        found = {"task": self.task.digest, "scene": self.scene.digest}
        if isinstance(self.lens, FixedLens):
            return found
        return found | {"lens_map": self.lens.digest}

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

    @property
    def views(self) -> Views:
        """(1, K) the viewpoints as views, each at its own place, of the lens's states."""
        table = self.viewpoints
        places = table[list(PLACE)].to_numpy()
        turns = np.array([pose.rotation for pose in self.poses]).reshape(-1, 3, 3)
        subject = Subject(self.task.target, self.task.seen_feature, self.scene, self.region)
        return Views(places[None], turns[None], states_of(self.lens, table), subject)

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
            "viewpoints": records_of(self.viewpoints),
            "why_empty": self.why_empty,
            "relaxations": [relaxation.to_dict() for relaxation in self.relaxations],
            "made_with": versions("lenscal", "manifold3d", "numpy"),
        }
        return write_document(path, PLAN_KIND, PLAN_VERSION, body)


def _camera(lens: LensMap | FixedLens, choice: pd.Series[float]) -> Camera:
    if isinstance(lens, FixedLens):
        return Camera(lens.sensor, float(choice["image_distance_mm"]))
    return lens.camera_at(float(choice["zoom"]), float(choice["focus"]))


def _finite(bounds: tuple[float, float] | None) -> list[float | None] | None:
    if bounds is None:
        return None
    return [value if np.isfinite(value) else None for value in bounds]
