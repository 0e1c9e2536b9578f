"""How fine a detail a camera shows: modulation transfer (MTF) of single views and of the refocused image.

An object point's wave fills the FAP, shape P, and comes to the array about its image; a microlens cuts d out of it and
shows it to pixels behind. A view takes one pixel of every microlens. As a function of where the object point is, that
pixel's light has the transfer, at the frequency nu on the array,

    ``integral over P's overlap with itself, lambda d_2 nu apart, of exp(2 pi i nu rho p') K(p', lambda d_2 nu) dp'``,

with P as the sensor sees it, p the pixel, rho the way that a point out of focus moves on the array per way on the
sensor, and K what the pixel adds up of ``g(p' + s/2) g*(p' - s/2)``, s the shift: g is the field that light from p' of
the microlens image makes in the pixel, through its microlens, in focus or not (beta), and through its neighbours. The
refocused image adds up all of a microlens's views, each moved by rho p: with ``t = lambda d_2 rho nu`` the MTF is then
a product of what the pupil, the microlens and the pixel pass,

    ``MTF(P, lambda d_2 nu) (1 - |t|/d) sinc((d - |t|) nu (1 - beta d_2 rho)) sinc(nu rho q)``.

Scalar, incoherent scene of one wavelength; as many places as one likes between microlenses: what sampling once a
microlens makes of detail beyond `fold` is not in it. Behind a real lens light is not moved by rho p' but as rays are
(`..traced.fields`); the refocused image moves its views by rho p all the same, what is left blurs it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array, magnitude, ratio
from ..camera import Camera, Number
from ..shapes.discs import Chords, chords
from .depth_of_field import Kind
from .exit_pupil import microlens_image_diameter
from .light import microlens_defocus

Direction = Literal["tangential", "sagittal"]

ROWS, NODES = 24, 24
"""Gauss-Legendre rows across a pupil's overlap, and places in each: transfers to 1e-3."""
MOST = 96
"""Of these where many blurs of the microlens lie in what a pixel's light comes from."""
FINE = 48
"""Places in the width of the microlens's blur at which K is tabulated."""
TAILS = 8.0
"""Widths of that blur about a pixel beyond which its light counts no more."""
ROUND = math.sqrt(3) / 2
"""Side of the square microlens that stands in for a round one in single views: its second moment over the diameter."""
PIXEL, NEIGHBOURS = 3, 3
"""Gauss-Legendre places along each side of a pixel; microlenses to each side whose light it gets as well."""
HALVINGS = 40
"""Of the frequency at which a transfer reaches a level."""
STEPS = 32
"""Steps of frequency between which a transfer is taken to bend little."""


def fold(c: Camera) -> Array:
    """Frequency on the array beyond which detail folds back as other detail, half a period a microlens [1/mm].

    Of a hexagonal array the least over all directions, ``1/(sqrt(3) d)``.
    """
    return np.asarray(ratio(1 / math.sqrt(3) if c.layout == "hexagonal" else 0.5, c.d))


def circle_transfer(shift: ArrayLike) -> Array:
    """Overlap of a disc with itself, shifted by a share of its diameter, over its area."""
    x = np.clip(np.abs(shift), 0.0, 1.0)
    return np.asarray(2 / math.pi * (np.arccos(x) - x * np.sqrt((1 - x) * (1 + x))))


class Lenslet(NamedTuple):
    """What a microlens and a pixel pass beside the pupil; numbers of one or of many builds."""

    width: Number
    distance: Number
    wavelength: Number
    defocus: Number
    """beta [1/mm]."""
    pixel: Number
    circular: bool

    @classmethod
    def of(cls, c: Camera) -> Lenslet:
        """A camera's."""
        round_lens = c.lens_shape == "circular"
        return cls(c.d, c.d_2, c.wavelength, -microlens_defocus(c) / c.d_2, c.q, round_lens)

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
        if self.circular:
            return np.asarray(self._round(t, bent) * self._pixels(rate * nu, axes))
        parts = []
        for share in map(abs, axes):
            left = self.width - share * t
            parts.append(left / self.width * np.sinc(left * share * bent))
        return np.asarray(parts[0] * parts[1] * self._pixels(rate * nu, axes))

    def _pixels(self, frequency: Array, axes: tuple[float, float]) -> Array:
        return np.asarray(np.sinc(frequency * self.pixel * axes[0]) * np.sinc(frequency * self.pixel * axes[1]))

    def _round(self, t: Array, frequency: Array) -> Array:
        """Two discs t apart: what their common part passes, column by column."""
        nodes, weights = np.polynomial.legendre.leggauss(24)
        half = (self.width - t)[..., None] / 2
        angle = (nodes + 1) * (math.pi / 4)
        x = half * np.sin(angle)
        chord = np.sqrt(np.maximum((half - x) * (half + x + t[..., None]), 0.0))
        light = chord * half * np.cos(angle) * np.cos(2 * math.pi * frequency[..., None] * x)
        return np.asarray((light * weights).sum(-1) * math.pi / (math.pi / 4 * np.square(self.width)))


def axial_limit(c: Camera, rate: Number, level: float) -> Array:
    """Frequency on the array at which the refocused image's MTF on the axis falls to a level [1/mm].

    Parameters
    ----------
    c : Camera
        Nothing but its FAP cuts the pupil.
    rate : float or ndarray
        rho of the plane refocused to.
    level : float
        Above 0 and below 1.
    """
    lens = Lenslet.of(c)
    diameter = magnitude(microlens_image_diameter(c))
    shape = np.broadcast_shapes(c.shape, np.shape(rate))
    reach = ratio(1.0, c.wavelength * c.d_2 / diameter)
    low, high = np.zeros(shape), np.broadcast_to(_end(lens, rate, reach), shape)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        passed = circle_transfer(middle / reach) * lens.refocused(rate, middle)
        above = passed > level
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.asarray((low + high) / 2)[()]


def _end(lens: Lenslet, rate: Number, reach: Number) -> Array:
    """A frequency up to which the refocused transfer falls all the way, and at which nothing is left."""
    bent = np.abs(1 - lens.defocus * lens.distance * rate)
    # Where (d - t) nu reaches the first zero, t growing with nu; nowhere where the overlap is gone before.
    shrink = np.abs(rate) * lens.wavelength * lens.distance
    zero = ratio(np.full(np.shape(bent), 1.22 if lens.circular else 1.0), bent)
    root = np.square(lens.width) - 4 * shrink * zero
    wide = np.where(root >= 0, ratio(2 * zero, lens.width + np.sqrt(np.maximum(root, 0.0))), np.inf)
    pixel, overlap = (ratio(1.0, np.abs(rate) * far) for far in (lens.pixel, lens.wavelength * lens.distance))
    overlap = overlap * lens.width
    return np.asarray(np.minimum(np.minimum(reach, wide), np.minimum(pixel, overlap)))


@dataclass(frozen=True, eq=False)
class FieldTransfer:
    """MTF at one field of one camera, for a plane of the scene."""

    camera: Camera
    """One build; its tilts and the array's rotation are left out."""
    centres: Array
    """Of the discs that stops cut out of the microlens image, shape (K, 2) [mm]."""
    radii: Array
    """Shape (K,) [mm]."""
    middle: tuple[float, float] | None
    """Where the view's pixel lies, the centroid of what is lit [mm]; None where it is dark."""
    rate: float
    """rho: way on the array per way on the sensor that a point of the plane moves from view to view."""
    along: float
    """Millimetres on the plane per millimetre on the array, along the field's radius."""
    across: float
    """The same across it."""
    way: tuple[float, float]
    """Unit vector of the field's radius; along x on the axis."""

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
        return self._refocused(nu, direction) if kind == "refocused" else self._view(nu, direction)

    def scale(self, direction: Direction) -> float:
        """Millimetres on the plane per millimetre on the array."""
        return self.along if direction == "tangential" else self.across

    def limits(self, levels: Sequence[float], kind: Kind, direction: Direction) -> list[float]:
        """Object frequencies at which the MTF first falls to levels [lp/mm], to 1e-3; nan where it is dark."""
        scale, lens = self.scale(direction), self._lens
        if self.middle is None or not 0 < scale < math.inf:
            return [math.nan if self.middle is None else ratio(1.0, scale).item()] * len(levels)
        reach = 2 * float(np.min(self.radii)) / float(lens.wavelength * lens.distance)
        # A square microlens ends waves along its diagonal last.
        end = 2 / float(lens.width) if kind == "view" else 2 * float(_end(lens, self.rate, reach))
        end = min(end, reach)
        top = min(end, self.softest)
        grid = np.linspace(0.0, top / scale, STEPS + 1)
        passed = self(grid, kind, direction)
        while passed.min() > min(levels) and top < end:
            top = min(2 * top, end)
            grid = np.linspace(0.0, top / scale, STEPS + 1)
            passed = self(grid, kind, direction)
        return [_falls(grid, passed, level) for level in levels]

    def fold(self, direction: Direction) -> float:
        """Object frequency beyond which detail folds back [lp/mm]."""
        return float(ratio(fold(self.camera), self.scale(direction)))

    @property
    def round(self) -> bool:
        """Whether a quarter turn changes nothing but the scale."""
        return len(self.radii) == 1

    @property
    def softest(self) -> float:
        """Frequency on the array beyond which a lens's aberrations may leave nothing [1/mm]: to be tried first."""
        return math.inf

    def axes(self, direction: Direction) -> tuple[float, float]:
        """Direction of the detail."""
        return self.way if direction == "tangential" else (-self.way[1], self.way[0])

    def _chords(self, axes: tuple[float, float], rows: int, between: tuple[float, float] | None = None) -> Chords:
        """Rows along the detail across what is lit, between two places across it [mm]."""
        return chords(self.centres @ turn(axes), self.radii, rows, between)

    def _moved(self, x: Array, y: Array, axes: tuple[float, float], shift: Array) -> Array:
        """Way on the array along the detail that light is moved by [mm].

        Of light that goes to the sensor's places ``x -+ shift`` along the detail and y across it, on average between.
        """
        return np.asarray(self.rate * x)

    def _refocused(self, nu: Array, direction: Direction) -> Array:
        axes = self.axes(direction)
        shift = float(self.camera.wavelength * self.camera.d_2) * nu[:, None]
        if self.round:
            whole = circle_transfer(shift[:, 0] / (2 * self.radii[0]))
            return np.asarray(np.abs(whole * self._lens.refocused(self.rate, nu, axes)))
        _, weight, left, right = self._chords(axes, ROWS)
        pupil = (weight * np.maximum(right - left - shift, 0.0)).sum(-1) / (weight * (right - left)).sum()
        return np.asarray(np.abs(pupil * self._lens.refocused(self.rate, nu, axes)))

    def _view(self, frequencies: Array, direction: Direction) -> Array:
        assert self.middle is not None
        nu, lens = np.append(0.0, frequencies), self._lens
        axes = self.axes(direction)
        shift = float(lens.wavelength * lens.distance) * nu[:, None] / 2
        # Only what the pixel and its blur reach.
        room = self._reach
        along, across = np.array(self.middle) @ turn(axes)
        # Fields turn once a blur width or so, also in the blur of defocus.
        turns = 2 * min(room, float(self.radii[0])) * float(lens.width / (lens.wavelength * lens.distance))
        more = min(MOST, math.ceil(2 * turns))
        y, weight, left, right = self._chords(axes, max(ROWS, more), (across - room, across + room))
        left, right = np.maximum(left + shift, along - room), np.minimum(right - shift, along + room)
        half = np.maximum(right - left, 0.0) / 2
        nodes, weights = np.polynomial.legendre.leggauss(max(NODES, more))
        x = ((left + right) / 2)[..., None] + half[..., None] * nodes
        light = (weight * half)[..., None] * weights
        moved = self._moved(x, y[:, None], axes, shift[..., None])
        if moved.any():
            light = light * np.exp(2j * math.pi * nu[:, None, None] * moved)
        if lens.circular:  # the square that stands in for it lies along the detail
            axes, middle = (1.0, 0.0), (float(along), float(across))
        else:
            middle = self.middle
        for k, (own, other, sign) in enumerate(((*axes, -1.0), (axes[1], axes[0], 1.0))):
            places = (x * own if own else 0.0) + (sign * other * y[:, None] if other else 0.0)
            light = light * self._seen(k, np.asarray(places) - middle[k], own * shift[..., None])
        total = np.abs(light.sum((1, 2)))
        return np.asarray(total[1:] / total[0])

    def _seen(self, axis: int, places: Array, shift: Array) -> NDArray[np.complexfloating[Any, Any]]:
        """K along an axis of the lattice, of places of the image, from the pixel, that are twice `shift` apart [mm]."""
        at, table = self._fields[axis]

        def read(where: Array) -> NDArray[np.complexfloating[Any, Any]]:
            index = np.clip((where - at[0]) / (at[1] - at[0]), 0, len(at) - 1.001)
            low = index.astype(int)
            part = (index - low)[None]
            return np.asarray(table[:, low] * (1 - part) + table[:, low + 1] * part)

        if not np.any(shift):
            field = read(places)
            return np.asarray((field.real**2 + field.imag**2).sum(0))
        return np.asarray((read(places - shift) * read(places + shift).conj()).sum(0))

    @cached_property
    def _fields(self) -> list[tuple[Array, NDArray[np.complexfloating[Any, Any]]]]:
        """Along each axis: places of the image, from the pixel, and the field that light from there makes in the pixel.

        At Gauss-Legendre places of the pixel, times the root of their weights; neighbours' fields with it where the
        array is a square one of square microlenses.
        """
        assert self.middle is not None
        lens, width = self._lens, float(self._lens.width) * (ROUND if self._lens.circular else 1.0)
        wave, distance, vergence = float(lens.wavelength), float(lens.distance), float(self.camera.vergence)
        alone = lens.circular or self.camera.layout == "hexagonal"
        spread, pitch, pixel = wave * distance, float(self.camera.d), float(lens.pixel)
        image_pitch = pitch * (1 + distance * vergence)
        reaching = float(ratio(TAILS * spread / width, abs(image_pitch)))
        farthest = 0 if alone else math.ceil(min(reaching, NEIGHBOURS))
        steps = list(range(-farthest, farthest + 1))
        reach = min(2 * float(self.radii[0]), self._reach)
        count = math.ceil(reach * width / spread * FINE)
        grid = np.linspace(-reach, reach, 2 * count + 1)
        sides, share = np.polynomial.legendre.leggauss(PIXEL)
        off = grid + (np.multiply(steps, image_pitch)[:, None, None] - sides[:, None] * pixel / 2)
        waves = self._behind(off, width)
        fields = []
        for axis in (0, 1):
            from_middle = self.middle[axis] - float(self.centres[0, axis])
            table = np.zeros((PIXEL, len(grid)), complex)
            for k, each in zip(steps, waves, strict=True):
                at = from_middle + sides[:, None] * pixel / 2
                away = at - k * pitch
                phase = away * away / distance + (k * pitch) ** 2 * vergence
                turn = 2 / spread * k * pitch * (grid + from_middle) + phase / wave
                table += each * np.exp(1j * math.pi * turn) * np.sqrt(share / 2)[:, None]
            fields.append((grid, table))
        return fields

    def _behind(self, off: Array, width: float) -> NDArray[np.complexfloating[Any, Any]]:
        """Field that a wave from the FAP makes behind a microlens, `off` the place where rays would meet the sensor."""
        spread = float(self._lens.wavelength * self._lens.distance)
        waves = math.pi * float(self._lens.defocus / self._lens.wavelength)
        if abs(waves) * width * width < 1e-3:
            return np.sinc(off * (width / spread)) + 0j
        reach = float(np.abs(off).max())
        at = np.linspace(-reach, reach, 2 * math.ceil(reach * width / spread * FINE) + 1)
        nodes, weights = np.polynomial.legendre.leggauss(
            24 + 2 * math.ceil(reach * width / spread + abs(waves) * width**2)
        )
        w = nodes * width / 2
        table = np.exp(2j * math.pi / spread * at[:, None] * w) @ (np.exp(-1j * waves * w * w) * weights / 2)
        return np.asarray(np.interp(off, at, table.real) + 1j * np.interp(off, at, table.imag))

    @cached_property
    def _reach(self) -> float:
        """How far from a pixel the light of its image comes from, by diffraction and defocus [mm]."""
        lens = self._lens
        blurs = TAILS * lens.wavelength * lens.distance / lens.width + lens.width * np.abs(lens.defocus) * lens.distance
        return float(lens.pixel + blurs)

    @cached_property
    def _lens(self) -> Lenslet:
        return Lenslet.of(self.camera)


def turn(axes: tuple[float, float]) -> Array:
    """Takes points, from the right, to their places along and across a direction, (2, 2)."""
    return np.array([[axes[0], -axes[1]], [axes[1], axes[0]]])


def _falls(at: Array, values: Array, level: float) -> float:
    """Where values, 1 at first, first fall to a level: along a parabola through three of them."""
    k = int(np.argmax(values <= level)) or len(values) - 1
    first = max(k - 2, 0)
    near, heights = at[first : first + 3], values[first : first + 3]
    bend, slope, base = np.polyfit(near - near[-1], heights, 2)
    roots = np.roots([bend, slope, base - level])
    inside = [x.real + near[-1] for x in roots if abs(x.imag) < 1e-12 and at[k - 1] <= x.real + near[-1] <= at[k]]
    if inside:
        return float(inside[0])
    share = (values[k - 1] - level) / (values[k - 1] - values[k])
    return float(at[k - 1] + share * (at[k] - at[k - 1]))
