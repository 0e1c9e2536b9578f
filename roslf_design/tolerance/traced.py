"""Builds behind a real main lens: every build's own lens is traced, and the metrics rest on its rays.

The lens is as made, everything else where it was put. The decoder believes in the nominal design as traced: a
microlens's image centre is where the nominal lens puts it, a slope means the depth that the nominal lens gives it at
that field. Calibrated on a build, it adds what an affine lattice and targets on the axis tell it of the build.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design import Design
from ..errors import InputError
from ..lenses.aim import (
    Aimed,
    Aims,
    Outlines,
    Planes,
    aimed,
    aims,
    cut_shapes,
    landings,
    outlines,
    pupil_points,
    spot_radii,
)
from ..lenses.builds import LensBuilds, lens_builds
from ..lenses.first_order import first_order
from ..lenses.images import FOLDED, real_images, sensor_of_pupil
from ..lenses.kernels import BLOCK
from ..lenses.manufacture import as_made
from ..lenses.of_design import camera_of, microlenses
from .algebra import Frame, Number, frame
from .camera import DISTANCE, FOCAL, PLANE, Camera, build
from .places import in_lens, nominal_values, of_lens
from .thin import CALIBRATION_DEPTHS, ThinBuilds, fractional

Array = NDArray[np.float64]

STEP = 0.25
"""Between the places that tell how image centres move over the array [mm]."""
SPOT_RADII, SPOT_TURNS = 4, 12
"""Rays that an object point's light is taken by: rings of equal weight by Gauss's rule, and rays on each."""
CHECKED = 4
"""Builds that are traced once more on their own, of the study's own, its first."""
POINTS = 768
"""Of an oracle's boundary: where rims cut an image, its own area is then right to 4e-5."""
METHOD = (
    "Exact rays through every build's own lens, aimed at the FAP; images integrated by Fourier series along the FAP's "
    "rim, and by polynomials of the fifth degree where rims cut them."
)


class Mounted(NamedTuple):
    """T builds of a camera behind a real lens."""

    lens: LensBuilds
    planes: Planes
    camera: Camera
    """Their thin twins: what closed forms of axial distances take."""
    world: Array
    """What the system's frame is shifted by against the lens's [mm], (T, 3)."""


def mounted(design: Design, values: Mapping[str, Array], trials: int) -> Mounted:
    """Where everything stands in builds of a design behind a real lens.

    The lens is missed in itself; the stops, the array and the sensor keep the places that the nominal lens gave them,
    but for their own misses.
    """
    nominal = nominal_values(design)

    def number(place: str) -> Array:
        return values.get(place, np.full(trials, nominal[place]))

    lens_x, lens_y = number("main_lens.decentre.0"), number("main_lens.decentre.1")
    camera, drawn = camera_of(design), design.lens
    assert drawn is not None
    constants = camera.first_order
    lens = lens_builds(
        drawn,
        design.wavelength,
        of_lens(values),
        trials,
        light=values.get("light.wavelength"),
        diameter=values.get("main_lens.diameter"),
        tilt=(number("main_lens.tilt.0"), number("main_lens.tilt.1")),
    )
    d_1 = number(DISTANCE)
    if PLANE in values:  # refocused to it by the nominal lens's constants
        d_1 = design.f * values[PLANE] / (values[PLANE] - design.f)
    mla = constants.rear_principal + d_1
    stops = ["aperture", *(f"stops.{index}" for index in range(len(design.stops)))]
    places = {stop: constants.front_principal - number(f"{stop}.distance") for stop in stops}

    def stands(part: str, z: Array, roll: Number = 0.0) -> Array:
        decentre = (number(f"{part}.decentre.0") - lens_x, number(f"{part}.decentre.1") - lens_y)
        return _row(frame(decentre, z, (number(f"{part}.tilt.0"), number(f"{part}.tilt.1")), roll), trials)

    rims = [
        np.concatenate([stands(stop, places[stop]), number(f"{stop}.diameter")[:, None] / 2], axis=1) for stop in stops
    ]
    planes = Planes(
        stands("microlens_array", mla, number("microlens_array.rotation")),
        stands("sensor", mla + number("sensor.distance")),
        np.stack(rims, axis=1),
    )
    twin = {place: value for place, value in values.items() if not in_lens(place) and place != PLANE}
    twin[FOCAL] = 1 / lens.power
    twin[DISTANCE] = mla - lens.rear_principal
    for stop in stops:
        twin[f"{stop}.distance"] = lens.front_principal - places[stop]
    thin = build(design.thin_twin, twin, trials)
    clear = lens.sound & (mla > lens.rear)
    for stop in stops:
        clear &= places[stop] <= np.minimum(lens.front, camera.front)
    valid = thin.valid & clear
    return Mounted(lens, planes, replace(thin, valid=valid), -np.stack([lens_x, lens_y, 0 * lens_x], axis=-1))


def _row(stands: Frame, trials: int) -> Array:
    row = np.empty((trials, 12))
    for column, value in enumerate((*stands.origin, *stands.x, *stands.y, *stands.z)):
        row[:, column] = value
    return row


def as_built(design: Design, values: Mapping[str, float]) -> Design:
    """One build as a design of its own, whose traced camera is the build.

    Its lens is written out as made; distances then count from that lens's own principal planes.

    Parameters
    ----------
    design : Design
        The nominal design, behind a real lens.
    values : mapping
        Place to number.

    Raises
    ------
    InputError
        The numbers make no camera.
    """
    drawn, constants = design.lens, camera_of(design).first_order
    assert drawn is not None
    nominal = nominal_values(design)
    made = as_made(drawn, of_lens(values), design.wavelength)
    narrowest = 2 * min(surface.semi_diameter for surface in drawn.surfaces)
    if "main_lens.diameter" in values:
        wide = values["main_lens.diameter"] / 2
        cut = [
            replace(s, semi_diameter=wide) if 2 * s.semi_diameter <= narrowest * (1 + 1e-9) else s
            for s in made.surfaces
        ]
        made = replace(made, surfaces=tuple(cut))
    changes: dict[str, object] = {p: v for p, v in values.items() if not in_lens(p) and p not in (DISTANCE, PLANE)}
    own = first_order(made, values.get("light.wavelength", design.wavelength))
    d_1 = values.get(DISTANCE, nominal[DISTANCE])
    if PLANE in values:
        d_1 = design.f * values[PLANE] / (values[PLANE] - design.f)
    changes[DISTANCE] = constants.rear_principal + d_1 - own.rear_principal
    for stop in ("aperture", *(f"stops.{index}" for index in range(len(design.stops)))):
        place = f"{stop}.distance"
        changes[place] = own.front_principal - (constants.front_principal - values.get(place, nominal[place]))
    changes |= {"main_lens.prescription": made, "main_lens.reversed": False, "main_lens.diameter": None}
    return design.replace({**changes, "main_lens.focal_length": None})


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


class TracedBuilds(ThinBuilds):
    """Builds behind a real lens; `ThinBuilds` of their thin twins, with every metric of a field traced instead."""

    def __init__(
        self,
        mount: Mounted,
        known: Reference,
        design: Design,
        fields: Sequence[tuple[float, float]],
        object_distance: float,
        calibrated: bool,
    ) -> None:
        super().__init__(mount.camera, design, fields, object_distance, calibrated)
        self.mount, self.known = mount, known
        self.trials = len(mount.camera.valid)
        self.half = np.broadcast_to(np.asarray(mount.camera.d) / 2, (self.trials,)).copy()

    @classmethod
    def of(
        cls,
        design: Design,
        values: Mapping[str, Array],
        trials: int,
        fields: Sequence[tuple[float, float]],
        object_distance: float,
        calibrated: bool,
    ) -> TracedBuilds:
        """Builds with numbers (trials,) at the places missed."""
        known = reference(design, tuple(fields), object_distance)
        return cls(mounted(design, values, trials), known, design, fields, object_distance, calibrated)

    def _aimed(self, wanted: Aims, rays: int) -> Aimed:
        """Rays of every field of every build, (trials * fields, rays) with the fields running fastest."""
        fields = len(wanted.base) // rays
        together = next(count for count in range(fields, 0, -1) if fields % count == 0 and count * rays <= BLOCK)
        groups = fields // together
        trial = np.repeat(np.arange(self.trials), groups)
        begin = np.tile(np.arange(groups) * together * rays, self.trials)
        found = aimed(self.mount.lens, self.mount.planes, self.half, wanted, trial, begin, together * rays)
        count = self.trials * fields
        return Aimed(*(part.reshape(count, rays, *part.shape[2:]) for part in found))

    def _grid(self, column: Array) -> Array:
        """From (trials * fields, ...) to (fields, trials, ...)."""
        return np.swapaxes(column.reshape(self.trials, -1, *column.shape[1:]), 0, 1)

    @property
    def rim(self) -> Aimed:
        """Rays of the FAP's rim."""
        return self._once("rim", lambda: self._aimed(self.known.rim, len(self.known.rim.base) // len(self.fields)))  # type: ignore[no-any-return]

    @property
    def outline(self) -> Outlines:
        """Images as if nothing cut them."""
        return self._once("outline", lambda: outlines(self.rim))  # type: ignore[no-any-return]

    @property
    def chief(self) -> Array:
        """Images of the FAP's centre [mm], (fields, trials, 2)."""
        return self._once("chief", lambda: self._grid(self._aimed(self.known.chief, 1).landed[:, 0]))  # type: ignore[no-any-return]

    def _image_diameter_mm(self) -> Any:
        return self._grid(2 * np.sqrt(self.outline.shape[:, 0] / np.pi))

    def _image_pitch_mm(self) -> Any:
        found = self._grid(self._aimed(self.known.neighbours, 4).landed)
        across, along = found[..., 1, :] - found[..., 0, :], found[..., 3, :] - found[..., 2, :]
        return np.sqrt(np.abs(across[..., 0] * along[..., 1] - across[..., 1] * along[..., 0]))

    def _non_distortion_room_mm(self) -> Any:
        lens, rims = self.mount.lens, self.mount.planes.rims
        count = lens.media.shape[1] - 1
        semi = np.sqrt(lens.table.reshape(self.trials, count, -1)[:, :, 5])
        radii = np.concatenate([semi, rims[:, 1:, 12]], axis=1)
        peaks = self._grid(self.outline.peaks)
        return np.min(radii * (1 - np.sqrt(peaks)), axis=-1) + 0 * self._image_diameter_mm()

    def _centre_shift_px(self) -> Any:
        """Against the straight line from the middle of the image-side principal plane, which Eq. 4 takes."""
        plane, lens = self.mount.planes.array, self.mount.lens
        lens_at = np.stack(
            [plane[:, k] + self.x * plane[:, 3 + k] + self.y * plane[:, 6 + k] for k in range(3)], axis=-1
        )
        middle = np.zeros((self.trials, 3))
        middle[:, 2] = lens.rear_principal
        run = lens_at - middle
        there = _crossing(lens_at, run / run[..., 2:], self.mount.planes.sensor)
        cos, sin = self.known.azimuth
        x, y = np.moveaxis(there - self.chief, -1, 0)
        return (x * cos + y * sin) / self.camera.q

    def _shapes(self) -> tuple[Array, Array, Array]:
        rim, found = self.rim, self.outline
        shape, share = found.shape.copy(), np.ones(len(found.shape))
        cut = np.flatnonzero(np.any(~(found.peaks <= 1), axis=1))
        if len(cut):
            fields = len(self.fields)
            rays = len(self.known.inner.base) // fields
            trial, field = cut // fields, cut % fields
            inner = aimed(self.mount.lens, self.mount.planes, self.half, self.known.inner, trial, field * rays, rays)
            shape[cut], share[cut] = cut_shapes(
                Aimed(*(part[cut] for part in rim)), inner, Outlines(*(part[cut] for part in found))
            )
        folded = np.tile(self.known.folded, self.trials)
        shape[folded], share[folded] = np.nan, np.nan
        xx, xy, yy = shape[:, 3], shape[:, 4], shape[:, 5]
        major = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
        ratio = np.where(share > 0, np.sqrt(np.maximum(xx * yy - xy * xy, 0.0)) / major, np.nan)
        return self._grid(shape[:, 0]), self._grid(share), self._grid(ratio)

    def _believed(self, x: Any, y: Any) -> Array:
        """Image centres that the decoder believes in [px] for places of the array [mm], (fields, trials, ...)."""
        scale = self.design.d / np.asarray(self.camera.d)
        found = self.known.centres.at(x * scale, y * scale) / self.design.q
        if not self.calibrated:
            return found
        rows = self._once("lattice", self._lattice)
        return np.asarray(found + rows[0] + (x * scale)[..., None] * rows[1] + (y * scale)[..., None] * rows[2])

    def _lattice(self) -> Array:
        """What an affine calibration adds to the nominal centres, (3, trials, 2): at the middle, per mm in x, in y."""
        seen = self._grid(self._aimed(self.known.ends, 1).landed[:, 0]) / np.asarray(self.camera.q)[..., None]
        scale = self.design.d / np.asarray(self.camera.d)
        reach = self.known.reach
        x, y = reach * np.array([[1.0], [-1.0], [0.0], [0.0]]), reach * np.array([[0.0], [0.0], [1.0], [-1.0]])
        off = seen - self.known.end_centres.at(x * scale, y * scale) / self.design.q
        width = 2 * reach * np.broadcast_to(scale, (self.trials,))[:, None]
        return np.stack([(off[0] + off[1]) / 2, (off[0] - off[1]) / width, (off[2] - off[3]) / width])

    def _centre_error(self) -> tuple[Any, Any]:
        x, y = (np.broadcast_to(part, (len(self.fields), self.trials)) for part in (self.x, self.y))
        off = self.chief / np.asarray(self.camera.q)[..., None] - self._believed(x, y)
        return off[..., 0], off[..., 1]

    def _depth_error_mm(self) -> Any:
        known = self.known
        slope = self._slopes(known.points, known.azimuth, self._believed)
        if self.calibrated:
            axis = (np.ones((1, 1)), np.zeros((1, 1)))
            seen = [self._slopes(point[None], axis, self._near_axis) for point in known.axis_points]
            depth = fractional(slope, seen, known.depths)
            slope = np.asarray(fractional(depth, known.depths, tuple(float(value) for value in known.axis_slopes)))
        depths = known.depths
        return fractional(slope, tuple(known.slopes.T[:, :, None]), depths) - self.object_distance

    def _near_axis(self, x: Any, y: Any) -> Array:
        scale = self.design.d / np.asarray(self.camera.d)
        rows = self._once("lattice", self._lattice)
        found = self.known.axis_centres.at(x * scale, y * scale) / self.design.q
        return np.asarray(found + rows[0] + (x * scale)[..., None] * rows[1] + (y * scale)[..., None] * rows[2])

    def _slopes(self, points: Array, azimuth: tuple[Array, Array], centre: Any) -> Array:
        """Slopes between the rays through the FAP's ends [microlenses per pixel], (points, trials)."""
        return epi_slopes(self.mount, points, azimuth, centre)

    def _blur_pitches(self) -> Any:
        mount = self.mount
        nodes, weights = np.polynomial.legendre.leggauss(SPOT_RADII)
        radius, turn = np.sqrt(0.5 + 0.5 * nodes), 2 * np.pi * np.arange(SPOT_TURNS) / SPOT_TURNS
        pupil = np.stack([np.outer(radius, np.cos(turn)).ravel(), np.outer(radius, np.sin(turn)).ravel()], axis=-1)
        weight = np.repeat(weights / 2, SPOT_TURNS) / SPOT_TURNS
        planes, points = mount.planes, self.known.points
        return spot_radii(mount.lens, planes.array, planes.rims, mount.world, points, pupil, weight).T / self.camera.d


def _crossing(point: Array, slope: Array, plane: Array) -> Array:
    """Where lines (fields, trials, 3) cross planes (trials, 12), in their own coordinates, (fields, trials, 2)."""
    off = point - plane[:, :3]
    lean, ahead = np.sum(slope * plane[:, 9:], axis=-1), np.sum(off * plane[:, 9:], axis=-1)
    hit = off - slope * (ahead / lean)[..., None]
    return np.stack([np.sum(hit * plane[:, 3:6], axis=-1), np.sum(hit * plane[:, 6:9], axis=-1)], axis=-1)


@dataclass(frozen=True)
class TraceCheck:
    """Largest differences between the study's metrics and builds traced one at a time, over all its fields."""

    builds: int
    """How many were compared; images undefined in a study are left out."""
    centre_px: float
    """Of image centres [px]."""
    diameter: float
    """Of image diameters, as a share."""
    kept_fraction: float
    """Of the parts of the FAP that are seen."""
    folded: tuple[str, ...] = ()
    """Fields whose nominal image is folded."""

    def notes(self) -> tuple[str, ...]:
        """What a study says of it."""
        if not self.folded:
            return (str(self),)
        where = ", ".join(self.folded)
        shape = f"the nominal image at {where} is folded (a caustic lies in it): its shape is undefined in every trial"
        return str(self), shape

    def __str__(self) -> str:
        return (
            f"{METHOD} {self.builds} builds traced one at a time differ by up to {self.centre_px:.1g} px in image "
            f"centres, {self.diameter:.1g} of image diameters and {self.kept_fraction:.1g} in kept fractions"
        )

    def to_dict(self) -> dict[str, Any]:
        """For the JSON object."""
        return {
            "method": METHOD,
            "builds_compared": self.builds,
            "largest_difference": {
                "image_centre_px": self.centre_px,
                "image_diameter_share": self.diameter,
                "kept_fraction": self.kept_fraction,
            },
        }


def check_traced(
    design: Design, fields: tuple[tuple[float, float], ...], object_distance: float, values: Mapping[str, Array]
) -> TraceCheck:
    """Trace builds of a question one at a time; `values` has their numbers at each place, shape (builds,)."""
    count = len(next(iter(values.values())))
    centre, diameter, kept, compared = 0.0, 0.0, 0.0, 0
    with np.errstate(all="ignore"):
        builds = TracedBuilds.of(design, values, count, fields, object_distance, False)
        chief, sizes, shares = builds.chief, builds.value("image_diameter_mm"), builds.value("kept_fraction")
    for trial in range(count):
        try:
            one = as_built(design, {place: float(numbers[trial]) for place, numbers in values.items()})
            images = real_images(camera_of(one), microlenses(one, fields), points=POINTS)
        except InputError:
            continue  # no camera; the study says so too
        compared += 1
        there = microlenses(one, fields) + images.chief - np.subtract(one.sensor.decentre, one.main_lens.decentre)
        centre = max(centre, _largest(there - chief[:, trial]) / one.q)
        diameter = max(diameter, _largest(images.diameter / sizes[:, trial] - 1))
        kept = max(kept, _largest(images.kept_fraction - shares[:, trial]))
    folded = builds.known.folded
    dark = tuple(f"{x:g}, {y:g} mm" for (x, y), bad in zip(fields, folded, strict=True) if bad)
    return TraceCheck(compared, centre, diameter, kept, dark)


def _largest(off: Array) -> float:
    return float(np.max(np.abs(off[np.isfinite(off)]), initial=0.0))
