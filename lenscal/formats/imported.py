"""What a foreign file says of a lens: one row per setting, and what the file does not say.

Foreign formats carry our image distance d, which they call focal length, and rarely the object
distance D. Without D there is no d/D, and a lens map tells d and the camera only.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import pandas as pd

from lenscal.calibration.table import COLUMNS, COUNTS, CalibrationTable
from lenscal.errors import InputError
from lenscal.formats.distortion import ConvertedCamera
from lenscal.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class ImportedTable:
    """Samples of a lens from a foreign file.

    Parameters
    ----------
    samples
        One row per setting, in the columns that `lenscal.maps.fit.fit_lens_map` takes as far as the
        file knows them: zoom, focus, image_distance_mm, k1_per_mm2, principal_point_x_px, …
        ``conversion_error_px`` is the largest distance on the sensor between the camera of the file
        and one with d, principal point and κ1 alone.
    missing
        What the file does not say, or says in another sense, in sentences.
    sensor
        The sensor, or None where the file does not tell enough of it.

    Raises
    ------
    InputError
        When there are no rows, a setting is repeated, or zoom or focus is missing.
    """

    samples: pd.DataFrame
    missing: tuple[str, ...]
    sensor: Sensor | None = None

    def __post_init__(self) -> None:
        absent = [name for name in ("zoom", "focus") if name not in self.samples]
        if absent or not len(self.samples):
            lacking = f"the columns {', '.join(absent)}" if absent else "rows"
            raise InputError(f"a table of samples lacks {lacking}; it needs one row per setting")
        repeated = self.samples.index[self.samples.duplicated(["zoom", "focus"])]
        if len(repeated):
            row = self.samples.loc[repeated[0]]
            raise InputError(
                f"the setting zoom {row['zoom']:g}, focus {row['focus']:g} stands more than once; "
                "keep one sample per setting"
            )

    @property
    def has_object_distance(self) -> bool:
        """Whether D is known at every setting, so that a map tells more than d and the camera."""
        name = "object_distance_mm"
        return name in self.samples and bool(self.samples[name].notna().all())

    def to_calibration_table(self, source: Path | str) -> CalibrationTable:
        """Make the table that is saved and that lens maps are fitted to.

        Parameters
        ----------
        source
            The file that was read; its name and hash become the evidence of the table.

        Returns
        -------
        CalibrationTable
            Cells that nothing is known of are NaN, and 0 views and corners stand behind each row.

        Raises
        ------
        InputError
            When the sensor is not known.
        """
        if self.sensor is None:
            raise InputError(
                "the file does not tell the size of the image in px and of the sensor in mm, which "
                "a calibration table needs; state what is missing (image size, pixel pitch)"
            )
        extra = [c for c in self.samples.columns if c not in COLUMNS]
        rows = self.samples.reindex(columns=[*COLUMNS, *extra])
        rows[list(COUNTS)] = 0
        rows["approach"] = ""
        path = Path(source)
        evidence = {"imported_from": path.name, "not_known": list(self.missing)}
        return CalibrationTable(
            rows,
            self.sensor,
            recording_sha256=hashlib.sha256(path.read_bytes()).hexdigest()
            if path.is_file()
            else "",
            evidence=tuple(dict(evidence) for _ in range(len(rows))),
            versions={"lenscal": version("lenscal")},
        )


def camera_row(zoom: float, focus: float, converted: ConvertedCamera) -> dict[str, float]:
    """Give the row of a setting from its camera.

    Parameters
    ----------
    zoom, focus
        The setting.
    converted
        The camera there, of which a map holds d, the principal point and κ1.

    Returns
    -------
    dict
        Column to value.
    """
    camera = converted.camera
    return {
        "zoom": zoom,
        "focus": focus,
        "image_distance_mm": camera.image_distance_mm,
        "principal_point_x_px": float(camera.centre_px[0]),
        "principal_point_y_px": float(camera.centre_px[1]),
        "k1_per_mm2": camera.k1_per_mm2,
        "scale_factor": camera.sensor.scale_factor,
        "conversion_error_px": converted.worst_error_px,
    }


def worst_error_sentence(samples: pd.DataFrame) -> str:
    """State what κ1 alone loses.

    Parameters
    ----------
    samples
        Rows with the column conversion_error_px.

    Returns
    -------
    str
        A sentence.
    """
    worst = float(samples["conversion_error_px"].max())
    return (
        "a lens map holds one image distance, the principal point and κ1: the cameras of the file "
        f"differ from that by up to {worst:.2g} px (column conversion_error_px)"
    )


def with_magnification(samples: pd.DataFrame) -> pd.DataFrame:
    """Add d/D where both are known.

    Parameters
    ----------
    samples
        Rows of settings.

    Returns
    -------
    pd.DataFrame
        With the column magnification, when there are image_distance_mm and object_distance_mm.
    """
    if any(name not in samples for name in ("image_distance_mm", "object_distance_mm")):
        return samples
    ratio = samples["image_distance_mm"] / samples["object_distance_mm"]
    if "magnification" in samples:
        ratio = samples["magnification"].fillna(ratio)
    return samples.assign(magnification=ratio)


#: What nearly every foreign format lacks.
NO_OBJECT_DISTANCE = (
    "the object distance D is not known, and with it not d/D and f: a lens map of this tells d and "
    "the camera; for more measure D, add the column object_distance_mm, and import that as CSV"
)
NO_SIGMA = "no standard deviations are stated: a map would estimate the noise from the scatter"
