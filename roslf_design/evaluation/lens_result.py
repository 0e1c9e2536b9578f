"""What a traced main lens does, as values whose names are the keys of the JSON under `real_lens`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RealLensField:
    """One microlens behind the real lens; None where there is no light to tell it by."""

    x_ml_mm: tuple[float, float]
    """Where it sits on the MLA, in the array's own frame."""
    status: str
    """"full", "clipped", "dark", or "folded": two sensor points see the same FAP point, a caustic of the pupil."""
    chief_ray: str
    """What became of the ray through the FAP's centre: "kept", "missed surface 1"."""
    kept_fraction: float
    """Part of the FAP that the microlens sees."""
    centre_mm: tuple[float, float] | None
    """Image of the FAP's centre, relative to the microlens axis."""
    diameter_mm: float | None
    """Of the disc with the area of the FAP's image; of its lit part where folded."""
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
    """The same across it."""
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
    """The same on the MLA."""
    thin_x_ml_max_mm: float
    """Eq. 6's, for the thin twin; infinite where no field is too large."""
    turned_x_ml_max_mm: float | None
    """Measured bound with the lens turned round; None where the field is undistorted anyhow, or parts would collide."""
    undistorted_in_field: bool
    """Whether images are whole, and not folded, at every field told here and at the four corners."""
    fields: tuple[RealLensField, ...]
