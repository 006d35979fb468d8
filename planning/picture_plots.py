"""Pictures of planned viewpoints, with what was measured in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from planning.image_check import ImageCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Colours of Okabe and Ito, which people tell apart whatever their colour vision.
_FEATURE: Final = "#d55e00"
_STEPS: Final = "#0072b2"
#: Ticks that a marked piece spans at the left end, in the middle and at the right end.
_MARKED: Final = 5


def draw_check(axes: Axes, check: ImageCheck, title: str = "") -> Axes:
    """Show a picture, the length that was measured in it, and the local scale.

    Parameters
    ----------
    axes
        Plain axes.
    check
        What was measured.
    title
        What stands above.

    Returns
    -------
    Axes
        The same axes, in px of the picture.
    """
    image = np.asarray(check.image, dtype=np.float64)
    axes.imshow(image, cmap="gray", vmin=0.0, vmax=float(image.max()))
    ticks, row = check.reading.ticks_px, check.reading.row_px
    below = row + 1.6 * check.reading.height_px
    axes.annotate(
        "",
        (ticks[-1], below),
        (ticks[0], below),
        arrowprops={"arrowstyle": "<|-|>", "color": _FEATURE, "shrinkA": 0, "shrinkB": 0},
    )
    words = f"{check.feature_px:.1f} px (planned {check.planned_px:.1f})"
    axes.text(
        ticks[[0, -1]].mean(), below + 6, words, color=_FEATURE, ha="center", va="top", fontsize=9
    )
    above = row - 1.5 * check.reading.height_px
    middle = (len(ticks) - _MARKED) // 2
    firsts = (0, middle, len(ticks) - _MARKED)
    for first, step, side in zip(firsts, check.step_px, ("left", "center", "right"), strict=True):
        piece = ticks[first : first + _MARKED]
        anchor = {"left": piece[0], "center": piece.mean(), "right": piece[-1]}[side]
        axes.plot(piece[[0, -1]], [above, above], color=_STEPS, linewidth=2.5)
        axes.text(anchor, above - 6, f"{step:.2f} px", color=_STEPS, ha=side, fontsize=8)
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("x (px)")
    axes.set_ylabel("y (px)")
    return axes
