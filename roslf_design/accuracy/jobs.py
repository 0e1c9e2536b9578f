"""What is computed: a quantity of a design at a field, as the few arrays that every method works on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .. import theory
from ..design import Design
from ..evaluation.fields import field_discs

Floats = NDArray[np.float64]

Quantity = Literal[
    "kept fraction",
    "centroid",
    "area",
    "pixel image",
    "diffraction image",
    "cut diffraction image",
    "textured image",
    "real lens",
    "depth",
]

QUANTITIES: dict[str, str] = {
    "kept fraction": "share of the pupil's light that one microlens gets; error absolute",
    "centroid": "centroid of the microlens image; error over the radius of the pupil's image",
    "area": "area of the microlens image; error relative",
    "pixel image": "light of each pixel behind one microlens, by rays; largest error, 1 is a fully lit pixel",
    "diffraction image": "pixels with the microlens's diffraction, all neighbours alike; largest error",
    "cut diffraction image": "diffraction image of one microlens alone behind a pupil that rims cut; largest error",
    "textured image": "pixels by rays, of a sinusoid off the focal plane; largest error",
    "real lens": "rays of one microlens through a real lens; largest miss on the focal plane over its sample there",
    "depth": "half of the range of depths that holds 68.3 % of measurements; error relative",
}
"""Each quantity, and what its error means."""

CUT = "cut diffraction image"
LENS = "real lens"

SIGMA_DISPARITY = 0.1
"""Disparity error of `depth` [pitches]."""


@dataclass(frozen=True)
class Job:
    """One thing to compute."""

    quantity: str
    design: Design = field(repr=False)
    axis: tuple[float, float] = (0.0, 0.0)
    """Microlens, on the array [mm]."""
    distance: float = 0.0
    """Z of the sinusoid, or depth Z_F that is measured [mm]; 0 is 0.8 of that of the focal plane."""
    cycles: float = 1.3
    """Of the sinusoid across one microlens image."""
    angle: float = 0.3
    """Its direction [rad]."""

    @cached_property
    def discs(self) -> tuple[Floats, Floats]:
        """Rims on the sensor relative to the microlens axis, in pixels; those around the FAP's left out."""
        centres, radii = field_discs(self.design, [self.axis])
        c, r = centres[0] / self.design.q, radii[0] / self.design.q
        cuts = np.hypot(*(c - c[0]).T) + r[0] > r
        cuts[0] = True
        return np.ascontiguousarray(c[cuts]), np.ascontiguousarray(r[cuts])

    @property
    def radius(self) -> float:
        """Of the pupil's image [px]."""
        return float(self.discs[1][0])

    @cached_property
    def box(self) -> tuple[Floats, int]:
        """Lower corner of the patch of pixels [px], and its width in pixels: the pupil's image and one more around."""
        centre = self.discs[0][0]
        corner = np.floor(centre - self.radius - 0.37) - 0.37
        return corner, math.ceil(2 * self.radius + 2)

    @property
    def pixels(self) -> int:
        """In the patch."""
        return self.box[1] ** 2

    @cached_property
    def cells(self) -> tuple[Floats, Floats]:
        """Corners of the patch's pixels, row by row, shapes (P, 2) [px]."""
        corner, width = self.box
        at = np.arange(width)
        low = np.stack([np.tile(at, width), np.repeat(at, width)], -1) + corner
        return low, low + 1

    @cached_property
    def depth(self) -> float:
        """Z_F [mm]."""
        return self.distance or 0.8 * (self.design.d_f - self.design.d_3)

    @cached_property
    def wave(self) -> tuple[float, float, float]:
        """Sinusoid on the sensor: cycles per pixel along x and y, and its phase at the microlens axis [cycles]."""
        rate = self.cycles / (2 * self.radius)
        phase = 0.17 + math.modf(3.1 * self.axis[0] / self.design.d)[0]
        return rate * math.cos(self.angle), rate * math.sin(self.angle), phase

    @cached_property
    def blur(self) -> tuple[float, float, float]:
        """Microlens diffraction in pixels: its width lambda d_2/d; image pitch; defocus 1/f_ml - 1/d_2 - 1/L [1/mm]."""
        design = self.design
        optics = design.f, design.d_f, design.d_3
        pitch = float(theory.microlens_image_pitch(design.d, design.d_2, *optics))
        bend = 1 / design.f_ml - 1 / design.d_2 - float(theory.exit_pupil_vergence(*optics))
        return design.wavelength * design.d_2 / design.d / design.q, pitch / design.q, bend

    @property
    def harmonics(self) -> int:
        """Highest harmonic that diffraction lets pass, along each axis."""
        width, pitch, _ = self.blur
        return math.floor(pitch / width)

    def texture(self, x: Floats, y: Floats) -> Floats:
        """Brightness of the sinusoid that each sensor point sees [px]."""
        along, across, phase = self.wave
        return np.asarray(0.5 + 0.5 * np.cos(2 * math.pi * (along * x + across * y + phase)))

    def error(self, value: Floats, truth: Floats) -> float:
        """How far a result is off, as `QUANTITIES` tells."""
        if self.quantity == LENS:
            return self._lens_error(value, truth)
        off = float(np.max(np.abs(np.asarray(value) - truth)))
        if self.quantity == "centroid":
            return off / self.radius
        if self.quantity in ("area", "depth"):
            top = float(np.max(np.abs(truth)))
            return off / top if top > 0 else (0.0 if off == 0 else math.inf)
        return off

    def _lens_error(self, value: Floats, truth: Floats) -> float:
        """Rays that many digits are known of; in units of d d_f/d_1, what one microlens sees of the focal plane."""
        ends, known = np.reshape(value, (-1, 2)), np.reshape(truth, (-1, 2))
        off = np.hypot(*(ends[:: len(ends) // len(known)] - known).T)
        return float(np.max(off)) / (self.design.d * self.design.d_f / self.design.d_1)


def panels(design: Design) -> dict[str, Design]:
    """Cameras that between them show every difficulty, made from one design; `panel_axis` tells which microlens."""
    edge = design.sensor_size[0] / 2
    gap = design.d_f - design.d_3
    # Where the pencil of the microlens at the sensor's edge lies on the main lens.
    off, radius = edge * design.d_f / design.d_1 * design.d_3 / gap, design.D_F / 2 * design.d_f / gap
    slim = max(design.D_F * 1.0001, 2 * math.hypot(off, 0.4 * radius) if off > radius else 1.2 * radius)
    fresnel = float(theory.fresnel_number(design.d, design.d_2, design.wavelength))
    found = {"round": design}
    if off > 0:
        found["cat's eye"] = design.replace({"main_lens.diameter": slim})
        tangent = 2 * (off - radius * (1 - 1e-5))
        if tangent > design.D_F:
            found["near tangent"] = design.replace({"main_lens.diameter": tangent})
    for number in (0.9, 4.0, 24.0):
        found[f"N_F {number:g}"] = design.replace({"light.wavelength": design.wavelength * fresnel / number})
    wide = design.d_3 / 3 if design.d_3 else 0.0
    found["mismatched"] = design.replace({"aperture.distance": wide, "aperture.diameter": design.D_F * 1.15})
    return found


def panel_axis(name: str, design: Design) -> tuple[float, float]:
    """Which microlens a panel looks at [mm]."""
    edge = design.sensor_size[0] / 2
    return (edge, 0.0) if name in ("cat's eye", "near tangent") else (0.31 * edge, 0.17 * edge)


def panel_jobs(design: Design, quantity: str) -> dict[str, Job]:
    """Jobs of one quantity, one a panel that it differs on."""
    if quantity == CUT:
        return _cut_jobs(design)
    if quantity == LENS:
        from .lens_jobs import panels_of

        return {name: Job(LENS, camera, axis) for name, camera, axis in panels_of(design)}
    waves = quantity == "diffraction image"
    found = {}
    for name, camera in panels(design).items():
        is_wave = name.startswith("N_F") or name == "mismatched"
        if (waves and not is_wave) or (not waves and name.startswith("N_F")):
            continue
        if quantity == "depth" and name not in ("round", "mismatched"):
            continue
        axis = panel_axis(name, camera) if not waves else (0.0, 0.0)
        found[name] = Job(quantity, camera, axis)
    return found


def _cut_jobs(design: Design) -> dict[str, Job]:
    """Cat's eyes from coarse to fine waves; one almost closed; one that the rim almost misses."""
    made = panels(design)
    edge = design.sensor_size[0] / 2
    gap = design.d_f - design.d_3
    off, radius = edge * design.d_f / design.d_1 * design.d_3 / gap, design.D_F / 2 * design.d_f / gap
    if "cat's eye" not in made:
        return {"round": Job(CUT, design, panel_axis("round", design))}
    found = {}
    eye = made["cat's eye"]
    for number in (0.9, 4.0, 24.0):
        wave = made[f"N_F {number:g}"].wavelength
        found[f"cat's eye, N_F {number:g}"] = Job(CUT, eye.replace({"light.wavelength": wave}), (edge, 0.0))
    for name, reach in (("almost closed", off - 0.96 * radius), ("barely cut", off + (1 - 1e-6) * radius)):
        if 2 * reach > design.D_F:
            found[name] = Job(CUT, design.replace({"main_lens.diameter": 2 * reach}), (edge, 0.0))
    return found
