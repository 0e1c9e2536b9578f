"""Fields of a single design and the detail that they show, behind an ideal main lens and a real one.

Detail is blurred by what the lens does to the light of an object point. Its ray through a point of the FAP meets the
array at u; p' is where a microlens shows that point of the FAP. The ideal lens has u = rho p'; this one's u over p' is
a polynomial through some tens of rays, and its mean between two places of the FAP's image, times their distance, the
difference of the wave's phases there. Views and the refocused image take their blur from it alike. The refocused image
is that of the slope at which it is sharpest, as whoever refocuses finds it: the lens's best focus, which with spherical
aberration or a curved field is not the first-order one, has another slope than the plane's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
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
from ..theory.light import on_array
from ..theory.photometry import contrast_left, response
from ..theory.quantities import QUANTITIES, image_rate
from ..theory.resolution import FieldTransfer, sparse
from ..theory.stop_images import MicrolensImages
from .camera import camera_of, microlenses
from .images import TracedImages, forward_rays, real_images
from .microlens import FieldRays, LensImages, Mount, thin_targets
from .outlines import circle

Array = NDArray[np.float64]

DEGREE = 5
"""Degree of the polynomials over the FAP."""
RINGS, SPOKES, FEWEST = 5, 12, 42
"""Rays of an object point, over the FAP; and how many must come through."""
PUPIL = np.concatenate(
    [
        np.zeros((1, 2)),
        (np.sqrt((np.polynomial.legendre.leggauss(RINGS)[0] + 1) / 2)[:, None, None] * circle(SPOKES)).reshape(-1, 2),
    ]
)
"""Points of the unit disc that stand for those of the FAP, its centre first, (R, 2)."""
SOFT = 0.6
"""Frequencies times `_Beam.spread` by which light so spread has lost its contrast, an even disc's by 0.31."""
NODES = 12
"""Gauss-Legendre places along a row, at least."""
TRIALS = 9
"""Places across an image between which light's phases are taken to turn one way."""
MOST_TURNS = 64.0
"""Periods by which a lens turns them, beyond which nothing is left of the contrast."""
HALF = 0.5
"""Contrast that a slope is to keep of detail as fine as it can."""
SLOPES = np.linspace(-1.0, 1.0, 65)
"""Slopes that are tried, by the periods that they turn detail's phases by between an image's middle and its rim."""
OCTAVES, HALVINGS = 8, 10
"""Octaves of detail below that of a microlens's width in which that is looked for, and halvings of them."""
GAUSS = 1 / math.sqrt(3)
"""Two places so far from the middle of a stretch have its mean, of cubic polynomials."""


def _contrasts(images: MicrolensImages, at: Number | None) -> Array:
    """Share of the contrast that the veil leaves at fields, of a plane ahead of the tip or of the focal plane."""
    shape = (len(images.fields), *(images.camera.shape or (1,)))
    light = images.level * response(images.camera, np.hypot(*images.microlens[:2]))
    return np.broadcast_to(contrast_left(images.camera, at, np.broadcast_to(light, shape)), shape)


def _contrast(images: MicrolensImages, field: int, at: float | None) -> float:
    """Share of the contrast that the veil leaves of one camera at a field."""
    return float(_contrasts(images, at)[field, 0])


class IdealImages(MicrolensImages):
    """Microlens images of ideal lenses' designs, each with its transfer."""

    def transfer(self, field: int, at: float | None) -> FieldTransfer:
        """MTF of one camera at a field, on a plane ahead of the tip or on the focal plane."""
        return self.transfers(field, at, [self.camera])[0]

    def transfers(self, field: int, at: Number | None, each: Sequence[Camera]) -> list[FieldTransfer]:
        """MTF at a field of each camera of the builds, on a plane ahead of its tip or on its focal plane."""
        shape, openings = (len(self.fields), len(each)), self.openings.at(np.s_[field])
        part = openings.common()
        rows = (*self.microlens[:2], *self.scales(at), image_rate(self.camera, at), _contrasts(self, at))
        numbers = np.stack([np.broadcast_to(row, shape)[field] for row in rows], -1).tolist()
        cuts = part.clipping | (np.arange(openings.total) == 0)
        transfers = []
        for k, (camera, (x, y, along, across, rate, contrast)) in enumerate(zip(each, numbers, strict=True)):
            u, v = part.centroid[k].tolist()
            away = math.hypot(x, y)
            transfers.append(
                FieldTransfer(
                    camera,
                    openings.at(k).some(np.flatnonzero(cuts[k]).tolist()),
                    (u, v) if part.lit[k] else None,
                    rate,
                    along,
                    across,
                    (x / away, y / away) if away > 1e-12 * float(camera.d) else (1.0, 0.0),
                    contrast,
                )
            )
        return transfers


class DesignImages(LensImages):
    """Microlens images of a single design behind its real lens."""

    def __init__(self, design: Design, fields: ArrayLike) -> None:
        camera, at = Camera.of(design), np.asarray(fields, float).reshape(-1, 2)
        self.lens, self.places = camera_of(design), microlenses(design, at)
        axis, straight = on_array(camera, np.zeros(2)), self.lens.fap.straight
        rays = FieldRays(partial(thin_targets, camera), at, axis, straight=straight, own=True)
        super().__init__(camera, at, Mount.of(design), rays, np.zeros(len(at), np.bool_))

    @cached_property
    def traced(self) -> TracedImages:
        """Images with their boundaries, folded ones as well."""
        return real_images(self.lens, self.places)

    @cached_property
    def _lit(self) -> tuple[Array, Array]:
        seen, aside = self.traced, self.places - self.lens.detector.centre
        return np.column_stack([seen.area, aside + seen.centroid, seen.second_moments]), seen.kept_fraction

    def _scales(self, field: int, at: float | None) -> tuple[float, float]:
        """Scales at one field; first order's where its chief rays are lost."""
        along, across = (float(np.asarray(scale)[field, 0]) for scale in self.scales(at))
        if math.isfinite(along * across):
            return along, across
        axial = float(QUANTITIES["object_sample_mm"](self.camera, at) / self.camera.d)
        return axial, axial

    def transfer(self, field: int, at: float | None) -> FieldTransfer:
        """MTF at a field, on a plane ahead of the tip or on the focal plane."""
        images, place = self.traced, self.places[field]
        beam = self._beam(field, at)
        known = beam is not None and images.kept_fraction[field] > 0 and images.status[field] != ImageFate.FOLDED
        outline = images.boundary[field]
        away = float(np.hypot(*place))
        x, y = images.centroid[field].tolist()
        beam = beam or _Beam(Polynomials(np.zeros(2), np.ones(2), np.zeros((2, 1, 1))), 0.0, 0.0)
        transfer = _TracedTransfer(
            self.camera,
            Openings.of_discs(images.chief[field][None], np.array([np.ptp(outline, axis=0).max() / 2])),
            (x, y) if known else None,
            beam.rate,
            *self._scales(field, at),
            (float(place[0] / away), float(place[1] / away)) if away > 1e-12 * float(self.camera.d) else (1.0, 0.0),
            _contrast(self, field, at),
            outline,
            beam,
        )
        return transfer.sharpest if known else transfer

    def astray(self, field: int, at: float | None) -> float:
        """Standard deviation of the ways by which views miss one slope [pitches]; infinite where too few rays come."""
        beam = self._beam(field, at)
        return math.inf if beam is None else beam.spread / float(self.camera.d)

    @property
    def _pupil(self) -> Array:
        """Points of the FAP that object points send rays through, (R, 2) [mm]."""
        return self.lens.fap.filled(PUPIL)

    @cached_property
    def _shown(self) -> Array:
        """Sensor points at which microlenses show those, from their axes (n, R, 2) [mm]."""
        landed = self._aimed(self.rays.to(self.fields, self.lens.fap.shares(self._pupil)), len(PUPIL)).landed
        return np.asarray(landed + (self.lens.detector.centre - self.places)[:, None])

    def _beam(self, field: int, at: float | None) -> _Beam | None:
        """Beam of the object point that a microlens's chief ray meets on a plane; None of too few rays."""
        z, place = float(self._plane(at)[0, 0]), self._shown[field]
        point = self._chief_ahead.at(self._plane(at))[field, 0]
        if not np.isfinite(point).all():
            return None
        moved, _, comes, _ = forward_rays(self.lens, point, self._pupil, self.lens.wavelength, z=z)
        comes &= np.isfinite(place).all(axis=-1)
        if not comes[0] or np.count_nonzero(comes) < FEWEST:
            return None
        ways, place = moved.T[comes], place[comes]
        half = np.full(2, np.ptp(place, axis=0).max() / 2)
        off, strayed = place - place.mean(axis=0), ways - ways.mean(axis=0)
        rate = float((strayed * off).sum() / np.square(off).sum())
        spread = float(np.std(ways - rate * place, axis=0).max())
        return _Beam(Polynomials.fitted(place[0], half, DEGREE, place.T, (ways - ways[0]).T), rate, spread)


def images_of(design: Design, fields: ArrayLike) -> IdealImages | DesignImages:
    """Microlens images of a design at fields (N, 2) of its array [mm]; traced where its main lens is real."""
    return IdealImages(Camera.of(design), fields) if design.lens is None else DesignImages(design, fields)


class _Beam(NamedTuple):
    """Light of an object point behind the array's plane, about its chief ray."""

    ways: Polynomials
    """Ways on the array (x, y) of light through the FAP's points by where a microlens shows those [mm]."""
    rate: float
    """Slope at which its rays meet with the least spread."""
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
    def sharpest(self) -> _TracedTransfer:
        """Transfer refocused by the slope that keeps half the contrast of the finest detail, of either direction."""
        best, most = self, -math.log2(float(self.camera.d) * max(self.along, self.across))
        low, high = most - OCTAVES, most
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            slope, contrast = best._slope_of(2**middle)
            if contrast >= HALF:
                best, low = replace(self, rate=slope), middle
            else:
                high = middle
        return best

    def _slope_of(self, detail: float) -> tuple[float, float]:
        """Slope that shows detail of the object best [lp/mm], and its contrast, on no veil, in the worse direction."""
        slopes = SLOPES * 2 / (detail * max(self.along, self.across) * self._width)
        least = np.full(SLOPES.shape, np.inf)
        for way in ("tangential", "sagittal"):
            nu, axes = detail * self.scale(way), self.axes(way)
            along, up = -nu * np.multiply.outer(axes, slopes)
            lens = self._spectrum(nu, np.array(axes), along, up, np.zeros(1))[0] / self._area
            least = np.minimum(least, np.abs(lens * self._lens.refocused(self.rate + slopes, nu, axes)))
        k = int(np.clip(least.argmax(), 1, len(SLOPES) - 2))
        before, there, after = least[k - 1 : k + 2].tolist()  # a parabola's top
        off = (after - before) / 2 / max(2 * there - before - after, abs(after - before), 1e-300)
        return self.rate + float(slopes[k] + off * (slopes[1] - slopes[0])), there

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
