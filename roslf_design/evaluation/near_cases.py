"""Hard cases near a design: singular places of its numbers, and what holds there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..camera import Camera
from ..design import Design
from ..theory.f_number import fill_factor, matched
from .fields import default_fields, field_openings

NEAR = 1e-2
"""Relative distance below which a design is called near a hard case."""


class Near(NamedTuple):
    """A design's distance from one hard case."""

    case: str
    distance: float
    """Relative; 0 is on it."""
    near: bool
    says: str
    """Sentence on what that means for this design; empty where it is not near."""

    @classmethod
    def of(cls, case: str, distance: float, says: str) -> Near:
        """Case, with what its loss of digits means where it is near."""
        near = distance < NEAR
        lost = min(16.0, -math.log10(max(distance, 2.0**-52)))
        text = f"{says}; a formula that cancels there loses {lost:.0f} of 16 digits, the forms used lose none"
        return cls(case, distance, near, text if near else "")


def near_cases(design: Design) -> tuple[Near, ...]:
    """Distance from every place where a textbook formula loses digits, closest first."""
    camera = Camera.of(design)
    f, d_f, d_3, D_F = (float(length) for length in (camera.f, camera.seen.d_f, camera.seen.d_3, camera.seen.D_F))
    fill = float(fill_factor(camera))
    # The pupil at the lens has no distance to scale by: a little in front of it the images touch at about the same D_F.
    near = camera if d_3 else camera.replace({"d_3": 0.01 * f})
    touching = float(matched(near, "D_F").value / near.fap.scale)
    # Openings near containment or, of discs, tangency, at the centre, edge and corner of the sensor.
    openings = field_openings(design, default_fields(design))
    centres, spans = openings.centres, openings.spans
    r, R = spans[:, :1] / 2, spans[:, 1:] / 2
    apart = np.hypot(*np.moveaxis(centres[:, 1:] - centres[:, :1], -1, 0))
    inner, outer = float((abs(apart - abs(R - r)) / r).min()), float((abs(R + r - apart) / r).min())
    if openings.polygons:
        inner = float((abs(openings.rooms[:, 1:]) / r).min())
    at_lens = Near("d_3 → 0", 0.0, True, "the aperture is at the main lens; margins are exact there")
    # Behind power in the bore d_f may have either sign, and is not where the camera is focused.
    far, scale = "focused almost at infinity", d_f
    if camera.chain.bends:
        far, scale = "the main lens sees the focal plane almost at infinity", f
    cases = [
        Near.of("d_3 → d_f", abs(d_f - d_3) / max(abs(d_f), abs(d_3)), "the bore's end lies almost in the focal plane"),
        Near.of("d_3 → f", abs(d_3 - f) / f, "image-space telecentric"),
        Near.of("d_f → f", abs(d_f - f) / f, "the object is almost in the front focus"),
        Near.of("d_f → ∞", abs(f / d_f), far),
        Near.of("images just touch", abs(D_F / touching - 1), f"image fill {fill:.6g}"),
        Near.of("d_3 → 0", abs(d_3 / scale), "the aperture is almost at the main lens") if d_3 else at_lens,
        Near.of("barely clipped", inner, "a rim almost touches the pupil's image from outside, somewhere in the field"),
        Near.of(
            "discs near tangency", outer, "a rim leaves almost nothing of the pupil's image somewhere in the field"
        ),
    ]
    return tuple(sorted(cases, key=lambda one: one.distance))
