import pytest

from lenscal.errors import InputError, OutOfRangeError
from lenscal.setting import LensSetting, LensTravel

TRAVEL = LensTravel(zoom=(45.0, 110.0), focus=(0.0, 140.0), iris=(5.0, 100.0))


def test_both_ends_of_the_travel_are_allowed():
    TRAVEL.check(LensSetting(45.0, 140.0, 5.0))
    TRAVEL.check(LensSetting(110.0, 0.0))


@pytest.mark.parametrize(
    ("setting", "name"),
    [
        (LensSetting(44.9, 0.0), "zoom 44.9"),
        (LensSetting(50.0, 140.1), "focus 140.1"),
        (LensSetting(50.0, 0.0, 101.0), "iris 101"),
    ],
)
def test_a_setting_beyond_the_travel_is_refused_and_never_clipped(setting, name):
    with pytest.raises(
        OutOfRangeError, match=f"{name} lies outside the travel .* nothing was moved"
    ):
        TRAVEL.check(setting)


def test_the_error_carries_what_is_allowed():
    with pytest.raises(OutOfRangeError) as caught:
        TRAVEL.check(LensSetting(200.0, 0.0))
    assert (caught.value.given, caught.value.allowed) == (200.0, (45.0, 110.0))


def test_settings_and_travels_must_be_finite():
    with pytest.raises(InputError, match="focus must be a finite controller value, but is nan"):
        LensSetting(1.0, float("nan"))
    with pytest.raises(InputError, match="the travel of zoom must run from low to high"):
        LensTravel((5.0, 5.0), (0.0, 1.0), (0.0, 1.0))


def test_a_setting_reads_like_one():
    assert str(LensSetting(98, 131).with_iris(20)) == "zoom 98, focus 131, iris 20"
