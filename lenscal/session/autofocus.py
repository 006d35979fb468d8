"""Finding the sharpest distance by moving the camera away from the target.

A coarse sweep, then a fine one about its peak, both in the same direction. The width of the edge
grows with the distance from the sharp plane as a hyperbola, so that the squared width, one over the
squared sharpness, is a parabola whose vertex is the sharpest distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.errors import FocusError
from lenscal.recording import FocusResult
from lenscal.rig.interfaces import Rig, Window
from lenscal.session.aim import hand_pose
from lenscal.session.exposure import expose
from lenscal.session.sharpness import DiskImage, find_disk, ring_sharpness

#: Pictures of the fine sweep.
_FINE: Final = 13
#: The fine sweep reaches to where the sharpness has fallen to this share of its peak.
_FINE_REACH: Final = 0.55
#: A curve that falls by less than this towards its ends has no clear peak.
_LEAST_CONFIDENCE: Final = 0.15
#: Room around the disk, in its semi-axes, and at least so many px.
_WINDOW: Final = 1.7
_WINDOW_PX: Final = 16


def autofocus(
    rig: Rig, standoffs_mm: Sequence[float], *, point_mm: tuple[float, float] = (0.0, 0.0)
) -> FocusResult:
    """Find the standoff at which the disk is sharpest, at the lens setting of the moment.

    Parameters
    ----------
    rig
        Lens, camera and positioner. Open the iris first: the peak is narrower.
    standoffs_mm
        (N,) standoffs of the coarse sweep, ascending, at least five.
    point_mm
        (x, y) of the disk in the target frame.

    Returns
    -------
    FocusResult
        The sharpest standoff with its σ, how clear the peak was, and the whole focus curve. The
        camera stands at the last position of the fine sweep.

    Raises
    ------
    FocusError
        When no disk is found, the picture is too dark or too bright, the peak lies at an end of the
        sweep, or there is no clear one.
    """
    if len(standoffs_mm) < 5 or (np.diff(standoffs_mm) <= 0).any():
        raise FocusError(
            f"the sweep needs at least five ascending standoffs, but has {len(standoffs_mm)}: "
            f"{', '.join(f'{s:g}' for s in standoffs_mm[:6])} mm"
        )
    rig.positioner.move_to(hand_pose(rig, standoffs_mm[len(standoffs_mm) // 2], point_mm))
    expose(rig.camera)
    frame = rig.camera.grab()
    window = _window_about(find_disk(frame.image), frame.window)
    coarse_mm = np.asarray(standoffs_mm, dtype=np.float64)
    coarse = _sweep(rig, coarse_mm, point_mm, window)
    best = int(coarse.argmax())
    if best in (0, len(coarse) - 1):
        end = "nearest" if best == 0 else "farthest"
        raise FocusError(
            f"the sharpest picture is the {end} one of the search, at {coarse_mm[best]:.1f} mm; "
            "extend the search beyond it"
        )
    confidence = float(1 - max(coarse[0], coarse[-1]) / coarse[best])
    if confidence < _LEAST_CONFIDENCE:
        raise FocusError(
            f"no clear peak between {coarse_mm[0]:.1f} and {coarse_mm[-1]:.1f} mm: sharpness falls "
            f"by {100 * confidence:.0f} % only; open the iris or search a longer range"
        )
    fine_mm = _fine_standoffs(coarse_mm, coarse, best)
    fine = _sweep(rig, fine_mm, point_mm, window)
    distance_mm, sigma_mm = fit_peak(fine_mm, fine)
    return FocusResult(
        distance_mm=distance_mm,
        sigma_mm=sigma_mm,
        confidence=confidence,
        iris=rig.lens.setting.iris,
        curve_standoff_mm=np.concatenate([coarse_mm, fine_mm]),
        curve_sharpness=np.concatenate([coarse, fine]),
    )


def fit_peak(distances_mm: FloatArray, sharpness: FloatArray) -> tuple[float, float]:
    """Fit the vertex of a focus curve.

    Parameters
    ----------
    distances_mm
        (N,) where the camera stood, N at least 5.
    sharpness
        (N,) reciprocal edge widths found there.

    Returns
    -------
    distance_mm, sigma_mm : float
        The sharpest distance and its standard deviation, from the scatter about the fit.

    Raises
    ------
    FocusError
        When the curve has no peak within the distances.
    """
    middle = float(distances_mm.mean())
    x = distances_mm - middle
    squared_width = sharpness**-2.0
    # Relative errors are alike all along the curve, so a width weighs by its reciprocal.
    design = np.stack([np.ones_like(x), x, x**2], axis=-1) / squared_width[:, None]
    target = np.ones_like(x)
    coefficients = np.linalg.lstsq(design, target, rcond=None)[0]
    _, slope, bend = coefficients
    vertex = -slope / (2 * bend) if bend > 0 else np.inf
    if not abs(vertex) <= np.abs(x).max():
        raise FocusError(
            f"the focus curve has no peak between {distances_mm.min():.1f} and "
            f"{distances_mm.max():.1f} mm; search a longer range"
        )
    residual = target - design @ coefficients
    variance = float(residual @ residual) / max(1, len(x) - 3)
    covariance = variance * np.linalg.inv(design.T @ design)
    gradient = np.array([0.0, -1 / (2 * bend), slope / (2 * bend**2)])
    return middle + float(vertex), float(np.sqrt(gradient @ covariance @ gradient))


def _sweep(
    rig: Rig, standoffs_mm: FloatArray, point_mm: tuple[float, float], window: Window
) -> FloatArray:
    """Sharpness at each standoff, moving away."""
    scores = []
    for standoff_mm in standoffs_mm:
        rig.positioner.move_to(hand_pose(rig, float(standoff_mm), point_mm))
        image = rig.camera.grab(window).image
        scores.append(ring_sharpness(image, find_disk(image)))
    return np.array(scores)


def _window_about(disk: DiskImage, full: Window) -> Window:
    """The part of the image that holds the disk, with room for a change of scale."""
    centre, axes = np.array(disk.centre_px), np.array(disk.semi_axes_px)
    reach = np.maximum(_WINDOW * axes, axes + _WINDOW_PX)
    size = np.array([full.width, full.height])
    low = np.clip(np.floor(centre - reach), 0, size - 1).astype(int)
    high = np.clip(np.ceil(centre + reach) + 1, 1, size).astype(int)
    return Window(int(low[0]), int(low[1]), *(int(v) for v in high - low))


def _fine_standoffs(coarse_mm: FloatArray, coarse: FloatArray, best: int) -> FloatArray:
    """Lay the fine sweep to where sharpness has fallen to the wanted share on both sides."""
    x = coarse_mm[best - 1 : best + 2] - coarse_mm[best]
    bend, slope, floor = np.polyfit(x, coarse[best - 1 : best + 2] ** -2.0, 2)
    vertex = float(np.clip(-slope / (2 * bend), x[0], x[-1])) if bend > 0 else 0.0
    lowest = max(floor - slope**2 / (4 * bend), 0.25 * floor) if bend > 0 else floor
    step = float(np.diff(coarse_mm).max())
    reach = np.sqrt((_FINE_REACH**-2.0 - 1) * lowest / bend) if bend > 0 else step
    reach = float(np.clip(reach, 0.5 * step, 4 * step))
    return np.asarray(coarse_mm[best] + vertex + np.linspace(-reach, reach, _FINE))
