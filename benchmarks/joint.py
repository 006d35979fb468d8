"""What the joint refinement gains over fit-then-smooth: 5 × 5 settings, two seen squarely only.

Corners of the simulated vicon-1990 lens with 0.1 px of noise, five views a setting (focus, four
tilted by 25°), poses free; at two settings the tilted ones are missing. Three maps of f are
compared with the truth over the plane: f smoothed by itself on its marginal σ; d/D and D smoothed
together with their full covariance; and the map refined jointly on all corners.

    OMP_NUM_THREADS=1 python benchmarks/joint.py [--sessions 10] [--figure joint.png]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lenscal.arrays import FloatArray
from lenscal.calibration.sweep import calibrate_recording
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.joint import refine_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.maps.surface import fit_surfaces
from lenscal.pose import Pose
from lenscal.recording import FocusResult, Head, Observation, Recording, SettingRecord, View
from lenscal.rig.simulated import SimulatedRig
from lenscal.setting import LensSetting
from lenscal.target import Chessboard

ZOOMS, FOCUSES = np.linspace(92, 104, 5), np.linspace(60, 140, 5)
FRONTAL = (7, 16)
NOISE_PX, TILT_DEG = 0.1, 25.0
BOARD = Chessboard(15, 11, 3.0)


def recorded(rng: np.random.Generator) -> Recording:
    """See the board at every setting, as the truth has it."""
    rig = SimulatedRig.preset("vicon-1990")
    records = []
    for number, (zoom, focus) in enumerate((z, f) for z in ZOOMS for f in FOCUSES):
        setting = LensSetting(float(zoom), float(focus), 20.0)
        truth = rig.truth(setting)
        azimuths = 0.35 + np.pi / 2 * np.arange(4)
        turns = [Pose.identity()]
        if number not in FRONTAL:
            turns += [
                Pose.from_rotation_vector(
                    np.radians(TILT_DEG) * np.array([np.cos(a), np.sin(a), 0])
                )
                for a in azimuths
            ]
        views = []
        for turn in turns:
            wobble = Pose.from_rotation_vector(1e-3 * rng.standard_normal(3))
            pose = Pose(np.eye(3), (0, 0, truth.object_distance_mm)) @ wobble @ turn
            pixels = truth.camera.project(pose.transform(BOARD.points_mm))
            inside = truth.camera.sensor.contains(pixels)
            noisy = pixels[inside] + NOISE_PX * rng.standard_normal((inside.sum(), 2))
            views.append(View(Observation.of(BOARD, BOARD.ids()[inside], noisy)))
        sharp = FocusResult(truth.standoff_mm, 0.02, 1.0, 20.0, np.zeros(0), np.zeros(0))
        records.append(SettingRecord(setting, tuple(views), focus=sharp))
    return Recording(Head(rig.camera.sensor, BOARD), tuple(records))


def f_by_itself(rows: pd.DataFrame, zoom: FloatArray, focus: FloatArray) -> FloatArray:
    """Smooth f on its own marginal σ."""
    f = rows["focal_length_mm"].to_numpy(float)
    sigma = rows["sigma_focal_length_mm"].to_numpy(float) / f
    surface = fit_surfaces(
        rows["zoom"],
        rows["focus"],
        np.log(f)[:, None],
        sigma[:, None, None] ** 2,
        estimate_noise=False,
        log_smoothing=None,
    )
    return np.exp(surface.value(zoom, focus)[..., 0])


def study(sessions: int) -> tuple[dict[str, list[FloatArray]], FloatArray, FloatArray]:
    """Relative errors of f over the plane, of each map and session."""
    zoom, focus = np.meshgrid(np.linspace(92, 104, 49), np.linspace(60, 140, 33), indexing="ij")
    rig = SimulatedRig.preset("vicon-1990")
    truth = np.vectorize(lambda z, f: rig.truth(LensSetting(z, f, 20.0)).focal_length_mm)(
        zoom, focus
    )
    errors: dict[str, list[FloatArray]] = {"f by itself": [], "full covariance": [], "joint": []}
    for seed in range(sessions):
        recording = recorded(np.random.default_rng(seed))
        table = calibrate_recording(recording)
        rows = table.to_dataframe()
        separate = fit_lens_map(table)
        joint = refine_lens_map(separate, recording)
        errors["f by itself"].append(f_by_itself(rows, zoom, focus) / truth - 1)
        for name, lens_map in (("full covariance", separate), ("joint", joint)):
            errors[name].append(f_of(lens_map, zoom, focus) / truth - 1)
    return errors, zoom, focus


def f_of(lens_map: LensMap, zoom: FloatArray, focus: FloatArray) -> FloatArray:
    """F of a map, also in the holes of its domain."""
    return np.asarray(lens_map.value("focal_length_mm", zoom, focus, outside="nan"))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the comparison, and draw it if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=10)
    parser.add_argument("--figure")
    options = parser.parse_args(arguments)
    errors, zoom, focus = study(options.sessions)
    stacked = {name: np.array(e) for name, e in errors.items()}
    for name, e in stacked.items():
        rms, worst = 100 * np.sqrt(np.nanmean(e**2)), 100 * np.nanmax(np.abs(e))
        print(f"{name:18s} rms error of f {rms:.3f} %, worst {worst:.2f} %")
    if options.figure:
        draw(stacked, zoom, focus).savefig(options.figure, dpi=110)


def draw(errors: dict[str, FloatArray], zoom: FloatArray, focus: FloatArray) -> Figure:
    """Rms error of each map over the plane."""
    figure = Figure(figsize=(12, 4), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    rms = {name: 100 * np.sqrt((e**2).mean(axis=0)) for name, e in errors.items()}
    top = max(float(np.nanmax(r)) for r in rms.values())
    for axes, (name, values) in zip(panels, rms.items(), strict=True):
        image = axes.pcolormesh(zoom, focus, values, cmap="viridis", vmin=0, vmax=top)
        z, f = np.meshgrid(ZOOMS, FOCUSES, indexing="ij")
        frontal = np.isin(np.arange(z.size), FRONTAL)
        axes.plot(z.ravel()[~frontal], f.ravel()[~frontal], "o", color="white", ms=4)
        axes.plot(z.ravel()[frontal], f.ravel()[frontal], "x", color="white", ms=9, mew=2)
        axes.set(title=name, xlabel="zoom")
    panels[0].set_ylabel("focus")
    figure.colorbar(image, ax=panels, label="rms error of f (%)")
    return figure


if __name__ == "__main__":
    main()
