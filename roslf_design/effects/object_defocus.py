"""Object out of focus: the pixels of one microlens image see different parts of the object."""

from __future__ import annotations

from ..design import Design
from ..errors import InputError, Problem
from .brief import SceneBrief
from .effect import Effect, Estimate


def blur_on_mla(design: Design, distance: float) -> float:
    """Width on the MLA over which an object point at Z = `distance` spreads [mm].

    D_F d_1 |1/(H Z_F) - 1/d_f| with Z_F = Z - d_3, in the form D_F (d_1/d_f) |d_f - Z|/(Z - d_3) that does not
    cancel near the focal plane.

    Raises
    ------
    InputError
        Where the object is not beyond the FAP.
    """
    if distance <= design.d_3:
        fault = f"{distance:g} mm is not beyond the aperture at d_3 = {design.d_3:g} mm; move the object out"
        raise InputError((Problem("object distance", fault),))
    return design.D_F * design.d_1 / design.d_f * abs(design.d_f - distance) / (distance - design.d_3)


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Spread over the MLA [microlens pitches] of the scene's nearest or farthest point; zero for a uniform scene."""
    if brief.distances is None:
        return Estimate(0.0, "the scene lies on the focal plane")
    spread = max(blur_on_mla(design, distance) for distance in brief.distances) / design.d
    nearest, farthest = brief.distances
    if brief.white:
        return Estimate(0.0, f"a uniform scene looks alike at any distance (detail would spread {spread:.3g} pitches)")
    reach = f"Z = {nearest:.4g} mm" if nearest == farthest else f"Z = {nearest:.4g} to {farthest:.4g} mm"
    return Estimate(spread, f"object points at {reach} spread over {spread:.3g} pitches")


EFFECT = Effect("object_defocus", "Object out of focus", "pitch", estimate)
