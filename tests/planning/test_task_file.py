"""Requirements as people write them: with units, or refused."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from lenscal.errors import InputError
from lenscal.handwritten import load_toml
from planning.enclosure import example_part
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.incidence import Incidence
from planning.requirements.unvignetted import Unvignetted
from planning.requirements.visibility import Visibility
from planning.task_file import TaskFile

HEAD = """
part = "part.stl"
unit = "mm"
lens = "map.json"
target = { near = ["0 mm", "0 mm", "0 mm"] }
workspace = { low = ["-30 cm", "-80 cm", "33 mm"], high = ["30 cm", "80 cm", "1 m"] }
"""


def read(tmp_path, requirements: str):
    path = tmp_path / "task.toml"
    path.write_text(HEAD + requirements, encoding="utf-8")
    (task,) = read_all(path)
    return task


def read_all(path):
    return load_toml(path, TaskFile, "task").build(example_part().scene, path.parent)


def test_every_kind_of_requirement_is_read(tmp_path) -> None:
    trimesh.creation.box(bounds=[[-1, -1, -4], [1, 1, -2]]).export(tmp_path / "housing.stl")
    task = read(
        tmp_path,
        """
[[requirements]]
kind = "depth_of_field"
depth = "0.1 in"
blur = "1.5 px"
wavelength = "550 nm"
[[requirements]]
kind = "depth_of_field"
depth = "0 mm"
blur = "2px"
[[requirements]]
kind = "incidence"
max_angle = "0.5 rad"
[[requirements]]
kind = "clearance"
distance = "1 cm"
cylinders = [
    { start = "-10 cm", end = "235 mm", radius = "30 mm" },
    { start = ["1 mm", "2 mm", "3 mm"], end = ["1 mm", "2 mm", "9 mm"], radius = "1 mm" },
]
meshes = [{ file = "housing.stl", unit = "in" }]
[[requirements]]
kind = "unvignetted"
[[requirements]]
kind = "visibility"
distance = "2 mm"
[[requirements]]
kind = "visibility"
""",
    )
    depth, flat, incidence, clearance, unvignetted, visibility, plain = task.requirements
    assert isinstance(depth, DepthOfField)
    assert (depth.depth_mm, depth.blur_px, depth.wavelength_nm) == (pytest.approx(2.54), 1.5, 550)
    assert flat == DepthOfField(0, 2)
    assert isinstance(incidence, Incidence)
    assert incidence.max_angle_deg == pytest.approx(np.degrees(0.5))
    assert isinstance(clearance, Clearance)
    assert clearance.distance_mm == 10
    first, second = clearance.body.cylinders
    np.testing.assert_allclose([first.start_mm, first.end_mm], [[0, 0, -100], [0, 0, 235]])
    np.testing.assert_allclose(second.start_mm, [1, 2, 3])
    (housing,) = clearance.body.meshes
    np.testing.assert_allclose(housing.bounds_mm[:, 2], [-4 * 25.4, -2 * 25.4], rtol=1e-6)
    assert (unvignetted, visibility, plain) == (Unvignetted(), Visibility(2), Visibility())
    stated = task.to_dict()["requirements"]
    assert stated[3]["body"]["meshes"] == [housing.digest]
    assert stated[3]["body"]["cylinders"][0]["radius_mm"] == 30
    assert stated[5] == {"kind": "visibility", "distance_mm": 2}
    assert len(task.digest) == 64


@pytest.mark.parametrize(
    ("requirement", "message"),
    [
        ('kind = "depth_of_field"\ndepth = 2\nblur = "1 px"', "a length needs its unit"),
        ('kind = "depth_of_field"\ndepth = "2 mm"\nblur = 1.5', "1.5 needs its unit, px, such as"),
        ('kind = "depth_of_field"\ndepth = "2 mm"\nblur = "1 mm"', "'1 mm' needs its unit, px"),
        ('kind = "depth_of_field"\ndepth = "-2 mm"\nblur = "1 px"', "greater than or equal to 0"),
        ('kind = "incidence"\nmax_angle = 30', "30 needs its unit, deg or rad, such as '1.5 deg'"),
        ('kind = "incidence"\nmax_angle = "95 deg"', "less than or equal to 90"),
        ('kind = "clearance"\ndistance = "0 mm"', "greater than 0"),
        ('kind = "clearance"\ndistance = "1 mm"', "a camera body needs a cylinder or a mesh"),
        ('kind = "unvignetted"\nradius = "1 mm"', "Extra inputs are not permitted"),
        ('kind = "sharpness"', "does not match any of the expected tags"),
    ],
)
def test_without_unit_or_sense_it_is_refused(tmp_path, requirement, message) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, f"[[requirements]]\n{requirement}\n")


SEVERAL = HEAD.replace('target = { near = ["0 mm", "0 mm", "0 mm"] }\n', "")
SHARED = """
[[requirements]]
kind = "incidence"
max_angle = "40 deg"
"""
TOP = """
[[targets]]
name = "top"
near = ["0 mm", "0 mm", "0 mm"]
feature = [["-4 mm", "0 mm", "0 mm"], ["4 mm", "0 mm", "0 mm"]]
"""
CORNER = """
[[targets]]
name = "corner"
vertices = [["0 mm", "0 mm", "0 mm"], ["1 mm", "0 mm", "0 mm"], ["0 mm", "1 mm", "0 mm"]]
[[targets.requirements]]
kind = "unvignetted"
"""


def several(tmp_path, *parts: str):
    path = tmp_path / "task.toml"
    path.write_text("".join(parts), encoding="utf-8")
    return path


def test_several_targets_share_what_the_file_asks_unless_they_ask_themselves(tmp_path) -> None:
    top, corner = read_all(several(tmp_path, SEVERAL, SHARED, TOP, CORNER))
    assert (top.name, corner.name) == ("top", "corner")
    assert top.requirements == (Incidence(40),)
    assert corner.requirements == (Unvignetted(),)
    assert top.seen_feature.is_segment
    assert corner.seen_feature is corner.target
    assert corner.target.area_mm2 == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ((HEAD, SHARED, TOP), "give either one target or several as"),
        ((SEVERAL, SHARED), "give either one target or several as"),
        ((HEAD,), r"nothing is required of the target; add \[\[requirements\]\] to the file$"),
        ((SEVERAL, TOP, CORNER), r"nothing is required of top; add .*, or \[\[targets.requirem"),
        ((SEVERAL, SHARED, TOP, TOP), "several targets are called 'top'; give each a name of its"),
        (
            (SEVERAL, 'feature = [["0 mm", "0 mm", "0 mm"], ["1 mm", "0 mm", "0 mm"]]', TOP),
            "with several targets the feature stands in the table of its target",
        ),
        ((SEVERAL, SHARED, TOP.replace('name = "top"', "")), "targets.0.name: Field required"),
        ((SEVERAL, SHARED, TOP.replace("near", "far")), "targets.0.far: Extra inputs are not"),
    ],
)
def test_several_targets_that_make_no_sense(tmp_path, parts, message) -> None:
    with pytest.raises(InputError, match=message):
        read_all(several(tmp_path, *parts))


def test_views_and_confidence(tmp_path) -> None:
    task = read(tmp_path, 'views = "general"\nconfidence = "99 %"\n' + SHARED)
    assert (task.views, task.confidence) == ("general", pytest.approx(0.99))
    plain = read(tmp_path, SHARED)
    assert (plain.views, plain.confidence) == ("orthogonal", None)
    text = 'views = "general"\nconfidence = "90 %"\n'
    tasks = read_all(several(tmp_path, SEVERAL, text, SHARED, TOP, CORNER))
    assert {(t.views, t.confidence) for t in tasks} == {("general", 0.9)}
    for wrong, message in (
        ("confidence = 0.99", "confidence: 0.99 needs its unit, %, such as '1.5 %'"),
        (
            'confidence = "120 %"',
            "confidence: '120 %' is no probability that can be asked",
        ),
        ('views = "oblique"', "views: Input should be 'orthogonal' or 'general'"),
    ):
        with pytest.raises(InputError, match=message):
            read(tmp_path, f"{wrong}\n{SHARED}")
