"""How fast a lens map answers at random settings, beside scipy's own spline of the same grid.

One million random settings, answered by a map and by ``RectBivariateSpline.ev`` through as many
values, in one run and alternating order, on one thread; CPU seconds of the fastest round of each
count. A map checks its domain on the way. Wanted: d/D within 1.5 times the spline, with σ within
6 times. On a strip focus is counted across what was sampled at each zoom; near infinity the
surfaces are of 1/D and its like instead of logarithms, and have to be turned back.
Contours and the inverse are in ``benchmarks/contours.py``.

    OMP_NUM_THREADS=1 python benchmarks/maps.py [--settings 1000000] [--rounds 7] [--grid 8]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy.interpolate import RectBivariateSpline

from lenscal.arrays import FloatArray
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap

#: Zoom and, at both of its ends and in between, lowest and highest focus of a lens that is not
#: parfocal: the strip of the simulated machine-vision lens.
STRIP_ZOOM = (0.0, 807.0, 1614.0, 2420.0, 3227.0)
STRIP_LOW = (6039.0, 6268.0, 6098.0, 4876.0, 1353.0)
STRIP_HIGH = (6379.0, 6941.0, 7538.0, 8103.0, 8374.0)


def rectangle(count: int) -> tuple[FloatArray, FloatArray]:
    """Give the settings of a regular grid."""
    zoom, focus = np.meshgrid(np.linspace(90, 110, count), np.linspace(60, 140, count))
    return zoom.T.ravel(), focus.T.ravel()


def strip(count: int) -> tuple[FloatArray, FloatArray]:
    """Give settings in as many columns over a curved strip."""
    zoom = np.repeat(np.linspace(STRIP_ZOOM[0], STRIP_ZOOM[-1], count), count)
    low, high = (np.interp(zoom, STRIP_ZOOM, ends) for ends in (STRIP_LOW, STRIP_HIGH))
    return zoom, low + np.tile(np.linspace(0, 1, count), count) * (high - low)


def map_over(zoom: FloatArray, focus: FloatArray, *, to_infinity: bool = False) -> LensMap:
    """Fit a map of an invented lens to samples at given settings."""
    x, y = ((v - v.min()) / np.ptp(v) for v in (zoom, focus))
    magnification = 0.1 * np.exp(0.8 * x + 0.2 * y + 0.1 * np.sin(3 * x))
    distance_mm = 600 * np.exp(0.3 * x - 0.2 * y + 0.1 * x * y)
    if to_infinity:
        low, high = (np.interp(zoom, STRIP_ZOOM, ends) for ends in (STRIP_LOW, STRIP_HIGH))
        distance_mm = 300 * np.exp(0.3 * x) / (0.02 + (focus - low) / (high - low))
        magnification = 20 * np.exp(0.8 * x) / distance_mm
    columns = {
        "zoom": zoom,
        "focus": focus,
        "magnification": magnification,
        "object_distance_mm": distance_mm,
        "sigma_magnification": 1e-4 * magnification,
        "sigma_object_distance_mm": 3e-3 * distance_mm,
        "standoff_mm": distance_mm + 100,
        "sigma_sharpest_mm": 5e-4 * distance_mm,
    }
    return fit_lens_map(pd.DataFrame(columns))


def settings_inside(
    lens_map: LensMap, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw settings over the domain of a map."""
    zoom, focus = (
        rng.uniform(*ends, 30 * count) for ends in (lens_map.domain.zoom, lens_map.domain.focus)
    )
    inside = np.flatnonzero(lens_map.domain.contains(zoom, focus))[:count]
    return zoom[inside], focus[inside]


def fastest_s(tasks: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Run tasks in alternating order and give the fastest time of each."""
    taken = dict.fromkeys(tasks, np.inf)
    for turn in range(rounds):
        for name in list(tasks)[:: 1 if turn % 2 == 0 else -1]:
            start = time.process_time()
            tasks[name]()
            taken[name] = min(taken[name], time.process_time() - start)
    return taken


def run(name: str, lens_map: LensMap, grid: int, count: int, rounds: int, seed: int) -> None:
    """Time one map and print each task beside the spline."""
    rng = np.random.default_rng(seed)
    zoom, focus = settings_inside(lens_map, count, rng)
    axes = [np.linspace(*ends, grid) for ends in (lens_map.domain.zoom, lens_map.domain.focus)]
    spline = RectBivariateSpline(*axes, rng.normal(size=(grid, grid)))
    domain = lens_map.domain

    def with_sigma(quantity: str) -> None:
        lens_map.value(quantity, zoom, focus)
        lens_map.sigma(quantity, zoom, focus)

    taken = fastest_s(
        {
            "RectBivariateSpline.ev": lambda: spline.ev(zoom, focus),
            "domain alone": lambda: domain.contains(zoom, focus),
            "d/D": lambda: lens_map.magnification(zoom, focus),
            "d/D and its σ": lambda: with_sigma("magnification"),
            "f": lambda: lens_map.focal_length_mm(zoom, focus),
            "f and its σ": lambda: with_sigma("focal_length_mm"),
            "slope of d/D by zoom": lambda: lens_map.derivative(
                "magnification", zoom, focus, by="zoom"
            ),
        },
        rounds,
    )
    peer = taken["RectBivariateSpline.ev"]
    powers = ", ".join(f"{power:g}" for power in lens_map.core.powers)
    print(f"\n{name}: {grid} × {grid} samples, powers {powers}, {len(zoom)} settings\n")
    for task, seconds in taken.items():
        print(f"  {task:24s} {1e3 * seconds:7.0f} ms  {seconds / peer:5.2f} ×")


def main() -> None:
    """Time maps over a rectangle and over a strip."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--settings", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--grid", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    maps = {
        "rectangle": map_over(*rectangle(given.grid)),
        "strip": map_over(*strip(given.grid)),
        "strip to infinity": map_over(*strip(given.grid), to_infinity=True),
    }
    for name, lens_map in maps.items():
        run(name, lens_map, given.grid, given.settings, given.rounds, given.seed)


if __name__ == "__main__":
    main()
