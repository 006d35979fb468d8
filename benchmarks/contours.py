"""How fast contours are beside contourpy, and whether the inverse of a map finds its way back.

Speed: one contour of a map, exact and with all quantities along it, beside contourpy's tracing of
a grid of 200 × 200 values that are there already; both get the levels in one run, in alternating
order, on one thread; fastest round. A map evaluates its own grid once; that is shown apart.
Inverse: random settings → two quantities → settings, on the map of the demo and on one that folds.

    OMP_NUM_THREADS=1 python benchmarks/contours.py [--settings 1000] [--rounds 200]
"""

from __future__ import annotations

import argparse
import itertools
import os
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import contourpy
import numpy as np
import pandas as pd

from lenscal.arrays import FloatArray
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap

MAP = Path(__file__).parents[1] / "data" / "vicon-1990" / "map.json"
LEVELS = {"magnification": 0.25, "object_distance_mm": 600.0, "focal_length_mm": 127.0}
NODES = 200
PAIRS = (
    ("magnification", "focal_length_mm"),
    ("magnification", "object_distance_mm"),
    ("magnification", "standoff_mm"),
    ("object_distance_mm", "standoff_mm"),
)


def folded_map() -> LensMap:
    """Fit a map none of whose quantities is monotone: pairs of them meet up to four times."""
    zooms, focuses = np.meshgrid(np.linspace(90, 110, 9), np.linspace(60, 140, 7))
    zoom, focus = zooms.ravel(), focuses.ravel()
    x, y = (zoom - 90) / 20, (focus - 60) / 80
    values = {
        "magnification": 0.2 * np.exp(0.4 * x - 0.8 * (y - 0.5 + 0.2 * x) ** 2),
        "object_distance_mm": 500 * np.exp(0.9 * (x - 0.45) ** 2 + 0.3 * np.sin(2.5 * y)),
        "standoff_mm": 400 * np.exp(0.05 * np.cos(3 * y + x)),
    }
    sigmas = {f"sigma_{name}": 1e-4 * value for name, value in values.items()}
    columns = {"zoom": zoom, "focus": focus, "sigma_sharpest_mm": np.full(zoom.shape, 0.1)}
    return fit_lens_map(pd.DataFrame(columns | values | sigmas))


def fastest_s(tasks: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Run tasks in alternating order and give the fastest time of each."""
    taken = dict.fromkeys(tasks, np.inf)
    for turn in range(rounds):
        for name in list(tasks)[:: 1 if turn % 2 == 0 else -1]:
            start = time.perf_counter_ns()
            tasks[name]()
            taken[name] = min(taken[name], 1e-9 * (time.perf_counter_ns() - start))
    return taken


def compare_speed(lens_map: LensMap, rounds: int) -> None:
    """Trace one contour of several quantities with both, and print the times."""
    zoom, focus = lens_map.domain.grid(NODES)
    print(
        f"{'':22} {'vertices':>8} {'contourpy ms':>12} {'ours ms':>8} {'ratio':>6} {'first ms':>9}"
    )
    for quantity, level in LEVELS.items():
        values = lens_map.value(quantity, zoom, focus, outside="nan")

        def peer(values: FloatArray = values, level: float = level) -> object:
            return contourpy.contour_generator(zoom, focus, values).lines(level)

        def ours(quantity: str = quantity, level: float = level) -> object:
            return lens_map.contour(quantity, level)

        # A copy of the map has no grid yet.
        def first(quantity: str = quantity, level: float = level) -> object:
            return replace(lens_map).contour(quantity, level)

        first_s = fastest_s({"first": first}, 5)["first"]
        taken = fastest_s({"peer": peer, "ours": ours}, rounds)
        vertices = sum(len(curve) for curve in lens_map.contour(quantity, level))
        print(
            f"{quantity:22} {vertices:8} {1e3 * taken['peer']:12.3f} {1e3 * taken['ours']:8.3f} "
            f"{taken['ours'] / taken['peer']:6.2f} {1e3 * first_s:9.1f}"
        )


def invert(name: str, lens_map: LensMap, pair: tuple[str, str], count: int) -> None:
    """Send random settings through the map and back, and print how far off they return."""
    rng = np.random.default_rng(0)
    ends = lens_map.domain.zoom, lens_map.domain.focus
    span = np.ptp(ends, axis=1)
    errors: list[float] = []
    found_counts, taken_s = Counter[int](), 0.0
    while len(errors) < count:
        zoom, focus = (rng.uniform(*end) for end in ends)
        if not lens_map.domain.contains(zoom, focus):
            continue
        wanted = {quantity: float(lens_map.value(quantity, zoom, focus)) for quantity in pair}
        start = time.perf_counter()
        found = lens_map.settings_for(**wanted)
        taken_s += time.perf_counter() - start
        away = [np.abs(np.array([s.zoom - zoom, s.focus - focus]) / span).max() for s in found]
        errors.append(float(min(away, default=np.inf)))
        found_counts[len(found)] += 1
    missed = int((np.array(errors) > 1e-6).sum())
    solutions = ", ".join(f"{n}: {times}" for n, times in sorted(found_counts.items()))
    print(
        f"{name:8} {' & '.join(pair):38} {missed:6} {max(errors):9.1e} "
        f"{1e3 * taken_s / count:7.2f}  {solutions}"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--settings", type=int, default=1000, help="random settings to invert")
    parser.add_argument("--rounds", type=int, default=200, help="how often each contour is timed")
    arguments = parser.parse_args()
    if os.environ.get("OMP_NUM_THREADS") != "1":
        parser.error("threads make times uneven; set OMP_NUM_THREADS=1")
    maps = {"vicon": LensMap.load(MAP), "folded": folded_map()}
    compare_speed(maps["vicon"], arguments.rounds)
    print(
        f"\n{arguments.settings} random settings, back from two quantities\n\n"
        f"{'map':8} {'quantities':38} {'missed':>6} {'worst':>9} {'ms each':>7}  solutions: times"
    )
    for (name, lens_map), pair in itertools.product(maps.items(), PAIRS):
        invert(name, lens_map, pair, arguments.settings)


if __name__ == "__main__":
    main()
