"""What every method is judged against: the same quantities at 22 to 50 digits, by other ways and other code.

Discs and pixels by slices and mpmath's tanh-sinh rule; depths from traced rays; real lenses by conics and Snell's law
in vectors. Diffraction images by Huygens's integral itself in double precision: the field over the aperture, squared,
added over pupil points. Cut ones are right to about 1e-12 (tests compare them with many digits). Where neighbours are
alike, their light is added one by one, which is right to `ALIKE_PRECISION`; a Fourier series with 50-digit Bessel
functions adds digits where it says the same, and nowhere else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import Any

import mpmath as mp
import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from roslf_design.traced.camera import camera_of

from .jobs import CUT, LENS, SIGMA_DISPARITY, WAVES, Job, microlens_rays
from .oracles import discs as common_part
from .oracles.closed_forms import ORACLES

Floats = NDArray[np.float64]

SHAPE_DIGITS, PIXEL_DIGITS, WAVE_DIGITS, LENS_DIGITS = 32, 22, 50, 30
EVERY = 16
"""Of so many rays through a real lens one is traced with many digits."""
NODES = 40
"""Of each panel of a cut pupil's rows, and four more for each blur width in the pupil's radius."""


NEIGHBOURS = 12
"""Microlenses beyond the image whose light is added as it is; that of farther ones fades into what edges send."""
FARTHEST = 4000
"""On each side whose mean light is still added one by one."""
ALIKE_PRECISION = 1e-6
"""Of what is so added; 1 is a fully lit pixel."""


@lru_cache(maxsize=512)
def reference(job: Job) -> Floats:
    """The exact result, rounded to double precision; remembered for the last jobs asked for."""
    if job.quantity == WAVES:
        return _alike(job)
    if job.quantity == CUT:
        return huygens_image(job)
    if job.quantity == LENS:
        return _ray_ends(job)
    if job.quantity == "depth":
        return _depth(job)
    return _pixels(job) if job.quantity in ("pixel image", "textured image") else _shape(job)


def _shape(job: Job) -> Floats:
    with mp.workdps(SHAPE_DIGITS):
        orders = [(0, 0), (1, 0), (0, 1)] if job.quantity == "centroid" else [(0, 0)]
        area, *first = common_part.integrals(
            *job.discs, [common_part.power(*order) for order in orders], digits=SHAPE_DIGITS
        )
        if job.quantity == "area":
            return np.array([float(area)])
        if job.quantity == "kept fraction":
            return np.array([float(area / (mp.pi * mp.mpf(job.radius) ** 2))])
        return np.array([float(moment / area) for moment in first]) if area else job.discs[0][0].copy()


def _pixels(job: Job) -> Floats:
    low, high = job.cells
    at, radii = job.discs
    white = job.quantity == "pixel image"
    corners = [np.stack([x[:, 0], y[:, 1]], -1) for x in (low, high) for y in (low, high)]
    whole = np.all([(np.hypot(*(c[:, None] - at).transpose(2, 0, 1)) < radii).all(1) for c in corners], axis=0)
    nearest = np.clip(at[None], low[:, None], high[:, None]) - at
    outside = (np.hypot(nearest[..., 0], nearest[..., 1]) > radii).any(1)
    light = np.where(whole, 1.0, 0.0)
    with mp.workdps(PIXEL_DIGITS):
        kx, ky, phase = (mp.mpf(v) for v in job.wave)

        def sinusoid(x: Any, bottom: Any, top: Any) -> Any:
            """Integral over y of (1 + cos(2 pi (kx x + ky y + phase)))/2."""
            turn, rate = 2 * mp.pi * (kx * x + phase), 2 * mp.pi * ky
            if ky == 0:
                return (top - bottom) * (1 + mp.cos(turn)) / 2
            return (top - bottom) / 2 + (mp.sin(turn + rate * top) - mp.sin(turn + rate * bottom)) / (2 * rate)

        for n in np.flatnonzero(~outside & ~(whole & white)):
            (left, bottom), (right, top) = common_part.exact(low[n]), common_part.exact(high[n])
            if whole[n]:
                # A pixel that no disc cuts: product of two sincs.
                middle = 2 * mp.pi * (kx * (left + right) / 2 + ky * (bottom + top) / 2 + phase)
                light[n] = float((1 + mp.cos(middle) * mp.sincpi(kx) * mp.sincpi(ky)) / 2)
                continue
            box = [[left, bottom], [right, bottom], [right, top], [left, top]]
            slice_ = common_part.power(0, 0) if white else sinusoid
            light[n] = float(common_part.integrals(at, radii, [slice_], box, digits=PIXEL_DIGITS)[0])
    return light


def _depth(job: Job) -> Floats:
    c = job.design
    sigma = ORACLES["depth_sigma"](
        depth=1.0, disparity_sigma=SIGMA_DISPARITY, pupil_diameter=c.D_F, microlens_pitch=c.d, focal_length=c.f,
        focal_plane_distance=c.d_f, pupil_distance=c.d_3,
    )  # fmt: skip
    with mp.workdps(WAVE_DIGITS):
        inverse = 1 / mp.mpf(job.depth)
        return np.array([float((1 / (inverse - sigma) - 1 / (inverse + sigma)) / 2)])


def _alike(job: Job) -> Floats:
    """Microlens images all alike: by Huygens's integral, with the series' digits where the two agree."""
    light, series = huygens_image(job), alike_series(job)
    return np.where(np.abs(light - series) <= ALIKE_PRECISION, series, light)


def alike_series(job: Job) -> Floats:
    """Fourier series of microlens images all alike, of 50 digits."""
    c = job.design
    lens = {"focal_length": c.f, "focal_plane_distance": c.d_f, "pupil_distance": c.d_3}
    image_pitch = ORACLES["image_pitch_mm"](microlens_pitch=c.d, sensor_distance=c.d_2, **lens)
    vergence = ORACLES["vergence_at_mla_per_mm"](**lens)
    with mp.workdps(WAVE_DIGITS):
        d, d_2, q = mp.mpf(c.d), mp.mpf(c.d_2), mp.mpf(c.q)
        width, pitch = mp.mpf(c.wavelength) * d_2 / d / q, abs(image_pitch) / q
        turns = (1 / mp.mpf(c.f_ml) - 1 / d_2 - vergence) * d_2 * d / q
        radius = mp.mpf(job.radius)
        count = int(mp.floor(pitch / width)) + 1

        def passed(order: int) -> Any:
            frequency = order / pitch
            overlap = max(1 - width * frequency, mp.mpf(0))
            return overlap * mp.sincpi(turns * frequency * overlap) * mp.sincpi(frequency)

        axis = [passed(k) * (2 if k else 1) for k in range(count)]
        bessel = {}
        for m in range(count):
            for n in range(m + 1):
                height = mp.sqrt(m * m + n * n) / pitch
                whole = mp.pi * radius**2
                bessel[m, n] = radius * mp.besselj(1, 2 * mp.pi * radius * height) / height if m else whole
        x, y = (
            [[mp.cos(2 * mp.pi * k * mp.mpf(float(v)) / pitch) for k in range(count)] for v in at - middle]
            for at, middle in zip(job.centres, job.discs[0][0], strict=True)
        )
        # Along x first: count x width sums, then the rows.
        inner = [
            [mp.fdot((axis[m] * bessel[max(m, n), min(m, n)], column[m]) for m in range(count)) for column in x]
            for n in range(count)
        ]
        image = [
            [mp.fdot((axis[n] * row[n], inner[n][i]) for n in range(count)) / pitch**2 for i in range(len(x))]
            for row in y
        ]
        return np.array([float(v) for line in image for v in line])


# --- rays through a real lens -----------------------------------------------------------------------------------------


def _ray_ends(job: Job) -> Floats:
    """Where rays cross the focal plane, by intersecting conics and Snell's law in vectors."""
    camera = camera_of(job.design)
    lens, wavelength = camera.lens, camera.wavelength
    place, slope = microlens_rays(job.design, job.axis)
    ends = []
    with mp.workdps(LENS_DIGITS):
        glasses = [mp.mpf(float(surface.glass.index(wavelength))) for surface in lens.surfaces]
        for (x, y), (sx, sy) in zip(place[:, ::EVERY].T.tolist(), slope[:, ::EVERY].T.tolist(), strict=True):
            p = [mp.mpf(x), mp.mpf(y), mp.mpf(camera.array.z)]
            d = _unit([-mp.mpf(sx), -mp.mpf(sy), mp.mpf(-1)])
            for n in range(len(lens.surfaces) - 1, -1, -1):
                surface = lens.surfaces[n]
                vertex, c, k = mp.mpf(lens.vertices[n]), mp.mpf(surface.curvature), mp.mpf(surface.conic)
                p, normal = _meet(p, d, vertex, c, k)
                d = _bend(d, normal, glasses[n] / (glasses[n - 1] if n else 1))
            step = (mp.mpf(camera.focal_plane) - p[2]) / d[2]
            ends += [float(p[0] + step * d[0]), float(p[1] + step * d[1])]
    return np.array(ends)


def _unit(v: list[Any]) -> list[Any]:
    size = mp.sqrt(sum(part * part for part in v))
    return [part / size for part in v]


def _meet(p: list[Any], d: list[Any], vertex: Any, c: Any, k: Any) -> tuple[list[Any], list[Any]]:
    """Point on a conic and its unit normal along +z: c (x^2 + y^2 + (1 + k) z^2) = 2 z."""
    x, y, z = p[0], p[1], p[2] - vertex
    a = c * (d[0] ** 2 + d[1] ** 2 + (1 + k) * d[2] ** 2)
    b = c * (x * d[0] + y * d[1] + (1 + k) * z * d[2]) - d[2]
    e = c * (x * x + y * y + (1 + k) * z * z) - 2 * z
    # The root near the vertex: e/(-b +- sqrt(b^2 - a e)), the sign that adds.
    root = mp.sqrt(b * b - a * e)
    step = e / (-b + root if b < 0 else -b - root)
    x, y, z = x + step * d[0], y + step * d[1], z + step * d[2]
    return [x, y, z + vertex], _unit([-c * x, -c * y, 1 - c * (1 + k) * z])


def _bend(d: list[Any], n: list[Any], ratio: Any) -> list[Any]:
    """Snell's law, `ratio` being index before over index after."""
    along = sum(a * b for a, b in zip(d, n, strict=True))
    if along < 0:
        n, along = [-part for part in n], -along
    after = mp.sqrt(1 - ratio**2 * (1 - along**2))
    return [ratio * a + (after - ratio * along) * b for a, b in zip(d, n, strict=True)]


# --- Huygens's integral of one microlens behind a cut pupil, or of neighbours all alike -------------------------------


def huygens_image(job: Job) -> Floats:
    """Field over the aperture, squared, for each pixel's own Gauss points; the pupil is cut into rows.

    No transfer function, no frequencies, no closed areas.
    """
    centres, radii = (part[:1] for part in job.discs) if job.quantity == WAVES else job.discs
    rows, weights, left, right = _rows(centres, radii, NODES + math.ceil(4 * job.radius / job.blur[0]))
    x, y = job.centres
    if not rows.size:
        return np.zeros(x.size * y.size)
    line_x, line_y = _Line(job, x, np.concatenate([left, right])), _Line(job, y, rows)
    across = line_x.integral(left) - line_x.integral(right)
    return np.asarray(((line_y(rows) * weights) @ across.T).ravel())


def _gauss(count: int) -> tuple[Floats, Floats]:
    """On [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1), 0.5 * weights


class _Line:
    """Light of pupil points along one axis, by an interpolant through directly integrated values."""

    def __init__(self, job: Job, at: Floats, places: Floats) -> None:
        self.at = at
        low, high = float(at.min() - places.max()) - 1e-6, float(at.max() - places.min()) + 1e-6
        light = _all_light if job.quantity == WAVES else _light
        self.line = _interpolant(lambda off: light(job, off), low, high, job.blur[0])

    def __call__(self, places: Floats) -> Floats:
        return np.asarray(self.line(self.at[:, None] - places))

    def integral(self, places: Floats) -> Floats:
        """From anywhere up to ``at - places``."""
        return np.asarray(self.line.integ()(self.at[:, None] - places))


def _interpolant(light: Callable[[Floats], Floats], low: float, high: float, width: float) -> Chebyshev:
    """Of light that holds no cycle shorter than `width`: pi degrees for each, and some for the last digits."""
    return Chebyshev.interpolate(light, math.ceil(math.pi * (high - low) / width) + 48, [low, high])


def _light(job: Job, off: Floats) -> Floats:
    """Of one pupil point along one axis: field over the aperture, squared, integrated over the pixel."""
    width, sag = job.blur[0], _sag(job)
    u, w = _gauss(math.ceil(3.2 / width) + 16)
    farthest = float(np.abs(off).max()) + 0.5
    nodes, weights = _gauss(math.ceil(1.7 * (farthest / width + abs(sag))) + 24)
    v = nodes - 0.5
    lens = weights * np.exp(-2j * math.pi * sag * v * v)
    places = off[:, None] + u - 0.5
    field = np.exp((-2j * math.pi / width) * places[..., None] * v) @ lens
    return np.asarray((field.real**2 + field.imag**2) @ w / width)


def _all_light(job: Job, off: Floats) -> Floats:
    """The same of a row of microlenses without end.

    Far out there are thousands of waves across the aperture: its phase is then a sum of Legendre polynomials, each of
    which has a spherical Bessel function for its integral. Light fades out over some microlenses, slowly against its
    ripples; what is so left out comes from the two edges of the aperture alone.
    """
    from scipy.special import erfc, spherical_jn

    width, pitch, _ = job.blur
    orders, shares = _legendre(_sag(job))

    count = NEIGHBOURS + 2 * math.ceil(float(np.abs(off).max()) / pitch)

    def kept(n: Any) -> Any:
        return 0.5 * erfc((np.abs(n) - 1.5 * count) / (count / 6))

    def near(x: Floats) -> Floats:
        light = np.zeros(x.shape)
        for n in range(-3 * count, 3 * count + 1):
            turns = math.pi / width * np.abs(x - n * pitch)
            field = sum(share * spherical_jn(order, turns) for order, share in zip(orders, shares, strict=True))
            light += kept(n) / width * (field.real**2 + field.imag**2)
        return light

    # Over each pixel.
    until = _interpolant(near, float(off.min()) - 0.5, float(off.max()) + 0.5, width).integ()
    n = np.arange(-FARTHEST, FARTHEST + 1)
    n = n[kept(n) < 1]
    t = off[:, None] - pitch * n
    # Defocus bends the wave at the two edges, towards them and away.
    sides = [t + side * width * _sag(job) for side in (-1, 1)]
    ripple = np.cos(2 * math.pi * t / width) * np.sinc(1 / width) / (sides[0] * sides[1])
    mean = 0.5 * sum(1 / (side * side - 0.25) for side in sides)
    edges = (mean - ripple) @ (1 - kept(n)) + 2 / (pitch * pitch * (FARTHEST + 0.5))
    return np.asarray(until(off + 0.5) - until(off - 0.5) + width / (2 * math.pi**2) * edges)


def _sag(job: Job) -> float:
    """Waves of defocus across the aperture, by the square of the distance from its middle over its width."""
    return 0.5 * job.blur[2] * job.design.d**2 / job.design.wavelength


def _legendre(sag: float) -> tuple[range, NDArray[np.complex128]]:
    """Even Legendre orders and their shares of the phase across the aperture, each times (-i)^order."""
    orders = range(0, 16 + math.ceil(2 * math.pi * abs(sag)), 2)
    x, w = np.polynomial.legendre.leggauss(2 * len(orders) + 24)
    phase = w * np.exp(-0.5j * math.pi * sag * x * x)
    legendre = np.polynomial.legendre.legvander(x, orders[-1])[:, ::2]
    return orders, (-1.0) ** np.arange(len(orders)) * (np.array(orders) + 0.5) * (phase @ legendre)


def _rows(centres: Floats, radii: Floats, nodes: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Heights of rows across the common part, their weights, and where each begins and ends."""
    y, x = centres[:, 1], centres[:, 0]
    low, high = float(np.max(y - radii)), float(np.min(y + radii))
    if high <= low:
        return (np.zeros(0),) * 4
    # Curves change where circles cross: the slices' own breaks, with x and y exchanged.
    crossed, _ = common_part.slices(centres[:, ::-1], radii)
    places = {low, high, *(float(v) for v in y), *(float(v) for v in crossed)}
    edges = np.array(sorted(v for v in places if low <= v <= high))
    u, w = _gauss(nodes)
    rows = []
    for bottom, top in pairwise(edges):
        half = 0.5 * (top - bottom)
        # u^2 (3 - 2 u) has slope 0 at both ends, as the square roots there ask for, twice over.
        row = bottom + 2 * half * u * u * (3 - 2 * u)
        drow = 2 * half * 6 * u * (1 - u) * w
        reach = np.sqrt(np.maximum((radii - (row[:, None] - y)) * (radii + (row[:, None] - y)), 0.0))
        left, right = (x - reach).max(1), (x + reach).min(1)
        rows.append([row, drow, left, np.maximum(left, right)])
    return tuple(np.concatenate(parts) for parts in zip(*rows, strict=True))  # type: ignore[return-value]
