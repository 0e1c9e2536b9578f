"""Faults of a real main lens: aberrations, distortion, field curvature, colour. Of an ideal one they are not modelled.

What stands before it is traced with it, and counts.

All four come from the traced lens, at the field's rim and inside it, the worst counting. A rendering cannot have them
one by one: where any of the first three is on, its rays go through the lens as it is; colour says whether each
wavelength takes its own way.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..camera import Camera
from ..design import Design
from ..fates import ImageFate, RayFate
from ..lenses.prescription import first_order
from ..theory.ideal_lenses import IdealLensFaults
from ..traced.camera import camera_of
from ..traced.images import field_map, measured_bound, real_field
from .effect import NOT_MODELLED, Effect, Estimate, Subject, Unit

RADII = (0.4, 0.6, 0.8, 1.0)
"""Parts of the field's radius at which the lens is looked at."""


class _LensAberrations(NamedTuple):
    """Aberrations of the traced lens over the field, each at its worst."""

    displaced: float
    """Farthest that the rim of a whole microlens image lies from where the thin lens puts it [mm]; an image's diameter
    where none is whole."""
    cut: float
    """Depth of the lens's own rims' cut into a microlens image [mm]."""
    spread: float
    """Largest extent on the array of an object point's light [mm]."""
    curvature: float
    """Extent from the tangential and sagittal foci alone [mm]."""
    refocused: float
    """Extent that stays where every place is refocused to halfway between its two foci: astigmatism [mm]."""
    whole_to: float
    """Radius to which images are whole [mm]; that of the field where all of them are."""
    steepest: float
    """Steepest ray behind the array that makes a microlens image: dx/dz."""


FAULTLESS = _LensAberrations(0.0, 0.0, 0.0, 0.0, 0.0, math.inf, 0.0)


def lens_aberrations(design: Design, x_ml: float) -> _LensAberrations:
    """Faults of a design's main lens out to the microlens radius `x_ml` [mm]."""
    return _traced_faults(design, x_ml) if design.main_lens.kind.faults else FAULTLESS


@lru_cache(maxsize=256)
def _traced_faults(design: Design, x_ml: float) -> _LensAberrations:
    axes = [(share * x_ml, 0.0) for share in RADII]
    # The array's own frame is turned and shifted; the lens is asked along its own radius.
    centred = ("main_lens", "aperture", "microlens_array")
    upright = (*centred, "sensor", *(stop.place for stop in design.openings))
    straight = {f"{part}.tilt": (0.0, 0.0) for part in upright}
    straight |= {f"{part}.decentre": (0.0, 0.0) for part in centred}
    bench = design.replace({**straight, "microlens_array.rotation": 0.0})
    if any(camera_of(bench).planes.straight):  # no direction then stands for all others
        turns = [turn * math.pi / 4 for turn in range(8)]
        axes = [(radius * math.cos(turn), radius * math.sin(turn)) for turn in turns for radius, _ in axes]
    field = real_field(bench, axes)
    diameter = field.thin_diameter
    whole = (field.images.status == ImageFate.FULL) & np.isfinite(field.rim_shift)
    lit = field.maps.status == RayFate.KEPT
    foci = np.maximum(np.abs(field.maps.tangential_focus), np.abs(field.maps.sagittal_focus))
    apart = np.abs(field.maps.tangential_focus - field.maps.sagittal_focus)
    return _LensAberrations(
        displaced=float(np.max(field.rim_shift, where=whole, initial=0.0)) if whole.any() else diameter,
        cut=float(np.max(1 - field.images.kept_fraction)) * diameter,
        spread=float(np.max(np.where(lit, np.max(field.maps.spread, axis=-1), 0.0))),
        curvature=float(np.max(np.where(lit, foci, 0.0))) * _cone(design),
        refocused=float(np.max(np.where(lit, apart / 2, 0.0))) * _cone(design),
        whole_to=x_ml if whole.all() else min(measured_bound(design)[1], x_ml),
        steepest=float(np.max(np.hypot(*np.moveaxis(field.images.outline, -1, 0)))) / camera_of(design).d_2,
    )


def _cone(design: Design) -> float:
    """Diameter of the light's cone per unit of distance from its focus on the array."""
    camera = Camera.of(design)
    return float(np.abs(camera.seen.D_F / camera.seen.A))


def colour_spread(design: Design, wavelengths: tuple[float, ...], x_ml: float) -> float:
    """Distance between wavelengths on the array at `x_ml`: lateral and axial colour added [mm]."""
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
    return f"{s.design.main_lens.kind.name}, traced to X_ml = {s.lens_field:.4g} mm"


def _distortion(s: Subject) -> Estimate:
    """Displacement of microlens images' rims against the thin lens [px]."""
    traced = lens_aberrations(s.design, s.lens_field)
    size = traced.displaced / s.design.q
    ends = "" if traced.whole_to == s.lens_field else f"; images are not whole beyond {traced.whole_to:.4g} mm"
    return Estimate(size, f"{_traced(s)}: rims of whole images up to {size:.3g} px off the thin lens's{ends}")


def _blur(s: Subject, spread: float, words: str) -> Estimate:
    if s.brief.white:
        return Estimate(0.0, f"a uniform scene hides it ({words} at X_ml = {s.lens_field:.4g} mm)")
    return Estimate(spread, f"{_traced(s)}: {words}")


def _aberrations(s: Subject) -> Estimate:
    """Extent on the array of an object point's light [pitches]; zero for a uniform scene."""
    spread = lens_aberrations(s.design, s.lens_field).spread / s.design.d
    return _blur(s, spread, f"object points spread over {spread:.3g} pitches")


def curvature(s: Subject) -> Estimate:
    """Blur on the array from field curvature and astigmatism [pitches]; zero for a uniform scene."""
    lens_faults = lens_aberrations(s.design, s.lens_field)
    spread, left = lens_faults.curvature / s.design.d, lens_faults.refocused / s.design.d
    words = (
        f"tangential and sagittal foci off the array blur by up to {spread:.3g} pitches, {left:.3g} after refocusing"
    )
    return _blur(s, spread, words)


def _colour(s: Subject) -> Estimate:
    """Lateral and axial colour between the scene's wavelengths and the design's [pitches]."""
    others = tuple(wave for wave in s.brief.wavelengths if wave != s.design.wavelength)
    if not others:
        return Estimate(0.0, "the scene is lit in the design's wavelength")
    spread = colour_spread(s.design, others, s.lens_field) / s.design.d
    return Estimate(spread, f"{_traced(s)}: colours part by {spread:.3g} pitches")


def _of_lens(name: str, title: str, unit: Unit, estimate: Callable[[Subject], Estimate], size: str = "") -> Effect:
    """Effect of a real lens; of ideal ones in a bore `size` names the words on how large it may be."""

    def absent(subject: Subject) -> str:
        faults = IdealLensFaults.of(subject.camera) if size else None
        return f"{NOT_MODELLED}ideal lens{'es; ' * bool(faults)}{getattr(faults, size) if faults else ''}".rstrip("; ")

    return Effect(
        name, title, unit, estimate, available=lambda design: name in design.main_lens.kind.faults, absent=absent
    )


EFFECTS = (
    _of_lens("lens_aberrations", "Main-lens aberrations", "pitch", _aberrations),
    _of_lens("lens_distortion", "Main-lens distortion", "px", _distortion),
    _of_lens("field_curvature", "Field curvature", "pitch", curvature, "curved"),
    _of_lens("lens_colour", "Main-lens colour", "pitch", _colour, "coloured"),
)
