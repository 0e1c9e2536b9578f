"""Exact rays through real lenses, one thread, beside plain numpy and Optiland; the surrogate; field maps; images.

Optiland runs in a Python of its own: name one that has it in the environment variable OPTILAND_PYTHON.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from roslf_design.design import load
from roslf_design.effects import plan
from roslf_design.imaging.grid import Region
from roslf_design.imaging.lens_rays import real_camera
from roslf_design.imaging.trace import Sampling, Tracer
from roslf_design.lenses.camera import LensCamera, Rim
from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.images import field_map, real_images
from roslf_design.lenses.lens_file import load_lens
from roslf_design.lenses.prescription import Prescription, Surface, first_order
from roslf_design.lenses.surrogate import fitted
from roslf_design.lenses.tracer import Rays
from roslf_design.scenes import Checkerboard, Plane, Scene

Floats = NDArray[np.float64]

GOAL = 5.0
"""Times Optiland's rays a second, N-BK7 singlet, one thread."""
RAYS = 1_000_000
GREEN = 550e-6
SINGLET = (51.5, 9.69, 140.0)
"""Radius, thickness, last vertex to array [mm]."""

OPTILAND = """
import statistics, sys, time, warnings
warnings.simplefilter("ignore")
import numpy as np
from optiland.materials import Material
from optiland.optic import Optic
from optiland.rays import RealRays
n, radius, thickness, behind = int(sys.argv[1]), *map(float, sys.argv[2:])
lens = Optic()
lens.surfaces.add(index=0, thickness=np.inf)
glass = Material("N-BK7", reference="schott")
lens.surfaces.add(index=1, radius=radius, thickness=thickness, material=glass, is_stop=True)
lens.surfaces.add(index=2, radius=np.inf, thickness=behind)
lens.surfaces.add(index=3)
rng = np.random.default_rng(0)
x, y, s, t = rng.uniform(-10, 10, n), rng.uniform(-10, 10, n), rng.uniform(-.05, .05, n), rng.uniform(-.05, .05, n)
times = []
for _ in range(8):
    rays = RealRays(x, y, np.full(n, -20.0), s, t, np.sqrt(1 - s * s - t * t), np.ones(n), np.full(n, 0.55))
    start = time.perf_counter()
    lens.surfaces.trace(rays, skip=1, record=False)
    times.append(time.perf_counter() - start)
print(statistics.median(times[1:]))
"""


def rays_in(count: int) -> Rays:
    """Rays that a singlet of 50 mm takes, the same as the peers get."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-10, 10, (2, count))
    s, t = rng.uniform(-0.05, 0.05, (2, count))
    return Rays(np.stack([x, y, np.full(count, -20.0)]), np.stack([s, t, np.sqrt(1 - s * s - t * t)]))


def plain_numpy(rays: Rays, n: float) -> tuple[Floats, Floats]:
    """The singlet of `SINGLET` as one would write it by hand, whole arrays at once; no clipping, no verdicts."""
    radius, thickness, behind = SINGLET
    (x, y, z), (dx, dy, dz) = rays
    c, mu = 1 / radius, 1 / n
    step = -z / dz
    x, y = x + step * dx, y + step * dy
    b, e = dz - c * (x * dx + y * dy), c * (x * x + y * y)
    root = np.sqrt(b * b - c * e)
    step = e / (b + root)
    x, y, z = x + step * dx, y + step * dy, step * dz
    bend = np.sqrt(1 - mu * mu * (1 - root * root)) - mu * root
    dx, dy, dz = mu * dx - bend * c * x, mu * dy - bend * c * y, mu * dz + bend * (1 - c * z)
    step = (thickness - z) / dz
    x, y = x + step * dx, y + step * dy
    dx, dy = n * dx, n * dy
    dz = np.sqrt(1 - dx * dx - dy * dy)
    return x + behind / dz * dx, y + behind / dz * dy


def seconds(run: Callable[[], object], repeats: int = 9) -> float:
    """Median time of a call, after one that does not count."""
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def optiland() -> float | None:
    """Optiland's median time for the same rays through the same singlet [s]; None where there is no Optiland."""
    python = os.environ.get("OPTILAND_PYTHON")
    if not python:
        return None
    single = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    command = [python, "-c", OPTILAND, str(RAYS), *map(str, SINGLET)]
    done = subprocess.run(command, env={**os.environ, **single}, capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"Optiland did not run: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
        return None
    return float(done.stdout)


def bench(name: str, field: float) -> tuple[LensCamera, float]:
    """The paper's bench with a real lens, and its field."""
    lens = load_lens(name)
    constants = first_order(lens, GREEN)
    f, front = constants.focal_length, constants.front_principal
    mla = constants.rear_principal + f * 3.5 / 2.5
    return LensCamera(lens, GREEN, (Rim(2.9, front - 120.0),), front - 3.5 * f, mla, mla + 2.0), field


def show(what: str, count: int, took: float, note: str = "") -> None:
    print(f"{what:46s} {count / took / 1e6:8.1f} million/s {note}".rstrip())


def main() -> None:
    """Print rays a second, one thread, and the time of field maps."""
    radius, thickness, behind = SINGLET
    glass = find_glass("N-BK7")
    singlet = Prescription((Surface(1 / radius, 25.4, thickness, glass), Surface(0.0, 25.4)))
    rays, plane = rays_in(RAYS), thickness + behind
    ours = seconds(partial(singlet.trace, rays, GREEN, plane=plane))
    index = float(glass.index(GREEN))
    by_hand = seconds(partial(plain_numpy, rays, index), 5)
    peer = optiland()
    show("N-BK7 singlet, every ray with its fate", RAYS, ours)
    show("  the same by hand in plain numpy, no fates", RAYS, by_hand)
    if peer is None:
        print("  Optiland: not measured; name a Python that has it in OPTILAND_PYTHON")
    else:
        show("  Optiland", RAYS, peer, f"(ours {peer / ours:.1f} times as fast, goal {GOAL:g})")
    flat = Surface(0.0, 25.4)
    conic = Surface(1 / radius, 25.4, thickness, glass, -0.6)
    for what, lens in (
        ("cemented achromat AC508-100-A", load_lens("AC508-100-A")),
        ("conic singlet", Prescription((conic, flat))),
        ("aspheric singlet", Prescription((replace(conic, asphere=(0.0, 1e-7)), flat))),
    ):
        show(what, RAYS, seconds(partial(lens.trace, rays, GREEN, plane=plane), 5))
    surrogates()
    rendering()
    maps()


def surrogates() -> None:
    """The surrogate as rendering uses it: all rays of a microlens together."""
    for name in ("LB1630-A", "AC508-100-A"):
        camera, field = bench(name, 11.15)
        rng = np.random.default_rng(1)
        c = rng.uniform(-7, 7, (2, RAYS // 200, 1))
        slopes = 0.003 * c + rng.uniform(-0.01, 0.01, (2, RAYS // 200, 200))
        for tolerance in (1e-2, 1e-4):
            start = time.perf_counter()
            fit = fitted(camera, field, tolerance=tolerance)
            took = time.perf_counter() - start
            note = f"(error {fit.object_error * 1e6:.2g} nm on the focal plane; fitted in {took:.2f} s)"
            show(f"surrogate of {name}", RAYS, seconds(partial(fit.rays, *c, *slopes)), note)


def rendering() -> None:
    """Part of a textured plane through the ideal lens and through real ones, whole microlenses, no diffraction."""
    scene = Scene(objects=(Plane(distance=340.0, texture=Checkerboard(period=3.0)),))
    fixed, region = Sampling(36, 36, 0.0), Region(2000, 1300, 150, 100)
    overrides = ["-fap_diffraction", "-microlens_diffraction"]
    ideal = load("paper")
    thin = Tracer.of(ideal, plan(ideal, scene, overrides=overrides), scene)
    took = seconds(partial(thin.image, region, fixed), 3)
    show("rendered through the ideal lens", thin.image(region, fixed)[1], took, f"({1e3 * took:.0f} ms)")
    for name in ("AC508-100-A", "AC508-150-A"):
        design = load("paper-singlet").replace({"main_lens.prescription": name, "main_lens.reversed": False})
        chosen = plan(design, scene, overrides=[*overrides, "+lens_aberrations"])
        start = time.perf_counter()
        tracer = real_camera(design, scene, chosen)
        assert tracer is not None
        ready = time.perf_counter() - start
        real = seconds(partial(tracer.image, region, Sampling(side=6)), 3)
        how = "surrogate" if tracer.ways[0].__name__ == "quickly" else "its own rays"
        note = f"({how}: {1e3 * real:.0f} ms, {real / took:.1f} times the ideal lens's; made ready in {ready:.1f} s)"
        show(f"rendered through {name}", tracer.image(region, Sampling(side=6))[1], real, note)


def maps() -> None:
    """Field maps of a few hundred microlenses."""
    camera, field = bench("LB1630-A", 11.15)
    side = np.linspace(-field, field, 21)
    grid = np.stack(np.meshgrid(side, side), axis=-1)
    for what, run in (
        ("outlines of 441 microlens images", partial(real_images, camera, grid)),
        ("aberrations at 441 microlenses, 3 colours", partial(field_map, camera, grid, [486e-6, 588e-6, 656e-6])),
    ):
        print(f"{what:46s} {1e3 * seconds(run, 3):8.0f} ms")


if __name__ == "__main__":
    main()
