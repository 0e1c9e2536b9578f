"""How sure the lengths of a calibrated camera are, and what its measurements alone tell of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..design import PATHS
from ..theory.length_covariance import CalibratedLengths, LengthCovariance
from .fit import StatisticsFit
from .frames import Array
from .model import DataSheet, derived
from .posterior import CameraDraws
from .sidedata import NUDGE, SideDatum, combine

KEPT = ("d_3", "d_1", "d_2", "d", "q")
"""Lengths of a design that a calibration tells, before f."""


def calibrated_lengths(
    draws: CameraDraws, fit: StatisticsFit, sheet: DataSheet, data: Sequence[SideDatum] = (), *, planned: bool = False
) -> CalibratedLengths:
    """A design's calibrated lengths, elements before the lens included: their covariance, and what stands behind it.

    Parameters
    ----------
    draws : CameraDraws
        Of the camera, data sheet included.
    fit : StatisticsFit
        Whose corners tell A/d, m/d and q A/d_2 of a board of a given scale: carried to lengths by their Jacobian.
    sheet : DataSheet
    data : sequence of SideDatum
        Measurements beside the corners.
    planned : bool
        Whether the calibration is yet to be made.
    """
    drawn = _lengths(draws.quantities, draws.draws("f"), sheet)
    covariance = LengthCovariance(tuple(drawn), np.atleast_2d(np.cov(np.stack([*drawn.values()]))))
    told = {PATHS["f"]: sheet.f_sigma, PATHS["d"]: sheet.d_sigma, PATHS["q"]: sheet.q_sigma or np.inf}
    told |= {known.place: known.sigma for known in sheet.uncertain}
    known = np.array([told.get(place, np.inf) for place in drawn])
    return CalibratedLengths(covariance, _information(fit, sheet, data), known, planned)


def _lengths(quantities: Mapping[str, Array], f: Array, sheet: DataSheet) -> dict[str, Array]:
    """Lengths with a ruler, by their places in a design."""
    lengths = dict(quantities)
    if (space := sheet.space_at(lengths)) is not None:
        lengths |= space.ruler(lengths)
    own = {PATHS[name]: lengths[name] for name in KEPT} | {PATHS["f"]: f}
    return own | {known.place: lengths[known.place] for known in sheet.uncertain}


def _information(fit: StatisticsFit, sheet: DataSheet, data: Sequence[SideDatum]) -> Array:
    """F of corners and side data alone, without the data sheet's f, q, d and elements [1/mm^2].

    All else that corners depend on (axis, distortion, the board's scale, which its maker knows) is eliminated.
    """
    known, count = combine(fit, sheet, data), len(fit.covariance.names)
    size, board = len(known.best), count + 3
    step = NUDGE * np.maximum(np.abs(known.best), 1e-3)
    nudged = np.concatenate([known.best + np.diag(step), known.best - np.diag(step)])
    lengths = _lengths(derived(nudged[:, :count], sheet, nudged[:, count:].T), nudged[:, count], sheet)
    values = np.stack([*lengths.values()])
    by_state = (values[:, :size] - values[:, size:]) / 2  # for a step of each
    # The same states told in lengths, with what they leave open.
    others = [*range(3, count), board]
    told = np.concatenate([by_state, np.diag(step)[others]])
    unit = np.abs(told).max(axis=1)
    back = np.linalg.inv(told / unit[:, None])  # states, in steps, of lengths in `unit`

    spread = fit.covariance.matrix.copy()
    spread[:3, :3] += fit.systematic.T @ fit.systematic
    scale = np.sqrt(np.diag(spread))
    jacobian = known.jacobian * step
    information = jacobian.T @ jacobian
    images = np.linalg.inv(spread / np.outer(scale, scale)) * np.outer(step[:count] / scale, step[:count] / scale)
    information[:count, :count] += images
    if sheet.cell_sigma > 0:
        information[board, board] += (step[board] / sheet.cell_sigma) ** 2
    else:
        others.pop()
    whole = back.T @ information @ back
    ours, theirs = slice(len(values)), slice(len(values), len(values) + len(others))
    alone = whole[ours, ours] - whole[ours, theirs] @ np.linalg.solve(whole[theirs, theirs], whole[theirs, ours])
    return np.asarray((alone + alone.T) / 2 / np.outer(unit[ours], unit[ours]))
