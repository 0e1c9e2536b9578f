"""Numbers of a benchmark in words: times, rates, ratios with their intervals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def digits(value: float) -> str:
    """Two to three digits that count, thousands apart."""
    if value == 0:
        return "0"
    if abs(value) >= 100:
        size = 10 ** max(0, len(str(int(abs(value)))) - 3)
        return f"{round(value / size) * size:,.0f}"
    return f"{value:.3g}" if abs(value) >= 10 else f"{value:.2g}"


def duration(seconds: float) -> str:
    """A time with a unit."""
    for unit, size in (("min", 60.0), ("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9)):
        if seconds >= size * (5 if unit == "min" else 1):
            return f"{digits(seconds / size)} {unit}"
    return f"{seconds:.1e} s"


def rate(value: float, unit: str) -> str:
    """Work a second."""
    for word, size in ((" million", 1e6), ("", 1.0)):
        if value >= size * (2 if word else 0):
            return f"{digits(value / size)}{word} {unit}/s"
    return f"{digits(value)} {unit}/s"


def interval(ratio: Mapping[str, Any] | None) -> str:
    """A ratio with its interval."""
    return "" if ratio is None else f"{digits(ratio['value'])} [{digits(ratio['low'])}, {digits(ratio['high'])}]"


def per(case: Mapping[str, Any], side: Mapping[str, Any]) -> str:
    """What a side does: a rate where a case is of many units, else the time of one."""
    if side["seconds"] is None:
        return "-"
    if case["count"] > 100:
        return rate(side["rate"], case["unit"])
    return duration(side["seconds"]["median"] / side["count"])


def spread(side: Mapping[str, Any]) -> str:
    """Quartiles about the median."""
    times = side["seconds"]
    if times is None:
        return ""
    low, high = (100 * (times[end] / times["median"] - 1) for end in ("low", "high"))
    return f"{low:+.0f} to {high:+.0f} %"


def case_lines(case: Mapping[str, Any]) -> list[str]:
    """A case for the terminal."""
    lines = [f"{case['title']}"]
    for side in case["sides"]:
        head = f"  {side['label']:36s}"
        if side["state"] != "timed":
            lines.append(f"{head} {side['state']}: {side['reason']}; no ratio")
            continue
        told = f"{per(case, side):>24s}  ({spread(side)})"
        ratio = f"  takes {interval(side['ratio'])} times as long" if side["ratio"] else ""
        good = "".join(f"  {name} {digits(v) if v is not None else '-'}" for name, v in side["quality"].items())
        lines.append(f"{head} {told}{ratio}{good}")
    return lines
