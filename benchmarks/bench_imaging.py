"""Raw images: white fields, textured planes, point sources; time, rays a second and peak memory."""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from roslf_design.design import Design, load
from roslf_design.effects import plan
from roslf_design.imaging.grid import Region
from roslf_design.imaging.points import PointSource, point_image
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import Sampling, Tracer
from roslf_design.scenes import Checkerboard, Picture, Plane, Scene

RAYS = 64
"""Rays per pixel of the textured plane."""


def main(repeats: int = 5) -> None:
    """Print medians."""
    paper, bore = load("paper"), load("mismatched-borescope")
    white(paper, bore, repeats)
    textured(paper, repeats)
    region = Region(2200, 1440, 200, 200)
    spot = median(
        lambda: point_image(PointSource(paper, 0.02, 0.03, 340.0), region, (paper.wavelength,), 0.01), repeats
    )
    print(f"point source, coherent, 200 x 200 px                 {spot:8.3f} s")
    print(f"peak memory, whole sensor, textured, one process     {peak_memory():8.0f} MiB   goal 1024")


def white(paper: Design, bore: Design, repeats: int) -> None:
    """Whole white images, three ways, beside the matrix products of plain numpy over all pixels and harmonics."""
    cases: tuple[tuple[str, Design, list[str], str], ...] = (
        ("white 4600 x 3080, diffraction (harmonics)", paper, [], "goal 2"),
        ("white 4600 x 3080, rays (exact coverage)", paper, ["-microlens_diffraction"], ""),
        ("white 2448 x 2048, vignetted, diffraction (FFT)", bore, [], ""),
    )
    for name, design, overrides, goal in cases:
        render(design, overrides=overrides, region=(0, 0, 64, 64))
        seconds = median(lambda d=design, o=overrides: render(d, overrides=o), repeats)
        print(f"{name:52s} {seconds:8.3f} s   {goal}")
    print(f"{'the same 25 harmonics, plain numpy, every pixel':52s} {plain_numpy(paper):8.3f} s")


def plain_numpy(design: Design) -> float:
    """A white image as one would first write it: a cosine for each harmonic and pixel; timed on a tenth of the rows."""
    width, height = design.pixels
    x, y = np.meshgrid(np.arange(width) / 12.94, np.arange(height // 10) / 12.94)
    start = time.perf_counter()
    image = np.zeros_like(x)
    for m in range(-3, 4):
        for n in range(1, 4):
            image += np.cos(2 * np.pi * (m * x + n * y))
    for m in range(4):
        image += np.cos(2 * np.pi * m * x)
    return (time.perf_counter() - start) * height / (height // 10)


def textured(paper: Design, repeats: int) -> None:
    """A textured plane out of focus, finite microlenses, with and without the FAP's diffraction."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "noise.png"
        noise = np.random.default_rng(0).integers(0, 256, (512, 512), dtype=np.uint8)
        Image.fromarray(noise).save(file)
        picture = Picture(file=str(file), width=60.0)
        for name, texture, overrides in (
            ("checkerboard", Checkerboard(period=3.0), ["-fap_diffraction"]),
            ("picture, bilinear", picture, ["-fap_diffraction"]),
            ("checkerboard, FAP diffraction", Checkerboard(period=3.0), ["-microlens_diffraction"]),
        ):
            scene = Scene(objects=(Plane(distance=340.0, texture=texture),))
            tracer = Tracer.of(paper, plan(paper, scene, overrides=overrides), scene)
            fixed = Sampling(RAYS, RAYS, 0.0)
            tracer.image(Region(0, 0, 32, 32), fixed)
            region = Region(2000, 1300, 600, 400)
            start = time.process_time()
            seconds = median(lambda t=tracer, s=fixed, r=region: t.image(r, s), repeats)
            core = (time.process_time() - start) / repeats
            rays = tracer.image(region, fixed)[1]
            label = f"plane, {name}, {RAYS} rays/px"
            free = f"{rays / core / 1e6:.1f} a second of one core"
            print(f"{label:52s} {rays / seconds / 1e6:8.1f} million rays/s   goal 40; {free}")


def median(task: object, repeats: int) -> float:
    """Median wall time [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        task()  # type: ignore[operator]
        times.append(time.perf_counter() - start)
    return statistics.median(times)


MEMORY = """
import resource
from roslf_design.design import load
from roslf_design.imaging.render import render
from roslf_design.imaging.trace import Sampling
from roslf_design.scenes import Checkerboard, Plane, Scene
scene = Scene(objects=(Plane(distance=340.0, texture=Checkerboard(period=3.0)),))
render(load("paper"), scene, sampling=Sampling(16, 16, 0.0))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


def peak_memory() -> float:
    """Peak resident memory of a process that renders the whole sensor [MiB]."""
    done = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True, check=True)
    return float(done.stdout)


if __name__ == "__main__":
    main()
    print(f"this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
