"""The simulated camera: it renders what the world puts before the lens."""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.errors import DeviceError, OutOfRangeError
from lenscal.imaging.detector import Detector
from lenscal.imaging.formation import render, window_inside
from lenscal.imaging.texture import Float32Image
from lenscal.pose import Pose
from lenscal.rig.interfaces import CameraDevice, Frame
from lenscal.rig.simulated.lens_truth import LensTruth
from lenscal.rig.simulated.world import World
from lenscal.sensor import Sensor, Window

#: Time to read a frame out.
_READOUT_S: Final = 0.02
#: The chip starts at room temperature and warms up by so much, this fast. Assumed.
_ROOM_C: Final = 22.0
_WARMING_C: Final = 18.0
_WARMING_TIME_S: Final = 1500.0


class SimulatedCamera(CameraDevice):
    """A camera with shot noise, read noise and a black level.

    Parameters
    ----------
    world
        The world that it looks at.
    detector
        Its pixels.
    exposure_s
        Exposure time to begin with.
    exposure_range_s
        Shortest and longest exposure time.
    """

    def __init__(
        self,
        world: World,
        detector: Detector,
        exposure_s: float = 0.01,
        exposure_range_s: tuple[float, float] = (1e-5, 2.0),
    ) -> None:
        self._world = world
        self._detector = detector
        self._exposure_range_s = exposure_range_s
        self._exposure_s = exposure_s
        self.set_exposure_s(exposure_s)

    @property
    def identity(self) -> str:
        """Size and bit depth."""
        sensor = self.sensor
        return (
            f"simulated camera, {sensor.width_px} × {sensor.height_px} px, "
            f"{self._detector.bit_depth} bit"
        )

    @property
    def sensor(self) -> Sensor:
        """The sensor and its frame buffer."""
        return self._world.lens.sensor

    @property
    def temperature_c(self) -> float:
        """Temperature of the chip in °C, as it warms up; it changes nothing in the pictures."""
        warmth = -np.expm1(-self._world.clock_s / _WARMING_TIME_S)
        return float(_ROOM_C + _WARMING_C * warmth)

    @property
    def exposure_s(self) -> float:
        """Exposure time of the next frame in seconds."""
        return self._exposure_s

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure time in seconds."""
        return self._exposure_range_s

    def set_exposure_s(self, exposure_s: float) -> None:
        """Set the exposure time.

        Parameters
        ----------
        exposure_s
            In seconds.

        Raises
        ------
        OutOfRangeError
            When it lies outside `exposure_range_s`; nothing has changed then.
        """
        shortest, longest = self._exposure_range_s
        if not shortest <= exposure_s <= longest:
            raise OutOfRangeError(
                f"an exposure of {exposure_s:g} s lies outside {shortest:g} to {longest:g} s, "
                "which this camera can do",
                exposure_s,
                self._exposure_range_s,
            )
        self._exposure_s = exposure_s

    def grab(self, window: Window | None = None) -> Frame:
        """Expose and read one frame.

        Parameters
        ----------
        window
            The part of the image wanted, or None for all of it.

        Returns
        -------
        Frame
            The picture.

        Raises
        ------
        DeviceError
            When the plate, or the part, is where the lens is.
        InputError
            When the window leaves the frame.
        OutOfRangeError
            When the lens stands where no plane before it is sharp.
        """
        world, truth = self._world, self._world.lens_truth()
        view = window_inside(window, self.sensor)
        irradiance = self._irradiance(truth, view)
        electrons = self._detector.electrons(irradiance, self._exposure_s, truth.f_number)
        image = self._detector.read(electrons, world.rng)
        began_s = world.clock_s
        world.advance(self._exposure_s + _READOUT_S)
        return Frame(image, self._detector.bit_depth, began_s, view)

    def _irradiance(self, truth: LensTruth, view: Window) -> Float32Image:
        world = self._world
        if world.workpiece is not None:
            base_from_camera = world.base_from_camera()
            world.workpiece.refuse_collision(
                world.lens.body, truth.front_depth_mm, base_from_camera
            )
            return world.workpiece.image(truth, base_from_camera, view)
        camera_from_target = world.camera_from_target()
        self._refuse_collision(camera_from_target, truth.front_depth_mm)
        return render(
            truth.camera,
            camera_from_target,
            world.surface,
            object_distance_mm=truth.object_distance_mm,
            entrance_pupil_diameter_mm=truth.entrance_pupil_diameter_mm,
            window=view,
            falloff=truth.falloff,
        )

    def _refuse_collision(self, camera_from_target: Pose, front_depth_mm: float) -> None:
        """Refuse a plate that the axis meets between the projection centre and the front glass."""
        normal = camera_from_target.rotation[:, 2]
        centre = camera_from_target.translation_mm
        if not normal[2]:
            return
        depth_mm = float(normal @ centre / normal[2])
        met = camera_from_target.inverse().transform([0.0, 0.0, depth_mm])
        on_plate = (np.abs(met[:2]) <= np.array(self._world.surface.target.size_mm) / 2).all()
        if on_plate and 0 < depth_mm < front_depth_mm:
            raise DeviceError(
                f"the plate lies {front_depth_mm - depth_mm:.0f} mm behind the front of the lens: "
                "lens and plate have collided; move the camera away"
            )
