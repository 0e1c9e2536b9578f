"""The nominal camera behind a real lens: what builds are aimed from, and what a decoder of that design believes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design import Design
from ..lenses.aim import Aims, aimed, aims, landings, pupil_points
from ..lenses.images import FOLDED, real_images, sensor_of_pupil
from ..lenses.kernels import BLOCK
from ..lenses.of_design import camera_of, microlenses
from .decoder import CALIBRATION_DEPTHS
from .mount import Mounted, mounted

Array = NDArray[np.float64]

STEP = 0.25
"""Between the places that tell how image centres move over the array [mm]."""


class LocalMaps(NamedTuple):
    """Image centres about n places of the array, to second order [mm]."""

    place: Array
    """(n, 2)."""
    value: Array
    """(n, 2)."""
    slope: Array
    """By x and y, (n, 2, 2): second axis the way, last the centre's coordinate."""
    bend: Array
    """Second derivatives xx, xy, yy, (n, 3, 2)."""

    def at(self, x: Array, y: Array) -> Array:
        """Image centres at places (n, ...) of the array, (n, ..., 2)."""
        more = (1,) * (np.ndim(x) - 1)
        u = (x - self.place[:, 0].reshape(-1, *more))[..., None]
        v = (y - self.place[:, 1].reshape(-1, *more))[..., None]
        value, dx, dy, xx, xy, yy = (
            part.reshape(-1, *more, 2)
            for part in (self.value, *np.moveaxis(self.slope, 1, 0), *np.moveaxis(self.bend, 1, 0))
        )
        return np.asarray(value + u * dx + v * dy + u * u * xx / 2 + u * v * xy + v * v * yy / 2)


@dataclass(frozen=True, eq=False)
class Reference:
    """All that builds of one question share. F fields."""

    chief: Aims
    """To the FAP's centre, F."""
    rim: Aims
    """To its rim, F times `aim.RIM`."""
    inner: Aims
    """To points inside it, its centre first."""
    neighbours: Aims
    """To its centre, from half a pitch left, right, below and above, F times 4."""
    ends: Aims
    """To its centre, from the ends of both axes of the array at `reach`, 4."""
    reach: float
    """Largest field radius [mm]."""
    folded: NDArray[np.bool_]
    """Fields whose nominal image is folded: it has no outline, (F,)."""
    azimuth: tuple[Array, Array]
    """Unit vector of each field's direction, along which its views are taken, (F, 1) each; +x on the axis."""
    points: Array
    """Object points that nominal chief rays meet at the object's distance, in the system's frame [mm], (F, 3)."""
    axis_points: Array
    """The same on the axis at the depths of a calibration, (3, 3)."""
    depths: tuple[float, ...]
    """Those depths, Z [mm]."""
    centres: LocalMaps
    end_centres: LocalMaps
    axis_centres: LocalMaps
    slopes: Array
    """Nominal slopes at those depths along each field's chief ray, (F, 3)."""
    axis_slopes: Array
    """The same on the axis, (3,)."""


@lru_cache(maxsize=8)
def reference(design: Design, fields: tuple[tuple[float, float], ...], object_distance: float) -> Reference:
    """Trace the nominal camera of a question.

    Parameters
    ----------
    design : Design
        With a real main lens.
    fields : tuple of (x, y)
        Microlens positions on the array [mm].
    object_distance : float
        Z of the decoder's target, from the object-side principal plane [mm].
    """
    camera, place = camera_of(design), np.array(fields, float).reshape(-1, 2)
    mount = mounted(design, {}, 1)
    rim, inner = pupil_points()

    def wanted(base: ArrayLike, target: Array, offset: ArrayLike = ((0.0, 0.0),)) -> Aims:
        """Every offset and target at every place, the places slowest."""
        at, aside = np.atleast_2d(np.asarray(base, float)), np.asarray(offset, float)
        per = max(len(target), len(aside))
        start = np.repeat(at, per, axis=0)
        nudge, goal = (np.tile(np.broadcast_to(part, (per, 2)), (len(at), 1)) for part in (aside, target))
        return aims(camera, start, goal, microlenses(design, start + nudge * design.d / 2), nudge)

    middle = np.zeros((1, 2))
    reach = float(np.max(np.hypot(place[:, 0], place[:, 1]))) or design.microlens_array.size[0] / 2
    crosses = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
    ends = reach * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])

    def centres(at: Array) -> LocalMaps:
        return _local_maps(at, lambda places: _centres(mount, design, wanted(places, middle)))

    radius = np.hypot(place[:, :1], place[:, 1:])
    off = radius > 0
    safe = np.where(off, radius, 1.0)
    azimuth = (np.where(off, place[:, :1] / safe, 1.0), np.where(off, place[:, 1:] / safe, 0.0))
    depths = tuple(design.d_3 + (object_distance - design.d_3) * factor for factor in CALIBRATION_DEPTHS)
    front = camera.first_order.front_principal
    lens_at = np.asarray(design.main_lens.decentre)

    def along_chief(at: Array, depth: float) -> Array:
        c = microlenses(design, at)
        fap = camera.fap
        found = sensor_of_pupil(camera, c, np.array([fap.x, fap.y]))
        aside = found.views.at(depth - design.d_3) + lens_at
        aside[~found.ok] = np.nan
        return np.concatenate([aside, np.full((len(at), 1), front - depth)], axis=1)

    near, axis_way = centres(place), (np.ones((1, 1)), np.zeros((1, 1)))
    axis, on_axis = centres(middle), np.array([[0.0, 0.0, front - depth] for depth in depths])

    def nominal(maps: LocalMaps) -> Callable[[Any, Any], Array]:
        return lambda x, y: maps.at(x, y) / design.q

    slopes = [epi_slopes(mount, along_chief(place, depth), azimuth, nominal(near))[:, 0] for depth in depths]
    return Reference(
        chief=wanted(place, middle),
        rim=wanted(place, rim),
        inner=wanted(place, inner),
        neighbours=wanted(place, middle, crosses),
        ends=wanted(ends, middle),
        reach=reach,
        folded=np.asarray(real_images(camera, microlenses(design, place)).status == FOLDED),
        azimuth=azimuth,
        points=along_chief(place, object_distance),
        axis_points=on_axis,
        depths=depths,
        centres=near,
        end_centres=centres(ends),
        axis_centres=axis,
        slopes=np.stack(slopes, axis=-1),
        axis_slopes=np.array([float(epi_slopes(mount, p[None], axis_way, nominal(axis))[0, 0]) for p in on_axis]),
    )


def _centres(mount: Mounted, design: Design, wanted: Aims) -> Array:
    count, half = len(wanted.base), np.array([design.d / 2])
    rays = next(size for size in range(min(BLOCK, count), 0, -1) if count % size == 0)
    begin = np.arange(0, count, rays)
    found = aimed(mount.lens, mount.planes, half, wanted, np.zeros(len(begin), np.int64), begin, rays)
    return found.landed.reshape(count, 2)


def _local_maps(place: Array, centre: Callable[[Array], Array]) -> LocalMaps:
    steps = STEP * np.array([[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, 1], [-1, 1], [1, -1]])
    o, w, e, s, n, sw, ne, nw, se = np.moveaxis(centre((place[:, None] + steps).reshape(-1, 2)).reshape(-1, 9, 2), 1, 0)
    slope = np.stack([e - w, n - s], axis=1) / (2 * STEP)
    bend = np.stack([e - 2 * o + w, (ne + sw - nw - se) / 4, n - 2 * o + s], axis=1) / STEP**2
    return LocalMaps(place, o, slope, bend)


def epi_slopes(
    mount: Mounted, points: Array, azimuth: tuple[Array, Array], centre: Callable[[Any, Any], Array]
) -> Array:
    """Slopes between each point's rays through the FAP's two ends, as a decoder computes them.

    Parameters
    ----------
    mount : Mounted
        T builds.
    points : ndarray, shape (n, 3)
        Object points, in the system's frame [mm].
    azimuth : pair of ndarray, shape (n, 1)
        The ends' direction.
    centre : callable
        From places on the array (n, T) [mm] to the image centres believed in [px], (n, T, 2).

    Returns
    -------
    ndarray, shape (n, T)
        [microlenses per pixel].
    """
    cos, sin = azimuth
    way = np.concatenate([cos, sin], axis=1)
    found = landings(
        mount.lens, mount.planes, mount.world, np.concatenate([points, points]), np.concatenate([way, -way])
    )
    u, v, x, y = np.moveaxis(found, (0, 1), (2, 1))
    n = len(points)
    believed = [centre(u[part], v[part]) for part in (slice(n), slice(n, None))]
    q, d = mount.camera.q, mount.camera.d
    s = [x[part] / q - believed[k][..., 0] for k, part in enumerate((slice(n), slice(n, None)))]
    t = [y[part] / q - believed[k][..., 1] for k, part in enumerate((slice(n), slice(n, None)))]
    du, dv = u[:n] - u[n:], v[:n] - v[n:]
    return np.asarray((du * cos + dv * sin) / d / ((s[0] - s[1]) * cos + (t[0] - t[1]) * sin))
