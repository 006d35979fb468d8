"""The entrance pupil as a lens map gives it."""

import numpy as np
import pytest

from lenscal.document import read_document, write_document
from lenscal.errors import FileError, InputError, MapError, OutOfDomainError
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.maps.map_file import KIND, VERSION


def pupil_mm(lens, zoom, focus, iris):
    distance = lens.magnification(zoom, focus) * lens.object_distance_mm(zoom, focus)
    return distance * (0.001 + 0.002 * iris) * np.exp(0.002 * (zoom - 100))


def rows_at(lens, grid, iris):
    rows = lens.sample(*grid)
    rows["image_distance_mm"] = rows["magnification"] * rows["object_distance_mm"]
    rows["pupil_iris"] = iris
    rows["entrance_pupil_diameter_mm"] = pupil_mm(lens, *grid, iris)
    rows["sigma_entrance_pupil_diameter_mm"] = 0.012 * rows["entrance_pupil_diameter_mm"]
    return rows


@pytest.fixture(scope="module")
def one_iris(lens, grid):
    return fit_lens_map(rows_at(lens, grid, 100.0))


@pytest.fixture(scope="module")
def two_irises(lens, grid):
    return fit_lens_map(rows_at(lens, grid, 100.0), pupil_samples=rows_at(lens, grid, 40.0))


def test_the_pupil_is_that_of_the_lens(lens, one_iris, two_irises):
    zoom, focus = np.array([[92.5], [101.0]]), np.array([75.0, 99.0, 128.0])
    truth = pupil_mm(lens, zoom, focus, 100.0)
    for lens_map in (one_iris, two_irises):
        found = lens_map.entrance_pupil_diameter_mm(zoom, focus, 100.0)
        sigma = lens_map.sigma_entrance_pupil_diameter_mm(zoom, focus, 100.0)
        assert found.shape == sigma.shape == (2, 3)
        np.testing.assert_allclose(found, truth, rtol=3e-3)
        assert (sigma > 0.01 * found).all()
        assert (sigma < 0.02 * found).all()
    stopped_down = two_irises.entrance_pupil_diameter_mm(zoom, focus, 40.0)
    np.testing.assert_allclose(stopped_down, pupil_mm(lens, zoom, focus, 40.0), rtol=3e-3)


def test_what_is_not_known_is_refused(one_iris, two_irises, lens_map):
    with pytest.raises(OutOfDomainError, match="iris 40 is not known: it was measured at iris 100"):
        one_iris.entrance_pupil_diameter_mm(95.0, 100.0, 40.0)
    assert np.isnan(one_iris.entrance_pupil_diameter_mm(95.0, 100.0, 40.0, outside="nan"))
    with pytest.raises(OutOfDomainError, match="zoom 80, focus 100. lies outside the map"):
        one_iris.entrance_pupil_diameter_mm(80.0, 100.0, 100.0)
    with pytest.raises(InputError, match="is known at the irises 40, 100, and between them; say"):
        two_irises.entrance_pupil_diameter_mm(95.0, 100.0)
    with pytest.raises(MapError, match="this map has no entrance pupil: no focus curve"):
        lens_map.entrance_pupil_diameter_mm(95.0, 100.0, 100.0)


def test_a_file_gives_it_back_exactly(two_irises, tmp_path):
    again = LensMap.load(two_irises.save(tmp_path / "map.json"))
    where = 97.0, 111.0, np.array([40.0, 77.0, 100.0])
    for name in ("entrance_pupil_diameter_mm", "sigma_entrance_pupil_diameter_mm"):
        np.testing.assert_allclose(getattr(again, name)(*where), getattr(two_irises, name)(*where))
    assert again.digest == two_irises.digest


def test_a_file_whose_samples_lost_the_pupil_is_refused(one_iris, tmp_path):
    path = one_iris.save(tmp_path / "map.json")
    body = read_document(path, KIND, VERSION)
    del body["version"]
    body["samples"]["entrance_pupil_diameter_mm"] = [None] * len(body["samples"]["zoom"])
    write_document(path, KIND, VERSION, body)
    with pytest.raises(FileError, match="it has an entrance pupil, but its samples give none"):
        LensMap.load(path)


def test_samples_that_do_not_determine_it_leave_a_note(lens, grid):
    rows = rows_at(lens, grid, 100.0)
    rows.loc[~rows.index.isin([0, 1, 8]), "entrance_pupil_diameter_mm"] = np.nan
    lens_map = fit_lens_map(rows)
    assert lens_map.pupil is None
    assert any("the map has no entrance pupil" in note for note in lens_map.notes)


def test_further_samples_need_their_columns(lens, grid):
    rows = rows_at(lens, grid, 100.0)
    with pytest.raises(InputError, match="pupil_samples lack the columns pupil_iris; add them"):
        fit_lens_map(rows, pupil_samples=rows.drop(columns="pupil_iris"))
