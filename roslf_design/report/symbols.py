"""How the paper's symbols and units are set in text: d_3, D_F, f_ml, um."""

from __future__ import annotations

import re
from html import escape

SYMBOL = re.compile(r"(?<![\w.])([A-Za-zσλΔ])_(ml|[0-9A-Zfkx])(?!\w)(/[dDqL](?!\w))?")
"""A letter with a subscript, such as d_3, D_F, X_ml, σ_Z; with what it is divided by, as in d_2/d."""
LETTERS = frozenset("DfdqHLλ")
"""Symbols of one letter; set as such where they are a whole text, such as a cell."""
SPELT_OUT = {"um": "µm", "lambda": "λ", "sigma": "σ"}
"""What is written in plain letters elsewhere, and its sign."""
_WORD = re.compile(r"\b(um|lambda|sigma(?=_))(?![A-Za-z0-9])")


def typographic(text: str) -> str:
    """The same text with µm and Greek letters as such."""
    return _WORD.sub(lambda match: SPELT_OUT[match[0]], text)


def to_html(text: str) -> str:
    """Text as HTML: escaped, symbols in italics with subscripts; a text of one letter is a symbol."""

    def lower(match: re.Match[str]) -> str:
        over = f"/<var>{match[3][1:]}</var>" if match[3] else ""
        return f"<var>{match[1]}</var><sub>{match[2]}</sub>{over}"

    if text in LETTERS:
        return f"<var>{text}</var>"
    return SYMBOL.sub(lower, escape(typographic(text)))
