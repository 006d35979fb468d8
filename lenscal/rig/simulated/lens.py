"""The simulated lens controller."""

from __future__ import annotations

from typing import Final

from lenscal.rig.interfaces import Lens
from lenscal.rig.simulated.world import World
from lenscal.setting import ApproachSide, LensSetting, LensTravel

#: Time that a motor takes over its whole travel, and to come to rest.
_FULL_TRAVEL_S: Final = 6.0
_SETTLING_S: Final = 0.2


class SimulatedLens(Lens):
    """A controller that counts steps and never sees the glass.

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
        """Where the motors stand, as the controller counts; `SimulatedRig.true_setting` knows."""
        return self._world.motors.believed

    def move_to(
        self, setting: LensSetting, approach: ApproachSide = ApproachSide.FROM_BELOW
    ) -> LensSetting:
        """Drive the motors; the clock of the world advances by the time of the longest move.

        A motor with slack overshoots where it has to, so that it always ends from the asked side.

        Parameters
        ----------
        setting
            Where to; an iris of None leaves the iris alone.
        approach
            The side to arrive from.

        Returns
        -------
        LensSetting
            Where they stand by the count of the controller.

        Raises
        ------
        OutOfRangeError
            When the setting lies beyond the travel; nothing has moved then.
        """
        longest = self._world.motors.move_to(setting, approach, self._world.rng)
        self._world.advance(_SETTLING_S + _FULL_TRAVEL_S * longest)
        return self.setting
