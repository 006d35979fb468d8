import json
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from lenscal.cli.export import FORMATS
from lenscal.cli.main import program
from lenscal.errors import InputError, OutOfDomainError, UnitError
from lenscal.maps.lens_map import LensMap

MAP = Path(__file__).parents[3] / "data" / "vicon-1990" / "map.json"


def run(*words):
    return CliRunner().invoke(program, [str(w) for w in words], catch_exceptions=False)


@pytest.fixture(scope="module")
def camera():
    return LensMap.load(MAP).camera_at(98, 131)


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_is_written_for_one_setting(tmp_path, form):
    out = tmp_path / "out"
    result = run("export", MAP, "--format", form, "--zoom", 98, "--focus", 131, "-o", out)
    assert f"1 settings exported as {form}: {out}" in result.output
    assert out.stat().st_size > 100


def test_opencv_gets_the_image_distance(tmp_path, camera):
    out = tmp_path / "c.json"
    result = run("export", MAP, "--format", "opencv", "--zoom", 98, "--focus", 131, "-o", out)
    assert "worst error of the conversion of distortion: " in result.output
    content = json.loads(out.read_text())
    assert content["camera_matrix"]["data"] == camera.matrix.ravel().tolist()


def test_a_zoom_set_per_focus_setting(tmp_path):
    result = run("export", MAP, "--format", "ros", "--grid", "4x2", "-o", tmp_path / "set")
    names = sorted(p.name for p in (tmp_path / "set").iterdir())
    # Rounded to whole settings: 92, 97.67, 103.33, 109.
    zooms = (103, 109, 92, 98)
    assert names == [f"focus_{f}_zoom_{z}.yaml" for f in (140, 60) for z in zooms]
    assert "8 settings exported as ros: 8 files in" in result.output
    assert "the interpolating manager of ROS mixes up its weights" in result.output
    content = yaml.safe_load((tmp_path / "set" / "focus_60_zoom_98.yaml").read_text())
    expected = LensMap.load(MAP).camera_at(98, 60).matrix
    assert content["camera_matrix"]["data"] == expected.ravel().tolist()


def test_settings_that_are_repeated_are_combined(tmp_path):
    words = ("--zoom", 93.5, "--zoom", 98, "--focus", 70, "--focus", 131)
    run("export", MAP, "--format", "mrcal", *words, "-o", tmp_path / "m")
    names = {p.name for p in (tmp_path / "m").iterdir()}
    assert "zoom_93.5_focus_70.cameramodel" in names
    assert len(names) == 4


def test_distances_from_the_image_plane_need_it(tmp_path):
    words = ("export", MAP, "--format", "opentrackio", "--zoom", 98, "--focus", 131)
    run(*words, "--image-plane-distance", "35 cm", "-o", tmp_path / "o.json")
    lens = json.loads((tmp_path / "o.json").read_text())["lens"]
    lens_map = LensMap.load(MAP)
    offset = float(lens_map.nodal_offset_mm(98, 131))
    assert lens["entrancePupilOffset"] == pytest.approx((350 - offset) / 1000)
    standoff = float(lens_map.standoff_mm(98, 131))
    assert lens["focusDistance"] == pytest.approx((350 + standoff) / 1000)
    run(*words, "-o", tmp_path / "o.json")
    content = json.loads((tmp_path / "o.json").read_text())
    assert "entrancePupilOffset" not in content["lens"]
    history = content["static"]["lens"]["calibrationHistory"]
    assert history == [f"lenscal map {lens_map.digest}"]
    with pytest.raises(UnitError, match="has no unit"):
        run(*words, "--image-plane-distance", "35", "-o", tmp_path / "o.json")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "say which settings: --zoom and --focus, or --grid"),
        (("--zoom", 98), "say which settings"),
        (("--zoom", 98, "--focus", 131, "--grid", "2x2"), "--grid stands in place of"),
        (("--grid", "2"), "--grid is written as two whole numbers, such as 7x5, not '2'"),
        (("--grid", "0x2"), "--grid is written as"),
        (
            ("--zoom", 98, "--focus", 131, "--image-plane-distance", "1 m"),
            "is for opentrackio, not",
        ),
    ],
)
def test_words_that_do_not_fit(tmp_path, words, message):
    with pytest.raises(InputError, match=message):
        run("export", MAP, "--format", "ulens", *words, "-o", tmp_path / "o")


def test_outside_the_map(tmp_path):
    with pytest.raises(OutOfDomainError, match="outside the map"):
        run("export", MAP, "--format", "ulens", "--zoom", 60, "--focus", 131, "-o", tmp_path / "o")


def test_a_curved_domain_without_the_settings_of_a_coarse_grid(tmp_path):
    """Samples along a diagonal: the middle of one axis and the end of the other is outside."""
    import numpy as np
    import pandas as pd

    from lenscal.maps.fit import fit_lens_map
    from lenscal.sensor import Sensor

    at = np.linspace(0, 10, 6)
    table = pd.DataFrame(
        {
            "zoom": np.append(at, 10.0),
            "focus": np.append(at, 0.0) * 10,
            "magnification": 0.1 + 0.01 * np.append(at, 10.0),
            "object_distance_mm": 400.0 + np.append(at, 0.0),
        }
    )
    fit_lens_map(table, sensor=Sensor(64, 48, 0.1, 0.1)).save(tmp_path / "map.json")
    out = tmp_path / "t.csv"
    result = run("export", tmp_path / "map.json", "--format", "csv", "--grid", "3x3", "-o", out)
    assert "6 settings exported as csv" in result.output
    strip = table.assign(zoom=[*at, 6.0], focus=[*at * 10, 20.0])
    fit_lens_map(strip, sensor=Sensor(64, 48, 0.1, 0.1)).save(tmp_path / "strip.json")
    with pytest.raises(InputError, match="no setting of a grid 1x2 lies in the domain"):
        run("export", tmp_path / "strip.json", "--format", "csv", "--grid", "1x2", "-o", out)
