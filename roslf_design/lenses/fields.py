"""What a real lens does over the field: distortion, field curvature, astigmatism, blur on the array, lateral colour.

For a microlens at c the chief ray is the one through the centre of the flexible angular plane (FAP); it says which
object point X on the focal plane the microlens looks at. From X the pencil that fills the FAP is traced forward to the
array: the FAP stands in front of the lens, so these rays need no aiming either.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._points import sunflower
from ..theory.field import FieldBound, nondistortion_bound
from .camera import LensCamera, Plane
from .images import sensor_of_pupil
from .trace import KEPT, Rays, Traced, trace

Array = NDArray[np.float64]

PENCIL = 1e-3
"""Size of the pencil about the chief ray that field curvature is measured with, as a part of the FAP."""
SPOT_RAYS = 200
RIM_POINTS = 32


class FieldMap(NamedTuple):
    """Aberrations by microlens; leading axes of the microlenses, then of wavelengths where there are several."""

    microlens: Array
    """c [mm], (..., 2)."""
    object_point: Array
    """X on the focal plane that the chief ray comes from [mm], (..., 2)."""
    distortion: Array
    """(|c| - |c_1|)/|c_1|, c_1 where first order would image X; (...), 0 on the axis."""
    tangential_focus: Array
    sagittal_focus: Array
    """Where pencils in and across the meridional plane focus, behind the array [mm], (...); negative before it."""
    blur: Array
    """Root-mean-square radius of the light from X on the array, about its centroid [mm], (...)."""
    spread: Array
    """Largest extents of that light along and across the meridional plane [mm], (..., 2)."""
    colours: Array
    """Wavelengths [mm], (W,)."""
    lateral_colour: Array
    """Where the chief ray from X meets the array in each colour, from where it does in the camera's own [mm], (..., W,
    2); 0 where it does not come through."""
    status: NDArray[np.int16]
    """State of the chief ray (`trace.describe`), (...); where it is not 0, the numbers above are 0."""


def field_map(camera: LensCamera, microlens: ArrayLike, colours: ArrayLike = ()) -> FieldMap:
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
    centre = np.array([fap.x, fap.y])
    chief = sensor_of_pupil(camera, c, centre)
    state = np.where(chief.ok, chief.views.state, _unfound(chief.views.state)).astype(np.int16)
    point = chief.views.at(fap.z - camera.focal_plane)
    first_order_point = -point * camera.d_1 / camera.d_f
    ideal, real = np.hypot(*np.moveaxis(first_order_point, -1, 0)), np.hypot(*np.moveaxis(c, -1, 0))
    away = ideal > 1e-9 * camera.fap.diameter
    distortion = np.where(away, np.divide(real - ideal, ideal, where=away, out=np.zeros_like(ideal)), 0.0)
    along = np.where(real[..., None] > 0, c / np.where(real > 0, real, 1.0)[..., None], np.array([1.0, 0.0]))
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    foci = [_focus(camera, point, centre, axis) for axis in (along, across)]
    blur, spread = _spot(camera, point, centre, along, across)
    lateral = np.zeros((*c.shape[:-1], waves.size, 2))
    if waves.size:
        own = _forward(camera, point, centre, camera.wavelength)
        other = _forward(camera, point[..., None, :], centre, waves)
        shift = np.moveaxis(other.rays.position[:2], 0, -1) - np.moveaxis(own.rays.position[:2], 0, -1)[..., None, :]
        lateral = np.where((other.kept & own.kept[..., None])[..., None], shift, 0.0)
    good = state == KEPT
    numbers = (distortion, *foci, blur, spread)
    distortion, tangential, sagittal, blur, spread = (
        np.where(good.reshape(good.shape + (1,) * (value.ndim - good.ndim)), value, 0.0) for value in numbers
    )
    return FieldMap(c, point, distortion, tangential, sagittal, blur, spread, waves, lateral, state)


def _unfound(state: NDArray[np.int16]) -> NDArray[np.int16]:
    """States of chief rays that Newton's method did not find: what stopped the nearest approach, else a miss."""
    from .kernels import MISSED

    return np.where(state == KEPT, 8 + MISSED, state).astype(np.int16)


def _forward(camera: LensCamera, point: Array, pupil: Array, wavelength: ArrayLike, *, clip: bool = False) -> Traced:
    """Rays from points of the focal plane through points of the FAP, both (..., 2), to the array, in its own frame."""
    x, a = np.broadcast_arrays(point, pupil)
    start = np.stack([x[..., 0], x[..., 1], np.full(x.shape[:-1], camera.focal_plane)])
    fap = camera.fap
    end = Plane(fap.x, fap.y, fap.tilt).lifted(a, fap.z)
    rays = Rays(end, Rays.between(start, end).direction)
    found = trace(camera.lens, rays, wavelength, plane=camera.mla, clip=clip)
    if camera.array.tilt == (0.0, 0.0):
        return found
    position, direction = found.rays
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(found.kept, direction[:2] / direction[2], 0.0)
    there = camera.array.crossed(position[:2], slope, 0.0)
    turned = np.tensordot(camera.array.axes, direction, axes=1)
    return found._replace(rays=Rays(np.stack([*there, position[2]]), turned))


def _focus(camera: LensCamera, point: Array, centre: Array, axis: Array) -> Array:
    """Where a thin pencil spread along `axis` on the FAP comes together along it, behind the array [mm]."""
    offset = PENCIL * camera.fap.diameter / 2 * np.array([[-1.0], [1.0]])
    rays = _forward(camera, point[..., None, :], centre + offset * axis[..., None, :], camera.wavelength)
    place, way = rays.rays.position[:2], rays.rays.direction
    towards = np.moveaxis(axis, -1, 0)[..., None]
    height, slope = np.sum(place * towards, axis=0), np.sum(way[:2] * towards, axis=0) / way[2]
    closing = slope[..., 1] - slope[..., 0]
    gap = height[..., 1] - height[..., 0]
    parallel = closing == 0
    return np.asarray(np.where(parallel, 0.0, -gap / np.where(parallel, 1.0, closing)))


def _spot(camera: LensCamera, point: Array, centre: Array, along: Array, across: Array) -> tuple[Array, Array]:
    """Root-mean-square radius, from rays all over the FAP, and extents, from those and more along its rim."""
    turns = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    disc = np.concatenate([sunflower(SPOT_RAYS), [np.cos(turns), np.sin(turns)]], axis=1) * camera.fap.diameter / 2
    pupil = centre + disc[0][:, None] * along[..., None, :] + disc[1][:, None] * across[..., None, :]
    rays = _forward(camera, point[..., None, :], pupil, camera.wavelength, clip=True)
    place, kept = np.moveaxis(rays.rays.position[:2], 0, -1), rays.kept
    even = kept & (np.arange(kept.shape[-1]) < SPOT_RAYS)
    count = np.maximum(np.sum(even, axis=-1), 1)
    mean = np.sum(place * even[..., None], axis=-2) / count[..., None]
    off = np.where(kept[..., None], place - mean[..., None, :], 0.0)
    blur = np.sqrt(np.sum(np.square(off) * even[..., None], axis=(-1, -2)) / count)
    sides = np.stack([np.sum(off * axis[..., None, :], axis=-1) for axis in (along, across)], axis=-1)
    return blur, np.max(sides, axis=-2) - np.min(sides, axis=-2)


def undistorted_field(camera: LensCamera, wavelength: float | None = None, angle: float = 0.0) -> FieldBound:
    """Non-distortion bound measured on the real lens: how far off axis a microlens still sees the whole FAP.

    Parameters
    ----------
    camera : LensCamera
        The camera.
    wavelength : float, optional
        [mm]; the camera's own by default.
    angle : float
        Direction on the array [rad].

    Returns
    -------
    FieldBound
        Radii on the focal plane and on the array [mm]; 0 where even the axis is clipped. Twin of Eq. 6, which knows
        only the thin lens. The search ends at twice the lens's diameter.
    """
    way = np.array([np.cos(angle), np.sin(angle)])
    turns = angle + 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    centre = np.array([camera.fap.x, camera.fap.y])
    rim = centre + camera.fap.diameter / 2 * np.stack([np.cos(turns), np.sin(turns)], axis=-1)

    def room(radius: float) -> float:
        """Least room of the FAP's rim, between the points looked at as well; -1 where some of it is out of sight."""
        found = sensor_of_pupil(camera, radius * way, rim, wavelength)
        if not np.all(found.ok & (found.views.room > -1)):
            return -1.0
        low = int(np.argmin(found.views.room))
        left, least, right = (float(found.views.room[(low + step) % RIM_POINTS]) for step in (-1, 0, 1))
        bend = left - 2 * least + right
        return least - (right - left) ** 2 / (8 * bend) if bend > 0 else least

    thin = nondistortion_bound(
        camera.lens_diameter, camera.fap.diameter, camera.d_3, camera.d_f, camera.first_order.focal_length, camera.d_f
    )
    low, high = 0.0, min(float(thin.mla_radius), camera.lens_diameter)
    inside, outside = room(low), room(high)
    if inside < 0:
        return FieldBound(np.asarray(0.0), np.asarray(0.0))
    while outside >= 0 and high < 2 * camera.lens_diameter:
        low, inside, high = high, outside, 1.25 * high
        outside = room(high)
    radius = high if outside >= 0 else _root(room, low, high, inside, outside)
    edge = sensor_of_pupil(camera, radius * way, centre, wavelength)
    point = edge.views.at(camera.fap.z - camera.focal_plane)
    return FieldBound(np.asarray(np.hypot(*point)), np.asarray(radius))


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
