"""Parts of a design together, each as a file states it: what light meets in order, and the numbers of that."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Generic, NamedTuple, Self, TypeVar

from pydantic import Field, ValidationInfo, field_validator, model_validator

from ..bore.chain import COVER, SUBSTRATE, Chain
from ..bore.conjugates import CONJUGATES
from ..bore.elements import AnyElement, ObjectSpace, element_name
from ..bore.part import TEMPERATURE, WAVELENGTH, OpticalPart, Part
from ..catalogue.entries import NAMED, with_named_parts
from ..lenses.glass import Glass
from ..lenses.prescription import Prescription
from .check import FOCAL, PLANE, at
from .environment import Environment
from .parts import (
    PATHS,
    Cover,
    DepthSettings,
    Housing,
    Light,
    MainLens,
    MicrolensArray,
    Opening,
    Pupil,
    RulerSymbols,
    Sensor,
    Stop,
)
from .required import Requirements

OF_TUBE = re.compile(r"stops\.(\d+)\.diameter")
"""Places of widths that a tube may give."""
GIVEN = frozenset({FOCAL, PATHS["D"]})
"""Places of which the main lens may have numbers of its own."""
Standing = TypeVar("Standing")
ROOMY = 1.2
"""Width of a main lens that cuts nothing over the light's, so that misplaced parts are not cut either."""
MOST_STOPS = 50
"""Further stops, or elements, of a design at most: each is met by every ray, and no bore has as many rims."""


class Placed(NamedTuple, Generic[Standing]):
    """A part on the axis."""

    place: str
    """Its place in a design file."""
    name: str
    """Name in words."""
    part: Standing
    near: float
    """Distance before the main lens of its end towards the sensor; below 0 behind the lens [mm]."""
    far: float
    """Distance before the main lens of its end towards the scene [mm]."""

    @property
    def held_by(self) -> str:
        """Place of the part that it belongs to: "sensor" of the cover "sensor.cover"."""
        return self.place.rpartition(".")[0]


class Assembly(Part, RulerSymbols[float], defer_build=True):
    """Parts of a camera, not yet checked against each other."""

    SYMBOLS: ClassVar = PATHS

    name: str
    """Name of the design."""
    source: str = ""
    """Source of its numbers."""
    main_lens: MainLens
    """Main lens, at z = 0."""
    aperture: Pupil
    """Aperture stop's image in object space (flexible angular plane, FAP); may be left out where a sheet states it."""
    stops: Annotated[tuple[Stop, ...], Field(max_length=MOST_STOPS)] = ()
    """Further rims of a real bore."""
    # Defaults are not validated: at import that would build validators that nobody needs.
    object_space: ObjectSpace = ObjectSpace.model_construct()
    """Object space: the medium that the scene lies in, air or a liquid."""
    elements: Annotated[tuple[AnyElement, ...], Field(max_length=MOST_STOPS)] = ()
    """Windows, prisms, lenses before the main lens."""
    microlens_array: MicrolensArray
    """Microlens array, at z = d_1."""
    sensor: Sensor
    """Sensor, at z = d_1 + d_2."""
    tube: Housing | None = None
    """Housing that the camera is built into; None where nothing need fit."""
    environment: Environment | None = None
    """Environment with the temperature of use; None is 20 degrees C, and no place that a temperature has."""
    light: Light = Light.model_construct()
    """Wavelength, and how bright the scene is."""
    depth: DepthSettings = DepthSettings.model_construct()
    """Settings that depth errors are computed for."""
    required: Requirements = ()
    """Quantities that it is to hold within limits, each a verdict of its own."""

    @model_validator(mode="before")
    @classmethod
    def _with_told_pupil(cls, data: Any) -> Any:
        told = isinstance(data, Mapping) and at(data, "main_lens.sheet") is not None
        return {"aperture": {}, **data} if told else data

    @field_validator(*NAMED, mode="before")
    @classmethod
    def _by_name(cls, value: Any, info: ValidationInfo) -> Any:
        return with_named_parts(str(info.field_name), value, (info.context or {}).get("folder", ""))

    @field_validator("aperture", mode="wrap")
    @classmethod
    def _of_lens(cls, value: Any, check: Callable[[Any], Pupil], info: ValidationInfo) -> Pupil:
        if isinstance(value, Stop):  # pages call it by what it is
            value = Pupil(**{key: own for key, own in dict(value).items() if key != "name"})
        lens = info.data.get("main_lens")
        if not lens:
            return check(value or Pupil(distance=0.0, diameter=1.0))  # the lens's own faults are told
        pupil = check(lens.kind.with_pupil(value) if isinstance(value, Mapping) else value)
        if fault := lens.kind.about_pupil(pupil):
            raise ValueError(fault)
        return pupil

    @property
    def tip(self) -> float:
        """Distance of the bore's outer end from the main lens by a ruler [mm]."""
        standing: tuple[Placed[Any], ...] = (*self._as_stated, *self.in_bore)
        return max(float(self.main_lens.kind.front), *(float(at.far) for at in standing))

    def _of_tube(self, rim: Opening) -> Opening:
        """A rim, as wide as the tube leaves it where it states no width of its own."""
        if self.tube is None or not rim.fitted:
            return rim
        return rim.model_copy(update={"diameter": self.tube.room(self.tip - rim.stands)})

    def __getitem__(self, place: str) -> float:
        """The number at a dotted place [mm, rad]; of f, d_f, d_1 and D also what others give."""
        own, wavelength = at(self, place), self.light.wavelength
        if place == PATHS["d_3"]:
            own = self.aperture.stands
        if place == PATHS["f_ml"]:
            own = self.microlens_array.types[0]
        if own is None and (rim := OF_TUBE.fullmatch(place)):
            own = self.all_stops[1 + int(rim[1])].diameter
        if place in GIVEN:
            own = self.main_lens.kind.given(place, own, wavelength)
        # Where all three are given, f and d_1 are the hardware.
        if place == PLANE and self.microlens_array.distance is not None:
            focal_length = self.main_lens.kind.given(FOCAL, self.main_lens.focal_length, wavelength)
            own = own if focal_length is None else None
        if own is None and place == PATHS["D"]:
            return self._uncut
        if own is None:
            others = {key: self[key] for key in CONJUGATES if key != place}
            return float(self.chain.followed({**self.bore_numbers, **others}, place))
        return float(own)

    @property
    def _uncut(self) -> float:
        """Width of a main lens that cuts nothing of what reaches the array's corners, with some room [mm]."""
        numbers = {**self.bore_numbers, **{key: self[key] for key in CONJUGATES}}
        d_f, pupil = float(self.chain.plane(numbers, self.d_f).distance), self.chain.plane(numbers, self.d_3)
        d_3, reach = float(pupil.distance), float(self.aperture.outline.reach / abs(float(pupil.magnification)))
        corner = math.hypot(*self.microlens_array.size) / 2 * (d_f - self.f) / self.f
        return ROOMY * 2 * (corner * abs(d_3) + reach * d_f) / abs(d_f - d_3)

    @property
    def D_F(self) -> float:
        """FAP diameter [mm]; of a rectangle the wider of its extents along x and y."""
        return float(self.aperture.outline.width)

    @property
    def lens(self) -> Prescription | None:
        """The real main lens as it stands in the camera: turned round, cut down; None for the ideal lens."""
        return self.main_lens.kind.lens

    @property
    def thin_twin(self) -> Self:
        """Design with an ideal lens of the same focal length and clear aperture; itself where it has one."""
        return self.main_lens.kind.thin_twin(self)

    @property
    def traced_through(self) -> tuple[str, ...]:
        """Words for what rays go through otherwise than to first order; nothing behind an ideal lens in air."""
        return (*self.main_lens.kind.looks_through, *(("what lies in the bore",) if self.elements else ()))

    @property
    def _as_stated(self) -> tuple[Placed[Opening], ...]:
        """The FAP and the further stops, as the file states them."""
        further = ((f"stops.{k}", stop.called(k + 1), stop) for k, stop in enumerate(self.stops))
        named = (("aperture", "FAP", self.aperture), *further)
        return tuple(Placed(*each, each[-1].stands, each[-1].stands) for each in named)

    @property
    def openings(self) -> tuple[Placed[Opening], ...]:
        """The FAP and the further stops, where they stand."""
        return tuple(at._replace(part=self._of_tube(at.part)) for at in self._as_stated)

    @property
    def in_bore(self) -> tuple[Placed[AnyElement], ...]:
        """The elements before the main lens, where they stand."""
        return tuple(
            Placed(f"elements.{k}", element_name(at, k + 1), at, at.distance, at.distance + at.length)
            for k, at in enumerate(self.elements)
        )

    @property
    def placed(self) -> tuple[Placed[Any], ...]:
        """All that stands before the main lens: openings, then elements."""
        return (*self.openings, *self.in_bore)

    @property
    def all_stops(self) -> tuple[Opening, ...]:
        """The FAP, then the further stops; the main lens is not among them."""
        return (self.aperture, *map(self._of_tube, self.stops))

    @property
    def plates(self) -> tuple[Placed[Cover], ...]:
        """Glass about the microlens array, where it stands: the sensor's cover, and the array's substrate."""
        array, sensor = -self.d_1, -self.d_1 - self.d_2
        return tuple(Placed(place, at.name, at, *at.ends(array, sensor)) for place, at in self.covers.items())

    @property
    def covers(self) -> dict[str, Cover]:
        """Glass about the microlens array by place."""
        plates = {COVER: self.sensor.cover, SUBSTRATE: self.microlens_array.substrate}
        return {place: plate for place, plate in plates.items() if plate is not None}

    @property
    def parts(self) -> dict[str, OpticalPart]:
        """All that light meets, by place."""
        elements, openings = ({at.place: at.part for at in placed} for placed in (self.in_bore, self.openings))
        medium = {"object_space": self.object_space} if elements else {}
        held = {"main_lens": self.main_lens, "microlens_array": self.microlens_array, "sensor": self.sensor}
        return {**elements, **medium, **self.covers, **openings, **held}

    @property
    def glasses(self) -> Iterator[tuple[str, Glass]]:
        """Every material by its place; of lenses by prescription each glass."""
        known = ((f"{place}.{key}", glass) for place, part in self.parts.items() for key, glass in part.glasses)
        return ((place, glass) for place, glass in known if glass is not None)

    @property
    def prescriptions(self) -> Iterator[tuple[str, Prescription]]:
        """Every lens that is given by its surfaces, by its part."""
        return ((place, lens) for place, part in self.parts.items() for lens in part.prescribed)

    @property
    def materials(self) -> dict[str, Glass]:
        """Every material beside the main lens's, by the place of its index."""
        glasses = ((place, part.glass) for place, part in self.parts.items())
        return {f"{place}.index": glass for place, glass in glasses if glass is not None}

    @property
    def chain(self) -> Chain:
        """Elements before the main lens, and the plates about the array."""
        housing = 0.0 if self.environment is None else self.environment.expansion
        before = tuple(place for place, plate in self.covers.items() if plate.before_lenslets)
        behind = tuple(place for place in self.covers if place not in before)
        bores = tuple(opening.place for opening in self.openings if opening.part.bore)
        stops = tuple(stop.name for stop in self.openings[1:])
        fitted = tuple(opening.place for opening in self._as_stated if opening.part.fitted)
        imaged = self.aperture.behind is not None
        return Chain(self.elements, housing, before, behind, imaged, self.main_lens.sheet, bores, stops, fitted)

    def place_named(self, name: str) -> str:
        """Dotted place of a number, from that, a symbol of the paper, or a place with a part's name in it."""
        return self.chain.place_named(PATHS.get(name, name))

    @property
    def bore_numbers(self) -> dict[str, float]:
        """Numbers of what light meets beside the main lens, at their places; indices at the design's wavelength."""
        numbers = {WAVELENGTH: self.wavelength}
        numbers |= {f"main_lens.decentre.{axis}": float(self.main_lens.decentre[axis]) for axis in (0, 1)}
        numbers |= {f"{at.place}.{key}": value for at in self.in_bore for key, value in at.part.numbers()}
        numbers |= {f"{place}.thickness": float(plate.thickness) for place, plate in self.covers.items()}
        if self.environment is not None:
            numbers[TEMPERATURE] = float(self.environment.temperature)
        return numbers | {place: _index(glass, self.wavelength) for place, glass in self.materials.items()}

    @property
    def aligned(self) -> bool:
        """True where nothing is tilted.

        Tilts of elements before the lens move the images of stops, which stay discs.
        """
        return self.has_exact_areas and all(stop.tilt == (0.0, 0.0) for stop in self.all_stops)

    @property
    def has_exact_areas(self) -> bool:
        """True where FAP, main lens, array and sensor stand straight.

        Closed forms then know every stop's image on the sensor, that of a further stop or of a mirror as it leans.
        """
        parts = (self.aperture, self.main_lens, self.microlens_array, self.sensor)
        return all(part.tilt == (0.0, 0.0) for part in parts)

    @property
    def sees_discs(self) -> bool:
        """True where every stop's image on the sensor is a disc: nothing is tilted, and no mirror's rim leans."""
        return self.aligned and not self.chain.leans


@lru_cache(maxsize=256)
def _index(glass: Glass, wavelength: float) -> float:
    return float(glass.index(wavelength))
