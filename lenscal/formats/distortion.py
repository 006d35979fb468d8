"""Distortion of other programs, which runs from undistorted to distorted, turned into ours.

Their map is inverted by Newton's method at a grid of pixels over the whole image; our
coefficients, of the opposite direction, follow by linear least squares. What the fit cannot follow
is stated in px.
"""

from __future__ import annotations

import dataclasses
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.sensor import Sensor

#: Pixels per side at which a conversion is fitted and judged.
_GRID: Final = 25
_NEWTON_STEPS: Final = 50
#: Step of the differences of normalised coordinates that make the Jacobian.
_STEP: Final = 1e-6
#: Radial terms that a converted camera gets at most, κ1 included, and when fewer are enough.
_MOST_TERMS: Final = 7
_CLOSE_PX: Final = 1e-3
#: Image sizes within which focal lengths and the principal point have to lie.
_LARGEST: Final = 10_000
#: How many coefficients OpenCV may state; those beyond the eighth have to be zero.
_COUNTS: Final = (0, 4, 5, 8, 12, 14)


class ConvertedCamera(NamedTuple):
    """A camera made from that of another program.

    Parameters
    ----------
    camera
        The camera.
    worst_error_px
        Largest distance on the sensor between its pixels and those of the original; infinite where
        the camera has no pixel for a ray of the original.
    undistorted
        (N, 2) directions x / z, y / z in which the original sees the pixels of `pixel_grid`.
    """

    camera: Camera
    worst_error_px: float
    undistorted: FloatArray

    def with_kappa_alone(self, scale_factor: float) -> ConvertedCamera:
        """Give the camera that a lens map can hold: one scale factor for all, and κ1 alone.

        Parameters
        ----------
        scale_factor
            The scale factor of the sensor of the map.

        Returns
        -------
        ConvertedCamera
            The camera, with the mean of what f_x and f_y say of d, compared with the original.
        """
        camera = self.camera
        sensor = dataclasses.replace(camera.sensor, scale_factor=scale_factor)
        distances = camera.image_distance_px * sensor.sample_pitch_mm
        bare = Camera(sensor, float(distances.mean()), principal_point_px=camera.centre_px)
        if camera.k1_per_mm2 or any((*camera.radial, *camera.decentring)):
            return fit_distortion(bare, self.undistorted, 1, decentred=False)
        return _compared(bare, self.undistorted)


def camera_from_matrix(
    matrix: npt.ArrayLike,
    coefficients: npt.ArrayLike,
    size_px: tuple[int, int],
    pitch_mm: float,
) -> ConvertedCamera:
    """Convert a camera in OpenCV's terms.

    Parameters
    ----------
    matrix
        (3, 3) camera matrix in px; pixel (0, 0) is the centre of the top-left pixel.
    coefficients
        k1, k2, p1, p2[, k3[, k4, k5, k6]] of normalised coordinates; may be empty.
    size_px
        Width and height of the image.
    pitch_mm
        Spacing of the sensor elements, without which pixels are no lengths.

    Returns
    -------
    ConvertedCamera
        The camera and the worst error.

    Raises
    ------
    InputError
        When the matrix is no camera matrix without skew, the number of coefficients is not
        OpenCV's, the matrix is out of proportion to the image, or the distortion folds within it.
    """
    full = frozen_array("camera matrix", matrix, (3, 3))
    focal, centre = np.diag(full)[:2], full[:2, 2]
    skewed = np.any(full[[0, 1, 2, 2], [1, 0, 0, 1]]) or full[2, 2] != 1
    if skewed or not (focal > 0).all():
        raise InputError(
            "wanted is a camera matrix [[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]], but given is "
            f"{full.tolist()}"
        )
    stated = frozen_array("distortion coefficients", np.ravel(np.asarray(coefficients)), ("N",))
    if len(stated) not in _COUNTS or np.any(stated[8:]):
        raise InputError(
            f"wanted are the distortion coefficients k1, k2, p1, p2[, k3[, k4, k5, k6]], but given "
            f"are {stated.tolist()}; thin prisms and tilted sensors are not modelled"
        )
    if not (np.abs(np.concatenate([focal, centre]) / max(size_px)) < _LARGEST).all():
        raise InputError(
            f"focal lengths {focal.tolist()} px and principal point {centre.tolist()} px are out "
            f"of proportion to an image of {size_px[0]} × {size_px[1]} px"
        )
    # The ratio of f_x to f_y goes into the scale factor, so that the matrix stays as it is.
    sensor = Sensor(*size_px, pitch_mm, pitch_mm, float(focal[1] / focal[0]))
    distance = float(focal[1]) * sensor.pitch_y_mm
    bare = Camera(sensor, distance, principal_point_px=centre)
    padded = np.concatenate([stated, np.zeros(8)])[:8]
    directions = (pixel_grid(sensor) - centre) / focal
    if not np.any(padded):
        return ConvertedCamera(bare, 0.0, directions)
    decentred, original = bool(np.any(padded[2:4])), _undistort(directions, padded)
    best = fit_distortion(bare, original, 1, decentred=decentred)
    for terms in range(2, _MOST_TERMS + 1):
        if best.worst_error_px < _CLOSE_PX:
            break
        # More terms are not always closer: the polynomial may turn round near the corners.
        fitted = fit_distortion(bare, original, terms, decentred=decentred)
        best = min(best, fitted, key=lambda converted: converted.worst_error_px)
    return best


def fit_distortion(
    camera: Camera, undistorted: FloatArray, radial_terms: int, *, decentred: bool
) -> ConvertedCamera:
    """Give a camera the distortion that a grid of pixels shows.

    Parameters
    ----------
    camera
        The camera without distortion.
    undistorted
        (N, 2) directions x / z, y / z in which it sees the pixels of `pixel_grid`.
    radial_terms
        How many radial terms, κ1 included.
    decentred
        Whether decentring is fitted too.

    Returns
    -------
    ConvertedCamera
        The camera that is closest to them in the image, and the largest distance that is left.
    """
    distorted = (pixel_grid(camera.sensor) - camera.centre_px) * camera.sensor.sample_pitch_mm
    ideal_mm = undistorted * camera.image_distance_mm
    x, y = distorted.T
    squared = x**2 + y**2
    columns = [distorted * squared[:, None] ** power for power in range(1, radial_terms + 1)]
    if decentred:
        columns.append(np.stack([2 * x * y, squared + 2 * y**2], axis=-1))
        columns.append(np.stack([squared + 2 * x**2, 2 * x * y], axis=-1))
    # Where distortion stretches the undistorted image, an error there is a small one in the image.
    to_pixels = _pixels_per_mm(camera, ideal_mm)
    design = np.einsum("nij,njp->nip", to_pixels, np.stack(columns, axis=-1))
    wanted = np.einsum("nij,nj->ni", to_pixels, ideal_mm - distorted).ravel()
    design = design.reshape(len(wanted), -1)
    scale = np.linalg.norm(design, axis=0)
    solution = np.linalg.lstsq(design / scale, wanted, rcond=None)[0] / scale
    fitted = solution.tolist()
    converted = Camera(
        camera.sensor,
        camera.image_distance_mm,
        fitted[0],
        camera.principal_point_px,
        tuple(fitted[1:radial_terms]),
        (fitted[-2], fitted[-1]) if decentred else (0.0, 0.0),
    )
    return _compared(converted, undistorted)


def pixel_grid(sensor: Sensor) -> FloatArray:
    """Lay a grid of pixels over the whole image, its outer edges included.

    Parameters
    ----------
    sensor
        The sensor.

    Returns
    -------
    FloatArray
        (N, 2) pixels (x, y), row by row.
    """
    return np.stack(np.meshgrid(*_axes(sensor)), axis=-1).reshape(-1, 2)


def _axes(sensor: Sensor) -> tuple[FloatArray, FloatArray]:
    across = np.linspace(-0.5, sensor.width_px - 0.5, _GRID)
    down = np.linspace(-0.5, sensor.height_px - 0.5, _GRID)
    return across, down


def _pixels_per_mm(camera: Camera, ideal_mm: FloatArray) -> FloatArray:
    """(N, 2, 2) how pixels move with undistorted coordinates, by differences over the grid."""
    across, down = _axes(camera.sensor)
    grid = ideal_mm.reshape(_GRID, _GRID, 2)
    along = np.stack(
        [
            np.gradient(grid, across, axis=1, edge_order=2),
            np.gradient(grid, down, axis=0, edge_order=2),
        ],
        axis=-1,
    )
    return np.asarray(np.linalg.inv(along).reshape(-1, 2, 2))


def _compared(camera: Camera, undistorted: FloatArray) -> ConvertedCamera:
    found = camera.project(np.column_stack([undistorted, np.ones(len(undistorted))]))
    error = np.linalg.norm(found - pixel_grid(camera.sensor), axis=-1)
    worst = np.inf if np.isnan(error).any() else float(error.max())
    return ConvertedCamera(camera, worst, undistorted)


def _undistort(wanted: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Invert OpenCV's distortion by Newton's method; refuse where it cannot be inverted."""
    ideal = wanted.copy()
    # Where the distortion folds, the steps lead anywhere; what is left over tells in the end.
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            residual = _distort(ideal, coefficients) - wanted
            jacobian = np.stack(
                [
                    (_distort(ideal + shift, coefficients) - _distort(ideal - shift, coefficients))
                    / (2 * _STEP)
                    for shift in _STEP * np.eye(2)
                ],
                axis=-1,
            )
            determinant = np.linalg.det(jacobian)
            if np.abs(residual).max() < 1e-13 or not (determinant > 1e-6).all():
                break
            ideal = ideal - np.linalg.solve(jacobian, residual[..., None])[..., 0]
        left = np.abs(_distort(ideal, coefficients) - wanted).max(axis=-1)
    # A point beyond a fold can satisfy the equation too, but turns the image inside out.
    bad = ~((left < 1e-9) & (determinant > 0))
    if bad.any():
        raise InputError(
            f"the distortion {coefficients.tolist()} folds within the image: at {bad.sum()} of "
            f"{len(bad)} pixels, out to {np.linalg.norm(wanted, axis=-1).max():.3g} times the "
            "image distance, it cannot be inverted; these coefficients were fitted to a smaller "
            "part of the image"
        )
    return ideal


def _distort(ideal: FloatArray, coefficients: FloatArray) -> FloatArray:
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients
    x, y = ideal.T
    squared = x**2 + y**2
    gain = (1 + squared * (k1 + squared * (k2 + squared * k3))) / (
        1 + squared * (k4 + squared * (k5 + squared * k6))
    )
    return np.stack(
        [
            x * gain + 2 * p1 * x * y + p2 * (squared + 2 * x**2),
            y * gain + p1 * (squared + 2 * y**2) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
