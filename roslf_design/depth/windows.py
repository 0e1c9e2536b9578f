"""Least squares over windows of microlenses: what they say of disparity together, and how far they are at odds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._jit import THREADS
from .warping import fill_holes, window_sums

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_GRADIENT_NOISE = 1.894
"""Noise power of a quintic spline's slope at its nodes, per pitch^2, for samples of unit noise."""
QUORUM = 0.25
"""Share of a window's microlenses that must say something of its disparity."""


@dataclass(frozen=True, eq=False)
class SharedLight:
    """Sums over views at each microlens along a disparity, and the picture that they show."""

    sums: Array
    """Shape (`SUMS`, v, u), as `warping.common` makes them."""
    picture: Array
    disparity: Array
    """Disparity that views were warped back by [pitches]."""
    steps: tuple[float, float]
    """Pitches between samples along u and v."""
    density: float
    """Microlenses a sample."""

    @cached_property
    def gradient(self) -> tuple[Array, Array, Flags]:
        """Slopes of the picture, and where they are known; see `gradient`."""
        return gradient(self.picture, self.sums[11] > 0, self.steps)

    @cached_property
    def moments(self) -> tuple[Array, Array]:
        """Chi-square about another disparity B' is residual + 2 moment (B' - B) + raw (B' - B)^2: raw and moment."""
        sums, (slope_u, slope_v, _) = self.sums, self.gradient
        raw = slope_u**2 * sums[4] + 2 * slope_u * slope_v * sums[5] + slope_v**2 * sums[6]
        return raw, slope_u * sums[7] + slope_v * sums[8]

    def own(self, change: Array) -> Array:
        """Chi-square per sample of each microlens's own views, about a disparity that is so much larger."""
        raw, moment = self.moments
        own = self.sums[9] + np.where(self.gradient[2], (2 * moment + raw * change) * change, 0)
        return np.asarray(own / np.maximum(self.sums[10], 0.5))


@dataclass(frozen=True, eq=False)
class WindowFit:
    """Disparity of each microlens as its window has it."""

    disparity: Array
    sigma: Array
    chi2: Array
    """Chi-square of all samples of the window, per degree of freedom."""
    free: Array
    """Degrees of freedom of `chi2`."""
    strain: Array
    """Chi-square of the disparities that the microlenses ask for each, about a plane, per degree of freedom."""
    spare: Array
    """Degrees of freedom of `strain`."""
    across: Array
    """Slope along u [pitches of disparity per sample]."""
    down: Array
    uu: Array
    """Covariance of the slopes."""
    uv: Array
    vv: Array

    @classmethod
    def of(cls, look: SharedLight, window: int, alone: bool = False) -> WindowFit:
        """Least squares over windows of what each microlens says of the disparity about which it was linearised.

        `alone`: of the window about each microlens, whatever is known beside it.
        """
        sums, disparity, steps, density = look.sums, look.disparity, look.steps, look.density
        known, scatter, (raw, moment) = look.gradient[2], sums[4:7], look.moments
        # The picture's own noise lends it gradient that the views do not share.
        lent = (scatter[0] / steps[0] ** 2 + scatter[2] / steps[1] ** 2) * _GRADIENT_NOISE
        lent /= np.maximum(sums[1], 1e-30)
        used = known & (sums[11] > 1)
        raw, moment = np.where(used, raw, 0), np.where(used, moment, 0)
        true = np.where(used, raw - lent, 0)
        residual, freedom = np.where(used, sums[9], 0), np.where(used, sums[10], 0)
        pulled = true * disparity - moment
        information, sharp, pull, spread, free, push = (
            box(a, window) for a in (raw, true, pulled, residual, freedom, moment)
        )
        first, second, crossed = (box(a, window) for a in (raw * disparity, raw * disparity**2, moment * disparity))
        enough = (sharp > np.maximum(0.05 * information, 1e-9)) & (box(used, window) > QUORUM * window**2)
        share = np.where(enough, sharp, 1)
        value = np.where(enough, pull / share, disparity)
        square = spread + 2 * (value * push - crossed) + value**2 * information - 2 * value * first + second
        chi2 = np.where(free > 1.5, np.maximum(square, 0) / np.maximum(free - 1, 0.5), 0)
        variance = np.where(enough, information, np.inf) / density / share**2
        near = _Plane.of(true, pulled, raw, moment, disparity, window)
        plane = near
        if not alone:
            wide = _Plane.of(true, pulled, raw, moment, disparity, 3 * window)
            trusted = wide.sound & (wide.strain < 2)
            plane = _Plane(
                *(np.where(trusted, a, b) for a, b in zip(vars(wide).values(), vars(near).values(), strict=True))
            )
        rows, columns = _places(value.shape)
        across = np.where(enough & plane.sound, box(true * columns, window) / share - columns, 0)
        down = np.where(enough & plane.sound, box(true * rows, window) / share - rows, 0)
        value = value - np.clip(plane.across * across + plane.down * down, -0.5, 0.5)
        variance = variance + plane.variance(across, down) / density
        strain = np.where(near.sound, near.strain, 0)
        slopes = (np.where(plane.sound, a, 0) for a in (plane.across, plane.down, plane.uu, plane.uv, plane.vv))
        fit = cls(value, np.sqrt(variance), chi2, free - 1, strain, near.spare, *slopes)
        return fit if alone else fit._beside(window // 2)

    def misfit(self, least: float = 0.0) -> Array:
        """Larger of `chi2` and `strain` against what chance, or `least`, allows: above 1 is at odds."""
        chi2 = self.chi2 / np.maximum(chance(self.free), least)
        return np.maximum(chi2, self.strain / np.maximum(chance(self.spare), least))

    def widened(self, alike: float | None) -> Array:
        """Factor by which errors are larger than `sigma`: where noise is as told (None), for what is surely at odds.

        Else noise is what each window shows, alike in neighbours: its variance of disparities over that of samples
        whose noise is each its own.
        """
        sure = np.where(self.strain > 1 + 3 * np.sqrt(2 / np.maximum(self.spare, 1)), self.strain, 1)
        if alike is None:
            own = np.where(self.chi2 > 1 + 3 * np.sqrt(2 / np.maximum(self.free, 1)), self.chi2, 1)
            return np.asarray(np.sqrt(np.maximum(own, sure)))
        return np.sqrt(np.maximum(np.maximum(alike * self.chi2, np.where(self.spare > 3, self.strain, 0)), 1e-12))

    def _beside(self, reach: int) -> WindowFit:
        """Where a window is at odds with itself or knows too little, the best beside it that holds the microlens."""
        # At the edge of what is lit, the windows about a microlens lie half in the dark.
        misfit = np.where(np.isfinite(self.sigma), self.misfit(), np.inf)
        at = np.argwhere(misfit > 1)
        if not len(at):
            return self
        rows, columns = misfit.shape
        places = at[:, None, :] + np.array([(b, a) for b in (-reach, 0, reach) for a in (-reach, 0, reach)])
        inside = ((places >= 0) & (places < (rows, columns))).all(axis=2)
        v, u = np.clip(places[..., 0], 0, rows - 1), np.clip(places[..., 1], 0, columns - 1)
        inside &= (self.spare[v, u] > 3) & (self.sigma[v, u] < 2 * self.sigma[at[:, 0], at[:, 1], None])
        each = np.where(inside, misfit[v, u], np.inf)
        best, pick = each.argmin(axis=1), np.arange(len(at))
        better = np.isfinite(each[pick, best]) & (each[pick, best] < 0.8 * misfit[at[:, 0], at[:, 1]])
        to, source = tuple(at[better].T), (v[pick, best][better], u[pick, best][better])
        fields = []
        for values in vars(self).values():
            moved = values.copy()
            moved[to] = values[source]
            fields.append(moved)
        fit = WindowFit(*fields)
        over, under = to[1] - source[1], to[0] - source[0]
        fit.disparity[to] += np.clip(fit.across[to] * over + fit.down[to] * under, -0.5, 0.5)
        carried = fit.uu[to] * over**2 + 2 * fit.uv[to] * over * under + fit.vv[to] * under**2
        fit.sigma[to] = np.sqrt(fit.sigma[to] ** 2 + np.maximum(carried, 0))
        return fit


def chance(freedom: Array) -> Array:
    """Chi-square per degree of freedom that chance exceeds once in 3000 at most (Laurent and Massart 2000, lemma 1)."""
    over = 8.0 / np.maximum(freedom, 0.5)
    return np.asarray(1 + 2 * np.sqrt(over) + 2 * over)


def box(values: NDArray[Any], window: int) -> NDArray[Any]:
    """Sum over the window about each microlens, as far as it lies in the picture; single precision stays such.

    Pictures lie along the last two axes.
    """
    kept = values if values.dtype == np.float32 else np.asarray(values, float)
    out = np.empty_like(kept)
    window_sums.compiled(kept.reshape(-1, *kept.shape[-2:]), window, out.reshape(-1, *kept.shape[-2:]))
    return out


def _places(shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Rows and columns of a picture, shapes (v, 1) and (1, u)."""
    return np.arange(float(shape[0]))[:, None], np.arange(float(shape[1]))


def gradient(picture: Array, lit: Flags, steps: tuple[float, float]) -> tuple[Array, Array, Flags]:
    """Slopes of a picture's quintic spline [per pitch] along u and v, and where two neighbours on each side are lit."""
    from scipy import ndimage

    filled = picture.astype(np.float32)[None]
    with THREADS:
        fill_holes.compiled(filled, lit.astype(np.float32)[None])
    slopes = []
    for axis, step in ((1, steps[0]), (0, steps[1])):
        spline = ndimage.spline_filter1d(filled[0].astype(float), 5, axis=axis, mode="mirror")
        reach = [(2, 2) if k == axis else (0, 0) for k in (0, 1)]
        padded, size = np.pad(spline, reach, mode="reflect"), spline.shape[axis]
        a, b, c, d = (np.take(padded, np.arange(k, k + size), axis) for k in (0, 1, 3, 4))
        slopes.append((d - a + 10 * (c - b)) / (24 * step))
    cross = np.zeros((5, 5), bool)
    cross[2], cross[:, 2] = True, True
    return slopes[0], slopes[1], ndimage.binary_erosion(lit, cross, border_value=1)


@dataclass(frozen=True, eq=False)
class _Plane:
    """Planes of disparity fitted to windows about each microlens."""

    across: Array
    """Slope along u [pitches of disparity per sample]."""
    down: Array
    uu: Array
    """Covariance of the slopes."""
    uv: Array
    vv: Array
    strain: Array
    """Chi-square of single microlenses about the plane, per degree of freedom."""
    spare: Array
    sound: Flags
    """True where the window determines a plane."""

    @classmethod
    def of(cls, true: Array, pulled: Array, raw: Array, moment: Array, disparity: Array, window: int) -> _Plane:
        rows, columns = _places(true.shape)
        s, su, sv = box(true, window), box(true * columns, window), box(true * rows, window)
        suu, suv, svv = (box(true * a, window) for a in (columns * columns, columns * rows, rows * rows))
        b, bu, bv = box(pulled, window), box(pulled * columns, window), box(pulled * rows, window)
        lit = s > 1e-9
        s = np.where(lit, s, 1)
        cuu, cuv, cvv = suu - su * su / s, suv - su * sv / s, svv - sv * sv / s
        cub, cvb = bu - su * b / s, bv - sv * b / s
        whole = cuu * cvv - cuv**2
        spare = box(raw > 0, window) - 3
        sound = lit & (whole > 1e-6 * (cuu + cvv) ** 2) & (cuu > 0) & (cvv > 0) & (spare > 0.5)
        whole = np.where(sound, whole, 1)
        across, down = (cub * cvv - cvb * cuv) / whole, (cvb * cuu - cub * cuv) / whole
        own = np.where(raw > 0, disparity - moment / np.where(raw > 0, raw, 1), 0)
        # About the mean first: what is left is small against the squares.
        square = box(raw * own * own, window) - 2 * b / s * box(raw * own, window) + (b / s) ** 2 * box(raw, window)
        square = np.maximum(square - across * cub - down * cvb, 0)
        return cls(
            across,
            down,
            cvv / whole,
            -cuv / whole,
            cuu / whole,
            square / np.maximum(spare, 1),
            np.maximum(spare, 0),
            sound,
        )

    def variance(self, across: Array, down: Array) -> Array:
        """Variance of the slopes' error carried over a distance [samples]."""
        return np.maximum(self.uu * across**2 + 2 * self.uv * across * down + self.vv * down**2, 0)
