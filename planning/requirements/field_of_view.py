"""Field of view: the whole feature must land on the sensor, (11) and (12) of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, positive
from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.optics import field_of_view_limit
from lenscal.sensor import Axis, Sensor
from planning.half_spaces import HalfSpaces
from planning.lens_states import LensStates
from planning.requirements.margin import Margin, margin_over
from planning.views import Subject, Views

#: Parts of an edge whose ends are projected where the lens distorts, so that it may bulge.
_PARTS: Final = 4
#: How much longer, as a share, a length may be by rounding.
_ROUNDING: Final = 1e-9
#: Places along each side of the sensor at which the distortion is undone for the half-spaces.
_BORDER: Final = 129


@dataclass(frozen=True, slots=True)
class FieldOfView:
    """A feature of a given length fits on the sensor when it is centred.

    In a general view it is the feature itself that must land on the sensor's rectangle; where the
    length is more than the size of the feature, the feature enlarged to it about its centroid.

    Parameters
    ----------
    length_mm
        The length L in mm.
    axis
        The image axis along which the feature lies; "any" when the roll of the camera is unknown:
        then the smaller side of the sensor counts.

    Raises
    ------
    InputError
        When the length is not positive.
    """

    length_mm: float
    axis: Axis = "any"

    def __post_init__(self) -> None:
        positive("length_mm", self.length_mm, "mm")

    @property
    def name(self) -> str:
        """``field_of_view``."""
        return "field_of_view"

    def magnification_bounds(self, sensor: Sensor) -> tuple[float, float]:
        """Give the highest d/D that does not truncate, I_min/L of (11).

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        tuple of float
            0 and I_min/L.
        """
        return 0.0, field_of_view_limit(sensor, self.length_mm, self.axis)

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
            (...) by which share d/D stays below I_min/L.
        """
        limit = self.magnification_bounds(sensor)[1]
        share: FloatArray = 1.0 - np.asarray(magnification, dtype=np.float64) / limit
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
            (V, S) distance of the outermost point of the feature from the border of the sensor, in
            samples; its share is of half the sensor's size. Where the lens distorts, an edge
            bulges: it is followed at five places, and what it may bulge between them, by the
            second differences, is taken off.
        """
        points, sensor = views.states.sensor_points, views.states.sensor
        enlarged = self._field_mm(views.subject)
        x, y, z = views.feature_in_camera_mm if enlarged is None else views.in_camera(enlarged)
        in_front = views.in_front if enlarged is None else (z > 0).all(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = x / z, y / z
        if points.distorts:
            x, y = _edges(x), _edges(y)
        pixels, shares = [], []
        for mm, centre, half, pitch in zip(
            points.project(x, y),
            views.states.principal_point_mm.T,
            (sensor.width_mm / 2, sensor.height_mm / 2),
            sensor.sample_pitch_mm,
            strict=True,
        ):
            outermost = _outermost(mm, centre[:, None], points.distorts)
            pixels.append((half - outermost) / pitch)
            shares.append(1.0 - outermost / half)
        value, share = np.minimum(*pixels), np.minimum(*shares)
        value[np.broadcast_to(~in_front, value.shape)] = -np.inf
        share[np.broadcast_to(~in_front, share.shape)] = -np.inf
        return margin_over(views, value, "px", share, self.describe(sensor))

    def half_spaces(self, rotation: FloatArray, states: LensStates, subject: Subject) -> HalfSpaces:
        """Bound the positions from which the feature lands on the sensor.

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
            Four, exact for the pinhole. Where the lens distorts, the sensor is replaced by a
            rectangle of ideal image points that all land on it: what is given up are its bulges.

        Raises
        ------
        InputError
            When there is not exactly one lens state.
        """
        if len(states) != 1:
            raise InputError(
                f"half-spaces of positions are those of one lens state, but there are {len(states)}"
            )
        low, high = _ideal_rectangle(states.cameras[0])
        enlarged = self._field_mm(subject)
        corners = subject.seen_feature.vertices_mm if enlarged is None else enlarged
        normals, offsets = [], []
        for k in range(2):
            # With p = t − r: low ≤ (x · p) / (v · p) ≤ high for every corner t.
            for normal in (
                rotation[:, k] - high[k] * rotation[:, 2],
                low[k] * rotation[:, 2] - rotation[:, k],
            ):
                normals.append(normal)
                offsets.append((corners @ normal).max())
        return HalfSpaces(np.array(normals), np.array(offsets))

    def describe(self, sensor: Sensor) -> str:
        """Say what is asked and what it means for d/D.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "field of view of 25.4 mm along x (d/D ≤ 0.3275)".
        """
        along = "" if self.axis == "any" else f" along {self.axis}"
        limit = self.magnification_bounds(sensor)[1]
        return f"field of view of {self.length_mm:g} mm{along} (d/D ≤ {limit:.4f})"

    def _field_mm(self, subject: Subject) -> FloatArray | None:
        """(N, 3) corners of the enlarged feature in mm; None where it needs no enlarging."""
        feature = subject.seen_feature
        times = self.length_mm / feature.size_mm
        if times <= 1 + _ROUNDING:
            return None
        corners: FloatArray = feature.centroid_mm + times * (
            feature.vertices_mm - feature.centroid_mm
        )
        return corners


def _edges(corners: FloatArray) -> FloatArray:
    """(P, E (M + 1), V) places along the edges of (P, N, V) corners, even in the ideal image."""
    count = 1 if corners.shape[1] == 2 else corners.shape[1]
    start, stop = corners[:, :count], np.roll(corners, -1, axis=1)[:, :count]
    share = np.linspace(0.0, 1.0, _PARTS + 1)[:, None]
    places = start[:, :, None] + share * (stop - start)[:, :, None]
    return places.reshape(len(corners), -1, corners.shape[2])


def _outermost(mm: FloatArray, centre: FloatArray, bulges: bool) -> FloatArray:
    """(S, V) largest distance of (S, N, V) places from the sensor's middle, with the bulges."""
    low, high = mm.min(axis=1), mm.max(axis=1)
    outermost: FloatArray = np.maximum(high + centre, -low - centre)
    if bulges:
        along = mm.reshape(len(mm), -1, _PARTS + 1, mm.shape[2])
        bend = np.abs(along[:, :, 2:] - 2 * along[:, :, 1:-1] + along[:, :, :-2]).max(axis=(1, 2))
        # A parabola bulges by an eighth of its second difference between two places.
        outermost += bend / 4
    return outermost


def _ideal_rectangle(camera: Camera) -> tuple[FloatArray, FloatArray]:
    """(2,) lowest and highest x/z, y/z of a rectangle whose image lies on the sensor.

    The border of the sensor, undistorted, is four curves. The rectangle that none of them enters is
    imaged to within the sensor. Between the places at which a curve is taken it may reach in by no
    more than its second difference.
    """
    sensor = camera.sensor
    size = np.array([sensor.width_px, sensor.height_px])
    low, high = np.zeros(2), np.zeros(2)
    share = np.linspace(0.0, 1.0, _BORDER)
    for k in range(2):
        side = np.zeros((_BORDER, 2))
        side[:, 1 - k] = share * size[1 - k] - 0.5
        for end, corner in ((0, -0.5), (1, size[k] - 0.5)):
            side[:, k] = corner
            distorted = (side - camera.centre_px) * sensor.sample_pitch_mm
            ideal = camera.undistort(distorted)[:, k] / camera.image_distance_mm
            slack = np.abs(np.diff(ideal, n=2)).max()
            if end:
                high[k] = ideal.min() - slack
            else:
                low[k] = ideal.max() + slack
    return low, high
