"""What a browser tab shows, as frozen values: the design, what of it is looked at, what was before, and its link."""

from __future__ import annotations

import base64
import binascii
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, cast

from ..design import Design, DesignError, dumps, loads
from ..errors import Problem
from ..evaluation import default_fields
from .fields import BY_SYMBOL, CONJUGATE, read, symbol_of

Follower = Literal["f", "d_1", "d_f"]

DEPTH = 200
"""How many steps back are kept."""

Place = Literal["centre", "edge", "corner"] | tuple[float, float]
"""A microlens: by name, or where it stands on the MLA [mm]."""

PLACES = ("centre", "edge", "corner")
"""Microlenses with a name: of what the sensor sees."""

TABS = {"camera": "Camera", "depth": "Depth", "tolerance": "Tolerance", "optimise": "Optimise", "space": "3D"}
"""Views of the explorer with their labels, first the one it opens with."""

WHOLE: dict[str, bool | None] = {"auto": None, "object": True, "instrument": False}
"""What the meridional section shows: what suits, from the object plane on, or from the outermost stop on."""

VERSION = "1"
"""Of links: what they begin with."""

LIMIT = 200_000
"""Largest unpacked link [bytes]: one from elsewhere must not fill the memory."""


@dataclass(frozen=True)
class Fault:
    """What was typed into a field and is not a design."""

    symbol: str
    text: str
    message: str


@dataclass(frozen=True)
class State:
    """The design, and what is wrong with what was typed; its methods give the state after."""

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

    @classmethod
    def of(cls, design: Design, follows: Follower | None = None) -> State:
        """The state of a design just loaded; by default what its file leaves open follows."""
        if follows is None:
            lens = design.main_lens
            given = lens.focal_length is not None or lens.prescription is not None
            follows = "d_1" if design.microlens_array.distance is None else "d_f" if given else "f"
        state = cls(design, design)
        return replace(state, follows=follows if follows in state.followers else "d_f")

    @property
    def followers(self) -> tuple[Follower, ...]:
        """Which of f, d_1 and d_f can follow: behind a real lens its focal length is its own."""
        return ("d_1", "d_f") if self.design.main_lens.prescription is not None else ("f", "d_1", "d_f")

    def changeable(self, symbol: str) -> bool:
        """Whether a number can be set by hand."""
        return symbol != self.follows and not (symbol == "f" and "f" not in self.followers)

    def fault(self, symbol: str) -> Fault | None:
        """What is wrong with what was typed into a field."""
        return next((fault for fault in self.faults if fault.symbol == symbol), None)

    def follow(self, symbol: str) -> State:
        """Let another of f, d_1 and d_f follow; the design stays what it is."""
        if symbol not in self.followers:
            return self
        return replace(self, follows=symbol, faults=self._faults_but(symbol))

    def edit(self, symbol: str, text: str) -> State:
        """Type a length into a field.

        Returns
        -------
        State
            With the new design; or with the old one and what is wrong beside the field. What other fields are waiting
            for is tried together with it: two numbers that are wrong one at a time may be right at once.
        """
        if not self.changeable(symbol):
            return self
        try:
            value = read(BY_SYMBOL[symbol], text)
        except ValueError as error:
            return self._with_fault(Fault(symbol, text, str(error)))
        return self._put(symbol, value, text)

    def set(self, symbol: str, value: float) -> State:
        """Set a field to a value [mm], as a slider does."""
        return self._put(symbol, value, f"{value!r} mm") if self.changeable(symbol) else self

    def change(self, changes: Mapping[str, float]) -> State:
        """Set several numbers at once [mm]; all or none.

        Raises
        ------
        DesignError
            The numbers do not make a design.
        """
        return self.take(self._changed(changes))

    def take(self, design: Design) -> State:
        """Go on with another design; sliders keep their reach."""
        return replace(self, design=design, faults=(), message="")

    def without_faults(self) -> State:
        """The same with nothing wrong."""
        return replace(self, faults=(), message="")

    def _changed(self, changes: Mapping[str, float]) -> Design:
        touched = [symbol for symbol in CONJUGATE if symbol in changes]
        fixed: dict[str, Any] = {}
        if touched and self.follows not in touched and self.design.main_lens.prescription is None:
            fixed = {s: getattr(self.design, s) for s in CONJUGATE if s not in (self.follows, *touched)}
        return self.design.replace(**{**fixed, **changes})

    def _put(self, symbol: str, value: float, text: str) -> State:
        waiting = _readable(self._faults_but(symbol))
        problems: tuple[Problem, ...] = ()
        for others in ([waiting] if waiting else []) + [{}]:
            try:
                design = self._changed({**others, symbol: value})
            except DesignError as error:
                problems = error.problems
                continue
            left = tuple(fault for fault in self._faults_but(symbol) if fault.symbol not in others)
            return replace(self, design=design, faults=left, message="")
        return self._with_fault(Fault(symbol, text, _about(problems, symbol)))

    def _faults_but(self, symbol: str) -> tuple[Fault, ...]:
        return tuple(fault for fault in self.faults if fault.symbol != symbol)

    def _with_fault(self, fault: Fault) -> State:
        return replace(self, faults=(*self._faults_but(fault.symbol), fault), message="")


def _readable(faults: Iterable[Fault]) -> dict[str, float]:
    values = {}
    for fault in faults:
        try:
            values[fault.symbol] = read(BY_SYMBOL[fault.symbol], fault.text)
        except ValueError:
            continue
    return values


def _about(problems: tuple[Problem, ...], symbol: str) -> str:
    """Problems beside a field: its own first, then those of others under their names."""
    named = [(symbol_of(problem.key), problem.message) for problem in problems]
    own = [message for name, message in named if name in (symbol, None)]
    return "; ".join(own + [f"{name}: {message}" for name, message in named if name not in (symbol, None)])


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

    def record(self, state: State, gesture: str = "") -> History:
        """Go on to a new state; a change of the same gesture as the last one replaces it.

        Parameters
        ----------
        state : State
            The new present. Where its design and follower are the old ones, no step is made.
        gesture : str
            Name of the move that this change is part of; "" for a change of its own.
        """
        before = self.present
        if (state.design, state.follows) == (before.design, before.follows):
            return replace(self, present=state)
        if gesture and gesture == self.gesture:
            return History(state, self.past, (), gesture)
        return History(state, (*self.past, before)[-DEPTH:], (), gesture)

    def undo(self) -> History:
        """One step back; the same where there is none. What was wrong was never part of the design."""
        if not self.past:
            return self
        *past, last = self.past
        return History(last.without_faults(), tuple(past), (self.present.without_faults(), *self.future))

    def redo(self) -> History:
        """One step forward again; the same where there is none."""
        if not self.future:
            return self
        return History(self.future[0], (*self.past, self.present.without_faults()), self.future[1:])


@dataclass(frozen=True)
class Look:
    """What of a design is looked at; not part of what undo takes back."""

    tab: str = "camera"
    place: Place = "centre"
    """The microlens whose image is shown."""
    diffraction: bool = True
    pixels: bool = True
    whole: str = "auto"
    """How much the meridional section shows, a key of `WHOLE`."""


def place_on_mla(design: Design, place: Place) -> tuple[float, float]:
    """Where a microlens stands [mm]."""
    return dict(zip(PLACES, default_fields(design), strict=True))[place] if isinstance(place, str) else place


def read_place(place: Any) -> Place:
    """A microlens by its name or its two coordinates [mm].

    Raises
    ------
    ValueError
        Neither.
    """
    if place in PLACES:
        return cast("Place", place)
    x, y = (float(value) for value in place)
    if not (abs(x) < 1e6 and abs(y) < 1e6):
        raise ValueError("a place on the MLA is two finite numbers")
    return x, y


def on_array(design: Design, x: float, y: float) -> tuple[float, float]:
    """The place on the array nearest to a point [mm]."""
    half_x, half_y = (side / 2 for side in design.microlens_array.size)
    return min(max(x, -half_x), half_x), min(max(y, -half_y), half_y)


class LinkError(ValueError):
    """A link that cannot be read; says why."""


def encode(state: State, look: Look) -> str:
    """Text of letters, digits, - and _ that `decode` turns into an equal design, follower and look."""
    content = {"design": dumps(state.design), "follows": state.follows, "look": asdict(look)}
    if state.reference != state.design:
        content["reference"] = dumps(state.reference)
    packed = zlib.compress(json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode(), 9)
    return VERSION + base64.urlsafe_b64encode(packed).decode().rstrip("=")


def decode(text: str) -> tuple[State, Look]:
    """What `encode` packed.

    Raises
    ------
    LinkError
        Cut off, changed, of another version, or holding no design.
    """
    if not text.startswith(VERSION):
        raise LinkError("the link is not one of this version of the explorer; make it again there")
    try:
        content = json.loads(_unpacked(text[len(VERSION) :]))
        design, follows = loads(str(content["design"]), "link"), content["follows"]
        if follows not in CONJUGATE:
            raise ValueError(f"{follows!r} does not follow")
        state = State.of(design, follows)
        if "reference" in content:
            state = replace(state, reference=loads(str(content["reference"]), "link"))
        return state, _look(content["look"])
    except DesignError as error:
        raise LinkError(f"the link's design cannot be used: {error}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise LinkError("the link is cut off or changed; copy it again, whole") from None


def _unpacked(text: str) -> bytes:
    try:
        packed = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
        reader = zlib.decompressobj()
        content = reader.decompress(packed, LIMIT)
    except (binascii.Error, zlib.error) as error:
        raise ValueError(str(error)) from None
    if reader.unconsumed_tail or not reader.eof:
        raise ValueError("cut off, or too large")
    return content


def _look(data: Any) -> Look:
    tab, whole = data["tab"], data["whole"]
    if tab not in TABS or whole not in WHOLE:
        raise ValueError(f"no view {tab!r} or {whole!r}")
    return Look(tab, read_place(data["place"]), bool(data["diffraction"]), bool(data["pixels"]), whole)
