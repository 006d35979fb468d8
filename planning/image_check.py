"""Verification in the image, as in section 1.5.3 of the paper: a ruler lies on the target.

The true camera looks at the part; pixels per length and cover of the frame are read off the picture
and compared with what was planned. Nothing is projected to measure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.camera import Camera
from lenscal.errors import PlanningError
from lenscal.imaging.decal import Decal
from lenscal.imaging.raycast import Body
from lenscal.imaging.ruler import Ruler
from lenscal.imaging.scene import render_scene
from lenscal.imaging.texture import Float32Image
from lenscal.pose import Pose
from lenscal.sensor import Window
from lenscal.units import MM_PER_INCH
from planning.ruler_reading import RulerReading, edge_to_edge_px, read_ruler
from planning.scene import Scene
from planning.target import Target

#: Ticks of the ruler in the paper's pictures are counted in steps of 0.02 in.
STEP_MM: Final = 0.02 * MM_PER_INCH
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


@dataclass(frozen=True, slots=True, eq=False)
class ImageCheck:
    """What was measured in a picture, beside what was planned.

    Parameters
    ----------
    planned_px
        Length of the feature in the image by the plan.
    feature_px
        The same between the end ticks of the ruler in the picture.
    edges_px
        The same between the edges of the target in the picture; NaN where the feature does not
        reach from edge to edge.
    step_px
        (3,) px per step of the ruler at its left end, in the middle and at its right end.
    step_mm
        That step.
    cover
        Share of the width of the frame that the feature takes.
    reading
        Where the ticks were found.
    image
        (rows, columns) the picture.
    """

    planned_px: float
    feature_px: float
    edges_px: float
    step_px: FloatArray
    step_mm: float
    cover: float
    reading: RulerReading
    image: npt.NDArray[np.generic] = field(repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "step_px", frozen_array("step_px", self.step_px, (3,)))

    @property
    def planned_step_px(self) -> float:
        """Px per step of the ruler by the plan."""
        return self.planned_px / (len(self.reading.ticks_px) - 1)


def ruler_on(feature: Target, step_mm: float = STEP_MM) -> Ruler:
    """Make the ruler that fits a feature.

    Parameters
    ----------
    feature
        A segment.
    step_mm
        Between its ticks; it must divide the length of the feature.

    Returns
    -------
    Ruler
        As long as the feature.

    Raises
    ------
    PlanningError
        When the feature is a face: a ruler measures along a line.
    """
    if not feature.is_segment:
        raise PlanningError(
            "a ruler measures along a segment, but the feature is a face; check one of its edges, "
            "as Target.segment(a, b)"
        )
    return Ruler(feature.size_mm, step_mm)


def ruler_decal(feature: Target, target: Target, step_mm: float = STEP_MM) -> Decal:
    """Lay a ruler along a feature on its target.

    Parameters
    ----------
    feature
        A segment in the plane of the target.
    target
        The face that it lies on.
    step_mm
        Between its ticks.

    Returns
    -------
    Decal
        The ruler, printed on the side that is to be seen.
    """
    start, end = feature.vertices_mm
    return ruler_on(feature, step_mm).decal(start, end, target.normal)


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


def check_picture(
    image: npt.NDArray[np.generic],
    feature: Target,
    target: Target,
    planned_px: float,
    step_mm: float = STEP_MM,
) -> ImageCheck:
    """Measure a picture, of a renderer or of a camera, in which a ruler lies along the feature.

    Parameters
    ----------
    image
        (rows, columns) grey values; the feature runs along its rows.
    feature
        A segment.
    target
        The face that it lies on.
    planned_px
        Length of the feature in the image by the plan.
    step_mm
        Between the ticks of the ruler.

    Returns
    -------
    ImageCheck
        What the picture shows.

    Raises
    ------
    DetectionError
        When the ruler, or an edge of the target that it reaches to, is not to be seen whole.
    """
    reading = read_ruler(image, len(ruler_on(feature, step_mm).ticks_mm))
    ends_on_edges = _on_outline(feature.vertices_mm, target)
    return ImageCheck(
        planned_px=planned_px,
        feature_px=reading.length_px,
        edges_px=edge_to_edge_px(image, reading) if ends_on_edges else float("nan"),
        step_px=reading.step_px,
        step_mm=step_mm,
        cover=reading.length_px / image.shape[1],
        reading=reading,
        image=image,
    )


def check_view(
    view: TrueView,
    scene: Scene,
    feature: Target,
    target: Target,
    planned_px: float,
    window: Window | None = None,
) -> ImageCheck:
    """Look through the true lens at a ruler on the target, and measure.

    Parameters
    ----------
    view
        Camera, pose and lens, as they truly are.
    scene
        The part.
    feature
        A segment, along the rows of the image.
    target
        The face that it lies on.
    planned_px
        Length of the feature in the image by the plan.
    window
        The part of the image to form, over all columns; None for all of it.

    Returns
    -------
    ImageCheck
        What the picture shows.
    """
    image = render_view(view, scene, target, [ruler_decal(feature, target)], window)
    return check_picture(image, feature, target, planned_px)


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


def _on_outline(points_mm: FloatArray, target: Target) -> bool:
    """Whether all points lie on edges of the target."""
    a = target.vertices_mm
    edge = np.roll(a, -1, axis=0) - a
    to_point = points_mm[:, None] - a
    share = np.clip((to_point * edge).sum(-1) / (edge**2).sum(-1), 0.0, 1.0)
    off = np.linalg.norm(to_point - share[..., None] * edge, axis=-1).min(axis=1)
    return bool((off <= _TOUCHING * target.size_mm).all())
