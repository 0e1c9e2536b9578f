"""Places of a design that a build can miss, tolerances as they are written, grades of a workshop.

Behind a real main lens the places are those of its drawing, as `lenses.manufacture` names them, after ``main_lens.``;
its focal length then follows.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from pydantic import BeforeValidator, Field, create_model, model_validator

from ..bore.chain import MEDIUM
from ..bore.conjugates import CONJUGATES, REFRACTING
from ..bore.elements import element_name
from ..bore.opening import DIAMETER
from ..bore.part import TEMPERATURE
from ..camera import BESIDE, VIEWING_CONDITIONS, Camera
from ..design import PATHS, Design
from ..design.parts import BEHIND
from ..errors import InputError, Problem
from ..lenses.glass import AIR
from ..lenses.tracer import MODES
from ..toml_files import PlainNumber, StrictTable, read_toml, validated
from ..units import FARTHEST, read_quantity, within_reach
from ..words import angle

Value = TypeVar("Value")

Aim = Literal["limits", "focus"]
"""Aim of an adjustment of each build: where the limits hold best, or where it is in focus as designed."""
FOCUSING = CONJUGATES[2]
"""Place of the part that usually focuses: the array, with the sensor behind it."""

SHORT = {"relay": "sensor.relay_magnification", "rotation": "microlens_array.rotation"}
"""Short names beside the paper's symbols."""
LENS = "main_lens."
"""Prefix of places in a real main lens."""
FOCAL_LENGTH = "main_lens.focal_length"
CALIBRATION = "calibration"
"""Name of the compensator that teaches the decoder each build instead of moving a part."""
LEFT = "compensators."
"""Prefix of places of what compensators leave: how far a part is set amiss, or depth of a calibrated decoder is off."""
LENSLETS, SAG = "microlens_array.lenslets.", "microlens_array.sag"
"""Prefix of places of single microlenses, those at a study's fields, and the place of their sag."""
MOST_LENSLETS = 9
"""Fields whose microlenses can be out of place on their own."""
BARE = {"ratio": '"0.3 %" or 0.003', "number": '0.0005 or "0.1 %"', "curvature": '"1e-5 /mm" or "0.1 %"'}
"""Kinds whose tolerances are not lengths or angles, and how they are written."""
SHOWN = {
    "number": (1.0, ""),
    "curvature": (1.0, " /mm"),
    "gradient": (1.0, " /mm"),
    "ratio": (100.0, " %"),
    "temperature": (1.0, " K"),
}
"""Kind to the factor and unit that deviations are shown with; lengths choose their own."""
FORMS = dict(
    zip("0123456", ("astig. 45", "astig. 0", "coma y", "coma x", "trefoil y", "trefoil x", "spherical"), strict=True)
)
"""Names of the modes of a surface's irregularity, by digit."""
SHIPPED = Path(__file__).with_name("grades.toml")
"""The grades that ship: makers' charts and engineering judgement, to be replaced by a shop's own figures."""


def perturbable(design: Design) -> dict[str, str]:
    """Every place of a design that a build can miss.

    Returns
    -------
    dict
        Dotted place to what it measures: "length", "angle", "ratio", "number" (an index), "gradient" or "temperature";
        in a real lens also "curvature".
    """
    built = [place for place in Camera.of(design).numbers if place not in BESIDE and place not in VIEWING_CONDITIONS]
    kinds = {place: _kind(place) for place in built if ".size." not in place}
    lenslets = [f"{LENSLETS}{field}.decentre.{axis}" for field in range(MOST_LENSLETS) for axis in (0, 1)]
    kinds |= dict.fromkeys([*lenslets, *([SAG] if _lenslet_sag(design) else [])], "length")
    lens = design.main_lens.kind
    kinds = {place: kind for place, kind in kinds.items() if place not in lens.follows}
    kinds |= {LENS + place: kind for place, kind in lens.places.items()}
    return kinds | {LEFT + place: kind for place, kind in (*kinds.items(), (CALIBRATION, "length"))}


def _kind(place: str) -> str:
    if place == TEMPERATURE:
        return "temperature"
    if place.endswith("relay_magnification"):
        return "ratio"
    if place.endswith((".index", ".gradient")):
        return "number" if place.endswith(".index") else "gradient"
    return "angle" if ".tilt." in place or ".wedge." in place or place.endswith(("rotation", ".turn")) else "length"


@lru_cache(maxsize=64)
def nominal_values(design: Design) -> Mapping[str, float]:
    """The design's own number at every perturbable place; f, d_f and d_1 all resolved."""
    numbers = {place: float(number) for place, number in Camera.of(design).numbers.items()}
    numbers |= {SAG: _lenslet_sag(design)}
    own = design.main_lens.kind.values(design.wavelength)
    numbers |= {LENS + place: value for place, value in own.items()}
    return {place: numbers.get(place, 0.0) for place in perturbable(design)}


def _lenslet_sag(design: Design) -> float:
    """Sag of a microlens across its pitch, ``d^2/(8 (n - 1) f_ml)`` [mm]; 0 where nothing says what it is made of."""
    glass = design.microlens_array.made_of
    return 0.0 if glass is None else design.d**2 / (8 * (float(glass.index(design.wavelength)) - 1) * design.f_ml)


def of_parts(design: Design, values: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of builds as parts have them: a sag told as focal length; of microlenses and compensators none."""
    parts = {p: value for p, value in values.items() if not p.startswith((LENSLETS, LEFT)) and p != SAG}
    if SAG in values:
        parts[PATHS["f_ml"]] = parts.get(PATHS["f_ml"], design.f_ml) * (_lenslet_sag(design) / values[SAG])
    return parts


def stops_of(design: Design) -> tuple[str, ...]:
    """Places of the FAP and the further stops."""
    return tuple(stop.place for stop in design.openings)


def in_lens(place: str) -> bool:
    """Whether a place is of a real lens's surfaces or elements."""
    return place.startswith((f"{LENS}surfaces.", f"{LENS}elements."))


def of_lens(values: Mapping[str, Value]) -> dict[str, Value]:
    """Values of a real lens's own surfaces and elements, named as in `lenses.manufacture`."""
    return {place.removeprefix(LENS): value for place, value in values.items() if in_lens(place)}


def expand(design: Design, name: str) -> tuple[str, ...]:
    """Places that a name in a study means.

    Parameters
    ----------
    design : Design
        Whose places.
    name : str
        A dotted place (with a part's name or number, "elements.relay.distance"), a paper's symbol ("d_3"), a pair
        without its index ("aperture.decentre": x and y), or a pattern ("stops.*.diameter": every further stop, of a
        rectangle its sides; "elements.*.thickness", "main_lens.surfaces.*.radius": every element or surface that has
        one).

    Raises
    ------
    ValueError
        Nothing is called that; the message names the nearest.
    """
    name = design.place_named(SHORT.get(name, name))
    if name == BEHIND and design.aperture.behind is not None:  # it counts in the other direction, and misses alike
        name = PATHS["d_3"]
    known = [place for place in perturbable(design) if not place.startswith(LEFT)]
    places = _matching(known, name)
    if name.endswith(f".{DIAMETER}") and not in_lens(name):  # a rectangle is made as wide as it is by its sides
        places += _matching(known, f"{name.removesuffix(DIAMETER)}sides")
    if places or (name.startswith("stops.*.") and not design.stops):
        return places
    if "*" in name and in_lens(name):
        parts = sorted({re.sub(r"\.\d$", "", p.split(".", 3)[3]) for p in known if in_lens(p)})
        if not parts or name.rpartition("*.")[2] in ("radius", "conic", "abbe", "wedge"):
            return ()  # not every lens has them
        raise ValueError(f"'{name}' is nothing that a lens's making can miss; there are {', '.join(parts)}")
    if name == FOCAL_LENGTH:
        raise ValueError(
            "'main_lens.focal_length' follows from the real lens's surfaces; perturb main_lens.surfaces.*.radius, "
            ".thickness and .index instead"
        )
    if in_lens(name) and not design.main_lens.kind.places:
        raise ValueError(f"'{name}' is of a real lens and this design's is ideal; perturb main_lens.focal_length")
    if name == TEMPERATURE:
        raise ValueError("the design says nothing of what grows; add [environment] to it, with temperature and housing")
    pairs = [*known, *(place[:-2] for place in known if place.endswith(".0"))]
    names = [*map(design.chain.called, pairs), *PATHS, *SHORT]
    near = difflib.get_close_matches(name, names, 1, 0.4)
    remedy = f"known are {', '.join(PATHS)} and dotted places such as aperture.tilt"
    remedy = f"did you mean '{near[0]}'?" if near else remedy
    raise ValueError(f"'{name}' is not a number of this design that a build can miss; {remedy}")


def _matching(known: Iterable[str], name: str) -> tuple[str, ...]:
    pattern = re.compile(re.escape(name).replace(r"\*", r"\d+") + r"(\.\d)?")
    return tuple(place for place in known if pattern.fullmatch(place))


def focus_fault(aim: Aim, names: Iterable[str], design: Design | None = None) -> str:
    """Words on what cannot be moved to the focus among places or their symbols; empty where nothing is wrong."""
    others = [name for name in names if not _focuses(PATHS.get(name, name), design)]
    if aim != "focus" or not others:
        return ""
    able = f"{FOCUSING} (d_1), the sensor going along, or by the distance of a lens in the bore"
    return f"'focus' is set by {able}, not by {others[0]}; name one of these, or leave out aim"


def _focuses(place: str, design: Design | None) -> bool:
    """Whether moving it moves the focus, of a design that is known."""
    element = re.fullmatch(r"elements\.(\d+)\.distance", place)
    if element is None or design is None:
        return element is not None or place == FOCUSING
    return design.elements[int(element[1])].bends


def short_name(place: str, design: Design | None = None) -> str:
    """Short name of a place on a figure or in a table: "d_3", "FAP decentre x", "MLA rotation", "plate 1 wedge x".

    Without the design stops and elements before the main lens go by their number alone.
    """
    symbols = {path: symbol for symbol, path in PATHS.items() if symbol not in ("q", "wavelength")}
    if place.startswith(LEFT):
        set_amiss = place.removeprefix(LEFT)
        return "depth as calibrated" if set_amiss == CALIBRATION else f"{short_name(set_amiss, design)} as set"
    if place in symbols:
        return symbols[place]
    part, _, rest = place.partition(".")
    if place == TEMPERATURE:
        return rest
    if part == "stops":
        index, _, rest = rest.partition(".")
        number = int(index) + 1
        part = f"stop {number}" if design is None else design.stops[number - 1].called(number)
    if part == "elements":
        index, _, rest = rest.partition(".")
        number = int(index)
        part = f"element {number + 1}" if design is None else element_name(design.elements[number], number + 1)
    if place.startswith(LENSLETS):
        part, (_, field, rest) = "microlens", rest.split(".", 2)
        part = f"{part} of field {field}"
    if rest.startswith(("cover.", "substrate.")):
        part, _, rest = rest.partition(".")
    if in_lens(place):
        part, index, rest = rest.split(".", 2)
        part = f"{part.removesuffix('s')} {index}"
    names = {"main_lens": "lens", "aperture": "FAP", "microlens_array": "MLA", "object_space": "medium"}
    axes = FORMS if ".irregularity." in place else {"0": "x", "1": "y"}
    words = [axes.get(word, word.replace("_", " ")) for word in rest.split(".")]
    return " ".join([names.get(part, part), *words]).replace("sensor relay magnification", "relay magnification")


def display(value: float, kind: str) -> str:
    """A deviation in the unit it reads best in, to three digits: "20 um", "0.05 mm", "3 mrad", "1.2 %", "0.0005"."""
    if not math.isfinite(value):
        return "any"
    value = value if abs(value) > 1e-10 else 0.0  # rounding, where parts touch
    if kind == "angle":
        return angle(value)
    if kind not in ("length", "form"):
        scale, unit = SHOWN[kind]
        return f"{scale * value:.3g}{unit}"
    size = abs(value)
    if size and size < 1e-3:
        return f"{1e6 * value:.3g} nm"
    return f"{1e3 * value:.3g} um" if size < 0.1 else f"{value:.3g} mm"


FRINGE = 546.07e-6 / 2
"""Sag of one fringe spacing of ISO 10110-5, half a wavelength of the green mercury line [mm]."""
PEAKS = {"asymmetric": 2 * math.sqrt(8), "symmetric": 1.5 * math.sqrt(5)}
"""Peak to valley of a mode of unit rms: of coma and trefoil (astigmatism has less), of spherical aberration."""
_NUMBER = r"(\d+(?:\.\d*)?|\.\d+|-)"
_ISO = re.compile(rf"3/\s*{_NUMBER}?\s*(?:\(\s*{_NUMBER}\s*(?:/\s*{_NUMBER}\s*)?\))?\s*(?:RMSi\s*<\s*{_NUMBER})?\s*")


class _FormTolerance(NamedTuple):
    """Form tolerance of a surface by ISO 10110-5, ``3/A(B/C) RMSi < D``, in fringes; None where not stated."""

    power: float | None
    """A: of the sagitta."""
    irregularity: float | None
    """B, peak to valley."""
    symmetric: float | None
    """C: the part of it that is symmetric about the axis."""
    rms: float | None
    """D: of the irregularity."""

    @classmethod
    def of(cls, text: str) -> _FormTolerance:
        """Read such a text.

        Raises
        ------
        ValueError
        """
        match = _ISO.fullmatch(text.strip())
        if match is None or not any(match.groups()):
            message = (
                f'cannot read "{text}"; write ISO 10110-5 as "3/1(0.5/0.2)", "3/-(0.5)", "3/- RMSi < 0.1", or "30 nm"'
            )
            raise ValueError(message)
        return cls(*(None if part in (None, "-") else float(part) for part in match.groups()))

    def mode(self, number: int) -> float | None:
        """Largest rms sag of a Zernike mode, 0 to 6 [mm].

        The least of what B (six modes without symmetry share it, peaks added in quadrature), C (the mode with) and D
        (all seven share it) leave; None where none of them says anything.
        """
        symmetric = number == MODES - 1
        peaks = self.symmetric if symmetric else self.irregularity
        share = PEAKS["symmetric"] if symmetric else PEAKS["asymmetric"] * math.sqrt(MODES - 1)
        if symmetric and peaks is None:
            peaks = self.irregularity  # which it is part of
        each = [] if peaks is None else [peaks * FRINGE / share]
        each += [] if self.rms is None else [self.rms * FRINGE / math.sqrt(MODES)]
        return min(each) if each else None


def tolerance_at(design: Design, place: str, text: object) -> float:
    """Half-width of a tolerance at a place of a design, in the design's units; texts as for `parse_tolerance`.

    Of a surface's form ISO 10110-5 is read as well, its A at a curvature, or an rms sag of the whole irregularity.

    Raises
    ------
    ValueError
        Not readable there, not finite, negative, or percent of a nominal zero.
    """
    kind, nominal = perturbable(design)[place], nominal_values(design)[place]
    iso = _FormTolerance.of(text) if isinstance(text, str) and text.strip().startswith("3/") else None
    if iso is None:
        width = parse_tolerance(text, "length" if kind == "form" else kind, nominal)
        return width / math.sqrt(MODES) if kind == "form" else width
    if kind == "form":
        half_width = iso.mode(int(place.rpartition(".")[2]))
    elif kind == "curvature":
        reach = design.main_lens.kind.semi_diameters[int(place.split(".")[2]) - 1]
        half_width = None if iso.power is None else 2 * iso.power * FRINGE / reach**2
    else:
        raise ValueError(f'"{text}" is of a surface\'s form; {place} is none: write e.g. "1 %"')
    if half_width is None:
        lacking = "irregularity: give B, C or D" if kind == "form" else "power: give A"
        raise ValueError(f'"{text}" says nothing of the {lacking}, as in "3/1(0.5/0.2)"')
    return half_width


def parse_tolerance(text: object, kind: str, nominal: float) -> float:
    """Half-width of a tolerance in the design's units.

    Parameters
    ----------
    text : object
        "0.05 mm", "3 mrad", or percent of the nominal value: "1 %". A ratio or a number takes percent or a bare number,
        a curvature "1e-5 /mm".
    kind : {"length", "angle", "ratio", "number", "gradient", "temperature", "curvature"}
        What the place measures.
    nominal : float
        The design's value there.

    Raises
    ------
    ValueError
        Not readable, not finite, negative, or percent of a nominal zero.
    """
    if isinstance(text, str) and text.strip().endswith("%"):
        if kind == "temperature":
            raise ValueError(f'"{text}" of a temperature means nothing; write e.g. "10 K"')
        try:
            share = float(text.strip()[:-1])
        except ValueError:
            raise ValueError(f'cannot read "{text}"; write e.g. "1 %"') from None
        if nominal == 0:
            raise ValueError(f'"{text}" of a nominal value of zero is always zero; give an absolute tolerance')
        value = abs(nominal) * share / 100
    elif kind in BARE:
        bare = text.strip().removesuffix("/mm").strip() if kind == "curvature" and isinstance(text, str) else text
        try:
            value = float(bare)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            raise ValueError(f"{text!r} is not a {kind}; write e.g. {BARE[kind]}") from None
    else:
        value = read_quantity(text, "temperature difference" if kind == "temperature" else kind)
    if not math.isfinite(value) or value < 0:
        raise ValueError(f'"{text}" must be a finite half-width that is not negative')
    return within_reach(value, kind, text) if kind in FARTHEST else value


class GradeLine(NamedTuple):
    """Tolerances of one place in every grade."""

    place: str
    """Dotted place, pair or pattern."""
    tolerances: tuple[str, ...]
    """Texts of the tolerance, one a grade, e.g. "1 %"."""
    provenance: str
    """Source of the figures."""
    costs: tuple[float, ...]
    """Cost of one such part in every grade; differences count."""


_Cost = Annotated[PlainNumber, Field(ge=0)]


class _AdjustmentLine(StrictTable):
    """A part that could be adjusted on each build, or "calibration" of the decoder, and what that costs."""

    place: str
    aim: Aim = "limits"
    """As of a study's compensator."""
    range: str = ""
    """How far it can be moved either way; empty for calibration, and of a focus for what builds ask, up to half of the
    place's length."""
    cost: _Cost
    provenance: str

    @model_validator(mode="after")
    def _focuses(self) -> _AdjustmentLine:
        if fault := focus_fault(self.aim, (self.place,)):
            raise ValueError(fault)
        return self


@dataclass(frozen=True)
class Grades:
    """A table of grades."""

    names: tuple[str, ...]
    """Names of the grades, from loose to tight."""
    meanings: tuple[str, ...]
    """Meanings of the grades, one sentence each."""
    lines: tuple[GradeLine, ...]
    adjustments: tuple[_AdjustmentLine, ...] = ()

    def line_of(self, design: Design, place: str) -> tuple[GradeLine, tuple[float, ...]] | None:
        """The line that speaks of a place, and its half-widths there in every grade; None where none does."""
        lines = [line for line in self.lines if place in _covered(design, line.place)]
        if not lines:
            return None
        return lines[-1], tuple(tolerance_at(design, place, text) for text in lines[-1].tolerances)

    def tolerances(self, grade: str, design: Design) -> dict[str, float]:
        """Half-widths, to one of the grades, at every place of a design that the table speaks of.

        Raises
        ------
        InputError
            A text that is no tolerance of its place.
        """
        column = self.names.index(grade)
        widths, problems = {}, []
        for line in self.lines:
            try:
                for place in _covered(design, line.place):
                    widths[place] = tolerance_at(design, place, line.tolerances[column])
            except ValueError as error:
                problems.append(Problem(f"{line.place}.{grade}", str(error)))
        if problems:
            raise InputError(tuple(problems), "grades")
        return widths

    def provenance(self, design: Design) -> dict[str, str]:
        """Place to the words on where its line comes from."""
        return {place: line.provenance for line in self.lines for place in _covered(design, line.place)}


def _covered(design: Design, place: str) -> tuple[str, ...]:
    """Places of a design that a line speaks of; a real lens's focal length and air's index are none of its own."""
    if place.startswith(LEFT):
        adjusted = place.removeprefix(LEFT)
        return tuple(LEFT + one for one in ((adjusted,) if adjusted == CALIBRATION else expand(design, adjusted)))
    if place.startswith(REFRACTING):
        return () if place == MEDIUM and design.object_space.medium == AIR else _matching(perturbable(design), place)
    lens = design.main_lens.kind
    idle = place in lens.follows or (in_lens(place) and not lens.places)
    return () if idle else expand(design, place)


def load_grades(path: Path = SHIPPED) -> Grades:
    """Read a table of grades.

    Raises
    ------
    InputError
        Every fault of the file: no grades, a line without its place, a value for each grade or its provenance, costs
        that are not one number a grade.
    """
    data = read_toml(path, str(path))
    names = data.get("grades")
    if not isinstance(names, dict) or not names:
        raise InputError((Problem("grades", 'is missing; list them as [grades] with name = "meaning"'),), str(path))
    file = validated(_grades_file(tuple(names)), data, str(path))
    lines = (
        GradeLine(line.place, tuple(getattr(line, key) for key in _grade_keys(names)), line.provenance, line.cost)
        for line in file.line
    )
    return Grades(tuple(file.grades), tuple(file.grades.values()), tuple(lines), file.adjustment)


def _grade_keys(names: Collection[str]) -> list[str]:
    return [f"grade_{index}" for index in range(len(names))]


def _tolerance_text(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise ValueError(f'must be text such as "1 %", got {value!r}')
    return str(value)


@lru_cache(maxsize=8)
def _grades_file(names: tuple[str, ...]) -> Any:
    """Model of a file with grades of these names: each of its lines has a tolerance in every one."""
    usual = tuple(float(step) for step in range(len(names)))
    cost = Field(default=usual, min_length=len(names), max_length=len(names), examples=[usual])
    text = Annotated[str, BeforeValidator(_tolerance_text)]
    grades: dict[str, Any] = {
        key: (text, Field(alias=name)) for key, name in zip(_grade_keys(names), names, strict=True)
    }
    tail: dict[str, Any] = {"provenance": (str, ...), "cost": (tuple[_Cost, ...], cost)}
    line = create_model("GradeTable", __base__=StrictTable, place=(str, ...), **grades, **tail)
    return create_model(
        "GradesFile",
        __base__=StrictTable,
        grades=(dict[str, str], ...),
        line=(tuple[line, ...], ()),
        adjustment=(tuple[_AdjustmentLine, ...], ()),
    )
