"""What a command takes, to its end: OUT.json WORDS...; a small process between, so that nobody else's memory counts.

The peak that Linux tells of a child starts from its parent's memory: pyperf's or numpy's, not the command's.
"""

import json
import resource
import subprocess
import sys
import time

PATIENCE = 900.0
"""Longest wait for one command [s]."""


def main(out: str, *words: str) -> int:
    """Run it, write seconds of wall and processor (with all its own processes) and the peak memory [MB]."""
    start = time.perf_counter()
    code = subprocess.call(words, timeout=PATIENCE)
    wall, used = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    unit = 1e6 if sys.platform == "darwin" else 1e6 / 1024
    with open(out, "w") as file:
        json.dump([wall, used.ru_utime + used.ru_stime, used.ru_maxrss / unit], file)
    return code


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
