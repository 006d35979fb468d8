"""How the cost of a plan for many targets grows with the targets and with the faces of the part.

The part is a plate with round pockets and bosses, 28 mm apart. How finely they are tessellated sets
the number of faces: of all of them, so that the pockets that are looked into have more corners too,
or of those without a target alone. Targets are patches of 8 × 6 mm on pocket floors and boss tops,
which are to be resolved and inside the image.

CPU seconds of one process are stated, so that other work on the machine does not count: of
preparing the scene once, of planning every target by itself (regions, viewpoints, their audit), of
judging all candidates for all targets, and of choosing the fewest viewpoints and ordering them.

    OMP_NUM_THREADS=1 python benchmarks/many_targets.py [--figure docs/images/many-targets.png]
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import Manifold, OpType

from lenscal.maps.lens_map import LensMap
from lenscal.progress import Progress, silent
from planning.boolean import from_manifold
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.resolution import Resolution
from planning.scene import Scene
from planning.several import CoveringPlan, plan_all
from planning.solid import box_workspace
from planning.target import Target
from planning.task import Task
from planning.visibility.exact_test import ExactTest

MAP = Path(__file__).parents[1] / "data" / "vicon-1990" / "map.json"
COLUMNS, ROWS, PITCH_MM = 15, 14, 28.0
ASKED = (Resolution(2, 0.254, "x"), FieldOfView(8, "x"), Incidence(60))
#: Sides of each pocket and boss, and about how many faces that makes.
SIDES = (6, 12, 24, 48)
TARGETS = (25, 50, 100, 200)
USUAL_SIDES, USUAL_TARGETS = 24, 50


def plate(sides: int, coarse: frozenset[str] = frozenset()) -> Scene:
    """A plate with pockets and bosses in turn; those that are named stay at the usual sides."""
    holes, bosses = [], []
    fine = sides
    for column, row, x, y in sites():
        sides = USUAL_SIDES if f"{column}/{row}" in coarse else fine
        if (column + row) % 2:
            hole = Manifold.cylinder(12.0, 10.0, 11.0, circular_segments=sides)
            holes.append(hole.translate([x, y, -10.0]))
        else:
            boss = Manifold.cylinder(14.0, 9.0, 8.0, circular_segments=sides)
            bosses.append(boss.translate([x, y, -2.0]))
    block = Manifold.cube([COLUMNS * PITCH_MM, ROWS * PITCH_MM, 20.0]).translate([0, 0, -20.0])
    body = Manifold.batch_boolean([block, *bosses], OpType.Add)
    body = Manifold.batch_boolean([body, *holes], OpType.Subtract)
    return Scene([trimesh.Trimesh(*from_manifold(body), process=False)], ["plate"])


def sites() -> Iterator[tuple[int, int, float, float]]:
    """Column, row and middle of each pocket or boss."""
    for column in range(COLUMNS):
        for row in range(ROWS):
            yield column, row, (column + 0.5) * PITCH_MM, (row + 0.5) * PITCH_MM


def tasks(count: int) -> list[Task]:
    """As many targets, spread over the plate."""
    workspace = box_workspace(
        (-100, -100, 40), (COLUMNS * PITCH_MM + 100, ROWS * PITCH_MM + 100, 900)
    )
    every = list(sites())
    found = []
    for k in np.random.default_rng(0).permutation(len(every))[:count]:
        column, row, x, y = every[k]
        z = -10.0 if (column + row) % 2 else 12.0
        corners = np.array([[x - 4, y - 3], [x + 4, y - 3], [x + 4, y + 3], [x - 4, y + 3]])
        feature = Target.segment((x - 4, y, z), (x + 4, y, z))
        found.append(
            Task(
                Target(np.insert(corners, 2, z, axis=1)),
                feature,
                ASKED,
                workspace,
                f"{column}/{row}",
            )
        )
    return found


class Stages:
    """CPU seconds of each stage of a plan."""

    def __init__(self) -> None:
        self.ended: dict[str, float] = {}

    @contextmanager
    def __call__(self, title: str) -> Iterator[Progress]:
        """Measure one stage."""
        start = time.process_time()
        with silent(title) as tell:
            yield tell
        self.ended[title] = time.process_time() - start


def measure(sides: int, count: int, lens: LensMap, elsewhere: bool = False) -> dict[str, float]:
    """Plan for so many targets on a part of so many faces, more of them elsewhere alone or all."""
    asked = tasks(count)
    scene = plate(sides, frozenset(task.name for task in asked if elsewhere))
    start = time.process_time()
    for body in scene.bodies:
        _ = body.parts
    ExactTest(scene)
    prepared = time.process_time() - start
    stages = Stages()
    start, wall = time.process_time(), time.perf_counter()
    found: CoveringPlan = plan_all(asked, lens, scene, progress=stages)
    whole = time.process_time() - start
    rest = whole - sum(stages.ended.values())
    row = {
        "faces": len(scene.triangles_mm),
        "targets": count,
        "prepare": prepared,
        "plan": stages.ended["planning"],
        "judge": stages.ended["judging"],
        "choose": rest,
        "each_ms": 1e3 * whole / count,
        "wall": time.perf_counter() - wall,
        "viewpoints": len(found.viewpoints),
        "at_least": found.cover.at_least,
        "uncovered": len(found.uncovered),
        "candidates": found.candidates,
        "travel": found.route.travel_mm,
    }
    print(
        f"{row['faces']:7d} {count:7d} {prepared:8.2f} {row['plan']:8.2f} {row['judge']:8.2f} "
        f"{rest:8.2f} {row['each_ms']:9.1f} {row['wall']:8.1f} {row['candidates']:10d} "
        f"{row['viewpoints']:10d} {row['at_least']:8d} {row['uncovered']:9d} {row['travel']:9.0f}",
        flush=True,
    )
    return row


def draw(
    by_targets: list[dict[str, float]],
    by_faces: list[dict[str, float]],
    by_faces_elsewhere: list[dict[str, float]],
    out: Path,
) -> None:
    """Draw CPU seconds against targets, and per target against faces."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    count = np.array([row["targets"] for row in by_targets])
    parts = {"plan each target": "plan", "judge all": "judge", "choose and order": "choose"}
    colours = ("#0072b2", "#e69f00", "#009e73")
    for (label, key), colour in zip(parts.items(), colours, strict=True):
        left.loglog(count, [row[key] for row in by_targets], "o-", color=colour, label=label)
    whole = np.array([row["each_ms"] * row["targets"] / 1e3 for row in by_targets])
    left.loglog(count, whole, "ko-", label="all")
    left.loglog(count, whole[0] * count / count[0], "k:", label="∝ targets")
    left.set(xlabel="targets", ylabel="CPU s", xticks=count)
    left.set_xticklabels([f"{c:.0f}" for c in count])
    left.set_ylim(0.5, 400)
    left.set_title(f"{by_targets[0]['faces']:,.0f} faces")
    for rows, colour, label in (
        (by_faces, "#d55e00", "finer everywhere"),
        (by_faces_elsewhere, "black", "finer where no target is"),
    ):
        faces = np.array([row["faces"] for row in rows])
        each = np.array([row["each_ms"] for row in rows])
        right.semilogx(faces, each, "o-", color=colour, label=label)
    faces = np.array([row["faces"] for row in by_faces])
    least = by_faces[0]["each_ms"]
    right.semilogx(faces, least * np.log(faces) / np.log(faces[0]), "k:", label="∝ log faces")
    right.set(xlabel="faces", ylabel="CPU ms per target", ylim=(0, 750), xticks=faces)
    right.set_xticklabels([f"{f:,.0f}" for f in faces])
    right.set_title(f"{by_faces[0]['targets']:.0f} targets")
    for axes in (left, right):
        axes.minorticks_off()
        axes.legend(frameon=False, loc="upper left")
        axes.grid(alpha=0.3)
    figure.savefig(out, dpi=120)


def main() -> None:
    """Measure, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--targets", type=int, nargs="*", default=TARGETS)
    parser.add_argument("--sides", type=int, nargs="*", default=SIDES)
    given = parser.parse_args()
    lens = LensMap.load(MAP)
    print(f"one thread: OMP_NUM_THREADS={os.environ.get('OMP_NUM_THREADS', 'unset')}")
    print(
        f"{'':7} {'':7} {'CPU s:':>8} {'plan':>8} {'judge':>8} {'choose,':>8} {'all, ms':>9} "
        f"{'wall':>8}\n{'faces':>7} {'targets':>7} {'prepare':>8} {'each':>8} {'all':>8} "
        f"{'order':>8} {'/ target':>9} {'s':>8} {'candidates':>10} {'viewpoints':>10} "
        f"{'at least':>8} {'uncovered':>9} {'travel mm':>9}"
    )
    by_targets = [measure(USUAL_SIDES, count, lens) for count in given.targets]
    by_faces = [measure(sides, USUAL_TARGETS, lens) for sides in given.sides]
    elsewhere = [measure(sides, USUAL_TARGETS, lens, elsewhere=True) for sides in given.sides]
    if given.figure is not None:
        draw(by_targets, by_faces, elsewhere, given.figure)


if __name__ == "__main__":
    main()
