"""Scenes and solids: files with units, and meshes that are no solids."""

from __future__ import annotations

import hashlib
import re

import manifold3d
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import planning.boolean
from lenscal.errors import FileError, GeometryError, InputError, UnitError
from lenscal.pose import Pose
from planning.body import Body
from planning.boolean import to_manifold
from planning.scene import Scene
from planning.solid import Solid, box_workspace
from planning.target import Target
from planning.visibility.methods import visibility_region


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
    with pytest.raises(
        FileError, match=r"its name ends in '\.docx'; known are stl, obj, ply, glb, step"
    ):
        Scene.load(tmp_path / "part.docx", unit="mm")
    with pytest.raises(UnitError, match="unknown unit of length 'furlong'"):
        Scene.load(tmp_path / "missing.stl", unit="furlong")


def test_triangles_need_a_unit(tmp_path, bench) -> None:
    bench.block.export(tmp_path / "part.stl")
    with pytest.raises(UnitError, match="part.stl is not known: a stl file .* give one of um, µm,"):
        Scene.load(tmp_path / "part.stl")


def test_keeps_where_it_came_from(tmp_path, bench) -> None:
    path = tmp_path / "part.stl"
    bench.block.export(path)
    (source,) = Scene.load(path, "in").sources
    assert (source.file, source.unit, source.chord_tolerance_mm) == ("part.stl", "in", None)
    assert source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_bodies_of_a_file_keep_their_names_and_places(tmp_path, bench) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(bench.block, node_name="block")
    lift = trimesh.transformations.translation_matrix([0, 0, 7])
    scene.add_geometry(bench.box((0, 0, 0), (1, 1, 1)), node_name="lamp", transform=lift)
    scene.export(tmp_path / "both.glb")
    loaded = Scene.load(tmp_path / "both.glb", "m")
    assert set(loaded.names) == {"block", "lamp"}
    np.testing.assert_allclose(loaded.body("lamp").bounds_mm[:, 2], [7000, 8000])


def test_poses_put_bodies_into_the_frame_of_the_part(bench) -> None:
    quarter = Pose.from_rotation_vector([0, 0, np.pi / 2], [10, 0, 0])
    scene = Scene([bench.box((0, 0, 0), (1, 2, 3))], ["arm"], [quarter])
    np.testing.assert_allclose(scene.bounds_mm, [[8, 0, 0], [10, 1, 3]], atol=1e-12)
    moved = scene.moved("arm", Pose.identity())
    np.testing.assert_allclose(moved.bounds_mm, [[0, 0, 0], [1, 2, 3]], atol=1e-12)


def test_a_body_may_stand_at_several_places(bench) -> None:
    scene = Scene([bench.block, bench.box((0, 0, 0), (1, 1, 1))], ["block", "arm"])
    places = [Pose(np.eye(3), np.array([0.0, 0, z])) for z in (5, 8)]
    both = scene.moved("arm", *places)
    assert both.names == ("block", "arm @ 0", "arm @ 1")
    np.testing.assert_array_equal(
        both.inside_material([[0.5, 0.5, 5.5], [0.5, 0.5, 7], [0.5, 0.5, 8.5]]), [1, 0, 1]
    )


def test_bodies_are_taken_away_and_joined(bench) -> None:
    scene = Scene([bench.block, bench.box((0, 0, 0), (1, 1, 1))], ["block", "lid"])
    assert scene.without("lid").names == ("block",)
    joined = scene.without("lid").joined(scene.without("block"))
    assert joined.digest == scene.digest


def test_says_which_bodies_there_are(bench) -> None:
    scene = Scene([bench.block], ["block"])
    with pytest.raises(GeometryError, match="there is no body 'lid'; the bodies are 'block'"):
        scene.without("lid")
    with pytest.raises(GeometryError, match="block is the only body; a scene without it"):
        scene.without("block")
    with pytest.raises(GeometryError, match="block cannot be moved without a pose"):
        scene.moved("block")
    with pytest.raises(GeometryError, match="two bodies are called 'block'"):
        scene.joined(scene)
    with pytest.raises(GeometryError, match="1 bodies but 2 poses; give each body one"):
        Scene([bench.block], poses=[Pose.identity()] * 2)


def test_a_body_that_crosses_itself_is_refused_with_a_place(bench) -> None:
    both = trimesh.util.concatenate(
        [bench.box((0, 0, 0), (2, 2, 2)), bench.box((1, 1, 1), (3, 3, 3))]
    )
    with pytest.raises(
        GeometryError, match=r"part crosses itself at \(.*\) mm.*--as-faces"
    ) as told:
        Scene([both], ["part"])
    place = [float(v) for v in re.findall(r"-?[\d.]+", str(told.value).split("mm")[0])]
    # Where surfaces of two boxes meet, one coordinate is that of a side of the first,
    assert any(v in (0, 2) for v in place)
    # and the other of a side of the second.
    assert any(v in (1, 3) for v in place)
    faces = Scene([both], ["part"], as_faces=True)
    assert not faces.bodies[0].is_closed


def test_bare_faces_hide_and_have_no_inside(bench) -> None:
    """A box without its lid: as faces it hides to the sides from both sides."""
    box = bench.box((-6, -6, 0), (6, 6, 4))
    tube = trimesh.Trimesh(box.vertices, box.faces[box.face_normals[:, 2] < 0.5], process=False)
    scene = Scene([tube], as_faces=True)
    assert not scene.inside_material([0, 0, 2])
    assert scene.bodies[0].volume_mm3 == 0
    target = Target(np.add(bench.square, [0, 0, 0.1]))
    region = visibility_region(scene, target, bench.workspace, audit_points=2000)
    assert 0.01 < region.volume_mm3 / bench.volume < 0.2
    assert region.audit.disagreements == 0


def test_corners_that_single_precision_tells_apart_become_one(bench) -> None:
    """Triangles whose corners were rounded apart, as some programs write STL."""
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=50)
    loose = sphere.triangles.reshape(-1, 3) * (
        1 + 1e-7 * np.random.default_rng(0).uniform(-1, 1, (3 * len(sphere.faces), 1))
    )
    body = Body.from_triangles("ball", loose, np.arange(len(loose)).reshape(-1, 3))
    assert body.is_closed
    assert len(body.vertices_mm) == len(sphere.vertices)


def test_refuses_corners_that_are_not_finite() -> None:
    with pytest.raises(GeometryError, match="ball has a corner that is not finite, vertex 1"):
        Body.from_triangles("ball", [[0, 0, 0], [np.nan, 0, 0], [0, 1, 0]], [[0, 1, 2]])


def test_scene_file_places_its_bodies(tmp_path, bench) -> None:
    bench.block.export(tmp_path / "block.stl")
    bench.box((0, 0, 0), (1, 2, 3)).export(tmp_path / "arm.ply")
    (tmp_path / "scene.toml").write_text(
        """
        [[bodies]]
        file = "block.stl"
        unit = "mm"
        [[bodies]]
        name = "arm"
        file = "arm.ply"
        unit = "cm"
        poses = [
            { translation = ["0 mm", "0 mm", "1 cm"] },
            { translation = ["0 mm", "0 mm", "1 in"], rotation_deg = [0, 0, 90] },
        ]
        """,
        encoding="utf-8",
    )
    scene = Scene.load(tmp_path / "scene.toml")
    assert scene.names == ("block.stl", "arm @ 0", "arm @ 1")
    np.testing.assert_allclose(scene.body("arm @ 0").bounds_mm, [[0, 0, 10], [10, 20, 40]])
    np.testing.assert_allclose(
        scene.body("arm @ 1").bounds_mm, [[-20, 0, 25.4], [0, 10, 55.4]], atol=1e-12
    )
    assert [s.file for s in scene.sources] == ["block.stl", "arm.ply"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "bodies: Field required"),
        ('[[bodies]]\nfile="a.stl"\npose={}\nposes=[{}]', "give either pose or poses"),
        ('[[bodies]]\nfile="a.stl"\npose={translation=[1,2,3]}', "a length needs its unit"),
        ('[[bodies]]\nfile="a.stl"\nunit="mm"\nangle=3', "angle: Extra inputs"),
    ],
)
def test_scene_files_that_are_not_understood(tmp_path, text: str, message: str) -> None:
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        Scene.load(tmp_path / "scene.toml")


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


def test_a_mesh_that_the_library_alters_is_refused(bench, monkeypatch) -> None:
    """It collapses slivers as it takes a mesh over; here it loses half of the cube."""

    class Losing:
        def __init__(self, mesh) -> None:
            self.mesh = mesh

        def status(self):
            return manifold3d.Error.NoError

        def volume(self) -> float:
            return 0.5

    monkeypatch.setattr(planning.boolean, "Manifold", Losing)
    cube = bench.box((0, 0, 0), (1, 1, 1))
    with pytest.raises(GeometryError, match=r"lid changed by 5.0e-01 of its box when it was taken"):
        to_manifold("lid", cube.vertices, cube.faces)


def test_a_mesh_that_the_library_alters_is_taken_over_when_shaken(bench, monkeypatch) -> None:
    """A library that loses half of what has a corner at exactly (1, 1, 1)."""
    library = planning.boolean.Manifold

    def losing(mesh):
        exact = (np.asarray(mesh.vert_properties) == 1).all(axis=1).any()
        return library(mesh).scale([0.5 if exact else 1.0, 1, 1])

    monkeypatch.setattr(planning.boolean, "Manifold", losing)
    cube = bench.box((0, 0, 0), (1, 1, 1))
    solid = to_manifold("lid", cube.vertices, cube.faces)
    assert solid.volume() == pytest.approx(1, abs=1e-11)
    assert abs(np.array(solid.bounding_box()) - [0, 0, 0, 1, 1, 1]).max() <= 1e-12


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
