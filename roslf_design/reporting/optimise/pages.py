"""An optimisation as a page and as a section of a design's report; the terminal shares its words and pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..._version import __version__
from ...camera import Camera
from ...design import PATHS
from ...drawing.marks import Text
from ...drawing.picture import PAGE, Picture, beside
from ...evaluation.part_verdicts import buildable
from ...evaluation.required import missed_words
from ...lenses.glass import ROOM
from ...optimization.conflict import Conflict
from ...optimization.front import Front
from ...optimization.goals import Constraint, Goal
from ...optimization.ranking import Ranking
from ...optimization.search import BIG
from ...optimization.solve import Active, Answer, optimum_accuracy
from ...optimization.study import Result
from ...optimization.traces import Retrace
from ...optimization.variables import NUMBERS
from ...tables import Column
from ...theory.depth_budget import NOISE, WARMTH, depth_budget
from ...theory.focused import pupil_blur_ratio
from ...theory.light import microlens_defocus_waves
from ...theory.quantities import QUANTITIES, bound_note, in_words
from ...tolerancing.result import KNOWN_LENGTHS, depth_left_out
from ...tolerancing.yields import Yield
from ...words import apart, clauses, listed, number, sentence
from ..blocks import Block, Bullets, Code, Figure, Finding, Paragraph, Report, Section, Statement, Statements, Table
from ..design.rays import meridional, ray_words, scale_words
from .pictures import SAME, bore_and_stop, ends_differ, ends_of, goal_front, robust_yields, search_history

TITLES = {
    "bore": ("One stop for the bore", "The field where the two lines part is where the model of one stop misleads."),
    "front": ("What one goal costs of another", "Every point is a design; none is better in every goal."),
    "robust": (
        "Yield of Monte Carlo units (builds)",
        "On fresh deviations, which neither design was chosen for. Limits that every build holds are not drawn.",
    ),
}

PRESSED = 1e-6
"""Multiplier from which a limit stops the goals, and is not only touched."""
AGREED = 1e-3
"""Difference between an optimum as searched and as traced again from which a page warns."""
HOLD_REQUIRED = "Hold it, too: required = true in the study takes it over as limits."
"""Remedy of an optimum that misses what its design's `[required]` asks for."""
WIDER = "Widen the bounds, or ask for something else."
OF_INFINITE = {
    NOISE: "Pixels need light that does not fill them, and the scene texture: exposure, illuminance, depth.contrast.",
    WARMTH: "A housing that expands less or a narrower environment.range keeps the camera in focus.",
}
"""Remedies of a depth that is infinite, by the term of its budget that is."""
HIGH = 170.0
"""Height of each of the drawings before and after [px]: both stand on the first screen."""
MOST_LEFT_OUT = 30
"""Combinations that are not listed and that a table shows with their reasons."""
HISTORY = (
    "Each dot is a local search from a Sobol point: how much worse its goals are than the answer's, over the "
    "evaluations spent by then. Dots on the lower edge ended at the answer; a diamond there is another solver "
    "that found none better."
)


def optimization_report(result: Result, command: str) -> Report:
    """A study as a page of its own."""
    answer = result.answer
    section = _optimization_section(result, command)
    return Report(answer.asked.name, f"from {answer.problem.design.name}", (section,), f"roslf_design {__version__}")


def _optimization_section(result: Result, command: str = "") -> Section:
    """A study as a section of a report; the command that reruns it is printed where given."""
    asked, notes = result.answer.asked, result.notes
    blocks: list[Block] = [Paragraph(asked.question)] if asked.question else []
    first, *more = statements(result)
    blocks += [Statements((first,)), *_change(result), Statements(tuple(more))]
    for table in _tables(result):
        rows = tuple(tuple(in_words(cell) for cell in row) for row in table.rows)
        blocks.append(replace(table, rows=rows, headings=tuple(in_words(heading) for heading in table.headings)))
    for name, picture in optimisation_pictures(result).items():
        blocks.append(Figure.of(f"optimize-{name}", *TITLES[name], picture))
    if notes:
        blocks.append(Bullets(notes))
    if command:
        blocks.append(Code(command, "Run again"))
    return Section(f"Optimisation: {asked.name}", tuple(blocks), "optimisation")


def optimization_finding(result: Result, take: str = "best", words: str = "") -> Finding:
    """A study in a design's report, with how its searches went; `take` is the report's design, `words` what it is."""
    answer, (first, *_) = result.answer, statements(result)
    said = replace(first, text=f"Optimisation: {first.text[:1].lower()}{first.text[1:]}")
    blocks, ends = _optimization_section(result).blocks, ends_of(answer)
    if take != "best":
        own = in_words(_reached(result, take))
        said = replace(said, text=f"{said.text} This report is of another design, {words}; its own numbers: {own}.")
        other = f"This section is about the study's optimum, all else in this report about {words}."
        blocks = (Paragraph(other), *blocks)
    if answer.feasible and ends_differ(ends):
        blocks = (*blocks, Figure.of("history", "What every start came to", HISTORY, search_history(ends, (576, 290))))
    seed = f"Seed of the optimisation's starts: {result.study.settings.seed}."
    return Finding(Section("Optimisation", blocks, "optimisation"), said, seed)


# --- answers ----------------------------------------------------------------------------------------------------------


def statements(result: Result) -> Iterator[Statement]:
    """The answer in sentences."""
    for statement in _statements(result):
        remedy = statement.remedy if "quantity = " in statement.remedy else in_words(statement.remedy)  # or as typed
        yield replace(statement, text=in_words(statement.text), remedy=remedy)


def _share(measured: Yield) -> str:
    """Words for a yield and its interval."""
    low, high = measured.interval
    return f"{100 * measured.value:.1f} % (95 % interval {100 * low:.1f} to {100 * high:.1f} %)"


def _statements(result: Result) -> Iterator[Statement]:
    answer = result.answer
    if answer.feasible:
        yield from _about_optimum(result)
        asked = (*answer.asked.goals, *answer.asked.constraints)
        given = answer.problem.design.depth.disparity_error is not None
        if note := bound_note((goal.quantity.name for goal in asked), given):
            yield Statement("plain", note)
    elif answer.conflict is None:
        text = (
            "The search was stopped before a design was met that holds every limit: whether there is one is not known."
        )
        yield Statement("bad", text, "Give it more time.")
    else:
        yield _about_conflict(answer.conflict)
    if result.bore is not None:
        yield _about_bore(result)
    if result.robust is not None:
        robust, problem = result.robust, answer.problem
        costs = [
            f"{goal.label} {number(answer.number(goal), 4)} → {goal.with_unit(problem.number(goal, robust.unit), 4)}"
            for goal in answer.asked.goals
        ]
        text = (
            f"Of Monte Carlo units (builds) {_share(robust.nominal.yield_)} of the nominal optimum's hold every limit, "
            f"{_share(robust.robust.yield_)} of the robust design's; the price: {', '.join(costs)}."
        )
        table = result.study.table.robust
        if table is not None and table.maximise == "quantile" and robust.robust.yield_.interval[0] < table.wanted_yield:
            text += f" The target yield is {100 * table.wanted_yield:g} %, which the interval does not promise."
        goals = [(one.quantity.name, one.at) for one in _judged(result) if one.quantity.name in KNOWN_LENGTHS]
        built = robust.scatter.covariance(problem, robust.unit)
        text += f" {depth_left_out(problem.design_at(robust.unit), goals, built)}".rstrip()
        yield _as_required(Statement("plain", text), result, "robust")
    yield from _about_focus(result)
    yield from _about_making(result)
    if result.front is not None:
        yield from _about_front(result.front)
    if result.ranking is not None:
        ranking = result.ranking
        text = (
            f"Of {len(ranking.combinations)} combinations of parts, bounds ruled out {ranking.ruled_out} and "
            f"{ranking.optimised} were optimised; {len(ranking.best)} of the best that hold every limit are listed."
        )
        if ranking.stopped:
            text = f"The search was stopped; what follows is the best so far. {text}"
        for limit in ranking.refused:
            text += f" {limit.words(len(ranking.combinations))}."
        if ranking.left_out:
            text += " Why others were left out stands in a table of its own."
        if ranking.best:
            parts = ", ".join(ranking.ordered(ranking.best[0]).values())
            text += f" Best of them: {parts} with {_reached(result, 'parts-01')}."
            if answer.feasible:
                kinds = listed([f"the {kind}" for kind in _kinds(ranking)])
                text += f" The best above chooses none: it has {kinds} of the base design, or as the study varies them."
        else:
            text += f" {_none_listed(ranking)}"
        if answer.asked.order == "lexicographic":
            text += " They are ranked by the weighted goals, not by their order."
        if result.part_retraces:
            worst = max(again.moved for again in result.part_retraces)
            text += f" Each of these was traced again on its own: goals and limits differ {apart(worst)}."
        why = "the search was stopped" if ranking.stopped else "the budget was spent; give more"
        late = f"{ranking.open} more were not settled before {why}." if ranking.open else ""
        said = Statement("caution" if ranking.open or ranking.stopped or not ranking.best else "plain", text, late)
        yield _as_required(said, result, "parts-01")


def _about_focus(result: Result) -> Iterator[Statement]:
    """Statement on designs whose microlenses blur the pupil more than pixels and diffraction do; none where none do."""
    cameras = {name.removesuffix(".toml"): Camera.of(design.thin_twin) for name, design in result.designs()}
    blurred = {name: camera for name, camera in cameras.items() if pupil_blur_ratio(camera) > 1}
    if not blurred:
        return
    waves = {name: f"{float(microlens_defocus_waves(camera)):.2g} waves" for name, camera in blurred.items()}
    defocus = QUANTITIES["microlens_defocus_px"]
    sizes = [f"{_called(name)} by {float(defocus(camera)):.3g} px ({waves[name]})" for name, camera in blurred.items()]
    text = f"Microlenses out of focus, which closed forms of images and views take for in focus: {', '.join(sizes)}."
    least = min(float(defocus(camera) / pupil_blur_ratio(camera)) for camera in blurred.values())
    remedy = f'Ask for it by [[constraints]]: quantity = "microlens_defocus_px", max = {least:.2g}'
    yield Statement("caution", text, f"{remedy}{'' if 'd_2' in result.answer.variables() else ', and let d_2 vary'}.")


def _called(name: str) -> str:
    """Design of a study's file in words; parts as their file is called."""
    named = {"best": "the optimum", "robust": "the robust design", "least-violating": "the least-violating point"}
    return named.get(name, name)


def _about_making(result: Result) -> Iterator[Statement]:
    """Statement on what of a design hardly anybody makes, that of the first design of each such doubt."""
    doubts: dict[str, Statement] = {}
    for name, design in result.designs():
        for doubt in buildable(design, Camera.of(design)):
            text = f"Of {_called(name.removesuffix('.toml'))}: {doubt.text}."
            doubts.setdefault(doubt.name, Statement("caution", text, sentence(doubt.remedy)))
    yield from doubts.values()


def _judged(result: Result) -> Iterator[Goal | Constraint]:
    """Goals and limits that the builds of a robust design are judged by."""
    yield from result.answer.asked.constraints
    if result.study.table.robust is not None and result.study.table.robust.maximise == "quantile":
        yield result.answer.asked.goals[0]


def _about_optimum(result: Result) -> Iterator[Statement]:
    answer = result.answer
    optimum, ranking = _optimum(answer, _reached(result)), result.ranking
    if ranking is not None and ranking.best and ranking.best[0].search.merit < answer.merit - SAME:
        parts = ", ".join(ranking.ordered(ranking.best[0]).values())
        better = f"With other parts, first of the list below, it is better: {parts}, {_reached(result, 'parts-01')}."
        better += " Take parts-01.toml; best.toml keeps the study's own."
        optimum = replace(optimum, text=f"{optimum.text} {better}")
    edges = [one.limit for one in answer.active if one.multiplier > PRESSED and not (one.bound or one.always)]
    if len(edges) > 1 and result.robust is None:
        said = f"It stands on {len(edges)} limits at once, which few builds hold together: ask for [robust]."
        optimum = replace(optimum, text=f"{optimum.text} {said}")
    yield _as_required(optimum, result, "best")
    for fault in result.faults:
        said = f"Beyond the study's limits `roslf evaluate best.toml` finds a fault: {fault.text}."
        yield Statement("bad", said, sentence(fault.remedy))
    yield _agreement(answer)
    if result.retrace is not None:
        yield _about_trace(result.retrace)
    accuracy = optimum_accuracy(answer)
    if accuracy is not None and accuracy.asked is not None:
        yield Statement("plain" if accuracy.kept else "caution", sentence(accuracy.sentence()))
    loose = ", ".join(
        f"{answer.problem.called(name)} {low:.4g} to {high:.4g} {answer.problem.variables[name].measured_in}".rstrip()
        for name, (low, high) in answer.loose().items()
    )
    if loose:
        remedy = "Add a goal or a limit to decide between them."
        yield Statement("caution", f"Equally good designs were met at different variables: {loose}.", remedy)


def _reached(result: Result, take: str = "best") -> str:
    """Goals that one of an optimisation's designs reaches, in words."""
    answer = result.answer
    problem, unit = answer.problem, answer.unit
    if take == "robust" and result.robust is not None:
        unit = result.robust.unit
    elif take != "best" and result.ranking is not None:
        ranked = result.ranking.best[int(take.removeprefix("parts-")) - 1]
        problem, unit = ranked.problem, ranked.search.unit
    return ", ".join(f"{goal.label} = {goal.with_unit(problem.number(goal, unit), 5)}" for goal in answer.asked.goals)


def _optimum(answer: Answer, reached: str) -> Statement:
    """The best design, and whether it is best by itself or where a bound stops the goal."""
    pressed = [active for active in answer.active if active.multiplier > PRESSED]
    met, ends = ([a.limit for a in pressed if a.bound], [a.limit for a in pressed if a.always])
    stops = [f"the bound{'s' if len(met) > 1 else ''} {listed(met)}"] if met else []
    stops += [f"what every camera must be ({', '.join(ends)})"] if ends else []
    bounds = " and ".join(stops)
    if answer.runs_off:
        text = f"Unbounded objective: {bounds or 'the search'} stopped it at {reached}, which is no optimum."
        return Statement("caution", text, "Limit the goal, or what drives it, by a constraint or narrower bounds.")
    if answer.merit >= BIG:
        text = f"A design holds every limit, but a goal is infinite wherever it was looked for: {reached}"
        why, remedy = _infinite(answer)
        return Statement("caution", f"{clauses(text, why)}.", remedy)
    if bounds and all(active.bound or active.always for active in pressed):
        text = f"A design holds every limit: {reached}; but nothing stops the goal there save {bounds}."
        return Statement("caution", text, "Where a bound is not meant so, limit what a better goal costs.")
    stopped = f" Active constraints include {bounds}." if bounds else ""
    return Statement("good", f"A design holds every limit; best found: {reached}.{stopped}")


def _infinite(answer: Answer) -> tuple[str, str]:
    """Cause of the optimum's infinite depth, as its own budget has it, and its remedy; no cause of other goals."""
    camera = Camera.of(answer.problem.design_at(answer.unit))
    causes = dict[str, str]()
    for goal in answer.asked.goals:
        noise_alone = goal.quantity.name.startswith("sigma_z")
        if noise_alone or goal.quantity.name.startswith("u_z"):
            for term in depth_budget(goal.warm(camera), goal.at).terms:
                counted = term.name == NOISE or not noise_alone
                if counted and term.u_mm is not None and np.any(np.isinf(term.u_mm)):
                    causes[clauses(term.name, term.remark, by=", ")] = OF_INFINITE.get(term.name, "")
    return " and ".join(causes), clauses(*dict.fromkeys(causes.values()), by=" ") or WIDER


def _as_required(said: Statement, result: Result, file: str) -> Statement:
    """A statement about one of an optimisation's designs, with whether it is what its own `[required]` asks for."""
    required = result.required.get(file, ())
    if not required:
        return said
    if missed := missed_words(required):
        remedy = f"`roslf evaluate {file}.toml` says more." if result.study.table.required else HOLD_REQUIRED
        text = f"{file}.toml misses what its [required] asks for: {missed}. {said.text}"
        return Statement("bad", text, f"{remedy} {said.remedy}".rstrip())
    drawn = [f"{one.label} {one.only}" for one in required if one.only]
    but = f" ({', '.join(drawn)})" if drawn else ""
    return replace(said, text=f"{said.text} {file}.toml is all that its [required] asks for{but}.")


def _about_trace(retrace: Retrace) -> Statement:
    """Statement about the fields traced behind a real lens, and how well the optimum's own trace agrees."""
    folded = ", ".join(f"{x:g}, {y:g} mm" for x, y in retrace.folded)
    text = (
        f"Behind the real lens ({retrace.lens}) what is asked at a field was traced at every design tried; angles of "
        "view, fields and detail where searches ended, between those places they are as many times the thin-lens "
        "model's as lies between; the rest follows from the lens's focal length and principal planes. "
        f"Traced again on its own, the optimum's goals and limits differ {apart(retrace.moved)}"
    )
    if folded:
        remedy = "Ask non_distortion_room_mm there to be at least 0, or leave the field out."
        return Statement("caution", f"{text}; the image at {folded} is folded: its shape is undefined.", remedy)
    good = retrace.moved <= AGREED
    remedy = "" if good else "See `roslf evaluate` with the design found."
    return Statement("plain" if good else "caution", f"{text}.", remedy)


def _about_conflict(conflict: Conflict) -> Statement:
    ways = [
        f"{r.label} {r.feasible_from} instead of {number(r.limit)}{f' {r.unit}' if r.unit else ''}"
        for r in conflict.relaxations
        if r.needed is not None
    ]
    lead = f"{'This alone' if len(ways) == 1 else 'Any one of these'}, all others unchanged, would do"
    if conflict.unjudged:
        lead += f" for the limits that were judged (not judged: {listed(conflict.unjudged)})"
    remedy = f"{lead}: {'; '.join(ways)}." if ways else ""
    if conflict.bounds:
        remedy += f" The least-violating point touches the bounds {', '.join(conflict.bounds)}."
    text = f"No design was found: {conflict.reason}. {conflict.missed}".rstrip()
    return Statement("bad", text, remedy.strip())


def _about_front(front: Front) -> Iterator[Statement]:
    names = [goal.label for goal in front.goals]
    if not front.points:
        yield Statement("caution", f"No front: {names[0]} could not be optimised alone in the time given.")
    elif len(front.points) == 1:
        text = f"{' and '.join(names)} do not compete: one design is best in all of them."
        yield Statement("plain", sentence(text))
    if front.points and not front.complete:
        yield Statement("caution", "The front is not complete: its budget was spent.", "Give a larger budget.")


def _agreement(answer: Answer) -> Statement:
    same = len(answer.equals)
    starts = len(answer.searches)
    text = f"{same} of {starts} starts ended at this design ({answer.reached} at a feasible one)"
    if not answer.reached:
        text = f"None of {starts} starts ended at a feasible design: this one was met on the way"
    text += f"; {answer.evaluations} evaluations"
    doubts = [check.solver for check in answer.checks if not answer.agrees(check)]
    if answer.checks and not doubts:
        names = " and ".join(check.solver for check in answer.checks)
        text += f"; a second search over all the bounds ({names}) found none better"
    if same > 1 and answer.residual < 1e-4 and not doubts:
        return Statement("good", f"{text}.")
    remedy = "Give more starts." if same <= 1 else ""
    if 1e-4 <= answer.residual < math.inf:
        only = f"{answer.residual:.1g}: the goals have a kink here, or a bound is missed"
        remedy += f" First-order conditions hold only to {only}."
    return Statement("caution", f"{text}.", remedy.strip())


def _about_bore(result: Result) -> Statement:
    pupil = result.bore
    assert pupil is not None
    text = (
        f"The bore acts as one stop of {pupil.stop[0]:.4g} mm at {pupil.stop[1]:.4g} mm; over the field the "
        f"unvignetted share differs by up to {pupil.worst_kept_difference:.2g}, and up to {pupil.worst_misplaced:.2g} "
        "of the light is on the wrong side of its rim"
    )
    good = pupil.worst_misplaced <= 0.05
    remedy = "" if good else "Check the result with every rim as a stop of the design."
    if pupil.dark_beyond_mm is not None:
        good = False
        text += (
            f". That is out to {pupil.dark_beyond_mm:.4g} mm from the axis on the array, of {pupil.seen_to_mm:.4g} mm "
            "that the sensor sees: farther out the bore leaves less than a third of the pencils, which one stop cannot "
            "show, so that fields behind it come out too large"
        )
        remedy = "Give the bore's rims to the design ([[stops]], bore = true): they then cut fields and images."
    if not pupil.settled:
        remedy += " The stop that suits an optimum best changes with it, without end: of those tried this misled least."
    return Statement("plain" if good and pupil.settled else "caution", f"{text}.", remedy.strip())


# --- before and after -------------------------------------------------------------------------------------------------


def _change(result: Result) -> Iterator[Figure]:
    """The camera before and after, and what changed; nothing where no design came of it."""
    answer, after = result.answer, next((design for _, design in result.designs()), None)
    if after is None:
        return
    before = answer.problem.design
    drawn = {"before": before, "optimised" if answer.feasible else "least violating": after}
    pictures = []
    for (name, design), other in zip(drawn.items(), (after, before), strict=True):
        picture = meridional(design, (PAGE, HIGH), key=False, like=other)
        mark = Text(PAGE - 8.0, 14.0, name, anchor="end", bold=True, halo=True)
        pictures.append(replace(picture, remarks=(*picture.remarks, mark)))
    across, up = picture.mapping.per_px
    values = answer.variables() | answer.followers()
    was, camera = answer.problem.before(values), Camera.of(before)
    moved = []
    for goal in answer.asked.goals:
        if goal.field is None and not math.isnan(old := float(np.ravel(goal.values(camera))[0])):
            reached = goal.with_unit(answer.number(goal), 4)
            moved.append(f"{in_words(goal.label)} {goal.with_unit(old, 4)} → {reached}")
    lengths = {name: (number(was[name], 4), number(values[name], 4)) for name in values if name in was}
    moved += [f"{answer.problem.called(name)} {old} → {new} mm" for name, (old, new) in lengths.items() if old != new]
    caption = f"The camera before and after, {scale_words(across / up)}, and {ray_words(after)}. "
    caption += f"What changed: {'; '.join(moved)}."
    of_camera = {one: float(np.ravel(one.values(camera))[0]) for one in answer.asked.constraints if one.field is None}
    missed = [
        f"{in_words(str(one))}: {number(was, 4)}"
        for one, was in of_camera.items()
        if not one.quantity.within(one.min, one.max, was)
    ]
    caption += f" Before, limits were missed: {'; '.join(missed)}." if missed else ""
    title = f"{before.name} and {after.name}"
    both = beside("change", title, pictures, down=True)
    yield Figure.of("optimize-change", "Before and after", caption, replace(both, breaks=0.0))  # to be compared


# --- tables -----------------------------------------------------------------------------------------------------------


def _tables(result: Result) -> Iterator[Table]:
    answer, robust = result.answer, result.robust
    problem, held, follows = answer.problem, answer.held(), answer.followers()
    values = answer.variables() | held | follows
    others = dict.fromkeys(held, "held") | dict.fromkeys(follows, "follows")
    moved: dict[str, float] = {}
    if robust is not None:
        moved = problem.named(robust.unit) | problem.held(robust.unit) | problem.following(robust.unit)

    def called(name: str) -> str:
        return ", ".join([problem.called(name), *([others[name]] if name in others else [])])

    before, (filed, caption) = answer.problem.before(values), _as_filed(result)
    columns: tuple[Column, ...] = (
        ("variable", "l", called),
        ("before", "d", lambda name: f"{before[name]:.5g}" if name in before else ""),
        ("from", "d", lambda name: "" if name in others else f"{problem.variables[name].min:.5g}"),
        ("value", "d", lambda name: f"{values[name]:.5g}"),
        ("to", "d", lambda name: "" if name in others else f"{problem.variables[name].max:.5g}"),
        *((("in the file", "d", lambda name: f"{filed[name]:.5g}" if name in filed else ""),) if filed else ()),
        ("unit", "l", lambda name: "" if name in NUMBERS else "mm"),
        ("robust", "d", lambda name: f"{moved[name]:.5g}"),
    )
    title = "The design" if answer.feasible else "The least-violating point"
    yield Table.of(values, columns if moved else columns[:-1], title, caption)
    yield _held(answer)
    if answer.active:
        single = len(answer.problem.goals) == 1
        of = answer.problem.goals[0].label if single else "the goals together"
        columns = (
            ("limit", "l", lambda active: active.limit),
            ("multiplier", "d", lambda active: f"{active.multiplier:.4g}"),
            (f"gain per unit relaxed, of {of}", "l", lambda active: _bought(active, answer.problem.goals)),
        )
        gains = (
            "Multiplier: what the goals together, the weighted mean of their logarithms, gain, both scaled. "
            "Relaxing, for small steps: a limit that gives way by one unit makes "
        )
        gains += "the goal so much better." if single else "the goals together so many percent better."
        yield Table.of(answer.active, columns, "Active constraints", gains)
    if answer.stages:
        rows = tuple((s.goal, f"{s.value:.6g}", s.held) for s in answer.stages)
        yield Table(rows, "ldl", ("goal, in order", "best", "held for the later ones"), "Lexicographic order")
    if answer.conflict is not None and answer.conflict.relaxations:
        missed = {violation.limit: f"{violation.value:.6g}" for violation in answer.conflict.violations}
        columns = (
            ("limit", "l", lambda way: way.label),
            ("asked", "r", lambda way: f"{way.limit:.6g}"),
            ("at the least-violating point", "r", lambda way: missed.get(way.label, "")),
            (
                "all others unchanged, feasible from",
                "r",
                lambda way: way.feasible_from or "does not help alone",
            ),
            ("all others left out, at best", "r", lambda way: way.alone),
            ("unit", "l", lambda way: way.unit),
        )
        unjudged = answer.conflict.unjudged
        told = f"Of the limits that were judged; not judged: {in_words(listed(unjudged))}." if unjudged else ""
        yield Table.of(answer.conflict.relaxations, columns, "What stands in the way", told)
    if result.ranking is not None and result.ranking.best:
        assumed = result.ranking.with_assumed_well
        well = f"Full well by area of pixels, as nobody states it: {listed(assumed)}." if assumed else ""
        yield replace(_parts(result.ranking), caption=" ".join(filter(None, (caption, well))))
    if result.ranking is not None and result.ranking.left_out:
        yield _left_out(result.ranking)


def _as_filed(result: Result) -> tuple[dict[str, float], str]:
    """Lengths of the first design as its file has them, and words on that, where any is printed otherwise."""
    answer, design = result.answer, next((design for _, design in result.designs()), None)
    if design is None or (environment := design.environment) is None:
        return {}, ""
    values = answer.variables() | answer.held() | answer.followers()
    cold = Camera.of(design).cold
    places = {name: PATHS.get(name, name) for name in values}
    filed = {name: float(cold[place]) for name, place in places.items() if place in cold.numbers}
    if all(f"{filed[name]:.5g}" == f"{values[name]:.5g}" for name in filed):
        return {}, ""
    return filed, (
        f"Values and bounds are those at {environment.temperature:g} °C, where the camera is used; files have lengths "
        f"as they are at {ROOM:g} °C, where parts are made and measured."
    )


def _held(answer: Answer) -> Table:
    wanted = {goal.label: "least" if goal.direction == "min" else "most" for goal in answer.asked.goals}
    limited = {constraint.label for constraint in answer.asked.constraints}
    goals = [goal for goal in answer.asked.goals if goal.label not in limited]

    def limit(part: Goal | Constraint, side: str) -> str:
        value = getattr(part, side, None)
        return "" if value is None else f"{value:.6g}"

    columns: tuple[Column, ...] = (
        ("quantity", "l", lambda part: part.label),
        ("min", "d", lambda part: limit(part, "min")),
        ("value", "d", lambda part: number(answer.number(part), zero=1e-9)),
        ("max", "d", lambda part: limit(part, "max")),
        ("unit", "l", lambda part: part.quantity.unit),
        ("goal", "l", lambda part: wanted.get(part.label, "")),
    )
    return Table.of((*goals, *answer.asked.constraints), columns, "Goals and limits")


def _bought(active: Active, goals: tuple[Goal, ...]) -> str:
    """Gain from relaxing a limit by a unit: of the one goal, else of the merit."""
    if active.multiplier < 1e-9:
        return "nothing: touched, not pressed"
    if active.merit_gain_per_unit is None:
        return "it cannot be: every camera holds it"
    fine = active.unit == "mm" and active.merit_gain_per_unit > 1
    per = "per um" if fine else f"per {active.unit.replace('pitches', 'pitch')}" if active.unit else "per unit"
    size = 1e-3 if fine else 1.0
    if len(goals) == 1 and active.goal_gain_per_unit is not None:
        return f"{goals[0].with_unit(size * active.goal_gain_per_unit, 4)} {per}"
    return f"{100 * size * active.merit_gain_per_unit:.4g} % {per}"


def _none_listed(ranking: Ranking) -> str:
    """Reason why no combination is listed."""
    if ranking.stopped:
        return "None holds every limit so far."
    if ranking.nearest is None and ranking.refused:
        return "No search was begun."
    if ranking.nearest is None or ranking.conflict is None:
        return "None makes a camera within the bounds."
    parts = ", ".join(ranking.named(ranking.nearest).values())
    if ranking.conflict.feasible_after_all and not ranking.conflict.undefined:
        return f"{parts} would do, but the budget was spent; give more."
    return f"Nearest comes {parts}: {ranking.conflict.reason}."


def _parts(ranking: Ranking) -> Table:
    problem = ranking.combinations.problem
    rows = []
    for place, ranked in enumerate(ranking.best, 1):
        own = ranked.problem
        values = own.named(ranked.search.unit)
        goals = [f"{own.number(goal, ranked.search.unit):.4g}" for goal in own.goals]
        rows.append(
            (str(place), *ranking.ordered(ranked).values(), *goals, *(f"{value:.5g}" for value in values.values()))
        )
    kinds = _kinds(ranking)
    goals = [goal.label + _unit(goal) for goal in problem.goals]
    heads = (
        "",
        *kinds,
        *goals,
        *(name if name in NUMBERS else f"{problem.called(name)} [mm]" for name in problem.variables),
    )
    align = "r" + "l" * len(kinds) + "d" * (len(goals) + problem.n)
    return Table(tuple(rows), align, heads, "Parts")


def _left_out(ranking: Ranking) -> Table:
    """Combinations that were optimised and are not listed, each with the reason why."""
    rows = tuple((*ranking.named(number).values(), why) for number, why in ranking.left_out)
    caption = (
        "Nearest: where all limits together are missed least, as far as a local search finds; the limit named is "
        "missed by most there, and alone might come nearer."
    )
    if len(rows) > MOST_LEFT_OUT:
        caption += f" The first {MOST_LEFT_OUT} of {len(rows)}; all are in results.json."
    heads = (*_kinds(ranking), "why")
    return Table(rows[:MOST_LEFT_OUT], "l" * len(heads), heads, "Left out, and why", caption)


def _kinds(ranking: Ranking) -> list[str]:
    """Kinds of parts as a table's headings."""
    return [
        kind.replace("_", " ").removesuffix("s").replace("lense", "lens").replace("glasse", "glass")
        for kind in ranking.combinations.kinds
    ]


def _unit(goal: Goal) -> str:
    return f" [{goal.quantity.unit}]" if goal.quantity.unit else ""


# --- pictures ---------------------------------------------------------------------------------------------------------


def optimisation_pictures(result: Result) -> dict[str, Picture]:
    """Name to picture; empty where an optimisation has nothing to draw."""
    drawn = {}
    if result.bore is not None:
        pupil = result.bore
        drawn["bore"] = bore_and_stop(pupil.fields_mm, pupil.kept_bore, pupil.kept_pupil, pupil.misplaced)
    if result.front is not None and len(result.front.points) > 1:
        drawn["front"] = _front(result.front, result.answer)
    if result.robust is not None:
        robust = result.robust
        together = ("all together", robust.nominal.yield_.value, robust.robust.yield_.value)
        rows = [*robust.constraint_yields, together]
        drawn["robust"] = robust_yields([(in_words(str(row[0])), float(row[1]), float(row[2])) for row in rows])
    return drawn


def _front(front: Front, answer: Answer) -> Picture:
    """The first goal over the second; the third, where there is one, by shade."""
    order = [1, 0, *range(2, len(front.goals))][: min(len(front.goals), 3)]
    values = np.array([list(point.goals.values()) for point in front.points])[:, order]
    goals = [front.goals[k] for k in order]
    log = [
        goal.quantity.positive and bool(column.max() > 3 * column.min() > 0)
        for goal, column in zip(goals, values.T, strict=True)
    ]
    axes = [
        f"{in_words(goal.label)}{_unit(goal)} ({'less' if goal.direction == 'min' else 'more'} is better)"
        for goal in goals
    ]
    x, y = (answer.number(goal) for goal in goals[:2])
    title = f"{in_words(goals[1].label)} against {in_words(goals[0].label)}, designs of which none is better in all"
    return goal_front(values, axes, log=log, title=title, answer=(x, y))
