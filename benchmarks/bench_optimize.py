"""Optimising: one evaluation, a six-variable endoscope, and the best ten of 100,000 combinations of parts."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

import roslf_design as roslf
from roslf_design.optimize import (
    Combinations,
    Constraint,
    DesignProblem,
    Goal,
    Settings,
    Variable,
    quantity_named,
    rank,
    solve,
)
from roslf_design.optimize.parts import Catalogue
from roslf_design.optimize.search import value_and_jacobian


def main(repeats: int = 5) -> None:
    """Print medians."""
    scope = endoscope()
    units = np.random.default_rng(0).random((4096, scope.n))
    single = _median(lambda: scope.vector(units[:1]), 200)
    slope = _median(lambda: value_and_jacobian(scope.vector, units[0]), 100)
    batch = _median(lambda: scope.vector(units), 10)
    print(f"evaluation: {1e6 * single:.0f} us; with derivatives {1e6 * slope:.0f} us; ", end="")
    print(f"in batches of 4096 {1e6 * batch / 4096:.2f} us each")
    seconds = []
    for seed in range(repeats):
        answer = solve(scope, Settings(seed=seed))
        seconds.append(answer.seconds)
        assert answer.feasible
    print(f"six-variable endoscope, 16 starts and CRS2_LM: {statistics.median(seconds):.2f} s (goal 10 s)")
    combinations = Combinations.of(bench(), catalogue(), ("lenses", "microlens_arrays", "sensors"))
    began = time.perf_counter()
    ranking = rank(combinations, 10, 120.0)
    spent = time.perf_counter() - began
    print(f"{len(combinations)} combinations of parts: {spent:.1f} s (goal 60 s); ", end="")
    print(f"{ranking.ruled_out} ruled out by bounds, {ranking.optimised} optimised, {ranking.open} left open")


def endoscope() -> DesignProblem:
    """A rigid scope with six variables."""
    return DesignProblem(
        "scope",
        roslf.load("rigid-scope"),
        (
            Variable("f", 1.0, 4.0),
            Variable("D_F", 0.1, 2.0),
            Variable("d_3", 1.0, 6.0),
            Variable("working_distance", 20.0, 60.0),
            Variable("d", 0.012, 0.06),
            Variable("d_2", 0.03, 2.0),
        ),
        (
            Constraint(quantity_named("fill_factor"), 0.98, 1.0),
            Constraint(quantity_named("non_distortion_room_mm"), 0.0),
            Constraint(quantity_named("total_length_mm"), None, 8.0),
            Constraint(quantity_named("field_half_width_mm"), 10.0, None, 40.0),
            Constraint(quantity_named("views_independent"), 6.0),
            Constraint(quantity_named("blur_pitches"), None, 8.0, 20.0),
        ),
        (Goal(quantity_named("sigma_z_mm"), "min", 40.0), Goal(quantity_named("total_length_mm"), "min", None, 0.2)),
    )


def bench() -> DesignProblem:
    """A bench system around bought parts: three variables are left."""
    return DesignProblem(
        "bench",
        roslf.load("paper"),
        (Variable("d_2", 0.2, 20.0), Variable("d_f", 210.0, 2000.0), Variable("D_F", 1.0, 8.0)),
        (
            Constraint(quantity_named("fill_factor"), 0.98, 1.0),
            Constraint(quantity_named("non_distortion_room_mm"), 0.0),
            Constraint(quantity_named("microlens_defocus_px"), None, 0.5),
            Constraint(quantity_named("total_length_mm"), None, 500.0),
            Constraint(quantity_named("field_half_width_mm"), 15.0, None, 200.0),
            Constraint(quantity_named("views_independent"), 5.0),
        ),
        (Goal(quantity_named("sigma_z_mm"), "min", 200.0), Goal(quantity_named("lateral_samples"), "max", None, 0.5)),
    )


def catalogue(lenses: int = 100, arrays: int = 25, sensors: int = 40) -> Catalogue:
    """An invented catalogue of 100,000 combinations."""
    rng = np.random.default_rng(2)

    def named(name: str) -> dict[str, str]:
        return {"part": name, "provenance": "invented for timing", "confidence": "typical"}

    return Catalogue.model_validate(
        {
            "lenses": [
                {**named(f"L{k}"), "diameter": float(rng.choice([25.4, 50.8])), "focal_length": float(f)}
                for k, f in enumerate(np.geomspace(30, 500, lenses))
            ],
            "microlens_arrays": [
                {**named(f"M{k}"), "pitch": p, "focal_length": p * float(rng.uniform(10, 40)), "size": (12.0, 12.0)}
                for k, p in enumerate(np.geomspace(0.04, 0.4, arrays).tolist())
            ],
            "sensors": [
                {**named(f"S{k}"), "pixel": float(q), "pixels": (int(rng.integers(400, 5000)),) * 2}
                for k, q in enumerate(np.geomspace(0.0012, 0.006, sensors))
            ],
        }
    )


def _median(work: Callable[[], object], repeats: int) -> float:
    work()
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return statistics.median(seconds)


if __name__ == "__main__":
    main()
