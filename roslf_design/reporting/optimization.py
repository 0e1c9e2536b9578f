"""An optimisation as a page and as a section of a design's report; the terminal shares its words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ..optimization.problem import Constraint, Goal
from ..optimization.ranking import Ranking
from ..optimization.solve import Answer, Conflict, Front, optimum_accuracy
from ..optimization.study import Result
from ..words import in_words, number, sentence
from .blocks import Block, Bullets, Code, Figure, Paragraph, Report, Section, Statement, Statements, Table
from .study_figures import optimisation_pictures

TITLES = {
    "bore": ("One stop for the bore", "The field where the two lines part is where the model of one stop misleads."),
    "front": ("What one goal costs of another", "Every point is a design; none is better in every goal."),
    "robust": ("What builds hold", "On fresh deviations, which neither design was chosen for."),
}


def optimization_report(result: Result, command: str, version: str) -> Report:
    """A study as a page of its own."""
    answer = result.answer
    section = optimization_section(result, command)
    return Report(answer.asked.name, f"from {answer.problem.design.name}", (section,), f"roslf_design {version}")


def optimization_section(result: Result, command: str = "") -> Section:
    """A study as a section of a report; the command that reruns it is printed where given."""
    asked, notes = result.answer.asked, result.answer.notes
    blocks: list[Block] = [Paragraph(asked.question)] if asked.question else []
    blocks += [Statements(tuple(statements(result))), *tables(result)]
    for name, figure in optimisation_pictures(result).items():
        blocks.append(Figure(f"optimize-{name}", *TITLES[name], figure.svg(name=f"optimize-{name}")))
    if notes:
        blocks.append(Bullets(notes))
    if command:
        blocks.append(Code(command, "Run again"))
    return Section(f"Optimisation: {asked.name}", tuple(blocks), "optimisation")


def statements(result: Result) -> Iterator[Statement]:
    """The answer in sentences."""
    for statement in _statements(result):
        yield replace(statement, text=in_words(statement.text), remedy=in_words(statement.remedy))


def _statements(result: Result) -> Iterator[Statement]:
    answer = result.answer
    if answer.feasible:
        yield from _about_optimum(result)
    elif answer.conflict is not None:
        yield _about_conflict(answer.conflict)
    if result.bore is not None:
        yield _about_bore(result)
    if result.robust is not None:
        yield _price(result)
    if result.front is not None:
        yield from _about_front(result.front)
    if result.ranking is not None:
        ranking = result.ranking
        text = (
            f"Of {len(ranking.combinations)} combinations of parts, bounds ruled out {ranking.ruled_out} and "
            f"{ranking.optimised} were optimised; {len(ranking.best)} of the best that hold every limit are listed."
        )
        if answer.asked.order == "lexicographic":
            text += " They are ranked by the weighted goals, not by their order."
        late = f"{ranking.open} more were not settled in the time given; give more seconds." if ranking.open else ""
        yield Statement("caution" if ranking.open or not ranking.best else "plain", text, late)


def _about_optimum(result: Result) -> Iterator[Statement]:
    answer = result.answer
    reached = ", ".join(f"{goal.label} = {number(answer.number(goal))}{_unit(goal)}" for goal in answer.asked.goals)
    yield Statement("good", f"A design holds every limit; best found: {reached}.")
    yield _agreement(answer)
    accuracy = optimum_accuracy(answer)
    if accuracy is not None and accuracy.asked is not None:
        yield Statement("plain" if accuracy.kept else "caution", sentence(accuracy.sentence()))
    loose = ", ".join(f"{name} {low:.4g} to {high:.4g} mm" for name, (low, high) in answer.loose().items())
    if loose:
        remedy = "Add a goal or a limit to decide between them."
        yield Statement("caution", f"Equally good designs were met at different variables: {loose}.", remedy)


def _about_conflict(conflict: Conflict) -> Statement:
    ways = [
        f"{r.label} {number(r.needed)} instead of {number(r.limit)}{f' {r.unit}' if r.unit else ''}"
        for r in conflict.relaxations
        if r.needed is not None
    ]
    lead = "This alone would do" if len(ways) == 1 else "Any one of these would do"
    remedy = f"{lead}: {'; '.join(ways)}." if ways else ""
    if conflict.bounds:
        remedy += f" The least-violating point touches the bounds {', '.join(conflict.bounds)}."
    clash = " and ".join(conflict.smallest)
    doubt = "" if conflict.complete else " (a smaller set was not excluded in the time given)"
    text = f"No design was found: within the bounds, these cannot hold together: {clash}{doubt}."
    return Statement("bad", text, remedy.strip())


def _about_front(front: Front) -> Iterator[Statement]:
    names = [goal.label for goal in front.goals]
    if not front.points:
        yield Statement("caution", f"No front: {names[0]} could not be optimised alone in the time given.")
    elif len(front.points) == 1:
        yield Statement("plain", f"{' and '.join(names)} do not compete: one design is best in all of them.")
    if front.points and not front.complete:
        yield Statement("caution", "The front is not complete: time ran out.", "Give more seconds.")


def _agreement(answer: Answer) -> Statement:
    same = len(answer.equals)
    text = (
        f"{same} of {len(answer.searches)} starts ended at this design ({answer.reached} at a feasible one); "
        f"{answer.evaluations} evaluations"
    )
    doubts = [check.solver for check in answer.checks if not answer.agrees(check)]
    if answer.checks and not doubts:
        text += f"; {' and '.join(check.solver for check in answer.checks)} found none better"
    if same > 1 and answer.residual < 1e-4 and not doubts:
        return Statement("good", f"{text}.")
    remedy = "Give more starts." if same <= 1 else ""
    if answer.residual >= 1e-4:
        only = f"{answer.residual:.1g}: the goals have a kink here, or a bound is missed"
        remedy += f" First-order conditions hold only to {only}."
    return Statement("caution", f"{text}.", remedy.strip())


def _about_bore(result: Result) -> Statement:
    pupil = result.bore
    assert pupil is not None
    text = (
        f"The bore acts as one stop of {pupil.stop[0]:.4g} mm at {pupil.stop[1]:.4g} mm; over the field kept fractions "
        f"differ by up to {pupil.worst_kept_difference:.2g}, and up to {pupil.worst_misplaced:.2g} of the light is on "
        "the wrong side of its rim"
    )
    good = pupil.worst_misplaced <= 0.05
    remedy = "" if good else "Check the result with every rim as a stop of the design."
    if not pupil.settled:
        remedy += " The stop that suits an optimum best changes with it, without end: of those tried this misled least."
    return Statement("plain" if good and pupil.settled else "caution", f"{text}.", remedy.strip())


def _price(result: Result) -> Statement:
    robust, answer = result.robust, result.answer
    assert robust is not None
    costs = [
        f"{goal.label} {number(answer.number(goal), 4)} → "
        f"{number(answer.problem.number(goal, robust.unit), 4)}{_unit(goal)}"
        for goal in answer.asked.goals
    ]
    text = (
        f"Of builds, {100 * robust.nominal.yield_.value:.1f} % of the nominal optimum's hold every limit, "
        f"{100 * robust.robust.yield_.value:.1f} % of the robust design's; the price: {', '.join(costs)}."
    )
    return Statement("plain", text)


def tables(result: Result) -> Iterator[Table]:
    """The tables of a study."""
    for table in _tables(result):
        rows = tuple(tuple(in_words(cell) for cell in row) for row in table.rows)
        yield replace(table, rows=rows, headings=tuple(in_words(heading) for heading in table.headings))


def _tables(result: Result) -> Iterator[Table]:
    answer = result.answer
    yield _variables(result)
    yield _held(answer)
    if answer.active:
        yield _active(answer)
    if answer.stages:
        rows = tuple((s.goal, f"{s.value:.6g}", s.held) for s in answer.stages)
        yield Table(rows, "ldl", ("goal, in order", "best", "held for the later ones"), "Lexicographic order")
    if answer.conflict is not None:
        yield _ways(answer.conflict)
    if result.ranking is not None and result.ranking.best:
        yield _parts(result.ranking)


def _variables(result: Result) -> Table:
    answer, robust = result.answer, result.robust
    values = answer.variables()
    moved = {} if robust is None else answer.problem.named(robust.unit)
    rows = tuple(
        (
            name,
            *(f"{value:.5g}" for value in (variable.min, values[name], variable.max)),
            *(() if robust is None else (f"{moved[name]:.5g}",)),
        )
        for name, variable in answer.problem.variables.items()
    )
    heads = ("variable", "from [mm]", "value [mm]", "to [mm]", *(() if robust is None else ("robust [mm]",)))
    title = "The design" if answer.feasible else "The least-violating point"
    return Table(rows, "l" + "d" * (len(heads) - 1), heads, title)


def _held(answer: Answer) -> Table:
    wanted = {goal.label: "least" if goal.direction == "min" else "most" for goal in answer.asked.goals}
    limited = {constraint.label for constraint in answer.asked.constraints}
    parts: list[Goal | Constraint] = [goal for goal in answer.asked.goals if goal.label not in limited]
    rows = []
    for part in [*parts, *answer.asked.constraints]:
        limits = (part.min, part.max) if isinstance(part, Constraint) else (None, None)
        low, high = ("" if limit is None else f"{limit:.6g}" for limit in limits)
        value = number(answer.number(part), zero=1e-9)
        rows.append((part.label, low, value, high, part.quantity.unit, wanted.get(part.label, "")))
    return Table(tuple(rows), "ldddll", ("quantity", "min", "value", "max", "unit", "goal"), "Goals and limits")


def _active(answer: Answer) -> Table:
    single = len(answer.problem.goals) == 1
    rows = []
    for active in answer.active:
        fine = active.unit == "mm" and active.merit_gain_per_unit > 1
        per = "per um" if fine else f"per {active.unit.replace('pitches', 'pitch')}" if active.unit else "per unit"
        size = 1e-3 if fine else 1.0
        if active.multiplier < 1e-9:
            buys = "nothing: touched, not pressed"
        elif single and active.goal_gain_per_unit is not None:
            goal = answer.problem.goals[0]
            buys = f"{size * active.goal_gain_per_unit:.4g}{_unit(goal)} {per}"
        else:
            buys = f"{100 * size * active.merit_gain_per_unit:.4g} % {per}"
        rows.append((active.limit, f"{active.multiplier:.4g}", buys))
    of = answer.problem.goals[0].label if single else "the goals together"
    return Table(
        tuple(rows), "ldl", ("limit", "multiplier", f"relaxing it buys, of {of}"), "Limits that the optimum rests on"
    )


def _ways(conflict: Conflict) -> Table:
    missed = {violation.limit: violation for violation in conflict.violations}
    rows = []
    for r in conflict.relaxations:
        own = missed.get(r.label)
        needed = "does not help alone" if r.needed is None else f"{r.needed:.6g}"
        rows.append((r.label, f"{r.limit:.6g}", "" if own is None else f"{own.value:.6g}", needed, r.unit))
    heads = ("limit", "asked", "at the least-violating point", "moved alone, feasible from", "unit")
    return Table(tuple(rows), "lrrrl", heads, "What stands in the way")


def _parts(ranking: Ranking) -> Table:
    problem = ranking.combinations.problem
    rows = []
    for place, ranked in enumerate(ranking.best, 1):
        own = ranking.combinations.problem_at(ranked.number)
        values = own.named(ranked.search.unit)
        goals = [f"{own.number(goal, ranked.search.unit):.4g}" for goal in own.goals]
        names = [part.part for part in ranking.combinations.chosen(ranked.number)]
        rows.append((str(place), *names, *goals, *(f"{value:.5g}" for value in values.values())))
    kinds = [kind.replace("_", " ").rstrip("s").replace("lense", "lens") for kind in ranking.combinations.kinds]
    goals = [_headed(goal) for goal in problem.goals]
    heads = ("", *kinds, *goals, *(f"{name} [mm]" for name in problem.variables))
    align = "r" + "l" * len(kinds) + "d" * (len(goals) + problem.n)
    return Table(tuple(rows), align, heads, "Parts")


def _headed(goal: Goal) -> str:
    return f"{goal.label} [{goal.quantity.unit}]" if goal.quantity.unit else goal.label


def _unit(part: Goal | Constraint) -> str:
    return f" {part.quantity.unit}" if part.quantity.unit else ""
