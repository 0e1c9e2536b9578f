"""Views in phase: where the phases of each view's light at the texture's waves say that it looks from."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import WHOLE, Band, kernel, prange
from ..calibration.decoding import LightField
from ..shapes.lattice import PACKINGS
from ..theory.colours import panchromatic
from ..theory.image_parts import ImageParts, waves_shown
from ..theory.stop_images import MicrolensImages
from .mixing import LEAST, ROUNDS, SURE, Mixing
from .nodes import COARSE, NodeMap
from .unmixing import SENT, SHARED, PreparedViews, ViewLight, aside_by_cuts, light_shares, reading
from .warping import fill_holes

WAVES = 13
"""Waves along a side of the grid that views are compared by, two more for each pitch but one that any looks aside, and
of views that share light for each pitch but one of disparity: turned by neighbours' light, the finest turn faster."""
DISPARITIES, MOST_DISPARITIES = 0.5, 12
"""Steps of disparity between which places are interpolated [pitches], half as large of views that share light, and how
many of them at most."""
FADING, DARK_WAVE, MOST_GAIN, FAINT_WAVE = 0.8, 0.1, 3.0, (0.2, 0.5)
"""Filters of views: share of the finest detail that the array shows from which on they fade out; share of a wave that
views must show; by how much they change it at most; and what a view shows of it, against all, from and up to which they
fade in."""
MOST_FILTERS = 300_000
"""Filters, of samples at places of the field and disparities, at most."""
MOST_PLACES = 50_000_000
"""Samples up to which each has a place of its own."""
UNUSED = 1e12
"""Square of the distance at which nodes count where a view is not used [microlenses^2]."""
FOCUSED = 1.0
"""Disparity, with aberrations, up to which the mean of a microlens's sure samples tells well enough what it sends for
samples of less than `SURE` to be used [pitches]."""


@dataclass(frozen=True, eq=False)
class PhasedViews:
    """Views of a camera, in phase."""

    light: ViewLight
    _phases: dict[tuple[int, int, bool], _Phases] = dataclass_field(default_factory=dict)
    """By nodes and waves along each axis, as they are asked for."""

    def in_phase(
        self, views: PreparedViews, disparity: NDArray[np.float64], least: float, shared: bool = False
    ) -> PreparedViews | None:
        """Views taken to look from where the phase of their light says; None where that makes no difference.

        A texture of f periods a pitch at disparity B has nu = f B periods across the FAP. A view shows it turned by the
        phase that its light has at nu: the mean place where nu is small, farther out where it is not, as the light of
        outer views is skew; and what is wrong with the light taken off as neighbours' turns it as well. Both follow,
        wave by wave, from taking neighbours' light off what microlenses show of single waves. Most of it is a place to
        look from: how fast what a view shows moves with disparity, about that of each microlens, and what is left aside
        of that. Filters take the rest out of the views, which then show all waves as strongly as each other, too.

        Parameters
        ----------
        views : PreparedViews
            Their own light as of `without_crosstalk`, by mean places; or as a real lens has these.
        disparity : ndarray, shape (v, u)
            Found with them [pitches].
        least : float
            Error of those, on average, that makes no difference [pitches].
        shared : bool
            Whether views are those of `with_shared`, and disparities were found in phase.
        """
        low, high = (float(np.quantile(disparity, part)) for part in (0.01, 0.99))
        least_step = DISPARITIES / (1 + shared)
        step = least_step * math.ceil(max(1.0, (high - low) / MOST_DISPARITIES / least_step) - 1e-9)
        counted = range(math.floor(low / step) - 1, math.ceil(high / step) + 2)
        samples = len(counted) * self.light.parts[2].light[0, 0].size
        most = min(COARSE, max(2, int(math.sqrt(MOST_FILTERS / samples))))
        aside = np.zeros_like(views.pupil) if views.aside is None else views.aside
        far = float(np.abs(aside if aside.ndim == 3 else np.where(views.field.weight > 0, aside, 0)).max())
        far = max(far, max(-low, high) * shared)
        side = WAVES + 2 * max(0, round(far) - 1)
        # What noise makes of the range of disparities asks for no other nodes and waves.
        alike = (
            key for key in self._phases
            if key[2] == shared and abs(key[0] - most) <= 1 and abs(key[1] - side) <= 2 * shared
        )  # fmt: skip
        key = next(alike, (most, side, shared))
        if key not in self._phases:
            self._phases[key] = _Phases.of(self.light, *key)
        phases = self._phases[key]
        rows, columns, freed = phases.rows, phases.columns, phases.freed
        offset, kernels = phases.at([step * k for k in counted])
        nodes, disparities = rows.size * columns.size, step * np.array(counted)
        slope = np.diff(offset, axis=0) / step
        rest = offset[:-1] - disparities[:-1, None, None, None] * slope
        # By mean places disparities come out wrong, by so much.
        lever = freed.weight * freed.pupil
        told = np.einsum("davn,avn->d", offset, lever) / max(float((lever * freed.pupil).sum()), 1e-12)
        count = disparities.size
        at = np.interp(disparity, np.maximum.accumulate(disparities + told * (not shared)), np.arange(count))
        if not shared and np.abs(np.interp(at, np.arange(count), told)).mean() < least:
            return None
        over_view = NodeMap.of_views(rows, columns, disparity.shape)
        below = np.minimum(at.astype(int), count - 2)
        if below.size * freed.usable.size > MOST_PLACES:
            below = np.full_like(below, int(np.median(below)))

        def spread(values: NDArray[np.float64]) -> NDArray[np.float32]:
            every = np.zeros((*values.shape[:2], *freed.usable.shape, nodes))
            every[:, :, freed.usable] = values
            if nodes == 1 and not np.ptp(below):
                return every[below[0, 0], ..., 0].astype(np.float32)
            if nodes == 1:
                return np.moveaxis(every[below, ..., 0], (0, 1), (-2, -1)).astype(np.float32)
            out = np.zeros((*every.shape[1:-1], *below.shape), np.float32)
            for k in np.unique(below):
                out = np.where(below == k, _as_seen_aside(views.field, over_view(every[k]), aside), out)
            return out

        near = [
            np.stack([np.interp(np.arange(n), nodes, one) for one in np.eye(nodes.size)])
            for nodes, n in ((rows, at.shape[0]), (columns, at.shape[1]))
        ]
        field = _filtered(views.field, freed.usable, kernels, at, near)
        if not shared and (away := _out_of_focus(views, aside, disparity) > FOCUSED).any():
            sure = np.zeros((*freed.usable.shape, nodes))
            sure[freed.usable] = freed.sure
            field = replace(field, weight=np.where(away & (over_view(sure) < 0.5), 0, field.weight))
        return PreparedViews(field, _sum(views.pupil, spread(slope)), _sum(aside, spread(rest)))


def _out_of_focus(
    views: PreparedViews, aside: NDArray[np.floating], disparity: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Disparity that an ideal lens's views with these places would spread by as these do, shape (v, u) [pitches]."""
    lit = views.field.weight > 0
    pupil, aside = (part if part.ndim == 5 else part[..., None, None] for part in (views.pupil, aside))
    spreads = []
    for look in (pupil, aside + disparity * pupil):
        at = np.where(lit, look, 0)
        spreads.append((at**2).sum((0, 1, 2)) - (at.sum((1, 2)) ** 2).sum(0) / np.maximum(lit.sum((0, 1)), 1))
    return np.asarray(np.sqrt(np.maximum(spreads[1], 0) / np.maximum(spreads[0], 1e-12)))


class _Phases(NamedTuple):
    """Waves as views show them against where their mean places do, at some microlenses."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    freed: _FreedWaves
    waves: _Waves
    nearest: NDArray[np.intp]
    """Node that stands for each where a view is not used, the nearest where it is, shape (view, node)."""
    worked_out: dict[float, tuple[NDArray[np.float64], NDArray[np.float32]]]
    """By disparity, as they are asked for."""

    @classmethod
    def of(cls, light: ViewLight, most: int, side: int, shared: bool = False) -> _Phases:
        """At so many nodes along each axis, at most, by so many waves."""
        rows, columns, parts = light.parts
        # Behind a real lens what neighbours' light shows bends over the field as images grow.
        counts = light.nodes.few if light.real is None else (rows.size, columns.size)
        few, some = (
            np.unique(np.linspace(0, at.size - 1, min(at.size, most, count)).round().astype(np.intp))
            for at, count in zip((rows, columns), counts, strict=True)
        )
        nodes = (few[:, None] * columns.size + some).ravel()
        parts = ImageParts(parts.steps, *(part[:, nodes] for part in parts[1:]))
        freed = _FreedWaves.of(light, rows[few], columns[some], parts, shared)
        at = np.stack(np.meshgrid(rows[few], columns[some], indexing="ij"), -1).reshape(-1, 2)
        away = ((at[:, None] - at) ** 2).sum(-1) + np.where(freed.gain > 0, 0, UNUSED)[:, None]
        waves = _Waves.of(side, light.like, PACKINGS[light.camera.layout].fold)
        return cls(rows[few], columns[some], freed, waves, away.argmin(-1), {})

    def at(self, disparities: list[float]) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """How far views look past their mean places [pitches], shape (disparity, axis, view, node), and filters."""
        new = [b for b in disparities if b not in self.worked_out]
        for b, shown in zip(new, self.freed.shown(self.waves.k, np.array(new)) if new else (), strict=True):
            off = self.waves.moved(shown)
            taps = self.waves.filters(shown, off)[self.nearest.T, np.arange(len(self.nearest))]
            self.worked_out[b] = np.take_along_axis(off, self.nearest[None], 2), taps
        offsets, kernels = zip(*(self.worked_out[b] for b in disparities), strict=True)
        return np.stack(offsets), np.stack(kernels)


def _as_seen_aside(field: LightField, past: NDArray[np.float32], aside: NDArray[np.floating]) -> NDArray[np.float32]:
    """Places past mean ones, shape (2, t, s, v, u), where microlenses look that see what these do, `aside` of them."""
    if aside.ndim == 3:
        return past
    axes = zip((field.u, field.v), (-1, -2), aside, strict=True)
    return np.asarray(past + sum(np.gradient(past, axis[1] - axis[0], axis=k) * far for axis, k, far in axes))


def _sum(one: NDArray[np.floating], other: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sum of arrays of views, shape (2, t, s), or (2, t, s, v, u)."""
    most = max(one.ndim, other.ndim)
    one, other = (part if part.ndim == most else part[..., None, None] for part in (one, other))
    return np.asarray(one + other, np.float32)


class _FreedWaves(NamedTuple):
    """Waves as views show them once neighbours' light was taken off as `without_crosstalk` does it."""

    light: ViewLight
    images: MicrolensImages
    usable: NDArray[np.bool_]
    """Views that have own light at any node, shape (t, s)."""
    gain: NDArray[np.float64]
    """Reciprocal of the own share of light, 0 where samples are dropped; shape (view, node)."""
    sure: NDArray[np.float64]
    """1 where that tells what the microlens sends others, else 0; likewise."""
    mixing: Mixing
    pupil: NDArray[np.float64]
    """Mean places on the FAP, shape (2, view, node)."""
    aside: NDArray[np.float64]
    """As of `ViewLight.looks`, likewise."""
    weight: NDArray[np.float64]
    """Light that tells, shape (view, node)."""
    shared: bool
    """Whether neighbours' light is what a picture shows of it, as `with_shared` takes it, not what samples tell."""

    @classmethod
    def of(
        cls, light: ViewLight, rows: NDArray[np.intp], columns: NDArray[np.intp], parts: ImageParts, shared: bool
    ) -> _FreedWaves:
        """Waves at microlenses of some rows and columns of views."""
        camera = panchromatic(light.camera)
        images = MicrolensImages(camera, light.places[np.ix_(rows, columns)].reshape(-1, 2))
        own = parts.steps.index((0, 0))
        total, shares = parts.light.sum(0), light_shares(parts.light)
        least, known = (SHARED, SENT) if shared else (LEAST, SURE)
        usable = light.sharing[0] if shared else (shares[own] > LEAST).any(0)
        share = shares[own][:, usable].T
        sure = (share > known) * 1.0
        gain = np.divide(sure.any(0), share, out=np.zeros_like(share), where=share > least)
        mixing = Mixing.of(parts, shares, own, usable, None, light.beside(images.fields, parts), known)
        pupil = light.side * np.stack([axis[own][:, usable].T for axis in (parts.x, parts.y)])
        still = aside_by_cuts(light.camera, light.like, parts.light[own])[:, usable]
        weight = np.where(gain > 0, total[:, usable].T * share**2, 0.0)
        return cls(light, images, usable, gain, sure, mixing, pupil, still, weight, shared)

    def _raw(
        self, waves: NDArray[np.float64], disparities: NDArray[np.float64]
    ) -> Iterator[tuple[NDArray[np.complex128], NDArray[np.float64]]]:
        """Waves with neighbours' light (W, node, view), and where views look (2, view, node); of each disparity."""
        field, real = self.light.like, self.light.real
        if real is not None:
            for raw, where in real.shown(field, self.images.fields, waves, disparities):
                yield raw[..., self.usable], where[..., self.usable].swapaxes(1, 2) + self.aside
            return
        s, t = field.s / field.pitch, field.t / field.pitch
        every = waves_shown(self.images, s, t, waves, self.light.side * disparities, reading(field))
        for raw, disparity in zip(every[..., self.usable], disparities.tolist(), strict=True):
            yield raw, disparity * self.pupil + self.aside

    def shown(self, waves: NDArray[np.float64], disparities: NDArray[np.float64]) -> Iterator[NDArray[np.complex128]]:
        """Waves, shape (W, 2), as views show them against where their mean places do, shape (W, view, node)."""
        ways, way = np.unique(self.mixing.step, axis=0, return_inverse=True)
        turns = np.exp(2j * math.pi * (ways @ PACKINGS[self.images.camera.layout].steps.T @ waves.T))
        sure = np.ones_like(self.sure.T) if self.shared else self.sure.T.copy()
        shares, rounds = np.ascontiguousarray(self.mixing.share.T), 1 if self.shared else ROUNDS
        for raw, where in self._raw(waves, disparities):
            to_middle, own = np.exp(2j * math.pi * np.tensordot(waves, where, 1)), raw * self.gain.T
            values = _apart(to_middle.conj().T if self.shared else np.moveaxis(own, 0, -1))
            _free_waves.compiled(
                _apart(np.moveaxis(raw, 0, -1)), self.gain.T.copy(), sure, self.mixing.first, self.mixing.source,
                way.ravel(), _apart(turns), shares, rounds, values,
            )  # fmt: skip
            shown = (values[:, :, 0] + 1j * values[:, :, 1]).T * to_middle
            if self.shared:  # neighbours send as much of a wave as the picture shows
                alone = own.swapaxes(1, 2) * to_middle
                sent = alone - shown
                shown = alone - _settled(alone, sent) * sent
            yield shown


class _Waves(NamedTuple):
    """Waves that views are compared by, on a grid of their frequencies, one of each with its mirror image."""

    k: NDArray[np.float64]
    """Periods a pitch along u and v, shape (W, 2)."""
    on_grid: NDArray[np.intp]
    """Place of each on the grid, from its middle, shape (W, 2)."""
    side: int
    """Waves along a side of the grid."""
    passed: NDArray[np.float64]
    """Share of its phase that is taken out of a wave: none where the lattice folds it."""

    @classmethod
    def of(cls, side: int, field: LightField, fold: float) -> _Waves:
        half = side // 2
        index = np.array([(x, y) for y in range(half + 1) for x in range(-half, half + 1) if (y, x) > (0, 0)], np.intp)
        steps = np.array([field.u[1] - field.u[0], field.v[1] - field.v[0]])
        k = index / (side * steps)
        fine = np.hypot(*k.T) / fold
        inside = fine < 1
        return cls(k[inside], index[inside], side, np.clip((1 - fine[inside]) / (1 - FADING), 0, 1))

    def moved(self, shown: NDArray[np.complex128]) -> NDArray[np.float64]:
        """How far views look past where their mean places do [pitches], shape (2, view, node).

        By the phases of all waves, of a texture with the same contrast in every octave, as they come through.
        """
        level = np.angle(shown)
        power = np.where(self.passed > 0.8, (np.abs(shown) ** 2).mean(1).T / (self.k**2).sum(-1), 0.0)
        normal = np.einsum("nw,wa,wb->nab", power, self.k, self.k) * (2 * math.pi)
        told = np.einsum("nw,wa,wvn->nav", power, self.k, level)
        off = -np.linalg.solve(normal + 1e-12 * np.eye(2), told)
        return np.asarray(np.moveaxis(off, 0, -1))

    def filters(self, shown: NDArray[np.complex128], off: NDArray[np.float64]) -> NDArray[np.float32]:
        """Taps, shape (node, view, N, N), that make views alike which look `off` [pitches] past their mean places.

        `shown` has the shape (W, view, node), `off` (2, view, node).
        """
        size, mean = np.abs(shown), _strength(shown)
        gain = np.clip(mean / np.maximum(size, 1e-9), 1 / MOST_GAIN, MOST_GAIN)
        shows = np.clip((size / np.maximum(mean, 1e-9) - FAINT_WAVE[0]) / (FAINT_WAVE[1] - FAINT_WAVE[0]), 0, 1)
        passed = self.passed[:, None, None] * (mean > DARK_WAVE) * shows
        turn = np.angle(shown * np.exp(2j * math.pi * np.tensordot(self.k, off, 1)))
        factor = np.exp(passed * (np.log(np.maximum(gain, 1e-9)) - 1j * turn)).T
        grid, (x, y) = np.ones((*factor.shape[:2], self.side, self.side // 2 + 1), np.complex64), self.on_grid.T
        ahead, behind = x >= 0, x <= 0
        grid[..., y[ahead], x[ahead]] = factor[..., ahead]
        grid[..., -y[behind], -x[behind]] = factor[..., behind].conj()
        return np.asarray(np.fft.fftshift(np.fft.irfft2(grid, (self.side, self.side)), (-2, -1)), np.float32)


def _strength(shown: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Rms of waves, shape (W, view, node), over the views that show them."""
    size = np.abs(shown)
    return np.asarray(np.sqrt((size**2).sum(1, keepdims=True) / np.maximum((size > 0).sum(1, keepdims=True), 1)))


def _settled(alone: NDArray[np.complex128], sent: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Strength x of waves, shape (W, view, node), in a picture that shows what is left once x `sent` is taken off.

    As `_strength` has it: x^2 = <|alone - x sent|^2>; at most `MOST_GAIN` times that of `alone`, as none settles where
    neighbours send more than a microlens has, turned the other way.
    """
    some = np.maximum((np.abs(alone) > 0).sum(1, keepdims=True), 1)
    own, both, other = (
        (one * two.conj()).real.sum(1, keepdims=True) / some
        for one, two in ((alone, alone), (alone, sent), (sent, sent))
    )
    root = np.sqrt(np.maximum(both**2 + own * (1 - other), 0))
    return np.asarray(own / np.maximum(both + root, np.maximum(np.sqrt(own) / MOST_GAIN, 1e-12)))


def _filtered(
    field: LightField, usable: NDArray[np.bool_], kernels: NDArray[np.float32], at: NDArray[np.float64],
    near: list[NDArray[np.float64]],
) -> LightField:  # fmt: skip
    """Views by filters, those of the nodes and disparities about each microlens by how near they are.

    Parameters
    ----------
    field : LightField
    usable : ndarray, shape (t, s)
    kernels : ndarray, shape (disparity, node, view, N, N)
    at : ndarray, shape (v, u)
        Place among the disparities.
    near : list of ndarray, shapes (rows of nodes, v), (columns of nodes, u)
        Weights of the nodes.
    """
    from scipy import fft

    values, noise = np.zeros_like(field.values), np.zeros_like(field.values)
    reach = kernels.shape[-1] // 2
    views, (at_t, at_s) = field.values[usable], np.nonzero(usable)
    fill_holes.compiled(views, field.weight[usable])
    padded = np.pad(views, ((0, 0), (reach, reach), (reach, reach)), mode="symmetric")
    for node, (row, column) in enumerate(itertools.product(*near)):
        (top, bottom), (left, right) = (np.flatnonzero(line)[[0, -1]] for line in (row, column))
        here = np.s_[top : bottom + 1, left : right + 1]
        part = np.multiply.outer(row, column)[here]
        shape = [fft.next_fast_len(n + 2 * reach, real=True) for n in part.shape]
        inside: Any = (..., *(slice(2 * reach, 2 * reach + n) for n in part.shape))
        shares = [np.clip(1 - np.abs(at[here] - k), 0, 1) * part for k in range(len(kernels))]
        for t in np.unique(at_t):
            row_of = at_t == t
            some = (t, at_s[row_of], *here)
            sent = fft.rfft2(padded[row_of, top : bottom + 1 + 2 * reach, left : right + 1 + 2 * reach], shape)
            for taps, share in zip(kernels[:, node, row_of], shares, strict=True):
                if share.any():
                    values[some] += share * fft.irfft2(sent * fft.rfft2(taps, shape), shape)[inside]
                    noise[some] += share * (taps**2).sum((1, 2), keepdims=True)
    lit = field.weight > 0
    weight = np.divide(field.weight, noise, out=np.zeros_like(field.weight), where=lit & (noise > 0))
    return replace(field, values=np.where(weight > 0, values, 0), weight=weight)


def _apart(waves: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Real and imaginary parts of waves (..., W) one after the other, shape (..., 2, W)."""
    parts = np.empty((*waves.shape[:-1], 2, waves.shape[-1]))  # one layout, whatever theirs
    parts[..., 0, :], parts[..., 1, :] = waves.real, waves.imag
    return parts


@kernel(parallel=True)
def _free_waves(
    raw: Any, gain: Any, sure: Any, first: Any, source: Any, way: Any, turns: Any, shares: Any, rounds: int, out: Any,
    band: Band = WHOLE,
) -> None:  # fmt: skip
    """Waves without what neighbours put into samples, which show them turned; all (node, view, part, wave)."""
    nodes, views, _, count = raw.shape
    for i in prange(nodes, band):
        before, mean, foreign = np.empty((views, 2, count)), np.empty((2, count)), np.empty((2, count))
        # Sample by sample: whole arrays at once would be compiled several times as long.
        for _ in range(rounds):
            known = 0
            for part in range(2):
                for k in range(count):
                    mean[part, k] = 0.0
            for n in range(views):
                if sure[i, n] > 0:
                    known += 1
                    for part in range(2):
                        for k in range(count):
                            mean[part, k] += out[i, n, part, k]
            for n in range(views):
                for part in range(2):
                    for k in range(count):
                        before[n, part, k] = out[i, n, part, k] if sure[i, n] > 0 else mean[part, k] / max(known, 1)
            for n in range(views):
                real, imaginary = foreign[0], foreign[1]
                for k in range(count):
                    real[k], imaginary[k] = 0.0, 0.0
                for m in range(first[n], first[n + 1]):
                    share = shares[i, m]
                    if share != 0:
                        turn, other = turns[way[m]], before[source[m]]
                        for k in range(count):
                            real[k] += share * (turn[0, k] * other[0, k] - turn[1, k] * other[1, k])
                            imaginary[k] += share * (turn[0, k] * other[1, k] + turn[1, k] * other[0, k])
                for part in range(2):
                    for k in range(count):
                        out[i, n, part, k] = (raw[i, n, part, k] - foreign[part, k]) * gain[i, n]
