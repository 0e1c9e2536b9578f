"""Tolerance trials per second: closed-form metrics, 3D microlens shapes, every build's real lens traced.

The same spot problem beside Optiland is a case of `benchmarks.cases`.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from roslf_design.design import load
from roslf_design.tolerance.run import Where, run_chunk, run_trials
from roslf_design.tolerance.study import TolerancePlan, make_plan, plan_from, read_study

FIELDS = ["centre", "edge", "corner", ["5 mm", "0 mm"], ["0 mm", "5 mm"]]
FIFTEEN = [
    {"place": ["f", "d_1", "d_2", "d_3", "D_F", "d", "D"]},
    {"place": ["aperture.decentre", "main_lens.decentre", "microlens_array.tilt"]},
    {"place": ["microlens_array.rotation", "microlens_array.focal_length"]},
]
CLOSED = ("fill_factor", "mismatch_px", "non_distortion_room_mm", "centre_error_px", "depth_error_mm")
SHAPES = ("kept_fraction", "axis_ratio", "image_area_mm2", "centre_error_px", "fill_factor")
TRACED = ("kept_fraction", "image_diameter_px", "fill_factor", "centre_error_px", "depth_error_mm", "blur_pitches")
REPEATS = 3


def plan_for(
    metrics: tuple[str, ...], trials: int, changes: dict[str, Any] | None = None, tilts: bool = True
) -> TolerancePlan:
    """15 perturbations at precision grade, five metrics at five fields."""
    base = plan_from(
        {
            "name": "bench",
            "design": "paper",
            "grade": "precision",
            "exclude": ["aperture.tilt", "main_lens.tilt"] + ([] if tilts else ["microlens_array.tilt"]),
            "perturb": FIFTEEN if tilts else [*FIFTEEN[:1], {"place": ["sensor.decentre"], "tolerance": "0.05 mm"}],
            "fields": FIELDS,
            "goals": [{"metric": name, "min": -1e9} for name in metrics],
            "trials": trials,
            "keep_trials": 0,
        }
    )
    assert len(base.draws.perturbations) == 15, len(base.draws.perturbations)
    if changes:
        base = replace(base, question=replace(base.question, design=base.question.design.replace(changes)))
    return base


def real_plan(lens: str, metrics: tuple[str, ...] = TRACED) -> TolerancePlan:
    """The paper's bench behind a real lens, everything that the grades cover missed."""
    turned = lens.startswith("LA")
    design = load("paper-singlet").replace({"main_lens.prescription": lens, "main_lens.reversed": turned})
    study = {
        "name": "bench",
        "design": "paper-singlet",
        "grade": "commercial",
        "perturb": [{"place": "main_lens.elements.1.decentre", "tolerance": "0.1 mm"}],
        "fields": [["0 mm", "0 mm"], ["6 mm", "0 mm"], ["9 mm", "6 mm"]],
        "goals": [{"metric": name, "min": -1e9} for name in metrics],
        "trials": 200_000,
        "keep_trials": 0,
    }
    text, _, grades = read_study(study)
    return make_plan(text, design, grades)


def rate(plan: TolerancePlan, workers: int) -> float:
    """Median trials a second of whole runs, files and all; the pool's start is told apart by `started`."""
    rates = []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as folder:
            first: list[float] = []
            done: list[int] = []

            def progress(count: int, _total: int, first: list[float] = first, done: list[int] = done) -> None:
                if count and not first:
                    first.append(time.perf_counter())
                    done.append(count)

            run_trials(plan, Path(folder), Where(workers), progress=progress)
            rates.append((plan.trials - done[0]) / (time.perf_counter() - first[0]))
    return statistics.median(rates)


def core_rate(plan: TolerancePlan) -> float:
    """Median trials per second of CPU time in one process: what other work on the machine does not disturb."""
    rates = []
    for index in range(REPEATS):
        start = time.process_time()
        run_chunk(plan, index)
        rates.append(plan.chunk_trials(index) / (time.process_time() - start))
    return statistics.median(rates)


def main() -> None:
    """Print measured rates."""
    clipped = {"main_lens.diameter": 33.0, "stops": [{"diameter": 17.0, "distance": 60.0}]}
    cases = [
        ("closed forms, 5 metrics x 5 fields, tilts among 15 perturbations", plan_for(CLOSED, 2_000_000), 300_000),
        ("closed forms, decentres only", plan_for(CLOSED, 2_000_000, tilts=False), 300_000),
        ("3D shapes, tilted, nothing clipped", plan_for(SHAPES, 500_000), 20_000),
        ("3D shapes, tilted, most fields clipped by lens and bore", plan_for(SHAPES, 500_000, clipped), 20_000),
        ("3D shapes, decentred discs, most clipped", plan_for(SHAPES, 500_000, clipped, tilts=False), 20_000),
        ("real singlet traced, 6 metrics x 3 fields, 26 perturbations", real_plan("LA1050-A"), 10_000),
        ("real singlet traced, image centres alone", real_plan("LA1050-A", ("centre_error_px",)), 50_000),
        ("real achromat traced, 6 metrics x 3 fields, 31 perturbations", real_plan("AC508-100-A"), 10_000),
    ]
    workers = len(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    print(f"{workers} workers, load average {load:.1f} before; medians of {REPEATS} whole runs, first chunk left out")
    for name, plan, goal in cases:
        run_chunk(replace(plan, trials=4096), 0)  # compiled and cached before the clock runs
        found, core = rate(plan, workers), core_rate(plan)
        print(f"{name:58s} {found:10,.0f} trials/s (goal {goal:,}); {core:9,.0f} per CPU second", flush=True)


if __name__ == "__main__":
    main()
