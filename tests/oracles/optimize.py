"""References for optimising, of another kind: closed forms at 60 digits, and brute force on a grid refined locally."""

from __future__ import annotations

import itertools

import mpmath as mp
import numpy as np

mp.mp.dps = 60


def matched_sensor_distance(design):
    """d_2 of Eq. 7 as the paper prints it, solved by mpmath for an image fill of 1."""
    f, d_f, D_F, d_3, d = (mp.mpf(x) for x in (design.f, design.d_f, design.D_F, design.d_3, design.d))
    d_1 = f * d_f / (d_f - f)

    def equation(d_2):
        return (d_1 * D_F + d_3 * d) / ((d_f - d_3) * d * d_1) - (d_1 + d_2) / (d_2 * d_f)

    return mp.findroot(equation, mp.mpf(design.d_2))


def eq7_residual(design):
    """Left over right side of Eq. 7 as printed, less 1, at 60 digits."""
    f, d_f, D_F, d_3, d, d_2 = (
        mp.mpf(float(x)) for x in (design.f, design.d_f, design.D_F, design.d_3, design.d, design.d_2)
    )
    d_1 = f * d_f / (d_f - f)
    return ((d_1 * D_F + d_3 * d) / ((d_f - d_3) * d * d_1)) / ((d_1 + d_2) / (d_2 * d_f)) - 1


def largest_undistorted_plane(design):
    """The farthest d_f at which Eq. 6 holds at the sensor's corner, for given f, D, D_F, d_2 and d_3, by mpmath."""
    f, D, D_F, d_2, d_3, *sides = (
        mp.mpf(float(x)) for x in (design.f, design.D, design.D_F, design.d_2, design.d_3, *design.sensor_size)
    )

    def room(d_f):
        grow = 1 + d_2 * (f - d_3) * (d_f - f) / (f * f * (d_f - d_3))  # image pitch over pitch
        return ((D - D_F) / d_3 - D / d_f) / 2 - mp.hypot(*sides) / 2 / grow * (d_f - f) / f / d_f

    return mp.findroot(room, (mp.mpf(150), mp.mpf(400)), solver="anderson")


def brute_force(evaluate, n, points, rounds, feasible=1e-9, shrink=0.45):
    """Best feasible point of a full grid over the unit box, then of finer grids about it.

    Parameters
    ----------
    evaluate : callable
        Points (N, n) to (merit (N,), largest violation (N,)).
    """
    low, high = np.zeros(n), np.ones(n)
    best, best_merit = None, np.inf
    for _ in range(rounds):
        axes = [np.linspace(a, b, points) for a, b in zip(low, high, strict=True)]
        grid = np.array(list(itertools.product(*axes)))
        merit, violation = evaluate(grid)
        merit = np.where((violation <= feasible) & np.isfinite(merit), merit, np.inf)
        index = int(np.argmin(merit))
        if merit[index] < best_merit:
            best, best_merit = grid[index], float(merit[index])
        if best is None:
            points += 1
            continue
        half = shrink * (high - low) / 2
        low, high = np.clip(best - half, 0, 1), np.clip(best + half, 0, 1)
    return best, best_merit
