"""Corners that stand in one another's place: the pictures are good, only the numbering is not.

A corner that was not believed may have been seen exactly where another one belongs. Saying so helps
more than saying by how much it misses: the fault lies in the detector or in the list, not in the
picture. Boards whose numbering runs the other way as a whole are told apart too.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from lenscal.arrays import BoolArray, FloatArray, IntArray
from lenscal.calibration.initial import on_a_line
from lenscal.pose import Pose

#: What `exchanged_with` answers for a corner that was not exchanged.
NOT_EXCHANGED: Final = -1
#: Share of the corners of a view that must stand in a place of the board before its order is named.
_MOST: Final = 0.5
#: Share of those that must agree on the order.
_AGREED: Final = 0.9
#: How far two places may differ and be the same, as a share of the extent of the board.
_SAME: Final = 1e-3


def exchanged_with(
    predicted_px: FloatArray, observed_px: FloatArray, rejected: BoolArray, limit_px: float
) -> IntArray:
    """Find corners of one view that were exchanged among themselves, in pairs or round a ring.

    Parameters
    ----------
    predicted_px
        (N, 2) where the other corners put them; NaN where there is no prediction.
    observed_px
        (N, 2) where they were seen.
    rejected
        (N,) which corners were not believed; the others stand in their own place.
    limit_px
        Longest residual to be believed of a corner that was not fitted.

    Returns
    -------
    IntArray
        (N,) for each corner the index of that in whose place it was seen, or `NOT_EXCHANGED`. Only
        complete exchanges count: whoever follows the answers comes back to where he began.
    """
    place = np.full(len(predicted_px), NOT_EXCHANGED, dtype=np.int64)
    lost = np.flatnonzero(rejected)
    if len(lost) < 2:
        return place
    nearest = _places(predicted_px[lost], observed_px[lost], limit_px)
    # Whoever has no place, or whose place nobody took, is no part of a ring, nor are those that
    # lean on him.
    member = (nearest >= 0) & (nearest != np.arange(len(lost)))
    while True:
        taken = np.bincount(nearest[member], minlength=len(lost)) == 1
        remaining = member & taken
        remaining[remaining] = remaining[nearest[remaining]]
        if (remaining == member).all():
            break
        member = remaining
    place[lost[member]] = lost[nearest[member]]
    return place


def numbering_in_place(
    points_mm: FloatArray, predicted_px: FloatArray, observed_px: FloatArray, limit_px: float
) -> str | None:
    """Tell which way the numbering of a view runs, where its pose is known otherwise.

    For views whose pose follows from the robot. A board that is numbered from the other end is a
    true picture of a board that is turned, so that a free pose takes the fault up without a trace.

    Parameters
    ----------
    points_mm
        (N, 3) points in the target frame.
    predicted_px
        (N, 2) where they should be seen; NaN where there is no prediction.
    observed_px
        (N, 2) where they were seen.
    limit_px
        Longest residual to be believed.

    Returns
    -------
    str or None
        A clause for the reason of a rejection; None when no order explains the view. Boards of
        which only a part is seen are told as long as half of their corners stand in places that
        were seen too.
    """
    place = _places(predicted_px, observed_px, limit_px)
    placed = place >= 0
    if placed.sum() < max(4.0, _MOST * len(place)):
        return None
    own, other = points_mm[placed, :2], points_mm[place[placed], :2]
    extent = np.linalg.norm(np.ptp(points_mm[:, :2], axis=0))
    total = np.abs(own + other - np.median(own + other, axis=0)) < _SAME * extent
    equal = np.abs(own - other) < _SAME * extent
    orders = {
        "its corners look numbered from the other end": total.all(axis=1),
        "its columns look numbered from the other end": total[:, 0] & equal[:, 1],
        "its rows look numbered from the other end": equal[:, 0] & total[:, 1],
    }
    if equal.all(axis=1).mean() > 1 - _AGREED:
        return None
    return next((words for words, agrees in orders.items() if agrees.mean() >= _AGREED), None)


def numbering_in_list(
    points_mm: FloatArray, undistorted_px: FloatArray, limit_px: float
) -> str | None:
    """Tell whether the pixels of a view were listed in another order than its points.

    For views with a pose of their own, which was not to be found. Listed backwards, a board of
    which a part was seen fits no plane, nor does one listed by columns instead of rows.

    Parameters
    ----------
    points_mm
        (N, 3) points in the target frame, z = 0.
    undistorted_px
        (N, 2) where they were seen, freed from distortion.
    limit_px
        Longest residual to be believed.

    Returns
    -------
    str or None
        A clause for the reason of a rejection; None when no order explains the view, or that in
        which it was given does.
    """
    plane = points_mm[:, :2]
    if len(plane) <= 4 or on_a_line(plane) or on_a_line(undistorted_px):
        return None
    # The last key of lexsort comes first; rounding keeps the corners of a row in one row.
    by_rows = np.lexsort(np.round(plane.T, 6))
    by_columns = np.lexsort(np.round(plane.T[::-1], 6))
    swapped = "its corners look numbered by columns where rows are meant, or the other way round"
    orders = (
        (None, np.arange(len(plane))),
        ("its corners look numbered from the other end", np.arange(len(plane))[::-1]),
        (swapped, by_columns),
        (swapped, by_rows),
    )
    for words, order in orders:
        if _misses_plane(plane[order], undistorted_px) <= limit_px:
            return words
    return None


def seen_from_behind(camera_from_target: Pose) -> bool:
    """Tell whether a flat target shows its back, which a printed one never does.

    A board whose rows or columns are numbered from the other end is the mirror image of itself. Its
    corners fit a pose all the same: that from which the back of the plate would show them.

    Parameters
    ----------
    camera_from_target
        The pose that was found.

    Returns
    -------
    bool
        Whether the camera stands on the side the target's z axis points to.
    """
    return bool(camera_from_target.rotation[:, 2] @ camera_from_target.translation_mm < 0)


def _places(predicted_px: FloatArray, observed_px: FloatArray, limit_px: float) -> IntArray:
    """(N,) whose place each corner was seen in; −1 when nobody's, or when two come into question.

    Corners that are closer together than the limit cannot be told apart.
    """
    away = np.linalg.norm(observed_px[:, None] - predicted_px[None], axis=-1)
    within = away <= limit_px
    found = np.where(within.any(axis=1), within.argmax(axis=1), -1)
    return np.where(within.sum(axis=1) == 1, found, -1).astype(np.int64)


def _misses_plane(plane_mm: FloatArray, undistorted_px: FloatArray) -> float:
    """Distance in px from the best homography that all but a few bad corners keep within."""
    matrix, _ = cv2.findHomography(plane_mm, undistorted_px, cv2.LMEDS)
    if matrix is None or not np.isfinite(matrix).all():
        return np.inf
    mapped = np.column_stack([plane_mm, np.ones(len(plane_mm))]) @ matrix.T
    with np.errstate(divide="ignore", invalid="ignore"):
        missed = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - undistorted_px, axis=1)
    missed = np.sort(np.where(np.isnan(missed), np.inf, missed))
    return float(missed[int(np.ceil(_AGREED * len(missed))) - 1])
