"""Names, symbols and numbers as people read them, on pages, in figures and on a terminal.

Study files and JSON keep their names; text keeps symbols as ``d_3`` or ``D_F``, which each printer sets in its way.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import cache
from html import escape

SYMBOL = re.compile(r"(?<![\w.])([A-Za-zσλΔ])_(ml|[0-9A-Zfkx])(?!\w)(/[dDqL](?!\w))?")
"""A letter with a subscript, such as d_3, D_F, X_ml, σ_Z; with what it is divided by, as in d_2/d."""
LETTERS = frozenset("DfdqHLλ")
"""Symbols of one letter; set as such where they are a whole text, such as a cell."""
SPELT_OUT = {"um": "µm", "lambda": "λ", "sigma": "σ"}
"""Signs of what is written in plain letters elsewhere."""
TERMS = {
    "FAP": "the aperture stop's image in object space (flexible angular plane, FAP): the entrance pupil",
    "image fill": "diameter of a microlens image over the distance to the next; 1: they touch",
    "unvignetted fraction": "area of a microlens image that no rim cuts off, over that of the whole image",
    "clearance": "distance of light from the nearest rim; below 0 where the rim cuts it",
    "thin-lens model": "the camera with an ideal thin lens for the real one: its focal length, at its principal planes",
    "mechanical distance": "a distance as a workshop measures it, not as it appears through glass and liquid",
    "Fresnel number": "N_F = d²/(4 lambda d_2) of a microlens; diffraction leaves 4 N_F independent views an axis",
    "depth noise (bound)": "standard deviation of depth that photons and read noise alone leave; none does better",
    "depth, expected": "combined standard uncertainty of depth by all that is known, in the GUM's terms",
    "aliasing": "detail finer than two samples a period, which shows as coarser detail that is not there",
    "Monte Carlo unit (build)": "one camera of a tolerance study, each length off by its tolerance at random",
}
"""Terms that reports explain at their end; `docs/glossary.md` has these and more."""
_WORD = re.compile(r"\b(um|lambda|sigma(?=_))(?![A-Za-z0-9])")
_TYPED = re.compile(r"`([^`\n]+)`")
_TAGS = {"plain": "{}", "symbol": "<var>{}</var>", "sub": "<sub>{}</sub>", "code": "<code>{}</code>"}


def typographic(text: str) -> str:
    """Text with µm and Greek letters as such."""
    return _WORD.sub(lambda match: SPELT_OUT[match[0]], text)


def spans(text: str) -> list[tuple[str, str]]:
    """Text in pieces of (kind, text): "plain", a "symbol" and its "sub", or "code" that stood between backticks.

    A text of one letter is a symbol.
    """
    pieces = list[tuple[str, str]]()
    for k, part in enumerate(_TYPED.split(text)):
        pieces += [("code", part)] if k % 2 else _symbols(part)
    return pieces


def _symbols(text: str) -> list[tuple[str, str]]:
    text = typographic(text)
    if text in LETTERS:
        return [("symbol", text)]
    pieces, last = [], 0
    for match in SYMBOL.finditer(text):
        pieces += [("plain", text[last : match.start()]), ("symbol", match[1]), ("sub", match[2])]
        if match[3]:
            pieces += [("plain", "/"), ("symbol", match[3][1:])]
        last = match.end()
    return [piece for piece in [*pieces, ("plain", text[last:])] if piece[1]]


def to_html(text: str) -> str:
    """Text as HTML: escaped, symbols in italics with subscripts."""
    return "".join(_TAGS[kind].format(escape(piece)) for kind, piece in spans(text))


ROUNDING = 1e-12
"""Below this a number of millimetres, pixels or shares is what rounding left of 0."""


def number(value: float, digits: int = 5, zero: float = ROUNDING) -> str:
    """A number to `digits` significant digits, infinity as a sign; "0" where it is smaller than `zero`.

    Up to 100,000 without powers of ten: "1090", not "1.09e+03".
    """
    if math.isnan(value):
        return "not stated"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if abs(value) < zero or value == 0:
        return "0"
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+0" in text and abs(float(text)) < 1e5 else text


def lux(illuminance: float) -> str:
    """An illuminance [lx]: "100,000 lx"."""
    return f"{illuminance:,.0f} lx" if illuminance >= 1e4 else f"{number(illuminance, 4)} lx"


def within(sigma: float, sign: str = "") -> str:
    """A standard deviation in words, for what is known better than anybody reads it, too."""
    return f"{sign}{sigma:.2g}" if sigma >= 1e-4 or sigma == 0 else f"better than {sign}0.0001"


def apart(share: float) -> str:
    """How much two numbers differ, relative to them, in words: "in the last digits" where that is all."""
    return "in the last digits" if abs(share) < 1e-9 else f"by up to {share:.1g}"


def on_side(value: float, up: bool, digits: int = 5) -> str:
    """Digits of a number that are not less than it, or else not more: a limit that they meet, it meets."""
    if not math.isfinite(value) or abs(value) < ROUNDING:
        return number(value)
    step = 10.0 ** (math.floor(math.log10(abs(value))) + 1 - digits)
    whole = math.ceil(value / step - 1e-9) if up else math.floor(value / step + 1e-9)
    return number(whole * step, digits)


def about_time(seconds: float) -> str:
    """A time that is about right, as people write it: "8 s", "41 s", "3 min", "1 h 20 min"."""
    if seconds < 89.5:
        return f"{max(seconds, 1):.0f} s"
    minutes = round(seconds / 60) if seconds < 1200 else 5 * round(seconds / 300)
    hours, rest = divmod(minutes, 60)
    return " ".join([*([f"{hours} h"] if hours else []), *([f"{rest} min"] if rest else [])])


def fixed(value: float, decimals: int, sign: str = "") -> str:
    """A number to so many decimals, never as -0; `sign` "+" writes both signs."""
    return f"{round(float(value), decimals) + 0.0:{sign}.{decimals}f}"


def decimals(value: float | None, count: int, sign: str = "") -> str:
    """A number to so many decimals, as `fixed`; a dash where there is none."""
    return "-" if value is None else fixed(value, count, sign)


def place(position: tuple[float, float], digits: int = 6) -> str:
    """A position [mm] as text: "11.15, 0"."""
    return ", ".join(number(value, digits) for value in position)


def rounded(value: float, sigma: float) -> str:
    """An estimate to two digits of its standard deviation."""
    return f"{value:.{max(0, min(8, 1 - math.floor(math.log10(sigma)))) if sigma > 0 else 6}f}"


def length(value: float) -> str:
    """A length [mm] as a reader wants it: five digits, micrometres below 0.1 mm."""
    text = number(value)
    return f"{text} mm" if abs(value) >= 0.1 or text == "0" else f"{1e3 * value:.5g} um"


NO_DEPTH = "no depth there"
"""Words for an expanded uncertainty of depth as large as the distance: what it is linear in then has no far end."""


def uncertainty(value: float, digits: int = 5, sign: str = "", ahead: float = math.inf) -> str:
    """An uncertainty [mm] with a sign before it: "none" where it is infinite, for there nothing is known.

    One of depth at a distance `ahead` [mm] is `NO_DEPTH` from there on.
    """
    if not math.isfinite(value):
        return "none"
    return NO_DEPTH if value >= ahead else f"{sign}{number(value, digits)} mm"


def angle(value: float) -> str:
    """An angle [rad] to three digits: milliradians, from 1 rad on degrees."""
    return f"{1e3 * value:.3g} mrad" if abs(value) < 0.9995 else f"{math.degrees(value):.3g} deg"


@cache
def in_file(place: str) -> str:
    """A dotted place as a design file has it, its elements and stops counted from 1: ``[[elements]] 1, thickness``."""
    part, _, rest = place.partition(".")
    index, _, rest = rest.partition(".")
    return f"[[{part}]] {int(index) + 1}, {rest}" if index.isdigit() else place


def sentence(text: str) -> str:
    """Text with a capital and a full stop; "f-number", symbols (d_3) and keys of files keep their small letter."""
    key = re.match(r"\w+[._]\w", text)
    capital = text[:1].upper() + text[1:] if (text[:2].isalpha() and not key) or text[:2] == "a " else text
    return capital if not text or text.endswith((".", "?")) else f"{capital}."


def spaced(name: str) -> str:
    """A name of a file or of JSON with spaces: ``_mla_rotation``."""
    return re.sub(r"\b(fap|mla)\b", lambda match: match[0].upper(), name.replace("_", " ").replace("cos4", "cos⁴"))


def the(part: str) -> str:
    """Name of a part in a sentence: those of which there are several are numbered, and take no article."""
    return part if any(letter.isdigit() for letter in part) else f"the {part}"


def percent(share: float, decimals: int = 0) -> str:
    """Share of one as a percentage."""
    return f"{100 * share:.{decimals}f} %"


def clauses(*parts: str, by: str = "; ") -> str:
    """Parts that say something, one after the other."""
    return by.join(filter(None, parts))


def listed(names: Sequence[str]) -> str:
    """Names as a sentence lists them."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
