"""Looking at a part through the true lens, from where the camera truly is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.camera import Camera
from lenscal.imaging.decal import Decal
from lenscal.imaging.raycast import Body
from lenscal.imaging.scene import render_scene
from lenscal.imaging.texture import Float32Image
from lenscal.pose import Pose
from lenscal.sensor import Window
from planning.scene import Scene
from planning.target import Target

#: How bright the body of the target is, and all others: its edges are to stand out.
_OF_TARGET, _OF_OTHERS = 0.8, 0.25
#: How near to the target's plane its own body must have a face, as a share of the target's size.
_TOUCHING: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class TrueView:
    """All that decides what a camera at a viewpoint sees.

    Parameters
    ----------
    camera
        The true camera at the setting.
    part_from_camera
        Its true pose.
    object_distance_mm
        True distance of the plane in sharpest focus.
    entrance_pupil_diameter_mm
        At the iris.
    falloff
        Of the illumination, see `lenscal.imaging.falloff`.
    """

    camera: Camera
    part_from_camera: Pose
    object_distance_mm: float
    entrance_pupil_diameter_mm: float
    falloff: tuple[float, float] = (0.0, 0.0)


def bodies_for_pictures(scene: Scene, target: Target) -> list[Body]:
    """Paint a scene so that the edges of the target stand out.

    Parameters
    ----------
    scene
        The part.
    target
        The face that is to be seen.

    Returns
    -------
    list of Body
        The body that the target is a face of is bright, all others are dark.
    """
    return [
        Body(body.vertices_mm, body.faces, _OF_TARGET if mine else _OF_OTHERS)
        for body, mine in zip(scene.bodies, _touching(scene, target), strict=True)
    ]


def render_view(
    view: TrueView,
    scene: Scene,
    target: Target,
    decals: Sequence[Decal] = (),
    window: Window | None = None,
) -> Float32Image:
    """Look through the true lens.

    Parameters
    ----------
    view
        Camera, pose and lens.
    scene
        The part.
    target
        The face whose body is bright.
    decals
        Pictures that lie on it.
    window
        The part of the image wanted, None for all of it.

    Returns
    -------
    Float32Image
        (rows, columns) irradiance without noise; white paper 1.
    """
    return render_scene(
        view.camera,
        view.part_from_camera.inverse(),
        bodies_for_pictures(scene, target),
        object_distance_mm=view.object_distance_mm,
        entrance_pupil_diameter_mm=view.entrance_pupil_diameter_mm,
        decals=decals,
        window=window,
        falloff=view.falloff,
    )


def _touching(scene: Scene, target: Target) -> list[bool]:
    """Which bodies have a face in the plane of the target that holds its middle."""
    found = []
    for body in scene.bodies:
        corners = body.triangles_mm - target.centroid_mm
        flat = np.abs(corners @ target.normal).max(axis=1) <= _TOUCHING * target.size_mm
        a, b, c = np.moveaxis(corners[flat], 1, 0)
        sides = np.stack(
            [np.cross(p, q) @ target.normal for p, q in ((a, b), (b, c), (c, a))], axis=-1
        )
        slack = 1e-9 * target.size_mm**2
        found.append(bool(((sides >= -slack).all(axis=-1) | (sides <= slack).all(axis=-1)).any()))
    return found
