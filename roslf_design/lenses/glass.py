"""Optical materials: refractive index from Sellmeier or Schott coefficients, refused outside the measured range.

Indices are relative to air of the glass's own temperature, so air is 1 exactly at every wavelength; what a source of
`glasses.toml` gives against vacuum is converted. An unknown glass is an error, never a guess.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, Discriminator, Field, Tag, ValidationInfo, field_validator

from ..errors import InputError, Problem
from ..toml_files import TAG, PlainNumber, StrictTable, validated
from ..units import AnyLength, format_quantity

Array = NDArray[np.float64]

COEFFICIENTS = {"sellmeier": ("b", "c"), "schott": ("a",), "abbe": ("index", "abbe"), "constant": ("index",)}
"""The keys of a glass table that hold its formula's coefficients."""
MOST_EXPANSION = 1e-2
"""No solid grows faster [1/K]."""
MOST_WARMED = 0.5
"""No temperature of a camera moves an index by more: it is the law that ends."""
LIKE = 0.55
"""Likeness of letters from which a name may be another one, mistyped."""
USUAL = ("air", "water", "saline", "sapphire", "fused silica", "N-BK7", "PMMA")
"""Names that an error shows where none is like what was asked for."""
OTHERWISE = {
    "quartz": "fused silica", "suprasil": "fused silica", "corundum": "sapphire", "borosilicate": "N-BK7",
    "crown": "N-BK7", "flint": "F2", "plexiglas": "PMMA", "perspex": "PMMA", "lexan": "polycarbonate",
}  # fmt: skip
"""Other names of materials, or of what is nearest to them, which an error suggests and nothing takes for them."""
GASES = ("co2", "carbon dioxide", "nitrogen", "argon", "helium", "oxygen")
"""Gases, all of which air stands for."""
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

        Notes
        -----
        NaN at temperatures at which it is not known.
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
        within = (np.real(warm) >= self.warming.coldest) & (np.real(warm) <= self.warming.hottest)
        warmed = np.where(within, warmed, np.nan)[()]  # of builds beyond it, which are no cameras
        if not np.all(~within | (abs(warmed - index) < MOST_WARMED)):
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
        change = _water_index(micrometres, temperature) - _water_index(micrometres, np.asarray(ROOM))
    else:
        d0, d1, d2, e0, e1, resonance = warming.coefficients
        bound = (e0 + e1 * step) / (micrometres * micrometres - resonance * resonance)
        change = (index * index - 1) / (2 * index) * step * (d0 + step * (d1 + step * d2) + bound)
    return np.asarray((index * _air(micrometres) + change) / _air(micrometres, temperature))


def _water_index(micrometres: Array, temperature: Array) -> Array:
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
    data = tomllib.loads(Path(__file__).with_name("glasses.toml").read_text("utf-8"))
    glasses = {"AIR": AIR}
    for name, table in data["glasses"].items():
        entries = {key: value for key, value in table.items() if key not in ("also", "nd", "vd")}
        entries |= {key: data["sources"][entries[key]] for key in ("source", "warming_source") if key in entries}
        glass = read_glass({"name": name, **entries})
        for spelling in (name, *table.get("also", ())):
            glasses[spelling.upper()] = glass
    return glasses


def is_shipped(glass: Glass) -> bool:
    """Whether a glass is the one that ships under its name, at whatever temperature and of whatever melt."""
    return catalogue().get(glass.name.upper()) == replace(glass, temperature=ROOM, offset=0.0)


def find_glass(name: str) -> Glass:
    """The glass of that name, such as "N-BK7", in any case; "air" and "" are air.

    Raises
    ------
    InputError
        Unknown; names the nearest one known.
    """
    known = catalogue()
    if glass := known.get(name.strip().upper() or "AIR"):
        return glass
    if any(gas in name.lower() for gas in GASES):
        message = f"'{name}' is not a known glass; of a gas give \"air\", whose index is within 3e-4 of its own"
        raise InputError((Problem("", message),))
    near = [known[one].name if one in known else one for one in likely(name, known)]
    hint = f"the nearest known is {' or '.join(map(repr, dict.fromkeys(near)))}"
    hint = hint if near else f"known are {', '.join(USUAL)} and others: `roslf catalogue` ends with all of them"
    remedy = "check the spelling, or describe it: {index = 1.5, abbe = 60}"
    raise InputError((Problem("", f"'{name}' is not a known glass; {hint}; {remedy}"),))


def likely(name: str, known: Iterable[str]) -> list[str]:
    """Names, at most two, that someone may mean by one that is not known: as trades call it, or spelt alike."""
    meant = [glass for called, glass in OTHERWISE.items() if called in name.lower()]
    alike = {one.lower(): one for one in known}
    return meant[:1] or [alike[one] for one in difflib.get_close_matches(name.lower(), alike, 2, LIKE)]


_Side = Literal["air", "vacuum"]
_Numbers = Annotated[tuple[PlainNumber, ...], Field(min_length=1)]
_Span = Annotated[tuple[AnyLength, AnyLength], Field(examples=[["0.35 um", "2.5 um"]])]


class _Rate(StrictTable, defer_build=True):
    """Change of index with temperature at a constant rate."""

    rate: Annotated[PlainNumber, Field(gt=-1, lt=1)]
    against: _Side = "air"

    def law(self) -> tuple[str, tuple[float, ...], str]:
        """Law, coefficients and what they are relative to, as `Warming` has them."""
        return "rate", (self.rate,), self.against


class _SchottRate(StrictTable, defer_build=True):
    """Change of index with temperature by Schott's formula."""

    d: tuple[PlainNumber, PlainNumber, PlainNumber]
    e: tuple[PlainNumber, PlainNumber]
    lambda_tk: PlainNumber

    def law(self) -> tuple[str, tuple[float, ...], str]:
        """Law, coefficients and what they are relative to, as `Warming` has them."""
        return "schott", (*self.d, *self.e, self.lambda_tk), "vacuum"


def _kind_of_law(value: object) -> str | None:
    if isinstance(value, Mapping):
        return TAG + ("rate" if "rate" in value else "schott")
    return f"{TAG}water" if value == "water" else None


_LAWS = 'must be {d = [D0, D1, D2], e = [E0, E1], lambda_tk = um}, {rate = -8.5e-5} per K or "water"'
_Law = Annotated[
    Annotated[Literal["water"], Tag(f"{TAG}water")]
    | Annotated[_Rate, Tag(f"{TAG}rate")]
    | Annotated[_SchottRate, Tag(f"{TAG}schott")],
    Discriminator(_kind_of_law, custom_error_type="law", custom_error_message=_LAWS),
]


class _GlassTable(StrictTable, defer_build=True):
    """Glass in a file; each kind adds the coefficients of its formula."""

    name: str = ""
    formula: str = ""
    range: _Span | None = None
    source: str = ""
    against: _Side = "air"
    cte: Annotated[PlainNumber, Field(gt=-MOST_EXPANSION, lt=MOST_EXPANSION)] = 0.0
    dndt: _Law | None = None
    warming_source: str = ""

    @field_validator("range", mode="after")
    @classmethod
    def _rises(cls, ends: tuple[float, float] | None) -> tuple[float, float] | None:
        if ends is not None and not 0 <= ends[0] < ends[1]:
            raise ValueError("must be two rising wavelengths; write the shorter one first")
        return ends

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients as `Glass` has them."""
        raise NotImplementedError

    def glass(self, formula: str) -> Glass:
        """Glass by a formula; an InputError where the coefficients give no index in the range."""
        shortest, longest = (float(end) for end in self.range or (0.0, np.inf))
        if self.range:
            with np.errstate(all="ignore"):
                real = _index(formula, self.coefficients, np.linspace(shortest or longest / 8, longest, 9) * 1e3)
            if not np.all((real >= 1) & (real < 5)):
                given = f"from {np.min(real):.3g} to {np.max(real):.3g}"
                message = f"give an index {given} in the range; check them and the range"
                raise InputError((Problem(COEFFICIENTS[formula][0], message),))
        numbers = zip("nV", self.coefficients, strict=False) if formula in ("abbe", "constant") else ()
        name = self.name or ", ".join(f"{sign} = {value:g}" for sign, value in numbers)
        span, offset = (shortest, longest), 0.0
        return Glass(name, formula, self.coefficients, *span, self.source, offset, self.against, self._warming())

    def _warming(self) -> Warming:
        if self.dndt is None:
            return Warming(self.cte, source=self.warming_source)
        law, terms, against = ("water", (), "vacuum") if self.dndt == "water" else self.dndt.law()
        coldest, hottest = WARMING.get(law, (-np.inf, np.inf))
        return Warming(self.cte, law, terms, against, coldest, hottest, self.warming_source)


class _Sellmeier(_GlassTable):
    b: _Numbers
    c: _Numbers
    range: _Span

    @field_validator("c", mode="after")
    @classmethod
    def _paired(cls, value: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        if len(value) != len(info.data.get("b", value)):
            raise ValueError(f"has {len(value)} numbers where b has {len(info.data['b'])}; pair them")
        return value

    @property
    def coefficients(self) -> tuple[float, ...]:
        return tuple(chain.from_iterable(zip(self.b, self.c, strict=True)))


class _Schott(_GlassTable):
    a: Annotated[tuple[PlainNumber, ...], Field(min_length=2)]
    range: _Span

    @property
    def coefficients(self) -> tuple[float, ...]:
        return self.a


def _an_index(value: float) -> float:
    if not 1 <= value < 5:  # told with its noun, because a medium may be given by its index alone
        raise ValueError(f"an index must be a number from 1 to 5, got {value:g}")
    return value


class _Constant(_GlassTable):
    index: Annotated[PlainNumber, AfterValidator(_an_index)]

    @property
    def coefficients(self) -> tuple[float, ...]:
        return (self.index,)


class _Abbe(_Constant):
    abbe: Annotated[PlainNumber, Field(gt=0)]

    @property
    def coefficients(self) -> tuple[float, ...]:
        return self.index, self.abbe


_TABLES: dict[str, type[_GlassTable]] = {
    "sellmeier": _Sellmeier,
    "schott": _Schott,
    "abbe": _Abbe,
    "constant": _Constant,
}


def read_glass(table: Mapping[str, Any]) -> Glass:
    """A glass from a table such as those of `glasses.toml`, or from index and Abbe number alone.

    Parameters
    ----------
    table : mapping
        ``formula``, its coefficients (``b`` and ``c``, ``a``, ``index`` and ``abbe``, or ``index``), ``range``,
        ``source``, and ``against = "vacuum"`` where it is that to which the coefficients are relative. Where known,
        ``cte`` [1/K], ``dndt`` (``{d = [D0, D1, D2], e = [E0, E1], lambda_tk}``, ``{rate}`` [1/K] with its own
        ``against``, or ``"water"``) and ``warming_source``. Without ``formula`` index and Abbe number say it.

    Raises
    ------
    InputError
        Every fault of it.
    """
    plain = "constant" if table.keys() <= _Constant.model_fields.keys() else "abbe"
    formula = table.get("formula", plain)
    if not isinstance(formula, str) or formula not in _TABLES:
        message = f"{formula!r} is not a known formula; write one of {', '.join(_TABLES)}"
        raise InputError((Problem("formula", message),))
    return validated(_TABLES[formula], table).glass(formula)
