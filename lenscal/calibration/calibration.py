"""The result of calibrating one setting: a camera, where the views stood, how good all of it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lenscal.arrays import BoolArray, FloatArray, frozen_array
from lenscal.calibration.mounting import Mounting
from lenscal.calibration.rejection import Rejection
from lenscal.camera import Camera
from lenscal.errors import CalibrationError, InputError
from lenscal.optics import focal_length_mm
from lenscal.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeatability:
    """How far a robot stands from where it says; by name only, so that nothing is swapped.

    Parameters
    ----------
    rotation_rad
        σ of the rotation about each axis.
    translation_mm
        σ of each coordinate.
    """

    rotation_rad: float
    translation_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class RobotEvidence:
    """What a robot's poses contributed, and what was learnt of the robot.

    Parameters
    ----------
    mounting
        The camera on the hand and the target in the base, for this setting.
    mounting_covariance
        (12, 12) of the rotation vectors and translations of `Mounting.moved`, in rad and mm.
    slips
        (V, 6) how far the hand stood from where the robot said: rotation in rad and translation in
        mm in the frame of the hand; NaN where no pose was told.
    believed
        (V,) which poses were used.
    repeatability
        Of the robot, as estimated or as given.
    redundancy
        (2,) independent observations behind the two numbers of the repeatability.
    """

    mounting: Mounting
    mounting_covariance: FloatArray
    slips: FloatArray
    believed: BoolArray
    repeatability: Repeatability
    redundancy: FloatArray

    def __post_init__(self) -> None:
        covariance = frozen_array("mounting_covariance", self.mounting_covariance, (12, 12))
        object.__setattr__(self, "mounting_covariance", covariance)
        slips = frozen_array("slips", self.slips, ("V", 6), finite=False)
        object.__setattr__(self, "slips", slips)
        object.__setattr__(self, "redundancy", frozen_array("redundancy", self.redundancy, (2,)))
        self.believed.setflags(write=False)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A calibrated camera with its evidence.

    Parameters
    ----------
    camera
        The camera.
    poses
        ``camera_from_target`` of each view. That of a rejected view is where it seemed to be.
    pixels
        One (N, 2) array per view: where the points were seen.
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
        (Q,) names of what `value`, `covariance` and `sigma` know.
    quantity_covariance
        (Q, Q) their covariance, or None where the method gives none.
    warnings
        What the user should know, in words.
    quantity_values
        (Q,) their values; of the plane D is measured to, too.
    robot
        What a robot's poses contributed, or None without them.
    """

    camera: Camera
    poses: tuple[Pose, ...]
    pixels: tuple[FloatArray, ...]
    residuals_px: tuple[FloatArray, ...]
    inliers: tuple[BoolArray, ...]
    rejected: tuple[Rejection, ...]
    noise_px: float
    focus_view: int | None
    quantities: tuple[str, ...]
    quantity_covariance: FloatArray | None
    warnings: tuple[str, ...] = ()
    quantity_values: FloatArray | None = None
    robot: RobotEvidence | None = None

    def __post_init__(self) -> None:
        frozen = tuple(
            frozen_array("residuals_px", r, ("N", 2), finite=False) for r in self.residuals_px
        )
        object.__setattr__(self, "residuals_px", frozen)
        seen = tuple(frozen_array("pixels", p, ("N", 2)) for p in self.pixels)
        object.__setattr__(self, "pixels", seen)
        for mask in self.inliers:
            mask.setflags(write=False)
        if self.quantity_covariance is not None:
            size = len(self.quantities)
            square = frozen_array("quantity_covariance", self.quantity_covariance, (size, size))
            object.__setattr__(self, "quantity_covariance", square)
        if self.quantity_values is not None:
            values = frozen_array("quantity_values", self.quantity_values, (len(self.quantities),))
            object.__setattr__(self, "quantity_values", values)

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

        With a robot it is the plane where the robot says that it was.

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
        if self.quantity_values is not None:
            return self.value("object_distance_mm")
        return axial_distance_mm(self.poses[self.focus_view])

    @property
    def magnification(self) -> float:
        """d/D, the best known of all."""
        return self.image_distance_mm / self.object_distance_mm

    @property
    def focal_length_mm(self) -> float:
        """Focal length f of the Gaussian lens law (3a) for this D and d."""
        return float(focal_length_mm(self.object_distance_mm, self.image_distance_mm))

    def value(self, name: str) -> float:
        """Give a quantity by its name.

        Parameters
        ----------
        name
            Among `quantities`.

        Returns
        -------
        float
            Its value, in the unit of the name.

        Raises
        ------
        InputError
            When the name is not known.
        """
        if self.quantity_values is None or name not in self.quantities:
            raise InputError(
                f"no value of {name} is known; known are {', '.join(self.quantities) or 'none'}"
            )
        return float(self.quantity_values[self.quantities.index(name)])

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
