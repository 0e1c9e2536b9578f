"""Fields of a design behind a real main lens, in the terms that those of an ideal one are told in.

Detail is blurred by what the lens does to the light of an object point. Its ray through a point of the FAP meets the
array at u; p' is where a microlens shows that point of the FAP. The ideal lens has u = rho p'; this one's u over p' is
a polynomial through some tens of rays, and its mean between two places of the FAP's image, times their distance, the
difference of the wave's phases there. Views and the refocused image take their blur from it alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Complex
from ..camera import Camera, Number
from ..design import Design
from ..fates import ImageFate
from ..polynomials import Polynomials
from ..shapes.discs import Outline, gauss_legendre, heights
from ..shapes.openings import Openings
from ..theory.light import object_scale, solid_angle
from ..theory.quantities import QUANTITIES, image_rate
from ..theory.resolution import FieldTransfer, sparse
from ..theory.stop_images import MicrolensImages
from .camera import SensorPoints, camera_of, microlenses, sensor_of_pupil
from .images import TracedImages, forward_rays, real_images
from .outlines import circle, polygon_moments
from .train import etendue_sr

Array = NDArray[np.float64]

DEGREE = 5
"""Degree of the polynomials over the FAP."""
RINGS, SPOKES, FEWEST = 5, 12, 42
"""Rays of an object point, over the FAP; and how many must come through."""
SOFT = 0.6
"""Frequencies times `_Beam.spread` by which light so spread has lost its contrast, an even disc's by 0.31."""
NODES = 12
"""Gauss-Legendre places along a row, at least."""
TRIALS = 9
"""Places across an image between which light's phases are taken to turn one way."""
MOST_TURNS = 64.0
"""Periods by which a lens turns them, beyond which nothing is left of the contrast."""
GAUSS = 1 / math.sqrt(3)
"""Two places so far from the middle of a stretch have its mean, of cubic polynomials."""


def images_of(design: Design, fields: ArrayLike) -> MicrolensImages:
    """Microlens images of a design at fields (N, 2) of its array [mm]; traced where its main lens is real."""
    return MicrolensImages(Camera.of(design), fields) if design.lens is None else LensImages(design, fields)


class LensImages(MicrolensImages):
    """Microlens images of a single design's thin twin, with light and magnification as its real lens makes them."""

    def __init__(self, design: Design, fields: ArrayLike) -> None:
        super().__init__(Camera.of(design), fields)
        self.lens, self.places = camera_of(design), microlenses(design, self.fields)

    @cached_property
    def traced(self) -> TracedImages:
        """Images as the lens makes them."""
        return real_images(self.lens, self.places)

    @cached_property
    def illumination(self) -> Number:
        """Light of a microlens against one whose image nothing cuts, on the lens's axis."""
        fap = self.lens.fap
        rim = sensor_of_pupil(self.lens, np.zeros(2), fap.centre + fap.diameter / 2 * circle(SPOKES))
        area, *rest = polygon_moments(rim.sensor[None])
        uncut = uncut_light(self._light(np.zeros((1, 2)), np.where(rim.ok.all(), area, np.nan), *rest), self.camera)
        seen = self.traced
        return (self._light(self.places, seen.area, seen.centroid, seen.second_moments) / uncut)[:, None]

    def _light(self, places: Array, area: Array, centroid: Array, moments: Array) -> Array:
        """Etendue of lit parts, centroids counted from the microlenses' axes [sr], (n,)."""
        shape = np.column_stack([area, places + centroid - self.lens.detector.centre, moments])
        return etendue_sr(shape, places - self.lens.array.centre, self.lens.array.pose, self.lens.detector.pose)

    @cached_property
    def stretch(self) -> tuple[Number, Number]:
        """Stretch of a microlens's part of the focal plane against that on the axis.

        Along the field's radius and across it.
        """
        along, across = self._magnified(None)
        scale = object_scale(self.camera)
        return along[:, None] / scale, across[:, None] / scale

    @cached_property
    def _chief(self) -> SensorPoints:
        """Chief rays of the microlenses and of places half a pitch right, left, above and below, (n, 5)."""
        half = float(self.camera.d) / 2
        offsets = np.array([[0.0, 0.0], [half, 0.0], [-half, 0.0], [0.0, half], [0.0, -half]])
        return sensor_of_pupil(self.lens, self.places[:, None] + offsets, self.lens.fap.centre)

    def _plane(self, at: float | None) -> float:
        """Place along z of a plane ahead of the tip, or of the focal plane, in the lens's frame [mm]."""
        tip = self.lens.first_order.front_principal - float(self.camera.tip)
        return self.lens.focal_plane if at is None else tip - at

    def _met(self, at: float | None) -> Array:
        """Points where those rays meet a plane, in the lens's frame [mm], (n, 5, 2)."""
        met = self._chief.views.at(self.lens.fap.z - self._plane(at))
        return np.where(self._chief.ok[..., None], met, np.nan)

    def _magnified(self, at: float | None) -> tuple[Array, Array]:
        """Millimetres on a plane per millimetre on the array, along the field's radius and across it."""
        met = self._met(at)
        ways = np.stack([met[:, 1] - met[:, 2], met[:, 3] - met[:, 4]], axis=-1) / float(self.camera.d)
        return stretches(ways, self.places, 1.0)

    def _scales(self, field: int, at: float | None) -> tuple[float, float]:
        """Scales at one field; first order's where its chief rays are lost."""
        along, across = (float(scale[field]) for scale in self._magnified(at))
        if math.isfinite(along * across):
            return along, across
        axial = float(QUANTITIES["object_sample_mm"](self.camera, at) / self.camera.d)
        return axial, axial

    def on_plane(self, ahead: Number) -> tuple[Array, Array]:
        """Points where chief rays meet a plane `ahead` of the tip, from the system's axis [mm]; nan if lost."""
        x, y = (self._met(float(ahead))[:, 0] + [float(self.camera[f"main_lens.decentre.{k}"]) for k in (0, 1)]).T
        return x[:, None], y[:, None]

    @property
    def directions(self) -> Array:
        """Unit vectors of chief rays away from the bore, in the medium of the scene, (n, 1, 3); nan likewise."""
        slope = np.where(self._chief.ok[:, :1], self._chief.views.slope[:, 0], np.nan)
        way = np.concatenate([-slope, np.ones((len(slope), 1))], axis=1)
        return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))[:, None]

    def transfer(self, field: int, at: float | None) -> _TracedTransfer:
        """MTF at a field, on a plane ahead of the tip or on the focal plane."""
        images, place = self.traced, self.places[field]
        beam = self._beam(field, at)
        known = beam is not None and images.kept_fraction[field] > 0 and images.status[field] != ImageFate.FOLDED
        outline = images.boundary[field]
        away = float(np.hypot(*place))
        x, y = images.centroid[field].tolist()
        return _TracedTransfer(
            self.camera,
            Openings.of_discs(images.chief[field][None], np.array([np.ptp(outline, axis=0).max() / 2])),
            (x, y) if known else None,
            float(image_rate(self.camera, at)),
            *self._scales(field, at),
            (float(place[0] / away), float(place[1] / away)) if away > 1e-12 * float(self.camera.d) else (1.0, 0.0),
            outline,
            beam or _Beam(Polynomials(np.zeros(2), np.ones(2), np.zeros((2, 1, 1))), 0.0),
        )

    @cached_property
    def _pupil(self) -> Array:
        """Points of the FAP that object points send rays through, its centre first, (R, 2) [mm]."""
        nodes, _ = np.polynomial.legendre.leggauss(RINGS)
        rings = np.sqrt((nodes + 1) / 2)[:, None, None] * circle(SPOKES)
        fap = self.lens.fap
        return np.asarray(fap.centre + fap.diameter / 2 * np.concatenate([np.zeros((1, 2)), rings.reshape(-1, 2)]))

    @cached_property
    def _shown(self) -> SensorPoints:
        """Sensor points at which microlenses show the points of the FAP, (n, R)."""
        return sensor_of_pupil(self.lens, self.places[:, None], self._pupil)

    def _beam(self, field: int, at: float | None) -> _Beam | None:
        """Beam of the object point that a microlens's chief ray meets on a plane; None of too few rays."""
        point, z = self._met(at)[field, 0], self._plane(at)
        if not np.isfinite(point).all():
            return None
        moved, _, comes = forward_rays(self.lens, point, self._pupil, self.lens.wavelength, z=z)
        comes &= self._shown.ok[field]
        if not comes[0] or np.count_nonzero(comes) < FEWEST:
            return None
        ways, place = moved.T[comes], self._shown.sensor[field][comes] - self.places[field]
        half = np.full(2, np.ptp(place, axis=0).max() / 2)
        spread = float(np.std(ways - float(image_rate(self.camera, at)) * place, axis=0).max())
        return _Beam(Polynomials.fitted(place[0], half, DEGREE, place.T, (ways - ways[0]).T), spread)


class _Beam(NamedTuple):
    """Light of an object point behind the array's plane, about its chief ray."""

    ways: Polynomials
    """Ways on the array (x, y) of light through the FAP's points by where a microlens shows those [mm]."""
    spread: float
    """Standard deviation of what no refocusing undoes of them, along the axis where it is larger [mm]."""

    def along(self, x: Array, y: Array, axes: Array) -> Array:
        """Way along a direction of light that goes to places of the sensor [mm]."""
        ways = self.ways
        return Polynomials(ways.middle, ways.half, axes[0] * ways.terms[0] + axes[1] * ways.terms[1]).at(x, y)


@dataclass(frozen=True, eq=False)
class _TracedTransfer(FieldTransfer):
    """MTF at one field behind a real lens; `openings` are one disc about as large as the image."""

    outline: Array
    """Boundary of what is lit, from the microlens's axis, (K, 2) [mm]."""
    beam: _Beam
    """Beam of the plane's object point."""

    @property
    def round(self) -> bool:
        """Whether a quarter turn changes nothing but the scale."""
        return False

    @property
    def softest(self) -> float:
        """Frequency on the array beyond which a lens's aberrations may leave nothing [1/mm]: to be tried first."""
        return SOFT / self.beam.spread if self.beam.spread > 0 else math.inf

    def _spectrum(self, nu: float, axes: Array, along: Array, up: Array, steps: Array) -> Complex:
        shift = nu * float(self.camera.wavelength * self.camera.seen.d_2) * axes / 2
        turns = self._turns(nu, axes)
        rows = sparse(self._rows(up, steps) + math.ceil(math.pi * turns))
        (low, high), edge = self._outline.between, abs(float(shift[1]))
        y, weight = heights(low + edge, high - edge, rows)
        (left, right), other = (self._outline.ends(y - sign * shift[1]) + sign * shift[0] for sign in (-1, 1))
        left, right = np.maximum(left, other[0]), np.minimum(right, other[1])
        half, middle = np.maximum(right - left, 0.0)[:, None] / 2, (left + right)[:, None] / 2
        turns += min(np.abs(along).max(initial=0.0) * 2 * half.max(initial=0.0), self._most)
        nodes, weights = gauss_legendre(sparse(NODES + math.ceil(math.pi / 2 * turns)))
        x, y = middle + half * nodes, y[:, None]
        astray = self._astray(x, y, axes, shift)
        wave = weight[:, None] * half * weights * np.exp(2j * math.pi * (nu * astray + along[:1].sum() * x))
        light = np.empty((len(y), len(along)), complex)
        step = np.exp(2j * math.pi * (along[1] - along[0]) * x) if len(along) > 1 else np.ones(1)
        for n in range(len(along)):  # evenly spaced
            light[:, n] = wave.sum(1)
            wave *= step
        return np.asarray(np.exp(2j * math.pi * steps[:, None] * y.T) @ (light * np.exp(2j * math.pi * up * y)))

    @cached_property
    def _outline(self) -> Outline:
        return Outline.of(self.outline)

    def _astray(self, x: Array, y: Array, axes: Array, shift: Array) -> Array:
        """Way on the array along the detail by which light misses where an ideal lens brings it [mm].

        Of light that goes to the sensor's places ``(x, y) -+ shift``, on average between.
        """
        ways = [self.beam.along(x + part * shift[0], y + part * shift[1], axes) for part in (-GAUSS, GAUSS)]
        return np.asarray((ways[0] + ways[1]) / 2 - self.rate * (x * axes[0] + y * axes[1]))

    def _turns(self, nu: float, axes: Array) -> float:
        """Periods by which detail's phases turn over the image beyond an ideal lens's, at most."""
        return min(nu * max(float(np.nansum(np.abs(steps @ axes), axis=0).max()) for steps in self._strays), MOST_TURNS)

    @cached_property
    def _strays(self) -> tuple[Array, Array]:
        """Steps of the ways astray along x and y, between places along the image's width and height, (8, 9, 2) [mm]."""
        middle, half = (self.outline.max(0) + self.outline.min(0)) / 2, np.ptp(self.outline, axis=0) / 2
        place = np.linspace(-1.0, 1.0, TRIALS)
        x, y = np.broadcast_arrays(middle[0] + half[0] * place, middle[1] + half[1] * place[:, None])
        ways = np.stack([self._astray(x, y, axis, np.zeros(2)) for axis in np.eye(2)], axis=-1)
        ways[np.hypot(place, place[:, None]) > 1] = np.nan
        return np.diff(ways, axis=0), np.diff(ways.swapaxes(0, 1), axis=0)


def uncut_light(light: Array, camera: Camera) -> Array:
    """Light of microlenses on the axis, as traced [sr].

    By first order where the lens does not show them the whole FAP.
    """
    return np.where(np.isnan(light), solid_angle(camera), light)


def stretches(moved: Array, place: Array, scale: Number) -> tuple[Array, Array]:
    """Stretch of microlenses' parts of the focal plane against the axis, along the field's radius and across.

    Parameters
    ----------
    moved : ndarray, (..., 2, 2)
        What chief rays' points on that plane move in x, y per microlens's way along x, y.
    place : ndarray, (..., 2)
        Microlenses, from the lens's axis, along the same axes as their ways.
    scale : float or ndarray
        `object_scale`.
    """
    radius = np.hypot(place[..., 0], place[..., 1])[..., None]
    way = np.where(radius > 0, place / np.where(radius > 0, radius, 1.0), np.array([1.0, 0.0]))
    aside = np.stack([-way[..., 1], way[..., 0]], axis=-1)
    along, across = (np.linalg.norm(np.einsum("...ij,...j", moved, u), axis=-1) / scale for u in (way, aside))
    return along, across
