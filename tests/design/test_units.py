import math
import pickle
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from roslf_design.design import dumps, load, loads, preset_names
from roslf_design.design.files import preset_path
from roslf_design.units import Angle, AnyLength, Length, format_quantity, parse_quantity

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
        ("120 mn", "did you mean 'nm' or 'mm'"),
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


def test_an_angle_without_a_unit_is_offered_degrees():
    for angle in ("45", 45):
        with pytest.raises(ValueError, match=r'45"? has no unit; write .* "45 deg"'):
            parse_quantity(angle, "angle")


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


@pytest.mark.parametrize("text", ["1e9999999 mm", "-1e9999999 m", "1" * 5000 + " mm", "1e999999999999999999999 um"])
def test_numbers_that_no_float_holds_are_refused(text):
    with pytest.raises(ValueError, match="not a finite number"):
        parse_quantity(text, "length")


@pytest.mark.parametrize("text", ["1e-9999999 mm", "0." + "0" * 5000 + "1 m", "1e-999999999999999999999 um"])
def test_numbers_too_small_for_a_float_are_nothing(text):
    assert parse_quantity(text, "length") == 0


@pytest.mark.parametrize(
    ("kind", "value", "said"),
    [
        (Length, "1e16 mm", "beyond 1e+15 mm"),
        (AnyLength, -1e16, "beyond 1e+15 mm"),
        (Length, "1e-13 mm", "less than 0.000001 nm"),
        (Length, "1e-9999999 mm", "greater than 0"),
        (Angle, "1e6 rad", "beyond 1000000 mrad"),
    ],
)
def test_what_no_camera_has_is_refused(kind, value, said):
    reader = TypeAdapter(kind)
    with pytest.raises(ValidationError, match=said.replace("+", r"\+")):
        reader.validate_python(value)


@pytest.mark.parametrize(
    ("kind", "value", "kept"),
    [
        (Length, "1e12 m", 1e15),
        (Length, "1e-6 nm", 1e-12),
        (AnyLength, "1e-300 mm", 1e-300),
        (Angle, "-360 deg", -2 * math.pi),
    ],
)
def test_what_a_camera_may_have_is_kept(kind, value, kept):
    assert TypeAdapter(kind).validate_python(value) == kept


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


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("58 micron", "'um'"),
        ("58 micrometres", "'um'"),
        ("60 mn", "'nm' or 'mm'"),
        ("2 inches", "'in'"),
        ("3 milimeter", ""),
    ],
)
def test_units_in_full_and_units_one_letter_off_are_understood(text, meant):
    with pytest.raises(ValueError, match=f"did you mean {meant}" if meant else "is not a known unit"):
        parse_quantity(text, "length")
