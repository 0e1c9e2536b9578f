"""Faults of a real main lens: aberrations, distortion, field curvature, colour. An ideal thin lens has none.

All four come from the traced lens, at the field's rim and inside it, the worst counting. A rendering cannot have them
one by one: where any of the first three is on, its rays go through the lens as it is; colour says whether each
wavelength takes its own way.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import field_radius, inverse_aperture_constant

RADII = (0.4, 0.6, 0.8, 1.0)
"""Parts of the field's radius at which the lens is looked at."""


class Faults(NamedTuple):
    """What the traced lens does over the field, each at its worst."""

    displaced: float
    """Farthest that the rim of a microlens image lies from where the thin lens puts it [mm]; an image's diameter where
    it is not whole."""
    cut: float
    """How much the lens's own rims take off a microlens image [mm]."""
    spread: float
    """Largest extent on the array of an object point's light [mm]."""
    curvature: float
    """The same from the tangential and sagittal foci alone [mm]."""
    whole_to: float
    """Largest of the radii looked at to which images are whole [mm]."""
    steepest: float
    """Steepest ray behind the array that makes a microlens image: dx/dz."""


@lru_cache(maxsize=256)
def faults(design: Design, x_ml: float) -> Faults:
    """Trace a design's main lens out to the microlens radius `x_ml` [mm]."""
    from ..lenses.of_design import real_field
    from ..lenses.trace import KEPT

    axes = [(share * x_ml, 0.0) for share in RADII]
    # The array's own frame is turned and shifted; the lens is asked along its own radius.
    upright = ("main_lens", "aperture", "microlens_array", "sensor", *(f"stops.{i}" for i in range(len(design.stops))))
    straight = {f"{part}.tilt": (0.0, 0.0) for part in upright}
    straight |= {f"{part}.decentre": (0.0, 0.0) for part in upright[:3]}
    centred = design.replace({**straight, "microlens_array.rotation": 0.0})
    found = real_field(centred, axes)
    diameter = found.thin_diameter
    lost = 1 - found.images.kept_fraction
    whole = (found.images.status == 2) & np.isfinite(found.rim_shift)
    seen = found.maps.status == KEPT
    cone = design.D_F / (design.d_1 * abs(inverse_aperture_constant(design)))
    foci = np.maximum(np.abs(found.maps.tangential_focus), np.abs(found.maps.sagittal_focus))
    return Faults(
        displaced=float(np.max(np.where(whole, found.rim_shift, diameter))),
        cut=float(np.max(lost)) * diameter,
        spread=float(np.max(np.where(seen, np.max(found.maps.spread, axis=-1), 0.0))),
        curvature=float(np.max(np.where(seen, foci, 0.0))) * cone,
        whole_to=max((axes[i][0] for i in range(len(axes)) if whole[i]), default=0.0),
        steepest=float(np.max(np.hypot(*np.moveaxis(found.images.outline, -1, 0)))) / design.d_2,
    )


def lens_field(design: Design, brief: SceneBrief) -> float:
    """Largest distance from the lens's axis of a microlens that counts [mm]: decentres move the field across it."""
    aside = np.subtract(design.microlens_array.decentre, design.main_lens.decentre)
    return field_radius(design, brief) + float(np.hypot(*aside))


def colour_spread(design: Design, wavelengths: tuple[float, ...], x_ml: float) -> float:
    """How far wavelengths part on the array at `x_ml`: lateral and axial colour added [mm]."""
    from ..lenses.fields import field_map
    from ..lenses.first_order import first_order
    from ..lenses.of_design import camera_of

    camera = camera_of(design)
    waves = (design.wavelength, *wavelengths)
    lateral = field_map(camera, [x_ml, 0.0], waves).lateral_colour[:, 0]
    places = [first_order(camera.lens, wave).image_of(camera.focal_plane)[0] for wave in waves]
    cone = design.D_F / (design.d_1 * abs(inverse_aperture_constant(design)))
    return float(np.ptp(lateral)) + (max(places) - min(places)) * cone


def _name(design: Design) -> str:
    assert design.lens is not None
    return f"{design.lens.name}, traced to X_ml"


def distortion(design: Design, brief: SceneBrief) -> Estimate:
    """Displacement of microlens images' rims against the thin lens [px]."""
    if design.lens is None:
        return IDEAL
    x_ml = lens_field(design, brief)
    found = faults(design, x_ml)
    size = found.displaced / design.q
    ends = "" if found.whole_to == x_ml else f"; images are not whole beyond {found.whole_to:.4g} mm"
    return Estimate(size, f"{_name(design)} = {x_ml:.4g} mm: image rims up to {size:.3g} px off the thin lens's{ends}")


def aberrations(design: Design, brief: SceneBrief) -> Estimate:
    """Extent on the array of an object point's light [pitches]; zero for a uniform scene."""
    if design.lens is None:
        return IDEAL
    x_ml = lens_field(design, brief)
    spread = faults(design, x_ml).spread / design.d
    told = f"object points spread over {spread:.3g} pitches"
    if brief.white:
        return Estimate(0.0, f"a uniform scene hides it ({told} {_at(x_ml)})")
    return Estimate(spread, f"{_name(design)} = {x_ml:.4g} mm: {told}")


def curvature(design: Design, brief: SceneBrief) -> Estimate:
    """Blur on the array from field curvature and astigmatism [pitches]; zero for a uniform scene."""
    if design.lens is None:
        return IDEAL
    x_ml = lens_field(design, brief)
    spread = faults(design, x_ml).curvature / design.d
    told = f"tangential and sagittal foci off the array blur by up to {spread:.3g} pitches"
    if brief.white:
        return Estimate(0.0, f"a uniform scene hides it ({told} {_at(x_ml)})")
    return Estimate(spread, f"{_name(design)} = {x_ml:.4g} mm: {told}")


def colour(design: Design, brief: SceneBrief) -> Estimate:
    """Lateral and axial colour between the scene's wavelengths and the design's [pitches]."""
    if design.lens is None:
        return IDEAL
    others = tuple(wave for wave in brief.wavelengths if wave != design.wavelength)
    if not others:
        return Estimate(0.0, "the scene is lit in the design's wavelength")
    x_ml = lens_field(design, brief)
    spread = colour_spread(design, others, x_ml) / design.d
    return Estimate(spread, f"{_name(design)} = {x_ml:.4g} mm: colours part by {spread:.3g} pitches")


def _at(x_ml: float) -> str:
    return f"at X_ml = {x_ml:.4g} mm"


def has_real_lens(design: Design) -> bool:
    """Whether the main lens is traced."""
    return design.lens is not None


IDEAL = Estimate(0.0, "ideal lens")

EFFECTS = (
    Effect("lens_aberrations", "Main-lens aberrations", "pitch", aberrations, available=has_real_lens),
    Effect("lens_distortion", "Main-lens distortion", "px", distortion, available=has_real_lens),
    Effect("field_curvature", "Field curvature", "pitch", curvature, available=has_real_lens),
    Effect("lens_colour", "Main-lens colour", "pitch", colour, available=has_real_lens),
)
