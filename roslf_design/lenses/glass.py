"""Optical materials: refractive index from Sellmeier or Schott coefficients, refused outside the measured range.

Indices are relative to air of the glass's own temperature, so air is 1 exactly at every wavelength; what a source of
`glasses.toml` gives against vacuum is converted. An unknown glass is an error, never a guess.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, Problem
from ..units import format_quantity, read_quantity

Array = NDArray[np.float64]

COEFFICIENTS = {"sellmeier": ("b", "c"), "schott": ("a",), "abbe": ("index", "abbe"), "constant": ("index",)}
"""The keys of a glass table that hold its formula's coefficients."""
WARMING_KEYS = ("cte", "dndt", "warming_source")
MOST_EXPANSION = 1e-2
"""No solid grows faster [1/K]."""
MOST_WARMED = 0.5
"""No temperature of a camera moves an index by more: it is the law that ends."""
ROOM = 20.0
"""Temperature of the catalogue's indices [degrees C]."""
F_LINE, D_LINE, C_LINE = 0.4861327, 0.5875618, 0.6562725
"""Wavelengths of Abbe numbers [um]."""


@dataclass(frozen=True)
class Warming:
    """Warming of a medium: its expansion, and how its index follows temperature.

    Attributes
    ----------
    expansion : float
        Linear, of lengths [1/K]; 0 of liquids, which fill what room there is.
    law : {"schott", "rate", "water", "none"}
        How the index follows: by Schott's dispersion formula of dn/dT (TIE-19); at a constant rate; as liquid water
        does; not known.
    coefficients : tuple of float
        ``(D0, D1, D2, E0, E1, lambda_TK [um])``, or ``(dn/dT,)`` [1/K].
    against : {"air", "vacuum"}
        What a constant rate is relative to.
    coldest, hottest : float
        For which it holds [degrees C].
    source : str
    """

    expansion: float = 0.0
    law: str = "none"
    coefficients: tuple[float, ...] = ()
    against: str = "air"
    coldest: float = -np.inf
    hottest: float = np.inf
    source: str = ""


WARMING = {"schott": (-100.0, 140.0), "water": (0.0, 150.0)}
"""Range of laws [degrees C]: SCHOTT TIE-19; Kell's density of water."""
NOT_KNOWN = Warming()


@dataclass(frozen=True)
class Glass:
    """A medium and its dispersion.

    Attributes
    ----------
    name : str
        As the catalogue spells it.
    formula : {"sellmeier", "schott", "constant", "abbe"}
        ``n^2 = 1 + sum b_i L^2/(L^2 - c_i)``; ``n^2 = a_0 + a_1 L^2 + a_2 L^-2 + a_3 L^-4 + ...``; ``n``; or, from
        index n_d and Abbe number V, ``n_d + (n_d - 1)/V (L^-2 - L_d^-2)/(L_F^-2 - L_C^-2)``.
    coefficients : tuple of float
        ``(b_1, c_1, b_2, c_2, ...)``, ``(a_0, a_1, ...)``, ``(n,)`` or ``(n_d, V)``, for L in micrometres.
    shortest, longest : float
        Wavelength range of the source [mm].
    source : str
        Where the coefficients come from.
    offset : float
        Added to the index: a melt's departure from the catalogue, for tolerancing.
    against : {"air", "vacuum"}
        What the coefficients are relative to; the index always is to air.
    warming : Warming
        What temperature does to it.
    temperature : float
        Which it has [degrees C].
    """

    name: str
    formula: str
    coefficients: tuple[float, ...]
    shortest: float = 0.0
    longest: float = np.inf
    source: str = ""
    offset: float = 0.0
    against: str = "air"
    warming: Warming = NOT_KNOWN
    temperature: float = ROOM

    def index(self, wavelength: ArrayLike, temperature: ArrayLike | None = None) -> Array:
        """Refractive index relative to air of the same temperature.

        Parameters
        ----------
        wavelength : array_like
            In air [mm].
        temperature : array_like, optional
            Another than the glass's own [degrees C].

        Returns
        -------
        ndarray
            Shape of both together.

        Raises
        ------
        InputError
            A wavelength outside [shortest, longest], or not finite.
        """
        length = np.asarray(wavelength, float)
        outside = ~((length >= self.shortest) & (length <= self.longest) & np.isfinite(length) & (length > 0))
        if np.any(outside):
            bad = float(length[outside].flat[0])
            text = format_quantity(bad, "length") if np.isfinite(bad) else str(bad)
            longest = format_quantity(self.longest, "length") if np.isfinite(self.longest) else "any length"
            known = f"{format_quantity(self.shortest, 'length')} to {longest}"
            message = f"{text} is outside the range of {self.name} ({known}); choose a wavelength inside it"
            raise InputError((Problem("wavelength", message),))
        index = _index(self.formula, self.coefficients, length * 1e3)
        index = self.offset + (index / _air(length * 1e3) if self.against == "vacuum" else index)
        warm = np.asarray(self.temperature if temperature is None else temperature)
        if self.warming.law == "none" or np.all(warm == ROOM):
            return index + np.zeros(warm.shape) if warm.ndim else index
        with np.errstate(all="ignore"):  # at the resonance of a law it has no value, which is told
            warmed = _warmed(self.warming, index, length * 1e3, warm)
        if not np.all(abs(warmed - index) < MOST_WARMED):
            message = f"{self.name} has no index at its temperature there: its dn/dT is as at a resonance; mend it"
            raise InputError((Problem("dndt", message),))
        return warmed

    def with_offset(self, change: float) -> Glass:
        """Glass with its index raised by `change`."""
        return replace(self, offset=self.offset + change)

    def at(self, temperature: float) -> Glass:
        """Glass at a temperature [degrees C]; itself where nothing is known of its index."""
        known = self.warming.law != "none" and temperature != self.temperature
        return replace(self, temperature=temperature) if known else self

    def grown(self, before: ArrayLike, after: ArrayLike) -> Array:
        """A length at temperature `after` over the same at `before` [degrees C]."""
        return growth(self.warming.expansion, before, after)


def _index(formula: str, coefficients: tuple[float, ...], micrometres: Array) -> Array:
    if formula == "constant":
        return np.full(micrometres.shape, coefficients[0])
    square = micrometres * micrometres
    if formula == "abbe":
        index, number = coefficients
        step = (1 / square - D_LINE**-2) / (F_LINE**-2 - C_LINE**-2)
        return np.asarray(index + (index - 1) / number * step)
    if formula == "sellmeier":
        total = np.ones(square.shape)
        for b, c in zip(coefficients[::2], coefficients[1::2], strict=True):
            total = total + b * square / (square - c)
    else:
        total = coefficients[0] + coefficients[1] * square
        for power, a in enumerate(coefficients[2:], start=1):
            total = total + a / square**power
    return np.asarray(np.sqrt(total))


def growth(expansion: ArrayLike, before: ArrayLike, after: ArrayLike) -> Array:
    """A length at one temperature over the same at another [degrees C], at a rate of its length at `ROOM` [1/K]."""
    rate = np.asarray(expansion, float)
    return np.asarray((1 + rate * (np.asarray(after) - ROOM)) / (1 + rate * (np.asarray(before) - ROOM)))


def _warmed(warming: Warming, index: Array, micrometres: Array, temperature: Array) -> Array:
    """Index relative to air at a temperature, from that at `ROOM`."""
    step = temperature - ROOM
    if warming.law == "rate" and warming.against == "air":
        return np.asarray(index + warming.coefficients[0] * step)
    if warming.law == "rate":
        change = warming.coefficients[0] * step
    elif warming.law == "water":
        change = water_index(micrometres, temperature) - water_index(micrometres, np.asarray(ROOM))
    else:
        d0, d1, d2, e0, e1, resonance = warming.coefficients
        bound = (e0 + e1 * step) / (micrometres * micrometres - resonance * resonance)
        change = (index * index - 1) / (2 * index) * step * (d0 + step * (d1 + step * d2) + bound)
    return np.asarray((index * _air(micrometres) + change) / _air(micrometres, temperature))


def water_index(micrometres: Array, temperature: Array) -> Array:
    """Index of liquid water against vacuum at a temperature [degrees C]; the range of `WARMING`.

    IAPWS R9-97 with the density at 1 atm by G. S. Kell, J. Chem. Eng. Data 20, 97 (1975), boiling or not.
    """
    t = temperature
    cubic = 46.170461e-6 - t * (105.56302e-9 - 280.54253e-12 * t)
    grams = (999.83952 + t * (16.945176 - t * (7.9870401e-3 + t * cubic))) / (1 + 16.879850e-3 * t)
    density, warmth = grams / 1000, (t + 273.15) / 273.15
    square = np.square(micrometres / 0.589)
    bound = 1.58920570e-3 / square + 2.45934259e-3 / (square - 0.2292020**2) + 0.900704920 / (square - 5.432937**2)
    bound = bound + 0.244257733 + 9.74634476e-3 * density - 1.66626219e-2 * density * density
    bound = density * (bound - 3.73234996e-3 * warmth + 2.68678472e-4 * square * warmth)
    return np.asarray(np.sqrt((1 + 2 * bound) / (1 - bound)))


def _air(micrometres: Array, temperature: ArrayLike = ROOM) -> Array:
    """Index of air at 1013.25 hPa against vacuum: Kohlrausch's formula, as in SCHOTT's TIE-19."""
    square = micrometres * micrometres
    at_15 = 6432.8 + 2949810 * square / (146 * square - 1) + 25540 * square / (41 * square - 1)
    return np.asarray(1 + at_15 * 1e-8 / (1 + (np.asarray(temperature) - 15) * 3.4785e-3))


AIR = Glass("air", "constant", (1.0,))
"""Index 1: the catalogue's indices are relative to it."""


@cache
def catalogue() -> Mapping[str, Glass]:
    """Every glass that ships, by its upper-case name and its other names."""
    data = tomllib.loads(files(__package__).joinpath("glasses.toml").read_text("utf-8"))
    glasses = {"AIR": AIR}
    for name, table in data["glasses"].items():
        entries = {key: value for key, value in table.items() if key not in ("also", "nd", "vd")}
        entries |= {key: data["sources"][entries[key]] for key in ("source", "warming_source") if key in entries}
        glass, problems = read_glass(name, entries)
        if glass is None:
            raise InputError(problems, "glasses.toml")
        for spelling in (name, *table.get("also", ())):
            glasses[spelling.upper()] = glass
    return glasses


def is_shipped(glass: Glass) -> bool:
    """Whether a glass is the one that ships under its name, at whatever temperature and of whatever melt."""
    return catalogue().get(glass.name.upper()) == replace(glass, temperature=ROOM, offset=0.0)


def find_glass(name: str, extra: Mapping[str, Glass] | None = None) -> Glass:
    """The glass of that name, in any case.

    Parameters
    ----------
    name : str
        Such as "N-BK7"; "air" and "" are air.
    extra : mapping, optional
        Glasses of the reader's own by upper-case name; they go first.

    Raises
    ------
    InputError
        Unknown; names the nearest one known.
    """
    known = {**catalogue(), **(extra or {})}
    if glass := known.get(name.strip().upper() or "AIR"):
        return glass
    near = difflib.get_close_matches(name.upper(), known, 1, 0.5)
    hint = f"the nearest known is '{known[near[0]].name}'" if near else f"known: {', '.join(sorted(known))}"
    remedy = "check the spelling, or describe it: {index = 1.5, abbe = 60}"
    raise InputError((Problem("glass", f"'{name}' is not a known glass; {hint}; {remedy}"),))


def glass_of_index(table: Mapping[str, Any]) -> Glass:
    """A medium from its ``index`` at 587.6 nm and, where it has one, its Abbe number ``abbe``.

    Raises
    ------
    InputError
        Other keys, an index outside 1 to 5, an Abbe number that is not positive.
    """
    problems = [Problem(key, f"'{key}' is not known of a material; known: index, abbe") for key in table
                if key not in ("index", "abbe")]  # fmt: skip
    index, number = table.get("index"), table.get("abbe")
    if not (_is_number(index) and 1 <= index < 5):  # type: ignore[operator]
        problems.append(Problem("index", f"an index must be a number from 1 to 5, got {index!r}"))
    if number is not None and not (_is_number(number) and number > 0):
        problems.append(Problem("abbe", f"an Abbe number must be positive, got {number!r}"))
    if problems:
        raise InputError(tuple(problems))
    name = f"n = {index:g}" + ("" if number is None else f", V = {number:g}")
    if number is None:
        return Glass(name, "constant", (float(index),))  # type: ignore[arg-type]
    return Glass(name, "abbe", (float(index), float(number)))  # type: ignore[arg-type]


def read_glass(name: str, table: Mapping[str, Any]) -> tuple[Glass | None, tuple[Problem, ...]]:
    """A glass from a table such as those of `glasses.toml`, or every fault in it.

    Parameters
    ----------
    name : str
        The glass's name.
    table : mapping
        ``formula``, its coefficients (``b`` and ``c``, ``a``, ``index`` and ``abbe``, or ``index``), ``range``,
        ``source``, and ``against = "vacuum"`` where it is that to which the coefficients are relative. Where known,
        ``cte`` [1/K], ``dndt`` (``{d = [D0, D1, D2], e = [E0, E1], lambda_tk}``, ``{rate}`` [1/K] with its own
        ``against``, or ``"water"``) and ``warming_source``.
    """
    formula = table.get("formula")
    if not isinstance(formula, str) or formula not in COEFFICIENTS:
        known = ", ".join(COEFFICIENTS)
        return None, (Problem("formula", f"{formula!r} is not a known formula; write one of {known}"),)
    needed = COEFFICIENTS[formula]
    allowed = ("formula", "source", "range", "against", *needed, *WARMING_KEYS)
    unknown = f"is not a known key of a {formula} glass; known: {', '.join(allowed)}"
    problems = [Problem(key, unknown) for key in table if key not in allowed]
    columns: list[tuple[float, ...]] = []
    for key in needed:
        values = [table.get(key)] if key in ("index", "abbe") else table.get(key)
        if not isinstance(values, list) or not values or not all(_is_number(value) for value in values):
            problems.append(Problem(key, f"must hold finite numbers (wavelengths in um), got {table.get(key)!r}"))
        else:
            columns.append(tuple(float(value) for value in values))
    if formula == "sellmeier" and len(columns) == 2 and len(columns[0]) != len(columns[1]):
        problems.append(Problem("c", f"has {len(columns[1])} numbers where b has {len(columns[0])}; pair them"))
    if formula == "schott" and columns and len(columns[0]) < 2:
        problems.append(Problem("a", "needs at least a_0 and a_1"))
    against = table.get("against", "air")
    if against not in ("air", "vacuum"):
        problems.append(Problem("against", f'must be "air" or "vacuum", got {against!r}'))
    bounds, faults = _read_range(table.get("range"), formula)
    warming, wrong = _read_warming(table)
    problems += faults + wrong
    if problems:
        return None, tuple(problems)
    coefficients = tuple(v for pair in zip(*columns, strict=True) for v in pair) if len(columns) == 2 else columns[0]
    source = str(table.get("source", ""))
    glass = Glass(name, formula, coefficients, *bounds, source, against=str(against), warming=warming)
    ends = np.linspace(*bounds, 9) * 1e3 if np.isfinite(bounds[1]) else np.ones(1)
    with np.errstate(all="ignore"):
        real = _index(formula, coefficients, ends[ends > 0])
    if not np.all((real >= 1) & (real < 5)):
        message = f"give an index from {np.min(real):.3g} to {np.max(real):.3g} in the range; check them and the range"
        return None, (Problem(needed[0], message),)
    return glass, ()


def _read_warming(table: Mapping[str, Any]) -> tuple[Warming, list[Problem]]:
    expansion, law, problems = table.get("cte", 0.0), table.get("dndt"), []
    if not (_is_number(expansion) and abs(expansion) < MOST_EXPANSION):
        message = f"must be a coefficient of linear expansion [1/K] such as 7.1e-6, got {expansion!r}"
        problems, expansion = [Problem("cte", message)], 0.0
    source = str(table.get("warming_source", ""))
    if law is None:
        return Warming(float(expansion), source=source), problems
    if law == "water":
        return Warming(float(expansion), "water", (), "vacuum", *WARMING["water"], source), problems
    rows = law if isinstance(law, Mapping) else {}
    rate, against = _row([rows.get("rate")], 1), rows.get("against", "air")
    if rows.keys() <= {"rate", "against"} and rate and abs(rate[0]) < 1 and against in ("air", "vacuum"):
        return Warming(float(expansion), "rate", (rate[0],), against, source=source), problems
    terms = (*_row(rows.get("d"), 3), *_row(rows.get("e"), 2), *_row([rows.get("lambda_tk")], 1))
    if rows.keys() == {"d", "e", "lambda_tk"} and len(terms) == 6:
        return Warming(float(expansion), "schott", terms, "vacuum", *WARMING["schott"], source), problems
    message = f"must be {{d = [D0, D1, D2], e = [E0, E1], lambda_tk = um}} or {{rate = -8.5e-5}} per K, got {law!r}"
    return NOT_KNOWN, [*problems, Problem("dndt", message)]


def _row(values: object, count: int) -> list[float]:
    right = isinstance(values, list) and len(values) == count and all(_is_number(value) for value in values)
    return [float(value) for value in values] if right else []  # type: ignore[attr-defined]


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and bool(np.isfinite(value))


def _read_range(value: object, formula: str) -> tuple[tuple[float, float], list[Problem]]:
    if value is None and formula in ("constant", "abbe"):
        return (0.0, np.inf), []
    if not isinstance(value, list) or len(value) != 2:
        return (0.0, 0.0), [Problem("range", f'must be two wavelengths such as ["0.35 um", "2.5 um"], got {value!r}')]
    try:
        low, high = (read_quantity(end, "length") for end in value)
    except ValueError as error:
        return (0.0, 0.0), [Problem("range", str(error))]
    if not 0 <= low < high:
        return (0.0, 0.0), [Problem("range", f"{value!r} must be two rising wavelengths")]
    return (low, high), []
