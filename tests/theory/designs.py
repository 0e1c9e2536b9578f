"""Random and singular designs: one value for every keyword of the closed forms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from studies.accuracy.oracles.closed_forms import keywords

P1 = {
    "lens_diameter": 50.8,
    "pupil_diameter": 2.9,
    "focal_length": 100.0,
    "focal_plane_distance": 350.0,
    "mla_distance": 140.0,
    "sensor_distance": 2.0,
    "pupil_distance": 120.0,
    "microlens_pitch": 0.063,
    "pixel_pitch": 0.004847826,
    "wavelength": 550e-6,
    "microlens_focal_length": 2.0,
}
"""The paper's bench system."""


def random_designs(count: int, seed: int = 20230101) -> Iterator[dict[str, Any]]:
    """Designs over six decades of size; a third of them with a pupil within 1e-9 of a special place."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        f = 10 ** rng.uniform(-1, 3)
        d_f = f * (1 + 10 ** rng.uniform(-4, 3))
        kind = rng.integers(6)
        near = 1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-15, -9)
        d_3 = (rng.uniform(0, d_f), rng.uniform(0, f), min(f * near, d_f), d_f / max(near, 2 - near), f, 0.0)[kind]
        yield fill_in(rng, float(f), float(d_f), float(d_3))


def fill_in(rng: np.random.Generator, f: float, d_f: float, d_3: float) -> dict[str, Any]:
    """All other arguments, drawn at random around that geometry."""

    def spread(low: float, high: float) -> float:
        return float(10 ** rng.uniform(low, high))

    def pair(scale: float) -> tuple[float, float]:
        return float(scale * rng.normal()), float(scale * rng.normal())

    depth_sense = rng.integers(3)
    gap = d_f - d_3
    depth = (spread(-2, 4), abs(gap) * (1 + spread(-15, -6)), abs(gap) * spread(-1, 1))[depth_sense]
    stop_distance = float(rng.uniform(0, d_3))
    m = spread(-2, 1)
    return {
        "focal_length": f,
        "focal_plane_distance": d_f,
        "mla_distance": f * spread(0.001, 2),
        "pupil_distance": d_3,
        "pupil_diameter": spread(-2, 1.5),
        "lens_diameter": spread(-1, 2.5),
        "sensor_distance": spread(-2, 1),
        "microlens_pitch": spread(-3, 0),
        "pixel_pitch": spread(-4, -1),
        "wavelength": spread(-4, -2),
        "microlens_focal_length": spread(-2, 1),
        "magnification": m,
        "effective_image_distance": spread(-1, 3),
        "depth": depth,
        "disparity_sigma": spread(-3, 0),
        "radius": float(rng.normal()) * spread(-2, 3),
        "stop_diameter": spread(-1, 2.5),
        "stop_distance": stop_distance,
        "stop_decentre": pair(spread(-3, 0)),
        "microlens_centre": pair(spread(-2, 1)),
        "exact": bool(rng.integers(2)),
    }


def arguments(name: str, design: Mapping[str, Any]) -> dict[str, Any]:
    """What the closed form of that name takes, out of a design."""
    return {key: design[key] for key in keywords(name)}
