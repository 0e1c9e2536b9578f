"""Combinations of a catalogue's parts: which a study asks for, and the problem that remains with each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, StrictBool

from .._arrays import Array
from ..bore.conjugates import CONJUGATES
from ..bore.main_lens import HIATUS, MainLensKind, main_lens_kind
from ..catalogue.conditions import parse_condition, read_condition
from ..catalogue.entries import EDGE, KINDS, LENS_PRESCRIPTION, NAMED, Catalogue, Entry, Kind, Option, declared_by, rows
from ..design import PATHS, Design
from ..errors import InputError, Problem
from ..lenses.glass import Glass
from ..lenses.prescription import Prescription
from ..toml_files import StrictTable, nearest
from ..traced.camera import camera_of
from ..words import number as in_digits
from .choices import LENS_REVERSED, ORIENTATIONS, Choice, given_by, glass_choices, placed
from .lens_variables import why_not_bent
from .problem import DesignProblem, sobol_units
from .search import BIG

FOCAL, PLANE, DISTANCE = CONJUGATES
FULL_WELL = "sensor.full_well"

TRIED = 64
"""Places from which a first camera behind another lens is looked for."""


def _condition(text: str) -> str:
    parse_condition(text)
    return text


Conditions = tuple[Annotated[str, AfterValidator(_condition)], ...]


class CatalogueTable(StrictTable):
    """Parts to choose among."""

    kinds: Annotated[tuple[Choice, ...], Field(min_length=1)] = ("lenses", "microlens_arrays", "sensors")
    """Kinds of parts to choose; of a real main lens also its orientation, and the glasses of a custom one."""
    where: dict[Kind, Conditions] = Field(default_factory=dict)
    """Kind to conditions for its parts, as `roslf catalogue --where` takes them: lenses = ["focal_length<=20 mm"]."""
    only: dict[Choice, tuple[str, ...]] = Field(default_factory=dict)
    """Kind to names of those parts, or glasses, alone: lenses = ["AC050-008-A", "AC080-016-A"]."""
    files: tuple[str, ...] = ()
    """Further catalogue files, beside the study."""
    shipped: StrictBool = True
    """Whether the shipped catalogue takes part."""
    element: int | str | None = None
    """For which of [[elements]], by name or from 0, a window is chosen; may be left out where there is one plate."""
    keep: Annotated[int, Field(ge=1, le=100)] = 10

    def faults_behind(self, lens: Prescription, shaped: Sequence[str]) -> Iterator[Problem]:
        """Faults of a choice that does not go together with a real main lens, given its variables."""
        if "windows" in self.kinds:
            words = f"with a real main lens ({lens.name}) windows are not chosen; leave the kind out"
            yield Problem("catalogue.kinds", words)
        if "lenses" in self.kinds and "glasses" in self.kinds:
            yield Problem("catalogue.kinds", "a bought lens has its glasses; leave lenses or glasses out")
        if "lenses" in self.kinds and shaped:
            words = f"a bought lens stays as it is, and '{shaped[0]}' varies; drop it, or leave the kind lenses out"
            yield Problem("catalogue.kinds", words)
        wrong = why_not_bent(lens) if "glasses" in self.kinds else None
        if wrong is not None:
            words = f"glasses are chosen for spherical singlets and cemented doublets ({lens.name}: {wrong})"
            yield Problem("catalogue.kinds", f"{words}; leave the kind out")

    def chosen(self, catalogue: Catalogue, lens: MainLensKind) -> Catalogue:
        """The parts of a catalogue that a study asks for, and that fit a main lens.

        Raises
        ------
        InputError
            A name that no part has, conditions that none meets, no lens to trace.
        """
        left: dict[str, tuple[Entry, ...]] = {}
        faults: list[Problem] = []
        for kind in (kind for kind in KINDS if kind in self.kinds):
            parts, names = catalogue.of(kind), self.only.get(kind)
            tell = f"holds no {kind}; add some, or leave the kind out"
            known = [part.part for part in parts]
            for name in names or ():
                if name not in known:
                    words = f"'{name}' is no part of the catalogue; {nearest(name, known, 'see `roslf catalogue`')}"
                    faults.append(Problem(f"catalogue.only.{kind}", words))
            conditions = [read_condition(text) for text in self.where.get(kind, ())]
            rows_of_kind = zip(parts, rows(catalogue, [kind]), strict=True)
            parts = tuple(part for part, row in rows_of_kind if all(holds(row) for holds in conditions))
            if known and not parts:
                asked = " and ".join(self.where[kind])
                tell = (
                    f"none of {len(known)} {kind.replace('_', ' ')} meets {asked}; see `roslf catalogue --kind {kind}`"
                )
            if names is not None:
                parts = tuple(part for part in parts if part.part in names)
            if parts and not any(part.fits(lens) for part in parts):
                tell = f"of the {kind} asked for none has a prescription that could be traced; see `roslf catalogue`"
            parts = tuple(part for part in parts if part.fits(lens))
            if not parts and not faults:
                faults.append(Problem("catalogue", tell))
            left[kind] = parts
        if faults:
            raise InputError(tuple(faults))
        return catalogue.model_copy(update=left)

    def plate(self, design: Design) -> int | None:
        """The element that windows are chosen for; None where none are.

        Raises
        ------
        ValueError
            The design has no such plate, or several and the study does not say which.
        """
        if "windows" not in self.kinds:
            return None
        plates = [k for k, at in enumerate(design.in_bore) if "windows" in at.part.catalogue]
        if self.element is None and len(plates) == 1:
            return plates[0]
        if (at := design.place_named(f"elements.{self.element}")) in (f"elements.{k}" for k in plates):
            return int(at.removeprefix("elements."))
        if not plates:
            raise ValueError("windows are for plates, and the design has none; add one to its [[elements]]")
        names = (f'"{name}"' if (name := design.elements[k].name) else str(k) for k in plates)
        raise ValueError(f"say for which plate a window is wanted: element = {' or '.join(names)}")


@dataclass(frozen=True)
class Combinations:
    """Every combination of some kinds of parts, numbered with the last kind running fastest."""

    problem: DesignProblem
    kinds: tuple[Choice, ...]
    parts: tuple[tuple[Option, ...], ...]
    """Parts of each kind."""
    element: int | None = None
    """Index of the design's element that a window is for."""

    @classmethod
    def of(
        cls,
        problem: DesignProblem,
        catalogue: Catalogue,
        kinds: Sequence[Choice],
        element: int | None = None,
        glasses: Sequence[str] = (),
    ) -> Combinations:
        """Combinations of a catalogue; kinds left out keep the base design's part.

        What the parts give does not vary any more; an array's microlenses have the focal length that they have.

        Raises
        ------
        InputError
            A glass that is not known; none that the lens can be made of.
        """
        design, unknown = problem.design, dict[str, float]()  # any, for parts to replace
        if element is not None:
            window = design.elements[element]
            keys = (key for key in ("diameter", EDGE) if getattr(window, key, 0.0) is None)
            unknown |= {f"elements.{element}.{key}": 1.0 for key in keys}
        if "lenses" in kinds and design.main_lens.outer_diameter is None:
            unknown[f"main_lens.{EDGE}"] = 1.0
        problem = replace(problem, design=design.replace(unknown)) if unknown else problem
        given = given_by(kinds, element)
        left = {name: v for name, v in problem.variables.items() if PATHS.get(name, name) not in given}
        in_focus = problem.in_focus and "microlens_arrays" not in kinds
        posed = replace(problem, variables=left, in_focus=in_focus, order="weighted")
        parts: list[tuple[Option, ...]] = []
        for kind in kinds:
            if kind == "orientations":
                parts.append(ORIENTATIONS)
            elif kind == "glasses":
                (lens,) = problem.design.main_lens.kind.prescribed
                parts.append(glass_choices(lens, glasses, problem.design.wavelength))
                if not parts[-1]:
                    words = f"{lens.name} cannot be made of these glasses in its focal length; name others"
                    raise InputError((Problem("catalogue.only.glasses", words),))
            else:
                parts.append(catalogue.of(kind))
        return cls(posed.with_scales(), tuple(kinds), tuple(parts), element)

    @property
    def _shape(self) -> tuple[int, ...]:
        return tuple(len(parts) for parts in self.parts)

    def __len__(self) -> int:
        return int(np.prod(self._shape))

    def chosen(self, number: int) -> tuple[Option, ...]:
        """The parts of a combination."""
        return tuple(parts[i] for parts, i in zip(self.parts, np.unravel_index(number, self._shape), strict=True))

    @cached_property
    def _columns(self) -> list[dict[str, Array]]:
        return [
            {place: np.array([self._numbers(part)[place] for part in parts]) for place in self._numbers(parts[0])}
            for parts in self.parts
        ]

    def _numbers(self, part: Option) -> dict[str, Any]:
        """Numbers that a part sets, by place; of a material also the index that the problem's light has in it."""
        wavelength, environment = float(self.problem.base.wavelength), self.problem.design.environment
        warmth = () if environment is None else (environment.temperature, environment.expansion)
        own = part.behind(self.problem.design.main_lens.kind, wavelength, *warmth)
        numbers = {placed(place, self.element): value for place, value in own.items()}
        if FOCAL in numbers:
            numbers |= self._focused
        if lens := numbers.get(LENS_PRESCRIPTION):
            numbers[HIATUS] = main_lens_kind(lens.warmed(*warmth) if warmth else lens, False).hiatus(wavelength)
        glasses = {place: value for place, value in numbers.items() if isinstance(value, Glass)}
        return numbers | {
            f"{place.rpartition('.')[0]}.index": float(glass.index(wavelength, *warmth[:1]))
            for place, glass in glasses.items()
        }

    @cached_property
    def _focused(self) -> dict[str, float]:
        """Focal plane that stays before every lens, by place; empty where it varies, or where the file states d_1."""
        varies = bool(self.problem.n) and not self.problem.values(np.full(self.problem.n, 0.5)).keys().isdisjoint(
            CONJUGATES[1:]
        )
        stated = self.problem.design.microlens_array.distance is None
        return {PLANE: float(self.problem.design.d_f)} if stated and not varies else {}

    def cut(self, numbers: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the array is cut to size, for many combinations at once."""
        which = np.unravel_index(numbers, self._shape) if self.parts else ()
        cut = np.zeros(len(numbers), bool)
        for index, parts in zip(which, self.parts, strict=True):
            cut |= np.array([part.is_cut for part in parts])[index]
        return cut

    def deciding(
        self, missed: NDArray[np.bool_], values: Array, nearest: Callable[[Iterable[float]], float]
    ) -> dict[str, float]:
        """Parts that no combination holds a limit with, to their nearest value; of the kind that matters most."""
        which = np.unravel_index(np.arange(len(self)), self._shape)
        told: list[tuple[float, dict[str, float]]] = []
        for index, parts in zip(which, self.parts, strict=True):
            groups = [index == k for k in range(len(parts))]
            spread = sum(float(np.ptp(np.clip(values[group], -BIG, BIG))) for group in groups)
            wrong = [(part.part, group) for part, group in zip(parts, groups, strict=True) if missed[group].all()]
            told.append((spread, {name: nearest(values[group].tolist()) for name, group in wrong}))
        return min(told, key=itemgetter(0))[1]

    def cut_words(self, number: int, unit: Array) -> str:
        """Size to which a combination's array is cut at scaled variables, in words; "" where it stays as it is."""
        problem = self.problem_at(number)
        stock = problem.base.array_size
        sides = [float(side) for side in problem.cameras(unit).array_size]
        if all(side >= most for side, most in zip(sides, stock, strict=True)):
            return ""
        return f"cut to {_by(sides)} from {_by(stock)} stock"

    def values(self, numbers: NDArray[np.intp]) -> dict[str, Array]:
        """Place to the parts' numbers, for many combinations at once."""
        which = np.unravel_index(numbers, self._shape) if self.parts else ()
        return {
            place: column[index]
            for index, columns in zip(which, self._columns, strict=True)
            for place, column in columns.items()
            if column.dtype == np.float64
        }

    @cached_property
    def _forgotten(self) -> dict[str, Any]:
        """Places where the base design has what its sensor declares, to what holds of one that declares none."""
        sensor, fields = self.problem.design.sensor, type(self.problem.design.sensor).model_fields
        declared = declared_by("sensors", sensor.part) if "sensors" in self.kinds else {}
        keys = {place: place.rpartition(".")[2] for place in declared}
        known = {place: getattr(sensor, key) for place, key in keys.items() if place != FULL_WELL}
        return {place: fields[keys[place]].default for place, own in known.items() if own == declared[place]}

    def problem_at(self, number: int) -> DesignProblem:
        """The problem with a combination's parts; before a new lens the focal plane stays, or d_1, as the file states.

        Here alone it counts what only some sensors' entries say (colour filters, acceptance).

        Raises
        ------
        InputError
            Behind a real lens: within the variables' bounds there is no camera.
        """
        parts = self.chosen(number)
        numbers = {place: value for part in parts for place, value in self._numbers(part).items()}
        design, given = self.problem.design, {**self.problem.given, **numbers}
        declared = self._forgotten | {place: value for part in parts for place, value in part.declared.items()}
        if (pixel := numbers.get(PATHS["q"])) is not None:
            declared.setdefault(FULL_WELL, design.sensor.well_of(pixel))
        if declared:
            design = design.replace(declared)
        cut = any(part.is_cut for part in parts)
        own = {place: given.pop(place) for place in (LENS_PRESCRIPTION, LENS_REVERSED) if place in given}
        if own:
            own |= {place: given.pop(place) for place in (PATHS["D"],) if place in numbers}
            given = {place: value for place, value in given.items() if place not in (FOCAL, HIATUS)}
            design = self._behind(own, {place: given[place] for place in (PLANE,) if place in given}, design)
        chosen = {kind: part.part for kind, part in zip(self.kinds, parts, strict=True)}
        places = {kind: place if place != "elements" else f"elements.{self.element}" for place, kind in NAMED.items()}
        design = design.unchecked({f"{places[kind]}.part": name for kind, name in chosen.items() if kind in places})
        return replace(self.problem, design=design, given=given, cut=cut)

    def _behind(self, own: Mapping[str, Any], plane: Mapping[str, float], base: Design) -> Design:
        """Some camera that can be built behind another real lens, by what it is made of; the search moves the rest."""
        problem = self.problem
        units = sobol_units(problem.n, TRIED, 0)
        numbers = problem.values(units) if problem.n else {}
        numbers = {place: value for place, value in numbers.items() if place not in (FOCAL, HIATUS)}
        fault = InputError((Problem("catalogue", "no camera"),))
        for k in range(-1, len(units)):
            moved = dict(plane) | ({place: float(value[k]) for place, value in numbers.items()} if k >= 0 else {})
            if not moved.keys() & CONJUGATES[1:]:
                moved[DISTANCE] = float(base.d_1)
            try:
                design = base.replace({**own, **moved})
                camera_of(design)
            except InputError as error:
                fault = error
            else:
                return design
        raise fault


def _by(sides: Sequence[Any]) -> str:
    """Width and height in words."""
    return f"{' x '.join(in_digits(float(side), 3) for side in sides)} mm"
