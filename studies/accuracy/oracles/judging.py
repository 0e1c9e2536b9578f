"""Sixty digits beside sixteen: exact conversions, errors in last places, condition numbers."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import mpmath as mp

DIGITS = 60
"""Decimal digits of the references."""

STEP = 1e-20
"""Relative step of the differences that condition numbers are taken from; at 60 digits they keep 20."""


class Judged(NamedTuple):
    """One number against its reference."""

    exact: Any
    ulps: float
    """Error in units of the exact value's last place; inf where a number is not one, or flags differ."""
    relative: float
    """Error over the exact value."""
    condition: float
    """Sum over the arguments of |x df/dx / f|: what one rounding of each argument alone may do, in roundings."""


def exactly(value: Any) -> Any:
    """A float, or a nest of them, as the mpmath numbers they exactly are; flags stay."""
    if isinstance(value, bool | mp.mpf):
        return value
    if isinstance(value, tuple | list):
        return tuple(exactly(part) for part in value)
    return mp.mpf(float(value))


def traced(function: Callable[..., Any]) -> Callable[..., Any]:
    """Run at 60 digits on exact conversions of the floats given by keyword."""

    @functools.wraps(function)
    def at_many_digits(**arguments: Any) -> Any:
        with mp.workdps(DIGITS):
            return function(**{name: exactly(value) for name, value in arguments.items()})

    return at_many_digits


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
    return mp.ldexp(1, int(mp.floor(mp.log(abs(value), 2))) - 52)


def error_of(value: Any, truth: Any) -> tuple[float, float]:
    """Error of a double in ulps and relative."""
    if isinstance(truth, bool) or mp.isinf(truth):
        return (0.0, 0.0) if value == truth else (math.inf, math.inf)
    if not math.isfinite(value):
        return math.inf, math.inf
    error = abs(mp.mpf(float(value)) - truth)
    if error == 0:
        return 0.0, 0.0
    return (math.inf, math.inf) if truth == 0 else (float(error / last_place(truth)), float(error / abs(truth)))


def judge(
    exact: Callable[..., Any],
    got: list[Any],
    arguments: Mapping[str, Any],
    enough: float = 0.0,
    truths: list[Any] | None = None,
) -> list[Judged]:
    """Errors of a result's numbers against their reference, beside their condition numbers.

    Parameters
    ----------
    exact : callable
        The reference, by the same keywords; runs at 60 digits (see `traced`).
    got : list
        Numbers that the double-precision form returned.
    arguments : mapping
        Floats, pairs of floats, flags.
    enough : float
        Errors up to so many ulps are not asked for their condition, told as 0: it takes most of the time.
    truths : list, optional
        Numbers of the reference where they are known already.

    Returns
    -------
    list of Judged
        A difference of equal terms (exactly 0) is judged by the terms' last place.
    """
    with mp.workdps(DIGITS):
        truths = truths or flat(exact(**arguments))
        errors = [error_of(value, truth) for value, truth in zip(got, truths, strict=True)]
        if max(ulps for ulps, _ in errors) <= enough:
            return [Judged(truth, *error, 0.0) for truth, error in zip(truths, errors, strict=True)]
        moved = movement(exact, arguments, len(truths))
        judged = []
        for value, truth, (ulps, relative), move in zip(got, truths, errors, moved, strict=True):
            flag = isinstance(truth, bool)
            if not flag and truth == 0 and move > 0:
                off = abs(mp.mpf(float(value)))
                judged.append(Judged(truth, float(off / last_place(move)), float(off / move), 1.0))
            else:
                regular = not flag and truth != 0 and not mp.isinf(truth)
                judged.append(Judged(truth, ulps, relative, float(move / abs(truth)) if regular else 0.0))
        return judged


def movement(exact: Callable[..., Any], arguments: Mapping[str, Any], count: int) -> list[Any]:
    """Sum over the arguments of |x df/dx| for each of a result's numbers, by central differences."""
    moved = [mp.mpf(0)] * count
    step = mp.mpf(STEP)
    given = {name: exactly(value) for name, value in arguments.items()}
    for name, value in given.items():
        if isinstance(value, bool):
            continue
        parts = value if isinstance(value, tuple) else (value,)
        for i, part in enumerate(parts):
            if part == 0:
                continue
            sides = []
            for sign in (1, -1):
                nudged = (*parts[:i], part * (1 + sign * step), *parts[i + 1 :])
                sides.append(flat(exact(**(given | {name: nudged if isinstance(value, tuple) else nudged[0]}))))
            for n, (up, down) in enumerate(zip(*sides, strict=True)):
                if not isinstance(up, bool):
                    jump = mp.isinf(up) or mp.isinf(down)
                    moved[n] += mp.inf if jump else abs(up - down) / (2 * step)
    return moved
