"""Traces at single fields of cameras behind a real main lens: the same builds that tolerance studies trace.

What belongs to the camera as a whole follows from the lens's own first order, its focal length and principal planes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from ..bore.conjugates import CONJUGATES
from ..bore.part import TEMPERATURE
from ..camera import BESIDE, VIEWING_CONDITIONS, Camera, Number
from ..design import PATHS, Design
from ..evaluation.field_images import FieldImages
from ..lenses.prescription import first_order
from ..theory.quantity import Quantity
from ..tolerancing.ideal import IdealBuilds
from ..tolerancing.metrics import Question, builds_of
from ..tolerancing.places import LENS
from ..tolerancing.traced import AS_IF_THIN, METHOD, folded
from .lens_variables import VariedLens

Field = tuple[float, float]
"""A microlens's place on the array [mm]."""

AHEAD = ("aperture", "stops.", "elements.")
"""Prefixes of places of all that stands before the lens."""


def faults_behind(design: Design, name: str, quantity: Quantity, at_field: bool) -> Iterator[str]:
    """Faults of asking for a quantity of a design behind a real lens."""
    assert design.lens is not None
    lens = design.lens.name
    if quantity.name in AS_IF_THIN:
        yield f"{name} is not traced while searching, and its formula leaves out {AS_IF_THIN[quantity.name]}"
    elif quantity.local is not None and not at_field:  # what belongs to a field is traced
        yield (
            f"behind a real lens ({lens}) {name} is traced and differs from field to field; say where on the array, "
            'e.g. field = "3 mm" (once for each place that matters)'
        )


class FieldTraces:
    """Fields of the cameras that a design with a real lens becomes; rays are shared by all that is asked there.

    Parameters
    ----------
    design : Design
        Behind a real lens.
    fields : tuple of (x, y)
        Every field that will be asked about [mm].
    camera : Camera
        T builds; what it has otherwise than the design is how they differ.
    lens : VariedLens, optional
        Of the same builds, where it is not the design's own.
    own : bool
        Whether they are the design itself, whose folded images are then left undefined.
    """

    def __init__(
        self,
        design: Design,
        fields: tuple[Field, ...],
        camera: Camera,
        lens: VariedLens | None = None,
        *,
        own: bool = False,
    ) -> None:
        self.design, self.fields, self.camera, self.own = design, fields, camera, own
        self.lens = lens if lens is not None and lens.places else None
        self._builds: dict[float | None, tuple[IdealBuilds, NDArray[np.bool_]]] = {}

    @property
    def numbers(self) -> dict[str, Array]:
        """Place to what builds have there, where that is not the design's own number, (T,) each."""
        shaped = () if self.lens is None else np.shape(self.lens.focal_length)
        own, builds = Camera.of(self.design).numbers, np.broadcast_shapes(self.camera.shape or (1,), shaped)
        kept = {*VIEWING_CONDITIONS, *CONJUGATES, *BESIDE}
        moved = {place: v for place, v in self.camera.numbers.items() if place not in kept}
        moved = {place: v for place, v in moved.items() if not np.array_equal(v, own[place])}
        moved[CONJUGATES[2]] = self.camera[CONJUGATES[2]]
        if self.lens is not None:  # distances count from the drawn lens's principal planes there, here from its own
            drawn = first_order(self.design.lens, self.design.wavelength)  # type: ignore[arg-type]
            stands = [place for place in own if place.endswith(".distance") and place.startswith(AHEAD)]
            ahead = drawn.front_principal - self.lens.front_principal
            moved |= {place: self.camera[place] + ahead for place in stands}
            moved[CONJUGATES[2]] = moved[CONJUGATES[2]] + (self.lens.rear_principal - drawn.rear_principal)
            moved |= {f"{LENS}{place}": value for place, value in self.lens.places.items()}
        return {place: np.broadcast_to(np.asarray(v, float), builds).copy() for place, v in moved.items()}

    def at(self, quantity: Quantity, field: Field, temperature: float | None = None) -> Array:
        """A quantity at one of the fields, (T,); nan where builds make no camera, or where it has no value."""
        builds, valid = self._at(temperature)
        with np.errstate(all="ignore"):
            values = np.broadcast_to(quantity.at_fields(builds), (len(self.fields), len(valid)))
        return np.where(valid, values[self.fields.index(field)], np.nan)

    def _at(self, temperature: float | None) -> tuple[IdealBuilds, NDArray[np.bool_]]:
        if temperature not in self._builds:
            numbers = self.numbers
            trials = len(next(iter(numbers.values())))
            if temperature is not None:
                numbers[TEMPERATURE] = np.full(trials, temperature)
            question = Question(self.design, (), self.fields, float(Camera.of(self.design).seen.d_f))
            with np.errstate(all="ignore"):
                self._builds[temperature] = builds_of(question, numbers, trials, afresh=not self.own)
        return self._builds[temperature]


@dataclass(frozen=True)
class _Clearance:
    """Clearance around a real lens, which nothing may stand inside."""

    label: str
    room: Callable[[Camera, VariedLens], Number]
    """In units of the lens's focal length; not below 0."""


def clearances(design: Design, moved: set[str]) -> Iterator[_Clearance]:
    """Clearances of the array, and of stops and elements of which places move."""
    focal = float(Camera.of(design).f)

    def array(c: Camera, lens: VariedLens) -> Number:
        before = c.chain.before_array(c.numbers)
        return (c[CONJUGATES[2]] - before - (lens.rear - lens.rear_principal)) / focal

    def ahead(c: Camera, lens: VariedLens, place: str) -> Number:
        return (c[place] - (lens.front_principal - lens.front)) / focal

    yield _Clearance("the array behind the lens's last surface", array)
    for place in sorted(moved):
        part, _, name = place.rpartition(".")
        image = part == "aperture" and design.d_3 < 0  # which is nowhere in the way
        if name == "distance" and part.startswith(AHEAD) and not image:
            yield _Clearance(f"{part} before the lens's first surface", partial(ahead, place=place))


@dataclass(frozen=True)
class Retrace:
    """The optimum, traced again on its own."""

    lens: str
    folded: tuple[Field, ...]
    """Fields whose image is folded [mm]."""
    moved: float
    """Largest difference between goals and limits as the search had them and as the optimum's own trace has them,
    relative to the larger of the two, or to 1."""

    def to_dict(self) -> dict[str, Any]:
        """Values for the JSON object."""
        shapeless = [list(field) for field in self.folded]
        return {"lens": self.lens, "method": METHOD, "goals_and_limits": self.moved, "folded_fields_mm": shapeless}


Asked = tuple[Quantity, Field | None, float | None, float]
"""Quantity that is asked for, its field or distance ahead of the tip [mm], and a value."""


def retraced(best: Design, asked: Sequence[Asked]) -> Retrace:
    """Trace a design as a camera of its own, where the search had one of many, with what it had for what is asked."""
    assert best.lens is not None
    fields = tuple(dict.fromkeys(field for _, field, *_ in asked if field is not None)) or ((0.0, 0.0),)
    cameras = Camera.of(best).replace({PATHS["d_2"]: np.array([best.d_2])})
    own = FieldTraces(best, fields, cameras, own=True)
    shown, again = FieldImages.of(best), list[tuple[float, float]]()
    for quantity, field, at, value in asked:
        told = shown.told(quantity, at) if field is None else float(own.at(quantity, field)[0])
        if told is not None:
            again.append((value, told))
    moved = [abs(a - b) / max(abs(a), abs(b), 1.0) for a, b in again]
    finite = [off for off in moved if np.isfinite(off)]
    shapeless = tuple(field for field, odd in zip(fields, folded(best, fields), strict=True) if odd)
    return Retrace(best.lens.name, shapeless, max(finite, default=0.0))
