"""The standard error of disparity that light, noise and texture leave: from first principles, per microlens.

A pixel p of a microlens image shows the scene's texture T at ``u - B s_p``: u counts microlenses, B is the disparity
between the FAP's rims [microlens pitches] and s_p the place on the FAP, in units of its diameter, that the pixel's
light comes from, on average. With the texture itself unknown, M microlenses tell B to

    ``sigma_B = 1/(G sqrt(M J))``,  ``J = sum over pixels of N^2 (X - s_mean A)^2/(N A_all + r^2)``, mean of both axes

with N electrons in a fully lit pixel, r^2 its variance without light, A the light of one microlens in each pixel (1
where it lights it fully), A_all that with its neighbours', X the first moment ``s A`` and G the rms gradient of what
the views show, in contrast per pitch. Without diffraction J is ``N n <(s - s_mean)^2>``, n the pixels of the image:
1/16 for a full disc.

Pixels of real cameras differ by more than noise: with an rms share eps of brightness, each pixel by itself, a veil of V
electrons in all of them and a scatter of s electrons in the dark, the variance in J is

    ``N A_all + V + r^2 + s^2 + (eps (N A_all + V))^2``.

Where images overlap, neighbours' light adds up, and fills pixels that a single image does not: what of ``N A_all``,
which scatters by noise and by the texture's contrast, is beyond the full well tells nothing.

That holds for detail far above a pitch. Here it is taken detail by detail: for a wave of kappa periods per pitch
neighbours' light in a pixel comes with its own phase, out of focus B turns phases over the FAP, and A and X become
``sum over microlenses k of exp(2 pi i kappa k) A(p - k)``: by Poisson's formula a Fourier sum over one cell of the
lattice, finite because diffraction bounds it. The waves of the texture's spectrum add up to the information of B.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, Complex, magnitude, ratio
from ..bore.opening import ClearAperture
from ..camera import Camera, Number
from ..shapes.discs import gauss_legendre
from ..shapes.lattice import PACKINGS
from ..shapes.openings import Openings
from .colours import filters, panchromatic
from .exit_pupil import microlens_image_diameter, microlens_image_pitch
from .f_number import fill_factor
from .lens_shapes import LENS_SHAPES, LensShape
from .light import microlens_defocus
from .photometry import NOTHING, Beside, dark_variance, electrons, response, through_filter, veil_electrons
from .stop_images import MicrolensImages
from .transfer import pixel_box

ROWS = 64
"""Gauss-Legendre rows across a cut microlens image, at least: fine detail and far defocus take one more a radian."""
SHARPEST = 8
"""Periods of the finest detail that diffraction passes, in one pitch, beyond which information is extrapolated in its
inverse: that grows as the blur shrinks, nearly in proportion. Right to 1 %."""
WIDEST = 8
"""Pitches across a microlens image beyond which images overlap so often that they tell nothing."""
OCTAVE_NODES = ((1.75, 3), (3.25, 5), (5.5, 8), (7.5, 12), (10.0, 16), (16.0, 24), (math.inf, 40))
"""Gauss-Legendre nodes over an octave of a texture's periods, each up to so many turns of `_waves_needed`: out of focus
what a wave tells rises and falls with its phases over the image. Sigma to 1 %; to 3 % where images overlap twofold."""
DIRECTIONS, OVERLAPPING, FINER = 3, 1.2, 5
"""Nodes over a quarter of its directions; pitches across an image from which neighbours' mixed light asks for more, and
how many then."""
SEAM = 0.95
"""Share of each bound from which on its nodes give way to the next, so that sigma has slopes there too."""
FINEST_PLACES, FINEST_CUT = 128, 32
"""Periods in a pitch up to which `image_parts` follows the microlens's diffraction in whole images and in cut ones: at
Fresnel numbers up to 32 and 8."""
REACH, FAINT = 3, 5e-4
"""Steps of the lattice to the farthest neighbours that `image_parts` takes one by one; light that it lets be."""
FAR = 4
"""Steps to those that stand for all others: tails of diffraction fall off slowly, and shift what a place shows."""
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
MANY = 6e5
"""Values in the rows of whole discs from which loading Bessel functions pays; rows give the same to 1e-11."""
NEARLY_ALIKE = 256
"""Images from which series stand in for sums."""
TRUE, CHECKS, FAINTEST = 1e-4, 8, 2e-6
"""Error that a series may have in information where it is checked: at the outermost images along each axis and at as
many others at least; and the share from which on a term counts, as far as `_coordinates` foresees it."""
MOST, FEW, HALVED = 600, 3, 0.1
"""Terms of a series beyond which its box is halved instead; images for each of them, at least; and the share of a box
over which halves give way to each other, so that sigma has slopes there too."""
NESTED = np.array([0.0, 1.0, -1.0, -0.577, 0.659, -0.839, 0.87, 0.306, -0.321, -0.943, 0.953, 0.48, -0.712, -0.156])
"""Places along an axis, each where it adds most to those before it (Leja)."""
TABLED = 128
"""Places in a unit of z at which Bessel functions are tabled."""
CLOSE, STEP = 0.004, 1e-5
"""Distance from the first image, in logarithms, within which fewer are taken from its tangents, to about the square of
that; and the step of the differences that tangents are."""
STEEPEST = 100.0
"""Slope from which on tangents are not taken: where next to nothing is left of a texture, rounding makes them."""
FULL, FULL_SIGMAS, CELL_PLACES = 5e-3, 2.576, 16
"""Share of pixels that is let be full, and beyond how many standard deviations it lies; places along a side of the
lattice's cell at which is looked how many are."""
VALUES, CACHED = 2**15, 2**14
"""Values of waves' images at a time: as many as stay at hand of the processor."""


class Seen(NamedTuple):
    """A plane of the scene, as disparity errors depend on it."""

    disparity: Array
    """B there [microlens pitches]; 0 is the focal plane."""
    scale: Array
    """Millimetres on it per millimetre of the array."""


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


class _Texture(NamedTuple):
    """Spectra that differ in how fine and how strong they are, and in nothing else."""

    fine: Array
    """Unit of the waves' frequencies [periods per microlens pitch], shape (...)."""
    strength: Array
    """Unit of the waves' power, shape (...)."""
    waves: Spectrum
    """Shape (W,)."""
    lens_shape: str | None = None
    """Shape of the microlenses whose width is yet to blur the waves; None: they are as single views show them."""

    def at(self, index: NDArray[np.intp]) -> _Texture:
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


Spectra = tuple[Array | Complex, Array | Complex, Array | Complex]


class _Array(NamedTuple):
    """Kind of microlens array: what its images depend on beside lengths."""

    layout: str
    lens_shape: str
    many: bool = False
    """Whether there are many images or builds, for which loading Bessel functions pays."""


class _Images(NamedTuple):
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
    texture: _Texture

    def at(self, index: NDArray[np.intp]) -> _Images:
        some: Any = [*(value[index] for value in self[:-2]), self.openings.at(index), self.texture.at(index)]
        return _Images(*some)

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
        return np.asarray(self.openings.rooms[:, 1:].min(1, initial=1.0) >= 0)

    def filling(self, rise: float) -> NDArray[np.bool_]:
        """True where so many neighbours' images may lie on each other that they fill pixels; shape (N,)."""
        with np.errstate(invalid="ignore"):
            most = np.ceil(self.wide) * np.ceil(self.wide / rise)
            most = np.where(_overlapping(self.wide, rise, self.openings.first_is_disc) > FULL, most, 1.0)
            light = (most * self.light)[:, None]
            return np.asarray((self.room - light < FULL_SIGMAS * self._spread(light[..., None])[..., 0]).any(1))

    def variance(self, light: Array) -> Array:
        """Variance of pixels that hold so many electrons of light, shape (N, 1, ...), in each noise (N, M, ...)."""
        dark, uneven, shot = (part[..., None] for part in (self.dark, self.uneven, self.shot))
        return np.asarray(shot * (light * (1 + uneven * light) + dark))

    def unfilled(self, light: Array) -> Array:
        """Share of them that hold no more than the full well, likewise."""
        from scipy.special import ndtr

        return np.asarray(ndtr((self.room[..., None] - light) / np.maximum(self._spread(light), 1e-150)))

    def _spread(self, light: Array) -> Array:
        """Scatter of the light by noise and by the texture's contrast, likewise."""
        return np.asarray(np.sqrt(self.variance(light) + np.square(self.contrast[:, None, None] * light)))

    @property
    def finest(self) -> Array:
        """Periods in a pitch of the finest detail that diffraction passes."""
        return self.pitch * self.width / (self.wavelength * self.distance)


def _overlapping(wide: Array | float, rise: float, is_disc: bool) -> Array:
    """Share of the pixels, at most, that whole images of several microlenses reach, by their width in pitches."""
    w = np.maximum(np.asarray(wide, float), 1.0)
    if not is_disc:
        return np.asarray(1 - np.square(np.maximum(2 - w, 0.0)) if rise == 1 else w > 1, float)
    lens = w**2 / 2 * np.arccos(1 / w) - np.sqrt(w**2 - 1) / 2  # that two discs a pitch apart have in common
    return np.asarray(np.minimum(lens * (2 if rise == 1 else 3) / rise, 1.0))


def _opening_of(width: Array, height: Array | None = None, turn: Array | None = None) -> Openings:
    """Disc, or rectangle, of such sizes about the origin; sizes are logarithms."""
    if height is None or turn is None:
        return Openings.of_discs(np.zeros((width.size, 1, 2)), np.exp(width)[:, None] / 2)
    return Openings.of(ClearAperture(math.inf, (np.exp(width) / 2, np.exp(height) / 2), turn), width.shape)


def texture(c: Camera, plane: Seen) -> _Texture:
    """The texture which a design assumes.

    Blurred by the microlenses' width; diffraction at the FAP, the same uncertainty of place and direction as that at
    the microlenses, would count twice. Detail finer than two microlenses (in hexagonal arrays root three) is not
    counted: single views show it as something else.

    Parameters
    ----------
    c : Camera
    plane : Seen
        The plane looked at.

    Returns
    -------
    Texture
        In a quarter of all directions, for their mirror images in x too. Leading axes are those of builds and of the
        plane.
    """
    limit = PACKINGS[c.layout].fold
    shape = np.broadcast_shapes(np.shape(plane.disparity), np.shape(plane.scale), c.shape)
    contrast, period = c["depth.contrast"], c.numbers.get("depth.period")
    finest = np.broadcast_to(ratio(magnitude(c.d * plane.scale), period or c.numbers.get("depth.finest", 0.0)), shape)
    strength = np.broadcast_to(np.square(contrast), shape)
    if period is not None:
        strength = np.where(finest <= limit, strength, 0.0)
    waves = _waves(OCTAVE_NODES[0][1] if period is None else None, DIRECTIONS)
    return _Texture(np.minimum(finest, limit), strength, waves, c.lens_shape)


@functools.lru_cache
def _waves(octave: int | None, directions: int) -> Spectrum:
    """Waves of unit texture: so many nodes over an octave of periods, or None of one period, in each direction."""
    at = radial = np.ones(1)
    if octave is not None:
        # The same contrast in each octave of k: its square over ln(2), per step of ln(k).
        nodes, weights = gauss_legendre(octave)
        at, radial = (nodes + 1) / 2, weights / (nodes + 1) / math.log(2)
    nodes, weights = gauss_legendre(directions)
    angle, turn = (nodes + 1) * (math.pi / 4), weights / 2
    pairs = (at, np.cos(angle)), (at, np.sin(angle)), (radial, turn)
    return Spectrum(*(np.outer(part, along).ravel() for part, along in pairs))


def _waves_needed(disparity: Array, fine: Array, wide: Array) -> Iterator[tuple[Spectrum, Array]]:
    """Waves of a texture with detail of every size, and the share that their sum has in each image's information.

    Parameters
    ----------
    disparity : ndarray, shape (N,)
        B [pitches].
    fine : ndarray, shape (N,)
        Finest detail [periods a pitch].
    wide : ndarray, shape (N,)
        Pitches across each image: phases turn over the image by B, among images that overlap by ``wide - B``.
    """
    overlap = np.maximum(wide - 1, 0.0)
    turns = fine * np.maximum((1 + overlap) * np.abs(disparity), (1.35 + 2.4 * overlap) * (wide - disparity))
    before = np.ones(turns.shape)
    for bound, octave in OCTAVE_NODES:
        after = np.clip((turns / bound - SEAM) / (1 - SEAM), 0.0, 1.0)
        share, before = before - after, after
        for some, count in ((wide < OVERLAPPING, DIRECTIONS), (wide >= OVERLAPPING, FINER)):
            yield _waves(octave, count), share * some


def view_gradient(c: Camera, plane: Seen) -> Array:
    """G, the rms gradient that single views show [contrast per microlens pitch]."""
    waves = texture(c, plane).as_views_show
    return np.asarray(2 * math.pi * np.sqrt(((waves.x**2 + waves.y**2) * waves.power).sum(-1)))


def _disparity_information(
    images: MicrolensImages, plane: Seen, waves: Spectrum | None = None, beside: Beside = NOTHING
) -> Array:
    """`_informations` in one noise, shape (fields, builds)."""
    return np.asarray(_informations(images, plane, waves, (beside,))[0])


def _informations(images: MicrolensImages, plane: Seen, waves: Spectrum | None, besides: tuple[Beside, ...]) -> Array:
    """Fisher information that one exposure of one microlens image has of B [1/pitch^2].

    Parameters
    ----------
    images : MicrolensImages
        At the fields asked for; tilts of FAP, main lens, array and sensor are left out.
    plane : Seen
        The plane looked at; it broadcasts with the builds.
    waves : Spectrum, shape (W,), optional
        Of the texture there, half of each wave's power being that of its mirror image in x. None is `texture`.
    besides : tuple of Beside
        What pixels have beside the picture's light and its noise: of each noise that the same signal is seen in.

    Returns
    -------
    ndarray, shape (noises, fields, builds)
        With the texture unknown. 0 without light, beyond the full well, and where images overlap many times. Behind
        colour filters of a texture without colour, in white light: what the pixels of each colour tell, added up.
    """
    c = images.camera
    if parts := [(one.share, images.by(through_filter(c, one))) for one in filters(c.colours)]:
        return np.asarray(sum(share * _informations(part, plane, waves, besides) for share, part in parts))
    one = np.ones(())
    own = texture(c, plane) if waves is None else _Texture(one, one, waves)
    rows = _rows_of(images, plane, own, besides)
    builds = _builds(images, plane)
    shape = (len(images.fields), *builds)
    array = _Array(c.layout, c.lens_shape, bool(c.shape))
    fill, whole = rows.wide, rows.whole
    usable = np.isfinite(fill) & (fill < WIDEST) & (fill > 0) & np.isfinite(rows.light) & (rows.light > 0)
    held, filled = rows.light[:, None] <= rows.room, rows.filling(PACKINGS[c.layout].rise)
    usable &= held.any(1)
    rows = rows._replace(room=np.where(filled[:, None], rows.room, math.inf))
    # A texture too fine for single views has no strength, and tells nothing at whatever cost.
    usable &= np.isfinite(rows.texture.fine) & np.isfinite(rows.texture.strength) & (rows.texture.strength > 0)
    level = np.where(usable, np.minimum(2 * np.ceil(rows.finest / 2), SHARPEST).clip(2, None), 0).astype(int)
    information = np.zeros((fill.size, len(besides)))
    level = np.where(usable & (rows.finest > SHARPEST), SHARPEST + 1, level)
    shares: Iterable[tuple[Spectrum, Array]] = [(own.waves, np.ones(fill.size))]
    if waves is None and "depth.period" not in c.numbers:
        disparity = np.broadcast_to(plane.disparity, shape).ravel()
        shares = _waves_needed(*(np.where(usable, part, 0.0) for part in (disparity, rows.texture.fine, fill)))
    details = (np.flatnonzero(np.bincount(level, minlength=2)[1:]) + 1).tolist()
    foldable = rows.openings.first_is_disc and PACKINGS[c.layout].rise == 1
    for (spectrum, share), detail, uncut, full in itertools.product(shares, details, (False, True), (False, True)):
        mine = np.flatnonzero((level == detail) & (whole == uncut) & (filled == full) & (share > 0))
        if mine.size:
            alike = spectrum.folded if uncut and foldable else spectrum
            some = rows.at(mine)._replace(texture=rows.texture.at(mine)._replace(waves=alike))
            part = (_interpolated if uncut else _each)(some, array, detail, uncut)
            information[mine] += share[mine, None] * part
    return np.where(held, information, 0.0).T.reshape(-1, *shape)


def _builds(images: MicrolensImages, plane: Seen) -> tuple[int, ...]:
    return np.broadcast_shapes(images.camera.shape or (1,), np.shape(plane.disparity), np.shape(plane.scale))


def _rows_of(
    images: MicrolensImages, plane: Seen, texture: _Texture, besides: tuple[Beside, ...] = (NOTHING,)
) -> _Images:
    """Every field of every build, one after the other."""
    c = images.camera
    openings = images.openings
    builds = _builds(images, plane)
    shape = (len(images.fields), *builds)
    pitch = magnitude(microlens_image_pitch(c))
    bend = ratio(plane.disparity * pitch, magnitude(microlens_image_diameter(c)))
    defocus = -microlens_defocus(c) / c.seen.d_2
    light = electrons(c) * images.level * response(c, np.hypot(*images.microlens[:2]))
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
    return _Images(*rows)


def _each(images: _Images, c: _Array, level: int, whole: bool) -> Array:
    count, side = images.pitch.size, _orders(c, min(level, SHARPEST))[0].size
    values = side * (1 + images.texture.waves.x.size)
    turns = images.wide * (side / 2 + np.abs(images.bend) * images.texture.fine)
    c = c._replace(many=c.many or count * values * max(ROWS, math.pi * float(turns.max())) > MANY)
    block = max(1, VALUES // (side * values))
    parts = [np.arange(start, min(start + block, count)) for start in range(0, count, block)]
    return np.concatenate([_sharpened(images.at(part), c, level, whole) for part in parts])


_Case = tuple[_Array, int, int, bytes, str | None]
"""Array, level, count of noises, spectrum and shape of the lenses, which the images of a series have in common."""


def _interpolated(images: _Images, c: _Array, level: int, whole: bool) -> Array:
    """Information of whole images, shape (N, M): of many by series in `_coordinates`, over boxes that hold them all.

    Sigma to 1e-4 of what sums give. A box is halved until its series is right to `TRUE` at the outermost of its images,
    which took no part in it, and at some between. Images too few for a series are summed. Fewer that lie close about
    the first are taken from tangents there: so are its derivatives.
    """
    # Builds that differ in what whole images do not depend on are worked out once.
    numbers = np.column_stack([*images[:-2], *images.texture[:2], *images.own_shape])
    _, first, again = np.unique(numbers, axis=0, return_index=True, return_inverse=True)
    if first.size < images.pitch.size:
        return _interpolated(images.at(first), c, level, whole)[again]
    few = images.pitch.size < NEARLY_ALIKE
    if not (images.texture.fine > 0).all() or (few and np.isfinite(images.room).any()):
        return _each(images, c, level, whole)
    about, reach, scale = _coordinates(images)
    *_, waves, lens_shape = images.texture
    case = (c, level, scale.shape[1], np.stack(waves).tobytes(), lens_shape)
    if few:
        logarithms = _by_tangents(case, about)
        return _each(images, c, level, whole) if logarithms is None else np.exp(logarithms) * scale
    information, alone = np.zeros(scale.shape), np.zeros(len(scale))
    boxes = [(np.arange(len(scale)), np.ones(len(scale)))]
    while boxes:
        mine, weight = boxes.pop()
        here = about[:, mine]
        least, most = here.min(1), here.max(1)
        # Of round sizes at round places, so that the next block of builds has the same.
        half = 2 ** (np.ceil(4 * np.log2(np.maximum(most - least, 1e-9) * 8 / 7)) / 4) / 2
        middle = np.round(2 * (least + most) / half) * half / 4
        shares = half / reach
        terms = _terms(tuple(shares.tolist()))
        if FEW * min(len(terms), MOST) > mine.size:
            alone[mine] += weight
            continue
        if len(terms) <= MOST:
            away = (here - middle[:, None]) / half[:, None]
            values = _series(case, middle.tobytes(), half.tobytes(), tuple(shares.tolist()))
            with np.errstate(all="ignore"):  # where nothing tells anything, no series is right
                guessed = np.exp(_sum_of(values, away, terms)) * scale[mine]
            ends = away[terms.any(0)]
            some = np.unique([*ends.argmin(1), *ends.argmax(1), *range(0, mine.size, 1 + mine.size // CHECKS)])
            summed = _each(images.at(mine[some]), c, level, whole)
            if (np.abs(guessed[some] - summed) <= TRUE * summed).all():
                information[mine] += weight[:, None] * guessed
                continue
        widest = np.argmax(shares)
        above = np.clip((here[widest] - middle[widest]) / (HALVED * half[widest]) + 0.5, 0.0, 1.0)
        if (above > 0).all() or (above < 1).all():
            alone[mine] += weight
        else:
            boxes += [(mine[part > 0], (weight * part)[part > 0]) for part in (1 - above, above)]
    some = np.flatnonzero(alone)
    if some.size:
        information[some] += alone[some, None] * _each(images.at(some), c, level, whole)
    return information


def _by_tangents(case: _Case, about: Array) -> Array | None:
    """Logarithm of information of images that lie close about the first; None of others."""
    free = np.flatnonzero(np.ptp(about, axis=1) > 1e-12)
    away = (about - about[:, :1])[free]
    if about.shape[1] < max(3, free.size + 2) or np.abs(away).max(initial=0.0) > CLOSE:
        return None
    nodes = np.repeat(about[:, :1], free.size + 1, axis=1)
    nodes[free, 1:] += STEP * np.eye(free.size)
    values = _logarithms(case, len(nodes), nodes.tobytes())
    slopes = (values[1:] - values[0]) / STEP if np.isfinite(values).all() else np.inf
    return values[0] + away.T @ slopes if np.abs(slopes).max(initial=0.0) <= STEEPEST else None


def _coordinates(images: _Images) -> tuple[Array, Array, Array]:
    """Numbers that information hangs on, (K, N); distances over which they bend it, (K,); a factor to it, (N, M).

    In units of the pitch and of the light: logarithms of the detail that diffraction passes, of the pixel, of how fine
    the texture is and of the opening's sizes; defocus, and periods of the finest detail that B holds. Where pixels fill
    also the contrast; and in each noise logarithms of three kinds of variance, and the share of the well that is full.
    """
    light, fine, shape = images.light[:, None], images.texture.fine, images.own_shape
    shot, filled = images.shot / light, np.isfinite(images.room).any()
    noise = (shot if filled else np.ones(shot.shape), images.dark / light + 1e-6, images.uneven * light + 1e-6)
    rows = [np.log(images.finest), np.log(images.pixel / images.pitch), np.log(fine)]
    rows += [images.defocus * images.distance * images.width / images.pitch, images.contrast * filled]
    rows += [images.bend * np.exp(shape[0]) * fine, *shape]
    rows += [*np.log(np.concatenate(noise, 1)).T, *(light / images.room).T]
    noises = shot.shape[1]
    reach = np.array([0.8, 4.0, 3.0, 1.0, 1.0, 1.2, *[1.0] * len(shape), *[5.0] * 3 * noises, *[0.3] * noises])
    return np.stack(rows), reach, (images.texture.strength / images.wide**2)[:, None] / (1.0 if filled else shot)


@functools.lru_cache(maxsize=4096)
def _logarithms(case: _Case, rows: int, nodes: bytes) -> Array:
    """Logarithm of information at places in `_coordinates`, shape (places, M), the factor left out."""
    array, level, noises, spectrum, lens_shape = case
    places, split = np.frombuffer(nodes).reshape(rows, -1), rows - 4 * noises
    sharp, pixel, fine, blurred, contrast, turns, *shape = places[:split]
    shot, dark, uneven, full = (part.T for part in places[split:].reshape(4, noises, -1))
    fine, one = np.exp(fine), np.ones(sharp.size)
    with np.errstate(divide="ignore", invalid="ignore"):  # of what tells nothing there is no series
        noise = (*(np.maximum(np.exp(part) - 1e-6, 0.0) for part in (dark, uneven)), np.exp(shot), 1 / full)
        bend = turns / (fine * np.exp(shape[0]))
        waves = _Texture(fine, one, Spectrum(*np.frombuffer(spectrum).reshape(3, -1)), lens_shape)
        own: Any = [one, one, np.exp(-sharp), blurred, np.exp(pixel), one, *noise, contrast, one, bend, one]
        own += [_opening_of(*shape), waves]
        values = np.log(_each(_Images(*own), array, level, whole=True))
    values.setflags(write=False)
    return values


@functools.lru_cache(maxsize=256)
def _terms(shares: tuple[float, ...]) -> NDArray[np.intp]:
    """Powers along the axes of the terms that count, shape (terms, K), where each power along one adds such a share."""
    terms, left, powers = np.zeros((1, 0), np.intp), np.ones(1), np.arange(len(NESTED))
    for share in shares:
        more = left[: MOST + 1, None] * share**powers
        row, power = np.nonzero((more >= FAINTEST) | (powers == 0))
        terms, left = np.column_stack([terms[row], power]), more[row, power]
    return terms


@functools.lru_cache(maxsize=256)
def _series(case: _Case, middle: bytes, half: bytes, shares: tuple[float, ...]) -> Array:
    """Coefficients of the terms of a series over a box, shape (terms, M).

    Through as many places as there are terms: nested along each axis, they pin all of them down.
    """
    terms = _terms(shares)
    offsets = NESTED[terms].T
    places = np.frombuffer(middle)[:, None] + np.frombuffer(half)[:, None] * offsets
    logarithms = _logarithms(case, len(places), places.tobytes())
    with np.errstate(invalid="ignore"):
        return np.asarray(np.linalg.solve(np.stack(list(_powers(offsets, terms)), -1), logarithms), float)


def _sum_of(values: Array, away: Array, terms: NDArray[np.intp]) -> Array:
    """Series at places, shape (places, M)."""
    axes = np.flatnonzero(terms.any(0))
    total = np.zeros((away.shape[1], values.shape[1]))
    for value, power in zip(values, _powers(away[axes], terms[:, axes]), strict=True):
        total += np.multiply.outer(power, value)
    return total


def _powers(away: Array, terms: NDArray[np.intp]) -> Iterator[Array]:
    """Chebyshev polynomials of places, shape (axes, places), multiplied as each of the terms says."""
    single = [np.ones_like(away), away]
    for _ in range(1, terms.max(initial=0)):
        single.append(2 * away * single[-1] - single[-2])
    for term in terms:
        factors = [single[degree][axis] for axis, degree in enumerate(term) if degree]
        yield functools.reduce(np.multiply, factors) if factors else np.ones(away.shape[1])


def _sharpened(images: _Images, c: _Array, level: int, whole: bool) -> Array:
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
    """Spectra of the light of each wave that stops leave, before diffraction; arrays broadcast to (N, 1 + W, S, S)."""

    fx: Array
    """Frequencies along x: of the uniform light, by which all is divided, then of the texture's waves."""
    fy: Array
    cell: float
    light: Array | Complex
    turned: Array | Complex
    """Change of each wave with B over i, shape (N, W, S, S)."""
    power: Array
    """Power of the texture's waves, shape (N, W)."""
    even: bool
    """True where images are as before after half a turn: the light is real then, and its change over i."""

    def images(self, passed: Array) -> tuple[Complex, Complex, Array]:
        """Waves' images and, over i, their changes, and how often each of their places counts.

        Of even ones one half of the places: in the other the images are complex conjugates.
        """
        if not self.even:
            return np.fft.ifft2(self.light * passed), np.fft.ifft2(self.turned * passed[:, 1:]), np.ones(())
        side = self.light.shape[-1]
        light, turned = (
            np.fft.ifft(np.fft.rfft(part, norm="forward"), axis=-2)
            for part in (self.light.real * passed, self.turned.real * passed[:, 1:])
        )
        return light, turned, np.where(np.arange(side // 2 + 1) % (side // 2) > 0, 2.0, 1.0)


def _spectra(images: _Images, waves: Spectrum, c: _Array, level: int, whole: bool) -> _Spectra:
    count = len(images.pitch)
    kx, ky = (np.concatenate([np.zeros((count, 1)), k], 1)[..., None, None] for k in waves[:2])
    x, y, cell = _orders(c, level)
    fx, fy, bend = kx + x, ky + y, images.bend[:, None, None, None]
    form = _cut
    if whole:
        form = _straight if not images.openings.first_is_disc else _whole if c.many else _cut
    light, along, across = form(images, fx - bend * kx, fy - bend * ky)
    per_wide = 2 * math.pi / images.wide[:, None, None, None]
    turned = per_wide * kx[:, 1:] * along[:, 1:] + per_wide * ky[:, 1:] * across[:, 1:]
    return _Spectra(fx, fy, cell, light, turned, waves.power, whole)


def _information(images: _Images, c: _Array, spectra: _Spectra) -> Array:
    """Information of images in each of their noises, shape (N, M): one signal, weighed by each."""
    count, side = len(images.pitch), spectra.light.shape[-1]
    passed = _transfer(images, c, spectra.fx, spectra.fy) * (side * side / spectra.cell)
    light, turned, times = spectra.images(passed)
    own_light = images.light[:, None, None] * np.maximum(light[:, :1].real, 0.0).reshape(count, 1, -1)
    variance = images.variance(own_light)
    area = spectra.cell / side**2 * (images.pitch / images.pixel) ** 2
    weight = (images.light**2 * area)[:, None, None] / np.maximum(variance, 1e-300)
    if np.isfinite(images.room).any():
        weight *= images.unfilled(own_light)
    weight *= np.broadcast_to(times, light.shape[-2:]).ravel()
    weight = np.repeat(weight, 2, axis=-1).swapaxes(1, 2)  # of real and imaginary parts, side by side

    def parts(values: Complex) -> Array:
        return np.ascontiguousarray(values).view(float).reshape(count, values.shape[1], -1)

    change, shown = parts(turned), parts(light[:, 1:])
    own, free, mixed = (product @ weight for product in (change * change, shown * shown, change * shown))
    mixed = mixed**2 if spectra.even else mixed**2 + (change * parts(1j * light[:, 1:]) @ weight) ** 2
    return np.asarray(((own - ratio(mixed, free)) * spectra.power[..., None]).sum(1))


def _orders(c: _Array, finest: float) -> tuple[Array, Array, float]:
    """Frequencies of a lattice that images with so fine a detail have, and the area of its cell.

    Along x, shape (S, 1), and y, (S, S) or where all rows are alike (1, S), in the order of a Fourier transform over
    the lattice's directions [periods per pitch].
    """
    packing = PACKINGS[c.layout]
    side = 2 * math.ceil(packing.orders * finest) + 2
    n = np.asarray(np.fft.fftfreq(side, 1 / side), np.float64)
    up = packing.wave_up(n[:, None], n)
    return n[:, None], up[:1] if (up == up[0]).all() else up, packing.rise


def _whole(images: _Images, fx: Array, fy: Array) -> Spectra:
    """Fourier transforms of a whole disc and, over i, of its first moments along x and y [pitches]."""
    radius = images.openings.radii[:, 0, None, None, None]
    first, bent = _bessel_quotients(np.square(2 * math.pi * radius) * (fx * fx + fy * fy))
    # The moment is i/(2 pi) times the derivative.
    moment = -4 * math.pi**2 * radius**4 * bent
    return 2 * math.pi * radius**2 * first, moment * fx, moment * fy


def _bessel_quotients(square: Array) -> tuple[Array, Array]:
    """Bessel functions ``J_1(z)/z`` and ``J_2(z)/z^2`` by z squared, to 1e-11.

    Taylor series about tabled places: by z^2, ``J_n/z^n`` changes by ``-J_(n+1)/z^(n+1)/2``.
    """
    node = np.rint(TABLED * np.sqrt(square)).astype(np.intp)
    step = (np.square(node / TABLED) - square) / 2
    one, two, three, four, five = (table[node] for table in _bessel_tables(int(node.max(initial=1)).bit_length()))
    return (
        one + step * (two + step / 2 * (three + step / 3 * four)),
        two + step * (three + step / 2 * (four + step / 3 * five)),
    )


@functools.lru_cache
def _bessel_tables(bits: int) -> list[Array]:
    """Quotients ``J_n(z)/z^n`` for n from 1 to 5, at so many places that they have so many bits."""
    from scipy.special import hyp0f1

    square = np.square(np.arange(2**bits) / TABLED)
    return [hyp0f1(n + 1, -square / 4) / (2**n * math.factorial(n)) for n in range(1, 6)]


def _straight(images: _Images, fx: Array, fy: Array) -> Spectra:
    """Fourier transforms of a whole rectangle and, over i, of its first moments along x and y [pitches]."""
    corners = images.openings.corners[:, images.openings.polygons.index(0)]
    sides = [(corners[:, 0] - corners[:, k]) / 2 for k in (1, 3)]
    (ax, ay), (bx, by) = (tuple(side.T[..., None, None, None]) for side in sides)
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


def _cut(images: _Images, fx: Array, fy: Array) -> Spectra:
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

    def transforms(some: slice) -> Spectra:
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


def _transfer(images: _Images, c: _Array, fx: Array, fy: Array) -> Array:
    """Transfer of diffraction, defocus and the pixel at each frequency [periods per pitch]."""
    per_mm = (1 / images.pitch)[:, None, None, None]
    box = images.pixel[:, None, None, None] * per_mm
    pixel = pixel_box(fx, box) * pixel_box(fy, box)
    own = (images.width, images.distance, images.defocus, images.wavelength)
    wide, far, blurred, wave = (value[:, None, None, None] for value in own)
    lenses = LENS_SHAPES[c.lens_shape].factors(wide, far, blurred, wave, fx * per_mm, fy * per_mm)
    return math.prod(lenses, start=pixel)


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
    rows: _Images
    form: Callable[[_Images, Array, Array], Spectra]
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
        array = _Array(images.camera.layout, images.camera.lens_shape)
        # Images stand alone where they repeat themselves after a few pitches only: a mean over as many waves.
        some = (np.arange(APART) - APART // 2) / APART if mean else np.zeros(0)
        half = APART**2 // 2 if more and mean else 0
        first, second = (values.ravel()[half:] for values in np.meshgrid(some, some, indexing="ij"))
        first, second = (np.append(one, [wave[k] for wave in more]) for k, one in enumerate((first, second)))
        kx, ky = first, PACKINGS[array.layout].wave_up(first, second)
        none, one = np.zeros(1), np.ones(())
        rows = _rows_of(images, Seen(np.zeros(()), np.ones(())), _Texture(one, one, Spectrum(none, none, none)))
        whole = bool(rows.whole.all())
        finest = FINEST_PLACES if whole else FINEST_CUT
        wider = np.where(rows.finest > finest, rows.wavelength * rows.finest / finest, rows.wavelength)
        rows = rows._replace(wavelength=wider)
        *orders, cell = _orders(array, float(rows.finest.max(initial=1.0)))
        waves = (k[:, None, None] + f for k, f in zip((kx, ky), orders, strict=True))
        fx, fy = (np.broadcast_to(f, (len(rows.pitch), *f.shape)) for f in waves)
        form, image = _cut, np.broadcast_to(np.eye(2), (len(rows.pitch), 2, 2)) if image is None else image
        if whole:
            form = _whole if rows.openings.first_is_disc else _straight
        else:  # rows of a cut image stay rows
            image = np.sqrt(np.abs(np.linalg.det(image)))[:, None, None] * np.eye(2)
        along, across = np.exp(2j * math.pi * fx[0] * x), np.exp(2j * math.pi * fy[0, ..., None] * y)
        pixel = float(rows.pixel[0] / rows.pitch[0])
        reads = [at(fx[0] * pixel) for at in read[0]], [at(fy[0] * pixel) for at in read[1]]
        passed = _transfer(rows, array, fx, fy) / cell
        return cls(first, second, rows, form, fx, fy, passed, along, across, reads, image)

    def spectra(self) -> Spectra:
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
    spectra: Spectra
    turns: Complex
    """Turn of each wave at each of `STEPS`, shape (steps, W); all four of lenses farther away are left out."""

    @classmethod
    def of(cls, images: MicrolensImages, x: Array, y: Array, read: Read, image: Array | None = None) -> _OwnWaves:
        slow = 1 / (4 * FAR)
        waves = _WavesOfLenses.of(images, x, y, read, ((slow, 0.0), (0.0, slow)), image=image)
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
        light = self.alone(at)
        light = np.where(np.abs(light) > FAINT, light, 0.0)  # read beside a rim it may be below none
        even = (at[0].real - light.sum(0)) / 4
        odd = (at[-2:].imag - np.einsum("aw,a...->w...", -self.turns[:, -2:].imag, light)) / 2
        return np.concatenate([light, [even + odd[0], even - odd[0], even + odd[1], even - odd[1]]])


def across_lenses(shape: LensShape, turn: Number, fx: Array, fy: Array, periods: Array) -> Array:
    """Transfer of waves over that of their light where microlenses are out of focus on the FAP.

    What passes a side of a microlens then moves on the sensor, and shows the texture behind that side.

    Parameters
    ----------
    shape : LensShape
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


def light_read(images: MicrolensImages, x: Array, y: Array, read: Read) -> Array:
    """Light of `image_parts` at places that are read in several ways: shape (steps, ways, T, S).

    Of a single field; every way along x is paired with each along y, those along x first.
    """
    return _OwnWaves.of(images, x, y, read).light


def share_saturated(c: Camera) -> float:
    """Share of the pixels on the axis that hold more than the full well, neighbours' light where images overlap too."""
    images, rise = MicrolensImages(panchromatic(c), [(0.0, 0.0)]), PACKINGS[c.layout].rise
    if not _overlapping(float(fill_factor(c)), rise, images.openings.first_is_disc) > FULL:
        return 0.0
    from scipy.special import ndtr

    places = (np.arange(CELL_PLACES) + 0.5) / CELL_PLACES
    x, y = places, np.concatenate([places, 1 + places]) * rise  # rows of hexagonal arrays alternate
    charge = float(electrons(c)) * light_read(images, x, y, AS_IT_IS).sum(0)
    spread = np.sqrt(np.maximum(charge, 0.0) + dark_variance(c) + np.square(c["depth.contrast"] * charge))
    return float(ndtr((charge + veil_electrons(c) - c["sensor.full_well"]) / spread).mean())


def disparity_sigmas(images: MicrolensImages, plane: Seen, besides: tuple[Beside, ...] = (NOTHING,)) -> Array:
    """Standard error of the disparity between the FAP's rims [microlens pitches]; inf where nothing tells it.

    Parameters
    ----------
    images : MicrolensImages
        At the fields asked for; tilts of FAP, main lens, array and sensor are left out.
    plane : Seen
        The plane looked at.
    besides : tuple of Beside
        What pixels have beside the picture's light and its noise, in each of several noises; by default nothing: the
        bound that noise sets.

    Returns
    -------
    ndarray, shape (noises, fields, builds)
        Of a square of ``depth.window`` rows of microlenses; as ``depth.disparity_error`` has it where that is given,
        wherever there is light.
    """
    c = images.camera
    fixed = c.numbers.get("depth.disparity_error")
    if fixed is not None:
        lit = images.shapes.lit
        return np.stack(len(besides) * [np.where(lit, np.broadcast_to(np.asarray(fixed), lit.shape), np.inf)])
    # Rows of a hexagonal array are closer than a pitch, and windows as wide as they are high.
    total = _informations(images, plane, None, besides) * c["depth.window"] ** 2 * PACKINGS[c.layout].rise
    with np.errstate(divide="ignore"):
        return np.asarray(1 / np.sqrt(np.maximum(total, 0.0)))


def disparity_sigma(images: MicrolensImages, plane: Seen, beside: Beside = NOTHING) -> Array:
    """`disparity_sigmas` in one noise, shape (fields, builds)."""
    return np.asarray(disparity_sigmas(images, plane, (beside,))[0])


def axial_disparity_sigmas(c: Camera, plane: Seen, besides: tuple[Beside, ...] = (NOTHING,)) -> Array:
    """`disparity_sigmas` of a microlens whose image nothing cuts, shape (noises, builds); tilts left out."""
    if "depth.disparity_error" in c.numbers:
        return np.stack(len(besides) * [np.asarray(c["depth.disparity_error"])])
    sigmas = disparity_sigmas(_Uncut(c, [(0.0, 0.0)]), plane, besides)[:, 0]
    return np.asarray(sigmas if c.shape or np.ndim(plane.scale) else sigmas[:, 0])


def axial_disparity_sigma(c: Camera, plane: Seen, beside: Beside = NOTHING) -> Array:
    """`axial_disparity_sigmas` in one noise, shape of the builds."""
    return np.asarray(axial_disparity_sigmas(c, plane, (beside,))[0])


class _Uncut(MicrolensImages):
    """The microlens on the axis and the FAP as its only stop."""

    def by(self, camera: Camera) -> MicrolensImages:
        """Image on the axis of another camera."""
        return _Uncut(camera, self.fields)

    @property
    def openings(self) -> Openings:
        """The FAP's alone."""
        shape = (1, *(self.camera.shape or (1,)))
        image = self.camera.fap.outline.sized(magnitude(microlens_image_diameter(self.camera)))
        return Openings.of(image, shape)
