"""Depth of field: no point of the feature is blurred by more than is permitted, a·d·|1/z − 1/D|."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import brentq

from lenscal import optics
from lenscal.arrays import FloatArray, positive
from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.fixed_lens import FixedLens
from planning.half_spaces import HalfSpaces
from planning.lens_states import LensStates
from planning.requirements.margin import Margin, margin_over
from planning.views import Subject, Views

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

#: Diameter of the first dark ring of Airy's disk over λ and the working f-number.
_AIRY: Final = 2.44


@dataclass(frozen=True, slots=True)
class DepthOfField:
    """Every point of a feature with depth is in focus, to within a circle of confusion.

    Blur is that of the perspective quantities that the calibration gives: with the entrance-pupil
    diameter a, a point at depth z along the optical axis is spread over a·d·|1/z − 1/D| on the
    sensor, exactly so for a thick lens. Distortion, which stretches the circle by a few parts in a
    hundred at most, is not counted.

    Parameters
    ----------
    depth_mm
        The depth of the feature: points of it may lie by half of that nearer or farther, along the
        optical axis, than the flat outline that is drawn. Zero for a flat one.
    blur_px
        The permitted diameter of the circle of confusion in samples, of the finer pitch.
    wavelength_nm
        When it is given, diffraction counts too: the blur is √(c² + (2.44 λ d/a)²) [the usual
        approximation], so that a small aperture blurs as well.

    Raises
    ------
    InputError
        When the depth is negative, or another number is not positive.
    """

    depth_mm: float
    blur_px: float
    wavelength_nm: float | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.depth_mm) and self.depth_mm >= 0):
            raise InputError(f"depth_mm must be zero or a positive number, but is {self.depth_mm}")
        positive("blur_px", self.blur_px, "px")
        if self.wavelength_nm is not None:
            positive("wavelength_nm", self.wavelength_nm, "nm")

    @property
    def name(self) -> str:
        """``depth_of_field``."""
        return "depth_of_field"

    def permitted_mm(self, sensor: Sensor) -> float:
        """Give the permitted circle of confusion on the sensor.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        float
            c in mm.
        """
        return self.blur_px * float(sensor.sample_pitch_mm.min())

    def margin(self, views: Views) -> Margin:
        """Judge views with the whole camera model.

        Parameters
        ----------
        views
            V × S views.

        Returns
        -------
        Margin
            (V, S) permitted less actual diameter of the blur in samples, at the worst corner.

        Raises
        ------
        PlanningError
            When the entrance pupil is not known.
        """
        sensor, distance = views.states.sensor, views.states.image_distance_mm
        pupil = _pupil_mm(views.states)
        permitted = self.permitted_mm(sensor)
        blur = self._defocus(views)
        blur *= (pupil * distance)[:, None]
        if self.wavelength_nm is not None:
            blur = np.hypot(blur, self._diffraction_mm(distance, pupil)[:, None])
        blur *= -1.0 / permitted
        blur += 1.0
        return margin_over(views, blur * self.blur_px, "px", blur, self.describe(sensor))

    def aperture_bounds_mm(self, views: Views) -> tuple[FloatArray, FloatArray]:
        """Give the largest and, with diffraction, the smallest entrance pupil that is good enough.

        Parameters
        ----------
        views
            V × S views; their own pupils do not matter.

        Returns
        -------
        smallest_mm, largest_mm : FloatArray
            (V, S) a in mm: 0 and c / (d · max |1/z − 1/D|) without diffraction, which is infinite
            for a flat feature in the sharp plane. NaN where no aperture will do.
        """
        distance = views.states.image_distance_mm[:, None]
        defocus = self._defocus(views) * distance
        permitted = self.permitted_mm(views.states.sensor)
        defocus = np.broadcast_to(defocus, (views.shape[1], views.shape[0]))
        if self.wavelength_nm is None:
            with np.errstate(divide="ignore"):
                largest = permitted / defocus
            return np.where(np.isnan(largest), np.nan, 0.0).T, largest.T
        # (a w)² + (b/a)² = c² is quadratic in a², with w the defocus times d and b = 2.44 λ d.
        spread = np.broadcast_to(_AIRY * self.wavelength_nm * 1e-6 * distance, defocus.shape)
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(permitted**4 - 4 * (defocus * spread) ** 2)
            # The smaller root by the product of both, which loses no digits.
            smallest = spread * np.sqrt(2 / (permitted**2 + root))
            largest = np.sqrt((permitted**2 + root) / 2) / defocus
        return smallest.T, largest.T

    def object_distance_bounds_mm(self, lens: FixedLens) -> tuple[float, float]:
        """Give the nearest D at which a feature that is seen orthogonally is in focus.

        With h half the depth, h / (D (D − h)) ≤ c (D − f) / (a f D) is quadratic in D.

        Parameters
        ----------
        lens
            The lens, focused at the middle of the feature.

        Returns
        -------
        tuple of float
            The nearest D in mm, and infinity.

        Raises
        ------
        PlanningError
            When the lens has no entrance pupil, or diffraction alone blurs too much at any D.
        """
        if lens.entrance_pupil_diameter_mm is None:
            raise PlanningError(_NO_PUPIL)
        pupil, focal, half = (
            lens.entrance_pupil_diameter_mm,
            lens.focal_length_mm,
            self.depth_mm / 2,
        )
        permitted = self.permitted_mm(lens.sensor)
        excess = 4 * pupil * focal * half / permitted
        nearest = (focal + half + np.sqrt((focal - half) ** 2 + excess)) / 2
        if self.wavelength_nm is None:
            return float(nearest), float("inf")
        airy = _AIRY * self.wavelength_nm * 1e-6 * focal / pupil
        if airy >= permitted:
            raise PlanningError(self._diffracts(airy / permitted, pupil))

        # Diffraction adds to the blur, which falls with D still.
        def spare(vergence: float) -> float:
            image_distance = focal / (1 - focal * vergence)
            defocus = 1.0 / (1.0 / vergence - half) - vergence if vergence else 0.0
            blur = np.hypot(pupil * image_distance * defocus, airy * image_distance / focal)
            return permitted - float(blur)

        at = 1 / nearest
        return 1 / float(brentq(spare, 0.0, at, xtol=1e-14)) if spare(at) < 0 else nearest, np.inf

    def half_spaces(self, rotation: FloatArray, states: LensStates, subject: Subject) -> HalfSpaces:
        """Bound the positions from which the feature is in focus: a slab across the axis.

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
            One or two, exact.

        Raises
        ------
        InputError
            When there is not exactly one lens state.
        PlanningError
            When the entrance pupil is not known, or diffraction alone blurs more than is permitted.
        """
        if len(states) != 1:
            raise InputError(
                f"half-spaces of positions are those of one lens state, but there are {len(states)}"
            )
        pupil, distance = _pupil_mm(states), states.image_distance_mm
        permitted = self.permitted_mm(states.sensor)
        if self.wavelength_nm is not None:
            spread = float(self._diffraction_mm(distance, pupil)[0])
            if spread >= permitted:
                raise PlanningError(self._diffracts(spread / permitted, float(pupil[0])))
            permitted = np.sqrt(permitted**2 - spread**2)
        near, far = optics.depth_of_field_mm(states.object_distance_mm, distance, pupil, permitted)
        axis, half = rotation[:, 2], self.depth_mm / 2
        depths = subject.seen_feature.vertices_mm @ axis
        spread_mm = float(np.ptp(depths))
        return HalfSpaces.slab(
            axis, axis * depths.min(), float(near[0]) + half, float(far[0]) - half - spread_mm
        )

    def describe(self, sensor: Sensor) -> str:  # noqa: ARG002
        """Say what is asked.

        Parameters
        ----------
        sensor
            The sensor.

        Returns
        -------
        str
            Such as "depth of field of 4 mm within 1.5 px of blur".
        """
        waves = "" if self.wavelength_nm is None else f" at {self.wavelength_nm:g} nm"
        return f"depth of field of {self.depth_mm:g} mm within {self.blur_px:g} px of blur{waves}"

    def _diffracts(self, times: float, pupil_mm: float) -> str:
        return (
            f"diffraction alone blurs by {times * self.blur_px:.3g} px at an entrance pupil of "
            f"{pupil_mm:.3g} mm, more than the {self.blur_px:g} px that are permitted; open the "
            "iris"
        )

    def _defocus(self, views: Views) -> FloatArray:
        """(S, V) largest |1/z − 1/D| of the feature in 1/mm; NaN where it is not in front."""
        depth = views.feature_in_camera_mm[2]
        half = self.depth_mm / 2
        near, far = depth.min(axis=1) - half, depth.max(axis=1) + half
        near = np.where(near > 0, near, np.nan)
        sharp = 1.0 / views.states.object_distance_mm[:, None]
        worst: FloatArray = np.maximum(1.0 / near - sharp, sharp - 1.0 / far)
        return worst

    def _diffraction_mm(self, image_distance_mm: FloatArray, pupil_mm: FloatArray) -> FloatArray:
        wavelength = 0.0 if self.wavelength_nm is None else self.wavelength_nm
        spread: FloatArray = _AIRY * wavelength * 1e-6 * image_distance_mm / pupil_mm
        return spread


def largest_aperture_mm(
    near_mm: FloatArray, far_mm: FloatArray, image_distance_mm: FloatArray, blur_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Focus so that the aperture can be opened as far as depths allow: the middle in dioptres.

    Parameters
    ----------
    near_mm, far_mm
        (...) nearest and farthest depth along the axis in mm.
    image_distance_mm
        (...) d in mm.
    blur_mm
        Permitted circle of confusion on the sensor in mm.

    Returns
    -------
    object_distance_mm, entrance_pupil_diameter_mm : FloatArray
        (...) D at 1/D = ½ (1/near + 1/far), and a = 2 c / (d (1/near − 1/far)), in mm.

    Raises
    ------
    InputError
        When the depths are not positive and in this order.
    """
    near, far = np.asarray(near_mm, dtype=np.float64), np.asarray(far_mm, dtype=np.float64)
    if not ((near > 0) & (near <= far)).all():
        raise InputError("depths must be positive, the nearest before the farthest")
    positive("blur_mm", blur_mm, "mm")
    with np.errstate(divide="ignore"):
        aperture = 2 * blur_mm / (np.asarray(image_distance_mm) * (1 / near - 1 / far))
    return np.asarray(2 / (1 / near + 1 / far)), np.asarray(aperture)


def widest_iris(
    lens: LensMap, zoom: FloatArray, focus: FloatArray, largest_mm: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Choose the recorded iris that opens widest without exceeding an entrance pupil.

    Parameters
    ----------
    lens
        A map that knows its entrance pupil.
    zoom, focus
        (S,) settings.
    largest_mm
        (S,) largest entrance pupil in mm, such as `DepthOfField.aperture_bounds_mm` gives.

    Returns
    -------
    iris, entrance_pupil_diameter_mm : FloatArray
        (S,) NaN both where even the smallest recorded pupil is too large. A lens that does not tell
        its iris has NaN for the iris and its one pupil.

    Raises
    ------
    PlanningError
        When the map knows no entrance pupil.
    """
    if lens.pupil is None:
        raise PlanningError(_NO_PUPIL)
    irises = lens.pupil.irises
    asked = [None] if np.isnan(irises[0]) else list(irises)
    pupils = np.stack([lens.entrance_pupil_diameter_mm(zoom, focus, iris) for iris in asked])
    allowed = np.where(pupils <= largest_mm, pupils, -np.inf)
    best = allowed.argmax(axis=0)
    found = allowed.max(axis=0)
    none = np.isinf(found)
    return np.where(none, np.nan, irises[best]), np.where(none, np.nan, found)


_NO_PUPIL: Final = (
    "depth of field and the pupil's own visibility need the entrance-pupil diameter, which is not "
    "known here; name an iris at which the map knows it, calibrate a session whose autofocus "
    "measures by edge_width, or give FixedLens(..., entrance_pupil_diameter_mm=...)"
)


def _pupil_mm(states: LensStates) -> FloatArray:
    if states.entrance_pupil_diameter_mm is None:
        raise PlanningError(_NO_PUPIL)
    return states.entrance_pupil_diameter_mm
