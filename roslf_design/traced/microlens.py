"""Microlens images behind a real lens, in many builds at once: everything that belongs to a field is traced.

A single design is one build. Rays go from the microlenses to the FAP's centre, for where images lie, and to its rim,
for what shape they have; ahead of all elements the former tell which place of a plane a microlens looks at.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array
from ..bore.conjugates import CONJUGATES
from ..camera import Camera, Number
from ..design import Design
from ..fates import RayFate
from ..theory.light import solid_angle
from ..theory.stop_images import MicrolensImages, lens_point
from .camera import camera_of
from .outlines import RIM, Outlines, lit_images, rim_points
from .train import AimedRays, Planes, RayTargets, Train, aimed, crossings, etendue_sr

MIDDLE = np.zeros((1, 2))
CROSS = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
"""Neighbouring places: left, right, below and above."""


class Mount(NamedTuple):
    """T builds as rays meet them, in the main lens's frame [mm]."""

    train: Train
    planes: Planes
    front_principal: Array
    """Object-side principal plane along z, (T,)."""
    rear_principal: Array
    """Image-side one, (T,)."""
    world: Array
    """Shift of the system's frame against the lens's, (T, 3)."""

    @classmethod
    def of(cls, design: Design) -> Mount:
        """A design behind its lens, one build."""
        camera = camera_of(design)
        array, turn = camera.planes.array.copy(), design.microlens_array.rotation
        x, y = array[:, 3:6].copy(), array[:, 6:9].copy()
        array[:, 3:6], array[:, 6:9] = math.cos(turn) * x + math.sin(turn) * y, math.cos(turn) * y - math.sin(turn) * x
        order, aside = camera.first_order, design.main_lens.decentre
        return cls(
            camera.train(camera.wavelength),
            camera.planes._replace(array=array),
            np.array([order.front_principal]),
            np.array([order.rear_principal]),
            -np.array([[*aside, 0.0]]),
        )


class FieldRays:
    """Rays that images at some fields are traced by, found as they are asked for.

    Parameters
    ----------
    find : callable
        Targets of rays from places of the array (n, 2) [mm] to points of the FAP (n, 2), from offsets (n, 2) beside
        those, as `RayTargets` has them.
    fields : ndarray, (F, 2)
        Microlenses, on the array [mm].
    axis : ndarray, (2,)
        Place of the array on the lens's axis [mm].
    straight : bool
        Whether the FAP has straight sides.
    own : bool
        Whether every build has targets of its own, the builds slowest.
    """

    def __init__(
        self,
        find: Callable[[Array, Array, Array], RayTargets],
        fields: Array,
        axis: Array,
        *,
        straight: bool,
        own: bool = False,
    ) -> None:
        self.find, self.fields, self.axis, self.straight, self.own = find, fields, axis, straight, own
        self.rim_points = rim_points(RIM[straight], straight=straight)

    def to(self, places: Array, target: Array, offset: Array = MIDDLE) -> RayTargets:
        """Every offset and target at every place, the places slowest."""
        per = max(len(target), len(offset))
        nudge, goal = (np.tile(np.broadcast_to(part, (per, 2)), (len(places), 1)) for part in (offset, target))
        return self.find(np.repeat(places, per, axis=0), nudge, goal)

    @cached_property
    def chief(self) -> RayTargets:
        """Rays to the FAP's centre, F."""
        return self.to(self.fields, MIDDLE)

    @cached_property
    def rim(self) -> RayTargets:
        """Rays to its rim, F times `rim_points`."""
        return self.to(self.fields, self.rim_points)

    @cached_property
    def neighbours(self) -> RayTargets:
        """Rays to its centre, from half a pitch left, right, below and above, F times 4."""
        return self.to(self.fields, MIDDLE, CROSS)

    @cached_property
    def axis_rim(self) -> RayTargets:
        """Rays from the axis to the FAP's rim, `rim_points`."""
        return self.to(self.axis[None], self.rim_points)


def thin_targets(camera: Camera, base: Array, offset: Array, target: Array) -> RayTargets:
    """Targets of rays for each of T builds, found from its thin-lens model; builds slowest.

    Parameters as of `FieldRays`.
    """
    builds = camera.shape or (1,)
    half, fap = np.broadcast_to(np.asarray(camera.d / 2), builds), camera.fap.outline
    at = base[:, None] + offset[:, None] * half[:, None]
    microlens = camera.microlens(at[..., 0], at[..., 1])
    point = lens_point(camera, camera.fap, microlens)

    def slopes(step: Array) -> Array:
        ends = point.at(*fap.at_shares(*(target + step).T[:, :, None]))
        ways = ((c - l) / camera.seen.d_1 for c, l in zip(microlens[:2], ends, strict=True))
        return np.stack(np.broadcast_arrays(*ways, np.empty(at.shape[:-1]))[:2], axis=-1)

    start = slopes(np.zeros(2))
    columns = [slopes(way) - start for way in np.eye(2)]
    inverse = np.stack(columns, axis=-1)

    def flat(part: Array) -> Array:
        return np.ascontiguousarray(np.swapaxes(part, 0, 1).reshape(builds[0] * len(base), -1))

    again, aside, goal = (np.tile(part, (builds[0], 1)) for part in (base, offset, target))
    return RayTargets(again, aside, goal, flat(start), flat(inverse.reshape(*inverse.shape[:2], 4)))


class _TracedShapes(NamedTuple):
    """Shapes of images as rims leave them, each (fields, trials); nan where the image is folded."""

    area: Array
    kept_fraction: Array
    axis_ratio: Array

    @property
    def lit(self) -> NDArray[np.bool_]:
        """Whether anything is."""
        return self.kept_fraction > 0


class _Ahead(NamedTuple):
    """Rays in front of all elements, prolonged to the upright plane through the FAP's centre; nan if lost."""

    height: Array
    """(2, T, n) [mm]."""
    slope: Array
    """dx/dz and dy/dz, (2, T, n)."""
    z: Array
    """Place of that plane, (T, 1) [mm]."""

    def at(self, z: Array) -> Array:
        """Points where they cross planes (T, 1) [mm], (n, T, 2)."""
        return np.moveaxis(self.height + self.slope * (z - self.z), (0, 1, 2), (2, 1, 0))


class LensImages(MicrolensImages):
    """Microlens images of T builds behind a real lens: fields of their thin-lens models, all traced instead.

    Parameters
    ----------
    camera : Camera
        Thin-lens models of the builds.
    fields : array_like, (F, 2)
        Microlenses, on the array [mm].
    mount : Mount
        The builds.
    rays : FieldRays
        Rays of those fields.
    folded : ndarray of bool, (F,)
        Fields whose image is folded: it has no outline.
    """

    def __init__(
        self, camera: Camera, fields: ArrayLike, mount: Mount, rays: FieldRays, folded: NDArray[np.bool_]
    ) -> None:
        MicrolensImages.__init__(self, camera, fields)
        self.mount, self.rays, self.folded = mount, rays, folded

    @property
    def trials(self) -> int:
        """T."""
        return len(self.mount.planes.array)

    @cached_property
    def half(self) -> Array:
        """Half the microlens pitch, (T,) [mm]."""
        return np.broadcast_to(np.asarray(self.camera.d, float) / 2, (self.trials,)).copy()

    def _aimed(self, wanted: RayTargets, rays: int) -> AimedRays:
        """Rays of some places, so many each; (T * places, rays), the places running fastest."""
        return aimed(self.mount.train, self.mount.planes, self.half, wanted, rays, own=self.rays.own)

    def _grid(self, column: Array) -> Array:
        """From (T * fields, ...) to (fields, T, ...)."""
        return np.swapaxes(column.reshape(self.trials, -1, *column.shape[1:]), 0, 1)

    @cached_property
    def uncut(self) -> Outlines:
        """Images as if nothing cut them."""
        return self._outlines(self.rays.rim)

    def _outlines(self, rim: RayTargets) -> Outlines:
        """Images by rays to the FAP's rim."""
        return Outlines.of(self._aimed(rim, len(self.rays.rim_points)), straight=self.rays.straight)

    @cached_property
    def chief(self) -> tuple[Number, Number]:
        """Images of the FAP's centre [mm]."""
        x, y = np.moveaxis(self._grid(self._aimed(self.rays.chief, 1).landed[:, 0]), -1, 0)
        return x, y

    @cached_property
    def diameter(self) -> Number:
        """Diameter of the disc as large as the uncut image [mm]; of a rectangle its wider extent along x and y."""
        return self._grid(self.uncut.width)

    @cached_property
    def _neighbours(self) -> Array:
        """Image centres half a pitch left, right, below and above, (fields, T, 4, 2) [mm]."""
        return self._grid(self._aimed(self.rays.neighbours, 4).landed)

    @cached_property
    def pitch(self) -> Number:
        """Distance between neighbouring images [mm]."""
        at = self._neighbours
        across, up = at[..., 1, :] - at[..., 0, :], at[..., 3, :] - at[..., 2, :]
        return np.sqrt(np.abs(across[..., 0] * up[..., 1] - across[..., 1] * up[..., 0]))

    @cached_property
    def illumination(self) -> Number:
        """Light of a microlens against one whose image nothing cuts, on the lens's axis.

        By first order where the lens does not show that one the whole FAP.
        """
        axis = self._outlines(self.rays.axis_rim).shape
        whole = self._etendue(axis, self.rays.axis[None])
        whole = np.where(np.isnan(whole), solid_angle(self.camera), whole)
        return self._etendue(self._lit[0], self.fields) / whole

    def _etendue(self, shape: Array, base: Array) -> Array:
        """Etendue of lit parts (T * n, 6) behind n microlenses (n, 2) [sr], (n, T)."""
        planes = (np.repeat(plane, len(base), axis=0) for plane in self.mount.planes[:2])
        light = etendue_sr(shape, np.tile(base, (self.trials, 1)), *planes)
        return np.asarray(light.reshape(self.trials, -1).T)

    @cached_property
    def clearance(self) -> Number:
        """Room between the pencil and the nearest rim or surface, on that [mm]; negative where it is cut."""
        (own, beyond), planes = (part.radii for part in self.mount.train), self.mount.planes
        radii = np.concatenate([own, planes.lengths, beyond], axis=1)
        room: Array = np.min(radii * (1 - planes.unsquared(self._grid(self.uncut.peaks), own.shape[1])), axis=-1)
        return room + 0 * self.diameter

    @cached_property
    def through_lens(self) -> tuple[Number, Number]:
        """Where straight lines from the middle of the image-side principal plane (Eq. 4) meet the sensor [mm]."""
        plane = self.mount.planes.array
        start = [plane[:, k] + self.x * plane[:, 3 + k] + self.y * plane[:, 6 + k] for k in range(3)]
        run = np.stack([*start[:2], start[2] - self.mount.rear_principal], axis=-1)
        x, y = np.moveaxis(crossings(np.stack(start, axis=-1), run / run[..., 2:], self.mount.planes.sensor), -1, 0)
        return x, y

    @cached_property
    def shapes(self) -> _TracedShapes:  # type: ignore[override]
        """The lit parts."""
        shape, share = self._lit
        xx, xy, yy = shape[:, 3], shape[:, 4], shape[:, 5]
        major = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
        lesser = np.sqrt(np.maximum(xx * yy - xy * xy, 0.0))
        ratio = np.divide(lesser, major, out=np.full_like(major, np.nan), where=major > 0)
        return _TracedShapes(*map(self._grid, (shape[:, 0], share, ratio)))

    @cached_property
    def _lit(self) -> tuple[Array, Array]:
        """Lit shapes (T * fields, 6) and seen parts of the FAP (T * fields,)."""
        camera, trial = self.camera, np.repeat(np.arange(self.trials), len(self.fields))
        base = np.tile(self.fields, (self.trials, 1))
        scale, wide = (
            np.broadcast_to(np.asarray(part), (self.trials,))[trial]
            for part in (camera.seen.d_2 / camera.seen.d_1, camera.D)
        )
        elsewhere = base * (1 + scale)[:, None], 0.6 * wide * np.abs(scale)
        shape, share, *_ = lit_images(self.mount.train, self.mount.planes, base, trial, self.uncut, elsewhere)
        folded = np.tile(self.folded, self.trials)
        shape[folded], share[folded] = np.nan, np.nan
        return shape, share

    @cached_property
    def _chief_ahead(self) -> _Ahead:
        """Chief rays, n fields."""
        return self._ahead(self.x, self.y, *self.chief)

    @cached_property
    def _neighbours_ahead(self) -> _Ahead:
        """Chief rays of neighbouring places, n = 4 F, the fields slowest."""
        x, y = (at[..., None] + self.half[:, None] * CROSS[:, k] for k, at in enumerate((self.x, self.y)))
        rows = (
            np.moveaxis(part, -1, 1).reshape(-1, self.trials) for part in (x, y, *np.moveaxis(self._neighbours, -1, 0))
        )
        return self._ahead(*rows)

    def _ahead(self, x: Number, y: Number, px: Number, py: Number) -> _Ahead:
        """Rays through places of the array and of the sensor, (n, T) each, in their own frames [mm]."""
        array, sensor, fap = self.mount.planes.array, self.mount.planes.sensor, self.mount.planes.rims[:, 0, 2]
        start = np.stack([(array[:, k] + x * array[:, 3 + k] + y * array[:, 6 + k]).T for k in range(3)])
        end = np.stack([(sensor[:, k] + px * sensor[:, 3 + k] + py * sensor[:, 6 + k]).T for k in range(3)])
        run, (lens, beyond) = start - end, self.mount.train
        rays = lens.through(start[:2], run[:2] / run[2], start=start[2], end=fap)
        lost = rays.state != RayFate.KEPT
        if beyond.table.size:
            rays = beyond.through(rays.height, rays.slope, start=fap[:, None], end=fap)
            lost |= rays.state != RayFate.KEPT
        height, slope = (np.where(lost, np.nan, part) for part in rays[:2])
        return _Ahead(height, slope, fap[:, None])

    def _plane(self, at: Number | None) -> Array:
        """Place along z of a plane ahead of the tip, or of the focal plane, in the lens's frame, (T, 1) [mm]."""
        ahead = np.asarray(self.camera[CONJUGATES[1]] if at is None else self.camera.tip + at)
        return np.broadcast_to(self.mount.front_principal - ahead, (self.trials,))[:, None]

    @cached_property
    def points_in_focus(self) -> Array:
        """Where chief rays meet each build's own plane in focus, in the lens's frame [mm], (fields, T, 3)."""
        z = self._plane(None)
        return np.concatenate([met := self._chief_ahead.at(z), np.broadcast_to(z, (*met.shape[:2], 1))], axis=-1)

    def on_plane(self, ahead: Number) -> tuple[Number, Number]:
        """Points where chief rays meet a plane `ahead` of the tip, from the system's axis [mm]; nan if lost."""
        x, y = np.moveaxis(self._chief_ahead.at(self._plane(ahead)) - self.mount.world[:, :2], -1, 0)
        return x, y

    @property
    def directions(self) -> Array:
        """Unit vectors of chief rays away from the bore, in the medium of the scene, (F, T, 3); nan likewise."""
        x, y = np.swapaxes(self._chief_ahead.slope, 1, 2)
        way = np.stack([-x, -y, np.ones_like(x)], axis=-1)
        return np.asarray(way / np.linalg.norm(way, axis=-1, keepdims=True))

    def scales(self, at: Number | None) -> tuple[Number, Number]:
        """Millimetres on a plane ahead of the tip per millimetre on the array, along the field's radius and across it.

        None is the focal plane.
        """
        met = self._neighbours_ahead.at(self._plane(at)).reshape(len(self.fields), 4, self.trials, 2)
        ways = np.stack([met[:, 1] - met[:, 0], met[:, 3] - met[:, 2]], axis=-1) / (2 * self.half[:, None, None])
        (x, y), turn = self.microlens[:2], self.camera["microlens_array.rotation"]
        cos, sin = np.cos(turn), np.sin(turn)
        place = np.stack(np.broadcast_arrays(x * cos + y * sin, y * cos - x * sin), axis=-1)
        radius = np.hypot(place[..., 0], place[..., 1])[..., None]
        way = np.where(radius > 0, place / np.where(radius > 0, radius, 1.0), np.array([1.0, 0.0]))
        aside = np.stack([-way[..., 1], way[..., 0]], axis=-1)
        along, across = (np.linalg.norm(np.einsum("...ij,...j", ways, u), axis=-1) for u in (way, aside))
        return along, across
