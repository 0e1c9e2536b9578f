"""Options of a calibration, and of its plan, each written once: for the shell, for Python and for story files."""

from __future__ import annotations

import math
import re
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import BeforeValidator, Field, StrictBool, field_validator, model_validator

from ..design import Design
from ..errors import InputError, refusal
from ..evaluation.required import required_distances
from ..options import Options
from ..seeds import Seed
from ..theory.focused import refuse_focused
from ..theory.length_covariance import CalibratedLengths
from ..tolerancing.places import nominal_values, parse_tolerance, perturbable
from ..toml_files import StrictTable, nearest
from ..units import Angle, AnyLength, Distance, Length
from .cover import BoardCover, covering, misplaced
from .frames import CalibrationError
from .model import Board, DataSheet, relative_sigma, sheet_of
from .planning import CapturePlan, Captures, camera_of, plan, reason, too_large

BEFORE_LENS = re.compile(
    r"(elements\.\d+\.(distance|thickness|index|gradient|focal_length)|object_space\.index"
    r"|(sensor\.cover|microlens_array\.substrate)\.(thickness|index))"
)
"""Places of numbers that a calibration takes as known, and may take as known but to an error."""

LEAST_NOISE, MOST_NOISE = 1e-6, 1e3
"""Between which any corner's standard error lies [microlens pitches]."""


def _digit(value: Any) -> Any:
    """Number that the shell hands on as text."""
    return int(value) if isinstance(value, str) and value.isdecimal() else value


class SheetOptions(Options):
    """Numbers that a calibration takes as known beforehand, and how well."""

    board: str | None = None
    """The checkerboard: cells across, cells down, size of one, as "4x5 6 mm". Of a ChArUco board, which need not be
    seen whole, its markers' size and dictionary too, as "charuco 8x6 6 mm 4.5 mm DICT_4X4_50"."""
    seed: Seed = 0
    """Seed of the posterior, or of a plan's random poses; the same seed gives the same bytes."""
    f_sigma: str = "1 %"
    """Standard deviation of the data sheet's focal length, as "1 mm" or "1%"."""
    d_sigma: str = "0.1 %"
    """Standard deviation of the microlens pitch, as "0.05 um" or "0.01%"."""
    cell_sigma: str = "0.1 %"
    """Standard deviation of the board's cells, all alike, as "10 um" or "0.1%"."""
    sigma: dict[str, str | float] = Field(default_factory=dict)
    """Standard deviations of numbers of what stands before the lens or about the array, by their places."""
    white_pitch: str | None = None
    """Use the pitch of the white image's microlens images, known to this share, as "0.01%". Where the microlens pitch
    is known as well it ties the focal length, better than most data sheets."""

    @field_validator("board")
    @classmethod
    def _readable(cls, text: str | None) -> str | None:
        if text is not None:
            Board.parse(text)
        return text

    @field_validator("f_sigma", "d_sigma", "cell_sigma", "white_pitch")
    @classmethod
    def _understood(cls, text: str | None) -> str | None:
        try:
            relative = 0.0 if text is None else relative_sigma(text, 1.0)
        except ValueError:
            raise ValueError(f'"{text}" is not understood; give "1 %" or "0.5 mm"') from None
        if not 0 <= relative < math.inf:
            raise ValueError(f'"{text}" must not be negative')
        if text is not None and text.strip().endswith("%") and relative > 1:
            raise ValueError(f'"{text}" is more than all of it; give 100 % at most')
        return text

    @field_validator("white_pitch")
    @classmethod
    def _positive_share(cls, text: str | None) -> str | None:
        if text is not None and not (text.strip().endswith("%") and relative_sigma(text, 1.0) > 0):
            raise ValueError(f'"{text}" is no share above zero; give "0.01 %"')
        return text

    @property
    def white_sigma(self) -> float | None:
        """Relative standard deviation of the white image's pitch; None where it is not used."""
        return None if self.white_pitch is None else relative_sigma(self.white_pitch, 1.0)


class PoseOptions(Options):
    """Captures that are planned; what is left out is chosen to suit the design, or is what careful work reaches."""

    boards: Annotated[int, Field(le=200)] = 12
    """How many images of the board (12)."""
    tilt: Angle = math.radians(20)
    """The largest tilt (20 deg)."""
    distance: Length | None = None
    """Mean distance of the boards from the main lens (the design's focal plane)."""
    range: Distance | None = None
    """Farthest minus nearest (a quarter of the way from FAP or lens to the focal plane)."""
    noise: Annotated[float, Field(ge=LEAST_NOISE, le=MOST_NOISE)] = 0.06
    """Standard deviation of a corner's coordinate in one view, in microlens pitches (0.06)."""
    at: tuple[Length, ...] = ()
    """Distance ahead of the tip, as "10mm", at which depth is reported and a bench has its textured wall, too; may be
    given several times."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        Captures(boards=self.boards, tilt=self.tilt, noise=self.noise)
        return self


class PlanOptions(PoseOptions, SheetOptions):
    """A calibration that is planned."""


class CalibrateOptions(SheetOptions):
    """A calibration from captured images."""

    distances: Path | None = None
    """A TOML file of how far the boards stood: sigma = "0.1 mm", relative = true for readings of a rail instead of
    distances from the main lens, and under [distances] lines such as "board1.tif" = "320 mm"."""
    distortion: Annotated[Literal[0, 1, 2], BeforeValidator(_digit)] | None = None
    """Radial coefficients to find: 0, 1 or 2. Default: 1 where the design's main lens has a prescription, else none
    unless residuals ask for them."""
    posterior: bool = True
    """Sample the posterior; else intervals are those of the Fisher matrix (Laplace's approximation)."""
    accuracy: float | None = None
    """Error that the posterior's means may have, in its own standard deviations, as 0.05 (in 95 % of runs): it is
    sampled for as long as that takes. Default: 0.1."""
    diffraction: Literal["auto", "on", "off"] = "auto"
    """Take microlens diffraction off the corners: always, never, or (auto) where the design's is above 0.1 px and the
    white image shows it."""
    use_in: str | None = None
    """The medium that the camera will look into where that is not the boards', as water, saline or an index: reports
    what depths would be off by, and calibrated.toml is the camera in that medium."""

    @property
    def checkerboard(self) -> Board:
        """Board that the images show; refused where none is described."""
        if self.board is None:
            raise refusal("board", 'is missing; describe it, as "4x5 6 mm"')
        return Board.parse(self.board)


class BoardDistances(StrictTable):
    """A file that tells how far from the lens boards stood."""

    sigma: Length
    """Standard deviation of each [mm]."""
    relative: StrictBool = False
    """Measured from any one place, as a rail shows them, instead of from the main lens."""
    distances: Annotated[dict[str, AnyLength], Field(min_length=1)]
    """Distance of each board's middle [mm], by the name of its image; growing away from the camera."""

    @model_validator(mode="after")
    def _before_the_lens(self) -> BoardDistances:
        behind = [name for name, away in self.distances.items() if not self.relative and away <= 0]
        if behind:
            raise ValueError(
                f"{behind[0]} stands {self.distances[behind[0]]:g} mm before the lens; say relative = true?"
            )
        return self


def planned_lengths(design: Design, asked: PlanOptions) -> CalibratedLengths | None:
    """How sure a camera's lengths will be after a calibration as planned; None where it cannot determine them."""
    best = calibration_plan(design, asked)
    return None if isinstance(best, str) else lengths_after(design, best, asked)


def lengths_after(design: Design, best: CapturePlan, asked: PlanOptions) -> CalibratedLengths:
    """How sure a camera's lengths will be after a plan's captures, and the distances that its boards leave out."""
    lengths = best.expected.lengths(design, data_sheet(design, best.captures.board, asked))
    missed = plan_cover(design, best.captures, asked).uncovered
    return lengths._replace(uncovered_mm=tuple(one.at_mm for one in missed))


def calibration_plan(design: Design, asked: PlanOptions, distortion: int | None = None) -> CapturePlan | str:
    """A plan of captures that suits a design and what is asked for; or why these cannot determine the camera.

    Unless told, the calibration will fit as much distortion as it does behind the design's main lens.
    """
    refuse_focused(design, "calibration of views")
    if distortion is None:
        distortion = design.main_lens.kind.radial
    try:
        captures = _captures_for(design, asked)
        sheet = data_sheet(design, captures.board, asked)
    except CalibrationError as error:
        return " ".join(str(error).split())
    try:
        serves = cache(partial(_Service.of, design, captures, asked))
        return plan(
            camera_of(design),
            sheet,
            captures,
            distortion=distortion,
            seed=asked.seed,
            white=asked.white_sigma,
            accepts=lambda other: _accepted(design, asked, captures, serves(), other),
        )
    except CalibrationError as error:
        text, why = " ".join(str(error).split()), reason(captures)
        return f"{text}: {why}" if "do not determine" in text and why not in text else text


def data_sheet(design: Design, board: Board, asked: SheetOptions) -> DataSheet:
    """The data sheet of a design and a board, each known as well as its text says, as "1 %" or "0.5 mm".

    Raises
    ------
    CalibrationError
        A place that is nothing before the main lens or about the array; what is no standard deviation of it.
    """
    scales = zip((asked.f_sigma, asked.d_sigma, asked.cell_sigma), (design.f, design.d, board.cell), strict=True)
    f, d, cell = (relative_sigma(text, scale) for text, scale in scales)
    kinds = {place: kind for place, kind in perturbable(design).items() if BEFORE_LENS.fullmatch(place)}
    nominal, sigmas = nominal_values(design), {}
    for place, sigma in ((design.place_named(name), sigma) for name, sigma in asked.sigma.items()):
        if place not in kinds:
            known = nearest(place, [*map(design.chain.called, kinds)]) if kinds else "this design has none"
            raise CalibrationError(
                f"sigma of {place}: is no number of what stands before the lens or about the array; {known}"
            )
        try:
            sigmas[place] = parse_tolerance(sigma, kinds[place], nominal[place])
        except ValueError as error:
            raise CalibrationError(f"sigma of {place}: {error}") from None
    return sheet_of(design, f, d, cell, sigmas)


def _captures_for(design: Design, asked: PlanOptions) -> Captures:
    """Captures planned for a design: numbers that are asked for, else those that suit it."""
    board = None if asked.board is None else Board.parse(asked.board)
    remade = partial(Captures.for_design, design, boards=asked.boards, tilt=asked.tilt, noise=asked.noise)
    captures = remade(board=board, distance=asked.distance, distance_range=asked.range)
    if asked.distance is not None or asked.range is not None:
        return captures
    return covering(design, captures, _wanted(design, asked), remade, choose=board is None)


def wider_board(design: Design, captures: Captures, asked: PlanOptions) -> str:
    """Board that covers more than the one asked for, as text that `board` takes; empty where none is known."""
    free = asked.model_copy(update={"board": None, "range": None, "distance": None})
    other = asked.model_copy(update={"board": _captures_for(design, free).board.text})
    missed, fewer = (len(plan_cover(design, one, asked).uncovered) for one in (captures, _captures_for(design, other)))
    return other.board if other.board is not None and fewer < missed else ""


class _Service(NamedTuple):
    """Service of boards: what they cover, and how far they are out of place."""

    covered: frozenset[float]
    """Distances asked for that they cover [mm]."""
    misplaced: tuple[float, float]
    """As of `misplaced` [mm]."""
    too_large: bool
    """True where the sensor does not see them whole."""

    @classmethod
    def of(cls, design: Design, captures: Captures, asked: PlanOptions) -> _Service:
        """Service of captures of a design."""
        covered = frozenset(plan_cover(design, captures, asked).covered_mm)
        return cls(covered, misplaced(design, captures), bool(too_large(design, captures)))

    def at_least(self, other: _Service) -> bool:
        """True where these serve wherever others do."""
        no_worse = all(own <= its for its, own in zip(other.misplaced, self.misplaced, strict=True))
        return other.covered <= self.covered and no_worse and self.too_large <= other.too_large


def _accepted(design: Design, asked: PlanOptions, captures: Captures, serves: _Service, other: Captures) -> bool:
    """True where a plan of `other` captures could be asked for, and its boards served wherever those planned do."""
    board = other.board.text if other.board != captures.board else asked.board
    poses = {"boards": other.boards, "tilt": other.tilt, "noise": other.noise, "board": board}
    if other.distance_range != captures.distance_range:
        poses |= {"distance": other.distance, "range": other.distance_range}
    try:
        again = PlanOptions.of(**dict(asked) | poses)
        made = _captures_for(design, again)
    except (CalibrationError, InputError):
        return False
    return _Service.of(design, made, asked).at_least(serves)


def _wanted(design: Design, asked: PlanOptions) -> list[float]:
    """Distances ahead of the tip that a design requires something at, and those asked for [mm]."""
    return sorted({*required_distances(design, math.inf), *asked.at})


def plan_cover(design: Design, captures: Captures, asked: PlanOptions) -> BoardCover:
    """Cover of a plan: which of the distances required and asked for its boards stand at, and why not at the others."""
    return BoardCover.of(design, captures, _wanted(design, asked))
