"""Tolerance trials per second: closed-form metrics, 3D microlens shapes, and the same spot problem beside Optiland."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import tempfile
import time
import venv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.perturb import with_index_error, with_radius_error, with_thickness_error
from roslf_design.lenses.prescription import Prescription, Surface
from roslf_design.lenses.trace import Rays, trace
from roslf_design.tolerance.chunk import run_chunk
from roslf_design.tolerance.plan import Plan, plan_from
from roslf_design.tolerance.run import Where, run_trials

FIELDS = ["centre", "edge", "corner", ["5 mm", "0 mm"], ["0 mm", "5 mm"]]
FIFTEEN = [
    {"place": ["f", "d_1", "d_2", "d_3", "D_F", "d", "D"]},
    {"place": ["aperture.decentre", "main_lens.decentre", "microlens_array.tilt"]},
    {"place": ["microlens_array.rotation", "microlens_array.focal_length"]},
]
CLOSED = ("fill_factor", "mismatch_px", "non_distortion_room_mm", "centre_error_px", "depth_error_mm")
SHAPES = ("kept_fraction", "axis_ratio", "image_area_mm2", "centre_error_px", "fill_factor")
REPEATS = 3


def plan_for(metrics: tuple[str, ...], trials: int, changes: dict[str, Any] | None = None, tilts: bool = True) -> Plan:
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


def rate(plan: Plan, workers: int) -> float:
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


def core_rate(plan: Plan) -> float:
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
    ]
    workers = len(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    print(f"{workers} workers, load average {load:.1f} before; medians of {REPEATS} whole runs, first chunk left out")
    for name, plan, goal in cases:
        run_chunk(replace(plan, trials=4096), 0)  # compiled and cached before the clock runs
        found, core = rate(plan, workers), core_rate(plan)
        print(f"{name:58s} {found:10,.0f} trials/s (goal {goal:,}); {core:9,.0f} per CPU second", flush=True)
    beside_optiland()


SPOT = """
import json, time
import numpy as np
from optiland.optic import Optic
from optiland.tolerancing import DistributionSampler, Tolerancing
from optiland.tolerancing.monte_carlo import MonteCarlo

lens = Optic()
lens.add_surface(index=0, thickness=350)
lens.add_surface(index=1, radius=103.29, thickness=7.0, material="N-BK7", is_stop=True)
lens.add_surface(index=2, radius=-103.29, thickness=136.0)
lens.add_surface(index=3)
lens.set_aperture(aperture_type="EPD", value=10)
lens.set_field_type(field_type="object_height")
for y in (0, 14, 28):
    lens.add_field(y=y)
lens.add_wavelength(value=0.55, is_primary=True)
study = Tolerancing(lens)
for field in (0, 0.5, 1):
    data = dict(optic=lens, surface_number=-1, Hx=0, Hy=field, num_rays=6, wavelength=0.55)
    data["distribution"] = "hexapolar"
    study.add_operand("rms_spot_size", input_data=data)
nominal = [float(value) for value in study.evaluate()]
def uniform(middle, width):
    return DistributionSampler("uniform", low=middle - width, high=middle + width)
for surface, radius in ((1, 103.29), (2, -103.29)):
    study.add_perturbation("radius", uniform(radius, 0.5), surface_number=surface)
for surface, value in ((0, 350.0), (1, 7.0), (2, 136.0)):
    study.add_perturbation("thickness", uniform(value, 0.05), surface_number=surface)
for surface in (1, 2):
    study.add_perturbation("conic", uniform(0.0, 0.01), surface_number=surface)
study.add_perturbation("index", uniform(1.5185, 0.001), surface_number=1, wavelength=0.55)
run = MonteCarlo(study)
run.run(10)
rates = []
for _ in range(3):
    start = time.perf_counter()
    run.run(100)
    rates.append(100 / (time.perf_counter() - start))
print(json.dumps([sorted(rates)[1], nominal]))
"""


def singlet() -> Prescription:
    """The biconvex lens of the spot problem."""
    glass = find_glass("N-BK7")
    return Prescription((Surface(1 / 103.29, 15.0, 7.0, glass), Surface(-1 / 103.29, 15.0)), "spot", "", 550e-6)


def spots(lens: Prescription, rays: Rays, plane: float) -> list[float]:
    """RMS spot size at each field, about its centroid [mm]; rays of shape (3, fields, rays)."""
    x, y, _ = trace(lens, rays, 550e-6, plane=plane, clip=False).rays.position
    x, y = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
    return [float(value) for value in np.sqrt((x * x + y * y).mean(axis=1))]


def spot_rays(distance: float) -> Rays:
    """Six rings over a 10 mm pupil at the first vertex, from three object heights at a distance."""
    rings = [5 * ring / 6 * np.exp(2j * np.pi * np.arange(6 * ring) / (6 * ring)) for ring in range(1, 7)]
    points = np.concatenate([[0.0], *rings])
    pupil = np.stack([points.real, points.imag, 0 * points.real])[:, None, :]
    heights = np.array([(0.0, -y, -distance) for y in (0.0, 14.0, 28.0)]).T[:, :, None]
    return Rays.between(heights, pupil)


def beside_optiland() -> None:
    """The same spot problem: a singlet, 8 perturbations, RMS spot size at three fields, 127 rays each, one process."""
    found = optiland_rate()
    lens, rays, stream = singlet(), spot_rays(350.0), np.random.default_rng(0)
    nominal = spots(lens, rays, 143.0)

    def trial() -> list[float]:
        r1, r2, k1, k2, t0, t1, t2, n1 = stream.uniform(-1, 1, 8) * (0.5, 0.5, 0.01, 0.01, 0.05, 0.05, 0.05, 0.001)
        one = with_thickness_error(with_radius_error(with_radius_error(lens, 1, r1), 2, r2), 1, t1)
        first, second = with_index_error(one, 1, n1).surfaces
        one = replace(one, surfaces=(replace(first, conic=float(k1)), replace(second, conic=float(k2))))
        return spots(one, spot_rays(350.0 + t0), 143.0 + t1 + t2)

    for _ in range(200):
        trial()
    spans = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        for _ in range(1000):
            trial()
        spans.append(time.perf_counter() - start)
    ours = 1000 / statistics.median(spans)
    text = "spot problem, 8 perturbations, 3 fields, 127 rays each:"
    print(f"{text} exact trace here {ours:,.0f} trials/s, nominal {_shown(nominal)}")
    if found is not None:
        theirs, their_nominal = found
        print(f"{text} Optiland {theirs:,.0f} trials/s, nominal {_shown(their_nominal)}; ratio {ours / theirs:,.0f}")


def _shown(sizes: list[float]) -> str:
    return ", ".join(f"{1e3 * size:.2f}" for size in sizes) + " um"


def optiland_rate() -> tuple[float, list[float]] | None:
    """Trials a second and nominal spots of Optiland, in a venv of its own in the cache folder; None where it cannot."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "roslf-bench" / "optiland"
    python = cache / "bin" / "python"
    try:
        if not python.exists():
            print(f"making a venv for Optiland in {cache}", flush=True)
            venv.create(cache, with_pip=True)
        here = subprocess.run([str(python), "-c", "import optiland"], capture_output=True, check=False)
        if here.returncode:
            install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "optiland"]
            subprocess.run(install, check=True, timeout=900, capture_output=True)
        done = subprocess.run([str(python), "-c", SPOT], check=True, timeout=600, capture_output=True, text=True)
    except (OSError, subprocess.SubprocessError) as error:
        told = getattr(error, "stderr", "") or ""
        print(f"Optiland left out: {str(told).strip().splitlines()[-1] if told else error}")
        return None
    rate_found, nominal = json.loads(done.stdout.splitlines()[-1])
    return float(rate_found), [float(value) for value in nominal]


if __name__ == "__main__":
    main()
