"""Chance: which deviations trial n has, from (seed, n) alone.

Every distribution is a map from a uniform number in (0, 1) to a deviation in units of the tolerance, symmetric about 0.
Random and low-discrepancy sampling therefore share one path, and members of a group can share their uniform number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array
from ..sobol import BITS, direction_numbers

Distribution = Literal["normal", "uniform", "parabolic", "end-point"]
"""Names of the known distributions."""
Sampling = Literal["random", "sobol"]
"""Independent random trials, or a scrambled Sobol sequence."""

SMALLEST = 2.0**-53
"""Uniform numbers are kept this far from 0 and 1, so that no deviation is infinite."""


def deviation(distribution: Distribution, uniform: ArrayLike, truncation: float = 2.0) -> Array:
    """Deviations in units of the tolerance.

    Parameters
    ----------
    distribution : str
        "normal": sigma is tolerance / `truncation`, cut off at the tolerance. "uniform". "parabolic": density
        3 x^2 / 2, heaped towards the ends, as general ray tracers use the word. "end-point": either end, evenly.
    uniform : array_like
        In [0, 1].
    truncation : float
        Of "normal": the tolerance in sigmas, above 0.

    Returns
    -------
    ndarray
        In [-1, 1], same shape; ``-deviation(u) == deviation(1 - u)`` to rounding.
    """
    u = _inside(uniform)
    if distribution == "uniform":
        return np.asarray(2 * u - 1)
    if distribution == "parabolic":
        return np.cbrt(2 * u - 1)
    if distribution == "end-point":
        return np.where(u < 0.5, -1.0, 1.0)
    from scipy.special import ndtr, ndtri

    tail = float(ndtr(-truncation))
    # From the nearer tail, where digits are not lost against 1.
    size = -ndtri(tail + (1 - 2 * tail) * np.minimum(u, 1 - u)) / truncation
    return np.copysign(np.clip(size, 0.0, 1.0), u - 0.5)


def standard_deviation(distribution: Distribution, truncation: float = 2.0) -> float:
    """Standard deviation of `deviation`, in units of the tolerance; parameters as there."""
    if distribution == "normal":
        from scipy.special import gammainc

        half = truncation**2 / 2
        return float(np.sqrt(gammainc(1.5, half) / gammainc(0.5, half)) / truncation)
    return {"uniform": 1 / math.sqrt(3), "parabolic": math.sqrt(0.6), "end-point": 1.0}[distribution]


def _inside(uniform: ArrayLike) -> Array:
    return np.clip(np.asarray(uniform, dtype=np.float64), SMALLEST, 1 - SMALLEST)


@dataclass(frozen=True)
class Perturbation:
    """Perturbation of one number that a build misses."""

    place: str
    """Dotted place in the design."""
    nominal: float
    """[mm, rad, or none]."""
    tolerance: float
    """Half-width, in the same unit."""
    distribution: Distribution = "normal"
    truncation: float = 2.0
    """Truncation of "normal": the tolerance in sigmas."""
    group: str | None = None
    """Perturbations with the same group share their chance."""
    opposed: bool = False
    """Whether it moves against its group."""
    source: str = ""
    """Source of the tolerance."""

    @property
    def sigma(self) -> float:
        """Standard deviation, in the place's unit."""
        return self.tolerance * standard_deviation(self.distribution, self.truncation)


@dataclass(frozen=True)
class Draws:
    """How trials are drawn.

    Each perturbation has an independent uniform number of its own, except that a group's members share one: entirely
    (correlation 1), or mixed with their own as normal scores ``sqrt(rho) z_group + sqrt(1 - rho) z_own``, so that
    the scores of two members are correlated by rho.
    """

    perturbations: tuple[Perturbation, ...]
    correlations: tuple[tuple[str, float], ...] = ()
    """Group to rho, in (0, 1]."""
    sampling: Sampling = "random"
    seed: int = 0

    def _rho(self, perturbation: Perturbation) -> float:
        return dict(self.correlations)[perturbation.group] if perturbation.group else 0.0

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the independent uniform numbers: one a free perturbation, one a group, members' own parts last."""
        free = [p.place for p in self.perturbations if not p.group]
        shared = [f"group {name}" for name, _ in self.correlations]
        own = [f"{p.place} (own part)" for p in self.perturbations if p.group and self._rho(p) < 1]
        return (*free, *shared, *own)

    def uniforms(self, chunk: int, size: int, start: int = 0, stop: int | None = None) -> Array:
        """Independent uniform numbers of trials `start` to `stop` of a chunk of `size` trials, shape (factors, trials).

        The same whatever the part of a chunk that is asked for.
        """
        count = (size if stop is None else stop) - start
        if self.sampling == "sobol":
            return sobol_points(len(self.factors), chunk * size + start, count, self.seed)
        seed = np.random.SeedSequence(self.seed, spawn_key=(chunk,))
        rows = np.empty((len(self.factors), count))
        for factor, row in enumerate(rows):  # each factor's numbers lie behind one another
            np.random.Generator(np.random.PCG64(seed).advance(factor * size + start)).random(out=row)
        return rows

    def deviations(self, uniforms: Array) -> Array:
        """Deviations in units of the tolerances, shape (perturbations, trials), from independent uniform numbers."""
        row = dict(zip(self.factors, uniforms, strict=True))
        result = np.empty((len(self.perturbations), uniforms.shape[1]))
        for index, p in enumerate(self.perturbations):
            u = row[f"group {p.group}" if p.group else p.place]
            own = row.get(f"{p.place} (own part)")
            if own is not None:
                from scipy.special import ndtr, ndtri

                rho = self._rho(p)
                u = ndtr(np.sqrt(rho) * ndtri(_inside(u)) + np.sqrt(1 - rho) * ndtri(_inside(own)))
            value = deviation(p.distribution, u, p.truncation)
            result[index] = -value if p.opposed else value
        return result

    def values(self, deviations: Array, scale: float = 1.0) -> dict[str, Array]:
        """Place to its numbers in each trial, all tolerances multiplied by `scale`."""
        pairs = zip(self.perturbations, deviations, strict=True)
        return {p.place: p.nominal + (p.tolerance * scale) * row for p, row in pairs}

    def covariance(self) -> Array:
        """Covariance of the deviations in the places' units, shape (perturbations, perturbations).

        Exact for independent and fully tied normal-alike members; for others with a correlation below 1, the normal
        scores' rho stands for the deviations' (right to a few percent of rho).
        """
        signed = np.array([-p.sigma if p.opposed else p.sigma for p in self.perturbations])
        matrix = np.diag(signed**2)
        for name, rho in self.correlations:
            tied = np.where([p.group == name for p in self.perturbations], signed, 0.0)
            matrix += rho * (np.outer(tied, tied) - np.diag(tied**2))
        return matrix


def sobol_points(dimensions: int, start: int, count: int, seed: int) -> Array:
    """Points `start` to ``start + count - 1`` of a scrambled Sobol sequence, shape (dimensions, count)."""
    shift, steps = _scrambled(dimensions, seed)
    numbers = np.arange(start + 1, start + count)
    # From point to point in the order of Gray's code: what number n adds is that of its lowest bit.
    walk = np.empty((dimensions, count), np.uint32)
    walk[:, 1:] = steps[:, np.bitwise_count((numbers & -numbers) - 1)]
    named = (start ^ start >> 1) >> np.arange(BITS) & 1
    walk[:, 0] = shift ^ np.bitwise_xor.reduce(np.where(named, steps, 0), axis=1)
    return np.bitwise_xor.accumulate(walk, axis=1) * 2.0**-BITS + 2.0 ** -(BITS + 1)


@lru_cache(maxsize=4)
def _scrambled(dimensions: int, seed: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Shift and direction numbers of a scrambled Sobol sequence, shapes (dimensions,) and (dimensions, BITS).

    As `scipy.stats.qmc.Sobol` has them.
    """
    places = np.arange(BITS)
    stream = np.random.default_rng(seed).spawn(1)[0]
    shift = stream.integers(2, size=(dimensions, BITS), dtype=np.uint32) @ (1 << places)
    mixing = np.tril(stream.integers(2, size=(dimensions, BITS, BITS), dtype=np.uint32), -1) | np.eye(BITS, dtype=int)
    # Bits from the first, the most significant one; each becomes a sum, modulo 2, of itself and those before it.
    bits = direction_numbers(dimensions)[:, None, :] >> places[::-1, None] & 1
    steps = (mixing @ bits % 2 << places[::-1, None]).sum(axis=1)
    return shift.astype(np.uint32), steps.astype(np.uint32)
