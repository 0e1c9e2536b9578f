"""Real lens over the field: microlens images as they really are, and the aberrations that make them so.

A microlens at c sees the flexible angular plane (FAP) through the lens; its image is the set of sensor points whose
backward ray passes the FAP, every surface and every further stop. The map from sensor point to FAP point is smooth, so
the FAP's rim is carried back to the sensor, and what the lens cuts off is found along spokes (`outlines`).
Only a strongly aberrated lens folds the map; such images are found out on a grid and integrated on a finer one.

The chief ray, through the centre of the FAP, says which object point X on the focal plane the microlens looks at. From
X the pencil that fills the FAP is traced forward to the array: the FAP stands in front of the lens, so these rays need
no aiming.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import sunflower
from ..camera import Camera
from ..design import Design
from ..errors import InputError
from ..fates import ImageFate, RayFate, state_at
from ..theory.vignetting import undistorted_radii
from .camera import LensCamera, TracedPlane, camera_of, chief_slope, microlenses, sensor_of_pupil, views
from .outlines import Outlines, circle, highest, lit_images, rim_points
from .train import AimedRays

Array = NDArray[np.float64]

CHUNK = 64
FOLD_GRID, QUADRATURE_GRID, PUPIL_SAMPLES = 33, 257, 400
PENCIL = 1e-3
"""Size of the pencil about the chief ray that field curvature is measured with, as a part of the FAP."""
SPOT_RAYS = 200
RIM_POINTS = 32
VISIBLE = (486.1e-6, 656.3e-6)
"""F and C lines [mm]: lateral colour is told between them."""


class TracedImages(NamedTuple):
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
    """Area inside `outline` [mm^2], (...); nan where part of the rim is out of the lens's sight."""
    diameter: Array
    """Diameter of the disc as large; of straight sides the wider of the extents along x and y [mm], (...); nan
    likewise."""
    area: Array
    """Lit area [mm^2], (...)."""
    centroid: Array
    """Centroid of the lit area [mm], (..., 2); the chief point where dark."""
    second_moments: Array
    """Central, per unit area, (xx, xy, yy) [mm^2], (..., 3); 0 where dark."""
    kept_fraction: Array
    """Part of the FAP, by its own area, from which light comes, (...)."""
    status: NDArray[np.int8]
    """`ImageFate`, (...)."""

    @property
    def axis_ratio(self) -> Array:
        """Minor over major axis of the ellipse with the lit part's second moments, (...); 0 where dark."""
        xx, xy, yy = np.moveaxis(self.second_moments, -1, 0)
        middle, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
        low, high = np.maximum(middle - spread, 0.0), middle + spread
        return np.asarray(np.sqrt(np.divide(low, high, out=np.zeros_like(low), where=high > 0)))


def real_images(camera: LensCamera, microlens: ArrayLike, *, points: int = 96) -> TracedImages:
    """Outlines, areas and moments of microlens images through the real lens.

    Parameters
    ----------
    camera : LensCamera
        The camera.
    microlens : array_like
        Microlens axes on the array [mm], (..., 2).
    points : int
        K, points on each boundary, at most `BLOCK`.

    Notes
    -----
    Whole images converge exponentially in K (at 96, to rounding); cut ones are right to some 1e-8 of the whole, for
    they are integrated between corners. A folded image's area is right to about 1e-3.
    """
    c = np.asarray(microlens, float)
    flat = c.reshape(-1, 2)
    parts = [_images(camera, flat[start : start + CHUNK], points) for start in range(0, max(1, len(flat)), CHUNK)]
    whole = (np.concatenate(column).reshape(c.shape[:-1] + column[0].shape[1:]) for column in zip(*parts, strict=True))
    return TracedImages(*whole)


def _images(camera: LensCamera, c: Array, points: int) -> TracedImages:
    fap = camera.fap
    middle = sensor_of_pupil(camera, c, fap.centre)
    rays = sensor_of_pupil(camera, c[:, None, :], fap.points(rim_points(points, straight=fap.straight)))
    outline, chief, aside = rays.sensor - c[:, None, :], middle.sensor - c, c - camera.detector.centre
    ok, landed = (rays.ok & middle.ok[:, None])[..., None], rays.sensor - camera.detector.centre
    rim = AimedRays(*(np.where(ok, part, math.nan) for part in (landed, rays.heights)))
    uncut, folded = Outlines.of(rim, straight=fap.straight), _folded(camera, c)
    scale = camera.d_2 / camera.d_1
    elsewhere = aside + c * scale, np.full(len(c), 0.6 * camera.lens.clear_diameter * abs(scale))
    parts = camera.train(camera.wavelength), camera.planes, c - camera.array.centre, np.zeros(len(c), int)
    shape, kept, some, edge = lit_images(*parts, uncut, elsewhere, spokes=points, odd=folded)
    boundary, area, dark = outline.copy(), shape[:, 0], ~(kept > 0)
    centroid, moments = np.where(dark[:, None], chief, shape[:, 1:3] - aside), shape[:, 3:]
    boundary[some] = np.where(dark[some][:, None, None], chief[some][:, None], edge - aside[some][:, None])
    status = np.full(len(c), ImageFate.FULL, np.int8)
    status[some] = np.where(dark[some], ImageFate.DARK, ImageFate.CLIPPED)
    for index in np.flatnonzero(folded):
        area[index], centroid[index], moments[index], kept[index] = _quadrature(camera, c[index])
        status[index] = ImageFate.FOLDED
    whole = uncut.shape[:, 0], uncut.width
    return TracedImages(chief, outline, boundary, *whole, area, centroid, moments, kept, status)


def _grid(camera: LensCamera, c: Array, count: int) -> tuple[Array, float]:
    """Sensor points behind microlenses (n, 2) that cover all that the lens's aperture can light, and their step."""
    side = np.linspace(-1, 1, count)
    scale = camera.d_2 / camera.d_1
    half = 0.6 * camera.lens.clear_diameter * scale
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1) * half
    return (c * (1 + scale))[:, None, None, :] + grid, 2 * half / (count - 1)


def _folded(camera: LensCamera, c: Array) -> NDArray[np.bool_]:
    p, _ = _grid(camera, c, FOLD_GRID)
    at = views(camera, c[:, None, None, :], p, clip=False)
    (xx, xy), (yx, yy) = (np.gradient(at.pupil[..., part], axis=(1, 2)) for part in range(2))
    lit = np.minimum(at.fap_margin, at.margin) >= 0
    return np.asarray(np.any(lit & (xx * yy - xy * yx < 0), axis=(1, 2)))


def _quadrature(camera: LensCamera, c: Array) -> tuple[Array, Array, Array, float]:
    """Area, centroid and central moments of everything lit behind one microlens, whatever its shape; FAP's share."""
    p, step = _grid(camera, c[None], QUADRATURE_GRID)
    at = views(camera, c, p[0], clip=False)
    room = np.minimum(at.fap_margin, at.margin)
    across, along = np.gradient(room)
    lit = np.pad(room >= 0, 1)
    beside = lit[1:-1, 1:-1] | lit[2:, 1:-1] | lit[:-2, 1:-1] | lit[1:-1, 2:] | lit[1:-1, :-2]
    weight = beside * np.clip(room / (np.abs(across) + np.abs(along) + 1e-300) + 0.5, 0.0, 1.0)
    total = np.sum(weight)
    d = p[0] - c
    mean = np.sum(weight[..., None] * d, axis=(0, 1)) / total
    x, y = np.moveaxis(d - mean, -1, 0)
    moments = np.array([np.sum(weight * x * x), np.sum(weight * x * y), np.sum(weight * y * y)]) / total
    # The part of the FAP that is seen at all: from points all over it back to the sensor, from the nearest lit one.
    wanted = camera.fap.filled(sunflower(PUPIL_SAMPLES).T)
    seen = at.pupil[room >= 0]
    nearest = np.argmin(0.5 * np.sum(np.square(seen), axis=-1) - wanted @ seen.T, axis=1)
    back = sensor_of_pupil(camera, c, wanted, start=p[0][room >= 0][nearest])
    return total * step * step, mean, moments, float(np.mean(back.ok & (back.views.margin >= 0)))


class _FieldMap(NamedTuple):
    """Aberrations by microlens; leading axes of the microlenses, then of wavelengths where there are several."""

    object_point: Array
    """X on the focal plane that the chief ray comes from [mm], (..., 2)."""
    distortion: Array
    """``(|c| - |c_1|)/|c_1|``, c_1 where first order would image X; (...), 0 on the axis."""
    tangential_focus: Array
    sagittal_focus: Array
    """Distance behind the array at which pencils in and across the meridional plane focus [mm], (...); negative before
    it."""
    blur: Array
    """Root-mean-square radius of the light from X on the array, about its centroid [mm], (...)."""
    spread: Array
    """Largest extents of that light along and across the meridional plane [mm], (..., 2)."""
    lateral_colour: Array
    """Displacement on the array of the chief ray from X in each colour, against the camera's own [mm], (..., W, 2); 0
    where it does not come through."""
    status: NDArray[np.int16]
    """State of the chief ray (`LensCamera.describe`), (...); where it is not 0, the numbers above are 0."""


def field_map(camera: LensCamera, microlens: ArrayLike, colours: ArrayLike = ()) -> _FieldMap:
    """Distortion, field curvature, blur and lateral colour for microlenses.

    Parameters
    ----------
    camera : LensCamera
        The camera, focused at its own wavelength.
    microlens : array_like
        Axes on the array [mm], (..., 2).
    colours : array_like
        Further wavelengths for lateral colour [mm], (W,).
    """
    c = np.asarray(microlens, float)
    fap, waves = camera.fap, np.atleast_1d(np.asarray(colours, float))
    chief = sensor_of_pupil(camera, c, fap.centre)
    # A chief ray that Newton's method did not find has the state of its nearest approach, else it missed.
    unfound = np.where(chief.views.state == RayFate.KEPT, state_at(1, RayFate.MISSED), chief.views.state)
    state = np.where(chief.ok, chief.views.state, unfound).astype(np.int16)
    good = state == RayFate.KEPT
    point = chief.views.at(fap.z - camera.focal_plane)
    depth, aside = camera.focus
    ideal = np.hypot(*np.moveaxis((camera.straightened(point) - aside) * camera.d_1 / depth, -1, 0))
    real = np.hypot(*np.moveaxis(c, -1, 0))
    away = good & (ideal > 1e-9 * fap.diameter) & (real > 0)
    distortion = np.divide(real - ideal, ideal, where=away, out=np.zeros_like(ideal))
    along = np.where(real[..., None] > 0, c / np.where(real > 0, real, 1.0)[..., None], np.array([1.0, 0.0]))
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    tangential, sagittal = (np.where(good, _focus(camera, point, axis), 0.0) for axis in (along, across))
    blur, spread = _spot(camera, point, along, across)
    lateral = np.zeros((*c.shape[:-1], waves.size, 2))
    own, _, ours, aimed = forward_rays(camera, point, fap.centre, camera.wavelength)
    for index, wave in enumerate(waves):
        other, _, theirs, _ = forward_rays(camera, point, fap.centre, float(wave), start=aimed)
        lateral[..., index, :] = np.where((ours & theirs)[..., None], np.moveaxis(other - own, 0, -1), 0.0)
    spread = np.where(good[..., None], spread, 0.0)
    return _FieldMap(point, distortion, tangential, sagittal, np.where(good, blur, 0.0), spread, lateral, state)


def forward_rays(
    camera: LensCamera,
    point: Array,
    pupil: Array,
    wavelength: float,
    *,
    z: float | None = None,
    clip: bool = False,
    start: Array | None = None,
) -> tuple[Array, Array, NDArray[np.bool_], Array]:
    """Rays from points of a plane at `z`, by default in focus, through points of the FAP, both (..., 2), to the array.

    Heights and slopes (2, ...) in the array's own frame, which rays come through, and slopes at the FAP: those of rays
    that go nearly as these are where to `start` from.
    """
    x, a = np.broadcast_arrays(point, pupil)
    end = camera.fap.lifted(a)
    slopes, comes = camera.aimed(
        end, TracedPlane(camera.focal_plane if z is None else z).lifted(x), wavelength, clip=clip, start=start
    )
    lens = camera.train(wavelength).lens
    there = lens.through(end[:2], slopes, start=end[2], end=camera.array.z, backward=False, clip=clip)
    way = np.tensordot(camera.array.axes, np.stack([*there.slope, np.ones(x.shape[:-1])]), axes=1)
    height = camera.array.crossed(there.height, there.slope, camera.array.z)
    return height, way[:2] / way[2], comes & (there.state == RayFate.KEPT), slopes


def _focus(camera: LensCamera, point: Array, axis: Array) -> Array:
    """Distance behind the array at which a thin pencil spread along `axis` on the FAP comes together along it [mm]."""
    offset = PENCIL * camera.fap.diameter / 2 * np.array([[-1.0], [1.0]])
    pupil, towards = camera.fap.centre + offset * axis[..., None, :], np.moveaxis(axis, -1, 0)[..., None]
    rays = forward_rays(camera, point[..., None, :], pupil, camera.wavelength)
    height, slope = (np.sum(part * towards, axis=0) for part in rays[:2])
    closing, gap = slope[..., 1] - slope[..., 0], height[..., 1] - height[..., 0]
    return np.asarray(np.divide(-gap, closing, where=closing != 0, out=np.zeros_like(gap)))


def _spot(camera: LensCamera, point: Array, along: Array, across: Array) -> tuple[Array, Array]:
    """Root-mean-square radius, from rays all over the FAP, and extents, from those and more along its rim."""
    disc = np.concatenate([sunflower(SPOT_RAYS), circle(RIM_POINTS).T], axis=1)
    pupil = camera.fap.filled(disc[0][:, None] * along[..., None, :] + disc[1][:, None] * across[..., None, :])
    height, _, kept, _ = forward_rays(camera, point[..., None, :], pupil, camera.wavelength, clip=True)
    place = np.moveaxis(height, 0, -1)
    even = kept & (np.arange(kept.shape[-1]) < SPOT_RAYS)
    count = np.maximum(np.sum(even, axis=-1), 1)
    mean = np.sum(place * even[..., None], axis=-2) / count[..., None]
    off = np.where(kept[..., None], place - mean[..., None, :], 0.0)
    blur = np.sqrt(np.sum(np.square(off) * even[..., None], axis=(-1, -2)) / count)
    sides = np.stack([np.sum(off * axis[..., None, :], axis=-1) for axis in (along, across)], axis=-1)
    return blur, np.max(sides, axis=-2) - np.min(sides, axis=-2)


def thin_twin(camera: LensCamera) -> Camera:
    """The straight camera with an ideal lens of the same focal length and clear aperture, as far as Eq. 6 takes it."""
    centred = {f"{part}.decentre.{axis}": 0.0 for part in ("main_lens", "aperture") for axis in (0, 1)}
    return Camera(
        {
            **centred,
            "main_lens.focal_length": camera.first_order.focal_length,
            "main_lens.focal_plane": camera.d_f,
            "main_lens.diameter": camera.lens.clear_diameter,
            "aperture.distance": camera.d_3,
            "aperture.diameter": camera.fap.diameter / abs(camera.apparent_pupil[1]),
        }
    )


class _FieldBound(NamedTuple):
    """Largest undistorted field radius, object side and microlens-array side."""

    object_radius: Array
    """Radius on the focal plane [mm]; 0 where even the axis is clipped."""
    mla_radius: Array
    """Where its chief ray meets the microlens array [mm]."""


def undistorted_field(camera: LensCamera, angle: float = 0.0) -> _FieldBound:
    """Non-distortion bound measured on the real lens along a direction on the array [rad].

    Returns
    -------
    FieldBound
        How far off axis a microlens still sees the whole FAP, on the focal plane and on the array [mm]; 0 where even
        the axis is clipped. Twin of Eq. 6, which knows only the thin lens. The search ends at twice the lens's
        diameter.
    """
    way = np.array([np.cos(angle), np.sin(angle)])
    centre = camera.fap.centre
    straight = camera.fap.straight
    rim = camera.fap.points(rim_points(RIM_POINTS, straight=straight))

    def room(radius: float) -> float:
        """Least room of the FAP's rim; -1 where some of it is out of sight."""
        rays = sensor_of_pupil(camera, radius * way, rim)
        least = 1 - float(highest(rays.heights[None], straight=straight).max()) if rays.ok.all() else -1.0
        return max(least, -1.0)

    twin = thin_twin(camera)
    thin = float(undistorted_radii(twin)[0] * twin.seen.m)
    widest = camera.lens.clear_diameter
    low, high = 0.0, min(thin, widest)
    high = high if high > 0 else widest / 8
    inside, outside = room(low), room(high)
    if inside < 0:
        return _FieldBound(np.asarray(0.0), np.asarray(0.0))
    while outside >= 0 and high < 2 * widest:
        low, inside, high = high, outside, 1.25 * high
        outside = room(high)
    radius = high if outside >= 0 else _root(room, low, high, inside, outside)
    edge = sensor_of_pupil(camera, radius * way, centre)
    point = edge.views.at(camera.fap.z - camera.focal_plane)
    return _FieldBound(np.asarray(np.hypot(*point)), np.asarray(radius))


def _root(room: Callable[[float], float], low: float, high: float, inside: float, outside: float) -> float:
    """Largest radius found with room, between one with and one without: secant steps kept inside the bracket."""
    stayed = 0
    for _ in range(80):
        smooth = outside > -1  # else part of the rim was out of sight and the number says only that
        share = inside / (inside - outside) if smooth else 0.5
        middle = low + (high - low) * min(max(share, 1e-3), 1 - 1e-3)
        value = room(middle)
        if value >= 0:  # Illinois: an end that stays twice must not hold the steps back
            low, inside, outside = middle, value, outside / 2 if stayed == 1 and smooth else outside
            stayed = 1
        else:
            high, outside, inside = middle, value, inside / 2 if stayed == -1 and value > -1 else inside
            stayed = -1
        if high - low <= 1e-12 * high or 0 <= value <= 1e-13:
            break
    return low


class _RealField(NamedTuple):
    """Images and aberrations of microlenses (N) behind a real lens; lengths in mm, nan where there is no light."""

    images: TracedImages
    thin_centre: Array
    """Image of the FAP's centre by the thin-lens model, relative to the microlens axis, (N, 2)."""
    thin_diameter: float
    thin_outline: Array
    """Image of the FAP's rim by the thin-lens model, likewise, (N, K, 2)."""
    shift: Array
    """Image centres against the thin-lens model's, (N, 2)."""
    widening: Array
    """Diameter over the thin-lens model's, less 1, (N); of what is lit where the image is folded, nan where part of the
    FAP's rim is out of the lens's sight."""
    rim_shift: Array
    """Farthest that a point of the FAP's rim is imaged from where the thin-lens model images it, (N); nan likewise."""
    maps: _FieldMap
    lateral_colour: Array
    """Distance between the F and the C line on the array, (N); nan outside the glasses' range."""
    chief: tuple[str, ...]
    """Fate of each chief ray."""


def real_field(design: Design, axes: Sequence[tuple[float, float]] | ArrayLike) -> _RealField:
    """Microlens images and aberrations at microlenses of a design (N, 2), in its array's frame [mm]."""
    camera = camera_of(design)
    fap = camera.fap
    c = microlenses(design, axes).reshape(-1, 2)
    images = real_images(camera, c)
    rim = fap.points(rim_points(images.outline.shape[-2], straight=fap.straight))
    thin_centre = camera.d_2 * chief_slope(camera, c, fap.centre)
    thin_rim = camera.d_2 * chief_slope(camera, c[:, None], rim)
    apart = chief_slope(camera, [0.0, 0.0], [1.0, 0.0]) - chief_slope(camera, [0.0, 0.0], [0.0, 0.0])
    thin_diameter = fap.diameter * abs(float(camera.d_2 * apart[0]))
    try:
        maps = field_map(camera, c, VISIBLE)
        colour = np.hypot(*np.moveaxis(maps.lateral_colour[:, 1] - maps.lateral_colour[:, 0], -1, 0))
    except InputError:  # a glass that is not known so far
        maps = field_map(camera, c)
        colour = np.full(len(c), math.nan)
    own = np.where(images.status == ImageFate.FOLDED, 2 * np.sqrt(images.area / np.pi), images.diameter)
    lost = maps.status != RayFate.KEPT
    cut = views(camera, c, c + images.chief)
    guessed = lost | ((images.status == ImageFate.CLIPPED) & np.isnan(images.whole_area))
    return _RealField(
        images,
        thin_centre,
        thin_diameter,
        thin_rim,
        np.where(lost[:, None], math.nan, images.chief - thin_centre),
        np.where(guessed, math.nan, own / thin_diameter - 1),
        np.where(guessed, math.nan, np.max(np.hypot(*np.moveaxis(images.outline - thin_rim, -1, 0)), axis=-1)),
        maps,
        np.where(lost, math.nan, colour),
        tuple(camera.describe(int(state)) for state in np.where(lost, maps.status, cut.state)),
    )


@lru_cache(maxsize=64)
def measured_bound(design: Design) -> tuple[float, float]:
    """Undistorted half-field measured on the traced lens, on the focal plane and on the array [mm].

    Twin of Eq. 6's bound; where parts are off axis, the least of eight directions.
    """
    camera = camera_of(design)
    turns = [0.0] if camera.is_centred else [k * math.pi / 4 for k in range(8)]
    least = min((undistorted_field(camera, turn) for turn in turns), key=lambda bound: float(bound.mla_radius))
    return float(least.object_radius), float(least.mla_radius)
