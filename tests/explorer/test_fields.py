"""Numbers as the page shows them: text and sliders, there and back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.design import load
from roslf_design.explorer.state import BY_SYMBOL, FIELDS, STEPS, position, reach, read, show, value_at

PAPER = load("paper")
lengths = st.floats(1e-6, 1e4)
fields = st.sampled_from(FIELDS)


@given(fields, lengths)
def test_what_is_shown_is_read_back_to_seven_digits(field, value):
    # Seven digits shown: half a unit of the seventh.
    assert read(field, show(field, value)) == pytest.approx(value, rel=5.1e-7)


@pytest.mark.parametrize(
    ("symbol", "text", "value"),
    [
        ("D_F", "2.9 mm", 2.9),
        ("D_F", "63 um", 0.063),
        ("d", "63 um", 0.063),
        ("d", "0.063 mm", 0.063),
        ("d", "63", 0.063),
        ("D_F", "2,9 mm", 2.9),
        ("D_F", " 2.9mm ", 2.9),
        ("wavelength", "550", 550e-6),
        ("d_3", "12 cm", 120.0),
    ],
)
def test_lengths_are_read_in_any_unit_and_a_bare_number_in_the_fields_own(symbol, text, value):
    assert read(BY_SYMBOL[symbol], text) == value


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", 'write e.g. "2.9 mm"'),
        ("abc", "cannot read"),
        ("3 furlong", "not a known unit of length"),
        ("3 mrad", "is a unit of angle"),
        ("nan", "cannot read"),
        ("1e999", "not a finite number"),
    ],
)
def test_what_is_no_length_is_told_with_a_remedy(text, told):
    with pytest.raises(ValueError, match=told):
        read(BY_SYMBOL["D_F"], text)


@given(fields, st.integers(0, STEPS), st.floats(0.3, 3.0))
def test_a_slider_stands_where_it_was_put(field, place, scale):
    design = PAPER.replace(D_F=2.9 * scale, D=50.8 * scale)
    ends = reach(field, PAPER, design)
    value = value_at(field, place, ends)
    assert ends[0] <= value <= ends[1]
    assert position(field, value, ends) == place


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field.symbol)
def test_ends_of_a_slider_are_met_exactly_and_hold_the_present_value(field):
    ends = reach(field, PAPER, PAPER)
    assert (value_at(field, 0, ends), value_at(field, STEPS, ends)) == ends
    assert ends[0] <= getattr(PAPER, field.symbol) <= ends[1]
    assert ends[0] < ends[1]


@given(fields, st.floats(0, STEPS), st.floats(0, STEPS))
def test_a_slider_runs_one_way(field, a, b):
    ends = reach(field, PAPER, PAPER)
    low, high = sorted((a, b))
    assert value_at(field, low, ends) <= value_at(field, high, ends)


def test_a_slider_reaches_a_value_typed_beyond_it():
    wide = PAPER.replace(D_F=40.0)
    assert reach(BY_SYMBOL["D_F"], PAPER, wide)[1] == 40.0
    assert position(BY_SYMBOL["D_F"], 40.0, reach(BY_SYMBOL["D_F"], PAPER, wide)) == STEPS


def test_every_reachable_pupil_distance_lies_before_the_object():
    assert value_at(BY_SYMBOL["d_3"], STEPS, reach(BY_SYMBOL["d_3"], PAPER, PAPER)) < PAPER.d_f
    assert value_at(BY_SYMBOL["d_3"], 0, reach(BY_SYMBOL["d_3"], PAPER, PAPER)) == 0
