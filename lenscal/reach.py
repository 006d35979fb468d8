"""What a robot can reach with its hand: a box, and how far it may tilt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import InputError, OutOfRangeError
from lenscal.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """A box that the hand must stay in, and how far it can tilt.

    Parameters
    ----------
    low_mm, high_mm
        (3,) opposite corners in the base frame.
    tilt_limit_deg
        Largest angle between the z axis of the hand and straight down.

    Raises
    ------
    InputError
        When the box is empty or the limit is no angle from 0 to 180.
    """

    low_mm: FloatArray
    high_mm: FloatArray
    tilt_limit_deg: float = 180.0

    def __post_init__(self) -> None:
        for name in ("low_mm", "high_mm"):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), (3,)))
        if not (self.low_mm < self.high_mm).all():
            raise InputError(
                f"a reach must run from a low corner to a high one, but is {self.low_mm.tolist()} "
                f"to {self.high_mm.tolist()} mm"
            )
        if not 0 <= self.tilt_limit_deg <= 180:
            raise InputError(
                f"the tilt limit must lie between 0 and 180 degrees, but is {self.tilt_limit_deg:g}"
            )

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
                beyond = max(low - value, value - high)
                raise OutOfRangeError(
                    f"{axis} = {value:.1f} mm of the hand lies outside the workspace {low:g} to "
                    f"{high:g} mm, by {beyond:.1f} mm; nothing was moved",
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
