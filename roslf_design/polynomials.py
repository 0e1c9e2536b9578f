"""Smooth functions of two variables, as products of Chebyshev polynomials over a box: nodes, fit, values, gradient.

A disc is fitted within the box about it. Where rays are dear and what is wanted of them is smooth (over the array, over
a pupil), some of them are traced, and polynomials asked for the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebpts1
from numpy.typing import NDArray

from ._arrays import Array, by_value


def nodes_between(low: float, high: float, count: int) -> Array:
    """Chebyshev's nodes between two ends, (count,): fitted there, polynomials err by little more than they must."""
    return np.asarray((low + high) / 2 + (high - low) / 2 * chebpts1(count))


def products(x: NDArray[Any], y: NDArray[Any], degree: int, *, each: bool = False) -> NDArray[Any]:
    """Products T_i(x) T_j(y) of Chebyshev polynomials, shape (terms, ...): i + j, or `each` of them, up to a degree."""
    across, along = _powers(x, degree), _powers(y, degree)
    return np.stack([across[i] * along[j] for i, j in _pairs(degree, each)])


def _pairs(degree: int, each: bool) -> list[tuple[int, int]]:
    return [(i, j) for i in range(degree + 1) for j in range((degree if each else degree - i) + 1)]


def _powers(x: NDArray[Any], degree: int) -> NDArray[Any]:
    """T_0 to T_degree, shape (degree + 1, ...)."""
    values = np.empty((degree + 1, *x.shape), x.dtype)
    values[0], values[1:2], twice = 1.0, x, 2.0 * x
    for k in range(2, degree + 1):
        np.multiply(twice, values[k - 1], out=values[k, ...])
        values[k, ...] -= values[k - 2]
    return values


@by_value
@dataclass(frozen=True)
class Polynomials:
    """Functions of places in the plane; axes of the functions lead, those of the places follow."""

    middle: Array
    """Middle of the box, (2,)."""
    half: Array
    """Half its width and height, (2,)."""
    terms: Array
    """Coefficients of T_i(x) T_j(y), shape (..., n + 1, n + 1)."""

    @classmethod
    def fitted(
        cls, middle: Array, half: Array, degree: int, places: Array, values: Array, *, each: bool = False
    ) -> Polynomials:
        """Least squares through values at places; exact where there are as many places as terms.

        Parameters
        ----------
        middle, half : ndarray, (2,)
            The box.
        degree : int
            Of both variables together, or of `each`.
        places : ndarray, (2, n)
        values : ndarray, (..., n)
        """
        x, y = (places - middle[:, None]) / half[:, None]
        columns, flat = products(x, y, degree, each=each).T, values.reshape(-1, len(x)).T
        through_all = columns.shape[0] == columns.shape[1]
        found = np.linalg.solve(columns, flat) if through_all else np.linalg.lstsq(columns, flat, rcond=None)[0]
        terms = np.zeros((*values.shape[:-1], degree + 1, degree + 1))
        terms[..., *np.transpose(_pairs(degree, each))] = found.T.reshape(*values.shape[:-1], -1)
        return cls(middle, half, terms)

    @classmethod
    def with_gradient(cls, middle: Array, half: Array, degree: int, places: Array, gradient: Array) -> Polynomials:
        """One function from its gradient (2, n) at places (2, n), but for a constant; else as `fitted`."""
        x, y = (_powers(at, degree) for at in (places - middle[:, None]) / half[:, None])
        rate = chebder(np.eye(degree + 1)).T
        by_x, by_y = rate @ x[:-1] / half[0], rate @ y[:-1] / half[1]
        pairs = _pairs(degree, False)[1:]
        columns = np.stack([np.concatenate([by_x[i] * y[j], x[i] * by_y[j]]) for i, j in pairs], axis=-1)
        terms = np.zeros((degree + 1, degree + 1))
        terms[*np.transpose(pairs)] = np.linalg.lstsq(columns, gradient.reshape(-1), rcond=None)[0]
        return cls(middle, half, terms)

    @property
    def _degree(self) -> int:
        return int(self.terms.shape[-1]) - 1

    def at(self, x: Array, y: Array) -> Array:
        """Values at places, arrays of as many axes that broadcast."""
        across = _powers((x - self.middle[0]) / self.half[0], self._degree)
        along = _powers((y - self.middle[1]) / self.half[1], self._degree)
        parts = self.terms @ along.reshape(len(along), -1)
        parts = parts.reshape(*self.terms.shape[:-1], *y.shape)
        rest = (slice(None),) * y.ndim
        total = across[0] * parts[..., 0, *rest]
        for k in range(1, len(across)):
            total += across[k] * parts[..., k, *rest]
        return np.asarray(total)

    def on_grid(self, x: Array, y: Array) -> Array:
        """Values at all x (u,) and y (v,), shape (..., v, u)."""
        across = _powers((x - self.middle[0]) / self.half[0], self._degree)
        along = _powers((y - self.middle[1]) / self.half[1], self._degree)
        return np.asarray((self.terms @ along).swapaxes(-1, -2) @ across)

    @cached_property
    def gradient(self) -> Polynomials:
        """Derivatives by x and by y, (2, ...) functions."""
        by_x, by_y = chebder(self.terms, axis=-2) / self.half[0], chebder(self.terms, axis=-1) / self.half[1]
        terms = np.zeros((2, *self.terms.shape))
        terms[0, ..., : by_x.shape[-2], :], terms[1, ..., : by_y.shape[-1]] = by_x, by_y
        return Polynomials(self.middle, self.half, terms)

    @property
    def bound(self) -> Array:
        """Bound of the functions' sizes within the box, shape (...)."""
        return np.asarray(np.abs(self.terms).sum((-2, -1)))
