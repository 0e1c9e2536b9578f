"""Oracles at 60 digits, and how far off a closed form is: in last places, beside its condition number."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import mpmath as mp

DIGITS = 60
ORACLES: dict[str, Callable[..., Any]] = {}


def traced(function: Callable[..., Any]) -> Callable[..., Any]:
    """Run at 60 digits on exact conversions of the floats given."""

    @functools.wraps(function)
    def at_many_digits(**arguments: Any) -> Any:
        with mp.workdps(DIGITS):
            return function(**{name: exactly(value) for name, value in arguments.items()})

    return at_many_digits


def oracle(function: Callable[..., Any]) -> Callable[..., Any]:
    """`traced`, and registered under its own name, which is that of a closed form."""
    ORACLES[function.__name__] = traced(function)
    return ORACLES[function.__name__]


def exactly(value: Any) -> Any:
    if isinstance(value, bool | mp.mpf):
        return value
    if isinstance(value, tuple | list):
        return tuple(exactly(part) for part in value)
    return mp.mpf(float(value))


def keywords(name: str) -> tuple[str, ...]:
    """Arguments of an oracle."""
    return tuple(inspect.signature(ORACLES[name]).parameters)


def flat(value: Any) -> list[mp.mpf]:
    """Numbers of a result, whatever its nesting."""
    return [part for item in value for part in flat(item)] if isinstance(value, tuple | list) else [value]


class Judged(NamedTuple):
    """One number of a result against its oracle."""

    exact: mp.mpf
    ulps: float
    """Error in units of the exact value's last place."""
    condition: float
    """Sum over the arguments of |x df/dx / f|."""


def judge(compute: Callable[..., Any], got: Any, arguments: Mapping[str, Any], enough: float = 0.0) -> list[Judged]:
    """Errors against an oracle, and condition numbers, of every number that a closed form returned.

    Numbers within `enough` ulps are not asked for their condition (it is told as 0), which takes most of the time.
    """
    exact = flat(compute(**arguments))
    with mp.workdps(DIGITS):
        errors = [ulps_off(value, truth) for value, truth in zip(got, exact, strict=True)]
        if max(errors) <= enough:
            return [Judged(truth, error, 0.0) for truth, error in zip(exact, errors, strict=True)]
        moved = movement(compute, arguments, len(exact))
        result = []
        for value, truth, error, move in zip(got, exact, errors, moved, strict=True):
            if truth == 0 and move > 0:  # a difference of equal terms: judged by the terms
                result.append(Judged(truth, float(abs(mp.mpf(float(value))) / last_place(move)), 1.0))
            else:
                result.append(Judged(truth, error, float(move / abs(truth)) if truth != 0 else 0.0))
        return result


def ulps_off(value: Any, truth: Any) -> float:
    if isinstance(truth, bool) or mp.isinf(truth):
        return 0.0 if value == truth else float("inf")
    error = abs(mp.mpf(float(value)) - truth)
    if error == 0:
        return 0.0
    return float(error / last_place(truth)) if truth != 0 else float("inf")


def last_place(value: mp.mpf) -> mp.mpf:
    return mp.ldexp(1, int(mp.floor(mp.log(abs(value), 2))) - 52)


def movement(compute: Callable[..., Any], arguments: Mapping[str, Any], count: int) -> list[mp.mpf]:
    """Sum over the arguments of |x df/dx|, by central differences."""
    step = mp.mpf(10) ** -20
    moved = [mp.mpf(0)] * count
    for nudged in nudges(arguments, step):
        up, down = (flat(compute(**side)) for side in nudged)
        for i, (u, v) in enumerate(zip(up, down, strict=True)):
            if not isinstance(u, bool):
                moved[i] += mp.inf if mp.isinf(u) or mp.isinf(v) else abs(u - v) / (2 * step)
    return moved


def nudges(arguments: Mapping[str, Any], step: mp.mpf) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Pairs of argument sets with one number moved up and down by a relative step."""
    pairs = []
    for name, value in arguments.items():
        if isinstance(value, bool):
            continue
        parts = value if isinstance(value, tuple) else (value,)
        for i, part in enumerate(parts):
            if part == 0:
                continue
            sides = []
            for sign in (1, -1):
                moved: Any = exactly(part) * (1 + sign * step)
                changed = (*exactly(parts[:i]), moved, *exactly(parts[i + 1 :])) if isinstance(value, tuple) else moved
                sides.append({**arguments, name: changed})
            pairs.append((sides[0], sides[1]))
    return pairs
