"""The tables of a study file: what each may hold, and what is wrong with it in the words of the file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from ..design import PATHS
from ..design.check import CONJUGATES
from ..design.units import Distance, Length, format_quantity, parse_quantity
from ..tolerance.draws import Distribution
from .parts import given_by
from .quantities import Quantity, quantity_named
from .variables import check_name, check_together

DIRECTIONS = ("min", "max")


class Table(BaseModel):
    """Base of every table: frozen, unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _limit(quantity: Quantity, key: str, value: Any) -> float:
    if quantity.length:
        return parse_quantity(value, "length")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        unit = f" (in {quantity.unit})" if quantity.unit else ""
        raise ValueError(f"{key} of {quantity.name} must be a number{unit}, got {value!r}")
    return float(value)


def _ahead(quantity: Quantity, at: float | None) -> None:
    if quantity.at == "needed" and at is None:
        raise ValueError(f'{quantity.name} needs a distance ahead of the tip; write e.g. at = "40 mm"')
    if quantity.at == "never" and at is not None:
        raise ValueError(f"{quantity.name} is not asked for at a distance; drop at")


def _shown(quantity: Quantity, value: float) -> str:
    return format_quantity(value, "length") if quantity.length else f"{value:g}"


class ConstraintTable(Table):
    """A quantity held between limits."""

    quantity: str
    min: Any = None
    max: Any = None
    """Text with a unit for lengths, else a number."""
    at: Length | None = None
    """Ahead of the bore's tip."""

    @field_validator("quantity")
    @classmethod
    def _known(cls, name: str) -> str:
        return quantity_named(name).name

    @model_validator(mode="after")
    def _bounded(self) -> ConstraintTable:
        quantity = quantity_named(self.quantity)
        _ahead(quantity, self.at)
        if self.min is None and self.max is None:
            raise ValueError(f"{self.quantity} has no limit; give min, max or both")
        low, high = self.limits()
        if low is not None and high is not None and low > high:
            shown = _shown(quantity, low), _shown(quantity, high)
            raise ValueError(f"{self.quantity}: min {shown[0]} is above max {shown[1]}; swap them")
        return self

    def limits(self) -> tuple[float | None, float | None]:
        """In the quantity's unit."""
        quantity = quantity_named(self.quantity)
        low = None if self.min is None else _limit(quantity, "min", self.min)
        return low, None if self.max is None else _limit(quantity, "max", self.max)


class GoalTable(Table):
    """A quantity to make small or large."""

    quantity: str
    direction: str | None = None
    at: Length | None = None
    weight: Annotated[float, Field(gt=0)] = 1.0

    @field_validator("quantity")
    @classmethod
    def _known(cls, name: str) -> str:
        return quantity_named(name).name

    @model_validator(mode="after")
    def _directed(self) -> GoalTable:
        _ahead(quantity_named(self.quantity), self.at)
        if self.direction is None:
            raise ValueError(f'goal {self.quantity} has no direction; write direction = "min" or direction = "max"')
        if self.direction not in DIRECTIONS:
            raise ValueError(f'direction "{self.direction}" of goal {self.quantity} is not known; write "min" or "max"')
        return self


class VariableTable(Table):
    """Bounds of a variable: ``["0.5 mm", "8 mm"]`` for short."""

    min: Distance
    max: Length
    start: Distance | None = None
    """Where one of the searches starts."""

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: Any) -> Any:
        if isinstance(value, (list, tuple)):
            if len(value) != 2:
                raise ValueError(f'{value!r} is no pair of bounds; write e.g. ["0.5 mm", "8 mm"]')
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


class TubeTable(Table):
    """A straight tube."""

    diameter: Length
    length: Length
    distance: Distance


class StopTable(Table):
    """One rim."""

    diameter: Length
    distance: Distance


class BoreTable(Table):
    """The bore, instead of a flexible angular plane: a tube, or several stops."""

    tube: TubeTable | None = None
    stops: tuple[StopTable, ...] = ()

    @model_validator(mode="after")
    def _one(self) -> BoreTable:
        if (self.tube is None) == (not self.stops):
            raise ValueError("a bore is a tube or a list of stops; give [bore.tube] or [[bore.stops]], not both")
        return self


class SolverTable(Table):
    """How hard to look."""

    starts: Annotated[int, Field(ge=1, le=4096)] = 16
    evaluations: Annotated[int, Field(ge=10)] = 300
    seconds: Annotated[float, Field(gt=0)] = 60.0
    check: bool = True
    """Whether CRS2_LM looks again."""
    isres: bool = False


class ParetoTable(Table):
    """Two or three goals to trade."""

    goals: Annotated[tuple[str, ...], Field(min_length=2, max_length=3)]
    """Names of quantities among [[goals]]."""
    points: Annotated[int, Field(ge=3, le=100)] = 13
    """Along each limited goal."""


class CatalogueTable(Table):
    """Parts to choose among."""

    kinds: Annotated[tuple[Literal["lenses", "microlens_arrays", "sensors"], ...], Field(min_length=1)] = (
        "lenses",
        "microlens_arrays",
        "sensors",
    )
    files: tuple[str, ...] = ()
    """Further catalogue files, beside the study."""
    shipped: bool = True
    """Whether the shipped catalogue takes part."""
    keep: Annotated[int, Field(ge=1, le=100)] = 10


class PerturbTable(Table):
    """What a build misses."""

    place: tuple[str, ...]
    tolerance: str | float
    distribution: Distribution = "normal"
    truncate: Annotated[float, Field(gt=0)] = 2.0

    @field_validator("place", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value


class RobustTable(Table):
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


class StudyTable(Table):
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
    def _some(cls, value: Any, info: ValidationInfo) -> Any:
        if not isinstance(value, Mapping) or not value:
            raise ValueError('nothing may vary; add a table [variables] with e.g. d_3 = ["0.5 mm", "8 mm"]')
        return value

    @field_validator("goals", mode="before")
    @classmethod
    def _wanted(cls, value: Any) -> Any:
        if not value:
            raise ValueError('nothing is wanted; add [[goals]] with e.g. quantity = "sigma_z_mm", direction = "min"')
        return value

    @model_validator(mode="after")
    def _together(self, info: ValidationInfo) -> StudyTable:
        places = (info.context or {}).get("places")
        faults = []
        if places is not None:
            for name, table in self.variables.items():
                try:
                    check_name(name, places)
                except ValueError as error:
                    faults.append(f"variables: {error}")
                    continue
                if table.min == 0 and not name.endswith(("d_3", "distance")):
                    faults.append(f"variables.{name}: min must be greater than zero")
        try:
            check_together(tuple(self.variables))
        except ValueError as error:
            faults.append(f"variables: {error}")
        if self.bore is not None:
            own = [n for n in self.variables if n in ("D_F", "d_3") or n.startswith(("aperture.", "stops.", "tube_"))]
            faults += [f"variables: '{name}' varies, but the bore gives it; drop one of them" for name in own]
        if self.pareto is not None:
            faults += _goals_of(self.pareto.goals, [goal.quantity for goal in self.goals])
        if self.catalogue is not None:
            faults += self._left_over(self.catalogue)
        if faults:
            raise ValueError("\n".join(faults))
        return self

    def _left_over(self, catalogue: CatalogueTable) -> list[str]:
        places = {PATHS.get(name, name) for name in self.variables}
        faults = []
        if not places - given_by(catalogue.kinds):
            faults.append("catalogue: its parts give everything that varies; let something else vary, e.g. d_2")
        plane = CONJUGATES[1] in places or "working_distance" in places
        if "lenses" in catalogue.kinds and plane and CONJUGATES[2] in places:
            faults.append("catalogue: with a lens from it, d_f and d_1 cannot both vary; drop one of them")
        return faults


def _goals_of(names: tuple[str, ...], goals: list[str]) -> list[str]:
    faults = []
    for name in names:
        if name not in goals:
            near = difflib.get_close_matches(name, goals, 1, 0.4)
            hint = f"did you mean '{near[0]}'?" if near else f"goals are {', '.join(goals)}"
            faults.append(f"pareto.goals: '{name}' is not among [[goals]]; {hint}")
    return faults
