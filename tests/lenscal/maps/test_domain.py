"""The domain of a map: what samples support, for the ways in which people sample a lens."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.path import Path as MatplotlibPath

from lenscal.maps.domain import Domain

#: The focus strip of the simulated machine-vision lens, which is not parfocal.
STRIP_ZOOM = (0.0, 807.0, 1614.0, 2420.0, 3227.0)
STRIP_LOW = (6039.0, 6268.0, 6098.0, 4876.0, 1353.0)
STRIP_HIGH = (6379.0, 6941.0, 7538.0, 8103.0, 8374.0)


def strip_ends(zoom):
    return np.interp(zoom, STRIP_ZOOM, STRIP_LOW), np.interp(zoom, STRIP_ZOOM, STRIP_HIGH)


def strip(columns=9, rows=8):
    zoom = np.repeat(np.linspace(0, 3227, columns), rows)
    low, high = strip_ends(zoom)
    return zoom, low + np.tile(np.linspace(0, 1, rows), columns) * (high - low)


def grid(columns=7, rows=5):
    zoom, focus = np.meshgrid(np.linspace(90, 110, columns), np.linspace(60, 140, rows))
    return zoom.ravel(), focus.ravel()


def agreement_with_strip(domain):
    """Area of the strip that is missing, and of what is there beyond it, as shares of the strip."""
    zoom, focus = np.meshgrid(np.linspace(0, 3227, 801), np.linspace(1353, 8374, 801))
    low, high = strip_ends(zoom)
    true, found = (focus >= low) & (focus <= high), domain.contains(zoom, focus)
    return (true & ~found).sum() / true.sum(), (found & ~true).sum() / true.sum()


def test_columns_over_a_strip_are_that_strip_and_not_its_hull():
    domain = Domain.around(*strip())
    missing, beyond = agreement_with_strip(domain)
    assert missing < 0.005
    assert beyond < 0.005
    # The hull would hold this; the lens has no sharp plane there.
    assert not domain.contains(1614.0, 5000.0)
    assert not domain.is_rectangle
    assert str(domain) == "a part of zoom 0 to 3227 and focus 1353 to 8374"


def test_a_setting_beside_the_columns_changes_nothing():
    zoom, focus = strip()
    with_reference = Domain.around(np.append(zoom, 1600.0), np.append(focus, 6500.0))
    np.testing.assert_array_equal(with_reference.outline, Domain.around(zoom, focus).outline)


def test_a_setting_beyond_the_columns_extends_them():
    zoom, focus = grid()
    above = Domain.around(np.append(zoom, 95.0), np.append(focus, 150.0))
    assert above.contains([95.0, 95.0], [150.0, 145.0]).all()
    assert not above.contains(109.0, 145.0)
    beside = Domain.around(np.append(zoom, 120.0), np.append(focus, 100.0))
    assert beside.contains(119.0, 100.0)
    assert not beside.contains(119.0, 60.0)


def test_unlike_columns_of_many_samples_are_joined_too():
    """The same step of focus at every zoom: six samples at one end of the strip, 141 at another."""
    columns = [np.arange(*strip_ends(zoom), 50.0) for zoom in np.linspace(0, 3227, 12)]
    zoom = np.repeat(np.linspace(0, 3227, 12), [len(c) for c in columns])
    missing, beyond = agreement_with_strip(Domain.around(zoom, np.concatenate(columns)))
    assert missing < 0.03
    assert beyond < 0.01


def test_a_grid_masked_by_a_strip_follows_the_strip():
    zoom, focus = (
        v.ravel() for v in np.meshgrid(np.linspace(0, 3227, 14), np.arange(1400, 8400, 75.0))
    )
    low, high = strip_ends(zoom)
    kept = (focus >= low) & (focus <= high)
    missing, beyond = agreement_with_strip(Domain.around(zoom[kept], focus[kept]))
    assert missing < 0.04
    assert beyond < 0.01


@settings(deadline=None, max_examples=60)
@given(
    columns=st.integers(3, 9),
    rows=st.integers(3, 9),
    dropped=st.sets(st.integers(0, 80), max_size=3),
)
def test_a_grid_is_a_full_rectangle_also_with_settings_missing(columns, rows, dropped):
    zoom, focus = grid(columns, rows)
    corners = np.isin(zoom, (90, 110)) & np.isin(focus, (60, 140))
    # At most one setting is lost per column, and no corner, where nothing beyond is known.
    lost = [i for i in dropped if i < len(zoom) and not corners[i]]
    lost = [i for i in lost if [j % columns for j in lost].count(i % columns) == 1]
    lost = [i for i in lost if [j // columns for j in lost].count(i // columns) == 1]
    domain = Domain.around(np.delete(zoom, lost), np.delete(focus, lost))
    assert domain.is_rectangle
    assert domain.area == pytest.approx(20 * 80)
    assert len(domain.outline) == 4
    assert str(domain) == "zoom 90 to 110 and focus 60 to 140"


def test_two_neighbours_lost_at_the_border_of_a_grid_are_still_surrounded():
    zoom, focus = grid(7, 5)
    assert Domain.around(np.delete(zoom, [2, 3]), np.delete(focus, [2, 3])).is_rectangle


def test_a_lost_corner_is_not_supported():
    zoom, focus = grid()
    domain = Domain.around(zoom[1:], focus[1:])
    assert domain.area == pytest.approx(20 * 80 - (20 / 6) * 20 / 2)
    assert not domain.contains(90.0, 60.0)


def test_zoom_only_and_focus_only_are_segments():
    along = Domain.around(np.linspace(90, 110, 5), np.full(5, 80.0))
    assert along.outline.tolist() == [[90, 80], [110, 80]]
    assert along.area == 0
    assert along.contains([90, 97.3, 110], 80.0).all()
    assert along.contains(110 + 1e-9, 80 + 1e-9)
    assert not along.contains([89.9, 95, 95, np.nan], [80.0, 80.1, 79.9, 80.0]).any()
    across = Domain.around(np.full(5, 95.0), np.linspace(60, 140, 5))
    assert across.contains(95.0, [60, 71, 140]).all()
    assert not across.contains([95.1, 95.0], [80.0, 140.1]).any()
    assert str(across) == "zoom 95 to 95 and focus 60 to 140"


def test_a_diagonal_line_and_a_single_setting():
    diagonal = Domain.around(np.array([0.0, 1.0, 3.0]), np.array([0.0, 20.0, 60.0]))
    assert diagonal.contains([0.0, 0.5, 3.0], [0.0, 10.0, 60.0]).all()
    assert not diagonal.contains([0.5, 3.1], [11.0, 62.0]).any()
    single = Domain.around(np.array([98.0]), np.array([131.0]))
    assert single.contains([98.0, 98.1], 131.0).tolist() == [True, False]
    assert [axis.shape for axis in single.grid()] == [(1, 1), (1, 1)]


def test_scattered_settings_lose_wide_bays_but_keep_their_shape():
    rng = np.random.default_rng(1)
    angle, radius = rng.uniform(0, np.pi, 300), rng.uniform(0.6, 1, 300)
    domain = Domain.around(radius * np.cos(angle), 50 * radius * np.sin(angle))
    true = np.pi / 2 * (1 - 0.36) * 50
    assert 0.8 * true < domain.area < 1.02 * true
    assert not domain.contains(0.0, 5.0)
    square = Domain.around(*rng.random((2, 200)))
    assert 0.85 < square.area < 1


@settings(deadline=None, max_examples=80)
@given(
    arrays(
        np.float64,
        st.tuples(st.integers(1, 60), st.just(2)),
        elements=st.one_of(st.integers(0, 12).map(float), st.floats(0, 12, width=16)),
    )
)
def test_every_sample_is_supported_and_nothing_beyond_their_hull(points):
    domain = Domain.around(*points.T)
    assert domain.contains(*points.T).all()
    assert domain.zoom == (points[:, 0].min(), points[:, 0].max())
    assert domain.focus == (points[:, 1].min(), points[:, 1].max())
    assert domain.area <= np.ptp(points[:, 0]) * np.ptp(points[:, 1]) * (1 + 1e-9)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(4, 80))
def test_contains_agrees_with_the_polygon(seed, count):
    """An authority for points in polygons, away from the border."""
    rng = np.random.default_rng(seed)
    domain = Domain.around(*(rng.random((2, count)) * [[3227], [8390]]))
    zoom, focus = rng.uniform(-0.05, 1.05, (2, 2000)) * [[3227], [8390]]
    ring = np.concatenate([domain.outline, domain.outline[:1]])
    expected = MatplotlibPath(ring).contains_points(np.stack([zoom, focus], axis=-1))
    np.testing.assert_array_equal(domain.contains(zoom, focus), expected)
    assert domain.area == pytest.approx(area_of(ring))


def area_of(ring):
    """By triangles about the first corner."""
    a, b = ring[1:-1] - ring[0], ring[2:] - ring[0]
    return abs((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) / 2


def test_the_border_belongs_to_the_domain_to_rounding():
    for domain in (
        Domain.around(*strip()),
        Domain.around(*np.random.default_rng(2).random((2, 90))),
    ):
        share = np.linspace(0, 1, 41)[:, None, None]
        along = domain.outline + share * (np.roll(domain.outline, -1, axis=0) - domain.outline)
        zoom, focus = along.reshape(-1, 2).T
        assert domain.contains(zoom, focus).all()
        # A quadrilateral about each point of the border reaches outside on some side.
        span = np.ptp(domain.outline, axis=0)
        around = [
            domain.contains(zoom + 1e-6 * i * span[0], focus + 1e-6 * j * span[1])
            for i, j in ((-1, 0), (1, 0), (0, -1), (0, 1))
        ]
        assert (~np.all(around, axis=0)).all()


def test_a_step_in_the_border_belongs_to_the_domain():
    outline = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 3], [0, 3]], dtype=float)
    domain = Domain(outline)
    assert domain.contains(1.0, [0.5, 1.0, 2.0, 3.0]).all()
    assert not domain.contains([1.1, 1.0], [1.5, 3.1]).any()
    assert domain.area == pytest.approx(4)
