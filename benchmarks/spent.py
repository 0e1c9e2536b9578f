"""What a command takes, to its end: OUT.json WORDS...; a small process between, so that nobody else's memory counts.

The peak that Linux tells of a child starts from its parent's memory: pyperf's or numpy's, not the command's.
"""

import json
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

PATIENCE = 900.0
"""Longest wait for one command [s]."""


@contextmanager
def _ended(command: "subprocess.Popen[bytes]") -> Iterator[None]:
    """A command that ends when patience does; `wait` with a time of its own would look twenty times a second only."""
    timer = threading.Timer(PATIENCE, command.kill)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def main(out: str, *words: str) -> int:
    """Run it, write seconds of wall and processor (with all its own processes) and the peak memory [MB]."""
    start = time.perf_counter()
    with subprocess.Popen(words) as command, _ended(command):
        code = command.wait()
    wall, used = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    unit = 1e6 if sys.platform == "darwin" else 1e6 / 1024
    with open(out, "w") as file:
        json.dump([wall, used.ru_utime + used.ru_stime, used.ru_maxrss / unit], file)
    return code


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
