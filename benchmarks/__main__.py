"""`python -m benchmarks [topic ...]`: run every benchmark, or those named, and say on what machine."""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import sys
from pathlib import Path


def topics() -> list[str]:
    """Names of the benchmarks: files called bench_<topic>.py."""
    return sorted(path.stem.removeprefix("bench_") for path in Path(__file__).parent.glob("bench_*.py"))


def main() -> int:
    """Run the benchmarks one after the other."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("topic", nargs="*", help=f"any of {', '.join(topics())}; default: all")
    chosen = parser.parse_args().topic or topics()
    unknown = sorted(set(chosen) - set(topics()))
    if unknown:
        parser.error(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(topics())}")
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores, {_processor()}")
    for topic in chosen:
        print(f"\n== {topic}", flush=True)
        importlib.import_module(f"benchmarks.bench_{topic}").main()
    return 0


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "processor unknown"
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "processor unknown")


if __name__ == "__main__":
    sys.exit(main())
