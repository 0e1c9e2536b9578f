"""A million designs through every closed form of `roslf_design.theory`, one core."""

from __future__ import annotations

import inspect
import statistics
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roslf_design import theory

DESIGNS = 1_000_000
GOAL = 1.0
"""[s], all closed forms together."""
SLOWEST = 8

MATRICES = {
    "pupil_frame",
    "view_projection",
    "microlens_projection",
    "light_field_projection",
    "light_field_reconstruction",
    "ray_matrix",
    "decoding_matrix",
    "project",
    "from_homogeneous",
    "back_substitution_jacobian",
    "back_substitution_covariance",
}
"""Projection and error propagation: matrices per design, not numbers; timed beside."""

Arrays = dict[str, NDArray[np.float64]]


def main(repeats: int = 5) -> None:
    """Print the time of all closed forms together, of the slowest, and of one plain division."""
    design = designs(DESIGNS)
    calls = [(name, keywords(name)) for name in closed_forms()]
    totals, each = [], {name: [0.0] * repeats for name, _ in calls}
    for repeat in range(repeats):
        start = time.perf_counter()
        for name, keys in calls:
            begin = time.perf_counter()
            getattr(theory, name)(**{key: design[key] for key in keys})
            each[name][repeat] = time.perf_counter() - begin
        totals.append(time.perf_counter() - start)
    median, worst = statistics.median(totals), max(totals)
    print(
        f"{DESIGNS:,} designs through {len(calls)} closed forms: {median:.2f} s (worst {worst:.2f} s, goal {GOAL} s), "
        f"{1e9 * median / DESIGNS / len(calls):.1f} ns a value"
    )
    times = sorted(((statistics.median(seconds), name) for name, seconds in each.items()), reverse=True)
    for seconds, name in times[:SLOWEST]:
        print(f"  {name:32s} {1e9 * seconds / DESIGNS:6.1f} ns a design")
    print(f"  {'one plain numpy division':32s} {1e9 * division(design):6.1f} ns a design")
    for name, seconds in matrix_times(design).items():
        print(f"  {name:32s} {1e9 * seconds:6.1f} ns a matrix")


def designs(count: int, seed: int = 1) -> Arrays:
    """Random designs around the paper's, an array for every keyword of the closed forms."""
    rng = np.random.default_rng(seed)

    def around(value: float) -> NDArray[np.float64]:
        return value * rng.uniform(0.8, 1.25, count)

    centre = {
        "lens_diameter": 50.8,
        "pupil_diameter": 2.9,
        "focal_length": 100.0,
        "focal_plane_distance": 350.0,
        "mla_distance": 140.0,
        "pupil_distance": 120.0,
        "sensor_distance": 2.0,
        "microlens_pitch": 0.063,
        "pixel_pitch": 0.0048,
        "wavelength": 550e-6,
        "microlens_focal_length": 2.0,
        "exit_pupil_vergence": -0.002,
        "magnification": 0.4,
        "effective_image_distance": 92.0,
        "index": 100.0,
        "pixel": 4.0,
        "coordinate": 1.0,
        "centre": 0.5,
        "slope": 0.5,
        "depth": 230.0,
        "disparity_sigma": 0.1,
        "width": 22.3,
        "field_radius": 28.0,
        "distance": 350.0,
        "radius": 28.0,
        "stop_diameter": 20.0,
        "stop_distance": 60.0,
    }
    values = {name: around(value) for name, value in centre.items()}
    pairs = {"point": 28.0, "stop_decentre": 0.1, "pupil_decentre": 0.1, "microlens_centre": 11.0}
    return values | {name: size * rng.standard_normal((count, 2)) for name, size in pairs.items()}


def closed_forms() -> list[str]:
    """Names of the public functions that give numbers, from numbers; `conjugates` only picks among them."""
    names = [name for name in theory.__all__ if inspect.isfunction(getattr(theory, name))]
    return [name for name in names if name not in MATRICES | {"conjugates"}]


def keywords(name: str) -> list[str]:
    """Arguments of a closed form, those with a default that is no length left out."""
    parameters = inspect.signature(getattr(theory, name)).parameters
    return [key for key in parameters if key not in {"exact", "tolerance", "weight"}]


def division(design: Mapping[str, NDArray[np.float64]]) -> float:
    """Seconds a design for what no closed form can undercut: one division in numpy."""
    start = time.perf_counter()
    design["focal_length"] / design["depth"]
    return (time.perf_counter() - start) / DESIGNS


def matrix_times(design: Mapping[str, NDArray[np.float64]], count: int = 20_000) -> dict[str, float]:
    """Seconds a matrix for the projections."""
    few: dict[str, Any] = {key: value[:count] for key, value in design.items()}
    keys = ("effective_image_distance", "magnification", "microlens_pitch", "pixel_pitch", "sensor_distance")
    parameters = [few[key] for key in keys]
    timed = {}
    for name, leading in (("view_projection", [few["point"]]), ("light_field_projection", []), ("ray_matrix", [])):
        start = time.perf_counter()
        getattr(theory, name)(*leading, *parameters)
        timed[name] = (time.perf_counter() - start) / count
    return timed


if __name__ == "__main__":
    main()
