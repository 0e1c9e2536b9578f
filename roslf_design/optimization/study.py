"""Study files: the tables that they may hold, and what these pose, with every fault at once."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, field_validator, model_validator

from ..camera import Camera, Number
from ..design import PATHS, Design
from ..design.conjugates import CONJUGATES
from ..design.files import expect_kind, load_beside
from ..design.parts import Stop
from ..errors import InputError, Problem
from ..theory.quantities import Quantity, quantity_named
from ..tolerancing.draws import Distribution
from ..tolerancing.study import StrictTable
from ..toml_files import problems_of, read_toml
from ..units import Distance, Length, format_quantity, parse_quantity
from .parts import Kind, given_by
from .problem import Constraint, DesignProblem, Goal, Variable, check_name, check_together
from .solve import Settings, SolverTable


class AskedTable(StrictTable):
    """A quantity, at the focal plane or ahead of the bore's tip."""

    quantity: str
    at: Length | None = None
    """Ahead of the bore's tip."""

    @field_validator("quantity")
    @classmethod
    def _known(cls, name: str) -> str:
        if quantity_named(name).of is None:
            raise ValueError(
                f"'{name}' differs from field to field, and a design is held to numbers of the whole camera"
            )
        return name

    @property
    def of(self) -> Quantity:
        """The quantity that is named."""
        return quantity_named(self.quantity)

    def _check_distance(self) -> None:
        if self.of.at == "needed" and self.at is None:
            raise ValueError(f'{self.quantity} needs a distance ahead of the tip; write e.g. at = "40 mm"')
        if self.of.at == "never" and self.at is not None:
            raise ValueError(f"{self.quantity} is not asked for at a distance; drop at")


class ConstraintTable(AskedTable):
    """A quantity held between limits."""

    min: Any = None
    max: Any = None
    """Text with a unit for lengths, else a number."""

    @model_validator(mode="after")
    def _bounded(self) -> ConstraintTable:
        self._check_distance()
        if self.min is None and self.max is None:
            raise ValueError(f"{self.quantity} has no limit; give min, max or both")
        low, high = self._limit("min", self.min), self._limit("max", self.max)
        if low is not None and high is not None and low > high:
            shown = [format_quantity(end, "length") if self.of.length else f"{end:g}" for end in (low, high)]
            raise ValueError(f"{self.quantity}: min {shown[0]} is above max {shown[1]}; swap them")
        return self

    def _limit(self, key: str, value: Any) -> float | None:
        if value is None:
            return None
        if self.of.length:
            return parse_quantity(value, "length")
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            unit = f" (in {self.of.unit})" if self.of.unit else ""
            raise ValueError(f"{key} of {self.quantity} must be a number{unit}, got {value!r}")
        return float(value)

    def posed(self) -> Constraint:
        """With limits in the quantity's unit."""
        return Constraint(self.of, self._limit("min", self.min), self._limit("max", self.max), self.at)


class GoalTable(AskedTable):
    """A quantity to make small or large."""

    direction: str | None = None
    weight: Annotated[float, Field(gt=0)] = 1.0

    @model_validator(mode="after")
    def _directed(self) -> GoalTable:
        self._check_distance()
        if self.direction is None:
            raise ValueError(f'goal {self.quantity} has no direction; write direction = "min" or direction = "max"')
        if self.direction not in ("min", "max"):
            raise ValueError(f'direction "{self.direction}" of goal {self.quantity} is not known; write "min" or "max"')
        return self

    def posed(self) -> Goal:
        """As the problem has it."""
        return Goal(self.of, "min" if self.direction == "min" else "max", self.at, self.weight)


class VariableTable(StrictTable):
    """Bounds of a variable: ``["0.5 mm", "8 mm"]`` for short."""

    min: Distance
    max: Length
    start: Distance | None = None
    """Where one of the searches starts."""

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: Any) -> Any:
        if isinstance(value, (list, tuple)) and len(value) == 2:
            return {"min": value[0], "max": value[1]}
        if not isinstance(value, Mapping):
            raise ValueError(f'{value!r} is no pair of bounds; write e.g. ["0.5 mm", "8 mm"]')
        return value

    @model_validator(mode="after")
    def _ordered(self) -> VariableTable:
        if self.min > self.max:
            shown = format_quantity(self.min, "length"), format_quantity(self.max, "length")
            raise ValueError(f"contradictory bounds: min {shown[0]} is above max {shown[1]}; swap them")
        return self


class TubeTable(StrictTable):
    """A straight tube."""

    diameter: Length
    length: Length
    distance: Distance


class StopTable(StrictTable):
    """One rim."""

    diameter: Length
    distance: Distance


class BoreTable(StrictTable):
    """The bore, instead of a flexible angular plane: a tube, or several stops."""

    tube: TubeTable | None = None
    stops: tuple[StopTable, ...] = ()

    @model_validator(mode="after")
    def _one(self) -> BoreTable:
        if (self.tube is None) == (not self.stops):
            raise ValueError("a bore is a tube or a list of stops; give [bore.tube] or [[bore.stops]], not both")
        return self

    @property
    def rims(self) -> tuple[Stop, ...]:
        """Every rim; of a tube the nearer end first."""
        if self.tube is None:
            return tuple(Stop(diameter=stop.diameter, distance=stop.distance) for stop in self.stops)
        ends = self.tube.distance, self.tube.distance + self.tube.length
        return tuple(Stop(diameter=self.tube.diameter, distance=end) for end in ends)


class ParetoTable(StrictTable):
    """Two or three goals to trade."""

    goals: Annotated[tuple[str, ...], Field(min_length=2, max_length=3)]
    """Names of quantities among [[goals]]."""
    points: Annotated[int, Field(ge=3, le=100)] = 13
    """Along each limited goal."""


class CatalogueTable(StrictTable):
    """Parts to choose among."""

    kinds: Annotated[tuple[Kind, ...], Field(min_length=1)] = ("lenses", "microlens_arrays", "sensors")
    files: tuple[str, ...] = ()
    """Further catalogue files, beside the study."""
    shipped: bool = True
    """Whether the shipped catalogue takes part."""
    keep: Annotated[int, Field(ge=1, le=100)] = 10


class PerturbTable(StrictTable):
    """What a build misses."""

    place: tuple[str, ...]
    tolerance: str | float
    distribution: Distribution = "normal"
    truncate: Annotated[float, Field(gt=0)] = 2.0

    @field_validator("place", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value


class RobustTable(StrictTable):
    """What to make of builds that scatter."""

    maximise: Literal["yield", "quantile"] = "yield"
    """"yield": the share of builds that hold every constraint; "quantile": the first goal, as `quantile` of the builds
    reach it, with at least `wanted_yield`."""
    quantile: Annotated[float, Field(gt=0, lt=1)] = 0.9
    wanted_yield: Annotated[float, Field(gt=0, le=1)] = 0.9
    give_up: Annotated[float, Field(gt=0)] | None = None
    """Share of the first goal that robustness may cost at most; None: any."""
    trials: Annotated[int, Field(ge=16, le=100_000)] = 512
    perturb: Annotated[tuple[PerturbTable, ...], Field(min_length=1)]


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
    microlens_in_focus: bool = False
    """Whether f_ml follows the focus."""
    variables: dict[str, VariableTable]
    constraints: tuple[ConstraintTable, ...] = ()
    goals: tuple[GoalTable, ...]
    bore: BoreTable | None = None
    solver: SolverTable = SolverTable()
    pareto: ParetoTable | None = None
    catalogue: CatalogueTable | None = None
    robust: RobustTable | None = None

    @field_validator("variables", mode="before")
    @classmethod
    def _some(cls, value: Any) -> Any:
        if not isinstance(value, Mapping) or not value:
            raise ValueError('nothing may vary; add a table [variables] with e.g. d_3 = ["0.5 mm", "8 mm"]')
        return value

    @field_validator("goals", mode="before")
    @classmethod
    def _wanted(cls, value: Any) -> Any:
        if not value:
            raise ValueError('nothing is wanted; add [[goals]] with e.g. quantity = "sigma_z_mm", direction = "min"')
        return value

    def faults(self, numbers: Mapping[str, Number]) -> list[Problem]:
        """What does not go together, in a study of a design with these numbers."""
        faults = []
        for name, table in self.variables.items():
            try:
                check_name(name, numbers)
                if table.min == 0 and not name.endswith(("d_3", "distance")):
                    faults.append(Problem(f"variables.{name}", "min must be greater than zero"))
            except ValueError as error:
                faults.append(Problem("variables", str(error)))
        try:
            check_together(tuple(self.variables))
        except ValueError as error:
            faults.append(Problem("variables", str(error)))
        if self.bore is not None:
            own = [n for n in self.variables if n in ("D_F", "d_3") or n.startswith(("aperture.", "stops.", "tube_"))]
            words = "'{}' varies, but the bore gives it; drop one of them"
            faults += [Problem("variables", words.format(name)) for name in own]
        goals = [goal.quantity for goal in self.goals]
        for name in self.pareto.goals if self.pareto is not None else ():
            if name not in goals:
                near = difflib.get_close_matches(name, goals, 1, 0.4)
                hint = f"did you mean '{near[0]}'?" if near else f"goals are {', '.join(goals)}"
                faults.append(Problem("pareto.goals", f"'{name}' is not among [[goals]]; {hint}"))
        if self.catalogue is not None:
            varied = {PATHS.get(name, name) for name in self.variables}
            if not varied - given_by(self.catalogue.kinds):
                words = "its parts give everything that varies; let something else vary, e.g. d_2"
                faults.append(Problem("catalogue", words))
            plane = CONJUGATES[1] in varied or "working_distance" in varied
            if "lenses" in self.catalogue.kinds and plane and CONJUGATES[2] in varied:
                words = "with a lens from it, d_f and d_1 cannot both vary; drop one of them"
                faults.append(Problem("catalogue", words))
        return faults

    def posed(self, design: Design) -> DesignProblem:
        """The problem on a base design."""
        rims = self.rims
        if rims:
            design = design.replace({"stops": ()})  # the bore takes the place of the design's own
        return DesignProblem(
            name=self.name,
            question=self.question,
            design=design,
            variables=tuple(Variable(name, v.min, v.max, v.start) for name, v in self.variables.items()),
            constraints=tuple(constraint.posed() for constraint in self.constraints),
            goals=tuple(goal.posed() for goal in self.goals),
            order=self.order,
            slack=self.slack,
            in_focus=self.microlens_in_focus,
            tip=max((rim.distance for rim in rims), default=0.0),
        )

    @property
    def rims(self) -> tuple[Stop, ...]:
        """Of the bore; empty where the design's aperture stands."""
        return () if self.bore is None else self.bore.rims


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
    """The same from nested values, with `folder` for the files they name; a design takes the place of their own."""
    faults: list[Problem] = []
    if design is not None:
        data = {**data, "design": design.name}
    design = _base(data, folder, faults, design)
    table = None
    try:
        table = StudyTable.model_validate(data, context={"from_file": True})
        faults += [] if design is None else table.faults(Camera.of(design).numbers)
    except ValidationError as error:
        faults += problems_of(error, StudyTable)
    if faults or table is None or design is None:
        raise InputError(tuple(dict.fromkeys(faults)), origin)
    if table.wavelength is not None:
        design = design.replace(wavelength=table.wavelength)
    settings = Settings(seed=table.seed if seed is None else seed, **table.solver.model_dump())
    return OptimizeStudy(table.posed(design), settings, table, folder)


def _base(data: Mapping[str, Any], folder: Path, faults: list[Problem], design: Design | None) -> Design | None:
    name = data.get("design")
    if not isinstance(name, str):
        return None  # the study's own check says so
    try:
        design = load_beside(name, folder) if design is None else design
    except InputError as error:
        faults += [Problem("design", f"{name}: {fault}") for fault in error.problems]
        return None
    if design.lens is not None:
        message = (
            f"{name}: has a real main lens ({design.lens.name}), and the search varies ideal ones; give main_lens "
            f'focal_length = "{design.f:.6g} mm" and diameter = "{design.D:.6g} mm" in place of its prescription, then '
            "see `roslf evaluate` with the lens for what it really does"
        )
        faults.append(Problem("design", message))
        return None
    return design
