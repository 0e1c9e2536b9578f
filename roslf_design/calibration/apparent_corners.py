"""Where a fitted corner comes to lie when its view's light comes from all over the pupil and from neighbours."""

from __future__ import annotations

import math

import numpy as np

from .._jit import THREADS, kernel, prange
from .lattice import Array
from .pupil_image import ViewWeights
from .saddle import fit_saddles

_FINE = 8
"""Bins per pitch in which shifted corners are counted."""
_PARTS = 5
"""Places across a microlens's aperture, per axis."""


def apparent_shifts(
    weights: ViewWeights, slopes: Array, edges: tuple[float, float], half: int, circular: bool = False
) -> Array:
    """Displacement of fitted corners against where their views should have them.

    In the view (s', t') a corner of slope k stands at k (s', t'). The light of a neighbour n pitches away that passed
    the pupil at (s'', t'') has it at k (s'', t'') - n instead: the view shows the sum of all, each microlens averaging
    over its aperture, and `fit_saddles` fits that with one corner. What it finds is computed here by running it: the
    mean of the displacements would be twice as large, as a far neighbour's light moves the mean but not the fit.

    Parameters
    ----------
    weights : ViewWeights
    slopes : ndarray
        Du/Ds' of corners [pitches/px], shape (k,).
    edges : (float, float)
        Directions of the corner's two edges in the view [rad].
    half : int
        Of the window that the corner is fitted in [pitches].
    circular : bool
        Shape of the microlenses.

    Returns
    -------
    ndarray
        [pitches], shape (v, k, 2); NaN where no corner could be fitted.
    """
    views, count = len(weights.shares), len(slopes)
    size = 2 * half + 3
    normals = np.array([[-math.sin(a), math.cos(a)] for a in edges])
    # Corners fall anywhere between samples: a different place for each patch.
    turns = np.arange(views * count).reshape(views, count)
    phases = np.stack([(turns * 0.7548776662466927) % 1 - 0.5, (turns * 0.5698402909980532) % 1 - 0.5], axis=-1)
    middle = (np.arange(_PARTS) + 0.5) / _PARTS - 0.5
    aperture = np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)
    if circular:
        turn = np.arange(_PARTS**2) + 0.5
        angle = turn * math.pi * (3 - math.sqrt(5))
        aperture = 0.5 * np.sqrt(turn / _PARTS**2)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    out = np.empty((size, views * count * size))
    ideal = np.einsum("k,vi->vki", slopes, weights.views)
    with THREADS:
        _patches.compiled(
            weights.shares, weights.neighbours, weights.places, np.asarray(slopes, float), ideal, normals, phases,
            aperture, half, _FINE, out,
        )  # fmt: skip
    at = np.stack([np.arange(views * count) * size + half + 1.0, np.full(views * count, half + 1.0)], axis=-1)
    start = at + phases.reshape(-1, 2)
    found = fit_saddles(out, np.ones(out.shape, bool), start, np.tile(edges, (len(start), 1)), half)
    shift = np.where(found.settled[:, None], found.corners - start, np.nan)
    return np.asarray(shift.reshape(views, count, 2))


@kernel(parallel=True)
def _patches(
    shares: Array,
    neighbours: Array,
    places: Array,
    slopes: Array,
    ideal: Array,
    normals: Array,
    phases: Array,
    aperture: Array,
    half: int,
    fine: int,
    out: Array,
) -> None:
    views, count = shares.shape[0], slopes.shape[0]
    size = 2 * half + 3
    reach = math.ceil(1.5 * (half + 3))
    bins = 2 * reach * fine
    for k in prange(views * count):
        v, q = k // count, k % count
        held = np.zeros((bins + 1, bins + 1))
        for m in range(neighbours.shape[0]):
            for n in range(places.shape[0]):
                x = slopes[q] * places[n, 0] - neighbours[m, 0] - ideal[v, q, 0]
                y = slopes[q] * places[n, 1] - neighbours[m, 1] - ideal[v, q, 1]
                # Shared among the four nearest bins, so that the mean stays where it is.
                a = min(max((normals[0, 0] * x + normals[0, 1] * y + reach) * fine - 0.5, 0.0), bins - 1.001)
                b = min(max((normals[1, 0] * x + normals[1, 1] * y + reach) * fine - 0.5, 0.0), bins - 1.001)
                column, row = math.floor(a), math.floor(b)
                fa, fb = a - column, b - row
                held[row + 1, column + 1] += shares[v, m, n] * (1 - fa) * (1 - fb)
                held[row + 1, column + 2] += shares[v, m, n] * fa * (1 - fb)
                held[row + 2, column + 1] += shares[v, m, n] * (1 - fa) * fb
                held[row + 2, column + 2] += shares[v, m, n] * fa * fb
        for row in range(1, bins + 1):
            for column in range(1, bins + 1):
                held[row, column] += held[row, column - 1]
        for row in range(1, bins + 1):
            for column in range(1, bins + 1):
                held[row, column] += held[row - 1, column]
        for row in range(size):
            for column in range(size):
                total = 0.0
                for p in range(aperture.shape[0]):
                    x = column - half - 1 + aperture[p, 0] - phases[v, q, 0]
                    y = row - half - 1 + aperture[p, 1] - phases[v, q, 1]
                    a = (normals[0, 0] * x + normals[0, 1] * y + reach) * fine
                    b = (normals[1, 0] * x + normals[1, 1] * y + reach) * fine
                    i, j = math.floor(a), math.floor(b)
                    fa, fb = a - i, b - j
                    # Light of corners on each side of both edges: sums of the cumulative table.
                    below_a = held[bins, i] * (1 - fa) + held[bins, i + 1] * fa
                    below_b = held[j, bins] * (1 - fb) + held[j + 1, bins] * fb
                    both = (held[j, i] * (1 - fa) + held[j, i + 1] * fa) * (1 - fb)
                    both += (held[j + 1, i] * (1 - fa) + held[j + 1, i + 1] * fa) * fb
                    total += 4.0 * both - 2.0 * below_a - 2.0 * below_b + 1.0
                out[row, k * size + column] = total / aperture.shape[0]
