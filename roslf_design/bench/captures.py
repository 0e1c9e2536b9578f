"""Contents of a bench folder: the design, the targets as printed, and captures, each of a kind by its name."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self, get_args

from pydantic import Field, field_validator, model_validator

from ..calibration.frames import SUFFIXES
from ..calibration.model import Board, Markers
from ..design import Design
from ..errors import InputError, Problem
from ..seeds import Seed
from ..theory.limits import as_design
from ..toml_files import StrictTable, read_toml, validated
from ..units import Angle, AnyLength, Length

DESIGN, SETUP, CALIBRATION, ACCEPTANCE = "design.toml", "bench.toml", "calibration", "acceptance"
"""Files and folders of a bench folder."""
Kind = Literal["white", "dark", "board", "edge", "wall", "spheres", "field"]
"""Kinds of capture: the first three calibrate, the others are measured for acceptance."""
KINDS: tuple[Kind, ...] = get_args(Kind)
_EVEN = re.compile(r"(white|dark)(_.+)?", re.IGNORECASE)
_ACCEPTED = re.compile(r"(edge|wall|spheres|field)_(\d+(?:\.\d+)?)mm(?:_(\d+))?", re.IGNORECASE)
_LOSSY = (".jpg", ".jpeg", ".gif", ".bmp", ".webp")
"""Pictures that hold no raw counts."""
_MOST_SCALED = 1.25
Distances = Annotated[tuple[Length, ...], Field(min_length=1)]
"""Distances ahead of the tip [mm] at which a target is to stand."""


class Printed(StrictTable):
    """A target on paper, with its scale bar: what the bar states, and what a ruler read on the print."""

    bar: Length
    printed_bar: Length

    @model_validator(mode="after")
    def _alike(self) -> Self:
        if not 1 / _MOST_SCALED <= self.scale <= _MOST_SCALED:
            raise ValueError(
                f"printed_bar: {self.printed_bar:g} mm is far from the drawing's {self.bar:g} mm; measure again, or"
                " print at 100 %"
            )
        return self

    @property
    def scale(self) -> float:
        """Sizes of the print over those of the drawing."""
        return self.printed_bar / self.bar


class BoardTarget(Printed):
    """The board, as `roslf calibrate --board` takes it."""

    cells: str

    @field_validator("cells")
    @classmethod
    def _readable(cls, text: str) -> str:
        Board.parse(text)
        return text

    @property
    def drawn(self) -> Board:
        """Board as it was drawn."""
        return Board.parse(self.cells)

    @property
    def board(self) -> Board:
        """Board as it was printed."""
        drawn, scale = self.drawn, self.scale
        marks = drawn.markers and Markers(drawn.markers.width * scale, drawn.markers.dictionary)
        return Board(drawn.columns, drawn.rows, drawn.cell * scale, marks)


class _Square(Printed):
    """A square target."""

    side: Length
    """Side, as drawn."""
    at: Distances

    @property
    def printed_side(self) -> float:
        """Side as printed [mm]."""
        return self.side * self.scale


class EdgeTarget(_Square):
    """A slanted edge for e-SFR: a dark square turned in a bright one."""

    angle: Angle
    """Angle between the edges and the array's rows and columns [rad]."""

    @property
    def across(self) -> float:
        """Width that it takes on the page, as drawn [mm]."""
        return self.side * (math.cos(self.angle) + math.sin(self.angle))


class WallTarget(_Square):
    """A flat wall with texture: noise of several octaves."""

    finest: Length
    """Side of the smallest dots, as drawn."""
    octaves: int = Field(ge=1, le=12)

    @property
    def count(self) -> int:
        """Smallest dots along its side."""
        return max(1 << (self.octaves - 1), math.ceil(self.side / self.finest))


class SpheresTarget(StrictTable):
    """A pair of textured spheres, machined after a drawing and then measured."""

    diameter: Length
    spacing: Length
    """Distance between their centres."""
    finest: Length
    """Side of the smallest dots on them."""
    at: Distances

    @model_validator(mode="after")
    def _apart(self) -> Self:
        if self.spacing < self.diameter:
            raise ValueError(f"spheres of {self.diameter:g} mm cannot stand {self.spacing:g} mm apart; measure again")
        return self


class FieldTarget(Printed):
    """Concentric rings for the field of view."""

    radii: Annotated[tuple[Length, ...], Field(min_length=2)]
    """Radii of the rings, as drawn."""
    at: Distances

    @property
    def printed_radii(self) -> tuple[float, ...]:
        """Radii as printed [mm]."""
        return tuple(radius * self.scale for radius in self.radii)


class BoardPose(StrictTable):
    """Where the board stands for one image."""

    file: str
    ahead: AnyLength
    """Distance of its middle ahead of the tip."""
    right: AnyLength
    up: AnyLength
    tilt: Angle
    towards: Angle
    """Side of the board that comes nearer: 0 its right, 90 degrees its top."""
    turn: Angle
    """Turn in its own plane, clockwise."""

    @property
    def rotation(self) -> tuple[float, float, float]:
        """Rotation vector in the calibration's frame (x right, y down, z away from the camera) [rad]."""
        return self.tilt * math.sin(self.towards), self.tilt * math.cos(self.towards), self.turn

    def to_dict(self) -> dict[str, float]:
        """As JSON's types: lengths in mm, angles in degrees."""
        lengths = {f"{name}_mm": float(getattr(self, name)) for name in ("ahead", "right", "up")}
        return lengths | {f"{name}_deg": math.degrees(getattr(self, name)) for name in ("tilt", "towards", "turn")}


class Setup(StrictTable):
    """`bench.toml`: what was chosen, and what was measured of it."""

    seed: Seed = 0
    board: BoardTarget
    edge: EdgeTarget
    wall: WallTarget
    spheres: SpheresTarget
    field: FieldTarget
    poses: tuple[BoardPose, ...]

    def dumps(self) -> str:
        """Text of the file."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(mode="json", context={"digits": 6}))


class BenchCapture(NamedTuple):
    """One captured image."""

    path: Path
    kind: Kind
    ahead: float | None = None
    """Distance ahead of the tip that its name tells [mm]; None of calibration's images."""

    @classmethod
    def named(cls, path: Path) -> BenchCapture | None:
        """Capture by the name of its file and folder; None for a file that is none."""
        if path.suffix.lower() in _LOSSY:
            raise InputError((Problem("", f"{path.name}: raw counts come as {', '.join(SUFFIXES)}; save it anew"),))
        if path.suffix.lower() not in SUFFIXES or path.name.startswith(".") or path.stem.endswith("-preview"):
            return None
        if path.parent.name == CALIBRATION:
            even = _EVEN.fullmatch(path.stem)
            return cls(path, "board" if even is None else _kind(even[1]))
        accepted = _ACCEPTED.fullmatch(path.stem)
        if accepted is None:
            raise InputError((Problem("", f"{path.name} is of no kind; name it as edge_40mm.tif or wall_40mm_2.tif"),))
        return cls(path, _kind(accepted[1]), float(accepted[2]))


def _kind(name: str) -> Kind:
    return KINDS[[kind.lower() for kind in KINDS].index(name.lower())]


@dataclass(frozen=True, eq=False)
class Bench:
    """A bench folder as read."""

    folder: Path
    design: Design
    setup: Setup

    @property
    def calibration(self) -> Path:
        """Folder of the images that `roslf calibrate` takes."""
        return self.folder / CALIBRATION

    @cached_property
    def captures(self) -> tuple[BenchCapture, ...]:
        """Captures there are, in the order of kinds and then of names."""
        paths = [path for name in (CALIBRATION, ACCEPTANCE) for path in sorted((self.folder / name).glob("*.*"))]
        named = [one for path in paths if (one := BenchCapture.named(path)) is not None]
        return tuple(sorted(named, key=lambda one: (KINDS.index(one.kind), one.path.name)))

    def of_kind(self, kind: Kind) -> tuple[BenchCapture, ...]:
        """Captures of one kind."""
        return tuple(one for one in self.captures if one.kind == kind)


def read_bench(folder: Path) -> Bench:
    """A bench folder that `roslf bench DESIGN` wrote.

    Raises
    ------
    InputError
        No such folder, or files in it that cannot be read.
    """
    if not (folder / SETUP).is_file():
        why = f"has no {SETUP}: name the folder that roslf bench DESIGN -o FOLDER wrote"
        raise InputError((Problem("", why if folder.exists() else "no such folder"),), str(folder))
    file = folder / SETUP
    return Bench(folder, as_design(folder / DESIGN), validated(Setup, read_toml(file, str(file)), str(file)))
