"""Plain form of results for JSON, which has no infinity, nothing undefined, and no classes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def plain(value: Any, *, undefined: bool = True) -> Any:
    """Results as JSON's types: dataclasses by their fields' names, arrays and tuples as lists, None for infinity.

    Parameters
    ----------
    value : any
        A tree of dataclasses, mappings, sequences, arrays, numbers and text.
    undefined : bool
        Whether what is no number becomes None too: for results that say elsewhere why a number is missing (a metric
        that no trial defines).

    Raises
    ------
    ArithmeticError
        Something is not a number, and `undefined` is false.
    """
    if is_dataclass(value):
        # Python's own words end in _: `from_`.
        return {
            field.name.rstrip("_"): plain(getattr(value, field.name), undefined=undefined) for field in fields(value)
        }
    if isinstance(value, Mapping):
        return {key: plain(inner, undefined=undefined) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist(), undefined=undefined)
    if isinstance(value, (list, tuple)):
        return [plain(inner, undefined=undefined) for inner in value]
    if isinstance(value, float):
        if math.isnan(value) and not undefined:
            raise ArithmeticError("a result is not a number; please report the design that led to it")
        return value if math.isfinite(value) else None
    return value
