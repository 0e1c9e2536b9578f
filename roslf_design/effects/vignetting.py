"""Vignetting: the main lens and the bore's further rims cut into the microlens images (cat's eyes)."""

from __future__ import annotations

import math

from ..design import Design, Stop
from . import lens_faults
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import field_note, field_radius, stop_image, stop_scale


def cut_depth(design: Design, x_ml: float) -> float:
    """How deep the main lens and the further stops cut into the FAP's disc, on the sensor [mm].

    Parameters
    ----------
    design : Design
    x_ml : float
        Radius of the microlens on the array [mm].

    Returns
    -------
    float
        0 where the FAP's disc lies inside all others (the non-distortion margin of Eqs. 5-6 is not negative), its
        whole diameter where nothing is left.
    """
    centre, radius = stop_image(design, design.aperture, x_ml)
    lens = Stop(diameter=design.D, distance=0.0, decentre=design.main_lens.decentre)
    depth = 0.0
    for stop in (lens, *design.stops):
        other, reach = stop_image(design, stop, x_ml)
        offset = _offset(design, stop)
        depth = max(depth, abs(other - centre) + offset + radius - reach)
    return min(depth, 2 * radius)


def _offset(design: Design, stop: Stop) -> float:
    """Largest distance that decentres add between the stop's and the FAP's discs [mm]."""
    own, fap = stop_scale(design, stop.distance), stop_scale(design, design.d_3)
    bend_own, bend_fap = own * stop.distance / design.f, fap * design.d_3 / design.f
    e_x, e_y = design.main_lens.decentre
    shift = [
        own * stop.decentre[axis] - fap * design.aperture.decentre[axis] + (bend_fap - bend_own) * lens
        for axis, lens in enumerate((e_x, e_y))
    ]
    return math.hypot(*shift)


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Depth of the deepest cut [px]."""
    depth = cut_depth(design, field_radius(design, brief)) / design.q
    where = field_note(design, brief)
    if design.lens is not None:
        traced = lens_faults.faults(design, lens_faults.lens_field(design, brief)).cut / design.q
        if traced > depth:
            return Estimate(traced, f"{design.lens.name}, traced, cuts {traced:.3g} px off microlens images {where}")
    if depth <= 0:
        return Estimate(0.0, f"the FAP's disc lies inside all others {where}: nothing is clipped")
    return Estimate(depth, f"other rims cut {depth:.3g} px into the FAP's disc {where}")


EFFECT = Effect("vignetting", "Vignetting", "px", estimate, cost_per_pixel=5e-9)
