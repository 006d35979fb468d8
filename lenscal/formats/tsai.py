"""Calibration data and camera parameters as the programs of R. Willson keep them (Tsai v3.0b3).

A data file (``cd``) has a line ``xw yw zw Xf Yf`` for each point, in mm and px. A parameter file
(``cpcc``) has 19 numbers, one a line. Their frames are ours: camera x right, y down, z towards the
scene, and frame-buffer coordinates as the data file has them. Their s_x divides::

    x_mm = dpx · (Xf − Cx) / sx,    ours: x_mm = pitch_x_mm · scale_factor · (u − c_x).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.camera import Camera
from lenscal.document import reason, write_whole
from lenscal.errors import FileError, InputError
from lenscal.pose import Pose
from lenscal.sensor import Sensor

#: What Willson's program for extrinsic parameters prints before the numbers.
_TITLE: Final = "Extrinsic Parameter Calibration"
_COLUMNS: Final = ("xw", "yw", "zw", "Xf", "Yf")


@dataclass(frozen=True, slots=True)
class TsaiParameters:
    """The 19 numbers of a parameter file, in the file's own order, names and units.

    Parameters
    ----------
    ncx, nfx
        Sensor elements and frame-buffer samples on a line.
    dx, dy
        Spacing of the sensor elements in mm.
    dpx, dpy
        Effective spacing of the samples in mm: dx · ncx / nfx, and dy.
    cx, cy
        Principal point in px.
    sx
        What is left of the scale factor; it divides.
    f
        Image distance in mm.
    kappa1
        κ1 in mm⁻².
    tx, ty, tz
        Translation of ``camera_from_world`` in mm.
    rx, ry, rz
        Its rotation Rz · Ry · Rx in radians.
    p1, p2
        Decentring, which Willson's programs keep but never use.
    """

    ncx: float
    nfx: float
    dx: float
    dy: float
    dpx: float
    dpy: float
    cx: float
    cy: float
    sx: float
    f: float
    kappa1: float
    tx: float
    ty: float
    tz: float
    rx: float
    ry: float
    rz: float
    p1: float = 0.0
    p2: float = 0.0

    def __post_init__(self) -> None:
        for name in _NAMES:
            value = float(getattr(self, name))
            if not np.isfinite(value) or (name in _POSITIVE and value <= 0):
                wanted = "a positive number" if name in _POSITIVE else "finite"
                raise InputError(f"{name} must be {wanted}, but is {value:g}")
            object.__setattr__(self, name, value)
        if self.p1 or self.p2:
            raise InputError(
                f"p1 and p2 must be zero, but are {self.p1:g} and {self.p2:g}: Willson's programs "
                "give them no meaning; set them to zero if they were not used"
            )

    @classmethod
    def of(
        cls, camera: Camera, camera_from_world: Pose, *, elements_per_line: float | None = None
    ) -> TsaiParameters:
        """Express a camera and its pose.

        Parameters
        ----------
        camera
            Without decentring and radial terms beyond κ1.
        camera_from_world
            The pose.
        elements_per_line
            Ncx: how many of the sensor's elements make up a line of the frame buffer. None for as
            many as there are samples, so that s_x alone holds the scale factor.

        Returns
        -------
        TsaiParameters
            The same camera.

        Raises
        ------
        InputError
            When the camera has distortion that the format cannot hold.
        """
        if any(camera.radial) or any(camera.decentring):
            raise InputError(
                "Tsai's model has κ1 alone, but the camera has further radial terms "
                f"{camera.radial} or decentring {camera.decentring}; calibrate it with "
                "radial_terms=1 and without decentring"
            )
        sensor = camera.sensor
        ncx = float(sensor.width_px if elements_per_line is None else elements_per_line)
        dpx = sensor.pitch_x_mm * ncx / sensor.width_px
        cx, cy = camera.centre_px
        tx, ty, tz = camera_from_world.translation_mm
        rx, ry, rz = _angles_rad(camera_from_world.rotation)
        return cls(
            ncx=ncx,
            nfx=sensor.width_px,
            dx=sensor.pitch_x_mm,
            dy=sensor.pitch_y_mm,
            dpx=dpx,
            dpy=sensor.pitch_y_mm,
            cx=cx,
            cy=cy,
            sx=dpx / sensor.sample_pitch_x_mm,
            f=camera.image_distance_mm,
            kappa1=camera.k1_per_mm2,
            tx=tx,
            ty=ty,
            tz=tz,
            rx=rx,
            ry=ry,
            rz=rz,
        )

    def sensor(self, width_px: int, height_px: int) -> Sensor:
        """Give the sensor.

        Parameters
        ----------
        width_px, height_px
            Size of the frame buffer, which the file does not tell.

        Returns
        -------
        Sensor
            Its sample pitch is dpx / sx and dpy.
        """
        return Sensor(width_px, height_px, self.dx, self.dpy, self.dpx / self.dx / self.sx)

    def camera(self, width_px: int, height_px: int) -> Camera:
        """Give the camera.

        Parameters
        ----------
        width_px, height_px
            Size of the frame buffer, which the file does not tell.

        Returns
        -------
        Camera
            With its sensor.
        """
        sensor = self.sensor(width_px, height_px)
        return Camera(sensor, self.f, self.kappa1, np.array([self.cx, self.cy]))

    @property
    def camera_from_world(self) -> Pose:
        """The pose."""
        (sin_x, sin_y, sin_z), (cos_x, cos_y, cos_z) = (
            function([self.rx, self.ry, self.rz]) for function in (np.sin, np.cos)
        )
        about_x = np.array([[1, 0, 0], [0, cos_x, -sin_x], [0, sin_x, cos_x]])
        about_y = np.array([[cos_y, 0, sin_y], [0, 1, 0], [-sin_y, 0, cos_y]])
        about_z = np.array([[cos_z, -sin_z, 0], [sin_z, cos_z, 0], [0, 0, 1]])
        return Pose(about_z @ about_y @ about_x, np.array([self.tx, self.ty, self.tz]))


_NAMES: Final = tuple(field.name for field in dataclasses.fields(TsaiParameters))
_POSITIVE: Final = frozenset(("ncx", "nfx", "dx", "dy", "dpx", "dpy", "sx", "f"))


def read_tsai_data(path: Path | str) -> tuple[FloatArray, FloatArray]:
    """Read calibration data.

    Parameters
    ----------
    path
        The ``cd`` file.

    Returns
    -------
    points_mm, pixels : FloatArray
        (N, 3) points in the world, and (N, 2) where they were seen.

    Raises
    ------
    FileError
        When the file cannot be read, holds no point, or a line does not hold five numbers.
    """
    path, wanted = Path(path), f"{len(_COLUMNS)} numbers {' '.join(_COLUMNS)}"
    rows = []
    for number, line in _lines(path):
        values = [_number(path, number, word, wanted) for word in line.split()]
        if len(values) != len(_COLUMNS):
            raise FileError(
                f"{path}, line {number}: wanted are {wanted}, but the line holds {len(values)}; "
                "was the file cut short?"
            )
        rows.append(values)
    if not rows:
        raise FileError(f"{path} is empty; wanted are lines of {wanted}")
    table = np.array(rows)
    return (
        frozen_array("points_mm", table[:, :3], ("N", 3)),
        frozen_array("pixels", table[:, 3:], ("N", 2)),
    )


def write_tsai_data(path: Path | str, points_mm: npt.ArrayLike, pixels: npt.ArrayLike) -> Path:
    """Write calibration data, to the last digit.

    Parameters
    ----------
    path
        The ``cd`` file.
    points_mm
        (N, 3) points in the world.
    pixels
        (N, 2) where they were seen.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        When there are not as many pixels as points.
    """
    points = frozen_array("points_mm", points_mm, ("N", 3))
    seen = frozen_array("pixels", pixels, ("N", 2))
    if len(points) != len(seen):
        raise InputError(f"there are {len(points)} points, but {len(seen)} pixels; give one each")
    rows = np.column_stack([points, seen]).tolist()
    return write_whole(Path(path), "".join(" ".join(map(repr, row)) + "\n" for row in rows))


def read_tsai_parameters(path: Path | str) -> TsaiParameters:
    """Read camera parameters and calibration constants.

    Parameters
    ----------
    path
        The ``cpcc`` file.

    Returns
    -------
    TsaiParameters
        Its 19 numbers, which give camera, pose and sensor.

    Raises
    ------
    FileError
        When the file cannot be read, does not hold 19 numbers, or one of them makes no sense.
    """
    path = Path(path)
    values: list[float] = []
    last = 0
    for number, line in _lines(path):
        for word in line.split():
            if len(values) == len(_NAMES):
                raise FileError(
                    f"{path}, line {number}: wanted are {len(_NAMES)} numbers in all, but more "
                    f"follow ({word!r:.40}); is this a parameter (cpcc) file?"
                )
            values.append(_number(path, number, word, _NAMES[len(values)]))
        last = number
    if len(values) < len(_NAMES):
        raise FileError(
            f"{path}, line {last}: the file ends after {len(values)} of {len(_NAMES)} numbers; "
            f"wanted next is {_NAMES[len(values)]}; was it cut short?"
        )
    try:
        return TsaiParameters(*values)
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


def write_tsai_parameters(path: Path | str, parameters: TsaiParameters) -> Path:
    """Write camera parameters and calibration constants, to the last digit.

    Parameters
    ----------
    path
        The ``cpcc`` file.
    parameters
        What to write, from `TsaiParameters.of`.

    Returns
    -------
    Path
        The file.
    """
    values = dataclasses.astuple(parameters)
    return write_whole(Path(path), "".join(f"{value!r}\n" for value in values))


def _lines(path: Path) -> list[tuple[int, str]]:
    """Give the lines that hold something, with their numbers."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"cannot read {path}: {reason(error)}") from error
    lines = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, line) for number, line in lines if line and line != _TITLE]


def _number(path: Path, line: int, word: str, wanted: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise FileError(
            f"{path}, line {line}: {word!r:.40} is no finite number; wanted is {wanted}"
        )
    return value


def _angles_rad(rotation: FloatArray) -> tuple[float, float, float]:
    """Take Rz · Ry · Rx apart; where Ry is ±90°, Rz takes part of what could be Rx."""
    rz = np.arctan2(rotation[1, 0], rotation[0, 0])
    sine, cosine = np.sin(rz), np.cos(rz)
    ry = np.arctan2(-rotation[2, 0], rotation[0, 0] * cosine + rotation[1, 0] * sine)
    rx = np.arctan2(
        rotation[0, 2] * sine - rotation[1, 2] * cosine,
        rotation[1, 1] * cosine - rotation[0, 1] * sine,
    )
    return float(rx), float(ry), float(rz)
