"""State of a browser tab, as frozen values: the design and its numbers, the view, history, link."""

from __future__ import annotations

import base64
import binascii
import dataclasses
import json
import math
import zlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass as checked_dataclass

from ..camera import Camera
from ..design import PATHS, Design, DesignError, dumps
from ..design.parts import MOST_CONTRAST
from ..errors import InputError, Problem
from ..evaluation import default_fields
from ..lenses.glass import AIR, ROOM, Glass, catalogue, find_glass, read_glass
from ..reporting.design.figures import at_room
from ..theory.limits import design_of_text
from ..theory.quantities import QUANTITIES
from ..units import UNITS, parse_quantity

# Numbers of a design.

STEPS = 1000
"""A slider's positions are the whole numbers from 0 to this."""

SPAN = 4.0
"""A slider reaches from the reference over this to the reference times this."""

Follower = Literal["f", "d_1", "d_f"]
CONJUGATE: tuple[Follower, ...] = ("f", "d_1", "d_f")
"""Any two of these give the third."""


def fixed_conjugates(follows: str, changed: Collection[str]) -> tuple[str, ...]:
    """Which of f, d_1 and d_f stay where some numbers change and one follows; none where that one is among them."""
    touched = [symbol for symbol in CONJUGATE if symbol in changed]
    return tuple(s for s in CONJUGATE if s not in (follows, *touched)) if touched and follows not in touched else ()


Choice = Literal["medium", "window", "window_material", "mapping"]
"""Choices beside numbers."""


class NumberField(NamedTuple):
    """Number of a design as the page shows it."""

    symbol: str
    """As in the paper, and as `Design.replace` takes it."""
    name: str
    group: str
    """Part of the camera that it belongs to."""
    unit: str
    """The unit that it is shown in, and that a number without a unit has."""
    scale: Literal["log", "linear"] = "log"
    """Scale of the slider."""
    kind: str = "length"
    """Kind of the unit; "" of a plain number."""
    ends: tuple[float, float] | None = None
    """Ends of the slider; None: about the design that was loaded."""
    left_out: str = ""
    """Text that stands for a value which a design leaves out; "" where none can."""

    @property
    def per_unit(self) -> float:
        """Size of the unit in mm, lx or s."""
        return float(UNITS[self.kind][self.unit]) if self.kind else 1.0


FIELDS = (
    NumberField("D", "Clear aperture", "Main lens", "mm"),
    NumberField("f", "Focal length", "Main lens", "mm"),
    NumberField("d_f", "Focal plane", "Main lens", "mm"),
    NumberField("d_1", "Lens to MLA", "Main lens", "mm"),
    NumberField("D_F", "FAP diameter", "FAP", "mm"),
    NumberField("d_3", "FAP to lens", "FAP", "mm", "linear"),
    NumberField("d", "Pitch", "Microlenses", "um"),
    NumberField("f_ml", "Focal length", "Microlenses", "mm"),
    NumberField("d_2", "MLA to sensor", "Sensor and light", "mm"),
    NumberField("q", "Pixel pitch", "Sensor and light", "um"),
    NumberField("wavelength", "Wavelength", "Sensor and light", "nm", "linear"),
)
"""Every field, in the order of the page."""

BY_SYMBOL = {field.symbol: field for field in FIELDS}

TEMPERATURE = NumberField(
    "environment.temperature", "Temperature", "In use", "degC", "linear", "temperature", (-20.0, 80.0), f"{ROOM:g} degC"
)
"""Field of the temperature that the camera is used at."""

WINDOW = (
    NumberField("window_thickness", "Thickness", "Bore", "mm"),
    NumberField("window_distance", "To the lens", "Bore", "mm", "linear"),
    NumberField("window_diameter", "Aperture", "Bore", "mm"),
)
"""Fields of the outermost window, where a design has one."""

LIGHT = (
    NumberField("light.illuminance", "Illuminance", "Light", "lx", "log", "illuminance", (1e1, 1e6)),
    NumberField("light.reflectance", "Reflectance", "Light", "", "log", "", (0.01, 1.0)),
    NumberField("light.measured_at", "Light measured at", "Light", "mm", "log", "length", (1.0, 1e3), "every distance"),
    NumberField("light.exposure", "Exposure", "Light", "ms", "log", "time", (1e-5, 1.0), "automatic"),
    NumberField("depth.contrast", "Contrast, rms", "Texture", "", "log", "", (1e-3, MOST_CONTRAST)),
    NumberField("depth.period", "Period", "Texture", "mm", "log", "length", (1e-2, 1e2), "every size"),
    NumberField("depth.finest", "Finest detail", "Texture", "mm", "log", "length", (1e-2, 1e2), "2 microlenses"),
    NumberField("depth.window", "Microlenses", "Matching", "", "linear", "", (1, 41)),
    NumberField("depth.view_mismatch", "Mismatch, rms", "Views and pixels", "", "linear", "", (0.0, 0.2)),
    NumberField("sensor.prnu", "PRNU", "Views and pixels", "", "linear", "", (0.0, 0.05)),
    NumberField("sensor.dsnu", "DSNU, electrons", "Views and pixels", "", "linear", "", (0.0, 100.0)),
    NumberField("light.veil", "Veil, of full scale", "Views and pixels", "", "linear", "", (0.0, 0.5)),
    NumberField("depth.disparity_error", "Fixed error", "Matching", "", "log", "", (1e-4, 1.0), "predicted"),
)
"""Fields of light, texture, matching and pixels that depth is told for, by their place in a design file."""

CONTROLS = BY_SYMBOL | {field.symbol: field for field in (TEMPERATURE, *WINDOW, *LIGHT)}
"""Every field that a design may have."""

MEDIA = ("air", *(name for name in ("water", "saline") if name.upper() in catalogue()))
"""Media that the scene can lie in by name."""

GLASSES = tuple(name for name in ("sapphire", "fused silica", "N-BK7") if name.upper() in catalogue())
"""Materials of windows that the page proposes; any other can be typed."""

EXAMPLES = {"mm": "2.9 mm", "um": "63 um", "nm": "550 nm", "lx": "1e5 lx", "ms": "10 ms", "degC": "37 degC", "": "0.1"}
"""Examples of what may be typed, by the field's unit."""

VISIBLE = (380e-6, 1000e-6)
"""Wavelengths that a slider reaches, whatever the design [mm]."""


SHORT = 0.1
"""Lengths from here down are shown in micrometres [mm]."""


def shown_in(field: NumberField, value: float | None) -> NumberField:
    """The field with the unit that it shows a value in."""
    short = field.unit == "mm" and value is not None and 0 < abs(value) < SHORT
    return field._replace(unit="um") if short else field


def show(field: NumberField, value: float) -> str:
    """A number [mm, lx, s] as text in the field's unit, a short length in micrometres, to seven digits."""
    field = shown_in(field, value)
    return f"{value / field.per_unit:.7g} {field.unit}".rstrip()


def read(field: NumberField, text: str) -> float:
    """A number that was typed [mm, lx, s]; a bare one has the unit that the field shows.

    Raises
    ------
    ValueError
        What is wrong and what to write instead.
    """
    typed = text.strip()
    if typed.count(",") == 1 and "." not in typed:
        typed = typed.replace(",", ".")
    if not typed:
        raise ValueError(f'empty; write e.g. "{EXAMPLES[field.unit]}"')
    try:
        bare = float(typed)
    except ValueError:
        if not field.kind:
            raise ValueError(f"'{typed}' is no number; write e.g. 0.1") from None
        return parse_quantity(typed, field.kind)
    return parse_quantity(f"{typed} {field.unit}", field.kind) if field.kind else bare


def reach(field: NumberField, reference: Design, design: Design) -> tuple[float, float]:
    """Smallest and largest value of the field's slider [mm].

    About the design that was loaded, so that a slider keeps its place while it is moved; always as far as the present
    design's value.
    """
    if field.ends is not None:
        now = value_of(design, field.symbol) or field.ends[1]
        return min(field.ends[0], now), max(field.ends[1], now)
    now = value_of(design, field.symbol) or design.D_F
    centre = value_of(reference, field.symbol) or now
    low, high = centre / SPAN, centre * SPAN
    if field.symbol == "window_distance":
        low, high = 0.0, design.d_f
    if field.symbol == "wavelength":
        low, high = VISIBLE
    elif field.symbol == "d_3":
        low, high = min(0.0, SPAN * centre), 0.995 * design.d_f
        if design.aperture.behind is not None:
            low, high = -0.99 * design.d_1, -0.01 * design.d_1
    elif field.symbol in ("d_1", "d_f"):
        low = max(low, 1.001 * design.f)
    return min(low, now), max(high, now)


def position(field: NumberField, value: float, ends: tuple[float, float]) -> int:
    """Where the slider stands for a value [mm], from 0 to `STEPS`."""
    low, high = ends
    if not high > low:
        return 0
    if field.scale == "log" and low > 0 < value:
        share = math.log(value / low) / math.log(high / low)
    else:
        share = (value - low) / (high - low)
    return round(STEPS * min(max(share, 0.0), 1.0))


def value_at(field: NumberField, place: float, ends: tuple[float, float]) -> float:
    """Value [mm] of a slider's position, rounded to as many digits as a step has; the ends are met exactly."""
    low, high = ends
    share = min(max(place / STEPS, 0.0), 1.0)
    if field.symbol == "depth.window":
        return round(low + share * (high - low))
    if share in (0.0, 1.0):
        return high if share else low
    if field.scale == "log" and low > 0:
        return float(f"{low * (high / low) ** share:.4g}")
    span = high - low
    return round(low + share * span, 3 - math.floor(math.log10(span))) if span > 0 else low


def window_of(design: Design) -> int | None:
    """Which element is the window at the tip: the farthest one, if it is a plate."""
    far = max(range(len(design.elements)), key=lambda k: design.elements[k].distance, default=None)
    return far if far is not None and design.elements[far].catalogue else None


def objective_of(design: Design) -> int | None:
    """Which element is the objective: the foremost that bends light, if it is an ideal lens."""
    bending = (k for k, at in enumerate(design.in_bore) if at.part.bends)
    far = max(bending, key=lambda k: design.elements[k].distance, default=None)
    return far if far is not None and design.elements[far].maps else None


def value_of(design: Design, symbol: str) -> float | None:
    """A field's number [mm, lx, s]; None where the design has none: no window, or one without an aperture."""
    if symbol in BY_SYMBOL:
        return float(getattr(design, symbol))
    if symbol == TEMPERATURE.symbol:
        return ROOM if design.environment is None else design.environment.temperature
    if "." in symbol:
        given = attrgetter(symbol)(design)
        return None if given is None else float(given)
    k = window_of(design)
    value = None if k is None else getattr(design.elements[k], symbol.removeprefix("window_"))
    return None if value is None else float(value)


def _new_window(design: Design) -> dict[str, Any]:
    """A window just before all else, as wide as what the sensor sees through the FAP asks for [mm]."""
    camera = Camera.of(design)
    tip, beyond = float(camera.tip), design.d_f - design.d_3
    gap = design.d_f - tip
    start, thick = (float(f"{value:.4g}") for value in (tip + min(0.5, 0.05 * gap), min(1.0, 0.1 * gap)))
    share = (start + thick - design.d_3) / beyond
    pencil = float(QUANTITIES["field_half_diagonal_mm"](camera)) * share + design.D_F / 2
    # A rim before an objective with a mapping would cut rays whose first order does not tell where they are.
    wide = {"diameter": float(f"{2.2 * pencil:.3g}")} if math.isfinite(pencil) and not camera.mapping.bends else {}
    return {"kind": "plate", "distance": start, "thickness": thick, "material": GLASSES[0], **wide}


# The design.


@dataclass(frozen=True)
class _Fault:
    """Text typed into a field that makes no design, with the reason."""

    symbol: str
    text: str
    message: str


@dataclass(frozen=True)
class State:
    """The design, and what is wrong with what was typed; its methods give the state after."""

    design: Design
    """The last good one: every picture is of it."""
    reference: Design
    """The one that was loaded, as `drawn`; sliders reach about its numbers."""
    follows: Follower = "d_f"
    """Which of f, d_1 and d_f is the consequence of the other two."""
    faults: tuple[_Fault, ...] = ()
    """Faults of fields, at most one a field."""
    message: str = ""
    """Message about a fault of something that is not a field: a file, a link."""
    cold: Design | None = None
    """The design before it was warmed; None where nothing was done since but that."""

    @classmethod
    def of(cls, design: Design, follows: Follower | None = None) -> State:
        """The state of a design just loaded; by default what its file leaves open follows."""
        if follows is None:
            lens = design.main_lens
            given = lens.kind.given(PATHS["f"], lens.focal_length, design.wavelength) is not None
            follows = "d_1" if design.microlens_array.distance is None else "d_f" if given else "f"
        state = cls(design, at_room(design)[0])
        return replace(state, follows=follows if follows in state.followers else "d_f")

    @cached_property
    def drawn(self) -> Design:
        """The design whose lengths fields show and change: at room temperature, as drawings and files have it."""
        return at_room(self.design)[0]

    def shown_by(self, symbol: str) -> Design:
        """The design whose number a field shows."""
        return self.design if symbol == TEMPERATURE.symbol else self.drawn

    def _used(self, drawn: Design) -> Design:
        """A drawn design at the temperature that the camera is used at."""
        used = self.design.environment
        return drawn if used is None else drawn.at_temperature(used.temperature, ranging=True)

    @property
    def followers(self) -> tuple[Follower, ...]:
        """Which of f, d_1 and d_f can follow: behind a real lens its focal length is its own."""
        return self.design.main_lens.kind.open_conjugates

    def changeable(self, symbol: str) -> bool:
        """Whether a number can be set by hand."""
        if symbol in ("light.illuminance", "light.reflectance"):
            return self.design.light.radiance is None
        if "." in symbol:
            return not (symbol == "depth.finest" and self.design.depth.period is not None)
        if symbol not in BY_SYMBOL:
            return window_of(self.design) is not None
        return symbol != self.follows and not (symbol == "f" and "f" not in self.followers)

    def fault(self, symbol: str) -> _Fault | None:
        """Fault of what was typed into a field; None where there is none."""
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
        if CONTROLS[symbol].left_out and not text.strip():
            return self._put(symbol, None, text)
        try:
            value = read(shown_in(CONTROLS[symbol], value_of(self.shown_by(symbol), symbol)), text)
        except ValueError as error:
            return self._with_fault(_Fault(symbol, text, str(error)))
        return self._put(symbol, value, text)

    def set(self, symbol: str, value: float) -> State:
        """Set a field to a value [mm, lx, s, degrees C], as a slider does."""
        field = CONTROLS[symbol]
        text = f"{value / field.per_unit!r} {field.unit}".strip()
        return self._put(symbol, value, text) if self.changeable(symbol) else self

    def change(self, changes: Mapping[str, float]) -> State:
        """Set several numbers at once, as they are in use [mm]; all or none.

        Raises
        ------
        DesignError
            The numbers do not make a design.
        """
        return self.take(self._changed(self.design, changes))

    def take(self, design: Design) -> State:
        """Go on with another design; sliders keep their reach."""
        return replace(self, design=design, faults=(), message="")

    def choose(self, what: Choice, text: str) -> State:
        """Say what the scene lies in, whether there is a window at the tip and of what, how an objective maps angles.

        Parameters
        ----------
        what : {"medium", "window", "window_material", "mapping"}
        text : str
            A material's name or index; a mapping's name; of a window "yes" or "no". A liquid brings the window that
            seals it off, and the last window that goes takes the liquid along.
        """
        design, k = self.drawn, window_of(self.design)
        elements: list[Any] = list(design.elements)
        medium = design.object_space.medium
        try:
            if what == "window":
                if (text == "yes") == (k is not None):
                    return replace(self, faults=self._faults_but(what))
                elements = [*elements, _new_window(design)] if k is None else elements[:k] + elements[k + 1 :]
            elif what == "medium":
                medium = _material(text)
                elements = elements or ([] if text == "air" else [_new_window(design)])
            elif what == "mapping":
                if (objective := objective_of(design)) is not None:
                    elements[objective] = elements[objective].model_copy(update={"mapping": text})
            elif k is not None:
                elements[k] = elements[k].model_copy(update={"material": _material(text)})
            held = [s for s in design.main_lens.kind.kept_conjugates if s != self.follows]
            changes = {PATHS[s]: getattr(design, s) for s in held}
            changes |= {"elements": tuple(elements), "object_space.medium": medium if elements else AIR}
            left = tuple(
                f
                for f in self._faults_but(what)
                if not (what == "window" and f.symbol in CONTROLS.keys() - BY_SYMBOL.keys())
            )
            return replace(self.take(self._used(design.replace(changes))), faults=left)
        except InputError as error:
            return self._with_fault(_Fault(what, text, "; ".join(problem.message for problem in error.problems)))

    def _changed(self, design: Design, changes: Mapping[str, float | None]) -> Design:
        window = f"elements.{window_of(design)}."
        places: dict[str, Any] = {PATHS.get(s, s.replace("window_", window)): value for s, value in changes.items()}
        if (across := places.get("depth.window")) is not None and across == round(across):
            places["depth.window"] = round(across)
        if "q" in changes:  # as the microlenses see it
            places[PATHS["q"]] *= design.sensor.relay_magnification
        fixed = fixed_conjugates(self.follows, changes)
        if any(symbol.startswith("window_") for symbol in changes):  # glass moves the focus
            fixed = tuple(s for s in CONJUGATE if s != self.follows and s not in changes)
        fixed = tuple(s for s in fixed if s in design.main_lens.kind.kept_conjugates)
        return design.replace({PATHS[s]: getattr(design, s) for s in fixed} | places)

    def _put(self, symbol: str, value: float | None, text: str) -> State:
        waiting = {} if symbol == TEMPERATURE.symbol else _readable(self._faults_but(symbol), self.drawn)
        problems: tuple[Problem, ...] = ()
        for others in ([waiting] if waiting else []) + [{}]:
            try:
                design = self._with(symbol, value, others)
            except DesignError as error:
                problems = error.problems
                continue
            left = tuple(fault for fault in self._faults_but(symbol) if fault.symbol not in others)
            cold = None
            if symbol == TEMPERATURE.symbol and value_of(design, symbol) != ROOM:
                cold = self.design if value_of(self.design, symbol) == ROOM else self.cold
            return replace(self, design=design, faults=left, message="", cold=cold)
        return self._with_fault(_Fault(symbol, text, _about(problems, symbol)))

    def _with(self, symbol: str, value: float | None, others: Mapping[str, float]) -> Design:
        """The design with a field's number, and others, in use."""
        if symbol != TEMPERATURE.symbol:
            return self._used(self._changed(self.drawn, {**others, symbol: value}))
        at, now = ROOM if value is None else value, value_of(self.design, symbol)
        if now is None or now == at:
            return self.design
        if self.cold is None or self.cold.at_temperature(now, ranging=True) != self.design:  # changed since
            return self.drawn.at_temperature(at, ranging=True)
        return self.cold if at == ROOM else self.cold.at_temperature(at, ranging=True)

    def _faults_but(self, symbol: str) -> tuple[_Fault, ...]:
        return tuple(fault for fault in self.faults if fault.symbol != symbol)

    def _with_fault(self, fault: _Fault) -> State:
        return replace(self, faults=(*self._faults_but(fault.symbol), fault), message="")


def _material(text: str) -> Glass:
    """A material that was typed: its name, or its index."""
    try:
        index = float(text.replace(",", "."))
    except ValueError:
        return find_glass(text)
    return read_glass({"index": index})


def _readable(faults: Iterable[_Fault], design: Design) -> dict[str, float]:
    values = {}
    for fault in faults:
        if fault.symbol == TEMPERATURE.symbol:  # the others' numbers are drawn at 20 degrees C
            continue
        try:
            values[fault.symbol] = read(shown_in(CONTROLS[fault.symbol], value_of(design, fault.symbol)), fault.text)
        except (KeyError, ValueError):  # a material is no length
            continue
    return values


def _about(problems: tuple[Problem, ...], symbol: str) -> str:
    """Problems beside a field: its own first, then those of others under their names."""
    symbols = {place: symbol for symbol, place in PATHS.items()}
    named = [(symbols.get(problem.key, symbol), problem.message) for problem in problems]
    own = [message for name, message in named if name == symbol]
    return "; ".join(own + [f"{name}: {message}" for name, message in named if name != symbol])


DEPTH = 200
"""Number of steps back that are kept."""


@dataclass(frozen=True)
class History:
    """A present state between its past and its future."""

    present: State
    past: tuple[State, ...] = ()
    """Oldest first."""
    future: tuple[State, ...] = ()
    """States that were undone, the nearest first."""
    gesture: str = ""
    """Gesture that the last change belongs to: all of one slider's move are one step."""

    def record(self, state: State, gesture: str = "") -> History:
        """Go on to a new state: no step where design and follower are the old ones, or the gesture is the last's."""
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
        return History(last.take(last.design), tuple(past), (self.present.take(self.present.design), *self.future))

    def redo(self) -> History:
        """One step forward again; the same where there is none."""
        if not self.future:
            return self
        return History(self.future[0], (*self.past, self.present.take(self.present.design)), self.future[1:])


# What is looked at.

TABS = {"camera": "Camera", "depth": "Depth", "tolerance": "Tolerance", "optimise": "Optimise", "space": "3D"}
"""Views of the explorer with their labels, first the one it opens with."""

WHOLE: dict[str, dict[str, Any]] = {
    "auto": {},
    "object": {"whole": True},
    "instrument": {"whole": False},
    "tip": {"close": "tip"},
    "sensor": {"close": "sensor"},
    "folded": {},
}
"""Extents of the meridional section, as `meridional` takes them: what suits, from the object plane on, from the
outermost stop on, or close to one end; or all of it as it is built, folded where the axis is, to scale."""

PLACES = ("centre", "edge", "corner")
"""Microlenses with a name: of what the sensor sees."""

Coordinate = Annotated[float, Field(gt=-1e6, lt=1e6)]
Place = Literal["centre", "edge", "corner"] | tuple[Coordinate, Coordinate]
"""A microlens: by name, or where it stands on the MLA [mm]."""


def key_of(names: Mapping[str, object]) -> AfterValidator:
    """Validator that refuses text that is not among the names."""

    def known(name: str) -> str:
        if name not in names:
            raise ValueError(f"there are {', '.join(names)}")
        return name

    return AfterValidator(known)


@checked_dataclass(frozen=True)
class Look:
    """View of a design in a tab; not part of what undo takes back.

    Raises
    ------
    ValueError
        There is no such view.
    """

    tab: Annotated[str, key_of(TABS)] = "camera"
    place: Place = "centre"
    """The microlens whose image is shown."""
    diffraction: bool = True
    pixels: bool = True
    whole: Annotated[str, key_of(WHOLE)] = "auto"
    """Extent of the meridional section, one of `WHOLE`."""


def place_on_mla(design: Design, place: Place) -> tuple[float, float]:
    """Place of a microlens [mm]."""
    return dict(zip(PLACES, default_fields(design), strict=True))[place] if isinstance(place, str) else place


def on_array(design: Design, x: float, y: float) -> tuple[float, float]:
    """The place on the array nearest to a point [mm]."""
    half_x, half_y = (side / 2 for side in design.microlens_array.size)
    return min(max(x, -half_x), half_x), min(max(y, -half_y), half_y)


# The link that brings all of it back.

VERSION = "1"
"""Version of links, with which they begin."""

LIMIT = 50_000
"""Largest unpacked link [bytes], ten times a lens of many surfaces: one from elsewhere must not keep others waiting."""


class LinkError(ValueError):
    """A link that cannot be read; says why."""


def encode(state: State, look: Look) -> str:
    """Text of letters, digits, - and _ that `decode` turns into an equal design, follower and look."""
    content = {"design": dumps(state.design), "follows": state.follows, "look": dataclasses.asdict(look)}
    if state.reference != state.design:
        content["reference"] = dumps(state.reference)
    packed = zlib.compress(json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode(), 9)
    return VERSION + base64.urlsafe_b64encode(packed).decode().rstrip("=")


def decode(text: str) -> tuple[State, Look]:
    """State and view that `encode` packed.

    Raises
    ------
    LinkError
        Cut off, changed, of another version, or holding no design.
    """
    if not text.startswith(VERSION):
        raise LinkError("the link is not one of this version of the explorer; make it again there")
    try:
        packed = base64.b64decode(text[1:] + "=" * (-len(text[1:]) % 4), altchars=b"-_", validate=True)
        reader = zlib.decompressobj()
        content = json.loads(reader.decompress(packed, LIMIT))
        if reader.unconsumed_tail or not reader.eof or content["follows"] not in CONJUGATE:
            raise LinkError
        state = State.of(_design_of(content["design"]), content["follows"])
        if "reference" in content:
            state = replace(state, reference=_design_of(content["reference"]))
        return state, Look(**content["look"])
    except DesignError as error:
        raise LinkError(f"the link's design cannot be used: {error}") from None
    except (binascii.Error, zlib.error, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise LinkError("the link is cut off or changed; copy it again, whole") from None


def _design_of(text: object) -> Design:
    # A link may come from anyone: it opens no file of this machine.
    return design_of_text(str(text), "link")
