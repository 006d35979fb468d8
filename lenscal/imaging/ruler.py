"""A ruler to lay into a scene: dark ticks on white, exactly where they are said to be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array, positive
from lenscal.errors import InputError
from lenscal.imaging.decal import Decal
from lenscal.pose import Pose

#: Width of a tick as a share of the way between ticks.
_BAR: Final = 0.4
#: Half the length of a tick as a share of the half width of the ruler: plain, every fifth, the two
#: ends. All are symmetric about the line that is measured, so that perspective does not shift them.
_PLAIN, _FIFTH, _END = 0.4, 0.65, 0.9
_TEXELS_PER_TICK: Final = 50
_WHITE, _BLACK = 0.9, 0.04


@dataclass(frozen=True, slots=True)
class Ruler:
    """Ticks at equal steps, both ends included; the line that is measured is its middle.

    Parameters
    ----------
    length_mm
        Between the middles of the first and of the last tick.
    step_mm
        Between the middles of neighbouring ticks.
    width_mm
        Of the white strip, across the line.

    Raises
    ------
    InputError
        When a length is not positive, or there is no whole number of steps.
    """

    length_mm: float
    step_mm: float
    width_mm: float = 4.0

    def __post_init__(self) -> None:
        for name in ("length_mm", "step_mm", "width_mm"):
            positive(name, getattr(self, name), "mm")
        steps = self.length_mm / self.step_mm
        if abs(steps - round(steps)) > 1e-6 or round(steps) < 1:
            raise InputError(
                f"a ruler of {self.length_mm:g} mm holds no whole number of steps of "
                f"{self.step_mm:g} mm; choose a step that divides it"
            )

    @property
    def ticks_mm(self) -> FloatArray:
        """(N,) places of the ticks along the ruler, from its middle."""
        count = round(self.length_mm / self.step_mm) + 1
        return np.linspace(-self.length_mm / 2, self.length_mm / 2, count)

    def decal(
        self, start_mm: npt.ArrayLike, towards_mm: npt.ArrayLike, normal: npt.ArrayLike
    ) -> Decal:
        """Lay the ruler down.

        Parameters
        ----------
        start_mm
            (3,) place of the first tick in the scene.
        towards_mm
            (3,) any point in the direction of the last one.
        normal
            (3,) direction that the print faces.

        Returns
        -------
        Decal
            Seen from the side of the normal, the ruler runs to the right. A step beyond both ends
            it is white still.

        Raises
        ------
        InputError
            When the ruler has no direction, or the normal does not stand on it.
        """
        start = frozen_array("start_mm", start_mm, (3,))
        along = frozen_array("towards_mm", towards_mm, (3,)) - start
        up = frozen_array("normal", normal, (3,))
        sizes = np.linalg.norm(along), np.linalg.norm(up)
        if not all(sizes) or abs(along @ up) > 1e-6 * sizes[0] * sizes[1]:
            raise InputError(
                "a ruler needs a direction and a normal that stands on it, but they are "
                f"{along.tolist()} and {up.tolist()}"
            )
        x, z = along / sizes[0], -up / sizes[1]
        middle = start + x * self.length_mm / 2
        place = Pose(np.stack([x, np.cross(z, x), z], axis=-1), middle)
        return Decal(place, self._print(), (self.length_mm + 2 * self.step_mm, self.width_mm))

    def _print(self) -> FloatArray:
        """(rows, columns) reflectance; a texel that a tick covers in part is grey."""
        ticks = self.ticks_mm
        columns = (len(ticks) + 1) * _TEXELS_PER_TICK
        texel = self.step_mm / _TEXELS_PER_TICK
        rows = max(1, round(self.width_mm / texel))
        edges = ticks[0] - self.step_mm + texel * np.arange(columns + 1)
        inside = np.clip(
            edges - (ticks[:, None] - _BAR * self.step_mm / 2), 0.0, _BAR * self.step_mm
        )
        covered = np.diff(inside, axis=1) / texel
        reach = np.full(len(ticks), _PLAIN)
        reach[::5] = _FIFTH
        reach[[0, -1]] = _END
        off_middle = np.abs((np.arange(rows) + 0.5) / rows * 2 - 1)
        ink = (off_middle[:, None] <= reach).astype(np.float64) @ covered
        return np.asarray(_WHITE + (_BLACK - _WHITE) * np.clip(ink, 0.0, 1.0))
