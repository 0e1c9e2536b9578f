"""Reports made whole: a design with default tolerances and a calibration plan, a study, or a story of several.

A story (docs/reference/story-file.md) carries a design through optimisation, tolerances and a calibration plan. Parts
run in their order. The first gets the story's design, each later one what the part before it passes on: an optimisation
what it found, the others what they were given. A `design` in a study's own file counts only where that study runs
alone. What `calibration` leaves out is chosen to suit the design; instead of a plan, `calibrated = "FOLDER"` takes what
`roslf calibrate` found.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from pydantic import Field, field_validator, model_validator

from ..calibration.options import PlanOptions, calibration_plan, lengths_after, planned_lengths
from ..calibration.written import calibrated_camera
from ..camera import Camera
from ..design import Design, preset_names
from ..design.files import Kind, kind_of
from ..errors import InputError, Problem, path_of, refusal
from ..evaluation import default_fields
from ..evaluation.required import load_beside
from ..progress import CountedProgress, shares, silent
from ..theory.depth_budget import BUILT, CALIBRATED, COVERAGE, depth_budget
from ..theory.depth_of_field import depth_of_field
from ..theory.field_of_view import focus_ahead
from ..theory.focused import has_views
from ..theory.length_covariance import LengthCovariance
from ..theory.limits import as_design
from ..tolerancing.places import CALIBRATION, FOCUSING
from ..tolerancing.result import StudyResult, analyse
from ..tolerancing.run import run_trials
from ..tolerancing.study import TolerancePlan, tolerance_plan
from ..tolerancing.summaries import summarise
from ..tolerancing.tally import Tally
from ..tolerancing.trials import first_builds, lengths_built
from ..toml_files import StrictTable, read_toml, validated
from . import optimise
from .blocks import Block, Bullets, Finding, Paragraph, Report, Section, Statements
from .calibrate.pages import Calibrated, calibrated_finding, plan_finding, read_calibration
from .design.pages import design_report, making
from .sheet.lines import BuildSpread, CalibrationSpread, SpreadSources, basis
from .tolerance.pages import focus_words, tolerance_finding

if TYPE_CHECKING:
    from ..optimization.study import Result

TAKES = re.compile(r"best|robust|parts-\d\d")
PLANNED = Path("planned")
"""Word for a calibration that is no folder: the one that is planned."""
LINES = "lines of the data sheet"
"""Step of a report that is counted."""
STUDIES = ("optimize", "tolerance", "calibration", "calibrated")
"""Kinds of study that a part may be."""


class StoryHeader(StrictTable):
    """`[story]`."""

    title: str
    question: str = ""
    design: str
    """Design file, relative to the story, or the name of a preset."""


class StoryPart(StrictTable):
    """Part of a story, one of `[[parts]]`: exactly one study."""

    optimize: str | None = None
    tolerance: str | None = None
    calibration: PlanOptions | None = None
    calibrated: str | None = None
    """Folder of a calibration that was made, relative to the story."""
    take: str = "best"
    """Name of the design of an optimisation that goes on to the next part."""

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
    def kind(self) -> str:
        """Kind of the study."""
        return next(key for key in STUDIES if getattr(self, key) is not None)

    @property
    def file(self) -> str | None:
        """The study's file."""
        return self.optimize or self.tolerance


class _StoryTable(StrictTable):
    """A whole file."""

    story: StoryHeader
    parts: Annotated[tuple[StoryPart, ...], Field(min_length=1, max_length=20)]


@dataclass(frozen=True)
class _Story:
    """A story ready to run."""

    table: _StoryTable
    design: Design
    studies: Mapping[int, Mapping[str, Any]]
    """Content of a part's study file, by the part's index; so for calibrations."""
    folder: Path
    origin: str
    calibrations: Mapping[int, Calibrated]


def load_story_or_study(path: Path) -> tuple[Kind, _Story | None]:
    """Kind of file that a path (or a preset's name) names, and the story where it is one; errors of `_read_story`."""
    if not path.exists() and (str(path) in preset_names() or not path.suffix):  # what is no preset, `load` tells
        return "design", None
    data = read_toml(path, str(path))
    kind = kind_of(data, str(path))
    return kind, _read_story(data, path.parent, str(path)) if kind == "story" else None


def _read_story(data: Mapping[str, Any], folder: Path = Path(), origin: str = "") -> _Story:
    """A story from nested values, with its design and its studies; `folder` is for the files they name.

    Raises
    ------
    InputError
        Names the file and every fault in it and in these.
    """
    table = validated(_StoryTable, data, origin)
    faults: list[Problem] = []
    studies: dict[int, Mapping[str, Any]] = {}
    calibrations: dict[int, Calibrated] = {}
    design = None
    try:
        design = load_beside(table.story.design, folder)
    except InputError as error:
        faults += [Problem("story.design", f"{table.story.design}: {fault}") for fault in error.problems]
    for index, part in enumerate(table.parts):
        place = f"parts.{index}.{part.kind}"
        try:
            if part.file is not None:
                studies[index] = read_toml(folder / part.file, part.file)
            elif part.calibrated is not None:
                calibrations[index] = read_calibration(folder / part.calibrated)
        except InputError as error:
            texts = [f"{part.file}: {fault}" if part.file else fault.message for fault in error.problems]
            faults += [Problem(place, text) for text in texts]
    if faults or design is None:
        raise InputError(tuple(faults), origin)
    return _Story(table, design, studies, folder, origin, calibrations)


# --- studies ----------------------------------------------------------------------------------------------------------

TRIALS, TRACED = 4096, 1024
"""Units of default tolerances; and behind a real lens, where each is traced: their intervals are twice as wide."""
GRADE = "precision"
FILL, KEPT, CENTRE, DEPTH = 0.1, 0.01, 1.0, 0.1
"""Limits: change of the image fill, light lost, image centres off [px], growth of the depth noise."""
QUESTION = (
    f"No tolerance study is at hand, so these limits are the report's own: {{}} Monte Carlo units (builds) to grade "
    f"'{GRADE}' (engineering judgement, as the table of grades says), the decoder calibrated on each{{}}. A build is "
    f"good where its image fill stays within {100 * FILL:g} % of the nominal, its depth noise grows by "
    f"{100 * DEPTH:g} % at most, no field loses more than {100 * KEPT:g} % of the light that it nominally gets, and "
    f"the decoder finds image centres to {CENTRE:g} px. Your own tolerances and limits make a study: roslf tolerance."
)
OUT_OF_FOCUS, FOCUS_TRIALS = 0.05, 256
"""Share of builds from which on default tolerances are of builds that are focused, and builds that tell it."""


def _run_tolerances(
    data: Mapping[str, Any],
    design: Design | None = None,
    folder: Path = Path(),
    origin: str = "",
    progress: CountedProgress = silent,
    seed: int | None = None,
    budgets: bool = True,
) -> StudyResult:
    """Run a tolerance study with all its analyses, in this process; nothing of it stays on the disk.

    As `tolerance_plan`; `progress` is told of trials and analyses, `seed` replaces the study's; `budgets`: what
    reaches the target yield, too.
    """
    plan, study, grades = tolerance_plan(_seeded(data, seed), design, folder, origin)
    return analyse(plan, study, grades, _tally(plan.defined(origin), progress), budgets=budgets, progress=progress)


def _seeded(data: Mapping[str, Any], seed: int | None) -> Mapping[str, Any]:
    return data if seed is None else {**data, "seed": seed}


def _tally(plan: TolerancePlan, progress: CountedProgress) -> Tally:
    with tempfile.TemporaryDirectory() as scratch:
        return run_trials(plan, Path(scratch), progress=partial(progress, "builds"))


def _builds_alone(
    data: Mapping[str, Any],
    design: Design | None = None,
    folder: Path = Path(),
    origin: str = "",
    progress: CountedProgress = silent,
    seed: int | None = None,
) -> BuildSpread:
    """The trials of a tolerance study without its analyses; arguments as of `_run_tolerances`."""
    plan, study, _ = tolerance_plan(_seeded(data, seed), design, folder, origin)
    return BuildSpread(plan, summarise(plan, _tally(plan.defined(origin), progress))[-1], study.yield_target)


def _quick_tolerances(
    design: Design, seed: int = 0, progress: CountedProgress = silent, trials: int | None = None
) -> StudyResult:
    """Default tolerances; behind a real main lens, builds are what `roslf tolerance` makes of them."""
    data = quick_study(design, seed)
    # What nobody asked for needs no budget.
    return _run_tolerances(data | {"trials": trials or data["trials"]}, design, progress=progress, budgets=False)


def quick_study(design: Design, seed: int = 0) -> dict[str, Any]:
    """Default tolerances as a study's file would say them, without the design: limits relative to the nominal."""
    trials = TRACED if design.main_lens.kind.mounted else TRIALS
    data: dict[str, Any] = {
        "name": f"default tolerances, {GRADE} grade",
        "question": QUESTION.format(trials, ""),
        "trials": trials,
        "grade": GRADE,
        "seed": seed,
        "fields": [[f"{x!r} mm", f"{y!r} mm"] for x, y in default_fields(design)],
        "report": ["fill_factor", "kept_fraction", "sigma_z_mm"],
        "goals": [{"quantity": "centre_error_px", "max": CENTRE}],
        "compensators": [{"place": "calibration"}],
        "sobol_samples": 0,
        "keep_worst": 0,
        "keep_trials": 0,
    }
    plan, *_ = tolerance_plan(data, design)
    goals: list[dict[str, Any]] = []
    for column, nominal in zip(plan.columns, plan.nominal.tolist(), strict=True):
        if not math.isfinite(nominal):
            continue  # a field without light
        low, high = sorted(((1 - FILL) * nominal, (1 + FILL) * nominal))
        limits = {
            "centre_error_px": {"max": CENTRE},
            "fill_factor": {"min": low, "max": high},
            "kept_fraction": {"min": max(0.0, nominal - KEPT)},
            "sigma_z_mm": {"max": (1 + DEPTH) * abs(nominal)},
        }
        at = {} if column.field is None else {"fields": [column.field]}
        goals.append({"quantity": column.metric, **limits[column.metric], **at})
    focused = dict[str, Any]()
    if (lost := _out_of_focus(plan)) > OUT_OF_FOCUS:
        said = f", and each focused at assembly, as {100 * lost:.3g} % of them would be out of focus"
        lines = [*data["compensators"], {"place": FOCUSING, "aim": "focus"}]
        focused = {"compensators": lines, "question": QUESTION.format(trials, said)}
    return data | {"goals": goals, "report": []} | focused


def _out_of_focus(plan: TolerancePlan) -> float:
    """Share of a plan's first builds that are focused where a view of the design is no longer sharp, or nowhere."""
    builds, cameras = first_builds(plan, FOCUS_TRIALS)
    near, far = depth_of_field(Camera.of(plan.question.design.thin_twin), "view")
    focus = focus_ahead(builds.camera)
    return 1 - float((cameras & (focus >= near) & (focus <= far)).mean())


# --- reports ----------------------------------------------------------------------------------------------------------


def full_report(
    design: Design,
    *,
    seed: int = 0,
    calibrated: Calibrated | None = None,
    calibration: Path | None = None,
    at: Sequence[float] = (),
    progress: CountedProgress = silent,
    **options: Any,
) -> Report:
    """A design's report with default tolerances and a calibration plan, or what was `calibrated` instead.

    `calibration` is the latter's folder: the data sheet is then of the instrument, with what is left uncertain of it,
    where its lengths' covariance is known and is of this design. `seed` is of builds and boards' poses, `at` distances
    that are told of, `progress` is told what is being made; options as `design_report` takes them.
    """
    known = {} if calibrated is None else {"calibration": calibrated_finding(design, calibrated)}
    findings, build = _first_look(design, seed, progress, known, at=at)
    instrument = None if calibration is None else _known_if_told(calibration, design)
    own = design if instrument is None else instrument.design
    grounds = basis(own, None, instrument, at, tell=shares(progress, LINES))._replace(looked=build)
    return design_report(design, findings=findings, grounds=grounds, progress=progress, **options)


def study_report(
    kind: Kind,
    path: Path,
    *,
    seed: int | None = None,
    at: Sequence[float] = (),
    progress: CountedProgress = silent,
    **options: Any,
) -> Report:
    """A study's report: the design it is about, with what the study found and all else that a design's report has.

    `kind` is "optimize" or "tolerance", `path` the study's file, `seed` counts instead of the study's; the rest as for
    `full_report`. Every fault of the file is told by an InputError.
    """
    data, origin = read_toml(path, str(path)), str(path)
    if kind == "optimize":
        result = optimise.run_optimisation(data, None, path.parent, origin, _prefixed(progress, "optimisation"), seed)
        best = _taken(result, "best")
        if best is None:
            return _without_design(result, **options)
        design, findings, built = best, {"optimisation": optimise.optimization_finding(result)}, None
    else:
        tolerances = _run_tolerances(data, None, path.parent, origin, _prefixed(progress, "tolerances"), seed)
        design, findings = tolerances.plan.question.design, {"tolerances": tolerance_finding(tolerances)}
        built = BuildSpread(tolerances.plan, tolerances.final, tolerances.study.yield_target)
    grounds = basis(design, built, at=at, tell=shares(progress, LINES))
    findings, build = _first_look(design, seed or 0, progress, findings, grounds.build, at)
    grounds = grounds._replace(looked=build)
    report = design_report(design, findings=findings, grounds=grounds, progress=progress, **options)
    return replace(report, title=str(data.get("name", design.name)))


def story_report(
    story: _Story,
    *,
    seed: int | None = None,
    at: Sequence[float] = (),
    progress: CountedProgress = silent,
    **options: Any,
) -> Report:
    """Run a story, part by part, and report on the design it ends with; `seed` is of all parts, instead of their own.

    The rest as for `full_report`.

    Raises
    ------
    InputError
        A fault of a part's study, or a part that has nothing to pass on.
    """
    steps: list[str] = []
    findings: dict[str, Finding] = {}
    parts = list(_walked(story, seed, progress, at))
    grounds = _basis_of(story, parts, at)
    built: LengthCovariance | None = None
    for part in parts:
        design = part.design
        match part.outcome:
            case PlanOptions() as asked:
                findings["calibration"] = plan_finding(design, asked, built)
                steps.append(f"Calibration plan, for {design.name}.")
            case Calibrated() as calibrated:
                findings["calibration"] = calibrated_finding(design, calibrated)
                steps.append(f"Calibration of a camera built to {calibrated.data['design']}.")
            case StudyResult() as tolerances:
                known = grounds.calibration if design is parts[-1].design else None
                judged = replace(tolerances, calibration=known)  # as the verdicts beside it
                findings["tolerances"], built = tolerance_finding(judged), tolerances.built
                steps.append(f"Tolerances ({part.name}), of {design.name}.")
            case result:
                onwards, built = _chosen(part.take, design), None
                findings["optimisation"] = optimise.optimization_finding(result, part.take, onwards)
                steps.append(f"Optimisation ({part.name}), from {part.before.name}; what goes on: {onwards}.")
    opening: tuple[Block, ...] = (Bullets(tuple(steps)),)
    if story.table.story.question:
        opening = (Paragraph(story.table.story.question), *opening)
    report = design_report(design, findings=findings, grounds=grounds, opening=opening, progress=progress, **options)
    return replace(report, title=story.table.story.title)


class _Walked(NamedTuple):
    """A part of a story that has run."""

    outcome: Result | StudyResult | BuildSpread | PlanOptions | Calibrated
    """Result of the part; of a plan the captures asked for."""
    before: Design
    design: Design
    """Design that goes on to the next part."""
    name: str
    """Name of the part's study."""
    take: str


def _walked(
    story: _Story,
    seed: int | None,
    progress: CountedProgress,
    at: Sequence[float] = (),
    tolerances: Callable[..., StudyResult | BuildSpread] = _run_tolerances,
) -> Iterator[_Walked]:
    """Run a story's parts, tolerance studies by `tolerances`; `at`: distances that a calibration's plan covers, too."""
    design = story.design
    for index, part in enumerate(story.table.parts):
        where, before = f"part {index + 1} of {len(story.table.parts)}", design
        file, data = story.folder / (part.file or ""), story.studies.get(index, {})
        outcome: Result | StudyResult | BuildSpread | PlanOptions | Calibrated
        if part.kind == "optimize":
            tell = _prefixed(progress, f"{where}, optimisation")
            result: Result = optimise.run_optimisation(data, design, file.parent, str(file), tell, seed)
            taken = _taken(result, part.take)
            if taken is None:
                raise InputError((Problem(f"parts.{index}", _nothing(result, part.take)),), story.origin)
            outcome, design = result, taken
        elif part.kind == "tolerance":
            tell = _prefixed(progress, f"{where}, tolerances")
            data = _as_calibrated(story, index, design, file, seed, at)
            outcome = tolerances(data, design, file.parent, str(file), tell, seed)
        elif part.calibration is not None:
            progress(f"{where}, calibration plan")
            outcome = _captures(part.calibration, seed, at)
        else:
            outcome = story.calibrations[index]
        yield _Walked(outcome, before, design, str(data.get("name", "")), part.take)


def _captures(asked: PlanOptions, seed: int | None, at: Sequence[float]) -> PlanOptions:
    """Captures of a story's plan, at distances that are told of as well."""
    changed = {"at": tuple(dict.fromkeys((*asked.at, *at)))}
    return asked.model_copy(update=changed | ({} if seed is None else {"seed": seed}))


def _as_calibrated(
    story: _Story, index: int, design: Design, file: Path, seed: int | None, at: Sequence[float]
) -> Mapping[str, Any]:
    """A part's tolerance study, with the depth error that the calibration after it leaves, where the file states none.

    Lengths as the study builds them are known before.
    """
    data, later = story.studies[index], story.table.parts[index + 1 :]
    plan = tolerance_plan(data, design, file.parent, str(file))[0]
    after = next((part for part in later if part.tolerance is None), None)
    asked = CALIBRATION in plan.perfect and any(column.metric == "depth_error_mm" for column in plan.columns)
    if not asked or after is None or after.optimize is not None:
        return data
    if after.calibration is not None:
        lengths = planned_lengths(design, _captures(after.calibration, seed, at))
    else:
        known = _known_if_told(story.folder / (after.calibrated or ""), design)
        lengths = None if known is None else known.lengths
    if lengths is None:
        return data
    camera = Camera.of(design)
    ahead = plan.question.object_distance - float(camera.tip)
    terms = depth_budget(camera, ahead, build=lengths_built(plan), calibration=lengths).terms
    off = COVERAGE * math.hypot(*(float(one.u_mm or 0.0) for one in terms if one.name in (CALIBRATED, BUILT)))
    if not math.isfinite(off):
        return data
    lines = [
        {**line, "error": f"{off:.3g} mm"} if line["place"] in (CALIBRATION, [CALIBRATION]) else line
        for line in data["compensators"]
    ]
    said = f"The calibration {'as planned' if lengths.planned else 'made'} leaves depth off by {off:.3g} mm (U, k = 2)."
    return {**data, "compensators": lines, "question": f"{data.get('question', '')} {said}".strip()}


def calibration_of(asked: str | Path | None, seed: int | None, at: tuple[float, ...]) -> Path | PlanOptions | None:
    """Calibration as `datasheet_of` takes it: a folder, or where it is the word for it the one that is planned."""
    folder = None if asked is None else path_of(asked, "calibration", "a folder that `roslf calibrate` wrote")
    return PlanOptions(seed=seed or 0, at=at) if folder == PLANNED else folder


def datasheet_of(
    path: Path,
    seed: int | None = None,
    progress: CountedProgress = silent,
    calibration: Path | PlanOptions | None = None,
    at: Sequence[float] = (),
) -> SpreadSources:
    """A design's data sheet, or that of a study's design with the scatter of its builds.

    Of a story it is the sheet of the design that it ends with, its tolerances and its calibration those of the last
    parts which are about that design. `calibration`: folder of one, which tells how sure the lines are of the
    instrument that was calibrated; the sheet of a single design is then of that instrument. Or a plan of one, of the
    design. `at`: distances ahead of the tip [mm] that it tells of as well.

    Raises
    ------
    InputError
        What cannot be read; a study that finds no design; a calibration of another design.
    """
    kind, story = load_story_or_study(path)
    if story is not None:
        if calibration is not None:
            remedy = "plan it" if isinstance(calibration, PlanOptions) else 'name it, as calibrated = "FOLDER",'
            raise refusal("calibration", f"goes with a design or a study; {remedy} in the story")
        return _basis_of(story, list(_walked(story, seed, progress, at, _builds_alone)), at)
    if kind == "design":
        return sheet_of(as_design(str(path)), calibration, at, progress)
    data, origin = read_toml(path, str(path)), str(path)
    if kind == "tolerance":
        design = tolerance_plan(data, None, path.parent, origin)[0].question.design
        known = None if calibration is None else _known(calibration, design)
        built = _builds_alone(data, None, path.parent, origin, _prefixed(progress, "tolerances"), seed)
        return basis(design, built, known, at, tell=shares(progress, LINES))
    result = optimise.run_optimisation(data, None, path.parent, origin, _prefixed(progress, "optimisation"), seed)
    best = _taken(result, "best")
    if best is None:
        raise InputError((Problem("", _nothing(result, "best")),), origin)
    known = None if calibration is None else _known(calibration, best)
    return basis(best, None, known, at, _looked(best, calibration), shares(progress, LINES))


def sheet_of(
    design: Design,
    calibration: Path | PlanOptions | None = None,
    at: Sequence[float] = (),
    progress: CountedProgress = silent,
) -> SpreadSources:
    """A single design's data sheet; the rest as for `datasheet_of`."""
    known = None if calibration is None else _known(calibration, design)
    looked, tell = _looked(design, calibration), shares(progress, LINES)
    return basis(design if known is None else known.design, None, known, at, looked, tell)


def _basis_of(story: _Story, parts: Sequence[_Walked], at: Sequence[float] = ()) -> SpreadSources:
    """Sources of tolerances among the parts of a story, for the design that it ends with."""
    design = parts[-1].design
    built: BuildSpread | None = None
    known: CalibrationSpread | None = None
    for index, part in enumerate(parts):
        if part.design != design:
            continue
        match part.outcome:
            case BuildSpread() as tolerances:
                built = tolerances
            case StudyResult() as result:
                built = BuildSpread(result.plan, result.final, result.study.yield_target)
            case PlanOptions() as asked:
                lengths = planned_lengths(design, asked)
                known = None if lengths is None else CalibrationSpread("as planned", design, lengths)
            case Calibrated():
                known = _known_if_told(story.folder / (story.table.parts[index].calibrated or ""), design) or known
    return basis(design, built, known, at)


def _known(calibration: Path | PlanOptions, named: Design) -> CalibrationSpread:
    if isinstance(calibration, PlanOptions):
        best = calibration_plan(named, calibration)
        if isinstance(best, str):
            raise refusal("calibration", best)
        return CalibrationSpread("as planned", named, lengths_after(named, best, calibration))
    return CalibrationSpread(f"as in {calibration.name}", *calibrated_camera(calibration, named))


def _looked(design: Design, calibration: Path | PlanOptions | None) -> LengthCovariance | None:
    return lengths_built(_first_look_plan(design, calibration.seed)) if isinstance(calibration, PlanOptions) else None


def _first_look_plan(design: Design, seed: int) -> TolerancePlan:
    """Builds to default tolerances, known before a calibration that is planned."""
    return tolerance_plan(quick_study(design, seed), design)[0]


def known_before(path: Path, seed: int) -> tuple[Design, LengthCovariance, str, str]:
    """Design of a file, or of a tolerance study, its lengths before a calibration, and in words by whose tolerances.

    Then words on how builds are focused, after a comma.

    Raises
    ------
    InputError
        What cannot be read, and other kinds of study.
    """
    if load_story_or_study(path)[0] != "tolerance":
        design = as_design(str(path))
        plan = _first_look_plan(design, seed)
        return design, lengths_built(plan), f"default tolerances ({GRADE} grade)", focus_words(plan)
    plan = tolerance_plan(read_toml(path, str(path)), None, path.parent, str(path))[0]
    return plan.question.design, lengths_built(plan), f"tolerances of the study {plan.name}", focus_words(plan)


def _known_if_told(calibration: Path, named: Design) -> CalibrationSpread | None:
    """None of another design's, or an older one: a report's section on it says so, and lines go without."""
    with suppress(InputError):
        return _known(calibration, named)
    return None


def _first_look(
    design: Design,
    seed: int,
    progress: CountedProgress,
    known: Mapping[str, Finding],
    built: LengthCovariance | None = None,
    at: Sequence[float] = (),
) -> tuple[dict[str, Finding], LengthCovariance | None]:
    """Findings about a design, with default tolerances and a calibration plan where these are not known.

    Beside them the lengths as built, where a study knows them. Where pixels are no views, what is known.
    """
    findings = dict(known)
    if not has_views(Camera.of(design.thin_twin)):
        return findings, built
    if "tolerances" not in known:
        look = _quick_tolerances(design, seed, _prefixed(progress, "tolerances"))
        findings["tolerances"], built = tolerance_finding(look, first_look=True), look.built
    if "calibration" not in known:
        progress("calibration plan")
        findings["calibration"] = plan_finding(design, PlanOptions(seed=seed, at=at), built)
    return findings, built


def _taken(result: Result, name: str) -> Design | None:
    return dict(result.designs()).get(f"{name}.toml")


def _chosen(take: str, design: Design) -> str:
    if take == "best":
        return "its optimum"
    if take == "robust":
        return "the robust design, moved off the edges of the optimum's limits"
    return f"number {int(take.removeprefix('parts-'))} of its parts lists ({design.source.removeprefix('catalogue: ')})"


def _nothing(result: Result, name: str) -> str:
    """Reason why an optimisation has no design of that name."""
    if not result.answer.feasible:
        conflict = result.answer.conflict
        if conflict is None:
            return "its search was stopped before a design to go on with was found; give it more time"
        return f"no design was found to go on with: {conflict.reason}; roslf optimize reports the ways out"
    known = ", ".join(file.removesuffix(".toml") for file, _ in result.designs())
    return f"found no '{name}' to take; it has {known}"


def _without_design(result: Result, *, command: str = "", stamp: tuple[str, ...] = ()) -> Report:
    """Report of an optimisation that found no design: what stands in the way."""
    asked, finding = result.answer.asked, optimise.optimization_finding(result)
    summary = Section("Summary", (Statements(tuple(optimise.statements(result))),))
    sections = (summary, finding.section, making(command, (finding.seed,), stamp))
    return Report(asked.name, f"from {result.answer.problem.design.name}", sections)


def _prefixed(progress: CountedProgress, what: str) -> CountedProgress:
    return lambda said, done=0.0, total=0.0: progress(f"{what}: {said}", done, total)
