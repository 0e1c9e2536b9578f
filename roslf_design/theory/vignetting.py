"""Which rims leave the pupil whole, over which field: Eqs. 5-6 for any number of circular stops, decentred or not.

The pencil of a field point that fills the flexible angular plane (FAP) covers a disc on every stop's plane; the
microlens image is undistorted ("full", not a cat's eye) while each disc lies inside its stop. The main lens is a stop
at distance 0, which is Eq. 6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, floats, magnitude, product, ratio
from ..camera import Camera
from ..design.parts import PATHS
from .chief_rays import chief_rays, traced
from .light import SensorField, sensor_field
from .stop_images import room_in_pupil, settled


class FieldBound(NamedTuple):
    """Largest undistorted field radius, object side and microlens-array side."""

    object_radius: Array
    """Radius on the plane at `distance` [mm]; inf where no field is too large, 0 where even the axis is clipped."""
    mla_radius: Array
    """Where its chief ray meets the microlens array [mm]; finite also for an infinite `distance`."""


def nondistortion_margin(c: Camera, radius: ArrayLike, distance: ArrayLike) -> Array:
    """Signed room left inside the main lens for the whole pencil of a field point. Eqs. 5-6.

    Parameters
    ----------
    c : Camera
    radius : array_like
        X, distance of the field point from the axis [mm], of either sign. A half-field, not a full one.
    distance : array_like
        Z, object plane to main lens [mm]; ``Z > d_3``, finite; d_f in the paper.

    Returns
    -------
    ndarray
        ``D (Z - d_3) - D_F Z - 2 |X| d_3`` [mm^2], broadcast; exact at ``d_3 = 0`` where Eq. 6 divides by zero. The
        microlens image is undistorted where it is >= 0.

    Raises
    ------
    ValueError
        `distance` is not finite.
    """
    lens, de, d3, z, x = floats(c.D, c.seen.D_F, c.seen.d_3, distance, radius)
    if not np.isfinite(z).all():
        raise ValueError(f"distance must be finite, got {float(np.ravel(z[~np.isfinite(z)])[0])}")
    margin: Array = (lens - de) * z - (lens + 2 * np.abs(x)) * d3
    return margin


def nondistortion_bound(c: Camera, distance: ArrayLike | None = None) -> FieldBound:
    """Field radius at which `nondistortion_margin` reaches zero. Eq. 6.

    Parameters
    ----------
    c : Camera
    distance : array_like, optional
        Z [mm]; ``Z > d_3``, may be inf; d_f where none is given.

    Returns
    -------
    FieldBound
        ``|X| = (D (Z - d_3) - D_F Z) / (2 d_3)`` and ``|A X / (Z - d_3)|`` [mm], broadcast. Both inf at ``d_3 = 0``
        with ``D >= D_F``; the first inf at ``Z = inf`` (finite twin: the second).
    """
    lens, de, d3, z = floats(c.D, c.seen.D_F, c.seen.d_3, c.seen.d_f if distance is None else distance)
    depth = z - d3
    axial = lens * ratio(depth, z) - de
    clear = axial >= 0
    slope = np.where(clear, ratio(axial, 2 * d3), 0.0)
    slope = np.where(clear & (d3 == 0), np.inf, slope)
    return FieldBound(product(slope, z), product(slope, np.abs(c.seen.A * ratio(z, depth))))


def room_at(c: Camera, object_radius: ArrayLike) -> Array:
    """Room between the pencil of the worst field point at a radius and each rim, on that rim's plane [mm].

    Parameters
    ----------
    c : Camera
        Its tilts are left out.
    object_radius : array_like
        |X_0| on the focal plane, as the main lens sees it [mm].

    Returns
    -------
    ndarray, shape (K, ...)
        One row a rim of `Camera.rims`; negative where that rim cuts the pencil. With decentres the worst direction
        counts: the field's offset adds to that of the decentres.
    """
    d_f, d_3, de, radius, gap = *floats(c.seen.d_f, c.seen.d_3, 2 * c.fap.radius, object_radius), c.seen.gap
    room = 2 * magnitude(gap)
    pupil = c.decentre("aperture")
    rooms = []
    for rim in c.rims:
        between = d_f - rim.distance
        offset = np.hypot(*(e * gap - o * between for e, o in zip(c.decentre(rim.part), pupil, strict=True)))
        axial = rim.radius * room - de * magnitude(between)
        here = settled((axial - 2 * offset - 2 * radius * np.abs(d_3 - rim.distance)) / room, rim.radius)
        anywhere = room_in_pupil(c, rim)
        rooms.append(rim.scale * np.where(np.isnan(anywhere), here, anywhere))
    return np.stack(np.broadcast_arrays(*rooms, np.zeros(c.shape))[:-1])


def corner_room(c: Camera, field: SensorField | None = None) -> Array:
    """`room_at` the corner of what the sensor sees (`field`, its own by default) that is farthest off the axis."""
    return room_at(c, (field or sensor_field(c)).radius * magnitude(c.seen.inverse_m))


def undistorted_radii(c: Camera) -> Array:
    """Largest radius on the focal plane whose pencil each rim leaves whole, in the worst direction [mm].

    As the main lens sees it; the object's own is larger by the magnification of `Camera.focus`.

    Parameters
    ----------
    c : Camera
        Its tilts are left out.

    Returns
    -------
    ndarray, shape (K, ...)
        One row a rim of `Camera.rims`; below 0 where even the axis is cut, by as much as it is. A rim in the FAP's own
        plane cuts all fields alike: inf where it leaves room, else its room.
    """
    d_3, gap = *floats(c.seen.d_3), magnitude(c.seen.gap)
    radii = []
    for rim, room in zip(c.rims, room_at(c, 0.0), strict=True):
        bound = product(ratio(room / rim.scale, np.abs(d_3 - rim.distance)), gap)
        alike = np.where(room >= 0, np.inf, room)
        radii.append(np.where(np.isnan(room_in_pupil(c, rim)), bound, alike))
    return np.stack(np.broadcast_arrays(*radii, np.zeros(c.shape))[:-1])


def on_focal_plane(c: Camera, radii: Array) -> Array:
    """Radii on the focal plane as the main lens sees them, where they are [mm]: along chief rays, of either sign."""
    straight = radii * magnitude(c.focus.magnification)
    if not traced(c):
        return straight
    places = np.where(np.isfinite(radii), np.abs(radii), 0.0) / magnitude(c.seen.inverse_m)
    rays = chief_rays(c, (np.stack([places, np.zeros_like(places)]), np.zeros(())))
    x, y = rays.on_plane(c[PATHS["d_f"]])
    met = np.copysign(np.hypot(x[0] - x[1], y[0] - y[1]), radii)
    return np.where(np.isfinite(radii), met, straight)


def field_margins(c: Camera) -> Array:
    """Margins by which limits on the undistorted field are judged where no field may be too large.

    Parameters
    ----------
    c : Camera
        Its tilts are left out.

    Returns
    -------
    ndarray, shape (K, 3, ...)
        Of each rim of `Camera.rims` the undistorted radius r where it is [mm], the room on the axis a and what each
        millimetre of radius takes of it b: all finite but r, and ``a - r b`` is 0.
    """
    radii, room = on_focal_plane(c, undistorted_radii(c)), room_at(c, 0.0)
    d_3, gap, grown = *floats(c.seen.d_3), magnitude(c.seen.gap), magnitude(c.focus.magnification)
    first_order = [
        np.where(np.isnan(room_in_pupil(c, rim)), rim.scale * np.abs(d_3 - rim.distance) / (gap * grown), 0.0)
        for rim in c.rims
    ]
    taken: Array = np.stack(np.broadcast_arrays(*first_order, np.zeros(c.shape))[:-1])
    if traced(c):  # the radius is that of a traced ray
        taken = np.where(np.isfinite(radii) & (radii != 0), ratio(room, radii), taken)
    return np.stack([radii, *np.broadcast_arrays(room, taken)], axis=1)


class FieldLimit(NamedTuple):
    """Limit of the undistorted field of one camera."""

    radius: float
    """Largest undistorted object radius at d_f, in the worst direction [mm]; inf where no field is too large."""
    mla_radius: float
    """Where its chief ray meets the array [mm]."""
    rim: str
    """The rim that ends it or, where none does, the one that leaves the least room."""
    room: float
    """Smallest room between a pencil and a rim at the field's farthest corner, on that rim's plane [mm]."""


def field_limit(c: Camera) -> FieldLimit:
    """Largest undistorted field of one camera, and the room left at the corner of what the sensor sees.

    Parameters
    ----------
    c : Camera
        One build; its tilts are left out.
    """
    bounds = [max(float(bound), 0.0) for bound in undistorted_radii(c)]
    rooms = [float(room) for room in corner_room(c)]
    tightest = min(range(len(rooms)), key=lambda k: (bounds[k], rooms[k]))
    radius = bounds[tightest]
    real, on_array = float(on_focal_plane(c, np.asarray(radius))), radius / abs(float(c.seen.inverse_m))
    return FieldLimit(real, on_array, c.rims[tightest].opening, min(rooms))
