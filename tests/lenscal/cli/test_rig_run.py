import cv2
import pytest
from click.testing import CliRunner

from lenscal.cli.main import program
from lenscal.errors import FileError, SessionError
from lenscal.rig.simulated import SimulatedRig
from lenscal.sequence import Sequence, Station
from lenscal.session.aim import hand_pose
from lenscal.setting import ApproachSide, LensSetting

RIG = '[simulated]\npreset = "vicon-1990"\nseed = 0\n'


@pytest.fixture
def folder(tmp_path):
    rig = SimulatedRig.preset("vicon-1990", seed=0)
    station = Station(
        "viewpoint 0",
        LensSetting(98, 131, 20),
        ApproachSide.FROM_BELOW,
        hand_pose(rig, 370.0),
        370.0,
        0.1,
    )
    Sequence([station], rig.identities()).save(tmp_path / "sequence.json")
    (tmp_path / "rig.toml").write_text(RIG)
    return tmp_path


def run(folder, **changes):
    words = {"sequence": "sequence.json", "rig": "rig.toml", "out": "pictures"} | changes
    names = [str(folder / words[name]) for name in ("sequence", "rig", "out")]
    arguments = ["rig", "run", names[0], "--rig", names[1], "-o", names[2]]
    return CliRunner().invoke(program, arguments, catch_exceptions=False)


def test_a_picture_is_taken_and_told_of(folder):
    result = run(folder)
    assert result.exit_code == 0
    assert "frames/0000.png: viewpoint 0, zoom 98, focus 131, iris 20" in result.output
    assert "pictures of 1 viewpoints and their record are in" in result.output
    assert cv2.imread(str(folder / "pictures" / "frames" / "0000.png")).shape == (480, 512, 3)


def test_errors_say_what_to_do(folder):
    (folder / "other.toml").write_text(RIG.replace("seed = 0", "seed = 1"))
    with pytest.raises(SessionError, match="the sequence is for another rig: its rig is"):
        run(folder, rig="other.toml")
    with pytest.raises(FileError, match="cannot read .*none.json: No such file"):
        run(folder, sequence="none.json")
    with pytest.raises(FileError, match="cannot read the rig .*none.toml: No such file"):
        run(folder, rig="none.toml")


def test_help_has_an_example():
    result = CliRunner().invoke(program, ["rig", "run", "--help"])
    assert "lenscal rig run sequence.json --rig data/rig.toml -o pictures" in result.output
