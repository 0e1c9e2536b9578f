"""How sure a calibration is: the posterior of the camera by affine-invariant ensembles, poses eliminated."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._jit import kernel
from ..accuracy.statement import Accuracy, check_accuracy
from .calibrate import StatisticsFit
from .corners import cholesky
from .datasheet import QUANTITIES, CameraDraws, DataSheet, derived
from .frames import Array, CalibrationError
from .model import GLOBALS, rotation_matrix

DEFAULT_ESS, DEFAULT_STEPS = 400.0, 10_000
"""Effective sample size wanted, bulk and tail, and most steps of each ensemble."""
SIGMAS = 2.0
"""Of a Monte Carlo standard error: what a mean is off by in at most 5 % of runs."""
FINEST = 0.02
"""A finer posterior takes more than 1e4 independent draws, which is more than chains in memory should hold."""
MOST_STEPS = 60_000
RHAT = 1.01
"""R-hat between ensembles below which they count as converged."""
_KEPT = 40_000
"""Most draws kept of a posterior."""
_CAMERA = 7
"""Parameters of `GLOBALS` that a likelihood takes: A, m, 1/d_2, x_0, y_0, k_1, k_2."""


@dataclass(frozen=True, eq=False)
class Posterior(CameraDraws):
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
    chunk: int = 500,
    most_steps: int = DEFAULT_STEPS,
    ess: float = DEFAULT_ESS,
    progress: Callable[[int, float, float], None] | None = None,
) -> Posterior:
    """Sample (A, m, 1/d_2, x_0, y_0, distortion, f) until separate ensembles agree.

    Ensembles, of four walkers for each parameter and at least 24, start apart, spread 1.5 times as wide as the Fisher
    matrix says, and walk in coordinates whitened by it. They stop when R-hat between ensembles is below 1.01 and bulk
    and tail effective sample sizes are above `ess` for every parameter and for d_1, d_f, H and d_3, or after
    `most_steps`. Priors are flat in A, m, 1/d_2 (all positive), x_0, y_0 and distortion, and normal in f, q, d and the
    board's scale as the data sheet says; q, d, scale and the fit's systematic errors, which no image informs, are drawn
    afterwards.

    Parameters
    ----------
    fit : StatisticsFit
    sheet : DataSheet
    seed : int
        Same seed, same draws.
    ensembles : int
        Separate ensembles, at least 4.
    chunk : int
        Steps between checks.
    most_steps : int
        Of each ensemble.
    ess : float
        Effective sample size wanted, bulk and tail.
    progress : callable, optional
        Called with (steps, R-hat, effective sample size) after each chunk.

    Raises
    ------
    CalibrationError
        Fewer than four ensembles, or the likelihood is not finite near its peak.
    """
    import emcee

    if ensembles < 4:
        raise CalibrationError(f"convergence is judged between at least 4 ensembles, got {ensembles}")
    target = _Target(fit, sheet)
    dimension = len(target.names)
    size = max(24, 4 * dimension)
    moves = [(emcee.moves.DEMove(), 0.7), (emcee.moves.DESnookerMove(), 0.1), (emcee.moves.StretchMove(), 0.2)]
    seeds = np.random.SeedSequence(seed).spawn(ensembles + 1)
    samplers, states = [], []
    for spawned in seeds[:ensembles]:
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
    scales = sheet.draws(len(flat), rng)[1:]
    flat[:, :3] += rng.normal(size=(len(flat), len(fit.systematic))) @ fit.systematic
    means, spread = chain.mean(axis=(1, 2)), chain.reshape(-1, dimension).std(axis=0)
    return Posterior(
        names=target.names,
        parameters=flat,
        quantities=derived(flat, sheet, flat[:, -1], scales),
        r_hat=r_hat,
        bulk_ess=bulk,
        tail_ess=tail,
        converged=converged,
        message=("converged: " if converged else f"NOT converged after {steps} steps: ") + said,
        acceptance=float(np.mean([sampler.acceptance_fraction.mean() for sampler in samplers])),
        steps=steps,
        walkers=ensembles * size,
        ensembles=ensembles,
        between=float(np.sqrt(np.mean((means.std(axis=0, ddof=1) / spread) ** 2) / ensembles)),
    )


class _Target:
    """Log-posterior in whitened coordinates."""

    def __init__(self, fit: StatisticsFit, sheet: DataSheet) -> None:
        self.likelihood = ProfileLikelihood(fit)
        fitted = fit.covariance.names
        self.names = (*fitted, "f")
        self._columns = [GLOBALS.index(name) for name in fitted]
        self._centre = fit.camera.vector(fitted)
        self._root = np.linalg.cholesky(fit.covariance.matrix)
        self._sheet = sheet

    def parameters(self, whitened: Array) -> Array:
        """Fitted parameters and f of whitened coordinates, shape (n, p)."""
        shared = self._centre + whitened[:, :-1] @ self._root.T
        return np.column_stack([shared, self._sheet.f + self._sheet.f_sigma * whitened[:, -1]])

    def __call__(self, whitened: Array) -> Array:
        """Log-posterior of many points, shape (n,)."""
        values = self.parameters(whitened)
        cameras = np.tile(self.likelihood.best, (len(values), 1))
        cameras[:, self._columns] = values[:, :-1]
        log = self.likelihood(cameras) - self.likelihood.peak - 0.5 * whitened[:, -1] ** 2
        return np.where(values[:, -1] > 0, log, -np.inf)

    def diagnostics(self, chain: Array) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
        """R-hat between ensembles, bulk and tail ESS over all walkers, for parameters and derived lengths."""
        from arviz_stats.base import array_stats  # type: ignore[attr-defined]

        stats: Any = array_stats
        groups, steps, walkers, dimension = chain.shape
        values = self.parameters(chain.reshape(-1, dimension))
        series = {name: values[:, k] for k, name in enumerate(self.names)}
        lengths = derived(values, self._sheet, values[:, -1])
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
    of = "means and intervals, in standard deviations of the posterior"
    count = len(draws.parameters)
    if not isinstance(draws, Posterior):
        model, error = "the posterior is taken as normal", SIGMAS / math.sqrt(count)
        return Accuracy(of, f"{count} draws of Laplace's approximation", error, asked=asked, model=model)
    p = draws
    least = min(*p.bulk_ess.values(), *p.tail_ess.values())
    thinned = 0.0 if count >= p.walkers * p.steps else 1 / count
    return Accuracy(
        of,
        f"{p.walkers} walkers in {p.ensembles} ensembles, {p.steps} steps: effective sample size {least:.0f}",
        SIGMAS * math.sqrt(1 / least + thinned),
        SIGMAS * p.between,
        "scatter between ensembles",
        asked,
        scatter=1 / math.sqrt(2 * (p.ensembles - 1) * len(p.names)),
    )


# --- likelihood -------------------------------------------------------------------------------------------------------


class ProfileLikelihood:
    """Log-likelihood of (A, m, 1/d_2, x_0, y_0, k_1, k_2), each board's pose taken along.

    For a camera off the best fit, each pose is moved as the linear fit says, one Gauss-Newton step's gain is taken off
    its misfit in closed form (the Schur complement of the pose block), and what is left is summed over the boards.
    With poses Gaussian about their best, and flat in units of their own standard deviation, this is the likelihood
    with poses integrated out, up to a constant. Flat in millimetres instead would favour far boards, twelve times over,
    and pull A by up to its own standard deviation.
    """

    def __init__(self, fit: StatisticsFit) -> None:
        names = fit.covariance.names
        columns = [GLOBALS.index(name) for name in names]
        self.best = fit.camera.vector()[:_CAMERA]
        self._follow = np.zeros((*fit.pose_by_shared.shape[:2], _CAMERA))
        self._follow[..., columns] = fit.pose_by_shared
        self._fixed = np.array([fit.camera.q, fit.camera.d])
        self._pose = np.ascontiguousarray(fit.poses.vector)
        data = fit.statistics
        weight = 1 / data.sigma
        self._data = tuple(map(np.ascontiguousarray, (data.points, data.values, data.at, data.share, weight)))
        zero = self(self.best[None])
        self.peak = float(zero[0])
        """Log-likelihood at the best fit."""

    def __call__(self, cameras: Array) -> Array:
        """Log-likelihood, up to a constant, shape (w,), of cameras, shape (w, 7); -inf where a board is behind one."""
        cameras = np.ascontiguousarray(cameras, float)
        out = np.empty(len(cameras))
        pose = self._pose + np.tensordot(cameras - self.best, self._follow, (1, 2))
        turns, shifts = rotation_matrix(pose[..., :3]), np.ascontiguousarray(pose[..., 3:])
        points, values, at, share, weight = self._data
        _eliminate.compiled(cameras, turns, shifts, self._fixed, points, values, at, share, weight, out)
        return out


@kernel()
def _eliminate(
    cameras: Array,
    turns: Array,
    shifts: Array,
    fixed: Array,
    points: Array,
    values: Array,
    at: Array,
    share: Array,
    weight: Array,
    out: Array,
) -> None:
    boards, corners = share.shape
    for w in range(cameras.shape[0]):
        A, m, x_0, y_0 = cameras[w, 0], cameras[w, 1], cameras[w, 3], cameras[w, 4]
        k_1, k_2, q, d = cameras[w, 5], cameras[w, 6], fixed[0], fixed[1]
        step = q * A * cameras[w, 2]
        J, H, g, r = np.empty((3, 6)), np.empty((6, 6)), np.empty(6), np.empty(3)
        total, behind = 0.0, A <= 0.0 or m <= 0.0 or step <= 0.0
        for b in range(boards):
            R, p = turns[w, b], shifts[w, b]
            H[:] = 0.0
            g[:] = 0.0
            misfit = 0.0
            for n in range(corners):
                if weight[b, n, 0] == 0.0:
                    continue
                px, py, pz = points[n, 0], points[n, 1], points[n, 2]
                z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + p[2]
                if z <= 0.0:
                    behind = True
                    break
                sx, sy = -step * at[b, n, 0], -step * at[b, n, 1]
                fx = (R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + p[0] - sx) / z
                fy = (R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + p[1] - sy) / z
                r2 = fx * fx + fy * fy
                gain, bend, curl = 1.0 + r2 * (k_1 + k_2 * r2), k_1 + 2.0 * k_2 * r2, 2.0 * k_2
                wx, wy = share[b, n], 1.0 - share[b, n]
                tilted = wx * fx * fx + wy * fy * fy
                stretch = gain + 2.0 * bend * tilted
                r[0] = weight[b, n, 0] * (x_0 - (A * gain * fx + m * sx) / d - values[b, n, 0])
                r[1] = weight[b, n, 1] * (y_0 - (A * gain * fy + m * sy) / d - values[b, n, 1])
                r[2] = weight[b, n, 2] * (step / d * (m - A * stretch / z) - values[b, n, 2])
                # Derivatives by the ray's slope, then by the corner's place, then by the board's turn and shift.
                a = -A / (d * z)
                txx, txy, tyy = gain + 2.0 * bend * fx * fx, 2.0 * bend * fx * fy, gain + 2.0 * bend * fy * fy
                lx = 2.0 * bend * fx + 4.0 * curl * tilted * fx + 4.0 * bend * wx * fx
                ly = 2.0 * bend * fy + 4.0 * curl * tilted * fy + 4.0 * bend * wy * fy
                J[0, 3], J[0, 4], J[0, 5] = a * txx, a * txy, -a * (txx * fx + txy * fy)
                J[1, 3], J[1, 4], J[1, 5] = a * txy, a * tyy, -a * (txy * fx + tyy * fy)
                s = a * step / z
                J[2, 3], J[2, 4], J[2, 5] = s * lx, s * ly, -s * (lx * fx + ly * fy + stretch)
                for i in range(3):
                    k = weight[b, n, i]
                    for j in range(3, 6):
                        J[i, j] *= k
                    for j in range(3):
                        # dX = R (turn x P): column j of -R [P]_x.
                        u, v = (j + 1) % 3, (j + 2) % 3
                        J[i, j] = 0.0
                        for c in range(3):
                            J[i, j] += J[i, 3 + c] * (R[c, v] * points[n, u] - R[c, u] * points[n, v])
                    misfit += r[i] * r[i]
                    for j in range(6):
                        g[j] += J[i, j] * r[i]
                        for c in range(j + 1):
                            H[j, c] += J[i, j] * J[i, c]
            if behind or not cholesky(H, 0.0, g):
                behind = True
                break
            total += misfit
            for j in range(6):
                total -= g[j] * g[j]
        out[w] = -math.inf if behind else -0.5 * total
