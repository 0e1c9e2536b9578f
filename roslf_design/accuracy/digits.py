"""Sixty digits beside sixteen: exact conversions, errors in ulps, condition numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

from ..errors import InputError, Problem

DIGITS = 60
"""Decimal digits of the references."""

Values = Mapping[str, Any]
"""Arguments of a closed form by name: numbers, pairs of numbers, flags."""

STEP = 1e-20
"""Relative step of the differences that condition numbers are taken from; at 60 digits they keep 20."""


@cache
def many_digits() -> Any:
    """The mpmath module.

    Raises
    ------
    InputError
        Not installed.
    """
    try:
        import mpmath
    except ImportError:
        message = "references at 60 digits need mpmath; install it with: pip install mpmath"
        raise InputError((Problem("accuracy", message),)) from None
    return mpmath


class Judged(NamedTuple):
    """One number against its reference."""

    ulps: float
    """Error in units of the exact value's last place."""
    relative: float
    """Error over the exact value."""
    condition: float
    """Sum over the arguments of |x df/dx / f|: what one rounding of each argument alone may do, in roundings."""

    def share(self, budget: float) -> float:
        """Error as a share of ``budget (1 + condition)`` ulps: at most 1 is within."""
        return self.ulps / (budget * (1 + self.condition))


def exactly(value: Any) -> Any:
    """A float, or a nest of them, as the numbers they exactly are; flags stay."""
    mp = many_digits()
    if isinstance(value, bool | mp.mpf):
        return value
    if isinstance(value, tuple | list):
        return tuple(exactly(part) for part in value)
    return mp.mpf(float(value))


def flat(value: Any) -> list[Any]:
    """Numbers of a result, whatever its nesting."""
    if isinstance(value, tuple | list):
        return [part for item in value for part in flat(item)]
    if hasattr(value, "tolist"):
        listed = value.tolist()
        return flat(listed) if isinstance(listed, list) else [listed]
    return [value]


def last_place(value: Any) -> Any:
    """Unit in the last place of a double near a non-zero number."""
    mp = many_digits()
    return mp.ldexp(1, int(mp.floor(mp.log(abs(value), 2))) - 52)


def error_of(value: Any, truth: Any) -> tuple[float, float]:
    """Error of a double in ulps and relative; inf where a number is not one, or flags differ."""
    mp = many_digits()
    if isinstance(truth, bool) or mp.isinf(truth):
        return (0.0, 0.0) if value == truth else (math.inf, math.inf)
    if not math.isfinite(value):
        return math.inf, math.inf
    error = abs(mp.mpf(float(value)) - truth)
    if error == 0:
        return 0.0, 0.0
    if truth == 0:
        return math.inf, math.inf
    return float(error / last_place(truth)), float(error / abs(truth))


def judge(exact: Callable[..., Any], got: list[Any], given: Values, enough: float = 0.0) -> Judged:
    """The worst of a result's numbers against its reference.

    Parameters
    ----------
    exact : callable
        The reference, by the same keywords; runs at 60 digits.
    got : list
        Numbers that the double-precision form returned.
    given : mapping
        Its arguments.
    enough : float
        Errors up to so many ulps are not asked for their condition, told as 0: it takes most of the time.

    Returns
    -------
    Judged
        Of the number that is worst next to its condition. A difference of equal terms (exactly 0) is judged by the
        terms' last place.
    """
    mp = many_digits()
    with mp.workdps(DIGITS):
        truths = flat(exact(**{name: exactly(value) for name, value in given.items()}))
        errors = [error_of(value, truth) for value, truth in zip(got, truths, strict=True)]
        if max(ulps for ulps, _ in errors) <= enough:
            return Judged(*max(errors), 0.0)
        moved = movement(exact, given, len(truths))
        found = []
        for value, truth, (ulps, relative), move in zip(got, truths, errors, moved, strict=True):
            if not isinstance(truth, bool) and truth == 0 and move > 0:
                off = abs(mp.mpf(float(value)))
                found.append(Judged(float(off / last_place(move)), float(off / move), 1.0))
            else:
                regular = not isinstance(truth, bool) and truth != 0 and not mp.isinf(truth)
                found.append(Judged(ulps, relative, float(move / abs(truth)) if regular else 0.0))
        return max(found, key=lambda one: one.share(1.0))


def movement(exact: Callable[..., Any], given: Values, count: int) -> list[Any]:
    """Sum over the arguments of |x df/dx| for each number of a result, by central differences."""
    mp = many_digits()
    moved = [mp.mpf(0)] * count
    step = mp.mpf(STEP)
    for name, value in given.items():
        if isinstance(value, bool):
            continue
        parts = value if isinstance(value, tuple) else (value,)
        for i, part in enumerate(parts):
            if part == 0:
                continue
            sides = []
            for sign in (1, -1):
                shifted = (*exactly(parts[:i]), exactly(part) * (1 + sign * step), *exactly(parts[i + 1 :]))
                arguments = {key: exactly(other) for key, other in given.items()}
                arguments[name] = shifted if isinstance(value, tuple) else shifted[0]
                sides.append(flat(exact(**arguments)))
            for n, (up, down) in enumerate(zip(*sides, strict=True)):
                if not isinstance(up, bool):
                    jump = mp.isinf(up) or mp.isinf(down)
                    moved[n] += mp.inf if jump else abs(up - down) / (2 * step)
    return moved
