"""Real lens tables, and invented ones of nasty shape, through map, validation and consistency."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from lenscal.calibration.table import CalibrationTable
from lenscal.cli.main import program
from lenscal.errors import InputError, MapError
from lenscal.maps.consistency import check_consistency
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.validation import cross_validate, summarise


def run(*words):
    return CliRunner().invoke(program, [str(w) for w in words], catch_exceptions=False).output


def through(tmp_path, table, spoil=None, factor=1.05):
    """Take a table through import, map, validation and consistency, as a user does."""
    table = table.reset_index(drop=True)
    if spoil is not None:
        table.loc[spoil, "image_distance_mm"] *= factor
    table.to_csv(tmp_path / "given.csv", index=False)
    words = ("--format", "csv", "--pitch", "3 um", "--size", "1920x1080")
    run("import", tmp_path / "given.csv", *words, "-o", tmp_path / "table.csv")
    imported = CalibrationTable.load(tmp_path / "table.csv")
    lens_map = fit_lens_map(imported)
    assert lens_map.domain.contains(table["zoom"], table["focus"]).all()
    assert summarise(cross_validate(imported, folds=4)) is not None
    return lens_map, check_consistency(imported)


def kurokesu(folder, name):
    """Every ninetieth point of the drive curves of a real lens, sharp at infinity and near."""
    curves = pd.read_csv(folder / "kurokesu-sce2" / f"{name}_curves.csv").iloc[::90]
    near = next(c for c in curves if c.startswith("focus_near"))
    return pd.concat(
        pd.DataFrame(
            {
                "zoom": curves["zoom_x"],
                "focus": curves[focus],
                "image_distance_mm": curves["focal_range"],
            }
        )
        for focus in ("focus_inf", near)
    )


@pytest.mark.parametrize("name", ["L085", "L086"])
def test_the_curves_of_real_zoom_lenses(tmp_path, reference_data, name):
    """Focal lengths that a maker tabulated: a narrow band, nothing to complain of."""
    table = kurokesu(reference_data, name)
    lens_map, consistency = through(tmp_path, table)
    assert not consistency["flagged"].any()
    assert not lens_map.domain.is_rectangle
    found = lens_map.image_distance_mm(table["zoom"], table["focus"])
    np.testing.assert_allclose(found, table["image_distance_mm"], rtol=0.05)
    middle = len(table) // 4
    _, spoilt = through(tmp_path, table, spoil=middle, factor=1.2)
    assert middle in np.flatnonzero(spoilt["flagged"])


def test_the_frames_of_a_real_clip(tmp_path, reference_data):
    """One zoom, hundreds of focus distances of a camera that tells them in feet."""
    clip = pd.read_csv(reference_data / "opentrackio" / "venice_D001C005_210716AG.csv")
    feet = pd.to_numeric(clip["Focus Distance (ft)"], errors="coerce")
    table = pd.DataFrame(
        {
            "zoom": clip["Focal Length (mm)"].astype(float),
            "focus": feet,
            "image_distance_mm": clip["Focal Length (mm)"].astype(float),
            "object_distance_mm": 304.8 * feet,
        }
    )
    table = table.dropna().drop_duplicates(["zoom", "focus"]).iloc[::6]
    lens_map, consistency = through(tmp_path, table)
    assert not consistency["flagged"].any()
    np.testing.assert_allclose(
        lens_map.object_distance_mm(32, table["focus"]), table["object_distance_mm"], rtol=1e-6
    )


def test_a_zoom_set_of_two(tmp_path, reference_data):
    words = ("--format", "ros", "--pitch", "5.5 um", "-o", tmp_path / "t.csv")
    run("import", reference_data / "ros-zoom" / "test_calibration_zoom_%d.yaml", *words)
    table = CalibrationTable.load(tmp_path / "t.csv")
    found = fit_lens_map(table).image_distance_mm(table.rows["zoom"], 0)
    # f_x and f_y differ from camera to camera, whereas a sensor has one ratio of its pitches.
    np.testing.assert_allclose(found / 0.0055, [259.79888, 1259.79888], rtol=6e-3)
    assert check_consistency(table)["sigmas"].isna().all()


def grid(zooms, focuses):
    zoom, focus = np.meshgrid(zooms, focuses, indexing="ij")
    return zoom.ravel(), focus.ravel()


def comb():
    """One focus at every zoom, and all of them at a few."""
    along = grid(np.linspace(0, 100, 21), [50.0])
    teeth = grid([0.0, 50.0, 100.0], np.linspace(0, 40, 5))
    return tuple(np.concatenate(pair) for pair in zip(along, teeth, strict=True))


def triangle():
    zoom, focus = grid(np.linspace(0, 100, 7), np.linspace(0, 100, 7))
    inside = zoom + focus <= 100
    return zoom[inside], focus[inside]


def on_unit(zoom, focus):
    """Settings as shares of their range."""
    return tuple(
        (v - v.min()) / (np.ptp(v) or 1.0) for v in (np.asarray(zoom, float), np.asarray(focus))
    )


#: Settings of a shape each.
SHAPES = {
    "one zoom only": grid([7.0], np.linspace(0, 100, 12)),
    "one focus only": grid(np.linspace(0, 100, 12), [3.0]),
    "a comb": comb(),
    "a triangle": triangle(),
    "zoom descending": grid(np.linspace(100, 0, 6), np.linspace(0, 50, 5)),
    "everything reversed": tuple(v[::-1] for v in grid(np.arange(6.0), np.arange(5.0))),
    "huge counts": grid(np.linspace(0, 65535, 6).round(), np.linspace(0, 65535, 5).round()),
    "shares of 1": grid(np.linspace(0, 1, 6), np.linspace(0, 1, 5)),
    "negative": grid(np.linspace(-90, -10, 6), np.linspace(-3, 2, 5)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_settings_of_any_shape(tmp_path, name):
    """A smooth lens is mapped and not complained of; a setting that is off is named."""
    zoom, focus = SHAPES[name]
    x, y = on_unit(zoom, focus)
    rng = np.random.default_rng(2)
    true = 20 * np.exp(1.2 * x + 0.1 * y)
    noise = 1 + 1e-3 * rng.normal(size=len(zoom))
    table = pd.DataFrame({"zoom": zoom, "focus": focus, "image_distance_mm": true * noise})
    lens_map, consistency = through(tmp_path, table)
    np.testing.assert_allclose(lens_map.image_distance_mm(zoom, focus), true, rtol=4e-3)
    assert not consistency["flagged"].any()
    spoil = len(zoom) // 2
    _, spoilt = through(tmp_path, table, spoil=spoil)
    assert np.flatnonzero(spoilt["flagged"]).tolist() == [spoil]


def test_a_steep_end(tmp_path):
    """D runs to infinity at the far end of the focus; nothing there is flagged."""
    zoom, focus = grid(np.linspace(0, 100, 7), np.linspace(0, 1, 9))
    distance = 500 / (1.001 - focus)
    table = pd.DataFrame(
        {
            "zoom": zoom,
            "focus": focus,
            "image_distance_mm": 20 * np.exp(zoom / 80),
            "object_distance_mm": distance,
        }
    )
    lens_map, consistency = through(tmp_path, table)
    assert not consistency["flagged"].any()
    found = lens_map.object_distance_mm(zoom, focus)
    np.testing.assert_allclose(found, distance, rtol=0.02)


def test_three_settings(tmp_path):
    table = pd.DataFrame(
        {"zoom": [0.0, 1, 1], "focus": [0.0, 0, 1], "image_distance_mm": [20.0, 30, 31]}
    )
    with pytest.raises(MapError, match="3 samples cannot determine a surface .* at least 4"):
        fit_lens_map(table)
    assert not check_consistency(table)["flagged"].any()


def test_repeated_measurements_are_refused_by_name():
    table = pd.DataFrame(
        {"zoom": [0.0, 1, 1], "focus": [0.0, 2, 2], "image_distance_mm": [20.0, 30, 31]}
    )
    for ask in (fit_lens_map, check_consistency, cross_validate):
        with pytest.raises(InputError, match="zoom 1, focus 2 stands more than once"):
            ask(table)
