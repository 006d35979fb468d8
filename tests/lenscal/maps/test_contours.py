"""Contours: on their level, within the domain, with everything along them."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.errors import InputError, MapError
from lenscal.maps.contours import SettingCurve
from lenscal.maps.fit import fit_lens_map

QUANTITIES = ["magnification", "object_distance_mm", "focal_length_mm", "nodal_offset_mm"]


@dataclasses.dataclass(frozen=True, eq=False)
class Strip:
    """A domain like that of a lens that is not parfocal: a band along a curve."""

    half_width: float = 14.0
    zoom = (90.0, 110.0)
    focus = (60.0, 140.0)

    def excess(self, zoom, focus):
        """How far beyond the border, negative inside."""
        share = np.clip((np.asarray(zoom) - 90) / 20, 0, 1)
        return np.abs(focus - 75 - 50 * share**1.5) - self.half_width

    def contains(self, zoom, focus):
        zoom = np.asarray(zoom)
        return (zoom >= 90 - 2e-8) & (zoom <= 110 + 2e-8) & (self.excess(zoom, focus) <= 0)

    def grid(self, count=101):
        return tuple(np.meshgrid(np.linspace(90, 110, count), np.linspace(60, 140, count)))


@pytest.fixture(scope="module")
def strip_map(lens_map):
    return dataclasses.replace(lens_map, domain=Strip())


@pytest.fixture(scope="module")
def peaked_map(lens):
    """A map whose magnification has its peak amid the domain, so that contours close."""
    zoom, focus = (a.ravel() for a in np.meshgrid(np.linspace(90, 110, 9), np.linspace(60, 140, 7)))
    table = lens.sample(zoom, focus)
    hill = ((zoom - 100) / 8) ** 2 + ((focus - 100) / 30) ** 2
    table["magnification"] = 0.3 * np.exp(-hill / 4)
    return fit_lens_map(table)


@settings(max_examples=40, deadline=None)
@given(quantity=st.sampled_from(QUANTITIES), share=st.floats(0.01, 0.99))
def test_vertices_have_the_level_and_carry_what_the_map_says(lens_map, quantity, share):
    low, high = lens_map.range_of(quantity)
    level = low + share * (high - low)
    curves = lens_map.contour(quantity, level)
    assert curves
    for curve in curves:
        assert (curve.quantity, curve.level) == (quantity, level)
        misses = np.abs(lens_map.value(quantity, curve.zoom, curve.focus) - level)
        assert misses.max() < 1e-11 * (high - low)
        for name in lens_map.quantities:
            mapped = lens_map.value(name, curve.zoom, curve.focus)
            np.testing.assert_allclose(curve.value(name), mapped, rtol=1e-12)


def test_a_contour_is_where_the_lens_has_it(lens, lens_map):
    (curve,) = lens_map.contour("magnification", 0.2)
    np.testing.assert_allclose(lens.magnification(curve.zoom, curve.focus), 0.2, rtol=1e-4)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_contours_end_on_the_border_of_a_curved_domain(strip_map, quantity):
    low, high = strip_map.range_of(quantity)
    for level in np.linspace(low, high, 12)[1:-1]:
        for curve in strip_map.contour(quantity, level):
            excess = strip_map.domain.excess(curve.zoom, curve.focus)
            assert excess.max() <= 0
            for end in (0, -1):
                at_zoom_end = min(abs(curve.zoom[end] - z) for z in strip_map.domain.zoom)
                assert excess[end] > -1e-9 or at_zoom_end < 1e-9


def test_pieces_in_a_curved_domain_are_those_of_the_whole_contour(lens_map, strip_map):
    (whole,) = lens_map.contour("magnification", 0.2)
    (piece,) = strip_map.contour("magnification", 0.2)
    held = strip_map.domain.contains(whole.zoom, whole.focus)
    np.testing.assert_array_equal(piece.zoom[1:-1], whole.zoom[held])
    assert held.sum() < len(whole)


def test_a_closed_contour_ends_where_it_starts_and_is_opened_where_it_is_cut(peaked_map):
    (ring,) = peaked_map.contour("magnification", 0.28)
    assert (ring.zoom[0], ring.focus[0]) == (ring.zoom[-1], ring.focus[-1])
    # Distances grow with zoom here: the band keeps one side of the ring, in one piece.
    distance = ring.value("object_distance_mm")
    (side,) = ring.within("object_distance_mm", float(np.median(distance)), np.inf)
    assert side.value("object_distance_mm")[[0, -1]] == pytest.approx(np.median(distance), rel=1e-9)
    (low, high) = sorted([float(np.quantile(distance, q)) for q in (0.4, 0.6)])
    assert len(ring.within("object_distance_mm", low, high)) == 2


@settings(max_examples=30, deadline=None)
@given(first=st.floats(-0.2, 1.2), second=st.floats(-0.2, 1.2))
def test_a_band_keeps_what_is_in_it_and_ends_exactly(lens_map, first, second):
    (curve,) = lens_map.contour("magnification", 0.2)
    along = curve.value("object_distance_mm")
    low, high = np.sort(along.min() + np.sort([first, second]) * np.ptp(along))
    pieces = curve.within("object_distance_mm", low, high)
    inside = (low <= along) & (along <= high)
    kept = [z for piece in pieces for z in piece.zoom]
    assert set(curve.zoom[inside]) <= set(kept)
    assert len(kept) <= inside.sum() + 2 * len(pieces)
    for piece in pieces:
        distance = piece.value("object_distance_mm")
        assert low - 1e-9 <= distance.min()
        assert distance.max() <= high + 1e-9
        np.testing.assert_allclose(piece.value("magnification"), 0.2, rtol=1e-11)
        mapped = lens_map.object_distance_mm(piece.zoom, piece.focus)
        np.testing.assert_allclose(distance, mapped, rtol=1e-12)
        for end in (0, -1):
            limits = [low, high, along[0], along[-1]]
            assert min(abs(distance[end] - limit) for limit in limits) < 1e-9


def test_a_band_narrower_than_the_vertices_are_apart_is_found(lens_map):
    (curve,) = lens_map.contour("magnification", 0.2)
    distance = curve.value("object_distance_mm")
    low, high = np.sort(distance[50] + np.array([0.4, 0.6]) * (distance[51] - distance[50]))
    (piece,) = curve.within("object_distance_mm", low, high)
    np.testing.assert_allclose(np.sort(piece.value("object_distance_mm")), [low, high], rtol=1e-12)


def test_a_band_that_is_never_entered_or_never_left(lens_map):
    (curve,) = lens_map.contour("magnification", 0.2)
    assert curve.within("object_distance_mm", 1.0, 2.0) == []
    assert curve.within("object_distance_mm", -np.inf, np.inf) == [curve]


def test_a_band_that_is_only_touched_leaves_a_single_setting(lens_map):
    (curve,) = lens_map.contour("magnification", 0.2)
    distance = curve.value("object_distance_mm")
    (touch,) = curve.within("object_distance_mm", 0.0, float(distance.min()))
    np.testing.assert_allclose(touch.zoom, curve.zoom[distance.argmin()], rtol=1e-12)


@pytest.mark.parametrize("low", [2.0, np.nan])
def test_a_band_that_is_empty_is_refused(lens_map, low):
    (curve,) = lens_map.contour("magnification", 0.2)
    with pytest.raises(InputError, match="a band runs from low to high, but that of standoff_mm"):
        curve.within("standoff_mm", low, 1.0)


def test_quantities_that_a_map_lacks_are_refused_by_its_curves(lens_map, lens, grid):
    (curve,) = lens_map.contour("magnification", 0.2)
    with pytest.raises(InputError, match="unknown quantity 'zoomness'; this map has magnification"):
        curve.value("zoomness")
    with pytest.raises(InputError, match="unknown quantity 'zoomness'"):
        curve.within("zoomness", 1, 2)
    table = lens.sample(*grid).drop(columns=["standoff_mm"])
    with pytest.raises(MapError, match="this map has no standoff_mm"):
        fit_lens_map(table).contour("standoff_mm", 380.0)


@pytest.mark.parametrize("level", [3.0, -1.0, np.nan, np.inf])
def test_levels_out_of_range_are_answered_with_the_range(strip_map, level):
    low, _ = strip_map.range_of("magnification")
    told = f"magnification never is {level:g} on this map: it runs from {low:.3g}"
    with pytest.raises(InputError, match=told):
        strip_map.contour("magnification", level)


def test_the_extreme_itself_is_no_error(lens_map):
    low, high = lens_map.range_of("magnification")
    for level in (low, high):
        assert all(len(curve) for curve in lens_map.contour("magnification", level))


def test_a_curve_becomes_a_table(lens_map):
    (curve,) = lens_map.contour("magnification", 0.2)
    table = curve.to_dataframe()
    assert list(table.columns) == ["zoom", "focus", *lens_map.quantities]
    np.testing.assert_array_equal(table["standoff_mm"], curve.value("standoff_mm"))


def test_a_curve_checks_its_arrays_and_cannot_be_written_to(lens_map):
    (curve,) = lens_map.contour("magnification", 0.2)
    with pytest.raises(ValueError, match="read-only"):
        curve.values[0, 0] = 1.0
    with pytest.raises(InputError, match="focus must have shape"):
        SettingCurve(
            curve.zoom, curve.focus[1:], curve.values, curve.quantity, curve.level, lens_map
        )
