"""Bends of surfaces: what windows that mean a bent one take off its disparities, and give back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .occlusion import beside_steps
from .windows import WindowFit

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_TURNS = 6.0
"""Standard errors of disparities that differences of second order exceed both ways about a step; by chance they do at
one place in 1400."""


def _second_derivatives(disparity: Array, lag: int) -> tuple[Array, Array]:
    """Second derivatives along u and v by differences over so much `lag`; 0 where a gap lies on either side.

    Where one lies on one side, beside a step say, they are those of the other side. Windows' means tell them alike.
    """
    found = np.full((2, *disparity.shape), np.nan)
    for each, part in ((found[0], disparity), (found[1].T, disparity.T)):
        if part.shape[1] <= 2 * lag:
            continue
        whole = ndimage.minimum_filter1d(np.isfinite(part).view(np.uint8), 2 * lag + 1, axis=1)[:, lag:-lag] > 0
        second = part[:, 2 * lag :] + part[:, : -2 * lag] - 2 * part[:, lag:-lag]
        each[:, lag:-lag] = np.where(whole, second / lag**2, np.nan)
        middle = each.copy()
        for here, beside in ((np.s_[:, :-lag], np.s_[:, lag:]), (np.s_[:, lag:], np.s_[:, :-lag])):
            each[here] = np.where(np.isnan(each[here]), middle[beside], each[here])
    along, down = np.nan_to_num(found)
    return along, down


def window_bends(disparity: Array, window: int, fit: WindowFit) -> Array:
    """Excess of windows of a bent surface at the places that were fitted by them.

    A plane through the mean, (w^2 - 1)/24 of the second derivatives beside the surface, is carried there.
    """
    along, down = (each[fit.middles] for each in _second_derivatives(disparity, window // 2 + 2))
    return np.asarray((window**2 - 1) / 24 * (along + down) - (along * fit.over**2 + down * fit.under**2) / 2)


def straightened(disparity: Array, window: int, error: float, times: int = 1) -> Array:
    """Disparities of a bent surface at the middles of windows that mean it, so many `times`; as they are beside steps.

    Its bend is that of two windows' width, less noisy than each one's own, and near the field's rims and the dark,
    where disparities are not numbers, the nearest. Where the field is large enough, windows that these crop or that
    hold the outermost microlenses take no part: views of these look past the picture, and what they have of neighbours'
    light is not all known. Windows that see both sides of a step, by the standard `error` of disparities, bend nothing.
    """
    lag, most = window // 2 + 2, (min(disparity.shape) - 1) // 2
    if most < lag:
        return disparity
    rim, steps = min(lag + window // 2 + 1, most), beside_steps(disparity) | _turning(disparity, window, error)
    stepped, mixed, dark = (
        ndimage.maximum_filter(part, 2 * reach + 1)
        for part, reach in ((steps, lag), (steps, rim), (~np.isfinite(disparity), rim))
    )
    whole = np.pad(~dark[rim:-rim, rim:-rim], rim)
    if not whole.any():
        return disparity
    bent = np.where(whole & ~mixed, (window**2 - 1) / 24 * np.add(*_second_derivatives(disparity, lag)), 0)
    total, count = (
        ndimage.uniform_filter(part.astype(float), 2 * window + 1, mode="constant") for part in (bent, whole)
    )
    nearest = ndimage.distance_transform_edt(~whole, return_distances=False, return_indices=True)
    bend = (total / np.maximum(count, 1e-12))[tuple(nearest)]
    return disparity - np.where(stepped, 0, times * bend)


def _turning(disparity: Array, window: int, error: float) -> Flags:
    """True where a surface bends one way before and the other way beyond, as windows have it about any step.

    Bends of a step that is lost in the standard error of disparities move these by a small part of one.
    """
    lag, half, turns = window // 2 + 2, window // 2, np.zeros(disparity.shape, np.bool_)
    for part, there in ((disparity, turns), (disparity.T, turns.T)):
        second = part[2 * lag :] + part[: -2 * lag] - 2 * part[lag:-lag]
        before, beyond = second[: -2 * half], second[2 * half :]
        opposed = np.maximum(np.minimum(before, -beyond), np.minimum(-before, beyond))
        there[lag + half : lag + half + len(opposed)] |= opposed > _TURNS * error
    return turns
