"""What can be done to a state, without any browser: its numbers and history; links bring it back, bad ones say so."""

import base64
import json
import os
import pickle
import time
import zlib
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.design import DesignError, dumps, load, preset_names
from roslf_design.evaluation import evaluate
from roslf_design.explorer.forms import _offered
from roslf_design.explorer.state import (
    BY_SYMBOL,
    CONJUGATE,
    DEPTH,
    FIELDS,
    LIMIT,
    STEPS,
    TABS,
    WHOLE,
    History,
    LinkError,
    Look,
    State,
    decode,
    encode,
    position,
    reach,
    read,
    show,
    value_at,
)
from roslf_design.explorer.view import controls, warmth
from tests.laws import LETTERS

PAPER = load("paper")
START = State.of(PAPER)
SINGLET = load("paper-singlet")

# Numbers: text and sliders, there and back.

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


# The design.


def test_short_lengths_are_shown_and_typed_in_micrometres():
    state = START.edit("f_ml", "35.7 um")
    assert show(BY_SYMBOL["f_ml"], state.design.f_ml) == "35.7 um"
    assert state.edit("f_ml", "40").design.f_ml == pytest.approx(0.04)
    assert START.edit("f_ml", "3").design.f_ml == pytest.approx(3.0)


def test_a_good_number_makes_a_new_design_and_leaves_the_old_state():
    before = START
    after = before.edit("D_F", "3.5 mm")
    assert (before.design.D_F, after.design.D_F) == (2.9, 3.5)
    assert after.faults == ()
    assert after.reference == PAPER


@pytest.mark.parametrize(
    ("symbol", "text", "told"),
    [
        ("D_F", "abc", "cannot read"),
        ("D_F", "-1 mm", "greater than zero"),
        ("D_F", "0 mm", "greater than zero"),
        ("d_3", "400 mm", "not less than the focal-plane distance"),
        ("d_1", "90 mm", "not beyond the focal length"),
        ("wavelength", "5 deg", "unit of angle"),
    ],
)
def test_a_bad_number_is_told_beside_its_field_and_the_last_good_design_stays(symbol, text, told):
    state = START.edit(symbol, text)
    assert state.design == PAPER
    assert state.fault(symbol).text == text
    assert told in state.fault(symbol).message
    assert [fault.symbol for fault in state.faults] == [symbol]


def test_a_good_number_takes_the_fault_of_its_field_away():
    state = START.edit("D_F", "abc").edit("D_F", "3 mm")
    assert state.faults == ()


def test_two_numbers_that_are_wrong_one_at_a_time_may_be_right_at_once():
    waiting = START.edit("d_3", "400 mm")
    assert waiting.design.d_3 == 120
    both = waiting.follow("d_1").edit("d_f", "500 mm")
    assert (both.design.d_3, both.design.d_f, both.faults) == (400, 500, ())


def test_a_fault_stays_while_another_field_is_changed():
    state = START.edit("d_3", "400 mm").edit("D", "60 mm")
    assert state.design.D == 60
    assert state.fault("d_3") is not None


@pytest.mark.parametrize("follower", CONJUGATE)
@pytest.mark.parametrize("changed", CONJUGATE)
def test_of_f_d_1_d_f_the_chosen_one_follows_and_the_others_stay(follower, changed):
    state = START.follow(follower)
    assert state.design == PAPER
    if changed == follower:
        assert not state.changeable(changed)
        assert state.edit(changed, "200 mm") == state
        return
    after = state.edit(changed, f"{1.05 * getattr(PAPER, changed)!r} mm")
    assert after.faults == ()
    [kept] = {*CONJUGATE} - {follower, changed}
    assert getattr(after.design, kept) == pytest.approx(getattr(PAPER, kept), rel=1e-14)
    f, d_1, d_f = (getattr(after.design, symbol) for symbol in CONJUGATE)
    assert 1 / f == pytest.approx(1 / d_1 + 1 / d_f, rel=1e-12)  # The lens equation, to a few ulp.
    assert getattr(after.design, follower) != getattr(PAPER, follower)


def test_behind_a_real_lens_its_focal_length_is_its_own():
    state = State.of(SINGLET)
    assert state.followers == ("d_1", "d_f")
    assert not state.changeable("f")
    assert state.edit("f", "120 mm") == state
    assert state.follow("f") == state
    moved = state.follow("d_f").edit("d_1", "150 mm")
    assert moved.design.d_1 == 150
    assert moved.design.f == SINGLET.f


def test_several_numbers_change_all_or_none():
    state = START.edit("D_F", "abc")
    assert state.change({"d_3": 100.0, "D_F": 3.0}).faults == ()
    with pytest.raises(DesignError):
        state.change({"d_3": 100.0, "D_F": -3.0})


def test_states_are_values():
    state = START.edit("d_3", "400 mm")
    assert pickle.loads(pickle.dumps(state)) == state
    assert hash(state) == hash(START.edit("d_3", "400 mm"))
    with pytest.raises(AttributeError):
        state.design = SINGLET


moves = st.lists(
    st.tuples(st.sampled_from(["D", "D_F", "d", "d_2", "q", "f_ml"]), st.floats(0.01, 50), st.sampled_from("ab ")),
    max_size=12,
)


@given(moves, st.integers(0, 12))
def test_undo_and_redo_are_each_others_inverse(changes, back):
    history = History(START)
    for symbol, value, gesture in changes:
        history = history.record(history.present.set(symbol, value), gesture.strip())
    end = history
    taken = 0
    while taken < back and history.past:
        history, taken = history.undo(), taken + 1
    for _ in range(taken):
        history = history.redo()
    assert history.present.design == end.present.design
    assert [state.design for state in history.past] == [state.design for state in end.past]


def test_one_move_of_a_slider_is_one_step():
    history = History(START)
    for value in (3.0, 3.1, 3.2):
        history = history.record(history.present.set("D_F", value), "D_F:1")
    history = history.record(history.present.set("D_F", 4.0), "D_F:2")
    assert len(history.past) == 2
    assert history.undo().present.design.D_F == 3.2
    assert history.undo().undo().present.design == PAPER
    assert history.undo().undo().undo().present.design == PAPER


def test_a_new_change_ends_what_could_be_redone():
    history = History(START).record(START.edit("D_F", "3 mm"))
    history = history.undo().record(START.edit("D_F", "4 mm"))
    assert history.future == ()
    assert history.redo() == history


def test_what_was_wrong_is_no_step_and_does_not_come_back():
    history = History(START).record(START.edit("D_F", "abc"))
    assert history.past == ()
    history = history.record(history.present.set("D", 60.0))
    assert history.undo().present.faults == ()


def test_history_is_bounded():
    history = History(START)
    for step in range(DEPTH + 20):
        history = history.record(history.present.set("D", 50.0 + step))
    assert len(history.past) == DEPTH


places = st.sampled_from(["centre", "edge", "corner"]) | st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
looks = st.builds(Look, st.sampled_from(list(TABS)), places, st.booleans(), st.booleans(), st.sampled_from(list(WHOLE)))


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_comes_back_from_its_link(name):
    state = State.of(load(name))
    back, look = decode(encode(state, Look()))
    assert (back, look) == (state, Look())


@given(looks, st.floats(0.1, 20), st.sampled_from(["f", "d_1", "d_f"]))
def test_a_link_brings_back_design_reference_follower_and_look(look, diameter, follower):
    state = START.edit("D_F", f"{diameter!r} mm").follow(follower)
    text = encode(state, look)
    assert decode(text) == (state, look)
    assert text.isascii()
    assert set(text) <= set("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_")


GOOD = encode(START, Look())


def test_a_link_is_short_enough_to_send():
    assert len(GOOD) < 1000


def link_of(text):
    return "1" + base64.urlsafe_b64encode(zlib.compress(text.encode(), 9)).decode().rstrip("=")


@given(st.integers(0, len(GOOD) - 1))
def test_a_link_cut_off_anywhere_is_refused(end):
    with pytest.raises(LinkError):
        decode(GOOD[:end])


@given(st.text(LETTERS, max_size=60) | st.text(alphabet="ABCabc123-_", max_size=60).map(lambda text: "1" + text))
def test_whatever_is_no_link_is_refused_in_one_way(text):
    with pytest.raises(LinkError):
        decode(text)


@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text(LETTERS, max_size=5), st.lists, max_leaves=8))
def test_links_with_other_content_are_refused(content):
    wrong = {"design": content, "follows": content, "look": content}
    with pytest.raises(LinkError):
        decode(link_of(json.dumps(wrong)))


def test_a_link_that_would_fill_the_memory_is_refused():
    bomb = link_of(" " * (20 * LIMIT))
    assert len(bomb) < 10_000
    with pytest.raises(LinkError):
        decode(bomb)


def test_a_link_names_lenses_that_ship_or_holds_them_and_opens_no_file(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    table = dumps(SINGLET.replace({"main_lens.prescription": replace(SINGLET.main_lens.prescription, name="mine")}))
    for text in (dumps(SINGLET), dumps(SINGLET).replace("LA1050-A", "la1050-a"), table):
        state, _ = decode(link_of(json.dumps({"design": text, "follows": "d_f", "look": {}})))
        assert state.design.lens == replace(SINGLET.lens, name=state.design.lens.name)
    for file in (tmp_path / "pipe.toml", "/dev/zero", "/etc/passwd", "lens.zmx", "../LA1050-A"):
        text = dumps(SINGLET).replace("LA1050-A", str(file))
        for content in ({"design": text}, {"design": dumps(PAPER), "reference": text}):
            with pytest.raises(LinkError, match=r"main_lens\.prescription: '.*' is no lens that ships .*table"):
                decode(link_of(json.dumps({"follows": "d_f", "look": {}} | content)))


@pytest.mark.parametrize("value", ['"' + 20_000 * "1" + ' x y"', 20_000 * "9", 20_000 * "["])
def test_a_link_that_is_long_to_read_is_refused_at_once(value):
    text = dumps(PAPER).replace('"2.9 mm"', value)
    began = time.perf_counter()
    with pytest.raises(LinkError):
        decode(link_of(json.dumps({"design": text, "follows": "d_f", "look": {}})))
    assert time.perf_counter() - began < 1.0  # a thousand digits took ten seconds, twice as many ninety


def test_a_link_with_more_stops_than_a_page_can_be_drawn_with_is_refused():
    text = dumps(PAPER) + '[[stops]]\ndiameter = "3 mm"\ndistance = "1 mm"\n' * 700
    with pytest.raises(LinkError, match="stops: has 700 entries, at most 50 can be used"):
        decode(link_of(json.dumps({"design": text, "follows": "d_f", "look": {}})))


def test_a_link_with_a_design_that_cannot_be_says_what_is_wrong():
    text = 'name = "x"\n[main_lens]\ndiameter = 3\n'
    content = {"design": text, "follows": "d_f", "look": {}}
    with pytest.raises(LinkError, match=r"main_lens.diameter: 3 has no unit"):
        decode(link_of(json.dumps(content)))


def test_a_window_and_a_liquid_come_change_and_go():
    """What follows follows: with f and d_1 kept, the plane in focus moves to n times its distance from the glass."""
    state = State.of(PAPER)
    assert not state.changeable("window_thickness")
    with_glass = state.choose("window", "yes")
    (window,) = with_glass.design.elements
    assert window.distance >= PAPER.d_3
    assert evaluate(with_glass.design).non_distortion.room_at_corner_mm > 0
    assert (with_glass.design.f, with_glass.design.d_1) == (PAPER.f, PAPER.d_1)
    wet = with_glass.choose("medium", "1.333")
    end = window.distance + window.thickness
    assert wet.design.d_f - end == pytest.approx(1.333 * (with_glass.design.d_f - end), rel=1e-12)
    thick = wet.edit("window_thickness", "2 mm").set("window_distance", 130.0).edit("window_diameter", "9")
    (window,) = thick.design.elements
    assert (window.thickness, window.distance, window.diameter) == (2.0, 130.0, 9.0)
    assert (thick.design.f, thick.design.d_1) == (PAPER.f, PAPER.d_1)
    assert thick.choose("window_material", "1.7").design.elements[0].material.coefficients == (1.7,)
    assert decode(encode(thick, Look()))[0].design == thick.design
    dry = thick.choose("window", "no")
    assert dry.design.elements == ()
    assert dry.design.object_space.medium.name == "air"
    assert dry.design.d_f == pytest.approx(PAPER.d_f, rel=1e-12)
    sealed = state.choose("medium", "1.333").design
    assert len(sealed.elements) == 1  # a liquid brings what seals it off
    history = History(state).record(with_glass).record(wet)
    assert history.undo().present.design == with_glass.design
    assert history.undo().undo().present.design == PAPER


def test_only_the_outermost_plate_is_the_window():
    lens = {"kind": "lens", "distance": 60.0, "focal_length": 500.0}
    design = PAPER.replace({"elements": (lens,)})
    state = State.of(design).choose("window", "yes")
    assert [element.kind for element in state.design.elements] == ["lens", "plate"]
    assert state.choose("window", "no").design.elements == design.elements


def test_the_objectives_mapping_is_chosen_by_name():
    lens = {"kind": "lens", "distance": 130.0, "focal_length": 500.0}
    state = State.of(PAPER.replace({"elements": (lens,)}))
    assert controls(State.of(PAPER))["bore"]["mapping"] == ""
    assert controls(state)["bore"]["mapping"] == "f tan"
    bent = state.choose("mapping", "f theta")
    assert controls(bent)["bore"]["mapping"] == "f theta"
    before, after = (evaluate(s.design).non_distortion.field_half_width_mm for s in (state, bent))
    assert after > before
    assert bent.choose("window", "yes").design.elements[1].diameter is None  # a rim there is refused
    wrong = state.choose("window", "yes").choose("mapping", "f sin")
    assert "would cut rays" in wrong.fault("mapping").message
    assert bent.choose("mapping", "f tan").design == state.design


@pytest.mark.parametrize(
    ("what", "text", "said"),
    [("medium", "watter", "not a known"), ("medium", "0.5", "from 1"), ("window_material", "N-BK8", "N-BK7")],
)
def test_a_material_that_is_none_is_told_beside_its_field(what, text, said):
    state = State.of(PAPER).choose("window", "yes")
    wrong = state.choose(what, text)
    assert said in wrong.fault(what).message
    assert wrong.design == state.design
    assert wrong.choose(what, "1.4").faults == ()
    inside = state.edit("window_distance", "119.9 mm")
    assert "lies inside" in inside.fault("window_distance").message


def test_a_real_lens_gets_a_window_and_what_is_refused_of_it_is_forgotten_without_one():
    glazed = State.of(SINGLET).choose("window", "yes")
    assert (len(glazed.design.elements), glazed.faults) == (1, ())
    refused = glazed.edit("window_distance", "119.9 mm")
    assert "lies inside" in refused.fault("window_distance").message
    assert refused.design == glazed.design
    without = refused.choose("window", "no")
    assert (without.design, without.faults) == (SINGLET, ())


def test_bounds_of_a_run_are_offered_in_four_digits():
    offered = _offered("d", State.of(PAPER.replace(d=0.01090009)))
    assert all(len(offered[side].split()[0].replace(".", "").lstrip("0")) <= 4 for side in ("low", "high"))


def test_fields_of_a_camera_used_warm_have_the_numbers_of_its_file():
    cold = {"housing": "stainless steel", "range": (15.0, 40.0)}
    warm = State.of(load("rigid-scope").replace({"environment": cold}).at_temperature(37.0))
    assert show(BY_SYMBOL["q"], warm.design.q) != "1.55 um"

    def told(state):
        return {f["symbol"]: f["text"] for group in controls(state)["groups"] for f in group["fields"]}

    assert (told(warm)["q"], told(warm)["d_f"], told(warm)["D_F"]) == ("1.55 um", "25 mm", "0.3 mm")
    typed = warm.edit("q", "1.6 um").choose("window", "yes").set("D_F", 0.25)
    assert (told(typed)["q"], told(typed)["D_F"], typed.faults) == ("1.6 um", "0.25 mm", ())
    assert typed.design.environment.temperature == 37.0
    grown = typed.design.q / typed.drawn.q
    assert grown == pytest.approx(warm.design.q / warm.drawn.q, rel=1e-12)
    assert grown > 1 + 1e-5
    # What a run or a proposal found is of the camera in use, and is taken as it is.
    assert warm.change({"D_F": 0.25}).design.D_F == 0.25


def test_the_temperature_in_use_is_set_and_reset_and_lengths_stay_those_at_20_degrees():
    singlet = State.of(load("paper-singlet"))

    def told(state):
        return {f["symbol"]: f for group in controls(state)["groups"] for f in group["fields"]}

    warm = singlet.edit("environment.temperature", "45")
    assert warm.design == singlet.design.at_temperature(45.0)
    assert told(warm)["environment.temperature"]["text"] == "45 degC"
    assert {s: f["text"] for s, f in told(warm).items() if s in BY_SYMBOL} == {
        s: f["text"] for s, f in told(singlet).items() if s in BY_SYMBOL
    }
    assert "350.044 mm at 45 °C" in warmth(evaluate(warm.design))
    assert warmth(evaluate(singlet.design)) == ""
    # Another number keeps it; nothing, or the slider, brings room temperature back.
    assert warm.edit("D_F", "2 mm").design.environment.temperature == 45.0
    for cold in (warm.edit("environment.temperature", " "), warm.set("environment.temperature", 20.0)):
        assert cold.design is singlet.design  # with what its file has, and without what it has not
        assert not told(cold)["environment.temperature"]["given"]
    assert singlet.edit("environment.temperature", "").design is singlet.design
    slid = warm.set("environment.temperature", 30.0).set("environment.temperature", 37.0)
    assert slid.set("environment.temperature", 20.0).design is singlet.design
    changed = slid.edit("D_F", "2 mm").set("environment.temperature", 20.0).design
    assert (changed.D_F, changed.environment.temperature) == (pytest.approx(2.0, rel=1e-14), 20.0)
    for text, why in (("300 K", "26.85 degC"), ("400", "at most 150"), ("x", "37 degC")):
        assert why in warm.edit("environment.temperature", text).fault("environment.temperature").message
    # What is wrong beside it waits on.
    assert warm.edit("D_F", "x").edit("environment.temperature", "30").fault("D_F").text == "x"


def test_a_link_whose_limits_cannot_be_tells_all_of_them():
    asked = {"u_z_mm": {"max": 1.0}, "views_independent": {"min": 1.0}}
    text = encode(State.of(PAPER.replace({"required": asked})), Look())
    packed = zlib.decompress(base64.urlsafe_b64decode(text[1:] + "=" * (-len(text[1:]) % 4)))
    spoilt = packed.replace(b"u_z_mm", b"u_y_mm").replace(b"views_independent", b"views_indifferent")
    with pytest.raises(LinkError, match=r"(?s)u_y_mm.*views_indifferent"):
        decode("1" + base64.urlsafe_b64encode(zlib.compress(spoilt)).decode().rstrip("="))
