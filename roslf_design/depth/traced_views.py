"""Where the views of a camera look through a real main lens, and through what stands before any, against first order.

By first order a view from the pupil coordinate s sees at u + B s what the pupil's middle sees at u. By exact rays it
does at u + B P(s, u) + E(s, u): E is the transverse aberration for the focal plane (field curvature, astigmatism, coma,
spherical; of windows and liquids, too), P differs from s by distortion and by the pupil's own aberrations. Before all
elements rays are straight, so that this holds for all B that matter: at the presets' edges it is off by 0.002 pitches
0.8 pitches out of focus. So disparities stay what they are to first order, and depths follow from them as ever.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bore.opening import POINT
from ..calibration.decoding import DARKEST, LightField
from ..calibration.lattice import CentreLattice, fit_lattice
from ..camera import Camera
from ..design import Design
from ..fates import RayFate
from ..polynomials import Polynomials, nodes_between, products
from ..shapes.lattice import PACKINGS
from ..shapes.openings import Openings
from ..theory.colours import panchromatic
from ..theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from ..theory.image_parts import APART, SLOW, STEPS, ImageParts, across_lenses, with_farther
from ..theory.lens_shapes import LENS_SHAPES
from ..theory.light import microlens_defocus
from ..theory.light_field import rim_disparity
from ..theory.stop_images import MicrolensImages
from ..theory.transfer import MicrolensTransfer, pixel_box
from ..traced.camera import LensCamera, RayViews, camera_of, chief_slope, microlenses, sensor_of_pupil, views
from ..traced.images import forward_rays
from .nodes import NodeMap
from .unmixing import reading

Array = NDArray[np.float64]

NODES, FIELD_DEGREE = 13, 7
"""Places along each axis of the array that are traced, and the polynomials that carry them over it."""
RINGS, PUPIL_DEGREE = (0.15, 0.3, 0.42, 0.5), 5
"""Rings on the pupil [diameters] that are traced, and the polynomials over it."""
SPOKES = 12
FINE, WIDE = 32, 4.0
"""Points in a pitch of microlens images that are blurred, and pitches after which these repeat themselves."""
STEP = 0.25
"""Disparity to either side of the focal plane that P is taken from [pitches]."""
NEAR_RIM = 0.05
"""Room, as share of a rim's squared radius, up to which rays tell where it cuts an image."""
AROUND = 2.0
"""Microlenses to either side by which images are taken to change evenly."""
FAINT = 1e-3
"""Light of a sample, against a lit one's, below which it is not said where it looks."""
AWAY = 1e9
"""Taken for infinity [mm]."""
CENTRES_DEGREE = 9
"""Order to which images' centres are followed over the array: an aberrated pupil's lie up to 0.5 px off the fifth."""
AMPLIFIED = 100.0
"""How many times as large as at nodes where rays come through a polynomial's errors may be at all others."""
ASTRAY = 0.1
"""Disparity that polynomials may add to what rays at a node have, where they are to say where views look [pitches]."""


def _ring(radius: float) -> Array:
    turn = 2 * np.pi * (np.arange(SPOKES) + radius) / SPOKES
    return radius * np.stack([np.cos(turn), np.sin(turn)], -1)


POINTS = np.concatenate([np.zeros((1, 2)), *(_ring(radius) for radius in RINGS)])
RING = _ring(math.sqrt(sum(r**4 for r in RINGS) / sum(r**2 for r in RINGS)))
"""Points whose linear fit is that of all those, up to the third order of aberrations."""


@dataclass(frozen=True, eq=False)
class TracedViews:
    """A camera's lens and elements as they are traced, and the first order that disparities are told for."""

    design: Design
    camera: Camera
    """Camera to first order."""
    depth: Callable[[Array], Array]
    """Z from the main lens of what has a disparity, to first order [mm]."""

    @property
    def mounted(self) -> LensCamera:
        """Camera as it is traced."""
        return camera_of(self.design)

    def sight(
        self, field: LightField, pupil: NDArray[np.floating], nodes: tuple[NDArray[np.intp], NDArray[np.intp]]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """How the views of a decoded light field look.

        Parameters
        ----------
        field : LightField
        pupil : ndarray
            Where on the FAP, by first order, each view looks through [diameters], shape (2, t, s) or (2, t, s, v, u).
        nodes : (rows, columns)
            Of views, between which images change evenly.

        Returns
        -------
        (pupil, aside)
            P [pupil diameters], NaN where no light comes through or rays fold, so that no polynomials carry them over
            the array, and E [pitches], in place of pupil coordinates s;
            shape (2, t, s, v, u).
        """
        x, y = (axis * float(self.camera.d) for axis in (field.u, field.v))
        along, down, places = _nodes_over(*np.array([[axis.min(), axis.max()] for axis in (x, y)]).T)
        points = POINTS
        if (opening := self.mounted.fap.opening).straight:  # whose corners the rings, too, are to reach
            points = np.stack(opening.places(*2 * points.T), -1) / opening.width @ _turned(self.design).T
        looks, good = self.view_coordinates(places, points)
        image, _, _ = self.image_maps(microlenses(self.design, places))
        # Polynomials over the pupil at each place, then over the places what these are made of.
        over_pupil = np.linalg.pinv(_over_pupil(points.T).T)
        dark = np.ones((len(y), len(x)), np.bool_)
        coefficients = np.zeros((2, 2, 2, len(over_pupil), *dark.shape))
        # Of what middles see, and of what each itself does: its light, from all over a sample, is a mean of that.
        middles = np.einsum("kp,lnpc->lckn", over_pupil, looks)
        table = np.stack([middles, np.moveaxis(self._polynomials(places)[0][:2], 1, -1).swapaxes(1, 2)])
        degree = _degree(places, good, FIELD_DEGREE)
        while degree > 0 and good.sum() > (degree + 1) * (degree + 2):  # twice as many as there are terms
            fitted = Polynomials.fitted(*_box(x, y), degree, places[good].T, table[..., good])
            told = np.einsum("ckn,kp->npc", fitted.at(*places[good].T)[0, 1], _over_pupil(points.T))
            astray = np.abs(_linear(points, told - looks[1, good])).max((1, 2))
            if astray.max() <= ASTRAY:
                coefficients = fitted.on_grid(x, y)
                column, row = (np.abs(at - axis[:, None]).argmin(1) for at, axis in ((along, x), (down, y)))
                dark = ~good.reshape(NODES, NODES)[np.ix_(row, column)]
                break
            good[np.flatnonzero(good)[astray > max(ASTRAY, astray.max() / 2)]] = False  # the worst disturb others
        rows, columns = nodes
        middles, itself = coefficients.astype(np.float32)
        powers = self._powers(field, np.stack(np.meshgrid(x[columns], y[rows]), -1).reshape(-1, 2))
        if powers is None:
            spread = self._spread(field, image[good].mean(0) if good.any() else np.eye(2))
            powers_of = _over_pupil(np.asarray(pupil, np.float32))
            seen, more = _over_views(middles, powers_of), _over_views(itself, spread)
        else:
            seen, more = np.zeros((2, 2, 2, len(field.t), len(field.s), *dark.shape), np.float32)
            over_view = NodeMap.of_views(rows, columns, dark.shape)
            for t, some in enumerate(np.moveaxis(powers, 2, 0)):
                here, *farther = over_view(some)
                for _ in range(2):  # what is seen from other microlenses is seen by images cut as there
                    moved = here + sum(far * by for far, by in zip(farther, seen[1, :, t], strict=True))
                    seen[:, :, t] = _over_views(middles, _at_mean(moved))
                more[:, :, t] = _over_views(itself, here - _at_mean(here))
        seen += _as_seen(seen, more, field)
        seen[0][..., dark], seen[1][..., dark] = np.nan, 0.0
        return seen[0], seen[1]

    def view_coordinates(self, nodes: Array, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """P and E of microlenses and pupil points, shape (2, node, point, 2), and where all rays came through."""
        camera, mounted, design = self.camera, self.mounted, self.design
        turned = _turned(design)
        c, fap = microlenses(design, nodes), mounted.fap
        image, shift, whole = self.image_maps(c)
        samples, beside = shift[:, None] + self._by_first_order(points) @ turned.T @ image @ turned, AROUND * design.d
        apart = (self.image_maps(c + beside * way)[1] - self.image_maps(c - beside * way)[1] for way in np.eye(2))
        moving = np.stack([*apart], -2) / (2 * beside)

        def through(places: Array) -> tuple[Array, NDArray[np.bool_]]:
            """Where on the FAP the samples of microlenses look through, shape (node, point, 2)."""
            centre = sensor_of_pupil(mounted, places, fap.centre)
            # Samples count from images' middles, which lie otherwise there.
            rays = views(mounted, places, centre.sensor + samples + (places - c[:, None]) @ moving, clip=False)
            return rays.pupil, centre.ok & (rays.state == RayFate.KEPT)

        middle = sensor_of_pupil(mounted, c, fap.centre)
        first, comes = through(np.broadcast_to(c[:, None], (len(c), len(points), 2)))
        good = middle.ok & comes.all(-1) & whole
        step, shown = self._step, list[Array]()
        aimed: Array | None = None
        for z in self.depth(np.array([-step, 0.0, step])):
            ahead = float(fap.z - mounted.first_order.front_principal + z)
            point, pupil = middle.views.at(ahead)[:, None], first
            for last in (False, True):
                height, _, comes, aimed = forward_rays(
                    mounted, point, pupil, mounted.wavelength, z=fap.z - ahead, start=aimed
                )
                good &= comes.all(-1)
                place = np.where(good[:, None, None], np.moveaxis(height, 0, -1), c[:, None])
                if not last:  # what looks there is another microlens, whose pupil has aberrations of its own
                    pupil, comes = through(place)
                    good &= comes.all(-1)
            shown.append((place - c[:, None]) @ turned.T / float(camera.d))
        looks = np.stack([(shown[2] - shown[0]) / (2 * step), shown[1]])
        good &= np.isfinite(looks).all((0, 2, 3))
        return looks, np.asarray(good)

    @property
    def _step(self) -> float:
        """Disparity to either side of the focal plane that P is taken from [pitches]."""
        return min(
            STEP, 0.25 * abs(float(rim_disparity(self.camera, self.camera.plane(AWAY).distance - self.camera.seen.d_3)))
        )

    def bends(self, places: Array) -> tuple[Array, Array]:
        """P and E at places in the array's frame (n, 2) [mm], as linear maps from the pupil, row by column (n, 2, 2).

        An ideal lens's where rays do not come through.
        """
        looks, good = self.view_coordinates(places, RING)
        pupil, aside = (_linear(RING, part) for part in looks)
        through = good[:, None, None]
        return np.where(through, pupil, np.eye(2)), np.where(through, aside, 0.0)

    def images(self, places: Array) -> Array:
        """Images at places in the array's frame (n, 2) [mm] against those by first order, as `TracedLens` has it."""
        image, _, good = self.image_maps(microlenses(self.design, places))
        return np.where(good[:, None, None], image, np.eye(2))

    def apart(self, places: Array) -> Array:
        """How far neighbours' images lie apart, as `TracedLens` has it; as by first order where rays do not come."""
        beside = AROUND * float(self.camera.d) * np.concatenate([np.eye(2), -np.eye(2)])
        c = microlenses(self.design, (places + beside[:, None]).reshape(-1, 2))
        middle = sensor_of_pupil(self.mounted, c, self.mounted.fap.centre)
        _, shift, whole = self.image_maps(c)
        after, before = ((middle.sensor + shift) @ _turned(self.design).T).reshape(2, 2, len(places), 2)
        apart = np.moveaxis(after - before, 0, 1) / (2 * AROUND * float(microlens_image_pitch(self.camera)))
        good = np.asarray((middle.ok & whole).reshape(4, -1).all(0))
        return np.where(good[:, None, None], apart, np.eye(2))

    def parts(self, camera: Camera, field: LightField, places: Array) -> ImageParts | None:
        """Light in samples of images of which some are cut, as `TracedLens` has it."""
        if not self._any_cut(places):
            return None
        (coefficients, room), images, apart = self._polynomials(places), self.images(places), self.apart(places)
        packing = PACKINGS[self.camera.layout]
        steps = np.array(STEPS[:-4]) @ packing.steps.T
        (x, at_x), (y, at_y) = (np.unique(axis.round(9), return_inverse=True) for axis in steps.T)
        along, up = np.array(SLOW).T
        waves, each = np.stack([along, packing.wave_up(along, up)], -1), []
        for image, between, fap, left in zip(images, apart.diagonal(0, 1, 2), coefficients[2], room, strict=True):
            sampled = replace(_Sampled.of(camera, field, image[None]), apart=tuple(between))
            powers, inside = sampled.image(image, fap, left)
            around = replace(sampled, wide=APART, steps=(x, y))  # neighbours' images are this one, where those stand
            parts = around(inside * powers[[0, PUPIL_DEGREE + 1, 1]])  # light, and twice its places
            parts = parts.reshape(3, y.size, field.t.size, x.size, field.s.size).swapaxes(2, 3)[:, at_y, at_x]
            light = with_farther(parts[0], sampled.among_neighbours(waves)(inside[None]))
            lit = light[:-4] != 0
            side = math.copysign(0.5, float(self.camera.seen.A) * float(self.camera.seen.D_F))
            means = side * np.divide(parts[1:], parts[0], out=np.zeros_like(parts[1:]), where=lit)
            each.append([light, *np.pad(means, [(0, 0), (0, 4), (0, 0), (0, 0)])])
        return ImageParts(STEPS, *np.stack(each, 2))

    def aside(self, places: Array, pupil: Array) -> Array:
        """How far to the side views from points on the FAP see, as `TracedLens` has it."""
        coefficients = self._polynomials(places)[0][1]
        inside = pupil * np.minimum(1, 0.5 / np.maximum(np.hypot(*pupil), 0.5))
        out = np.empty_like(inside)
        for n, (part, at) in enumerate(zip(coefficients, np.moveaxis(inside, 1, 0), strict=True)):
            lit = at.any(0)  # where no light comes from the middle stands for it
            out[:, n] = (part.T @ _over_pupil(np.zeros(2))).reshape(2, *(1,) * lit.ndim)
            out[:, n, lit] = part.T @ _over_pupil(at[:, lit])
        return np.asarray(out)

    def shown(
        self, field: LightField, places: Array, waves: Array, disparities: Array
    ) -> Iterator[tuple[NDArray[np.complex128], Array]]:
        """Waves as microlenses show them, as `TracedLens` has it."""
        (coefficients, room), images, apart = self._polynomials(places), self.images(places), self.apart(places)
        each_of = zip(images, apart.diagonal(0, 1, 2), np.moveaxis(coefficients, 0, 1), room, strict=True)
        shown, where = [], []
        for image, between, (pupil, aside, fap), left in each_of:
            sampled = replace(_Sampled.of(self.camera, field, image[None]), apart=tuple(between))
            waving, still = sampled.among_neighbours(waves), sampled.among_neighbours(np.zeros((1, 2)))
            powers, inside = sampled.image(image, fap, left)
            lit, mine = (np.where(part > DARKEST, part, np.inf) for part in (still(inside[None]).real, sampled(inside)))
            each = [np.tensordot(aside + b * pupil, powers, (0, 0)) for b in disparities.tolist()]
            shown.append([waving(inside * _turning(waves, look)) / lit for look in each])
            where.append([sampled(inside * look) / mine for look in each])
        yield from zip(np.stack(shown, 2), np.stack(where, 2), strict=True)

    def _polynomials(self, places: Array) -> tuple[Array, Array]:
        """P, E and place on the FAP [diameters] of microlenses (n, 2), by what each itself sees: (3, n, terms, 2).

        And the room that all else leaves there, as `views` has it: (n, terms).

        `view_coordinates` has them of what its middle sees: far out of focus that is seen from microlenses some pitches
        away, which look otherwise. By first order where no light comes through.
        """
        (c, rays, good), mounted, turned = self._rays(places), self.mounted, _turned(self.design)
        step, shown = self._step, list[Array]()
        aimed: Array | None = None
        for z in self.depth(np.array([-step, 0.0, step])):
            ahead = float(mounted.fap.z - mounted.first_order.front_principal + z)
            height, _, comes, aimed = forward_rays(
                mounted, rays.at(ahead), mounted.fap.centre, mounted.wavelength, z=mounted.fap.z - ahead, start=aimed
            )
            good &= comes.all(-1)
            shown.append((c[:, None] - np.moveaxis(height, 0, -1)) @ turned.T / float(self.camera.d))
        looks = np.stack([(shown[2] - shown[0]) / (2 * step), shown[1]])
        good &= np.isfinite(looks).all((0, 2, 3))
        one = self._on_fap(np.array([[1.0, 0.0]])) @ turned.T
        fap = (rays.pupil - mounted.fap.centre) @ turned.T / one[0, 0]
        through, ideal = good[:, None, None], np.broadcast_to(POINTS, fap.shape)
        fitted = np.where(through, [*looks, fap], [ideal, 0 * ideal, ideal])
        over_pupil = np.linalg.pinv(_over_pupil(POINTS.T).T)
        return np.asarray(over_pupil @ fitted), np.where(good[:, None], rays.margin, 1.0) @ over_pupil.T

    def _rays(self, places: Array) -> tuple[Array, RayViews, NDArray[np.bool_]]:
        """Microlenses (n, 2) in the lens's frame, rays that look by first order through `POINTS`, whether all came."""
        c, turned = microlenses(self.design, places), _turned(self.design)
        image, shift, _ = self.image_maps(c)
        middle = sensor_of_pupil(self.mounted, c, self.mounted.fap.centre).sensor + shift
        samples = middle[:, None] + self._by_first_order(POINTS) @ turned.T @ image @ turned
        rays = views(self.mounted, c[:, None], samples, clip=False)
        return c, rays, np.asarray((rays.state == RayFate.KEPT).all(-1))

    def _any_cut(self, places: Array) -> bool:
        """Whether rays from some places do not pass lens and stops."""
        _, rays, good = self._rays(places)
        return bool((good & (rays.margin[:, -SPOKES:] < 0).any(-1)).any())

    def _powers(self, field: LightField, places: Array) -> Array | None:
        """Means of `_over_pupil` over the light of each sample of cut images, (3, terms, t, s, n); None of whole ones.

        And how they change from one microlens to the next, along the array and up.
        """
        if not self._any_cut(places):
            return None
        around = np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]) * AROUND
        there = (places[:, None] + around * float(self.camera.d)).reshape(-1, 2)
        (coefficients, room), images = self._polynomials(there), self.images(there)
        sampled, each = _Sampled.of(self.camera, field, images), []
        for n, (image, fap, left) in enumerate(zip(images, coefficients[2], room, strict=True)):
            own, inside = sampled.image(image, fap, left)
            if n % len(around) == 0:  # all count places on the sensor as the middle one does
                powers = own
            means = sampled(powers * inside)
            each.append(np.divide(means, means[0], out=np.zeros_like(means), where=means[0] > FAINT))
        here, right, left, up, down = (np.stack(each[n :: len(around)], -1) for n in range(len(around)))
        return np.stack([here, (right - left) / (2 * AROUND), (up - down) / (2 * AROUND)])

    def cut(self, images: MicrolensImages) -> MicrolensImages:
        """Images of microlenses, cut where rays do not pass lens and stops, as `TracedLens` has it."""
        if self.mounted.fap.straight:
            return images
        _, rays, good = self._rays(images.fields)
        cut = good & (rays.margin[:, -SPOKES:] < 0).any(-1)
        if not cut.any() and images.openings.unclipped:
            return images
        # The disc in the image whose rim has no room, where rays are near it.
        room = np.where(good[:, None], rays.margin, 1.0)
        columns = np.column_stack([np.ones(len(POINTS)), POINTS, (POINTS**2).sum(-1)])
        near = 1 / (NEAR_RIM + np.abs(room))[..., None]
        least, *across, square = np.moveaxis((np.linalg.pinv(near * columns) @ (near * room[..., None]))[..., 0], -1, 0)
        square = np.minimum(square, -1e-6)
        middle = -np.stack(across, -1) / (2 * square[:, None])
        radius = np.sqrt(np.maximum((middle**2).sum(-1) - least / square, 0.0))
        width = abs(float(microlens_image_diameter(self.camera)))
        whole = np.where(cut, 0.0, np.hypot(*middle.T) + 0.501)
        return _CutImages(images, self._by_first_order(middle) / width, np.maximum(radius, whole))

    def _by_first_order(self, points: Array) -> Array:
        """Places on the sensor, from the chief ray, that look by first order through points on the FAP [mm]."""
        mounted, origin = self.mounted, np.zeros(2)
        return mounted.d_2 * (chief_slope(mounted, origin, self._on_fap(points)) - chief_slope(mounted, origin, origin))

    def _on_fap(self, points: Array) -> Array:
        """Points on the FAP, from its centre [mm], by those that the lens sees, which a relay turns round."""
        seen, fap = self.camera.seen, self.mounted.fap
        side = math.copysign(1.0, float(seen.A) * float(seen.D_F) * self.mounted.apparent_pupil[1])
        return np.asarray(side * fap.diameter * points @ _turned(self.design))

    def image_maps(self, c: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Images of the FAP through microlenses (n, 2) in the lens's frame.

        Maps to places on them from those by first order, along the array's axes (n, 2, 2); how far their middles lie
        from chief rays, in the lens's frame (n, 2) [mm]; where all rays came.
        """
        mounted, points, turned = self.mounted, _ring(RINGS[-1]), _turned(self.design)
        middle = sensor_of_pupil(mounted, c, mounted.fap.centre)
        rim = sensor_of_pupil(mounted, c[:, None], mounted.fap.centre + self._on_fap(points))
        at = rim.sensor - middle.sensor[:, None]
        image = _linear(self._by_first_order(points) @ turned.T, at @ turned.T)
        return image, at.mean(1), middle.ok & rim.ok.all(-1)

    def _spread(self, field: LightField, shape: Array) -> NDArray[np.float32]:
        """Means of `_over_pupil` over the light of each sample, less those at its mean place, shape (terms, t, s).

        `shape` is that of the images, as `TracedLens.images` has it. A pixel and diffraction take in a good part of the
        pupil. In cut images light is taken to spread as much about where it comes from on average.
        """
        sampled = _Sampled.of(self.camera, field, shape[None])
        powers, inside = sampled.image(shape)
        means = sampled(powers * inside)
        means = np.divide(means, means[0], out=np.zeros_like(means), where=means[0] > FAINT)
        return np.asarray(means - _at_mean(means), np.float32)

    def chief_rays(self, places: Array) -> Array:
        """Rays through the FAP's middle, before all elements, from places in the array's frame (n, 2) [mm].

        Height on the object-side principal plane and slope along z, shape (n, 4); NaN where none comes through.
        """
        mounted = self.mounted
        middle = sensor_of_pupil(mounted, microlenses(self.design, places), mounted.fap.centre)
        at = middle.views.at(mounted.fap.z - mounted.first_order.front_principal)
        rays = np.concatenate([at + self.design.main_lens.decentre, middle.views.slope], -1)
        return np.where(middle.ok[:, None], rays, np.nan)

    def lattice(self, lattice: CentreLattice, indices: NDArray[np.int64], pixel: float) -> CentreLattice:
        """The lattice, bent, that images of microlenses lie on, where it is known by first order.

        Parameters
        ----------
        lattice : CentreLattice
            By first order; its node (i, j) is i pitches along the array's rows.
        indices : ndarray
            Of the microlenses, shape (n, 2).
        pixel : float
            [mm]
        """
        mounted, steps = self.mounted, PACKINGS[lattice.layout].steps
        if not len(indices):
            return lattice
        at = indices @ steps.T
        _, _, nodes = _nodes_over(at.min(0) - 0.5, at.max(0) + 0.5)
        c = microlenses(self.design, nodes * float(self.camera.d))
        middle = sensor_of_pupil(mounted, c, mounted.fap.centre)
        first = c + mounted.d_2 * chief_slope(mounted, c, mounted.fap.centre)
        _, shift, whole = self.image_maps(c)
        order = _degree(nodes, whole, CENTRES_DEGREE)
        if order < 1:
            return lattice
        some = nodes[whole] @ np.linalg.inv(steps).T
        centres = lattice.nodes(*some.T) + (middle.sensor + shift - first)[whole] / pixel
        return fit_lattice(some, centres, lattice.layout, order, clipped=False).lattice


class _CutImages(MicrolensImages):
    """Microlens images that the main lens cuts as rays have it."""

    def __init__(self, images: MicrolensImages, middles: Array, radii: Array) -> None:
        super().__init__(images.camera, images.fields)
        self._middles, self._radii = middles, radii

    def by(self, camera: Camera) -> MicrolensImages:
        """Images of another camera at the same fields, cut likewise."""
        return _CutImages(MicrolensImages(camera, self.fields), self._middles, self._radii)

    @property
    def openings(self) -> Openings:
        """Openings by first order, but for the main lens's."""
        first, width = MicrolensImages(self.camera, self.fields).openings, abs(microlens_image_diameter(self.camera))
        centres, radii = first.centres.copy(), first.radii.copy()
        centres[..., 1, :] = centres[..., 0, :] + width * self._middles[:, None]
        radii[..., 1] = width * self._radii[:, None]
        return first._replace(centres=centres, radii=radii)


@dataclass(frozen=True, eq=False)
class _Sampled:
    """Way from whole microlens images before diffraction to their samples behind that and the pixels."""

    camera: Camera
    field: LightField
    at: Array
    """Places along each axis that images are known at [distances between them], shape (points,)."""
    apart: tuple[float, float] = (1.0, 1.0)
    """Distances between neighbours' images along each axis [image pitches]; skew is left out."""
    wide: float = WIDE
    """Distances after which images taken to stand alone repeat themselves."""
    steps: tuple[Array | tuple[float], ...] = ((0.0,), (0.0,))
    """Distances along each axis to the images that samples are taken of, all of one after those of another."""

    @classmethod
    def of(cls, camera: Camera, field: LightField, shapes: Array) -> _Sampled:
        """Places for images of such shapes, as `TracedLens.images` has them, shape (n, 2, 2)."""
        radius = abs(float(microlens_image_diameter(camera) / microlens_image_pitch(camera))) / 2
        reach = math.ceil(FINE * (radius * float(np.linalg.norm(shapes, 2, (1, 2)).max()) + 1 / FINE))
        return cls(camera, field, np.arange(-reach, reach + 1) / FINE)

    def image(self, shape: Array, fap: Array | None = None, room: Array | None = None) -> tuple[Array, Array]:
        """`_over_pupil` at points of an image, shape (terms, points, points), and the share of each that lies inside.

        Exactly by polynomials of places on the FAP, and of the room that all else leaves.
        """
        camera = self.camera
        width = abs(float(microlens_image_diameter(camera) / microlens_image_pitch(camera)))
        grid = np.tensordot(np.linalg.inv(shape / self.apart), np.stack(np.meshgrid(self.at, self.at)), (0, 0))
        # The microlens turns the FAP round.
        side = -math.copysign(1.0, float(camera.seen.A) * float(camera.seen.D_F))
        image = camera.fap.outline.sized(width)
        image = image._replace(turn=image.turn - float(camera["microlens_array.rotation"]))
        powers = _over_pupil(side * grid / width)
        seen = grid if fap is None else side * width * np.tensordot(fap, powers, (0, 0))
        inside = np.clip(np.asarray(image.room(POINT, *seen)) * FINE + 0.5, 0, 1)
        if room is not None:  # by how much of a cell has some
            left = np.tensordot(room, powers, (0, 0))
            slope = np.abs(np.gradient(left)).sum(0)
            inside = inside * np.clip(left / np.maximum(slope, 1e-12) + 0.5, 0, 1)
        return powers, inside

    @cached_property
    def lens(self) -> MicrolensTransfer:
        """Transfer of diffraction and defocus."""
        camera = self.camera
        return MicrolensTransfer(
            float(camera.d), float(camera.seen.d_2), float(-microlens_defocus(camera) / camera.seen.d_2),
            (float(panchromatic(camera).wavelength),), camera.lens_shape,
        )  # fmt: skip

    @property
    def samples(self) -> tuple[Array, Array]:
        """Places of samples along each axis [distances between images]."""
        axes = zip((self.field.s, self.field.t), self.apart, self.steps, strict=True)
        along, up = (-np.subtract.outer(step, at / (self.field.pitch * apart)).ravel() for at, apart, step in axes)
        return along, up

    @property
    def pitch(self) -> float:
        """Pitch of the images [mm]."""
        return abs(float(microlens_image_pitch(self.camera)))

    @property
    def finest(self) -> float:
        """Largest frequency that anything passes at [periods per image pitch]."""
        return min(self.lens.cutoff * self.pitch, FINE / 2 - 1)

    def transfer(self, fx: Array, fy: Array) -> Any:
        """Transfer of diffraction, defocus, pixels and reading between them at frequencies [periods per image pitch].

        Those broadcast.
        """
        pixel = float(self.camera.q) / self.pitch
        (by_x,), (by_y,) = reading(self.field)
        pixels = pixel_box(fx, pixel) * by_x(fx * pixel) * (pixel_box(fy, pixel) * by_y(fy * pixel))
        cells = pixel_box(fx, 1 / FINE) * pixel_box(fy, 1 / FINE) * FINE**2  # that rims are blurred by
        return self.lens(fx / self.pitch, fy / self.pitch) * pixels / cells

    @cached_property
    def _alone(self) -> tuple[Array, Array, Any, Array, Array]:
        """Transforms of images, of which those at negative frequencies up are the others' conjugates, and back."""
        most = math.ceil(self.finest * self.wide)
        frequency = np.arange(-most, most + 1) / self.wide
        up = frequency[most:]
        along, down = (np.exp(-2j * math.pi * axis[:, None] * self.at) for axis in (frequency, up))
        passed = self.transfer(frequency, up[:, None]) / self.wide**2 * np.where(up > 0, 2, 1)[:, None]
        (s, t), waves = self.samples, 2j * math.pi
        x, y = np.exp(waves * frequency[:, None] * s), np.exp(waves * t[:, None] * up)
        return along.T.copy(), np.concatenate([down.real, down.imag]), passed, x, y

    def __call__(self, values: Array) -> Array:
        """Samples of images that are so bright at their points (..., points, points), alone."""
        along, down, passed, x, y = self._alone
        real, imaginary = np.split(down @ values, 2, -2)
        sent = y @ ((real + 1j * imaginary) @ along * passed)
        return np.asarray(sent.real @ x.real - sent.imag @ x.imag)

    def among_neighbours(self, waves: Array) -> Callable[[NDArray[Any]], NDArray[np.complex128]]:
        """Map from images (n, points, points) to samples; all microlenses have it, turned by waves (n, 2).

        By Poisson's formula a sum over the lattice's frequencies.
        """
        packing = PACKINGS[self.camera.layout]
        most = math.ceil(packing.orders * (self.finest + 1))
        n = np.arange(-most, most + 1.0)
        up = packing.wave_up(n[:, None], n)
        fx = waves[:, 0, None, None] + n[:, None]
        # (wave, order along, order up): rows of a square array are alike in all orders along.
        fy = waves[:, 1, None, None] + (up if np.ptp(up, axis=0).any() else up[:1])
        s, t = self.samples
        across = np.exp(-2j * math.pi * self.at[:, None] * fx[..., 0][:, None])
        down = np.exp(-2j * math.pi * fy[..., None] * self.at)
        # Nearer images of neighbours are those of a nearer pupil, which is out of focus by as much.
        turn = 1 - np.array(self.apart) - float(microlens_defocus(self.camera) * self.camera.d) / self.pitch
        shape, periods = LENS_SHAPES[self.camera.lens_shape], waves.T[..., None, None]
        moved = across_lenses(shape, 1.0, turn[0] * fx, turn[1] * fy, periods)
        passed = self.transfer(fx, fy) * moved / packing.rise
        back = np.exp(2j * math.pi * fy[..., None] * t)
        along = np.exp(2j * math.pi * fx * s)

        def shown(images: NDArray[Any]) -> NDArray[np.complex128]:
            lines = np.swapaxes(images @ across, 1, 2)  # (wave, order along, point)
            if fy.shape[1] == 1:
                sent = (lines @ np.swapaxes(down[:, 0], 1, 2)) * passed
                rows = sent @ back[:, 0]
            else:
                sent = (down @ lines[..., None])[..., 0] * passed
                rows = (sent[:, :, None] @ back)[:, :, 0]
            return np.asarray(np.swapaxes(rows, 1, 2) @ along)

        return shown


def _turned(design: Design) -> Array:
    """Rotation of directions from the array's frame to the lens's, applied from the right."""
    cosine, sine = math.cos(design.microlens_array.rotation), math.sin(design.microlens_array.rotation)
    return np.array([[cosine, sine], [-sine, cosine]])


def _turning(waves: Array, look: Array) -> NDArray[np.complex128]:
    """Waves (n, 2) against those at the origin where a point looks back by `look` (2, ...), shape (n, ...)."""
    along, down = (
        np.exp(-2j * math.pi * np.multiply.outer(k, at))[back]
        for at, (k, back) in zip(look, (np.unique(part, return_inverse=True) for part in waves.T), strict=True)
    )
    return np.asarray(along * down)


def _linear(points: Array, values: Array) -> Array:
    """Linear parts, row by column, of values (..., p, 2) over points (p, 2), shape (..., 2, 2)."""
    columns = np.concatenate([np.ones((len(points), 1)), points], -1)
    return np.asarray(np.linalg.pinv(columns)[1:] @ values)


def _nodes_over(low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Nodes along each axis of a box, and all of them, shape (n, 2)."""
    along, down = (nodes_between(*ends, NODES) for ends in zip(low, high, strict=True))
    return along, down, np.stack(np.meshgrid(along, down), -1).reshape(-1, 2)


def _degree(nodes: Array, good: NDArray[np.bool_], most: int) -> int:
    """Odd degree, at most `most`, of polynomials over nodes (n, 2) that the `good` of them carry; -1 of none.

    Where rays fold or do not come through on one side, these would grow there without end.
    """
    x, y = nodes.T
    middle, half = _box(x, y)
    x, y = ((nodes - middle) / half).T
    for degree in range(most, 0, -2):
        columns = products(x, y, degree).T
        if np.linalg.matrix_rank(columns[good]) == columns.shape[1] < good.sum():
            grown = np.abs(columns @ np.linalg.pinv(columns[good])).sum(1).max()
            if grown <= AMPLIFIED:
                return degree
    return -1


def _box(x: Array, y: Array) -> tuple[Array, Array]:
    """Middle and half the size of the box that axes span."""
    low, high = np.array([[axis.min(), axis.max()] for axis in (x, y)]).T
    return (low + high) / 2, np.maximum((high - low) / 2, 1e-9)


def _over_pupil(at: NDArray[Any]) -> NDArray[Any]:
    """Products of polynomials over points on the pupil (2, ...) [diameters], shape (terms, ...)."""
    return products(2 * at[0], 2 * at[1], PUPIL_DEGREE)


def _at_mean(means: NDArray[Any]) -> NDArray[Any]:
    """`_over_pupil` at the mean places of light whose means of it, shape (terms, ...), are these."""
    return products(means[PUPIL_DEGREE + 1], means[1], PUPIL_DEGREE)


def _over_views(coefficients: NDArray[np.float32], powers: NDArray[np.float32]) -> NDArray[np.float32]:
    """Polynomials over the pupil, shape (n, 2, terms, v, u), at views: their powers (terms, ...) or (terms, ..., v, u).

    Shape (n, 2, ..., v, u).
    """
    if powers.ndim == 3:
        return np.moveaxis(np.tensordot(coefficients, powers, (2, 0)), (2, 3), (-2, -1))
    if powers.ndim == 4:
        return np.asarray(np.einsum("ksvu,nckvu->ncsvu", powers, coefficients))
    out = np.empty((*coefficients.shape[:2], *powers.shape[1:]), np.float32)
    for t in range(powers.shape[1]):  # all at once would not stay near the processor
        np.einsum("ksvu,nckvu->ncsvu", powers[:, t], coefficients, out=out[:, :, t])
    return out


def _as_seen(seen: NDArray[np.float32], more: NDArray[np.float32], field: LightField) -> NDArray[np.float32]:
    """Change of P and E that middles have, `seen`, by what microlenses themselves see `more`, all (2, 2, t, s, v, u).

    That is known where a microlens stands, and looked for where what it sees is: to first order both move it.
    """
    if min(seen.shape[-2:]) < 2:
        return more
    out, steps = more.copy(), (field.v, field.u)
    for t in range(seen.shape[2]):
        slopes = [np.stack([np.gradient(part[:, :, t], steps[k], axis=k - 2) for k in (1, 0)]) for part in (seen, more)]
        for ways, slope in ((seen[:, :, t], slopes[1]), (more[:, :, t], slopes[0])):
            for k in range(2):  # along u, along v
                out[:, :, t] += ways[1, k] * slope[k]
                out[0, :, t] += ways[0, k] * slope[k, 1]
    return out
