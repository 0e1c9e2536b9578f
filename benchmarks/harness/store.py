"""Results as JSON: what is in it, and a check that it is all there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .comparison import CaseResult, SideResult
from .samples import Spread

SCHEMA = "roslf.benchmarks/1"
PARTS = ("schema", "quick", "machine", "bandwidth", "peers", "cases", "goals", "scaling", "topics", "seconds")
STATES = ("timed", "missing", "failed", "mismatch")


def case_dict(found: CaseResult) -> dict[str, Any]:
    """A case with all its sides."""
    case = found.case
    return {
        "name": case.name,
        "title": case.title,
        "unit": case.unit,
        "count": case.count,
        "note": case.note,
        "bytes_each": case.bytes_each,
        "sides": [side_dict(side) for side in found.sides],
    }


def side_dict(side: SideResult) -> dict[str, Any]:
    """A side; times are of one run of `count` units."""
    spread = Spread.of(side.seconds) if side.seconds else None
    return {
        "label": side.label,
        "program": side.program,
        "threads": side.threads,
        "count": side.count,
        "state": side.state,
        "reason": side.reason,
        "checks": [
            {"name": c.name, "difference": number(c.difference), "allowed": c.allowed, "ok": c.ok} for c in side.checks
        ],
        "quality": {name: number(value) for name, value in side.quality.items()},
        "first_run_s": number(side.first),
        "seconds": None
        if spread is None
        else {"median": spread.median, "low": spread.low, "high": spread.high, "best": spread.best},
        "samples": [float(f"{value:.6g}") for value in side.seconds],
        "cpu_s": number(side.cpu),
        "peak_mib": number(side.peak_mib),
        "rate": number(side.rate),
        "ratio": None
        if side.ratio is None
        else {"value": side.ratio.value, "low": side.ratio.low, "high": side.ratio.high, "pairs": side.ratio.pairs},
    }


def number(value: float | None) -> float | None:
    """JSON has no infinity and no NaN: null."""
    return float(value) if value is not None and math.isfinite(value) else None


def goal_dicts(found: CaseResult) -> list[dict[str, Any]]:
    """Goals of a case with what was reached, by the median; met is None where there is no ratio."""
    told = []
    ours = found.sides[0]
    for goal in found.case.goals:
        side = found.side(goal.against)
        ratio = side.ratio if side else None
        met = None if ratio is None else ratio.value >= goal.least
        worse = [] if side is None else [k for k, v in ours.quality.items() if v > side.quality.get(k, math.inf)]
        told.append(
            {
                "case": found.case.name,
                "text": goal.text,
                "against": goal.against,
                "least": goal.least,
                "ratio": None if ratio is None else ratio.value,
                "low": None if ratio is None else ratio.low,
                "high": None if ratio is None else ratio.high,
                "worse_in": worse,
                "met": met and not worse if met is not None else None,
                "reason": "" if side is None or ratio is not None else f"{side.state}: {side.reason}",
            }
        )
    return told


def check(data: Mapping[str, Any]) -> None:
    """See that a stored result can be drawn.

    Raises
    ------
    ValueError
        Another schema, a part missing, a side in an unknown state, or a ratio where there may be none.
    """
    if data.get("schema") != SCHEMA:
        raise ValueError(f"schema is {data.get('schema')!r}, not {SCHEMA!r}: run the benchmarks again")
    missing = [part for part in PARTS if part not in data]
    if missing:
        raise ValueError(f"parts missing: {', '.join(missing)}")
    for case in data["cases"]:
        for side in case["sides"]:
            where = f"{case['name']}, {side['label']}"
            if side["state"] not in STATES:
                raise ValueError(f"{where}: no such state: {side['state']}")
            if side["ratio"] is not None and (side["state"] != "timed" or not all(c["ok"] for c in side["checks"])):
                raise ValueError(f"{where}: a ratio without results that agree")
