"""Scenes and solids: files with units, and meshes that are no solids."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.errors import FileError, GeometryError, UnitError
from planning.boolean import to_manifold
from planning.scene import Scene
from planning.solid import Solid, box_workspace


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "glb"])
def test_loads_with_a_stated_unit(tmp_path, bench, ending: str) -> None:
    path = tmp_path / f"part.{ending}"
    bench.box((0, 0, 0), (1, 2, 3)).export(path)
    scene = Scene.load(path, unit="in")
    np.testing.assert_allclose(scene.bounds_mm, [[0, 0, 0], [25.4, 50.8, 76.2]])
    assert scene.bodies[0].volume_mm3 == pytest.approx(6 * 25.4**3)
    assert scene.names == (f"part.{ending}",)


def test_refuses_files_that_are_no_part(tmp_path, bench) -> None:
    with pytest.raises(FileError, match="cannot read .*missing.stl as a mesh"):
        Scene.load(tmp_path / "missing.stl", unit="mm")
    (tmp_path / "words.ply").write_text("these are words")
    with pytest.raises(FileError, match="cannot read .*words.ply as a mesh"):
        Scene.load(tmp_path / "words.ply", unit="mm")
    (tmp_path / "empty.obj").write_text("# nothing\n")
    with pytest.raises(FileError, match="empty.obj"):
        Scene.load(tmp_path / "empty.obj", unit="mm")
    with pytest.raises(FileError, match=r"its name ends in '\.docx'; known are stl, obj, ply, glb"):
        Scene.load(tmp_path / "part.docx", unit="mm")
    with pytest.raises(UnitError, match="unknown unit of length 'furlong'"):
        Scene.load(tmp_path / "missing.stl", unit="furlong")


def test_refuses_a_points_only_file(tmp_path) -> None:
    trimesh.PointCloud(np.eye(3)).export(tmp_path / "points.ply")
    with pytest.raises(FileError, match="points.ply holds no mesh"):
        Scene.load(tmp_path / "points.ply", unit="mm")


def test_open_mesh_is_refused_with_a_place(bench) -> None:
    cube = bench.box((0, 0, 0), (1, 1, 1))
    opened = trimesh.Trimesh(cube.vertices, cube.faces[:-1], process=False)
    with pytest.raises(
        GeometryError, match=r"lid is no closed solid: 3 of its 18 edges are open.*\) mm"
    ):
        Scene([opened], names=["lid"])


def test_refuses_empty_flat_and_inside_out_meshes(bench) -> None:
    cube = bench.box((0, 0, 0), (1, 1, 1))
    with pytest.raises(GeometryError, match="body 0 is empty"):
        Scene([trimesh.Trimesh()])
    with pytest.raises(GeometryError, match="body 0 is inside out"):
        Scene([trimesh.Trimesh(cube.vertices, cube.faces[:, ::-1], process=False)])
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]], process=False)
    with pytest.raises(GeometryError, match="body 0 is flat"):
        Scene([flat])
    with pytest.raises(GeometryError, match="at least one body"):
        Scene([])
    with pytest.raises(GeometryError, match="1 bodies but 2 names"):
        Scene([cube], names=["a", "b"])


def test_solid_refuses_faces_without_vertices() -> None:
    with pytest.raises(GeometryError, match="names vertex 3, but there are 3 vertices"):
        Solid(np.eye(3), np.array([[0, 1, 3]]))


def test_workspace_corners_must_be_in_order() -> None:
    with pytest.raises(GeometryError, match="low corner below its high one"):
        box_workspace((0, 0, 0), (1, -1, 1))


def test_manifold_library_gets_only_manifolds(bench) -> None:
    cube = bench.box((0, 0, 0), (1, 1, 1))
    with pytest.raises(GeometryError, match="lid cannot be used as a solid .NotManifold."):
        to_manifold("lid", cube.vertices, cube.faces[:-1])


@settings(max_examples=30, deadline=None)
@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))
def test_membership_and_distance_in_a_cube(x: float, y: float, z: float) -> None:
    """The winding number and the distance to the faces agree with the cube's own formula."""
    cube = box_workspace((-1, -1, -1), (1, 1, 1))
    outside = np.maximum(np.abs([x, y, z]) - 1, 0)
    wanted = np.linalg.norm(outside) if outside.any() else 1 - np.abs([x, y, z]).max()
    assert cube.distance_to_surface_mm([x, y, z]) == pytest.approx(wanted, abs=1e-12)
    if wanted > 1e-9:
        assert bool(cube.contains([x, y, z])) == (not outside.any())


def test_empty_solid_holds_nothing() -> None:
    nothing = Solid(np.zeros((0, 3)), np.zeros((0, 3)))
    assert nothing.is_empty
    assert nothing.volume_mm3 == 0
    assert not nothing.contains([0, 0, 0])
    assert np.isinf(nothing.distance_to_surface_mm([0, 0, 0]))
    assert np.isnan(nothing.bounds_mm).all()


def test_hash_sees_every_change(bench) -> None:
    first, second = bench.scene(bench.block), bench.scene(bench.box((-5, -5, -5), (5, 5, 1e-9)))
    assert first.digest != second.digest
    assert first.digest == bench.scene(bench.block).digest
