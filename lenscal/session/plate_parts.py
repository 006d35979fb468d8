"""What of a plate to focus on and to look at: the disk and the board that suit the magnification.

No disk and no board serves all settings of a zoom lens, so a plate may carry several. Which to take
follows from d/D: it says how many pixels a part covers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.detection import Image, detect
from lenscal.errors import SessionError
from lenscal.plate import Plate
from lenscal.recording import Observation
from lenscal.sensor import Sensor
from lenscal.target import Charuco, Disk, Target

#: Diameter in px of a disk that is good to focus on: room for the blur, and a quick picture.
_DISK_PX: Final = 200.0
#: Corners nearer to each other than this are not located well.
_LEAST_SPACING_PX: Final = 25.0


@dataclass(frozen=True, slots=True)
class PlatePart:
    """A part of a plate.

    Parameters
    ----------
    number
        Which, counted from 0.
    target
        What it is.
    centre_mm
        (x, y) of its middle in the frame of the plate.
    """

    number: int
    target: Target
    centre_mm: tuple[float, float]


@dataclass(frozen=True, slots=True)
class PlateDisk(PlatePart):
    """A disk on a plate.

    Parameters
    ----------
    diameter_mm
        Its diameter.
    """

    diameter_mm: float

    def diameter_px(self, magnification: float, sensor: Sensor) -> float:
        """Tell how large it appears.

        Parameters
        ----------
        magnification
            d/z at its distance z.
        sensor
            The sensor.

        Returns
        -------
        float
            Diameter of the circle of the same area in px.
        """
        return self.diameter_mm * magnification / mean_pitch_mm(sensor)


def mean_pitch_mm(sensor: Sensor) -> float:
    """Give the side of a square as large as a pixel.

    Parameters
    ----------
    sensor
        The sensor.

    Returns
    -------
    float
        In mm.
    """
    return float(np.sqrt(np.prod(sensor.sample_pitch_mm)))


def points_of_interest(target: Target) -> tuple[tuple[float, float], tuple[float, float]]:
    """Tell where on a target to focus and where to look when the magnification is not known.

    Parameters
    ----------
    target
        A plate with a disk on it.

    Returns
    -------
    focus_point_mm, view_point_mm : tuple of float
        Middle of the first disk, and middle of the largest other part, in the target frame.

    Raises
    ------
    SessionError
        When the target has no disk or nothing else.
    """
    disks, boards = disks_of(target), boards_of(target)
    if not disks or not boards:
        raise SessionError(
            f"a session needs a plate with a disk to focus on and a board to calibrate from, but "
            f"the target is {target.spec}; combine them, such as "
            "charuco:17x13:3mm:2.25mm@0,0+disk:6mm@0,27"
        )
    largest = max(boards, key=lambda board: (board.target.size_mm, board.centre_mm))
    return disks[0].centre_mm, largest.centre_mm


def offers_choice(target: Target) -> bool:
    """Tell whether there are several disks or several boards.

    Parameters
    ----------
    target
        The target.

    Returns
    -------
    bool
        Whether something is to be chosen.
    """
    return len(disks_of(target)) > 1 or len(boards_of(target)) > 1


def disks_of(target: Target) -> list[PlateDisk]:
    """List the disks of a target.

    Parameters
    ----------
    target
        A plate, or one target alone.

    Returns
    -------
    list of PlateDisk
        In the order of the plate.
    """
    return [
        PlateDisk(number, part, centre_mm, part.diameter_mm)
        for number, (part, centre_mm) in enumerate(_parts(target))
        if isinstance(part, Disk)
    ]


def boards_of(target: Target) -> list[PlatePart]:
    """List what can be calibrated from.

    Parameters
    ----------
    target
        A plate, or one target alone.

    Returns
    -------
    list of PlatePart
        All but the disks, in the order of the plate.
    """
    return [
        PlatePart(number, part, centre_mm)
        for number, (part, centre_mm) in enumerate(_parts(target))
        if not isinstance(part, Disk)
    ]


def disk_to_focus_on(target: Target, sensor: Sensor, magnification: float) -> PlateDisk:
    """Choose the disk whose image is nearest to 200 px across.

    Parameters
    ----------
    target
        A plate with a disk on it.
    sensor
        The sensor.
    magnification
        d/z at the distance z of the plate.

    Returns
    -------
    PlateDisk
        The disk.
    """
    return min(
        disks_of(target),
        key=lambda disk: abs(np.log(disk.diameter_px(magnification, sensor) / _DISK_PX)),
    )


def board_to_look_at(target: Target, sensor: Sensor, magnification: float) -> PlatePart:
    """Choose the board that shows the most corners over the most of the image.

    Parameters
    ----------
    target
        A plate with a board on it.
    sensor
        The sensor.
    magnification
        d/z at the distance z of the plate.

    Returns
    -------
    PlatePart
        The board with the largest product of corners seen and share of the image that they cover;
        among those whose corners are 25 px apart at least. Where none of these shows a corner, the
        coarsest board that does.
    """
    boards = _coarse_enough(target, sensor, magnification)
    return max(boards, key=lambda board: _worth(board.target, sensor, magnification))


def detect_boards(
    image: Image, target: Target, sensor: Sensor, magnification: float
) -> Observation:
    """Find the boards of a plate whose corners are far enough apart to be located well.

    Parameters
    ----------
    image
        (rows, columns) grey values of 8 bits.
    target
        The plate.
    sensor
        The sensor.
    magnification
        d/z at the distance z of the plate.

    Returns
    -------
    Observation
        Points of the plate.

    Raises
    ------
    DetectionError
        When none of them is found.
    """
    boards = _coarse_enough(target, sensor, magnification)
    found = detect(image, Plate(tuple((board.target, board.centre_mm) for board in boards)))
    first = np.cumsum([0, *(len(part.points_mm) for part, _ in _parts(target))])
    ids = np.concatenate([np.arange(first[b.number], first[b.number + 1]) for b in boards])
    return Observation.of(target, ids[found.ids], found.pixels)


def _parts(target: Target) -> tuple[tuple[Target, tuple[float, float]], ...]:
    return target.parts if isinstance(target, Plate) else ((target, (0.0, 0.0)),)


def _spacing_mm(board: Target) -> float:
    """Distance of neighbouring points; all boards are regular."""
    points = board.points_mm
    return float(np.linalg.norm(points[1:] - points[0], axis=-1).min())


def _coarse_enough(target: Target, sensor: Sensor, magnification: float) -> list[PlatePart]:
    """Boards whose points are far enough apart, or as far as can be had with any in the image."""
    boards = boards_of(target)
    seen = [b for b in boards if _worth(b.target, sensor, magnification) > 0] or boards
    wanted_mm = _LEAST_SPACING_PX * float(sensor.sample_pitch_mm.max()) / magnification
    least_mm = min(wanted_mm, max(_spacing_mm(board.target) for board in seen))
    return [board for board in boards if _spacing_mm(board.target) >= least_mm]


def _worth(board: Target, sensor: Sensor, magnification: float) -> float:
    """Points in the image times the share of it that they cover, the board in the middle.

    What N points tell of a scale goes with N times the squared length over which they are spread.
    """
    image_mm = np.array([sensor.width_mm, sensor.height_mm]) / magnification
    points = board.points_mm[:, :2]
    partial = isinstance(board, Charuco)
    # A corner is told by the markers beside it, which have to be in the image too.
    margin_mm = _spacing_mm(board) if partial else 0.0
    seen = points[(np.abs(points) + margin_mm <= image_mm / 2).all(axis=-1)]
    if not len(seen) or (len(seen) < len(points) and not partial):
        return 0.0
    return len(seen) * float(np.prod(np.ptp(seen, axis=0) / image_mm))
