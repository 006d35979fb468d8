"""Checking a viewpoint with a camera that is taken to be the truth, by code of its own.

Nothing that the planner judges by is used. The feature is projected and counted; two rays from the
rim of the pupil are followed through the sharp plane to the sensor; the angle to the normal is
measured; the exact test of the audit decides what hides the target from the centre and from the rim
of the pupil; and the surface of the camera body is held against the scene patch by patch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.pose import Pose
from planning.clearance_check import distance_as_far_as
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.margin import Requirement
from planning.requirements.resolution import Resolution
from planning.requirements.unvignetted import Unvignetted
from planning.requirements.visibility import Visibility
from planning.scene import Scene
from planning.solid import Solid
from planning.target import Target
from planning.visibility.exact_test import ExactTest

Image = Callable[[FloatArray], FloatArray]
Kind = TypeVar("Kind")
Given = TypeVar("Given")

#: Places along an edge at which a piece is counted, and points of an edge that are looked for.
_PLACES: Final = 101
_ALONG: Final = 33
#: Directions of pieces on a face, and their length as a share of the face's size.
_DIRECTIONS: Final = 24
_SHORT: Final = 1e-3
#: Points on circles in the pupil, at these shares of its radius, and points on a ball.
_ON_CIRCLE: Final = 32
_CIRCLES: Final = (1.0, 0.7, 0.4)
_ON_BALL: Final = 96
#: Diameter of the first dark ring of Airy's disk over λ and the working f-number.
_AIRY: Final = 2.44


@dataclass(frozen=True, slots=True)
class Verification:
    """What a camera at a viewpoint really sees.

    Of what is not asked for, the value is told where it can be, and the answer is True.

    Parameters
    ----------
    feature_px
        Length of the longest edge of the feature in the image, in px.
    pixels_per_mm
        Samples per mm on the worst piece of the feature, in the image as it is.
    resolved
        Whether every resolution requirement is met on every piece of the feature.
    in_view
        Whether the feature lies on the sensor.
    target_in_view
        Whether the whole target lies on the sensor; for information, no requirement asks it.
    visible
        Whether nothing hides any point of the target from the projection centre, and from a ball
        about it where a distance from the border of the region is asked for.
    blur_px
        Largest circle of confusion on the feature, in samples; NaN where no depth of field is asked
        for.
    in_focus
        Whether it is small enough.
    incidence_deg
        Largest angle to the normal of the target on the feature; NaN for a segment as the target.
    seen_steeply
        Whether it is small enough.
    clearance_mm
        Distance of the camera body from the scene, see `distance_as_far_as`; NaN where no clearance
        is asked for.
    clear
        Whether it is large enough.
    unvignetted
        Whether nothing hides any point of the target from the entrance pupil.
    """

    feature_px: float
    pixels_per_mm: float
    resolved: bool
    in_view: bool
    target_in_view: bool
    visible: bool
    blur_px: float = float("nan")
    in_focus: bool = True
    incidence_deg: float = float("nan")
    seen_steeply: bool = True
    clearance_mm: float = float("nan")
    clear: bool = True
    unvignetted: bool = True

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the requirements that are not met; visibility is always one."""
        answers = {
            "resolution": self.resolved,
            "field_of_view": self.in_view,
            "visibility": self.visible,
            "depth_of_field": self.in_focus,
            "incidence": self.seen_steeply,
            "clearance": self.clear,
            "unvignetted": self.unvignetted,
        }
        return tuple(name for name, holds in answers.items() if not holds)

    @property
    def satisfied(self) -> bool:
        """Whether all that was asked is met, and the target visible."""
        return not self.failed


def verify_viewpoint(
    camera: Camera,
    part_from_camera: Pose,
    target: Target,
    feature: Target,
    requirements: Sequence[Requirement],
    scene: Scene,
    *,
    object_distance_mm: float | None = None,
    entrance_pupil_diameter_mm: float | None = None,
    projection_centre_mm: FloatArray | None = None,
    workspace: Solid | None = None,
    exact_test: ExactTest | None = None,
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
    object_distance_mm
        True distance of the plane in sharpest focus in mm; depth of field needs it.
    entrance_pupil_diameter_mm
        True diameter in mm; depth of field and an unvignetted pupil need it.
    projection_centre_mm
        (3,) the true projection centre in the frame of the reference camera in mm, whose axes are
        those of the camera; clearance needs it.
    workspace
        Where the projection centre may be, where that is to be checked: a pupil, or a ball about
        the centre, that is to be free must lie in it as well.
    exact_test
        The scene prepared for many viewpoints.

    Returns
    -------
    Verification
        What was found.

    Raises
    ------
    InputError
        When something that a requirement needs is not given.
    """
    exact_test = exact_test or ExactTest(scene)
    camera_from_part = part_from_camera.inverse()
    centre = part_from_camera.translation_mm

    def image(points_mm: FloatArray) -> FloatArray:
        return camera.project(camera_from_part.transform(points_mm))

    def free(points_mm: FloatArray) -> bool:
        within = workspace is None or bool(workspace.contains(points_mm).all())
        return within and bool(exact_test.sees(points_mm, target).all())

    def asked(kind: type[Kind]) -> list[Kind]:
        return [r for r in requirements if isinstance(r, kind)]

    truth = _Truth(camera, part_from_camera, object_distance_mm, entrance_pupil_diameter_mm)
    lengths = np.linalg.norm(np.diff(image(_edges(feature)), axis=1)[:, 0], axis=-1)
    densities = [_worst_density(image, camera, feature, r) for r in asked(Resolution)]
    blurs = [truth.blur_px(r, feature) for r in asked(DepthOfField)]
    incidence = _incidence_deg(centre, target, feature)
    gaps = [_gap_mm(r, part_from_camera, projection_centre_mm, scene) for r in asked(Clearance)]
    pupils = [truth.pupil_points_mm(r) for r in asked(Unvignetted)]
    balls = [_ball(centre, r.distance_mm) for r in asked(Visibility)]
    return Verification(
        feature_px=float(lengths[np.argmax(_lengths(feature))]),
        pixels_per_mm=min(densities, default=np.nan),
        resolved=all(
            got >= r.pixels / r.length_mm
            for got, r in zip(densities, asked(Resolution), strict=True)
        ),
        in_view=not asked(FieldOfView) or _on_sensor(image, camera, feature),
        target_in_view=_on_sensor(image, camera, target),
        visible=all(free(points) for points in [centre[None], *balls]),
        blur_px=max(blurs, default=np.nan),
        in_focus=all(got <= r.blur_px for got, r in zip(blurs, asked(DepthOfField), strict=True)),
        incidence_deg=incidence,
        seen_steeply=all(incidence <= r.max_angle_deg for r in asked(Incidence)),
        clearance_mm=min(gaps, default=np.nan),
        clear=all(got >= r.distance_mm for got, r in zip(gaps, asked(Clearance), strict=True)),
        unvignetted=all(free(points) for points in pupils),
    )


@dataclass(frozen=True, slots=True)
class _Truth:
    """What the pupil and the sharp plane truly are, as far as it was given."""

    camera: Camera
    part_from_camera: Pose
    object_distance_mm: float | None
    entrance_pupil_diameter_mm: float | None

    def blur_px(self, requirement: DepthOfField, feature: Target) -> float:
        """Follow rays from opposite points of the pupil's rim through points of the feature.

        Where they pass the sharp plane is where they are imaged, as of any point of that plane.
        """
        sharp = _needed(self.object_distance_mm, "object_distance_mm", requirement)
        pupil = self._pupil_mm(requirement)
        distance = self.camera.image_distance_mm
        points = self.part_from_camera.inverse().transform(feature.vertices_mm)
        half = np.array([0.0, 0.0, requirement.depth_mm / 2])
        points = np.concatenate([points - half, points + half])
        if (points[:, 2] <= 0).any():
            return float("inf")
        rims = pupil / 2 * np.array([[[1.0, 0, 0]], [[-1.0, 0, 0]]])
        passes = rims + (points - rims) * (sharp / points[:, 2:])
        spread = np.linalg.norm(np.diff(passes, axis=0)[0], axis=-1) * distance / sharp
        if requirement.wavelength_nm is not None:
            spread = np.hypot(spread, _AIRY * requirement.wavelength_nm * 1e-6 * distance / pupil)
        return float(spread.max() / self.camera.sensor.sample_pitch_mm.min())

    def pupil_points_mm(self, requirement: Unvignetted) -> FloatArray:
        """(K, 3) points of the entrance pupil: its rim and circles within."""
        circle = self._pupil_mm(requirement) / 2 * _circle(np.array([0.0, 0, 1]), _ON_CIRCLE)
        points = np.concatenate([share * circle for share in _CIRCLES])
        return self.part_from_camera.transform(points)

    def _pupil_mm(self, requirement: Requirement) -> float:
        name = "entrance_pupil_diameter_mm"
        return _needed(self.entrance_pupil_diameter_mm, name, requirement)


def _needed(value: Given | None, name: str, requirement: Requirement) -> Given:
    if value is None:
        raise InputError(
            f"{requirement.name} cannot be verified without the truth about it; give "
            f"verify_viewpoint(..., {name}=...)"
        )
    return value


def _edges(feature: Target) -> FloatArray:
    """(E, 2, 3) ends of the edges of all outlines in mm."""
    pairs = [
        np.stack([feature.vertices_mm[loop], feature.vertices_mm[np.roll(loop, -1)]], axis=1)
        for loop in feature.loops
    ]
    return np.concatenate(pairs)


def _lengths(feature: Target) -> FloatArray:
    return np.asarray(np.linalg.norm(np.diff(_edges(feature), axis=1)[:, 0], axis=-1))


def _on_sensor(image: Image, camera: Camera, feature: Target) -> bool:
    """Whether all points along the edges are imaged on the sensor: a lens may bend them."""
    start, stop = np.moveaxis(_edges(feature)[:, :, None], 1, 0)
    points = start + np.linspace(0, 1, _ALONG)[:, None] * (stop - start)
    return bool(camera.sensor.contains(image(points)).all())


def _worst_density(image: Image, camera: Camera, feature: Target, requirement: Resolution) -> float:
    """Samples per mm on the worst piece: of the required length along a segment, short on a face.

    Along no stated axis the coarser spacing of samples counts, as the roll is free.
    """
    spacing = camera.sensor.sample_pitch_mm / camera.sensor.sample_spacing_mm(requirement.axis)

    def samples(start: FloatArray, stop: FloatArray) -> FloatArray:
        covered = np.abs(image(stop) - image(start)) * spacing
        if feature.is_segment and requirement.axis != "any":
            return covered[..., "xy".index(requirement.axis)]
        return np.asarray(np.linalg.norm(covered, axis=-1))

    if feature.is_segment:
        a, b = feature.vertices_mm
        whole = float(np.linalg.norm(b - a))
        piece = min(requirement.length_mm, whole)
        offsets = np.linspace(0.0, whole - piece, _PLACES)[:, None]
        along = (b - a) / whole
        return float(samples(a + offsets * along, a + (offsets + piece) * along).min()) / piece
    places = np.concatenate([_edges(feature).reshape(-1, 3), feature.centroid_mm[None]])
    inner = (places[:, None] + places) / 2
    piece = _SHORT * feature.size_mm
    step = _circle(feature.normal, _DIRECTIONS) * piece / 2
    middles = inner.reshape(-1, 1, 3)
    return float(samples(middles - step, middles + step).min()) / piece


def _circle(normal: FloatArray, count: int) -> FloatArray:
    """(count, 3) unit vectors across a normal."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    return np.asarray(np.cos(angles) * first + np.sin(angles) * np.cross(normal, first))


def _incidence_deg(centre: FloatArray, target: Target, feature: Target) -> float:
    if target.is_segment:
        return float("nan")
    towards = centre - feature.vertices_mm
    height = towards @ target.normal
    aside = np.linalg.norm(towards - height[:, None] * target.normal, axis=-1)
    return float(np.degrees(np.arctan2(aside, height)).max())


def _gap_mm(
    requirement: Clearance, part_from_camera: Pose, centre_mm: FloatArray | None, scene: Scene
) -> float:
    centre = _needed(centre_mm, "projection_centre_mm", requirement)
    part_from_body = part_from_camera @ Pose(np.eye(3), -np.asarray(centre))
    return distance_as_far_as(requirement.body, part_from_body, scene, requirement.distance_mm)


def _ball(centre: FloatArray, radius_mm: float) -> FloatArray:
    """(K, 3) points on a ball, evenly spread by golden angles."""
    height = 1 - (2 * np.arange(_ON_BALL) + 1) / _ON_BALL
    around = np.sqrt(1 - height**2)
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(_ON_BALL)
    unit = np.stack([around * np.cos(angle), around * np.sin(angle), height], axis=-1)
    return np.asarray(centre + radius_mm * unit)
