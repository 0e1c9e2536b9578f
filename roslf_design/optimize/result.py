"""What a study found as one JSON object; what is not finite is null."""

from __future__ import annotations

from typing import Any

from ..json_data import null_unless_finite
from .conflicts import Conflict
from .precision import optimum_accuracy
from .problem import Constraint, Goal
from .robust import Spread, names_of
from .run import Result
from .search import Ranking
from .solve import Answer

SCHEMA = "roslf.optimization/1"


def to_dict(result: Result, *, timings: bool = True) -> dict[str, Any]:
    """The JSON object.

    Parameters
    ----------
    result : Result
    timings : bool
        Whether seconds are told; without, the same study gives the same bytes.
    """
    answer = result.answer
    worth = optimum_accuracy(answer, result.study.settings, result.seconds)
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
        "accuracy": None if worth is None else worth.to_dict(timings),
        "active": None,
        "trust": _trust(answer),
        "stages": [{"goal": s.goal, "value": s.value, "held": s.held} for s in answer.stages],
        "infeasible": None if answer.conflict is None else _conflict(answer.conflict),
        "bore": _bore(result),
        "front": _front(result),
        "robust": _robust(result),
        "catalogue": None if result.ranking is None else _ranking(result.ranking, timings),
        "loose_variables_mm": {name: list(ends) for name, ends in answer.loose().items()},
        "notes": list(answer.notes),
    }
    if answer.conditions is not None:
        data["active"] = [
            {
                "limit": a.label,
                "unit": a.unit,
                "multiplier": a.multiplier,
                "merit_gain_per_unit": a.merit_per_unit,
                "goal_gain_per_unit": a.goal_per_unit,
            }
            for a in answer.conditions.active
        ]
    if timings:
        data["seconds"] = {"solve": answer.seconds, "all": result.seconds}
    finite: dict[str, Any] = null_unless_finite(data)
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
        "violations": [
            {"limit": v.label, "value": v.value, "wanted": v.limit, "unit": v.unit} for v in conflict.violations
        ],
        "cannot_hold_together": list(conflict.smallest),
        "smaller_sets_shown_feasible": conflict.complete,
        "relaxations": [
            {"limit": r.label, "from": r.limit, "to": r.needed, "unit": r.unit} for r in conflict.relaxations
        ],
        "bounds_touched": list(conflict.bounds),
    }


def _bore(result: Result) -> dict[str, Any] | None:
    if result.bore is None:
        return None
    pupil = result.bore.pupil
    return {
        "pupil_diameter_mm": pupil.diameter,
        "pupil_distance_mm": pupil.distance,
        "worst_kept_difference": pupil.worst_kept_difference,
        "worst_misplaced": pupil.worst_misplaced,
        "fields_mm": pupil.field_mm.tolist(),
        "kept_bore": pupil.kept_bore.tolist(),
        "kept_pupil": pupil.kept_pupil.tolist(),
        "passes": result.bore.passes,
        "settled": result.bore.settled,
    }


def _front(result: Result) -> dict[str, Any] | None:
    front = result.front
    if front is None:
        return None
    problem = result.answer.problem
    rows = []
    for point in front.points:
        values = problem.values(point.unit[None])
        goals = {goal.label: value for goal, value in zip(front.goals, point.values, strict=True)}
        rows.append({"goals": goals, "variables_mm": {v.name: float(values[v.place][0]) for v in problem.variables}})
    return {
        "goals": [
            {"goal": goal.label, "direction": goal.direction, "unit": goal.quantity.unit} for goal in front.goals
        ],
        "points": rows,
        "limits_without_design": front.failed,
        "dominated": front.dominated,
        "evaluations": front.evaluations,
        "complete": front.complete,
    }


def _robust(result: Result) -> dict[str, Any] | None:
    robust, table, scatter = result.robust, result.study.table.robust, result.scatter
    if robust is None or table is None or scatter is None:
        return None
    problem = result.answer.problem
    values = problem.values(robust.unit[None])
    return {
        "maximised": table.maximise,
        "quantile": table.quantile,
        "perturbations": list(names_of(scatter)),
        "nominal": _spread(robust.nominal),
        "robust": _spread(robust.robust),
        "robust_variables_mm": {v.name: float(values[v.place][0]) for v in problem.variables},
        "price": robust.robust.goal_nominal / robust.nominal.goal_nominal - 1 if robust.nominal.goal_nominal else None,
        "constraints": [{"constraint": name, "nominal": a, "robust": b} for name, a, b in robust.constraint_yields],
        "trials": robust.trials,
        "evaluations": robust.evaluations,
    }


def _spread(spread: Spread) -> dict[str, Any]:
    return {
        "yield": spread.yield_.value,
        "interval_95": list(spread.yield_.interval),
        "goal": spread.goal_nominal,
        "goal_quantile": spread.goal_quantile,
    }


def _ranking(ranking: Ranking, timings: bool) -> dict[str, Any]:
    rows = []
    for place, ranked in enumerate(ranking.best, 1):
        problem = ranking.combinations.problem_at(ranked.number)
        values, cameras = problem.values(ranked.search.unit[None]), problem.cameras(ranked.search.unit[None])
        rows.append(
            {
                "rank": place,
                "parts": {
                    kind: part.part
                    for kind, part in zip(
                        ranking.combinations.kinds, ranking.combinations.chosen(ranked.number), strict=True
                    )
                },
                "goals": {g.label: float(g.values(cameras).ravel()[0]) for g in problem.goals},
                "variables_mm": {v.name: float(values[v.place][0]) for v in problem.variables},
                "file": f"parts-{place:02d}.toml",
            }
        )
    found = {
        "combinations": len(ranking.combinations),
        "ruled_out_by_bounds": ranking.ruled_out,
        "optimised": ranking.optimised,
        "open": ranking.open,
        "best": rows,
    }
    return found | {"seconds": ranking.seconds} if timings else found
