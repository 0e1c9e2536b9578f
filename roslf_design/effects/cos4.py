"""Cos^4 fall-off: oblique pencils bring less light through the flexible angular plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design import Design
from .brief import SceneBrief
from .effect import Effect, Estimate
from .field import field_note, field_radius


def falloff(design: Design, x_ml: ArrayLike) -> NDArray[np.float64]:
    """Brightness cos^4 of a microlens at radius `x_ml` [mm] against the one on the axis.

    The chief ray leaves the focal plane at X_0 = X_ml d_f/d_1 and meets the FAP's centre Z_0 = d_f - d_3 farther on.
    """
    slope = np.multiply(x_ml, design.d_f / design.d_1) / (design.d_f - design.d_3)
    return np.asarray((1 + slope**2) ** -2.0)


def estimate(design: Design, brief: SceneBrief) -> Estimate:
    """Loss at the field's rim [fraction of full scale].

    Behind a real lens it is that of the rays behind the array: what obliqueness costs in front of the lens shows in
    the size of the microlens images there, which are traced (etendue is conserved).
    """
    if design.lens is not None:
        from .lens_faults import faults, lens_field

        x_ml = lens_field(design, brief)
        loss = _loss(faults(design, x_ml).steepest)
        return Estimate(loss, f"{loss:.2%} darker at X_ml = {x_ml:.4g} mm, behind the array (traced)")
    loss = _loss(field_radius(design, brief) * design.d_f / design.d_1 / (design.d_f - design.d_3))
    return Estimate(loss, f"{loss:.2%} darker {field_note(design, brief)}")


def _loss(slope: float) -> float:
    """1 - cos^4 of the angle of a slope; -expm1 keeps small angles exact."""
    return float(-np.expm1(-2 * np.log1p(slope**2)))


EFFECT = Effect("cos4", "cos^4 fall-off", "intensity", estimate)
