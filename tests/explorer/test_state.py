"""What can be done to a state, without any browser."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.design import DesignError, load
from roslf_design.explorer.fields import CONJUGATE
from roslf_design.explorer.history import DEPTH, History, record, redo, undo
from roslf_design.explorer.state import change, changeable, edit, follow, followers, set_value, start

PAPER = load("paper")
SINGLET = load("paper-singlet")


def test_a_good_number_makes_a_new_design_and_leaves_the_old_state():
    before = start(PAPER)
    after = edit(before, "D_F", "3.5 mm")
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
    state = edit(start(PAPER), symbol, text)
    assert state.design == PAPER
    assert state.fault(symbol).text == text
    assert told in state.fault(symbol).message
    assert [fault.symbol for fault in state.faults] == [symbol]


def test_a_good_number_takes_the_fault_of_its_field_away():
    state = edit(edit(start(PAPER), "D_F", "abc"), "D_F", "3 mm")
    assert state.faults == ()


def test_two_numbers_that_are_wrong_one_at_a_time_may_be_right_at_once():
    waiting = edit(start(PAPER), "d_3", "400 mm")
    assert waiting.design.d_3 == 120
    both = edit(follow(waiting, "d_1"), "d_f", "500 mm")
    assert (both.design.d_3, both.design.d_f, both.faults) == (400, 500, ())


def test_a_fault_stays_while_another_field_is_changed():
    state = edit(edit(start(PAPER), "d_3", "400 mm"), "D", "60 mm")
    assert state.design.D == 60
    assert state.fault("d_3") is not None


@pytest.mark.parametrize("follower", CONJUGATE)
@pytest.mark.parametrize("changed", CONJUGATE)
def test_of_f_d_1_d_f_the_chosen_one_follows_and_the_others_stay(follower, changed):
    state = follow(start(PAPER), follower)
    assert state.design == PAPER
    if changed == follower:
        assert not changeable(state, changed)
        assert edit(state, changed, "200 mm") == state
        return
    after = edit(state, changed, f"{1.05 * getattr(PAPER, changed)!r} mm")
    assert after.faults == ()
    [kept] = {*CONJUGATE} - {follower, changed}
    assert getattr(after.design, kept) == pytest.approx(getattr(PAPER, kept), rel=1e-14)
    f, d_1, d_f = (getattr(after.design, symbol) for symbol in CONJUGATE)
    assert 1 / f == pytest.approx(1 / d_1 + 1 / d_f, rel=1e-12)  # The lens equation, to a few ulp.
    assert getattr(after.design, follower) != getattr(PAPER, follower)


def test_behind_a_real_lens_its_focal_length_is_its_own():
    state = start(SINGLET)
    assert followers(SINGLET) == ("d_1", "d_f")
    assert not changeable(state, "f")
    assert edit(state, "f", "120 mm") == state
    assert follow(state, "f") == state
    moved = edit(follow(state, "d_f"), "d_1", "150 mm")
    assert moved.design.d_1 == 150
    assert moved.design.f == SINGLET.f


def test_several_numbers_change_all_or_none():
    state = edit(start(PAPER), "D_F", "abc")
    assert change(state, {"d_3": 100.0, "D_F": 3.0}).faults == ()
    with pytest.raises(DesignError):
        change(state, {"d_3": 100.0, "D_F": -3.0})


def test_states_are_values():
    state = edit(start(PAPER), "d_3", "400 mm")
    assert pickle.loads(pickle.dumps(state)) == state
    assert hash(state) == hash(edit(start(PAPER), "d_3", "400 mm"))
    with pytest.raises(AttributeError):
        state.design = SINGLET


moves = st.lists(
    st.tuples(st.sampled_from(["D", "D_F", "d", "d_2", "q", "f_ml"]), st.floats(0.01, 50), st.sampled_from("ab ")),
    max_size=12,
)


@given(moves, st.integers(0, 12))
def test_undo_and_redo_are_each_others_inverse(changes, back):
    history = History(start(PAPER))
    for symbol, value, gesture in changes:
        history = record(history, set_value(history.present, symbol, value), gesture.strip())
    end = history
    taken = 0
    while taken < back and history.past:
        history, taken = undo(history), taken + 1
    for _ in range(taken):
        history = redo(history)
    assert history.present.design == end.present.design
    assert [state.design for state in history.past] == [state.design for state in end.past]


def test_one_move_of_a_slider_is_one_step():
    history = History(start(PAPER))
    for value in (3.0, 3.1, 3.2):
        history = record(history, set_value(history.present, "D_F", value), "D_F:1")
    history = record(history, set_value(history.present, "D_F", 4.0), "D_F:2")
    assert len(history.past) == 2
    assert undo(history).present.design.D_F == 3.2
    assert undo(undo(history)).present.design == PAPER
    assert undo(undo(undo(history))).present.design == PAPER


def test_a_new_change_ends_what_could_be_redone():
    history = record(History(start(PAPER)), edit(start(PAPER), "D_F", "3 mm"))
    history = record(undo(history), edit(start(PAPER), "D_F", "4 mm"))
    assert history.future == ()
    assert redo(history) == history


def test_what_was_wrong_is_no_step_and_does_not_come_back():
    history = record(History(start(PAPER)), edit(start(PAPER), "D_F", "abc"))
    assert history.past == ()
    history = record(history, set_value(history.present, "D", 60.0))
    assert undo(history).present.faults == ()


def test_history_is_bounded():
    history = History(start(PAPER))
    for step in range(DEPTH + 20):
        history = record(history, set_value(history.present, "D", 50.0 + step))
    assert len(history.past) == DEPTH
