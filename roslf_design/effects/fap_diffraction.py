"""Diffraction at the flexible angular plane: how sharply the main lens can show an object point on the MLA."""

from __future__ import annotations

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import inverse_aperture_constant


def airy_radius_on_mla(design: Design, wavelength: float) -> float:
    """Airy radius 1.22 lambda d_1/(D_F H) on the microlens array [mm]."""
    return 1.22 * wavelength * design.d_1 * inverse_aperture_constant(design) / design.D_F


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Airy radius [microlens pitches]; zero for a uniform scene, which is incoherent and stays uniform.

    With matched f-numbers it is 1.22 times the microlenses' own blur, in pitches on either side: one and the same
    uncertainty. Textures are therefore blurred at the FAP only where the microlenses do not diffract already; point
    sources carry both, coherently.
    """
    radius = airy_radius_on_mla(design, brief.wavelength(design)) / design.d
    if brief.white:
        return Estimate(0.0, f"a uniform scene stays uniform (detail would blur by {radius:.3g} pitches)")
    carried = ", carried by the microlenses' own diffraction" if brief.diffracts and brief.smallest_period > 0 else ""
    return Estimate(radius, f"Airy radius on the MLA {radius:.3g} pitches{carried}")


EFFECT = Effect("fap_diffraction", "FAP diffraction at the MLA", "pitch", estimate, cost_per_pixel=100e-9)
