"""The poses and lens states that the rows of a table of viewpoints state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd

from lenscal.pose import Pose
from planning.fixed_lens import FixedLens
from planning.lens_states import LensStates

if TYPE_CHECKING:
    from lenscal.maps.lens_map import LensMap

PLACE: Final = ("x_mm", "y_mm", "z_mm")
TURN: Final = ("rotation_x", "rotation_y", "rotation_z")


def poses_of(viewpoints: pd.DataFrame) -> tuple[Pose, ...]:
    """Read the poses of viewpoints.

    Parameters
    ----------
    viewpoints
        One row each, with x_mm, y_mm, z_mm of the projection centre and rotation_x, rotation_y,
        rotation_z, the rotation vector in radians.

    Returns
    -------
    tuple of Pose
        part_from_camera of each, in the order of the table.
    """
    turns, places = viewpoints[list(TURN)].to_numpy(), viewpoints[list(PLACE)].to_numpy()
    return tuple(Pose.from_rotation_vector(t, p) for t, p in zip(turns, places, strict=True))


def pose_columns(pose: Pose) -> dict[str, float]:
    """State a pose as the columns of a row.

    Parameters
    ----------
    pose
        part_from_camera.

    Returns
    -------
    dict
        Place in mm and rotation vector in radians.
    """
    values = [*pose.translation_mm, *pose.rotation_vector]
    return dict(zip((*PLACE, *TURN), map(float, values), strict=True))


def records_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Give the rows of a table as JSON can hold them.

    Parameters
    ----------
    table
        Viewpoints, or what they cover.

    Returns
    -------
    list of dict
        One per row; None where a number is not finite.
    """
    return [
        {
            str(name): None if isinstance(value, float) and not np.isfinite(value) else value
            for name, value in row.items()
        }
        for row in table.to_dict("records")
    ]


def states_of(lens: LensMap | FixedLens, viewpoints: pd.DataFrame) -> LensStates:
    """Give the lens states of viewpoints, one each.

    Parameters
    ----------
    lens
        The lens map or fixed lens.
    viewpoints
        One row or more, with zoom, focus and iris, and object_distance_mm for a fixed lens. Where
        an iris is NaN, the entrance pupil is left open.

    Returns
    -------
    LensStates
        As many.
    """
    if isinstance(lens, FixedLens):
        return LensStates.of_fixed(lens, viewpoints["object_distance_mm"].to_numpy())
    iris = viewpoints["iris"].to_numpy()
    settings = viewpoints["zoom"].to_numpy(), viewpoints["focus"].to_numpy()
    return LensStates.of_map(lens, *settings, None if np.isnan(iris).any() else iris)
