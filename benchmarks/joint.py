"""What the joint refinement gains over fit-then-smooth: 5 × 5 settings, two seen squarely only.

Corners with 0.1 px of noise, five views a setting (focus, four tilted), poses free; at two settings
the tilted ones are missing. What a square view knows is d/D, to a hundredth of a per cent; D and f
it does not know at all. Four maps of f and of D are compared with the truth over the plane:

* "quantity": smoothed by itself on its marginal σ — square views add nothing;
* "d/D and D": each smoothed on its marginal σ, f derived by (5c), as a map does;
* "full": d/D and D smoothed together with their full covariance, as far as they were calibrated;
* "joint": the map refined on all corners, square views included.

Scenes: "strip" is the machine-vision lens, whose square views lie at two ends of its strip; "long"
the vicon-1990 lens, at both corners of the long end; "inside" the same, among others; "tilted" and
"tilted-strip" have tilts everywhere.

    OMP_NUM_THREADS=1 python benchmarks/joint.py [--scene strip] [--sessions 8] [--figure joint.png]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import map_accuracy
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lenscal.arrays import FloatArray
from lenscal.calibration.sweep import calibrate_recording
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.joint import refine_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.maps.strip import Strip
from lenscal.maps.surface import fit_surfaces
from lenscal.plate import Plate
from lenscal.pose import Pose
from lenscal.recording import FocusResult, Head, Observation, Recording, SettingRecord, View
from lenscal.rig.simulated import SimulatedRig
from lenscal.rig.simulated.lens_truth import LensTruth
from lenscal.setting import LensSetting
from lenscal.target import Chessboard

NOISE_PX = 0.1
BOARD = Chessboard(15, 11, 3.0)
MAPS = ("quantity", "d/D and D", "full", "joint")
QUANTITIES = ("focal_length_mm", "object_distance_mm")


@dataclass(frozen=True, eq=False)
class Scene:
    """A lens, where it is sampled, and where it is judged.

    Parameters
    ----------
    settings
        (25, 2) zoom and focus.
    squarely
        Which of them are seen squarely only.
    truth
        Of a setting.
    target
        What is seen.
    part
        Corners of the target that fit into the image at a setting, and their middle in mm.
    tilt_deg
        Of the tilted views.
    zoom, focus
        (M,) the dense grid.
    """

    settings: FloatArray
    squarely: tuple[int, ...]
    truth: Callable[[LensSetting], LensTruth]
    target: Plate | Chessboard
    part: Callable[[LensTruth], tuple[np.ndarray, float]]
    tilt_deg: float
    zoom: FloatArray
    focus: FloatArray


def vicon(
    zooms: tuple[float, float], focuses: tuple[float, float], squarely: tuple[int, ...]
) -> Scene:
    """Sample a rectangle of the lens of 1990."""
    axes = [np.linspace(*ends, 5) for ends in (zooms, focuses)]
    dense = [np.linspace(*ends, n) for ends, n in ((zooms, 49), (focuses, 33))]
    settings = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    zoom, focus = (g.ravel() for g in np.meshgrid(*dense, indexing="ij"))
    everything = np.asarray(BOARD.ids()), 0.0
    rig = SimulatedRig.preset("vicon-1990")
    return Scene(settings, squarely, rig.truth, BOARD, lambda _: everything, 25.0, zoom, focus)


def strip(squarely: tuple[int, ...]) -> Scene:
    """Sample the strip of the lens that is not parfocal."""
    plan = map_accuracy.strip(count=5, dense=33)
    size = (map_accuracy.COLUMNS - 1) * (map_accuracy.ROWS - 1)

    def part(truth: LensTruth) -> tuple[np.ndarray, float]:
        board = map_accuracy.board_for(truth.magnification)
        return size * board + np.arange(size), map_accuracy.MIDDLES_MM[board]

    return Scene(
        plan.settings,
        squarely,
        map_accuracy.LENS.truth,
        map_accuracy.PLATE,
        part,
        20.0,
        plan.zoom,
        plan.focus,
    )


SCENES: dict[str, Callable[[], Scene]] = {
    "strip": lambda: strip((0, 24)),
    "tilted-strip": lambda: strip(()),
    "long": lambda: vicon((60, 100), (0, 140), (20, 24)),
    "inside": lambda: vicon((92, 104), (60, 140), (7, 16)),
    "tilted": lambda: vicon((92, 104), (60, 140), ()),
}


def recorded(scene: Scene, rng: np.random.Generator) -> Recording:
    """See the target at every setting, as the truth has it."""
    records = []
    for number, (zoom, focus) in enumerate(scene.settings.tolist()):
        truth = scene.truth(LensSetting(zoom, focus, 20.0))
        ids, middle_mm = scene.part(truth)
        azimuths = 0.35 + np.pi / 2 * np.arange(4)
        turns = [Pose.identity()]
        if number not in scene.squarely:
            turns += [
                Pose.from_rotation_vector(
                    np.radians(scene.tilt_deg) * np.array([np.cos(a), np.sin(a), 0])
                )
                for a in azimuths
            ]
        views = []
        for turn in turns:
            wobble = Pose.from_rotation_vector(1e-3 * rng.standard_normal(3))
            shift = Pose(np.eye(3), (-middle_mm, 0, 0))
            pose = Pose(np.eye(3), (0, 0, truth.object_distance_mm)) @ wobble @ turn @ shift
            pixels = truth.camera.project(pose.transform(scene.target.points_mm[ids]))
            inside = truth.camera.sensor.contains(pixels)
            noisy = pixels[inside] + NOISE_PX * rng.standard_normal((inside.sum(), 2))
            views.append(View(Observation.of(scene.target, ids[inside], noisy)))
        sharp = FocusResult(truth.standoff_mm, 0.02, 1.0, 20.0, np.zeros(0), np.zeros(0))
        records.append(SettingRecord(truth.setting, tuple(views), focus=sharp))
    sensor = scene.truth(LensSetting(*scene.settings[0].tolist(), 20.0)).camera.sensor
    return Recording(Head(sensor, scene.target), tuple(records))


def by_itself(rows: pd.DataFrame, name: str, scene: Scene) -> FloatArray:
    """Smooth a quantity on its own marginal σ, in the coordinates of the samples."""
    band = Strip.through(*scene.settings.T)
    values = rows[name].to_numpy(float)
    sigma = rows[f"sigma_{name}"].to_numpy(float) / values
    zoom, focus = (rows[motor].to_numpy(float) for motor in ("zoom", "focus"))
    surface = fit_surfaces(
        zoom, band.across(zoom, focus), np.log(values)[:, None], sigma[:, None, None] ** 2
    )
    return np.exp(surface.value(scene.zoom, band.across(scene.zoom, scene.focus))[:, 0])


def of_map(lens_map: LensMap, scene: Scene) -> dict[str, FloatArray]:
    """F and D of a map, also where its domain ends because a corner was not calibrated."""
    ratio, distance = np.exp(lens_map.core.value(scene.zoom, scene.focus, only=[0, 1])).T
    return dict(zip(QUANTITIES, (ratio * distance / (1 + ratio), distance), strict=True))


def study(scene: Scene, sessions: int) -> dict[str, dict[str, FloatArray]]:
    """Relative errors over the plane, (sessions, M), by quantity and map."""
    truths = [
        scene.truth(LensSetting(z, f, 20.0))
        for z, f in zip(scene.zoom.tolist(), scene.focus.tolist(), strict=True)
    ]
    errors: dict[str, dict[str, list[FloatArray]]] = {
        quantity: {name: [] for name in MAPS} for quantity in QUANTITIES
    }
    for seed in range(sessions):
        recording = recorded(scene, np.random.default_rng(seed))
        table = calibrate_recording(recording)
        rows = table.to_dataframe()
        separate = fit_lens_map(table)
        joint = of_map(refine_lens_map(separate, recording), scene)
        ratio, distance = (
            by_itself(rows, name, scene) for name in ("magnification", "object_distance_mm")
        )
        derived = dict(zip(QUANTITIES, (ratio * distance / (1 + ratio), distance), strict=True))
        full = of_map(separate, scene)
        for quantity in QUANTITIES:
            truth = np.array([getattr(t, quantity) for t in truths])
            found = by_itself(rows, quantity, scene), derived[quantity], full[quantity]
            for name, value in zip(MAPS, (*found, joint[quantity]), strict=True):
                errors[quantity][name].append(value / truth - 1)
    return {q: {name: np.array(e) for name, e in maps.items()} for q, maps in errors.items()}


def rms(errors: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(errors**2)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the comparison, and draw it if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", choices=SCENES, default="strip")
    parser.add_argument("--sessions", type=int, default=8)
    parser.add_argument("--figure")
    options = parser.parse_args(arguments)
    scene = SCENES[options.scene]()
    errors = study(scene, options.sessions)
    print(f"{options.scene}, {options.sessions} sessions")
    print("quantity            smoothed      rms %   worst %   joint over this, and by session")
    for quantity, maps in errors.items():
        joint = maps["joint"]
        for name, e in maps.items():
            each = [rms(j) / rms(o) for j, o in zip(joint, e, strict=True)]
            print(
                f"{quantity:19s} {name:10s} {100 * rms(e):8.3f} {100 * np.abs(e).max():9.2f}   "
                f"{rms(joint) / rms(e):.3f}   {min(each):.3f} to {max(each):.3f}"
            )
    if options.figure:
        draw(errors["focal_length_mm"], scene).savefig(options.figure, dpi=110)


def draw(errors: dict[str, FloatArray], scene: Scene) -> Figure:
    """Rms error of f of each map over the plane."""
    figure = Figure(figsize=(15, 4), layout="constrained")
    panels = figure.subplots(1, len(errors), sharey=True)
    found = {name: 100 * np.sqrt((e**2).mean(axis=0)) for name, e in errors.items()}
    top = max(float(np.quantile(r, 0.99)) for r in found.values())
    squarely = np.isin(np.arange(len(scene.settings)), scene.squarely)
    for axes, (name, values) in zip(panels, found.items(), strict=True):
        image = axes.scatter(scene.zoom, scene.focus, c=values, s=9, vmin=0, vmax=top)
        axes.plot(*scene.settings[~squarely].T, "o", color="black", ms=3)
        axes.plot(*scene.settings[squarely].T, "x", color="red", ms=9, mew=2)
        axes.set(title=name, xlabel="zoom")
    panels[0].set_ylabel("focus")
    figure.colorbar(image, ax=panels, label="rms error of f (%)")
    return figure


if __name__ == "__main__":
    main()
