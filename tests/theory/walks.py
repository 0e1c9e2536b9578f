"""Walks towards the singular points of the closed forms, and the points themselves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from tests.theory.designs import fill_in

GAPS = tuple(10.0**-k for k in range(1, 16))


def approach(target: float) -> Iterator[float]:
    """Values from both sides of a target: relative gaps down to 1e-15, then its neighbours."""
    for gap in GAPS:
        yield target * (1 - gap)
        yield target * (1 + gap)
    yield math.nextafter(target, 0)
    yield math.nextafter(target, math.inf)


def vanish() -> Iterator[float]:
    """Values that go to zero, as far as 60 digits resolve them beside lengths of 100."""
    yield from (10.0**-k for k in range(0, 33, 3))


def walk(kind: str, seed: int = 5) -> Iterator[dict[str, Any]]:
    """Designs on the way to one singular point; the point itself is left to the tests of limits."""
    rng = np.random.default_rng(seed)
    f, d_f, d_3 = 100.0, 350.0, 120.0
    base = fill_in(rng, f, d_f, d_3)
    if kind == "d_3 -> d_f":
        yield from (base | {"pupil_distance": v} for v in approach(d_f))
    elif kind == "d_3 -> f":
        yield from (base | {"pupil_distance": v} for v in approach(f))
    elif kind == "d_3 -> 0":
        yield from (base | {"pupil_distance": v} for v in vanish())
    elif kind == "d_f -> f":
        yield from (base | {"focal_plane_distance": v, "pupil_distance": 20.0} for v in approach(f) if v > f)
    elif kind == "d_1 -> f":
        yield from (base | {"mla_distance": v} for v in approach(f))
    elif kind == "D_F -> 0":
        yield from (base | {"pupil_diameter": v} for v in vanish())
    elif kind == "d_2 -> 0":
        yield from (base | {"sensor_distance": v} for v in vanish())
    elif kind == "Z_F -> g":
        yield from (base | {"depth": v} for v in approach(d_f - d_3))
    elif kind == "Z -> inf":
        yield from (base | {"depth": 1 / v} for v in vanish())
    elif kind == "d_f -> inf":
        yield from (base | {"focal_plane_distance": f / v} for v in vanish() if v < 1)
    elif kind == "scale":
        for k in range(-6, 7):
            scale = 10.0**k
            yield fill_in(rng, f * scale, d_f * scale, d_3 * scale)
            lens = {"focal_length": f * scale, "focal_plane_distance": d_f * scale, "pupil_distance": d_3 * scale}
            yield base | lens | {"stop_distance": 60.0 * scale}
    elif kind == "matched":
        # Pupil at which the images just touch, and its neighbours: differences of equal terms.
        touch = base["microlens_pitch"] / base["sensor_distance"] * 92.0
        yield from (base | {"pupil_diameter": v} for v in approach(touch))
    else:
        raise ValueError(kind)


WALKS = (
    "d_3 -> d_f",
    "d_3 -> f",
    "d_3 -> 0",
    "d_f -> f",
    "d_1 -> f",
    "D_F -> 0",
    "d_2 -> 0",
    "Z_F -> g",
    "Z -> inf",
    "d_f -> inf",
    "scale",
    "matched",
)
