"""Disparity of every microlens of a light field, with the standard error that its light and texture allow."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from ..calibration.decoding import LightField
from ..theory.photometry import surely_held
from .bends import window_bends
from .occlusion import BESIDE_STEP, SETTLED, SIZES, FewViews, Limits, Quarter, beside_steps, past_edges
from .sides import Parted, parted
from .warping import (
    SUMS,
    add_pulls,
    best_and_next,
    common,
    fill_holes,
    gather_zones,
    light_of_cells,
    spline_coefficients,
    spread_of_zones,
)  # fmt: skip
from .windows import QUORUM, SharedLight, WindowFit, box, chance, noise_by_texture, roughness

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Pictures = NDArray[np.float32]

_ROBUST = 4.0
"""Standard errors from the mean of all views beyond which a sample's weight falls: 1 in 16,000 by chance."""
_MANY = 60
"""Views of which the first corrections may leave out every other one."""
CLIPPED = 0.05
"""Share of the microlenses about a window near saturation from which that is why it has no disparity."""
CLIPPED_VIEWS = 0.5
"""Share of a microlens's own views that are saturated from which it has no disparity, whatever those about it tell."""
SOME_VIEWS = 5
"""Views along each axis, about, whose pull on windows' disparities tells their variance."""
ROUGH = 2
"""Corrections that tell noise well enough: after one, what is left of movement still counts as noise."""
MANY_PIXELS = 192
"""Pixels of views along each side from which they are searched by half as many first."""
_SETTLED = 0.1
"""Change of disparity from the one warped back by that a slope can tell [pitches]."""
_BRIGHT = 0.5
"""Light, over the most, from which a microlens without views is not dark: all of them had their neighbours'."""
_SAME = 0.05
"""Change of disparity up to which another look shows nothing new [pitches]: slopes are right to the square of half."""
_APART = 0.25, 0.4
"""Microlenses that the outermost views move by from one candidate to the next; and of means of four, less sharp."""
_CLEAR = 0.5
"""Chi-square of the best candidate, over that of all, below which it is clearly the best."""
ALIKE = 9.0
"""Chi-square between two disparities below which neither is the better: three standard errors."""
LARGEST_SIGMA, LARGEST_CHI2 = 0.3, 3.0
"""Standard error [pitches] and chi-square above which there is no disparity."""


class DisparityStatus(IntEnum):
    """Reason why a microlens has a disparity, or none."""

    MEASURED = 0
    NO_TEXTURE = 1
    NO_LIGHT = 2
    SATURATED = 3
    INCONSISTENT = 4
    OUT_OF_RANGE = 5
    TOO_FEW_VIEWS = 6
    AMBIGUOUS = 7
    MIXED = 8
    FOLDED = 9
    UNSHARP = 10

    @property
    def reason(self) -> str:
        """Reason in words."""
        return _REASONS[self]


_REASONS = {
    DisparityStatus.MEASURED: "measured",
    DisparityStatus.NO_TEXTURE: "too little texture for its light",
    DisparityStatus.NO_LIGHT: "no light, or none about it",
    DisparityStatus.SATURATED: "saturated",
    DisparityStatus.INCONSISTENT: "views disagree: occlusion, a depth step or a reflection",
    DisparityStatus.OUT_OF_RANGE: "beyond the disparities searched",
    DisparityStatus.TOO_FEW_VIEWS: "too few views",
    DisparityStatus.AMBIGUOUS: "texture repeats: two disparities fit alike",
    DisparityStatus.MIXED: "microlens images overlap: no pixel shows mostly its own microlens",
    DisparityStatus.FOLDED: "rays fold or are lost about it: nothing tells where its views look",
    DisparityStatus.UNSHARP: "the lens is not sharp there: views look aside by more than a window",
}


@dataclass(frozen=True)
class PixelNoise:
    """Noise of one pixel: a value R under relative white light w has variance (N w R + r^2)/(N w)^2.

    Less than one electron of noise is not believed.
    """

    electrons: float
    """N: electrons of a pixel that shows white (R = 1) in full light (w = 1)."""
    read_noise: float = 0.0
    """r [electrons]"""
    saturation: float = math.inf
    """Electrons at which a pixel saturates."""
    measured: bool = False
    """True of noise that only views tell: errors are then for what each window's views show."""

    def __post_init__(self) -> None:
        if not (self.electrons > 0 and math.isfinite(self.electrons)):
            raise ValueError(f"electrons is {self.electrons}; give the electrons of a fully lit white pixel, above 0")
        if not (self.read_noise >= 0 and math.isfinite(self.read_noise)):
            raise ValueError(f"read_noise is {self.read_noise}; it must not be negative")
        if not self.saturation > 0:
            raise ValueError(f"saturation is {self.saturation}; give electrons above 0, or leave it out")
        for name in ("electrons", "read_noise", "saturation"):  # kernels are compiled once more for whole numbers
            object.__setattr__(self, name, float(getattr(self, name)))

    def times(self, factor: float) -> PixelNoise:
        """Noise of pixels whose standard deviation is so many times as large."""
        return replace(self.dimmed(factor**-2), read_noise=self.read_noise / factor)

    def dimmed(self, share: float) -> PixelNoise:
        """Noise of pixels that give this share of the signal."""
        return replace(self, electrons=share * self.electrons, saturation=share * self.saturation)

    def on_veil(self, electrons: float) -> PixelNoise:
        """Noise of pixels that had so many more electrons, which were taken off: their shot noise stays."""
        dark = math.hypot(self.read_noise, math.sqrt(electrons))
        return replace(self, read_noise=dark, saturation=max(self.saturation - electrons, 1e-9))

    @property
    def brightest(self) -> float:
        """Electrons from which a sample may be saturated by chance."""
        return math.inf if self.saturation == math.inf else surely_held(self.saturation, self.read_noise**2)


@dataclass(frozen=True, eq=False)
class DisparityMap:
    """Disparity of every microlens, or why there is none. Arrays have the shape (v, u) of the light field's views."""

    disparity: Array
    """B [microlens pitches between the pupil's rims], of what the pupil's centre sees there: the view from pupil
    coordinate s sees it at u + B s. NaN wherever `status` is not ``MEASURED``."""
    sigma: Array
    """Standard error of `disparity` from the Fisher information of the samples used, widened by sqrt(`chi2`) where that
    is surely above 1. Infinite where `status` is not ``MEASURED``."""
    status: NDArray[np.int8]
    """`DisparityStatus` of each microlens."""
    chi2: Array
    """Chi-square per degree of freedom, of the window's samples about their picture or of its microlenses' disparities
    about a plane, the larger; 0 where nothing was compared. Interpolated samples, as decoding makes them, have less
    noise than pixels and bring the former below 1."""
    views: NDArray[np.int16]
    """Views that see what the microlens sees, and that were used."""
    picture: Array
    """All-in-focus picture: mean of the views along their disparity; 0 where no light came."""
    window: int
    """Side of the matching window [microlenses]."""
    search: tuple[float, float]
    """Disparities searched [pitches]."""
    outside: tuple[float, float]
    """Shares of the microlenses with light whose disparities lie below and above those searched."""
    begun: Start | None = None
    """Where it started from."""
    alike: float = 1.0
    """Variance of windows' disparities over that of samples whose noise is each its own, where views tell it."""

    @property
    def measured(self) -> Flags:
        """True where there is a disparity, shape (v, u)."""
        return np.asarray(self.status == DisparityStatus.MEASURED)

    @property
    def error(self) -> float:
        """Standard error of half of those measured; infinite where none is."""
        known = self.sigma[self.measured]
        return float(np.median(known)) if known.size else math.inf

    def within(self, rows: slice, columns: slice) -> DisparityMap:
        """A part of it."""
        part = rows, columns
        return DisparityMap(
            self.disparity[part], self.sigma[part], self.status[part], self.chi2[part], self.views[part],
            self.picture[part], self.window, self.search, self.outside,
        )  # fmt: skip

    def shares(self) -> dict[DisparityStatus, float]:
        """Share of the microlenses by status, those that occur."""
        return {kind: share for kind in DisparityStatus if (share := float(np.mean(self.status == kind))) > 0}

    def __repr__(self) -> str:
        rows, columns = self.status.shape
        return f"DisparityMap({columns} x {rows} microlenses, {100 * self.measured.mean():.0f} % measured)"


@dataclass(frozen=True, eq=False)
class EpipolarPlane:
    """One row of microlenses through the views of one row of the pupil, and the slope fitted to it."""

    values: Pictures
    """Shape (s, u)."""
    lit: Flags
    """True where something was measured, shape (s, u)."""
    pupil: Array
    """Pupil coordinate of each sample along the row [pupil diameters], shape (s, u)."""
    u: Array
    """[microlens pitches]"""
    disparity: Array
    """Disparity of each microlens of the row; NaN where none was measured."""
    aside: Array | None = None
    """How far views see to the side along the row [pitches], shape (s, u)."""

    def line(self, index: int) -> tuple[Array, Array]:
        """Points (u, pupil coordinate) of what microlens `index` sees, from rim to rim of its views."""
        if self.aside is not None:
            known = np.isfinite(self.pupil[:, index])
            at = self.pupil[known, index]
            return self.u[index] + self.disparity[index] * at + self.aside[known, index], at
        rims = np.array([np.nanmin(self.pupil[:, index]), np.nanmax(self.pupil[:, index])])
        return self.u[index] + self.disparity[index] * rims, rims


def epipolar_plane(
    field: LightField, pupil: ArrayLike, disparity: DisparityMap, row: int, aside: ArrayLike | None = None
) -> EpipolarPlane:
    """Epipolar-plane image of a row of microlenses, through the pupil's middle, with its fitted disparities."""
    middle = int(np.abs(field.t).argmin())
    where, shape = _in_row(pupil, middle, row), (len(field.s), len(field.u))
    return EpipolarPlane(
        field.values[middle, :, row],
        field.weight[middle, :, row] > 0,
        np.broadcast_to(where, shape),
        field.u,
        disparity.disparity[row],
        None if aside is None else np.broadcast_to(_in_row(aside, middle, row), shape),
    )


def _in_row(values: ArrayLike, middle: int, row: int) -> Array:
    """Values along u, for one row of views and one of microlenses, shape (s, u) or (s, 1)."""
    along: Array = np.asarray(values, float)[0, middle]
    return along[:, None] if along.ndim == 1 else along[:, row]


def estimate_disparity(
    field: LightField,
    pupil: ArrayLike,
    noise: PixelNoise,
    *,
    search: tuple[float, float],
    window: int = 5,
    aside: ArrayLike | None = None,
    captured: LightField | None = None,
    largest_sigma: float = LARGEST_SIGMA,
    largest_chi2: float = LARGEST_CHI2,
    passes: int = 4,
    edges: bool = False,
    begun: Start | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> DisparityMap:
    """Estimate each microlens's disparity from all views, near maximum likelihood.

    All candidates are compared first on some 25 groups of views. Then every view is warped back (spline of degree 7)
    along the disparity so far; all views together give the picture and its gradient, and what remains the correction,
    by least squares over the window with the weights of the noise model (Fisher information with the texture's own
    values free). Where a window is at odds with itself, the one beside it that agrees best is taken, and a plane fitted
    to three windows' width, or to the window, carries the value to the microlens.

    Parameters
    ----------
    field : LightField
        Decoded, or any grid of views: s and t are not read, `pupil` says where the views are.
    pupil : array_like
        Where on the pupil each sample's light passed, on average, along u and along v [pupil diameters from its
        centre], shape (2, t, s) or (2, t, s, v, u). Not a number where no light passes.
    noise : PixelNoise
        Of one sample.
    search : tuple of float
        Least and largest disparity [pitches].
    window : int
        Side of the matching window [microlenses], odd.
    aside : array_like, optional
        How far views see to the side of that, whatever the disparity: the view from s sees at u + B s + aside what the
        pupil's centre sees at u. Along u and along v [microlens pitches], shapes as of `pupil`. None is nothing.
    captured : LightField, optional
        As its pixels were read, where neighbours' light has been taken off `field` since: it tells what is saturated,
        and where there was light.
    largest_sigma : float
        Standard error [pitches] above which there is no disparity. Beyond about 0.3 the wrong one of two likely
        disparities would be taken now and then, and no standard error says so.
    largest_chi2 : float
        Chi-square per degree of freedom above which views disagree.
    passes : int
        Corrections after the search; the first two take half of the views, where these are many: of views with many
        pixels a quarter, the first of them four by four. With 0 there is only a search, and what lies outside by it.
    edges : bool
        Whether windows at odds are looked at once more for what smaller windows, and quarters of the views, have there.
        Else windows about a step are parted, each of one side alone, where the noise is not told by views themselves.
    begun : Start, optional
        Of an estimate of the same views with the same search: it is not made again, and of the same light field views
        are not prepared again.
    progress : callable
        Told the share that is done, about: of search, corrections and edges a third each.

    Raises
    ------
    ValueError
        Window even or below 3, search range empty, or arrays of other shapes.
    """
    low, high = (float(limit) for limit in search)
    if window < 3 or window % 2 == 0:
        raise ValueError(f"window is {window}; give an odd number of microlenses, 3 or more")
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ValueError(f"search is {search}; give a least and a largest disparity")
    every = None if begun is None else begun.every
    ready = every is not None and every.field is field and every.noise.saturation == noise.saturation
    views = every.views if every is not None and ready else _Views.of(field, pupil, noise, aside, captured)
    if not len(views.values):
        return _unlit(views, window, (low, high))
    # Noise that only views tell is that of views with many pixels, which may be searched by fewer.
    coarse = (noise.measured or passes <= ROUGH) and min(views.shape) >= MANY_PIXELS
    every = _AllViews(views, noise, field)
    first = replace(_searched(every, low, high, window, coarse) if begun is None else begun, every=every)
    if not passes:
        return replace(_unlit(views, window, (low, high)), outside=first.outside, begun=first)
    fresh, most = not first.corrected, len(views.grid) >= _MANY
    whole = np.ones(len(views.grid), np.bool_)
    other = views.sparse if coarse else views.grid.sum(axis=1) % 2 == 0
    disparity, picture = first.disparity, first.picture
    bound = (low - first.step, high + first.step)
    seen: tuple[bool, bool, SharedLight] | None = None
    passes = passes if fresh else 1 if coarse else min(passes, 3)
    for count in range(min(int(coarse and fresh), passes - 1), passes):
        progress((1 + count / passes) / 3)
        # Half of many views suffices to come near. What has settled is not looked at again.
        half, robust = most and fresh and count < 2, not fresh or count > 0
        kept = seen[2] if seen is not None and seen[:2] == (half, robust) else None
        look = every.look([(other if half else whole, disparity)], picture, robust, kept)
        seen = half, robust, look
        picture, fit = look.picture, WindowFit.of(look, window, rough=coarse and half)
        reliable = (fit.sigma < 2 * largest_sigma) & np.isfinite(fit.disparity)
        target = np.where(reliable, fit.disparity, look.disparity)
        disparity = np.clip(look.disparity + np.clip(target - look.disparity, -0.5, 0.5), *bound)
    begun = replace(first, disparity=disparity, picture=picture, corrected=True)
    if passes <= ROUGH and not noise.measured:  # noise is told by windows that hold no step
        left = np.where(views.lit > 0, np.maximum(fit.chi2, fit.strain), 0)
        return replace(_unlit(views, window, (low, high)), chi2=left, begun=begun)
    pulled = every.pulled(look, (window, *SIZES)) if noise.measured else None
    if pulled is not None:
        pulled[0] = pulled[0][fit.middles]
    alike = None if pulled is None else np.where(pulled[0] > 0, pulled[0] / np.maximum(fit.chi2, 1e-12), 1.0)
    judged = _judged(
        fit, look, views, noise, first.alike(noise), window, (low, high), largest_sigma, largest_chi2, alike
    )
    judged = replace(judged, begun=begun)
    pooled = None
    if pulled is not None:
        judged, pooled = _with_errors_of_views(judged, pulled, fit)
    if not edges and noise.measured:
        return judged
    if not edges:
        step = parted(look, fit, window, judged.error, lambda along: every.look([(whole, along)], picture))
        return judged if step is None else _by_sides(judged, step, largest_sigma, largest_chi2)
    progress(2 / 3)
    wanted = (judged.status == DisparityStatus.INCONSISTENT) | (judged.status == DisparityStatus.OUT_OF_RANGE)
    wanted |= (judged.status == DisparityStatus.AMBIGUOUS) & (fit.misfit(largest_chi2) > 1)
    level = noise_by_texture(fit.chi2, look.picture, window) if noise.measured else np.ones(views.shape)
    return _with_edges(judged, wanted, look, first, Limits.of(largest_sigma, pooled, level))


def _by_sides(judged: DisparityMap, step: Parted, largest_sigma: float, largest_chi2: float) -> DisparityMap:
    """Disparities with those of windows of one side, about depth steps."""
    fit, known = step.fit, (DisparityStatus.MEASURED, DisparityStatus.INCONSISTENT)
    about = step.about & np.isin(judged.status, known)
    told = about & (fit.sigma <= largest_sigma) & ~step.unsure & (fit.misfit(largest_chi2) <= 1)
    told &= np.abs(step.change) <= np.maximum(0.5 * fit.sigma, SETTLED)
    lost = about & step.beside & ~told
    sigma = np.where(told, fit.sigma * fit.widened(None), judged.sigma)
    return replace(
        judged,
        disparity=np.where(told, fit.disparity, np.where(lost, np.nan, judged.disparity)),
        sigma=np.where(lost, np.inf, np.where(about, np.hypot(sigma, step.leak), sigma)),
        status=np.where(told, np.int8(known[0]), np.where(lost, np.int8(known[1]), judged.status)),
        chi2=np.where(told, np.maximum(fit.chi2, fit.strain), judged.chi2),
    )


def _with_edges(judged: DisparityMap, wanted: Flags, look: SharedLight, start: Start, limits: Limits) -> DisparityMap:
    """Disparities with those of smaller windows and of quarters of the views, where they are `wanted`."""
    every, groups = start.every, start.zones
    assert every is not None
    views, (low, high) = every.views, judged.search
    # The middle view shows what the microlens sees: without it a quarter agrees on what lies behind an edge beside.
    pupil = views.pupil[..., :1, :1] if views.still else views.pupil
    left, above = ((side <= 1e-6, side >= -1e-6) for side in np.nanmean(pupil, axis=(2, 3)))
    few = views.sparse if len(views.grid) >= _MANY else np.ones(len(views.grid), np.bool_)
    lit = bool((views.lit == len(views.grid)).all())
    quarters = [Quarter.of(a & b, few, views.grid, lit) for a in left for b in above if (a & b).sum() > 2]
    known = judged.disparity[judged.measured]
    least, most = (max(low, known.min() - 1), min(high, known.max() + 1)) if known.size else (low, high)
    coarse, rough = min(views.shape) >= MANY_PIXELS, roughness(look.picture)
    each = coarse and groups is not None and len(groups.zones) == few.sum()
    found, wrong = past_edges(
        look, wanted, quarters, judged.disparity,
        lambda some, near: _searched(
            every if each else replace(every, views=views.some(some & few)), least, most, SIZES[0], coarse, near,
            groups.some(some[few]) if each and groups is not None else None,
        ).disparity,
        partial(every.look, rough=rough), partial(every.few, rough=rough), limits,
    )  # fmt: skip
    new = np.isfinite(found.sigma) & (found.disparity >= low) & (found.disparity <= high)
    disparity = np.where(new, found.disparity, np.where(wrong, np.nan, judged.disparity))
    sigma = np.where(new, found.sigma, np.where(wrong, np.inf, judged.sigma))
    status = np.where(wrong, np.int8(DisparityStatus.INCONSISTENT), judged.status)
    return replace(
        judged,
        disparity=disparity,
        sigma=sigma * np.where(beside_steps(disparity), BESIDE_STEP, 1.0),
        status=np.where(new, np.int8(DisparityStatus.MEASURED), status),
        chi2=np.where(new, found.chi2, judged.chi2),
        views=np.where(new, found.views, judged.views).astype(np.int16),
        picture=np.where(new, found.picture, judged.picture),
    )


@dataclass(frozen=True, eq=False)
class _AllViews:
    """Views made splines, to look at along any disparity."""

    views: _Views
    noise: PixelNoise
    field: LightField
    """Light field that they are of."""

    def look(
        self, parts: Sequence[tuple[Flags, Array]], picture: Array, robust: bool = True,
        kept: SharedLight | None = None, rough: Pictures | None = None,
    ) -> SharedLight:  # fmt: skip
        """Sums and picture of some of the views along a disparity, or of several such parts, at places of their own.

        `picture` is what they are expected to show. Where no disparity is a number nothing is compared, and where it is
        nearly that of another look at the same views, `kept`, its sums stay. `rough` is the picture's, if at hand.
        """
        rough = roughness(picture) if rough is None else rough
        views = self.views
        apart = self.noise.measured and all(some.all() for some, _ in parts)
        sums: NDArray[Any] = np.zeros((SUMS, *views.shape), np.float32) if kept is None else kept.sums.copy()
        where = np.zeros(views.shape) if kept is None else kept.disparity.copy()
        room = (apart * self.apart.size, 2, *views.shape)
        each = np.zeros(room, np.float32) if kept is None else kept.each.copy()
        for some, disparity in parts:
            if kept is not None:
                disparity = np.where(np.abs(disparity - kept.disparity) <= _SAME, np.nan, disparity)
            self._sum(np.flatnonzero(some), disparity, picture, rough, robust, sums, self.apart, each)
            np.copyto(where, disparity, where=~np.isnan(disparity))
        return SharedLight(sums, np.where(sums[11] > 0, sums[0], picture), where, views.steps, views.density, each)

    def few(self, indices: NDArray[np.int64], disparity: Array, picture: Array, rough: Pictures) -> FewViews:
        """Few views along a disparity, each by itself; else as `look`."""
        each = np.zeros((len(indices), 2, *self.views.shape), np.float32)
        self._sum(indices, disparity, picture, rough, True, np.empty((0, *self.views.shape), np.float32), indices, each)
        return FewViews(each, self.views.pupil, indices, picture, disparity, self.views.steps)

    def _sum(
        self, chosen: NDArray[np.int64], disparity: Array, picture: Array, rough: Pictures, robust: bool, sums: Array,
        apart: NDArray[np.int64], each: Pictures,
    ) -> None:  # fmt: skip
        """Sums of chosen views along a disparity, as `common` makes them, and what each of those `apart` shows."""
        views, noise = self.views, self.noise
        finite = math.isfinite(noise.saturation)
        peak = ndimage.maximum_filter(picture, 5) if finite else picture
        splines, cells = views.splines
        even, slot = not finite and not any(cells.strides), np.full(len(views.grid), -1)
        cells = np.ascontiguousarray(cells[:1, :1, :1] if even else cells)  # of one layout: compiled once for both
        if len(each):
            slot[apart] = np.arange(len(each))
        common.compiled(
            splines, cells, views.pupil, views.aside, views.still, even, chosen, disparity, picture, rough, peak,
            views.steps, noise.electrons, noise.read_noise, noise.brightest, _ROBUST if robust else math.inf, sums,
            slot, each,
        )  # fmt: skip

    @property
    def apart(self) -> NDArray[np.int64]:
        """Some `SOME_VIEWS` along each axis, whose pull on windows' disparities is told."""
        every = -(-(np.ptp(self.views.grid, axis=0) + 1) // SOME_VIEWS)
        return np.flatnonzero((self.views.grid % every == every // 2).all(axis=1))

    def pulled(self, look: SharedLight, windows: Sequence[int]) -> Array:
        """Variance of disparities of windows by how each view pulls them, over that by the noise believed of samples.

        Shape (window, v, u); 0 where no view tells it. Samples that err alike pull together (clusters of Liang and
        Zeger 1986, eq. 9): noise of interpolated or compressed views, and what splines and occlusion leave.
        """
        square, information = np.zeros((2, len(windows), *self.views.shape))
        add_pulls.compiled(
            look.each, self.views.pupil, self.apart, look.sums, *look.gradient, np.array(windows), square,
            information,
        )  # fmt: skip
        return np.asarray(np.divide(square, information, out=np.zeros_like(square), where=information > 0))


@dataclass(frozen=True, eq=False)
class _Views:
    """Lit views of a light field in one row, shape (view, v, u)."""

    values: Pictures
    light: Pictures
    full: Flags
    """True where a sample is saturated, shape of `values`."""
    pupil: Pictures
    """Shape (2, view, v, u)."""
    aside: Pictures
    """Offset of where each sample looks on the array, likewise [pitches]."""
    grid: NDArray[np.int64]
    """Place (t, s) of each view in the grid of views, shape (view, 2)."""
    lit: NDArray[np.int64]
    """Views with light at each microlens, saturated or not, shape (v, u)."""
    saturated: NDArray[np.int64]
    """Number of saturated views among them."""
    unlit: NDArray[np.int8]
    """Why a microlens has no views, where it has none, shape (v, u)."""
    steps: tuple[float, float]
    """Pitches between samples along u and v."""
    density: float
    """Microlenses a sample: below 1 where a hexagonal array was made square."""

    @classmethod
    def of(
        cls, field: LightField, pupil: ArrayLike, noise: PixelNoise, aside: ArrayLike | None = None,
        captured: LightField | None = None,
    ) -> _Views:  # fmt: skip
        grid, shape = field.values.shape[:2], field.values.shape[2:]
        if min(shape) < 4:
            raise ValueError(f"views of {shape[1]} x {shape[0]} microlenses; disparity needs 4 x 4 or more")
        where = _checked("pupil", pupil, field)
        # What is the same all over takes no room, and is looked at once.
        held = field.weight if any(field.weight.strides) else field.weight[..., :1, :1]
        usable = (held > 0).any(axis=(2, 3)) & np.isfinite(where).any(axis=tuple(range(3, where.ndim))).all(0)
        values, light = (
            each.reshape(-1, *shape) if usable.all() else each[usable] for each in (field.values, field.weight)
        )
        where = where[:, usable]
        if where.ndim == 2:
            known: Flags = np.ones((1, 1, 1), np.bool_)
            where = np.broadcast_to(where[:, :, None, None], (2, *values.shape))
        else:
            known = np.asarray(np.isfinite(where).all(axis=0))
        beside = (np.zeros((2, *grid), np.float32) if aside is None else _checked("aside", aside, field))[:, usable]
        if beside.ndim == 2:
            beside = np.broadcast_to(beside[:, :, None, None], (2, *values.shape))
        used = held[usable]
        good = known & (used > 0)
        with np.errstate(over="ignore", invalid="ignore"):
            whole = math.isfinite(values.sum())  # in a fifth of the time
        good = good if whole else good & np.isfinite(values)
        good = np.broadcast_to(np.True_, values.shape) if good.all() else good
        full: Flags = np.broadcast_to(np.zeros((), np.bool_), values.shape)
        if noise.saturation < math.inf:
            read = field if captured is None else captured
            full = good & saturated(read.values, read.weight, noise)[usable]
        if any(good.strides):
            light = np.where(good, light, np.float32(0))
        elif used.size and used.min() == used.max():
            light = np.broadcast_to(light.flat[0], light.shape)
        places = np.argwhere(usable)
        steps = (float(field.u[1] - field.u[0]), float(field.v[1] - field.v[0]))
        density = steps[0] if field.hexagonal is not None else 1.0
        shone = (held if captured is None or captured is field else captured.weight).max((0, 1))
        mixed = (shone > _BRIGHT * shone.max()) & ~(held > 0).any((0, 1))
        folded = (held > 0).any((0, 1)) & ~known.any(0)
        unlit = np.where(mixed, DisparityStatus.MIXED, DisparityStatus.NO_LIGHT)
        unlit = np.broadcast_to(np.where(folded, DisparityStatus.FOLDED, unlit).astype(np.int8), shape)
        return cls(
            np.ascontiguousarray(values), light, full, _read_only(where), _read_only(beside), places,
            _counted(good), _counted(full), unlit, steps, density,
        )  # fmt: skip

    @property
    def shape(self) -> tuple[int, int]:
        return self.values.shape[1], self.values.shape[2]

    @property
    def still(self) -> bool:
        """True where each view looks from one place and to one side all over."""
        return not any((*self.pupil.strides[2:], *self.aside.strides[2:]))

    def some(self, chosen: Flags) -> _Views:
        """Some of the views."""
        light, full = _picked(self.light, chosen), _picked(self.full, chosen)
        pupil, aside = (_picked(part.swapaxes(0, 1), chosen).swapaxes(0, 1) for part in (self.pupil, self.aside))
        return replace(
            self, values=self.values[chosen], light=light, full=full, pupil=pupil, aside=aside, grid=self.grid[chosen],
            lit=_counted(light), saturated=_counted(full),
        )  # fmt: skip

    def halved(self) -> _Views:
        """Views of half as many microlenses along each side, means of four, lit where all of them are."""
        rows, columns = (2 * (size // 2) for size in self.shape)
        corners = [(..., slice(b, rows, 2), slice(a, columns, 2)) for b in (0, 1) for a in (0, 1)]
        values, light, full = self.values[corners[0]], self.light[corners[0]], self.full[corners[0]]
        for corner in corners[1:]:
            values = values + self.values[corner]
            if any((*self.light.strides, *self.full.strides)):
                light, full = np.minimum(light, self.light[corner]), full | self.full[corner]
        values *= np.float32(0.25)
        return replace(
            self, values=values, light=light, full=full, pupil=_read_only(self.pupil[corners[0]]),
            aside=_read_only(self.aside[corners[0]]), lit=_counted(light), saturated=_counted(full),
            steps=(2 * self.steps[0], 2 * self.steps[1]),
        )  # fmt: skip

    @property
    def sparse(self) -> Flags:
        """True of every other one along both axes, which are a quarter of all."""
        return np.asarray((self.grid % 2 == 0).all(axis=1))

    @cached_property
    def splines(self) -> tuple[Pictures, Pictures]:
        """Spline coefficients and light of the cells between samples."""
        views = self.values
        if any(self.light.strides) and not self.light.all():
            views = views.copy()
            fill_holes.compiled(views, self.light)
        full = self.full if any(self.full.strides) else None
        return spline_coefficients(views), light_of_cells(self.light, full)

    def zones(self, largest: float) -> tuple[NDArray[np.int64], int]:
        """Zone of each view, so that disparities up to `largest` smear none by more than about a pitch."""
        bands = []
        for axis in range(2):
            size = int(self.grid[:, axis].max()) + 1
            count = min(size, max(5, math.ceil(largest)))
            bands.append(self.grid[:, axis] * count // size)
        _, zone = np.unique(np.stack(bands), axis=1, return_inverse=True)
        zone = np.asarray(zone, np.int64).ravel()
        return zone, int(zone.max()) + 1


def _checked(name: str, values: ArrayLike, field: LightField) -> Pictures:
    """Array of one value per view, or per sample, as `estimate_disparity` takes it; errors call it by `name`."""
    array, shape = np.asarray(values, np.float32), field.values.shape
    if array.shape not in ((2, *shape[:2]), (2, *shape)):
        raise ValueError(f"{name} of shape {array.shape}; give (2, t, s) or (2, t, s, v, u) of {shape}")
    return array


def saturated(values: Pictures, weight: Pictures, noise: PixelNoise) -> Flags:
    """Samples (t, s, v, u) that are saturated, and those of the same microlens beside them.

    Samples are interpolated between pixels: one beside a full one rests on full pixels as well. Where a microlens's
    views are all so bright that some would be full by chance, the rest are dark by selection, and all count as full.
    """
    if noise.saturation == math.inf:
        return np.zeros(values.shape, np.bool_)
    charge = weight * np.float32(noise.electrons)
    lit = weight > 0
    picture = np.where(lit, values, 0).sum((0, 1)) / np.maximum(lit.sum((0, 1)), 1)
    full = np.asarray((values * charge >= noise.saturation) | (picture * charge >= noise.brightest))
    return np.asarray(ndimage.maximum_filter(full, (3, 3, 1, 1))) if full.any() else full


def _picked(part: NDArray[Any], chosen: Flags) -> NDArray[Any]:
    """Some of views; of what is the same all over them nothing is copied."""
    same = not any(part.strides[-2:])
    return np.broadcast_to(part[chosen, ..., :1, :1] if same else part[chosen], (int(chosen.sum()), *part.shape[1:]))


def _counted(part: NDArray[Any]) -> NDArray[np.int64]:
    """Number of views that have something at each microlens."""
    same = part.size and not any(part.strides[1:])
    return np.full(part.shape[1:], (part[:, 0, 0] > 0).sum()) if same else (part > 0).sum(axis=0)


def _read_only(part: Pictures) -> Pictures:
    """Read-only view of an array: kernels are compiled once more for arrays that can be written to."""
    return np.broadcast_to(part, part.shape)


@dataclass(frozen=True, eq=False)
class Start:
    """Disparities that an estimate starts from."""

    disparity: Array
    picture: Array
    margin: Array
    """Chi-square between the best and the next dip, less what noise of the candidates takes."""
    step: float
    noise: PixelNoise
    """Noise that chi-square is for."""
    every: _AllViews | None = None
    corrected: bool = False
    """Whether by corrections too."""
    outside: tuple[float, float] = (0.0, 0.0)
    """Shares of the microlenses that are clearly sharpest beyond either end of the search."""
    zones: _Zones | None = None
    """Groups of views that were compared."""

    @property
    def dark(self) -> Flags:
        """True of microlenses that no view has light of, whose disparity is that of the nearest others."""
        assert self.every is not None
        return np.asarray(self.every.views.lit == 0)

    def alike(self, noise: PixelNoise) -> Flags:
        """True where another disparity fits as well."""
        times = self.noise.read_noise / noise.read_noise if noise != self.noise else 1.0
        return np.asarray(self.margin * times**2 < ALIKE)


class _Zones(NamedTuple):
    """Groups of views that are compared along disparities."""

    zones: Pictures
    """As `gather_zones` makes them."""
    cells: Pictures
    """Least information of each four neighbours."""
    picture: Array
    views: _Views
    """Views that were grouped."""
    reach: float
    """Largest pupil coordinate."""

    @classmethod
    def of(cls, views: _Views, noise: PixelNoise, largest: float, coarse: bool = False) -> _Zones:
        """Groups of views, or where these are few or move far each, to search disparities up to `largest`."""
        if (views.aside[..., :1, :1] if views.still else views.aside).any():
            largest += 2 * float(np.abs(views.aside).max())
        zone, count = views.zones(largest)
        if count == len(views.grid) >= _MANY:
            views = views.some(views.sparse)
            zone, count = np.arange(len(views.grid)), len(views.grid)
        if coarse:
            views = views.halved()
        shown = np.where(views.light > 0, views.values, 0) if any(views.light.strides) else views.values
        overall = shown.sum(axis=0, dtype=float) / np.maximum(views.lit, 1)
        zones = np.zeros((count, 6, *views.shape), np.float32)
        gather_zones.compiled(
            views.values, np.ascontiguousarray(views.light), views.pupil, views.aside, zone, overall,
            noise.electrons, noise.read_noise, zones,
        )  # fmt: skip
        light = zones[:, 1]
        above, below = (np.minimum(each[..., :-1], each[..., 1:]) for each in (light[:, :-1], light[:, 1:]))
        places = zones[:, 2:4]  # 0 without light
        reach = max(float(places.max()), -float(places.min()), 1e-3)
        return cls(zones, np.minimum(above, below), overall, views, reach)

    def some(self, chosen: Flags) -> _Zones:
        """Some of them."""
        return self._replace(zones=self.zones[chosen], cells=self.cells[chosen])

    def between(self, low: float, high: float, apart: float) -> Array:
        """Disparities to search, one beyond either end, from each to the next of which the outermost views move so far.

        `apart` is in microlenses.
        """
        steps = max(2, math.ceil((high - low) * self.reach / (apart * min(self.views.steps))))
        return low + (high - low) / steps * np.arange(-1.0, steps + 2)


def _searched(
    every: _AllViews, low: float, high: float, window: int, coarse: bool = False, near: Flags | None = None,
    groups: _Zones | None = None,
) -> Start:  # fmt: skip
    """Best of all candidates at every microlens, or those `near`, by the spread of groups of views about their mean.

    `coarse`: of microlenses four by four together; `groups`, where these are made.
    """
    views, noise = every.views, every.noise
    groups = _Zones.of(views, noise, max(abs(low), abs(high)), coarse) if groups is None else groups
    zones, cells, overall, some, _ = groups
    candidates = groups.between(low, high, _APART[coarse])
    shape, fine, size, step = overall.shape, views.shape, 1 + coarse, float(candidates[1] - candidates[0])
    window = window // 2 | 1 if coarse else window
    pitches = size * views.steps[0], size * views.steps[1]
    where = np.ones(shape, np.bool_) if near is None else near[::size, ::size][: shape[0], : shape[1]].copy()
    squares, freedoms, means = np.zeros((3, len(candidates), *shape), np.float32)
    shown = overall.astype(np.float32)
    spread_of_zones.compiled(zones, cells, shown, candidates, pitches, where, squares, freedoms, means)
    totals, freedoms = (box(each, window) for each in (squares, freedoms))
    best = np.zeros(shape, np.int64)
    part, least, second, level = np.zeros((4, *shape))
    best_and_next.compiled(totals, freedoms, best, part, least, second, level)
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    start = candidates[best] + step * part
    freedom = freedoms[best, rows, columns]
    with np.errstate(invalid="ignore"):
        margin = np.where(np.isfinite(second), ((second - least) - 0.02 * (level - least)) * freedom, np.inf)
    beyond = [float(np.mean((best == end) & (least < _CLEAR * level))) for end in (0, len(candidates) - 1)]
    told = np.isfinite(least)
    picture: Array = np.where(told, means[best, rows, columns], overall)
    if near is None and told.any() and not told.all():
        start = start[tuple(ndimage.distance_transform_edt(~told, return_distances=False, return_indices=True))]
    if coarse and near is None:
        # One correction of these costs a quarter of one of all pixels.
        chosen = np.ones(len(some.grid), np.bool_)
        look = replace(every, views=some).look([(chosen, start)], picture, robust=False)
        picture, fit = look.picture, WindowFit.of(look, window, rough=True)
        start = np.clip(np.where(np.isfinite(fit.sigma), fit.disparity, start), start - 0.5, start + 0.5)
    if coarse:
        down, along = (np.minimum(np.arange(n) // 2, n // 2 - 1) for n in fine)
        start, picture, margin = (each[down[:, None], along] for each in (start, picture, margin))
    return Start(start, picture, margin, step, noise, outside=(beyond[0], beyond[1]), zones=groups)


def _judged(
    fit: WindowFit, look: SharedLight, views: _Views, noise: PixelNoise, alike: Flags,
    window: int, search: tuple[float, float], largest_sigma: float, largest_chi2: float, pulled: Array | None,
) -> DisparityMap:  # fmt: skip
    sums, change = look.sums, fit.disparity - look.disparity
    sigma, known = fit.sigma * fit.widened(pulled), look.gradient[2]
    own = look.own(change)
    # Saturation takes what splines and slopes would need about it as well.
    light = views.light.sum(axis=0) if any(views.light.strides) else views.light[0] * views.lit
    charge = noise.electrons * look.picture * light / np.maximum(views.lit, 1)
    near = charge + 3 * np.sqrt(np.maximum(charge, 0) + noise.read_noise**2) >= noise.saturation
    lit, full = box(views.lit > 0, window + 6), box(near | (views.saturated > 0), window + 6)
    spread = box(sums[4] + sums[6], window) / np.maximum(box(sums[1], window), 1e-30)
    margin = np.where(np.isfinite(sigma), 3 * sigma, 0)
    status = np.full(views.shape, int(DisparityStatus.MEASURED), np.int8)
    at_odds = (fit.misfit(largest_chi2) > 1) | (own > np.maximum(largest_chi2, chance(sums[10])))
    # Not settled: too far from what the search started from for a slope to tell.
    at_odds |= np.abs(change) > np.maximum(0.5 * fit.sigma, _SETTLED)
    unsure = ~(fit.sigma <= largest_sigma)
    bare = unsure & (box(known & (sums[11] > 1), window) <= QUORUM * window**2)
    # The last that holds is the reason given.
    status[at_odds] = DisparityStatus.INCONSISTENT
    below, above = fit.disparity < search[0] - margin, fit.disparity > search[1] + margin
    status[below | above] = DisparityStatus.OUT_OF_RANGE
    status[alike] = DisparityStatus.AMBIGUOUS
    status[unsure] = DisparityStatus.NO_TEXTURE
    status[bare] = DisparityStatus.NO_LIGHT
    status[unsure & ((views.lit < 2) | (spread < 1e-6))] = DisparityStatus.TOO_FEW_VIEWS
    clipped = (unsure | at_odds) & (full > CLIPPED * lit)
    clipped |= views.saturated > CLIPPED_VIEWS * views.lit
    status[clipped] = DisparityStatus.SATURATED
    status = np.where(views.lit == 0, views.unlit, status)
    measured = status == DisparityStatus.MEASURED
    away, shone = status == DisparityStatus.OUT_OF_RANGE, max(int((views.lit > 0).sum()), 1)
    outside = float((away & below).sum() / shone), float((away & above).sum() / shone)
    return DisparityMap(
        np.where(measured, fit.disparity, np.nan),
        np.where(measured, sigma, np.inf),
        status,
        np.maximum(fit.chi2, fit.strain),
        sums[11].astype(np.int16),
        np.where(sums[11] > 0, sums[0], 0),
        window,
        search,
        outside,
    )


def _with_errors_of_views(judged: DisparityMap, pulled: Array, fit: WindowFit) -> tuple[DisparityMap, list[float]]:
    """Disparities without what bends put on them; how much more windows of `SIZES` vary than if noise were each's.

    Of a bend as large as the error half is taken off, of others as much as is not likely noise (Wiener). Half a bend
    counts as an error: at the limb of a ball, 1.8 times what differences tell bends a window (radius 15, 6 inside).
    """
    some = judged.measured & (pulled > 0).all(axis=0)
    total = fit.chi2[some].sum()
    whole, *small = (max(1.0, float(pull[some].sum() / total)) if total > 0 else 1.0 for pull in pulled)
    smooth = np.where(beside_steps(judged.disparity), np.nan, judged.disparity)
    bent = window_bends(smooth, judged.window, fit)
    part = np.divide(bent**2, bent**2 + judged.sigma**2, where=judged.measured, out=np.zeros_like(bent))
    disparity, sigma = judged.disparity - part * bent, np.hypot(judged.sigma, bent / 2)
    return replace(judged, disparity=disparity, sigma=sigma, alike=whole), small


def _unlit(views: _Views, window: int, search: tuple[float, float]) -> DisparityMap:
    shape = views.shape
    zero = np.zeros(shape)
    return DisparityMap(
        np.full(shape, np.nan), np.full(shape, np.inf), views.unlit, zero, np.zeros(shape, np.int16), zero, window,
        search, (0.0, 0.0),
    )  # fmt: skip
