"""The main lens as it stands in the camera: ideal and thin, or a real one. Both answer the same questions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, Problem
from ..lenses.glass import Glass
from ..lenses.manufacture import lens_places, lens_values
from ..lenses.prescription import Prescription, Surface, first_order, lens_growth, warm_constants
from ..units import format_quantity
from .conjugates import CONJUGATES
from .export import SequenceRow, lens_surfaces
from .lens import power_ratio
from .lens_sheet import LensSheet
from .part import Number
from .real_lens import focal_length_at, mounted_lens

FOCAL, DIAMETER = CONJUGATES[0], "main_lens.diameter"
HIATUS = "hiatus"
"""Place, beside those of a design, of the distance between a real lens's principal planes, H to H' [mm]."""
AGREEMENT = 1e-6
"""Relative difference from the lens's own numbers, beyond which others contradict them."""
NEAR_SHEET = 0.1
"""Share of the focal length by which a number of the design may differ from a sheet's: as measured, or as made."""
Conjugate = Literal["f", "d_1", "d_f"]
ThinDesign = TypeVar("ThinDesign", bound=Any)


class MainLensKind:
    """Main lens of a camera."""

    name: str = ""
    """Name of the product or file; empty of an ideal lens."""
    words: str = "ideal"
    """Which lens it is, in a few words."""
    lens: Prescription | None = None
    """Its surfaces as they stand in the camera."""
    radial: ClassVar[int] = 0
    """Coefficients of radial distortion that a calibration fits behind it."""
    images_stops: ClassVar[bool] = True
    """Whether a stop behind it is seen through it as first order has it."""
    faults: ClassVar[tuple[str, ...]] = ()
    """Effects of a rendering that are its own."""
    looks_through: ClassVar[tuple[str, ...]] = ()
    """Words for it where rays through it are not what first order says."""
    open_conjugates: ClassVar[tuple[Conjugate, ...]] = ("f", "d_1", "d_f")
    """Which of f, d_1 and d_f can follow from the others."""
    kept_conjugates: ClassVar[tuple[Conjugate, ...]] = open_conjugates
    """Which of them a change of something else can leave as they are."""
    follows: ClassVar[frozenset[str]] = frozenset()
    """Places whose numbers follow from what it is made of."""
    parts: ClassVar[tuple[str, ...]] = ()
    """Kinds of a catalogue that are parts of it."""
    told_to: float = math.inf
    """Slope to first order up to which its data sheet states the field."""
    untold: str = ""
    """Sentence on what of it is not known, and which numbers are ideal therefore."""
    gap: float = 0.0
    """Distance between its principal planes, as far as distances count it [mm]."""
    front: float = 0.0
    """Front vertex before its principal plane, as far as that is stated [mm]."""

    @property
    def grows(self) -> bool:
        """True where it is known what temperature does to it."""
        raise NotImplementedError

    @property
    def glasses(self) -> tuple[tuple[str, Glass | None], ...]:
        """Every material of it by its key."""
        raise NotImplementedError

    @property
    def prescribed(self) -> tuple[Prescription, ...]:
        """Prescription as in the design file."""
        return ()

    @property
    def mounted(self) -> tuple[Prescription, ...]:
        """Prescription as it stands in the camera."""
        return ()

    @property
    def semi_diameters(self) -> tuple[float, ...]:
        """Half of each surface's clear diameter [mm]."""
        return tuple(surface.semi_diameter for lens in self.mounted for surface in lens.surfaces)

    @property
    def places(self) -> Mapping[str, str]:
        """Places in which it can be made otherwise, to what they measure."""
        return {}

    def values(self, wavelength: float) -> Mapping[str, float]:
        """Its own numbers at those places."""
        return {}

    def given(self, place: str, value: float | None, wavelength: float) -> float | None:
        """The number at a place where a design gives `value`, or the lens's own [mm]."""
        return value

    def with_pupil(self, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """A FAP as a file gives it, with what of it the lens tells."""
        return given

    def about_pupil(self, fap: Any) -> str:
        """Contradiction of its pupil and the FAP of a design; empty without one."""
        return ""

    def about(self, values: Mapping[str, float | None], turned: bool, wavelength: float | None) -> Iterator[Problem]:
        """Values of a design that contradict it; a wavelength that could not be read is None."""
        raise NotImplementedError

    def settled(self, values: Mapping[str, float | None], wavelength: float | None) -> Mapping[str, float | None]:
        """Values of a design with its own in place of others; without a wavelength these are not known."""
        return values

    def in_light(self, wavelength: ArrayLike) -> dict[str, ArrayLike]:
        """Numbers of a camera that change with the wavelength [mm], by their places."""
        return {}

    def moved(
        self, numbers: Mapping[str, Number], before: Number, after: Number, wavelength: Number, housing: float
    ) -> dict[str, Number]:
        """Focal length at another temperature [degrees C], by its place, where that changes it."""
        raise NotImplementedError

    def wider(self, before: Number, after: Number, housing: float, held: Number) -> Number:
        """Clear diameter after over before; `held` is how much a housing of expansion `housing` [1/K] grows."""
        raise NotImplementedError

    def principal_shifts(
        self, wavelength: Number, before: Number, after: Number, housing: float
    ) -> tuple[tuple[Number, Number], tuple[Number, Number, Number]]:
        """Where its principal planes stand, before and after [mm].

        The front one behind the first vertex, the rear one before the last; then by how much less the rear one stands
        behind the first.
        """
        return (0.0, 0.0), (0.0, 0.0, 0.0)

    def planes(self, wavelength: float) -> tuple[float, float]:
        """Front and rear principal plane, along z from the first vertex [mm]."""
        return 0.0, 0.0

    def hiatus(self, wavelength: float) -> float:
        """Distance from H to H', below 0 where they stand crossed [mm]."""
        front, rear = self.planes(wavelength)
        return self.gap + (rear - front)

    def rows(self, focal_length: float, diameter: float) -> list[SequenceRow]:
        """Surfaces as other programs take them."""
        raise NotImplementedError

    def thin_twin(self, design: ThinDesign) -> ThinDesign:
        """A design of it with an ideal lens of the same focal length and clear aperture."""
        return design

    def replaced_by(self, other: MainLensKind) -> bool:
        """Whether another lens can stand in its place, told as exactly."""
        return True

    def replacement(
        self, other: MainLensKind, wavelength: float, temperature: float | None = None, housing: float = 0.0
    ) -> dict[str, Any]:
        """Place to what another lens in its place has beside focal length and diameter.

        Warmed to a temperature [degrees C] in a housing of an expansion [1/K], where one is given.
        """
        return {}


@dataclass(frozen=True)
class IdealMainLens(MainLensKind):
    """A thin lens without aberrations."""

    material: Glass | None = None
    """Material, as far as temperature goes."""

    @property
    def grows(self) -> bool:
        """Whether its material is known."""
        return self.material is not None

    @property
    def glasses(self) -> tuple[tuple[str, Glass | None], ...]:
        """Its material."""
        return (("material", self.material),)

    def about(self, values: Mapping[str, float | None], turned: bool, wavelength: float | None) -> Iterator[Problem]:
        """Being turned round, which says nothing."""
        if turned:
            message = "an ideal lens looks the same from both sides; drop it, or give main_lens.prescription"
            yield Problem("main_lens.reversed", message)

    def moved(
        self, numbers: Mapping[str, Number], before: Number, after: Number, wavelength: Number, housing: float
    ) -> dict[str, Number]:
        """Focal length, which grows with the glass and with what its index loses."""
        if self.material is None:
            return {}
        weaker = power_ratio(self.material, wavelength, before, after)
        return {FOCAL: numbers[FOCAL] * self.material.grown(before, after) * weaker}

    def wider(self, before: Number, after: Number, housing: float, held: Number) -> Number:
        """Growth of its material, or of what holds it."""
        return held if self.material is None else self.material.grown(before, after)

    def rows(self, focal_length: float, diameter: float) -> list[SequenceRow]:
        """A paraxial surface, which stands for both principal planes."""
        name = f"main lens (H and H' together, {self.gap:.6g} mm apart)" if self.gap else "main lens"
        return [SequenceRow(name, 0.0, Surface(0.0, diameter / 2), focal_length)]


@dataclass(frozen=True)
class SheetMainLens(IdealMainLens):
    """A bought lens by its data sheet: ideal in what that does not tell."""

    sheet: LensSheet = field(kw_only=True)
    """Its numbers."""

    open_conjugates: ClassVar[tuple[Conjugate, ...]] = ("d_1", "d_f")
    kept_conjugates: ClassVar[tuple[Conjugate, ...]] = open_conjugates

    @property
    def untold(self) -> str:  # type: ignore[override]
        """Sentence on what no sheet tells, and what this one does not."""
        left = "" if "distortion" in self.sheet.over_field else ", distortion"
        left += "" if "relative_illumination" in self.sheet.over_field else ", light over the field (cos^4 is taken)"
        return (
            f"The main lens, {self.name}, is known by its data sheet. It does not state aberrations, field curvature, "
            f"colour, what barrels cut (nothing, where no clear aperture is given){left}: sharpness, MTF, spots, depth "
            "noise and shapes of microlens images are those of an ideal lens with its focal length and pupil."
        )

    name = property(lambda self: self.sheet.name or "a bought lens")
    told_to = property(lambda self: self.sheet.reach)
    gap = property(lambda self: self.sheet.gap)
    front = property(lambda self: max(0.0, float(self.sheet.front_principal)))

    def given(self, place: str, value: float | None, wavelength: float) -> float | None:
        """The sheet's focal length where none is given; diameter of its pupil, where that stands elsewhere."""
        if value is not None or place not in (FOCAL, DIAMETER):
            return value
        if place == FOCAL:
            return self.sheet.focal_length
        return None if "distance" in self.sheet.pupil else self.sheet.pupil["diameter"]

    def with_pupil(self, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """The pupil of the sheet, where that tells its place and no other is given."""
        told = {key: f"{size!r} mm" for key, size in self.sheet.pupil.items()}
        if "distance" not in told or given.get("behind") is not None:
            return given
        told = told if given.get("shape", "circle") == "circle" else {"distance": told["distance"]}
        return {**told, **{key: value for key, value in given.items() if value is not None}}

    def about_pupil(self, fap: Any) -> str:
        """Another place than the sheet's, or a wider opening."""
        pupil, f = {"diameter": math.inf, **self.sheet.pupil}, self.sheet.focal_length
        if "distance" not in pupil:
            return ""
        grown = 1.0 if fap.behind is None else abs(f / ((f - fap.behind) or math.inf))
        if abs(fap.stands * grown - pupil["distance"]) > NEAR_SHEET * f:
            own, told = (format_quantity(float(at), "length", 6) for at in (fap.stands * grown, pupil["distance"]))
            return (
                f"a FAP {own} before the lens contradicts the sheet, whose pupil is seen at {told}; drop distance, or "
                "entrance_pupil and exit_pupil of the sheet where an opening of the bore is the FAP"
            )
        if 2 * fap.outline.reach * grown > pupil["diameter"] * (1 + NEAR_SHEET):
            most = format_quantity(pupil["diameter"], "length", 6)
            return f"{fap.outline.size} is wider than the sheet's pupil of {most}; drop it, or stop the lens down"
        return ""

    def about(self, values: Mapping[str, float | None], turned: bool, wavelength: float | None) -> Iterator[Problem]:
        """Being turned round; a focal length that is another lens's."""
        if turned:
            message = "a data sheet states one orientation; drop it, or give the sheet's numbers from the other side"
            yield Problem("main_lens.reversed", message)
        f, given = self.sheet.focal_length, values.get(FOCAL)
        if given is not None and abs(given / f - 1) > NEAR_SHEET:
            told, own = (format_quantity(value, "length", 8) for value in (given, f))
            message = f"{told} contradicts the sheet's focal_length = {own}; drop {FOCAL}, or mend the sheet"
            yield Problem(FOCAL, message)

    def settled(self, values: Mapping[str, float | None], wavelength: float | None) -> Mapping[str, float | None]:
        """Values with its own focal length where none is given."""
        return values if values.get(FOCAL) is not None else {**values, FOCAL: self.sheet.focal_length}

    def replaced_by(self, other: MainLensKind) -> bool:
        """False: no catalogue tells of another what this one's sheet does."""
        return False


@dataclass(frozen=True)
class RealMainLens(MainLensKind):
    """A lens by its surfaces."""

    prescription: Prescription
    """As in the design file."""
    turned: bool = False
    """Whether it stands the other way round."""
    diameter: float | None = None
    """Clear diameter that it is cut down to [mm]."""

    radial: ClassVar[int] = 1
    images_stops: ClassVar[bool] = False
    faults: ClassVar[tuple[str, ...]] = ("lens_aberrations", "lens_distortion", "field_curvature", "lens_colour")
    looks_through: ClassVar[tuple[str, ...]] = ("the real lens",)
    open_conjugates: ClassVar[tuple[Conjugate, ...]] = ("d_1", "d_f")
    kept_conjugates: ClassVar[tuple[Conjugate, ...]] = ()
    follows: ClassVar[frozenset[str]] = frozenset({FOCAL})
    parts: ClassVar[tuple[str, ...]] = ("glasses", "orientations")

    @property
    def lens(self) -> Prescription:  # type: ignore[override]
        """Its surfaces, turned round and cut down."""
        return mounted_lens(self.prescription, self.turned, self.diameter)

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name of the lens as it stands."""
        return self.lens.name or "a real lens"

    @property
    def words(self) -> str:  # type: ignore[override]
        """Description: real, and its name."""
        return f"real ({self.name})"

    @property
    def grows(self) -> bool:
        """True: its glasses are known."""
        return True

    @property
    def glasses(self) -> tuple[tuple[str, Glass | None], ...]:
        """Glass of each surface."""
        return tuple(("prescription", surface.glass) for surface in self.prescription.surfaces)

    @property
    def prescribed(self) -> tuple[Prescription, ...]:
        """Its own."""
        return (self.prescription,)

    @property
    def mounted(self) -> tuple[Prescription, ...]:
        """Its surfaces, turned round and cut down."""
        return (self.lens,)

    @property
    def places(self) -> Mapping[str, str]:
        """Places of its surfaces and elements."""
        return lens_places(self.lens)

    def values(self, wavelength: float) -> Mapping[str, float]:
        """Numbers of its surfaces and elements."""
        return lens_values(self.lens, wavelength)

    def given(self, place: str, value: float | None, wavelength: float) -> float | None:
        """Focal length of its own, and clear diameter where none is given."""
        if place == FOCAL:
            return focal_length_at(self.prescription, wavelength)
        return self.prescription.clear_diameter if place == DIAMETER and value is None else value

    def about(self, values: Mapping[str, float | None], turned: bool, wavelength: float | None) -> Iterator[Problem]:
        """Focal length, diameter and wavelength, where they are not the lens's own."""
        if wavelength is None:
            return
        name = self.prescription.name
        try:
            focal = focal_length_at(self.prescription, wavelength)
        except InputError as error:
            for problem in error.problems:
                yield Problem("light.wavelength", f"{name}: {problem.message}")
            return
        focal_length, diameter = values.get(FOCAL), values.get(DIAMETER)
        if not (0 < focal < math.inf):
            yield Problem("main_lens.prescription", f"{name} does not converge light; it forms no real image")
        elif focal_length is not None and abs(focal_length / focal - 1) > AGREEMENT:
            told, at = (format_quantity(value, "length", 8) for value in (focal_length, wavelength))
            yield Problem(
                FOCAL,
                f"{told} contradicts the prescription: {name} has f = {focal:.7g} mm at {at} "
                f"(residual {focal_length - focal:+.4g} mm); drop {FOCAL}",
            )
        widest = self.prescription.clear_diameter
        if diameter is not None and diameter > widest * (1 + AGREEMENT):
            yield Problem(
                DIAMETER,
                f"{format_quantity(diameter, 'length', 8)} is wider than {name}, whose clear diameter is "
                f"{widest:.6g} mm; drop it, or give a smaller one for a stop at the lens",
            )

    def settled(self, values: Mapping[str, float | None], wavelength: float | None) -> Mapping[str, float | None]:
        """Values with its own focal length."""
        others = {place: value for place, value in values.items() if place != FOCAL}
        return others if wavelength is None else {**others, FOCAL: focal_length_at(self.prescription, wavelength)}

    def in_light(self, wavelength: ArrayLike) -> dict[str, ArrayLike]:
        """Focal length at each wavelength."""
        return {FOCAL: np.vectorize(lambda each: focal_length_at(self.lens, each), otypes=[np.float64])(wavelength)}

    def moved(
        self, numbers: Mapping[str, Number], before: Number, after: Number, wavelength: Number, housing: float
    ) -> dict[str, Number]:
        """Focal length, of a build as much longer as that of the surfaces."""
        was, becomes = (warm_constants(self.lens, wavelength, at, housing).focal_length for at in (before, after))
        return {FOCAL: numbers[FOCAL] * (becomes / was)}

    def wider(self, before: Number, after: Number, housing: float, held: Number) -> Number:
        """Growth of its narrowest surface."""
        k = min(range(len(self.lens.surfaces)), key=lambda k: self.lens.surfaces[k].semi_diameter)
        old, new = (lens_growth(self.lens, at, housing)[k][0] for at in (before, after))
        return new / old

    def principal_shifts(
        self, wavelength: Number, before: Number, after: Number, housing: float
    ) -> tuple[tuple[Number, Number], tuple[Number, Number, Number]]:
        """Both planes at both temperatures."""
        a, b = (warm_constants(self.lens, wavelength, at, housing) for at in (before, after))
        rear = a.length - a.rear_principal, b.length - b.rear_principal
        return (a.front_principal, b.front_principal), (*rear, a.rear_principal - b.rear_principal)

    def planes(self, wavelength: float) -> tuple[float, float]:
        """Both planes."""
        constants = first_order(self.lens, wavelength)
        return constants.front_principal, constants.rear_principal

    def rows(self, focal_length: float, diameter: float) -> list[SequenceRow]:
        """Each surface."""
        return lens_surfaces("main lens", self.lens, 0.0)

    def thin_twin(self, design: ThinDesign) -> ThinDesign:
        """Focal length at the design's wavelength and clear diameter, as those of an ideal lens."""
        ideal = {"prescription": None, "reversed": False, "focal_length": design.f, "diameter": design.D}
        twin: ThinDesign = design.model_copy(update={"main_lens": design.main_lens.model_copy(update=ideal)})
        return twin

    def replaced_by(self, other: MainLensKind) -> bool:
        """Whether the other's surfaces are known."""
        return bool(other.prescribed)

    def replacement(
        self, other: MainLensKind, wavelength: float, temperature: float | None = None, housing: float = 0.0
    ) -> dict[str, Any]:
        """The other's surfaces, and the focal length that these have."""
        (lens,) = other.prescribed
        warm = lens if temperature is None else lens.warmed(temperature, housing)
        return {"main_lens.prescription": lens, FOCAL: focal_length_at(warm, wavelength)}


def main_lens_kind(
    prescription: Prescription | None, turned: bool, diameter: float | None = None, material: Glass | None = None
) -> MainLensKind:
    """Main lens that a design file describes."""
    return IdealMainLens(material) if prescription is None else RealMainLens(prescription, turned, diameter)
