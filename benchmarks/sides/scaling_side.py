"""Work of a size that is asked for; each size runs in a process of its own, so that its memory can be told."""

# mypy: allow-untyped-defs, allow-untyped-calls

import numpy as np

BLOCK = 10_000_000
"""Rays held at once; more are done block by block through the same arrays."""


def trials(inputs, options):
    """Whole tolerance studies in two processes, files and all, closed-form metrics."""
    import tempfile
    from pathlib import Path

    from benchmarks.bench_tolerance import CLOSED, plan_for
    from roslf_design.tolerance.run import Where, run_trials

    plan = plan_for(CLOSED, int(options["size"]))

    def run():
        with tempfile.TemporaryDirectory() as folder:
            run_trials(plan, Path(folder), Where(int(options["workers"])))

    return run, dict


def pixels(inputs, options):
    """A white image with diffraction of so many pixels: the paper's camera with a larger or smaller sensor."""
    import roslf_design as roslf
    from roslf_design.imaging.render import render

    paper = roslf.load("paper")
    grow = (float(options["size"]) / np.prod(paper.pixels)) ** 0.5
    width, height = (side * grow for side in paper.sensor.size)
    design = paper.replace({"sensor.size": (width, height), "microlens_array.size": (width + 1, height + 1)})

    def run():
        render(design)

    return run, dict


def posterior(inputs, options):
    """Steps of the posterior's walkers for so many parameters beside the focal length."""
    from benchmarks.bench_calibration import CAMERA, SHEET
    from roslf_design.calibration.calibrate import calibrate, corner_statistics, fit_statistics
    from roslf_design.calibration.planning import Captures, random_poses, synthetic_observations
    from roslf_design.calibration.posterior import sample_posterior

    captures, rng = Captures(boards=12, views=5), np.random.default_rng(0)
    observations = synthetic_observations(CAMERA, random_poses(captures, 120.0, rng), captures, rng)
    found = calibrate(observations, SHEET)
    names = found.fit.covariance.names[: int(options["size"]) - 1]
    data = corner_statistics(observations, found.lines.sigma)
    fit = fit_statistics(data, found.joint.camera, found.joint.poses, names)
    steps = int(options["steps"])

    def run():
        sample_posterior(fit, SHEET, seed=1, chunk=steps, most_steps=steps)

    return run, dict


WORK = {"trials": trials, "pixels": pixels, "posterior": posterior}
