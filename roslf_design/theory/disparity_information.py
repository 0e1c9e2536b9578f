"""Information of disparity that microlens images have: sums over their pixels and a texture's waves.

For a wave of kappa periods per pitch neighbours' light in a pixel comes with its own phase, out of focus B turns phases
over the FAP, and the light A of one microlens in each pixel and its first moment become ``sum over microlenses k of
exp(2 pi i kappa k) A(p - k)``: by Poisson's formula a Fourier sum over one cell of the lattice, finite because
diffraction bounds it. The waves of the texture's spectrum add up to the information of B.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, Complex, magnitude, ratio
from ..camera import Number
from ..shapes.lattice import PACKINGS
from ..shapes.openings import Openings
from .exit_pupil import microlens_image_diameter, microlens_image_pitch
from .lens_shapes import LENS_SHAPES
from .light import microlens_defocus
from .photometry import NOTHING, Beside, dark_variance, electrons, response
from .stop_images import MicrolensImages
from .transfer import pixel_box

ROWS = 64
"""Gauss-Legendre rows across a cut microlens image, at least: fine detail and far defocus take one more a radian."""
SHARPEST = 8
"""Periods of the finest detail that diffraction passes, in one pitch, beyond which information is extrapolated in its
inverse: that grows as the blur shrinks, nearly in proportion. Right to 1 %."""
TABLED, MIDPOINTS, FARTHEST = 128, 16, 255.0
"""Places in a unit of z at which Bessel functions are tabled; angles that they take, and one more in four units; z
beyond which SciPy's are asked, as tables would fill the memory."""
FULL, FULL_SIGMAS = 5e-3, 2.576
"""Share of pixels that is let be full, and beyond how many standard deviations it lies."""
FEW = 500_000
"""Values whose shares of a normal distribution are told without SciPy."""
FOLDED, GOLDEN, FOLDS, FINEST_FOLDED = 128, (math.sqrt(5) - 1) / 2, 3, 2.0
"""Waves too fine for the lattice that are looked at; by how much of half a turn each follows the one before, so that
they lie evenly; steps of the reciprocal lattice, either way, that they fold by; and periods in a pitch from which on
microlenses leave next to nothing of them."""
VALUES, CACHED = 2**15, 2**14
"""Values of waves' images at a time: as many as stay at hand of the processor."""


class Seen(NamedTuple):
    """A plane of the scene, as disparity errors depend on it."""

    disparity: Array
    """B there [microlens pitches]; 0 is the focal plane."""
    scale: Array
    """Millimetres on it per millimetre of the array."""
    at: Number | None = None
    """Distance ahead of the tip that its light is of [mm]; None is the focal plane."""


class Spectrum(NamedTuple):
    """Spectrum of a texture at some waves, each with its mirror image; shape (..., W), leading axes broadcast."""

    x: Array
    """kappa along the lattice's x [periods per microlens pitch]."""
    y: Array
    power: Array
    """Variance of contrast, as single views show it."""

    @property
    def folded(self) -> Spectrum:
        """One of each two waves, shape (W,), that a mirror along a diagonal or an axis turns into each other."""
        low, high = np.sort(np.abs([self.x, self.y]), axis=0)
        _, first, again = np.unique(np.round([low, high], 12), axis=1, return_index=True, return_inverse=True)
        return Spectrum(low[first], high[first], np.asarray(np.bincount(again, self.power), float))


class Texture(NamedTuple):
    """Spectra that differ in how fine and how strong they are, and in nothing else."""

    fine: Array
    """Unit of the waves' frequencies [periods per microlens pitch], shape (...)."""
    strength: Array
    """Unit of the waves' power, shape (...)."""
    waves: Spectrum
    """Shape (W,)."""
    lens_shape: str | None = None
    """Shape of the microlenses whose width is yet to blur the waves; None: they are as single views show them."""

    def at(self, index: NDArray[np.intp]) -> Texture:
        """Some of them."""
        return self._replace(fine=self.fine[index], strength=self.strength[index])

    @property
    def as_views_show(self) -> Spectrum:
        """Spectrum as single views show it, shape (..., W)."""
        x, y = (self.fine[..., None] * part for part in self.waves[:2])
        power = self.strength[..., None] * self.waves.power
        return Spectrum(
            x, y, power if self.lens_shape is None else power * LENS_SHAPES[self.lens_shape].blur(x, y) ** 2
        )


Transforms = tuple[Array | Complex, Array | Complex, Array | Complex]


class ArrayKind(NamedTuple):
    """Kind of microlens array: what its images depend on beside lengths."""

    layout: str
    lens_shape: str


class ImageRows(NamedTuple):
    """Many microlens images in one row; lengths in mm."""

    width: Array
    distance: Array
    wavelength: Array
    defocus: Array
    pixel: Array
    light: Array
    dark: Array
    """Variance without own light, over `shot` [electrons^2]; as the next two, of each image in each of M noises."""
    uneven: Array
    """Squared share of brightness that pixels differ by, over `shot`; shape (N, M)."""
    shot: Array
    """Variance per electron of own light: above 1 where views differ by a share of a veil, too; shape (N, M)."""
    room: Array
    """Electrons of light that pixels hold, in each of the noises; inf where all of them hold theirs, shape (N, M)."""
    contrast: Array
    """Rms share by which a texture's brightness differs from its mean."""
    pitch: Array
    bend: Array
    """B over the image's diameter, in pitches."""
    wide: Array
    """Width of the whole image, between the FAP's rims [pitches]."""
    openings: Openings
    """Openings that stops cut out, from the FAP's centre, along the lattice [pitches]; one axis of N."""
    texture: Texture

    def at(self, index: NDArray[np.intp]) -> ImageRows:
        """Some of them."""
        some: Any = [*(value[index] for value in self[:-2]), self.openings.at(index), self.texture.at(index)]
        return ImageRows(*some)

    @property
    def own_shape(self) -> tuple[Array, ...]:
        """Numbers that `_opening_of` makes the first opening of: logarithms of its sizes, and its turn."""
        if self.openings.first_is_disc:
            return (np.log(2 * self.openings.radii[:, 0]),)
        corners = self.openings.corners[:, self.openings.polygons.index(0)]
        along, across = corners[:, 0] - corners[:, 1], corners[:, 0] - corners[:, 3]
        sides = (np.log(np.hypot(*side.T)) for side in (along, across))
        return *sides, np.arctan2(along[:, 1], along[:, 0])

    @property
    def whole(self) -> NDArray[np.bool_]:
        """True for those that no stop but the FAP cuts."""
        return np.asarray(self.openings.least_rooms[:, 1:].min(1, initial=1.0) >= 0)

    def filling(self, rise: float) -> NDArray[np.bool_]:
        """True where so many neighbours' images may lie on each other that they fill pixels; shape (N,)."""
        with np.errstate(invalid="ignore"):
            most = np.ceil(self.wide) * np.ceil(self.wide / rise)
            most = np.where(overlapping(self.wide, rise, self.openings.first_is_disc) > FULL, most, 1.0)
            light = (most * self.light)[:, None]
            return np.asarray((self.room - light < FULL_SIGMAS * self._spread(light[..., None])[..., 0]).any(1))

    def variance(self, light: Array) -> Array:
        """Variance of pixels that hold so many electrons of light, shape (N, 1, ...), in each noise (N, M, ...)."""
        dark, uneven, shot = (part[..., None] for part in (self.dark, self.uneven, self.shot))
        return np.asarray(shot * (light * (1 + uneven * light) + dark))

    def unfilled(self, light: Array) -> Array:
        """Share of them that hold no more than the full well, likewise."""
        return normal_share((self.room[..., None] - light) / np.maximum(self._spread(light), 1e-150))

    def _spread(self, light: Array) -> Array:
        """Scatter of the light by noise and by the texture's contrast, likewise."""
        return np.asarray(np.sqrt(self.variance(light) + np.square(self.contrast[:, None, None] * light)))

    @property
    def finest(self) -> Array:
        """Periods in a pitch of the finest detail that diffraction passes."""
        return self.pitch * self.width / (self.wavelength * self.distance)


def normal_share(z: Array) -> Array:
    """Share of a normal distribution below so many standard deviations."""
    if z.size > FEW:
        from scipy.special import ndtr  # its import takes as long as so many by the standard library

        return np.asarray(ndtr(z))
    return np.reshape([0.5 * math.erfc(-x) for x in np.ravel(z / math.sqrt(2.0)).tolist()], z.shape)


def overlapping(wide: Array | float, rise: float, is_disc: bool) -> Array:
    """Share of the pixels, at most, that whole images of several microlenses reach, by their width in pitches."""
    w = np.maximum(np.asarray(wide, float), 1.0)
    if not is_disc:
        return np.asarray(1 - np.square(np.maximum(2 - w, 0.0)) if rise == 1 else w > 1, float)
    lens = w**2 / 2 * np.arccos(1 / w) - np.sqrt(w**2 - 1) / 2  # that two discs a pitch apart have in common
    return np.asarray(np.minimum(lens * (2 if rise == 1 else 3) / rise, 1.0))


def shape_of_builds(images: MicrolensImages, plane: Seen) -> tuple[int, ...]:
    """Shape of the builds and of the plane together."""
    return np.broadcast_shapes(images.camera.shape or (1,), np.shape(plane.disparity), np.shape(plane.scale))


def rows_of(
    images: MicrolensImages, plane: Seen, texture: Texture, besides: tuple[Beside, ...] = (NOTHING,)
) -> ImageRows:
    """Every field of every build, one after the other."""
    c = images.camera
    openings = images.openings
    builds = shape_of_builds(images, plane)
    shape = (len(images.fields), *builds)
    pitch = magnitude(microlens_image_pitch(c))
    bend = ratio(plane.disparity * pitch, magnitude(microlens_image_diameter(c)))
    defocus = -microlens_defocus(c) / c.seen.d_2
    light = electrons(c, plane.at) * images.level * response(c, np.hypot(*images.microlens[:2]))
    noises: list[tuple[Number, Number, Number, Number]] = []
    for beside in besides:
        uneven = np.square(beside.share)
        # N A + V + r^2 + s^2 + eps^2 (N A + V)^2, over what the term in N A is multiplied by.
        shot = 1 + 2 * uneven * beside.veil
        dark = dark_variance(c) + np.square(beside.dark) + beside.veil + uneven * np.square(beside.veil)
        noises.append((dark / shot, uneven / shot, shot, c["sensor.full_well"] - beside.veil))
    optics = (c.d, c.seen.d_2, c.wavelength, defocus, c.q, light, c["depth.contrast"], pitch, bend)
    per_pitch = np.broadcast_to(ratio(1.0, pitch), builds)
    turn = np.asarray(c["microlens_array.rotation"])
    cos, sin = np.cos(turn), np.sin(turn)

    def along_lattice(points: Array) -> Array:
        """Points (..., K or P, M, 2) from the FAP's centre [pitches], one axis of N in place of the leading ones."""
        (u, v), (a, b) = np.moveaxis(points - openings.centres[..., :1, None, :], -1, 0), (cos[..., None, None], sin)
        b = b[..., None, None]
        turned = np.stack([u * a + v * b, v * a - u * b], -1) * per_pitch[..., None, None, None]
        return np.broadcast_to(turned, (*shape, *turned.shape[-3:])).reshape(math.prod(shape), *turned.shape[-3:])

    xx, xy, yy = np.moveaxis(openings.matrices, -1, 0)
    a, b, square = cos[..., None], sin[..., None], np.square(per_pitch)[..., None]
    turned = (
        a * a * xx + 2 * a * b * xy + b * b * yy,
        a * b * (yy - xx) + (a * a - b * b) * xy,
        b * b * xx - 2 * a * b * xy + a * a * yy,
    )
    forms = np.stack([part * square for part in turned], -1)
    across = np.broadcast_to(openings.radii * per_pitch[..., None], (*shape, openings.total))
    across = across.reshape(-1, openings.total)
    scaled = Openings(
        along_lattice(openings.centres[..., None, :])[:, :, 0],
        across,
        along_lattice(openings.corners),
        openings.polygons,
        np.broadcast_to(forms, (*shape, *forms.shape[-2:])).reshape(math.prod(shape), *forms.shape[-2:]),
        openings.ellipses,
    )
    wide = 2 * across[:, 0]
    if 0 in openings.polygons:
        wide = np.broadcast_to(magnitude(microlens_image_diameter(c)) * per_pitch, shape).ravel()
    rows: Any = [np.broadcast_to(np.asarray(value, float), shape).ravel() for value in (*optics, *texture[:2])]
    *rows, contrast, pitch, bend, fine, strength = rows
    rows += [
        np.stack([np.broadcast_to(np.asarray(value, float), shape).ravel() for value in values], -1)
        for values in zip(*noises, strict=True)
    ]
    rows += [contrast, pitch, bend, wide, scaled, texture._replace(fine=fine, strength=strength)]
    return ImageRows(*rows)


def summed_information(images: ImageRows, c: ArrayKind, level: int, whole: bool) -> Array:
    """Information of images that pass so much detail, shape (N, M), each summed by itself; whole ones or cut."""
    count, side = images.pitch.size, lattice_orders(c, min(level, SHARPEST))[0].size
    values = side * (1 + images.texture.waves.x.size)
    block = max(1, VALUES // (side * values))
    parts = [np.arange(start, min(start + block, count)) for start in range(0, count, block)]
    return np.concatenate([_sharpened(images.at(part), c, level, whole) for part in parts])


def _sharpened(images: ImageRows, c: ArrayKind, level: int, whole: bool) -> Array:
    """Information; where blur is far below a pitch, extrapolated from broader ones."""
    finest, waves = images.finest, images.texture.as_views_show
    if not (whole and images.openings.first_is_disc):  # whole discs are as they are in a mirror
        x, y, power = waves.x, waves.y, waves.power / 2
        waves = Spectrum(*(np.concatenate(pair, 1) for pair in ((x, -x), (y, y), (power, power))))
    spectra = _spectra(images, waves, c, min(level, SHARPEST), whole)
    if level <= SHARPEST:
        return _information(images, c, spectra)
    at = np.array([1.0, 1.5, 2.25]) / SHARPEST
    blurred = [images._replace(wavelength=images.wavelength * finest * x) for x in at]
    values = np.stack([_information(some, c, spectra) for some in blurred])
    x = np.minimum(1 / finest, at[0])
    weights = [np.prod([(x - b) / (a - b) for b in at if b != a], axis=0) for a in at]
    return np.asarray(sum(weight[:, None] * value for weight, value in zip(weights, values, strict=True)))


class _Spectra(NamedTuple):
    """Spectra of the light of each wave that stops and pixels leave, before diffraction.

    Arrays broadcast to (N, 1 + W, S, S), or are (N, P) at those places alone that round microlenses pass.
    """

    fx: Array
    """Frequencies along x: of the uniform light, by which all is divided, then of the texture's waves."""
    fy: Array
    shape: tuple[int, ...]
    at: NDArray[np.intp] | None
    """Where the places stand among (1 + W) S S; None: all of them."""
    cell: float
    light: Array | Complex
    turned: Array | Complex
    """Change of each wave with B over i."""
    power: Array
    """Power of the texture's waves, shape (N, W)."""
    even: bool
    """True where images are as before after half a turn: the light is real then, and its change over i."""

    def images(self, passed: Array) -> tuple[Complex, Complex, Array]:
        """Waves' images and, over i, their changes, and how often each of their places counts.

        Of even ones one half of the places: in the other the images are complex conjugates.
        """
        sent = [self._placed(part.real if self.even else part, passed) for part in (self.light, self.turned)]
        sent[1] = sent[1][:, 1:]
        if not self.even:
            light, turned = map(np.fft.ifft2, sent)
            return light, turned, np.ones(())
        side = self.shape[-1]
        light, turned = (np.fft.ifft(np.fft.rfft(part, norm="forward"), axis=-2) for part in sent)
        return light, turned, np.where(np.arange(side // 2 + 1) % (side // 2) > 0, 2.0, 1.0)

    def _placed(self, part: Any, passed: Array) -> Any:
        if self.at is None:
            return part * passed
        placed = np.zeros((self.shape[0], math.prod(self.shape[1:])), part.dtype)
        placed[:, self.at] = part * passed
        return placed.reshape(self.shape)


def _spectra(
    images: ImageRows, waves: Spectrum, c: ArrayKind, level: int, whole: bool, folds: tuple[Array, Array] | None = None
) -> _Spectra:
    """Spectra of waves, at the lattice's frequencies about their own or about those that they fold to."""
    count = len(images.pitch)
    kx, ky, own_x, own_y = (
        np.concatenate([np.zeros((count, 1)), k], 1)[..., None, None] for k in (*waves[:2], *(folds or waves[:2]))
    )
    x, y, cell = lattice_orders(c, level)
    fx, fy, at = own_x + x, own_y + y, None
    shape = np.broadcast_shapes(fx.shape, fy.shape)
    if whole and LENS_SHAPES[c.lens_shape].round:
        finest = np.minimum(images.finest, SHARPEST)[:, None, None, None]
        at = np.flatnonzero((fx * fx + fy * fy < finest * finest).any(0))
        fx, fy, kx, ky = (np.broadcast_to(f, shape).reshape(count, -1)[:, at] for f in (fx, fy, kx, ky))
    bend, wide = (_along(part, fx) for part in (images.bend, images.wide))
    light, along, across = form_of(images, whole)(images, fx - bend * kx, fy - bend * ky)
    pixel = _pixel(images, fx, fy)
    turned = 2 * math.pi / wide * pixel * (kx * along + ky * across)
    return _Spectra(fx, fy, shape, at, cell, light * pixel, turned, waves.power, whole)


def _along(values: Array, like: Array) -> Array:
    """Values of images (N,), to broadcast with others whose first axis is theirs."""
    return values.reshape(-1, *(1,) * (like.ndim - 1))


def _information(images: ImageRows, c: ArrayKind, spectra: _Spectra) -> Array:
    """Information of images in each of their noises, shape (N, M): one signal, weighed by each."""
    count = len(images.pitch)
    light, turned, weight, _ = _weighed(images, c, spectra)
    weight = np.repeat(weight, 2, axis=-1).swapaxes(1, 2)  # of real and imaginary parts, side by side

    def parts(values: Complex) -> Array:
        return np.ascontiguousarray(values).view(float).reshape(count, values.shape[1], -1)

    change, shown = parts(turned), parts(light[:, 1:])
    own, free, mixed = (product @ weight for product in (change * change, shown * shown, change * shown))
    mixed = mixed**2 if spectra.even else mixed**2 + (change * parts(1j * light[:, 1:]) @ weight) ** 2
    return np.asarray(((own - ratio(mixed, free)) * spectra.power[..., None]).sum(1))


def _weighed(images: ImageRows, c: ArrayKind, spectra: _Spectra) -> tuple[Complex, Complex, Array, Array]:
    """Waves' images, their changes, weights of the places in each noise, shape (N, M, P), and pixels that are lit."""
    count, side = len(images.pitch), spectra.shape[-1]
    passed = _lens(images, c, spectra.fx, spectra.fy) * (side * side / spectra.cell)
    light, turned, times = spectra.images(passed)
    shown = np.maximum(light[:, :1].real, 0.0).reshape(count, 1, -1)
    own_light = images.light[:, None, None] * shown
    variance = images.variance(own_light)
    area = spectra.cell / side**2 * (images.pitch / images.pixel) ** 2
    weight = (images.light**2 * area)[:, None, None] / np.maximum(variance, 1e-300)
    if np.isfinite(images.room).any():
        weight *= images.unfilled(own_light)
    places = np.broadcast_to(times, light.shape[-2:]).ravel()
    lit = area * (np.minimum(shown[:, 0], 1.0) * places).sum(-1)
    return light, turned, weight * places, lit


def folded_slopes(images: ImageRows, c: ArrayKind, finest: Array, level: int, whole: bool) -> tuple[Array, Array]:
    """Effect of detail too fine for the lattice on B: variance that it adds to the slope that tells B, and chi-square.

    Views show a wave of kappa as one of ``kappa - n``, n of the reciprocal lattice, but out of focus its phase turns
    over the FAP as kappa has it. What the picture does not explain of that pulls at B by the texture's own waves about
    ``kappa - n``: ``V = sum over waves of P_kappa S(kappa - n)|D* X|^2``, S the power for each unit of area, D the
    change of the texture's image with B, X the folded wave's image, both without what the picture explains.

    Parameters
    ----------
    images : ImageRows
    c : ArrayKind
    finest : ndarray, shape (N,)
        Finest detail [periods a pitch].
    level : int
        Periods in a pitch that diffraction passes.
    whole : bool
        Whether no stop but the FAP cuts images.

    Returns
    -------
    ndarray, shape (N, M)
        V of one microlens in each noise, beside the information J of B: ``sigma_B^2`` is ``(1 + V/J)/J``.
    ndarray, shape (N, M)
        Chi-square of a sample that such detail adds.
    """
    packing = PACKINGS[c.layout]
    sharpest = images.finest > SHARPEST
    images = images._replace(wavelength=images.wavelength * np.where(sharpest, images.finest / SHARPEST, 1.0))
    octaves = np.log(np.clip(finest, packing.fold, FINEST_FOLDED) / packing.fold)[:, None]
    count = np.arange(FOLDED)
    radius, turns = packing.fold * np.exp(octaves * (count + 0.5) / FOLDED), math.pi * GOLDEN * count
    power = octaves / (math.log(2) * FOLDED)
    x, y = radius * np.cos(turns), radius * np.sin(turns)
    steps = np.arange(-FOLDS, FOLDS + 1.0)
    lattice = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2) @ np.linalg.inv(packing.steps)
    nearest = np.hypot(x[..., None] - lattice[:, 0], y[..., None] - lattice[:, 1]).argmin(-1)
    over = lattice[nearest]
    own_x, own_y = x - over[..., 0], y - over[..., 1]
    strength, lens = images.texture.strength[:, None], LENS_SHAPES[images.texture.lens_shape or c.lens_shape]
    shown = strength * power * lens.blur(x, y) ** 2 * np.any(over != 0, -1)
    area = 2 * math.pi * math.log(2) * (own_x**2 + own_y**2)
    density = strength * lens.blur(own_x, own_y) ** 2 / np.maximum(area, 1e-12) / packing.rise
    density *= np.hypot(own_x, own_y) < packing.fold
    there = min(level, SHARPEST)
    seen = _spectra(images, Spectrum(own_x, own_y, shown), c, there, whole)
    light, turned, weight, lit = _weighed(images, c, seen)
    folded = _weighed(images, c, _spectra(images, Spectrum(x, y, shown), c, there, whole, (own_x, own_y)))[0]
    own, other, change = (part.reshape(*part.shape[:2], -1) for part in (light[:, 1:], folded[:, 1:], turned))

    def product(first: Complex, second: Complex) -> Complex:
        sums = (first.conj() * second) @ weight.swapaxes(1, 2)
        return np.asarray(sums.real if seen.even else sums)  # half of the places: the others are their conjugates

    free, mixed, alike = product(own, own).real, product(own, change), product(own, other)
    least = np.maximum(free, 1e-300)
    pull = product(change, other) - mixed.conj() * alike / least
    left = product(other, other).real - np.abs(alike) ** 2 / least
    variance = ((shown * density)[..., None] * np.abs(pull) ** 2).sum(1)
    return variance, (shown[..., None] * left).sum(1) / np.maximum(lit, 1e-300)[:, None]


def lattice_orders(c: ArrayKind, finest: float) -> tuple[Array, Array, float]:
    """Frequencies of a lattice that images with so fine a detail have, and the area of its cell.

    Along x, shape (S, 1), and y, (S, S) or where all rows are alike (1, S), in the order of a Fourier transform over
    the lattice's directions [periods per pitch].
    """
    packing = PACKINGS[c.layout]
    side = 2 * math.ceil(packing.orders * finest) + 2
    n = np.asarray(np.fft.fftfreq(side, 1 / side), np.float64)
    up = packing.wave_up(n[:, None], n)
    return n[:, None], up[:1] if (up == up[0]).all() else up, packing.rise


def form_of(images: ImageRows, whole: bool) -> Callable[[ImageRows, Array, Array], Transforms]:
    """Function that has images' transforms: in closed form those of whole ones."""
    if not whole:
        return _cut
    return _whole if images.openings.first_is_disc else _straight


def _whole(images: ImageRows, fx: Array, fy: Array) -> Transforms:
    """Fourier transforms of a whole disc and, over i, of its first moments along x and y [pitches]."""
    radius = _along(images.openings.radii[:, 0], fx)
    first, bent = _bessel_quotients(np.square(2 * math.pi * radius) * (fx * fx + fy * fy))
    # The moment is i/(2 pi) times the derivative.
    moment = -4 * math.pi**2 * radius**4 * bent
    return 2 * math.pi * radius**2 * first, moment * fx, moment * fy


def _bessel_quotients(square: Array) -> tuple[Array, Array]:
    """Bessel functions ``J_1(z)/z`` and ``J_2(z)/z^2`` by z squared, to 1e-11.

    Taylor series about tabled places: by z^2, ``J_n/z^n`` changes by ``-J_(n+1)/z^(n+1)/2``.
    """
    near = np.minimum(square, FARTHEST**2)
    node = np.rint(TABLED * np.sqrt(near)).astype(np.intp)
    step = (np.square(node / TABLED) - near) / 2
    tables = _bessel_tables(int(node.max(initial=1)).bit_length())
    one, two, three, four, five = (table.take(node, mode="clip") for table in tables)  # no node lies beyond: unchecked
    half, third = step / 2, step / 3
    first = one + step * (two + half * (three + third * four))
    second = two + step * (three + half * (four + third * five))
    if (far := square > near).any():
        from scipy.special import j1, jv

        z = np.sqrt(square[far])
        first[far], second[far] = j1(z) / z, jv(2, z) / np.square(z)
    return first, second


@functools.lru_cache
def _bessel_tables(bits: int) -> list[Array]:
    """Quotients ``J_n(z)/z^n`` for n from 1 to 5, at so many places that they have so many bits.

    Means of ``cos(z cos t) sin^(2 n) t`` over ``(2 n - 1)!!`` (Poisson's integral), by midpoints, exact to rounding.
    """
    places, n = np.arange(2**bits) / TABLED, np.arange(1, 6)
    count = MIDPOINTS + math.ceil(places[-1] / 4)
    angles = (np.arange(count) + 0.5) * (math.pi / 2 / count)
    shares = np.sin(angles)[:, None] ** (2 * n) / (count * np.cumprod(2 * n - 1))
    waves = (np.cos(places * along) for along in np.cos(angles).tolist())  # one after the other, for memory's sake
    return list(sum(np.multiply.outer(share, wave) for share, wave in zip(shares, waves, strict=True)))


def _straight(images: ImageRows, fx: Array, fy: Array) -> Transforms:
    """Fourier transforms of a whole rectangle and, over i, of its first moments along x and y [pitches]."""
    corners = images.openings.corners[:, images.openings.polygons.index(0)]
    sides = [(corners[:, 0] - corners[:, k]) / 2 for k in (1, 3)]
    (ax, ay), (bx, by) = ([_along(part, fx) for part in side.T] for side in sides)
    (along, along_bent), (across, across_bent) = (_sinc(2 * (fx * x + fy * y)) for x, y in ((ax, ay), (bx, by)))
    area = 4 * np.abs(ax * by - ay * bx)
    first, second = area * along_bent * across, area * along * across_bent
    moment_x, moment_y = ((first * a + second * b) / math.pi for a, b in ((ax, bx), (ay, by)))
    return area * along * across, moment_x, moment_y


def _sinc(x: Array) -> tuple[Array, Array]:
    """Value sin(pi x)/(pi x) and its derivative."""
    values, near = np.sinc(x), np.abs(x) < 0.01
    safe = np.where(near, 1.0, x)
    return values, np.where(
        near, -(math.pi**2) * x / 3 * (1 - (math.pi * x) ** 2 / 10), (np.cos(math.pi * safe) - values) / safe
    )


def _cut(images: ImageRows, fx: Array, fy: Array) -> Transforms:
    """Transforms of any opening, cut by others or not, row by row; of moments over i."""
    half = images.openings.spans.min(1) / 2
    finest = 2 * math.pi * float((np.abs(fy).max((1, 2, 3)) * half).max(initial=0.0))
    rows = max(ROWS, math.ceil(finest) + ROWS // 2)
    y, weight, left, right = images.openings.strips(rows)
    # Frequencies along x hang on the row of the lattice alone, those along y differ by whole steps between columns.
    # Both are the wave's in the first row and steps that all waves share: exponentials of sums, in half the time.
    x, up = (2 * math.pi * f[..., :1] for f in (fx, fy))
    beside = 2 * math.pi * (fy - fy[..., :1])[:, 0, 0]
    of_rows = ((left + right) / 2, (right - left) / 2, y, weight)
    middle, half, at, share = (value[:, None, None, :] for value in of_rows)

    def transforms(some: slice) -> Transforms:
        mid, wide, over, ways = middle[some], half[some], at[some], (x[some], up[some])
        first, step = [f[:, :, :1] for f in ways], [f[:, :1] - f[:, :1, :1] for f in ways]
        turn, own = (np.exp(-1j * (along * mid + above * over)) for along, above in (first, step))
        turn = (turn * share[some]) * own
        wave, phase = np.exp(1j * first[0] * wide) * np.exp(1j * step[0] * wide), ways[0] * wide
        near = np.abs(phase) < 0.1
        small = phase[near]
        square = small * small
        phase[near] = 1.0
        sine = wave.imag / phase
        bent = (sine - wave.real) / phase
        sine[near] = 1 - square / 6 * (1 - square / 20 * (1 - square / 42))
        bent[near] = small * (1 / 3 - square / 30 * (1 - square / 28 * (1 - square / 54)))
        flat, moment = 2 * wide * sine, np.empty(turn.shape, complex)
        moment.real, moment.imag = -2 * wide**2 * bent, -flat * mid
        lit, moment = turn * flat, turn * moment
        columns = np.exp(-1j * beside[some][:, None, None, :] * over.swapaxes(2, 3))
        return lit @ columns, moment @ columns, lit @ (-1j * columns * over.swapaxes(2, 3))

    # Some images at a time, as many as a processor's own memory holds.
    block = max(1, CACHED // max(1, x[0].size * y.shape[1]))
    parts = [transforms(slice(start, start + block)) for start in range(0, len(x), block)]
    light, along, above = (np.concatenate(part) for part in zip(*parts, strict=True))
    return light, along, above


def transfer(images: ImageRows, c: ArrayKind, fx: Array, fy: Array) -> Array:
    """Transfer of diffraction, defocus and the pixel at each frequency [periods per pitch]."""
    return _pixel(images, fx, fy) * _lens(images, c, fx, fy)


def _pixel(images: ImageRows, fx: Array, fy: Array) -> Array:
    box = _along(images.pixel / images.pitch, fx)
    return pixel_box(fx, box) * pixel_box(fy, box)


def _lens(images: ImageRows, c: ArrayKind, fx: Array, fy: Array) -> Array:
    per_mm = _along(1 / images.pitch, fx)
    own = (images.width, images.distance, images.defocus, images.wavelength)
    wide, far, blurred, wave = (_along(part, fx) for part in own)
    lenses = LENS_SHAPES[c.lens_shape].factors(wide, far, blurred, wave, fx * per_mm, fy * per_mm)
    return math.prod(lenses, start=np.ones(()))
