"""Finite microlens aperture: one pixel sees a patch of the object as wide as the microlens's footprint."""

from __future__ import annotations

import math

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate


def footprint(design: Design, distance: float) -> float:
    """Width on the object, at Z = `distance`, of what one sensor point sees through a whole microlens [mm].

    At the focal plane this is d d_f/d_1 whatever the microlens's own focus.
    """
    bend = 1 / design.f_ml - 1 / design.d_2
    on_lens = 1 - design.d_1 * bend
    slope = bend + on_lens / design.f
    return design.d * abs(on_lens - slope * distance)


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Rms change of a full-contrast texture [fraction of full scale].

    A box of width F takes the share 1 - sinc(F/P) of a sinusoid of period P, whose rms is 1/sqrt(8); hard edges, two a
    period along each axis, each change by a ramp of width F: sqrt(F/3P) rms.
    """
    distances = (design.d_f,) if brief.distances is None else brief.distances
    width = max(footprint(design, distance) for distance in distances)
    if brief.white:
        return Estimate(0.0, f"a uniform scene has no detail within the object footprint of {width:.3g} mm")
    if brief.smallest_period == 0:
        return Estimate(1.0, f"points are smaller than the object footprint of {width:.3g} mm")
    ratio = width / brief.smallest_period
    smooth = (1 - math.sin(math.pi * ratio) / (math.pi * ratio)) / math.sqrt(8)
    loss = 1.0 if ratio >= 1 else math.sqrt(ratio / 3) if brief.hard_edges else smooth
    return Estimate(loss, f"object footprint {width:.3g} mm against detail of period {brief.smallest_period:.3g} mm")


EFFECT = Effect(
    "finite_microlens_aperture", "Finite microlens aperture", "intensity", estimate, cost_per_pixel=64 * 25e-9
)
