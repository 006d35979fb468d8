"""Resolution: a short piece of the feature must cover so many samples, (9) and (10)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, positive
from lenscal.optics import resolution_limit
from lenscal.sensor import Axis, Sensor
from planning.half_spaces import HalfSpaces
from planning.lens_states import LensStates
from planning.requirements.margin import Margin, margin_over
from planning.sensor_points import SensorPoints
from planning.views import Subject, Views

#: Places along an edge at which a piece is measured where the lens distorts. Without distortion the
#: worst piece lies at an end.
_PLACES: Final = 7
#: Shares of its three corners at the places of a lattice over a triangle, with as many on a side,
#: and which of them lie along the sides.
_LATTICE: Final = np.array(
    [(_PLACES - 1 - i - j, i, j) for i in range(_PLACES) for j in range(_PLACES - i)]
) / (_PLACES - 1)
_SIDES: Final = [np.flatnonzero(_LATTICE[:, k] == 0) for k in range(3)]
#: How far, as a share, a feature may be from perpendicular to count as such.
_PERPENDICULAR: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Resolution:
    """At least so many frame-buffer samples on every piece of the feature of a given length.

    Of a segment, that is every piece along it. Of a face it is every short piece in any direction
    on it, also foreshortened: the smallest singular value of the face's image.

    Parameters
    ----------
    pixels
        How many samples.
    length_mm
        The length l that they must cover, in mm. Of a feature that is shorter, in proportion.
    axis
        The image axis along which the feature lies; "any" when the roll of the camera is unknown:
        then the coarser pitch counts.

    Raises
    ------
    InputError
        When a number is not positive.
    """

    pixels: float
    length_mm: float
    axis: Axis = "any"

    def __post_init__(self) -> None:
        positive("pixels", self.pixels, "px")
        positive("length_mm", self.length_mm, "mm")

    @property
    def name(self) -> str:
        """``resolution``."""
        return "resolution"

    def magnification_bounds(self, sensor: Sensor) -> tuple[float, float]:
        """Give the lowest d/D that resolves, w/l of (9).

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        tuple of float
            w/l and infinity.
        """
        return resolution_limit(sensor, self.pixels, self.length_mm, self.axis), float("inf")

    def orthogonal_margin(self, magnification: npt.ArrayLike, sensor: Sensor) -> Margin:
        """Judge magnifications, for an orthogonal, centred view without distortion.

        Parameters
        ----------
        magnification
            (...) d/D.
        sensor
            The sensor.

        Returns
        -------
        Margin
            (...) by which share d/D exceeds w/l.
        """
        limit = self.magnification_bounds(sensor)[0]
        share: FloatArray = np.asarray(magnification, dtype=np.float64) / limit - 1.0
        return Margin(share * limit, "d/D", share, self.describe(sensor))

    def margin(self, views: Views) -> Margin:
        """Judge views with the whole camera model.

        Parameters
        ----------
        views
            V × S views.

        Returns
        -------
        Margin
            (V, S) by how many samples the worst piece exceeds what it must cover. Without
            distortion it is exact for a segment; for a face the piece is taken to be infinitely
            short, which is never too good. With distortion pieces are measured at seven places of
            an edge, or on a lattice over the face, and what the worst one between them may lack, by
            the second differences, is taken off.
        """
        sensor = views.states.sensor
        if views.subject.seen_feature.is_segment:
            per_mm = self._along_segment(views)
        else:
            per_mm = self._on_face(views)
        samples = per_mm * (self.length_mm / sensor.sample_spacing_mm(self.axis))
        lacking = samples - self.pixels
        lacking[np.broadcast_to(~views.in_front, lacking.shape)] = -np.inf
        return margin_over(views, lacking, "px", lacking / self.pixels, self.describe(sensor))

    def half_spaces(self, rotation: FloatArray, states: LensStates, subject: Subject) -> HalfSpaces:
        """Bound the distance of a feature that is seen perpendicularly.

        Parameters
        ----------
        rotation
            (3, 3) of part_from_camera.
        states
            One lens state.
        subject
            What is looked at.

        Returns
        -------
        HalfSpaces
            D ≤ d/(w/l), for the pinhole. None at all where the feature is seen obliquely, or the
            lens distorts: then the set is not polyhedral, and the margin has the last word.
        """
        axis = rotation[:, 2]
        corners = subject.seen_feature.vertices_mm
        depths = corners @ axis
        oblique = np.ptp(depths) > _PERPENDICULAR * subject.seen_feature.size_mm
        if oblique or states.sensor_points.distorts:
            return HalfSpaces.everywhere()
        turn = 1.0
        if subject.seen_feature.is_segment and self.axis != "any":
            edge = corners[1] - corners[0]
            turn = abs(float(edge @ rotation[:, "xy".index(self.axis)])) / float(
                np.linalg.norm(edge)
            )
        limit = self.magnification_bounds(states.sensor)[0]
        farthest = turn * float(states.image_distance_mm[0]) / limit
        return HalfSpaces.slab(axis, corners[0], 0.0, farthest)

    def describe(self, sensor: Sensor) -> str:
        """Say what is asked and what it means for d/D.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "resolution of 3 px on 0.254 mm along x (d/D ≥ 0.1919)".
        """
        along = "" if self.axis == "any" else f" along {self.axis}"
        limit = self.magnification_bounds(sensor)[0]
        return (
            f"resolution of {self.pixels:g} px on {self.length_mm:g} mm{along} (d/D ≥ {limit:.4f})"
        )

    def _along_segment(self, views: Views) -> FloatArray:
        """(S, V) mm on the sensor per mm of the worst piece."""
        points = views.states.sensor_points
        start, stop = ([c[:, k : k + 1] for c in views.feature_in_camera_mm] for k in range(2))
        length = views.subject.seen_feature.size_mm
        piece = min(self.length_mm, length)
        count = 1 if piece == length else _PLACES if points.distorts else 2
        begin = np.linspace(0.0, 1.0 - piece / length, count)[:, None]
        ends = []
        for share in (begin, begin + piece / length):
            x, y, z = (a + share * (b - a) for a, b in zip(start, stop, strict=True))
            with np.errstate(divide="ignore", invalid="ignore"):
                ends.append(points.project(x / z, y / z))
        across, down = (b - a for a, b in zip(*ends, strict=True))
        along = {"x": lambda: np.abs(across), "y": lambda: np.abs(down)}.get(
            self.axis, lambda: np.hypot(across, down)
        )()
        return _worst_of_places(along) / piece

    def _on_face(self, views: Views) -> FloatArray:
        """(S, V) mm on the sensor per mm of the worst direction at the worst place."""
        points = views.states.sensor_points
        x, y, z = views.feature_in_camera_mm
        if not points.distorts:
            return np.asarray(_worst_direction(views, points, x, y, z).min(axis=1))
        middle = [c.mean(axis=1, keepdims=True) for c in (x, y, z)]
        worst, bend = [], []
        for k in range(x.shape[1]):
            # A lattice over the triangle between the middle and two neighbouring corners.
            around = [k, (k + 1) % x.shape[1]]
            triangle = (
                np.concatenate([m, c[:, around]], axis=1)
                for m, c in zip(middle, (x, y, z), strict=True)
            )
            places = (np.einsum("nk,pkv->pnv", _LATTICE, corners) for corners in triangle)
            values = _worst_direction(views, points, *places)
            worst.append(values.min(axis=1))
            bend.append(np.maximum.reduce([_bend(values[:, side]) for side in _SIDES]))
        # No place is farther than 0.6 steps from one of the lattice: a parabola falls by less than
        # a fifth of its second difference.
        return np.asarray(np.minimum.reduce(worst) - np.maximum.reduce(bend) / 4)


def _worst_of_places(values: FloatArray) -> FloatArray:
    """(S, V) lowest of (S, K, V) values, less what they may fall short of it between the places."""
    worst: FloatArray = values.min(axis=1)
    if values.shape[1] > 2:
        # A parabola falls by an eighth of its second difference between two places.
        worst = worst - _bend(values) / 6
    return worst


def _bend(values: FloatArray) -> FloatArray:
    """(S, V) largest second difference of (S, K, V) values."""
    second = values[:, 2:] - 2 * values[:, 1:-1] + values[:, :-2]
    return np.asarray(np.abs(second, out=second).max(axis=1))


def _worst_direction(
    views: Views, points: SensorPoints, x: FloatArray, y: FloatArray, z: FloatArray
) -> FloatArray:
    """(S, N, V) smallest singular value of the image of the face at points of it, mm per mm."""
    normal = views.subject.seen_feature.normal
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    plane = np.stack([first, np.cross(normal, first)])
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = x / z, y / z
        columns = []
        for direction in plane:
            a, b, c = (
                np.moveaxis(views.rotations.transpose(1, 2, 3, 0), 2, 0).transpose(0, 1, 3, 2)
                @ direction
            )
            columns.append(((a[:, None] - u * c[:, None]) / z, (b[:, None] - v * c[:, None]) / z))
        u_mm, v_mm = points.project(u, v)
        xx, xy, yx, yy = points.stretch(u_mm, v_mm)
    (a, c), (b, d) = columns
    # J = stretch @ [[a, b], [c, d]]
    j11, j12, j21, j22 = xx * a + xy * c, xx * b + xy * d, yx * a + yy * c, yx * b + yy * d
    total = j11**2 + j12**2 + j21**2 + j22**2
    area = np.abs(j11 * j22 - j12 * j21)
    largest = np.sqrt((total + np.sqrt(np.maximum(total**2 - 4 * area**2, 0.0))) / 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        smallest: FloatArray = np.where(largest > 0, area / largest, 0.0)
    distance = views.states.image_distance_mm[:, None, None]
    return smallest * distance + 0.0 * u_mm
