"""The main lens in a search: its variables, the room that it needs, and numbers that rays through it tell."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from .._arrays import Array
from ..bore.main_lens import HIATUS, IdealMainLens, RealMainLens, SheetMainLens
from ..camera import Camera, Number
from ..design import Design
from .lens_variables import BENDING, FOCAL, LensVariation, VariedLens, varies_lens
from .search import FTOL
from .traces import Asked, Field, FieldTraces, Retrace, clearances, retraced

TRACED_FTOL = 1e-9
"""Change of a merit of traced rays that is theirs, and not of their rounding."""

CUSTOM = ", custom"
"""Suffix to the name of a lens that an optimum has otherwise than drawn."""

Room = Callable[[Camera, Any], Number]
"""Clearance that is not below 0, of cameras and the `VariedLens` that they stand behind."""

Optimum = Callable[[], tuple[Design, Sequence[Asked]]]
"""An optimum, and what the search had for goals and limits."""


@dataclass(frozen=True)
class IdealLensSearch:
    """An ideal main lens: numbers like any others, and closed forms."""

    design: Design

    def own(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Values of those places that vary the lens's surfaces."""
        return {}

    def as_lengths(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        """Values of places with the lens's focal length for those of its surfaces."""
        return values

    def varied(self, values: Mapping[str, Any]) -> VariedLens | None:
        """The lens of every build; None where it has no surfaces."""
        return None

    def redrawn(self, values: Mapping[str, Array]) -> dict[str, Any]:
        """Changes of the design that make its lens the one at a value of each place."""
        return {}

    def rooms(self, values: Mapping[str, Array], standing: Iterable[str]) -> Iterator[tuple[str, Room]]:
        """Clearances that a camera with the lens needs.

        Parameters
        ----------
        values : mapping
            What varies.
        standing : iterable of str
            Places that may move against the lens, beside all where its surfaces vary.
        """
        return iter(())

    def traced(self, fields: tuple[Field, ...]) -> tuple[Field, ...]:
        """Fields among some whose numbers come from rays through the lens."""
        return ()

    def traces(self, fields: tuple[Field, ...], cameras: Camera, lens: VariedLens | None) -> FieldTraces | None:
        """Traces at fields, of which there are some; None where closed forms tell."""
        return None

    def finest(self, fields: tuple[Field, ...]) -> float:
        """Change of a merit of quantities at some fields that ends a polished search."""
        return TRACED_FTOL if self.traced(fields) else FTOL

    def retraced(self, optimum: Optimum) -> Retrace | None:
        """An optimum traced again; None where nothing was traced."""
        return None


@dataclass(frozen=True)
class _RealLensSearch(IdealLensSearch):
    """A real main lens: its surfaces may vary, and rays through it tell what belongs to a field."""

    @cached_property
    def variation(self) -> LensVariation:
        """How variables change the lens as it stands in the camera."""
        design = self.design
        (lens,) = design.main_lens.kind.mounted
        return LensVariation(lens, design.wavelength, float(design.f))

    def own(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Radii, thicknesses, bending and focal length."""
        return {place: value for place, value in values.items() if varies_lens(place)}

    def as_lengths(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        """Values with the distance between planes and focal length of the surfaces; bending alone leaves the latter."""
        own = self.own(values)
        others = {place: value for place, value in values.items() if place not in own}
        if own:
            lens = self.variation.at(own)
            others[HIATUS] = lens.rear_principal - lens.front_principal
            if own.keys() - {BENDING}:
                others[FOCAL] = lens.focal_length
        return others

    def varied(self, values: Mapping[str, Any]) -> VariedLens:
        """The lens with its own values."""
        return self.variation.at(self.own(values))

    def redrawn(self, values: Mapping[str, Array]) -> dict[str, Any]:
        """Its prescription as it stands in the camera, where anything of it varies."""
        own = {place: float(value) for place, value in self.own(values).items()}
        if not own:
            return {}
        lens = self.variation.prescription(own)
        named = replace(lens, name=lens.name if lens.name.endswith(CUSTOM) else f"{lens.name}{CUSTOM}")
        return {"main_lens.prescription": named, "main_lens.reversed": False}

    def rooms(self, values: Mapping[str, Array], standing: Iterable[str]) -> Iterator[tuple[str, Room]]:
        """Clearances of what stands about it and, where its surfaces vary, its own."""
        own = self.own(values)
        for clearance in clearances(self.design, set(Camera.of(self.design).numbers if own else standing)):
            yield clearance.label, clearance.room
        if own:
            focal = float(self.design.f)
            yield "a lens that converges light", lambda _, lens: focal / lens.focal_length
            for label in self.varied(values).rooms:
                yield label, lambda _, lens, label=label: lens.rooms[label]  # type: ignore[misc]

    def traced(self, fields: tuple[Field, ...]) -> tuple[Field, ...]:
        """All of them."""
        return fields

    def traces(self, fields: tuple[Field, ...], cameras: Camera, lens: VariedLens | None) -> FieldTraces | None:
        """Traces through the lens."""
        return FieldTraces(self.design, fields, cameras, lens) if fields else None

    def retraced(self, optimum: Optimum) -> Retrace:
        """The optimum as its design file has it."""
        return retraced(*optimum())


_SEARCHES = {IdealMainLens: IdealLensSearch, SheetMainLens: IdealLensSearch, RealMainLens: _RealLensSearch}


def lens_search(design: Design) -> IdealLensSearch:
    """The main lens of a design, as a search has it."""
    return _SEARCHES[type(design.main_lens.kind)](design)
