"""README's speed table from a stored run: `python -m benchmarks.readme_table [benchmarks.json]`."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .harness.store import check
from .harness.words import interval, per

ROWS = (
    "ideal-lens",
    "singlet",
    "tolerance",
    "optimise",
    "geometry",
    "centres-hexagonal-0.7",
    "first-answer",
    "white-floor",
    "closed-forms",
    "shapes",
    "coverage",
    "coverage-cut",
    "white",
    "textured",
    "trials-closed",
    "trials-shapes",
    "optimum",
    "parts",
    "commands-help",
    "commands-evaluate",
    "commands-report",
)
"""Cases, in the table's order."""


def readme_table(data: Mapping[str, Any]) -> str:
    """Markdown: where and when, then a row for each case that was run."""
    machine = data["machine"]
    versions = f"Python {machine['python']}, numpy {machine['packages']['numpy']}"
    lines = [
        f"{machine['processor']}, {machine['cores']} cores, {machine['date'][:10]}, {versions}, revision "
        f"{machine['revision']}{', quick run' if data['quick'] else ''}.",
        "",
        "| what | here | others: times as long [95 % interval] |",
        "|---|---|---|",
    ]
    cases = {case["name"]: case for case in data["cases"]}
    lines += [row(cases[name]) for name in ROWS if name in cases]
    lines += explorer_row(data["topics"].get("explorer", {}).get("text", ""))
    return "\n".join(lines) + "\n"


def row(case: Mapping[str, Any]) -> str:
    """One case: our figure, and each other side's ratio or why there is none."""
    ours, *rest = case["sides"]
    here = per(case, ours)
    if ours["threads"] > 1:
        here += f", {ours['threads']} threads"
    others = []
    for side in rest:
        if side["program"] == "here":
            label = "1 thread" if side["label"] == "here" else side["label"].removeprefix("here, ")
            others.append(f"{label}: {per(case, side)}")
        elif side["state"] == "timed":
            others.append(f"{side['label']}: {interval(side['ratio'])}")
        else:
            others.append(f"{side['label']}: {side['state']}")
    return f"| {case['title']} | {here} | {'; '.join(others)} |"


SLIDER = re.compile(r"slider to picture, (\w+) +([\d.]+) ms median .*?([\d.]+) ms 95th percentile")
"""What the explorer's topic prints for each view."""


def explorer_row(text: str) -> list[str]:
    """The explorer's row from its topic's own words; none where it was not measured."""
    views = [f"{view} {float(median):.0f} ms ({float(late):.0f})" for view, median, late in SLIDER.findall(text)]
    what = "Explorer, slider to changed picture, median (95th percentile)"
    return [f"| {what} | {'; '.join(views)} | |"] if views else []


def main() -> int:
    """Print the table."""
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("reports/benchmarks/benchmarks.json")
    try:
        data = json.loads(file.read_text())
        check(data)
    except (OSError, ValueError) as error:
        told = error.strerror if isinstance(error, OSError) else error
        print(f"{file}: {told}; `make bench` writes it", file=sys.stderr)
        return 2
    print(readme_table(data), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
