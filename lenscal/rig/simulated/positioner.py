"""The simulated positioner: it reports where it was sent, and stands a little beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import OutOfRangeError
from lenscal.pose import Pose
from lenscal.rig.interfaces import Positioner
from lenscal.rig.simulated.world import PoseNoise, World

#: Speeds of the hand, and the time it takes to come to rest.
_SPEED_MM_PER_S: Final = 100.0
_SPEED_RAD_PER_S: Final = 0.5
_SETTLING_S: Final = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """A box that the hand must stay in, and how far it can tilt.

    Parameters
    ----------
    low_mm, high_mm
        (3,) opposite corners in the base frame.
    tilt_limit_deg
        Largest angle between the z axis of the hand and straight down.
    """

    low_mm: FloatArray
    high_mm: FloatArray
    tilt_limit_deg: float

    def __post_init__(self) -> None:
        for name in ("low_mm", "high_mm"):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), (3,)))

    def check(self, base_from_hand: Pose) -> None:
        """Refuse a pose beyond reach.

        Parameters
        ----------
        base_from_hand
            The pose that is asked for.

        Raises
        ------
        OutOfRangeError
            When a coordinate leaves the box or the hand tilts too far.
        """
        place = base_from_hand.translation_mm
        for axis, value, low, high in zip("xyz", place, self.low_mm, self.high_mm, strict=True):
            if not low <= value <= high:
                raise OutOfRangeError(
                    f"{axis} = {value:.1f} mm of the hand lies outside the workspace {low:g} to "
                    f"{high:g} mm; nothing was moved",
                    float(value),
                    (float(low), float(high)),
                )
        downward = -base_from_hand.rotation[2, 2]
        tilt_deg = float(np.degrees(np.arccos(np.clip(downward, -1.0, 1.0))))
        if tilt_deg > self.tilt_limit_deg:
            raise OutOfRangeError(
                f"the hand cannot tilt {tilt_deg:.1f} degrees from straight down, "
                f"{self.tilt_limit_deg:g} are allowed; nothing was moved",
                tilt_deg,
                (0.0, self.tilt_limit_deg),
            )


class SimulatedPositioner(Positioner):
    """A robot arm that looks down on a bench.

    Parameters
    ----------
    world
        The world that it moves in; its hand is taken to stand where it reports.
    workspace
        What it can reach.
    repeatability
        Scatter of the true pose about the reported one, drawn anew by every move.
    """

    def __init__(self, world: World, workspace: Workspace, repeatability: PoseNoise) -> None:
        self._world = world
        self._workspace = workspace
        self._repeatability = repeatability
        self._reported = world.base_from_hand

    @property
    def identity(self) -> str:
        """Its kind and its repeatability."""
        scatter = self._repeatability
        return (
            f"simulated arm, repeatability {scatter.translation_mm:g} mm, "
            f"{1e3 * scatter.rotation_rad:g} mrad"
        )

    @property
    def workspace(self) -> Workspace:
        """What it can reach."""
        return self._workspace

    @property
    def base_from_hand(self) -> Pose:
        """Where the hand is, as the positioner reports it."""
        return self._reported

    def move_to(self, base_from_hand: Pose) -> Pose:
        """Move the hand; the clock of the world advances by the time that it takes.

        Parameters
        ----------
        base_from_hand
            Where to.

        Returns
        -------
        Pose
            The same pose: encoders do not see the error.

        Raises
        ------
        OutOfRangeError
            When the pose is beyond reach; nothing has moved then.
        """
        self._workspace.check(base_from_hand)
        way_mm, turn_rad = self._reported.distance_to(base_from_hand)
        self._world.base_from_hand = base_from_hand @ self._repeatability.draw(self._world.rng)
        self._world.advance(
            _SETTLING_S + max(way_mm / _SPEED_MM_PER_S, turn_rad / _SPEED_RAD_PER_S)
        )
        self._reported = base_from_hand
        return base_from_hand
