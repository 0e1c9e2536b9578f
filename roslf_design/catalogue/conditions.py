"""Conditions on parts, as typed: "focal_length<=100 mm"."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from operator import eq, ge, gt, le, lt
from typing import Any

import numpy as np

from ..errors import refusal
from ..toml_files import nearest
from ..units import read_quantity
from .entries import CLOSE, ELECTRONS, MODELS, Entry

COMPARE: Mapping[str, Callable[[Any, Any], Any]] = {"=": eq, "<": lt, "<=": le, ">": gt, ">=": ge}
LENGTHS = frozenset(
    [
        "diameter",
        "clear_aperture",
        "thickness",
        "focal_length",
        "effective_focal_length",
        "pitch",
        "pixel",
        "size",
        "package",
    ]
)
MEANT = {
    **dict.fromkeys(("width", "height", "side", "format"), "size"),
    **dict.fromkeys(("name", "model", "number"), "part"),
    **dict.fromkeys(("vendor", "manufacturer", "brand"), "maker"),
    **dict.fromkeys(("pixel_size", "pixel_pitch"), "pixel"),
    **dict.fromkeys(("resolution", "megapixels"), "pixels"),
    **dict.fromkeys(("f", "efl"), "focal_length"),
    **dict.fromkeys(("glass", "substance"), "material"),
    **dict.fromkeys(("filter", "color", "colour"), "filters"),
    "d": "diameter",
    "aperture": "clear_aperture",
}
"""Names that people give to keys, and the keys."""
NEAR = 1e-9
"""Relative difference at which lengths count as equal."""


def read_condition(text: str) -> Callable[[Mapping[str, Any]], bool]:
    """Whether a part (of `rows`) meets a condition as typed: "focal_length<=100 mm", "maker=Thorlabs".

    A part without the key does not; of several numbers (a size) all must, of a package its larger side. Lengths that
    differ by rounding are equal.

    Raises
    ------
    InputError
        Unknown key, no comparison, a length without a unit.
    """
    try:
        key, sign, value = parse_condition(text)
    except ValueError as error:
        raise refusal("where", str(error)) from None

    def holds(row: Mapping[str, Any]) -> bool:
        own = row.get(key)
        if key == "colours" and sign == "=" and own is None:  # sold with filters and without, it can be had as either
            own = "mono or bayer" if row.get("mono_too") else None
        if own is None:
            return False
        if isinstance(value, str):
            return value.lower() in str(own).lower()
        over = np.ravel(max(own) if key == "package" else own) - value
        return bool(COMPARE[sign](np.where(np.abs(over) <= NEAR * abs(value), 0, over), 0).all())

    return holds


def _instead(key: str, known: Collection[str]) -> str:
    """Remedy for a key that is none: the one that means the same, one spelt much alike, or the keys of each kind."""
    if (meant := MEANT.get(key.lower())) is not None:
        return f"write {meant}"
    own = ({"kind": None} | Entry.model_fields).keys()
    each = {"all parts": own} | {k: [n for n in m.model_fields if n not in own] for k, m in MODELS.items()}
    listed = "; ".join(f"{kind.replace('_', ' ')} have {', '.join(names)}" for kind, names in each.items())
    return nearest(key, known, listed, least=CLOSE)


def parse_condition(text: str) -> tuple[str, str, float | str]:
    """Key, comparison and value of a condition as typed.

    Raises
    ------
    ValueError
        As `read_condition` tells it.
    """
    known = sorted({"kind", "filters", *(name for model in MODELS.values() for name in model.model_fields)})
    match = re.fullmatch(r"\s*(\w+)\s*(<=|>=|<|>|=)\s*(.+?)\s*", text)
    if match is None:
        raise ValueError(f'cannot read "{text}"; write e.g. "focal_length<=100 mm" or "maker=Thorlabs"')
    key, sign, value = match.groups()
    if key not in known:
        raise ValueError(f"'{key}' is no key of a part; {_instead(key, known)}")
    if key in LENGTHS or key == "acceptance":
        return key, sign, read_quantity(value, "length" if key in LENGTHS else "angle")
    if key == "pixels" or key in ELECTRONS:
        try:
            return key, sign, float(value)
        except ValueError:
            what, some = ("pixels", 400) if key == "pixels" else ("electrons", 5000)
            raise ValueError(f'"{value}" is no number of {what}; write e.g. "{key}>={some}"') from None
    if sign != "=":
        raise ValueError(f"'{key}' holds words, which {sign} does not compare; write {key}={value}")
    return key, sign, value
