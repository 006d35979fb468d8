"""The simulated positioner: it reports where it was sent, and stands a little beside it."""

from __future__ import annotations

from typing import Final

from lenscal.pose import Pose
from lenscal.reach import Reach
from lenscal.rig.interfaces import Positioner
from lenscal.rig.simulated.world import PoseNoise, World

#: Speeds of the hand, and the time it takes to come to rest.
_SPEED_MM_PER_S: Final = 100.0
_SPEED_RAD_PER_S: Final = 0.5
_SETTLING_S: Final = 0.3


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

    def __init__(self, world: World, workspace: Reach, repeatability: PoseNoise) -> None:
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
    def workspace(self) -> Reach:
        """What it can reach."""
        return self._workspace

    @property
    def base_from_hand(self) -> Pose:
        """Where the hand is, as the positioner reports it."""
        return self._reported

    def check(self, base_from_hand: Pose) -> None:
        """Refuse a pose beyond reach, before anything moves.

        Parameters
        ----------
        base_from_hand
            The pose that would be asked for.

        Raises
        ------
        OutOfRangeError
            When the pose is beyond reach.
        """
        self._workspace.check(base_from_hand)

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
