import numpy as np
import pytest

from lenscal.errors import DeviceError, FileError, InputError
from lenscal.imaging.raycast import Body
from lenscal.imaging.ruler import Ruler
from lenscal.pose import Pose
from lenscal.rig.description import load_rig
from lenscal.rig.simulated import SimulatedRig
from lenscal.rig.simulated.workpiece import bodies_of_file
from lenscal.sensor import Window

RIG = """
[simulated]
preset = "vicon-1990"

[part]
file = "part.ply"
unit = "in"
base_from_part = { rotation_vector_deg = [180, 0, 0], translation = ["60 cm", "10 cm", "200 mm"] }

[[part.rulers]]
start = ["-0.5 in", "0 in", "0 in"]
towards = ["0 in", "0 in", "0 in"]
length = "1 in"
step = "0.02 in"
normal = [0, 0, -1]
"""


def sheet(half_mm=20.0, z_mm=0.0, reflectance=0.8):
    corners = [(-half_mm, -half_mm, z_mm), (half_mm, -half_mm, z_mm)]
    corners += [(half_mm, half_mm, z_mm), (-half_mm, half_mm, z_mm)]
    return Body(corners, [(0, 1, 2), (0, 2, 3)], reflectance)


def test_the_camera_sees_the_part_instead_of_the_target():
    rig = SimulatedRig.preset("vicon-1990")
    before = rig.camera.grab()
    rig.lay_down([sheet(400.0, reflectance=0.5)], rig.base_from_target)
    after = rig.camera.grab()
    assert after.image.shape == before.image.shape
    assert np.ptp(before.image.astype(float)) > 100, "a board has black and white"
    assert after.image.std() < 10, "a grey sheet has not"


def test_its_place_is_off_as_that_of_the_target():
    """What lies where the target lay is seen where the target was seen."""
    rig = SimulatedRig.preset("vicon-1990", seed=3)
    rig.lay_down([sheet()], rig.base_from_target)
    part, target = rig.true_part_from_camera(), rig.true_camera_from_target().inverse()
    np.testing.assert_allclose(part.matrix, target.matrix, atol=1e-9)


def test_a_ruler_is_seen_through_a_window():
    rig = SimulatedRig.preset("vicon-1990")
    ruler = Ruler(25.4, 0.508).decal([-12.7, 0, 0], [12.7, 0, 0], [0, 0, -1])
    rig.lay_down([sheet()], rig.base_from_target, [ruler])
    image = rig.camera.grab(Window(100, 230, 300, 20)).image
    assert image.shape == (20, 300)
    assert np.ptp(image.astype(float)) > 100


def test_a_part_inside_the_lens_is_a_collision():
    rig = SimulatedRig.preset("vicon-1990")
    rig.lay_down([sheet(), sheet(5.0, -200.0)], rig.base_from_target)
    with pytest.raises(
        DeviceError, match="a corner of the part lies .* mm behind the front of the"
    ):
        rig.camera.grab()


def test_without_a_part_its_place_cannot_be_told():
    with pytest.raises(InputError, match="no part lies on the bench; put one there with lay_down"):
        SimulatedRig.preset("vicon-1990").true_part_from_camera()


def test_a_rig_as_it_is_written(tmp_path):
    import trimesh

    trimesh.creation.box(extents=(1, 1, 0.5)).export(tmp_path / "part.ply")
    (tmp_path / "rig.toml").write_text(RIG)
    rig = load_rig(tmp_path / "rig.toml")
    assert rig.identity["rig"] == "simulated vicon-1990, seed 0"
    piece = rig.world.workpiece
    np.testing.assert_allclose(np.ptp(piece.bodies[0].vertices_mm, axis=0), [25.4, 25.4, 12.7])
    assert len(piece.decals) == 1
    stated = Pose.from_rotation_vector([np.pi, 0, 0], [600, 100, 200])
    assert piece.base_from_part.distance_to(stated)[0] < 1
    (tmp_path / "bare.toml").write_text('[simulated]\npreset = "machine-vision"\nseed = 4\n')
    assert load_rig(tmp_path / "bare.toml").world.workpiece is None


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        (
            '"60 cm"',
            "600",
            InputError,
            "part.base_from_part.translation.0: a length needs its unit",
        ),
        ('preset = "vicon-1990"', "", InputError, "simulated.preset: Field required"),
        ('"vicon-1990"', '"leica"', InputError, "there is no simulated rig 'leica'"),
        ('"part.ply"', '"none.ply"', FileError, "names the part .*none.ply, which is not there"),
        ('unit = "in"', 'unit = "ell"', InputError, "unknown unit of length 'ell'"),
    ],
)
def test_a_rig_that_is_not_understood(tmp_path, old, new, error, message):
    (tmp_path / "part.ply").write_text("")
    (tmp_path / "rig.toml").write_text(RIG.replace(old, new))
    with pytest.raises(error, match=message):
        load_rig(tmp_path / "rig.toml")


def test_a_part_that_is_no_mesh(tmp_path):
    (tmp_path / "part.stl").write_text("nothing")
    with pytest.raises(FileError, match="cannot read the part .*part.stl|holds no mesh"):
        bodies_of_file(tmp_path / "part.stl", 1.0)
    (tmp_path / "points.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n0 0 0\n"
    )
    with pytest.raises(FileError, match="points.ply holds no mesh for the simulated rig"):
        bodies_of_file(tmp_path / "points.ply", 1.0)
