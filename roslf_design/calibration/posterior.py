"""How sure a calibration is: the posterior of the camera by affine-invariant ensembles, poses eliminated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from .datasheet import QUANTITIES, DataSheet, derived
from .diagnostics import bulk_ess, r_hat, tail_ess
from .draws import Draws
from .errors import CalibrationError, optional_module
from .lattice import Array
from .likelihood import ProfileLikelihood
from .model import GLOBALS
from .precision import DEFAULT_ESS, DEFAULT_STEPS
from .statistics_fit import StatisticsFit

_KEPT = 40_000
"""Most draws kept of a posterior."""
RHAT, ESS = 1.01, DEFAULT_ESS
"""What counts as converged."""


@dataclass(frozen=True, eq=False)
class Posterior(Draws):
    """Draws from the posterior, and whether they may be trusted."""

    r_hat: Mapping[str, float]
    """Between ensembles, for each parameter and derived quantity."""
    bulk_ess: Mapping[str, float]
    tail_ess: Mapping[str, float]
    converged: bool
    message: str
    """Why it counts as converged, or not."""
    acceptance: float
    steps: int
    """Of each ensemble, after the first that were dropped."""
    walkers: int
    """In all ensembles."""
    ensembles: int
    between: float
    """Standard error of a mean by the scatter between ensembles, in standard deviations; rms over the parameters."""


def sample_posterior(
    fit: StatisticsFit,
    sheet: DataSheet,
    *,
    seed: int,
    ensembles: int = 4,
    walkers: int | None = None,
    chunk: int = 500,
    most_steps: int = DEFAULT_STEPS,
    ess: float = ESS,
    vectorize: bool = True,
    progress: Callable[[int, float, float], None] | None = None,
) -> Posterior:
    """Sample (A, m, 1/d_2, x_0, y_0, distortion, f) until separate ensembles agree.

    Ensembles start apart, spread 1.5 times as wide as the Fisher matrix says, and walk in coordinates whitened by it.
    They stop when R-hat between ensembles is below 1.01 and bulk and tail effective sample sizes are above `ess` for
    every parameter and for d_1, d_f, H and d_3, or after `most_steps`. Priors are flat in A, m, 1/d_2 (all positive),
    x_0, y_0 and distortion, and normal in f, q, d and the board's scale as the data sheet says; q, d, scale and the
    fit's systematic errors, which no image informs, are drawn afterwards.

    Parameters
    ----------
    fit : StatisticsFit
    sheet : DataSheet
    seed : int
        Same seed, same draws.
    ensembles : int
        Separate ensembles, at least 4.
    walkers : int, optional
        In each ensemble, even; four for each parameter and at least 24 where not given.
    chunk : int
        Steps between checks.
    most_steps : int
        Of each ensemble.
    ess : float
        Effective sample size wanted, bulk and tail; `precision.sample_size_for` an accuracy.
    vectorize : bool
        Ask the likelihood for many walkers at once.
    progress : callable, optional
        Called with (steps, R-hat, effective sample size) after each chunk.

    Raises
    ------
    MissingExtraError
        Without emcee.
    CalibrationError
        Fewer than four ensembles, or the likelihood is not finite near its peak.
    """
    emcee = optional_module("emcee", "sampling the posterior")
    if ensembles < 4:
        raise CalibrationError(f"convergence is judged between at least 4 ensembles, got {ensembles}")
    target = _Target(fit, sheet)
    dimension = len(target.names)
    size = max(24, 4 * dimension) if walkers is None else walkers
    moves = [(emcee.moves.DEMove(), 0.7), (emcee.moves.DESnookerMove(), 0.1), (emcee.moves.StretchMove(), 0.2)]
    seeds = np.random.SeedSequence(seed).spawn(ensembles + 1)
    samplers, states = [], []
    for spawned in seeds[:ensembles]:
        random = np.random.RandomState(np.random.MT19937(spawned))
        start = 1.5 * random.normal(size=(size, dimension))
        worth = target.rows(start)
        if not np.isfinite(worth).all():
            start[~np.isfinite(worth)] *= 0.1
        if not np.isfinite(target.rows(start)).all():
            raise CalibrationError("the posterior is not finite near its peak: the boards hardly determine the camera")
        function = target.rows if vectorize else target.one
        samplers.append(emcee.EnsembleSampler(size, dimension, function, moves=moves, vectorize=vectorize))
        states.append(emcee.State(start, random_state=random.get_state()))
    dropped = min(max(50, chunk // 2), 400)
    states = [sampler.run_mcmc(state, dropped) for sampler, state in zip(samplers, states, strict=True)]
    for sampler in samplers:
        sampler.reset()
    steps = 0
    while True:
        # Looking takes as long as a tenth of what it looks at.
        many = min(max(chunk, steps // 4), most_steps - steps)
        states = [sampler.run_mcmc(state, many) for sampler, state in zip(samplers, states, strict=True)]
        steps += many
        chain = np.stack([sampler.get_chain() for sampler in samplers])  # (ensembles, steps, walkers, p)
        checks = _checks(target, chain)
        worst, least = max(checks[0].values()), min(min(c.values()) for c in checks[1:])
        converged = worst < RHAT and least > ess
        if progress is not None:
            progress(steps, worst, least)
        if converged or steps >= most_steps:
            break
    said = f"R-hat {worst:.4f} (below {RHAT} wanted), effective sample size {least:.0f} (above {ess:.0f} wanted)"
    flat = target.parameters(chain.swapaxes(0, 1).reshape(-1, dimension))
    flat = flat[:: max(1, len(flat) // _KEPT)]
    rng = np.random.default_rng(seeds[-1])
    q, d, board = sheet.draws(len(flat), rng)[1:]
    flat[:, :3] += rng.normal(size=(len(flat), len(fit.systematic))) @ fit.systematic
    return Posterior(
        names=target.names,
        parameters=flat,
        quantities=derived(flat, sheet, flat[:, -1], np.stack([q, d, board])),
        r_hat=checks[0],
        bulk_ess=checks[1],
        tail_ess=checks[2],
        converged=converged,
        message=("converged: " if converged else f"NOT converged after {steps} steps: ") + said,
        acceptance=float(np.mean([sampler.acceptance_fraction.mean() for sampler in samplers])),
        steps=steps,
        walkers=ensembles * size,
        ensembles=ensembles,
        between=_between(chain),
    )


def _between(chain: Array) -> float:
    """Scatter of the ensembles' means over sqrt(ensembles), in standard deviations, rms over the coordinates."""
    means = chain.mean(axis=(1, 2))
    spread = chain.reshape(-1, chain.shape[-1]).std(axis=0)
    return float(np.sqrt(np.mean((means.std(axis=0, ddof=1) / spread) ** 2) / len(means)))


class _Target:
    """Log-posterior in whitened coordinates."""

    def __init__(self, fit: StatisticsFit, sheet: DataSheet) -> None:
        self.likelihood = ProfileLikelihood(fit)
        self.fitted = fit.covariance.names
        self.names = (*self.fitted, "f")
        self._columns = [GLOBALS.index(name) for name in self.fitted]
        self._centre = fit.camera.vector(self.fitted)
        self._root = np.linalg.cholesky(fit.covariance.matrix)
        self._sheet = sheet

    def parameters(self, whitened: Array) -> Array:
        """Fitted parameters and f of whitened coordinates, shape (n, p)."""
        shared = self._centre + whitened[:, :-1] @ self._root.T
        return np.column_stack([shared, self._sheet.f + self._sheet.f_sigma * whitened[:, -1]])

    def rows(self, whitened: Array) -> Array:
        """Log-posterior of many points, shape (n,)."""
        values = self.parameters(whitened)
        cameras = np.tile(self.likelihood.best, (len(values), 1))
        cameras[:, self._columns] = values[:, :-1]
        worth = self.likelihood(cameras) - self.likelihood.peak - 0.5 * whitened[:, -1] ** 2
        return np.where(values[:, -1] > 0, worth, -np.inf)

    def one(self, whitened: Array) -> float:
        """Log-posterior of one point."""
        return float(self.rows(whitened[None])[0])


def _checks(target: _Target, chain: Array) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """R-hat between ensembles, bulk and tail ESS over all walkers, for parameters and derived lengths."""
    groups, steps, walkers, dimension = chain.shape
    values = target.parameters(chain.reshape(-1, dimension))
    series = {name: values[:, k] for k, name in enumerate(target.names)}
    lengths = derived(values, target._sheet, values[:, -1])
    series |= {name: lengths[name] for name in QUANTITIES if name not in series and name != "d_2"}
    hat, bulk, tail = {}, {}, {}
    for name, flat in series.items():
        if np.ptp(flat) == 0:
            continue
        draws = flat.reshape(groups, steps, walkers)
        hat[name] = r_hat(draws.reshape(groups, steps * walkers))
        by_walker = draws.swapaxes(1, 2).reshape(groups * walkers, steps)
        bulk[name], tail[name] = bulk_ess(by_walker), tail_ess(by_walker)
    return hat, bulk, tail
