"""A whole study: the bore reduced, the problem solved, whatever else the file asks for, and all of it as JSON."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ..design import Design
from ..errors import InputError, Problem
from ..json_data import plain
from .bore import Bore, judged_at, through_bore
from .conflicts import Conflict
from .pareto import Front, pareto_front
from .parts import load_catalogue
from .problem import Constraint, Goal
from .ranking import Combinations, Ranking, rank
from .robust import BuildStatistics, Robust, Scatter, maximise_robustness, scatter_of
from .solve import Answer, Tell, optimum_accuracy, solve
from .study import OptimizeStudy

SCHEMA = "roslf.optimization/1"


@dataclass(frozen=True)
class Result:
    """Everything that a study found."""

    study: OptimizeStudy
    answer: Answer
    bore: Bore | None
    front: Front | None
    robust: Robust | None
    scatter: Scatter | None
    ranking: Ranking | None
    seconds: float


def run(study: OptimizeStudy, tell: Tell = lambda _: None) -> Result:
    """Run a study; `tell` is told what is being done.

    Raises
    ------
    InputError
        The bore does not go with the base design; a catalogue file or a perturbation is wrong.
    """
    began = time.monotonic()
    table, settings, problem = study.table, study.settings, study.problem
    scatter = combinations = bore = front = robust = ranking = None
    if table.robust is not None:
        scatter = scatter_of(table.robust, problem.design, settings.seed)
    if table.catalogue is not None:
        files = [study.folder / name for name in table.catalogue.files]
        catalogue = load_catalogue(files, shipped=table.catalogue.shipped)
        empty = [kind for kind in table.catalogue.kinds if not catalogue.of(kind)]
        if empty:
            words = f"holds no {', '.join(empty)}; add some, or leave the kind out"
            raise InputError((Problem("catalogue", words),))
    if table.rims:
        problem, bore = through_bore(problem, table.rims, settings, tell)
    answer = solve(problem, settings, tell)
    if bore is not None:
        bore = judged_at(bore, table.rims, answer)
    if answer.feasible and table.pareto is not None:
        goals = [next(goal for goal in problem.goals if goal.quantity.name == name) for name in table.pareto.goals]
        deadline = time.monotonic() + settings.seconds
        front = pareto_front(problem, goals, table.pareto.points, [answer.unit], deadline, settings.seed, tell)
    if answer.feasible and table.robust is not None and scatter is not None:
        deadline = time.monotonic() + settings.seconds
        robust = maximise_robustness(problem, table.robust, scatter, answer.unit, deadline, tell)
    if table.catalogue is not None:
        combinations = Combinations.of(problem, catalogue, table.catalogue.kinds)
        ranking = rank(combinations, table.catalogue.keep, settings.seconds, settings.seed, tell)
    return Result(study, answer, bore, front, robust, scatter, ranking, time.monotonic() - began)


def designs(result: Result) -> Iterator[tuple[str, Design]]:
    """File name and design of everything worth keeping; a point that is no design has none."""
    answer = result.answer
    title, source = answer.asked.name, f"roslf optimize, from {answer.problem.design.name}"
    name, kind = ("best.toml", "optimised") if answer.feasible else ("least-violating.toml", "least-violating")
    try:
        yield name, answer.problem.design_at(answer.unit, f"{title}, {kind}").replace({"source": source})
    except InputError:
        if answer.feasible:
            raise
    if result.robust is not None:
        robust = answer.problem.design_at(result.robust.unit, f"{title}, robust")
        yield "robust.toml", robust.replace({"source": source})
    if result.ranking is not None:
        combinations = result.ranking.combinations
        for place, ranked in enumerate(result.ranking.best, 1):
            problem = combinations.problem_at(ranked.number)
            design = problem.design_at(ranked.search.unit, f"{title}, parts {place}")
            parts = ", ".join(part.part for part in combinations.chosen(ranked.number))
            yield f"parts-{place:02d}.toml", design.replace({"source": f"catalogue: {parts}"})


def to_dict(result: Result, *, timings: bool = True) -> dict[str, Any]:
    """The study's results as one JSON object, what is not finite null; without timings the same bytes every time."""
    answer = result.answer
    accuracy = optimum_accuracy(answer, result.study.settings, result.seconds)
    data: dict[str, Any] = {
        "schema": SCHEMA,
        "study": answer.asked.name,
        "base_design": answer.problem.design.name,
        "seed": result.study.settings.seed,
        "status": "optimal" if answer.feasible else "infeasible",
        "variables_mm": answer.variables(),
        "goals": [_part(answer, goal) | {"direction": goal.direction} for goal in answer.asked.goals],
        "constraints": [_part(answer, c) | {"min": c.low, "max": c.high} for c in answer.asked.constraints],
        "violation": answer.violation,
        "accuracy": None if accuracy is None else accuracy.to_dict(timings),
        "active": None if answer.conditions is None else answer.conditions.active,
        "trust": _trust(answer),
        "stages": answer.stages,
        "infeasible": None if answer.conflict is None else _conflict(answer.conflict),
        "bore": None if result.bore is None else _bore(result.bore),
        "front": None if result.front is None else _front(result.front, answer),
        "robust": _robust(result),
        "catalogue": None if result.ranking is None else _ranking(result.ranking, timings),
        "loose_variables_mm": answer.loose(),
        "notes": answer.notes,
    }
    if timings:
        data["seconds"] = {"solve": answer.seconds, "all": result.seconds}
    finite: dict[str, Any] = plain(data)
    return finite


def _part(answer: Answer, part: Constraint | Goal) -> dict[str, Any]:
    own = {"quantity": part.quantity.name, "unit": part.quantity.unit, "value": answer.number(part)}
    return own if part.at is None else own | {"at_mm": part.at}


def _trust(answer: Answer) -> dict[str, Any]:
    return {
        "solver": "nlopt LD_SLSQP from Sobol points",
        "evaluations": answer.evaluations,
        "starts": len(answer.searches),
        "starts_feasible": answer.reached,
        "starts_at_the_answer": answer.same,
        "first_order_residual": None if answer.conditions is None else answer.conditions.residual,
        "gradient_error": answer.gradient_error,
        "checks": [
            {
                "solver": check.solver,
                "evaluations": check.evaluations,
                "merit": check.merit,
                "merit_polished": check.polished.merit if check.polished.feasible else None,
                "agrees": check.agrees(answer.merit),
            }
            for check in answer.checks
        ],
        "merit": answer.merit,
    }


def _conflict(conflict: Conflict) -> dict[str, Any]:
    return {
        "violations": conflict.violations,
        "cannot_hold_together": conflict.smallest,
        "smaller_sets_shown_feasible": conflict.complete,
        "relaxations": [
            {"limit": r.label, "from": r.limit, "to": r.needed, "unit": r.unit} for r in conflict.relaxations
        ],
        "bounds_touched": conflict.bounds,
    }


def _bore(bore: Bore) -> dict[str, Any]:
    return {
        "pupil_diameter_mm": bore.pupil.diameter,
        "pupil_distance_mm": bore.pupil.distance,
        "worst_kept_difference": bore.pupil.worst_kept_difference,
        "worst_misplaced": bore.pupil.worst_misplaced,
        "fields_mm": bore.pupil.field_mm,
        "kept_bore": bore.pupil.kept_bore,
        "kept_pupil": bore.pupil.kept_pupil,
        "passes": bore.passes,
        "settled": bore.settled,
    }


def _front(front: Front, answer: Answer) -> dict[str, Any]:
    labels = [goal.label for goal in front.goals]
    return {
        "goals": [{"goal": g.label, "direction": g.direction, "unit": g.quantity.unit} for g in front.goals],
        "points": [
            {
                "goals": dict(zip(labels, point.values, strict=True)),
                "variables_mm": answer.problem.named(point.unit),
            }
            for point in front.points
        ],
        "limits_without_design": front.failed,
        "dominated": front.dominated,
        "evaluations": front.evaluations,
        "complete": front.complete,
    }


def _robust(result: Result) -> dict[str, Any] | None:
    robust, table, scatter = result.robust, result.study.table.robust, result.scatter
    if robust is None or table is None or scatter is None:
        return None

    def told(builds: BuildStatistics) -> dict[str, Any]:
        return {
            "yield": builds.yield_.value,
            "interval_95": builds.yield_.interval,
            "goal": builds.goal_nominal,
            "goal_quantile": builds.goal_quantile,
        }

    return {
        "maximised": table.maximise,
        "quantile": table.quantile,
        "perturbations": [
            {"place": p.place, "tolerance": p.tolerance, "distribution": p.distribution} for p in scatter.perturbations
        ],
        "nominal": told(robust.nominal),
        "robust": told(robust.robust),
        "robust_variables_mm": result.answer.problem.named(robust.unit),
        "price": robust.robust.goal_nominal / robust.nominal.goal_nominal - 1 if robust.nominal.goal_nominal else None,
        "constraints": [{"constraint": name, "nominal": a, "robust": b} for name, a, b in robust.constraint_yields],
        "trials": robust.trials,
        "evaluations": robust.evaluations,
    }


def _ranking(ranking: Ranking, timings: bool) -> dict[str, Any]:
    rows = []
    for place, ranked in enumerate(ranking.best, 1):
        problem, unit = ranking.combinations.problem_at(ranked.number), ranked.search.unit
        parts = [part.part for part in ranking.combinations.chosen(ranked.number)]
        rows.append(
            {
                "rank": place,
                "parts": dict(zip(ranking.combinations.kinds, parts, strict=True)),
                "goals": {goal.label: problem.number(goal, unit) for goal in problem.goals},
                "variables_mm": problem.named(unit),
                "file": f"parts-{place:02d}.toml",
            }
        )
    told = {
        "combinations": len(ranking.combinations),
        "ruled_out_by_bounds": ranking.ruled_out,
        "optimised": ranking.optimised,
        "open": ranking.open,
        "best": rows,
    }
    return told | {"seconds": ranking.seconds} if timings else told
