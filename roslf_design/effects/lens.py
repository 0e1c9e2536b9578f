"""Faults of a real main lens: aberrations, distortion, field curvature, colour. An ideal thin lens has none.

What stands before it is traced with it, and counts.

All four come from the traced lens, at the field's rim and inside it, the worst counting. A rendering cannot have them
one by one: where any of the first three is on, its rays go through the lens as it is; colour says whether each
wavelength takes its own way.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..camera import Camera
from ..design import Design
from ..lenses.prescription import first_order
from ..lenses.tracer import KEPT
from ..traced.camera import camera_of
from ..traced.images import field_map, real_field
from .effect import Effect, Estimate, Subject

RADII = (0.4, 0.6, 0.8, 1.0)
"""Parts of the field's radius at which the lens is looked at."""


class Faults(NamedTuple):
    """Aberrations of the traced lens over the field, each at its worst."""

    displaced: float
    """Farthest that the rim of a microlens image lies from where the thin lens puts it [mm]; an image's diameter where
    it is not whole."""
    cut: float
    """How much the lens's own rims take off a microlens image [mm]."""
    spread: float
    """Largest extent on the array of an object point's light [mm]."""
    curvature: float
    """Extent from the tangential and sagittal foci alone [mm]."""
    refocused: float
    """Extent that stays where every place is refocused to halfway between its two foci: astigmatism [mm]."""
    whole_to: float
    """Largest of the radii looked at to which images are whole [mm]."""
    steepest: float
    """Steepest ray behind the array that makes a microlens image: dx/dz."""


@lru_cache(maxsize=256)
def faults(design: Design, x_ml: float) -> Faults:
    """Trace a design's main lens out to the microlens radius `x_ml` [mm]."""
    axes = [(share * x_ml, 0.0) for share in RADII]
    # The array's own frame is turned and shifted; the lens is asked along its own radius.
    upright = ("main_lens", "aperture", "microlens_array", "sensor", *(f"stops.{i}" for i in range(len(design.stops))))
    straight = {f"{part}.tilt": (0.0, 0.0) for part in upright}
    straight |= {f"{part}.decentre": (0.0, 0.0) for part in upright[:3]}
    field = real_field(design.replace({**straight, "microlens_array.rotation": 0.0}), axes)
    diameter = field.thin_diameter
    whole = (field.images.status == 2) & np.isfinite(field.rim_shift)
    lit = field.maps.status == KEPT
    foci = np.maximum(np.abs(field.maps.tangential_focus), np.abs(field.maps.sagittal_focus))
    apart = np.abs(field.maps.tangential_focus - field.maps.sagittal_focus)
    return Faults(
        displaced=float(np.max(np.where(whole, field.rim_shift, diameter))),
        cut=float(np.max(1 - field.images.kept_fraction)) * diameter,
        spread=float(np.max(np.where(lit, np.max(field.maps.spread, axis=-1), 0.0))),
        curvature=float(np.max(np.where(lit, foci, 0.0))) * _cone(design),
        refocused=float(np.max(np.where(lit, apart / 2, 0.0))) * _cone(design),
        whole_to=max((axes[i][0] for i in range(len(axes)) if whole[i]), default=0.0),
        steepest=float(np.max(np.hypot(*np.moveaxis(field.images.outline, -1, 0)))) / camera_of(design).d_2,
    )


def _cone(design: Design) -> float:
    """Diameter of the light's cone per unit of distance from its focus on the array."""
    camera = Camera.of(design)
    return float(np.abs(camera.seen.D_F / camera.seen.A))


def colour_spread(design: Design, wavelengths: tuple[float, ...], x_ml: float) -> float:
    """How far wavelengths part on the array at `x_ml`: lateral and axial colour added [mm]."""
    camera = camera_of(design)
    waves = (design.wavelength, *wavelengths)
    lateral = field_map(camera, [x_ml, 0.0], waves).lateral_colour[:, 0]
    design_camera = Camera.of(design)
    places = []
    for wave in waves:
        # The focal plane as the lens sees it in that colour through what stands before it.
        plane = design_camera.replace({"wavelength": wave}).plane(design.d_f)
        z = camera.first_order.front_principal - float(plane.distance)
        places.append(first_order(camera.lens, wave).image_of(z)[0])
    return float(np.ptp(lateral)) + (max(places) - min(places)) * _cone(design)


def _traced(s: Subject) -> str:
    assert s.design.lens is not None
    return f"{s.design.lens.name}, traced to X_ml = {s.lens_field:.4g} mm"


def distortion(s: Subject) -> Estimate:
    """Displacement of microlens images' rims against the thin lens [px]."""
    if s.design.lens is None:
        return IDEAL
    traced = faults(s.design, s.lens_field)
    size = traced.displaced / s.design.q
    ends = "" if traced.whole_to == s.lens_field else f"; images are not whole beyond {traced.whole_to:.4g} mm"
    return Estimate(size, f"{_traced(s)}: image rims up to {size:.3g} px off the thin lens's{ends}")


def _blur(s: Subject, spread: float, words: str) -> Estimate:
    if s.brief.white:
        return Estimate(0.0, f"a uniform scene hides it ({words} at X_ml = {s.lens_field:.4g} mm)")
    return Estimate(spread, f"{_traced(s)}: {words}")


def aberrations(s: Subject) -> Estimate:
    """Extent on the array of an object point's light [pitches]; zero for a uniform scene."""
    if s.design.lens is None:
        return IDEAL
    spread = faults(s.design, s.lens_field).spread / s.design.d
    return _blur(s, spread, f"object points spread over {spread:.3g} pitches")


def curvature(s: Subject) -> Estimate:
    """Blur on the array from field curvature and astigmatism [pitches]; zero for a uniform scene."""
    if s.design.lens is None:
        return IDEAL
    lens_faults = faults(s.design, s.lens_field)
    spread, left = lens_faults.curvature / s.design.d, lens_faults.refocused / s.design.d
    words = (
        f"tangential and sagittal foci off the array blur by up to {spread:.3g} pitches, {left:.3g} after refocusing"
    )
    return _blur(s, spread, words)


def colour(s: Subject) -> Estimate:
    """Lateral and axial colour between the scene's wavelengths and the design's [pitches]."""
    if s.design.lens is None:
        return IDEAL
    others = tuple(wave for wave in s.brief.wavelengths if wave != s.design.wavelength)
    if not others:
        return Estimate(0.0, "the scene is lit in the design's wavelength")
    spread = colour_spread(s.design, others, s.lens_field) / s.design.d
    return Estimate(spread, f"{_traced(s)}: colours part by {spread:.3g} pitches")


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
