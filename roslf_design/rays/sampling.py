"""Even samples of a pupil and of a microlens: deterministic, or shifted at random for independent repeats."""

from __future__ import annotations

import numpy as np

from .frames import Floats

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
"""Turn between successive points of the sunflower [rad]."""


def sunflower(count: int) -> Floats:
    """Points that fill the unit disc evenly (Vogel's spiral).

    Parameters
    ----------
    count : int
        N.

    Returns
    -------
    ndarray, shape (2, N)
        The k-th at radius sqrt((k + 1/2)/N): equal areas, strictly inside.
    """
    k = np.arange(count)
    radius, angle = np.sqrt((k + 0.5) / count), k * GOLDEN_ANGLE
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])


def recurrence(count: int, dimensions: int, shift: Floats | float = 0.5) -> Floats:
    """Points of the additive recurrence whose steps are powers of the generalised golden ratio.

    Parameters
    ----------
    count, dimensions : int
        N and D.
    shift : float or ndarray, shape (D,), optional
        Start of each coordinate; random shifts give independent sets of the same evenness.

    Returns
    -------
    ndarray, shape (D, N)
        In [0, 1).

    Notes
    -----
    The ratio g solves g^(D+1) = g + 1; coordinate i steps by g^-i modulo 1.
    """
    g = 2.0
    for _ in range(64):
        g = (1.0 + g) ** (1.0 / (dimensions + 1))
    steps = g ** -np.arange(1.0, dimensions + 1)
    starts = np.broadcast_to(np.asarray(shift, float), (dimensions,))
    return np.asarray((starts[:, None] + steps[:, None] * np.arange(1, count + 1)) % 1.0)


def disc(square: Floats) -> Floats:
    """Points of the unit square as points of the unit disc, areas kept; shape (2, N) both."""
    radius, angle = np.sqrt(square[0]), 2.0 * np.pi * square[1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])


def pupil_samples(count: int, *, microlens: str | None = None, seed: int | None = None) -> Floats:
    """Samples of the pupil, each with the point of the microlens it goes to.

    Parameters
    ----------
    count : int
        N.
    microlens : {None, "square", "circular"}
        Shape of the microlens's clear aperture to fill; None for a pinhole.
    seed : int, optional
        Shifts the samples at random, the same for the same seed; None for the fixed set.

    Returns
    -------
    ndarray, shape (4, N)
        Pupil x, y in pupil radii; microlens x, y in half widths.
    """
    dimensions = 2 if microlens is None else 4
    if seed is None and microlens is None:
        return np.concatenate([sunflower(count), np.zeros((2, count))])
    shift = 0.5 if seed is None else np.random.default_rng(seed).random(dimensions)
    points = recurrence(count, dimensions, shift)
    if microlens is None:
        return np.concatenate([disc(points), np.zeros((2, count))])
    return np.concatenate([disc(points[:2]), disc(points[2:]) if microlens == "circular" else 2.0 * points[2:] - 1.0])
