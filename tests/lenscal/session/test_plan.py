import numpy as np
import pytest

from lenscal.errors import FileError, InputError
from lenscal.session.plan import AutofocusPlan, SessionPlan

TEXT = """
zoom = [90, 98.5]
focus = [60, 100, 140]

[autofocus]
nearest = "362 mm"
farthest = "38.6 cm"
step = "1.5 mm"
iris = 100

[views]
tilted = 4
tilt_deg = 25
iris = 20
"""


def load(tmp_path, text):
    (tmp_path / "plan.toml").write_text(text)
    return SessionPlan.load(tmp_path / "plan.toml")


@pytest.fixture
def plan(tmp_path):
    return load(tmp_path, TEXT)


def test_every_zoom_meets_every_focus(plan):
    settings = plan.settings()
    assert len(settings) == 6
    assert [s.focus for s in settings[:3]] == [60, 100, 140]


def test_the_sweep_visits_both_ends_evenly_in_vergence(plan):
    standoffs = np.array(plan.autofocus.standoffs_mm())
    assert (standoffs[0], standoffs[-1]) == (362.0, 386.0)
    np.testing.assert_allclose(np.diff(1 / standoffs, n=2), 0, atol=1e-15)
    assert 1.3 < standoffs[1] - standoffs[0] <= 1.5


def test_a_long_sweep_takes_longer_steps_farther_away():
    plan = AutofocusPlan(nearest="0.3 m", farthest="2.5 m", step="10 mm", iris=75)
    standoffs = plan.standoffs_mm()
    assert len(standoffs) == 29
    assert standoffs[1] - standoffs[0] == pytest.approx(10, rel=0.05)
    assert standoffs[-1] - standoffs[-2] > 400


def test_what_a_search_assumes_unless_told(plan):
    search = plan.autofocus
    assert (search.measure, search.extensions, search.repeatability) == ("edge_width", 2, 0.02)


def test_the_first_view_is_untilted_and_the_others_tilt_about_axes_across_the_optical_axis(plan):
    first, *tilted = plan.views.tilts()
    assert np.array_equal(first.rotation, np.eye(3))
    vectors = np.array([t.rotation_vector for t in tilted])
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), np.deg2rad(25))
    np.testing.assert_allclose(vectors[:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(vectors.sum(axis=0), 0, atol=1e-12)


def test_displaced_views_come_between_the_focus_view_and_the_tilted_ones(tmp_path):
    text = TEXT.replace("tilted = 4", 'tilted = 4\ndisplacements = ["-3 mm", "0.15 cm"]')
    plan = load(tmp_path, text)
    assert plan.views.displacements == (-3.0, 1.5)
    placements = plan.views.placements()
    assert [p.displacement_mm for p in placements] == [0, -3, 1.5, 0, 0, 0, 0]
    angles = [np.linalg.norm(p.turn.rotation_vector) for p in placements]
    np.testing.assert_allclose(np.rad2deg(angles), [0, 0, 0, 25, 25, 25, 25], atol=1e-9)
    assert SessionPlan.model_validate(plan.model_dump(mode="json")) == plan


def test_a_plan_displaces_nothing_unless_told(plan):
    assert plan.views.displacements == ()
    assert [p.turn.rotation.tolist() for p in plan.views.placements()] == [
        turn.rotation.tolist() for turn in plan.views.tilts()
    ]


def test_a_plan_round_trips_through_what_a_recording_keeps_of_it(plan):
    kept = plan.model_dump(mode="json")
    assert kept["autofocus"]["nearest"] == "362.0 mm"
    assert SessionPlan.model_validate(kept) == plan


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"362 mm"', "362", "autofocus.nearest: .*a length needs its unit, such as '362 mm'"),
        ('"362 mm"', '"362"', "the length '362' has no unit"),
        ('"362 mm"', '"385 mm"', "needs at least four .*steps, but one is 1.5 mm"),
        ("tilted = 4", "tiltted = 4", "views.tiltted: Extra inputs are not permitted"),
        (
            "tilt_deg = 25",
            "tilt_deg = 80",
            "views.tilt_deg: Input should be less than or equal to 60",
        ),
        ("zoom = [90, 98.5]", "zoom = []", "zoom: Tuple should have at least 1 item"),
        ("zoom = [90, 98.5]", "zoom = [90, 90]", "zoom names a setting twice: 90, 90"),
        ("iris = 20", "", "views.iris: Field required"),
        (
            "tilted = 4",
            'displacements = ["3 mm", "0 mm"]',
            "views.displacements: a displacement of zero repeats the focus view.*: 3 mm, 0 mm",
        ),
        (
            "tilted = 4",
            'displacements = ["3 mm", "0.3 cm"]',
            "views.displacements: a displacement stands twice: 3 mm, 3 mm",
        ),
        ("tilted = 4", "displacements = [3]", "a length needs its unit, such as '3 mm'"),
        (
            "tilted = 4",
            'displacements = ["-362 mm"]',
            "a displacement of -362 mm from the nearest standoff of the search, 362 mm, brings "
            "the camera to the target or behind it; displace it by less",
        ),
        ("iris = 100", 'iris = 100\nmeasure = "wow"', "autofocus.measure: Input should be 'edge_w"),
    ],
)
def test_what_a_plan_may_not_say(tmp_path, old, new, message):
    with pytest.raises(InputError, match=f"the plan .*plan.toml cannot be used: .*{message}"):
        load(tmp_path, TEXT.replace(old, new))


def test_files_that_are_no_plan(tmp_path):
    with pytest.raises(FileError, match=r"cannot read the plan .*none\.toml: No such file"):
        SessionPlan.load(tmp_path / "none.toml")
    with pytest.raises(FileError, match=r"plan\.toml is no TOML"):
        load(tmp_path, "zoom = [")
