"""The commands of the stages, on the small session that the project carries."""

import json
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

from lenscal.cli.main import program
from lenscal.errors import FileError, InputError, OutOfDomainError, SessionError

DATA = Path(__file__).parents[3] / "data"
MAP = DATA / "vicon-1990" / "map.json"


def run(*words):
    return CliRunner().invoke(program, [str(w) for w in words], catch_exceptions=False)


def test_a_map_is_shown_with_its_sigmas():
    result = run("map", "show", MAP, "--zoom", 98, "--focus", 131)
    lines = {line.split()[0]: line.split()[1:] for line in result.output.splitlines()}
    assert float(lines["magnification"][0]) == pytest.approx(0.1822, rel=0.01)
    assert lines["standoff_mm"][1] == "±"


def test_outside_the_map_is_an_error():
    with pytest.raises(OutOfDomainError, match="the setting .* lies outside the map"):
        run("map", "show", MAP, "--zoom", 60, "--focus", 131)


def test_a_map_is_fitted_from_a_table(tmp_path):
    result = run("map", "fit", DATA / "vicon-1990" / "table.csv", "-o", tmp_path / "map.json")
    assert "settings mapped over zoom 92 to 109 and focus 60 to 140" in result.output
    fitted, kept = (json.loads(p.read_text()) for p in (tmp_path / "map.json", MAP))
    assert fitted["samples"] == kept["samples"]


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_contours_are_drawn(tmp_path, ending):
    out = tmp_path / f"contours.{ending}"
    result = run("contours", MAP, "--level", 0.192, "--level", 0.25, "-o", out)
    assert f"contours of magnification written to {out}" in result.output
    assert out.stat().st_size > 5000


def test_contours_become_a_table_with_everything_along_them(tmp_path):
    run("contours", MAP, "--level", 0.192, "-o", tmp_path / "c.csv")
    table = pd.read_csv(tmp_path / "c.csv")
    assert table["magnification"].sub(0.192).abs().max() < 1e-9
    assert {"level", "piece", "zoom", "focus", "standoff_mm"} <= set(table.columns)


def test_contours_that_cannot_be(tmp_path):
    with pytest.raises(InputError, match="magnification never is 7 on this map: it runs from"):
        run("contours", MAP, "--level", 7, "-o", tmp_path / "c.png")
    with pytest.raises(InputError, match="cannot write contours to c.txt; end it in .png"):
        run("contours", MAP, "-o", tmp_path / "c.txt")
    with pytest.raises(InputError, match="a table of contours needs at least one --level"):
        run("contours", MAP, "-o", tmp_path / "c.csv")


PLAN = """
zoom = [104]
focus = [100]
autofocus = { nearest = "368 mm", farthest = "380 mm", step = "1.5 mm", iris = 100 }
views = { tilted = 2, tilt_deg = 25, iris = 20 }
"""


def test_a_session_is_recorded_once(tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN)
    result = run("session", "run", tmp_path / "plan.toml", "-o", tmp_path / "s")
    assert "1 settings, 3 views recorded in" in result.output
    assert len(list((tmp_path / "s" / "frames").rglob("*.png"))) == 3
    with pytest.raises(SessionError, match="holds another session already"):
        run("session", "run", tmp_path / "plan.toml", "-o", tmp_path / "s")


def test_what_a_session_cannot_run_on(tmp_path):
    with pytest.raises(FileError, match="cannot read the plan"):
        run("session", "run", tmp_path / "none.toml", "-o", tmp_path / "s")
    (tmp_path / "plan.toml").write_text(PLAN)
    with pytest.raises(InputError, match="there is no simulated rig 'canon'"):
        run("session", "run", tmp_path / "plan.toml", "--simulate", "canon", "-o", tmp_path / "s")
