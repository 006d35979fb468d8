"""What a focus search can move: the camera along its axis, or the focus motor of the lens."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import OutOfRangeError
from lenscal.rig.interfaces import Rig
from lenscal.session.aim import hand_pose
from lenscal.session.focus_peak import vergence_from_growth
from lenscal.setting import ApproachSide, LensSetting

#: The camera reaches every place by moving away from the target, over this way at least.
_RUN_UP_MM: Final = 1.0


class FocusMover(Protocol):
    """Moves what brings the target into focus, ending every move from the same side."""

    @property
    def what(self) -> str:
        """What is moved, and in which unit it is given, such as "standoff" and "mm"."""

    @property
    def unit(self) -> str:
        """Unit of the positions, with a space before it, or nothing."""

    @property
    def ascending(self) -> bool:
        """Whether sweeps go from low to high."""

    def move_to(self, position: float) -> None:
        """Move there and wait; beyond the travel raises `OutOfRangeError` and moves nothing."""

    def vergence(self, positions: FloatArray, sizes: FloatArray, at: float) -> tuple[float, float]:
        """Give κ at a position and its σ, see `lenscal.session.focus_peak`."""


class CameraMover:
    """Moves the camera along its axis; positions are standoffs in mm.

    Parameters
    ----------
    rig
        The rig.
    point_mm
        (x, y) in the target frame that the axis meets.
    """

    what: Final = "standoff"
    unit: Final = " mm"
    ascending: Final = True

    def __init__(self, rig: Rig, point_mm: tuple[float, float]) -> None:
        self._rig = rig
        self._point_mm = point_mm
        self._at_mm = np.inf

    def move_to(self, position: float) -> None:
        """Move the camera away to a standoff; a nearer one is reached by way of one nearer still.

        Parameters
        ----------
        position
            Standoff in mm.

        Raises
        ------
        OutOfRangeError
            When the positioner does not reach it.
        """
        if position < self._at_mm + _RUN_UP_MM / 2 and position != self._at_mm:
            self._run_up(position)
        self._go(position)
        self._at_mm = position

    def vergence(self, positions: FloatArray, sizes: FloatArray, at: float) -> tuple[float, float]:
        """Estimate 1/z from the growth of the disk.

        Parameters
        ----------
        positions, sizes
            (N,) standoffs in mm and sizes of the disk in the image.
        at
            Standoff at which it is wanted.

        Returns
        -------
        vergence, sigma : float
            In 1/mm.
        """
        return vergence_from_growth(positions, sizes, at)

    def _run_up(self, position: float) -> None:
        """Go behind a position to come from the near side; the end of travel leaves no room."""
        try:
            self._go(position - _RUN_UP_MM)
        except OutOfRangeError:
            self._go(position)

    def _go(self, standoff_mm: float) -> None:
        self._rig.positioner.move_to(hand_pose(self._rig, standoff_mm, self._point_mm))


class FocusMotorMover:
    """Moves the focus motor; positions are in the units of the lens controller.

    Parameters
    ----------
    rig
        The rig.
    approach
        Side from which every move ends; sweeps go away from that side.
    """

    what: Final = "focus setting"
    unit: Final = ""

    def __init__(self, rig: Rig, approach: ApproachSide) -> None:
        self._rig = rig
        self._approach = approach

    @property
    def ascending(self) -> bool:
        """Whether sweeps go from low to high."""
        return self._approach is ApproachSide.FROM_BELOW

    def move_to(self, position: float) -> None:
        """Drive the focus motor; zoom and iris stay.

        Parameters
        ----------
        position
            Focus setting.

        Raises
        ------
        OutOfRangeError
            When it lies beyond the travel.
        """
        now = self._rig.lens.setting
        self._rig.lens.move_to(LensSetting(now.zoom, position, now.iris), self._approach)

    def vergence(
        self,
        positions: FloatArray,  # noqa: ARG002 - the motor's scale is its own
        sizes: FloatArray,  # noqa: ARG002
        at: float,  # noqa: ARG002
    ) -> tuple[float, float]:
        """Take the defocus as linear in the focus setting, which it is near the peak.

        Parameters
        ----------
        positions, sizes, at
            Not used.

        Returns
        -------
        vergence, sigma : float
            Zero, give or take one over the travel: over all of it, the defocus per unit may double
            or halve.
        """
        low, high = self._rig.lens.travel.focus
        return 0.0, 1 / (high - low)
