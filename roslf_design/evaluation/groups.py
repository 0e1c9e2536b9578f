"""Groups of an evaluation: frozen values whose names are the keys of the JSON, and their rows in tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ..camera import Camera
from ..lenses.solid import Solid
from ..theory.quantities import QUANTITIES
from ..words import decimals, fixed, length, number, place

FAR = 1e9
"""Lengths that are told as infinite: of what stands in a focus, rounding leaves some 1e13 [mm]."""


@dataclass(frozen=True)
class Numbers(Mapping[str, Any]):
    """Numbers of a group, by their names in the JSON; attributes too: ``result.sampling.view_baseline_mm``."""

    pairs: tuple[tuple[str, Any], ...]
    """Each with its name, in order."""

    @classmethod
    def of(cls, camera: Camera, group: str, first: Mapping[str, Any] | None = None, **own: Any) -> Numbers:
        """All quantities that are `evaluated` under a group.

        Parameters
        ----------
        camera : Camera
            One build.
        group : str
        first : mapping, optional
            Numbers that stand before them, quantities among them or not.
        **own : any
            Values that are known already, and others of the group, which follow.
        """
        numbers = dict(first or {})
        for quantity in QUANTITIES.values():
            if (listed := quantity.evaluated) is None or listed.under != group:
                continue
            key = listed.key or quantity.name
            if key not in numbers:
                numbers[key] = own.pop(key) if key in own else listed.value(quantity(camera))
        return cls((*numbers.items(), *own.items()))

    def __getitem__(self, name: str) -> Any:
        return dict(self.pairs)[name]

    def __iter__(self) -> Iterator[str]:
        return iter(dict(self.pairs))

    def __len__(self) -> int:
        return len(self.pairs)

    def __getattr__(self, name: str) -> Any:
        numbers = dict(self.__dict__.get("pairs", ()))  # not there yet while it is unpickled
        if name not in numbers:
            raise AttributeError(f"there is no {name} among {', '.join(numbers)}")
        return numbers[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]

    def __repr__(self) -> str:
        return f"Numbers({', '.join(f'{key}={value!r}' for key, value in self.pairs)})"


@dataclass(frozen=True)
class Share:
    """Share of the rays that fill the FAP which one element lets through."""

    name: str
    """"FAP", "main lens", "stop 1" (or its name) and so on; then "sensor", "own cell", "neighbours"."""
    kept: float
    """Share of the rays that fill the FAP: past this element and all that light met before it; on the sensor; inside
    the microlens's own cell there; in its neighbours'."""


@dataclass(frozen=True)
class RayBudget:
    """Fractions of the rays that fill the FAP, as seen by one microlens, past one element after the other."""

    fap: float
    main_lens: float
    stops: tuple[float, ...]
    """One entry for each of the design's further stops."""
    own_cell: float
    """On the sensor inside the microlens's own cell of one image pitch."""
    by_name: tuple[Share, ...] = ()
    """Every element in the order of light, then where on the sensor the rest lands."""

    def taken(self) -> tuple[tuple[str, float], ...]:
        """Share that each element takes, then where the rest lands: (name, share), which add to 1."""
        *met, own, neighbours = self.by_name
        past = [1.0, *(share.kept for share in met)]
        lost = [(share.name, before - share.kept) for share, before in zip(met, past, strict=False)]
        return (*lost, (own.name, own.kept), (neighbours.name, neighbours.kept))


@dataclass(frozen=True)
class Field:
    """Field of one microlens."""

    x_ml_mm: tuple[float, float]
    """Where it sits on the MLA, in the array's own frame."""
    status: str
    """"full", "clipped" or "dark"."""
    area_mm2: float
    """Area of its image."""
    kept_fraction: float
    """Area against the unclipped FAP disc."""
    lost_fraction: float
    """1 - kept_fraction, exact where it is tiny."""
    centroid_mm: tuple[float, float] | None
    """Centroid of its image, relative to the microlens axis; None where dark."""
    axis_ratio: float | None
    """Minor over major axis of the image's second moments; 1 for a disc."""
    ray_budget: RayBudget
    sigma_z_mm: float | None
    """Depth noise (bound) at the focal plane, as far as this image's own cut goes; None where nothing gives it."""
    u_z_mm: float | None
    """Depth, expected, there: with view mismatch, veil and temperature, without what lengths add all over the field."""
    rays: int | None
    """Rays that these numbers were counted from, where something is tilted; None for exact areas."""

    @property
    def cells(self) -> tuple[str, ...]:
        """Row of the table over the field."""
        return (
            place(self.x_ml_mm),
            self.status,
            f"{100 * self.kept_fraction:.4g} %",
            "-" if self.centroid_mm is None else " ".join(decimals(1e3 * v, 2, "+") for v in self.centroid_mm),
            "-" if self.axis_ratio is None else f"{self.axis_ratio:.4f}",
            f"{fixed(100 * self.ray_budget.own_cell, 2)} %",
        )


@dataclass(frozen=True)
class DepthAssumptions:
    """Light, texture and matching that a disparity error is predicted for."""

    electrons: float
    """In a pixel that its microlens lights fully, where the scene is as bright as on average, at the focal plane."""
    full_within_mm: float
    """Distance ahead of the tip nearer than which more than half of the field has no depth for full pixels, of a source
    there; of light as bright everywhere 0, or infinite where that is so at any distance."""
    exposure_s: float
    full_well: float
    """Electrons that a pixel holds."""
    light: str
    """Illuminance and reflectance of the scene, or its radiance, in words."""
    light_at_distances: str
    """Whether light is as bright at every distance, or falls from where, in words."""
    contrast: float
    """Rms, in each octave of detail or of the one period."""
    period_mm: float | None
    """Period of the texture; None has detail of every size."""
    finest_mm: float
    """Period of its finest detail in focus."""
    finest_microlenses: float | None
    """Microlenses that this has at every distance; None of detail that the design states, as fine at all of them."""
    gradient_per_pitch: float
    """Rms gradient that views show, after all blurs [contrast per microlens pitch]."""
    views: float
    """Independent ones in a microlens image, in its two directions."""
    window: float
    """Microlenses along each side of the square in which disparity is taken to be the same."""
    sigma_disparity_pitches: float

    @property
    def detail(self) -> str:
        """Detail that the texture has."""
        if self.period_mm is None:
            finest = length(self.finest_mm)
            if self.finest_microlenses is None:
                return f"in each octave of detail down to {finest}"
            down = f"{number(self.finest_microlenses, 3)} microlenses at every distance"
            return f"in each octave of detail down to {down} ({finest} in focus)"
        return f"with a period of {length(self.period_mm)}"

    def __str__(self) -> str:
        return (
            f"for {number(self.electrons, 4)} electrons a pixel in {number(1e3 * self.exposure_s, 3)} ms (full well "
            f"{number(self.full_well, 4)}; {self.light}, {self.light_at_distances}), a texture of "
            f"{100 * self.contrast:.3g} % rms contrast {self.detail}, and {self.window:g} x {self.window:g} "
            "microlenses matched"
        )

    @property
    def facts(self) -> list[tuple[str, str, str]]:
        """Name, value, remark."""
        lenses, exposure = f"{self.window:g} x {self.window:g}", f"in {number(1e3 * self.exposure_s, 3)} ms"
        spread = self.light_at_distances
        if 0 < self.full_within_mm < math.inf:
            nearer = f"nearer than {number(self.full_within_mm, 3)} mm most of the field is lost to full pixels"
            spread = f"in focus; {spread}: {nearer}"
        return [
            ("light", f"{number(self.electrons, 4)} e- a pixel", f"{exposure}, {spread}"),
            ("light, on the scene", self.light, f"full well {number(self.full_well, 4)} e-"),
            ("texture, rms contrast", f"{self.contrast:.3g}", self.detail),
            ("microlenses matched", lenses, f"of {self.views:.0f} independent views"),
        ]


@dataclass(frozen=True)
class Verdict:
    """One question an engineer asks first, and its answer."""

    name: str
    ok: bool
    """Whether nothing needs mending; of what the file requires whether it is met, with a reservation or without."""
    level: str
    """"good", "limit" (to be known: nature's, or of what the figure counts) or "fault"."""
    text: str
    """The answer with its margin."""
    remedy: str
    """Remedy in a sentence; empty where nothing needs mending."""

    @classmethod
    def of(cls, name: str, text: str, remedy: str = "") -> Verdict:
        """Answer that is good where there is nothing to mend."""
        return cls(name, not remedy, "fault" if remedy else "good", text, remedy)


@dataclass(frozen=True)
class RealLensField:
    """One microlens behind the real lens; None where there is no light to tell it by."""

    x_ml_mm: tuple[float, float]
    """Where it sits on the MLA, in the array's own frame."""
    status: str
    """"full", "clipped", "dark", or "folded": two sensor points see the same FAP point, a caustic of the pupil."""
    chief_ray: str
    """Fate of the ray through the FAP's centre: "kept", "missed surface 1", "clipped at stop 1"."""
    kept_fraction: float
    """Part of the FAP that the microlens sees."""
    centre_mm: tuple[float, float] | None
    """Image of the FAP's centre, relative to the microlens axis."""
    diameter_mm: float | None
    """Diameter of the disc with the area of the FAP's image; of its lit part where folded."""
    axis_ratio: float | None
    """Minor over major axis of the lit part's second moments."""
    shift_px: tuple[float, float] | None
    """Image centre against the thin lens's."""
    widening_px: float | None
    """Diameter against the thin lens's."""
    widening_percent: float | None
    tangential_focus_mm: float | None
    """Where pencils in the meridional plane focus, behind the array; negative before it."""
    sagittal_focus_mm: float | None
    """Distance of the sagittal focus, likewise."""
    tangential_focus_pitches: float | None
    """The blur on the array that comes of it [microlens pitches], signed like the focus."""
    sagittal_focus_pitches: float | None
    blur_pitches: float | None
    """Root-mean-square radius on the array of an object point's light."""
    distortion_percent: float | None
    """Image height on the array against first order."""
    lateral_colour_pitches: float | None
    """Between the F and the C line, on the array; None outside the glasses' range."""

    @property
    def cells(self) -> tuple[str, ...]:
        """Row of the table through the real lens."""
        return (
            place(self.x_ml_mm),
            self.status if self.chief_ray == "kept" else f"{self.status} ({self.chief_ray})",
            f"{100 * self.kept_fraction:.4g} %",
            "-" if self.shift_px is None else " ".join(decimals(value, 2, "+") for value in self.shift_px),
            decimals(self.widening_percent, 1),
            f"{decimals(self.tangential_focus_pitches, 1, '+')} {decimals(self.sagittal_focus_pitches, 1, '+')}",
            decimals(self.distortion_percent, 2, "+"),
            decimals(self.lateral_colour_pitches, 2),
        )


@dataclass(frozen=True)
class RealLens:
    """The traced lens. The rest of the evaluation is its thin-lens model: same focal length and clear diameter."""

    lens: str
    """Its name, "reversed" where it stands the other way round."""
    focal_length_mm: float
    back_focal_length_mm: float
    front_principal_mm: float
    """Object-side principal plane behind the first vertex: what d_f and d_3 count from."""
    rear_principal_mm: float
    """Image-side principal plane behind the first vertex: what d_1 counts from."""
    first_vertex_to_fap_mm: float
    """Mechanical distance from the first vertex to the FAP."""
    last_vertex_to_mla_mm: float
    """Mechanical distance from the last vertex to the MLA."""
    x0_max_mm: float
    """Undistorted object radius, measured: as far as microlenses see the whole FAP."""
    x_ml_max_mm: float
    """Largest undistorted radius on the MLA."""
    thin_x_ml_max_mm: float
    """Eq. 6's, for the thin-lens model; infinite where no field is too large."""
    turned_x_ml_max_mm: float | None
    """Measured bound with the lens reversed; None where the field is undistorted anyhow, or parts would collide."""
    undistorted_in_field: bool
    """Whether images are whole, and not folded, at every field reported here and at the four corners."""
    fields: tuple[RealLensField, ...]
    folded_beyond_mm: float | None = None
    """Radius on the MLA, along x, beyond which images fold before anything cuts them; None where none does."""
    cut_by: tuple[dict[str, Any], ...] = ()
    """Openings as in `non_distortion`, so much too narrow that images are whole by rays once that is mended; none where
    all are, or that does not mend it."""

    @property
    def facts(self) -> list[tuple[str, str, str]]:
        """Name, value, remark."""
        thin = f"on the MLA; thin lens, Eq. 6: {number(self.thin_x_ml_max_mm)} mm"
        ruler = "mechanical" if self.first_vertex_to_fap_mm >= 0 else "seen through the lens"
        focal = f"{number(self.focal_length_mm)} mm", f"back focal {number(self.back_focal_length_mm)} mm"
        return [
            ("lens", self.lens, ""),
            ("focal length", *focal),
            ("first vertex to the FAP", f"{number(self.first_vertex_to_fap_mm)} mm", f"{ruler}; d_3 is to H"),
            ("last vertex to the MLA", f"{number(self.last_vertex_to_mla_mm)} mm", "mechanical; d_1 is from H'"),
            ("undistorted, measured", f"{number(self.x_ml_max_mm)} mm", thin),
        ]


@dataclass(frozen=True)
class SeenPart:
    """Something that light passes, with a ruler and as the main lens sees it: through what stands between, as in air.

    Distances are those before the main lens; of the MLA that behind it, of the sensor that behind the MLA. All
    are those at 20 degrees C, as drawings have them.
    """

    name: str
    what: str
    """Size and material."""
    distance_mm: float
    """Mechanical; of an element its sensor-side vertex."""
    diameter_mm: float | None
    """Diameter of an opening, or of an element."""
    seen_distance_mm: float
    """Infinite where it is seen there."""
    seen_diameter_mm: float | None
    sides_mm: tuple[float, ...] | None = None
    """Sides of a rectangular opening."""

    @property
    def cells(self) -> tuple[str, ...]:
        """Row of the table of what is beside the main lens; how it is seen as far as that differs."""
        pairs = (("", self.distance_mm, self.seen_distance_mm), ("diameter ", self.diameter_mm, self.seen_diameter_mm))
        apart = [
            f"{name}{number(apparent)} mm" if abs(apparent) < FAR else f"{name}∞"
            for name, own, apparent in pairs
            if own is not None and apparent is not None and not math.isclose(own, apparent, rel_tol=1e-6)
        ]
        across = "" if self.diameter_mm is None else f"{number(self.diameter_mm)} mm"
        if self.sides_mm is not None:
            across = f"{' x '.join(map(number, self.sides_mm))} mm"
        return self.name, self.what, f"{number(self.distance_mm)} mm", across, ", ".join(apart)


@dataclass(frozen=True)
class MappedField:
    """Effects of an objective's mapping on one field, along its chief ray."""

    x_ml_mm: tuple[float, float]
    """The microlens, on the array [mm]."""
    angle_deg: float
    """From the axis, in the medium of the scene; where nothing is imaged, the largest that is."""
    distortion_percent: float
    """Image height against f tan of the angle in air."""
    object_sample_mm: tuple[float, float]
    """Footprint of a microlens on the focal plane, along the field's radius and across it."""
    sigma_z_mm: tuple[float, float]
    """Depth noise (bound) there, of views set apart along and across."""

    @property
    def cells(self) -> tuple[str, ...]:
        """Row of the table over the field."""
        pairs = [" ".join(map(number, pair)) for pair in (self.object_sample_mm, self.sigma_z_mm)]
        return place(self.x_ml_mm), f"{self.angle_deg:.2f}", fixed(self.distortion_percent, 1, "+"), *pairs


@dataclass(frozen=True)
class ObjectiveMapping:
    """How an objective takes angles to image heights, where it is not f tan."""

    mapping: str
    element: str
    """Element that maps angles."""
    largest_angle_deg: float
    """Largest angle that it images, in air."""
    fields: tuple[MappedField, ...]

    def __str__(self) -> str:
        name = "a measured table" if self.mapping == "table" else self.mapping
        return f"{self.element}, images by {name} up to {self.largest_angle_deg:.4g} degrees in air"


@dataclass(frozen=True)
class LookedThrough:
    """Media and parts that light meets beside the main lens: liquid, elements, glass about the array."""

    medium: str
    """Medium that the scene lies in."""
    index: float
    """Index of that medium, at the design's wavelength."""
    parts: tuple[SeenPart, ...]
    """Parts in the order of light, from the focal plane on."""
    mapping: ObjectiveMapping | None = None
    """Mapping of the objective; None of f tan."""

    @property
    def around(self) -> str:
        """Medium of the scene, as a sentence."""
        return f"The scene lies in {self.medium}" + ("." if self.index == 1 else f", index {self.index:.5g}.")


@dataclass(frozen=True)
class AtTemperature:
    """The camera at one temperature, left as it was focused."""

    temperature_degc: float
    """[degrees C]."""
    focal_length_mm: float
    """f."""
    mla_distance_mm: float
    """d_1, a mechanical distance."""
    focal_plane_mm: float
    """d_f: where it is then in focus, a mechanical distance; infinite where it is nowhere."""
    focus_shift_pitches: float | None
    """Disparity between the FAP's rims of what was in focus; None where it is no camera any more."""
    fill_factor: float
    """Microlens-image diameter over pitch."""
    fits: bool
    """Whether it is a camera still: a real image, no part in another."""

    def cells(self, here: float) -> tuple[str, ...]:
        """Row of the table of temperatures, `here` that of all other numbers."""
        return (
            f"{self.temperature_degc:g} °C" + (" (here)" if self.temperature_degc == here else ""),
            f"{self.focal_length_mm:.7g} mm",
            f"{self.mla_distance_mm:.7g} mm",
            f"{self.focal_plane_mm:.6g} mm",
            decimals(self.focus_shift_pitches, 3, "+"),
            f"{self.fill_factor:.5f}",
            "yes" if self.fits else "no",
        )


@dataclass(frozen=True)
class Temperatures:
    """Effects of temperature on the camera."""

    temperature_degc: float
    """Temperature of every other number of the evaluation."""
    housing: str
    """Housing that spaces the parts; empty where it does not grow."""
    expansion_per_k: float
    """Expansion of the housing."""
    at: tuple[AtTemperature, ...]
    """20 degrees C, the camera's own, the ends of its range, and where it is calibrated."""
    index_not_known: tuple[str, ...]
    """Materials whose index is taken not to change."""
    not_named: tuple[str, ...]
    """Parts that do not change, because nothing says what they are made of."""
    housing_grade: str = ""
    """Grade that the housing's name, which stands for several, is taken for; empty where it names one."""
    tube: str = ""
    """Material of the tube in words, where it is not the housing's."""

    @property
    def held(self) -> str:
        """Housing in words."""
        tube = f", tube of {self.tube}" * bool(self.tube)
        if not self.housing:
            return f"rigid housing{tube}"
        return f"housing of {Solid(self.housing, self.expansion_per_k, grade=self.housing_grade).words}{tube}"
