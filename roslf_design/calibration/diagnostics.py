"""Has a Markov chain converged? Rank-normalised split R-hat, bulk and tail effective sample size.

After Vehtari, Gelman, Simpson, Carpenter, Buerkner, "Rank-normalization, folding, and localization" (2021).
"""

from __future__ import annotations

import numpy as np

from .lattice import Array


def r_hat(draws: Array) -> float:
    """Rank-normalised split R-hat, the larger of bulk and folded.

    Parameters
    ----------
    draws : ndarray
        Shape (chains, draws), 4 or more draws a chain, in time's order.

    Returns
    -------
    float
        1 for chains that agree; inf where nothing varies within but does between.
    """
    split = _split(draws)
    folded = np.abs(split - np.median(split))
    return max(_plain_r_hat(_normal_scores(split)), _plain_r_hat(_normal_scores(folded)))


def bulk_ess(draws: Array) -> float:
    """Effective sample size for the middle of the distribution; parameters as for `r_hat`."""
    return _ess(_normal_scores(_split(draws)))


def tail_ess(draws: Array) -> float:
    """Effective sample size of the 5 % and 95 % quantiles, the smaller; parameters as for `r_hat`."""
    low, high = np.quantile(draws, (0.05, 0.95))
    return min(_ess(_split((draws <= level).astype(float))) for level in (low, high))


def _split(draws: Array) -> Array:
    half = draws.shape[1] // 2
    if half < 2:
        raise ValueError(f"convergence needs at least 4 draws a chain, got {draws.shape[1]}")
    return np.concatenate([draws[:, :half], draws[:, -half:]])


def _normal_scores(draws: Array) -> Array:
    from scipy.special import ndtri
    from scipy.stats import rankdata

    rank = rankdata(draws, method="average").reshape(draws.shape)
    scores: Array = ndtri((rank - 0.375) / (draws.size + 0.25))
    return scores


def _plain_r_hat(chains: Array) -> float:
    n = chains.shape[1]
    within = float(chains.var(axis=1, ddof=1).mean())
    between = float(chains.mean(axis=1).var(ddof=1))
    if within == 0:
        return 1.0 if between == 0 else float("inf")
    return float(np.sqrt((n - 1) / n + between / within))


def _ess(chains: Array) -> float:
    """Effective sample size by Geyer's initial monotone sequence over all chains together."""
    count, n = chains.shape
    if np.ptp(chains) == 0:
        return float(count * n)
    covariance = _autocovariance(chains)
    within = float(covariance[:, 0].mean()) * n / (n - 1)
    total = within * (n - 1) / n + (float(chains.mean(axis=1).var(ddof=1)) if count > 1 else 0.0)
    rho = 1 - (within - covariance.mean(axis=0)) / total
    rho[0] = 1.0
    pairs = rho[: 2 * (n // 2)].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0)
    last = int(negative[0]) if len(negative) else len(pairs)
    monotone = np.minimum.accumulate(pairs[:last])
    time = -1 + 2 * float(monotone.sum())
    if last < len(pairs):
        time += max(float(rho[2 * last]), 0.0)
    time = max(time, 1 / np.log10(count * n))
    return float(count * n / time)


def _autocovariance(chains: Array) -> Array:
    """Biased autocovariance of each chain at every lag."""
    n = chains.shape[1]
    size = 1 << int(np.ceil(np.log2(2 * n)))
    spectrum = np.fft.rfft(chains - chains.mean(axis=1, keepdims=True), size, axis=1)
    result: Array = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=1)[:, :n] / n
    return result
