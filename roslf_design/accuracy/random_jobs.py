"""Jobs of any kind, drawn at random around a design: what the table is measured on, and what the choice is tried on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .. import theory
from ..design import Design, DesignError
from .jobs import LENS, QUANTITIES, Job
from .lens_jobs import random_lens_design


def random_job(design: Design, quantity: str, rng: np.random.Generator) -> Job:
    """A camera of other f-numbers, vignetting, field, pixels and wavelength, and one quantity of it.

    Parameters
    ----------
    design : Design
        To start from.
    quantity : str
        One of `jobs.QUANTITIES`.
    rng : numpy.random.Generator
    """
    if quantity == LENS:
        camera = random_lens_design(design, rng)
        x, y = (float(rng.uniform(-0.22, 0.22)) * side for side in camera.microlens_array.size)
        return Job(LENS, camera, (x, y))
    while True:
        d_3 = float(rng.uniform(0, 0.75)) * design.d_f
        x, y = (float(rng.uniform(-0.5, 0.5)) * side for side in design.sensor_size)
        gap = design.d_f - d_3
        D_F = design.D_F * float(rng.uniform(0.6, 1.5)) * (gap / (design.d_f - design.d_3))
        pencil, off = D_F * design.d_f / gap, float(np.hypot(x, y)) * design.d_f / design.d_1 * d_3 / gap
        # Half of the lenses clip: from whole to almost nothing.
        room = rng.uniform(-0.45, 0.6) if rng.random() < 0.5 else 1.0
        lens = max(2 * off + room * pencil * 2, 1.001 * D_F, 0.1)
        pixels = float(rng.uniform(6, 22))
        fresnel = 10 ** float(rng.uniform(np.log10(0.6), np.log10(24)))
        image = float(theory.microlens_image_diameter(D_F, design.d_2, design.f, design.d_f, d_3))
        wave = design.wavelength * float(theory.fresnel_number(design.d, design.d_2, design.wavelength)) / fresnel
        try:
            camera = design.replace(
                {
                    "aperture.distance": d_3,
                    "aperture.diameter": D_F,
                    "main_lens.diameter": lens,
                    "sensor.pixel": image / pixels * design.sensor.relay_magnification,
                    "light.wavelength": wave,
                }
            )
        except DesignError:
            continue
        axis = (0.0, 0.0) if quantity == "diffraction image" else (x, y)
        return Job(
            quantity,
            camera,
            axis,
            gap * float(rng.uniform(0.4, 1.6)) if quantity == "depth" else 0.0,
            float(rng.uniform(0.3, 2.5)),
            float(rng.uniform(0, np.pi)),
        )


def random_jobs(design: Design, count: int, seed: int) -> Iterator[tuple[Job, float]]:
    """Jobs of all quantities in turn, each with an accuracy between 1e-1 and 1e-9."""
    rng = np.random.default_rng(seed)
    names = tuple(QUANTITIES)
    for n in range(count):
        yield random_job(design, names[n % len(names)], rng), 10 ** -float(rng.uniform(1, 9))
