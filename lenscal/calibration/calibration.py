"""The result of calibrating one setting: a camera, where the views stood, how good all of it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from lenscal.calibration.rejection import Rejection
from lenscal.camera import Camera
from lenscal.errors import CalibrationError, InputError
from lenscal.optics import focal_length_mm
from lenscal.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A calibrated camera with its evidence.

    Parameters
    ----------
    camera
        The camera.
    poses
        ``camera_from_target`` of each view. That of a rejected view is where it seemed to be.
    residuals_px
        One (N, 2) array per view: predicted minus observed, rejected points included.
    inliers
        One (N,) array per view: which points were used.
    rejected
        What was not used, one by one, with the reason.
    noise_px
        σ of one observed coordinate, from the residuals and the degrees of freedom.
    focus_view
        Index of the view that shows the plane D is measured to, or None.
    quantities
        (Q,) names of what `covariance` and `sigma` know.
    quantity_covariance
        (Q, Q) their covariance, or None where the method gives none.
    warnings
        What the user should know, in words.
    """

    camera: Camera
    poses: tuple[Pose, ...]
    residuals_px: tuple[FloatArray, ...]
    inliers: tuple[BoolArray, ...]
    rejected: tuple[Rejection, ...]
    noise_px: float
    focus_view: int | None
    quantities: tuple[str, ...]
    quantity_covariance: FloatArray | None
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        frozen = tuple(
            frozen_array("residuals_px", r, ("N", 2), finite=False) for r in self.residuals_px
        )
        object.__setattr__(self, "residuals_px", frozen)
        for mask in self.inliers:
            mask.setflags(write=False)
        if self.quantity_covariance is not None:
            size = len(self.quantities)
            square = frozen_array("quantity_covariance", self.quantity_covariance, (size, size))
            object.__setattr__(self, "quantity_covariance", square)

    @property
    def rms_px(self) -> float:
        """Root mean square distance of predicted and observed points, those used."""
        used = np.concatenate([r[i] for r, i in zip(self.residuals_px, self.inliers, strict=True)])
        return float(np.sqrt((used**2).sum(axis=1).mean()))

    @property
    def image_distance_mm(self) -> float:
        """d: from the projection centre to the image plane."""
        return self.camera.image_distance_mm

    @property
    def object_distance_mm(self) -> float:
        """D: along the axis from the projection centre to the target plane of the focus view.

        Raises
        ------
        CalibrationError
            When there is no focus view, or it was rejected.
        """
        if self.focus_view is None:
            raise CalibrationError(
                "the object distance is not known: no focus view was named, or it was rejected; "
                "name a view of the plane in sharpest focus"
            )
        return axial_distance_mm(self.poses[self.focus_view])

    @property
    def magnification(self) -> float:
        """d/D, the best known of all."""
        return self.image_distance_mm / self.object_distance_mm

    @property
    def focal_length_mm(self) -> float:
        """Focal length f of the Gaussian lens law (3a) for this D and d."""
        return float(focal_length_mm(self.object_distance_mm, self.image_distance_mm))

    def covariance(self, names: Sequence[str]) -> FloatArray:
        """Give the covariance of some quantities.

        Parameters
        ----------
        names
            Among `quantities`.

        Returns
        -------
        FloatArray
            (len(names), len(names)) in the units of the quantities; zero for what was held fixed.

        Raises
        ------
        InputError
            When a name is not known.
        CalibrationError
            When the method gives no covariance.
        """
        if self.quantity_covariance is None:
            raise CalibrationError(
                "Tsai's two-stage solution comes without uncertainty; calibrate with method='full'"
            )
        unknown = [name for name in names if name not in self.quantities]
        if unknown:
            raise InputError(
                f"no covariance of {', '.join(unknown)}; known are {', '.join(self.quantities)}"
            )
        index = [self.quantities.index(name) for name in names]
        chosen: FloatArray = self.quantity_covariance[np.ix_(index, index)]
        return chosen

    def sigma(self, name: str) -> float:
        """Give the standard deviation of a quantity.

        Parameters
        ----------
        name
            Among `quantities`.

        Returns
        -------
        float
            σ in the unit of the quantity; zero for what was held fixed.
        """
        return float(np.sqrt(self.covariance([name])[0, 0]))

    def __repr__(self) -> str:
        used = sum(int(mask.sum()) for mask in self.inliers)
        return (
            f"Calibration({self.camera!r}, {used} points in {len(self.poses)} views, "
            f"{len(self.rejected)} rejections, rms {self.rms_px:.3g} px)"
        )


def axial_distance_mm(camera_from_target: Pose) -> float:
    """Measure the distance to a target plane along the optical axis.

    Parameters
    ----------
    camera_from_target
        Where the target stands.

    Returns
    -------
    float
        n·t / n_z with the plane's normal n: where the axis meets the plane z = 0 of the target, in
        mm. Infinite when the axis is parallel to the plane.
    """
    normal = camera_from_target.rotation[:, 2]
    with np.errstate(divide="ignore"):
        return float(normal @ camera_from_target.translation_mm / normal[2])
