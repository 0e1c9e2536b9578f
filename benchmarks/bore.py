"""What windows and prisms before the main lens cost: a camera behind three, and the one in air that sees the same."""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from roslf_design.camera import Camera
from roslf_design.design import Design, load
from roslf_design.design.files import dumps
from roslf_design.evaluation.evaluate import evaluate
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import RaySampling
from roslf_design.scenes import Scene, load_scene
from roslf_design.tolerancing.run import run_chunk
from roslf_design.tolerancing.study import plan_from

from .commands import REPOSITORY
from .turns import Row, Run, Side, in_turn

ROUNDS = {True: 3, False: 9}
SECONDS = {True: 6.0, False: 60.0}
"""After which a row is not run again."""
TRIALS = 1 << 15
REGION = (600, 300, 64, 48)
RAYS = 32
"""A pixel."""
FEW = 40
"""Evaluations in one run, each of another design."""
PLACES = {"aperture.diameter": "4 um", "aperture.distance": "10 um", "sensor.distance": "1 um", "f": "0.2 %"}
GOALS = {"fill_factor": 0.9, "kept_fraction": 0.99, "depth_error_mm": -0.5}
"""Metric to the least that is good."""


def behind_three() -> Design:
    """The arthroscope with a filter between prism and window."""
    scope = load("arthroscope").replace({"microlens_array.substrate": None, "sensor.distance": 0.13})
    prism, window = scope.elements
    glass = {"kind": "plate", "distance": 3.82, "thickness": 0.15, "material": "N-BK7", "diameter": 2.6}
    between = type(window).model_validate(glass, context={"from_file": False})
    return scope.replace({"elements": [prism, between, window]})


def twin_in_air(design: Design) -> Design:
    """The camera in air that sees the same through the same openings."""
    c = Camera.of(design)
    stops = [{"diameter": 2 * float(rim.radius), "distance": float(rim.distance)} for rim in c.rims[1:]]
    apparent = {"aperture.distance": float(c.seen.d_3), "aperture.diameter": float(c.seen.D_F)}
    apparent["microlens_array.distance"] = design.d_1
    return design.replace({"elements": [], "object_space.medium": "air", "stops": stops, **apparent})


def timed(work: Callable[[], object]) -> Run:
    """Work as `in_turn` runs it."""

    def run() -> float:
        start = time.perf_counter()
        work()
        return time.perf_counter() - start

    return run


def evaluations(design: Design) -> Run:
    """Designs that nobody has evaluated yet."""
    numbers = itertools.count()

    def run() -> float:
        fresh = [design.replace({"name": f"design {next(numbers)}"}) for _ in range(FEW)]
        return timed(lambda: [evaluate(each) for each in fresh])() / FEW

    return run


def trials(design: Design) -> Run:
    """A chunk of a tolerance study."""
    study = {
        "name": "bore",
        "trials": TRIALS,
        "seed": 1,
        "sobol_samples": 256,
        "perturb": [{"place": place, "tolerance": tolerance} for place, tolerance in PLACES.items()],
        "goals": [{"metric": metric, "min": least} for metric, least in GOALS.items()],
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "design.toml"
        file.write_text(dumps(design))
        plan = plan_from(study | {"design": str(file)})
    return timed(partial(run_chunk, plan, 0))


def picture(design: Design, scene: Scene | None, *overrides: str) -> Run:
    """A white image of the whole sensor; of a scene a region, a fixed number of rays a pixel."""
    if scene is None:
        return timed(partial(render, design, overrides=overrides))
    fixed = RaySampling(RAYS, RAYS, 0.0)
    return timed(partial(render, design, scene, region=REGION, sampling=fixed, overrides=overrides))


def measure(quick: bool, chosen: Sequence[str]) -> Iterator[Row]:
    """Both cameras in turn at each piece of work."""
    through = behind_three()
    air = twin_in_air(through)
    board = load_scene(REPOSITORY / "studies/paper-images/board.toml")
    boards = tuple(thing.model_copy(update={"distance": 1.05 * through.d_f}) for thing in board.surfaces)
    ahead = board.model_copy(update={"objects": boards})
    first_order = "-plate_aberration"
    works: dict[str, tuple[str, Run, Run]] = {
        "bore-evaluate": ("evaluate, each time another design", evaluations(air), evaluations(through)),
        "bore-trials": (f"tolerance study, {TRIALS:,} trials", trials(air), trials(through)),
        "bore-white": (
            "white image, elements to first order",
            picture(air, None),
            picture(through, None, first_order),
        ),
        "bore-board": (
            "checkerboard, elements to first order",
            picture(air, ahead),
            picture(through, ahead, first_order),
        ),
        "bore-exact": ("checkerboard, elements by Snell's law", picture(air, ahead), picture(through, ahead)),
    }
    for name, (title, without, behind) in works.items():
        if name in chosen or not chosen:
            turns = in_turn({"air": without, "elements": behind}, ROUNDS[quick], SECONDS[quick])
            sides = Side.of("in air", turns["air"]), Side.of("behind three elements", turns["elements"])
            yield Row(name, title, sides=sides)
