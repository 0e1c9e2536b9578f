"""`roslf warm`."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from .._jit import compiling
from ..depth.decoded import DecodeOptions, decoded
from ..depth.measure import simulate
from ..depth.pictures import PictureOptions, default_scene
from ..design import load
from ..evaluation import evaluate
from ..imaging.files import write_image
from ..imaging.render import render
from ..reporting.story import full_report
from ..scenes import WHITE_FIELD
from .terminal import bar, say

SMALL = 60
"""Side of the pictures that are rendered [px]: what is compiled does not hang on it."""


def warm() -> None:
    """Compile what commands would compile when each is first run, so that nobody waits for it later.

    Once on a machine, and again after an update. Machine code goes where numba keeps it: beside the package, or in the
    user's cache folder (NUMBA_CACHE_DIR).
    """
    began, jobs = time.perf_counter(), _jobs()
    with bar("warm", len(jobs), at_once=True) as progress:
        for done, job in enumerate(jobs):
            progress(done)
            with compiling():
                job()
    say(f"compiled in {time.perf_counter() - began:.0f} s; commands now begin at once")


def _jobs() -> tuple[Callable[[], Any], ...]:
    """Small jobs of every kind that runs kernels."""

    def picture(name: str) -> Callable[[], Any]:
        design = load(name)
        width, height = design.pixels
        region = (width // 2, height // 2, SMALL, SMALL)
        return lambda: render(design, default_scene(design), region=region)

    def depth(name: str) -> Callable[[], Any]:
        design = load(name)
        width, height = design.pixels
        side = 2 * SMALL
        options = PictureOptions(region=(width // 2, height // 2, side, side))
        return lambda: simulate(design, default_scene(design), options)

    def decode() -> None:
        with TemporaryDirectory() as folder:
            image, (width, height) = Path(folder) / "white.tif", load("paper").pixels
            write_image(
                render(load("paper"), WHITE_FIELD, region=(width // 2, height // 2, 2 * SMALL, 2 * SMALL)), image
            )
            decoded(image, DecodeOptions(white=image))

    return (
        lambda: evaluate("paper-singlet"),
        lambda: evaluate(load("cystoscope")),
        lambda: full_report(load("paper")),
        decode,
        *map(picture, ("paper", "cystoscope", "paper-singlet")),
        *map(depth, ("paper", "paper-singlet")),
    )
