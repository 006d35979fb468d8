"""The commands, and the files that people write for them."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import trimesh
from click.testing import CliRunner

from lenscal.calibration.table import CalibrationTable
from lenscal.document import read_document
from lenscal.errors import FileError, GeometryError, InputError, PlanningError, UnitError
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from planning import cli
from planning.enclosure import example_part
from planning.task_file import load_task

TASK = """
name = "top face"
part = "part.ply"
unit = "mm"
lens = "map.json"
target = { near = ["0 mm", "0 mm", "0 mm"] }
feature = [["-0.5 in", "0 in", "0 in"], ["0.5 in", "0 in", "0 in"]]
workspace = { low = ["-30 cm", "-80 cm", "33 mm"], high = ["30 cm", "80 cm", "1 m"] }

[[requirements]]
kind = "resolution"
pixels = 3
length = "0.01 in"
axis = "x"

[[requirements]]
kind = "field_of_view"
length = "1 in"
axis = "x"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory, lens):
    """A folder with the example part, a map of the closed-form lens, and a task."""
    folder = tmp_path_factory.mktemp("task")
    meshes = [body.to_mesh() for body in example_part().scene.bodies]
    trimesh.util.concatenate(meshes).export(folder / "part.ply")
    zoom, focus = (a.ravel() for a in np.meshgrid(np.linspace(90, 109, 6), np.linspace(40, 140, 5)))
    columns = {
        name: getattr(lens, name)(zoom, focus)
        for name in ("magnification", "object_distance_mm", "standoff_mm")
    }
    table = pd.DataFrame({"zoom": zoom, "focus": focus, **columns})
    for name in columns:
        table[f"sigma_{name}"] = 1e-4 * table[name]
    # The choice of smoothing is what takes a fit its time; any small one will do here.
    smoothing = {"core": np.full((3, 2), -9.0)}
    fit_lens_map(table, sensor=lens.sensor, log_smoothing=smoothing).save(folder / "map.json")
    (folder / "task.toml").write_text(TASK, encoding="utf-8")
    return folder


def run(command, *words):
    """Run a command; what it raises comes through."""
    return CliRunner().invoke(command, [str(w) for w in words], catch_exceptions=False)


@pytest.mark.parametrize("ending", ["stl", "glb", "ply"])
def test_visibility_writes_the_region(folder, ending: str) -> None:
    out = folder / f"region.{ending}"
    done = run(
        cli.visibility, folder / "part.ply", "--unit", "mm", "--target-near", "0,0,0 mm",
        "--workspace", "-300,-800,33,300,800,1000mm", "-o", out, "--audit-points", 500,
    )  # fmt: skip
    assert done.exit_code == 0
    assert "target: 483.87 mm²" in done.output
    assert "audit: 0 of 500 viewpoints disagree" in done.output
    region = trimesh.load_mesh(out)
    assert np.abs(region.bounds).max() == pytest.approx(1.0 if ending == "glb" else 1000.0)


def test_visibility_of_several_targets_with_page_and_picture(folder, tmp_path) -> None:
    done = run(
        cli.visibility, folder / "part.ply", "--unit", "mm", "--target", "0,0,0 mm",
        "--target", "-5,0,0; 5,0,0 mm", "--workspace", "-30,-80,3.3,30,80,100 cm",
        "-o", tmp_path / "deep" / "region.glb", "--html", tmp_path / "region.html",
        "--png", tmp_path / "region.png", "--audit-points", 100,
    )  # fmt: skip
    assert "audit: 0 of 200 viewpoints disagree" in done.output
    for name in ("deep/region.glb", "deep/region.json", "region.html", "region.png"):
        assert f"wrote {tmp_path / name}" in done.output
        assert (tmp_path / name).stat().st_size > 500
    nodes = trimesh.load_scene(tmp_path / "deep/region.glb").graph.nodes_geometry
    assert set(nodes) == {"part", "target", "region", "workspace"}


def test_visibility_says_what_it_chose_and_what_is_bare(folder, tmp_path, bench) -> None:
    box = bench.box((0, 0, 0), (9, 9, 9))
    open_box = trimesh.Trimesh(box.vertices, box.faces[2:], process=False)
    open_box.export(tmp_path / "open.stl")
    words = [tmp_path / "open.stl", "--unit", "mm", "--target", "4,4,9 mm", "--audit-points", 50]
    with pytest.raises(GeometryError, match="open.stl is no closed solid: .* or have it taken as"):
        run(cli.visibility, *words)
    done = run(cli.visibility, *words, "--as-faces")
    assert "workspace: 45 mm to all sides of the target's centre" in done.output
    assert "bare faces: open.stl" in done.output


def test_visibility_says_why_there_is_no_region(folder, tmp_path) -> None:
    done = run(
        cli.visibility, folder / "part.ply", "--unit", "mm", "--target-near", "0,0,0 mm",
        "--workspace", "-20,-5,1,20,5,2 m", "-o", tmp_path / "r.stl", "--audit-points", 10,
    )  # fmt: skip
    assert "region:" in done.output
    below = run(
        cli.visibility, folder / "part.ply", "--unit", "mm", "--target-near", "0,0,0 mm",
        "--workspace", "-2,-2,-2,2,2,-1 m", "-o", tmp_path / "none.stl", "--audit-points", 10,
    )  # fmt: skip
    assert "the region is empty: the whole workspace lies behind" in below.output
    assert "none.stl was not written: there is nothing" in below.output
    assert not (tmp_path / "none.stl").exists()


def test_visibility_refuses_bare_numbers_and_other_files(folder, tmp_path) -> None:
    words = ["--unit", "mm", "--workspace", "0,0,0,1,1,1 m"]
    with pytest.raises(UnitError, match="--target needs 3 numbers between commas and a unit"):
        run(cli.visibility, folder / "part.ply", *words, "--target-near", "0,0,0", "-o", "r.stl")
    with pytest.raises(FileError, match="cannot write a region to .*; its name must end in"):
        run(cli.visibility, folder / "part.ply", *words, "--target-near", "0,0,0mm", "-o", "r.docx")


def test_settings_shows_the_range(folder) -> None:
    words = ["--resolution", "3px/0.01in", "--fov", "1 in", "--axis", "x"]
    done = run(cli.settings, folder / "map.json", *words)
    assert done.exit_code == 0
    for number in ("0.1919", "0.3275", "standoff"):
        assert number in done.output


def test_settings_refuses_what_cannot_be(folder) -> None:
    with pytest.raises(PlanningError, match="the requirements contradict each other"):
        run(cli.settings, folder / "map.json", "--resolution", "9px/0.01in", "--fov", "1in")
    with pytest.raises(PlanningError, match="no setting of this lens satisfies the field of view"):
        run(cli.settings, folder / "map.json", "--fov", "1 m")
    with pytest.raises(InputError, match="nothing is required; give --resolution"):
        run(cli.settings, folder / "map.json")
    with pytest.raises(InputError, match="cannot read --resolution 'many/1in'"):
        run(cli.settings, folder / "map.json", "--resolution", "many/1in")
    with pytest.raises(UnitError, match="the length '0.01' has no unit"):
        run(cli.settings, folder / "map.json", "--resolution", "3px/0.01")


def test_plan_writes_the_viewpoints(folder) -> None:
    done = run(cli.plan, folder / "task.toml", "-o", folder / "plan.json")
    assert done.exit_code == 0
    assert "Viewpoints top face" in done.output
    body = read_document(folder / "plan.json", "plan", 1)
    assert len(body["viewpoints"]) > 6
    assert body["task"]["target_mm"]


SEVERAL = (
    TASK.replace('target = { near = ["0 mm", "0 mm", "0 mm"] }', "")
    .replace('feature = [["-0.5 in", "0 in", "0 in"], ["0.5 in", "0 in", "0 in"]]', "")
    .replace('"1 in"', '"9 mm"')
)
for _x in (-6, 6):
    SEVERAL += f"""
[[targets]]
name = "at {_x}"
vertices = [["{_x - 4} mm", "-3 mm", "0 mm"], ["{_x + 4} mm", "-3 mm", "0 mm"],
            ["{_x + 4} mm", "3 mm", "0 mm"], ["{_x - 4} mm", "3 mm", "0 mm"]]
feature = [["{_x - 4} mm", "0 mm", "0 mm"], ["{_x + 4} mm", "0 mm", "0 mm"]]
"""
SHUT = """
[[targets]]
name = "floor"
vertices = [["-9 mm", "30 mm", "-20 mm"], ["9 mm", "30 mm", "-20 mm"], ["0 mm", "40 mm", "-20 mm"]]
feature = [["-9 mm", "35 mm", "-20 mm"], ["9 mm", "35 mm", "-20 mm"]]
[[targets.requirements]]
kind = "resolution"
pixels = 90
length = "0.01 in"
"""


def test_plan_covers_several_targets(folder) -> None:
    (folder / "several.toml").write_text(SEVERAL + SHUT, encoding="utf-8")
    done = run(cli.plan, folder / "several.toml", "-o", folder / "covering.json")
    assert done.exit_code == 0
    assert "at -6, at 6" in done.output
    assert "2 of 3 targets by 1 viewpoint of" in done.output
    assert "tried, the fewest that do\ntravel 0 mm, the shortest; planned in" in done.output
    assert "Margins, as shares of what is asked" in done.output
    assert done.output.count("at -6") == 2
    assert "not covered: floor: no setting of this lens" in done.output
    body = read_document(folder / "covering.json", "covering-plan", 1)
    assert body["viewpoints"][0]["targets"] == "at -6, at 6"
    with pytest.raises(InputError, match="several.toml has 3 targets where one is wanted; read"):
        load_task(folder / "several.toml")


def test_plan_of_several_targets_without_a_viewpoint_is_an_error(folder) -> None:
    text = SEVERAL.replace("pixels = 3", "pixels = 90").replace('"9 mm"', '"0.1 mm"')
    (folder / "none.toml").write_text(text, encoding="utf-8")
    with pytest.raises(PlanningError, match="none of the 2 targets .*; at -6, at 6: no set"):
        run(cli.plan, folder / "none.toml", "-o", folder / "none.json")


def test_plan_shows_every_margin_that_was_asked_for(folder, tmp_path, request) -> None:
    data = request.config.rootpath / "data"
    more = """
[[requirements]]
kind = "depth_of_field"
depth = "1 mm"
blur = "2.5 px"
[[requirements]]
kind = "incidence"
max_angle = "80 deg"
"""
    text = (TASK + more).replace("map.json", str(data / "vicon-1990" / "map.json"))
    (folder / "sharp.toml").write_text(text, encoding="utf-8")
    done = run(cli.plan, folder / "sharp.toml", "-o", tmp_path / "plan.json")
    for words in ("iris", "Margins, as shares of what is asked", "depth", "angle", "resol."):
        assert words in done.output
    assert max(len(line) for line in done.output.splitlines()[:-1]) <= 80


def test_what_cannot_be_planned_is_refused_at_once(folder, tmp_path, request) -> None:
    data = request.config.rootpath / "data"
    placement = "[placement]" + (data / "task.toml").read_text().partition("[placement]")[2]
    placement = placement.replace("vicon-1990/session", str(data / "vicon-1990" / "session"))
    session = CalibrationTable.load(data / "vicon-1990" / "table.csv").identity
    lens = LensMap.load(folder / "map.json")
    replace(lens, identity={**session, "rig": "another"}).save(folder / "other.json")
    for name, table, message in (
        ("map.json", placement, "counted from|does not state; state with approach|holds for"),
        ("other.json", placement, "of another rig than the lens map: its rig is 'simulated v"),
        ("map.json", '[[requirements]]\nkind = "unvignetted"', "to judge unvignetted planning"),
    ):
        path = folder / "early.toml"
        path.write_text((TASK + table).replace("map.json", name), encoding="utf-8")
        with pytest.raises(PlanningError, match=message):
            run(cli.plan, path, "-o", tmp_path / "none.json")
    assert not (tmp_path / "none.json").exists()


def test_plan_without_a_viewpoint_is_an_error(folder) -> None:
    path = folder / "dark.toml"
    path.write_text(
        TASK.replace('high = ["30 cm", "80 cm", "1 m"]', 'high = ["30 cm", "80 cm", "9 cm"]')
    )
    with pytest.raises(
        PlanningError, match="no viewpoint: workspace: no view satisfies .* is in .*dark.json"
    ):
        run(cli.plan, path, "-o", folder / "dark.json")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('length = "1 in"', "length = 25.4", "requirements.1.field_of_view.length: .* its unit"),
        ('"0.01 in"', '"0.01 parsec"', "unknown unit of length 'parsec'"),
        ('unit = "mm"', 'unit = "mm"\ncolour = "red"', "colour: Extra inputs"),
        ('kind = "resolution"', 'kind = "beauty"', "requirements.0: "),
        ('near = ["0 mm", "0 mm", "0 mm"]', "", "target: give either near or face or vertices"),
        (
            'near = ["0 mm", "0 mm", "0 mm"]',
            'body = "b", vertices = [["0 mm", "0 mm", "0 mm"]]',
            "target: body and fill_holes go with near or face",
        ),
    ],
)
def test_task_files_that_are_not_understood(tmp_path, old: str, new: str, message: str) -> None:
    path = tmp_path / "task.toml"
    path.write_text(TASK.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=f"the task .* cannot be used: .*{message}"):
        load_task(path)


def test_a_task_file_must_state_the_unit_of_triangles(folder) -> None:
    (folder / "unit.toml").write_text(TASK.replace('unit = "mm"', ""), encoding="utf-8")
    with pytest.raises(
        UnitError, match=r"the unit of .*part.ply is not known: a ply file does not"
    ):
        load_task(folder / "unit.toml")


def test_a_task_file_that_is_no_toml(tmp_path) -> None:
    path = tmp_path / "task.toml"
    path.write_text(TASK.replace("name = ", "name "), encoding="utf-8")
    with pytest.raises(FileError, match="the task .* is no TOML"):
        load_task(path)


def test_task_file_must_exist(tmp_path) -> None:
    with pytest.raises(FileError, match="cannot read the task .*: No such file"):
        load_task(tmp_path / "none.toml")


def test_target_by_vertices_and_feature_left_out(folder) -> None:
    vertices = '[["-1 mm", "-1 mm", "0 mm"], ["1 mm", "-1 mm", "0 mm"], ["0 mm", "1 mm", "0 mm"]]'
    text = TASK.replace('near = ["0 mm", "0 mm", "0 mm"]', f"vertices = {vertices}")
    text = "\n".join(line for line in text.splitlines() if not line.startswith("feature"))
    (folder / "small.toml").write_text(text, encoding="utf-8")
    task, lens, _ = load_task(folder / "small.toml")
    assert task.target.area_mm2 == pytest.approx(2)
    assert task.seen_feature is task.target
    assert lens.has_standoff


@pytest.mark.parametrize("name", ["visibility", "settings", "plan", "demo"])
def test_help_has_an_example(name: str) -> None:
    done = run(getattr(cli, name), "--help")
    assert "Example:" in done.output
    assert f"lenscal {name}" in done.output


def test_commands_import_nothing_heavy() -> None:
    """Help is quick: neither numpy nor any of the geometry is loaded."""
    code = "import sys, planning.cli; print({'numpy', 'trimesh', 'pydantic'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_public_names_are_there() -> None:
    import planning

    for name in planning.__all__:
        assert getattr(planning, name).__name__ == name
    assert set(planning.__all__) <= set(dir(planning))
    with pytest.raises(AttributeError, match="module 'planning' has no attribute 'nonsense'"):
        planning.nonsense  # noqa: B018
