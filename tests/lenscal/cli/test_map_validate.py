import json
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

from lenscal.cli.main import program
from lenscal.errors import FileError, InputError

TABLE = Path(__file__).parents[3] / "data" / "vicon-1990" / "table.csv"


def run(*words):
    arguments = ["map", "validate", *map(str, words)]
    return CliRunner().invoke(program, arguments, catch_exceptions=False)


@pytest.fixture
def some(tmp_path):
    """A CSV of other origin: 25 settings, the fourth of them spoilt."""
    table = pd.read_csv(TABLE).query("zoom in [92, 95.5, 99, 102, 104.5]").reset_index(drop=True)
    table.loc[3, ["object_distance_mm", "image_distance_mm", "focal_length_mm"]] *= 1.05
    table.to_csv(tmp_path / "some.csv", index=False)
    return tmp_path / "some.csv"


def test_both_are_printed_in_a_hundred_columns():
    result = run(TABLE, "--folds", 4)
    assert result.exit_code == 0
    assert max(map(len, result.output.splitlines())) <= 100
    assert "Prediction errors, in 4 folds" in result.output
    assert "no setting of 40 disagrees with the others by more than" in result.output
    assert "refitted_corner_px" in result.output


def test_flagged_settings_are_named_and_drawn(some, tmp_path):
    result = run(some, "--figure", tmp_path / "v.png")
    assert result.exit_code == 0
    lines = result.output.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("Consistency: 1 of 25"))
    assert lines[at + 2].split()[:2] == ["92", "120"]
    assert max(map(len, lines)) <= 100 or str(tmp_path) in lines[-1]
    assert (tmp_path / "v.png").stat().st_size > 20000


def test_json_holds_everything(some):
    found = json.loads(run(some, "--json").output)
    assert found["flagged"] == [{"zoom": 92.0, "focus": 120.0}]
    assert len(found["settings"]) == len(found["consistency"]) == 25
    assert found["consistency"][3]["flagged"] is True
    assert {"quantity", "edge", "rms_error"} <= set(found["summary"][0])


def test_too_few_to_judge(tmp_path):
    (tmp_path / "two.csv").write_text("zoom,focus,image_distance_mm\n1,0,260\n9999,0,1260\n")
    result = run(tmp_path / "two.csv")
    assert result.exit_code == 0
    assert "2 settings are too few to judge one by the others" in result.output
    assert "nothing can be validated" in result.output
    assert "without a setting the rest of the 2 do not determine a surface" in result.output
    assert "calibrate more settings: several focus settings at several zooms" in result.output


def test_four_settings_of_a_real_lens_validate_nothing(reference_data, tmp_path):
    """Along the curve of a lens sharp at infinity no setting is told by the other three."""
    curves = pd.read_csv(reference_data / "kurokesu-sce2" / "L086_curves.csv").iloc[::400]
    columns = {"zoom_x": "zoom", "focus_inf": "focus", "focal_range": "image_distance_mm"}
    curves[list(columns)].rename(columns=columns).to_csv(tmp_path / "given.csv", index=False)
    words = ["import", tmp_path / "given.csv", "--format", "csv", "-o", tmp_path / "table.csv"]
    words += ["--pitch", "3 um", "--size", "1920x1080"]
    assert CliRunner().invoke(program, [str(w) for w in words]).exit_code == 0
    result = run(tmp_path / "table.csv", "--folds", 2, "--figure", tmp_path / "v.png")
    assert result.exit_code == 0
    assert "Prediction errors, in 2 folds: nothing can be validated" in result.output
    assert "or deal them into more folds" in result.output
    assert max(map(len, result.output.splitlines()[:5])) <= 100


def test_what_cannot_be_read_or_drawn(tmp_path, some):
    with pytest.raises(FileError, match="there is no table .*none.csv; name the CSV"):
        run(tmp_path / "none.csv")
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(FileError, match="cannot read .*empty.csv as a table"):
        run(tmp_path / "empty.csv")
    with pytest.raises(InputError, match="cannot draw to v.txt; end it in .png, .pdf or .svg"):
        run(some, "--figure", tmp_path / "v.txt")
