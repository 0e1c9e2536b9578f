"""Resolution: modulation transfer (MTF) of single views and of the refocused image.

An object point's wave fills the FAP, shape P, and comes to the array about its image; a microlens cuts d out of it and
shows it to pixels behind. A view takes one pixel of every microlens. As a function of where the object point is, that
pixel's light has the transfer, at the frequency nu on the array,

    ``integral over P's overlap with itself, s apart, of exp(2 pi i nu rho p') K(p', s) dp'``,  ``s = lambda d_2 nu``,

with P as the sensor sees it, p the pixel, rho the way that a point out of focus moves on the array per way on the
sensor, and K what the pixel adds up of ``g(p' - s/2) g*(p' + s/2)``: g is the field that light from p' of the microlens
image makes in the pixel, through its microlens, in focus or not (beta), and through all others. Those make K a wave in
p' but for a factor that repeats itself with the images' pitch: by Poisson's formula the integral is a sum over the
frequencies k of a lattice, of

    ``P_s(nu rho + k) Q(k) exp(-2 pi i k p) A(k, nu)``,

with P_s the Fourier transform of that overlap, Q that of the pixel, and A what a microlens, and pairs of them, pass
(`..theory.transfer.pair_transfer`). Diffraction ends the sum; no light is left out where images overlap, and no phase
that turns fast is sampled. The refocused image adds up all of a microlens's views, each moved by rho p: with
``t = lambda d_2 rho nu`` the MTF is then a product of what the pupil, the microlens and the pixel pass,

    ``MTF(P, lambda d_2 nu) (1 - |t|/d) sinc((d - |t|) nu (1 - beta d_2 rho)) sinc(nu rho q)``.

On a veil both are `photometry.contrast_left` times that, at every frequency above 0.

Scalar, incoherent scene of one wavelength; as many places as one likes between microlenses: what sampling once a
microlens makes of detail beyond `fold` is not in it. Behind a real lens light is not moved by rho p' but as rays are
(`..traced.fields`); the refocused image moves its views by one rho p all the same, that which leaves least blur.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array, Complex, magnitude, ratio
from ..bore.opening import disc_overlap
from ..camera import Camera, Number
from ..shapes.lattice import PACKINGS
from ..shapes.openings import Openings
from .depth_of_field import Kind
from .exit_pupil import microlens_image_diameter, microlens_image_pitch
from .lens_shapes import LENS_SHAPES, LensShape
from .light import diffraction_width, independent_views, microlens_defocus
from .photometry import contrast_left
from .stop_images import MicrolensImages
from .transfer import MicrolensTransfer, pair_line, pair_transfer, pixel_box

Direction = Literal["tangential", "sagittal"]

ROWS = 32
"""Gauss-Legendre rows across a pupil's overlap, and places in each, at least; one more a radian of phase."""
TURNS = {"square": 64, "circular": 32}
"""Periods across what blurs, the pupil's image, the pixel or a microlens out of focus, up to which its edges count; by
the microlenses' shape."""
INTERFERING = {"square": (64, 3), "circular": (8, 2)}
"""Independent views across a pitch up to which light through two microlenses counts, and how many steps apart they lie
at most: fields of round ones fall off faster."""
HALVINGS = 40
"""Halvings of the stretch in which a transfer reaches a level."""
STEPS = 12
"""Steps of frequency, over which a transfer's waves turn once or twice: cubics between four of them are like it."""
PARTS = 8
"""Parts of a step that are looked at, so that none is passed over in which the transfer falls and rises."""
AT_ONCE = 2
"""Steps taken before looking whether the least level is reached."""
CLOSE = 1e-4
"""Distance to a level from where on a cubic's place of it is right."""
GRAZING = 0.01
"""Largest error of cubics over whole steps, where the transfer comes near to a level."""
MOST_CLOSER = 6
"""Places tried so, at most."""


def fold(c: Camera) -> Array:
    """Frequency on the array beyond which detail folds back as other detail, half a period a microlens [1/mm].

    Of a hexagonal array the least over all directions, ``1/(sqrt(3) d)``.
    """
    return np.asarray(ratio(PACKINGS[c.layout].fold, c.d))


def sparse(count: int) -> int:
    """Number of nodes at least as large, of few kinds: sets of nodes are made once."""
    return -(-count // 8) * 8 if count < 128 else -(-count // 64) * 64


class _Lenslet(NamedTuple):
    """Transfer of a microlens and a pixel beside the pupil; numbers of one or of many builds."""

    width: Number
    distance: Number
    wavelength: Number
    defocus: Number
    """beta [1/mm]."""
    pixel: Number
    shape: LensShape

    @classmethod
    def of(cls, c: Camera) -> _Lenslet:
        """A camera's."""
        shape = LENS_SHAPES[c.lens_shape]
        return cls(c.d, c.seen.d_2, c.wavelength, -microlens_defocus(c) / c.seen.d_2, c.q, shape)

    def refocused(self, rate: Number, frequency: ArrayLike, axes: tuple[float, float] = (1.0, 0.0)) -> Array:
        """Its part of the refocused image's transfer, which all broadcasts.

        Parameters
        ----------
        rate : float or ndarray
            rho.
        frequency : array_like
            On the array [1/mm].
        axes : pair of float
            Direction of the detail, against the lattice's x and y.
        """
        nu = np.asarray(frequency)
        t = np.minimum(np.abs(self.wavelength * self.distance * rate * nu), self.width)
        bent = nu * (1 - self.defocus * self.distance * rate)
        return np.asarray(self.shape.overlap(self.width, t, bent, axes) * self._pixels(rate * nu, axes))

    def _pixels(self, frequency: Array, axes: tuple[float, float]) -> Array:
        return np.asarray(np.sinc(frequency * self.pixel * axes[0]) * np.sinc(frequency * self.pixel * axes[1]))


def axial_limit(c: Camera, rate: Number, level: float, at: Number | None = None) -> Array:
    """Frequency on the array at which the refocused image's MTF on the axis falls to a level [1/mm].

    Parameters
    ----------
    c : Camera
        Its tilts are left out; of the FAP counts what stops leave of it for the microlens in the array's middle.
    rate : float or ndarray
        rho of the plane refocused to.
    level : float
        Above 0 and below 1.
    at : float or ndarray, optional
        Its distance ahead of the tip [mm]; None is the focal plane.
    """
    lens, wanted = _Lenslet.of(c), level / contrast_left(c, at)
    diameter = magnitude(microlens_image_diameter(c))
    shape = np.broadcast_shapes(c.shape, np.shape(rate))
    reach = ratio(1.0, c.wavelength * c.seen.d_2 / diameter)
    low, high = np.zeros(shape), np.broadcast_to(_end(lens, rate, reach), shape)
    pupil, openings, limits = c.fap.outline.sized(reach), MicrolensImages(c, [(0.0, 0.0)]).openings.at(0), []
    cut = np.broadcast_to((openings.least_rooms[..., 1:] < 0).any(-1).reshape(c.shape), shape)
    builds = np.broadcast_to(np.arange(openings.radii[..., 0].size).reshape(c.shape), shape)[cut]
    left = openings.at(np.unravel_index(builds, openings.radii.shape[:-1]))
    spread = np.broadcast_to(c.wavelength * c.seen.d_2, shape)[cut]
    for way in ((1.0, 0.0), (0.0, 1.0)) if cut.any() else pupil.ways:  # the softer one counts
        least, most = low, high
        for _ in range(HALVINGS):
            middle = (least + most) / 2
            passed = pupil.overlap(middle, *way)
            if builds.size:
                passed = np.array(np.broadcast_to(passed, shape))
                passed[cut] = left.overlap(np.multiply.outer(middle[cut] * spread, way))
            above = passed * lens.refocused(rate, middle, way) > wanted
            least, most = np.where(above, middle, least), np.where(above, most, middle)
        limits.append(np.where(wanted < 1, (least + most) / 2, 0.0))
    return np.asarray(np.minimum(limits[0], limits[-1]))[()]


def _end(lens: _Lenslet, rate: Number, reach: Number) -> Array:
    """A frequency up to which the refocused transfer falls all the way, and at which nothing is left."""
    bent = np.abs(1 - lens.defocus * lens.distance * rate)
    # Where (d - t) nu reaches the first zero, t growing with nu; nowhere where the overlap is gone before.
    shrink = np.abs(rate) * lens.wavelength * lens.distance
    zero = ratio(np.full(np.shape(bent), lens.shape.dark), bent)
    root = np.square(lens.width) - 4 * shrink * zero
    wide = np.where(root >= 0, ratio(2 * zero, lens.width + np.sqrt(np.maximum(root, 0.0))), np.inf)
    pixel, overlap = (ratio(1.0, np.abs(rate) * far) for far in (lens.pixel, lens.wavelength * lens.distance))
    overlap = overlap * lens.width
    return np.asarray(np.minimum(np.minimum(reach, wide), np.minimum(pixel, overlap)))


@dataclass(frozen=True, eq=False)
class FieldTransfer:
    """MTF at one field of one camera, for a plane of the scene."""

    camera: Camera
    """One build; the array's rotation and tilts, but for those of further stops, are left out."""
    openings: Openings
    """Openings that stops cut out of the microlens image [mm]."""
    middle: tuple[float, float] | None
    """Place of the view's pixel, the centroid of what is lit [mm]; None where it is dark."""
    rate: float
    """rho: way on the array per way on the sensor that a point of the plane moves from view to view."""
    along: float
    """Millimetres on the plane per millimetre on the array, along the field's radius."""
    across: float
    """Millimetres on the plane per millimetre on the array, across the field's radius."""
    way: tuple[float, float]
    """Unit vector of the field's radius; along x on the axis."""
    contrast: float
    """Share of the contrast that the veil leaves there."""

    def __call__(self, frequency: ArrayLike, kind: Kind, direction: Direction) -> Array:
        """MTF at frequencies of the object [lp/mm], shape (N,).

        Parameters
        ----------
        frequency : array_like, shape (N,)
            From 0.
        kind : {"view", "refocused"}
        direction : {"tangential", "sagittal"}
            Of the detail's waves: along the field's radius or across it.
        """
        nu = np.asarray(frequency, float) * self.scale(direction)
        if self.middle is None:
            return np.full(nu.shape, np.nan)
        return np.abs(self._complex(nu, kind, direction)) * np.where(nu > 0, self.contrast, 1.0)

    def _complex(self, nu: Array, kind: Kind, direction: Direction) -> Complex:
        """Transfer at frequencies on the array [1/mm], shape (N,)."""
        return self._refocused(nu, direction) if kind == "refocused" else self._view(nu, direction)

    def scale(self, direction: Direction) -> float:
        """Millimetres on the plane per millimetre on the array."""
        return self.along if direction == "tangential" else self.across

    def limits(self, levels: Sequence[float], kind: Kind, direction: Direction) -> list[float]:
        """Object frequencies at which the MTF first falls to levels [lp/mm], to 1e-3; nan where it is dark."""
        scale, lens = self.scale(direction), self._lens
        if self.middle is None or not 0 < scale < math.inf:
            return [math.nan if self.middle is None else ratio(1.0, scale).item()] * len(levels)
        levels = [level / self.contrast for level in levels]
        reach = self._width / float(lens.wavelength * lens.distance)
        end = reach if kind == "view" else min(reach, 2 * float(_end(lens, self.rate, reach)))
        top = min(end, self.softest, 2 / self._spread if kind == "view" else math.inf)
        grid, passed = np.linspace(0.0, top / scale, STEPS + 1), np.zeros(0, complex)
        while not len(passed) or np.abs(passed).min() > min(levels):
            if len(passed) == len(grid):
                if top >= end:
                    break
                first, top = top, min(2 * top, end)
                grid = np.append(grid, np.linspace(first / scale, top / scale, STEPS + 1)[1:])
            more = grid[len(passed) : len(passed) + AT_ONCE]
            passed = np.append(passed, self._complex(more * scale, kind, direction))
        grid = grid[: len(passed)]
        return [self._fall(grid, passed, level, kind, direction) if level < 1 else 0.0 for level in levels]

    def limits_each_way(self, levels: Sequence[float], kind: Kind) -> tuple[list[float], list[float]]:
        """`limits` of tangential and of sagittal detail."""
        tangential = self.limits(levels, kind, "tangential")
        if self.round and 0 < self.along < math.inf:
            return tangential, [limit * self.along / self.across for limit in tangential]
        return tangential, self.limits(levels, kind, "sagittal")

    def _fall(self, grid: Array, passed: Complex, level: float, kind: Kind, direction: Direction) -> float:
        """Object frequency at which the transfer, known on a grid, first falls to a level [lp/mm]."""
        for _ in range(MOST_CLOSER):
            limit, dip = _falls(grid, passed, level)
            tried = limit if math.isnan(dip) else dip
            if tried in grid:
                return limit
            value = self._complex(np.array([tried * self.scale(direction)]), kind, direction)
            k = int(np.searchsorted(grid, tried))
            grid, passed = np.insert(grid, k, tried), np.insert(passed, k, value)
            if tried == limit and abs(abs(value.item()) - level) < CLOSE:
                break
        return _falls(grid, passed, level)[0]

    def fold(self, direction: Direction) -> float:
        """Object frequency beyond which detail folds back [lp/mm]."""
        return float(ratio(fold(self.camera), self.scale(direction)))

    @property
    def round(self) -> bool:
        """Whether a quarter turn changes nothing but the scale."""
        return self.openings.total == 1 and self.openings.first_is_disc

    @property
    def softest(self) -> float:
        """Frequency on the array beyond which a lens's aberrations may leave nothing [1/mm]: to be tried first."""
        return math.inf

    def axes(self, direction: Direction) -> tuple[float, float]:
        """Direction of the detail."""
        return self.way if direction == "tangential" else (-self.way[1], self.way[0])

    def _refocused(self, nu: Array, direction: Direction) -> Complex:
        axes = self.axes(direction)
        whole: Array | Complex
        if self.round:
            whole = disc_overlap(nu * float(self.camera.wavelength * self.camera.seen.d_2) / self._width)
        else:
            whole = np.array([self._overlap(each, np.array(axes)) for each in nu.tolist()]) / self._area
        return np.asarray(whole * self._lens.refocused(self.rate, nu, axes))

    def _overlap(self, nu: float, axes: Array) -> complex:
        """Integral over the pupil's overlap with itself [mm^2]."""
        zero = np.zeros(1)
        return complex(self._spectrum(nu, axes, zero, zero, zero)[0, 0])

    @cached_property
    def _area(self) -> complex:
        """Area of the pupil [mm^2]."""
        return self._overlap(0.0, np.array(self.way))

    def _view(self, frequencies: Array, direction: Direction) -> Complex:
        axes = np.array(self.axes(direction))
        passed = [self._passed(nu, axes) / self._total for nu in frequencies.tolist()]
        return np.array(passed, complex).reshape(frequencies.shape)

    @cached_property
    def _total(self) -> complex:
        """Light of the view's pixel where the scene is even."""
        return self._passed(0.0, np.array(self.way))

    def _passed(self, nu: float, axes: Array) -> complex:
        """Light of the view's pixel where the scene is a wave of a frequency on the array [1/mm]."""
        assert self.middle is not None
        along, up, steps, order = self._orders(nu, axes)
        if not order.size:
            return 0j
        waves = np.stack(np.broadcast_arrays(along, up + steps[:, None]), -1)
        at = waves - nu * self.rate * axes
        soft = np.clip(2 * np.hypot(waves[..., 0], waves[..., 1]) * self._width / self._most - 1, 0.0, 1.0)
        light = self._spectrum(nu, axes, along, up, steps) * np.cos(math.pi / 2 * soft) ** 2
        light *= pixel_box(at, self.camera.q).prod(-1) * np.exp(-2j * math.pi * (at @ self.middle))
        return complex((light * self._lenses(at, order, nu * axes)).sum())

    def _lenses(self, at: Array, order: NDArray[np.int64], detail: Array) -> Array:
        """Transfer of microlenses at frequencies of the lattice (M, N, 2) and these orders, of detail on the array."""
        if self._microlens.shape.round or PACKINGS[self.camera.layout].slant:
            return self._paired(at.reshape(-1, 2), order.reshape(-1, 2), detail, self._pairs).reshape(at.shape[:2])
        lens, (_, farthest) = self._microlens, INTERFERING["square"]
        steps = np.arange(-farthest, farthest + 1) if len(self._pairs) > 1 else np.arange(1)
        lines = []
        for axis, row in ((1, np.s_[:, 0]), (0, np.s_[0, :])):
            apart, vergence = np.asarray(float(self.camera.d) * steps[:, None], float), float(self.camera.seen.vergence)
            part = pair_line(lens, lens.wavelengths[0], at[row][:, axis], apart, vergence, detail[axis])
            lines.append(np.where(order[row][:, axis] * steps[:, None] % 2, -part, part).sum(0))
        return np.asarray(np.multiply.outer(*lines))

    def _paired(self, at: Array, order: NDArray[np.int64], detail: Array, pairs: Sequence[NDArray[np.int64]]) -> Array:
        lens, passed, steps = self._microlens, np.zeros(len(at)), np.array(pairs)
        apart = float(self.camera.d) * (steps @ PACKINGS[self.camera.layout].steps.T)
        reached = lens.wavelengths[0] * lens.sensor_distance * at
        pair, near = np.nonzero((np.abs(reached - apart[:, None]) < lens.width).all(-1))
        part = pair_transfer(lens, at[near], apart[pair], float(self.camera.seen.vergence), detail)
        np.add.at(passed, near, np.where((order[near] * steps[pair]).sum(-1) % 2, -part, part))
        return passed

    def _orders(self, nu: float, axes: Array) -> tuple[Array, Array, Array, NDArray[np.int64]]:
        """Frequencies at which the pupil's transform is asked for [1/mm], and their orders in the lattice.

        Columns of the same frequency along x, shape (N,), where each begins along y, and steps from there, (M,); orders
        (M, N, 2).
        """
        camera, lens, period = self.camera, self._microlens, self._period
        moved, paired = nu * self.rate * axes, len(self._pairs) > 1
        ends = [(-moved, self._most / self._width), (0.0 * axes, self._most / float(camera.q))]
        ends.append((0.0 * axes, self._farthest * lens.width / (lens.wavelengths[0] * lens.sensor_distance)))
        bend = lens.defocus * lens.sensor_distance
        if bend != 0 and not paired:
            ends.append((-nu * axes / bend, self._most / abs(lens.width * bend)))
        # Detail on the array, as its microlenses' images repeat it.
        first = nu * float(camera.d) / math.copysign(period, float(microlens_image_pitch(camera))) * axes
        low = np.max([(middle - half - first) * period for middle, half in ends], axis=0)
        high = np.min([(middle + half - first) * period for middle, half in ends], axis=0)
        packing = PACKINGS[camera.layout]
        slant, rise = packing.slant, packing.rise
        columns = np.arange(math.ceil(low[0]), math.floor(high[0]) + 1)
        rows = np.arange(math.ceil(low[1] * rise), math.floor(high[1] * rise) + 2)
        start = np.floor(slant * columns).astype(int)
        order = np.stack(np.broadcast_arrays(columns, start + rows[:, None]), -1)
        begin = first + moved
        up = begin[1] + (start - slant * columns) / (rise * period)
        return begin[0] + columns / period, up, rows / (rise * period), order

    def _spectrum(self, nu: float, axes: Array, along: Array, up: Array, steps: Array) -> Complex:
        """Transform of the pupil's overlap with itself at such frequencies, shape (M, N)."""
        apart = np.multiply.outer([-0.5, 0.5], nu * float(self.camera.wavelength * self.camera.seen.d_2) * axes)
        pair = self.openings.moved(apart[0]).beside(self.openings.moved(apart[1]))
        y, weight, left, right = pair.chords(sparse(self._rows(up, steps)))
        half = (right - left) / 2
        light = (2 * half * weight) * np.sinc(2 * along[:, None] * half)
        light = light * np.exp(2j * math.pi * (along[:, None] * (left + right) / 2 + up[:, None] * y))
        return np.asarray(np.exp(2j * math.pi * steps[:, None] * y) @ light.T)

    def _rows(self, up: Array, steps: Array) -> int:
        """So many as phases along y turn in radians, and more; faster ones than `_passed` counts need none."""
        turns = self._width * float(np.abs(up + steps[:, None]).max(initial=0.0))
        return ROWS + math.ceil(math.pi * min(turns, self._most))

    @cached_property
    def _spread(self) -> float:
        """Width on the array of the light of a point that a view sees, at most or so [mm]."""
        lens, camera = self._microlens, self.camera
        pitch = float(microlens_image_pitch(camera))
        blur = float(camera.q + diffraction_width(camera)) + lens.width * lens.sensor_distance * abs(lens.defocus)
        spread = lens.width + abs(self.rate) * min(blur, self._width)
        if self._width > abs(pitch):  # of several microlenses
            spread += self._width * abs(self.rate + float(ratio(camera.d, pitch)))
        return spread

    @property
    def _most(self) -> int:
        return TURNS[self.camera.lens_shape]

    @cached_property
    def _width(self) -> float:
        """Width of the pupil's image [mm]."""
        return max(float(self.openings.spans.min()), 1e-9 * float(self.camera.d))

    @cached_property
    def _microlens(self) -> MicrolensTransfer:
        lens = self._lens
        width, distance, defocus = float(lens.width), float(lens.distance), float(lens.defocus)
        return MicrolensTransfer(width, distance, defocus, (float(lens.wavelength),), self.camera.lens_shape)

    @cached_property
    def _pairs(self) -> list[NDArray[np.int64]]:
        """Steps from one microlens to another whose light interferes with its own; of itself first."""
        views, farthest = INTERFERING[self.camera.lens_shape]
        reach = np.arange(-farthest, farthest + 1) if float(independent_views(self.camera)) < views else [0]
        pairs = [np.array([i, j]) for i in reach for j in reach]
        return sorted(pairs, key=lambda pair: float(np.abs(pair).sum()))

    @cached_property
    def _farthest(self) -> int:
        """Most steps along an axis between such microlenses, or 1."""
        return max(int(pair.max()) for pair in self._pairs) or 1

    @cached_property
    def _period(self) -> float:
        """Period of the images, or less where they stand alone and their light does not come so far [mm]."""
        lens = self._microlens
        apart = max(abs(float(microlens_image_pitch(self.camera))), 1e-6 * self._width)
        if len(self._pairs) > 1:
            return apart
        blur = float(self.camera.q) + lens.width * lens.sensor_distance * abs(lens.defocus)
        return min(apart, self._width + blur / 2 + 2 * float(diffraction_width(self.camera)))

    @cached_property
    def _lens(self) -> _Lenslet:
        return _Lenslet.of(self.camera)


def _falls(at: Array, values: Complex, level: float) -> tuple[float, float]:
    """Where values, 1 at first, first fall to a size: along cubics through four of them; the last where they do not.

    Also where, before, they come so near to it that they may do so there; else nan.
    """
    below = np.flatnonzero(np.abs(values) <= level)
    last = int(below[0]) if below.size else len(at) - 1
    k = np.arange(last)[:, None]
    four = np.clip(k - 1, 0, max(len(at) - 4, 0)) + np.arange(min(len(at), 4))
    fine = at[k] + (at[k + 1] - at[k]) * np.arange(PARTS + 1) / PARTS
    size = np.abs(_between(at[four][:, None], values[four][:, None], fine))
    size[:, -1] = np.abs(values[1 : last + 1])  # rounding apart
    fallen = np.flatnonzero(size.ravel() <= level)
    row, part = divmod(int(fallen[0]) if fallen.size else size.size - 1, PARTS + 1)
    path = size[: row + 1, :-1].ravel()
    dips = np.flatnonzero((path[1:-1] < path[:-2]) & (path[1:-1] < path[2:]) & (path[1:-1] < level + GRAZING)) + 1
    dips = dips[(dips % PARTS > 0) & (dips < row * PARTS + part)]
    dip = float(fine[:, :-1].ravel()[dips[0]]) if dips.size else math.nan
    if not fallen.size:
        return float(at[-1]), dip
    finer = np.linspace(fine[row, max(part - 1, 0)], fine[row, part], PARTS**2 + 1)
    size = np.abs(_between(at[four[row]], values[four[row]], finer))
    n = int(np.argmax(size <= level)) if size.min() <= level else len(finer) - 1
    share = (size[n - 1] - level) / (size[n - 1] - size[n]) if n and size[n] < size[n - 1] else 1.0
    return float(finer[max(n - 1, 0)] + min(share, 1.0) * (finer[n] - finer[max(n - 1, 0)])), dip


def _between(at: Array, values: Complex, place: Array) -> Complex:
    """Polynomials through values (..., K) at places along x, at other places (..., N)."""
    rows = [values[..., n] for n in range(at.shape[-1])]
    for step in range(1, len(rows)):
        for n in range(len(rows) - step):
            one, other = at[..., n], at[..., n + step]
            rows[n] = ((place - one) * rows[n + 1] - (place - other) * rows[n]) / (other - one)
    return np.asarray(rows[0])
