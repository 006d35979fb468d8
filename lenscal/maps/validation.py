"""How well a map predicts settings that it has not seen."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray, IntArray
from lenscal.errors import InputError
from lenscal.maps.domain import Domain
from lenscal.maps.fit import can_be_mapped, core_names, fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.maps.prediction_pixels import pixel_errors
from lenscal.maps.quantities import QUANTITIES
from lenscal.maps.surface import fit_surfaces
from lenscal.maps.tame_samples import POSITIVE, checked_settings, tame_quantities
from lenscal.sensor import Sensor

if TYPE_CHECKING:
    from lenscal.calibration.table import CalibrationTable

#: A setting is left out by making its σ this much larger: the splines keep their knots.
_LEFT_OUT: Final = 1e5
#: Beyond this many of its own σ, only the left-out setting itself can be what holds a prediction.
_UNDETERMINED: Final = 1e4
#: Smallest relative σ that is taken from the scatter of a table without σ.
_LEAST_SIGMA: Final = 1e-9

#: Rows to leave out to (predicted, its σ, measured, its σ) of each quantity at those rows.
_Predict = Callable[[IntArray], dict[str, FloatArray]]


def cross_validate(
    table: pd.DataFrame | CalibrationTable,
    *,
    folds: int | None = None,
    sensor: Sensor | None = None,
    choose_smoothing: bool = False,
    rng: np.random.Generator | None = None,
) -> pd.DataFrame:
    """Predict every setting by the map of the others.

    Pixels tell what a point in the sharp plane moves by in the image when the predicted camera
    takes the place of the setting's own. ``error_centre_px`` and ``error_corner_px`` are for a
    camera that stands at its own sharp distance D and is not moved otherwise: errors of d/D,
    principal point and κ1 count, an error that d and D share does not. ``refitted_centre_px`` and
    ``refitted_corner_px`` are what is left when the pose is refitted to points all over the image,
    as it is when a target is looked at: distortion, and what tilt cannot hide. Where D is not
    known, both cameras look at the same distance, so that errors of d count in full.

    Parameters
    ----------
    table
        A calibration table, or a frame as for `fit_lens_map`. Where no map can be fitted, since
        quantities are known at a part of the settings only, each gets a surface of its own.
    folds
        Into how many parts the settings are dealt, each of which is predicted by the others; None
        leaves out one setting at a time.
    sensor
        What the table does not carry itself; without a sensor there are no pixels.
    choose_smoothing
        Whether to choose the smoothing anew for every part, which takes longer, instead of keeping
        that of the map of all settings.
    rng
        Deals the settings into folds; None deals them the same way each time.

    Returns
    -------
    pd.DataFrame
        One row per setting, in the order of the table: zoom, focus, fold; edge, whether the other
        settings surround it or it could only be extrapolated to; for each quantity predicted_<q>,
        error_<q> (predicted less measured), relative_error_<q> for positive quantities,
        sigma_<q> (of the error: that of the map and the sample's own) and error_sigmas_<q>; and the
        pixels. NaN where a quantity was not measured, or the other settings do not determine it.

    Raises
    ------
    InputError
        When columns are missing, values cannot be used, or there are more folds than settings.
    MapError
        When the settings are too few.
    """
    if not isinstance(table, pd.DataFrame):
        sensor = sensor or table.sensor
        table = table.to_dataframe()
    samples = checked_settings(table)
    fold = _folds(len(samples), folds, rng)
    prepare = _by_map if can_be_mapped(samples) else _by_surfaces
    predict = prepare(samples, choose_smoothing)
    places = samples[["zoom", "focus"]].to_numpy(float)
    result = pd.DataFrame({"zoom": places[:, 0], "focus": places[:, 1], "fold": fold})
    result["edge"] = False
    found: dict[str, FloatArray] = {}
    for part in range(fold.max() + 1):
        rows = np.flatnonzero(fold == part)
        others = Domain.around(*places[fold != part].T)
        result.loc[rows, "edge"] = ~others.contains(*places[rows].T)
        for name, four in predict(rows).items():
            found.setdefault(name, np.full((4, len(samples)), np.nan))[:, rows] = four
    columns = {}
    for name, (predicted, sigma, measured, own) in found.items():
        # What nothing but the setting itself holds was not predicted.
        told = np.where(sigma > _UNDETERMINED * own, np.nan, predicted)
        error, both = told - measured, np.hypot(sigma, own)
        columns[f"predicted_{name}"] = told
        columns[f"error_{name}"] = error
        if name in POSITIVE:
            columns[f"relative_error_{name}"] = error / measured
        columns[f"sigma_{name}"] = np.where(np.isnan(told), np.nan, both)
        columns[f"error_sigmas_{name}"] = error / both
    if sensor is not None and "image_distance_mm" in found:
        predicted = {name: columns[f"predicted_{name}"] for name in found}
        measured = {name: four[2] for name, four in found.items()}
        columns |= pixel_errors(sensor, measured, predicted)
    return pd.concat([result, pd.DataFrame(columns)], axis=1)


def summarise(validation: pd.DataFrame) -> pd.DataFrame:
    """Condense a cross-validation to one row per quantity.

    Parameters
    ----------
    validation
        What `cross_validate` gave.

    Returns
    -------
    pd.DataFrame
        By quantity, within the samples and at their edge apart: settings predicted, rms and worst
        error (relative for positive quantities), rms of the error in σ, and the zoom and focus of
        the worst. Pixels are quantities too.
    """
    rows = []
    columns = [str(column) for column in validation]
    names = [c.removeprefix("error_sigmas_") for c in columns if c.startswith("error_sigmas_")]
    pixels = [c for c in columns if c.endswith(("_centre_px", "_corner_px"))]
    for name in (*names, *pixels):
        relative = name in POSITIVE
        column = name if name in pixels else f"{'relative_' if relative else ''}error_{name}"
        for edge in (False, True):
            known = validation[(validation["edge"] == edge) & validation[column].notna()]
            if known.empty:
                continue
            errors, zoom, focus = (known[c].to_numpy(float) for c in (column, "zoom", "focus"))
            worst = int(np.argmax(np.abs(errors)))
            sigmas = np.full(1, np.nan)
            if name in names:
                sigmas = known[f"error_sigmas_{name}"].to_numpy(float)
            rows.append(
                {
                    "quantity": name,
                    "relative": relative,
                    "edge": edge,
                    "settings": len(known),
                    "rms_error": float(np.sqrt((errors**2).mean())),
                    "worst_error": float(errors[worst]),
                    "rms_sigmas": float(np.sqrt((sigmas**2).mean())),
                    "worst_zoom": float(zoom[worst]),
                    "worst_focus": float(focus[worst]),
                }
            )
    return pd.DataFrame(rows)


def _folds(count: int, folds: int | None, rng: np.random.Generator | None) -> IntArray:
    if folds is None:
        return np.arange(count)
    if not 2 <= folds <= count:
        raise InputError(
            f"{count} settings cannot be dealt into {folds} folds; give 2 to {count}, or none to "
            "leave out one setting at a time"
        )
    order = (rng or np.random.default_rng(0)).permutation(count)
    dealt = np.zeros(count, dtype=np.int64)
    dealt[order] = np.arange(count) % folds
    return dealt


def _by_map(samples: pd.DataFrame, choose_smoothing: bool) -> _Predict:
    """Predict by lens maps, all quantities together."""
    full = fit_lens_map(samples)
    stated = _with_sigmas(full)
    smoothing = {
        "core": full.core.log_smoothing,
        "core_powers": full.core.powers,
        "core_mixing": full.core.mixing,
        "core_roughening": full.core.roughening,
    } | {name: surface.log_smoothing for name, surface in full.single_surfaces.items()}
    measured, own = _measured(stated, full)

    def predict(rows: IntArray) -> dict[str, FloatArray]:
        table = stated.copy()
        columns = [c for c in map(str, table.columns) if c.startswith(("sigma_", "cov_"))]
        for column in columns:
            power = 2 if column.startswith("cov_") else 1
            table.loc[rows, column] *= _LEFT_OUT**power
        fitted = fit_lens_map(table, log_smoothing=None if choose_smoothing else smoothing)
        where = [stated[name].to_numpy(float)[rows] for name in ("zoom", "focus")]
        return {
            name: np.stack(
                [
                    fitted.value(name, *where),
                    fitted.sigma(name, *where),
                    measured[name][rows],
                    own[name][rows],
                ]
            )
            for name in measured
            if name in fitted.quantities
        }

    return predict


def _with_sigmas(full: LensMap) -> pd.DataFrame:
    """Give the samples of a map σ where they have none: those that the map found in the scatter."""
    stated = full.samples.copy()
    core = core_names(stated)
    known = all(f"sigma_{n}" in stated and stated[f"sigma_{n}"].notna().all() for n in core[:2])
    if not known:
        share = max(float(np.sqrt(full.core.noise_scale)), _LEAST_SIGMA)
        stated = stated.drop(columns=[c for c in stated if str(c).startswith(("cov_",))])
        stated = stated.drop(columns="sigma_sharpest_mm", errors="ignore")
        for name in core:
            stated[f"sigma_{name}"] = share * stated[name]
    for name, surface in full.single_surfaces.items():
        column = f"sigma_{name}"
        if column not in stated or stated[column].isna().any():
            least = _LEAST_SIGMA * float(stated[name].abs().max())
            stated[column] = max(float(np.sqrt(surface.noise_scale)), least, 1e-300)
    return stated


def _measured(
    stated: pd.DataFrame, full: LensMap
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Measured values and their σ, autofocus included."""
    measured, own = {}, {}
    for quantity in tame_quantities(stated):
        if quantity.name not in full.quantities or len(quantity.rows) < len(stated):
            continue
        values = np.exp(quantity.values) if quantity.is_logarithm else quantity.values
        sigma = np.sqrt(quantity.variances) if quantity.variances is not None else np.nan
        measured[quantity.name] = values
        own[quantity.name] = sigma * (values if quantity.is_logarithm else np.ones(len(values)))
    if full.has_standoff:
        distance, standoff = "object_distance_mm", "standoff_mm"
        measured["nodal_offset_mm"] = measured[distance] - measured[standoff]
        # The stop of the autofocus moves both alike, so that it drops out.
        own["nodal_offset_mm"] = stated[f"sigma_{distance}"].to_numpy(float)
    return {n: measured[n] for n in QUANTITIES if n in measured}, own


def _by_surfaces(samples: pd.DataFrame, choose_smoothing: bool) -> _Predict:
    """Predict each quantity of a foreign table by a surface of its own."""
    fits: dict[str, Any] = {}
    for quantity in tame_quantities(samples):
        known = quantity.variances is not None
        variances = quantity.variances if known else np.ones(len(quantity.rows))
        zoom, focus = (samples[n].to_numpy(float)[quantity.rows] for n in ("zoom", "focus"))
        full = fit_surfaces(
            zoom,
            focus,
            quantity.values[:, None],
            np.asarray(variances)[:, None, None],
            estimate_noise=not known,
        )
        scale = max(full.noise_scale, _LEAST_SIGMA**2)
        fits[quantity.name] = quantity, zoom, focus, np.asarray(variances) * scale, full

    def predict(rows: IntArray) -> dict[str, FloatArray]:
        found = {}
        for name, (quantity, zoom, focus, variances, full) in fits.items():
            out = np.isin(quantity.rows, rows)
            fitted = fit_surfaces(
                zoom,
                focus,
                quantity.values[:, None],
                np.where(out, variances * _LEFT_OUT**2, variances)[:, None, None],
                log_smoothing=None if choose_smoothing else full.log_smoothing,
            )
            four = np.full((4, len(rows)), np.nan)
            place = np.isin(rows, quantity.rows)
            four[0, place] = fitted.value(zoom[out], focus[out])[:, 0]
            four[1, place] = np.sqrt(fitted.covariance_at(zoom[out], focus[out])[:, 0, 0])
            four[2, place], four[3, place] = quantity.values[out], np.sqrt(variances[out])
            if quantity.is_logarithm:
                four[[0, 2]] = np.exp(four[[0, 2]])
                four[[1, 3]] *= four[2]
            found[name] = four
        return found

    return predict
