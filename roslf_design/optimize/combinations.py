"""Combinations of catalogue parts: which there are, their numbers as arrays, each as a problem of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from .parts import ArrayPart, Catalogue, Entry, Kind, LensPart, SensorPart, given_by
from .problem import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Combinations:
    """Every combination of some kinds of parts, numbered with the last kind running fastest."""

    problem: Problem
    kinds: tuple[Kind, ...]
    parts: tuple[tuple[Entry, ...], ...]
    """Of each kind."""

    @classmethod
    def of(cls, problem: Problem, catalogue: Catalogue, kinds: Sequence[Kind]) -> Combinations:
        """Combinations of a catalogue; kinds left out keep the base design's part.

        What the parts give does not vary any more; an array's microlenses have the focal length that they have.
        """
        given = given_by(kinds)
        left = tuple(variable for variable in problem.variables if variable.place not in given)
        in_focus = problem.in_focus and "microlens_arrays" not in kinds
        posed = replace(problem, variables=left, in_focus=in_focus, order="weighted")
        return cls(posed.with_scales(), tuple(kinds), tuple(catalogue.of(kind) for kind in kinds))

    def __len__(self) -> int:
        return int(np.prod([len(parts) for parts in self.parts]))

    def indices(self, number: int) -> tuple[int, ...]:
        """Which part of each kind."""
        return tuple(int(i) for i in np.unravel_index(number, [len(parts) for parts in self.parts]))

    def chosen(self, number: int) -> tuple[Entry, ...]:
        """The parts of a combination."""
        return tuple(parts[i] for parts, i in zip(self.parts, self.indices(number), strict=True))

    @cached_property
    def _columns(self) -> list[dict[str, Array]]:
        found = []
        for parts in self.parts:
            numbers = [_numbers(part) for part in parts]
            found.append({place: np.array([row[place] for row in numbers]) for place in numbers[0]})
        return found

    def values(self, numbers: NDArray[np.intp]) -> dict[str, Array]:
        """Place to the parts' numbers, for many combinations at once."""
        if not self.parts:
            return {}
        which = np.unravel_index(numbers, [len(parts) for parts in self.parts])
        return {
            place: column[index]
            for index, columns in zip(which, self._columns, strict=True)
            for place, column in columns.items()
        }

    def problem_at(self, number: int) -> Problem:
        """The problem with a combination's parts in its base design."""
        return replace(self.problem, design=with_parts(self.problem.design, self.chosen(number)))

    def title(self, number: int) -> str:
        """The parts' names."""
        return ", ".join(part.part for part in self.chosen(number))


def with_parts(design: Design, parts: Sequence[Entry]) -> Design:
    """A design with parts of the catalogue in it; d_1 stays, and d_f follows a new lens."""
    changes: dict[str, Any] = {}
    for part in parts:
        changes |= _numbers(part)
        if isinstance(part, ArrayPart):
            changes |= {"microlens_array.layout": part.layout, "microlens_array.lens_shape": part.lens_shape}
    focal = changes.get("main_lens.focal_length")
    if focal is not None and focal >= design.d_1:
        # Behind this lens no image forms at the old d_1; the variables will say where it does.
        changes["microlens_array.distance"] = 1.5 * focal
        while changes["microlens_array.distance"] > focal and _plane(focal, changes["microlens_array.distance"]) <= max(
            stop.distance for stop in design.all_stops
        ):
            changes["microlens_array.distance"] = (changes["microlens_array.distance"] + focal) / 2
    elif focal is not None and _plane(focal, design.d_1) <= max(stop.distance for stop in design.all_stops):
        distance = design.d_1
        while _plane(focal, distance) <= max(stop.distance for stop in design.all_stops):
            distance = (distance + focal) / 2
        changes["microlens_array.distance"] = distance
    return design.replace(changes)


def _plane(focal: float, distance: float) -> float:
    return focal * distance / (distance - focal)


def _numbers(part: Entry) -> Mapping[str, float]:
    if isinstance(part, LensPart):
        return {"main_lens.diameter": part.aperture, "main_lens.focal_length": part.focal_length}
    if isinstance(part, ArrayPart):
        return {
            "microlens_array.pitch": part.pitch,
            "microlens_array.focal_length": part.focal,
            "microlens_array.size.0": part.size[0],
            "microlens_array.size.1": part.size[1],
        }
    assert isinstance(part, SensorPart)
    return {"sensor.pixel": part.pixel, "sensor.size.0": part.size[0], "sensor.size.1": part.size[1]}
