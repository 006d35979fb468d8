"""How often check_consistency cries wolf, and what it finds: whole sessions of a simulated lens.

Sessions of the machine-vision lens, 8 × 8 settings along its strip, corners to calibration as in
`benchmarks/map_accuracy.py`. Clean tables should raise no alarm; then D, d and f of one setting are
spoilt, at corners, borders and inside, and it is counted where that setting, and no other, is
flagged.

    OMP_NUM_THREADS=1 python benchmarks/consistency.py [--sessions 20] [--spoilt-by 0.03]
"""

from __future__ import annotations

import argparse

import map_accuracy
import numpy as np

from lenscal.calibration.sweep import calibrate_recording
from lenscal.maps.consistency import check_consistency

#: Corners, borders and inner settings of 8 × 8, zoom by zoom.
PLACES = {"corner": (0, 7, 56, 63), "border": (3, 24, 39, 60), "inside": (18, 27, 45, 54)}
SPOILT = ("object_distance_mm", "image_distance_mm", "focal_length_mm")


def main() -> None:
    """Print alarms on clean tables, and which spoilt settings are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--spoilt-by", type=float, default=0.03)
    parser.add_argument("--seed", type=int, default=1000)
    chosen = parser.parse_args()
    plan = map_accuracy.strip()
    alarms = []
    for session in range(chosen.sessions):
        rng = np.random.default_rng(chosen.seed + session)
        table = calibrate_recording(map_accuracy.record(plan.settings, rng)).to_dataframe()
        found = check_consistency(table)
        alarms.append(int(found["flagged"].sum()))
        worst = found.loc[found["sigmas"].abs().idxmax()]
        print(
            f"session {session}: {alarms[-1]} flagged; worst {worst['sigmas']:.1f} of "
            f"{worst['threshold']:.1f} σ, {worst['worst_quantity']} at zoom {worst['zoom']:.0f}, "
            f"focus {worst['focus']:.0f}",
            flush=True,
        )
    print(f"alarms on {np.count_nonzero(alarms)} of {chosen.sessions} clean tables")
    for place, rows in PLACES.items():
        named = []
        for row in rows:
            bad = table.copy()
            bad.loc[row, [c for c in SPOILT if c in bad]] *= 1 + chosen.spoilt_by
            named.append(np.flatnonzero(check_consistency(bad)["flagged"]).tolist() == [row])
        print(f"{place}: {sum(named)} of {len(rows)} spoilt settings named, and no other")


if __name__ == "__main__":
    main()
