"""Field of view by ISO 8600-3, method B: rings seen at two distances, the entrance pupil's position not known.

A picture of the rings tells what a microlens pitch spans on the target, lens distortion and the target's own tilt
allowed for; the field ends where the sensor, or the light, ends. What its width grows by between two distances is the
angle.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import erf

from .._arrays import Array, by_value
from ..calibration.frames import CalibrationError
from .clusters import clustered_covariance

APART = 3.0
"""Gap between rings that a picture shows as such [pitches]."""
MOST = 6000
"""Microlenses that are fitted at most; others are left out evenly."""
OFF_CENTRE, SCALES = 0.35, 0.1
"""Share of the field that the rings' middle may be off its own, and share by which their scale may be off."""
STRAYS, ROUNDS = 3.5, 4
"""Residuals over their rms beyond which a microlens shows something else, as a label; rounds of leaving those out."""
PATCH = 6
"""Microlenses along a side of patches whose residuals are taken to err alike."""
LEAST_SHOWN = 0.5
"""Least correlation of a picture with the rings fitted to it."""


class Rings(NamedTuple):
    """Concentric rings as printed."""

    radii: Array
    """[mm]"""
    lines: Array
    """Width of each ring's line [mm]."""

    @classmethod
    def of(cls, radii: Sequence[float], line: float) -> Rings:
        """Rings whose lines are a share of the gap inside them."""
        gaps = np.diff([0.0, *radii])
        return cls(np.asarray(radii, float), line * gaps)

    def shown(self, sample: float) -> Rings:
        """Rings that stand apart where a microlens spans `sample` [mm]."""
        gaps = np.diff([0.0, *self.radii])
        wide = np.minimum(gaps, np.append(gaps[1:], np.inf)) > APART * sample
        return Rings(self.radii[wide], self.lines[wide])

    def darkness(self, radius: Array, blur: float) -> Array:
        """Share of a line at places so far from the middle, blurred by a Gaussian [mm]."""
        off, half, spread = np.subtract.outer(radius, self.radii), self.lines / 2, math.sqrt(2) * blur
        near = np.abs(off) < half + 6 * spread  # farther lines add nothing to the last digit
        at, half, dark = off[near], np.broadcast_to(half, off.shape)[near], np.zeros_like(off)
        dark[near] = erf((at + half) / spread) - erf((at - half) / spread)
        return np.asarray(dark.sum(-1) / 2)


class _Sight(NamedTuple):
    """Parameters of a picture of rings."""

    log_scale: float
    distortion: float
    """Growth of the scale towards the corner of the field."""
    x: float
    y: float
    """Middle of the rings from the field's [mm]."""
    tilt_x: float
    tilt_y: float
    """Growth of distance along the target."""
    log_blur: float

    def radius(self, place: Array, reach: float, pupil: float) -> Array:
        """Radius on the target that microlenses see, at `place` from the field's middle [pitches], shape (2, n)."""
        x, y = self.on_plane(place, reach)
        meets = (pupil - self.tilt_x * self.x - self.tilt_y * self.y) / (pupil - self.tilt_x * x - self.tilt_y * y)
        dx, dy = meets * x - self.x, meets * y - self.y
        return np.asarray(np.sqrt(dx**2 + dy**2 + (self.tilt_x * dx + self.tilt_y * dy) ** 2))

    def on_plane(self, place: Array, reach: float) -> Array:
        """Places on a plane square to the axis through the rings' middle [mm]."""
        bent = 1 + self.distortion * (place**2).sum(0) / reach**2
        return np.asarray(math.exp(self.log_scale) * place * bent)


@by_value
@dataclass(frozen=True)
class _Picture:
    """Microlenses that rings are fitted to."""

    values: Array
    place: Array
    """From the field's middle [pitches], shape (2, n)."""
    reach: float
    """From there to its corner [pitches]."""
    pupil: float
    """Distance of the target from the entrance pupil, about [mm]."""
    rings: Rings

    def some(self, chosen: NDArray[Any]) -> _Picture:
        """Microlenses chosen."""
        return replace(self, values=self.values[chosen], place=self.place[:, chosen])

    def left(self, parameters: Array) -> Array:
        """Residuals of shading and the rings' darkness, whose own sizes are fitted for each sight."""
        dark = self._beside_shading(self._dark(parameters))
        return np.asarray(self._unshaded - dark * (dark @ self._unshaded / max(float(dark @ dark), 1e-300)))

    def contrast(self, parameters: Array) -> float:
        """Correlation of what shading leaves with the rings; below 0 where they are brighter than the paper."""
        return self._contrast(self._dark(parameters))

    def _contrast(self, dark: Array) -> float:
        dark = self._beside_shading(dark)
        return -float(dark @ self._unshaded) / max(float(np.linalg.norm(dark) * np.linalg.norm(self._unshaded)), 1e-30)

    @cached_property
    def _unshaded(self) -> Array:
        """Values less their shading."""
        return self._beside_shading(self.values)

    def _beside_shading(self, values: Array) -> Array:
        return np.asarray(values - self._shade @ (self._shade.T @ values))

    @cached_property
    def _shade(self) -> Array:
        """Shading as orthonormal columns, the same for every sight."""
        x, y = self.place / self.reach
        return np.linalg.qr(np.stack([np.ones(x.size), x, y, x**2 + y**2], axis=-1))[0]

    def _dark(self, parameters: Array) -> Array:
        sight = _Sight(*parameters.tolist())
        return self.rings.darkness(sight.radius(self.place, self.reach, self.pupil), math.exp(sight.log_blur))

    def start(self, sample: float) -> Array:
        """Best of many sights, evenly over where rings may stand and how large they may be."""
        line = max(2.0, float(self.rings.lines.min()) / sample)  # [pitches]
        few = self.some(np.arange(0, self.values.size, max(1, self.values.size // 1500)))
        half = OFF_CENTRE * self.reach / math.sqrt(2)
        offsets = sample * np.linspace(-half, half, 2 * math.ceil(half / line) + 1)
        scales = np.log(sample) + np.linspace(-SCALES, SCALES, 2 * math.ceil(SCALES * self.reach / line) + 1)
        blur = 0.6 * line * sample
        step = blur / 20
        radii = np.arange(0.0, math.sqrt(2) * offsets[-1] + math.exp(scales[-1]) * self.reach + blur, step)
        darkness = self.rings.darkness(radii, blur)  # one blur: read from a table by hundreds of sights

        def contrast(tried: tuple[float, float, float]) -> float:
            scale, *middle = tried
            x, y = math.exp(scale) * few.place - np.reshape(middle, (2, 1))
            return few._contrast(darkness[np.rint(np.hypot(x, y) / step).astype(int)])

        scale, x, y = max(itertools.product(scales.tolist(), offsets.tolist(), offsets.tolist()), key=contrast)
        return np.array([scale, 0, x, y, 0, 0, math.log(blur)])


@dataclass(frozen=True, eq=False)
class RingView:
    """Picture of the rings at one distance."""

    ahead: float
    """Distance of the target ahead of the tip [mm]."""
    sizes_mm: Array
    """Width, height and diagonal of the field there, shape (3,)."""
    sigma: Array
    """Standard errors of those, (3,)."""

    @classmethod
    def of(
        cls, picture: NDArray[np.floating], lit: NDArray[np.bool_], axes: tuple[Array, Array], ends: Array,
        rings: Rings, ahead: float, sample: float, pupil: float,
    ) -> RingView:  # fmt: skip
        """Rings in a picture.

        Parameters
        ----------
        picture, lit : ndarray, shape (v, u)
            Middle view, and where it holds anything.
        axes : pair of ndarray
            u and v of its columns and rows [pitches].
        ends : ndarray, shape (2, 2)
            Least and largest u, then v, of the field.
        ahead : float
            Distance ahead of the tip [mm].
        sample, pupil : float
            Span of a pitch there and distance from the entrance pupil [mm], about, as the design has them.

        Raises
        ------
        CalibrationError
            No rings of that size are seen.
        """
        shown = rings.shown((1 + SCALES) * sample)
        if not shown.radii.size:
            raise CalibrationError(f"shows no rings that stand {APART:g} microlenses apart; print coarser ones")
        v, u = np.nonzero(lit)
        every = max(1, v.size // MOST)
        v, u = v[::every], u[::every]
        place = np.stack([axes[0][u], axes[1][v]]) - ends.mean(axis=1)[:, None]
        reach = float(np.hypot(*np.diff(ends, axis=1)[:, 0])) / 2
        seen = _Picture(picture[v, u].astype(float), place, reach, pupil, shown)
        # Finer rings than these, and what stands in the middle, are no part of the picture that is fitted.
        parameters, gap = seen.start(sample), shown.radii[0] - (rings.radii[rings.radii < shown.radii[0]][-1:].sum())
        inner = shown.radii[0] - gap / 2

        def outside(parameters: Array) -> NDArray[np.bool_]:
            return np.asarray(_Sight(*parameters.tolist()).radius(place, reach, pupil) > inner)

        used = outside(parameters)
        scale = [0.01, 0.01, sample, sample, 0.05, 0.05, 0.1]
        fitted = seen
        for _ in range(ROUNDS):
            fitted = seen.some(used)
            # Without bounds no tall matrix need be decomposed at every step, as a trust region does.
            parameters = least_squares(fitted.left, parameters, x_scale=scale, method="lm", max_nfev=400).x
            off = np.abs(seen.left(parameters))
            used = outside(parameters) & (off < STRAYS * float(np.sqrt(np.mean(off[used] ** 2))))
        if not fitted.contrast(parameters) > LEAST_SHOWN:
            raise CalibrationError("shows no rings of the printed sizes")

        def sizes(at: Array) -> Array:
            (left, right), (below, above) = ends - ends.mean(axis=1)[:, None]
            pairs = [(left, 0), (right, 0), (0, below), (0, above), (left, below), (right, above)]
            x, y = _Sight(*at.tolist()).on_plane(np.array(pairs, float).T, reach)
            return np.asarray(np.hypot(np.diff(x)[::2], np.diff(y)[::2]))

        fit = least_squares(fitted.left, parameters, x_scale=scale, max_nfev=1)
        left, slopes = np.asarray(fit.fun), np.asarray(fit.jac)
        bins = np.floor(fitted.place / PATCH).astype(int)
        _, patch = np.unique(bins[0] * 100_000 + bins[1], return_inverse=True)
        scores = np.stack([np.bincount(patch, left * column) for column in slopes.T], axis=-1)
        inverse = np.linalg.pinv(slopes.T @ slopes)
        leverage = np.bincount(patch, np.einsum("ni,ij,nj->n", slopes, inverse, slopes))
        covariance = clustered_covariance(inverse, scores, leverage)
        step = 1e-4
        moved = np.eye(len(scale))[:2] * step
        rates = np.array([(sizes(parameters + one) - sizes(parameters - one)) / (2 * step) for one in moved])
        sigma = np.sqrt(np.einsum("ik,ij,jk->k", rates, covariance[:2, :2], rates))
        return cls(ahead, sizes(parameters), sigma)


class FieldAngles(NamedTuple):
    """Field of view from two distances."""

    degrees: Array
    """Full angles over width, height and diagonal, shape (3,)."""
    sigma: Array
    """Standard errors, (3,)."""
    pupil_behind_tip: float
    """Distance of the entrance pupil behind the tip [mm]."""
    pupil_sigma: float

    @classmethod
    def of(cls, near: RingView, far: RingView, placed: tuple[float, float], printed: float) -> FieldAngles:
        """Angles by method B.

        Parameters
        ----------
        near, far : RingView
        placed : pair of float
            Standard uncertainties of their distances [mm].
        printed : float
            Relative standard uncertainty of the printed radii.
        """
        between = far.ahead - near.ahead
        growth = (far.sizes_mm - near.sizes_mm) / between
        random = np.hypot(near.sigma, far.sigma) / between
        error = np.hypot(random, growth * math.hypot(math.hypot(*placed) / between, printed))
        angles = 2 * np.arctan(growth / 2)
        behind = near.sizes_mm / growth - near.ahead
        best = int(np.argmin(random / growth))
        near_share, far_share = far.sizes_mm[best], near.sizes_mm[best]  # of errors of the near size and the far one
        of_sizes = math.hypot(near_share * near.sigma[best], far_share * far.sigma[best])
        of_sizes *= between / (far.sizes_mm[best] - near.sizes_mm[best]) ** 2
        of_places = (
            math.hypot(placed[0] * (far.ahead + behind[best]), placed[1] * (near.ahead + behind[best])) / between
        )
        return cls(
            np.rad2deg(angles),
            np.rad2deg(error / (1 + growth**2 / 4)),
            float(behind[best]),
            math.hypot(of_sizes, of_places),
        )
