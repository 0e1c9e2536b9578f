"""Microlens images behind a real lens: the outline that each microlens's image of the FAP really has.

A microlens at c sees the flexible angular plane (FAP) through the lens; its image is the set of sensor points whose
backward ray passes the FAP, every surface and every further stop. The map from sensor point to FAP point is smooth, so
the FAP's rim is carried back to the sensor by Newton's method, and what the lens cuts off is found along spokes.
Only a strongly aberrated lens folds the map; such images are found out on a grid and integrated on a finer one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._points import sunflower
from .camera import LensCamera, Views, chief_slope, views
from .trace import KEPT

Array = NDArray[np.float64]

NEWTON_STEPS = 25
HALVINGS = 44
CHUNK = 64
FOLD_GRID, QUADRATURE_GRID, PUPIL_SAMPLES = 33, 257, 400
DARK, CLIPPED, FULL, FOLDED = 0, 1, 2, 3
"""Status of an image: no light, cut, whole, or folded.

A folded image is one where the lens is so aberrated that two sensor points behind a microlens see the same FAP point: a
caustic of the pupil lies in it, and it is no longer a distorted disc.
"""


class Found(NamedTuple):
    """Sensor points that see given points of the FAP's plane."""

    sensor: Array
    """[mm], (..., 2)."""
    views: Views
    """Their backward rays, apertures not counted."""
    ok: NDArray[np.bool_]
    """Whether the point was found, (...); elsewhere the nearest approach."""


def sensor_of_pupil(
    camera: LensCamera,
    microlens: ArrayLike,
    pupil: ArrayLike,
    wavelength: float | None = None,
    *,
    start: ArrayLike | None = None,
) -> Found:
    """Sensor points behind microlenses that see given points of the FAP's plane; inverse of `views`.

    Parameters
    ----------
    camera : LensCamera
        The camera.
    microlens, pupil : array_like
        Microlens axes c and points a on the FAP's plane [mm], (..., 2), broadcast.
    wavelength : float, optional
        [mm]; the camera's own by default.
    start : array_like, optional
        First guess; first order by default.

    Returns
    -------
    Found
        To 1e-12 of the FAP's diameter, apertures left aside (`views.room` tells of them).
    """
    c, a = np.broadcast_arrays(np.asarray(microlens, float), np.asarray(pupil, float))
    p = c + camera.d_2 * chief_slope(camera, c, a) if start is None else np.array(np.broadcast_to(start, c.shape))
    origin = c + camera.d_2 * chief_slope(camera, c, np.zeros(2))
    nudge = 1e-3 * camera.d_2 * float(np.abs(chief_slope(camera, np.zeros(2), [camera.fap.diameter / 2, 0.0])[0]))
    tolerance = 1e-12 * camera.fap.diameter
    steps = np.array([[0.0, 0.0], [nudge, 0.0], [0.0, nudge]])
    best, miss = p.copy(), np.full(c.shape[:-1], np.inf)
    for _ in range(NEWTON_STEPS):
        at = views(camera, c[..., None, :], p[..., None, :] + steps, wavelength, clip=False)
        met = np.all(at.state == KEPT, axis=-1)
        error = at.pupil[..., 0, :] - a
        size = np.where(met, np.hypot(error[..., 0], error[..., 1]), np.inf)
        better = size < miss
        best, miss = np.where(better[..., None], p, best), np.where(better, size, miss)
        if np.all(miss <= tolerance):
            break
        jacobian = np.swapaxes(at.pupil[..., 1:, :] - at.pupil[..., :1, :], -1, -2) / nudge
        full = _solved(jacobian, error)
        # Where a ray misses the lens, or things get worse, come back half way to the best so far, at first to the axis.
        back = np.where(np.isfinite(miss)[..., None], best, origin)
        p = np.where((met & better)[..., None], p - full, (p + back) / 2)
    final = views(camera, c, best, wavelength, clip=False)
    return Found(best, final, np.asarray(miss <= 1e3 * tolerance))


def _solved(jacobian: Array, error: Array) -> Array:
    (a, b), (c, d) = np.moveaxis(jacobian, (-2, -1), (0, 1))
    size = a * d - b * c
    safe = np.where(size == 0, 1.0, size)
    x, y = error[..., 0], error[..., 1]
    step = np.stack([d * x - b * y, a * y - c * x], axis=-1) / safe[..., None]
    return np.asarray(np.where((size != 0)[..., None], step, 0.0))


class MicrolensImages(NamedTuple):
    """Microlens images as the lens makes them; leading axes of the microlenses, points relative to their own axis."""

    chief: Array
    """Image of the FAP's centre [mm], (..., 2)."""
    outline: Array
    """Image of the FAP's rim, as if nothing else cut it [mm], (..., K, 2), counterclockwise on the FAP; where a rim
    point is out of the lens's sight, its nearest approach."""
    boundary: Array
    """Boundary of what light reaches [mm], (..., K, 2); where dark, K times the chief point; where folded, only of the
    part about its roomiest point."""
    whole_area: Array
    """Area inside `outline` [mm^2], (...); to first order where part of the rim is out of the lens's sight."""
    area: Array
    """Lit area [mm^2], (...)."""
    centroid: Array
    """Of the lit area [mm], (..., 2); the chief point where dark."""
    second_moments: Array
    """Central, per unit area, (xx, xy, yy) [mm^2], (..., 3); 0 where dark."""
    kept_fraction: Array
    """Part of the FAP, by its own area, from which light comes, (...)."""
    status: NDArray[np.int8]
    """FULL, CLIPPED, DARK or FOLDED, (...)."""

    @property
    def diameter(self) -> Array:
        """Diameter of the disc with the FAP image's area [mm], (...)."""
        return np.asarray(2 * np.sqrt(self.whole_area / np.pi))

    @property
    def axis_ratio(self) -> Array:
        """Minor over major axis of the ellipse with the lit part's second moments, (...); 0 where dark."""
        xx, xy, yy = np.moveaxis(self.second_moments, -1, 0)
        middle, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
        low, high = np.maximum(middle - spread, 0.0), middle + spread
        return np.asarray(np.sqrt(np.divide(low, high, out=np.zeros_like(low), where=high > 0)))


def real_images(
    camera: LensCamera, microlens: ArrayLike, wavelength: float | None = None, *, points: int = 96
) -> MicrolensImages:
    """Outlines, areas and moments of microlens images through the real lens.

    Parameters
    ----------
    camera : LensCamera
        The camera.
    microlens : array_like
        Microlens axes on the array [mm], (..., 2).
    wavelength : float, optional
        [mm]; the camera's own by default.
    points : int
        K, points on each boundary.

    Returns
    -------
    MicrolensImages
        Whole images converge exponentially in K (at 96, to rounding); a cut image has corners, and its area is right
        to about 20/K^2 of itself. A folded image's area is right to about 1e-3.
    """
    c = np.asarray(microlens, float)
    flat = c.reshape(-1, 2)
    chunks = [flat[start : start + CHUNK] for start in range(0, max(1, len(flat)), CHUNK)]
    parts = [_images(camera, chunk, wavelength, points) for chunk in chunks]
    whole = (np.concatenate(column).reshape(c.shape[:-1] + column[0].shape[1:]) for column in zip(*parts, strict=True))
    return MicrolensImages(*whole)


def _images(camera: LensCamera, c: Array, wavelength: float | None, points: int) -> MicrolensImages:
    fap = camera.fap
    angles = 2 * np.pi * np.arange(points) / points
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    centre = np.array([fap.x, fap.y])
    middle = sensor_of_pupil(camera, c, centre, wavelength)
    rim = sensor_of_pupil(camera, c[:, None, :], centre + fap.diameter / 2 * circle, wavelength)
    outline, chief = rim.sensor - c[:, None, :], middle.sensor - c
    whole, centroid, moments = polygon_moments(outline)
    seen = middle.ok & np.all(rim.ok, axis=-1)
    whole = np.where(seen, whole, camera.thin_images(np.zeros(2)).area)
    cut = ~(seen & np.all(rim.views.room >= 0, axis=-1))
    folded = _folded(camera, c, wavelength)
    status = np.where(cut, CLIPPED, FULL).astype(np.int8)
    boundary, area, kept = outline.copy(), whole.copy(), np.ones(len(c))
    odd = cut | folded
    if np.any(odd):
        lit, edge = _cut_boundary(camera, c[odd], middle.sensor[odd], rim.sensor[odd], wavelength)
        seen_pupil = views(camera, c[odd][:, None], edge, wavelength, clip=False).pupil
        share = polygon_moments(seen_pupil)[0] / (np.pi / 4 * fap.diameter**2)
        kept[odd] = np.where(lit, np.minimum(share, 1.0), 0.0)
        edge = np.where(lit[:, None, None], edge - c[odd][:, None], chief[odd][:, None])
        boundary[odd] = edge
        area[odd], centroid[odd], moments[odd] = polygon_moments(edge)
        status[odd] = np.where(lit, CLIPPED, DARK)
    for index in np.flatnonzero(folded):
        area[index], centroid[index], moments[index], kept[index] = _quadrature(camera, c[index], wavelength)
        status[index] = FOLDED
    return MicrolensImages(chief, outline, boundary, whole, area, centroid, moments, kept, status)


def _grid(camera: LensCamera, c: Array, count: int) -> tuple[Array, float]:
    """Sensor points behind microlenses (n, 2) that cover all that the lens's aperture can light, and their step."""
    side = np.linspace(-1, 1, count)
    scale = camera.d_2 / camera.d_1
    half = 0.6 * camera.lens_diameter * scale
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1) * half
    return (c * (1 + scale))[:, None, None, :] + grid, 2 * half / (count - 1)


def _folded(camera: LensCamera, c: Array, wavelength: float | None) -> NDArray[np.bool_]:
    p, _ = _grid(camera, c, FOLD_GRID)
    at = views(camera, c[:, None, None, :], p, wavelength, clip=False)
    (xx, xy), (yx, yy) = (np.gradient(at.pupil[..., part], axis=(1, 2)) for part in range(2))
    lit = np.minimum(at.fap_room, at.room) >= 0
    return np.asarray(np.any(lit & (xx * yy - xy * yx < 0), axis=(1, 2)))


def _quadrature(camera: LensCamera, c: Array, wavelength: float | None) -> tuple[Array, Array, Array, float]:
    """Area, centroid and central moments of everything lit behind one microlens, whatever its shape; FAP seen."""
    p, step = _grid(camera, c[None], QUADRATURE_GRID)
    at = views(camera, c, p[0], wavelength, clip=False)
    room = np.minimum(at.fap_room, at.room)
    across, along = np.gradient(room)
    lit = np.pad(room >= 0, 1)
    beside = lit[1:-1, 1:-1] | lit[2:, 1:-1] | lit[:-2, 1:-1] | lit[1:-1, 2:] | lit[1:-1, :-2]
    weight = beside * np.clip(room / (np.abs(across) + np.abs(along) + 1e-300) + 0.5, 0.0, 1.0)
    total = np.sum(weight)
    d = p[0] - c
    mean = np.sum(weight[..., None] * d, axis=(0, 1)) / total
    x, y = np.moveaxis(d - mean, -1, 0)
    moments = np.array([np.sum(weight * x * x), np.sum(weight * x * y), np.sum(weight * y * y)]) / total
    return total * step * step, mean, moments, _seen_share(camera, c, p[0][room >= 0], at.pupil[room >= 0], wavelength)


def _seen_share(camera: LensCamera, c: Array, sensor: Array, pupil: Array, wavelength: float | None) -> float:
    """Share of the FAP that a microlens sees at all, from lit sensor points and the FAP points they see."""
    fap = camera.fap
    wanted = np.array([fap.x, fap.y]) + fap.diameter / 2 * sunflower(PUPIL_SAMPLES).T
    nearest = np.argmin(np.sum(np.square(wanted[:, None] - pupil), axis=-1), axis=1)
    found = sensor_of_pupil(camera, c, wanted, wavelength, start=sensor[nearest])
    return float(np.mean(found.ok & (found.views.room >= 0)))


def _cut_boundary(
    camera: LensCamera, c: Array, middle: Array, rim: Array, wavelength: float | None
) -> tuple[NDArray[np.bool_], Array]:
    """Boundary of the lit part, n fields at once, along spokes from its roomiest point; and whether there is any."""

    def room(p: Array) -> Array:
        at = views(camera, c[:, None], p, wavelength, clip=False)
        return np.minimum(at.fap_room, at.room)

    n, points = rim.shape[:2]
    shares = (np.arange(12) + 0.5) / 12
    spread = (rim - middle[:, None])[:, :: max(1, points // 32)]
    trial = (middle[:, None, None] + shares[:, None, None] * spread[:, None]).reshape(n, -1, 2)
    trial = np.concatenate([middle[:, None], trial], axis=1)
    hub = trial[np.arange(n), np.argmax(room(trial), axis=1)]
    size = np.max(np.linalg.norm(spread, axis=-1), axis=1)
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 5)] * 2), axis=-1).reshape(-1, 2)
    reach = size / 8
    for _ in range(12):
        around = hub[:, None] + reach[:, None, None] * grid
        hub = around[np.arange(n), np.argmax(room(around), axis=1)]
        reach = reach / 2
    lit = room(hub[:, None])[:, 0] > 0
    angles = 2 * np.pi * np.arange(points) / points
    spoke = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    low, high = np.zeros((n, points)), np.broadcast_to(2.5 * size[:, None], (n, points))
    for _ in range(HALVINGS):
        half = (low + high) / 2
        inside = room(hub[:, None] + half[..., None] * spoke) >= 0
        low, high = np.where(inside, half, low), np.where(inside, high, half)
    return lit, hub[:, None] + low[..., None] * spoke


def polygon_moments(outline: ArrayLike) -> tuple[Array, Array, Array]:
    """Area, centroid and central second moments (xx, xy, yy) per unit area inside closed curves through points.

    Parameters
    ----------
    outline : array_like
        Points evenly spaced in some smooth parameter, (..., K, 2) [mm], either way round.

    Notes
    -----
    Green's theorem with the curve's derivative from its Fourier series: for a smooth curve the error falls
    exponentially with K, for one with corners like 1/K^2.
    """
    curve = np.asarray(outline, float)
    start = np.mean(curve, axis=-2, keepdims=True)
    x, y = np.moveaxis(curve - start, -1, 0)
    k = x.shape[-1]
    waves = 1j * np.fft.fftfreq(k, 1 / k) * (np.arange(k) * 2 != k)
    dx, dy = (np.fft.ifft(waves * np.fft.fft(part, axis=-1), axis=-1).real * 2 * np.pi / k for part in (x, y))
    area = np.sum(x * dy - y * dx, axis=-1) / 2
    turn = np.where(area < 0, -1.0, 1.0)
    safe = np.where(area == 0, 1.0, area)
    mx, my = np.sum(x * x * dy, axis=-1) / 2 / safe, -np.sum(y * y * dx, axis=-1) / 2 / safe
    xx, yy = np.sum(x**3 * dy, axis=-1) / 3 / safe, -np.sum(y**3 * dx, axis=-1) / 3 / safe
    xy = np.sum(x * x * y * dy, axis=-1) / 2 / safe
    moments = np.stack([xx - mx * mx, xy - mx * my, yy - my * my], axis=-1)
    return np.asarray(area * turn), start[..., 0, :] + np.stack([mx, my], axis=-1), moments
