"""Samples to lens map: which columns count, how their errors hang together, one joint fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.errors import InputError, MapError
from lenscal.maps.domain import Domain
from lenscal.maps.lens_map import LensMap
from lenscal.maps.numbers import in_numbers
from lenscal.maps.pupil import PupilMap
from lenscal.maps.pupil_fit import PUPIL_COLUMNS, fit_pupil_of_table
from lenscal.maps.quantities import CORE, CORE_WITHOUT_DISTANCE, SINGLE, varies
from lenscal.maps.strip import Strip
from lenscal.maps.surface import Surfaces
from lenscal.maps.tame_surfaces import (
    ENOUGH_TO_TELL,
    fit_tame_surfaces,
    tame_coordinates,
    unmix,
)
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting

if TYPE_CHECKING:
    from lenscal.calibration.table import CalibrationTable

_SETTING: Final = ("zoom", "focus")
#: What ln D is of ln d/D, of the spline that stands for it, and of ln standoff: D itself; d, where
#: d/D and D bend alike and d does not; D / standoff, where D and the standoff bend alike. The
#: others are known so much better than D that what is known of them helps it.
_OF_DISTANCE: Final = ((0.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (0.0, 1.0, 1.0))
#: What ln d/D is of the splines where the first stands for d/D · standoff: where a strip bends
#: between samples, or the autofocus stopped, both are off by one factor, which drops out.
_RATIO_BY_STANDOFF: Final = (1.0, 0.0, -1.0)
_POSITIVE: Final = (*CORE, *CORE_WITHOUT_DISTANCE)


def fit_lens_map(
    table: pd.DataFrame | CalibrationTable,
    *,
    sensor: Sensor | None = None,
    reference_setting: LensSetting | None = None,
    log_smoothing: Mapping[str, npt.ArrayLike] | None = None,
    pupil_samples: pd.DataFrame | None = None,
    identity: Mapping[str, str] | None = None,
) -> LensMap:
    """Fit a lens map to one sample per setting.

    Parameters
    ----------
    table
        A calibration table, or a frame with the columns zoom, focus, magnification and
        object_distance_mm; and, as far as they are known, standoff_mm, principal_point_x_px,
        principal_point_y_px, k1_per_mm2, scale_factor, nodal_x_mm, nodal_y_mm,
        sharpest_confidence, sigma_<quantity>, sigma_sharpest_mm (of the autofocus) and
        cov_magnification_object_distance_mm. An absent covariance counts as zero, an absent σ is
        estimated from the scatter, and the notes of the map say so. Where neither d/D nor D is
        known at any setting, image_distance_mm is enough: the map then tells d and the camera.
    sensor, reference_setting
        What the table does not carry itself.
    log_smoothing
        A smoothing that was chosen before, by name of the surface, and under ``core_powers``,
        ``core_mixing`` and ``core_roughening`` the coordinates; None to let the data choose.
    pupil_samples
        Further samples of the entrance pupil, such as the rows of a session whose autofocus was
        made at another iris: zoom, focus, image_distance_mm, pupil_iris,
        entrance_pupil_diameter_mm and its σ. Those of the table itself always count.
    identity
        Names of the devices that the table was recorded with, by role, where it does not carry
        them itself.

    Returns
    -------
    LensMap
        The map.

    Raises
    ------
    InputError
        When columns are missing, values are not finite or not positive, or settings are repeated.
    MapError
        When the samples are too few.
    """
    if not isinstance(table, pd.DataFrame):
        sensor = sensor or table.sensor
        reference_setting = reference_setting or table.reference_setting
        identity = identity or table.identity
        table = table.to_dataframe()
    samples = _checked(table)
    chosen: Mapping[str, Any] = log_smoothing or {}
    names, covariances, notes = _core_covariances(samples)
    zoom, focus = (samples[name].to_numpy(float) for name in ("zoom", "focus"))
    unknown = covariances is None
    if covariances is None:
        covariances = np.tile(np.eye(len(names)), (len(zoom), 1, 1))
    logarithms = np.log(samples[list(names)].to_numpy(float))
    stated = [chosen.get(f"core_{key}") for key in ("powers", "mixing", "roughening")]
    tried: list[list[Any]] = [stated]
    if stated[0] is None:
        tried = _coordinates(zoom, focus, logarithms, covariances, unknown)
    core = min(
        (
            fit_tame_surfaces(
                zoom,
                focus,
                logarithms,
                covariances,
                estimate_noise=unknown,
                log_smoothing=chosen.get("core"),
                powers=powers,
                mixing=mixing,
                roughening=roughening,
            )
            for powers, mixing, roughening in tried
        ),
        key=lambda surfaces: surfaces.criterion,
    )
    single_surfaces, single_notes = _single_surfaces(samples, chosen)
    if sensor is not None and "scale_factor" in single_surfaces:
        # What knows one sensor for all settings should know a scale factor that goes with them.
        sensor = replace(sensor, scale_factor=float(samples["scale_factor"].mean()))
    pupil, pupil_notes = _pupil(samples, pupil_samples, chosen.get("pupil"))
    return LensMap(
        samples=samples,
        core=core,
        single_surfaces=single_surfaces,
        domain=Domain.around(zoom, focus),
        sensor=sensor,
        reference_setting=reference_setting,
        notes=(*notes, *single_notes, *pupil_notes),
        pupil=pupil,
        pupil_samples=pupil_samples,
        identity=dict(identity or {}),
    )


def _coordinates(
    zoom: FloatArray,
    focus: FloatArray,
    logarithms: FloatArray,
    covariances: FloatArray,
    unknown: bool,
) -> list[list[Any]]:
    """Powers, mixing and roughening with which the data may be most likely; all together decide.

    Logarithms will do for a few samples on a grid, which could not tell; a strip runs into
    distances where they fall off a cliff. D given the standoff is as likely as D / standoff given
    it: whether the splines are of the one or of the other is decided by their likelihoods.
    """
    count = logarithms.shape[1]
    if len(zoom) < ENOUGH_TO_TELL and Strip.through(zoom, focus).ends is None:
        return [[np.zeros(count), np.eye(count), np.zeros((count, 2))]]
    powers, roughening, criteria = tame_coordinates(
        zoom, focus, logarithms, covariances, estimate_noise=unknown
    )
    if count == 1:
        return [[powers, np.eye(1), roughening]]
    chosen, least = np.eye(count), float(criteria[1])
    for row in _OF_DISTANCE[1:count]:
        mixing = np.eye(count)
        mixing[1] = row[:count]
        values, spread, _ = unmix(logarithms, covariances, mixing)
        power, growth, criterion = tame_coordinates(
            zoom,
            focus,
            values[:, 1:2],
            spread[:, 1:2, 1:2],
            estimate_noise=unknown,
            roughening_free=len(zoom) >= ENOUGH_TO_TELL,
        )
        if criterion[0] < least:
            chosen, least = mixing, float(criterion[0])
            powers[1], roughening[1] = power[0], growth[0]
    first = [powers, chosen, roughening]
    if count == 2 or Strip.through(zoom, focus).ends is None:
        return [first]
    # d/D · standoff is known so much better than either that only the joint fit can tell whether
    # it is the better spline.
    by_standoff = np.eye(count)
    by_standoff[0] = _RATIO_BY_STANDOFF
    mixing = chosen @ by_standoff
    values, spread, _ = unmix(logarithms, covariances, mixing)
    power, growth, _ = tame_coordinates(
        zoom, focus, values[:, :1], spread[:, :1, :1], estimate_noise=unknown
    )
    second = [np.append(power, powers[1:]), mixing, np.append(growth, roughening[1:], axis=0)]
    return [first, second]


def _pupil(
    samples: pd.DataFrame, further: pd.DataFrame | None, log_smoothing: Any
) -> tuple[PupilMap | None, list[str]]:
    """Fit the entrance pupil; where samples do not tell it, the map does without and says so."""
    if further is not None:
        missing = [
            c for c in ("zoom", "focus", "image_distance_mm", *PUPIL_COLUMNS) if c not in further
        ]
        if missing:
            raise InputError(f"pupil_samples lack the columns {', '.join(missing)}; add them")
        own = samples
        if "magnification" in own:
            own = own.assign(image_distance_mm=own["magnification"] * own["object_distance_mm"])
        samples = pd.concat([own, further], ignore_index=True)
    try:
        return fit_pupil_of_table(samples, log_smoothing=log_smoothing), []
    except MapError as error:
        return None, [f"the map has no entrance pupil: {error}"]


def _checked(table: pd.DataFrame) -> pd.DataFrame:
    samples = in_numbers(table)
    # A column without a value says no more than one that is not there.
    empty = [name for name in _POSITIVE if name in samples and samples[name].isna().all()]
    samples = samples.drop(columns=empty)
    missing = [name for name in (*_SETTING, *core_names(samples)) if name not in samples]
    if missing:
        wanted = ", ".join(missing)
        if not {"magnification", "object_distance_mm"} & set(samples):
            wanted += ", or image_distance_mm, for a map of d alone"
        raise InputError(
            f"the table of samples lacks the columns {wanted}; it has "
            f"{', '.join(map(str, samples.columns))}"
        )
    for name in (*_SETTING, *core_names(samples)):
        bad = samples.index[~np.isfinite(samples[name].to_numpy(float))]
        if len(bad):
            raise InputError(
                f"{name} is not finite in row {bad[0]} of the table of samples "
                f"({len(bad)} such rows); leave these settings out or measure them again"
            )
    for name in (n for n in _POSITIVE if n in samples):
        bad = samples.index[samples[name] <= 0]
        if len(bad):
            raise InputError(
                f"{name} must be positive, but is {samples[name][bad[0]]:g} in row {bad[0]} of the "
                "table of samples; leave this setting out or measure it again"
            )
    for name in (str(c) for c in samples.columns if str(c).startswith("sigma_")):
        bad = samples.index[samples[name] <= 0]
        if len(bad):
            raise InputError(
                f"{name} must be positive, but is {samples[name][bad[0]]:g} in row {bad[0]}; "
                "a measurement without error does not exist: state it, or leave the column out"
            )
    repeated = samples.index[samples.duplicated(["zoom", "focus"])]
    if len(repeated):
        row = samples.loc[repeated[0]]
        raise InputError(
            f"the setting zoom {row['zoom']:g}, focus {row['focus']:g} stands more than once "
            "in the table of samples; keep one row per setting"
        )
    if len(samples) < 2:
        raise MapError(
            f"a map needs at least 2 samples, but the table has {len(samples)}; "
            "calibrate more settings"
        )
    return samples


def core_names(samples: pd.DataFrame) -> tuple[str, ...]:
    """Tell which quantities of a table take a core surface each.

    Parameters
    ----------
    samples
        One row per setting.

    Returns
    -------
    tuple of str
        d alone where neither d/D nor D is known at any setting; else d/D and D, whether they are
        known or should be, and the standoff where there is one.
    """
    stated = {name for name in _POSITIVE if name in samples and samples[name].notna().any()}
    if not {*CORE[:2]} & stated and {*CORE_WITHOUT_DISTANCE} <= stated:
        return CORE_WITHOUT_DISTANCE
    return CORE if "standoff_mm" in stated else CORE[:2]


def can_be_mapped(samples: pd.DataFrame) -> bool:
    """Tell whether a table knows at every setting what a lens map is made of.

    Parameters
    ----------
    samples
        One row per setting.

    Returns
    -------
    bool
        Whether `fit_lens_map` finds what it needs.
    """
    return all(name in samples and samples[name].notna().all() for name in core_names(samples))


def _core_covariances(
    samples: pd.DataFrame,
) -> tuple[tuple[str, ...], FloatArray | None, list[str]]:
    """Covariance of (ln d/D, ln D[, ln standoff]) of each sample, or None where it is not known.

    Calibration states that of d/D and D for the distance at which the picture was taken. Where the
    autofocus stopped beyond the sharpest distance by a share e, D and standoff are too large by as
    much and, since d stays, d/D is too small by it.
    """
    names = core_names(samples)
    sigmas = [f"sigma_{name}" for name in names[:2]]
    absent = [s for s in sigmas if s not in samples or samples[s].isna().any()]
    notes = []
    if names == CORE_WITHOUT_DISTANCE:
        notes.append("no object_distance_mm in the table: the map tells d, but not d/D, D or f")
    if absent:
        note = f"no {' and '.join(absent)} in the table: the noise was estimated from the scatter"
        return names, None, [*notes, note]
    values = samples[list(names)].to_numpy(float)
    covariances = np.zeros((len(samples), len(names), len(names)))
    for i, sigma in enumerate(sigmas):
        covariances[:, i, i] = (samples[sigma].to_numpy(float) / values[:, i]) ** 2
    if names == CORE_WITHOUT_DISTANCE:
        # Where the autofocus stopped is of no concern to d.
        return names, covariances, notes
    shared = "cov_magnification_object_distance_mm"
    if shared not in samples:
        notes.append(f"no {shared} in the table: d/D and D were taken as uncorrelated")
    for a, b in combinations(range(len(names)), 2):
        column = f"cov_{names[a]}_{names[b]}"
        if column in samples and samples[column].notna().all():
            term = samples[column].to_numpy(float) / (values[:, a] * values[:, b])
            covariances[:, a, b] = covariances[:, b, a] = term
    sharpest = np.zeros(len(samples))
    if "sigma_sharpest_mm" in samples and samples["sigma_sharpest_mm"].notna().all():
        sharpest = samples["sigma_sharpest_mm"].to_numpy(float)
    else:
        notes.append("no sigma_sharpest_mm in the table: autofocus was taken as exact")
    if len(names) == 3:
        covariances[:, 2, 2] = _variance_without_autofocus(samples, values[:, 2], sharpest)
    effect = np.concatenate([-1 / values[:, 1:2], 1 / values[:, 1:]], axis=1) * sharpest[:, None]
    covariances += effect[:, :, None] * effect[:, None, :]
    if (np.linalg.eigvalsh(covariances)[:, 0] <= 0).any():
        raise InputError(
            "the covariances of the samples contradict themselves: a correlation beyond ±1; check "
            f"sigma_magnification, sigma_object_distance_mm and {shared}"
        )
    return names, covariances, notes


def _variance_without_autofocus(
    samples: pd.DataFrame, standoff: FloatArray, sharpest: FloatArray
) -> FloatArray:
    """Variance of ln standoff that is not the autofocus's, which the stated σ holds too."""
    if "sigma_standoff_mm" in samples and samples["sigma_standoff_mm"].notna().all():
        total = samples["sigma_standoff_mm"].to_numpy(float)
        return np.asarray(np.maximum(total**2 - sharpest**2, 0.0) / standoff**2)
    if (sharpest > 0).all():
        return np.zeros(len(samples))
    raise InputError(
        "the table has standoff_mm but neither sigma_standoff_mm nor sigma_sharpest_mm; state one "
        "of them, or leave standoff_mm out"
    )


def _single_surfaces(
    samples: pd.DataFrame, chosen: Mapping[str, Any]
) -> tuple[dict[str, Surfaces], list[str]]:
    """Fit the quantities that are surfaces of their own; those with gaps are named instead."""
    surfaces, notes = {}, []
    for name in (n for n in SINGLE if varies(samples, n)):
        gaps = int(samples[name].isna().sum())
        if gaps:
            notes.append(
                f"{name} is not mapped: it is unknown at {gaps} of {len(samples)} settings"
            )
        else:
            surfaces[name] = _single_surface(samples, name, chosen.get(name))
    return surfaces, notes


def _single_surface(samples: pd.DataFrame, name: str, log_smoothing: Any) -> Surfaces:
    sigma = f"sigma_{name}"
    known = sigma in samples and bool(samples[sigma].notna().all())
    variance = samples[sigma].to_numpy(float) ** 2 if known else np.ones(len(samples))
    return fit_tame_surfaces(
        samples["zoom"],
        samples["focus"],
        samples[[name]].to_numpy(float),
        variance[:, None, None],
        estimate_noise=not known,
        log_smoothing=log_smoothing,
    )
