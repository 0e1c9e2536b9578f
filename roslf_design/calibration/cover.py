"""Distances that a plan's boards cover: those required and those asked for, as far as one board serves for them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..camera import Camera
from ..design import Design
from ..theory.depth_of_field import depth_of_field
from ..words import number
from .corners import LEAST_CELL
from .model import Board
from .planning import Captures, field_at, fitting_board, pupil_of, told_apart_to


@dataclass(frozen=True)
class Uncovered:
    """A distance that no board stands at."""

    at_mm: float
    """Ahead of the tip."""
    reason: str

    def __str__(self) -> str:
        return f"not {number(self.at_mm, 4)} mm, as {self.reason}"


@dataclass(frozen=True)
class BoardCover:
    """Distances that boards cover, of those required and asked for [mm ahead of the tip].

    The focal plane is one of those that are not covered where the board's cells are too small there, asked for or not.
    """

    nearest_mm: float
    """Middle of the nearest board."""
    farthest_mm: float
    covered_mm: tuple[float, ...]
    uncovered: tuple[Uncovered, ...]

    @classmethod
    def of(cls, design: Design, captures: Captures, wanted: Sequence[float]) -> BoardCover:
        """Cover of planned captures, of so many distances ahead of the tip."""
        tip, limits = float(Camera.of(design).tip), _Limits.of(design, captures.board, captures.tilt)
        near, far = (end - tip for end in captures.ends)
        stands = f"boards stand from {number(near, 3)} to {number(far, 3)} mm; plan"
        reasons = {z: limits.reason(z + tip, tip) for z in wanted}
        beyond = (z for z in wanted if not reasons[z] and not near * (1 - 1e-6) <= z <= far * (1 + 1e-6))
        reasons |= {z: f"{stands} {_reaching(captures.boards, tip, near, far, z)}" for z in beyond}
        focus = design.d_f - tip
        if limits.far < design.d_f < math.inf:
            reasons.setdefault(focus, limits.reason(design.d_f, tip))
        missed = tuple(Uncovered(z, reason) for z, reason in reasons.items() if reason)
        return cls(near, far, tuple(z for z in wanted if not reasons[z]), tuple(sorted(missed, key=lambda m: m.at_mm)))


def _reaching(boards: int, tip: float, *places: float) -> str:
    """Options of a plan whose boards stand from the nearest to the farthest of places ahead of the tip [mm]."""
    near, far = (end + tip for end in (min(places), max(places)))
    middle = round((near + far) / 2, 1)
    reach = 2 * max(far - middle, middle - near) / (1 - 1 / max(boards, 2))  # as `Captures.ends`
    return f'`--distance "{middle:g} mm" --range "{math.ceil(10 * reach) / 10:g} mm"`'


def misplaced(design: Design, captures: Captures) -> tuple[float, float]:
    """How much too near the nearest board stands for it to serve, and how much too far the farthest one [mm]."""
    limits, (near, far) = _Limits.of(design, captures.board, captures.tilt), captures.ends
    return max(limits.near - near, 0.0), max(far - limits.far, 0.0)


class _Limits(NamedTuple):
    """Distances from the main lens between which a board serves [mm], and why not nearer or farther."""

    near: float
    far: float
    why_near: str
    why_far: str

    @classmethod
    def of(cls, design: Design, board: Board, tilt: float) -> _Limits:
        """Limits of a board tilted by up to `tilt` [rad]."""
        tip, pupil = float(Camera.of(design).tip), pupil_of(design)
        sides = sorted((board.columns * board.cell, board.rows * board.cell))
        extents = sorted(field_at(design, pupil + 1.0))  # per millimetre ahead of the FAP
        first, last = (float(end) for end in depth_of_field(Camera.of(design), "view"))
        whole = max(side / extent for side, extent in zip(sides, extents, strict=True))
        near = (
            (pupil + whole, "the sensor sees the board whole"),
            (tip + math.hypot(*sides) / 2 * math.sin(tilt), "the board, tilted, stands clear of the tip"),
            (tip + first, "views are sharp"),
        )  # fmt: skip
        far = (
            (told_apart_to(design, board), f"the board's cells span {LEAST_CELL:g} microlenses"),
            (tip + last, "views are sharp"),
        )  # fmt: skip
        (nearest, why_near), (farthest, why_far) = max(near), min(far)
        return cls(nearest, farthest, why_near, why_far)

    def reason(self, at: float, tip: float) -> str:
        """Reason why a board does not serve at a distance from the main lens; empty where it does."""
        if at < self.near:
            return f"{self.why_near} only from {number(self.near - tip, 3)} mm on"
        return f"{self.why_far} only up to {number(self.far - tip, 3)} mm" if at > self.far else ""


def covering(
    design: Design, captures: Captures, wanted: Sequence[float], remade: Callable[..., Captures], choose: bool
) -> Captures:
    """Captures about the same focal plane whose boards also stand at wanted distances, as many as one board serves for.

    Parameters
    ----------
    captures : Captures
        As planned where nothing is wanted.
    wanted : sequence of float
        Distances ahead of the tip [mm].
    remade : callable
        Captures of a ``board`` at another ``distance`` and ``distance_range`` [mm].
    choose : bool
        Whether another board may be chosen.
    """
    tip, count, (first, last) = float(Camera.of(design).tip), captures.boards, captures.ends
    places = [z + tip for z in wanted]
    if count < 2 or all(first <= z <= last for z in places):
        return captures
    half = 0.5 / (count - 1)  # of the way from the nearest board to the farthest one: boards stand evenly
    boards, nearer = [captures.board], [z - half * (last - z) if z < last else z for z in (*places, design.d_f)]
    if choose:
        boards += [fitting_board(design, z, design.d_f) for z in nearer if z > pupil_of(design)]
    best, most = captures, sum(first <= z <= last for z in places)
    for board in dict.fromkeys(boards):
        limits = _Limits.of(design, board, captures.tilt)
        far = max([min(last, limits.far), *(z for z in places if z <= limits.far)])
        least = (limits.near + half * far) / (1 + half)
        near = min([max(first, least), *(z for z in places if z >= least)])
        served = sum(near <= z <= far for z in places)
        if served > most and near <= design.d_f <= far:
            spread = (far - near) * (1 + 2 * half)
            best, most = remade(board=board, distance=(near + far) / 2, distance_range=spread), served
    return best
