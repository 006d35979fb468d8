"""Checking a viewpoint with a camera that is taken to be the truth, by code of its own.

Nothing of the planner is used: the vertices are projected and counted, and the exact test of the
audit decides what hides the target.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.pose import Pose
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.margin import Requirement
from planning.requirements.resolution import Resolution
from planning.scene import Scene
from planning.target import Target
from planning.visibility.audit import sees_whole_target

Image = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Verification:
    """What a camera at a viewpoint really sees.

    Parameters
    ----------
    feature_px
        Length of the longest edge of the feature in the image, in px.
    pixels_per_mm
        Samples per mm on the worst piece of the feature, in the image as it is.
    resolved
        Whether every resolution requirement is met on every piece of the feature.
    in_view
        Whether the feature lies on the sensor; True also where no field of view is asked for.
    target_in_view
        Whether the whole target lies on the sensor; for information, no requirement asks it.
    visible
        Whether nothing hides any point of the target.
    """

    feature_px: float
    pixels_per_mm: float
    resolved: bool
    in_view: bool
    target_in_view: bool
    visible: bool

    @property
    def satisfied(self) -> bool:
        """Whether the feature is resolved and in view, and the target visible."""
        return self.resolved and self.in_view and self.visible


def verify_viewpoint(
    camera: Camera,
    part_from_camera: Pose,
    target: Target,
    feature: Target,
    requirements: Sequence[Requirement],
    scene: Scene,
) -> Verification:
    """Look through a camera and check everything again.

    Parameters
    ----------
    camera
        The true camera at the setting of the viewpoint.
    part_from_camera
        Its true pose.
    target
        The face to be seen whole.
    feature
        The segment or face to be resolved.
    requirements
        What was asked.
    scene
        All that can hide the target.

    Returns
    -------
    Verification
        What was found.
    """
    camera_from_part = part_from_camera.inverse()

    def image(points_mm: FloatArray) -> FloatArray:
        return camera.project(camera_from_part.transform(points_mm))

    corners = image(feature.vertices_mm)
    asks_view = any(isinstance(r, FieldOfView) for r in requirements)
    in_view = bool(camera.sensor.contains(corners).all())
    ends = np.roll(feature.vertices_mm, -1, axis=0)
    longest = int(np.argmax(np.linalg.norm(ends - feature.vertices_mm, axis=-1)))
    length = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=-1)
    densities = [
        _worst_density(image, feature, r) for r in requirements if isinstance(r, Resolution)
    ]
    asked = [r.pixels / r.length_mm for r in requirements if isinstance(r, Resolution)]
    return Verification(
        feature_px=float(length[longest]),
        pixels_per_mm=min(densities, default=float("nan")),
        resolved=all(got >= want for got, want in zip(densities, asked, strict=True)),
        in_view=in_view or not asks_view,
        target_in_view=bool(camera.sensor.contains(image(target.vertices_mm)).all()),
        visible=bool(sees_whole_target(part_from_camera.translation_mm, target, scene)),
    )


def _worst_density(image: Image, feature: Target, requirement: Resolution) -> float:
    """Samples per mm on the worst of the pieces of the required length, sliding along each edge."""
    worst = np.inf
    start = feature.vertices_mm
    for a, b in zip(start, np.roll(start, -1, axis=0), strict=True):
        edge = float(np.linalg.norm(b - a))
        piece = min(requirement.length_mm, edge)
        offsets = np.linspace(0.0, edge - piece, 101)[:, None]
        direction = (b - a) / edge
        covered = np.abs(image(a + (offsets + piece) * direction) - image(a + offsets * direction))
        count = {
            "x": covered[:, 0],
            "y": covered[:, 1],
            "any": np.linalg.norm(covered, axis=-1),
        }[requirement.axis]
        worst = min(worst, float(count.min()) / piece)
    return float(worst)
