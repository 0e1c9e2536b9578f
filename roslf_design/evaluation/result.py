"""What `evaluate` found: frozen values whose names are the keys of the JSON, ready for a terminal or a notebook."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from .lens_result import RealLens

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
    """The same on the MLA."""
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
class RayBudget:
    """Fractions of the rays that fill the FAP, as seen by one microlens, past one element after the other."""

    fap: float
    main_lens: float
    stops: tuple[float, ...]
    """One entry for each of the design's further stops."""
    own_cell: float
    """On the sensor inside the microlens's own cell of one image pitch."""


@dataclass(frozen=True)
class Field:
    """One microlens."""

    x_ml_mm: tuple[float, float]
    """Where it sits on the MLA, in the array's own frame."""
    status: str
    """"full", "clipped" or "dark"."""
    area_mm2: float
    """Of its image."""
    kept_fraction: float
    """Area against the unclipped FAP disc."""
    lost_fraction: float
    """1 - kept_fraction, exact where it is tiny."""
    centroid_mm: tuple[float, float] | None
    """Of its image, relative to the microlens axis; None where dark."""
    axis_ratio: float | None
    """Minor over major axis of the image's second moments; 1 for a disc."""
    ray_budget: RayBudget
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
    """Microlenses across the sensor's width."""
    object_sample_mm: float
    """d d_f/d_1."""
    view_baseline_mm: float
    """q d_1/(H d_2), on the FAP."""


@dataclass(frozen=True)
class Depth:
    """Depth precision at the focal plane."""

    disparity_pitches_per_mm: float
    sigma_z_mm: float
    sigma_disparity_pitches: float
    """The disparity error that sigma_z assumes."""


@dataclass(frozen=True)
class Diffraction:
    """What diffraction at one microlens does."""

    fresnel_number: float
    """N_F = d^2/(4 lambda d_2)."""
    airy_radius_px: float


@dataclass(frozen=True)
class Effect:
    """One entry of the effects plan."""

    name: str
    estimate: float
    unit: str
    budget: float
    on: bool
    reason: str


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
    """What would mend it; empty where nothing needs mending."""


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
    effects: tuple[Effect, ...]
    verdicts: tuple[Verdict, ...]
    warnings: tuple[str, ...]
    method: str
    """How areas were found, and how far they may be off."""
    real_lens: RealLens | None = None
    """The traced main lens; None where it is ideal."""

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of `roslf evaluate --json`; infinite values are None."""
        return {"schema": SCHEMA, **_plain(self)}

    def __str__(self) -> str:
        from .show import as_text

        return as_text(self)

    def _repr_html_(self) -> str:
        from .show import as_html

        return as_html(self)


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        if math.isnan(value):
            raise ArithmeticError("a result is not a number; please report the design that led to it")
        return value if math.isfinite(value) else None
    return value
