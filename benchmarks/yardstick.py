"""How fast the machine is, by work that has nothing of ours in it: `python -m benchmarks --only yardstick`."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Mapping

from .turns import Side, in_turn, process

ALONE = "import os, time; os.environ['OPENBLAS_NUM_THREADS'] = '1'; import numpy"
TIMED = "start = time.process_time(); {}; took = time.process_time() - start; print(took, took)"
WORK = {
    "a loop of 10 million additions in Python": f"import time; {TIMED.format('sum(i + 1 for i in range(10_000_000))')}",
    "a product of two 1500 x 1500 matrices in numpy, one thread": (
        f"{ALONE}; a = numpy.ones((1500, 1500)); a @ a; {TIMED.format('a @ a')}"
    ),
    "`import numpy` in a fresh Python": "import numpy",
}
"""What is done, each in a process of its own, and its Python."""
ROUNDS = 5


def measure(rounds: int = ROUNDS) -> dict[str, float]:
    """Processor seconds of each piece of work, medians of runs in turn; what fails is left out."""
    runs = {name: process((sys.executable, "-c", code), prints="print" in code) for name, code in WORK.items()}
    sides = [Side.of(*turn) for turn in in_turn(runs, rounds).items()]
    return {side.label: round(statistics.median(side.processor), 4) for side in sides if side.processor}


def sentence(seconds: Mapping[str, float]) -> str:
    """Speed of the machine in words; nothing where it was not measured."""
    told = "; ".join(f"{name}, {1e3 * value:.0f} ms" for name, value in seconds.items())
    return f" Yardstick, processor time: {told}." if told else ""
