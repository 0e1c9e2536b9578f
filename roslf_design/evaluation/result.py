"""Evaluation of a design: frozen values whose names are the keys of the JSON, ready for a terminal or a notebook."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..effects.plan import PlannedEffect
from ..json_data import plain
from .show import as_html, as_text

SCHEMA = "roslf.evaluation/1"


@dataclass(frozen=True)
class ExitPupil:
    """The image of the FAP by the main lens."""

    distance_from_lens_mm: float
    """z_x = f d_3/(d_3 - f), positive beyond the lens; infinite where telecentric."""
    vergence_at_mla_per_mm: float
    """1/L, its finite twin."""
    diameter_mm: float
    """Infinite where telecentric."""
    telecentric: bool
    """Whether d_3 = f to rounding."""


@dataclass(frozen=True)
class FNumber:
    """Whether microlens images fill their cells."""

    microlens: float
    """d_2/d."""
    pupil: float
    """d_1/(D_F H), Eq. 8."""
    main_lens: float
    """d_1/D, Eq. 9."""
    fill_factor: float
    """Microlens-image diameter over pitch, exact (Eq. 7)."""
    mismatch_px: float
    """Diameter less pitch [px]: overlap where positive, gap where negative."""


@dataclass(frozen=True)
class NonDistortion:
    """Where microlens images are full discs (Eqs. 5-6); every length is a half-field."""

    x0_max_mm: float
    """Largest undistorted object radius at d_f; infinite where no field is too large."""
    x_ml_max_mm: float
    """Largest undistorted radius on the MLA."""
    room_at_corner_mm: float
    """Room between the corner field's pencil and the nearest rim, on that rim's plane: the finite twin."""
    limited_by: str
    """Which element's rim that is."""
    field_half_width_mm: float
    """Half the object field that the sensor sees, along x."""
    field_half_diagonal_mm: float
    """To its corner."""
    undistorted_in_field: bool
    """Whether the whole sensor sees full discs."""


@dataclass(frozen=True)
class MicrolensImage:
    """Size and place of undistorted microlens images."""

    diameter_mm: float
    """D_F H d_2/d_1."""
    diameter_px: float
    pitch_mm: float
    """d (1 + d_2/L)."""
    centre_shift_px_per_microlens: float
    """Against the traditional light field (Eq. 4)."""


@dataclass(frozen=True)
class Share:
    """Share of the rays that fill the FAP which one element lets through."""

    name: str
    """"FAP", "main lens", "stop 1" and so on; then "sensor", "own cell", "neighbours"."""
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
        *stops, sensor, own, neighbours = self.by_name
        past = [1.0, *(share.kept for share in stops), sensor.kept]
        lost = [
            (share.name, before - after)
            for share, before, after in zip((*stops, sensor), past[:-1], past[1:], strict=True)
        ]
        return (*lost, (own.name, own.kept), (neighbours.name, neighbours.kept))


@dataclass(frozen=True)
class Field:
    """One microlens."""

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
    """Standard error of depth at the focal plane, as far as this image's own cut goes; None where nothing tells it."""
    rays: int | None
    """Rays that these numbers were counted from, where something is tilted; None for exact areas."""


@dataclass(frozen=True)
class Sampling:
    """How finely space and angle are sampled."""

    views_geometric: float
    """Pixels across a microlens image."""
    views_independent: float
    """4 N_F: what diffraction leaves of them, per axis."""
    lateral_samples: int
    """Whole microlenses across the width that the sensor sees."""
    object_sample_mm: float
    """d d_f/d_1."""
    view_baseline_mm: float
    """q d_1/(H d_2), on the FAP."""


@dataclass(frozen=True)
class DepthAssumptions:
    """Light, texture and matching that a disparity error is predicted for."""

    electrons: float
    """In a pixel that its microlens lights fully, where the scene is as bright as on average."""
    exposure_s: float
    contrast: float
    """Rms, in each octave of detail or of the one period."""
    period_mm: float | None
    """Period of the texture; None has detail of every size."""
    gradient_per_pitch: float
    """Rms gradient that views show, after all blurs [contrast per microlens pitch]."""
    views: float
    """Independent ones in a microlens image, in its two directions."""
    window: float
    """Microlenses along each side of the square in which disparity is taken to be the same."""
    sigma_disparity_pitches: float


@dataclass(frozen=True)
class Depth:
    """Depth precision at the focal plane."""

    disparity_pitches_per_mm: float
    sigma_z_mm: float
    """On the axis; infinite where neither light nor texture tells anything."""
    sigma_disparity_pitches: float
    """The disparity error that sigma_z comes of."""
    assumes: DepthAssumptions | None
    """Assumptions behind the disparity error; None where the design gives it."""


@dataclass(frozen=True)
class Diffraction:
    """Diffraction at one microlens."""

    fresnel_number: float
    """N_F = d^2/(4 lambda d_2)."""
    airy_radius_px: float


@dataclass(frozen=True)
class Verdict:
    """One question an engineer asks first, and its answer."""

    name: str
    ok: bool
    level: str
    """"good", "limit" (nature's, to be known rather than mended) or "fault"."""
    text: str
    """The answer with its margin."""
    remedy: str
    """Remedy in a sentence; empty where nothing needs mending."""


@dataclass(frozen=True)
class RealLensField:
    """One microlens behind the real lens; None where there is no light to tell it by."""

    x_ml_mm: tuple[float, float]
    """Where it sits on the MLA, in the array's own frame."""
    status: str
    """"full", "clipped", "dark", or "folded": two sensor points see the same FAP point, a caustic of the pupil."""
    chief_ray: str
    """Fate of the ray through the FAP's centre: "kept", "missed surface 1"."""
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


@dataclass(frozen=True)
class RealLens:
    """The traced lens. The rest of the evaluation is its thin twin: same focal length and clear diameter."""

    lens: str
    """Its name, "reversed" where it stands the other way round."""
    focal_length_mm: float
    back_focal_length_mm: float
    front_principal_mm: float
    """Object-side principal plane behind the first vertex: what d_f and d_3 count from."""
    rear_principal_mm: float
    """Image-side principal plane behind the first vertex: what d_1 counts from."""
    first_vertex_to_fap_mm: float
    """For a ruler: first vertex to the FAP."""
    last_vertex_to_mla_mm: float
    """For a ruler: last vertex to the MLA."""
    x0_max_mm: float
    """Undistorted object radius, measured: as far as microlenses see the whole FAP."""
    x_ml_max_mm: float
    """Largest undistorted radius on the MLA."""
    thin_x_ml_max_mm: float
    """Eq. 6's, for the thin twin; infinite where no field is too large."""
    turned_x_ml_max_mm: float | None
    """Measured bound with the lens turned round; None where the field is undistorted anyhow, or parts would collide."""
    undistorted_in_field: bool
    """Whether images are whole, and not folded, at every field told here and at the four corners."""
    fields: tuple[RealLensField, ...]


@dataclass(frozen=True)
class SeenPart:
    """Something that light passes, with a ruler and as the main lens sees it: through what stands between, as in air.

    Distances are those before the main lens; of the MLA that behind it, of the sensor that behind the MLA.
    """

    name: str
    what: str
    """Size and material."""
    distance_mm: float
    """With a ruler; of an element its sensor-side vertex."""
    diameter_mm: float | None
    """Diameter of an opening."""
    seen_distance_mm: float
    """Infinite where it is seen there."""
    seen_diameter_mm: float | None


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
    """Depth spread there, of views set apart along and across."""


@dataclass(frozen=True)
class ObjectiveMapping:
    """How an objective takes angles to image heights, where it is not f tan."""

    mapping: str
    element: str
    """Which it is."""
    largest_angle_deg: float
    """Largest angle that it images, in air."""
    fields: tuple[MappedField, ...]


@dataclass(frozen=True)
class LookedThrough:
    """Media and parts that light meets beside the main lens: liquid, elements, glass about the array."""

    medium: str
    """Medium that the scene lies in."""
    index: float
    """Index of that medium, at the design's wavelength."""
    parts: tuple[SeenPart, ...]
    """In the order of light, from the focal plane on."""
    mapping: ObjectiveMapping | None = None
    """None of f tan."""


@dataclass(frozen=True)
class AtTemperature:
    """The camera at one temperature, left as it was focused."""

    temperature_degc: float
    """[degrees C]."""
    focal_length_mm: float
    """f."""
    mla_distance_mm: float
    """d_1, with a ruler."""
    focal_plane_mm: float
    """d_f: where it is then in focus, with a ruler; infinite where it is nowhere."""
    focus_shift_pitches: float | None
    """Disparity between the FAP's rims of what was in focus; None where it is no camera any more."""
    fill_factor: float
    """Microlens-image diameter over pitch."""
    fits: bool
    """Whether it is a camera still: a real image, no part in another."""


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
    """20 degrees C, the camera's own, the ends of its range."""
    index_not_known: tuple[str, ...]
    """Materials whose index is taken not to change."""
    not_named: tuple[str, ...]
    """Parts that do not change, because nothing says what they are made of."""


@dataclass(frozen=True)
class Evaluation:
    """Everything that `roslf evaluate` says of a design. Lengths in mm, angles in rad."""

    design: str
    """Its name."""
    aperture_constant: float
    """H, Eq. 3."""
    inverse_aperture_constant: float
    """1/H, which stays finite as d_3 -> d_f."""
    exit_pupil: ExitPupil
    f_number: FNumber
    non_distortion: NonDistortion
    microlens_image: MicrolensImage
    fields: tuple[Field, ...]
    sampling: Sampling
    depth: Depth
    diffraction: Diffraction
    effects: tuple[PlannedEffect, ...]
    verdicts: tuple[Verdict, ...]
    warnings: tuple[str, ...]
    method: str
    """How areas were found, and how far they may be off."""
    real_lens: RealLens | None = None
    """The traced main lens; None where it is ideal."""
    object_space: LookedThrough | None = None
    """None where all is air."""
    temperature: Temperatures | None = None
    """None of a design without `[environment]`."""

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of `roslf evaluate --json`; infinite values are None, what all is air has no object space."""
        data = {"schema": SCHEMA, **plain(self, undefined=False)}
        if self.temperature is None:
            del data["temperature"]
        if self.object_space is None:
            del data["object_space"]
        elif self.object_space.mapping is None:
            del data["object_space"]["mapping"]
        return data

    def __str__(self) -> str:
        return as_text(self)

    def _repr_html_(self) -> str:
        return as_html(self)
