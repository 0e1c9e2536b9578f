"""Reports made whole: a design with a first look at tolerances and calibration, a study, or a story of several.

A story carries a design through optimisation, tolerances and a calibration plan, in one TOML file::

    [story]
    title = "A rigid borescope of 5.8 mm"
    question = "What it must see, and how well."
    design = "start.toml"            # a file beside the story, or a preset

    [[parts]]
    optimize = "optimize.toml"       # a study of roslf optimize
    take = "best"                    # what goes on: best, robust, or parts-01 and so on of a catalogue search

    [[parts]]
    tolerance = "tolerance.toml"     # a study of roslf tolerance

    [[parts]]
    calibration = { board = "8x6 1 mm", boards = 12, tilt = "20 deg" }

Parts run in their order. The first gets the story's design, each later one what the part before it passes on: an
optimisation what it found, the others what they were given. A `design` in a study's own file counts only where that
study runs alone. What `calibration` leaves out is chosen to suit the design: `board`, `boards`, `tilt`, `distance`,
`range`, `noise` (of a corner, in microlens pitches), `f_sigma` (how well f is known) and `seed`. Instead of a plan,
`calibrated = "FOLDER"` takes what `roslf calibrate` found.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, ValidationError, field_validator, model_validator

from ..design import Design, preset_names
from ..design.files import Kind, kind_of, load_beside
from ..errors import InputError, Problem
from ..optimization.run import designs
from ..tolerancing.study import StrictTable
from ..toml_files import problems_of, read_toml
from .blocks import Block, Bullets, Paragraph, Report, Section, Statements
from .calibration import Calibrated, CalibrationPart, calibration_plan, read_calibration
from .design import FOOTER, Evidence, design_report, making
from .optimization import optimization_section, statements
from .studies import Tell, quick_tolerances, run_optimisation, run_tolerances

if TYPE_CHECKING:
    from ..optimization.run import Result

TAKES = re.compile(r"best|robust|parts-\d\d")
STUDIES = ("optimize", "tolerance", "calibration", "calibrated")
"""What a part may be."""


class Opening(StrictTable):
    """`[story]`."""

    title: str
    question: str = ""
    design: str
    """Design file, relative to the story, or the name of a preset."""


class StoryPart(StrictTable):
    """One of `[[parts]]`: exactly one study."""

    optimize: str | None = None
    tolerance: str | None = None
    calibration: CalibrationPart | None = None
    calibrated: str | None = None
    """Folder of a calibration that was made, relative to the story."""
    take: str = "best"
    """Of an optimisation: which of its designs goes on."""

    @field_validator("take")
    @classmethod
    def _known(cls, name: str) -> str:
        if not TAKES.fullmatch(name):
            raise ValueError(f"'{name}' is nothing to take; write best, robust, or parts-01 and so on")
        return name

    @model_validator(mode="after")
    def _one(self) -> StoryPart:
        given = [key for key in STUDIES if getattr(self, key) is not None]
        if len(given) != 1:
            has = " and ".join(given) or "nothing"
            raise ValueError(f"has {has}; give each part one of optimize, tolerance, calibration or calibrated")
        if "take" in self.model_fields_set and self.optimize is None:
            raise ValueError("take goes with optimize only; leave it out")
        return self

    @property
    def file(self) -> str | None:
        """The study's file."""
        return self.optimize or self.tolerance


class StoryTable(StrictTable):
    """A whole file."""

    story: Opening
    parts: Annotated[tuple[StoryPart, ...], Field(min_length=1)]


@dataclass(frozen=True)
class Story:
    """A story ready to run."""

    table: StoryTable
    design: Design
    studies: tuple[Mapping[str, Any], ...]
    """What each part's file says; empty for a part without one."""
    folder: Path
    origin: str
    calibrations: Mapping[int, Calibrated]
    """By the part's index."""

    def place_of(self, index: int) -> tuple[Path, str]:
        """Where files named by a part's study are looked for, and what its errors are told of."""
        file = self.table.parts[index].file
        if file is None:
            return self.folder, f"{self.origin}: parts.{index}"
        return (self.folder / file).parent, str(self.folder / file)


def load_story(path: str | os.PathLike[str]) -> Story:
    """Read a story with its design and its studies.

    Raises
    ------
    InputError
        Names the file and every fault in it; also a study or a design that is not there.
    """
    place = Path(path)
    return read_story(read_toml(place, str(path)), place.parent, str(path))


def load_story_or_study(path: Path) -> tuple[Kind, Story | None]:
    """What kind of file a path (or a preset's name) names, and the story where it is one.

    Raises
    ------
    InputError
        It cannot be read, is none of the kinds, or is a story with faults.
    """
    if str(path) in preset_names() and not path.exists():
        return "design", None
    data = read_toml(path, str(path))
    kind = kind_of(data, str(path))
    return kind, read_story(data, path.parent, str(path)) if kind == "story" else None


def read_story(data: Mapping[str, Any], folder: Path = Path(), origin: str = "") -> Story:
    """The same as `load_story` from nested values, with `folder` for the files they name."""
    try:
        table = StoryTable.model_validate(data, context={"from_file": True})
    except ValidationError as error:
        raise InputError(problems_of(error, StoryTable), origin) from None
    faults: list[Problem] = []
    studies: list[Mapping[str, Any]] = []
    calibrations: dict[int, Calibrated] = {}
    design, name = None, table.story.design
    try:
        design = load_beside(name, folder)
    except InputError as error:
        faults += [Problem("story.design", str(fault)) for fault in error.problems]
    for index, part in enumerate(table.parts):
        studies.append({})
        try:
            if part.file is not None:
                studies[index] = read_toml(folder / part.file, part.file)
            elif part.calibrated is not None:
                calibrations[index] = read_calibration(folder / part.calibrated)
        except InputError as error:
            key = next(key for key in STUDIES if getattr(part, key) is not None)
            lead = "" if part.file is None else f"{part.file}: "
            said = (fault.message if part.file is None else str(fault) for fault in error.problems)
            faults += [Problem(f"parts.{index}.{key}", lead + text) for text in said]
    if faults or design is None:
        raise InputError(tuple(faults), origin)
    return Story(table, design, tuple(studies), folder, origin, calibrations)


def full_report(
    design: Design,
    *,
    seed: int = 0,
    calibrated: Calibrated | None = None,
    progress: Tell = lambda _: None,
    **options: Any,
) -> Report:
    """A design's report with a first look at tolerances and a calibration plan.

    Parameters
    ----------
    design : Design
    seed : int
        Of builds and boards' poses.
    calibrated : Calibrated, optional
        What a calibration found, instead of the plan of one.
    progress : callable
        Told what is being made.
    **options
        As `design_report` takes them.

    Raises
    ------
    InputError
        A design that cannot be evaluated.
    """
    evidence = _first_look(design, seed, progress, Evidence(calibration=calibrated))
    return design_report(design, evidence=evidence, progress=progress, **options)


def study_report(
    kind: Kind, path: Path, *, seed: int | None = None, progress: Tell = lambda _: None, **options: Any
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
    progress, **options
        As `full_report` takes them.

    Raises
    ------
    InputError
        Every fault of the file.
    """
    data, origin = read_toml(path, str(path)), str(path)
    if kind == "optimize":
        result = run_optimisation(data, None, path.parent, origin, _prefixed(progress, "optimisation"), seed)
        best = _taken(result, "best")
        if best is None:
            return _without_design(result, **options)
        design, evidence = best, Evidence(result)
    else:
        seeded = data if seed is None else {**data, "seed": seed}
        tolerances = run_tolerances(seeded, None, path.parent, origin, _counted(progress, "tolerances"))
        design, evidence = tolerances.plan.question.design, Evidence(tolerances=tolerances)
    evidence = _first_look(design, seed or 0, progress, evidence)
    title = str(data.get("name", design.name))
    return design_report(design, evidence=evidence, title=title, progress=progress, **options)


def story_report(story: Story, *, seed: int | None = None, progress: Tell = lambda _: None, **options: Any) -> Report:
    """Run a story, part by part, and report on the design it ends with.

    Parameters
    ----------
    story : Story
    seed : int, optional
        Of all parts, instead of their own.
    progress, **options
        As `full_report` takes them.

    Raises
    ------
    InputError
        A fault of a part's study, or a part that has nothing to pass on.
    """
    design, evidence, steps = story.design, Evidence(), []
    for index, part in enumerate(story.table.parts):
        where = f"part {index + 1} of {len(story.table.parts)}"
        data, (folder, origin) = story.studies[index], story.place_of(index)
        if part.optimize is not None:
            told = _prefixed(progress, f"{where}, optimisation")
            result = run_optimisation(data, design, folder, origin, told, seed)
            taken = _taken(result, part.take)
            if taken is None:
                raise InputError((Problem(f"parts.{index}", _nothing(result, part.take)),), story.origin)
            steps.append(
                f"Optimisation ({data['name']}), from {design.name}; what goes on: {_chosen(part.take, taken)}."
            )
            design, evidence = taken, replace(evidence, optimisation=result)
        elif part.tolerance is not None:
            seeded = data if seed is None else {**data, "seed": seed}
            counted = _counted(progress, f"{where}, tolerances")
            evidence = replace(evidence, tolerances=run_tolerances(seeded, design, folder, origin, counted))
            steps.append(f"Tolerances ({data['name']}), of {design.name}.")
        elif part.calibration is not None:
            progress(f"{where}, calibration plan")
            asked = part.calibration if seed is None else part.calibration.model_copy(update={"seed": seed})
            evidence = replace(evidence, calibration=calibration_plan(design, asked), planned=asked)
            steps.append(f"Calibration plan, for {design.name}.")
        else:
            calibrated = story.calibrations[index]
            evidence = replace(evidence, calibration=calibrated)
            steps.append(f"Calibration of a camera built to {calibrated.data['design']}.")
    opening: tuple[Block, ...] = (Bullets(tuple(steps)),)
    if story.table.story.question:
        opening = (Paragraph(story.table.story.question), *opening)
    return design_report(
        design, evidence=evidence, opening=opening, title=story.table.story.title, progress=progress, **options
    )


def _first_look(design: Design, seed: int, progress: Tell, known: Evidence) -> Evidence:
    """What is known of a design, with a first look at tolerances and a calibration plan where these are not."""
    if known.tolerances is None:
        known = replace(known, tolerances=quick_tolerances(design, seed, _counted(progress, "tolerances")))
    if known.calibration is None:
        progress("calibration plan")
        asked = CalibrationPart(seed=seed)
        known = replace(known, calibration=calibration_plan(design, asked), planned=asked)
    return known


def _taken(result: Result, name: str) -> Design | None:
    """A design of an optimisation by its name; None where it was not found."""
    return dict(designs(result)).get(f"{name}.toml")


def _chosen(take: str, design: Design) -> str:
    """What of an optimisation goes on, in words."""
    if take == "best":
        return "its optimum"
    if take == "robust":
        return "the robust design, moved off the edges of the optimum's limits"
    return f"number {int(take.removeprefix('parts-'))} of its parts lists ({design.source.removeprefix('catalogue: ')})"


def _nothing(result: Result, name: str) -> str:
    """Why an optimisation has no design of that name."""
    if not result.answer.feasible:
        conflict = result.answer.conflict
        clash = " and ".join(conflict.smallest) if conflict is not None else "its limits"
        return f"no design was found to go on with: {clash} cannot hold together; roslf optimize tells the ways out"
    known = ", ".join(file.removesuffix(".toml") for file, _ in designs(result))
    return f"found no '{name}' to take; it has {known}"


def _without_design(result: Result, *, command: str = "", stamp: tuple[str, ...] = ()) -> Report:
    """Of an optimisation that found no design: what stands in the way."""
    asked = result.answer.asked
    sections = (
        Section("Summary", (Statements(tuple(statements(result))),)),
        Section("Optimisation", optimization_section(result).blocks, "optimisation"),
        making(command, tuple(Evidence(result).seeds()), stamp),
    )
    return Report(asked.name, f"from {result.answer.problem.design.name}", sections, FOOTER)


def _prefixed(progress: Tell, what: str) -> Tell:
    return lambda said: progress(f"{what}: {said}")


def _counted(progress: Tell, what: str) -> Callable[[int, int], None]:
    return lambda done, total: progress(f"{what}: {done} of {total} builds")
