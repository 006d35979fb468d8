"""Targets and workspaces as people type them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lenscal.errors import GeometryError, InputError, UnitError
from planning.scene import Scene
from planning.spoken import spoken_targets, spoken_workspace

PLATE = Path(__file__).parents[2] / "data/plate.step"


@pytest.fixture(scope="module")
def plate() -> Scene:
    return Scene.load(PLATE)


@pytest.mark.parametrize(
    ("text", "area", "corners"),
    [
        ("0,0,5 mm", 1086.9, None),
        ("1.9cm, 0, 0.1 mm", 1086.9, None),
        ("face:front", 200, 4),
        ("face:2", 200, 4),
        ("face:plate/front", 200, 4),
        ("-1,-1,0; 1,-1,0; 1,1,0; -1,1,0 cm", 400, 4),
        ("0 in,0,0; 1 in,0,0 in; 0,1,0 in;", 322.58, 3),
        ("0,0,0; 3,4,0 mm", 0, 2),
    ],
)
def test_targets(plate, text: str, area: float, corners) -> None:
    (target,) = spoken_targets([text], plate)
    assert target.area_mm2 == pytest.approx(area, rel=1e-3)
    assert corners is None or len(target.vertices_mm) == corners


def test_lines_and_several_targets(plate) -> None:
    line = spoken_targets(["line: 0,0,0; 1,0,0; 1,1,0 mm", "face:top"], plate, fill_holes=True)
    assert [target.is_segment for target in line] == [True, True, False]
    assert line[2].is_convex


@pytest.mark.parametrize(
    ("texts", "error", "message"),
    [
        (
            [],
            InputError,
            "there is no --target; write a point .* faces are plate: top, p",
        ),
        (["top"], InputError, "cannot read --target 'top'; write a point near a flat face"),
        (["edge:3"], InputError, "cannot read --target 'edge:3'; write a point"),
        (["0,0 mm"], InputError, "--target needs 3 numbers between commas, but '0,0 mm' has 2"),
        (
            ["0,0,0"],
            UnitError,
            "--target needs 3 numbers between commas and a unit, but '0,0,0'",
        ),
        (["0,0,zero mm"], UnitError, "cannot read 'zero mm' as a length|unknown unit"),
        (["face:lid"], GeometryError, "there is no face 'lid'; flat faces are plate: top"),
        (["face:lid/top"], GeometryError, "there is no body 'lid'; the bodies are 'plate'"),
    ],
)
def test_targets_that_are_not_understood(plate, texts, error, message: str) -> None:
    with pytest.raises(error, match=message):
        spoken_targets(texts, plate)


def test_workspaces(plate, tmp_path, bench) -> None:
    (top,) = targets = spoken_targets(["face:top"], plate)
    box, said = spoken_workspace("-1,-1,0,1,1,2 cm", plate, targets)
    np.testing.assert_allclose(box.bounds_mm, [[-10, -10, 0], [10, 10, 20]])
    assert not said
    box, said = spoken_workspace(None, plate, targets)
    np.testing.assert_allclose(box.bounds_mm - top.centroid_mm, [[-200] * 3, [200] * 3])
    assert said.startswith("workspace: 200 mm to all sides")
    bench.block.export(tmp_path / "reach.stl")
    reach, _ = spoken_workspace(f"{tmp_path / 'reach.stl'}:cm", plate, targets)
    assert reach.volume_mm3 == pytest.approx(500e3)


def test_workspaces_that_are_none(plate, tmp_path, bench) -> None:
    with pytest.raises(InputError, match="reach.stl as a workspace has no unit"):
        spoken_workspace("reach.stl", plate, ())
    with pytest.raises(InputError, match="--workspace needs 6 numbers .* but '1,2 mm'"):
        spoken_workspace("1,2 mm", plate, ())
    two = bench.scene(bench.block, bench.box((9, 9, 9), (10, 10, 10)))
    from planning.layers import Layer
    from planning.preview import Preview
    from planning.preview_files import write_glb

    layers = tuple(Layer(b.name, b.vertices_mm, b.faces) for b in two.bodies)
    write_glb(tmp_path / "two.glb", Preview("two", layers, np.zeros(3)))
    with pytest.raises(GeometryError, match="a workspace is one solid, but .*two.glb holds 2"):
        spoken_workspace(f"{tmp_path / 'two.glb'}:m", plate, ())
