"""Do the intervals hold what they promise? Many synthetic calibrations with known truth."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from ..theory.aperture import effective_image_distance
from ..theory.conjugates import focal_plane_distance
from .calibrate import calibrate
from .datasheet import DataSheet
from .draws import laplace_draws
from .errors import CalibrationError
from .lattice import Array
from .model import Camera
from .posterior import sample_posterior
from .synthetic import Captures, observe_synthetic, random_poses

_DRAWS = 4000


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
    from scipy.stats import binom

    held, failed = dict.fromkeys(names, 0), 0
    pulls: dict[str, list[float]] = {name: [] for name in names}
    for k in range(trials):
        rng = np.random.default_rng([seed, k])
        f, q, d, board = (float(v[0]) for v in sheet.draws(1, rng))
        m = d_1 / float(focal_plane_distance(f, d_1))
        A = float(effective_image_distance(f, d_1 / m, d_3))
        camera = Camera(A, m, 1 / d_2, 150.0 + rng.uniform(-5, 5), 100.0 + rng.uniform(-5, 5), q=q, d=d)
        real = replace(captures, board=replace(captures.board, cell=captures.board.cell * board))
        observations = observe_synthetic(camera, random_poses(real, d_3, rng), real, rng)
        observations = replace(observations, points=captures.board.points)
        truth = {"A": A, "m": m, "d_2": d_2, "d_1": d_1, "d_f": d_1 / m, "H": d_1 / A, "d_3": d_3}
        try:
            fit = calibrate(observations, sheet, distortion=distortion).fit
        except CalibrationError:
            failed += 1
            continue
        if method == "fisher":
            draws = dict(laplace_draws(fit, sheet, _DRAWS, rng).quantities)
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
