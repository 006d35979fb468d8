"""Verification in the image, as in section 1.5.3 of the paper: a ruler lies on the target.

The true camera looks at the part; pixels per length and cover of the frame are read off the picture
and compared with what was planned. Nothing is projected to measure.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import PlanningError
from lenscal.imaging.decal import Decal
from lenscal.imaging.ruler import Ruler
from lenscal.sensor import Window
from lenscal.units import MM_PER_INCH
from planning.ruler_reading import RulerReading, edge_to_edge_px, read_ruler
from planning.scene import Scene
from planning.target import Target
from planning.true_view import TrueView, render_view

#: Ticks of the ruler in the paper's pictures are counted in steps of 0.02 in.
STEP_MM: Final = 0.02 * MM_PER_INCH
#: How near to an edge of the target a point lies on it, as a share of the target's size.
_TOUCHING: Final = 1e-6


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


def _on_outline(points_mm: FloatArray, target: Target) -> bool:
    """Whether all points lie on edges of the target."""
    a = target.vertices_mm
    edge = np.roll(a, -1, axis=0) - a
    to_point = points_mm[:, None] - a
    share = np.clip((to_point * edge).sum(-1) / (edge**2).sum(-1), 0.0, 1.0)
    off = np.linalg.norm(to_point - share[..., None] * edge, axis=-1).min(axis=1)
    return bool((off <= _TOUCHING * target.size_mm).all())
