"""Each microlens's own light in its samples, and where on the FAP it comes from.

Diffraction and overlap bring light of neighbouring microlenses into a sample, which look at another place of the scene
from the other side of the FAP: taken for the microlens's own they shear the light field, and depth comes out wrong.
How much of it there is follows from the camera, and what the neighbours see stands in their own samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calibration.decoding import DARKEST, LightField, left_by_rows, read_between, squared
from ..camera import Camera
from ..shapes.lattice import PACKINGS
from ..theory.colours import panchromatic
from ..theory.exit_pupil import microlens_image_pitch
from ..theory.image_parts import AS_IT_IS, FINEST_PLACES, ImageParts, Read, image_parts, light_read
from ..theory.lens_shapes import LENS_SHAPES
from ..theory.light import microlens_defocus
from .mixing import FAINT, LEAST, STRONG, SURE, Mixing, add_neighbours, free_samples, freed_in_rounds
from .nodes import NodeMap, Nodes, TracedLens, cut_images, image_shapes, on_grid
from .warping import fill_holes

BLOCK, COMMON = 32, 12.0
"""Places at a time, for memory's sake, where diffraction passes so many periods in a pitch; fewer where more."""
BETWEEN, ALIKE = 8, 0.004
"""Places between pixels along each axis at which light is worked out; share of it up to which they are alike."""
MANY_BETWEEN, TURNED = 32, 0.2
"""Places between pixels that their mean is taken over; pixels by which samples of one microlens lie differently between
them, where the array is turned, beyond which it is taken of all."""
FARTHEST = 0.25
"""Pitches from a microlens's middle beyond which no sample is taken to look."""
CORNERS = (-1, -1), (-1, 1), (1, -1), (1, 1)
"""Places of a microlens that stand for all of it, over their rms along each axis."""
SHARED, SENT, PAYS = 0.3, 0.02, 1.3
"""Own share of a sample's light from which on it tells disparities where the picture says what neighbours send; share
from which on its place counts among those that they send from; times the information from which on that pays."""
TURNS, FREQUENCIES = 4, (0.1, 0.25, 0.4, 0.55, 0.7)
"""Directions of waves that pictures' answers are averaged over, and their frequencies, over the finest of the array."""
BEYOND = 8
"""Microlenses that a picture is continued beyond its sides, as it was before them turned about them."""


def places_on_array(camera: Camera, field: LightField) -> NDArray[np.float64]:
    """Places of a light field's microlenses on the array, shape (v, u, 2) [mm]."""
    u, v = np.meshgrid(field.u, field.v)
    return np.stack([u, v], -1) * float(camera.d)


class PreparedViews(NamedTuple):
    """Input of `estimate_disparity`: a light field with views' own light alone, and where that comes from."""

    field: LightField
    """Weights are those of samples with as much noise."""
    pupil: NDArray[np.floating]
    """Where each sample's light passed the FAP, on average, along u and along v [diameters]: shape (2, t, s), or
    (2, t, s, v, u) where it differs over the views."""
    aside: NDArray[np.floating] | None = None
    """How far from the microlens's middle that light passed it, on average, backwards [pitches]: likewise."""


class _Freeing(NamedTuple):
    """Way from samples to what their own microlens alone sends them."""

    usable: NDArray[np.bool_]
    """Samples that have enough own light anywhere, shape (t, s)."""
    share: NDArray[np.float32]
    """Own share of their light, shape (sample, v, u), or (sample, 1, 1)."""
    noise: NDArray[np.float32]
    """Variance that neighbours' samples leave in them as well, over their own; likewise."""
    ways: list[Mixing]
    """Strong and faint light of neighbours."""
    maps: NodeMap
    start: NDArray[np.intp]
    """First lens of each row."""


@dataclass(frozen=True, eq=False)
class ViewLight:
    """Light of a camera's views: how much of it is of each microlens's own, and where on the FAP that comes from.

    The same in all pictures that a camera takes, whatever is bright in them.
    """

    camera: Camera
    """One build, which takes them."""
    like: LightField
    """One of them, of which its places count; u and v count microlenses from the array's centre."""
    real: TracedLens | None = None
    """None of an ideal one."""

    @cached_property
    def nodes(self) -> Nodes:
        """Microlenses whose images are worked out."""
        return Nodes.of(self.camera, self.places, self.real, self.like.s.size * self.like.t.size)

    @cached_property
    def parts(self) -> tuple[NDArray[np.intp], NDArray[np.intp], ImageParts]:
        """`ImageParts` of microlenses at some rows and columns of views; of one where all are alike."""
        rows, columns, _ = self.nodes
        return rows, columns, self._parts_at(self.camera, self.places[np.ix_(rows, columns)].reshape(-1, 2), self.like)

    def _parts_at(self, camera: Camera, places: NDArray[np.float64], like: LightField) -> ImageParts:
        """`ImageParts` at places on the array (n, 2) [mm], of microlenses as a camera has them."""
        if self.real is not None and (cut := self.real.parts(camera, like, places)) is not None:
            return _of_lenses(cut, np.asarray(cut.light.any((1, 2, 3))))
        parts = _parts_at(panchromatic(camera), places, like, self.real)
        return _nearer(parts, camera, places, like, self.real)

    @cached_property
    def _over_sides(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Light at the nodes, on average over microlenses: from each step, and two moments of the own one.

        Shape (step, node, t, s); (2, node, t, s), times its place on the FAP; and (2, t, s, node), how far from the
        microlens's middle it passed, backwards [pitches]. From one side of a microlens to the other rims go on as from
        one microlens to the next, and where it is out of focus on the FAP light of the sides lies apart on the sensor.
        """
        (rows, columns, parts), like, d = self.parts, self.like, float(self.camera.d)
        own, light = parts.steps.index((0, 0)), parts.light.copy()
        places = light[own] * np.stack([parts.x[own], parts.y[own]])
        aside = aside_by_cuts(self.camera, like, light[own])
        middles = self.places[np.ix_(rows, columns)].reshape(-1, 2)
        sides = math.sqrt(LENS_SHAPES[self.camera.lens_shape].variance) * np.array(CORNERS)

        def kept(places: NDArray[np.float64]) -> NDArray[np.float64]:
            return cut_images(self.camera, places, self.real).shapes.kept_fraction[:, 0]

        if len(middles) == 1 or kept(middles).min() >= 1 - 1e-9:
            return light, places, aside
        cut = np.flatnonzero(np.min([kept(middles + d * side) for side in sides], 0) < 1 - 1e-9)
        passed = np.zeros((2, cut.size, *light.shape[2:]))
        light[:, cut] = places[:, cut] = 0
        sharp = self.camera.replace({}, in_focus=True)
        apart = float(microlens_defocus(self.camera) * self.camera.d / microlens_image_pitch(self.camera)) * like.pitch
        for side in sides:
            along, up = apart * side
            moved = replace(like, s=like.s - along, t=like.t - up)
            there = self._parts_at(sharp, middles[cut] + d * side, moved)
            lit, mine = [step in there.steps for step in parts.steps], there.steps.index((0, 0))
            even = np.zeros_like(light[:, cut])
            even[lit] = there.light[[there.steps.index(step) for step in parts.steps if step in there.steps]]
            even /= len(sides)
            light[:, cut] += even
            places[:, cut] += even[own] * np.stack([there.x[mine], there.y[mine]])
            passed += np.multiply.outer(side, even[own])
        total = light[own, cut]
        past = np.divide(passed, total, out=np.zeros_like(passed), where=total > DARKEST)
        aside[..., cut] = np.moveaxis(np.clip(-past, -FARTHEST, FARTHEST), 1, -1)
        return light, places, aside

    @cached_property
    def places(self) -> NDArray[np.float64]:
        """Places of the microlenses on the array, shape (v, u, 2) [mm]."""
        return places_on_array(self.camera, self.like)

    @property
    def side(self) -> float:
        """1, or -1 where the scene is turned round on the FAP."""
        return math.copysign(1.0, float(self.camera.seen.A) * float(self.camera.seen.D_F))

    @cached_property
    def _mixed(self) -> tuple[ImageParts, NodeMap, NDArray[np.intp], NDArray[np.float64] | None]:
        """Light in samples, the way from its nodes to lenses, the first lens of each row, and `beside`."""
        rows, columns, parts = self.parts
        field = self.like
        steps = PACKINGS[self.camera.layout].steps
        parts = parts._replace(light=self._over_sides[0])
        parts = _as_they_stand(parts, field.u[columns], field.v[rows], steps)
        start = np.zeros(len(field.v), int)
        if field.hexagonal is not None:
            start = np.rint(field.hexagonal.starts - field.v / math.sqrt(3)).astype(int)
        maps = NodeMap.of_lenses(rows, columns, field)
        places = self.places[np.ix_(rows, columns)].reshape(-1, 2)
        beside = self.beside(places, parts)
        between = _each_between(self.camera, places, field, self.real, parts)
        return *(between or (parts, maps)), start, beside

    @cached_property
    def _freeing(self) -> _Freeing:
        mixed, maps, start, beside = self._mixed
        shares, own = light_shares(mixed.light), mixed.steps.index((0, 0))
        mine = maps(np.moveaxis(shares[own], 0, -1))
        usable = np.asarray((mine > LEAST).any((2, 3)))
        each = (False, True) if usable.any() else ()
        ways = [Mixing.of(mixed, shares, own, usable, faint, beside) for faint in each]
        light, share = mixed.light.sum(0)[:, usable].T, shares[own][:, usable].T
        noise = sum((way.noise(light, share) for way in ways), np.zeros_like(share))
        return _Freeing(usable, mine[usable], maps(noise), ways, maps, start)

    def beside(self, places: NDArray[np.float64], parts: ImageParts) -> NDArray[np.float64] | None:
        """How far to the side the light of each microlens in samples sees, along the lattice's steps: (2, *parts.x).

        At places on the array (n, 2) [mm]; None of an ideal lens.
        """
        if self.real is None:
            return None
        aside = self.real.aside(places, self.side * np.swapaxes([parts.x, parts.y], 1, 2))
        return np.tensordot(np.linalg.inv(PACKINGS[self.camera.layout].steps), np.swapaxes(aside, 1, 2), 1)

    @cached_property
    def looks(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """`PreparedViews.pupil` and `aside` by first order."""
        rows, columns, parts = self.parts
        over_view = NodeMap.of_views(rows, columns, (len(self.like.v), len(self.like.u)))
        light, places, past = self._over_sides
        own = light[parts.steps.index((0, 0))]
        means = [np.divide(at, own, out=np.zeros_like(at), where=own > FAINT) for at in places]
        pupil = np.float32(self.side) * np.stack([over_view(np.moveaxis(at, 0, -1)) for at in means])
        aside = over_view(past)
        return (pupil[..., 0, 0], aside[..., 0, 0]) if rows.size == 1 else (pupil, aside)

    def flat_fielded(self) -> LightField:
        """`like`, decoded without a white image, as with the one that the camera should give."""
        rows, columns, parts = self.parts
        field, total = self.like, parts.light.sum(0)
        lenses = field if field.hexagonal is None else field.hexagonal
        spread = NodeMap.of_lenses(rows, columns, field)
        light = spread(np.moveaxis(total / total.max(initial=1e-30), 0, -1))
        lit = light > DARKEST
        gain = np.divide(1, light, out=np.zeros_like(light), where=lit)
        values, weight = lenses.values * gain, np.asarray(lenses.weight * np.where(lit, light, 0), np.float32)
        return _with(field, values, weight)

    def without_crosstalk(self, field: LightField) -> LightField:
        """A light field with each microlens's own light alone; weights are those of samples with as much noise."""
        usable, share, noise, ways, maps, start = self._freeing
        lenses = field if field.hexagonal is None else field.hexagonal
        values, weight = np.zeros_like(lenses.values, np.float32), np.zeros_like(lenses.weight, np.float32)
        if usable.any():
            light = lenses.weight[usable]
            gain = np.divide(1, share, out=np.zeros(light.shape, np.float32), where=(share > LEAST) & (light > 0))
            sure = np.where(share > SURE, gain, 0)
            gain *= (sure > 0).any(0)
            values[usable] = freed_in_rounds(
                np.asarray(lenses.values[usable], np.float32), gain, sure, ways, maps, start
            )
            weight[usable] = np.where(gain > 0, light * share**2 / (1 + noise), 0)
        return _with(field, values, weight)

    @cached_property
    def sharing(self) -> tuple[NDArray[np.bool_], NDArray[np.float32], Mixing]:
        """As of `_Freeing`: usable ones, own share, and all light of neighbours."""
        mixed, maps, _, beside = self._mixed
        shares, own = light_shares(mixed.light), mixed.steps.index((0, 0))
        mine = maps(np.moveaxis(shares[own], 0, -1))
        usable = np.asarray((mine > SENT).any((2, 3)))
        return usable, mine[usable], Mixing.of(mixed, shares, own, usable, None, beside, SENT)

    @cached_property
    def shares(self) -> bool:
        """True where microlenses share so much of the light that tells disparities that `with_shared` pays."""
        parts = self.parts[2]
        own = parts.steps.index((0, 0))
        share, light = light_shares(parts.light)[own], parts.light.sum(0)

        def told(least: float) -> float:
            weight = np.where(share > least, light * share**2, 0)
            total, spread = np.maximum(weight.sum((1, 2)), 1e-12), 0.0
            for at in (parts.x[own], parts.y[own]):
                spread += (weight * at**2).sum((1, 2)) - (weight * at).sum((1, 2)) ** 2 / total
            return float(np.mean(spread))

        return told(SHARED) > PAYS * told(LEAST) > 0

    def with_shared(
        self, field: LightField, looks: PreparedViews, disparity: NDArray[np.float64], picture: NDArray[np.float64]
    ) -> PreparedViews:
        """Views with samples that microlenses share, by what a picture and disparities say that neighbours send.

        Parameters
        ----------
        field : LightField
            As its pixels were read.
        looks : PreparedViews
            Where views look from, by mean places.
        disparity, picture : ndarray, shape (v, u)
            Found before.
        """
        usable, share, mixing = self.sharing
        _, maps, start, _ = self._mixed
        lenses = field if field.hexagonal is None else field.hexagonal
        values, weight = np.zeros_like(lenses.values, np.float32), np.zeros_like(lenses.weight, np.float32)
        light = lenses.weight[usable]
        shown = _shown(field, usable, looks, disparity, picture)
        raw, freed = np.asarray(lenses.values[usable], np.float32), np.empty_like(shown)
        known = (picture[on_grid(field)[0]] != 0).astype(np.float32)
        told, dark = np.zeros_like(shown), np.zeros_like(known)
        # Each sample's own as often as it has light of neighbours, and what of these is known.
        add_neighbours.compiled(np.stack(len(raw) * [known]), np.ones_like(known), *mixing, *maps, start, told)
        beyond = 2 * (1 - share) - told
        good = (share > SHARED) & ((beyond < SENT) | (share > LEAST)) & (light > 0)
        gain = np.divide(1, share, out=np.zeros(light.shape, np.float32), where=good)
        free_samples.compiled(raw, gain, gain, np.zeros_like(raw), shown, dark, *mixing, *maps, start, freed)
        values[usable] = np.where(gain > 0, freed, 0)
        weight[usable] = np.where(gain > 0, light * share**2, 0)
        return looks._replace(field=_with(field, values, weight))


def returned(light: ViewLight, views: PreparedViews, disparity: float) -> float:
    """Part of an error of the disparities before that comes back by the picture that they made; see `with_shared`.

    Let K be a neighbour's share over the own one, for a wave turned by the way to it, s where light passes the pupil,
    and <> mean all samples. Samples freed along disparities that are off by b show wave k off by 2 pi i k b K s, so
    that the picture, once it has settled, is off by <K s>/(1 + <K>) times as much, and that moves disparities by
    <(s - <s>) K>, over <(s - <s>)^2>. Waves are as strong in every octave.
    """
    usable, own, mixing = light.sharing
    weight, share = views.field.weight.mean((2, 3), dtype=float)[usable], mixing.share.mean(1)
    to = np.repeat(np.arange(weight.size), np.diff(mixing.first))
    some = (share > STRONG) & (weight[to] > 0)
    to, source = to[some], mixing.source[some]
    sent = weight[to] * share[some] / own.mean((1, 2))[to]
    packing = PACKINGS[light.camera.layout]
    pupil = np.nan_to_num(views.pupil[:, usable]).reshape(2, weight.size, -1).mean(-1, dtype=float)
    apart = packing.steps @ mixing.step[some].T - disparity * (pupil[:, source] - pupil[:, to])
    total, answers, told = float(weight.sum()), 0.0, 0.0
    for turn in np.pi * np.arange(TURNS) / TURNS:
        way = np.array([math.cos(turn), math.sin(turn)])
        place = way @ pupil
        lever = place - weight @ place / max(total, 1e-12)
        normal = float(weight @ lever**2)
        for k in packing.fold * np.array(FREQUENCIES):
            turned = sent * np.exp(2j * np.pi * k * (way @ apart))
            pull, moved = turned @ lever[to], turned @ place[source]
            answers += k * float((pull * moved / (total + turned.sum())).real)
            told += k * normal
    return answers / max(told, 1e-12)


def _as_they_stand(
    parts: ImageParts, u: NDArray[np.float64], v: NDArray[np.float64], lattice: NDArray[np.float64]
) -> ImageParts:
    """Light of neighbours as stops cut it where they stand, not at the nodes, which lie at u and v [pitches].

    A cut that moves by a hundredth of a pitch from one microlens to the next sends several hundredths of the light of
    its rim elsewhere, which views would show as a shift to the side.
    """
    if u.size == v.size == 1:
        return parts
    there = parts.light.reshape(len(parts.steps), v.size, u.size, *parts.light.shape[2:]).copy()
    for light, (along, up) in zip(there, (lattice @ np.transpose(parts.steps)).T, strict=True):
        light[:] = np.einsum("vw,ux,wxts->vuts", _beside(v, up), _beside(u, along), light, optimize=True)
    there = np.maximum(there.reshape(parts.light.shape), 0)
    return parts._replace(light=np.where(parts.light < 0, parts.light, there))


def _beside(nodes: NDArray[np.float64], away: float) -> NDArray[np.float64]:
    """Shares of the light of nodes in that of places so far `away` from each, a row of each place.

    Between nodes light goes by splines, beyond them by straight lines.
    """
    if nodes.size == 1:
        return np.ones((1, 1))
    from scipy.interpolate import CubicSpline

    spline, inside = CubicSpline(nodes, np.eye(nodes.size)), np.clip(nodes + away, nodes[0], nodes[-1])
    return np.asarray(spline(inside) + (nodes + away - inside)[:, None] * spline(inside, 1))


def aside_by_cuts(camera: Camera, field: LightField, light: NDArray[np.float64]) -> NDArray[np.float64]:
    """`PreparedViews.aside` at the nodes, shape (2, t, s, nodes), where all microlenses have this light (nodes, t, s).

    The FAP's rim moves by the microlenses' defocus on the way over one of them: a sample at the rim sees more of the
    scene behind the side that is cut less.
    """
    variance = LENS_SHAPES[camera.lens_shape].variance
    blur = -float(microlens_defocus(camera) * camera.d / microlens_image_pitch(camera))
    slopes = np.stack(
        [blur * np.gradient(light, at / field.pitch, axis=axis) for axis, at in ((2, field.s), (1, field.t))]
    )
    share = np.divide(slopes, light, out=np.zeros_like(slopes), where=light > DARKEST)
    return np.moveaxis(np.clip(-variance * share, -FARTHEST, FARTHEST), 1, -1)


def _shown(
    field: LightField, usable: NDArray[np.bool_], looks: PreparedViews, disparity: NDArray[np.float64],
    picture: NDArray[np.float64],
) -> NDArray[np.float32]:  # fmt: skip
    """Samples of a picture along disparities, as microlenses alone would show it; shape (view, v, u)."""
    from scipy import fft, ndimage

    steps = float(field.u[1] - field.u[0]), float(field.v[1] - field.v[0])
    near, column = on_grid(field)
    row = near[0]
    filled = picture.astype(np.float32)[None]
    fill_holes.compiled(filled, (filled != 0).astype(np.float32))
    # Splines of single samples would turn the finest detail by 0.8 of what they should.
    waves = fft.dctn(np.pad(filled[0].astype(float), BEYOND, mode="reflect", reflect_type="odd"), norm="ortho")
    if field.hexagonal is not None:
        frequency = np.arange(waves.shape[1]) / (2 * waves.shape[1] * steps[0])
        # Of the finest, views hold the mirror image beyond half a period a pitch as well, which is the same wave at
        # the microlenses: all of it is left.
        waves /= np.where(frequency < 1 - 1 / (2 * steps[0]), left_by_rows(frequency), 1.0)
    fine = 2 * fft.idctn(np.pad(waves, [(0, n) for n in waves.shape]), norm="ortho")
    spline, b = ndimage.spline_filter(fine, 5, mode="reflect"), disparity[near]
    out = np.empty((int(usable.sum()), *column.shape), np.float32)
    aside = np.zeros_like(looks.pupil) if looks.aside is None else looks.aside
    for n, (t, s) in enumerate(np.argwhere(usable)):
        p, a = (
            part[:, t, s] if part.ndim == 3 else part[:, t, s][:, near[0], near[1]] for part in (looks.pupil, aside)
        )
        x, y = (b * p[k] + a[k] for k in (0, 1))
        out[n] = ndimage.map_coordinates(
            spline,
            [2 * (row + BEYOND - y / steps[1]) + 0.5, 2 * (column + BEYOND - x / steps[0]) + 0.5],
            order=5,
            mode="reflect",
            prefilter=False,
        )
    return out


def _with(field: LightField, values: NDArray[np.float32], weight: NDArray[np.float32]) -> LightField:
    """Light field with other samples; of a hexagonal array its rows'."""
    if field.hexagonal is None:
        return replace(field, values=values, weight=weight)
    even, light = squared(values, weight, field.u, field.hexagonal.starts)
    rows = field.hexagonal._replace(values=values, weight=weight)
    return replace(field, values=even, weight=light, hexagonal=rows)


def _parts_at(camera: Camera, places: NDArray[np.float64], field: LightField, real: TracedLens | None) -> ImageParts:
    """`image_parts` of each place, whole images that are alike once."""
    image = image_shapes(places, real)
    whole = cut_images(camera, places, real).shapes.kept_fraction[:, 0] >= 1 - 1e-9
    kinds = np.concatenate([image.reshape(-1, 4), np.where(whole, -1, np.arange(len(places)))[:, None]], 1)
    _, some, back = np.unique(kinds.round(6), axis=0, return_index=True, return_inverse=True)
    s, t = field.s / field.pitch, field.t / field.pitch
    finest = min(
        float(abs(microlens_image_pitch(camera)) * camera.d / (camera.wavelength * camera.seen.d_2)), FINEST_PLACES
    )
    block = max(1, int(BLOCK * min(1.0, (COMMON / finest) ** 2)))
    pieces = [
        image_parts(cut_images(camera, places[part], real), s, t, reading(field), image[part])
        for part in np.split(some, range(block, some.size, block))
    ]
    # Of many places, microlenses that none has light of would be most of what is to be held.
    lit = np.any([part.light.any((1, 2, 3)) for part in pieces], 0) | (len(places) == 1)
    pieces = [_of_lenses(part, lit) for part in pieces]
    light, x, y = (np.concatenate([part[k] for part in pieces], 1)[:, back] for k in (1, 2, 3))
    return ImageParts(pieces[0].steps, light, x, y)


def _nearer(
    parts: ImageParts, camera: Camera, places: NDArray[np.float64], field: LightField, real: TracedLens | None
) -> ImageParts:
    """Light of neighbours where rays have their images, which pupils with aberrations bring nearer."""
    if real is None:
        return parts
    steps = np.transpose(PACKINGS[camera.layout].steps @ np.transpose(parts.steps))
    nearer = np.moveaxis(steps @ (np.eye(2) - real.apart(places)), 0, 1)[..., None, None, :]
    slopes = np.gradient(parts.light, field.t / field.pitch, field.s / field.pitch, axis=(2, 3))
    moved = parts.light + nearer[..., 0] * slopes[1] + nearer[..., 1] * slopes[0]
    return parts._replace(light=np.where(parts.light > 0, np.maximum(moved, 0), parts.light))


def _of_lenses(parts: ImageParts, some: NDArray[np.bool_]) -> ImageParts:
    """Light of some of the microlenses alone."""
    steps = tuple(step for step, one in zip(parts.steps, some, strict=True) if one)
    return ImageParts(steps, *(part[some] for part in parts[1:]))


def reading(field: LightField) -> Read:
    """Interpolation between pixels, on average over a light field."""
    if field.between is None:
        return AS_IT_IS
    ranks = (np.arange(MANY_BETWEEN) + 0.5) / MANY_BETWEEN
    along, across = (partial(read_between, between=np.quantile(axis, ranks)) for axis in field.between)
    return (along,), (across,)


def light_shares(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares of samples' light, its first axis counting the microlenses that it comes from."""
    total = light.sum(0)
    return np.asarray(np.divide(light, total, out=np.zeros_like(light), where=total > 0))


def _each_between(
    camera: Camera, places: NDArray[np.float64], field: LightField, real: TracedLens | None, parts: ImageParts
) -> tuple[ImageParts, NodeMap] | None:
    """Light between pixels, of whole images that one place stands for, and the way to lenses; None where it is alike.

    Where detail of microlens images is finer than pixels, what a sample has of its neighbours' light changes with where
    it lies between them.
    """
    turned = abs(math.sin(4 * float(camera["microlens_array.rotation"]))) / 4 * field.pitch / 2
    if field.between is None or parts.light.shape[1] > 1 or turned > TURNED:
        return None
    images = cut_images(panchromatic(camera), places, real)
    if images.shapes.kept_fraction.min() < 1 - 1e-9:
        return None
    image = image_shapes(places, real)
    for count in (2, BETWEEN):
        reads = [partial(read_between, between=np.array([part])) for part in np.arange(count) / count]
        light = light_read(images, field.s / field.pitch, field.t / field.pitch, (reads, reads), image)
        share = light_shares(light)[parts.steps.index((0, 0))]
        if np.ptp(share[:, (share > LEAST).any(0)], axis=0).max(initial=0.0) < ALIKE:
            return None
    again = np.arange(BETWEEN + 1) % BETWEEN
    nodes = (again[:, None] * BETWEEN + again).ravel()
    column, row = np.floor(field.between * BETWEEN).astype(np.int64)
    along, down = (field.between * BETWEEN % 1).astype(np.float32, order="C")
    light = light[:, nodes]
    x, y = (np.broadcast_to(part, light.shape) for part in parts[2:])
    each = _nearer(ImageParts(parts.steps, light, x, y), camera, places, field, real)
    return each, NodeMap(row * (BETWEEN + 1) + column, down, along, BETWEEN + 1)
