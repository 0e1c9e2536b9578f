"""A polynomial twin of a centred lens: the smooth map from an image-side ray to its object-side ray, error stated.

A ray meets the array at x with slope s. To first order it comes from ``a_1 = slope x - reach s`` on the plane of the
flexible angular plane (FAP); the microlens's own chief ray has ``a_1 = K x``. With ``y = a_1 - K x`` the true map of a
lens of revolution is ``a = P x + Q y`` and ``o = R x + S y``, where P, Q, R, S and K are smooth functions of the
invariants |x|^2, x.y and |y|^2 alone. They are fitted as polynomials on exact rays; others, held out, give the error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._points import recurrence
from ..errors import Problem
from .camera import LensCamera, chief_slope
from .images import sensor_of_pupil
from .prescription import LensError
from .surrogate_kernel import TERMS, evaluate
from .trace import KEPT, Rays, trace

Array = NDArray[np.float64]

FIT_RAYS, HELD_OUT = 2000, 4000
MOST_ORDER = 12
CHIEF_TERMS = 8
MARGIN = 1.02
"""How much wider than the FAP and the field the map is fitted."""
INTERPRETED_BELOW = 300
TIGHT = 0.1
"""Surfaces that leave more room than this to every ray of the fit cannot clip, and are left out of `room`."""


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
        shape = np.broadcast_shapes(*(part.shape for part in inputs))
        together = bool(shape) and all(part.ndim == 0 or part.shape[-1] == 1 for part in inputs[:2])
        m = shape[-1] if together else 1
        places = [np.broadcast_to(part, (*shape[:-1], 1) if together else shape).reshape(-1) for part in inputs[:2]]
        slopes = [np.broadcast_to(part, shape).reshape(-1) for part in inputs[2:]]
        outs = [np.empty(slopes[0].size) for _ in range(5)]
        constants = (self._domain.slope, self._domain.reach)
        terms = self._coefficients.size // (self.order + 1)
        arrays: list[Any] = [*map(np.ascontiguousarray, (*places, *slopes)), self._domain.chief, self._coefficients]
        arrays += [np.empty(terms), *outs]
        compiled = slopes[0].size >= INTERPRETED_BELOW
        if not compiled:
            arrays = [memoryview(array) for array in arrays]
        run = evaluate.compiled if compiled else evaluate.interpreted
        scales = (self._domain.field, self._domain.pupil)
        from_x, from_y, along_x, along_y, chief, coefficients, work, *results = arrays
        size = (places[0].size, m, *constants)
        run(from_x, from_y, along_x, along_y, *size, chief, coefficients, self.order, *scales, work, *results)
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
    size = np.sqrt(1 + np.sum(np.square(s), axis=-1))
    rays = Rays(
        np.stack([place[:, 0], place[:, 1], np.full(count, camera.mla)]),
        np.stack([-s[:, 0], -s[:, 1], -np.ones(count)]) / size,
    )
    traced = trace(camera.lens, rays, colour, backward=True, plane=camera.fap.z, clip=False)
    good = traced.state == KEPT
    way = traced.rays.direction[:, good]
    rooms = _surface_rooms(camera, rays, colour)[good]
    return _Samples(x[good], y[good], traced.rays.position[:2, good].T, (way[:2] / way[2]).T, rooms)


def _surface_rooms(camera: LensCamera, rays: Rays, colour: float) -> Array:
    """Room that each surface leaves, (n, S): the ray up to a surface does not know what comes before it."""
    rooms = []
    lens = camera.lens
    for number, z in enumerate(lens.vertices):
        rear = replace(lens, surfaces=lens.surfaces[number:])
        moved = Rays(rays.position - np.array([[0.0], [0.0], [z]]), rays.direction)
        end = trace(rear, moved, colour, backward=True, clip=False).rays.position
        rooms.append(1 - (end[0] ** 2 + end[1] ** 2) / lens.surfaces[number].semi_diameter ** 2)
    return np.stack(rooms, axis=-1)


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
