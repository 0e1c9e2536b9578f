"""How time and memory grow with the size of the work; `python -m benchmarks.scaling NAME SIZE` does one."""

from __future__ import annotations

import math
import resource
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roslf_design.calibration.options import PlanOptions, calibration_plan
from roslf_design.depth.measure import simulate
from roslf_design.depth.pictures import PictureOptions
from roslf_design.design import Design, load
from roslf_design.design.files import dumps
from roslf_design.evaluation.evaluate import evaluate
from roslf_design.imaging.render import render
from roslf_design.scenes import load_scene
from roslf_design.tolerancing.run import run_trials
from roslf_design.tolerancing.sensitivities import sobol_indices
from roslf_design.tolerancing.study import plan_from

from .commands import REPOSITORY
from .turns import Row, RunError, Side, process

LEAST = 0.2
"""Work is repeated until it took so long [s]."""
PLATES = 12
Work = Callable[[], object]


@dataclass(frozen=True)
class Series:
    """One piece of work at several sizes, smallest first."""

    name: str
    title: str
    unit: str
    sizes: tuple[int, ...]
    prepare: Callable[[int], Work]
    most: float = 60.0
    """Processor seconds that a size may be expected to take; beyond them it is computed, not run."""
    first: int | None = None
    """Size that loads and compiles everything beforehand; None: the smallest."""
    quick: bool = True


class Growth(NamedTuple):
    """How processor time grows: exponent of a power of the size."""

    exponent: float
    error: float
    """Standard error, of how far the times lie off the power; infinite of two sizes."""
    at_end: float
    """Exponent between the two largest sizes."""
    last: tuple[float, float]
    """Largest size, and its processor seconds."""

    def at(self, size: float) -> float:
        """Processor seconds at a larger size, by the steeper of both exponents."""
        return self.last[1] * math.pow(size / self.last[0], max(self.exponent, self.at_end))

    @property
    def faster(self) -> bool:
        """Whether time grows faster than the size: by more than twice the error, or a tenth in the end."""
        return self.exponent - 2 * self.error > 1 or self.at_end > 1.1


def growth(sides: Sequence[Side]) -> Growth | None:
    """Growth over the sizes above 0 that were run; None of fewer than two."""
    points = [(side.count, side.processor[0]) for side in sides if side.processor and side.count > 0]
    if len(points) < 2:
        return None
    x, y = np.log(points).T
    exponent, start = np.polyfit(x, y, 1)
    off, free = y - start - exponent * x, len(points) - 2
    error = math.sqrt(float(off @ off) / free / float(np.sum((x - x.mean()) ** 2))) if free else math.inf
    return Growth(float(exponent), error, float((y[-1] - y[-2]) / (x[-1] - x[-2])), points[-1])


def trials(count: int) -> Work:
    """All trials of a tolerance study, as built, in this process."""
    data = tomllib.loads((REPOSITORY / "studies/tolerance-paper/study.toml").read_text()) | {"trials": count}
    plan = plan_from({key: value for key, value in data.items() if key != "compensators"})

    def work() -> None:
        with tempfile.TemporaryDirectory() as folder:
            run_trials(plan, Path(folder))

    return work


def picture(scene: str, count: int) -> Work:
    """A region in the middle of the paper's sensor, its pixels halved: 56.7 million; white where no scene is named."""
    design = load("paper")
    design = design.replace({"sensor.pixel": design.sensor.pixel / 2})
    whole, seen = np.array(design.pixels), load_scene(REPOSITORY / scene) if scene else None
    columns, rows = (int(n) for n in np.minimum(np.round(whole * math.sqrt(count / math.prod(whole))), whole))
    region = (int(whole[0] - columns) // 2, int(whole[1] - rows) // 2, columns, rows)
    return partial(render, design, seen, region=region)


def depth(count: int) -> Work:
    """Depth of so many microlenses, the picture taken before; half as many down as across."""
    paper = load("paper")
    down = round(math.sqrt(count / 2))
    size = [round(lenses * paper.microlens_array.pitch / paper.sensor.pixel) for lenses in (2 * down, down)]
    corner = [(whole - part) // 2 for whole, part in zip(paper.pixels, size, strict=True)]
    return partial(simulate, paper, None, PictureOptions(region=(corner[0], corner[1], size[0], size[1])))


def fields(count: int) -> Work:
    """A design evaluated at so many microlenses, for the first time."""
    paper, places = load("paper"), [(float(x), 0.3 * float(x)) for x in np.linspace(0, 11, count)]
    return lambda: evaluate(paper.replace({"name": f"at {time.perf_counter_ns()}"}), places)


def boards(count: int) -> Work:
    """The plan of a calibration by so many pictures of a board."""
    return partial(calibration_plan, load("paper"), PlanOptions(boards=count))


def behind(count: int) -> Design:
    """The paper's bench behind so many glass plates."""
    plate = {"kind": "plate", "thickness": 1.0, "material": "N-BK7", "diameter": 60.0}
    return load("paper").replace({"elements": [plate | {"distance": 8.0 * (k + 1)} for k in range(count)]})


def elements(count: int) -> Work:
    """A design behind plates evaluated for the first time."""
    design = behind(count)
    return lambda: evaluate(design.replace({"name": f"at {time.perf_counter_ns()}"}))


def traced_elements(count: int) -> Work:
    """A region of the checkerboard behind plates, by Snell's law."""
    scene = load_scene(REPOSITORY / "studies/paper-images/board.toml")
    return partial(render, behind(count), scene, region=(2000, 1300, 96, 64))


def sobol(count: int) -> Work:
    """Sobol indices of so many factors: thicknesses and places of plates."""
    places = [f"elements.{k}.{length}" for length in ("thickness", "distance") for k in range(PLATES)][:count]
    study = {
        "name": "sobol",
        "trials": 1,
        "seed": 1,
        "sobol_samples": 256,
        "goals": [{"metric": "fill_factor", "min": 0.9}],
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "design.toml"
        file.write_text(dumps(behind(PLATES)))
        plan = plan_from(study | {"design": str(file), "perturb": [{"place": places, "tolerance": "20 um"}]})
    return partial(sobol_indices, plan, 256)


PIXELS = (300_000, 1_200_000, 5_000_000, 56_672_000)
BOARD = "studies/paper-images/board.toml"
SERIES = (
    Series("trials", "tolerance: trials, as built", "trials", tuple(10**k for k in range(3, 8)), trials, 120.0),
    Series("white", "render: white", "pixels", PIXELS, partial(picture, ""), 300.0, 20_000),
    Series("board", "render: checkerboard", "pixels", PIXELS, partial(picture, BOARD), 300.0, 5000, False),
    Series("depth", "depth: region", "microlenses", (200, 800, 3200, 12_800), depth, quick=False),
    Series("fields", "evaluate: fields", "microlenses", (4, 20, 100, 500), fields),
    Series("boards", "calibrate --plan: boards", "boards", (4, 8, 16, 32, 64), boards),
    Series("elements", "evaluate: plates before the lens", "elements", (0, 1, 2, 4, 8, 12), elements),
    Series("traced", "render: checkerboard behind plates", "elements", (0, 1, 2, 4, 8, 12), traced_elements),
    Series("sobol", "tolerance: Sobol indices", "factors", (2, 4, 8, 16, 24), sobol),
)


def measure(quick: bool, chosen: Sequence[str]) -> Iterator[Row]:
    """Every series, each size in a process of its own; of a quick run the first three sizes."""
    for series in SERIES:
        if (name := f"scaling-{series.name}") in chosen or not (chosen or (quick and not series.quick)):
            sides: list[Side] = []
            for size in series.sizes[: 3 if quick else None]:
                sides.append(one(series, size, growth(sides)))
            yield Row(name, series.title, series.unit, tuple(sides))


def one(series: Series, size: int, before: Growth | None) -> Side:
    """One size; only computed where smaller ones say that it takes too long."""
    label = f"{size:,}"
    if before is not None and (seconds := before.at(size)) > series.most:
        return Side(label, count=size, fault=f"computed from the smaller ones, not run: {seconds:.0f} s")
    try:
        spent = process((sys.executable, "-m", "benchmarks.scaling", series.name, str(size)), REPOSITORY, True)()
    except RunError as error:
        return Side(label, count=size, fault=str(error))
    return Side.of(label, [spent], size)


def main(name: str, size: str) -> None:
    """Do one size, after a small one; print seconds of wall and processor of one go."""
    series = next(series for series in SERIES if series.name == name)
    series.prepare(series.first or series.sizes[0])()
    work = series.prepare(int(size))
    wall, busy, rounds = time.perf_counter(), processor(), 0
    while rounds == 0 or processor() - busy < LEAST:
        work()
        rounds += 1
    print((time.perf_counter() - wall) / rounds, (processor() - busy) / rounds)


def processor() -> float:
    """Processor seconds of this process and of those that it waited for."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(used.ru_utime + used.ru_stime for used in usage)


if __name__ == "__main__":
    main(*sys.argv[1:])
