"""Whole commands, from process start to exit, after a first run has filled the caches."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

GOALS = {"--help": 0.4, "evaluate": 0.8, "report": 15.0}
"""Goal for each command [s]."""


def main(repeats: int = 7) -> None:
    """Print the median and the spread of each command."""
    roslf = Path(sys.executable).with_name("roslf")
    design = Path(__file__).resolve().parent.parent / "designs" / "paper.toml"
    with tempfile.TemporaryDirectory() as folder:
        commands = {
            "--help": ["--help"],
            "evaluate": ["evaluate", str(design)],
            "report": ["report", str(design), "-o", folder],
        }
        for name, arguments in commands.items():
            seconds = [_seconds([str(roslf), *arguments]) for _ in range(repeats if name != "report" else 3)][1:]
            median, worst = statistics.median(seconds), max(seconds)
            print(f"roslf {name:10s} {median:6.2f} s (worst {worst:.2f} s, goal {GOALS[name]} s)")


def _seconds(command: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
