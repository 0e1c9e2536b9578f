"""How close a design itself is to the hard cases."""

from __future__ import annotations

import math
from typing import NamedTuple

from .. import theory
from ..design import Design
from .walks import arguments_of, touching

NEAR = 1e-2
"""Relative distance below which a design is called near."""

EPSILON = 2.0**-52


class Near(NamedTuple):
    """A design's distance from one hard case."""

    case: str
    distance: float
    """Relative; 0 is on it."""
    near: bool
    says: str
    """What that means for this design; empty where it is not near."""


def near_cases(design: Design) -> tuple[Near, ...]:
    """Distance from every hard case that a design can be close to, closest first."""
    optics = design.f, design.d_f, design.d_3
    fill = float(theory.fill_factor(design.D_F, design.d, design.d_2, *optics))
    numbers = arguments_of(design)
    found = [
        _near("d_3 → d_f", (design.d_f - design.d_3) / design.d_f, "the bore's end lies almost in the focal plane"),
        _near("d_3 → f", abs(design.d_3 - design.f) / design.f, "image-space telecentric"),
        _near("d_f → f", (design.d_f - design.f) / design.f, "the object is almost in the front focus"),
        _near("d_f → ∞", design.f / design.d_f, "focused almost at infinity"),
        _near("images just touch", abs(numbers["pupil_diameter"] / touching(numbers) - 1), f"fill factor {fill:.6g}"),
    ]
    if design.d_3 > 0:
        found.append(_near("d_3 → 0", design.d_3 / design.d_f, "the aperture is almost at the main lens"))
    else:
        found.append(Near("d_3 → 0", 0.0, True, "the aperture is at the main lens; margins are exact there"))
    found += _rim_cases(design)
    return tuple(sorted(found, key=lambda one: one.distance))


def _near(case: str, distance: float, says: str) -> Near:
    near = distance < NEAR
    lost = min(16.0, -math.log10(max(distance, EPSILON)))
    text = f"{says}; a formula that cancels there loses {lost:.0f} of 16 digits, the forms used lose none"
    return Near(case, distance, near, text if near else "")


def _rim_cases(design: Design) -> list[Near]:
    """Discs near containment or tangency, at the centre, edge and corner of the sensor."""
    from ..evaluation import default_fields
    from ..evaluation.fields import field_discs

    centres, radii = field_discs(design, default_fields(design))
    inner, outer = math.inf, math.inf
    for place in range(len(radii)):
        for k in range(1, radii.shape[1]):
            apart = math.hypot(*(centres[place, k] - centres[place, 0]))
            r, R = float(radii[place, 0]), float(radii[place, k])
            inner = min(inner, abs(apart - abs(R - r)) / r)
            outer = min(outer, abs(R + r - apart) / r)
    return [
        _near("barely clipped", inner, "a rim almost touches the pupil's image from outside, somewhere in the field"),
        _near("discs near tangency", outer, "a rim leaves almost nothing of the pupil's image somewhere in the field"),
    ]
