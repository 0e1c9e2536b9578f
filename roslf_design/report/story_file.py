"""Story files: a design carried through optimisation, tolerances and a calibration plan, in one TOML file.

::

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
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from ..calibration import Board, CalibrationError
from ..design import Design, load, preset_names
from ..design.files import read_toml
from ..design.messages import problems_of
from ..design.units import Angle, Length
from ..errors import InputError, Problem
from .calibrated import Calibrated, read_calibration

TAKES = re.compile(r"best|robust|parts-\d\d")


class Table(BaseModel):
    """Base of every table of a story: frozen, unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Opening(Table):
    """`[story]`."""

    title: str
    question: str = ""
    design: str
    """Design file, relative to the story, or the name of a preset."""


class CalibrationPart(Table):
    """What one means to capture."""

    board: str | None = None
    """Cells across, cells down, size of one."""
    boards: Annotated[int, Field(ge=2)] = 12
    """Images of the board."""
    tilt: Annotated[Angle, Field(gt=0, lt=1.5)] = 0.3490658503988659
    """Largest tilt [rad]."""
    distance: Length | None = None
    """Mean distance of the boards from the main lens [mm]."""
    range: Length | None = None
    """Farthest minus nearest [mm]."""
    noise: Annotated[float, Field(gt=0)] = 0.06
    """Of a corner in one view [microlens pitches]."""
    f_sigma: str = "1 %"
    """How well f is known."""
    seed: Annotated[int, Field(ge=0)] = 0

    @field_validator("board")
    @classmethod
    def _readable(cls, text: str | None) -> str | None:
        if text is not None:
            try:
                Board.parse(text)
            except CalibrationError as error:
                raise ValueError(str(error)) from None
        return text


class Part(Table):
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
    def _one(self) -> Part:
        given = [
            key for key in ("optimize", "tolerance", "calibration", "calibrated") if getattr(self, key) is not None
        ]
        if len(given) != 1:
            found = " and ".join(given) or "nothing"
            raise ValueError(f"has {found}; give each part one of optimize, tolerance, calibration or calibrated")
        if "take" in self.model_fields_set and self.optimize is None:
            raise ValueError("take goes with optimize only; leave it out")
        return self

    @property
    def file(self) -> str | None:
        """The study's file."""
        return self.optimize or self.tolerance


class StoryTable(Table):
    """A whole file."""

    story: Opening
    parts: Annotated[tuple[Part, ...], Field(min_length=1)]


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

    def folder_of(self, index: int) -> Path:
        """Where files named by a part's study are looked for."""
        file = self.table.parts[index].file
        return (self.folder / file).parent if file else self.folder

    def origin_of(self, index: int) -> str:
        """What errors of a part are told of."""
        file = self.table.parts[index].file
        return str(self.folder / file) if file else f"{self.origin}: parts.{index}"


def load_story(path: str | os.PathLike[str]) -> Story:
    """Read a story with its design and its studies.

    Raises
    ------
    InputError
        Names the file and every fault in it; also a study or a design that is not there.
    """
    place = Path(path)
    return read_story(read_toml(place, str(path)), place.parent, str(path))


def read_story(data: Mapping[str, Any], folder: Path = Path(), origin: str = "") -> Story:
    """The same from nested values, with `folder` for the files they name."""
    faults: list[Problem] = []
    try:
        table = StoryTable.model_validate(data, context={"from_file": True})
    except ValidationError as error:
        raise InputError(tuple(problems_of(error, data, StoryTable, from_file=True)), origin) from None
    design = None
    try:
        name = table.story.design
        design = load(name if name in preset_names() and not (folder / name).exists() else folder / name)
    except InputError as error:
        faults += [Problem("story.design", str(fault)) for fault in error.problems]
    studies: list[Mapping[str, Any]] = []
    for index, part in enumerate(table.parts):
        try:
            studies.append({} if part.file is None else read_toml(folder / part.file, part.file))
        except InputError as error:
            key = f"parts.{index}.{'optimize' if part.optimize else 'tolerance'}"
            faults += [Problem(key, f"{part.file}: {fault}") for fault in error.problems]
    calibrations: dict[int, Calibrated] = {}
    for index, part in enumerate(table.parts):
        if part.calibrated is not None:
            try:
                calibrations[index] = read_calibration(folder / part.calibrated)
            except InputError as error:
                faults += [Problem(f"parts.{index}.calibrated", fault.message) for fault in error.problems]
    if faults or design is None:
        raise InputError(tuple(faults), origin)
    return Story(table, design, tuple(studies), folder, origin, calibrations)
