"""Disparity about occlusion: by the quarter of the views that looks past the edge, and by small windows on one side.

At a depth step windows hold two surfaces, and some views see another than the rest. Each is sought once more by the
views of one quarter of the pupil alone, one of which still sees it beside most edges and corners. Of all windows that
hold a microlens and are at one with themselves and with its own views, the one that knows its disparity best is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .windows import SharedLight, WindowFit, chance

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SIZES = (5, 3)
"""Sides of the windows tried where the wanted one is at odds [microlenses]."""
SETTLED = 0.25
"""Change of disparity from the one warped back by up to which a slope tells it well enough near an edge [pitches]."""
AT_ODDS = 5.0
"""Chi-square per degree of freedom above which a window is at odds with itself there: edges alias."""
_PICKED = 1.3
"""Factor by which the least of the errors of many windows is taken as too small: chosen on rendered light fields, not
derived."""
_DEPTH_STEP, BESIDE_STEP = 0.9, 2.0
"""Difference of known disparities within `SIZES[0]` that is a depth step [pitches], and the factor by which errors are
larger there than windows tell: pixels show some of both sides. Chosen on rendered light fields, not derived."""


@dataclass(frozen=True, eq=False)
class _Offered:
    """Disparities by other windows or views, of the microlenses with a finite `sigma`."""

    disparity: Array
    sigma: Array
    chi2: Array
    views: Array
    picture: Array

    @classmethod
    def none(cls, shape: tuple[int, int]) -> _Offered:
        """Nothing to begin with."""
        return cls(np.full(shape, np.nan), np.full(shape, np.inf), *(np.zeros(shape) for _ in range(3)))

    def take(self, look: SharedLight, wanted: Flags, largest_sigma: float, alike: float | None) -> None:
        """Take the windows of a look that know more than those so far."""
        at = np.argwhere(wanted)
        rows, columns = wanted.shape
        own_limit = np.maximum(AT_ODDS, chance(look.sums[10]))
        raw, moment = look.moments
        here = tuple(at.T)
        moment, raw = (np.where(look.gradient[2], part, 0)[here] for part in (moment, raw))
        for window in SIZES:
            fit, reach = WindowFit.of(look, window, alone=True), window // 2
            widened, misfit = fit.widened(alike), fit.misfit(AT_ODDS)
            for under in (-reach, 0, reach):
                for over in (-reach, 0, reach):
                    v, u = at[:, 0] + under, at[:, 1] + over
                    inside = (v >= 0) & (v < rows) & (u >= 0) & (u < columns)
                    there = np.clip(v, 0, rows - 1), np.clip(u, 0, columns - 1)
                    value = fit.disparity[there] - np.clip(
                        fit.across[there] * over + fit.down[there] * under, -0.5, 0.5
                    )
                    carried = fit.uu[there] * over**2 + 2 * fit.uv[there] * over * under + fit.vv[there] * under**2
                    sigma = np.sqrt(fit.sigma[there] ** 2 + np.maximum(carried, 0))
                    change = value - look.disparity[here]
                    own = (look.sums[9][here] + (2 * moment + raw * change) * change) / np.maximum(
                        look.sums[10][here], 0.5
                    )
                    good = inside & (misfit[there] <= 1) & (own <= own_limit[here]) & (sigma <= largest_sigma)
                    good &= (np.abs(change) <= np.maximum(0.5 * sigma, SETTLED)) & (fit.spare[there] > 3)
                    sigma = _PICKED * sigma * widened[there]
                    good &= sigma < self.sigma[here]
                    to, source = tuple(at[good].T), (there[0][good], there[1][good])
                    self.disparity[to], self.sigma[to] = value[good], sigma[good]
                    self.chi2[to] = np.maximum(fit.chi2[source], fit.strain[source])
                    self.views[to], self.picture[to] = look.sums[11][to], look.sums[0][to]


def past_edges(
    first: SharedLight, wanted: Flags, quarters: Iterable[Flags], search: Callable[[Flags], Array],
    look: Callable[[Flags, Array, Array], SharedLight], largest_sigma: float, alike: float | None,
) -> _Offered:  # fmt: skip
    """Disparities of the microlenses `wanted`, where other windows or a quarter of the views have them.

    `first` is of all views; `quarters` are true for the views of each quarter of the pupil, `search` makes disparities
    of some views alone, and `look` looks at them along these, as `_AllViews` does.
    """
    found = _Offered.none(wanted.shape)
    found.take(first, wanted, largest_sigma, alike)
    wanted = wanted & ~np.isfinite(found.sigma)
    near = ndimage.binary_dilation(wanted, iterations=SIZES[0])
    for some in quarters:
        if wanted.any() and some.sum() > 2:
            begun = np.where(near, search(some), np.nan)
            found.take(look(some, begun, first.picture), wanted, largest_sigma, alike)
    return found


def beside_steps(disparity: Array) -> Flags:
    """True where known disparities nearby, those that are numbers, differ by a depth step."""
    known = np.isfinite(disparity)
    most = ndimage.maximum_filter(np.where(known, disparity, -np.inf), SIZES[0])
    least = ndimage.minimum_filter(np.where(known, disparity, np.inf), SIZES[0])
    return np.asarray(most > least + _DEPTH_STEP)
