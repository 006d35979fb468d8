"""Samples to entrance pupil: a/d as one surface over (zoom, focus) and one number per iris."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.calibration.pupil import SHAPE_SIGMA
from lenscal.errors import InputError, MapError
from lenscal.maps.domain import Domain
from lenscal.maps.pupil import SAME_IRIS, PupilMap
from lenscal.maps.surface import Surfaces, fit_surfaces

#: What a table states of the entrance pupil, besides the setting and d.
PUPIL_COLUMNS: Final = (
    "pupil_iris",
    "entrance_pupil_diameter_mm",
    "sigma_entrance_pupil_diameter_mm",
)
#: An iris whose ln(a/d) is known to less than this is not told from zoom and focus.
_LOOSEST_RATIO: Final = 0.5
#: Rounds in which smoothing and irises are fitted in turn.
_ROUNDS: Final = 3


def fit_pupil_of_table(
    samples: pd.DataFrame, *, log_smoothing: npt.ArrayLike | None = None
) -> PupilMap | None:
    """Fit the aperture ratio a/d to the columns of calibration tables.

    Parameters
    ----------
    samples
        Columns zoom, focus, image_distance_mm or both magnification and object_distance_mm, and
        those of `PUPIL_COLUMNS`; a setting may stand there several times, at different irises.
    log_smoothing
        (1, 2) to keep a smoothing that was chosen before; None to let the data choose.

    Returns
    -------
    PupilMap or None
        None when the table knows of no entrance pupil.

    Raises
    ------
    InputError
        When a diameter or its σ is not positive, or only a part of the irises is stated.
    MapError
        When the samples do not determine the surface.
    """
    absent = [column for column in PUPIL_COLUMNS if column not in samples]
    if absent or not samples[list(PUPIL_COLUMNS[1:])].notna().all(axis=1).any():
        return None
    iris, diameter, sigma = (samples[name].to_numpy(float) for name in PUPIL_COLUMNS)
    if (diameter <= 0).any():
        row = int(np.flatnonzero(diameter <= 0)[0])
        raise InputError(
            f"entrance_pupil_diameter_mm must be positive, but is {diameter[row]:g} in row {row} "
            "of the table of samples; leave it empty there or measure it again"
        )
    if "image_distance_mm" in samples:
        image_distance = samples["image_distance_mm"].to_numpy(float)
    else:
        image_distance = (samples["magnification"] * samples["object_distance_mm"]).to_numpy(float)
    # The error of D is in a and in d alike, and not in a/d.
    shared = np.zeros(len(samples))
    if "sigma_image_distance_mm" in samples:
        shared = samples["sigma_image_distance_mm"].fillna(0.0).to_numpy(float) / image_distance
    stated = sigma / diameter
    least = np.minimum(np.abs(stated), SHAPE_SIGMA)
    own = np.sign(stated) * np.sqrt(np.maximum(stated**2 - shared**2, least**2))
    ratio = diameter / image_distance
    return fit_pupil(
        samples["zoom"].to_numpy(float),
        samples["focus"].to_numpy(float),
        iris,
        ratio,
        own * ratio,
        log_smoothing=log_smoothing,
    )


def fit_pupil(
    zooms: npt.ArrayLike,
    focuses: npt.ArrayLike,
    irises: npt.ArrayLike,
    ratios: npt.ArrayLike,
    sigmas: npt.ArrayLike,
    *,
    log_smoothing: npt.ArrayLike | None = None,
) -> PupilMap:
    """Fit the aperture ratio a/d to scattered samples.

    Parameters
    ----------
    zooms, focuses
        (N,) settings.
    irises
        (N,) at which it was measured; NaN where the lens does not tell, then at all of them.
    ratios, sigmas
        (N,) a/d, positive, and its standard deviation; rows in which either is NaN are left out.
    log_smoothing
        (1, 2) to keep a smoothing that was chosen before; None to let the data choose.

    Returns
    -------
    PupilMap
        The map.

    Raises
    ------
    InputError
        When a ratio or its σ is not positive, or only a part of the irises is stated.
    MapError
        When no ratio is known, or the samples do not determine the surface.
    """
    columns = [
        frozen_array(name, value, ("N",), finite=False)
        for name, value in (
            ("zooms", zooms),
            ("focuses", focuses),
            ("irises", irises),
            ("ratios", ratios),
            ("sigmas", sigmas),
        )
    ]
    known = np.isfinite(columns[3]) & np.isfinite(columns[4])
    zoom, focus, iris, ratio, sigma = (column[known] for column in columns)
    _check(iris, ratio, sigma)
    levels, level = _levels(iris)
    samples = _Samples(
        zoom,
        focus,
        (level[:, None] == np.arange(1, len(levels))).astype(np.float64),
        np.log(ratio),
        (sigma / ratio) ** 2,
    )
    smoothing = np.asarray(samples.smoothing() if log_smoothing is None else log_smoothing)
    effects, log_ratios, covariance = samples.irises(smoothing)
    return PupilMap(
        surface=samples.surface(log_ratios, smoothing),
        effects=effects,
        irises=levels,
        log_ratios=np.concatenate([[0.0], log_ratios]),
        covariance=covariance,
        domain=Domain.around(zoom, focus),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """ln(a/d) at N settings: a surface plus one number for each of the irises but the first."""

    zoom: FloatArray
    focus: FloatArray
    indicator: FloatArray  # (N, K − 1): 1 where a sample has that iris
    values: FloatArray  # (N,) ln(a/d)
    variances: FloatArray  # (N,)

    def surface(self, ratios: FloatArray, log_smoothing: npt.ArrayLike | None) -> Surfaces:
        """Fit the surface, the irises being known."""
        values = (self.values - self.indicator @ ratios)[:, None]
        covariances = self.variances[:, None, None]
        return fit_surfaces(self.zoom, self.focus, values, covariances, log_smoothing=log_smoothing)

    def smoothing(self) -> FloatArray:
        """Let the data choose the smoothing, in turn with the irises."""
        plane = np.stack([np.ones_like(self.zoom), self.zoom, self.focus], axis=-1)
        design = np.concatenate([self.indicator, plane], axis=1)
        ratios = np.linalg.lstsq(design, self.values)[0][: self.indicator.shape[1]]
        smoothing = self.surface(ratios, None).log_smoothing
        for _ in range(_ROUNDS if ratios.size else 0):
            ratios = self.irises(smoothing)[1]
            smoothing = self.surface(ratios, None).log_smoothing
        return smoothing

    def irises(self, log_smoothing: FloatArray) -> tuple[Surfaces | None, FloatArray, FloatArray]:
        """Solve for the irises: what each does to the surface, their numbers, the covariance."""
        count = self.indicator.shape[1]
        if not count:
            return None, np.zeros(0), np.zeros((0, 0))
        effects = fit_surfaces(
            self.zoom,
            self.focus,
            self.indicator,
            self.variances[:, None, None] * np.eye(count),
            log_smoothing=np.tile(log_smoothing, (count, 1)),
        )
        # What of an iris the surface cannot follow tells its number (Frisch, Waugh and Lovell).
        own = (self.indicator - effects.value(self.zoom, self.focus)) / self.variances[:, None]
        information = self.indicator.T @ own
        least = np.linalg.eigvalsh((information + information.T) / 2)[0]
        if least * _LOOSEST_RATIO**2 < 1:
            raise MapError(
                "the samples do not tell the iris from zoom and focus: settings at different "
                "irises lie too far apart; search the focus of some settings at several irises"
            )
        covariance: FloatArray = np.asarray(
            np.linalg.inv((information + information.T) / 2), dtype=np.float64
        )
        return effects, covariance @ (own.T @ self.values), covariance


def _check(iris: FloatArray, ratio: FloatArray, sigma: FloatArray) -> None:
    if not len(ratio):
        raise MapError(
            "no sample has an entrance pupil with its σ; it is learnt from focus curves "
            "that were measured by edge_width"
        )
    for name, column in (("aperture ratio a/d", ratio), ("σ of the aperture ratio a/d", sigma)):
        if (column <= 0).any():
            raise InputError(
                f"the {name} must be positive, but is {column[column <= 0][0]:g}; leave this "
                "sample out or measure it again"
            )
    untold = int(np.isnan(iris).sum())
    if 0 < untold < len(iris):
        raise InputError(
            f"{untold} of {len(iris)} samples of the entrance pupil do not state their iris; "
            "state pupil_iris for all of them, or leave these out"
        )


def _levels(iris: FloatArray) -> tuple[FloatArray, IntArray]:
    """Gather the irises that are one: the middle of each, ascending, and which one a sample has."""
    if np.isnan(iris).all():
        return np.array([np.nan]), np.zeros(len(iris), dtype=np.int64)
    order = np.argsort(iris, kind="stable")
    steps = np.diff(iris[order], prepend=iris[order[0]])
    level = np.zeros(len(iris), dtype=np.int64)
    level[order] = np.cumsum(steps > SAME_IRIS * np.abs(iris).max())
    return np.bincount(level, weights=iris) / np.bincount(level), level
