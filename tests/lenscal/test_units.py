import pytest

from lenscal.errors import UnitError
from lenscal.units import parse_length_mm, unit_in_mm


@pytest.mark.parametrize(
    ("text", "millimetres"),
    [("25mm", 25.0), ("1 in", 25.4), ("0.01in", 0.254), ("23um", 0.023), ("1e-1 m", 100.0)],
)
def test_lengths_with_units(text, millimetres):
    assert parse_length_mm(text) == pytest.approx(millimetres, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("25", "the length '25' has no unit; write one of um"),
        ("25 parsec", "unknown unit of length 'parsec'; known are um"),
        ("long", "cannot read 'long' as a length"),
        ("", "cannot read '' as a length"),
        ("1,5 mm", "cannot read '1,5 mm' as a length"),
    ],
)
def test_lengths_that_cannot_be_read(text, message):
    with pytest.raises(UnitError, match=message):
        parse_length_mm(text)


def test_an_inch():
    assert unit_in_mm("in") == 25.4
