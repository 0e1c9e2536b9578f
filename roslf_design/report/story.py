"""Reports made whole: a design with a first look at tolerances and calibration, a study, or a story of several."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..calibration import CalibrationError
from ..design.files import read_toml
from ..design.kinds import Kind, kind_of
from ..errors import InputError, Problem
from .blocks import Block, Bullets, Paragraph, Report, Section, Statements
from .calibrated import Calibrated
from .calibration_plans import calibration_plan
from .content import FOOTER, design_report, making
from .evidence import Evidence
from .quick_tolerances import quick_tolerances
from .story_file import CalibrationPart, Story, read_story
from .studies import run_optimisation, run_tolerances

if TYPE_CHECKING:
    from ..calibration.planning import CapturePlan as Plan
    from ..design import Design
    from ..optimize.run import Result

Tell = Callable[[str], None]


def full_report(
    design: Design,
    *,
    seed: int = 0,
    calibrated: Calibrated | None = None,
    progress: Tell | None = None,
    **told: Any,
) -> Report:
    """A design's report with a first look at tolerances and a calibration plan.

    Parameters
    ----------
    design : Design
    seed : int
        Of builds and boards' poses.
    calibrated : Calibrated, optional
        What a calibration found, instead of the plan of one.
    progress : callable, optional
        Told what is being made.
    **told
        As `design_report` takes them.

    Raises
    ------
    InputError
        A design that cannot be evaluated.
    """
    tell = progress or (lambda _: None)
    found = quick_tolerances(design, seed, _counted(tell, "tolerances"))
    tell("calibration plan")
    plan = _planned(design, CalibrationPart(seed=seed)) if calibrated is None else calibrated
    evidence = Evidence(tolerances=found, calibration=plan)
    seeds = (f"Seed of the calibration boards' poses: {seed}.",) if calibrated is None else ()
    return design_report(design, evidence=evidence, seeds=seeds, progress=progress, **told)


def study_report(
    kind: Kind,
    path: Path,
    *,
    seed: int | None = None,
    progress: Tell | None = None,
    command: str = "",
    stamp: tuple[str, ...] = (),
) -> Report:
    """A study's report: the design it is about, with what the study found and all else that a design's report has.

    Parameters
    ----------
    kind : {"optimize", "tolerance"}
        What the file holds.
    path : Path
        The study's file.
    seed : int, optional
        Instead of the study's.
    progress, command, stamp
        As `design_report` takes them.

    Raises
    ------
    InputError
        Every fault of the file.
    """
    tell = progress or (lambda _: None)
    data, origin = read_toml(path, str(path)), str(path)
    if kind == "optimize":
        result = run_optimisation(data, None, path.parent, origin, _prefixed(tell, "optimisation"), seed)
        design = _taken(result, "best")
        if design is None:
            return _without_design(result, command, stamp)
        seeds = 0 if seed is None else seed
        tolerances = quick_tolerances(design, seeds, _counted(tell, "tolerances"))
        plan = _planned(design, CalibrationPart(seed=seeds))
        evidence = Evidence(result, tolerances, plan)
    else:
        changed = data if seed is None else {**data, "seed": seed}
        tolerances = run_tolerances(changed, None, path.parent, origin, _counted(tell, "tolerances"))
        design = tolerances.plan.question.design
        evidence = Evidence(tolerances=tolerances, calibration=_planned(design, CalibrationPart()))
    title = str(data.get("name", design.name))
    return design_report(design, evidence=evidence, title=title, command=command, stamp=stamp, progress=progress)


def story_report(
    story: Story,
    *,
    seed: int | None = None,
    progress: Tell | None = None,
    command: str = "",
    stamp: tuple[str, ...] = (),
) -> Report:
    """Run a story, part by part, and report on the design it ends with.

    Parameters
    ----------
    story : Story
    seed : int, optional
        Of all parts, instead of their own.
    progress, command, stamp
        As `design_report` takes them.

    Raises
    ------
    InputError
        A fault of a part's study, or a part that has nothing to pass on.
    """
    tell = progress or (lambda _: None)
    design, evidence, steps = story.design, Evidence(), []
    seeds: list[str] = []
    for index, part in enumerate(story.table.parts):
        where, data, origin = (
            f"part {index + 1} of {len(story.table.parts)}",
            story.studies[index],
            story.origin_of(index),
        )
        if part.optimize is not None:
            told = _prefixed(tell, f"{where}, optimisation")
            result = run_optimisation(data, design, story.folder_of(index), origin, told, seed)
            found = _taken(result, part.take)
            if found is None:
                raise InputError((Problem(f"parts.{index}", _nothing(result, part.take)),), story.origin)
            steps.append(
                f"Optimisation ({data['name']}), from {design.name}; what goes on: {_chosen(part.take, found)}."
            )
            design, evidence = found, Evidence(result, evidence.tolerances, evidence.calibration)
        elif part.tolerance is not None:
            changed = data if seed is None else {**data, "seed": seed}
            folder, counted = story.folder_of(index), _counted(tell, f"{where}, tolerances")
            tolerances = run_tolerances(changed, design, folder, origin, counted)
            steps.append(f"Tolerances ({data['name']}), of {design.name}.")
            evidence = Evidence(evidence.optimisation, tolerances, evidence.calibration)
        elif part.calibration is not None:
            tell(f"{where}, calibration plan")
            asked = part.calibration if seed is None else part.calibration.model_copy(update={"seed": seed})
            evidence = Evidence(
                evidence.optimisation, evidence.tolerances, _planned(design, asked), part.calibration.f_sigma
            )
            seeds.append(f"Seed of the calibration boards' poses: {asked.seed}.")
            steps.append(f"Calibration plan, for {design.name}.")
        elif part.calibrated is not None:
            known = story.calibrations[index]
            evidence = Evidence(evidence.optimisation, evidence.tolerances, known)
            steps.append(f"Calibration of a camera built to {known.data['design']}.")
    opening: tuple[Block, ...] = (Bullets(tuple(steps)),)
    if story.table.story.question:
        opening = (Paragraph(story.table.story.question), *opening)
    return design_report(
        design,
        evidence=evidence,
        opening=opening,
        title=story.table.story.title,
        seeds=tuple(seeds),
        command=command,
        stamp=stamp,
        progress=progress,
    )


def _planned(design: Design, asked: CalibrationPart) -> Plan | str:
    try:
        return calibration_plan(design, asked, asked.seed)
    except CalibrationError as error:
        return str(error)


def _taken(result: Result, name: str) -> Design | None:
    """A design of an optimisation by its name; None where it was not found."""
    from ..optimize.run import designs

    return dict(designs(result)).get(f"{name}.toml")


def _chosen(take: str, design: Design) -> str:
    """What of an optimisation goes on, in words."""
    if take == "best":
        return "its optimum"
    if take == "robust":
        return "the robust design, moved off the edges of the optimum's limits"
    return f"number {int(take.removeprefix('parts-'))} of its parts lists ({design.source.removeprefix('catalogue: ')})"


def _nothing(result: Result, name: str) -> str:
    from ..optimize.run import designs

    if not result.answer.feasible:
        conflict = result.answer.conflict
        clash = " and ".join(conflict.smallest) if conflict is not None else "its limits"
        return f"no design was found to go on with: {clash} cannot hold together; roslf optimize tells the ways out"
    known = ", ".join(file.removesuffix(".toml") for file, _ in designs(result))
    return f"found no '{name}' to take; it has {known}"


def _without_design(result: Result, command: str, stamp: tuple[str, ...]) -> Report:
    """Of an optimisation that found no design: what stands in the way."""
    from ..optimize.section import optimize_section, statements

    asked = result.answer.asked
    sections = (
        Section("Summary", (Statements(tuple(statements(result))),)),
        Section("Optimisation", optimize_section(result).blocks, "optimisation"),
        making(command, Evidence(result).seeds, stamp),
    )
    return Report(asked.name, f"from {result.answer.problem.design.name}", sections, FOOTER)


def _prefixed(tell: Tell, what: str) -> Tell:
    return lambda said: tell(f"{what}: {said}")


def _counted(tell: Tell, what: str) -> Callable[[int, int], None]:
    return lambda done, total: tell(f"{what}: {done} of {total} builds")


def load_story_or_study(path: Path) -> tuple[Kind, Story | None]:
    """What kind of file a path names, and the story where it is one.

    Raises
    ------
    InputError
        It cannot be read, is none of the kinds, or is a story with faults.
    """
    data = read_toml(path, str(path))
    kind = kind_of(data, str(path))
    return kind, read_story(data, path.parent, str(path)) if kind == "story" else None
