"""Whatever stands in a field, wherever a file ends: a reader reads it or says what is wrong."""

import copy
import json

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.errors import FileError
from lenscal.formats.camera_info import read_camera_info, write_camera_info
from lenscal.formats.colmap import read_colmap, write_colmap
from lenscal.formats.exported import ExportedSetting
from lenscal.formats.mrcal_model import read_mrcal, write_mrcal
from lenscal.formats.opencv_yaml import (
    read_opencv,
    write_opencv_json,
    write_opencv_yaml,
)
from lenscal.formats.opentrackio import write_opentrackio
from lenscal.formats.opentrackio_samples import read_opentrackio
from lenscal.formats.ulens import read_ulens, write_ulens
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting

SETTINGS = [
    ExportedSetting(LensSetting(z, 5), Camera(Sensor(64, 48, 0.1, 0.1), 30.0 + z, 1e-3), 400.0, 3.0)
    for z in (1, 4)
]
CAMERA = SETTINGS[0].camera
CASES = {
    "a.json": (
        lambda p: write_opentrackio(p, SETTINGS, image_plane_distance_mm=50),
        read_opentrackio,
        json,
    ),
    "a.ulens": (lambda p: write_ulens(p, SETTINGS), read_ulens, json),
    "cv.json": (lambda p: write_opencv_json(p, CAMERA), lambda p: read_opencv(p, 0.1), json),
    "cv.yml": (lambda p: write_opencv_yaml(p, CAMERA), lambda p: read_opencv(p, 0.1), None),
    "ros.yaml": (
        lambda p: write_camera_info(p, CAMERA),
        lambda p: read_camera_info(p, 0.1),
        yaml,
    ),
    "m.cameramodel": (lambda p: write_mrcal(p, CAMERA), lambda p: read_mrcal(p, 0.1), None),
    "cameras.txt": (lambda p: write_colmap(p, SETTINGS), lambda p: read_colmap(p, 0.1), None),
}
JUNK = st.sampled_from(
    [None, True, 0, -1, 1.5, 1e300, "", "x", "nan", [], [None], [[1]], {}, {"a": 1}, [1, 2, 3]]
)


def places(content, way=()):
    yield way
    if isinstance(content, dict | list):
        names = content if isinstance(content, dict) else range(len(content))
        for name in names:
            yield from places(content[name], (*way, name))


def read_or_refused(read, path):
    refusal = None
    try:
        read(path)
    except FileError as error:
        refusal = str(error)
    assert refusal is None or str(path) in refusal


@pytest.mark.parametrize("name", [n for n, case in CASES.items() if case[2] is not None])
@settings(max_examples=60)
@given(data=st.data())
def test_junk_in_a_field(tmp_path_factory, name, data):
    write, read, language = CASES[name]
    path = tmp_path_factory.mktemp("junk") / name
    write(path)
    load = yaml.safe_load if language is yaml else json.loads
    content = load(path.read_text())
    way = data.draw(st.sampled_from(list(places(content))))
    junk = copy.deepcopy(data.draw(JUNK))
    if way:
        place = content
        for step in way[:-1]:
            place = place[step]
        place[way[-1]] = junk
    else:
        content = junk
    dump = yaml.safe_dump if language is yaml else json.dumps
    path.write_text(dump(content))
    read_or_refused(read, path)


@pytest.mark.parametrize("name", CASES)
@settings(max_examples=25)
@given(share=st.floats(0, 1))
def test_files_that_end_early(tmp_path_factory, name, share):
    write, read, _ = CASES[name]
    path = tmp_path_factory.mktemp("cut") / name
    write(path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    read_or_refused(read, path)
