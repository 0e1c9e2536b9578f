"""From a raw image to the light field L(s, t, u, v): sampled at every lattice centre, freed of vignetting, squared."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._jit import WHOLE, Band, kernel, prange
from .frames import MOST_SATURATED, Array, Frame, grey_frame, refuse_saturated, same_size
from .lattice import CentreLattice

Samples = NDArray[np.float32]
HALF = 0.5
"""Reach of samples [pitches]: those of images that do not overlap."""
DARKEST = 0.05
"""Light of the white image, against its brightest, under which a sample says nothing."""

TAPS = 2.0
"""Reach of cubic convolution [px]: samples are of pixels up to so far."""
TABLE = 1000
"""Steps a period in which what interpolation does to detail is tabulated: to 2e-5."""
SPLINE: Final = 5
"""Degree of the splines that make hexagonal rows square."""
CARRIED, FOLDS = 20, 3
"""Samples that rows are carried on beyond their ends for them, and periods a sample beside a wave that count in what
they leave of it."""


class _HexagonalRows(NamedTuple):
    """Samples of a hexagonal array where its microlenses stand, before they are interpolated to a square grid."""

    values: Samples
    """Shape (t, s, v, k): sample k of row v at u = ``starts[v] + k``."""
    weight: Samples
    """Weights as of `LightField`, of the same shape."""
    starts: Array
    """u of each row's first sample [microlens pitches]."""


@dataclass(frozen=True, eq=False)
class LightField:
    """Radiance by view and microlens.

    s, t count pixels from each microlens image's centre, along the array's rows and square to them, as its shadow lies
    on the sensor (t down the image); u, v count microlens pitches along the same directions. So Eq. 12 holds along
    (s, u) and along (t, v), whatever the array's rotation against the sensor.
    """

    values: Samples
    """Shape (t, s, v, u): the order of storage puts each view's picture last, rows first."""
    weight: Samples
    """Light that the white image has there, 1 at its brightest; 0 where nothing was measured. Shape (t, s, v, u)."""
    s: Array
    """[px]"""
    t: Array
    """[px]"""
    u: Array
    """[microlens pitches]; equal steps, of 1 for square arrays and sqrt(3)/2 for hexagonal ones made square."""
    v: Array
    """[microlens pitches]"""
    pitch: float
    """Microlens-image pitch on the sensor [px]."""
    hexagonal: _HexagonalRows | None = None
    """Rows of a hexagonal array; None of a square one."""
    between: Array | None = None
    """Shares of a pixel by which each microlens's samples lie beyond the pixels that they were interpolated from, along
    the array's rows and square to them, shape (2, v, u), or of a hexagonal array its rows'. None of what was not."""

    def __post_init__(self) -> None:
        shape = (len(self.t), len(self.s), len(self.v), len(self.u))
        if self.values.shape != shape or self.weight.shape != shape:
            raise ValueError(
                f"light field of shape {self.values.shape} and {self.weight.shape}, coordinates of {shape}"
            )

    def __repr__(self) -> str:
        views, size = f"{len(self.s)} x {len(self.t)}", f"{len(self.u)} x {len(self.v)}"
        return f"LightField({views} views of {size} microlenses, pitch {self.pitch:.3f} px)"

    def view(self, s: float = 0.0, t: float = 0.0) -> Samples:
        """The sub-aperture view nearest to (s, t) [px], shape (v, u)."""
        return np.asarray(self.values[np.abs(self.t - t).argmin(), np.abs(self.s - s).argmin()])

    def view_weight(self, s: float = 0.0, t: float = 0.0) -> Samples:
        """Weight of `view`, shape (v, u)."""
        return np.asarray(self.weight[np.abs(self.t - t).argmin(), np.abs(self.s - s).argmin()])

    def turned_over(self, along: int) -> LightField:
        """The light field with its pictures reversed along u (0) or v (1), and its views with them."""
        views, lenses = (1, 3) if along == 0 else (0, 2)
        hexagonal, between = self.hexagonal, self.between
        if between is not None:
            between = np.flip(between, lenses - 1).copy()
            between[along] = -between[along] % 1
        if hexagonal is not None:
            starts = hexagonal.starts[::-1] if along else 1 - hexagonal.starts - hexagonal.values.shape[3]
            samples, light = (np.flip(part, (views, lenses)) for part in (hexagonal.values, hexagonal.weight))
            hexagonal = _HexagonalRows(samples, light, starts)
        values, weight = (np.ascontiguousarray(np.flip(part, (views, lenses))) for part in (self.values, self.weight))
        axes = {name: -getattr(self, name)[::-1] for name in ("su" if along == 0 else "tv")}
        return replace(self, values=values, weight=weight, hexagonal=hexagonal, between=between, **axes)

    def position(self, column: Any, row: Any) -> tuple[Array, Array]:
        """Microlens coordinates (u, v) [pitches] of fractional columns and rows of a view."""
        du, dv = self._steps
        return self.u[0] + np.asarray(column, float) * du, self.v[0] + np.asarray(row, float) * dv

    @property
    def _steps(self) -> tuple[float, float]:
        """From column to column and from row to row [pitches]; 1 where there is one only."""
        du, dv = (float(axis[1] - axis[0]) if len(axis) > 1 else 1.0 for axis in (self.u, self.v))
        return du, dv

    def refocused(self, slope: float, every: int = 1) -> tuple[Samples, Samples]:
        """Shift and sum: the picture in which points of that epipolar slope (Eq. 12) are sharp, and its weight.

        Each view is read where such a point has moved to, (u + slope s, v + slope t), by cubic convolution (at the
        edge of what was measured linearly, or not at all), and counts by its weight.

        Parameters
        ----------
        slope : float
            Du/Ds [pitches per px], as of `theory.light_field.epi_slope`; below 0 for near points.
        every : int
            For a quicker look: of so many views along s and t, one is used.

        Returns
        -------
        ndarray, ndarray
            Mean value, 0 where nothing was measured, and the sum of weights, both of shape (v, u).
        """
        values, weight = (np.zeros((len(self.v), len(self.u)), np.float32) for _ in range(2))
        du, dv = self._steps
        t, s = (np.arange(len(axis) // 2 % every, len(axis), every) for axis in (self.t, self.s))
        shift_u, shift_v = slope * self.s[s] / du, slope * self.t[t] / dv
        lit = np.ascontiguousarray(self.weight)  # compiled once, however it was laid out
        _shift_and_sum.compiled(np.ascontiguousarray(self.values), lit, t, s, shift_v, shift_u, values, weight)
        return values, weight


def decode(
    raw: ArrayLike, lattice: CentreLattice, *, white: ArrayLike | None = None, dark: ArrayLike | None = None
) -> LightField:
    """Decode a raw image with the lattice of its microlens images.

    Each sample is interpolated (cubic convolution) at a whole number of pixels from a microlens image's fitted centre,
    out to half the pitch. With a white image, samples are divided by its light and dropped where it has too little.
    Hexagonal arrays are interpolated along their rows to a square grid of sqrt(3)/2 pitches.

    Parameters
    ----------
    raw : array_like
        Raw image, shape (rows, columns), or with channels, which are averaged.
    lattice : CentreLattice
        Of the microlens images, from `find_centres`.
    white, dark : array_like, optional
        White image and frame without light, same size.

    Raises
    ------
    CalibrationError
        Images missing, of different sizes, not finite, or a raw image with over 5 % of its pixels saturated.
    """
    frame = grey_frame(raw, dark, "raw image")
    return Decoder.of(lattice, frame.shape, white=white, dark=dark)(raw)


@dataclass(frozen=True, eq=False)
class Decoder:
    """Decodes the raw images of one camera: what they share is worked out once, and their `weight` is one array."""

    lattice: CentreLattice
    shape: tuple[int, int]
    """Shape of the raw images (rows, columns)."""
    dark: Frame | None
    rows: NDArray[np.int64]
    """Rows of the lattice that reach into the image."""
    starts: NDArray[np.int64]
    """Lattice index i of each row's first lens."""
    columns: NDArray[np.int64]
    """Lenses from there on."""
    gain: Samples
    """Factor on the samples, shape (t, s, rows, columns): 0 where nothing is measured."""
    light: Samples
    """Weight of each sample, of the same shape."""
    reach: float = HALF
    """Distance along each axis from a microlens image's centre to its farthest samples [pitches]."""

    @classmethod
    def of(
        cls,
        lattice: CentreLattice,
        shape: tuple[int, ...],
        *,
        white: ArrayLike | None = None,
        dark: ArrayLike | None = None,
        reach: float = HALF,
    ) -> Decoder:
        """Prepare for raw images of `shape` (rows, columns, ...); arguments and errors are those of `decode`."""
        size = (shape[0], shape[1])
        inside = lattice.inside(size)
        rows = np.arange(inside[:, 1].min(), inside[:, 1].max() + 1)
        # Hexagonal rows shift by half a pitch each: start them where the row enters the image, whole lenses apart.
        shift = 0.0 if lattice.layout == "square" else 0.5
        along = inside[:, 0] + shift * inside[:, 1]
        left = math.floor(along.min())
        starts = left - np.floor(shift * rows).astype(int)
        columns = np.arange(math.ceil(along.max()) - left + 1)
        black = None if dark is None else grey_frame(dark, None, "dark frame")
        none = np.zeros(0, np.float32)
        bare = cls(lattice, size, black, rows, starts, columns, none, none, reach)
        bright = np.ones(size, np.float32)
        if white is not None:
            bright = grey_frame(white, black, "white image")
            same_size("raw image", shape, "white image", bright.shape)
        level, lit = bare._sampled(bright)
        if white is not None:
            level /= np.float32(max(float(np.quantile(level[lit > 0][::16], 0.99)), 1e-30))
            lit *= level > DARKEST
        gain = np.divide(1, level, out=np.zeros_like(level), where=lit > 0)
        light = np.clip(level, 0, 1, out=level)
        light *= lit
        return replace(bare, gain=gain, light=light)

    def __call__(self, raw: ArrayLike) -> LightField:
        """Decode one image.

        Raises
        ------
        CalibrationError
            As `decode`.
        """
        frame = grey_frame(raw, self.dark, "raw image")
        same_size("raw image", frame.shape, "image prepared for", self.shape)
        refuse_saturated(raw, "raw image", MOST_SATURATED)
        values, _ = self._sampled(frame, with_mask=False)
        values *= self.gain
        weight, lattice, offsets = self.light, self.lattice, self._offsets
        hexagonal = None
        if lattice.layout == "square":
            u, step = self.starts[0] + self.columns.astype(float), 1.0
        else:
            step = math.sqrt(3) / 2
            first = self.starts + 0.5 * self.rows
            along = lattice.inside(self.shape) @ (1.0, 0.5)
            u = step * np.arange(math.ceil(along.min() / step), math.floor(along.max() / step) + 1)
            hexagonal = _HexagonalRows(values, weight, first)
            values, weight = squared(values, weight, u, first)
        v = step * self.rows.astype(float)
        return LightField(values, weight, offsets, offsets.copy(), u, v, lattice.pitch, hexagonal, self._between)

    @property
    def _offsets(self) -> Array:
        reach = math.floor(self.reach * self.lattice.pitch)
        return np.arange(-reach, reach + 1.0)

    @property
    def _nodes(self) -> Array:
        """Centres of the microlens images [px], shape (rows, columns, 2)."""
        return self.lattice.nodes(self.starts[:, None] + self.columns, self.rows[:, None])

    @property
    def _between(self) -> Array:
        """`LightField.between`; of an array that is turned against the sensor along the nearest of its axes."""
        cosine, sine = np.rint(np.asarray(self.lattice.first) / self.lattice.pitches[0])
        return np.asarray(np.moveaxis(self._nodes @ np.array([[cosine, -sine], [sine, cosine]]), -1, 0) % 1)

    def _sampled(self, image: Frame, with_mask: bool = True) -> tuple[Samples, Samples]:
        """Samples and, `with_mask`, whether they were inside the image, shape (t, s, rows, columns)."""
        nodes = self._nodes
        shape = (len(self._offsets), len(self._offsets), len(self.rows), len(self.columns))
        values, held = np.zeros(shape, np.float32), np.zeros(shape if with_mask else (0, 0, 0, 0), np.float32)
        along = np.asarray(self.lattice.first) / self.lattice.pitches[0]
        _gather.compiled(image, nodes, along, self._offsets, values, held)
        return values, held


@kernel()
def cubic_taps(part: Any) -> tuple[Any, Any, Any, Any]:
    """Weights of the samples 1 before, at, 1 and 2 after, for a place `part` of a step after a sample.

    Cubic convolution (a = -1/2): exact for quadratics, third order in the pixel. For numbers and arrays.
    """
    return (
        ((-0.5 * part + 1.0) * part - 0.5) * part,
        (1.5 * part - 2.5) * part * part + 1.0,
        ((-1.5 * part + 2.0) * part + 0.5) * part,
        (0.5 * part - 0.5) * part * part,
    )


def read_between(frequency: ArrayLike, between: Array) -> NDArray[np.complex128]:
    """Transfer at frequencies [1/px] of interpolation at shares of a pixel, shape (n,), beyond pixels: their mean."""
    frequency = np.asarray(frequency, float)
    at = np.arange(math.ceil(np.abs(frequency).max(initial=0.0) * TABLE) + 2)[:, None] / TABLE
    turned = np.exp(-2j * math.pi * at * between) @ np.stack(cubic_taps(between), -1)
    table = (turned * np.exp(2j * math.pi * at * (-1, 0, 1, 2))).sum(-1) / between.size
    passed = np.interp(np.abs(frequency), at[:, 0], table)
    return np.asarray(np.where(frequency < 0, passed.conj(), passed))


@kernel(parallel=True)
def _gather(
    image: Frame, nodes: Array, along: Array, offsets: Array, values: Samples, inside: Samples, band: Band = WHOLE
) -> None:
    rows, columns = image.shape
    count = offsets.shape[0]
    for v in prange(nodes.shape[0], band):  # by rows of lenses: the image's rows stay at hand
        for k in range(count * count):
            t, s = k // count, k % count
            dx = offsets[s] * along[0] - offsets[t] * along[1]
            dy = offsets[s] * along[1] + offsets[t] * along[0]
            for u in range(nodes.shape[1]):
                x, y = nodes[v, u, 0] + dx, nodes[v, u, 1] + dy
                column, row = math.floor(x), math.floor(y)
                if column < 1 or row < 1 or column > columns - 3 or row > rows - 3:
                    continue
                across, down = cubic_taps(x - column), cubic_taps(y - row)
                total = 0.0
                for b in range(4):
                    for a in range(4):
                        total += down[b] * across[a] * image[row - 1 + b, column - 1 + a]
                values[t, s, v, u] = total
                if inside.shape[0] > 0:
                    inside[t, s, v, u] = 1.0


@kernel()
def _taps(part: np.float32) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Weights of `cubic_taps`, in single precision."""
    a, b, c, d = cubic_taps(part)
    return np.float32(a), np.float32(b), np.float32(c), np.float32(d)


@kernel(apart=True)
def _mix_rows(
    first: Samples, top: Samples, below: Samples, last: Samples, taps: tuple[Any, Any, Any, Any], part: np.float32,
    linear: Samples, cubic: Samples,
) -> None:  # fmt: skip
    """A row between four, by linear and by cubic weights."""
    a, b, c, d = taps
    for u in range(linear.size):
        linear[u] = top[u] + part * (below[u] - top[u])
    for u in range(linear.size):
        cubic[u] = a * first[u] + b * top[u] + c * below[u] + d * last[u]


@kernel(apart=True)
def _least_of_rows(
    first: Samples, top: Samples, below: Samples, last: Samples, inside: bool, both: Samples, all_four: Samples
) -> None:
    """Least light of two rows, and of four where all are `inside`."""
    for u in range(both.size):
        both[u] = min(top[u], below[u])
    for u in range(both.size):
        all_four[u] = min(both[u], min(first[u], last[u])) if inside else np.float32(0)


@kernel(apart=True)
def _add_row(
    value: Samples, after: Samples, lit: Samples, lit_after: Samples, a: Samples, b: Samples, c: Samples, d: Samples,
    light_a: Samples, light_b: Samples, light_c: Samples, light_d: Samples, held: Samples, part: np.float32,
    taps: tuple[Any, Any, Any, Any], mean: Samples, total: Samples,
) -> None:  # fmt: skip
    """Sum of views with a row more, `part` of a sample aside: by four samples where all have light, else by two."""
    k, l, m, n = taps
    zero = np.float32(0)
    for u in range(mean.size):
        least = min(min(light_a[u], light_b[u]), min(light_c[u], light_d[u]))
        cubic = k * a[u] + l * b[u] + m * c[u] + n * d[u]
        mixed = cubic if least > zero else value[u] + part * (after[u] - value[u])
        lights = min(lit[u], lit_after[u]) > zero
        mean[u] += held[u] * mixed if lights else zero
        total[u] += held[u] if lights else zero


@kernel(parallel=True)
def _shift_and_sum(
    values: Samples,
    weight: Samples,
    t: NDArray[np.int64],
    s: NDArray[np.int64],
    down: Array,
    right: Array,
    mean: Samples,
    total: Samples,
    band: Band = WHOLE,
) -> None:
    _, _, rows, columns = values.shape
    for v in prange(rows, band):
        # Of one view: its rows about y, mixed by cubic and by linear weights, and the least weight among them.
        # Beside the sides none of four samples has light.
        cubic, linear = np.zeros(columns + 4, np.float32), np.zeros(columns, np.float32)
        all_four, both = np.zeros(columns + 4, np.float32), np.zeros(columns, np.float32)
        for b in range(t.shape[0]):
            y = v + down[b]
            top = math.floor(y)
            part = np.float32(y - top)
            below = top if part == 0.0 else top + 1
            if top < 0 or below > rows - 1:
                continue
            first, last = (top, top) if part == 0.0 else (top - 1, top + 2)
            inside = first >= 0 and last <= rows - 1
            first, last = max(first, 0), min(last, rows - 1)
            rows_by = _taps(part)
            near_y = top if part < 0.5 else below
            for a in range(s.shape[0]):
                view, light = values[t[b], s[a]], weight[t[b], s[a]]
                _mix_rows(view[first], view[top], view[below], view[last], rows_by, part, linear, cubic[2:-2])
                _least_of_rows(light[first], light[top], light[below], light[last], inside, both, all_four[2:-2])
                shift = math.floor(right[a])
                part_x = np.float32(right[a] - shift)
                after = 0 if part_x == 0.0 else 1
                near_x = 0 if part_x < 0.5 else 1
                start = max(0, -shift)
                stop = max(start, min(columns, columns - shift - after))
                left = start + shift
                _add_row(
                    linear[left:], linear[left + after :], both[left:], both[left + after :], cubic[left + 2 - after :],
                    cubic[left + 2 :], cubic[left + 2 + after :], cubic[left + 2 + 2 * after :],
                    all_four[left + 2 - after :], all_four[left + 2 :], all_four[left + 2 + after :],
                    all_four[left + 2 + 2 * after :], light[near_y, left + near_x :], part_x, _taps(part_x),
                    mean[v, start:stop], total[v, start:stop],
                )  # fmt: skip
        for u in range(columns):
            if total[v, u] > 0.0:
                mean[v, u] /= total[v, u]


def squared(values: Samples, light: Samples, u: Array, starts: Array) -> tuple[Samples, Samples]:
    """Hexagonal rows interpolated at u (all in pitches); row v's samples stand at ``starts[v] + 0, 1, 2, ...``.

    By splines, which leave the finest detail that microlenses show as they find it: four taps took half of it away
    midway between them.
    """
    from scipy import ndimage
    from scipy.interpolate import BSpline

    columns, basis = values.shape[-1], BSpline.basis_element(np.arange(SPLINE + 2) - (SPLINE + 1) / 2)
    out, held = (np.zeros((*values.shape[:-1], len(u)), np.float32) for _ in range(2))
    sides = [(0, 0)] * (values.ndim - 2) + [(CARRIED, CARRIED)]
    for v, start in enumerate(starts):
        base = np.floor(u - start).astype(int)
        part = u - start - base
        taps = np.stack([base - 1, base, base + 1, base + 2])
        usable = (taps >= 0) & (taps < columns)
        held_by = light[..., v, :][..., np.clip(taps, 0, columns - 1)] * usable
        before, at, after, beyond = np.moveaxis(held_by > 0, -2, 0)
        whole = at & after & (before | beyond)
        row, lit = (np.pad(part[..., v, :].astype(float), sides) for part in (values, light))
        _carry.compiled(row.reshape(-1, row.shape[-1]), lit.reshape(-1, row.shape[-1]) > 0, CARRIED)
        spline = ndimage.spline_filter1d(row, SPLINE)
        base = np.clip(base, -1, columns - 1) + CARRIED
        reach = range(-(SPLINE // 2), SPLINE // 2 + 2)
        value = sum(basis(part - k) * spline[..., base + k] for k in reach)
        out[..., v, :] = np.where(whole, value, 0)
        held[..., v, :] = np.where(whole, np.where(part < 0.5, held_by[..., 1, :], held_by[..., 2, :]), 0)
    return out, held


def left_by_rows(frequency: Array) -> Array:
    """Share of waves along hexagonal rows [periods a pitch] that `squared` leaves, on average."""
    passed = [np.abs(np.sinc(frequency - n)) ** (SPLINE + 1) for n in (0, *range(-FOLDS, 0), *range(1, FOLDS + 1))]
    return np.asarray(passed[0] / sum(passed))


@kernel()
def _carry(rows: Any, lit: Any, reach: int) -> None:
    """Put samples that are not lit, up to `reach` beside some, on the parabola through the nearest three; (n, columns).

    Like the nearest where fewer than three stand together.
    """
    count, columns = rows.shape
    for n in range(count):
        for u in range(columns):
            if lit[n, u]:
                continue
            for k in range(1, reach + 1):
                side = 0
                if u + k < columns and lit[n, u + k]:
                    side = 1
                if u - k >= 0 and lit[n, u - k]:
                    side = -1
                if side == 0:
                    continue
                first, second, third = u + side * k, u + side * (k + 1), u + side * (k + 2)
                rows[n, u] = rows[n, first]
                if 0 <= third < columns and lit[n, second] and lit[n, third]:
                    bent = (k + 2) * rows[n, first] / 2 + k * rows[n, third] / 2
                    rows[n, u] = (k + 1) * bent - k * (k + 2) * rows[n, second]
                break
