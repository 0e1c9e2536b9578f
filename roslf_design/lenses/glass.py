"""Optical materials: refractive index from Sellmeier or Schott coefficients, refused outside the measured range.

Indices are relative to air at 20 degrees C, so air is 1 exactly at every wavelength; what a source of the catalogue
that ships (`glasses.toml`) gives against vacuum is converted. An unknown glass is an error, never a guess.
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
from ..units import format_quantity, parse_quantity

Array = NDArray[np.float64]

COEFFICIENTS = {"sellmeier": ("b", "c"), "schott": ("a",), "abbe": ("index", "abbe"), "constant": ("index",)}
"""The keys of a glass table that hold its formula's coefficients."""
F_LINE, D_LINE, C_LINE = 0.4861327, 0.5875618, 0.6562725
"""Wavelengths of Abbe numbers [um]."""


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
    """

    name: str
    formula: str
    coefficients: tuple[float, ...]
    shortest: float = 0.0
    longest: float = np.inf
    source: str = ""
    offset: float = 0.0
    against: str = "air"

    def index(self, wavelength: ArrayLike) -> Array:
        """Refractive index relative to air.

        Parameters
        ----------
        wavelength : array_like
            In air [mm].

        Returns
        -------
        ndarray
            Same shape.

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
        return self.offset + (index / _air(length * 1e3) if self.against == "vacuum" else index)

    def with_offset(self, change: float) -> Glass:
        """The same glass with its index raised by `change`."""
        return replace(self, offset=self.offset + change)


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


def _air(micrometres: Array) -> Array:
    """Index of air at 20 degrees C and 1013.25 hPa against vacuum: Kohlrausch's formula, as in SCHOTT's TIE-19."""
    square = micrometres * micrometres
    at_15 = 6432.8 + 2949810 * square / (146 * square - 1) + 25540 * square / (41 * square - 1)
    return np.asarray(1 + at_15 * 1e-8 / (1 + 5 * 3.4785e-3))


AIR = Glass("air", "constant", (1.0,))
"""Index 1: the catalogue's indices are relative to it."""


@cache
def catalogue() -> Mapping[str, Glass]:
    """Every glass that ships, by its upper-case name and its other names."""
    data = tomllib.loads(files(__package__).joinpath("glasses.toml").read_text("utf-8"))
    glasses = {"AIR": AIR}
    for name, table in data["glasses"].items():
        entries = {key: value for key, value in table.items() if key not in ("also", "nd", "vd")}
        glass, problems = read_glass(name, {**entries, "source": data["sources"][table["source"]]})
        if glass is None:
            raise InputError(problems, "glasses.toml")
        for spelling in (name, *table.get("also", ())):
            glasses[spelling.upper()] = glass
    return glasses


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
    remedy = "check the spelling, or describe it: {index = 1.5, abbe = 60} in a design, [glasses] in a lens file"
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
        ``source``, and ``against = "vacuum"`` where it is that to which the coefficients are relative.
    """
    formula = table.get("formula")
    if formula not in COEFFICIENTS:
        known = ", ".join(COEFFICIENTS)
        return None, (Problem("formula", f"{formula!r} is not a known formula; write one of {known}"),)
    needed = COEFFICIENTS[formula]
    allowed = ("formula", "source", "range", "against", *needed)
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
    problems += faults
    if problems:
        return None, tuple(problems)
    coefficients = tuple(v for pair in zip(*columns, strict=True) for v in pair) if len(columns) == 2 else columns[0]
    glass = Glass(name, formula, coefficients, *bounds, str(table.get("source", "")), against=str(against))
    ends = np.linspace(*bounds, 9) * 1e3 if np.isfinite(bounds[1]) else np.ones(1)
    with np.errstate(all="ignore"):
        real = _index(formula, coefficients, ends[ends > 0])
    if not np.all((real >= 1) & (real < 5)):
        message = f"give an index from {np.min(real):.3g} to {np.max(real):.3g} in the range; check them and the range"
        return None, (Problem(needed[0], message),)
    return glass, ()


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and bool(np.isfinite(value))


def _read_range(value: object, formula: str) -> tuple[tuple[float, float], list[Problem]]:
    if value is None and formula == "constant":
        return (0.0, np.inf), []
    if not isinstance(value, list) or len(value) != 2:
        return (0.0, 0.0), [Problem("range", f'must be two wavelengths such as ["0.35 um", "2.5 um"], got {value!r}')]
    try:
        low, high = (parse_quantity(end, "length") for end in value)
    except ValueError as error:
        return (0.0, 0.0), [Problem("range", str(error))]
    if not 0 <= low < high:
        return (0.0, 0.0), [Problem("range", f"{value!r} must be two rising wavelengths")]
    return (low, high), []
