import json

import numpy as np
import pytest

from lenscal.document import read_document, write_document
from lenscal.errors import FileError


@pytest.fixture
def path(tmp_path):
    return write_document(tmp_path / "deep" / "map.json", "lens-map", 2, {"level": 0.192, "n": [1]})


def test_what_was_written_is_read(path):
    assert read_document(path, "lens-map", 2) == {"level": 0.192, "n": [1], "version": 2}


def test_no_other_file_is_left_behind(path):
    assert [p.name for p in path.parent.iterdir()] == ["map.json"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:-20], "is cut short or no JSON"),
        (lambda text: text.replace("0.192", "0.193"), "was altered after it was written"),
        (
            lambda text: text.replace('"version": 2', '"version": 3'),
            "has version 3 of the lens-map",
        ),
        (lambda text: text.replace("lens-map", "plan"), "is a plan, not a lens-map"),
        (lambda text: "{}", "is no lenscal document, not a lens-map"),
        (lambda text: "[]", "is no lenscal document"),
    ],
)
def test_what_must_not_be_used_is_refused(path, change, message):
    path.write_text(change(path.read_text()))
    with pytest.raises(FileError, match=message):
        read_document(path, "lens-map", 2)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileError, match=r"cannot read .*none\.json: No such file"):
        read_document(tmp_path / "none.json", "lens-map", 1)


def test_a_picture_is_no_document(tmp_path):
    (tmp_path / "picture.json").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(FileError, match="cannot read"):
        read_document(tmp_path / "picture.json", "lens-map", 1)


def test_nan_never_gets_into_a_file(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_document(tmp_path / "a.json", "lens-map", 1, {"x": np.nan})
    assert not (tmp_path / "a.json").exists()


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot write .*file/a.json: "):
        write_document(tmp_path / "file" / "a.json", "lens-map", 1, {})


def test_the_order_of_keys_does_not_matter(path):
    content = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(content.items()))))
    assert read_document(path, "lens-map", 2)["level"] == 0.192
