"""Undo and redo: the states before and after the present one."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .state import State

DEPTH = 200
"""How many steps back are kept."""


@dataclass(frozen=True)
class History:
    """A present state between its past and its future."""

    present: State
    past: tuple[State, ...] = ()
    """Oldest first."""
    future: tuple[State, ...] = ()
    """What was undone, the nearest first."""
    gesture: str = ""
    """What the last change belongs to: all of one slider's move are one step."""


def record(history: History, state: State, gesture: str = "") -> History:
    """Go on to a new state; a change of the same gesture as the last one replaces it.

    Parameters
    ----------
    history : History
        Until now.
    state : State
        The new present. Where its design and follower are the old ones, no step is made.
    gesture : str
        Name of the move that this change is part of; "" for a change of its own.
    """
    before = history.present
    if (state.design, state.follows) == (before.design, before.follows):
        return History(state, history.past, history.future, history.gesture)
    if gesture and gesture == history.gesture:
        return History(state, history.past, (), gesture)
    return History(state, (*history.past, before)[-DEPTH:], (), gesture)


def undo(history: History) -> History:
    """One step back; the same where there is none."""
    if not history.past:
        return history
    return History(_clean(history.past[-1]), history.past[:-1], (_clean(history.present), *history.future))


def redo(history: History) -> History:
    """One step forward again; the same where there is none."""
    if not history.future:
        return history
    return History(history.future[0], (*history.past, _clean(history.present)), history.future[1:])


def _clean(state: State) -> State:
    """Without what was wrong: it was never part of the design."""
    return replace(state, faults=(), message="")
