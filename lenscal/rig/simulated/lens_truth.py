"""What is true of a simulated lens at one setting."""

from __future__ import annotations

from dataclasses import dataclass

from lenscal.arrays import FloatArray, positive
from lenscal.camera import Camera
from lenscal.optics import depth_of_field_mm
from lenscal.setting import LensSetting


@dataclass(frozen=True, slots=True, eq=False)
class LensTruth:
    """What is true of a lens at one setting; only a simulation knows it.

    Parameters
    ----------
    setting
        The setting, iris included.
    magnification
        d/D, in the sharp plane.
    object_distance_mm
        D, from the sharp plane to the entrance pupil.
    image_distance_mm
        d = D · (d/D), the camera constant.
    focal_length_mm
        f of (3a), 1/f = 1/D + 1/d; not the Gaussian one.
    nodal_offset_mm
        How far the entrance pupil lies behind that of the reference setting; positive = further
        from the object.
    standoff_mm
        D − offset, from the sharp plane to the reference projection centre.
    working_distance_mm
        From the sharp plane to the front of the lens.
    gaussian_focal_length_mm
        Between principal planes, with its sign.
    principal_object_distance_mm
        From the sharp plane to the front principal plane.
    entrance_pupil_diameter_mm
        a at this iris.
    exit_pupil_diameter_mm
        Its image as the sensor sees it.
    exit_pupil_distance_mm
        From the exit pupil to the sensor.
    falloff
        c2 in mm⁻² and c4 in mm⁻⁴ of the relative illumination 1 + c2 r² + c4 r⁴, with r on the
        sensor from the principal point.
    principal_point_px
        (2,) where the axis meets the image.
    camera
        The pinhole with distortion that maps rays through the entrance pupil to pixels.
    """

    setting: LensSetting
    magnification: float
    object_distance_mm: float
    image_distance_mm: float
    focal_length_mm: float
    nodal_offset_mm: float
    standoff_mm: float
    working_distance_mm: float
    gaussian_focal_length_mm: float
    principal_object_distance_mm: float
    entrance_pupil_diameter_mm: float
    exit_pupil_diameter_mm: float
    exit_pupil_distance_mm: float
    falloff: tuple[float, float]
    principal_point_px: FloatArray
    camera: Camera

    @property
    def f_number(self) -> float:
        """Working f-number d/a, that of the cone of light that meets the sensor."""
        return self.image_distance_mm / self.entrance_pupil_diameter_mm

    @property
    def gaussian_f_number(self) -> float:
        """Engraved f-number, |Gaussian focal length|/a; never use it with the perspective d."""
        return abs(self.gaussian_focal_length_mm) / self.entrance_pupil_diameter_mm

    @property
    def front_depth_mm(self) -> float:
        """Depth of the front of the lens in the camera frame: nearer than that nothing can be."""
        return self.object_distance_mm - self.working_distance_mm

    def depth_of_field_mm(self, blur_mm: float) -> tuple[float, float]:
        """Give the depths between which a point is blurred by no more than allowed.

        Parameters
        ----------
        blur_mm
            Permitted circle of confusion on the sensor; diffraction and aberrations not counted.

        Returns
        -------
        near_mm, far_mm : float
            Depths along the axis from the projection centre; far is infinite beyond the hyperfocal
            distance.

        Raises
        ------
        InputError
            When the blur is not positive.
        """
        near, far = depth_of_field_mm(
            self.object_distance_mm,
            self.image_distance_mm,
            self.entrance_pupil_diameter_mm,
            positive("blur_mm", blur_mm, "mm"),
        )
        return float(near), float(far)
