"""Places of microlens images: the light of each microlens there, where on the FAP it comes from, what waves show."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .._arrays import Array, Complex
from ..camera import Number
from ..shapes.lattice import PACKINGS
from .disparity_information import (
    ArrayKind,
    ImageRows,
    Seen,
    Spectrum,
    Texture,
    Transforms,
    form_of,
    lattice_orders,
    rows_of,
    transfer,
)
from .lens_shapes import LENS_SHAPES, LensShape
from .stop_images import MicrolensImages

FINEST_PLACES, FINEST_CUT = 128, 32
"""Periods in a pitch up to which `image_parts` follows the microlens's diffraction in whole images and in cut ones: at
Fresnel numbers up to 32 and 8."""
REACH, FAINT = 3, 5e-4
"""Steps of the lattice to the farthest neighbours that `image_parts` takes one by one; light that it lets be."""
FAR = 4
"""Steps to those that stand for all others: tails of diffraction fall off slowly, and shift what a place shows."""
SLOW = ((0.0, 0.0), (1 / (4 * FAR), 0.0), (0.0, 1 / (4 * FAR)))
"""None, and waves along the lattice [periods a step] that those show a quarter of a period earlier or later."""
DIM = 0.2
"""Share of detail that a microlens's width leaves below which its defocus is not followed."""
WAVES = 1024
"""Waves of all images at a time, for memory's sake."""
STEPS: tuple[tuple[int, int], ...] = (
    *((a, b) for a in range(-REACH, REACH + 1) for b in range(-REACH, REACH + 1)),
    *((FAR, 0), (-FAR, 0), (0, FAR), (0, -FAR)),
)
"""Steps of the lattice to the microlenses that `image_parts` tells apart."""
APART = 9
"""Pitches after which images that are taken to stand alone repeat themselves."""


class ImageParts(NamedTuple):
    """Light that reaches a place from the microlenses around it; the first axis counts lattice steps.

    The place belongs to the microlens of step (0, 0), the middle one.
    """

    steps: tuple[tuple[int, int], ...]
    """Steps along the lattice's first and second direction to the microlens that the light comes from. The last four
    stand for all light that is faint or comes from farther away, as far as a slow texture tells: some have less than
    none."""
    light: Array
    """1 where the FAP lights the place fully, shape (steps, fields, T, S)."""
    x: Array
    """Mean place on the FAP that it comes from, in FAP diameters from its centre; of the same shape."""
    y: Array


Read = tuple[Sequence[Callable[[Array], Array | Complex]], Sequence[Callable[[Array], Array | Complex]]]
"""Transfers at frequencies [1/px] of images read between pixels: along x and along y, several of each."""
AS_IT_IS: Read = ((np.ones_like,), (np.ones_like,))
"""Images read at pixels' middles."""


class _WavesOfLenses(NamedTuple):
    """Waves over the array, as microlens images show them; a mean over waves leaves a single image."""

    first: Array
    """Periods a step along the lattice's first direction, shape (W,)."""
    second: Array
    rows: ImageRows
    form: Callable[[ImageRows, Array, Array], Transforms]
    fx: Array
    """Frequencies along x of every order of each wave, shape (fields, W, S, 1), and along y, (fields, W, S or 1, S)."""
    fy: Array
    passed: Array
    along: Array
    """Waves at the places asked for, shape (W, S, S')."""
    across: Array
    """Shape (W, S or 1, S, T)."""
    read: tuple[list[Array | Complex], list[Array | Complex]]
    """Transfers of reading between pixels along x, shape (W, S, 1), and along y, (W, S or 1, S)."""
    image: Array
    """Images against those by closed forms, shape (fields, 2, 2): of cut ones a scale."""

    @classmethod
    def of(
        cls, images: MicrolensImages, x: Array, y: Array, read: Read, more: tuple[tuple[float, ...], ...] = (),
        mean: bool = True, image: Array | None = None,
    ) -> _WavesOfLenses:  # fmt: skip
        """At places of the images; `more` waves after those of a `mean`, half of which then stand for all."""
        array = ArrayKind(images.camera.layout, images.camera.lens_shape)
        # Images stand alone where they repeat themselves after a few pitches only: a mean over as many waves.
        some = (np.arange(APART) - APART // 2) / APART if mean else np.zeros(0)
        half = APART**2 // 2 if more and mean else 0
        first, second = (values.ravel()[half:] for values in np.meshgrid(some, some, indexing="ij"))
        first, second = (np.append(one, [wave[k] for wave in more]) for k, one in enumerate((first, second)))
        kx, ky = first, PACKINGS[array.layout].wave_up(first, second)
        none, one = np.zeros(1), np.ones(())
        rows = rows_of(images, Seen(np.zeros(()), np.ones(())), Texture(one, one, Spectrum(none, none, none)))
        whole = bool(rows.whole.all())
        finest = FINEST_PLACES if whole else FINEST_CUT
        wider = np.where(rows.finest > finest, rows.wavelength * rows.finest / finest, rows.wavelength)
        rows = rows._replace(wavelength=wider)
        *orders, cell = lattice_orders(array, float(rows.finest.max(initial=1.0)))
        waves = (k[:, None, None] + f for k, f in zip((kx, ky), orders, strict=True))
        fx, fy = (np.broadcast_to(f, (len(rows.pitch), *f.shape)) for f in waves)
        image = np.broadcast_to(np.eye(2), (len(rows.pitch), 2, 2)) if image is None else image
        if not whole:  # rows of a cut image stay rows
            image = np.sqrt(np.abs(np.linalg.det(image)))[:, None, None] * np.eye(2)
        along, across = np.exp(2j * math.pi * fx[0] * x), np.exp(2j * math.pi * fy[0, ..., None] * y)
        pixel = float(rows.pixel[0] / rows.pitch[0])
        reads = [at(fx[0] * pixel) for at in read[0]], [at(fy[0] * pixel) for at in read[1]]
        passed = transfer(rows, array, fx, fy) / cell
        return cls(first, second, rows, form_of(rows, whole), fx, fy, passed, along, across, reads, image)

    def spectra(self) -> Transforms:
        """Transforms of images and of places on the FAP, as `form` has them."""
        scale, (xx, xy, yx, yy) = np.abs(np.linalg.det(self.image)), self.image.reshape(-1, 4).T
        xx, xy, yx, yy, scale = (part[:, None, None, None] for part in (xx, xy, yx, yy, scale))
        fx, fy = xx * self.fx + xy * self.fy, yx * self.fx + yy * self.fy
        light, along, across = self.form(self.rows, fx, fy)
        return scale * light, 1j * scale * along, 1j * scale * across

    def at_places(self, part: Array | Complex) -> Complex:
        """Waves' images of such a transform at the places asked for, shape (W, fields and ways to read them, T, S)."""
        sent, images = part * self.passed, []
        for over in self.read[1]:
            if self.across.shape[1] == 1:
                lines = (sent * over) @ self.across[:, 0]
            else:
                lines = np.einsum("nwkl,wklt->nwkt", sent * over, self.across, optimize=True)
            images += [np.swapaxes(lines * by, -1, -2) @ self.along for by in self.read[0]]
        pieces: Complex = np.stack(images, 1)
        return np.moveaxis(pieces.reshape(-1, *pieces.shape[2:]), 0, 1)


class _OwnWaves(NamedTuple):
    """Waves of which a mean leaves single images, and two that farther lenses show a quarter of a period later."""

    waves: _WavesOfLenses
    spectra: Transforms
    turns: Complex
    """Turn of each wave at each of `STEPS`, shape (steps, W); all four of lenses farther away are left out."""

    @classmethod
    def of(cls, images: MicrolensImages, x: Array, y: Array, read: Read, image: Array | None = None) -> _OwnWaves:
        waves = _WavesOfLenses.of(images, x, y, read, SLOW[1:], image=image)
        turns = np.exp(-2j * math.pi * (np.array(STEPS[:-4]) @ [waves.first, waves.second]))
        return cls(waves, waves.spectra(), turns)

    def alone(self, at: Complex) -> Array:
        """Single images of waves' images, shape (steps, fields and ways to read them, T, S)."""
        count = at.shape[0] - 2
        each = np.where(np.arange(count) > 0, 2.0, 1.0) / APART**2
        return np.asarray(np.einsum("aw,w...->a...", self.turns[:, :count] * each, at[:count], optimize=True).real)

    @property
    def light(self) -> Array:
        """Light of microlenses, and of those that stand for all others."""
        at = self.waves.at_places(self.spectra[0])
        return with_farther(self.alone(at), at[[0, -2, -1]])


def with_farther(light: Array, slow: Complex) -> Array:
    """Light of microlenses at `STEPS` but the last four, faint of which is let be, and of those.

    By what all microlenses show of each wave of `SLOW`.
    """
    light = np.where(np.abs(light) > FAINT, light, 0.0)  # read beside a rim it may be below none
    turns = np.sin(2 * math.pi * np.array(STEPS[:-4]) @ np.transpose(SLOW[1:]))
    even = (slow[0].real - light.sum(0)) / 4
    odd = (slow[1:].imag - np.einsum("aw,a...->w...", turns, light)) / 2
    return np.concatenate([light, [even + odd[0], even - odd[0], even + odd[1], even - odd[1]]])


def across_lenses(shape: LensShape, turn: Number, fx: Array, fy: Array, periods: Array) -> Array:
    """Transfer of waves over that of their light where microlenses are out of focus on the FAP.

    What passes a side of a microlens then moves on the sensor, and shows the texture behind that side.

    Parameters
    ----------
    turn : float or ndarray
        How far light through a side moves, over how far that is from the microlens's middle [image pitches a pitch].
    fx, fy : ndarray
        Frequencies of images [periods an image pitch].
    periods : ndarray, shape (2, ...)
        The waves' [periods a pitch].
    """
    x, y = turn * fx, turn * fy
    kx, ky = periods
    alone = shape.blur(x, y) * shape.blur(kx, ky)
    clear = np.abs(alone) > DIM
    return np.asarray(np.where(clear, shape.blur(x + kx, y + ky) / np.where(clear, alone, 1.0), 1.0))


def waves_shown(
    images: MicrolensImages, x: Array, y: Array, waves: Array, disparities: Array, read: Read = AS_IT_IS
) -> Array:
    """Waves of a texture as microlens images show them, neighbours' light and all, over the light there.

    Parameters
    ----------
    images : MicrolensImages
        Of one build, at the fields asked for; neighbours are taken to be like them.
    x, y : ndarray, shape (S,), (T,)
        Places from the image's centre, along the lattice's axes [microlens-image pitches].
    waves : ndarray, shape (W, 2)
        Periods a pitch along the lattice's axes.
    disparities : ndarray, shape (D,)
        B between the FAP's rims as they lie behind the microlens [pitches].
    read : Read
        One along each axis.

    Returns
    -------
    ndarray, shape (D, W, fields, T, S)
        Complex, 1 where the microlens's middle is shown sharply; 0 without light.
    """
    packing, shown = PACKINGS[images.camera.layout], list[Complex]()
    block = max(1, WAVES // len(images.fields))
    for some in np.split(waves @ packing.steps, np.arange(block, len(waves), block)):
        lenses = _WavesOfLenses.of(images, x, y, read, ((0.0, 0.0), *map(tuple, some)), mean=False)
        periods = np.stack([lenses.first, packing.wave_up(lenses.first, lenses.second)])[..., None, None]
        along, down = (k / lenses.rows.wide[:, None, None, None] for k in periods)
        own = lenses.rows
        turn = (own.defocus * own.distance * own.width / own.pitch)[:, None, None, None]
        across = across_lenses(LENS_SHAPES[images.camera.lens_shape], turn, lenses.fx, lenses.fy, periods)
        each = []
        for b in disparities.tolist():
            part = lenses.form(lenses.rows, lenses.fx - b * along, lenses.fy - b * down)[0]
            light, *shines = lenses.at_places(np.multiply(part, across))
            lit = light.real > FAINT
            each.append([np.where(lit, one / np.where(lit, light.real, 1.0), 0.0) for one in shines])
        shown.append(np.array(each))
    return np.concatenate(shown, 1)


def image_parts(
    images: MicrolensImages, x: Array, y: Array, read: Read = AS_IT_IS, image: Array | None = None
) -> ImageParts:
    """Light of a microlens and its neighbours at places of its image, and where on the FAP it comes from.

    Parameters
    ----------
    images : MicrolensImages
        Of one build, at the fields asked for; neighbours are taken to be like them.
    x, y : ndarray, shape (S,), (T,)
        Places from the image's centre, along the lattice's axes [microlens-image pitches].
    read : Read
        One along each axis.
    image : ndarray, shape (fields, 2, 2), optional
        Places of images, along the lattice's axes, by those where closed forms have them, row by column; None is
        identity. Of cut images its scale alone counts.
    """
    own = _OwnWaves.of(images, x, y, read, image)
    light = own.light
    unit, near = 1 / own.waves.rows.wide[:, None, None], light[:-4]
    lit = near != 0
    # The microlens turns the FAP round.
    moments = (-unit * own.alone(own.waves.at_places(part)) for part in own.spectra[1:])
    s_x, s_y = (np.where(lit, moment / np.where(lit, near, 1.0), 0.0) for moment in moments)
    s_x, s_y = (np.pad(part, ((0, 4), *3 * [(0, 0)])) for part in (s_x, s_y))
    return ImageParts(STEPS, light, s_x, s_y)


def light_read(images: MicrolensImages, x: Array, y: Array, read: Read, image: Array | None = None) -> Array:
    """Light of `image_parts` at places that are read in several ways: shape (steps, ways, T, S).

    Of a single field; every way along x is paired with each along y, those along x first.
    """
    return _OwnWaves.of(images, x, y, read, image).light


def whole_light(images: MicrolensImages, x: Array, y: Array) -> Array:
    """Light of `light_read` of all microlenses together, at places as they are: shape (1, T, S)."""
    even = _WavesOfLenses.of(images, x, y, AS_IT_IS, ((0.0, 0.0),), mean=False)
    return np.asarray(even.at_places(even.spectra()[0])[0].real)
