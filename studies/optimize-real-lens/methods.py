"""Ways to choose and to shape a real main lens, on two problems of the paper's bench: which is cheap, which is sure.

Run again: python studies/optimize-real-lens/methods.py   (some minutes; writes reports/optimize-real-lens/methods.json)

Each way looks at the same traced problem and is judged by images integrated ray by ray of the design that it ended at.
The yardstick is scipy's differential evolution over designs traced one at a time.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution

import roslf_design as roslf
from roslf_design.catalogue import load_catalogue
from roslf_design.errors import InputError
from roslf_design.optimization import Constraint, Goal
from roslf_design.optimization.combinations import CatalogueTable, Combinations
from roslf_design.optimization.lens_variables import BENDING
from roslf_design.optimization.problem import DesignProblem, promising_starts, sobol_units
from roslf_design.optimization.search import Guard, SearchBudget, derivative_free, globally, search
from roslf_design.optimization.variables import NumberVariable, Variable
from roslf_design.traced.camera import camera_of, microlenses
from roslf_design.traced.images import real_images

Array = NDArray[np.float64]

REPORT = Path(__file__).resolve().parents[2] / "reports" / "optimize-real-lens" / "methods.json"
BENCH = roslf.load("paper-singlet").replace({"depth.disparity_error": 0.1})
AXIS, CORNER = (0.0, 0.0), (11.0, 7.0)
PITCH = BENCH.d
STARTS = 3
FINE = 256
"""Points of a boundary by which designs are compared in the end: areas of cut images are then right to 3e-5."""
PENALTY = 10.0
"""Of a scaled violation, where a way takes no limits."""
SURE = 6
"""Combinations that a ranking by thin-lens models passes on."""


@dataclass(frozen=True)
class Question:
    """A problem, its combinations, and what its designs are judged by."""

    name: str
    combinations: Combinations
    cost: Callable[[roslf.Design, int], float]
    """Of a design, by images integrated ray by ray, from so many points of their boundaries."""


def judged(wide: tuple[float, float], merit: Callable[[Any], float]) -> Callable[[roslf.Design, int], float]:
    """A merit of both images, and a penalty where the one at a field is wider than the pitch."""

    def cost(design: roslf.Design, points: int) -> float:
        try:
            lit = real_images(camera_of(design), microlenses(design, np.array([AXIS, CORNER])), points=points)
        except InputError:
            return 30.0
        value, width = merit(lit), lit.diameter[(AXIS, CORNER).index(wide)]
        whole = wide == AXIS or lit.kept_fraction[1] >= 1 - 1e-9
        if not (np.isfinite(value) and np.isfinite(width) and whole):
            return 30.0
        return float(value + PENALTY * max(0.0, np.log(width / PITCH)))

    return cost


def questions() -> tuple[Question, ...]:
    """Which lens, and which shape and glass."""

    def between(low: float, high: float) -> Variable:
        return Variable(min=low, max=high)

    fits = Constraint(quantity="image_diameter_mm", field=AXIS, max=PITCH)
    bought = DesignProblem(
        "bought",
        BENCH,
        {"D_F": between(2, 5), "d_3": between(80, 140)},
        (fits,),
        (Goal(quantity="image_area_mm2", field=CORNER, direction="max"),),
    )
    table = CatalogueTable(
        kinds=("lenses", "orientations"), where={"lenses": ("focal_length>=90 mm", "focal_length<=120 mm")}
    )
    own = DesignProblem(
        "own",
        BENCH,
        {BENDING: NumberVariable(min=-2.5, max=2.5), "D_F": between(1, 6), "d_3": between(80, 140)},
        (
            Constraint(quantity="image_diameter_mm", field=CORNER, max=PITCH),
            Constraint(quantity="kept_fraction", field=CORNER, min=1 - 1e-9),
        ),
        (Goal(quantity="image_diameter_mm", field=AXIS, direction="max"),),
    )
    glasses = ("N-BK7", "N-LAK22", "SF5", "N-SF11")
    parts = table.chosen(load_catalogue(), BENCH.main_lens.kind)
    return (
        Question(
            "which of four lenses, either way round",
            Combinations.of(bought, parts, table.kinds),
            judged(AXIS, lambda lit: -np.log(max(lit.area[1], 1e-12))),
        ),
        Question(
            "bending of a singlet of four glasses",
            Combinations.of(own, parts, ("glasses",), glasses=glasses),
            judged(CORNER, lambda lit: -np.log(lit.diameter[0])),
        ),
    )


@dataclass
class Counted:
    """A traced problem whose points are counted: every one that is traced, those of derivatives, too."""

    problem: DesignProblem
    points: int = 0

    def __call__(self, units: Array) -> Array:
        """As `DesignProblem.vector`."""
        self.points += len(units)
        return self.problem.vector(units)

    def penalised(self, unit: Array) -> float:
        """Merit and violations in one number."""
        values = self(np.clip(unit, 0, 1)[None])[:, 0]
        if not np.isfinite(values).all():
            return 1e3
        return float(values[0] + PENALTY * np.maximum(values[1:], 0.0).sum())


Outcome = tuple[float, Array]
"""Merit with penalty, and the point."""


def by_gradients(counted: Counted, starts: Sequence[Array]) -> Outcome:
    """SLSQP on five-point differences, all their points one batch: what `roslf optimize` does."""
    results = [search(counted, start, SearchBudget(), 80, 1e-9) for start in starts]
    best = min(results, key=lambda result: (not result.feasible, result.merit))
    return counted.penalised(best.unit), best.unit


def by_simplex(name: Any) -> Callable[[Counted, Sequence[Array]], Outcome]:
    """One of nlopt's derivative-free searches, on the merit with a penalty."""

    def run(counted: Counted, starts: Sequence[Array]) -> Outcome:
        ends = []
        for start in starts:
            unit, _ = derivative_free(
                name,
                lambda unit: (counted.penalised(unit),),
                start,
                step=0.1,
                xtol=1e-6,
                budget=SearchBudget().at_most(200),
            )
            ends.append((counted.penalised(unit), unit))
        return min(ends, key=lambda end: end[0])

    return run


def by_crs(counted: Counted, starts: Sequence[Array]) -> Outcome:
    """CRS2_LM, once over the whole box."""
    guard = Guard(counted, SearchBudget())
    unit = globally(guard, len(starts[0]), "crs2", PENALTY, 400 * len(starts), 0, 1e-9)
    return counted.penalised(unit), unit


def enumerated(
    combinations: Combinations, way: Callable[[Counted, Sequence[Array]], Outcome], numbers: Sequence[int]
) -> tuple[roslf.Design, int]:
    """The best of some combinations, each searched by itself, and the points traced."""
    ends, points = [], 0
    for number in numbers:
        problem = combinations.problem_at(number)
        counted = Counted(problem)
        middle = [np.full(problem.n, 0.5)]
        starts = promising_starts(problem, [*middle, *sobol_units(problem.n, STARTS - 1, 1)], STARTS, 1)
        counted.points += 8 * STARTS
        ends.append((*way(counted, starts), problem))
        points += counted.points
    _, unit, problem = min(ends, key=lambda end: end[0])
    return problem.design_at(unit), points


def thin_ranking(combinations: Combinations) -> list[int]:
    """Combinations in the order of what their ideal twins reach, f and D alone: cheap, blind to bending and turning."""
    merits = []
    for number in range(len(combinations)):
        problem = combinations.problem_at(number)
        variables = {name: v for name, v in problem.variables.items() if name != BENDING}
        thin = replace(problem, design=problem.design.thin_twin, variables=variables)
        values = thin.vector(sobol_units(thin.n, 4096, 1))
        cost = values[0] + PENALTY * np.maximum(values[1:], 0).sum(axis=0)
        merits.append(float(np.nanmin(cost)))
    return [int(k) for k in np.argsort(merits, kind="stable")]


def all_at_once(combinations: Combinations) -> tuple[roslf.Design, int]:
    """CRS2_LM over everything, the combination's number as one more continuous variable."""
    counters = [Counted(combinations.problem_at(number)) for number in range(len(combinations))]
    n = combinations.problem.n

    def cost(unit: Array) -> tuple[float]:
        number = min(int(unit[0] * len(counters)), len(counters) - 1)
        return (counters[number].penalised(unit[1:]),)

    unit, _ = derivative_free("GN_CRS2_LM", cost, np.full(1 + n, 0.5), xtol=1e-7, budget=SearchBudget().at_most(4000))
    number = min(int(unit[0] * len(counters)), len(counters) - 1)
    return counters[number].problem.design_at(unit[1:]), sum(counter.points for counter in counters)


def ended(question: Question, design: roslf.Design) -> dict[str, Any]:
    """What a design costs, and its lens."""
    assert design.lens is not None
    return {"cost": question.cost(design, FINE), "lens": design.lens.name}


def evolved(question: Question) -> tuple[roslf.Design, int]:
    """Differential evolution over designs traced one at a time; its best design, and how many were traced."""
    problems = [question.combinations.problem_at(number) for number in range(len(question.combinations))]

    def design(numbers: Array) -> roslf.Design:
        return problems[int(numbers[0])].design_at(np.asarray(numbers[1:]))

    n = question.combinations.problem.n
    bounds = Bounds([0.0] * (1 + n), [float(len(problems) - 1), *[1.0] * n])

    def cost(numbers: Array) -> float:
        return question.cost(design(numbers), 64)

    result = differential_evolution(
        cost,
        bounds,
        integrality=[True, *[False] * n],
        seed=1,
        popsize=10,
        maxiter=70,
        tol=1e-7,
        polish=False,
    )
    return design(result.x), int(result.nfev)


def main() -> None:
    """Both questions, every way."""
    answers = []
    for question in questions():
        combinations = question.combinations
        every = range(len(combinations))
        few = thin_ranking(combinations)[:SURE]
        ways: dict[str, Callable[[], tuple[roslf.Design, int]]] = {
            "each by SLSQP on batched differences": partial(enumerated, combinations, by_gradients, every),
            f"the {SURE} best thin-lens models by the same": partial(enumerated, combinations, by_gradients, few),
            "each by COBYLA": partial(enumerated, combinations, by_simplex("LN_COBYLA"), every),
            "each by BOBYQA": partial(enumerated, combinations, by_simplex("LN_BOBYQA"), every),
            "each by Nelder and Mead's simplex": partial(enumerated, combinations, by_simplex("LN_NELDERMEAD"), every),
            "each by CRS2_LM": partial(enumerated, combinations, by_crs, every),
            "all at once by CRS2_LM": partial(all_at_once, combinations),
        }
        enumerated(combinations, by_gradients, every[:1])  # compiled kernels are not what is measured
        rows: list[dict[str, Any]] = []
        for name, way in ways.items():
            began = time.process_time()
            design, points = way()
            seconds = round(time.process_time() - began, 2)
            rows.append({"way": name, "points": points, "seconds": seconds, **ended(question, design)})
            print(question.name, rows[-1], flush=True)
        began = time.process_time()
        design, points = evolved(question)
        known = {"points": points, "seconds": round(time.process_time() - began, 1), **ended(question, design)}
        print(question.name, known, flush=True)
        for row in rows:
            row["worse_than_evolution"] = row["cost"] - known["cost"]
        answers.append({"question": question.name, "combinations": len(combinations), "ways": rows, "evolution": known})
        REPORT.parent.mkdir(parents=True, exist_ok=True)
        REPORT.write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
