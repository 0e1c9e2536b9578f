"""Work of this project alone, for which no peer offers the like; beside plain numpy where one would write it by hand.

Inputs and hand-written versions are those of the topics (`benchmarks/bench_*.py`).
"""

# mypy: allow-untyped-defs, allow-untyped-calls

import numpy as np


def nothing():
    return {}


def closed_forms(inputs, options):
    """Many designs through every closed form."""
    from benchmarks import bench_theory
    from roslf_design import theory

    design = bench_theory.designs(int(options["designs"]))
    calls = [(getattr(theory, name), bench_theory.keywords(name)) for name in bench_theory.closed_forms()]

    def run():
        for function, names in calls:
            function(**{name: design[name] for name in names})

    return run, lambda: {"functions": len(calls)}


def _discs(options):
    from benchmarks import bench_microlens
    from roslf_design.microlens.images import stop_images
    from roslf_design.microlens.lattice import Lattice, lens_centres

    axes = lens_centres(Lattice(0.063, (23.0, 14.932)))
    stops = bench_microlens.CUT if options.get("cut") else bench_microlens.FAP_AND_LENS
    centres, radii = (np.ascontiguousarray(v) for v in stop_images(axes, *stops, **bench_microlens.P1))
    return bench_microlens, axes, stops, centres, radii


def shapes(inputs, options):
    """Shapes of all microlens images, moments included."""
    from roslf_design.microlens.images import microlens_images

    bench, axes, stops, _, _ = _discs(options)
    state = {}

    def run():
        state["found"] = microlens_images(axes, *stops, **bench.P1)

    return run, lambda: {"area": state["found"].area}


def shapes_numpy(inputs, options):
    """Areas alone, by arc cosines."""
    bench, axes, stops, _, _ = _discs(options)
    from roslf_design.microlens.images import stop_images

    state = {}

    def run():
        state["found"] = bench._numpy_area(*stop_images(axes, *stops, **bench.P1))

    return run, lambda: {"area": state["found"]}


def coverage(inputs, options):
    """Exact pixel coverage of a whole sensor into an image that is there."""
    from roslf_design.microlens.coverage import coverage_image

    bench, axes, _, centres, radii = _discs(options)
    image = np.zeros(bench.SIZE[::-1], np.float32)

    def run():
        coverage_image(axes, centres, radii, pixel=bench.PIXEL, size=bench.SIZE, out=image, parallel=False)

    return run, lambda: {"total": image.sum(dtype=np.float64)}


def coverage_numpy(inputs, options):
    """Every twentieth microlens by hand: exact for whole discs, 16 slices a pixel for cut ones."""
    bench, axes, _, centres, radii = _discs(options)
    whole = bench._numpy_slices if options.get("cut") else bench._numpy_discs
    few, state = (axes[::20], centres[::20], radii[::20]), {}

    def run():
        state["image"] = whole(*few)

    return run, lambda: {"total": state["image"].sum() * len(axes) / len(few[0])}


def white(inputs, options):
    """A white image of a preset, as the plan of effects has it."""
    import roslf_design as roslf
    from roslf_design.imaging.render import render

    design = roslf.load(options.get("design", "paper"))

    def run():
        render(design)

    return run, nothing


def white_numpy(inputs, options):
    """The same harmonics, a cosine for each and every pixel; a tenth of the rows."""
    import roslf_design as roslf
    from benchmarks.bench_imaging import plain_numpy

    design = roslf.load("paper")

    def run():
        plain_numpy(design)

    return run, nothing


def textured(inputs, options):
    """Rays of a checkerboard out of focus, finite microlenses, 64 rays a pixel."""
    from roslf_design.design import load
    from roslf_design.effects import plan
    from roslf_design.imaging.grid import Region
    from roslf_design.imaging.trace import Sampling, Tracer
    from roslf_design.scenes import Checkerboard, Plane, Scene

    paper = load("paper")
    scene = Scene(objects=(Plane(distance=340.0, texture=Checkerboard(period=3.0)),))
    tracer = Tracer.of(paper, plan(paper, scene, overrides=["-fap_diffraction"]), scene)
    fixed, region = Sampling(64, 64, 0.0), Region(2000, 1300, 300, 200)

    def run():
        tracer.image(region, fixed)

    return run, lambda: {"rays": 300 * 200 * 64}


def trials(inputs, options):
    """Tolerance trials of 15 perturbations, five metrics at five fields, in this process."""
    from benchmarks import bench_tolerance as bench
    from roslf_design.tolerance.run import run_chunk

    metrics = bench.CLOSED if options["metrics"] == "closed" else bench.SHAPES
    plan = bench.plan_for(metrics, int(options["trials"]))

    def run():
        run_chunk(plan, 0)

    return run, lambda: {"trials": plan.chunk_trials(0)}


def optimum(inputs, options):
    """A rigid endoscope of six variables: 16 starts and a second solver."""
    from benchmarks.bench_optimize import endoscope
    from roslf_design.optimize import Settings, solve

    scope = endoscope()

    def run():
        assert solve(scope, Settings(seed=0)).feasible

    return run, nothing


def parts(inputs, options):
    """The best ten of 100,000 combinations of bought parts."""
    from benchmarks.bench_optimize import bench, catalogue
    from roslf_design.optimize import Combinations, rank

    combinations = Combinations.of(bench(), catalogue(), ("lenses", "microlens_arrays", "sensors"))

    def run():
        rank(combinations, 10, 120.0)

    return run, lambda: {"combinations": len(combinations)}


WORK = {
    "closed_forms": closed_forms,
    "shapes": shapes,
    "shapes_numpy": shapes_numpy,
    "coverage": coverage,
    "coverage_numpy": coverage_numpy,
    "white": white,
    "white_numpy": white_numpy,
    "textured": textured,
    "trials": trials,
    "optimum": optimum,
    "parts": parts,
}
