"""The columns of a table of samples that have to be numbers."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lenscal.errors import InputError
from lenscal.maps.quantities import QUANTITIES


def in_numbers(table: pd.DataFrame) -> pd.DataFrame:
    """Take a table of samples whose settings and quantities are numbers, or are not known.

    Parameters
    ----------
    table
        One row per setting.

    Returns
    -------
    pd.DataFrame
        The same with rows counted from 0, the settings, the quantities of a lens, their σ and
        covariances as float; NaN stands for what is not known.

    Raises
    ------
    InputError
        When the table is empty, or one of these is no number, or infinite.
    """
    samples = table.reset_index(drop=True)
    if samples.empty:
        raise InputError("the table of samples has no row; calibrate at least two settings")
    for name in (n for n in samples if _is_number(str(n))):
        numbers = pd.to_numeric(samples[name], errors="coerce").astype(float)
        bad = samples.index[numbers.isna() & samples[name].notna() | np.isinf(numbers)]
        if len(bad):
            raise InputError(
                f"{name} must be a number, but is {samples[name][bad[0]]!r:.40} in row {bad[0]} of "
                "the table of samples; correct it, or leave it empty where it is not known"
            )
        samples[name] = numbers
    return samples


def _is_number(column: str) -> bool:
    known = ("zoom", "focus", *QUANTITIES)
    return column in known or column.startswith(("sigma_", "cov_"))
