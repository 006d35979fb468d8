"""Previews: the layers, the files that hold them, and the pictures."""

from __future__ import annotations

import base64
import json
import re

import numpy as np
import pytest
import trimesh
from PIL import Image

from lenscal.document import read_document
from lenscal.errors import InputError
from planning.enclosure import example_part
from planning.evidence import write_evidence
from planning.layers import Layer, bent_edges, bounds_of
from planning.picture import cut_away, save_picture
from planning.preview import deep_point, preview_visibility
from planning.preview_files import write_glb, write_html
from planning.raycast import render
from planning.sections import draw_section, named_direction, section_axes
from planning.solid import Solid
from planning.target import Target
from planning.visibility.methods import visibility_region

VIEW_PX = (160, 140)


@pytest.fixture(scope="module")
def example():
    return example_part()


@pytest.fixture(scope="module")
def region(example):
    return visibility_region(example.scene, example.target, example.workspace, audit_points=500)


@pytest.fixture(scope="module")
def preview(example, region):
    return preview_visibility(example.scene, example.target, region, "T </script> & co")


def cube(low=(0, 0, 0), high=(1, 1, 1), **look) -> Layer:
    mesh = trimesh.creation.box(bounds=[low, high])
    return Layer("cube", mesh.vertices, mesh.faces, is_closed=True, **look)


def test_layers_of_a_region(preview, example, region) -> None:
    assert [layer.name for layer in preview.layers] == [
        *("block", "enclosure", "target", "region", "workspace"),
    ]
    assert [layer.group for layer in preview.layers[:3]] == ["part", "part", ""]
    np.testing.assert_allclose(bounds_of([preview.layer("region")]), region.solid.bounds_mm)
    assert region.contains(preview.viewpoint_mm)
    assert dict(preview.facts)["audit"] == "0 of 500 viewpoints disagree"


def test_glb_has_named_nodes_in_metres(preview, tmp_path, region) -> None:
    loaded = trimesh.load_scene(write_glb(tmp_path / "a" / "r.glb", preview))
    assert set(loaded.graph.nodes_geometry) == {
        *("block", "enclosure", "target", "region", "workspace"),
    }
    assert loaded.graph.transforms.parents["block"] == "part"
    mesh = loaded.geometry["region"]
    assert mesh.volume * 1e9 == pytest.approx(region.volume_mm3, rel=1e-6)
    assert mesh.visual.material.alphaMode == "BLEND"


def test_one_body_is_the_part(bench, tmp_path) -> None:
    scene = bench.scene(bench.block)
    found = visibility_region(scene, bench.target, bench.workspace, audit_points=0)
    preview = preview_visibility(scene, bench.target, found)
    loaded = trimesh.load_scene(write_glb(tmp_path / "r.glb", preview))
    assert set(loaded.graph.nodes_geometry) == {"part", "target", "region", "workspace"}


def test_page_stands_alone_and_holds_the_layers(preview, tmp_path, region) -> None:
    path = write_html(tmp_path / "r.html", preview)
    page = path.read_text(encoding="utf-8")
    assert not re.search(r"https?://|//[a-z]+\.|src=|@import|fetch\(", page)
    assert "@DATA@" not in page
    assert len(page) < 60_000
    assert "<title>T &lt;/script&gt; &amp; co</title>" in page
    text = re.search(r'<script type="application/json" id="data">(.*?)</script>', page)[1]
    data = json.loads(text)
    assert data["title"] == "T </script> & co"
    layer = next(entry for entry in data["layers"] if entry["name"] == "region")
    points = np.frombuffer(base64.b64decode(layer["points"]), "<f4").reshape(-1, 3)
    faces = np.frombuffer(base64.b64decode(layer["faces"]), "<u4").reshape(-1, 3)
    solid = Solid(points + np.array(data["origin"]), faces)
    assert solid.volume_mm3 == pytest.approx(region.volume_mm3, rel=1e-5)


def test_picture_shows_target_and_region(preview, example, region, tmp_path) -> None:
    path = save_picture(tmp_path / "r.png", preview, example.scene, example.target, region, VIEW_PX)
    pixels = np.asarray(Image.open(path).convert("RGB"), dtype=float) / 255
    red, _, blue = np.moveaxis(pixels, -1, 0)
    assert (red - blue > 0.6).sum() > 500  # the target
    assert (blue - red > 0.2).sum() > 10_000  # the region


def test_pictures_without_a_region(bench, tmp_path) -> None:
    scene = bench.scene(bench.block)
    behind = bench.solid(bench.workspace.vertices_mm - [0, 0, 101], bench.workspace.faces)
    nothing = visibility_region(scene, bench.target, behind, audit_points=0)
    preview = preview_visibility(scene, bench.target, nothing)
    assert preview.viewpoint_mm is None
    assert dict(preview.facts)["region"] == "empty"
    assert save_picture(tmp_path / "r.png", preview, scene, bench.target, nothing, VIEW_PX).exists()


def test_a_cube_is_drawn_where_it_is() -> None:
    """Seen along −x from the left part of the field: orange before white, and its outline."""
    layers = [cube(colour="#ff0000"), cube((0, 2, 0), (1, 3, 1), colour="#00ff00")]
    picture = render(layers, (1.0, 0.0, 0.0), (80, 60))
    assert picture.shape == (60, 80, 3)
    np.testing.assert_array_equal(picture[0, 0], 1)
    left, right = picture[30, 22], picture[30, 57]
    assert left[0] > 0.5 > left[1]  # with z up, +y is to the right
    assert right[1] > 0.5 > right[0]


def test_glass_shows_what_is_behind() -> None:
    inner = cube((0.4, 0.4, 0.4), (0.6, 0.6, 0.6), colour="#ff0000")
    outer = cube(colour="#0000ff", opacity=0.3)
    middle = render([inner, outer], (1.0, 0.2, 0.1), (41, 41))[20, 20]
    assert middle[0] > 0.3
    assert middle[2] > 0.15


def test_cutting_away_opens_solids() -> None:
    flat = Layer("t", [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], [[0, 1, 2], [0, 2, 3]])
    left = cut_away([cube(), flat, cube((5, 5, 5), (6, 6, 6))], (0.25, 0, 0), (1, 0, 0))
    assert [layer.name for layer in left] == ["cube", "t"]
    solid = Solid(left[0].vertices_mm, left[0].faces)
    assert solid.volume_mm3 == pytest.approx(0.25)
    np.testing.assert_allclose(bounds_of(left), [[0, 0, 0], [0.25, 1, 1]])


def test_only_bends_are_drawn() -> None:
    box = trimesh.creation.box()
    assert len(bent_edges(box.vertices, box.faces)) == 12
    sphere = trimesh.creation.icosphere(subdivisions=4)
    assert len(bent_edges(sphere.vertices, sphere.faces)) == 0
    assert len(bent_edges(np.eye(3), [[0, 1, 2]])) == 3
    assert len(bent_edges(np.zeros((0, 3)), [])) == 0


def test_refuses_looks_that_are_none() -> None:
    with pytest.raises(InputError, match="colour of layer cube must be written as '#rrggbb', but"):
        cube(colour="blue")
    with pytest.raises(InputError, match="opacity of layer cube must lie between 0 and 1"):
        cube(opacity=1.5)
    with pytest.raises(InputError, match="nothing to draw: no layer with faces is visible"):
        render([cube(is_visible=False)], (1, 0, 0))
    with pytest.raises(InputError, match="cannot be seen from .* the two must span a plane"):
        render([cube()], (0, 0, 1))


def test_deep_point_of_a_slender_solid() -> None:
    mesh = trimesh.creation.box(bounds=[[0, 0, 0], [1000, 1, 1]])
    turned = mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))
    solid = Solid(turned.vertices, turned.faces)
    assert solid.contains(deep_point(solid))
    assert deep_point(Solid(np.zeros((0, 3)), np.zeros((0, 3)))) is None


def test_sections_of_a_segment_and_of_a_face(example, region) -> None:
    right, up = section_axes(example.target)
    np.testing.assert_allclose([right, up], [[0, 1, 0], [0, 0, 1]], atol=1e-12)
    right, up = section_axes(example.target, across=(1, 0, 5))
    np.testing.assert_allclose([right, up], [[1, 0, 0], [0, 0, 1]], atol=1e-12)
    right, up = section_axes(Target.segment((0, 0, 0), (0, 0, -3)))
    np.testing.assert_allclose([right, up], [[0, 0, 1], [0, 1, 0]], atol=1e-12)
    assert named_direction(np.array([0, 0, -1.0])) == "-z"
    assert named_direction(np.array([0.6, 0.8, 0])) == "along (0.60, 0.80, 0.00)"


def test_section_fills_what_is_cut(example, region) -> None:
    from matplotlib.figure import Figure

    axes = draw_section(Figure().add_subplot(), example.scene, example.target, region)
    sees, _ = axes.patches
    # Two wedges, and the region's section holds the points that the region holds.
    assert len(sees.get_path().to_polygons()) == 2
    for place, seen in (((300.0, 600.0), True), ((0.0, 600.0), False), ((-400.0, 600.0), True)):
        assert bool(region.contains([0, *place])) == seen
        assert any(trimesh_contains(p, place) for p in sees.get_path().to_polygons()) == seen


def trimesh_contains(polygon, point) -> bool:
    from matplotlib.path import Path as Outline

    return bool(Outline(polygon).contains_point(point))


def test_bare_faces_are_cut_as_lines(bench) -> None:
    from matplotlib.figure import Figure

    box = bench.box((-6, -6, 1), (6, 6, 4))
    tube = trimesh.Trimesh(box.vertices, box.faces[np.abs(box.face_normals[:, 2]) < 0.5])
    scene = type(bench.scene(bench.block))([tube], as_faces=True)
    found = visibility_region(scene, bench.target, bench.workspace, audit_points=0)
    axes = draw_section(Figure().add_subplot(), scene, bench.target, found, reach_mm=20)
    segments = np.concatenate(axes.collections[0].get_segments())
    assert set(np.round(np.abs(segments[:, 0]), 9)) == {6.0}


def test_evidence_is_kept(example, region, tmp_path) -> None:
    path = write_evidence(tmp_path / "r.json", example.scene, (example.target,), region)
    body = read_document(path, "visibility region", 1)
    assert body["audit"]["disagreements"] == 0
    assert body["region"]["volume_mm3"] == region.volume_mm3
    assert body["region"]["scene_digest"] == example.scene.digest
    assert [b["name"] for b in body["bodies"]] == ["block", "enclosure"]
    assert body["made_with"].startswith("lenscal ")
