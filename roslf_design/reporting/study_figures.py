"""Which pictures a tolerance study, an optimisation and a calibration have, drawn from their numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..calibration.model import UNITS
from ..calibration.result import Outcome
from ..optimization.pareto import Front
from ..optimization.problem import Goal
from ..optimization.run import Result
from ..pictures import calibration
from ..pictures.optimise import bore_and_stop, goal_front, robust_yields
from ..pictures.picture import Picture
from ..pictures.tolerance import (
    Yields,
    YieldShare,
    distributions,
    ranked_correlations,
    ranked_moves,
    yield_bars,
    yield_curve,
)
from ..tolerancing.analyses import LimitYield, Yield
from ..tolerancing.metrics import METRICS
from ..tolerancing.places import short_name
from ..tolerancing.result import StudyResult
from ..words import in_words

MOST = 14
"""Bars that a ranking shows."""

CALIBRATION: dict[str, tuple[str, Callable[[Outcome], Picture]]] = {
    "residuals": ("What the joint fit leaves over", calibration.residuals),
    "epi-lines": ("Epipolar slopes against inverse depth", calibration.epi_lines),
    "posterior": ("How sure: the posterior", lambda result: calibration.posterior(result, UNITS)),
    "depth": ("What it means for measured depths", calibration.depth_errors),
}
"""Name of each picture of a calibration: its title and what draws it."""


def calibration_pictures(result: Outcome) -> dict[str, Picture]:
    """Every picture that a calibration has."""
    return {name: plot(result) for name, (_, plot) in CALIBRATION.items()}


TOLERANCE = {
    "yield": "Yield over tolerance",
    "grades": "What a grade buys",
    "spread": "Spread of the weakest metric",
    "sensitivity": "What moves the weakest metric",
    "correlation": "What goes with the weakest metric",
}
"""Titles of a tolerance study's pictures."""


def tolerance_pictures(result: StudyResult) -> dict[str, Picture]:
    """Every picture that a tolerance study has something for.

    Over the yield, the numbers of one metric: that whose limit is the weakest.
    """
    limit = result.final.weakest
    row = [column.label for column in result.plan.columns].index(limit.label)
    yields, target = _yields(result), result.study.yield_target
    reached = None if result.scale_for_target is None else result.scale_for_target[0]
    drawn = {"yield": yield_curve(yields, (500, 320), target, reached)}
    if result.grades:
        drawn["grades"] = yield_bars(yields, (500, 0), target)
    nominal = result.variants[0].distributions[row].nominal
    nominal = nominal if np.isfinite(nominal) else 0.0
    drawn["spread"] = _spread(result, limit, row, nominal)
    moves = result.sensitivity
    order = _largest(np.nan_to_num(moves.worst[-1, row], posinf=np.finfo(float).max))
    plus, minus = (np.nan_to_num(ends[-1, row, order]) for ends in (moves.plus, moves.minus))
    limits = [edge - nominal for edge in (limit.low, limit.high)]
    drawn["sensitivity"] = ranked_moves(_names(result, order), plus, minus, limits, _metric(result, row))
    values, noise = result.correlations[row], 2 / np.sqrt(result.plan.trials)
    order = _largest(np.where(np.abs(values) > noise, np.abs(values), 0.0))
    label = _metric(result, row, unit=False)
    drawn["correlation"] = ranked_correlations(_names(result, order), values[order], noise, label)
    return drawn


def _spread(result: StudyResult, limit: LimitYield, row: int, nominal: float) -> Picture:
    """As built and, where anything is adjusted, afterwards."""
    shown = [result.variants[0]] if len(result.variants) == 1 else [result.variants[0], result.final]
    columns = [variant.distributions[row] for variant in shown]
    parts = [
        (variant.name, np.array(column.cuts), np.array(column.histogram))
        for variant, column in zip(shown, columns, strict=True)
    ]
    limits = [edge for edge in (limit.low, limit.high) if np.isfinite(edge)]
    span = columns[-1].low, columns[-1].high
    return distributions(parts, nominal, limits, span, _metric(result, row), (500, 310))


def _yields(result: StudyResult) -> Yields:
    def share(measured: Yield) -> YieldShare:
        return YieldShare(measured.value, *measured.interval)

    grades = tuple((grade.grade, share(grade.result)) for grade in result.grades)
    own = dict(grades).get(result.study.grade or "", share(result.final.result))
    return Yields(result.study.grade or "", own, grades, tuple((scale, share(at)) for scale, at in result.yield_curve))


def _names(result: StudyResult, order: NDArray[np.intp]) -> list[str]:
    return [short_name(result.plan.draws.perturbations[index].place) for index in order]


def _largest(sizes: NDArray[np.float64]) -> NDArray[np.intp]:
    """Where the largest are, in order; without those too small to be seen."""
    order = np.argsort(-sizes, kind="stable")[:MOST]
    large = order[sizes[order] > 2e-3 * sizes[order[0]]]
    return large if len(large) else order[:1]


def _metric(result: StudyResult, row: int, unit: bool = True) -> str:
    """A column's metric and field for an axis."""
    column = result.plan.columns[row]
    metric = METRICS[column.metric]
    place = ""
    if column.field is not None:
        x, y = result.plan.question.fields[column.field]
        place = f" at ({x:.3g}, {y:.3g}) mm"
    return f"{in_words(metric.name)}{place}" + (f" [{metric.unit}]" if unit and metric.unit else "")


def optimisation_pictures(result: Result) -> dict[str, Picture]:
    """Name to picture; empty where an optimisation has nothing to draw."""
    drawn = {}
    if result.bore is not None:
        pupil = result.bore.pupil
        drawn["bore"] = bore_and_stop(pupil.field_mm, pupil.kept_bore, pupil.kept_pupil, pupil.misplaced)
    if result.front is not None and len(result.front.points) > 1:
        drawn["front"] = _front(result.front, result)
    if result.robust is not None:
        robust = result.robust
        together = ("all together", robust.nominal.yield_.value, robust.robust.yield_.value)
        rows = [*robust.constraint_yields, together]
        drawn["robust"] = robust_yields([(in_words(str(row[0])), float(row[1]), float(row[2])) for row in rows])
    return drawn


def _front(front: Front, result: Result) -> Picture:
    """The first goal over the second; the third, where there is one, by shade."""
    order = [1, 0, *range(2, len(front.goals))][: max(len(front.goals), 2)]
    values = np.array([point.values for point in front.points])[:, order[:3]]
    goals = [front.goals[k] for k in order[:3]]
    log = [
        goal.quantity.positive and bool(column.max() > 3 * column.min() > 0)
        for goal, column in zip(goals, values.T, strict=True)
    ]
    x, y = (result.answer.number(goal) for goal in goals[:2])
    title = f"{in_words(goals[1].label)} against {in_words(goals[0].label)}, designs of which none is better in all"
    return goal_front(values, [_axis(goal) for goal in goals], log=log, title=title, answer=(x, y))


def _axis(goal: Goal) -> str:
    unit = f" [{goal.quantity.unit}]" if goal.quantity.unit else ""
    return f"{in_words(goal.label)}{unit} ({'less' if goal.direction == 'min' else 'more'} is better)"
