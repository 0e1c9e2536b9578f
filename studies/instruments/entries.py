"""Instruments that others built: their designs, what was published of them, and what the program predicts.

Two files each, found by themselves: `NAME.toml` is a design, `NAME.numbers.toml` a table of published numbers.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import BeforeValidator, Field

from roslf_design.design import Design, load
from roslf_design.errors import InputError, Problem
from roslf_design.toml_files import PlainNumber, StrictTable, nearest, read_toml, validated
from studies.instruments.expressions import CALLED, PLAIN, Expression

HERE = Path(__file__).parent
SUFFIX = ".numbers.toml"
PICTURES = Path("reports/depth-published/published.json")
"""What was measured on real pictures, as studies/depth/published.py wrote it."""
WITHOUT = "those pictures do not lie beside the project"
NEAR, FAR = 0.5, 2.0
"""Predicted over published that counts as agreement to a factor of two."""
CLOSE = 0.02
"""Share by which a prediction may be off before its row has to say why."""

Subject = Literal["lengths", "images", "field", "refocusing", "depth"]
SUBJECTS: tuple[Subject, ...] = get_args(Subject)

Ends = Annotated[
    tuple[PlainNumber, ...],
    BeforeValidator(lambda value: value if isinstance(value, list) else [value]),
    Field(min_length=1, max_length=2),
]
"""A number, or the ends of a range."""


class NumberTable(StrictTable):
    """A published number, or one measured on real pictures, and what is computed of the design."""

    figure: str = Field(description="what it is", examples=["baseline over six pixels"])
    subject: Subject
    unit: str = Field(examples=["mm"])
    published: Ends | None = Field(None, description="the number, or the ends of its range", examples=[3.7956])
    measured: str = Field("", description="name of what was measured on real pictures, in place of `published`")
    source: str = Field(description="where it was read", examples=["abstract"])
    predict: str = Field("", description="expression of the camera's quantities; empty where nothing compares")
    set: dict[str, PlainNumber | str] = Field(
        default_factory=dict, description="lengths that are others for this number [mm], or the names of numbers"
    )
    why: str = Field("", description="why they differ, or why nothing is predicted, in a sentence")


class NumbersTable(StrictTable):
    """What was published of one instrument."""

    instrument: str = Field(examples=["Hahne 2016, f193"])
    design: str = Field("", description="a preset in place of NAME.toml")
    given: dict[str, PlainNumber] = Field(default_factory=dict, description="further numbers of the source, by name")
    number: tuple[NumberTable, ...] = Field(min_length=1)


@dataclass(frozen=True)
class Pictures:
    """Measurements on real pictures."""

    measured: Mapping[str, tuple[float, ...]]
    """What rows call `measured`."""
    named: Mapping[str, float]
    """Numbers that expressions name."""

    @classmethod
    def written(cls, path: Path = PICTURES) -> Pictures | None:
        """Those that the study of depth wrote; None where there are none."""
        real = json.loads(path.read_text())["real"] if path.exists() else None
        return None if real is None else cls({k: tuple(v) for k, v in real["measured"].items()}, real["named"])


VESICLE = ("vesicle width", "vesicle blur", "vesicle veil")
"""Of a white frame, as `roslf decode --white` tells it: width of images over their pitch, blur [px], veil [%]."""
MEASURED = ("lytro error", "lytro error, right", "board", *VESICLE)
"""Names of `Pictures.measured`."""
NAMED = ("scene_disparity", "left_half_mismatch", "board_error_per_mismatch")
"""Names of `Pictures.named`."""


class Row(NamedTuple):
    """Number of an instrument, and what is predicted of it."""

    instrument: str
    figure: str
    subject: Subject
    unit: str
    published: tuple[float, ...]
    """One, or the ends of a range; empty where it is of real pictures that are not there."""
    predicted: float | None
    expression: str
    """What it is predicted by, with the lengths that are others for it."""
    measured: str
    """Name of what was measured on real pictures; empty for what others published."""
    source: str
    why: str

    @property
    def ratio(self) -> float | None:
        """Predicted over the published range's geometric middle, signs left out."""
        if self.predicted is None or not self.published:
            return None
        middle = math.exp(sum(math.log(abs(value)) for value in self.published) / len(self.published))
        return abs(self.predicted) / middle

    @property
    def agrees(self) -> bool | None:
        """True where the ratio is within a factor of two."""
        return None if self.ratio is None else NEAR <= self.ratio <= FAR

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Row:
        """Row of the JSON that `to_dict` makes."""
        return cls(**{name: data[name] for name in cls._fields} | {"published": tuple(data["published"])})

    def to_dict(self) -> dict[str, Any]:
        """As JSON."""
        return self._asdict() | {"ratio": self.ratio}


@dataclass(frozen=True)
class Instrument:
    """One instrument: its table, and its design where one is known."""

    path: Path
    """Of its table."""
    table: NumbersTable

    @classmethod
    def read(cls, path: Path) -> Instrument:
        """An instrument by the path of its table.

        Raises
        ------
        InputError
            Every fault of the table, each with its place, value and remedy.
        """
        table = validated(NumbersTable, read_toml(path, str(path)), str(path))
        found = cls(path, table)
        if problems := tuple(found._problems()):
            raise InputError(problems, str(path))
        return found

    @classmethod
    def all(cls, folder: Path = HERE) -> list[Instrument]:
        """Every instrument of a folder, by their names."""
        return sorted(map(cls.read, folder.glob(f"*{SUFFIX}")), key=lambda one: one.table.instrument.lower())

    @property
    def name(self) -> str:
        """Name of its files."""
        return self.path.name.removesuffix(SUFFIX)

    @cached_property
    def design(self) -> Design | None:
        """Its design; None where its lengths are not known."""
        beside = self.path.with_name(f"{self.name}.toml")
        if self.table.design:
            return load(self.table.design)
        return load(beside) if beside.exists() else None

    def rows(self, pictures: Pictures | None) -> Iterator[Row]:
        """Every number, with its prediction."""
        for k, one in enumerate(self.table.number):
            published, predicted, why = one.published or (), None, one.why
            if one.measured and pictures is None:
                why = WITHOUT
            else:
                if one.measured and pictures is not None:
                    published = pictures.measured[one.measured]
                if one.predict:
                    given = self.table.given | ({} if pictures is None else dict(pictures.named))
                    try:
                        predicted = Expression(one.predict).value(self._with(one, given), given)
                    except LookupError as error:
                        fault = f"{error} is no number of that name; `roslf evaluate --json` shows all"
                        raise InputError((Problem(f"number.{k}.predict", fault),), str(self.path)) from None
            changed = ", ".join(f"{place} = {value}" for place, value in one.set.items())
            expression = f"{one.predict}, with {changed}" if changed else one.predict
            yield Row(
                self.table.instrument, one.figure, one.subject, one.unit, published, predicted, expression,
                one.measured, one.source, why,
            )  # fmt: skip

    def _with(self, one: NumberTable, given: Mapping[str, float]) -> Design | None:
        """The design, with what is another for one number."""
        if self.design is None or not one.set:
            return self.design
        values = {key: given[value] if isinstance(value, str) else value for key, value in one.set.items()}
        symbols = {key: value for key, value in values.items() if key in PLAIN}
        places = {key: value for key, value in values.items() if key not in PLAIN}
        return self.design.replace(places, **symbols)

    def _problems(self) -> Iterator[Problem]:
        """Faults that no single key shows."""
        for name in self.table.given:
            if name in PLAIN | CALLED:
                yield Problem(f"given.{name}", "is a quantity of every camera; give it another name")
        for k, one in enumerate(self.table.number):
            at = f"number.{k}"
            names = {*self.table.given, *(NAMED if one.measured else ())}
            if (one.published is None) == (not one.measured):
                yield Problem(at, "must have either `published`, the number, or `measured`; write one of them")
            if one.published is not None and 0 in one.published:
                yield Problem(f"{at}.published", "0 has no ratio; leave the number out")
            if not one.predict and not one.why:
                yield Problem(f"{at}.why", "is missing; say why nothing is predicted, or add predict")
            if one.measured and one.measured not in MEASURED:
                yield Problem(f"{at}.measured", f'"{one.measured}" is not known; {nearest(one.measured, MEASURED)}')
            yield from self._predicted(one, f"{at}.predict", names)
            for key, value in one.set.items():
                if isinstance(value, str) and value not in names:
                    yield Problem(f"{at}.set.{key}", f'"{value}" is no name that is given; write a number [mm]')

    def _predicted(self, one: NumberTable, at: str, names: Collection[str]) -> Iterator[Problem]:
        """Faults of an expression."""
        expression = Expression(one.predict)
        faults = list(expression.faults(names)) if one.predict else []
        yield from (Problem(at, fault) for fault in faults)
        if one.predict and not faults and self.design is None and expression.asks_camera:
            yield Problem(at, f"needs a design; add {self.name}.toml beside this file, or design = a preset")
