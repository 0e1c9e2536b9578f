"""A study: what its file may hold, with every fault at once; what runs of it; and all that was found as JSON."""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import permutations
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, StrictBool, ValidationError, ValidationInfo, field_validator

from .._arrays import by_value, ratio
from ..bore.conjugates import CONJUGATES
from ..camera import TIP, Camera
from ..catalogue import load_catalogue
from ..design import PATHS, Design
from ..design.files import expect_kind
from ..design.parts import Stop
from ..errors import InputError, Problem
from ..evaluation import evaluate
from ..evaluation.fields import unseen
from ..evaluation.groups import Verdict
from ..evaluation.required import Requirement, limits_for_study, required_of, studied
from ..json_data import plain
from ..lenses.prescription import Prescription
from ..progress import silent
from ..tables import BriefValue
from ..theory.focused import focus_faults
from ..theory.quantity import FEASIBLE
from ..toml_files import StrictTable, nearest, problems_of, read_toml
from ..units import Length
from ..words import number
from .bore import BoreTable, EquivalentPupil, solve_through
from .bounds import refuse_all
from .choices import given_by
from .combinations import CatalogueTable, Combinations
from .front import Front, ParetoTable, pareto_front
from .goals import Constraint, Goal
from .lens_variables import lens_faults, places_that_vary, varies_lens
from .problem import DesignProblem, sobol_units, titled
from .ranking import Ranking, rank
from .reach import unreachable
from .robust import Robust, RobustTable, maximise_robustness, scatter_of
from .solve import Answer, Settings, SolverTable, Tell, optimum_accuracy, refused_by_bore, solve_by_rays
from .traces import Asked, Retrace, faults_behind
from .variables import NUMBERS, NumberVariable, Variable, lengths_and_numbers, name_faults, places_of

SCHEMA = "roslf.optimization/1"
DIVERGES = re.compile(r"elements\.\d+\.focal_length|main_lens\.surfaces\.\d+\.radius")
"""Places that are below 0 of what diverges."""
TIES = {"together", "same"}
"""Keys of variables that set several places."""
FIXED_POINTS = 32
"""Points of the bounds, beside some of their corners, at which a value that nothing varies is told from others."""

ROBUST_STOPPED = (
    "[robust] was stopped: how many builds hold every limit was not judged; what would have followed is left out"
)


class StudyTable(StrictTable):
    """A whole study file."""

    name: str
    question: str = ""
    design: str
    wavelength: Length | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    order: Literal["weighted", "lexicographic"] = "weighted"
    slack: Annotated[float, Field(ge=0, lt=1)] = 0.01
    """Lexicographic: share of an earlier goal that a later one may cost."""
    microlens_in_focus: StrictBool = False
    """Whether f_ml follows the focus."""
    variables: Annotated[dict[str, Variable], Field(validate_default=True, default_factory=dict)]
    constraints: tuple[Constraint, ...] = ()
    required: StrictBool = False
    """Whether all that the design's `[required]` asks for is held as well."""
    goals: Annotated[tuple[Goal, ...], Field(validate_default=True)] = ()
    bore: BoreTable | None = None
    solver: SolverTable = SolverTable()
    pareto: ParetoTable | None = None
    catalogue: CatalogueTable | None = None
    robust: RobustTable | None = None

    @field_validator("variables", mode="before")
    @classmethod
    def _some(cls, value: Any, info: ValidationInfo) -> Any:
        if not isinstance(value, Mapping) or not value:
            raise ValueError('nothing may vary; add a table [variables] with e.g. d_3 = ["0.5 mm", "8 mm"]')
        design: Design | None = (info.context or {}).get("design")
        placed = {name: name if design is None else design.chain.place_named(name) for name in value}
        if twice := [name for name in placed if name != placed[name] and placed[name] in placed]:
            raise ValueError(f"{twice[0]} is {placed[twice[0]]}, which varies too; name it once")
        return {placed[name]: _number_bounds(name, own) if name in NUMBERS else own for name, own in value.items()}

    @field_validator("goals", mode="before")
    @classmethod
    def _wanted(cls, value: Any) -> Any:
        if not value:
            raise ValueError('nothing is wanted; add [[goals]] with e.g. quantity = "sigma_z_mm", direction = "min"')
        return value

    @property
    def rims(self) -> tuple[Stop, ...]:
        """Rims of the bore; empty where the design's aperture stands."""
        return () if self.bore is None else self.bore.rims

    def _limits(self, design: Design) -> dict[str, Constraint]:
        """All limits, by their keys in the files: those of the study, then the design's own that are none of these."""
        own = {f"constraints.{number}": limit for number, limit in enumerate(self.constraints)}
        asked = limits_for_study(design) if self.required else ()
        every = (Constraint.model_validate(limit, context={"from_file": True}) for limit in asked)
        return own | {f"required: {limit.label}": limit for limit in every if limit not in self.constraints}

    def _asked(self, design: Design) -> dict[str, Constraint | Goal]:
        """All limits and goals, by their keys."""
        return self._limits(design) | {f"goals.{number}": goal for number, goal in enumerate(self.goals)}

    def faults(self, design: Design) -> Iterator[Problem]:
        """Faults of a study against its design."""
        if self.required and not design.required:
            yield Problem("required", f"{design.name} has no [required] to be held; add it, or drop the key")
        ties = {name: variable for name, variable in self.variables.items() if variable.tied}
        yield from _name_faults(self.variables, design, ties)
        places = places_of(self.variables)
        yield from self._shift_faults(design)
        for name, variable in self._bounded():
            if name in NUMBERS:
                continue
            if variable.min == 0 and not name.endswith(("d_3", "distance")):
                yield Problem(f"variables.{name}", "min must be greater than zero")
            behind = PATHS.get(name, name) == PATHS["d_3"] and design.d_3 < 0
            if variable.min < 0 and not behind:
                ends = f"{variable.min:g} and {variable.max:g} mm"
                if not DIVERGES.fullmatch(name):
                    message = "min must not be negative; only an element's focal length may be, or a radius"
                    yield Problem(f"variables.{name}", message)
                elif variable.max >= 0:
                    yield Problem(f"variables.{name}", f"bounds {ends} hold 0 between them; keep to one sign")
        for name in (one for key, variable in self.variables.items() for one in variable.tied or (key,)):
            if self.bore and (name in ("D_F", "d_3") or name.startswith(("aperture.", "stops.", "tube_"))):
                yield Problem("variables", f"'{name}' varies, but the bore gives it; drop one of them")
        yield from self._contradictions(design)
        asked = self._asked(design)
        views = [part.quantity.name for part in asked.values() if part.quantity.of_views]
        yield from focus_faults(design, *views, changed=("f_ml",) if self.microlens_in_focus else places)
        half = [side / 2 for side in design.microlens_array.size]
        for key, part in asked.items():
            if part.temperature is not None and design.environment is None:
                words = f"{design.name} has no [environment] that says what grows; add it, or drop temperature"
                yield Problem(f"{key}.temperature", words)
            if part.field is not None and any(abs(x) > most for x, most in zip(part.field, half, strict=True)):
                words = f"lies beyond the array, which reaches {half[0]:g} and {half[1]:g} mm from its middle"
                yield Problem(f"{key}.field", words)
        for lens in design.main_lens.kind.mounted:
            yield from self._faults_behind(design, lens)
        goals = [goal.quantity.name for goal in self.goals]
        for name in self.pareto.goals if self.pareto is not None else ():
            if name not in goals:
                hint = nearest(name, goals, f"goals are {', '.join(goals)}")
                yield Problem("pareto.goals", f"'{name}' is not among [[goals]]; {hint}")
        if self.catalogue is not None:
            if of_lens := sorted(
                {"orientations", "glasses"} & {*self.catalogue.kinds} - {*design.main_lens.kind.parts}
            ):
                words = f"{of_lens[0]} are of a real main lens and this design's is ideal; leave the kind out"
                yield Problem("catalogue.kinds", words)
            varied, element = places, None
            try:
                element = self.catalogue.plate(design)
            except ValueError as error:
                yield Problem("catalogue.element", str(error))
            given = given_by(self.catalogue.kinds, element)
            for name, tie in ties.items():
                if both := given.intersection(tie.tied):
                    yield Problem("catalogue", f"its parts give '{min(both)}', which '{name}' ties; drop one of them")
            if not varied - given:
                words = "its parts give everything that varies; let something else vary, e.g. d_2"
                yield Problem("catalogue", words)
            plane = CONJUGATES[1] in varied or "working_distance" in varied
            if "lenses" in self.catalogue.kinds and plane and CONJUGATES[2] in varied:
                words = "with a lens from it, d_f and d_1 cannot both vary; drop one of them"
                yield Problem("catalogue", words)

    def _bounded(self) -> Iterator[tuple[str, Variable]]:
        """Variables by name, those that keep places alike by each of these; without shifts."""
        for name, variable in self.variables.items():
            yield from ((place, variable) for place in (() if variable.together else variable.same or (name,)))

    def _shift_faults(self, design: Design) -> Iterator[Problem]:
        """Shifts that together would take a length to 0, or beyond."""
        far = dict[str, float]()
        numbers = Camera.of(design).numbers
        for variable in self.variables.values():
            for place, factor in variable.together.items():
                sign = math.copysign(1.0, numbers.get(place, 1.0))
                far[place] = far.get(place, 0.0) + min(sign * factor * end for end in (variable.min, variable.max))
        for place, change in far.items():
            size = abs(float(numbers.get(place, math.inf)))
            if size + change < 0 or (size + change == 0 and not place.endswith("distance")):
                words = f"is {size:g} mm in size and would be {size + change:g} mm at the bounds; narrow them"
                yield Problem("variables", f"shifts take '{design.chain.called(place)}' through 0: it {words}")

    def _contradictions(self, design: Design) -> Iterator[Problem]:
        """Limits on the same number of which none lies between."""
        for (key, one), (_, other) in permutations(self._limits(design).items(), 2):
            if one.asked != other.asked or one.min is None or other.max is None:
                continue
            if one.min > other.max + one.quantity.slack(other.max):
                yield Problem(key, f"{one} contradicts {other}: nothing lies between; change one of them")

    def fixed_faults(self, problem: DesignProblem) -> Iterator[Problem]:
        """Limits that are missed by as much at points all over the bounds: nothing that varies changes their values.

        Not where parts or a bore stand for the design's own numbers, nor of single microlenses, which take rays.
        """
        if self.catalogue is not None or self.rims:
            return
        ends = np.vstack([np.eye(problem.n), np.zeros(problem.n)])
        units = np.vstack([ends, 1 - ends, sobol_units(problem.n, FIXED_POINTS, 0)])
        with np.errstate(all="ignore"):  # of points that are no cameras
            cameras = problem.cameras(units)
            for key, limit in self._limits(problem.design).items():
                if limit.field is not None:
                    continue
                values = np.broadcast_to(limit.values(cameras), len(units))[np.broadcast_to(cameras.valid, len(units))]
                # One that is infinite somewhere is not the same all over.
                fixed = values.size > 1 and np.isfinite(values).all() and np.ptp(values) <= FEASIBLE * abs(values[0])
                if not fixed or limit.quantity.within(limit.min, limit.max, values[0]):
                    continue
                symbol = limit.quantity.name
                stands = f"{PATHS[symbol]} of {problem.design.name}" if symbol in PATHS else problem.design.name
                yield Problem(
                    key,
                    f"{limit} is missed before any search: {stands} gives {limit.with_unit(float(values[0]))}, and "
                    f"nothing that varies ({', '.join(map(problem.called, self.variables))}) changes it; let vary what "
                    "does, change the design or the limit",
                )

    def _faults_behind(self, design: Design, lens: Prescription) -> Iterator[Problem]:
        """Faults of a study with a real main lens."""
        places = places_of(self.variables)
        shaped = sorted(place for place in places if varies_lens(place))
        if PATHS["D"] in places:
            words = f"'D' is the real lens's own ({lens.name}); drop it, or take an ideal main lens to choose it"
            yield Problem("variables", words)
        yield from (Problem("variables", words) for words in lens_faults(lens, places))
        if places & {CONJUGATES[1], "working_distance"} and CONJUGATES[2] in places:
            yield Problem(
                "variables", f"the real lens ({lens.name}) has its f, so d_f and d_1 cannot both vary; drop one"
            )
        if shaped and PATHS["wavelength"] in places:
            yield Problem("variables", f"'wavelength' and the lens itself ('{shaped[0]}') cannot both vary; drop one")
        if self.robust is not None:
            words = "is for ideal main lenses; find the optimum without it and see `roslf tolerance` with best.toml"
            yield Problem("robust", words)
        if self.catalogue is not None:
            yield from self.catalogue.faults_behind(lens, shaped)
        for key, part in self._asked(design).items():
            for words in faults_behind(design, part.quantity.name, part.quantity, part.field is not None):
                yield Problem(key, words)
            if shaped and part.temperature is not None:
                words = f"is not asked where the lens itself varies ('{shaped[0]}'); drop one of them"
                yield Problem(f"{key}.temperature", words)

    def posed(self, design: Design) -> DesignProblem:
        """The problem on a base design; a bore takes the place of the design's own stops."""
        asked = self._asked(design)
        return DesignProblem(
            name=self.name,
            question=self.question,
            design=design.replace({"stops": ()}) if self.rims else design,
            variables=self.variables,
            constraints=tuple(self._limits(design).values()),
            goals=self.goals,
            order=self.order,
            slack=self.slack,
            in_focus=self.microlens_in_focus,
            of_views=any(part.quantity.of_views for part in asked.values()),
            given={TIP: max(rim.distance for rim in self.rims)} if self.rims else {},
        )


def _name_faults(
    names: Iterable[str], design: Design, ties: Mapping[str, Variable] = MappingProxyType({})
) -> Iterator[Problem]:
    """Faults of variables' names, and of the places that some tie."""
    own = [place for lens in design.main_lens.kind.mounted for place in places_that_vary(lens)]
    chain = design.chain
    words = name_faults(tuple(map(chain.place_named, names)), Camera.of(design).numbers, own, chain.called, ties)
    return (Problem("variables", fault) for fault in words)


def _number_bounds(name: str, value: Any) -> Variable:
    try:
        return NumberVariable.model_validate(value, context={"from_file": True})
    except ValidationError as error:
        said = problems_of(error, NumberVariable)[0].message
        remedy = "" if "; " in said else "; it has no unit, write e.g. [-2, 2]"
        raise ValueError(f"{name}: {said}{remedy}") from None


@dataclass(frozen=True)
class OptimizeStudy:
    """A study, ready to run."""

    problem: DesignProblem
    settings: Settings
    table: StudyTable
    folder: Path
    """Where files that the study names are looked for."""


def load_study(path: str | os.PathLike[str], seed: int | None = None, accuracy: float | None = None) -> OptimizeStudy:
    """Read a study; `seed` overrides the file's, `accuracy` is `Settings.accuracy`.

    Raises
    ------
    InputError
        Names the file and every fault in it.
    """
    place = Path(path)
    data = read_toml(place, str(path))
    expect_kind(data, "optimize", str(path))
    study = read_study(data, place.parent, str(path), seed)
    return replace(study, settings=study.settings.model_copy(update={"accuracy": accuracy}))


def read_study(
    data: Mapping[str, Any],
    folder: Path = Path(),
    origin: str = "",
    seed: int | None = None,
    design: Design | None = None,
) -> OptimizeStudy:
    """Study from nested values, with `folder` for the files they name; a design takes the place of their own."""
    faults: list[Problem] = []
    data, design = studied(data, folder, design, faults)
    table = None
    try:
        table = StudyTable.model_validate(data, context={"from_file": True, "design": design})
        faults += [] if design is None else table.faults(design)
    except ValidationError as error:
        faults += problems_of(error, StudyTable)
        if design is not None and isinstance(varied := data.get("variables"), Mapping):
            single = (name for name, own in varied.items() if not (isinstance(own, Mapping) and TIES & own.keys()))
            faults += _name_faults(single, design)
    if faults or table is None or design is None:
        raise InputError(tuple(dict.fromkeys(faults)), origin)
    if table.wavelength is not None:
        design = design.replace(wavelength=table.wavelength)
    settings = Settings(seed=table.seed if seed is None else seed, **table.solver.model_dump())
    problem = table.posed(design)
    if faults := list(table.fixed_faults(problem)):
        raise InputError(tuple(faults), origin)
    return OptimizeStudy(problem, settings, table, folder)


@by_value
@dataclass(frozen=True)
class Result(BriefValue):
    """Everything that a study found; printed, its variables and goals alone."""

    study: OptimizeStudy
    answer: Answer
    bore: EquivalentPupil | None
    front: Front | None
    robust: Robust | None
    ranking: Ranking | None
    retrace: Retrace | None
    """Behind a real lens."""
    part_retraces: tuple[Retrace, ...]
    """Retraces of the best combinations of parts, in their order."""
    seconds: float
    robust_stopped: bool = False
    search_stopped: bool = False

    def __str__(self) -> str:
        answer = self.answer
        numbers = {answer.problem.called(name): number(value) for name, value in answer.variables().items()}
        numbers |= {goal.quantity.name: number(answer.number(goal)) for goal in answer.asked.goals}
        values = ", ".join(f"{name} {value}" for name, value in numbers.items())
        none = "stopped before a design held every limit" if answer.conflict is None else "no design holds every limit"
        kind = "best design" if answer.feasible else f"{none}; the least-violating"
        return f"{answer.asked.name}: {kind}: {values}; roslf.report(...) shows all, .to_dict() gives it"

    @cached_property
    def required(self) -> dict[str, tuple[Requirement, ...]]:
        """Requirements of each design, judged as drawn, by the design's file name without its ending."""
        return {name.removesuffix(".toml"): required_of(design) for name, design in self.designs()}

    @cached_property
    def faults(self) -> tuple[Verdict, ...]:
        """Faults of the optimum, whatever its study asked for; what is required stands in `required`."""
        best = next((design for name, design in self.designs() if name == "best.toml"), None)
        verdicts: tuple[Verdict, ...] = ()
        with suppress(InputError):  # the search has limits to tell all the same
            verdicts = () if best is None else evaluate(best).verdicts
        return tuple(one for one in verdicts if one.level == "fault" and not one.name.startswith("required_"))

    def designs(self) -> Iterator[tuple[str, Design]]:
        """File name and design of everything worth keeping; a point that is no design has none."""
        answer = self.answer
        title, source = answer.asked.name, f"roslf optimize, from {answer.problem.design.name}"
        name, kind = ("best.toml", "optimised") if answer.feasible else ("least-violating.toml", "least-violating")
        kind += ", best so far" if answer.ended == "stopped" else ""
        try:
            yield name, answer.problem.design_at(answer.unit, titled(title, kind)).replace({"source": source})
        except InputError:
            if answer.feasible:
                raise
        if self.robust is not None:
            robust = answer.problem.design_at(self.robust.unit, titled(title, "robust"))
            yield "robust.toml", robust.replace({"source": source})
        if self.ranking is not None:
            for place, ranked in enumerate(self.ranking.best, 1):
                problem = ranked.problem
                so_far = ", best so far" if self.ranking.stopped else ""
                design = problem.design_at(ranked.search.unit, f"{title}, parts {place}{so_far}")
                parts = self.ranking.ordered(ranked)
                told = ", ".join(f"lens {part}" if kind == "orientations" else part for kind, part in parts.items())
                yield f"parts-{place:02d}.toml", design.replace({"source": f"catalogue: {told}"})

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the search, and on fields asked for that the sensor of what it found does not see."""
        asked = dict.fromkeys(part.field for part in (*self.answer.asked.goals, *self.answer.asked.constraints))
        found = [design for _, design in self.designs()][:1]
        unseen_fields = (unseen(design, field) for design in found for field in asked if field is not None)
        stopped = (ROBUST_STOPPED,) * self.robust_stopped
        return (*self.answer.notes, *stopped, *filter(None, unseen_fields))

    @property
    def stopped(self) -> bool:
        """Whether it was ended early, with what it had found."""
        return self.search_stopped or self.robust_stopped or (self.ranking is not None and self.ranking.stopped)

    def to_dict(self, *, timings: bool = True) -> dict[str, Any]:
        """One JSON object, what is not finite null; without timings the same bytes every time."""
        answer = self.answer
        accuracy = optimum_accuracy(answer, self.seconds)
        data: dict[str, Any] = {
            "schema": SCHEMA,
            "study": answer.asked.name,
            "base_design": answer.problem.design.name,
            "seed": self.study.settings.seed,
            "status": answer.status,
            "runs_off": answer.runs_off,
            **lengths_and_numbers(answer.variables()),
            "following_mm": answer.followers(),
            "held_mm": answer.held(),
            "goals": [_part(answer, goal) | {"direction": goal.direction} for goal in answer.asked.goals],
            "constraints": [_part(answer, c) | {"min": c.min, "max": c.max} for c in answer.asked.constraints],
            "required": self.required,
            "violation": answer.violation,
            "accuracy": None if accuracy is None else accuracy.to_dict(timings),
            "active": answer.active if answer.feasible else None,
            "trust": _trust(answer),
            "stages": answer.stages,
            "infeasible": None if answer.conflict is None else answer.conflict.to_dict(),
            "bore": self.bore,
            "front": None if self.front is None else self.front.to_dict(),
            "robust": _robust(self),
            "catalogue": None if self.ranking is None else self.ranking.to_dict(self.part_retraces, timings),
            "loose_variables_mm": {name: ends for name, ends in answer.loose().items() if name not in NUMBERS},
            "notes": self.notes,
        }
        if self.retrace is not None:
            data["traced"] = self.retrace.to_dict()
        if timings:
            data["seconds"] = {"solve": answer.seconds, "all": self.seconds}
        finite: dict[str, Any] = plain(data)
        return finite


def run(study: OptimizeStudy, tell: Tell = silent, keep: Callable[[Result], object] = lambda found: None) -> Result:
    """Run a study; `tell` is told what is being done, `keep` is given what was found before [robust] begins.

    Raises
    ------
    InputError
        The bore does not go with the base design; a catalogue file or a perturbation is wrong.
    """
    began = time.monotonic()
    table, settings, problem = study.table, study.settings, study.problem
    scatter = bore = front = robust = ranking = None
    stopped = False
    if table.robust is not None:
        scatter = scatter_of(table.robust, problem.design, settings.seed)
    if table.catalogue is not None:
        files = [study.folder / name for name in table.catalogue.files]
        shipped = load_catalogue(files, shipped=table.catalogue.shipped)
        catalogue = table.catalogue.chosen(shipped, problem.design.main_lens.kind)
        combinations = partial(
            Combinations.of,
            catalogue=catalogue,
            kinds=table.catalogue.kinds,
            element=table.catalogue.plate(problem.design),
            glasses=table.catalogue.only.get("glasses", ()),
        )
        combined = combinations(problem)
        if not table.rims:  # whose stop is known once it is solved
            refuse_all(combined)
    chosen = () if table.catalogue is None else table.catalogue.kinds
    beyond = unreachable(problem, table.rims, chosen, table.required)
    stages = 1 + sum(part is not None for part in (table.pareto, table.robust, table.catalogue))
    told = (_at_stage(tell, number, stages) for number in range(1, stages + 1))
    tell = next(told)
    if beyond:
        posed, answer = problem, refused_by_bore(problem, beyond, settings)
    elif table.rims:
        answer, bore = solve_through(problem, table.rims, settings, tell)
        problem = posed = answer.asked
    else:
        posed, answer = problem, solve_by_rays(problem, settings, tell)
        problem = answer.asked
    going = answer.ended != "stopped"  # who has enough of the search waits for nothing after it
    if going and answer.feasible and table.pareto is not None:
        goals = [next(goal for goal in problem.goals if goal.quantity.name == name) for name in table.pareto.goals]
        budget = settings.fresh()
        front = pareto_front(problem, goals, table.pareto.points, [answer.unit], budget, settings.seed, next(told))
        going = budget.ended != "stopped"
    if going and answer.feasible and table.robust is not None and scatter is not None:
        keep(Result(study, answer, bore, front, None, None, None, (), time.monotonic() - began))
        try:
            robust = maximise_robustness(problem, table.robust, scatter, answer.unit, settings.fresh(), next(told))
        except KeyboardInterrupt:
            stopped = True
    if going and table.catalogue is not None and not (stopped or beyond):
        ranking = rank(
            combinations(posed), table.catalogue.keep, settings.fresh(), settings.seed, next(told), settings.starts
        )
    retrace, part_retraces = None, list[Retrace]()
    if answer.feasible:
        asked: tuple[Goal | Constraint, ...] = (*answer.asked.goals, *answer.asked.constraints)
        retrace = problem.main_lens.retraced(partial(_optimum, answer.problem, asked, answer.unit))
    if ranking is not None:
        again = [
            problem.main_lens.retraced(partial(_combination, ranking, number, tell))
            for number in range(len(ranking.best))
        ]
        part_retraces = [trace for trace in again if trace is not None]
    seconds = time.monotonic() - began
    return Result(
        study, answer, bore, front, robust, ranking, retrace, tuple(part_retraces), seconds, stopped, not going
    )


def _at_stage(tell: Tell, number: int, stages: int) -> Tell:
    """Progress of one of a study's stages: the time that it has left is its own."""
    which = f" (stage {number} of {stages})" if stages > 1 else ""
    return lambda what, done=0.0, total=0.0: tell(f"{what}{which}", done, total)


def _optimum(
    problem: DesignProblem, asked: Sequence[Constraint | Goal], unit: NDArray[np.float64]
) -> tuple[Design, list[Asked]]:
    """An optimum as its design file has it, and what the search had for goals and limits."""
    parts = [part for part in asked if part.temperature is None]
    return problem.design_at(unit), [(p.quantity, p.field, p.at, problem.number(p, unit)) for p in parts]


def _combination(ranking: Ranking, number: int, tell: Tell) -> tuple[Design, list[Asked]]:
    """One of the best combinations of parts, likewise."""
    tell("combinations traced again", number, len(ranking.best))
    ranked = ranking.best[number]
    posed = ranked.problem
    return _optimum(posed, (*posed.goals, *posed.constraints), ranked.search.unit)


def _part(answer: Answer, part: Constraint | Goal) -> dict[str, Any]:
    value = answer.number(part)
    own = {"quantity": part.quantity.name, "unit": part.quantity.unit, "value": value}
    if part.quantity.infinite:
        own["inverse"] = float(ratio(1.0, value))
    asked = {"at_mm": part.at, "field_mm": part.field, "temperature_degc": part.temperature}
    return own | {key: value for key, value in asked.items() if value is not None}


def _trust(answer: Answer) -> dict[str, Any]:
    return {
        "solver": "nlopt LD_SLSQP from Sobol points",
        "evaluations": answer.evaluations,
        "ended_by": answer.ended or None,
        "starts": len(answer.searches),
        "starts_feasible": answer.reached,
        "starts_at_the_answer": len(answer.equals),
        "first_order_residual": answer.residual if answer.feasible else None,
        "gradient_error": answer.gradient_error,
        "merit": answer.merit,
        "checks": [
            {
                "solver": check.solver,
                "evaluations": check.evaluations,
                "merit": check.merit,
                "merit_polished": check.polished.merit if check.polished.feasible else None,
                "agrees": answer.agrees(check),
            }
            for check in answer.checks
        ],
    }


def _robust(result: Result) -> dict[str, Any] | None:
    robust, table = result.robust, result.study.table.robust
    if robust is None or table is None:
        return None

    applied, before = (robust.scatter.tolerances(result.answer.problem, u) for u in (robust.unit, result.answer.unit))

    return {
        "maximised": table.maximise,
        "quantile": table.quantile,
        "perturbations": [
            {
                "place": p.place,
                "tolerance": applied[p.place],
                "tolerance_nominal": before[p.place],
                "distribution": p.distribution,
            }
            for p in robust.scatter.perturbations
        ],
        "nominal": robust.nominal.to_dict(),
        "robust": robust.robust.to_dict(),
        "robust_variables_mm": result.answer.problem.named(robust.unit),
        "price": robust.robust.goal_nominal / robust.nominal.goal_nominal - 1 if robust.nominal.goal_nominal else None,
        "constraints": [{"constraint": name, "nominal": a, "robust": b} for name, a, b in robust.constraint_yields],
        "trials": robust.trials,
        "evaluations": robust.evaluations,
    }
