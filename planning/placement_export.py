"""Placements as files: a table for people, JSON with all covariances, a sequence for the rig."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from lenscal.camera_mount import ROLES
from lenscal.document import write_document, write_whole
from lenscal.errors import FileError
from lenscal.sequence import Sequence, Station
from planning.placement import Placement, Placements

KIND: Final = "placements"
VERSION: Final = 1


def placement_table(placements: Placements) -> pd.DataFrame:
    """Lay placements out, one a row.

    Parameters
    ----------
    placements
        The placements.

    Returns
    -------
    pandas.DataFrame
        Viewpoint, setting and side; standoff, offset and their σ; the hand in the base by
        translation and rotation vector; σ of the sharp point, of the projection centre and of the
        direction, in the frame of the camera.
    """
    return pd.DataFrame([_row(p) for p in placements.placements])


def save_placements(placements: Placements, path: Path | str) -> Path:
    """Write placements as CSV or JSON.

    Parameters
    ----------
    placements
        The placements.
    path
        A file whose name ends in ``.csv`` or ``.json``; JSON holds the covariances too.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileError
        When its name ends otherwise.
    """
    path = Path(path)
    if path.suffix == ".csv":
        text = placement_table(placements).to_csv(index=False, lineterminator="\n")
        return write_whole(path, text)
    if path.suffix != ".json":
        raise FileError(f"placements are written as .csv or .json, but {path.name!r} was named")
    body = {
        "made_from": placements.plan.made_from,
        "identity": _identity(placements),
        "notes": list(placements.notes),
        "placements": [
            {
                **{k: None if v is np.nan else v for k, v in _row(p).items()},
                "base_from_hand": p.base_from_hand.to_dict(),
                "part_from_camera": p.part_from_camera.to_dict(),
                "sharp_covariance_rad_mm": p.sharp_covariance.tolist(),
                "centre_covariance_rad_mm": p.centre_covariance.tolist(),
            }
            for p in placements.placements
        ],
        "unreachable": [
            {"viewpoint": u.viewpoint, "reason": u.reason} for u in placements.unreachable
        ],
    }
    return write_document(path, KIND, VERSION, body)


def as_sequence(placements: Placements) -> Sequence:
    """Make the sequence that a rig carries out.

    Parameters
    ----------
    placements
        The placements.

    Returns
    -------
    Sequence
        One station per placement, in their order, for the rig of the hand-eye calibration.
    """
    stations = [
        Station(
            f"viewpoint {p.viewpoint}",
            p.setting,
            p.approach,
            p.base_from_hand,
            p.standoff_mm,
            float(p.sigma_sharp_mm[2]),
        )
        for p in placements.placements
    ]
    return Sequence(stations, _identity(placements), placements.plan.made_from)


def _row(placement: Placement) -> dict[str, float | int | str]:
    setting, nodal, hand = placement.setting, placement.nodal, placement.base_from_hand
    row: dict[str, float | int | str] = {
        "viewpoint": placement.viewpoint,
        "zoom": setting.zoom,
        "focus": setting.focus,
        "iris": np.nan if setting.iris is None else setting.iris,
        "approach": placement.approach.value,
        "standoff_mm": nodal.standoff_mm,
        "sigma_standoff_mm": nodal.sigma_standoff_mm,
        "nodal_offset_mm": nodal.offset_mm,
        "sigma_nodal_offset_mm": nodal.sigma_offset_mm,
    }
    vectors = {
        "hand_{}_mm": hand.translation_mm,
        "hand_rotation_{}_rad": hand.rotation_vector,
        "sigma_sharp_{}_mm": placement.sigma_sharp_mm,
        "sigma_centre_{}_mm": placement.sigma_centre_mm,
        "sigma_rotation_{}_rad": placement.sigma_rotation_rad,
    }
    for name, vector in vectors.items():
        row |= {name.format(axis): float(v) for axis, v in zip("xyz", vector, strict=True)}
    return row


def _identity(placements: Placements) -> dict[str, str]:
    stated = placements.cell.mount.identity
    return {role: stated[role] for role in ROLES if role in stated}
