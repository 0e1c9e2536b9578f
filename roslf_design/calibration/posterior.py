"""How sure a calibration is: draws of the camera, by ensembles or from the Fisher matrix, and what follows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..accuracy.statement import Accuracy, check_accuracy
from .corner_statistics import StatisticsFit
from .frames import Array, CalibrationError
from .model import GLOBALS, QUANTITIES, DataSheet, derived
from .sidedata import Combined, SideDatum, combine

ENSEMBLES = 4
"""Between which convergence is judged: fewer would not tell."""
DEFAULT_ESS, DEFAULT_STEPS = 400.0, 10_000
"""Effective sample size wanted, bulk and tail, and most steps of each ensemble."""
SIGMAS = 2.0
"""Width of an error bound in Monte Carlo standard errors: a mean is off by more in at most 5 % of runs."""
FINEST = 0.02
"""A finer posterior takes more than 1e4 independent draws, which is more than chains in memory should hold."""
MOST_STEPS = 60_000
RHAT = 1.01
"""R-hat between ensembles below which they count as converged."""
_KEPT = 40_000
"""Most draws kept of a posterior."""


@dataclass(frozen=True, eq=False)
class CameraDraws:
    """Draws of what was fitted and of what follows from it: of a posterior, or of the normal law in its place."""

    names: tuple[str, ...]
    """Parameters: those of the fit, then f."""
    parameters: Array
    """Draws of them, shape (n, p)."""
    quantities: Mapping[str, Array]
    """Draws of `QUANTITIES`, of values of the data sheet, q, d and its `uncertain` numbers; each of shape (n,)."""

    def draws(self, name: str) -> Array:
        """Draws of a quantity (data-sheet errors included) or, where there is none of that name, of a parameter."""
        if name in self.quantities:
            return self.quantities[name]
        if name not in self.names:
            known = ", ".join([*self.quantities, *self.names])
            raise ValueError(f"no quantity {name!r} in the posterior: it holds {known}")
        return np.asarray(self.parameters[:, self.names.index(name)])


def laplace_draws(
    fit: StatisticsFit,
    sheet: DataSheet,
    count: int,
    rng: np.random.Generator,
    data: Sequence[SideDatum] = (),
) -> CameraDraws:
    """Draws from Laplace's approximation: the normal law of the Fisher matrix about the best fit, and the data sheet.

    Systematic errors of the fit are drawn along; side `data` then condition all.
    """
    names = fit.covariance.names
    root = np.linalg.cholesky(fit.covariance.matrix)
    cameras = fit.camera.vector(names) + rng.normal(size=(count, len(root))) @ root.T
    cameras[:, :3] += rng.normal(size=(count, len(fit.systematic))) @ fit.systematic
    drawn = sheet.draws(count, rng)
    parameters, quantities = _with_data(np.column_stack([cameras, drawn.T]), sheet, combine(fit, sheet, data), rng)
    return CameraDraws((*names, "f"), parameters, quantities)


def _with_data(
    states: Array, sheet: DataSheet, combined: Combined, rng: np.random.Generator
) -> tuple[Array, dict[str, Array]]:
    """Parameters of draws, f the last, and `QUANTITIES`, once side data are known."""
    states, count = combined.conditioned(states, rng), len(combined.names)
    return states[:, : count + 1], derived(states, sheet, states[:, count:].T)


@dataclass(frozen=True, eq=False)
class Posterior(CameraDraws):
    """Draws from the posterior, and whether they may be trusted."""

    r_hat: Mapping[str, float]
    """Between ensembles, for each parameter and derived quantity."""
    bulk_ess: Mapping[str, float]
    tail_ess: Mapping[str, float]
    converged: bool
    message: str
    """Reason why it counts as converged, or not."""
    acceptance: float
    steps: int
    """Steps of each ensemble, after the first that were dropped."""
    walkers: int
    """Number of walkers in all ensembles."""
    between: float
    """Standard error of a mean by the scatter between ensembles, in standard deviations; rms over the parameters."""


def sample_posterior(
    fit: StatisticsFit,
    sheet: DataSheet,
    *,
    seed: int,
    chunk: int = 500,
    most_steps: int = DEFAULT_STEPS,
    ess: float = DEFAULT_ESS,
    data: Sequence[SideDatum] = (),
    progress: Callable[[int, float, float], None] | None = None,
) -> Posterior:
    """Sample (A, m, 1/d_2, x_0, y_0, distortion, f) until separate ensembles agree.

    Four ensembles, of four walkers for each parameter and at least 24, start apart, spread 1.5 times as wide as the
    Fisher matrix says, and walk in coordinates whitened by it. They stop when R-hat between ensembles is below 1.01 and
    bulk and tail effective sample sizes are above `ess` for every parameter and for d_1, d_f, H and d_3, or after
    `most_steps`. Priors are flat in A, m, 1/d_2 (all positive), x_0, y_0 and distortion, and normal in f, q, d, the
    board's scale and the sheet's elements as the data sheet says; all of these but f, and the fit's systematic errors,
    which no image informs, are drawn afterwards, and side `data` condition the draws.

    The same `seed` gives the same draws; after each `chunk` of steps `progress` is called with (steps, R-hat, effective
    sample size).

    Raises
    ------
    CalibrationError
        The likelihood is not finite near its peak.
    """
    import emcee

    target = _Target(fit, sheet)
    dimension = len(target.names)
    size = max(24, 4 * dimension)
    moves = [(emcee.moves.DEMove(), 0.7), (emcee.moves.DESnookerMove(), 0.1), (emcee.moves.StretchMove(), 0.2)]
    seeds = np.random.SeedSequence(seed).spawn(ENSEMBLES + 1)
    samplers, states = [], []
    for spawned in seeds[:ENSEMBLES]:
        random = np.random.RandomState(np.random.MT19937(spawned))
        start = 1.5 * random.normal(size=(size, dimension))
        start[~np.isfinite(target(start))] *= 0.1
        if not np.isfinite(target(start)).all():
            raise CalibrationError("the posterior is not finite near its peak: the boards hardly determine the camera")
        samplers.append(emcee.EnsembleSampler(size, dimension, target, moves=moves, vectorize=True))
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
        r_hat, bulk, tail = target.diagnostics(chain)
        worst, least = max(r_hat.values()), min(*bulk.values(), *tail.values())
        converged = worst < RHAT and least > ess
        if progress is not None:
            progress(steps, worst, least)
        if converged or steps >= most_steps:
            break
    said = f"R-hat {worst:.4f} (below {RHAT} wanted), effective sample size {least:.0f} (above {ess:.0f} wanted)"
    flat = target.parameters(chain.swapaxes(0, 1).reshape(-1, dimension))
    flat = flat[:: max(1, len(flat) // _KEPT)]
    rng = np.random.default_rng(seeds[-1])
    drawn_states: Array = np.column_stack([flat, sheet.draws(len(flat), rng)[1:].T])
    drawn_states[:, :3] += rng.normal(size=(len(flat), len(fit.systematic))) @ fit.systematic
    parameters, quantities = _with_data(drawn_states, sheet, combine(fit, sheet, data), rng)
    means, spread = chain.mean(axis=(1, 2)), chain.reshape(-1, dimension).std(axis=0)
    return Posterior(
        names=target.names,
        parameters=parameters,
        quantities=quantities,
        r_hat=r_hat,
        bulk_ess=bulk,
        tail_ess=tail,
        converged=converged,
        message=("converged: " if converged else f"NOT converged after {steps} steps: ") + said,
        acceptance=float(np.mean([sampler.acceptance_fraction.mean() for sampler in samplers])),
        steps=steps,
        walkers=ENSEMBLES * size,
        between=float(np.sqrt(np.mean((means.std(axis=0, ddof=1) / spread) ** 2) / ENSEMBLES)),
    )


class _Target:
    """Log-posterior in whitened coordinates."""

    def __init__(self, fit: StatisticsFit, sheet: DataSheet) -> None:
        self.likelihood = _ProfileLikelihood(fit)
        self.names = (*self.likelihood.names, "f")
        self._root = np.linalg.cholesky(fit.covariance.matrix)
        self._sheet = sheet

    def parameters(self, whitened: Array) -> Array:
        """Fitted parameters and f of whitened coordinates, shape (n, p)."""
        shared = self.likelihood.best + whitened[:, :-1] @ self._root.T
        return np.column_stack([shared, self._sheet.f + self._sheet.f_sigma * whitened[:, -1]])

    def __call__(self, whitened: Array) -> Array:
        """Log-posterior of many points, shape (n,)."""
        values = self.parameters(whitened)
        log = self.likelihood(values[:, :-1]) - self.likelihood.peak - 0.5 * whitened[:, -1] ** 2
        return np.where(values[:, -1] > 0, log, -np.inf)

    def diagnostics(self, chain: Array) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
        """R-hat between ensembles, bulk and tail ESS over all walkers, for parameters and derived lengths."""
        from arviz_stats.base import array_stats  # type: ignore[attr-defined]

        stats: Any = array_stats
        groups, steps, walkers, dimension = chain.shape
        values = self.parameters(chain.reshape(-1, dimension))
        series = {name: values[:, k] for k, name in enumerate(self.names)}
        lengths = derived(values, self._sheet, [values[:, -1], *self._sheet.mean[1:]])
        series |= {name: lengths[name] for name in QUANTITIES if name not in series and name != "d_2"}
        r_hat, bulk, tail = {}, {}, {}
        for name, flat in series.items():
            if np.ptp(flat) == 0:
                continue
            draws = flat.reshape(groups, steps, walkers)
            r_hat[name] = float(stats.rhat(draws.reshape(groups, steps * walkers)))
            by_walker = draws.swapaxes(1, 2).reshape(groups * walkers, steps)
            bulk[name] = float(stats.ess(by_walker, method="bulk"))
            tail[name] = float(stats.ess(by_walker, method="tail", prob=(0.05, 0.95)))
        return r_hat, bulk, tail


# --- what the draws are worth -----------------------------------------------------------------------------------------


def sample_size_for(accuracy: float | None) -> float:
    """Effective sample size, bulk and tail, that an accuracy of the means takes [standard deviations of the posterior].

    Raises
    ------
    InputError
        Out of range.
    """
    if accuracy is None:
        return DEFAULT_ESS
    check_accuracy(accuracy, FINEST, "in standard deviations; a finer posterior takes too many draws")
    return max(50.0, (SIGMAS / accuracy) ** 2)


def most_steps_for(size: float) -> int:
    """Steps after which sampling gives up."""
    return int(min(MOST_STEPS, max(DEFAULT_STEPS, DEFAULT_STEPS * size / DEFAULT_ESS)))


def posterior_accuracy(draws: CameraDraws, asked: float | None = None) -> Accuracy:
    """Method, expected and measured error of the intervals' ends and means, for having finitely many draws.

    Errors are in standard deviations of the posterior itself: a mean of n independent draws has one of 1/sqrt(n).
    Draws that are no posterior's are taken for Laplace's approximation.
    """
    of, unit = "means and ends of intervals", "standard deviations of the posterior"
    count = len(draws.parameters)
    if not isinstance(draws, Posterior):
        model, error = "the posterior is taken as normal", SIGMAS / math.sqrt(count)
        return Accuracy(of, unit, f"{count} draws of Laplace's approximation", error, asked=asked, model=model)
    p = draws
    least = min(*p.bulk_ess.values(), *p.tail_ess.values())
    thinned = 0.0 if count >= p.walkers * p.steps else 1 / count
    return Accuracy(
        of,
        unit,
        f"{p.walkers} walkers in {ENSEMBLES} ensembles, {p.steps} steps: effective sample size {least:.0f}",
        SIGMAS * math.sqrt(1 / least + thinned),
        SIGMAS * p.between,
        "scatter between ensembles",
        asked,
        scatter=1 / math.sqrt(2 * (ENSEMBLES - 1) * len(p.names)),
    )


# --- likelihood -------------------------------------------------------------------------------------------------------


class _ProfileLikelihood:
    """Log-likelihood of the shared parameters, each board's pose taken along.

    For a camera off the best fit, each pose is moved as the linear fit says, what of its residuals a pose can still
    take up is projected away, and the rest is summed over the boards. With poses Gaussian about their best, and flat in
    units of their own standard deviation, this is the likelihood with poses integrated out, up to a constant. Flat in
    millimetres instead would favour far boards, twelve times over, and pull A by up to its own standard deviation.
    """

    def __init__(self, fit: StatisticsFit) -> None:
        self.names = fit.covariance.names
        self.best = fit.camera.vector(self.names)
        self._fit = fit
        self._columns = [GLOBALS.index(name) for name in self.names]
        self._taken = fit.statistics.linear(fit.camera.vector(), fit.poses.vector).eliminated().own
        self.peak = float(self(self.best[None])[0])
        """Log-likelihood at the best fit."""

    def __call__(self, shared: Array) -> Array:
        """Log-likelihood, up to a constant, shape (w,), of `names`, shape (w, p); -inf where a board is behind."""
        cameras = np.tile(self._fit.camera.vector(), (len(shared), 1))
        cameras[:, self._columns] = shared
        pose = self._fit.poses.vector + np.tensordot(shared - self.best, self._fit.pose_by_shared, (1, 2))
        possible = (cameras[:, :3] > 0).all(axis=1) & (pose[..., 5] > 0).all(axis=1)
        off = self._fit.statistics.linear(cameras, pose, derivatives=False).off
        taken = off[..., None, :] @ self._taken
        squares = np.einsum("wbr,wbr->w", off, off) - np.einsum("wbip,wbip->w", taken, taken)
        return np.where(possible, -0.5 * squares, -np.inf)


# --- what follows from them -------------------------------------------------------------------------------------------


def depth_errors(
    draws: CameraDraws,
    fit: StatisticsFit,
    sheet: DataSheet,
    distances: Array,
    data: Sequence[SideDatum] = (),
) -> dict[str, Array]:
    """Errors of measured depths that the calibration's uncertainty causes.

    Parameters
    ----------
    fit : StatisticsFit
        Whose camera makes the slope of a point at each distance.
    distances : ndarray
        From the main lens [mm], beyond the FAP, shape (k,).
    data : sequence of SideDatum
        That the draws were conditioned on.

    Returns
    -------
    dict
        ``distance``; ``from_lens`` and ``from_pupil``: standard deviation of Z and of Z_F [mm]; ``low_95`` and
        ``high_95``: interval of the error of Z [mm]; each of shape (k,).

    Notes
    -----
    Eq. 12 solved for depth. The images' errors of d_3 and of A cancel in distances from the lens near the focal plane
    (d_f = f (1 + m)/m knows nothing of A), where the error of f alone is left; in distances from the pupil f drops out
    and the error of A stays.
    """
    distances = np.asarray(distances, float)
    best = sheet.apparent(combine(fit, sheet, data).lengths(sheet))
    depth = distances - best.pupil
    if not (depth > 0).all():
        raise CalibrationError(f"distances must lie beyond the FAP at {float(best.pupil):.2f} mm from the lens")
    # Views measure a slope in pitches per pixel: the pitches' own errors are in it.
    slope = (best.m - best.A / depth) * best.A * sheet.q / (best.d_2 * sheet.d)
    A, m, d_2, pupil = (part[:, None] for part in sheet.apparent(draws.quantities))
    q, d = (draws.quantities[name][:, None] for name in ("q", "d"))
    with np.errstate(divide="ignore"):
        z_f = A / (m - slope * d_2 * d / (q * A))
    z = z_f + pupil
    low, high = np.quantile(z - distances, [0.025, 0.975], axis=0)
    return {
        "distance": distances,
        "from_lens": z.std(axis=0, ddof=1),
        "from_pupil": z_f.std(axis=0, ddof=1),
        "low_95": low,
        "high_95": high,
    }


def variance_shares(
    fit: StatisticsFit, sheet: DataSheet, data: Sequence[SideDatum] = ()
) -> dict[str, dict[str, float]]:
    """To first order, what share of each quantity's variance comes from the images and from each data-sheet value.

    Returns
    -------
    dict
        For each of `QUANTITIES`, shares of ``images``, ``f``, ``q``, ``d``, ``board``, ``elements`` (where the sheet
        has any), ``systematic`` (what scatter does not show) and of side data by name, that add up to 1, and ``sigma``,
        the standard deviation of all.
    """
    count, known = len(fit.covariance.names), combine(fit, sheet, data)
    images = np.linalg.cholesky(fit.covariance.matrix).T
    # Steps of one standard deviation in (shared parameters, f, q, d, board, elements), by their source.
    sheet_size = len(sheet.mean)
    steps = {"images": np.pad(images, ((0, 0), (0, sheet_size)))}
    by_sheet = np.eye(sheet_size, count + sheet_size, count) * sheet.sigma[:, None]
    steps |= {name: row[None] for name, row in zip(("f", "q", "d", "board"), by_sheet[:4], strict=True)}
    steps |= {"elements": by_sheet[4:]} if sheet.uncertain else {}
    steps["systematic"] = np.pad(fit.systematic, ((0, 0), (0, count + sheet_size - 3)))
    steps = {source: step @ known.keeps.T for source, step in steps.items()}
    for datum in data:
        steps[datum.name] = known.gain[:, [source == datum.name for source in known.sources]].T

    every = np.concatenate([*steps.values()])
    ends = np.concatenate([known.best + 0.01 * every, known.best - 0.01 * every])
    lengths = derived(ends[:, :count], sheet, ends[:, count:].T)
    of_source = np.cumsum([len(step) for step in steps.values()])[:-1]
    parts: dict[str, dict[str, float]] = {source: {} for source in steps}
    for name in QUANTITIES:
        ahead, behind = np.split(np.broadcast_to(lengths[name], len(ends)), 2)
        for source, moved in zip(steps, np.split((ahead - behind) / 0.02, of_source), strict=True):
            parts[source][name] = float(np.square(moved).sum())
    shares = {}
    for name in QUANTITIES:
        total = sum(part[name] for part in parts.values())
        shares[name] = {source: part[name] / total if total > 0 else 0.0 for source, part in parts.items()}
        shares[name]["sigma"] = float(np.sqrt(total))
    return shares
