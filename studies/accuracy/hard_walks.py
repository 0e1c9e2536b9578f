"""Walks of the hard cases: a design's numbers on the way to a singular point."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from roslf_design.camera import Camera
from roslf_design.design import Design

Numbers = Mapping[str, Any]
"""Arguments of closed forms by keyword; pairs for places."""
Rng = np.random.Generator

JITTER = 1e-3
"""Relative spread by which all other arguments are moved at every step of a walk, so that no round number helps."""

NUMBERS_WITHOUT_LENGTH = frozenset({"magnification", "disparity_sigma", "exact"})
"""Keywords that do not scale with the camera."""


def arguments_of(design: Design) -> dict[str, Any]:
    """One value for every keyword of the closed forms: the design's own lengths, and scenes of its own size."""
    camera = Camera.of(design)
    d_3 = design.d_3 or 0.01 * design.f
    x = design.sensor_size[0] / 2
    magnification = float(camera.seen.m)
    stop = design.stops[0] if design.stops else None
    return {
        "focal_length": design.f,
        "focal_plane_distance": design.d_f,
        "mla_distance": design.d_1,
        "pupil_distance": d_3,
        "pupil_diameter": design.D_F,
        "lens_diameter": design.D,
        "sensor_distance": design.d_2,
        "microlens_pitch": design.d,
        "pixel_pitch": design.q,
        "wavelength": design.wavelength,
        "microlens_focal_length": design.f_ml,
        "magnification": magnification,
        "effective_image_distance": float(camera.seen.A),
        "depth": 0.8 * (design.d_f - design.d_3),
        "disparity_sigma": 0.1,
        "radius": 0.7 * x / magnification,
        "stop_diameter": stop.diameter if stop else 1.4 * design.D_F,
        "stop_distance": stop.distance if stop else 0.4 * d_3,
        "stop_decentre": (0.02 * design.D_F, -0.01 * design.D_F),
        "microlens_centre": (0.7 * x, 0.4 * x),
        "exact": True,
    }


def jittered(numbers: Numbers, rng: Rng) -> dict[str, Any]:
    """The same, every number moved a little."""

    def move(value: Any) -> Any:
        if isinstance(value, bool):
            return value
        if isinstance(value, tuple):
            return tuple(move(part) for part in value)
        return value * (1 + JITTER * float(rng.uniform(-1, 1)))

    return {key: move(value) for key, value in numbers.items()}


class Step(NamedTuple):
    """One place on a walk."""

    gap: float
    """Distance from the singular point, relative to the lengths there; of the walk in scale, the scale."""
    numbers: dict[str, Any]


Walk = Callable[[Numbers, Rng, int], Iterator[Step]]
"""From a design's numbers, a generator and a count of steps."""


def gaps(rng: Rng, count: int, least: float = 1e-16) -> list[float]:
    """Log-uniform between 0.1 and `least`, largest first."""
    return sorted((10 ** float(rng.uniform(math.log10(least), -1)) for _ in range(count)), reverse=True)


def approach(target: float, rng: Rng, count: int, above_only: bool = False) -> Iterator[float]:
    """Values on the way to a target from both sides, the last its very neighbours."""
    for gap in gaps(rng, count):
        side = 1.0 if above_only else float(rng.choice([-1, 1]))
        value = target * (1 + side * gap)
        if value != target:
            yield value
    if not above_only:
        yield math.nextafter(target, -math.inf)
    yield math.nextafter(target, math.inf)


def towards(key: str, target: Callable[[Numbers], float], above_only: bool = False) -> Walk:
    """Walk of one argument towards a value that the others give."""

    def walk(numbers: Numbers, rng: Rng, count: int) -> Iterator[Step]:
        for n in range(count + 2):
            moved = jittered(numbers, rng)
            if key == "focal_plane_distance":
                moved["pupil_distance"] = 0.2 * moved["focal_length"]
            goal = target(moved)
            places = list(approach(goal, rng, 1, above_only))
            # The last two steps are the neighbours on each side.
            value = places[0] if n < count else places[-1 - (n - count) % (1 if above_only else 2)]
            yield Step(abs(value - goal) / abs(goal), moved | {key: value})

    return walk


def scaling(key: str, power: int) -> Walk:
    """Walk of one argument to zero (power 1) or to infinity (-1); the gap is its part of, or under, the one at hand."""

    def walk(numbers: Numbers, rng: Rng, count: int) -> Iterator[Step]:
        for gap in gaps(rng, count, 1e-30):
            moved = jittered(numbers, rng)
            yield Step(gap, moved | {key: moved[key] * gap if power > 0 else moved[key] / gap})

    return walk


def rescaled(numbers: Numbers, rng: Rng, count: int) -> Iterator[Step]:
    """Cameras of other sizes, 1e-6 to 1e6 times this one."""
    for n in range(count):
        scale = 10 ** (12 * n / max(1, count - 1) - 6)
        moved = jittered(numbers, rng)
        for key in moved.keys() - NUMBERS_WITHOUT_LENGTH:
            value = moved[key]
            moved[key] = tuple(scale * part for part in value) if isinstance(value, tuple) else scale * value
        yield Step(scale, moved)
