"""How fast the commands are: `python -m benchmarks`; beside another revision: `python -m benchmarks --compare REV`."""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from . import commands, page, peers, rates, scaling, yardstick
from .turns import Row

REPORT, QUICK = Path("reports/benchmarks"), Path("out/benchmarks-quick")
DATA, SCHEMA = "benchmarks.json", "roslf.benchmarks/3"
YARDSTICK = "yardstick"
"""Key of the machine's own speed, which older runs have not, and its name for `--only`."""
PARTS = {
    "commands": commands.measure,
    "rates": rates.measure,
    "peers": peers.measure,
    "scaling": scaling.measure,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, or read what was measured; write JSON, page and README's table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few runs of small sizes: under three minutes")
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="a row, a part or yardstick; printed, not stored"
    )
    parser.add_argument("--redraw", action="store_true", help="page and table again from the stored run")
    parser.add_argument("--readme", action="store_true", help="put the table into README.md")
    parser.add_argument("--compare", metavar="REV", help="every command here and at this revision, in turn")
    parser.add_argument("-o", "--output", type=Path, help=f"folder; default {REPORT}, of a quick run {QUICK}")
    given = parser.parse_args(arguments)
    if given.readme and (given.quick or given.only):
        parser.error("README's table is of a whole run; leave --quick and --only out")
    try:
        if given.compare:
            for row in commands.compared(given.compare, given.only):
                print(page.comparison_line(row), flush=True)
            return 0
        output = given.output or (QUICK if given.quick else REPORT)
        data = json.loads((output / DATA).read_text()) if given.redraw else run(given.quick, given.only)
        if data["schema"] != SCHEMA:
            raise ValueError(f"{output / DATA} is of another version; run without --redraw")
        if not given.only:
            write(data, output, Path("README.md") if given.readme else None)
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def run(quick: bool, chosen: Sequence[str]) -> dict[str, Any]:
    """Everything, or the rows that are chosen; lines are printed as they come."""
    machine = describe()
    if not chosen or YARDSTICK in chosen:
        machine[YARDSTICK] = yardstick.measure()
        print(yardstick.sentence(machine[YARDSTICK]).strip(), flush=True)
    parts: dict[str, list[Row]] = {part: [] for part in PARTS}
    single = [name for name in chosen if name not in (*PARTS, YARDSTICK)]
    for part, measure in PARTS.items():
        if chosen and not single and part not in chosen:
            continue
        for row in measure(quick, () if part in chosen else single):
            print(page.line(row), flush=True)
            parts[part].append(row)
    rows = {part: [asdict(row) for row in rows] for part, rows in parts.items()}
    return {"schema": SCHEMA, "quick": quick, "machine": machine, "parts": rows}


def write(data: dict[str, Any], output: Path, readme: Path | None) -> None:
    """JSON and page into the folder, the table onto the screen and into README."""
    parts = {part: [Row.from_dict(row) for row in rows] for part, rows in data["parts"].items()}
    table = page.readme_table([row for rows in parts.values() for row in rows], data["machine"])
    output.mkdir(parents=True, exist_ok=True)
    (output / DATA).write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n")
    (output / "index.html").write_text(page.page(parts, data["machine"]))
    if readme is not None:
        readme.write_text(page.with_table(readme.read_text(), table))
    print(f"\n{table}\n{output / 'index.html'}")


def describe() -> dict[str, Any]:
    """Processor, versions, revision, date and load; nothing that names the machine."""
    try:
        words = ["git", "-C", str(commands.REPOSITORY), "describe", "--always", "--dirty=+"]
        revision = subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except (OSError, subprocess.CalledProcessError):
        revision, lines = "unknown", []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return {
        "processor": next(names, platform.processor() or "unknown"),
        "cores": os.cpu_count(),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "revision": revision,
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else "unknown",
    }


if __name__ == "__main__":
    sys.exit(main())
