"""Disparities where images overlap so much that few pixels show mostly one microlens: with the texture, all at once.

A sample is what all microlenses show whose light it has: a linear form of the texture, along the disparities. The
texture is solved for by least squares at every disparity that is searched, and what it leaves over says which of them
is right (variable projection, Golub and Pereyra 1973); window by window these are then corrected (Gauss and Newton),
each with the error that all samples allow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from ..calibration.decoding import DARKEST, LightField
from ..camera import Camera
from ..progress import UNHEARD, Share, part_of
from ..shapes.lattice import PACKINGS
from ..theory.colours import panchromatic
from ..theory.image_parts import waves_shown
from ..theory.stop_images import MicrolensImages
from .bends import straightened
from .estimate import (
    ALIKE,
    CLIPPED,
    CLIPPED_VIEWS,
    LARGEST_CHI2,
    LARGEST_SIGMA,
    DisparityMap,
    DisparityStatus,
    PixelNoise,
    saturated,
)
from .unmixing import ViewLight, reading
from .windows import box

Array = NDArray[np.float64]
Samples = NDArray[np.float32]
Spectra = NDArray[np.complex64]

ACROSS = 9, 15
"""Samples along a microlens's cell that pixels are taken together to, at least and at most."""
STEP, LEVELS = 0.125, 64
"""Disparities between which what samples show is interpolated [pitches]; waves that are worked out at a time."""
TILE, CUT_TILE, AROUND, APART = 40, 10, 6, 8
"""Microlenses along a side of what is fitted together, of cut images, all of which change; fitted beside it and left
out; between its sides where it repeats itself."""
SEARCHING, SOLVING, ROUNDS = 8, 30, 10
"""Steps of conjugate gradients to a texture in the search and in each of so many rounds of corrections."""
SMALL = 1e-8
"""Square of what is left of a texture's gradient, over that at first, at which it is found."""
FARTHEST, SETTLED = 0.3, 0.1
"""Correction of a round at most [pitches]; change, over the standard error, that ends them."""
FAINTEST = 0.1
"""Brightness over the mean below which noise does not fall."""
MOST_STRAIN = 2.0
"""Chi-square of a window's microlenses about its disparity above which it sees a step; 1.9 by chance at one in 200."""


def joint_disparities(
    light: ViewLight,
    field: LightField,
    noise: PixelNoise,
    search: tuple[float, float],
    window: int,
    progress: Share = UNHEARD,
) -> DisparityMap:
    """Disparity of every microlens, by all samples and the texture that explains them best.

    Parameters
    ----------
    light : ViewLight
        Of an ideal lens.
    field : LightField
        As its pixels were read.
    noise : PixelNoise
        Of one sample.
    search : tuple of float
        Least and largest disparity [pitches].
    window : int
        Microlenses along a side of the window, odd.
    progress : callable
        Told the share that is done.
    """
    lenses = field if field.hexagonal is None else field.hexagonal
    full = saturated(lenses.values, lenses.weight, noise)
    rows, columns = (np.arange(size) for size in lenses.values.shape[2:])
    alike = light.nodes.rows.size * light.nodes.columns.size == 1
    pieces = [
        (top, left)
        for top in np.array_split(rows, max(1, round(rows.size / (TILE if alike else CUT_TILE))))
        for left in np.array_split(columns, max(1, round(columns.size / (TILE if alike else CUT_TILE))))
    ]
    shape = lenses.values.shape[2:]
    found = {name: np.zeros(shape) for name in _Fitted._fields}
    known: dict[tuple[int, int], Spectra] = {}
    for number, (top, left) in enumerate(pieces):
        part = tuple(
            slice(max(0, int(one[0]) - AROUND), min(size, int(one[-1]) + 1 + AROUND))
            for one, size in zip((top, left), shape, strict=True)
        )
        tell = part_of(progress, number / len(pieces), (number + 1) / len(pieces))
        at = light.places[(top[0] + top[-1]) // 2, min((left[0] + left[-1]) // 2, light.places.shape[1] - 1)]
        joint = _Joint.of(light, field, noise, full, (part[0], part[1]), (float(at[0]), float(at[1])))
        fitted = joint.fitted(search, window, known if alike else {}, tell)
        inside = np.ix_(top - part[0].start, left - part[1].start)
        for name, one in zip(fitted._fields, fitted, strict=True):
            found[name][np.ix_(top, left)] = one[inside]
    density = 1.0 if field.hexagonal is None else float(field.u[1] - field.u[0])
    return _judged(_Fitted(**{name: _on_grid(field, one) for name, one in found.items()}), window, search, density)


class _Fitted(NamedTuple):
    """Answers of a fit about single microlenses."""

    disparity: Array
    """Along which samples were explained [pitches]."""
    pull: Array
    """Slope of half of chi-square about that."""
    information: Array
    """Its curvature: of disparities that move alike, the texture free."""
    squares: Array
    """Chi-square of its samples."""
    used: Array
    """Their number."""
    full: Array
    """Share of its samples that are full; 1 of none that is lit is 0."""
    margin: Array
    """Chi-square between the best and the next dip of its window in the search."""
    picture: Array


def _on_grid(field: LightField, values: Array) -> Array:
    """Numbers of each microlens at those of the views: of a hexagonal array between them along rows."""
    if field.hexagonal is None:
        return values
    ranks = np.arange(values.shape[1])
    return np.stack(
        [np.interp(field.u, first + ranks, row) for first, row in zip(field.hexagonal.starts, values, strict=True)]
    )


def _judged(fitted: _Fitted, window: int, search: tuple[float, float], density: float) -> DisparityMap:
    """Disparities of windows, and why there are none; each place of views counts for `density` microlenses."""
    known = fitted.information > 0
    information = box(fitted.information, window)
    least = np.maximum(information, 1e-12)
    pull = box(fitted.pull, window)
    disparity = _of_windows(fitted.disparity, fitted.information, window) + pull / least
    count = np.maximum(box(known.astype(float), window) * density, 2)
    own = np.divide(fitted.pull**2, fitted.information, out=np.zeros_like(pull), where=known)
    strain = density * np.maximum(box(own, window) - pull**2 / least, 0) / (count - 1)
    samples = np.maximum(box(fitted.used, window), 1)
    chi2 = box(fitted.squares, window) / samples
    sure = [np.where(one > 1 + 3 * np.sqrt(2 / n), one, 1) for one, n in ((chi2, samples), (strain, count - 1))]
    sigma = np.sqrt(np.maximum(*sure) / (density * least))
    below, above = (side * (edge - disparity) > 3 * sigma for side, edge in ((1, search[0]), (-1, search[1])))
    unsure, odd = ~(sigma <= LARGEST_SIGMA), (chi2 > LARGEST_CHI2) | (strain > MOST_STRAIN)
    status = np.full(sigma.shape, int(DisparityStatus.MEASURED), np.int8)
    status[odd] = DisparityStatus.INCONSISTENT
    status[below | above] = DisparityStatus.OUT_OF_RANGE
    status[fitted.margin < ALIKE] = DisparityStatus.AMBIGUOUS
    status[unsure] = DisparityStatus.NO_TEXTURE
    lit = (fitted.used > 0) | (fitted.full > 0)
    clipped = (unsure | odd) & (box(fitted.full, window) > CLIPPED * box(lit.astype(float), window))
    status[clipped | (fitted.full > CLIPPED_VIEWS)] = DisparityStatus.SATURATED
    status[~lit] = DisparityStatus.NO_LIGHT
    measured = status == DisparityStatus.MEASURED
    error = float(np.median(sigma[measured])) if measured.any() else math.inf
    if measured.any():  # bends of single windows would scatter by a quarter of their error
        smooth = np.where(lit, ndimage.uniform_filter(ndimage.median_filter(disparity, window), window), np.nan)
        disparity = disparity + straightened(smooth, window, error) - smooth
    shone = max(int(lit.sum()), 1)
    return DisparityMap(
        np.where(measured, disparity, np.nan),
        np.where(measured, sigma, np.inf),
        status,
        np.maximum(chi2, strain),
        fitted.used.astype(np.int16),
        fitted.picture,
        window,
        search,
        (float((measured & below).sum() / shone), float((measured & above).sum() / shone)),
    )


@dataclass(frozen=True, eq=False)
class _Joint:
    """Samples of some microlenses that are fitted together, on a torus of the lattice's indices.

    Shapes: (view, rows, columns) of samples and (rows, columns) of what is known of microlenses, along their rows; of
    the torus (J, I), and (J, I // 2 + 1) of waves on it.
    """

    light: ViewLight
    field: LightField
    at: tuple[float, float]
    """Place on the array that the light is worked out for [mm]."""
    cells: _Cells
    values: Array
    charge: Array
    """Light of each sample, over that of a fully lit pixel."""
    usable: NDArray[np.bool_]
    full: Array
    mean: float
    noise: PixelNoise
    shift: NDArray[np.intp]
    """Columns of the torus before each row's first microlens."""

    @classmethod
    def of(
        cls, light: ViewLight, field: LightField, noise: PixelNoise, full: NDArray[np.bool_],
        part: tuple[slice, slice], at: tuple[float, float],
    ) -> _Joint:  # fmt: skip
        """Fit of rows and columns of a light field's microlenses, whose samples may be `full`."""
        lenses = field if field.hexagonal is None else field.hexagonal
        cells = _Cells.of(field, light.camera)
        values, weight, clipped = (
            np.moveaxis(one[(..., *part)], (0, 1), (-2, -1)) for one in (lenses.values, lenses.weight, full)
        )
        light_there = cells.means(weight.astype(float))
        share = cells.means(clipped.astype(float))
        shown = cells.means(values * weight) / np.maximum(light_there, 1e-9)
        usable = (light_there > DARKEST) & (share == 0)
        total = float(light_there[usable].sum())
        mean = float((shown * light_there)[usable].sum()) / total if total else 0.0
        shift = np.zeros(values.shape[0], np.intp)
        if field.hexagonal is not None:
            starts = np.rint(field.hexagonal.starts - field.v / math.sqrt(3)).astype(np.intp)[part[0]]
            shift = starts - starts.min()
        shown, charge, use = (
            np.ascontiguousarray(np.moveaxis(one, -1, 0)) for one in (shown, light_there * cells.size**2, usable)
        )
        return cls(light, field, at, cells, shown, charge, use > 0, share.mean(-1), mean, noise, shift)

    @cached_property
    def torus(self) -> tuple[int, int]:
        """Shape of the torus."""
        rows, columns = self.values.shape[1:]
        size = rows + APART, columns + int(self.shift.max()) + APART
        return fft.next_fast_len(size[0], real=True), fft.next_fast_len(size[1], real=True)

    @cached_property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of the torus at which the microlenses stand."""
        rows, columns = self.values.shape[1:]
        return np.arange(rows)[:, None], self.shift[:, None] + np.arange(columns)

    @cached_property
    def waves(self) -> Array:
        """Waves of the torus, shape (J, I // 2 + 1, 2) [periods a pitch]: of those alike at microlenses the longest."""
        up, along = np.fft.fftfreq(self.torus[0])[:, None], np.fft.rfftfreq(self.torus[1])[None]
        index = np.stack(np.broadcast_arrays(along, up), -1)[..., None, :]
        alike = np.stack(np.meshgrid(*2 * [np.arange(-1, 2)]), -1).reshape(-1, 2)
        every = (index + alike) @ np.linalg.inv(PACKINGS[self.light.camera.layout].steps)
        best = np.hypot(*np.moveaxis(every, -1, 0)).argmin(-1)
        return np.asarray(np.take_along_axis(every, best[..., None, None], 2)[:, :, 0])

    def shown(self, disparities: Array, tell: Share) -> Spectra:
        """Waves as samples show them, shape (disparity, view, J, I // 2 + 1)."""
        field, cut = self.field, self.cells.cut
        images = MicrolensImages(panchromatic(self.light.camera), [self.at])
        weight = self._mean_light
        waves, total = self.waves.reshape(-1, 2), self.cells.means(weight)
        out = np.empty((len(disparities), total.size, len(waves)), np.complex64)
        s, t = (axis[cut] / field.pitch for axis in (field.s, field.t))
        for first in range(0, len(waves), LEVELS):
            some = np.s_[first : first + LEVELS]
            every = waves_shown(images, s, t, waves[some], self.light.side * disparities, reading(field))[:, :, 0]
            means = self.cells.of_cut(every * weight[cut, cut]) / np.maximum(total, 1e-9)
            out[..., some] = np.moveaxis(means, 1, 2)
            tell(min(1.0, (first + LEVELS) / len(waves)))
        out[..., 0] = 1
        return out.reshape(*out.shape[:2], *self.waves.shape[:2])

    @cached_property
    def _mean_light(self) -> Array:
        lenses = self.field if self.field.hexagonal is None else self.field.hexagonal
        return np.asarray(lenses.weight.mean((2, 3), dtype=float))

    def weight(self, shown: NDArray[np.floating] | float) -> Samples:
        """Reciprocals of the samples' variances, where they show so much."""
        most = self.noise.electrons * self.charge
        brightness = np.maximum(shown, FAINTEST * self.mean)
        variance = most * brightness + self.cells.size**2 * self.noise.read_noise**2
        return np.asarray(np.where(self.usable, most**2 / np.maximum(variance, 1e-12), 0), np.float32)

    def spread(self, values: Array) -> Array:
        """Values of the microlenses over the torus, beside them the nearest's."""
        rows, columns = values.shape
        up, along = (np.arange(size) for size in self.torus)
        up = np.where(up < (rows + self.torus[0]) / 2, np.minimum(up, rows - 1), 0)
        after = along - self.shift[up][:, None]
        after = np.where(after < (columns + self.torus[1]) / 2, after, after - self.torus[1])
        return np.asarray(values[up[:, None], np.clip(after, 0, columns - 1)])

    def at_lenses(self, waves: Spectra) -> Samples:
        """Sums of waves at the microlenses."""
        return np.asarray(fft.irfft2(waves, self.torus)[(..., *self.places)])

    def into_waves(self, values: Samples) -> Spectra:
        """Waves of values at the microlenses, 0 elsewhere."""
        out = np.zeros((*values.shape[:-2], *self.torus), np.float32)
        out[(..., *self.places)] = values
        return np.asarray(fft.rfft2(out))

    @cached_property
    def prior(self) -> Array:
        """Reciprocal variance of the texture's waves: as much contrast in every octave as the samples show."""
        fine = np.hypot(*np.moveaxis(self.waves, -1, 0))
        fine[0, 0] = 1 / max(self.torus)
        values = (self.values - self.mean)[self.usable]
        variance = float((values**2).mean()) / (2 * math.pi * math.log(max(self.torus)))
        return np.asarray(fine**2 / max(variance * math.prod(self.torus), 1e-12), np.float32)

    def solved(
        self, way: _Way, values: Samples, weight: Samples, steps: int, begin: Spectra | float = 0.0
    ) -> tuple[Spectra, Samples]:  # fmt: skip
        """Texture that explains values best, and what it shows, by conjugate gradients."""
        across = self.prior + sum(np.tensordot(weight.mean((1, 2)), np.abs(one) ** 2, 1) for one in way.shown) / len(
            way.shown
        )
        texture = np.zeros(self.waves.shape[:2], np.complex64) + np.complex64(begin)
        shows = way.forward(texture)
        slope = np.asarray(way.back(weight * (values - shows)) - self.prior * texture, np.complex64)
        step = ahead = np.asarray(slope / across, np.complex64)
        left = first = self._product(slope, ahead)
        for _ in range(steps):
            if not left > SMALL * first:
                break
            shown = way.forward(step)
            curve = np.asarray(way.back(weight * shown) + self.prior * step, np.complex64)
            far = np.float32(left / max(self._product(step, curve), 1e-30))
            texture, shows, slope = texture + far * step, shows + far * shown, slope - far * curve
            ahead = np.asarray(slope / across, np.complex64)
            left, before = self._product(slope, ahead), left
            step = ahead + np.float32(left / before) * step
        return texture, shows

    def _product(self, one: Spectra, other: Spectra) -> float:
        first, second = (fft.irfft2(each, self.torus).astype(float) for each in (one, other))
        return float((first * second).sum())

    def fitted(
        self, search: tuple[float, float], window: int, known: dict[tuple[int, int], Spectra],
        tell: Share,
    ) -> _Fitted:  # fmt: skip
        """Disparities by a search and rounds of corrections; what samples show is `known` for some tori."""
        low, high = math.floor(search[0] / STEP) - 1, math.ceil(search[1] / STEP) + 1
        disparities = STEP * np.arange(low, high + 1.0)
        if self.torus not in known:
            known[self.torus] = self.shown(disparities, part_of(tell, 0.0, 0.4))
        shown = known[self.torus]
        values = np.where(self.usable, self.values - self.mean, 0).astype(np.float32)
        weight = self.weight(self.mean)
        totals = []
        for number, one in enumerate(shown):
            tell(0.4 + 0.2 * number / len(shown))
            left = values - self.solved(_Way(self, one[None]), values, weight, SEARCHING)[1]
            totals.append(box((weight * left**2).sum(0), window))
        at, margin = _best(np.array(totals))
        used, texture = self.usable.sum(0), np.zeros(self.waves.shape[:2], np.complex64)
        for number in range(ROUNDS):
            tell(0.6 + 0.4 * number / ROUNDS)
            smooth = np.clip(ndimage.median_filter(at, window), 0, len(shown) - 1.001)
            way = _Way.along(self, shown, self.spread(smooth))
            texture, shows = self.solved(way, values, weight, SOLVING, texture)
            weight = self.weight(shows + self.mean)
            left = values - shows
            moved = way.moved(texture)
            moved -= self.solved(way, moved, weight, SOLVING)[1]
            pull, information = (weight * moved * left).sum(0, dtype=float), (weight * moved**2).sum(0, dtype=float)
            total = np.maximum(box(information, window), 1e-12)
            change = box(pull, window) / total
            at = _of_windows(smooth, information, window) + np.clip(change, -FARTHEST / STEP, FARTHEST / STEP)
            if np.median(np.abs(change) * np.sqrt(total)) < SETTLED:
                break
        picture = fft.irfft2(texture, self.torus)[self.places] + self.mean
        squares = (weight * left**2).sum(0, dtype=float)
        return _Fitted(
            STEP * (low + smooth), pull / STEP, information / STEP**2, squares, used, self.full, margin,
            np.where(used > 0, picture, 0.0),
        )  # fmt: skip


def _of_windows(disparity: Array, information: Array, window: int) -> Array:
    """Means of windows by information, at their middles: where more is known to one side, a slope counts less there."""
    total = np.maximum(box(information, window), 1e-12)
    mean, smooth = box(information * disparity, window) / total, ndimage.uniform_filter(disparity, window)
    for axis, slope in enumerate(np.gradient(smooth)):
        place = np.indices(disparity.shape)[axis].astype(float)
        mean -= slope * (box(information * place, window) / total - place)
    return np.asarray(mean)


def _best(totals: Array) -> tuple[Array, Array]:
    """Place of the least of totals along their first axis, between steps, and how much more the next dip has."""
    inner, last = totals[1:-1], len(totals) - 2
    best = np.clip(totals.argmin(0), 1, last)
    before, least, after = (np.take_along_axis(totals, best[None] + k, 0)[0] for k in (-1, 0, 1))
    bent = before - 2 * least + after
    part = np.clip(0.5 * (before - after) / np.where(bent > 0, bent, np.inf), -0.5, 0.5)
    dips = (inner <= totals[:-2]) & (inner <= totals[2:])
    np.put_along_axis(dips, best[None] - 1, False, 0)
    return best + part, np.where(dips, inner, np.inf).min(0) - least


class _Cells(NamedTuple):
    """Samples of a microlens's own cell, every one of them in one cell alone, taken together to blocks."""

    cut: slice
    """Samples along either axis that lie in some block."""
    size: int
    """Samples along a side of a block."""
    kept: NDArray[np.bool_]
    """Blocks within the cell."""

    @classmethod
    def of(cls, field: LightField, camera: Camera) -> _Cells:
        """Cells of a light field."""
        inside = np.flatnonzero(np.abs(field.s) <= field.pitch / 2 + 1e-9)
        sizes = range(max(1, round(inside.size / ACROSS[1])), max(1, inside.size // ACROSS[0]) + 1)
        size = min(sizes, key=lambda one: (inside.size % one, one))  # the fewest samples left over
        count = inside.size // size * size
        first = int(inside[0]) + (inside.size - count) // 2
        cut = slice(first, first + count)
        t, s = np.meshgrid(field.t[cut] / field.pitch, field.s[cut] / field.pitch, indexing="ij")
        whole = cls(cut, size, np.ones((count // size, count // size), np.bool_))
        own = PACKINGS[camera.layout].in_cell(s, t).astype(float)
        return whole._replace(kept=whole.of_cut(own).reshape(whole.kept.shape) > 0.5)

    def means(self, samples: NDArray[Any]) -> NDArray[Any]:
        """Means over the blocks of samples, shape (..., t, s), to (..., block)."""
        return self.of_cut(samples[..., self.cut, self.cut])

    def of_cut(self, samples: NDArray[Any]) -> NDArray[Any]:
        """Means of the samples that lie in blocks."""
        count = len(self.kept)
        blocks = samples.reshape(*samples.shape[:-2], count, self.size, count, self.size).mean((-3, -1))
        return np.asarray(blocks[..., self.kept])


class _Way(NamedTuple):
    """Way from a texture to what samples show of it, along disparities."""

    joint: _Joint
    shown: Spectra
    """Waves as samples show them, of some disparities."""
    parts: Samples | None = None
    """How far each place of the torus has each of these, (disparity, J, I); None of one all over."""
    slopes: Samples | None = None
    """How that changes as disparities go one step on."""

    @classmethod
    def along(cls, joint: _Joint, shown: Spectra, at: Array) -> _Way:
        """Along disparities at places between those of `shown`."""
        low = at.astype(np.intp)
        some = np.unique([low, low + 1])
        each = some[:, None, None]
        parts = np.clip(1 - np.abs(at - each), 0, 1).astype(np.float32)
        slopes = ((low + 1 == each).astype(np.float32) - (low == each)).astype(np.float32)
        return cls(joint, shown[some], parts, slopes)

    def _through(self, texture: Spectra, parts: Samples | None) -> Samples:
        if parts is None:
            return self.joint.at_lenses(self.shown[0] * texture)
        pieces = fft.rfft2(parts * fft.irfft2(texture, self.joint.torus))
        return self.joint.at_lenses(sum(one * piece for one, piece in zip(self.shown, pieces, strict=True)))

    def forward(self, texture: Spectra) -> Samples:
        """Samples of a texture."""
        return self._through(texture, self.parts)

    def moved(self, texture: Spectra) -> Samples:
        """How that changes as all disparities go one step on."""
        return self._through(texture, self.slopes)

    def back(self, samples: Samples) -> Spectra:
        """Adjoint of `forward`."""
        waves = self.joint.into_waves(samples)
        every = np.stack([np.einsum("nji,nji->ji", one.conj(), waves) for one in self.shown])
        if self.parts is None:
            return np.asarray(every[0])
        return np.asarray(fft.rfft2((self.parts * fft.irfft2(every, self.joint.torus)).sum(0)))
