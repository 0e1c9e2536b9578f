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

That holds for detail far above a pitch. Here it is taken detail by detail (`.disparity_information`), of many builds by
series (`.information_series`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array, magnitude, ratio
from ..camera import Camera, Number
from ..design.parts import OCTAVES
from ..shapes.discs import gauss_legendre
from ..shapes.lattice import PACKINGS
from .colours import filters, panchromatic
from .disparity_information import (
    FULL,
    SHARPEST,
    ArrayKind,
    ImageRows,
    Seen,
    Spectrum,
    Texture,
    folded_slopes,
    normal_share,
    overlapping,
    rows_of,
    shape_of_builds,
    summed_information,
)
from .f_number import fill_factor
from .image_parts import whole_light
from .information_series import interpolated_information
from .photometry import (
    FILLED,
    LARGEST_FILL,
    NOTHING,
    Beside,
    dark_variance,
    electrons,
    surely_held,
    through_filter,
    veil_electrons,
)
from .stop_images import MicrolensImages

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
WITHIN_REACH = 3
"""Places of a texture, each as bright as it happens to be, of which none may be full about a microlens that has a
depth: counted on walls simulated at 60 to 90 % of the full well, to 5 % of it."""
RARE = 2.5
"""Standard deviations of a texture's brightness above its mean at which the full well may lie: 2 % of the field is
lost."""
LEVELS = 15.0
"""Logarithm of electrons over the full well, either way, within which it is looked how much of the field is lost."""
MOST_LOST = 0.5
"""Share of the field that full pixels may leave without depth: where more has none, a required depth is not met, and
the working range has not begun. Who wants depth there gets none at most places, however well it is known at others."""
LARGEST_CHI2 = 3.0
"""Chi-square of samples above which views disagree, and there is no disparity."""
MOST_MISLED = 5.0
"""Errors over those of noise beyond which detail that aliases leaves less than half of the microlenses a disparity, as
neighbours ask for others: counted on walls before two cameras, from 1.9 to one microlens a period, in two lights."""
LEAST_TURNED = 0.25
"""Disparity at least that detail too fine for views is taken to be seen at [pitches]."""
AT_A_TIME = 16
"""Images of which such detail is worked out together."""
CELL_PLACES = 16
"""Places along a side of the lattice's cell at which is looked how many pixels are full."""


def finest_seen(c: Camera, plane: Seen) -> Array:
    """Finest detail of the texture at a plane [periods a pitch]: infinite where a design states none."""
    return ratio(magnitude(c.d * plane.scale), c.numbers.get("depth.period", c.numbers.get("depth.finest", 0.0)))


def folds(c: Camera, plane: Seen) -> NDArray[np.bool_]:
    """Where detail that a design states is too fine for single views, which show it as something else."""
    return np.asarray(("depth.finest" in c.numbers) & (finest_seen(c, plane) > PACKINGS[c.layout].fold))


def texture(c: Camera, plane: Seen) -> Texture:
    """The texture which a design assumes.

    Blurred by the microlenses' width; diffraction at the FAP, the same uncertainty of place and direction as that at
    the microlenses, would count twice. Detail finer than two microlenses (in hexagonal arrays root three) tells
    nothing: single views show it as something else, by which they differ (`folded_slopes`).

    Parameters
    ----------
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
    finest = np.broadcast_to(finest_seen(c, plane), shape)
    strength = np.broadcast_to(np.square(contrast), shape)
    if period is not None:
        strength = np.where(finest <= limit, strength, 0.0)
    waves = _waves(OCTAVE_NODES[0][1] if period is None else None, DIRECTIONS)
    return Texture(np.minimum(finest, limit), strength, waves, c.lens_shape)


@lru_cache
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
    own = texture(c, plane) if waves is None else Texture(one, one, waves)
    rows = rows_of(images, plane, own, besides)
    builds = shape_of_builds(images, plane)
    shape = (len(images.fields), *builds)
    array = ArrayKind(c.layout, c.lens_shape)
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
            sums = partial(summed_information, whole=False)
            information[mine] += share[mine, None] * (interpolated_information if uncut else sums)(some, array, detail)
    if waves is None and (folded := folds(c, plane)).any():
        finest = np.broadcast_to(finest_seen(c, plane), shape).ravel()
        folded = np.broadcast_to(folded, shape).ravel() & (information > 0).any(1)
        _mislead(information, rows, array, finest, level, np.stack([folded & ~whole, folded & whole]))
    return np.where(held, information, 0.0).T.reshape(-1, *shape)


def _mislead(
    information: Array, rows: ImageRows, array: ArrayKind, finest: Array, level: NDArray[np.intp], folded: Array
) -> None:
    """Less information, in place, where detail is `folded`, of images cut and whole: none where views disagree."""
    for whole, detail in itertools.product((False, True), np.unique(level[folded.any(0)]).tolist()):
        every = np.flatnonzero(folded[int(whole)] & (level == detail))
        for mine in np.array_split(every, math.ceil(every.size / AT_A_TIME)) if every.size else ():
            # In focus it moves as what it folds to, but no surface is all of it in focus.
            some = rows.at(mine)
            bend, least = some.bend, LEAST_TURNED / some.wide
            turned = np.where(np.abs(bend) < least, np.copysign(least, bend), bend)
            variance, squares = folded_slopes(some._replace(bend=turned), array, finest[mine], detail, whole)
            own = information[mine]
            times = 1 + ratio(variance, own)
            agree = (times <= MOST_MISLED**2) & (1 + squares <= LARGEST_CHI2)
            information[mine] = np.where(agree, own / times, 0.0)


def _brightest(c: Camera) -> float:
    """Electrons of light that a pixel may hold and be believed not to be full."""
    veil = float(veil_electrons(c))
    return surely_held(float(FILLED * c["sensor.full_well"]) - veil, float(dark_variance(c)) + veil)


def roomy(c: Camera) -> float:
    """Electrons of a scene's mean that leave its bright places room in the full well: half of it at most."""
    held = _brightest(c) / (1 + RARE * _texture_contrast(c))
    return max(min(held, LARGEST_FILL * float(c["sensor.full_well"])), 0.0)


def _texture_contrast(c: Camera) -> float:
    """Rms contrast of the texture's brightness, of all its octaves together."""
    return float(c["depth.contrast"]) * (1.0 if "depth.period" in c.numbers else math.sqrt(OCTAVES))


def share_full(c: Camera, at: Number | None = None, *, neighbours: bool = True) -> tuple[float, float]:
    """Share of pixels on the axis beyond the full well, by texture and noise, and of the field without depth for it.

    With the light of `neighbours` where images overlap, or as if they did not.
    """
    return _shares_full(c, float(electrons(c, at)) * (_light_of_cells(c) if neighbours else np.ones((1, 1))))


def full_within(c: Camera) -> float:
    """Distance ahead of the tip nearer than which more than `MOST_LOST` of the field is lost to full pixels [mm].

    Of light as bright everywhere 0, or infinite where that is lost.
    """
    cells, stated = _light_of_cells(c), c.numbers.get("light.measured_at")
    lit = float(electrons(c, stated))

    def excess(level: float) -> float:
        """Share lost beyond that, by the logarithm of a fully lit pixel's electrons."""
        return _shares_full(c, math.exp(level) * cells)[1] - MOST_LOST

    if stated is None:
        return math.inf if lit > 0 and excess(math.log(lit)) > 0 else 0.0
    well = math.log(float(c["sensor.full_well"]))
    low, high = well - LEVELS, well + LEVELS
    if not excess(high) > 0:  # no light gets there
        return 0.0
    from scipy.optimize import brentq

    return float(stated) * math.sqrt(lit / math.exp(brentq(excess, low, high))) if excess(low) < 0 else math.inf


def _light_of_cells(c: Camera) -> Array:
    """Light of all images at places of the lattice's cell, over that of a fully lit pixel."""
    images, rise = MicrolensImages(panchromatic(c), [(0.0, 0.0)]), PACKINGS[c.layout].rise
    if not overlapping(float(fill_factor(c)), rise, images.openings.first_is_disc) > FULL:
        return np.ones((1, 1))
    places = (np.arange(CELL_PLACES) + 0.5) / CELL_PLACES
    x, y = places, np.concatenate([places, 1 + places]) * rise  # rows of hexagonal arrays alternate
    return np.asarray(whole_light(images, x, y))


def _shares_full(c: Camera, charge: Array) -> tuple[float, float]:
    """`share_full` of pixels whose mean charge is known [electrons]."""
    light, contrast = np.maximum(charge, 0.0), _texture_contrast(c)
    scatter = np.sqrt(light + float(dark_variance(c) + veil_electrons(c)) + np.square(contrast * light))

    def share(most: float) -> float:
        return float(normal_share((charge - most) / scatter).mean())

    room = float(c["sensor.full_well"] - veil_electrons(c))
    return share(room), 1.0 - (1.0 - share(_brightest(c))) ** WITHIN_REACH


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
    """`disparity_sigmas` of the microlens in the array's middle, shape (noises, builds); tilts left out."""
    if "depth.disparity_error" in c.numbers:
        return np.stack(len(besides) * [np.asarray(c["depth.disparity_error"])])
    sigmas = disparity_sigmas(MicrolensImages(c, [(0.0, 0.0)]), plane, besides)[:, 0]
    return np.asarray(sigmas if c.shape or np.ndim(plane.scale) else sigmas[:, 0])


def axial_disparity_sigma(c: Camera, plane: Seen, beside: Beside = NOTHING) -> Array:
    """`axial_disparity_sigmas` in one noise, shape of the builds."""
    return np.asarray(axial_disparity_sigmas(c, plane, (beside,))[0])
