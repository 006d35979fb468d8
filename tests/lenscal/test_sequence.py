import json

import numpy as np
import pytest

from lenscal.document import digest
from lenscal.errors import FileError, InputError
from lenscal.pose import Pose
from lenscal.sequence import Sequence, Station
from lenscal.setting import ApproachSide, LensSetting

POSE = Pose.from_rotation_vector([0.1, 2.0, -0.3], [1 / 3, 2e3, -0.1])


def station(**changes):
    words = {
        "name": "viewpoint 0",
        "setting": LensSetting(98.7, 1 / 3, 20.0),
        "approach": ApproachSide.FROM_ABOVE,
        "base_from_hand": POSE,
        "standoff_mm": 370.0,
        "sigma_standoff_mm": 0.05,
    }
    return Station(**(words | changes))


def test_a_sequence_is_read_back_to_the_last_digit(tmp_path):
    asked = Sequence(
        [station(), station(name="b", setting=LensSetting(1, 2))], {"lens": "L"}, {"task": "abc"}
    )
    read = Sequence.load(asked.save(tmp_path / "deep" / "sequence.json"))
    assert read.digest == asked.digest
    assert (read.identity, read.made_from, len(read)) == ({"lens": "L"}, {"task": "abc"}, 2)
    for a, b in zip(asked.stations, read.stations, strict=True):
        assert (a.name, a.setting, a.approach) == (b.name, b.setting, b.approach)
        np.testing.assert_array_equal(a.base_from_hand.matrix, b.base_from_hand.matrix)
    assert digest({}) != read.digest != Sequence([station()]).digest


def test_what_is_no_sequence():
    with pytest.raises(InputError, match="a sequence needs at least one station, but has none"):
        Sequence([])
    with pytest.raises(InputError, match="standoff_mm must be a positive number, but is 0 mm"):
        station(standoff_mm=0)


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda text: text[: len(text) // 2], "is cut short or no JSON"),
        (lambda text: text.replace("370.0", "380.0"), "was altered after it was written"),
        (lambda text: text.replace('"version": 1', '"version": 2'), "has version 2 of the sequenc"),
        (lambda text: text.replace('"sequence"', '"plan"'), "is a plan, not a sequence"),
    ],
)
def test_a_file_that_must_not_be_carried_out(tmp_path, harm, message):
    path = Sequence([station()]).save(tmp_path / "s.json")
    path.write_text(harm(path.read_text()))
    with pytest.raises(FileError, match=message):
        Sequence.load(path)


def test_a_sealed_file_that_says_too_little(tmp_path):
    body = {"identity": {}, "made_from": {}, "stations": [{"name": "x"}]}
    content = {"lenscal": "sequence", "version": 1, "sha256": digest(body), **body}
    path = tmp_path / "s.json"
    path.write_text(json.dumps(content))
    with pytest.raises(FileError, match=r"s.json is no whole sequence: KeyError\('setting'\)"):
        Sequence.load(path)
