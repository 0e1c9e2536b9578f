"""A polynomial twin of a centred lens: the smooth map from an image-side ray to its object-side ray, error stated.

A ray meets the array at x with slope s. To first order it comes from ``a_1 = slope x - reach s`` on the plane of the
flexible angular plane (FAP); the microlens's own chief ray has ``a_1 = K x``. With ``y = a_1 - K x`` the true map of a
lens of revolution is ``a = P x + Q y`` and ``o = R x + S y``, where P, Q, R, S and K are smooth functions of the
invariants u = |x|^2, v = x.y and w = |y|^2 alone. They are fitted as polynomials ``sum_t c_t(u) m_t`` on exact rays,
with the nine products m_t of v and w 1, v, w, v^2, v w, w^2, v^3, v^2 w, v^4; other rays, held out, give the error.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import recurrence
from .._jit import kernel
from ..errors import Problem
from ..lenses.prescription import LensError
from ..lenses.tracer import KEPT
from .camera import LensCamera, chief_slope, sensor_of_pupil

Array = NDArray[np.float64]

FIT_RAYS, HELD_OUT = 2000, 4000
MOST_ORDER, TERMS = 12, 9
CHIEF_TERMS = 8
MARGIN = 1.02
"""How much wider than the FAP and the field the map is fitted."""
TIGHT = 0.1
"""Surfaces that leave more room than this to every ray of the fit cannot clip, and are left out of `room`."""


@kernel()
def horner(coefficients: Any, begin: int, count: int, u: float) -> float:
    """Polynomial in `u` whose `count` coefficients, lowest power first, begin at `begin`."""
    total = 0.0
    for term in range(begin + count - 1, begin - 1, -1):
        total = total * u + coefficients[term]
    return total


@kernel()
def combine(a: Any, v: float, w: float) -> float:
    """Sum of the nine products with the weights `a`."""
    square = v * v
    low: float = a[0] + a[1] * v + a[2] * w + a[3] * square + a[4] * (v * w) + a[5] * (w * w)
    high: float = square * (a[6] * v + a[7] * w + a[8] * square)
    return low + high


@kernel()
def evaluate(
    x: Any, y: Any, sx: Any, sy: Any, m: int, slope: float, reach: float, chief: Any, coefficients: Any, order: int,
    field: float, pupil: float, work: Any, out_x: Any, out_y: Any, out_sx: Any, out_sy: Any, room: Any,
) -> None:  # fmt: skip
    """Object-side rays of `m` image-side ones from each point of the array.

    What depends on the microlens is computed once for each of them; the inner loops have no branches and no calls, so
    that the compiler takes several rays at once. `coefficients` holds P, Q, R, S and then rooms, nine times
    ``order + 1`` numbers each; `field` and `pupil` scale x and y; `work` has room for nine numbers a polynomial.
    """
    length = TERMS * (order + 1)
    polynomials = len(coefficients) // length
    p, q, r, s = work[0:9], work[9:18], work[18:27], work[27:36]
    for row in range(len(x)):
        hx, hy = x[row] / field, y[row] / field
        u = hx * hx + hy * hy
        for term in range(TERMS * polynomials):
            work[term] = horner(coefficients, term * (order + 1), order + 1, u)
        k = horner(chief, 0, len(chief), u)
        ax, ay = (slope - k) * x[row] / pupil, (slope - k) * y[row] / pupil
        scale = reach / pupil
        first, last = row * m, row * m + m
        bx, by = sx[first:last], sy[first:last]
        ox, oy, osx, osy = out_x[first:last], out_y[first:last], out_sx[first:last], out_sy[first:last]
        rooms = room[first:last]
        for i in range(m):
            px, py = ax - scale * bx[i], ay - scale * by[i]
            v, w = hx * px + hy * py, px * px + py * py
            sp, sq = combine(p, v, w), combine(q, v, w)
            sr, ss = combine(r, v, w), combine(s, v, w)
            ox[i] = sp * hx + sq * px
            oy[i] = sp * hy + sq * py
            osx[i] = sr * hx + ss * px
            osy[i] = sr * hy + ss * py
            rooms[i] = 1.0
        for number in range(4, polynomials):
            a = work[TERMS * number : TERMS * (number + 1)]
            for i in range(m):
                px, py = ax - scale * bx[i], ay - scale * by[i]
                rooms[i] = min(rooms[i], combine(a, hx * px + hy * py, px * px + py * py))


class SurrogateRays(NamedTuple):
    """Object-side rays; each array has the shape of the inputs."""

    x: Array
    y: Array
    """Where they cross the plane of the FAP [mm]."""
    slope_x: Array
    slope_y: Array
    """dx/dz and dy/dz."""
    room: Array
    """Least of 1 - r^2/semi-diameter^2 over the lens's surfaces: positive where no surface clips."""


@dataclass(frozen=True, eq=False)
class Surrogate:
    """A fitted lens at one wavelength; see `fitted`.

    Attributes
    ----------
    camera : LensCamera
        What was fitted.
    wavelength : float
        [mm].
    field_radius : float
        Largest |x| on the array it holds for [mm].
    order : int
        Highest power of |x|^2; in y the ray map is of the fifth degree.
    pupil_error, object_error : float
        Largest error over the held-out rays, on the plane of the FAP and on the focal plane [mm].
    room_error : float
        The same of `SurrogateRays.room`: how far from a clear aperture's rim a verdict may be wrong.
    """

    camera: LensCamera
    wavelength: float
    field_radius: float
    order: int
    pupil_error: float
    object_error: float
    room_error: float
    _domain: _Domain
    _coefficients: Array

    def rays(self, x: ArrayLike, y: ArrayLike, slope_x: ArrayLike, slope_y: ArrayLike) -> SurrogateRays:
        """Object-side rays of image-side ones.

        Parameters
        ----------
        x, y : array_like
            Where the rays cross the array [mm], within `field_radius` of the axis.
        slope_x, slope_y : array_like
            dx/dz and dy/dz there; for a pinhole microlens (p - c)/d_2. Broadcast; fastest where `x` and `y` have one
            value, of shape (..., 1), for many slopes (..., m): all rays of a microlens.

        Returns
        -------
        SurrogateRays
            Right to the stated errors for rays that fill the FAP; others are extrapolated.
        """
        inputs = [np.asarray(part, float) for part in (x, y, slope_x, slope_y)]
        shape, domain = np.broadcast_shapes(*(part.shape for part in inputs)), self._domain
        together = bool(shape) and all(part.ndim == 0 or part.shape[-1] == 1 for part in inputs[:2])
        shapes = [(*shape[:-1], 1) if together else shape] * 2 + [shape] * 2
        flat: list[Any] = [np.broadcast_to(part, size).ravel() for part, size in zip(inputs, shapes, strict=True)]
        outs: list[Any] = [np.empty(flat[2].size) for _ in range(5)]
        room = np.empty(self._coefficients.size // (self.order + 1))
        arguments = [*flat, shape[-1] if together else 1, domain.slope, domain.reach, domain.chief, self._coefficients]
        run: Any = evaluate.compiled
        run(*arguments, self.order, domain.field, domain.pupil, room, *outs)
        return SurrogateRays(*(out.reshape(shape) for out in outs))


def fitted(
    camera: LensCamera,
    field_radius: float,
    *,
    tolerance: float = 1e-4,
    wavelength: float | None = None,
    order: int | None = None,
) -> Surrogate:
    """Fit a surrogate to a camera.

    Parameters
    ----------
    camera : LensCamera
        Of a centred lens (no decentre, no tilt).
    field_radius : float
        Largest distance of a microlens from the axis [mm].
    tolerance : float
        Largest error wanted on the focal plane [mm].
    wavelength : float, optional
        [mm]; the camera's own by default.
    order : int, optional
        This one, whatever its error, instead of the lowest that meets the tolerance.

    Returns
    -------
    Surrogate
        Of the lowest order that meets the tolerance, or of the one asked for.

    Raises
    ------
    LensError
        The lens is not centred, part of the FAP is out of its sight in that field, or no order meets the tolerance.
    """
    if not camera.lens.is_centred:
        raise LensError((Problem("main_lens", "is decentred or tilted: a surrogate needs symmetry; trace it"),))
    if not camera.is_upright:
        raise LensError((Problem("camera", "has tilted parts around the lens: a surrogate needs symmetry; trace it"),))
    colour = camera.wavelength if wavelength is None else wavelength
    domain = _domain(camera, field_radius, colour)
    train = _samples(camera, domain, colour, FIT_RAYS, held_out=False)
    held = _samples(camera, domain, colour, HELD_OUT, held_out=True)
    tight = np.flatnonzero(np.min(train.rooms, axis=0) < TIGHT)
    best, fits = np.inf, _Fits(train, tight)
    for power in range(1, MOST_ORDER + 1) if order is None else (order,):
        coefficients = fits.of(power)
        pupil, focal, room = _errors(held, coefficients, power, tight, camera.fap.z - camera.focal_plane)
        best = min(best, focal)
        if focal <= tolerance or order is not None:
            flat = coefficients.reshape(-1)
            return Surrogate(camera, colour, field_radius, power, pupil, focal, room, domain, flat)
    message = f"no order up to {MOST_ORDER} is right to {tolerance:g} mm (best {best:.2g} mm); allow more, or trace it"
    raise LensError((Problem("tolerance", message),))


class _Domain(NamedTuple):
    """Where the map is fitted."""

    slope: float
    reach: float
    """Of ``a_1 = slope x - reach s``."""
    chief: Array
    """K as a polynomial in (|x|/field)^2."""
    field: float
    pupil: float
    """Largest |x| and |y| [mm]."""


class _Samples(NamedTuple):
    """Exact rays, x and y in units of the domain's scales."""

    x: Array
    y: Array
    pupil: Array
    slope: Array
    rooms: Array
    """By surface, (n, S)."""


def _domain(camera: LensCamera, field_radius: float, colour: float) -> _Domain:
    reach = -1 / float(chief_slope(camera, [0.0, 0.0], [1.0, 0.0])[0])
    slope = float(chief_slope(camera, [1.0, 0.0], [0.0, 0.0])[0]) * reach
    field = MARGIN * field_radius
    radii = field * np.sqrt((np.arange(1, 26)) / 25)
    turns = np.pi * np.arange(33) / 32
    edge = MARGIN * (camera.fap.diameter / 2 + np.hypot(camera.fap.x, camera.fap.y))
    pupil = np.concatenate([np.zeros((1, 2)), edge * np.stack([np.cos(turns), np.sin(turns)], axis=-1)])
    c = np.stack([radii, np.zeros(25)], axis=-1)
    found = sensor_of_pupil(camera, c[:, None, :], pupil, colour)
    if not np.all(found.ok):
        worst = radii[int(np.argmin(np.all(found.ok, axis=1)))] / MARGIN
        message = f"from {worst:.3g} mm off axis on, part of the flexible angular plane is out of sight"
        raise LensError((Problem("field_radius", f"{message}; take a smaller field, or trace the lens"),))
    first = slope * c[:, None, :] - reach * (found.sensor - c[:, None, :]) / camera.d_2
    u = (radii / field) ** 2
    chief = np.linalg.lstsq(u[:, None] ** np.arange(CHIEF_TERMS), first[:, 0, 0] / radii, rcond=None)[0]
    off = first - np.polynomial.polynomial.polyval(u, chief)[:, None, None] * c[:, None, :]
    return _Domain(
        slope, reach, np.asarray(chief, np.float64), field, float(np.max(np.hypot(off[..., 0], off[..., 1])))
    )


def _samples(camera: LensCamera, domain: _Domain, colour: float, count: int, *, held_out: bool) -> _Samples:
    """Exact rays over the domain, x along the first axis (the lens is round); held-out ones also on its very rims."""
    spread = recurrence(count, 3, 0.25 if held_out else 0.5)
    if held_out:
        radius, share = np.sqrt(spread[0]) / MARGIN, np.sqrt(spread[1]) / MARGIN
        radius[: count // 4], share[count // 8 : count // 2] = 1 / MARGIN, 1 / MARGIN
    else:
        radius, share = np.sin(np.pi / 2 * spread[0]), np.sin(np.pi / 2 * spread[1])  # denser outside, as Chebyshev's
    angle = np.pi * spread[2]
    x = np.stack([radius, np.zeros(count)], axis=-1)
    y = np.stack([share * np.cos(angle), share * np.sin(angle)], axis=-1)
    k = np.polynomial.polynomial.polyval(radius**2, domain.chief)
    place = domain.field * x
    s = ((domain.slope - k)[:, None] * place - domain.pupil * y) / domain.reach
    there = camera.lens.through(place.T, s.T, colour, start=camera.mla, end=camera.fap.z)
    good = there.state == KEPT
    return _Samples(x[good], y[good], there.height[:, good].T, there.slope[:, good].T, 1 - there.heights[:, good].T)


def _terms(samples: _Samples, order: int) -> Array:
    """Every product of a power of u and one of the kernel's nine in v and w, (n, 9 (order + 1))."""
    u, v, w = (np.sum(a * b, axis=-1) for a, b in combinations_with_replacement((samples.x, samples.y), 2))
    one = np.ones_like(u)
    products = (one, v, w, v * v, v * w, w * w, v**3, v * v * w, v**4)
    return np.stack([m * u**i for m in products for i in range(order + 1)], axis=-1)


class _Fits:
    """Least-squares fits of every order from one factorisation: what a lower order takes are its first columns.

    Parameters
    ----------
    samples : _Samples
        To be fitted.
    tight : ndarray of int
        Surfaces whose rooms are fitted too.
    """

    def __init__(self, samples: _Samples, tight: NDArray[np.intp]) -> None:
        terms = _terms(samples, MOST_ORDER).reshape(-1, TERMS, MOST_ORDER + 1)
        by_power = np.swapaxes(terms, 1, 2)  # lower powers of u first
        ways = [
            np.stack([by_power * part[:, axis, None, None] for part in (samples.x, samples.y)], axis=2)
            for axis in (0, 1)
        ]
        wanted = np.stack([part.T.reshape(-1) for part in (samples.pupil, samples.slope)], axis=-1)
        self.map = _factored(np.concatenate(ways).reshape(len(wanted), -1), wanted)
        self.rooms = _factored(by_power.reshape(len(by_power), -1), samples.rooms[:, tight])

    def of(self, order: int) -> Array:
        """Coefficients by polynomial: P, Q, R, S, then rooms of the tight surfaces, (4 + tight, terms)."""
        count = order + 1
        both = _solved(self.map, 2 * TERMS * count).reshape(count, 2, TERMS, 2)
        rays = np.moveaxis(both, (3, 1, 2), (0, 1, 2)).reshape(4, -1)  # P and Q of the pupil, R and S of slopes
        rooms = np.moveaxis(_solved(self.rooms, TERMS * count).reshape(count, TERMS, -1), 2, 0)
        return np.concatenate([rays, np.swapaxes(rooms, 1, 2).reshape(len(rooms), TERMS * count)])


def _factored(matrix: Array, wanted: Array) -> tuple[Array, Array]:
    q, r = np.linalg.qr(matrix)  # a tenth of the time that lstsq's singular values take
    return r, q.T @ wanted


def _solved(factored: tuple[Array, Array], columns: int) -> Array:
    r, right = factored
    return np.asarray(np.linalg.solve(r[:columns, :columns], right[:columns]))


def _errors(
    samples: _Samples, coefficients: Array, order: int, tight: NDArray[np.intp], depth: float
) -> tuple[float, float, float]:
    """Largest errors on the FAP, on the focal plane `depth` in front of it, and of the room."""
    p, q, r, s, *rooms = (_terms(samples, order) @ coefficients.T).T
    pupil = p[:, None] * samples.x + q[:, None] * samples.y - samples.pupil
    slope = r[:, None] * samples.x + s[:, None] * samples.y - samples.slope
    focal = pupil - depth * slope
    room = max((float(np.max(np.abs(rooms[i] - samples.rooms[:, k]))) for i, k in enumerate(tight)), default=0.0)
    return float(np.max(np.hypot(*pupil.T))), float(np.max(np.hypot(*focal.T))), room
