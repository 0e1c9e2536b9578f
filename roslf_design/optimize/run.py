"""A whole study: the bore reduced, the problem solved, and whatever else the file asks for."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..design import Design
from ..effects.field import half_sizes
from ..errors import InputError
from ..errors import Problem as Fault
from .bore import EquivalentPupil, judge_pupil, reduce_bore
from .combinations import Combinations
from .pareto import Front, pareto_front
from .parts import load_catalogue
from .problem import Problem
from .robust import Robust, Scatter, maximise_robustness, scatter_of
from .search import Ranking, rank
from .solve import Answer, Settings, solve
from .study import Study, with_design

Tell = Callable[[str], None]

PASSES = 12
"""Most times that a bore is reduced again for the field of the optimum."""
SETTLED = 1e-6
"""Relative change of D_F and d_3 at which the bore's reduction has settled."""


@dataclass(frozen=True)
class Bore:
    """What stands for the bore."""

    pupil: EquivalentPupil
    passes: int
    settled: bool
    """Whether another reduction would change nothing."""


@dataclass(frozen=True)
class Result:
    """Everything that a study found."""

    study: Study
    answer: Answer
    bore: Bore | None
    front: Front | None
    robust: Robust | None
    scatter: Scatter | None
    ranking: Ranking | None
    seconds: float


def run(study: Study, tell: Tell = lambda _: None) -> Result:
    """Run a study.

    Parameters
    ----------
    study : Study
    tell : callable
        Told what is being done.

    Raises
    ------
    InputError
        The bore does not go with the base design; a catalogue file or a perturbation is wrong.
    """
    began = time.monotonic()
    table, settings = study.table, study.settings
    problem, bore = study.problem, None
    scatter = None
    if table.robust is not None:
        scatter = scatter_of(table.robust, problem.design, problem, settings.seed)
    catalogue = None
    if table.catalogue is not None:
        files = [study.folder / name for name in table.catalogue.files]
        catalogue = load_catalogue(files, shipped=table.catalogue.shipped)
    if study.bore:
        problem, bore = _through_bore(study, problem, tell)
    answer = solve(problem, settings, tell)
    if bore is not None:
        bore = _for_the_answer(study, bore, answer)
    front = robust = ranking = None
    if answer.feasible and table.pareto is not None:
        goals = [next(goal for goal in problem.goals if goal.quantity.name == name) for name in table.pareto.goals]
        deadline = time.monotonic() + settings.seconds
        front = pareto_front(problem, goals, table.pareto.points, [answer.unit], deadline, settings.seed, tell)
    if answer.feasible and table.robust is not None and scatter is not None:
        deadline = time.monotonic() + settings.seconds
        robust = maximise_robustness(problem, table.robust, scatter, answer.unit, deadline, tell)
    if table.catalogue is not None and catalogue is not None:
        combinations = Combinations.of(problem, catalogue, table.catalogue.kinds)
        if not len(combinations):
            empty = [kind for kind in table.catalogue.kinds if not catalogue.of(kind)]
            raise InputError((Fault("catalogue", f"holds no {', '.join(empty)}; add some, or leave the kind out"),))
        ranking = rank(combinations, table.catalogue.keep, settings.seconds, settings.seed, tell)
    return Result(study, answer, bore, front, robust, scatter, ranking, time.monotonic() - began)


def _through_bore(study: Study, problem: Problem, tell: Tell) -> tuple[Problem, Bore]:
    """The problem with the bore's equivalent pupil, for the field and focus that the optimum itself has.

    Which stop stands for the bore depends on the optimum, and the optimum on the stop: they are found in turn until
    they agree. Where they go round in circles, the stop counts that suits its own optimum best.
    """
    quick = replace(study.settings, starts=min(4, study.settings.starts), check=False, isres=False)
    base = problem.design
    tried: list[Bore] = []
    pupil = _reduced(study, base)
    for number in range(1, PASSES + 1):
        tell(f"reducing the bore, pass {number}")
        problem = with_design(problem, base.replace(D_F=pupil.diameter, d_3=pupil.distance))
        answer = solve(problem, quick, tell)
        try:
            seen = problem.design_at(answer.unit)
            after = _reduced(study, seen)
        except InputError:
            break  # what was found is no design, or focuses inside the bore
        settled = _close(after, pupil)
        tried.append(Bore(_judged(study, seen, pupil), number, settled))
        if settled or any(_close(after, earlier.pupil) for earlier in tried):
            break
        pupil = after
    if not tried:
        tried.append(Bore(pupil, 1, False))
    best = tried[-1] if tried[-1].settled else min(tried, key=lambda bore: bore.pupil.worst_misplaced)
    return with_design(problem, base.replace(D_F=best.pupil.diameter, d_3=best.pupil.distance)), best


def _for_the_answer(study: Study, bore: Bore, answer: Answer) -> Bore:
    """The bore's pupil judged at the answer itself, where that is a design in front of the bore."""
    try:
        design = answer.problem.design_at(answer.unit)
    except InputError:
        return bore
    if design.d_f <= max(rim.distance for rim in study.bore):
        return bore
    return replace(bore, pupil=_judged(study, design, bore.pupil))


def _judged(study: Study, design: Design, pupil: EquivalentPupil) -> EquivalentPupil:
    return judge_pupil(design, study.bore, float(np.hypot(*half_sizes(design))), pupil.diameter, pupil.distance)


def _reduced(study: Study, design: Design) -> EquivalentPupil:
    try:
        return reduce_bore(design, study.bore, float(np.hypot(*half_sizes(design))))
    except ValueError as error:
        message = f"{error}; focus the base design farther out, or shorten the bore"
        raise InputError((Fault("bore", message),)) from None


def _close(left: EquivalentPupil, right: EquivalentPupil) -> bool:
    size = max(left.distance, left.diameter)
    return (
        abs(left.diameter - right.diameter) <= SETTLED * left.diameter
        and abs(left.distance - right.distance) <= SETTLED * size
    )


__all__ = ["Bore", "Result", "Settings", "run"]
