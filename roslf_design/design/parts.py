"""The parts of a camera as frozen values: main lens, stops, microlens array, sensor, light.

Made in Python, lengths are plain millimetres and angles radians (text with a unit works too); read from a file, text
with a unit is required. Decentres are (x, y) against the optical axis; a tilt (t_x, t_y) turns the part's normal from
z by t_x about x, then by t_y about y.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
from pydantic import Field, StrictBool, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from ..bore.export import SequenceRow
from ..bore.lens_sheet import LensSheet
from ..bore.main_lens import MainLensKind, SheetMainLens, main_lens_kind
from ..bore.opening import TURN, ClearAperture
from ..bore.part import Colours, GivenName, Layout, Number, Offset, OpticalPart, Part, PartName, Size, Tilt
from ..bore.plate import glass_rows
from ..bore.real_lens import Lens
from ..lenses.glass import Glass
from ..lenses.material import Material
from ..lenses.prescription import Prescription
from ..units import (
    Angle,
    AnyLength,
    Distance,
    Illuminance,
    Length,
    Radiance,
    Time,
    format_quantity,
    read_quantity,
)
from ..words import length
from .environment import Housed

BEHIND = "aperture.behind"
"""Place of the distance of a stop behind the main lens."""
N = TypeVar("N", float, Number)
VIEW_MISMATCH = 0.02
"""Share by which samples of a raw capture differ from what other views say, where nothing is known: rounded up from a
raw white frame of a light-field microscope before any flat field (0.013 rms from one microlens to the next and from
pixel to pixel, shot noise included), below the 0.024 left between inner views of a processed 8-bit light field. Depths
in such views err as if it were 0.09, as interpolated views share it (studies/depth/published.py).
"""
USUAL_PIXEL, ALIKE = 3.45e-3, 2.0
"""Pixel [mm] whose full well is assumed, and ratio of areas up to which another's is taken to be about the same."""
MOST_PIXELS = 1_000_000
"""Largest number of pixels along one side of a sensor."""


class MainLens(OpticalPart):
    """The main lens: ideal and thin at z = 0, or a real one, whose principal planes then stand where z = 0 splits.

    With a prescription the focal length is the lens's own at the design's wavelength, with a sheet what that tells;
    d_f, d_3 and the further stops count from its object-side principal plane, d_1 from its image-side one.
    """

    part: PartName | None = None
    """Part in the catalogue that gives the keys left out here (`roslf catalogue` lists names, and what they give), or
    {file = "mine.toml", name = "quote 118"} in one of your own; own values beside it win. None: no part is named."""
    prescription: Lens = None
    """A real lens; None is the ideal one."""
    sheet: LensSheet | None = None
    """Data sheet of a bought lens; None is the ideal one."""
    reversed: StrictBool = False
    """Whether the real lens stands the other way round than its prescription says."""
    diameter: Length | None = Field(default=None, validate_default=True)
    """D, clear aperture [mm]; with a prescription None is the lens's own, and a smaller one a stop at the lens; with a
    sheet None cuts nothing where that states a pupil's place, and is the pupil's diameter where it does not."""
    outer_diameter: Length | None = None
    """Diameter of the whole lens with its edge, which a tube must hold [mm]; None: as wide as what is known of it."""
    focal_length: Length | None = None
    """f [mm]; None where d_f and d_1, or a prescription, give it."""
    material: Material | None = None
    """Material of an ideal lens, as far as temperature goes; None leaves f what it is."""
    focal_plane: Length | None = None
    """d_f, distance of the object plane in focus on the MLA [mm]; None where f and d_1 give it."""
    decentre: Offset = (0.0, 0.0)
    """Offset from the axis [mm]."""
    tilt: Tilt = (0.0, 0.0)
    """[rad]."""

    @property
    def kind(self) -> MainLensKind:
        """Main lens that answers for itself."""
        if self.sheet is not None:
            return SheetMainLens(sheet=self.sheet)
        return main_lens_kind(self.prescription, self.reversed, self.diameter, self.material)

    @property
    def glasses(self) -> tuple[tuple[str, Glass | None], ...]:
        """Material of an ideal one, glass of each surface of a real one."""
        return self.kind.glasses

    @property
    def prescribed(self) -> tuple[Prescription, ...]:
        """Its own, of a real one."""
        return self.kind.prescribed

    @property
    def grows(self) -> bool:
        """Whether its material is known."""
        return self.kind.grows

    @field_validator("diameter", mode="after")
    @classmethod
    def _needed(cls, value: float | None, info: ValidationInfo) -> float | None:
        # A prescription or sheet that could not be read is told of by itself.
        sheet, prescription = (info.data.get(key, ...) for key in ("sheet", "prescription"))
        if value is None and prescription is None and (sheet is None or not getattr(sheet, "pupil", True)):
            raise PydanticCustomError("missing", "Field required")
        return value

    @field_validator("sheet", "material", mode="after")
    @classmethod
    def _of_ideal(cls, value: Any, info: ValidationInfo) -> Any:
        known = [key for key in ("prescription", "sheet") if info.data.get(key) is not None]
        if value is not None and known:
            raise ValueError(f"the {known[0]} says what the lens is made of; drop {info.field_name}")
        return value


Shape = Literal["circle", "rectangle"]
"""Shapes of a stop's clear opening."""


class Opening(OpticalPart):
    """A clear opening of some shape."""

    OF_TUBE: ClassVar = False
    """Whether a tube may say how wide it is."""

    shape: Shape = "circle"
    """Shape of the opening."""
    bore: StrictBool = False
    """Whether it is the bore of `[tube]` itself: its misses move the wall, and it needs no room in the tube."""
    diameter: Length | None = Field(default=None, validate_default=True)
    """Diameter of a circle, D_F of the FAP [mm]; None of a rectangle, and of a stop that is the tube's bore as wide as
    `[tube]` leaves it there."""
    sides: Size | None = Field(default=None, validate_default=True)
    """Sides of a rectangle [mm]; None of a circle."""
    turn: Angle = 0.0
    """Angle of a rectangle's first side to x, about the axis [rad]."""

    @field_validator("diameter", "sides", mode="after")
    @classmethod
    def _of_shape(cls, value: Any, info: ValidationInfo) -> Any:
        shape = info.data.get("shape")
        if shape is None:  # the shape's own fault is told
            return value
        own = info.field_name == ("diameter" if shape == "circle" else "sides")
        if own and value is None:
            if cls.OF_TUBE and shape == "circle" and info.data.get("bore"):
                return None  # the tube tells it
            raise PydanticCustomError("missing", "Field required")
        if own or value is None:
            return value
        if shape == "circle":
            raise ValueError('a circle has a diameter; drop sides, or give shape = "rectangle"')
        raise ValueError("a rectangle has sides; drop diameter, or the shape")

    @field_validator("turn", mode="after")
    @classmethod
    def _of_rectangle(cls, value: float, info: ValidationInfo) -> float:
        if value and info.data.get("shape") == "circle":
            raise ValueError('a circle is the same however it is turned; drop turn, or give shape = "rectangle"')
        return value

    decentre: Offset = (0.0, 0.0)
    """Offset from the axis [mm]."""
    tilt: Tilt = (0.0, 0.0)
    """[rad]."""

    @property
    def fitted(self) -> bool:
        """Whether it is as wide as the tube leaves it."""
        return self.diameter is None and self.sides is None

    @property
    def number_keys(self) -> tuple[str, ...]:
        """Keys of its numbers beside its pose."""
        return (*self.outline.keys, *((TURN,) if self.outline.straight else ()), "distance")

    @property
    def stands(self) -> float:
        """Distance in front of the main lens by a ruler [mm]."""
        raise NotImplementedError

    @property
    def outline(self) -> ClearAperture:
        """Its clear opening."""
        if self.sides is None:
            return ClearAperture((self.diameter or math.nan) / 2)
        return ClearAperture(math.inf, (self.sides[0] / 2, self.sides[1] / 2), self.turn)


class Stop(Opening):
    """An opening in object space: a further rim of the bore."""

    OF_TUBE: ClassVar = True

    distance: Distance
    """Distance in front of the main lens [mm]; 0 is at the lens."""
    name: GivenName | None = None
    """Name on pages and in tables, such as "tip"; by its number, "stop 1", where none is given."""

    def called(self, number: int) -> str:
        """Name of the one of that number, from 1."""
        return self.name or f"stop {number}"

    @property
    def stands(self) -> float:
        """Distance in front of the main lens by a ruler [mm]."""
        return float(self.distance)


class Pupil(Opening):
    """The flexible angular plane (FAP), or the stop behind the main lens whose image by the lens it is."""

    USUAL: ClassVar = ("diameter", "distance")
    """Keys that make one of most cameras."""

    distance: AnyLength | None = None
    """d_3, distance in front of the main lens [mm]; 0 is at the lens, below 0 behind it, where the scene sees the
    entrance pupils of many bought objectives. None of a stop `behind` the lens."""
    behind: Length | None = Field(default=None, validate_default=True)
    """Distance behind the main lens of the stop that makes the FAP [mm]; diameter, decentre and tilt are then the
    stop's own. None of a FAP at `distance`."""

    @field_validator("behind", mode="after")
    @classmethod
    def _one_place(cls, value: float | None, info: ValidationInfo) -> float | None:
        distance = info.data.get("distance", ...)
        if value is None and distance is None:
            raise ValueError("is missing, and so is distance; give one of them")
        if value is not None and isinstance(distance, float):
            raise ValueError("the stop stands behind the lens, or its image at a distance before it; drop one of them")
        return value

    @property
    def stands(self) -> float:
        """Distance in front of the main lens by a ruler; below 0 behind it [mm]."""
        return float(self.distance if self.behind is None else -self.behind)  # type: ignore[arg-type]


class Cover(OpticalPart):
    """A plane plate on the sensor, or between it and the microlens array."""

    thickness: Length
    """[mm]."""
    material: Material
    """Material of the cover."""

    name: ClassVar[str] = "cover"
    trade_name: ClassVar[str] = "cover glass of the sensor"
    before_lenslets: ClassVar[bool] = False
    """Whether light goes through it before the microlenses."""

    @property
    def glass(self) -> Glass:
        """Its material."""
        return self.material

    def ends(self, array: float, sensor: float) -> tuple[float, float]:
        """Ends towards the sensor and the scene, of array and sensor that stand there [all mm before the main lens]."""
        return sensor, sensor + self.thickness

    def words(self) -> tuple[str, ...]:
        """Thickness and material."""
        return (f"{length(self.thickness)} of {self.material.name}",)

    def rows(self, name: str, at: float, semi: float) -> list[SequenceRow]:
        """Rows of both faces, the one towards the sensor at a place; see `Element.rows`."""
        return glass_rows(name, at, self.thickness, self.material, semi)


class Substrate(Cover):
    """The plate that carries the microlenses."""

    lenslets: Literal["scene", "sensor"] = "scene"
    """Side that the lenslets face: towards the scene the light goes through the plate behind them, else before them."""

    name: ClassVar[str] = "substrate"
    trade_name: ClassVar[str] = "MLA substrate"

    @property
    def before_lenslets(self) -> bool:  # type: ignore[override]
        """Whether the lenslets face the sensor."""
        return self.lenslets == "sensor"

    def ends(self, array: float, sensor: float) -> tuple[float, float]:
        """Ends of a plate that carries the lenslets on its side towards the sensor, or the scene; see `Cover.ends`."""
        return (array, array + self.thickness) if self.before_lenslets else (array - self.thickness, array)

    def words(self) -> tuple[str, ...]:
        """Thickness and material, and where the lenslets face."""
        return (*super().words(), f"lenslets towards the {self.lenslets}")


class MicrolensArray(OpticalPart):
    """The microlens array (MLA)."""

    part: PartName | None = None
    """Part in the catalogue that gives the keys left out here (`roslf catalogue` lists names, and what they give), or
    {file = "mine.toml", name = "quote 118"} in one of your own; own values beside it win. None: no part is named."""
    pitch: Length
    """d, between centres of neighbours, the same all over the array [mm]."""
    focal_lengths: Annotated[tuple[Length, ...], Field(max_length=16)] = ()
    """Focal lengths of a multi-focus array, one for each type of microlens, which take turns along both directions of
    the lattice [mm]; empty where all microlenses are alike."""
    focal_length: Length | None = Field(default=None, validate_default=True)
    """f_ml, the effective one (ISO 14880-1), in air [mm]; None of a multi-focus array."""
    distance: Length | None = None
    """d_1, main lens to MLA [mm]; None where f and d_f give it."""
    size: Size
    """Width and height [mm]."""
    layout: Layout = "square"
    """Packing of the microlenses."""
    lens_shape: Literal["square", "circular"] = "square"
    """Clear aperture of one microlens, as wide as the pitch."""
    material: Material | None = None
    """Material of the microlenses, as far as temperature goes; None is their substrate's."""
    substrate: Substrate | None = None
    """The plate that carries them; None where light meets none."""
    rotation: Angle = 0.0
    """About the axis [rad]."""
    tilt: Tilt = (0.0, 0.0)
    """[rad]."""
    decentre: Offset = (0.0, 0.0)
    """Offset from the axis [mm]."""

    @field_validator("focal_length", mode="after")
    @classmethod
    def _one_or_several(cls, value: float | None, info: ValidationInfo) -> float | None:
        several = info.data.get("focal_lengths")  # None where its own fault is told
        if value is None and several == ():
            raise PydanticCustomError("missing", "Field required")
        if value is not None and several:
            raise ValueError(
                "all microlenses have one focal length, or focal_lengths has each type's; drop one of them"
            )
        return value

    @property
    def types(self) -> tuple[float, ...]:
        """Focal length of each type of microlens [mm]."""
        return self.focal_lengths if self.focal_length is None else (self.focal_length,)

    @property
    def focal_words(self) -> str:
        """Focal length of each type."""
        return " / ".join(map(length, self.types))

    @property
    def made_of(self) -> Glass | None:
        """Material of the microlenses: their own, or their substrate's."""
        return self.material or (None if self.substrate is None else self.substrate.material)

    @property
    def glasses(self) -> tuple[tuple[str, Glass | None], ...]:
        """Material of the microlenses, where it is given."""
        return (("material", self.material),)

    @property
    def grows(self) -> bool:
        """Whether the microlenses' material is known."""
        return self.made_of is not None


class Sensor(OpticalPart):
    """The photosensor behind the microlens array."""

    INSTEAD: ClassVar = ("pixels",)
    """Keys that a file may have in place of others."""

    part: PartName | None = None
    """Part in the catalogue that gives the keys left out here (`roslf catalogue` lists names, and what they give), or
    {file = "mine.toml", name = "quote 118"} in one of your own; own values beside it win. None: no part is named."""
    distance: Length
    """d_2, MLA to sensor [mm]."""
    pixel: Length
    """Pixel pitch [mm], before the relay."""
    size: Size
    """Width and height [mm], before the relay; or, in its place, how many pixels that is: pixels = [4056, 3040]."""
    package: Size | None = None
    """Width and height of its package, which a tube must hold [mm]; None: only its pixels are known to take room."""
    relay_magnification: Annotated[float, Field(gt=0, ge=1e-6, le=1e6)] = 1.0
    """Magnification of a relay between the MLA's image plane and the sensor, where a pixel is then 1/magnification as
    large."""
    cover: Cover | None = None
    """Glass before the sensor, behind the MLA; None where there is none. Most packages have one, which no part of the
    catalogue states: its thickness is on the maker's drawing, and d_2 has to hold it."""
    quantum_efficiency: Annotated[float, Field(gt=0, le=1)] = 0.7
    """Electrons per photon; makers' EMVA 1288 sheets of CMOS sensors tell 0.55 to 0.8 in the green."""
    full_well: Annotated[float, Field(gt=0, le=1e9)] = 10_500.0
    """Electrons that a pixel holds; about those of 3.45 um global-shutter pixels."""
    read_noise: Annotated[float, Field(ge=0, le=1e6)] = 2.5
    """Rms [electrons]."""
    prnu: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Photo-response non-uniformity (EMVA 1288) that flat-fielding leaves: rms share of a pixel's signal."""
    dsnu: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Dark-signal non-uniformity (EMVA 1288) that a dark frame leaves, rms [electrons]."""
    bits: Annotated[int, Field(ge=1, le=24)] = 12
    """Bits of the digitised full well."""
    acceptance: Angle | None = None
    """Angle of a ray to the sensor's normal, in air, at which a pixel takes half of the light, by its maker's figures
    [rad]; None where nothing is known."""
    colours: Colours = "mono"
    """Filters on its pixels; rows count as in the raw image."""

    @property
    def well_unlike(self) -> bool:
        """Whether its full well is the one assumed, and its pixels are unlike those that this is of."""
        larger, assumed = (self.pixel / USUAL_PIXEL) ** 2, type(self).model_fields["full_well"].default
        return bool(self.full_well == assumed and not 1 / ALIKE <= larger <= ALIKE)

    def well_of(self, pixel: float) -> float:
        """Electrons that pixels of another size hold [mm], where nobody states them: by area, of what its own hold."""
        return float(self.full_well) * (pixel / (USUAL_PIXEL if self.well_unlike else float(self.pixel))) ** 2

    @field_validator("size", mode="after")
    @classmethod
    def _of_pixels(cls, value: tuple[float, float], info: ValidationInfo) -> tuple[float, float]:
        pixel = info.data.get("pixel")
        if pixel is not None and min(value) < pixel * (1 - 1e-9):
            wide, high, own = (format_quantity(length, "length", 6) for length in (*value, pixel))
            raise ValueError(f"{wide} x {high} is less than one pixel of {own}; check the units of pixel and size")
        return value

    @field_validator("acceptance", mode="after")
    @classmethod
    def _slanting(cls, value: float | None) -> float | None:
        if value is not None and not 0 < value < math.pi / 2:
            raise ValueError("a pixel takes half of the light at an angle between 0 and 90 degrees; give one")
        return value

    @model_validator(mode="before")
    @classmethod
    def _counted(cls, data: Any) -> Any:
        """`pixels`, their count along width and height, in place of `size`."""
        if not isinstance(data, Mapping) or "pixels" not in data:
            return data
        counts, rest = data["pixels"], {key: value for key, value in data.items() if key != "pixels"}
        if "size" in data:
            raise ValueError("has both size and pixels; give one of them")
        whole = isinstance(counts, Sequence) and len(counts) == 2 and all(type(count) is int for count in counts)
        if not whole or not all(0 < count <= MOST_PIXELS for count in counts):
            raise ValueError("pixels counts them along width and height; write e.g. pixels = [4056, 3040]")
        try:
            pixel = read_quantity(data.get("pixel"), "length", unit_required=False)
        except ValueError:
            return rest | {"size": ["1 mm", "1 mm"]}  # the pixel's own fault is told
        return rest | {"size": [f"{count * pixel!r} mm" for count in counts]}

    tilt: Tilt = (0.0, 0.0)
    """[rad]."""
    decentre: Offset = (0.0, 0.0)
    """Offset from the axis [mm], as seen at the MLA's image plane."""


def widening(tip: Number, wide_end: Number, length: Number, behind: Number) -> Number:
    """How much wider a cone is so far `behind` its tip than there [mm]; as wide as its end from there on."""
    wider: Number = (wide_end - tip) * np.clip(np.divide(behind, length), 0.0, 1.0)
    return wider


def tube_room(numbers: Mapping[str, Number], behind: Number) -> Number:
    """Diameter of the room inside a tube, so far `behind` its tip [mm], from its numbers by their places."""
    outer = numbers["tube.outer_diameter"]
    inside: Number = outer - 2 * (numbers["tube.wall"] + numbers.get("tube.light_guide", 0.0))
    if (wide_end := numbers.get("tube.proximal_diameter")) is None:
        return inside
    return inside + widening(outer, wide_end, numbers["tube.length"], behind)


class Housing(Part):
    """The tube that a scope is built into, from its tip backwards."""

    outer_diameter: Length
    """Outer diameter, of a cone at its tip [mm]."""
    proximal_diameter: Length | None = None
    """Outer diameter of a cone where it ends, `length` behind the tip, to which it widens evenly, as a speculum [mm];
    None of a straight tube."""
    wall: Length
    """Thickness of its wall, across the axis [mm]."""
    light_guide: Length | None = None
    """Thickness of a ring of light fibres within the wall [mm]; None where the file says nothing of light."""
    length: Length | None = None
    """Length from the tip along the light's way, also what a fold turns sideways [mm]; what lies farther back need not
    fit inside. None: everything must."""
    material: Housed | None = None
    """Material, where it is not the housing's: it holds apart what stands before the main lens from the tube's end to
    the tip, and its own widths grow with it."""

    def room(self, behind: float) -> float:
        """Diameter of the room inside, so far `behind` the tip [mm]."""
        lengths = {f"tube.{key}": value for key, value in self if isinstance(value, float)}
        return float(tube_room(lengths, behind))

    @model_validator(mode="after")
    def _hollow(self) -> Housing:
        if self.material is not None and self.length is None:
            raise ValueError("material is of a tube that ends; give its length, or name the housing in [environment]")
        if self.proximal_diameter is not None and self.length is None:
            raise ValueError("proximal_diameter is where a cone ends; give its length from the tip, or drop it")
        if self.proximal_diameter is not None and self.proximal_diameter < self.outer_diameter:
            raise ValueError(
                "proximal_diameter is the wide end and below outer_diameter, which is the tip's; swap them"
            )
        if self.room(0.0) <= 0:
            what = "the wall is" if self.light_guide is None else "wall and light_guide are"
            raise ValueError(f"{what} half the outer diameter or more, which leaves no room; make it thinner")
        return self


class Light(Part):
    """The light that the design is evaluated for.

    The scene's radiance is given, or follows from illuminance and reflectance of a matt surface: ``E rho/pi`` over the
    eye's luminous efficacy of 683 lm/W, as if all of it had the design's wavelength and that were 555 nm. Both are
    those in the medium that the scene lies in, of index n: 1/n^2 of the radiance comes through its window.
    """

    wavelength: Length = 550e-6
    """lambda [mm]."""
    illuminance: Illuminance = 1e5
    """Illuminance on the scene, in its medium [lx]; about that of full sunlight. It counts as light of 555 nm, 683
    lm/W: of light far from that state the radiance."""
    reflectance: Annotated[float, Field(gt=0, le=1)] = 0.3
    """Reflectance of the scene, on average."""
    radiance: Radiance | None = None
    """Radiance of the scene, in its medium, on average [W/m^2/sr]; None where illuminance and reflectance give it."""
    measured_at: Length | None = None
    """Distance ahead of the tip at which the scene has that illuminance or radiance, of a source in the tip [mm]: from
    there it falls as 1/z^2, which holds from a few diameters of the tip on. None: as bright at every distance."""
    exposure: Time | None = None
    """Exposure [s], at every distance; None is 1/60 s, or shorter where the scene's mean would fill more than half the
    full well, at `measured_at`."""
    transmission: Annotated[float, Field(gt=0, le=1)] = 0.95
    """Transmission of all optics together."""
    veil: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Veiling light that every pixel gets beside the picture's own, as a share of the full well."""


OCTAVES, MOST_CONTRAST = 6, 0.3
"""Octaves of detail of a texture; its contrast in each of them, at most [rms]: 0.73 rms together, where one place in
twelve would be darker than black."""


class DepthSettings(Part):
    """Settings of depth errors: the scene's texture, and how disparity is found.

    A texture with the same contrast in every octave of detail, as natural scenes have it, or one of a single period.
    """

    period: Length | None = None
    """Period of a texture that has only one, in every direction [mm]; None has detail of every size."""
    contrast: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Rms contrast of the texture: of the one `period`, or in each octave of detail, there 0.3 at most."""
    finest: Length | None = None
    """Period of the texture's finest detail [mm]; None has all that single views can show, down to two microlenses."""
    window: Annotated[int, Field(ge=1, le=1001)] = 5
    """Microlenses along each side of the square in which disparity is taken to be the same."""
    view_mismatch: Annotated[float, Field(ge=0, le=1)] = VIEW_MISMATCH
    """Rms share of brightness by which a pixel differs from what other views say of it, beside noise: unequal pixels,
    lenslets out of place, aberrations, resampling; counted in `u_z_mm` alone. For raw captures: 0.013 was measured in a
    raw white frame before its flat field (`reports/depth-published`). Views that were interpolated err as by 0.09."""
    disparity_error: Annotated[float, Field(gt=0, le=1e3)] | None = None
    """Standard error of the disparity between the FAP's rims [microlens pitches], whatever light and texture; None
    predicts it from them."""

    @field_validator("contrast", mode="after")
    @classmethod
    def _of_light(cls, value: float, info: ValidationInfo) -> float:
        if value > MOST_CONTRAST and info.data.get("period", ...) is None:
            raise ValueError(
                f"{value:g} in each octave of detail is more than light can show: six octaves of {MOST_CONTRAST:g} are "
                f"0.73 rms together, and no radiance is below zero; give {MOST_CONTRAST:g} at most, or depth.period "
                "for a texture of one period"
            )
        return value


PATHS: dict[str, str] = {
    "D": "main_lens.diameter",
    "f": "main_lens.focal_length",
    "d_f": "main_lens.focal_plane",
    "d_1": "microlens_array.distance",
    "D_F": "aperture.diameter",
    "d_3": "aperture.distance",
    "d": "microlens_array.pitch",
    "f_ml": "microlens_array.focal_length",
    "d_2": "sensor.distance",
    "q": "sensor.pixel",
    "wavelength": "light.wavelength",
}
"""The paper's symbol to its place in a design file."""


class Symbols(Generic[N]):
    """The paper's symbols that are the same by a ruler and as the main lens sees them."""

    def __getitem__(self, place: str) -> N:
        raise NotImplementedError

    @property
    def f(self) -> N:
        """Main lens focal length [mm]."""
        return self[PATHS["f"]]

    @property
    def D(self) -> N:
        """Main lens clear aperture [mm]."""
        return self[PATHS["D"]]

    @property
    def d(self) -> N:
        """Microlens pitch [mm]."""
        return self[PATHS["d"]]

    @property
    def f_ml(self) -> N:
        """Microlens focal length [mm]; of a multi-focus array that of the first type."""
        return self[PATHS["f_ml"]]

    @property
    def wavelength(self) -> N:
        """Wavelength lambda [mm]."""
        return self[PATHS["wavelength"]]

    @property
    def q(self) -> N:
        """Pixel pitch as seen at the MLA's image plane [mm]: the sensor's pixel over the relay's magnification."""
        return self[PATHS["q"]] / self["sensor.relay_magnification"]

    @property
    def sensor_size(self) -> tuple[N, N]:
        """Width and height of the sensor as seen at the MLA's image plane [mm]."""
        relay = self["sensor.relay_magnification"]
        return self["sensor.size.0"] / relay, self["sensor.size.1"] / relay

    @property
    def pixels(self) -> tuple[int, int]:
        """Whole pixels across the sensor's width and height, of one camera."""
        width, height = (float(self[f"sensor.size.{axis}"] / self[PATHS["q"]]) for axis in (0, 1))
        # Printed sizes are rounded: 22.3 mm / 4.847826 um is 4599.9999.
        return int(width + 1e-3), int(height + 1e-3)


class RulerSymbols(Symbols[N]):
    """Symbols of lengths as a ruler tells them."""

    @property
    def d_f(self) -> N:
        """Focal plane before the main lens [mm]."""
        return self[PATHS["d_f"]]

    @property
    def d_1(self) -> N:
        """Main lens to microlens array (MLA) [mm]."""
        return self[PATHS["d_1"]]

    @property
    def d_2(self) -> N:
        """Microlens array to sensor [mm]."""
        return self[PATHS["d_2"]]

    @property
    def d_3(self) -> N:
        """Flexible angular plane (FAP) before the main lens [mm]."""
        return self[PATHS["d_3"]]

    @property
    def D_F(self) -> N:
        """FAP diameter [mm]; of a rectangle the wider of its extents along x and y."""
        raise NotImplementedError
