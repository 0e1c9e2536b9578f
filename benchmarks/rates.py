"""How much the commands get done a second, inside: a pyperf script (`python -m benchmarks.rates -o FILE`)."""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from time import process_time

import numpy as np
import pyperf

from roslf_design.camera import Camera
from roslf_design.design import load
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.scenes import load_scene
from roslf_design.shapes.lattice import Lattice, lens_centres
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.theory.stop_images import MicrolensImages
from roslf_design.tolerancing.run import run_chunk
from roslf_design.tolerancing.study import plan_from

from .commands import REPOSITORY
from .turns import Row, Side, Spent, environment, last_line

STUDIES = REPOSITORY / "studies"
BLOCKS = 5
"""How often many designs are done at once."""
NOISE = ("sigma_disparity_pitches", "sigma_z_mm", "u_z_mm")
"""Quantities that rest on the texture's waves: a hundred times the work of all others."""
CLOSED = [name for name, quantity in QUANTITIES.items() if quantity.of is not None and name not in NOISE]
REGION = (2000, 1300, 300, 200)
RAYS = 64
"""A pixel."""
Work = Callable[[], object]
Ready = tuple[Work, int]
"""A piece of work, and how many units of it are done in one go."""


@dataclass(frozen=True)
class Rate:
    """One piece of work."""

    name: str
    title: str
    unit: str
    prepare: Callable[[], Ready]
    clock: Callable[[], float] = time.perf_counter
    """Processor time of what takes one core: others on the machine count less."""


def designs(count: int, names: Collection[str]) -> Ready:
    """Cameras made from arrays of lengths, and quantities of each."""
    random = np.random.default_rng(0)
    changes = {
        "main_lens.focal_plane": random.uniform(250, 600, count),
        "aperture.distance": random.uniform(20, 120, count),
        "aperture.diameter": random.uniform(1, 5, count),
    }
    paper = load("paper")
    quantities = [QUANTITIES[name] for name in names]

    def work() -> None:
        for _ in range(BLOCKS):
            camera = Camera.of(paper, changes)
            for quantity in quantities:
                quantity(camera, None if quantity.at == "never" else 340.0)

    return work, count * BLOCKS


def shapes() -> Ready:
    """Area, centre and axes of every image of the paper's array."""
    paper = load("paper")
    array = paper.microlens_array
    axes = lens_centres(Lattice(array.pitch, paper.sensor.size, array.layout))
    camera = Camera.of(paper)
    return lambda: MicrolensImages(camera, axes).shapes, len(axes)


def white(layout: str) -> Ready:
    """The white image of the whole sensor, diffraction and all."""
    design = load("paper").replace({"microlens_array.layout": layout})
    return lambda: render(design), math.prod(design.pixels)


def board() -> Ready:
    """A region of the checkerboard, a fixed number of rays a pixel."""
    paper, scene = load("paper"), load_scene(STUDIES / "paper-images/board.toml")
    fixed = RaySampling(RAYS, RAYS, 0.0)
    work = partial(render, paper, scene, region=REGION, sampling=fixed)
    return work, work().rays


def trials(study: str, adjusted: bool) -> Ready:
    """A chunk of a tolerance study's trials in this process: one but the first, which keeps trials in full."""
    data = tomllib.loads((STUDIES / study / "study.toml").read_text())
    if not adjusted:
        data.pop("compensators", None)
    plan = plan_from(data)
    return lambda: run_chunk(plan, 1), plan.chunk_trials(1)


RATES = (
    Rate("designs", f"cameras, each through {len(CLOSED)} quantities", "designs", partial(designs, 20_000, CLOSED)),
    Rate("depth-noise", "cameras, depth noise of each", "designs", partial(designs, 200, ("sigma_z_mm",))),
    Rate("shapes", "images of microlenses: area, centre, axes", "images", shapes),
    Rate("white", "white image", "pixels", partial(white, "square")),
    Rate("white-hexagonal", "white image, hexagonal array", "pixels", partial(white, "hexagonal")),
    Rate("rays", "checkerboard out of focus, traced backward", "rays", board),
    Rate("trials", "tolerance trials, as built", "trials", partial(trials, "tolerance-paper", False), process_time),
    Rate(
        "trials-adjusted",
        "tolerance trials, adjusted",
        "trials",
        partial(trials, "tolerance-paper", True),
        process_time,
    ),
    Rate("trials-traced", "trials, lens traced", "trials", partial(trials, "tolerance-singlet", False), process_time),
)


def rate(name: str) -> Rate:
    """The one of that name."""
    return next(rate for rate in RATES if rate.name == name)


def timed(loops: int, one: Rate) -> float:
    """Seconds for one unit of work, times `loops`; what makes it ready does not count, nor does a first go."""
    work, count = ready(one.prepare)
    start = one.clock()
    for _ in range(loops):
        work()
    return (one.clock() - start) / count


@cache
def ready(prepare: Callable[[], Ready]) -> Ready:
    """Work that has been done once."""
    work, count = prepare()
    work()
    return work, count


def measure(quick: bool, chosen: Sequence[str]) -> Iterator[Row]:
    """Every rate, in processes that pyperf starts; as many threads as a command takes."""
    size = ("-p", "1", "-n", "1") if quick else ("-p", "2", "-n", "3")
    for one in RATES:
        if one.name not in chosen and (chosen or (quick and one.name == "trials-traced")):
            continue
        with tempfile.TemporaryDirectory(prefix="roslf-bench-") as folder:
            file = Path(folder) / "rates.json"
            words = [sys.executable, "-m", "benchmarks.rates", "--only", one.name, "-o", str(file), *size]
            words += ["-l", "1", "-w", "0", "--quiet", "--copy-env"]
            environ = environment(None, REPOSITORY)
            done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=REPOSITORY, env=environ)
            values: list[Spent] | str = last_line(done.stderr)
            if not done.returncode:
                values = [
                    Spent(each) for each in pyperf.BenchmarkSuite.load(str(file)).get_benchmarks()[0].get_values()
                ]
        yield Row(one.name, one.title, one.unit, (Side.of("here", values),))


def main() -> None:
    """What pyperf starts, for itself and for its workers."""
    runner = pyperf.Runner(
        program_args=("-m", "benchmarks.rates"),
        add_cmdline_args=lambda command, given: command.extend(["--only", given.only]),
    )
    runner.argparser.add_argument("--only", choices=[one.name for one in RATES], required=True)
    one = rate(runner.parse_args().only)
    runner.bench_time_func(one.name, timed, one)


if __name__ == "__main__":
    main()
