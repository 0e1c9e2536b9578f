"""`roslf bench`: targets and protocol for a camera that was built, and what its captures are worth."""

from __future__ import annotations

from pathlib import Path

from cyclopts import App

from ..bench.captures import read_bench
from .terminal import Json, json_text, say

bench = App(
    name="bench",
    help="The camera that was built: a bench's protocol and targets to print, and what its captures are worth.",
    help_epilogue="Example: roslf bench paper -o out/bench",
    help_format="plaintext",
)


@bench.command(name="check")
def check(folder: Path, /, *, json: Json = False) -> None:
    """Worth of the captures so far, and what to take next.

    Example: roslf bench check out/bench

    Parameters
    ----------
    folder
        Folder that roslf bench wrote, with captures in calibration/ and acceptance/.
    """
    bench = read_bench(folder)
    if json:
        print(json_text({"schema": "roslf.bench-check/1", "images": [str(one.path.name) for one in bench.captures]}))
        return
    for one in bench.captures:
        say(f"{one.path.name}: {one.kind}")
