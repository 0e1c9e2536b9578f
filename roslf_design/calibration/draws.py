"""Draws of a calibration's parameters and lengths: from a posterior, or from the normal law that stands in for one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .datasheet import DataSheet, derived
from .lattice import Array
from .statistics_fit import StatisticsFit


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of what was fitted and of what follows from it."""

    names: tuple[str, ...]
    """Parameters: those of the fit, then f."""
    parameters: Array
    """Draws of them, shape (n, p)."""
    quantities: Mapping[str, Array]
    """Draws of `QUANTITIES`, data-sheet values drawn along, each of shape (n,)."""

    def interval(self, name: str, level: float = 0.68) -> tuple[float, float]:
        """Central interval of a quantity (or parameter) that holds `level` of its draws."""
        draws = self.draws(name)
        low, high = np.quantile(draws, [(1 - level) / 2, (1 + level) / 2])
        return float(low), float(high)

    def draws(self, name: str) -> Array:
        """Draws of a quantity (data-sheet errors included) or, where there is none of that name, of a parameter."""
        if name in self.quantities:
            return self.quantities[name]
        if name not in self.names:
            known = ", ".join([*self.quantities, *self.names])
            raise ValueError(f"no quantity {name!r} in the posterior: it holds {known}")
        column: Array = self.parameters[:, self.names.index(name)]
        return column

    def summary(self) -> dict[str, dict[str, float]]:
        """Mean, standard deviation, median, 68 % and 95 % intervals of every quantity."""
        table = {}
        for name, draws in self.quantities.items():
            low, lower, median, upper, high = np.quantile(draws, [0.025, 0.16, 0.5, 0.84, 0.975])
            row = {"mean": draws.mean(), "sigma": draws.std(ddof=1), "median": median}
            row |= {"low_68": lower, "high_68": upper, "low_95": low, "high_95": high}
            table[name] = {key: float(value) for key, value in row.items()}
        return table


def laplace_draws(fit: StatisticsFit, sheet: DataSheet, count: int, rng: np.random.Generator) -> Draws:
    """Draws from Laplace's approximation: the normal law of the Fisher matrix about the best fit, and the data sheet.

    Parameters
    ----------
    fit : StatisticsFit
        Its systematic errors are drawn along.
    sheet : DataSheet
    count : int
    rng : Generator
    """
    names = fit.covariance.names
    root = np.linalg.cholesky(fit.covariance.matrix)
    cameras = fit.camera.vector(names) + rng.normal(size=(count, len(root))) @ root.T
    cameras[:, :3] += rng.normal(size=(count, len(fit.systematic))) @ fit.systematic
    f, q, d, board = sheet.draws(count, rng)
    lengths = derived(cameras, sheet, f, np.stack([q, d, board]))
    return Draws((*names, "f"), np.column_stack([cameras, f]), lengths)
