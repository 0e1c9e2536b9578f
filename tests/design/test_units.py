import math
import pickle
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.design import dumps, load, loads, preset_names
from roslf_design.design.files import preset_path
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


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_written_again_has_the_numbers_and_units_that_were_typed(name):
    def values(text):
        parts = tomllib.loads(text).items()
        return {(part, key): v for part, keys in parts if isinstance(keys, dict) for key, v in keys.items()}

    typed, design = values(preset_path(name).read_text()), load(name)
    for again in (design, loads(dumps(design)), pickle.loads(pickle.dumps(design)), design.replace({"name": "x"})):
        written = values(dumps(again))
        assert {key: typed[key] for key in written} == written


def test_files_for_people_are_rounded_and_others_keep_every_bit():
    design = load("paper").replace({"aperture.diameter": 2.9000000000000004, "microlens_array.pitch": 0.1 * 0.63})
    assert 'diameter = "2.9000000000000004 mm"' in dumps(design)
    assert loads(dumps(design)) == design
    assert 'diameter = "2.9 mm"' in dumps(design, 12)
    assert 'pitch = "63 um"' in dumps(design, 12)
    assert format_quantity(1.23456789e-3, "length", 3) == "1.23 um"
    assert format_quantity(1234567.0, "length", 3) == "1230000 mm"
