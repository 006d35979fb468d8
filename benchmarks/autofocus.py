"""How well autofocus knows itself: error of the distance against its bar and its stated σ.

Every setting of a grid is focused with noise, and the plane is measured with the truth of the
simulated rig where the camera was left: its depth should be D. Hand-eye and target are taken as
known, since their errors shift all settings alike. The machine-vision lens is searched from about
0.75 to 1.3 times the true standoff, drawn at random.

    python benchmarks/autofocus.py [--seed 1] [--figure docs/images/autofocus.png]
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from lenscal.arrays import FloatArray
from lenscal.errors import FocusError, LensCalError
from lenscal.plots.focus import draw_errors, draw_focus_curve, draw_measures
from lenscal.rig.simulated import SimulatedRig
from lenscal.rig.simulated.presets import PRESETS
from lenscal.rig.simulated.world import PoseNoise
from lenscal.session.aim import hand_pose
from lenscal.session.autofocus import autofocus
from lenscal.session.disk_search import find_disk
from lenscal.session.exposure import expose
from lenscal.session.focus_peak import fit_peak
from lenscal.session.plan import AutofocusPlan
from lenscal.session.runner import points_of_interest
from lenscal.session.sharpness import MEASURES, Measure
from lenscal.setting import LensSetting
from lenscal.target import Disk

NO_ERROR = PoseNoise(0.0, 0.0)


#: Standoffs at which the simulated lens of the paper is searched, and its settings as shares of the
#: travel.
VICON_STANDOFFS_MM = (362.0, 386.0)
VICON_SHARES = ((0.05, 0.3, 0.5, 0.65, 0.8, 0.9, 0.97), (0.1, 0.4, 0.7, 0.95))
#: The same for the machine-vision lens; most of these settings focus on nothing or beyond reach.
MACHINE_VISION_STANDOFFS_MM = (330.0, 2000.0)
MACHINE_VISION_SHARES = (tuple(np.linspace(0.02, 0.98, 9)), tuple(np.linspace(0.0, 1.0, 41)))
MOST_SETTINGS = 30


def settings_of(preset: str, rig: SimulatedRig, rng: np.random.Generator) -> list[LensSetting]:
    """List settings, wide open and in random order, whose sharp plane can be reached."""
    vicon = preset == "vicon-1990"
    shares = VICON_SHARES if vicon else MACHINE_VISION_SHARES
    nearest_mm, farthest_mm = VICON_STANDOFFS_MM if vicon else MACHINE_VISION_STANDOFFS_MM
    travel, settings = rig.lens.travel, []
    for zoom, focus in itertools.product(*shares):
        setting = LensSetting(
            float(np.interp(zoom, (0, 1), travel.zoom)),
            float(np.interp(focus, (0, 1), travel.focus)),
            travel.iris[1],
        )
        try:
            standoff_mm = rig.truth(setting).standoff_mm
        except LensCalError:
            continue  # no sharp plane at any finite distance
        if nearest_mm <= standoff_mm <= farthest_mm:
            settings.append(setting)
    return [settings[i] for i in rng.permutation(len(settings))[:MOST_SETTINGS]]


def search_of(preset: str, standoff_mm: float, rng: np.random.Generator) -> AutofocusPlan:
    """Say where to search."""
    if preset == "vicon-1990":
        nearest_mm, farthest_mm = VICON_STANDOFFS_MM
        step_mm = 1.5
    else:
        nearest_mm = standoff_mm * rng.uniform(0.7, 0.85)
        farthest_mm = standoff_mm * rng.uniform(1.2, 1.45)
        step_mm = nearest_mm / 40
    return AutofocusPlan(
        nearest=f"{nearest_mm} mm", farthest=f"{farthest_mm} mm", step=f"{step_mm} mm", iris=0
    )


def run(preset: str, seed: int) -> None:
    """Focus at every setting of a preset and print what came of it."""
    rng = np.random.default_rng(seed)
    rig = SimulatedRig.preset(preset, seed=seed, mounting_error=NO_ERROR)
    print(f"\n{preset}, seed {seed}\n")
    print("  zoom   focus      D mm  fifth of DOF  bar mm  error mm     σ mm  error/σ  pictures")
    ratios, shares = [], []
    for setting in settings_of(preset, rig, rng):
        rig.lens.move_to(setting)
        truth = rig.truth(setting)
        row = f"{setting.zoom:6.1f} {setting.focus:7.1f} {truth.object_distance_mm:9.1f}"
        search = search_of(preset, truth.standoff_mm, rng)
        try:
            point_mm = disk_to_focus_on(rig, truth.magnification)
            result = autofocus(rig, search.standoffs_mm(), point_mm=point_mm)
        except FocusError as error:
            print(f"{row}  not focused: {error}")
            shares.append(np.inf)
            continue
        fifth_mm = depth_of_field_mm(rig, setting) / 5
        bar_mm = min(0.002 * truth.object_distance_mm, fifth_mm)
        error_mm = depth_mm(rig) - truth.object_distance_mm
        ratios.append(error_mm / result.sigma_mm)
        shares.append(abs(error_mm) / bar_mm)
        print(
            f"{row} {fifth_mm:13.3f} {bar_mm:7.3f} {error_mm:9.3f} {result.sigma_mm:8.3f} "
            f"{ratios[-1]:8.2f} {len(result.curve):9d}"
        )
    print(
        f"\n{len(shares)} settings, {sum(s <= 1 for s in shares)} within the bar, worst "
        f"{max(shares):.2f} of it; rms of error/σ {np.sqrt(np.mean(np.square(ratios))):.2f}"
    )


def disk_to_focus_on(rig: SimulatedRig, magnification: float) -> tuple[float, float]:
    """Choose the disk of the plate whose image comes nearest to 150 px across."""
    pitch_mm = float(rig.camera.sensor.sample_pitch_mm.min())
    disks = [
        (abs(np.log(part.diameter_mm * magnification / pitch_mm / 150)), centre)
        for part, centre in rig.target.parts
        if isinstance(part, Disk)
    ]
    return min(disks)[1]


def depth_mm(rig: SimulatedRig) -> float:
    """Depth at which the axis truly meets the plane of the target."""
    camera_from_target = rig.true_camera_from_target()
    normal = camera_from_target.rotation[:, 2]
    return float(normal @ camera_from_target.translation_mm / normal[2])


def draw_comparison(path: Path) -> None:
    """Draw one focus curve, all measures over a sweep, and what each of them finds."""
    rig = SimulatedRig.preset("vicon-1990", seed=1, mounting_error=NO_ERROR)
    point_mm, _ = points_of_interest(rig.target)
    setting = LensSetting(80.0, 60.0, 100.0)
    rig.lens.move_to(setting)
    result = autofocus(rig, np.linspace(*VICON_STANDOFFS_MM, 17).tolist(), point_mm=point_mm)
    figure = Figure(figsize=(16, 6), layout="constrained")
    curve, measures, bias = figure.subplots(1, 3)
    draw_focus_curve(curve, result)
    curve.set_title("Autofocus at zoom 80, focus 60, iris open")
    places_mm, scores = long_sweep(rig, setting, half_mm=28.0, pictures=57)
    draw_measures(measures, places_mm, scores)
    measures.set_title("All measures over a long sweep there")
    zooms = (50.0, 65.0, 80.0, 90.0, 100.0, 106.0)
    found = [errors_of(rig, LensSetting(zoom, 60.0, 100.0)) for zoom in zooms]
    field_mm = np.array([depth_of_field_mm(rig, LensSetting(z, 60.0, 100.0)) for z in zooms])
    draw_errors(bias, field_mm, {m: np.array([f[m] for f in found]) for m in Measure})
    bias.set_title("What each measure finds, long to wide end")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    print(f"\nfigure written to {path}")


def long_sweep(
    rig: SimulatedRig, setting: LensSetting, half_mm: float, pictures: int
) -> tuple[FloatArray, dict[Measure, FloatArray]]:
    """Score all measures about the true sharpest standoff; places are given relative to it."""
    point_mm, _ = points_of_interest(rig.target)
    rig.lens.move_to(setting)
    sharpest_mm = rig.truth(setting).standoff_mm
    rig.positioner.move_to(hand_pose(rig, sharpest_mm, point_mm))
    expose(rig.camera)
    places_mm = np.linspace(-half_mm, half_mm, pictures)
    scores = []
    for place_mm in places_mm:
        rig.positioner.move_to(hand_pose(rig, sharpest_mm + float(place_mm), point_mm))
        image = rig.camera.grab().image
        disk = find_disk(image)
        scores.append([MEASURES[measure].score(image, disk) for measure in Measure])
    return places_mm, dict(zip(Measure, np.array(scores).T, strict=True))


def errors_of(rig: SimulatedRig, setting: LensSetting) -> dict[Measure, float]:
    """Fit the peak of every measure in a sweep of two depths of field to both sides, in mm."""
    half_mm = 2 * depth_of_field_mm(rig, setting)
    places_mm, scores = long_sweep(rig, setting, half_mm, pictures=61)
    vergence = 1 / rig.truth(setting).object_distance_mm, 0.0
    found = {}
    for measure, values in scores.items():
        power = MEASURES[measure].width_power
        try:
            fit = fit_peak(places_mm, values, vergence=vergence, width_power=power)
        except FocusError:
            found[measure] = np.nan
        else:
            found[measure] = fit.position
    return found


def depth_of_field_mm(rig: SimulatedRig, setting: LensSetting) -> float:
    """Depth within which a·d·|1/z − 1/D| stays below a pixel, on the near side of the plane."""
    truth = rig.truth(setting)
    pitch_mm = float(rig.camera.sensor.sample_pitch_mm.min())
    aperture_mm2 = truth.entrance_pupil_diameter_mm * truth.image_distance_mm
    near_mm = 1 / (1 / truth.object_distance_mm + pitch_mm / aperture_mm2)
    return truth.object_distance_mm - near_mm


def main() -> None:
    """Run the studies of the presets that exist, then draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--figure", type=Path, default=None)
    arguments = parser.parse_args()
    for preset in PRESETS:
        run(preset, arguments.seed)
    if arguments.figure is not None:
        draw_comparison(arguments.figure)


if __name__ == "__main__":
    main()
