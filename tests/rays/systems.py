"""Cameras for the tests of the ray engine: the paper's, and random ones of every size."""

from __future__ import annotations

from typing import Any

import numpy as np

from roslf_design.rays import Array, Lens, Sensor, Stop, System

PAPER = System(Lens(100.0, 50.8), (Stop(2.9, 120.0),), Array(140.0, 2.0, 0.063), Sensor(2.0, (22.3, 14.932)))


def random_system(rng: np.random.Generator, *, stops: int = 2, decentred: bool = True, tilted: bool = True) -> System:
    """A camera with every element somewhat out of place."""
    f = 10 ** rng.uniform(0, 2.3)
    m = 10 ** rng.uniform(-1.3, 0.3)
    d_1, d_f = f * (1 + m), f * (1 + m) / m
    d = 10 ** rng.uniform(-2, -1)
    d_2 = d * rng.uniform(3, 40)
    # As large as suits the microlenses, so that rays come near every rim.
    width = d * d_1 / d_2

    def pose(size: float, tilt: float = 0.1) -> dict[str, Any]:
        return {
            "decentre": tuple(rng.normal(0, 0.1 * size, 2)) if decentred else (0.0, 0.0),
            "tilt": tuple(rng.uniform(-tilt, tilt, 2)) if tilted else (0.0, 0.0),
        }

    rims = [Stop(width * rng.uniform(0.4, 1.5), d_f * rng.uniform(0, 0.8), **pose(width, 0.3)) for _ in range(stops)]
    shape = ("square", "circular")[rng.integers(2)]
    turn = rng.uniform(-0.1, 0.1) if tilted else 0.0
    return System(
        Lens(f, width * rng.uniform(1, 3), **pose(width)),
        tuple(rims),
        Array(d_1, d_2 * rng.uniform(0.8, 1.2), d, lens_shape=shape, rotation=turn, **pose(d)),
        Sensor(d_2, **pose(d)),
    )


def random_points(system: System, rng: np.random.Generator, count: int, field: float = 10.0) -> tuple[Any, Any, Any]:
    """Sensor points, microlens axes and offsets, each of shape (2, count), near enough to pass now and then."""
    d = float(system.array.pitch)
    c = rng.uniform(-field, field, (2, count)) * d
    return (
        c * (1 + 0.01 * rng.normal(size=count)) + rng.uniform(-0.7, 0.7, (2, count)) * d,
        c,
        rng.uniform(-0.55, 0.55, (2, count)) * d,
    )
