"""Promises of `roslf render`, with `--accuracy` and by budgets, tried on random pictures against many rays.

    python -m studies.accuracy.pictures [jobs] [seed]

Round and hexagonal arrays, images cut by the main lens, elements, a real lens; edges, gratings and noise; with and
without diffraction.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np

from roslf_design.accuracy.picture import settle
from roslf_design.camera import Camera
from roslf_design.design import Design, load
from roslf_design.effects import Budget, plan
from roslf_design.errors import InputError
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import TOGETHER, RaySampling
from roslf_design.scenes import Checkerboard, Noise, Plane, Scene, Sinusoid
from roslf_design.theory.quantities import QUANTITIES

SHARP = ("-microlens_diffraction", "-microlens_defocus")
SIDES = (48, 40)
"""Pixels of a picture."""


class Tried(NamedTuple):
    """One picture against its reference."""

    name: str
    asked: float
    """Error of 99 of 100 pixels that was promised at most."""
    error: float
    worst: float
    """Error of the worst pixel."""
    rays: float
    """Rays a pixel, those around the picture included."""


def cameras() -> dict[str, Design]:
    """Cameras whose pixels are hard in different ways."""
    paper = load("paper")
    return {
        "paper": paper,
        "round": paper.replace({"microlens_array.lens_shape": "circular"}),
        "hexagonal": paper.replace({"microlens_array.layout": "hexagonal", "microlens_array.lens_shape": "circular"}),
        "cut": paper.replace({"main_lens.diameter": 32.0}),
        "elements": load("cystoscope"),
        "real lens": load("paper-singlet"),
    }


def try_picture(name: str, design: Design, rng: np.random.Generator, *, by_budget: bool) -> Tried:
    """Draw a scene, a place and an accuracy, and hold the picture against one of many rays of another seed."""
    sample = float(QUANTITIES["object_sample_mm"](Camera.of(design.thin_twin)))
    period = sample * float(np.exp(rng.uniform(np.log(4), np.log(30))))
    kind = rng.integers(3)
    texture = Noise(finest=period / 2, seed=1) if kind == 2 else (Checkerboard, Sinusoid)[kind](period=period)
    scene = Scene(objects=(Plane(distance=design.d_f * float(rng.uniform(0.9, 1.1)), texture=texture),))
    overrides = ("-noise", *(SHARP if rng.random() < 0.25 and not design.lens else ()))
    asked = float(np.exp(rng.uniform(np.log(0.03 if len(overrides) > 1 else 0.006), np.log(0.12))))
    column, row = (int(rng.integers(most - side + 1)) for most, side in zip(design.pixels, SIDES, strict=True))
    region = column, row, *SIDES
    seed = int(rng.integers(1000))
    if by_budget:
        budget = Budget(intensity=asked / 2)
        lines, sampling = plan(design, scene, budget, overrides), None
    else:
        way = settle(design, scene, asked, overrides, seed=seed, region=region)
        budget, lines, sampling = way.budget, way.plan, way.sampling
    most = 4096 if len(overrides) > 1 else 1024
    many = RaySampling(most, most, 0.0, seed + 5000, side=32, together=1 if len(overrides) > 1 else TOGETHER)
    shown, truth = (
        render(design, scene, effects=lines, budget=budget, sampling=one, region=region, seed=seed)
        for one in (sampling, many)
    )
    off = np.abs(shown.pixels.astype(float) - truth.pixels)
    way_of = "budget" if by_budget else "accuracy"
    return Tried(f"{name}, {way_of}", asked, float(np.quantile(off, 0.99)), float(off.max()), shown.rays / off.size)


def main(jobs: int = 60, seed: int = 0) -> None:
    """Print every picture that was tried, and how many kept what was promised."""
    rng, known = np.random.default_rng(seed), list(cameras().items())
    kept = 0
    for n in range(jobs):
        try:
            one = try_picture(*known[n % len(known)], rng, by_budget=n // len(known) % 2 == 1)
        except InputError as refused:  # out of reach, as is said beforehand
            print(refused)
            kept += 1
            continue
        kept += one.error <= one.asked
        print(f"{one.name:20} {one.asked:.4f} {one.error:.4f} {one.worst:.4f} {one.rays:8.1f} rays a pixel", flush=True)
    print(f"{kept} of {jobs} within what was promised, or refused")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
