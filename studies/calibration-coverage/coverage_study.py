"""Do a calibration's intervals hold what they promise? Run: python studies/calibration-coverage/coverage_study.py."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import binom

from roslf_design.bore.conjugates import focal_plane_distance
from roslf_design.calibration.fit import calibrate
from roslf_design.calibration.frames import CalibrationError
from roslf_design.calibration.model import DataSheet, Intrinsics, sheet_of
from roslf_design.calibration.planning import Captures, random_poses, synthetic_observations
from roslf_design.calibration.posterior import laplace_draws, sample_posterior
from roslf_design.design import load
from roslf_design.design.files import write_atomically
from roslf_design.drawing.axes import BLUE, GREEN, GREY, INK, PALE, VERMILLION, drawing, to_png

Array = NDArray[np.float64]

NAMES = ("H", "d_3", "d_1", "d_f", "d_2")
CAPTURES = Captures(boards=12, views=3)
"""12 boards of 4 x 5 cells of 6 mm, 350 +- 30 mm from the lens, tilted up to 20 degrees, corners to 0.06 pitches."""
WANTED = (0.61, 0.75)
"""Shares of 68 % intervals that hold the truth between which the claim stands."""


DRAWS = 4000


class Coverage(NamedTuple):
    """How often intervals held the truth."""

    level: float
    """What they promised."""
    trials: int
    held: dict[str, int]
    """For each quantity, in how many trials its interval held the truth."""
    expected: tuple[float, float]
    """Share of trials, between which an honest interval falls in 99 of 100 such studies."""
    failed: int
    """Trials in which the calibration gave up: not counted."""
    pulls: dict[str, Array]
    """(median - truth)/sigma of each trial."""

    @property
    def share(self) -> dict[str, float]:
        """Share of trials for each quantity."""
        return {name: count / self.trials for name, count in self.held.items()}


def coverage(
    d_1: float,
    d_2: float,
    d_3: float,
    sheet: DataSheet,
    captures: Captures,
    *,
    trials: int,
    seed: int,
    level: float = 0.68,
    distortion: int = 0,
    method: Literal["fisher", "ensembles"] = "fisher",
    names: tuple[str, ...] = ("H", "d_3", "d_1", "d_f", "d_2"),
) -> Coverage:
    """Calibrate many synthetic cameras and count how often the intervals hold the truth.

    In each trial the camera's own f, q, d and the board's scale are drawn as the data sheet says; the calibration knows
    the data sheet only.

    Parameters
    ----------
    d_1, d_2, d_3 : float
        The camera's lengths [mm].
    sheet : DataSheet
    captures : Captures
    trials, seed : int
        Trial k has its own generator, from (seed, k).
    level : float
        Of the intervals.
    distortion : int
        Radial coefficients fitted (the cameras have none).
    method : {"fisher", "ensembles"}
        Intervals from the Fisher matrix about the joint fit, or from the sampled posterior.
    names : tuple of str
        Quantities judged.
    """
    held, failed = dict.fromkeys(names, 0), 0
    pulls: dict[str, list[float]] = {name: [] for name in names}
    for k in range(trials):
        rng = np.random.default_rng([seed, k])
        f, q, d, board = (float(v[0]) for v in sheet.draws(1, rng))
        d_f = float(focal_plane_distance(f, d_1))
        m, A = d_1 / d_f, f * (d_f - d_3) / (d_f - f)
        camera = Intrinsics(A, m, 1 / d_2, 150.0 + rng.uniform(-5, 5), 100.0 + rng.uniform(-5, 5), q=q, d=d)
        real = replace(captures, board=replace(captures.board, cell=captures.board.cell * board))
        observations = synthetic_observations(camera, random_poses(real, d_3, rng), real, rng)
        observations = replace(observations, points=captures.board.points)
        truth = {"A": A, "m": m, "d_2": d_2, "d_1": d_1, "d_f": d_1 / m, "H": d_1 / A, "d_3": d_3}
        try:
            fit = calibrate(observations, sheet, distortion=distortion).fit
        except CalibrationError:
            failed += 1
            continue
        if method == "fisher":
            draws = dict(laplace_draws(fit, sheet, DRAWS, rng).quantities)
        else:
            draws = dict(sample_posterior(fit, sheet, seed=seed * 1_000_003 + k, chunk=300).quantities)
        for name in names:
            low, middle, high = np.quantile(draws[name], [(1 - level) / 2, 0.5, (1 + level) / 2])
            held[name] += int(low <= truth[name] <= high)
            pulls[name].append((middle - truth[name]) / draws[name].std())
    done = trials - failed
    bounds = np.asarray(binom.ppf([0.005, 0.995], max(done, 1), level)) / max(done, 1)
    arrays = {name: np.array(values) for name, values in pulls.items()}
    return Coverage(level, done, held, (float(bounds[0]), float(bounds[1])), failed, arrays)


class Case(NamedTuple):
    """One way to make intervals."""

    name: str
    sheet: DataSheet
    method: Literal["fisher", "ensembles"]


def cases() -> tuple[Case, ...]:
    """The sampled posterior, and the Fisher matrix with f known as on a data sheet and almost exactly."""
    sheet = sheet_of(load("paper"))
    return (
        Case("posterior, f to 1 %", sheet, "ensembles"),
        Case("Fisher matrix, f to 1 %", sheet, "fisher"),
        Case("Fisher matrix, f to 0.01 %", replace(sheet, f_sigma=0.01), "fisher"),
    )


def studied(case: Case, trials: int, seed: int) -> Coverage:
    """Calibrate synthetic cameras of the paper's lengths."""
    paper = load("paper")
    return coverage(
        paper.d_1, paper.d_2, paper.d_3, case.sheet, CAPTURES, trials=trials, seed=seed, method=case.method, names=NAMES
    )


def facts_of(case: Case, covered: Coverage) -> dict[str, Any]:
    """As JSON's types."""
    return {
        "intervals": case.name,
        "f_sigma_mm": case.sheet.f_sigma,
        "level": covered.level,
        "trials": covered.trials,
        "failed": covered.failed,
        "share_held": covered.share,
        "binomial_99": list(covered.expected),
        "pull_mean": {name: float(pulls.mean()) for name, pulls in covered.pulls.items()},
        "pull_sigma": {name: float(pulls.std(ddof=1)) for name, pulls in covered.pulls.items()},
    }


def figure(results: list[tuple[Case, Coverage]]) -> Figure:
    """Shares held beside what was promised, and the errors in units of their sigma."""
    shown = Figure(figsize=(8.4, 3.6), layout="constrained")
    shares, errors = shown.subplots(1, 2, width_ratios=(1.5, 1))
    colours, marks = (BLUE, VERMILLION, GREEN), "os^"
    level = results[0][1].level
    low, high = results[0][1].expected
    shares.axhspan(100 * low, 100 * high, color=PALE, label="99 of 100 honest studies")
    for end, label in zip(WANTED, ("61 to 75 %", None), strict=True):
        shares.axhline(100 * end, color=GREY, linestyle=(0, (4, 3)), linewidth=0.8, label=label)
    shares.axhline(100 * level, color=INK, linewidth=0.8)
    for k, (case, covered) in enumerate(results):
        at = np.arange(len(NAMES)) + 0.18 * (k - 1)
        shares.plot(at, [100 * covered.share[n] for n in NAMES], marks[k], color=colours[k], label=case.name)
    shares.set_xticks(range(len(NAMES)), [n.replace("_", "$_{") + "}$" if "_" in n else n for n in NAMES])
    shares.set(ylabel="68 % intervals that hold the truth [%]", ylim=(54, 92), xlim=(-0.6, len(NAMES) - 0.4))
    shares.set_yticks([60, 68, 75, 80])
    shares.legend(loc="upper left", ncols=2, fontsize=8)
    edges = np.linspace(-3.5, 3.5, 29)
    middle = (edges[1:] + edges[:-1]) / 2
    case, covered = results[-1]
    for name, colour, style in (("H", BLUE, "-"), ("d_3", VERMILLION, "--")):
        heights, _ = np.histogram(covered.pulls[name], edges, density=True)
        errors.stairs(heights, edges, color=colour, linestyle=style, label=f"${name}$")
    errors.plot(middle, np.exp(-(middle**2) / 2) / np.sqrt(2 * np.pi), color=INK, linewidth=1, label="normal law")
    errors.set(xlabel="error over its sigma", ylabel="density of trials", ylim=(0, 0.68))
    errors.set_title(case.name, fontsize=9)
    errors.legend(loc="upper right", fontsize=8)
    return shown


def main() -> None:
    """Study, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("reports/calibration-coverage"))
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    results = []
    for case in cases():
        covered = studied(case, options.trials, options.seed)
        results.append((case, covered))
        shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in covered.share.items())
        print(f"{case.name}: {covered.trials} trials, {covered.failed} failed; held {shares}", flush=True)
    facts = {
        "trials": options.trials,
        "seed": options.seed,
        "captures": "12 boards of 4 x 5 cells of 6 mm, 350 +- 30 mm, tilts to 20 degrees, corners to 0.06 pitches",
        "wanted": list(WANTED),
        "cases": [facts_of(case, covered) for case, covered in results],
    }
    with drawing():
        picture = to_png(figure(results))
    options.output.mkdir(parents=True, exist_ok=True)
    write_atomically(options.output / "coverage.json", (json.dumps(facts, indent=1) + "\n").encode())
    write_atomically(options.output / "coverage.png", picture)


if __name__ == "__main__":
    main()
