"""Disparity where none was measured, filled in from the known ones nearby, with the error that such a fill has."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

if TYPE_CHECKING:
    from scipy import sparse

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEP = 0.02
"""Difference over the picture's middle brightness across which neighbours hold together half as well."""
HELD_OUT = 5
"""Known places so near to unknown ones are held out to see how well a fill finds them: edges are as near to them, and
what is known about as far away."""
FEWEST = 30
"""Places held out that errors are judged by, at least."""
WITHIN = 0.68
"""Share of errors within a standard error."""
HARDER = 1.14
"""Errors of a fill over those of places held out whose known ones differ as much: what is unknown is harder than what
is known beside it. By eight rendered light fields whose disparities are known, judged on eleven others."""
FARTHEST = 16
"""Distance to the nearest known place beyond which nothing is filled in [places]."""


class DenseMap(NamedTuple):
    """Disparities everywhere, those known as they are."""

    disparity: Array
    """[pitches], shape (v, u); NaN where nothing known is near."""
    sigma: Array
    """Standard error; of those filled in as places held out have it."""
    held_out: float
    """Rms error of the fill at places that were held out; NaN where there are too few."""
    within: float
    """Share of these within the errors reported."""

    @classmethod
    def of(cls, disparity: Array, sigma: Array, known: Flags, picture: Array) -> DenseMap:
        """Fill between known ones: each place the mean of its neighbours, those of like brightness the more.

        The value is the mean of the known ones that a random walk from the place meets first. Were these of two
        surfaces, the likelier would lie so far from the mean as their variance and skewness tell; the error follows
        from that by the law (a factor, and what errors have beside) with which 68 of 100 places held out lie within.

        Parameters
        ----------
        disparity, sigma, picture : ndarray
            Disparities, their standard errors and the all-in-focus picture, shape (v, u).
        known : ndarray of bool
            Where there is a disparity.
        """
        if known.all():
            return cls(disparity, sigma, np.nan, np.nan)
        joined = _joined(picture)
        held = known & ndimage.binary_dilation(~known, iterations=HELD_OUT)
        kept, rms, within, factor, beside = known & ~held, np.nan, np.nan, 1.0, 0.0
        if min(kept.sum(), held.sum()) >= FEWEST:
            value, apart = _walked(disparity, sigma, kept, joined)
            held &= np.isfinite(value)
            error, apart = np.abs(value - disparity)[held], apart[held]
            factor, beside = _law(apart, error)
            rms = float(np.sqrt((error**2).mean()))
            within = float((error < HARDER * np.hypot(factor * apart, beside)).mean())
        value, apart = _walked(disparity, sigma, known, joined)
        away, nearest = ndimage.distance_transform_edt(~known, return_indices=True)
        value = np.where(away <= FARTHEST, value, np.nan)
        least = sigma[tuple(nearest)]
        reported = np.maximum(HARDER * np.hypot(factor * apart, beside), least)
        widened = np.where(np.isfinite(value), reported, np.inf)
        return cls(np.where(known, disparity, value), np.where(known, sigma, widened), rms, within)


def _law(apart: Array, error: Array) -> tuple[float, float]:
    """Factor of how far known ones are apart, and what errors have beside, that `WITHIN` of those held out lie within.

    The factor is by the half of them whose known ones are farther apart, the rest by the other half.
    """
    far = apart >= np.median(apart)
    factor = float(np.quantile(error[far] / apart[far], WITHIN))
    left = np.maximum(error[~far] ** 2 - (factor * apart[~far]) ** 2, 0.0)
    return factor, float(np.sqrt(np.quantile(left, WITHIN))) if left.size else 0.0


def _joined(picture: Array) -> sparse.csr_matrix:
    """How well neighbours hold together, shape (places, places): 1 of like brightness, less across edges."""
    from scipy import sparse  # an eighth of a second with its solver, for maps with gaps only

    index = np.arange(picture.size).reshape(picture.shape)
    lit = np.abs(picture[picture != 0])  # more than half of a picture may be dark
    step = STEP * float(np.median(lit)) if lit.size else 1.0
    first, second, weight = [], [], []
    for a, b in (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]):
        first.append(index[a].ravel())
        second.append(index[b].ravel())
        weight.append((1 / (1 + ((picture[a] - picture[b]) / step) ** 2)).ravel())
    one, other = (np.concatenate(each).astype(np.intp) for each in (first, second))
    weights = np.concatenate(weight)
    half: sparse.csr_matrix = sparse.csr_matrix(
        (np.asarray(weights, np.float64), (one, other)), (picture.size, picture.size)
    )
    both: sparse.csr_matrix = (half + half.T).tocsr()
    return both


def _walked(disparity: Array, sigma: Array, known: Flags, joined: sparse.csr_matrix) -> tuple[Array, Array]:
    """Means of the known ones that walks meet first, and how far the likelier of two such would lie; NaN where none is.

    Of two values met with probabilities p and 1 - p, d apart, the variance V is p (1 - p) d^2, the third moment M
    p (1 - p) (1 - 2 p) d^3, and the likelier lies min(p, 1 - p) d = ((M^2 + 4 V^3)^(1/2) - |M|) / (2 V) off their mean.
    """
    from scipy import sparse
    from scipy.sparse.linalg import splu

    unknown, some = np.flatnonzero(~known), np.flatnonzero(known)
    means, apart = np.where(known, disparity, np.nan).ravel(), np.where(known, sigma, np.nan).ravel()
    if unknown.size and some.size:
        rows = joined[unknown]
        middle = float(np.median(disparity[known]))
        value, error = disparity.ravel()[some] - middle, sigma.ravel()[some]
        ends = rows[:, some] @ np.stack([value, value**2 + error**2, value**3 + 3 * value * error**2], 1)
        total = sparse.diags(np.asarray(rows.sum(1)).ravel())
        mean, square, cube = splu((total - rows[:, unknown]).tocsc()).solve(ends).T
        variance = np.maximum(square - mean**2, np.finfo(float).tiny ** (1 / 3))
        third = np.abs(cube - 3 * mean * square + 2 * mean**3)
        means[unknown], apart[unknown] = mean + middle, (np.sqrt(third**2 + 4 * variance**3) - third) / (2 * variance)
    return means.reshape(known.shape), apart.reshape(known.shape)
