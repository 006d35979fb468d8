"""How far a lens map is from the truth, and whether it knows: the whole way from corners to maps.

The simulated machine-vision lens is not parfocal: at each zoom only a band of focus settings puts
the sharp plane within reach. Settings are sampled there and recorded without pictures: corners of
the board are projected with the true camera and given noise, the robot slips, and the autofocus
stops where its σ lets it. What `calibrate_recording` and `fit_lens_map` make of it is compared with
the truth over a dense grid; then sessions are repeated with new noise, and the intervals counted
that hold the truth.

    OMP_NUM_THREADS=1 python benchmarks/map_accuracy.py --plan strip --farthest-mm 1200
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lenscal.arrays import FloatArray, IntArray
from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.refine import fit_poses
from lenscal.calibration.sweep import calibrate_recording
from lenscal.camera import Camera
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.plate import parse_target
from lenscal.pose import Pose
from lenscal.recording import FocusResult, Head, Observation, Recording, SettingRecord, View
from lenscal.rig.simulated.lens_truth import LensTruth
from lenscal.rig.simulated.machine_vision import machine_vision_lens
from lenscal.rig.simulated.presets import PRESETS
from lenscal.rig.simulated.world import PoseNoise
from lenscal.setting import LensSetting

LENS = machine_vision_lens()
HAND_FROM_CAMERA = PRESETS["machine-vision"].hand_from_camera
BASE_FROM_TARGET = PRESETS["machine-vision"].base_from_target
WIDE_OPEN = LENS.travel.iris[1]

#: The sharp planes that a session reaches. One step of the focus motor moves a plane at 1.2 m by
#: 1 % at the wide end, and by 2 % one at 2.5 m: no map can be better there than its motor.
NEAREST_MM, FARTHEST_MM = 300.0, 1200.0
NOISE_PX = 0.1
ROBOT = PoseNoise(0.02, 1e-4)
#: σ of the autofocus at two distances, and in a straight line between and beyond; about what
#: `benchmarks/autofocus.py` finds that it states, for a zoom in the middle.
AUTOFOCUS_MM = ((300.0, 0.02), (1200.0, 0.2))
#: Boards of 13 × 10 squares side by side, each twice as large as the next.
SQUARES_MM = (40.0, 20.0, 10.0, 5.0, 2.5)
MIDDLES_MM = (0.0, 450.0, 700.0, 830.0, 900.0)
COLUMNS, ROWS = 13, 10
PLATE = parse_target(
    "+".join(
        f"charuco:{COLUMNS}x{ROWS}:{s:g}mm:{0.75 * s:g}mm:DICT_4X4_1000:{65 * i}@{x:g},0"
        for i, (s, x) in enumerate(zip(SQUARES_MM, MIDDLES_MM, strict=True))
    )
)
#: Largest image of a square, so that the board stays within the image.
SQUARE_PX = 180.0
TILT_DEG = 20.0
TILTED = 3
#: Displaced views stand this share of D before and behind the sharp plane.
DISPLACED = 0.03
#: From this zoom on the bands have so much in common that a rectangle lies in them.
LONG_ZOOM = 2000.0
#: How far the spacing of the zooms goes from equal steps (0) to those of Chebyshev (1).
TO_CHEBYSHEV = 0.5

QUANTITIES = (
    "magnification",
    "object_distance_mm",
    "standoff_mm",
    "focal_length_mm",
    "image_distance_mm",
)
#: Worst error wanted, of each quantity, as a share of it; the standoff's as a share of D.
BARS = {
    "magnification": 2e-3,
    "object_distance_mm": 3e-3,
    "standoff_mm": 1e-3,
    "focal_length_mm": 3e-3,
}
#: Half the length of a 95 % interval, in σ.
IN_SIGMAS = 1.959964


@dataclass(frozen=True, eq=False)
class Plan:
    """Where a session samples, and where its map is judged.

    Parameters
    ----------
    settings
        (N, 2) zoom and focus of the samples.
    zoom, focus
        (M,) each: the dense grid.
    truth
        Of every quantity, (M,) on that grid.
    held_out
        Settings between the samples.
    """

    settings: FloatArray
    zoom: FloatArray
    focus: FloatArray
    truth: dict[str, FloatArray]
    held_out: FloatArray


def strip(count: int = 8, dense: int = 41, farthest_mm: float = FARTHEST_MM) -> Plan:
    """Sample the band of focus settings at each zoom; judge where D is within the same limits."""
    return _plan(lambda zooms: _bands(zooms, farthest_mm), count, dense)


def rectangle(count: int = 8, dense: int = 41, farthest_mm: float = FARTHEST_MM) -> Plan:
    """Sample a regular grid, which this lens has at the long end only."""

    def bands(zooms: FloatArray) -> FloatArray:
        inner = _bands(np.array([LONG_ZOOM, LENS.travel.zoom[1]]), farthest_mm)
        return np.tile([inner[:, 0].max(), inner[:, 1].min()], (len(zooms), 1))

    return _plan(bands, count, dense, first_zoom=LONG_ZOOM)


def zoom_shares(count: int) -> FloatArray:
    """Place zooms from 0 to 1, closer together towards the ends, where splines are held least.

    Between equal steps and those of Chebyshev.
    """
    even = np.linspace(0, 1, count)
    chebyshev = (1 - np.cos(np.pi * even)) / 2
    return np.asarray((1 - TO_CHEBYSHEV) * even + TO_CHEBYSHEV * chebyshev)


def _bands(zooms: FloatArray, farthest_mm: float) -> FloatArray:
    return np.array([LENS.focus_range(z, NEAREST_MM, farthest_mm) for z in zooms])


def _plan(
    bands: Callable[[FloatArray], FloatArray],
    count: int,
    dense: int,
    first_zoom: float = LENS.travel.zoom[0],
) -> Plan:
    ends = first_zoom, LENS.travel.zoom[1]
    sampled = ends[0] + (ends[1] - ends[0]) * zoom_shares(count)
    limits = bands(sampled)
    shares = np.linspace(0, 1, count)

    def within(zooms: FloatArray, between: FloatArray) -> FloatArray:
        # Between the samples, and where the plane is within reach.
        chords = np.stack([np.interp(zooms, sampled, limits[:, i]) for i in (0, 1)], axis=-1)
        reach = bands(zooms)
        low, high = np.maximum(chords[:, 0], reach[:, 0]), np.minimum(chords[:, 1], reach[:, 1])
        focuses = low[:, None] + (high - low)[:, None] * between
        return np.stack([np.repeat(zooms, len(between)), focuses.ravel()], axis=-1)

    settings = limits[:, :1] + np.diff(limits, axis=1) * shares
    grid = within(np.linspace(*ends, dense), np.linspace(0, 1, dense))
    truths = [truth_at(*setting) for setting in grid]
    middles = (sampled[1:] + sampled[:-1]) / 2 + 0.13 * np.diff(sampled)
    return Plan(
        np.stack([np.repeat(sampled, count), settings.ravel()], axis=-1),
        grid[:, 0],
        grid[:, 1],
        {name: np.array([getattr(t, name) for t in truths]) for name in QUANTITIES},
        within(middles, np.array([0.05, 0.3, 0.5, 0.8, 0.95])),
    )


def truth_at(zoom: float, focus: float) -> LensTruth:
    """Tell the truth about a setting."""
    return LENS.truth(LensSetting(float(zoom), float(focus), WIDE_OPEN))


def autofocus_sigma_mm(object_distance_mm: float) -> float:
    """Tell how well the sharp plane is found."""
    (near_mm, low_mm), (far_mm, high_mm) = AUTOFOCUS_MM
    return low_mm + (high_mm - low_mm) * (object_distance_mm - near_mm) / (far_mm - near_mm)


def record(settings: FloatArray, rng: np.random.Generator) -> Recording:
    """Record a session without pictures.

    Parameters
    ----------
    settings
        (N, 2) zoom and focus.
    rng
        Source of all noise.

    Returns
    -------
    Recording
        With corners, poses as the robot reported them, and what the autofocus found.
    """
    head = Head(LENS.sensor, PLATE, LENS.reference_setting, HAND_FROM_CAMERA, BASE_FROM_TARGET)
    return Recording(head, tuple(_record_setting(truth_at(*s), rng) for s in settings))


def _record_setting(truth: LensTruth, rng: np.random.Generator) -> SettingRecord:
    far_mm = truth.object_distance_mm
    sigma_mm = autofocus_sigma_mm(far_mm)
    standoff_mm = truth.standoff_mm + sigma_mm * rng.standard_normal()
    part = board_for(truth.magnification)
    first = 0.8 + TILTED * far_mm  # turns the three tilts differently at every setting
    azimuths = first + 2 * np.pi / TILTED * np.arange(TILTED)
    turns = np.radians(TILT_DEG) * np.stack(
        [np.cos(azimuths), np.sin(azimuths), 0 * azimuths], axis=-1
    )
    middle = Pose(np.eye(3), np.array([-MIDDLES_MM[part], 0.0, 0.0]))
    looks = [
        Pose(np.eye(3), np.array([0.0, 0.0, standoff_mm + by * far_mm])) @ middle
        for by in (0.0, -DISPLACED, DISPLACED)
    ] + [
        Pose(np.eye(3), np.array([0.0, 0.0, standoff_mm]))
        @ Pose.from_rotation_vector(turn)
        @ middle
        for turn in turns
    ]
    views = tuple(look_at(truth, part, look, rng) for look in looks)
    none = np.zeros(0)
    return SettingRecord(
        truth.setting, views, 0, FocusResult(standoff_mm, sigma_mm, 1.0, WIDE_OPEN, none, none)
    )


def board_for(magnification: float) -> int:
    """Choose the largest board that fits into the image."""
    images_px = np.array(SQUARES_MM) * magnification / LENS.sensor.pitch_x_mm
    return int(np.flatnonzero(images_px <= SQUARE_PX)[0])


def look_at(
    truth: LensTruth, part: int, reference_from_target: Pose, rng: np.random.Generator
) -> View:
    """Send the robot to a pose and find the corners of one board in what the camera sees.

    Parameters
    ----------
    truth
        The lens.
    part
        Which board.
    reference_from_target
        Where the target should stand before the reference camera.
    rng
        Source of all noise.

    Returns
    -------
    View
        The corners, and where the robot believes that it stood.
    """
    hand = BASE_FROM_TARGET @ reference_from_target.inverse() @ HAND_FROM_CAMERA.inverse()
    camera_from_hand = (HAND_FROM_CAMERA @ reference_from_camera(truth.nodal_offset_mm)).inverse()
    camera_from_target = camera_from_hand @ (hand @ ROBOT.draw(rng)).inverse() @ BASE_FROM_TARGET
    size = (COLUMNS - 1) * (ROWS - 1)
    ids = size * part + np.arange(size)
    exact = truth.camera.project(camera_from_target.transform(PLATE.points_mm[ids]))
    inside = LENS.sensor.contains(exact)
    seen = exact[inside] + NOISE_PX * rng.standard_normal((int(inside.sum()), 2))
    return View(Observation.of(PLATE, ids[inside], seen), hand)


def reference_from_camera(nodal_offset_mm: float) -> Pose:
    """Give the camera at a setting in the frame of the reference camera."""
    return Pose(np.eye(3), np.array([0.0, 0.0, -nodal_offset_mm]))


def fit_session(
    plan: Plan, rng: np.random.Generator, repeatability: Repeatability | None = None
) -> LensMap:
    """Record a session, calibrate it, with the robot as known or estimated, and fit its map."""
    recording = record(plan.settings, rng)
    return fit_lens_map(calibrate_recording(recording, repeatability=repeatability))


def errors(plan: Plan, lens_map: LensMap) -> dict[str, FloatArray]:
    """Error of every quantity over the dense grid, relative; the standoff's relative to D."""
    result = {}
    for name in QUANTITIES:
        base = plan.truth["object_distance_mm" if name == "standoff_mm" else name]
        value = lens_map.value(name, plan.zoom, plan.focus, outside="nan")
        result[name] = (value - plan.truth[name]) / base
    return result


def held(plan: Plan, lens_map: LensMap) -> dict[str, FloatArray]:
    """Tell where on the dense grid the stated intervals hold the truth: 1, 0, or NaN outside."""
    result = {}
    for name in QUANTITIES:
        error = lens_map.value(name, plan.zoom, plan.focus, outside="nan") - plan.truth[name]
        sigma = lens_map.sigma(name, plan.zoom, plan.focus, outside="nan")
        inside = np.abs(error) <= IN_SIGMAS * sigma
        result[name] = np.where(np.isnan(error), np.nan, inside)
    return result


def held_out_distances_px(
    plan: Plan, lens_map: LensMap, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Distance of the map's predictions from corners at settings that were not sampled.

    Parameters
    ----------
    plan
        With the settings held out.
    lens_map
        The map.
    rng
        Source of all noise.

    Returns
    -------
    refitted : float
        Mean distance in px with the pose of every view refitted.
    worst_refitted : float
        Largest of the mean distances of the settings.
    with_robot : float
        Mean distance with nothing refitted: the poses of the robot, the mounting as stated.
    """
    inside = lens_map.domain.contains(*plan.held_out.T)
    recording = record(plan.held_out[inside], rng)
    refitted, with_robot = [], []
    for setting in recording.settings:
        where = setting.setting.zoom, setting.setting.focus
        camera = lens_map.camera_at(*where)
        seen = [view.observation for view in setting.views]
        left = fit_poses(camera, [o.points_mm for o in seen], [o.pixels for o in seen])
        refitted.append(_mean_length(left))
        with_robot.append(
            _mean_length(
                predicted_px(camera, float(lens_map.nodal_offset_mm(*where)), setting.views)
            )
        )
    return float(np.mean(refitted)), float(np.max(refitted)), float(np.mean(with_robot))


def predicted_px(camera: Camera, nodal_offset_mm: float, views: Sequence[View]) -> list[FloatArray]:
    """Residuals of corners predicted from the map and from what the robot says alone."""
    camera_from_hand = (HAND_FROM_CAMERA @ reference_from_camera(nodal_offset_mm)).inverse()
    residuals = []
    for view in views:
        if view.base_from_hand is None:
            continue
        camera_from_target = camera_from_hand @ view.base_from_hand.inverse() @ BASE_FROM_TARGET
        points = camera_from_target.transform(view.observation.points_mm)
        residuals.append(camera.project(points) - view.observation.pixels)
    return residuals


def _mean_length(residuals: Sequence[FloatArray]) -> float:
    return float(np.linalg.norm(np.concatenate(list(residuals)), axis=1).mean())


def tenths(plan: Plan) -> IntArray:
    """Part the grid into ten pieces, five along the zoom and two across the band."""
    along = np.argsort(np.argsort(plan.zoom, kind="stable")) * 5 // len(plan.zoom)
    result = np.zeros(len(plan.zoom), dtype=np.int64)
    for piece in range(5):
        here = np.flatnonzero(along == piece)
        far = plan.truth["object_distance_mm"][here]
        result[here] = 2 * piece + (far > np.median(far))
    return result


def main() -> None:
    """Print accuracy of one session and coverage of many."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plan", choices=("strip", "rectangle"), default="strip")
    parser.add_argument("--farthest-mm", type=float, default=FARTHEST_MM)
    parser.add_argument("--sessions", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    plan = {"strip": strip, "rectangle": rectangle}[chosen.plan](farthest_mm=chosen.farthest_mm)
    rng = np.random.default_rng(chosen.seed)
    worst: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    covered: dict[str, list[FloatArray]] = {name: [] for name in QUANTITIES}
    distances = []
    for _ in range(chosen.sessions):
        lens_map = fit_session(plan, rng)
        for name, error in errors(plan, lens_map).items():
            worst[name].append(float(np.nanmax(np.abs(error))))
        for name, inside in held(plan, lens_map).items():
            covered[name].append(inside)
        distances.append(held_out_distances_px(plan, lens_map, rng))
    print(f"{chosen.plan}, {chosen.sessions} sessions\n")
    print("worst error in %, and how often the intervals hold in %")
    print("quantity                     first  median  largest    bar   covered least tenth")
    piece = tenths(plan)
    for name in QUANTITIES:
        bar = f"{100 * BARS[name]:.2f}" if name in BARS else "-"
        inside = np.array(covered[name])
        least = min(np.nanmean(inside[:, piece == i]) for i in range(10))
        print(
            f"{name:22s} {100 * worst[name][0]:11.3f} {100 * np.median(worst[name]):7.3f} "
            f"{100 * np.max(worst[name]):8.3f} {bar:>6s} {100 * np.nanmean(inside):9.1f} "
            f"{100 * least:10.1f}"
        )
    refitted, worst_setting, with_robot = np.array(distances).T
    print(
        f"\nheld-out settings: {refitted.mean():.4f} px with poses refitted (worst session "
        f"{refitted.max():.4f}, worst setting {worst_setting.max():.4f}), "
        f"{with_robot.mean():.2f} px with nothing refitted"
    )


if __name__ == "__main__":
    main()
