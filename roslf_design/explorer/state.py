"""What one browser tab shows: a frozen value, and what can be done to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from ..design import Design, DesignError
from ..errors import Problem
from .fields import BY_SYMBOL, CONJUGATE, read, symbol_of

Follower = Literal["f", "d_1", "d_f"]


@dataclass(frozen=True)
class Fault:
    """What was typed into a field and is not a design."""

    symbol: str
    text: str
    message: str


@dataclass(frozen=True)
class State:
    """The design, and what of it is looked at."""

    design: Design
    """The last good one: every picture is of it."""
    reference: Design
    """The one that was loaded; sliders reach about its numbers."""
    follows: Follower = "d_f"
    """Which of f, d_1 and d_f is the consequence of the other two."""
    faults: tuple[Fault, ...] = ()
    """At most one a field."""
    message: str = ""
    """What went wrong with something that is not a field: a file, a link."""

    def fault(self, symbol: str) -> Fault | None:
        """What is wrong with what was typed into a field."""
        return next((fault for fault in self.faults if fault.symbol == symbol), None)


def start(design: Design, follows: Follower | None = None) -> State:
    """The state of a design just loaded; by default what its file leaves open follows."""
    return State(design, design, _allowed(design, follows or _left_open(design)))


def followers(design: Design) -> tuple[Follower, ...]:
    """Which of f, d_1 and d_f can follow: behind a real lens its focal length is its own."""
    return ("d_1", "d_f") if design.main_lens.prescription is not None else ("f", "d_1", "d_f")


def changeable(state: State, symbol: str) -> bool:
    """Whether a number can be set by hand."""
    return symbol != state.follows and not (symbol == "f" and state.design.main_lens.prescription is not None)


def follow(state: State, symbol: str) -> State:
    """Let another of f, d_1 and d_f follow; the design stays what it is."""
    if symbol not in followers(state.design):
        return state
    return replace(state, follows=symbol, faults=tuple(f for f in state.faults if f.symbol != symbol))


def edit(state: State, symbol: str, text: str) -> State:
    """Type a length into a field.

    Returns
    -------
    State
        With the new design; or with the old one and what is wrong beside the field. What other fields are waiting for
        is tried together with it: two numbers that are wrong one at a time may be right at once.
    """
    if not changeable(state, symbol):
        return state
    try:
        value = read(BY_SYMBOL[symbol], text)
    except ValueError as error:
        return _with_fault(state, Fault(symbol, text, str(error)))
    return _put(state, symbol, value, text)


def set_value(state: State, symbol: str, value: float) -> State:
    """Set a field to a value [mm], as a slider does."""
    return _put(state, symbol, value, f"{value!r} mm") if changeable(state, symbol) else state


def change(state: State, changes: Mapping[str, float]) -> State:
    """Set several numbers at once [mm]; all or none.

    Raises
    ------
    DesignError
        The numbers do not make a design.
    """
    return replace(state, design=changed(state, changes), faults=(), message="")


def changed(state: State, changes: Mapping[str, float]) -> Design:
    """The design with some numbers changed, where the one of f, d_1, d_f follows that was chosen to.

    Raises
    ------
    DesignError
        The numbers do not make a design.
    """
    design = state.design
    touched = [symbol for symbol in CONJUGATE if symbol in changes]
    kept: dict[str, Any] = {}
    if touched and state.follows not in touched and design.main_lens.prescription is None:
        kept = {symbol: getattr(design, symbol) for symbol in CONJUGATE if symbol not in (state.follows, *touched)}
    return design.replace(**{**kept, **changes})


def _put(state: State, symbol: str, value: float, text: str) -> State:
    waiting = _readable(fault for fault in state.faults if fault.symbol != symbol)
    for others in ([waiting] if waiting else []) + [{}]:
        try:
            design = changed(state, {**others, symbol: value})
        except DesignError as error:
            problems = error.problems
            continue
        left = tuple(f for f in state.faults if f.symbol != symbol and f.symbol not in others)
        return replace(state, design=design, faults=left, message="")
    return _with_fault(state, Fault(symbol, text, _told(problems, symbol)))


def _readable(faults: Any) -> dict[str, float]:
    values = {}
    for fault in faults:
        try:
            values[fault.symbol] = read(BY_SYMBOL[fault.symbol], fault.text)
        except ValueError:
            continue
    return values


def _told(problems: tuple[Problem, ...], symbol: str) -> str:
    own = [problem.message for problem in problems if symbol_of(problem.key) in (symbol, None)]
    others = [f"{symbol_of(p.key)}: {p.message}" for p in problems if symbol_of(p.key) not in (symbol, None)]
    return "; ".join(own + others)


def _with_fault(state: State, fault: Fault) -> State:
    return replace(state, faults=(*(f for f in state.faults if f.symbol != fault.symbol), fault), message="")


def _left_open(design: Design) -> Follower:
    if design.microlens_array.distance is None:
        return "d_1"
    if design.main_lens.focal_length is None and design.main_lens.prescription is None:
        return "f"
    return "d_f"


def _allowed(design: Design, symbol: Follower) -> Follower:
    return symbol if symbol in followers(design) else "d_f"
