"""Exact derivatives of the closed forms: numbers that carry their partial derivatives along."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..design import Design
from .axial import SIGMA_DISPARITY


@dataclass(frozen=True)
class Dual:
    """A value and its partial derivatives by name."""

    value: float
    partials: Mapping[str, float]

    def __add__(self, other: Dual | float) -> Dual:
        b = _dual(other)
        return Dual(self.value + b.value, _combine(self, 1.0, b, 1.0))

    __radd__ = __add__

    def __sub__(self, other: Dual | float) -> Dual:
        b = _dual(other)
        return Dual(self.value - b.value, _combine(self, 1.0, b, -1.0))

    def __rsub__(self, other: float) -> Dual:
        return _dual(other) - self

    def __mul__(self, other: Dual | float) -> Dual:
        b = _dual(other)
        return Dual(self.value * b.value, _combine(self, b.value, b, self.value))

    __rmul__ = __mul__

    def __truediv__(self, other: Dual | float) -> Dual:
        b = _dual(other)
        return Dual(self.value / b.value, _combine(self, 1 / b.value, b, -self.value / b.value**2))

    def __rtruediv__(self, other: float) -> Dual:
        return _dual(other) / self


def _dual(value: Dual | float) -> Dual:
    return value if isinstance(value, Dual) else Dual(value, {})


def _combine(a: Dual, wa: float, b: Dual, wb: float) -> dict[str, float]:
    names = {**a.partials, **b.partials}
    return {name: wa * a.partials.get(name, 0.0) + wb * b.partials.get(name, 0.0) for name in names}


FORMULAS: dict[str, Callable[[dict[str, Dual]], Dual]] = {
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
    """Derivatives of a metric by every place that it depends on; None where it has no closed form here.

    Exact for an aligned design, whose fields all have the same value. By decentres and tilts there are none here. The
    places f and d_1 are hardware: d_f follows.
    """
    if metric not in FORMULAS or not design.aligned:
        return None
    places = {
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
    values = {"pixel": design.sensor.pixel, "relay": design.sensor.relay_magnification}
    s = {
        symbol: Dual(values[symbol] if symbol in values else getattr(design, symbol), {place: 1.0})
        for symbol, place in places.items()
    }
    s["q"] = s["pixel"] / s["relay"]
    s["d_f"] = s["f"] * s["d_1"] / (s["d_1"] - s["f"])
    s["gap"] = s["d_f"] - s["d_3"]
    s["A"] = s["d_1"] * s["gap"] / s["d_f"]
    s["vergence"] = (s["f"] - s["d_3"]) / (s["f"] * s["A"])
    s["diameter"] = s["D_F"] * s["d_2"] / s["A"]
    s["pitch"] = s["d"] * (1 + s["d_2"] * s["vergence"])
    return dict(FORMULAS[metric](s).partials)
