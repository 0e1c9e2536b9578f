"""Series that stand for sums of information over many builds, in the few numbers that it hangs on."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from ..bore.opening import ClearAperture
from ..shapes.openings import Openings
from .disparity_information import ArrayKind, ImageRows, Spectrum, Texture, summed_information

NEARLY_ALIKE = 64
"""Images from which series stand in for sums."""
TRUE, CHECKS = 1e-4, 24
"""Error that a series may have in information where it is checked: at the outermost images along each axis and at so
many of the farthest out (an eighth at most). Twice that elsewhere still keeps sigma, which goes with the root,
to 1e-4."""
FAINTEST, FINER = 2e-6, 4.0
"""Share from which on a term counts, as far as `_coordinates` foresees it; and by how much fainter ones count in a
series after one that was not right."""
MOST, FEW, LOST, HALVED = 600, 3, 5, 0.1
"""Terms of a series beyond which its box is halved instead; images for each of them, at least; all images for each sum
that goes into series that are not right; and the share of a box over which halves give way to each other, so that sigma
has slopes there too."""
LITTLE, SLOPES = 1e-3, 64
"""Spread of a coordinate, over its reach, from which on it tells others; and steps in a unit of how much of them."""
NESTED = np.array([0.0, 1.0, -1.0, -0.577, 0.659, -0.839, 0.87, 0.306, -0.321, -0.943, 0.953, 0.48, -0.712, -0.156])
"""Places along an axis, each where it adds most to those before it (Leja)."""
CLOSE, STEP = 0.004, 1e-5
"""Distance from the first image, in logarithms, within which fewer are taken from its tangents, to about the square of
that; and the step of the differences that tangents are."""
STEEPEST = 100.0
"""Slope from which on tangents are not taken: where next to nothing is left of a texture, rounding makes them."""
_Case = tuple[ArrayKind, int, int, bytes, str | None]
"""Array, level, count of noises, spectrum and shape of the lenses, which the images of a series have in common."""


def interpolated_information(images: ImageRows, c: ArrayKind, level: int) -> Array:
    """Information of whole images, shape (N, M): of many by series in `_coordinates`, over boxes that hold them all.

    Sigma to 1e-4 of what sums give: a series takes on terms, then its box is halved, until it is right to `TRUE`. Few
    images are summed, or taken from tangents at the first; so are all left once failed series cost a share of `LOST`.
    """
    # Builds that differ in what whole images do not depend on are worked out once, in their order; compared as bytes.
    numbers = np.column_stack([*images[:-2], *images.texture[:2], *images.own_shape])
    rows = numbers.view(np.dtype((np.void, numbers.strides[0])))[:, 0]
    _, first, again = np.unique(rows, return_index=True, return_inverse=True)
    if first.size < images.pitch.size:
        order = np.argsort(first)
        return interpolated_information(images.at(first[order]), c, level)[np.argsort(order)[again]]
    few = images.pitch.size < NEARLY_ALIKE
    if not (images.texture.fine > 0).all() or (few and np.isfinite(images.room).any()):
        return summed_information(images, c, level, whole=True)
    about, reach, scale = _coordinates(images)
    *_, waves, lens_shape = images.texture
    case = (c, level, scale.shape[1], np.stack(waves).tobytes(), lens_shape)
    if few:
        logarithms = _by_tangents(case, about)
        return summed_information(images, c, level, whole=True) if logarithms is None else np.exp(logarithms) * scale
    information, alone = np.zeros(scale.shape), np.zeros(len(scale))
    about, spread = _uncorrelated(about / reach[:, None])
    along, spread = np.sqrt(np.square(spread).sum(0)), reach[:, None] * spread
    spare = len(scale) // LOST
    boxes = [(np.arange(len(scale)), np.ones(len(scale)))]
    while boxes:
        mine, weight = boxes.pop()
        here = about[:, mine]
        least, most = here.min(1), here.max(1)
        # Of round sizes at round places, so that the next block of builds has the same.
        half = 2 ** (np.ceil(4 * np.log2(np.maximum(most - least, 1e-9) * 8 / 7)) / 4) / 2
        middle = np.round(2 * (least + most) / half) * half / 4
        shares = half * along
        box = middle.tobytes(), half.tobytes(), spread.tobytes(), tuple(shares.tolist())
        terms, many = _terms(box[-1], 0), min(MOST, mine.size // FEW, spare)
        if min(len(terms), MOST) > many:
            alone[mine] += weight
            continue
        if len(terms) <= many:
            away = (here - middle[:, None]) / half[:, None]
            ends = away[terms.any(0)]
            far = np.argsort(-(shares @ np.abs(away)))[: min(CHECKS, mine.size // 8)]
            some = np.unique([*ends.argmin(1), *ends.argmax(1), *far])
            summed = summed_information(images.at(mine[some]), c, level, whole=True)
            known, finer, right = 0, 0, False
            while known < len(terms) <= many and not right:
                with np.errstate(all="ignore"):  # where nothing tells anything, no series is right
                    guessed = np.exp(_sum_of(_series(case, *box, finer), away, terms)) * scale[mine]
                right = bool((np.abs(guessed[some] - summed) <= TRUE * summed).all())
                known, finer = len(terms), finer + 1
                terms = _terms(box[-1], finer)
            if right:
                information[mine] += weight[:, None] * guessed
                continue
            spare -= known + some.size
        widest = np.argmax(shares)
        above = np.clip((here[widest] - middle[widest]) / (HALVED * half[widest]) + 0.5, 0.0, 1.0)
        if (above > 0).all() or (above < 1).all():
            alone[mine] += weight
        else:
            boxes += [(mine[part > 0], (weight * part)[part > 0]) for part in (1 - above, above)]
    some = np.flatnonzero(alone)
    if some.size:
        information[some] += alone[some, None] * summed_information(images.at(some), c, level, whole=True)
    return information


def _uncorrelated(about: Array) -> tuple[Array, Array]:
    """Coordinates less what those before them tell of them, and what turns these into the former, (K, K).

    Builds vary in few lengths, each of which moves several coordinates. Round slopes, so that the next block has them.
    """
    own, back = about.copy(), np.eye(len(about))
    for row, column in zip(*np.tril_indices(len(about), -1), strict=True):
        known = own[column] - own[column].mean()
        if np.ptp(known) > LITTLE:
            back[row, column] = np.round(SLOPES * (own[row] @ known) / (known @ known)) / SLOPES
            own[row] -= back[row, column] * own[column]
    return own, back


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


def _coordinates(images: ImageRows) -> tuple[Array, Array, Array]:
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
    scale = (images.texture.strength / images.wide**2)[:, None] / (np.ones(shot.shape) if filled else shot)
    return np.stack(rows), reach, scale


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
        waves = Texture(fine, one, Spectrum(*np.frombuffer(spectrum).reshape(3, -1)), lens_shape)
        own: Any = [one, one, np.exp(-sharp), blurred, np.exp(pixel), one, *noise, contrast, one, bend, one]
        own += [_opening_of(*shape), waves]
        values = np.log(summed_information(ImageRows(*own), array, level, whole=True))
    values.setflags(write=False)
    return values


def _opening_of(width: Array, height: Array | None = None, turn: Array | None = None) -> Openings:
    """Disc, or rectangle, of such sizes about the origin; sizes are logarithms."""
    if height is None or turn is None:
        return Openings.of_discs(np.zeros((width.size, 1, 2)), np.exp(width)[:, None] / 2)
    return Openings.of(ClearAperture(math.inf, (np.exp(width) / 2, np.exp(height) / 2), turn), width.shape)


@functools.lru_cache(maxsize=256)
def _terms(shares: tuple[float, ...], finer: int) -> NDArray[np.intp]:
    """Powers along the axes of the terms that count, by share, so that a finer series adds some: shape (terms, K)."""
    terms, left, powers = np.zeros((1, 0), np.intp), np.ones(1), np.arange(len(NESTED))
    for share in shares:
        more = left[: MOST + 1, None] * share**powers
        row, power = np.nonzero((more >= FAINTEST / FINER**finer) | (powers == 0))
        terms, left = np.column_stack([terms[row], power]), more[row, power]
    return terms[np.argsort(-left, kind="stable")]


@functools.lru_cache(maxsize=256)
def _series(case: _Case, middle: bytes, half: bytes, spread: bytes, shares: tuple[float, ...], finer: int) -> Array:
    """Coefficients of the terms of a series over a box, shape (terms, M).

    Through as many places as there are terms, a coarser one's first: nested along each axis, they pin them all down.
    """
    terms = _terms(shares, finer)
    offsets = NESTED[terms].T
    places = np.frombuffer(middle)[:, None] + np.frombuffer(half)[:, None] * offsets
    places = np.frombuffer(spread).reshape(len(places), -1) @ places
    parts = np.split(places, [len(_terms(shares, coarser)) for coarser in range(finer)], axis=1)
    logarithms = np.concatenate([_logarithms(case, len(part), part.tobytes()) for part in parts])
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
