"""The table of a calibrated lens: one row per setting, with what each number is worth.

On disk it is a CSV that any program reads, and beside it a JSON of the same name with the evidence:
where the numbers come from, full covariances, what was rejected, and the checksum of the CSV.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from lenscal.document import Json, read_document, reason, write_document, write_whole
from lenscal.errors import FileError, InputError
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting

KIND: Final = "calibration-table"
VERSION: Final = 3

#: Quantities of a setting; each has a column ``sigma_<quantity>`` with its standard deviation.
QUANTITIES: Final = (
    "magnification",
    "object_distance_mm",
    "image_distance_mm",
    "focal_length_mm",
    "standoff_mm",
    "nodal_offset_mm",
    "nodal_x_mm",
    "nodal_y_mm",
    "principal_point_x_px",
    "principal_point_y_px",
    "k1_per_mm2",
    "scale_factor",
)
#: Quantities whose errors go together; every pair has a column ``cov_<a>_<b>`` in this order.
CORRELATED: Final = (
    "magnification",
    "object_distance_mm",
    "image_distance_mm",
    "focal_length_mm",
    "nodal_offset_mm",
    "standoff_mm",
)
PAIRS: Final = tuple((a, b) for i, a in enumerate(CORRELATED) for b in CORRELATED[i + 1 :])

#: Columns of whole numbers.
COUNTS: Final = ("views", "corners", "rejected_corners")
COLUMNS: Final = (
    "zoom",
    "focus",
    "iris",
    "temperature_c",
    *QUANTITIES,
    "rms_px",
    *COUNTS,
    "approach",
    *(f"sigma_{quantity}" for quantity in QUANTITIES),
    "sigma_sharpest_mm",
    "sharpest_confidence",
    "pupil_iris",
    "entrance_pupil_diameter_mm",
    "sigma_entrance_pupil_diameter_mm",
    *(f"cov_{a}_{b}" for a, b in PAIRS),
)


@dataclass(frozen=True, slots=True)
class Failure:
    """A setting that could not be calibrated.

    Parameters
    ----------
    zoom, focus
        The setting.
    reason
        Why, in words.
    """

    zoom: float
    focus: float
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationTable:
    """Calibrations of all settings of a recording.

    ``sigma_<quantity>`` is what the calibration knows of the plane of the focus view. How well that
    view stood at the sharpest distance is ``sigma_sharpest_mm``, from the autofocus, which comes on
    top; only ``sigma_standoff_mm`` holds it already, because it is most of the error there. D and
    the nodal offset share one large error, since the robot knows the standoff between them. The
    projection centre lies at (``nodal_x_mm``, ``nodal_y_mm``, −``nodal_offset_mm``) in the frame of
    the reference camera. ``sharpest_confidence`` says from 0 to 1 how clear the autofocus saw its
    peak, and ``entrance_pupil_diameter_mm`` is that at ``pupil_iris``, the iris of the autofocus.
    NaN stands for what is not known, and for the σ of what was held fixed.

    Parameters
    ----------
    rows
        One row per setting, columns as in `COLUMNS`; further ones are allowed.
    sensor
        The sensor of the camera.
    reference_setting
        The setting for which hand-eye was calibrated, or None.
    recording_sha256
        Hash of the recording it was made from.
    failures
        Settings left out, with the reason.
    evidence
        One entry per row: covariances of all quantities, rejections, warnings.
    versions
        Of the programs that made it.
    identity
        Names of the devices that it was recorded with, by role.

    Raises
    ------
    InputError
        When columns are missing.
    """

    rows: pd.DataFrame
    sensor: Sensor
    reference_setting: LensSetting | None = None
    recording_sha256: str = ""
    failures: tuple[Failure, ...] = ()
    evidence: tuple[Json, ...] = ()
    versions: dict[str, str] = field(default_factory=dict)
    identity: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        missing = [column for column in COLUMNS if column not in self.rows.columns]
        if missing:
            raise InputError(f"a calibration table needs the columns {', '.join(missing)} too")
        object.__setattr__(self, "rows", self.rows.reset_index(drop=True).copy())

    def __len__(self) -> int:
        return len(self.rows)

    def to_dataframe(self) -> pd.DataFrame:
        """Give the rows to work with.

        Returns
        -------
        pd.DataFrame
            A copy.
        """
        return self.rows.copy()

    def save(self, path: Path | str) -> Path:
        """Write the CSV and, beside it, the JSON.

        Parameters
        ----------
        path
            The CSV file; its name must end in ``.csv``.

        Returns
        -------
        Path
            The CSV file.

        Raises
        ------
        FileError
            When the name does not end in ``.csv``, or the folder cannot be written to.
        """
        table, document = _both(path)
        text = self.rows.to_csv(index=False, lineterminator="\n")
        # The document first: what it cannot hold must not cost the table that is there.
        write_document(
            document,
            KIND,
            VERSION,
            {
                "csv_sha256": _sha256(text.encode()),
                "sensor": dataclasses.asdict(self.sensor),
                "reference_setting": self.reference_setting
                and dataclasses.astuple(self.reference_setting),
                "recording_sha256": self.recording_sha256,
                "failures": [
                    {"zoom": f.zoom, "focus": f.focus, "reason": f.reason} for f in self.failures
                ],
                "evidence": list(self.evidence),
                "versions": self.versions,
                "identity": self.identity,
            },
        )
        return write_whole(table, text)

    @classmethod
    def load(cls, path: Path | str) -> CalibrationTable:
        """Read a table back and make sure that both files are what was written.

        Parameters
        ----------
        path
            The CSV file.

        Returns
        -------
        CalibrationTable
            The table.

        Raises
        ------
        FileError
            When a file is missing, altered, or from a newer version.
        """
        table, document = _both(path)
        body = read_document(document, KIND, VERSION)
        try:
            content = table.read_bytes()
        except OSError as error:
            raise FileError(f"cannot read {table}: {reason(error)}") from error
        if _sha256(content) != body["csv_sha256"]:
            raise FileError(
                f"{table} is not the table that {document.name} was written with (its checksum "
                "does not match); restore it, or calibrate again"
            )
        setting: Any = body["reference_setting"]
        rows = _parse(content)
        if body["version"] < VERSION:
            # Columns that were thought of later: nothing is known of them.
            rows = rows.reindex(columns=[*rows.columns, *(c for c in COLUMNS if c not in rows)])
        return cls(
            rows,
            Sensor(**body["sensor"]),
            None if setting is None else LensSetting(*setting),
            body["recording_sha256"],
            tuple(Failure(**failure) for failure in body["failures"]),
            tuple(body["evidence"]),
            body["versions"],
            # Older tables do not say.
            body.get("identity", {}),
        )


def _parse(content: bytes) -> pd.DataFrame:
    """Read numbers to the last digit, which not every parser of pandas does."""
    texts = pd.read_csv(io.BytesIO(content), dtype=str, keep_default_na=False)
    return pd.DataFrame({str(name): _numbers(column) for name, column in texts.items()})


def _numbers(texts: pd.Series[str]) -> pd.Series[Any]:
    try:
        values = texts.replace("", "nan").astype(np.float64)
    except ValueError:
        return texts
    return values.astype(np.int64) if texts.name in COUNTS else values


def _both(path: Path | str) -> tuple[Path, Path]:
    table = Path(path)
    if table.suffix != ".csv":
        raise FileError(f"a calibration table is a .csv file, but {table.name!r} was named")
    return table, table.with_suffix(".json")


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
