"""The simulated rigs, recorded and calibrated with the robot, against the truth.

5 × 5 settings a rig, ten views each: the focus view, four displaced by ±1.5 and ±3 mm, five tilted
by 20°, the iris closed until the one-pixel depth of field covers ±3 mm at (all but) every setting.
The arm repeats to 0.02 mm and 0.1 mrad, its hand-eye calibration is off by 0.05 mm and 0.2 mrad a
coordinate, as the rig states. Two minutes for vicon-1990, ten for machine-vision.

    OMP_NUM_THREADS=1 python benchmarks/rig_constrained.py [vicon-1990 | machine-vision]
"""

from __future__ import annotations

import sys
import tempfile
from typing import Any

import numpy as np

from lenscal.calibration.sweep import calibrate_recording
from lenscal.rig.simulated import SimulatedRig
from lenscal.session.plan import SessionPlan
from lenscal.session.runner import run_session
from lenscal.setting import LensSetting

VIEWS = {"displacements": ["-3 mm", "-1.5 mm", "1.5 mm", "3 mm"], "tilted": 5, "tilt_deg": 20}
PLANS: dict[str, dict[str, Any]] = {
    "vicon-1990": {
        "zoom": [92, 96, 100, 104, 108],
        "focus": [60, 80, 100, 120, 140],
        "autofocus": {"nearest": "362 mm", "farthest": "386 mm", "step": "1.5 mm", "iris": 100},
        "views": {**VIEWS, "iris": 14},
        "keep_frames": False,
    },
    # The band of focus settings that is sharp between 0.3 and 2.2 m at all five zooms.
    "machine-vision": {
        "zoom": [0, 807, 1600, 2420, 3227],
        "focus": [6280, 6305, 6330, 6355, 6380],
        "autofocus": {"nearest": "330 mm", "farthest": "2 m", "step": "8 mm", "iris": 75},
        "views": {**VIEWS, "iris": 7.5},
        "keep_frames": False,
    },
}


def study(preset: str, seed: int = 3) -> None:
    """Record, calibrate, compare, print."""
    rig = SimulatedRig.preset(preset, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        recording = run_session(SessionPlan.model_validate(PLANS[preset]), rig, f"{folder}/s")
    rows = calibrate_recording(recording).to_dataframe()
    truth = [rig.truth(LensSetting(row.zoom, row.focus, row.iris)) for row in rows.itertuples()]
    distance = np.array([t.object_distance_mm for t in truth])
    offset = np.array([t.nodal_offset_mm for t in truth])
    standoff = np.array([t.standoff_mm for t in truth])
    away = (rows["nodal_offset_mm"] - offset) / rows["sigma_nodal_offset_mm"]
    print(f"{preset}, {len(rows)} settings, D {distance.min():.0f} to {distance.max():.0f} mm")
    print(
        f"  offset: worst error {np.abs(away).max():.2f} σ, rms {np.sqrt((away**2).mean()):.2f} σ"
    )
    share = 100 * rows["sigma_nodal_offset_mm"] / distance
    print(f"  σ(offset)/D: {share.min():.3f} to {share.max():.3f} %")
    share = 100 * rows["sigma_object_distance_mm"] / distance
    print(f"  σ(D)/D: {share.min():.3f} to {share.max():.3f} %")
    ratio = rows["sigma_standoff_mm"] / rows["sigma_sharpest_mm"]
    print(f"  σ(standoff) / σ of the autofocus: at most {ratio.max():.3f}")
    error = rows["standoff_mm"] - standoff
    print(f"  standoff: rms error {np.sqrt((error**2).mean()):.3f} mm")


if __name__ == "__main__":
    for name in sys.argv[1:] or PLANS:
        study(name)
