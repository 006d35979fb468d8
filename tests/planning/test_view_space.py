"""Views as points of a space: sharp wherever they are, and never beyond what the map supports."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lenscal.maps.domain import Domain
from lenscal.maps.lens_map import LensMap
from planning.enclosure import example_part
from planning.fixed_lens import FixedLens
from planning.setting_space import FixedSettings, MapSettings
from planning.view_space import GeneralStarts, OrthogonalStarts, sharp_positions
from planning.viewpoints import Ring
from planning.views import Subject


@pytest.fixture(scope="module")
def lens_map(request) -> LensMap:
    return LensMap.load(request.config.rootpath / "data" / "vicon-1990" / "map.json")


@pytest.fixture(scope="module")
def subject() -> Subject:
    part = example_part()
    return Subject(part.target, None, part.scene)


@given(st.integers(0, 10**6))
def test_nearest_and_farthest_corner_are_blurred_alike(seed: int) -> None:
    part = example_part()
    subject = Subject(part.target)
    rng = np.random.default_rng(seed)
    turns = Rotation.random(5, rng=rng).as_matrix()
    aims, distance = rng.uniform(-0.1, 0.1, (5, 2)), rng.uniform(200, 900, 5)
    defocus = rng.uniform(-0.2, 0.2, 5)
    places = sharp_positions(subject, turns, aims, distance, defocus)
    depths = np.einsum("nkj,nj->nk", part.target.vertices_mm - places[:, None], turns[..., 2])
    middle = (1 / depths.min(axis=1) + 1 / depths.max(axis=1)) / 2
    np.testing.assert_allclose(middle, (1 - defocus) / distance)
    seen = np.einsum("nij,ni->nj", turns, part.target.centroid_mm - places)
    np.testing.assert_allclose(seen[:, :2] / seen[:, 2:], aims, atol=1e-12)


def test_no_move_changes_nothing_and_moves_go_from_each_start(lens_map, subject) -> None:
    rng = np.random.default_rng(1)
    starts = GeneralStarts(
        subject,
        MapSettings(lens_map),
        rng.uniform(0, 1, (3, 2)),
        Rotation.random(3, rng=rng).as_matrix(),
        rng.uniform(-0.1, 0.1, (3, 2)),
        np.zeros(3),
        True,
    )
    assert starts.size == 8
    same = starts.moved(np.zeros((3, 1, 8)))
    np.testing.assert_allclose(same.rotations, starts.rotations)
    np.testing.assert_allclose(same.shares, starts.shares)
    turned = starts.moved(np.tile([0, 0, 0, 0, 0.3, 0, 0, 0], (3, 2, 1)))
    assert len(turned) == 6
    # A turn about the optical axis keeps it.
    np.testing.assert_allclose(turned.rotations[::2, :, 2], starts.rotations[:, :, 2])
    pushed = starts.moved(np.tile([9.0, -9.0, 0, 0, 0, 0, 0, 0], (3, 1, 1)))
    np.testing.assert_array_equal(pushed.shares, [[1, 0]] * 3)
    states = pushed.as_views()[0].states
    np.testing.assert_allclose(states.zoom, lens_map.domain.zoom[1])
    np.testing.assert_allclose(states.focus, lens_map.domain.focus[0])
    low, high = starts.limits
    np.testing.assert_allclose(low[:, :2], -starts.shares)
    np.testing.assert_allclose(high[:, :2], 1 - starts.shares)
    assert np.isinf(low[:, 2:]).all()


def test_orthogonal_views_look_at_the_middle(lens_map, subject) -> None:
    part = example_part()
    ring = Ring.about(part.feature, part.target)
    starts = OrthogonalStarts(
        subject, MapSettings(lens_map), np.full((2, 2), 0.5), np.array([0.2, -0.4]), ring, "x"
    )
    assert starts.size == 3
    views, valid = starts.moved(np.tile([0.1, 0.2, 0.3], (2, 1, 1))).as_views()
    assert valid.all()
    away = part.feature.centroid_mm - views.positions_mm[0]
    distance = views.states.object_distance_mm[:, None]
    np.testing.assert_allclose(away, distance * views.rotations[0, :, :, 2])
    face = OrthogonalStarts(
        subject,
        MapSettings(lens_map),
        np.full((1, 2), 0.5),
        np.zeros(1),
        Ring.about(part.target, part.target),
        "any",
    )
    assert face.size == 2, "a face is seen along its normal only"


@dataclass(frozen=True)
class LensOn:
    """The lens map of another domain."""

    lens: LensMap
    domain: Domain

    def __getattr__(self, name):
        return getattr(self.lens, name)


def test_a_curved_strip_is_followed(lens_map, monkeypatch) -> None:
    """Shares run along the strip, not over the rectangle that bounds it."""
    zoom = np.linspace(92, 109, 9)
    low = 70 + 2 * (zoom - 92)
    outline = np.concatenate(
        [np.column_stack([zoom, low]), np.column_stack([zoom, low + 20])[::-1]]
    )
    strip = Domain(outline)
    asked = []
    monkeypatch.setattr(
        "planning.setting_space.LensStates",
        SimpleNamespace(of_map=lambda lens, z, f, iris: asked.append((z, f)) or _All(len(z))),
    )
    shares = np.random.default_rng(0).uniform(0, 1, (200, 2))
    _, valid = MapSettings(LensOn(lens_map, strip)).states(shares)
    assert valid.all()
    z, f = asked[0]
    assert strip.contains(z, f).all()
    order = np.lexsort((shares[:, 1], shares[:, 0]))
    np.testing.assert_allclose(f - (70 + 2 * (z - 92)), 20 * shares[order, 1], atol=1e-6)


@dataclass(frozen=True)
class _All:
    """States that nobody looks into."""

    count: int

    def some(self, which):
        return self


def test_settings_on_lines_take_one_number(lens_map) -> None:
    slanted = Domain(np.array([[92.0, 70.0], [109.0, 120.0]]))
    zoom_only = Domain(np.array([[92.0, 70.0], [109.0, 70.0]]))
    single = Domain(np.array([[100.0, 70.0]]))
    for domain, size in ((slanted, 1), (zoom_only, 1), (single, 0)):
        space = MapSettings(LensOn(lens_map, domain))
        assert space.size == size
    space = MapSettings(LensOn(lens_map, slanted))
    np.testing.assert_allclose(space._focus_span(np.array([92.0, 100.5])), [[70, 95], [70, 95]])


def test_a_bay_of_the_domain_is_not_entered(lens_map) -> None:
    """Where the outline turns back, settings between its parts are told to be invalid."""
    outline = np.array([[92.0, 70], [109, 70], [109, 80], [96, 80], [96, 100], [109, 100],
                        [109, 110], [92, 110]])  # fmt: skip
    space = MapSettings(LensOn(lens_map, Domain(outline)))
    states, valid = space.states(np.array([[0.9, 0.5], [0.9, 0.1], [0.1, 0.5]]))
    np.testing.assert_array_equal(valid, [False, True, True])
    assert len(states) == 3


def test_a_fixed_lens_is_focused_between_its_bounds(paper_sensor) -> None:
    space = FixedSettings(FixedLens(50.0, paper_sensor), 200.0, 800.0)
    states, valid = space.states(np.array([[0.0], [1.0], [0.5], [0.5]]))
    assert valid.all()
    np.testing.assert_allclose(states.object_distance_mm, [800, 200, 320, 320])
    far = FixedSettings(FixedLens(50.0, paper_sensor), 50.0, np.inf)
    distance = far.states(np.array([[0.0], [1.0]]))[0].object_distance_mm
    np.testing.assert_allclose(distance, [50_000, 50.05])
