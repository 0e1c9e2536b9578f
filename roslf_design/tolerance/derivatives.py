"""Exact derivatives of the closed forms, by complex steps: no difference, so nothing cancels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..design import Design
from .axial import SIGMA_DISPARITY

STEP = 1e-40
"""Imaginary, as a share of the number that it is added to; its square vanishes against 1."""
PLACES = {
    "f": "main_lens.focal_length",
    "d_1": "microlens_array.distance",
    "D": "main_lens.diameter",
    "D_F": "aperture.diameter",
    "d_3": "aperture.distance",
    "d": "microlens_array.pitch",
    "d_2": "sensor.distance",
    "pixel": "sensor.pixel",
    "relay": "sensor.relay_magnification",
    "wavelength": "light.wavelength",
}
FORMULAS: dict[str, Callable[[Mapping[str, Any]], Any]] = {
    "image_diameter_mm": lambda s: s["diameter"],
    "image_diameter_px": lambda s: s["diameter"] / s["q"],
    "image_pitch_mm": lambda s: s["pitch"],
    "fill_factor": lambda s: s["diameter"] / s["pitch"],
    "mismatch_px": lambda s: (s["diameter"] - s["pitch"]) / s["q"],
    "disparity_pitches_per_mm": lambda s: s["D_F"] * s["A"] / (s["d"] * s["gap"] * s["gap"]),
    "sigma_z_mm": lambda s: SIGMA_DISPARITY * s["d"] * s["gap"] * s["gap"] / (s["D_F"] * s["A"]),
    "inverse_aperture_constant": lambda s: s["A"] / s["d_1"],
    "vergence_at_mla_per_mm": lambda s: s["vergence"],
    "f_number_microlens": lambda s: s["d_2"] / s["d"],
    "f_number_pupil": lambda s: s["A"] / s["D_F"],
    "f_number_main_lens": lambda s: s["d_1"] / s["D"],
    "centre_shift_px_per_microlens": lambda s: s["d"] * s["d_2"] * s["d_3"] / (s["q"] * s["d_1"] * s["A"]),
    "views_independent": lambda s: s["d"] * s["d"] / (s["wavelength"] * s["d_2"]),
    "object_sample_mm": lambda s: s["d"] * s["d_f"] / s["d_1"],
    "view_baseline_mm": lambda s: s["q"] * s["A"] / s["d_2"],
    "fresnel_number": lambda s: s["d"] * s["d"] / (4 * s["wavelength"] * s["d_2"]),
    "airy_radius_px": lambda s: 1.22 * s["wavelength"] * s["d_2"] / (s["d"] * s["q"]),
}
"""Closed forms of an aligned camera, in f, d_1 and the rest; A = d_1/H, d_f follows from f and d_1."""


def exact_derivatives(design: Design, metric: str) -> dict[str, float] | None:
    """Derivatives of a metric by the places that it depends on; None where it has no closed form here.

    Exact for an aligned design behind an ideal lens, whose fields all have the same value. By decentres and tilts there
    are none here. The places f and d_1 are hardware: d_f follows.
    """
    if metric not in FORMULAS or not design.aligned or design.lens is not None:
        return None
    own = {"pixel": design.sensor.pixel, "relay": design.sensor.relay_magnification}
    at = np.array([own.get(symbol) or getattr(design, symbol) for symbol in PLACES])
    steps = STEP * np.where(at == 0, 1.0, at)
    s = dict(zip(PLACES, at[:, None] + 1j * np.diag(steps), strict=True))
    s["q"] = s["pixel"] / s["relay"]
    s["d_f"] = s["f"] * s["d_1"] / (s["d_1"] - s["f"])
    s["gap"] = s["d_f"] - s["d_3"]
    s["A"] = s["d_1"] * s["gap"] / s["d_f"]
    s["vergence"] = (s["f"] - s["d_3"]) / (s["f"] * s["A"])
    s["diameter"] = s["D_F"] * s["d_2"] / s["A"]
    s["pitch"] = s["d"] * (1 + s["d_2"] * s["vergence"])
    return dict(zip(PLACES.values(), (FORMULAS[metric](s).imag / steps).tolist(), strict=True))
