"""Which pictures a study has, drawn by `pictures.optimise` from the study's numbers."""

from __future__ import annotations

import numpy as np

from ..pictures.optimise import bore_and_stop, goal_front, robust_yields
from ..pictures.picture import Picture
from ..words import in_words
from .pareto import Front
from .problem import Goal
from .run import Result


def drawn(result: Result) -> dict[str, Picture]:
    """Name to picture; empty where a study has nothing to draw."""
    found = {}
    if result.bore is not None:
        pupil = result.bore.pupil
        found["bore"] = bore_and_stop(pupil.field_mm, pupil.kept_bore, pupil.kept_pupil, pupil.misplaced)
    if result.front is not None and len(result.front.points) > 1:
        found["front"] = plot_front(result.front, result)
    if result.robust is not None:
        robust = result.robust
        together = ("all together", robust.nominal.yield_.value, robust.robust.yield_.value)
        rows = [*robust.constraint_yields, together]
        found["robust"] = robust_yields([(in_words(str(row[0])), float(row[1]), float(row[2])) for row in rows])
    return found


def plot_front(front: Front, result: Result) -> Picture:
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
