"""The motors of the simulated lens."""

from __future__ import annotations

from typing import Final

from lenscal.rig.interfaces import Lens
from lenscal.rig.simulated.world import World
from lenscal.setting import ApproachSide, LensSetting, LensTravel

#: Time that a motor takes over its whole travel, and to come to rest.
_FULL_TRAVEL_S: Final = 6.0
_SETTLING_S: Final = 0.2


class SimulatedLens(Lens):
    """Motors that arrive exactly where they are sent, from either side.

    Parameters
    ----------
    world
        The world that it moves in.
    """

    def __init__(self, world: World) -> None:
        self._world = world

    @property
    def identity(self) -> str:
        """Name of the lens."""
        return self._world.lens.name

    @property
    def travel(self) -> LensTravel:
        """How far the motors go."""
        return self._world.lens.travel

    @property
    def setting(self) -> LensSetting:
        """Where the motors stand."""
        return self._world.setting

    def move_to(
        self,
        setting: LensSetting,
        approach: ApproachSide = ApproachSide.FROM_BELOW,  # noqa: ARG002 - no backlash, no side
    ) -> LensSetting:
        """Drive the motors; the clock of the world advances by the time of the longest move.

        Parameters
        ----------
        setting
            Where to; an iris of None leaves the iris alone.
        approach
            The side to arrive from; these motors have no backlash.

        Returns
        -------
        LensSetting
            Where they stand.

        Raises
        ------
        OutOfRangeError
            When the setting lies beyond the travel; nothing has moved then.
        """
        self.travel.check(setting)
        before = self._world.setting
        target = setting if setting.iris is not None else setting.with_iris(before.iris)
        moves = [
            (target.zoom - before.zoom, self.travel.zoom),
            (target.focus - before.focus, self.travel.focus),
            ((target.iris or 0.0) - (before.iris or 0.0), self.travel.iris),
        ]
        longest = max(abs(way) / (high - low) for way, (low, high) in moves)
        self._world.setting = target
        self._world.advance(_SETTLING_S + _FULL_TRAVEL_S * longest)
        return target
