"""Conditions on catalogue entries, as typed: "focal_length<=100 mm", "maker=Thorlabs"."""

from __future__ import annotations

import difflib
import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..design.units import parse_quantity
from ..errors import InputError, Problem
from .parts import MODELS

COMPARE = {"=": operator.eq, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
LENGTHS = ("diameter", "clear_aperture", "focal_length", "effective_focal_length", "pitch", "pixel", "size")
NEAR = 1e-9
"""Relative difference at which lengths count as equal."""


@dataclass(frozen=True)
class Condition:
    """A condition on one key."""

    key: str
    sign: str
    value: float | str

    def holds(self, row: Mapping[str, Any]) -> bool:
        """Whether an entry meets it; of several numbers (a size) all must."""
        own = row.get(self.key)
        if own is None:
            return False
        if isinstance(self.value, str):
            return self.value.lower() in str(own).lower()
        numbers = own if isinstance(own, (list, tuple)) else [own]
        return all(self._compare(float(number)) for number in numbers)

    def _compare(self, number: float) -> bool:
        assert isinstance(self.value, float)
        if abs(number - self.value) <= NEAR * abs(self.value):
            return self.sign in ("=", "<=", ">=")
        return bool(COMPARE[self.sign](number, self.value))


def read_condition(text: str) -> Condition:
    """Read a condition.

    Raises
    ------
    InputError
        Unknown key, no comparison, a length without a unit.
    """
    known = sorted({"kind", *(name for model in MODELS.values() for name in model.model_fields)})
    match = re.fullmatch(r"\s*(\w+)\s*(<=|>=|<|>|=)\s*(.+?)\s*", text)
    if match is None:
        raise _wrong(f'cannot read "{text}"; write e.g. "focal_length<=100 mm" or "maker=Thorlabs"')
    key, sign, value = match.groups()
    if key not in known:
        near = difflib.get_close_matches(key, known, 1, 0.5)
        raise _wrong(f"'{key}' is no key of a part; " + (f"did you mean '{near[0]}'?" if near else ", ".join(known)))
    if key in LENGTHS:
        try:
            return Condition(key, sign, parse_quantity(value, "length"))
        except ValueError as error:
            raise _wrong(str(error)) from None
    if key == "pixels":
        try:
            return Condition(key, sign, float(value))
        except ValueError:
            raise _wrong(f'"{value}" is no number of pixels; write e.g. "pixels>=400"') from None
    if sign != "=":
        raise _wrong(f"'{key}' holds words, which {sign} does not compare; write {key}={value}")
    return Condition(key, sign, value)


def _wrong(message: str) -> InputError:
    return InputError((Problem("--where", message),))
