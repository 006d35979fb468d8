"""``lenscal contours``: figures and tables, on the map that the project carries."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from lenscal.cli.main import program
from lenscal.errors import InputError
from lenscal.maps.lens_map import LensMap

MAP = Path(__file__).parents[3] / "data" / "vicon-1990" / "map.json"


def run(*words):
    words = ["contours", MAP, *words]
    return CliRunner().invoke(program, [str(w) for w in words], catch_exceptions=False)


def test_limits_of_other_quantities_and_bands_become_a_table(tmp_path):
    out = tmp_path / "admissible.csv"
    band = ("--within", "magnification", 0.192, 0.25)
    run(
        "--quantity",
        "focal_length_mm",
        "--level",
        127,
        *band,
        "--limit",
        "standoff_mm",
        373,
        "-o",
        out,
    )
    table = pd.read_csv(out)
    focal = table[table["quantity"] == "focal_length_mm"]
    np.testing.assert_allclose(focal["focal_length_mm"], 127, rtol=1e-10)
    assert focal["magnification"].between(0.192 - 1e-12, 0.25 + 1e-12).all()
    assert focal["magnification"].max() == pytest.approx(0.25, abs=1e-12)
    standoff = table[table["quantity"] == "standoff_mm"]
    np.testing.assert_allclose(standoff["standoff_mm"], 373, rtol=1e-10)
    lens_map = LensMap.load(MAP)
    # The numbers in a table are text, so a setting on the border may lie a rounding outside.
    mapped = lens_map.object_distance_mm(table["zoom"], table["focus"])
    np.testing.assert_allclose(table["object_distance_mm"], mapped, rtol=1e-9)


@pytest.mark.parametrize("words", [["--surface"], ["--limit", "magnification", 0.25]])
def test_a_surface_and_limits_are_drawn(tmp_path, words):
    out = tmp_path / "figure.png"
    result = run("--quantity", "object_distance_mm", *words, "-o", out)
    assert f"contours of object_distance_mm written to {out}" in result.output
    image = matplotlib.image.imread(out)[..., :3]
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 1000


@pytest.mark.parametrize(
    "words", [["--level", 0.2], ["--limit", "standoff_mm", 373], ["--within", "standoff_mm", 1, 2]]
)
def test_a_surface_goes_with_no_curves(tmp_path, words):
    with pytest.raises(InputError, match="--surface draws a figure of the whole quantity, so it"):
        run("--surface", *words, "-o", tmp_path / "s.png")


def test_a_surface_is_no_table(tmp_path):
    with pytest.raises(InputError, match="--surface draws a figure of the whole quantity"):
        run("--surface", "-o", tmp_path / "s.csv")


def test_bands_need_a_contour_to_cut(tmp_path):
    with pytest.raises(InputError, match="--within cuts contours, so it needs at least one --lev"):
        run("--within", "standoff_mm", 1, 2, "-o", tmp_path / "c.csv")


def test_bands_that_leave_nothing_are_no_empty_table(tmp_path):
    with pytest.raises(InputError, match="no contour keeps within the bands asked for"):
        run("--level", 0.2, "--within", "standoff_mm", 1, 2, "-o", tmp_path / "c.csv")
    assert not (tmp_path / "c.csv").exists()
