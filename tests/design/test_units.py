import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.units import format_quantity, parse_quantity

finite = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)


@pytest.mark.parametrize(
    ("text", "millimetres"),
    [
        ("120 mm", 120.0),
        ("63 um", 0.063),
        ("63um", 0.063),
        ("63 µm", 0.063),
        ("550 nm", 550e-6),
        ("0.4 m", 400.0),
        ("2 in", 50.8),
        ("-1.5e1 cm", -150.0),
        (" 4.847826 um ", 0.004847826),
    ],
)
def test_lengths_are_the_nearest_float_to_the_decimal(text, millimetres):
    assert parse_quantity(text, "length") == millimetres


@pytest.mark.parametrize(("text", "radians"), [("2 mrad", 0.002), ("180 deg", math.pi), ("90 °", math.pi / 2)])
def test_angles(text, radians):
    assert parse_quantity(text, "angle") == radians


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (120, "has no unit; write it as text"),
        ("120", 'write e.g. "120 mm"'),
        ("120 mn", "did you mean 'm"),
        ("3 mrad", "is a unit of angle"),
        ("abc", "cannot read"),
        ("1e999 mm", "not a finite"),
        (True, "expected a length"),
        (None, "expected a length"),
        ("", "cannot read"),
        ("1 2 mm", "cannot read"),
    ],
)
def test_what_cannot_be_read_says_why(text, said):
    with pytest.raises(ValueError, match=said):
        parse_quantity(text, "length")


def test_bare_numbers_are_millimetres_only_in_python():
    assert parse_quantity(0, "length") == parse_quantity(-0.0, "angle") == 0.0  # the same in every unit
    assert parse_quantity(120, "length", unit_required=False) == 120.0
    with pytest.raises(ValueError, match="not a finite"):
        parse_quantity(math.nan, "length", unit_required=False)


@given(finite, st.sampled_from(["length", "angle"]))
def test_writing_and_reading_keeps_every_bit(value, dimension):
    assert parse_quantity(format_quantity(value, dimension), dimension) == value


@pytest.mark.parametrize(
    ("value", "text"), [(50.8, "50.8 mm"), (0.063, "63 um"), (550e-6, "550 nm"), (0.0, "0 mm"), (1e20, "1e+20 mm")]
)
def test_lengths_read_well(value, text):
    assert format_quantity(value, "length") == text
