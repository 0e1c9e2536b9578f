"""Builds behind a real main lens: every build's own lens is traced, and the metrics rest on its rays.

The lens is as made, everything else where it was put. The decoder believes in the nominal design as traced: a
microlens's image centre is where the nominal lens puts it, a slope means the depth that the nominal lens gives it at
that field. Calibrated on a build, it adds what an affine lattice and targets on the axis tell it of the build.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property, lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import Array
from ..bore.conjugates import CONJUGATES
from ..bore.main_lens import HIATUS
from ..bore.opening import ClearAperture
from ..bore.part import TEMPERATURE
from ..camera import BESIDE, Camera, Number
from ..camera.frames import frame
from ..design import Design
from ..design.parts import PATHS
from ..fates import ImageFate
from ..lenses.manufacture import LensBuilds, as_made, lens_builds
from ..lenses.prescription import first_order
from ..theory.light import on_array
from ..theory.object_space import ObjectSpaceFaces
from ..traced.camera import camera_of, microlenses, nominal_targets, sensor_of_pupil
from ..traced.images import real_images
from ..traced.microlens import CROSS, MIDDLE, FieldRays, LensImages, Mount, thin_targets
from ..traced.train import Planes, RayTargets, Train, aimed, landings, rim_row, spot_radii
from .ideal import IdealBuilds, azimuths, fractional
from .places import in_lens, nominal_values, of_lens, of_parts, stops_of

FOCAL, PLANE, DISTANCE = CONJUGATES
STEP = 0.25
"""Between the places that tell how image centres move over the array [mm]."""
ORIGIN = np.zeros((1, 3))
STENCIL = np.array([[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, 1], [-1, 1], [1, -1]])
ALONG_X = np.ones((1, 1)), np.zeros((1, 1))
"""Direction along which views of targets on the axis are taken."""
SPOT_RADII, SPOT_TURNS, SPOT_SIDE = 4, 12, 7
"""Rays that an object point's light is taken by: rings of equal weight by Gauss's rule, and rays on each; through
straight sides rows by Gauss's rule, and as many rays on each."""
METHOD = (
    "Exact rays through every build's own lens, aimed at the FAP; images integrated by Fourier series along the FAP's "
    "rim, and between corners where rims cut them."
)

AS_IF_THIN = {
    "undistorted_field_mm": "what the lens's aberrations cut; hold non_distortion_room_mm at a field instead",
    "centre_shift_px_per_microlens": "how it differs over the field; take centre_shift_px at a field instead",
}
"""Quantities whose formulas would leave out what a real lens is asked about, and what they leave out."""


class _RealLensBuilds(NamedTuple):
    """T builds of a camera behind a real lens."""

    lens: LensBuilds
    mount: Mount
    thin_equivalents: dict[str, Array]
    """Where the numbers of their thin-lens models differ from the nominal design's: what closed forms take."""
    sound: NDArray[np.bool_]
    """True where a build can be put together, (T,)."""


def real_lens_builds(design: Design, values: Mapping[str, Array], trials: int) -> _RealLensBuilds:
    """Where everything stands in builds of a design behind a real lens.

    The lens is missed in itself; the stops, the elements, the array and the sensor keep the places that the nominal
    lens gave them, but for their own misses.
    """
    nominal, camera, drawn = nominal_values(design), camera_of(design), design.lens
    assert drawn is not None
    warmth, diameter = None, values.get(PATHS["D"])
    if TEMPERATURE in values and design.environment is not None:
        warmth = values[TEMPERATURE], design.environment.expansion
        values = {**values, **_warmed(design, values)}

    def number(place: str) -> Array:
        return values.get(place, np.full(trials, nominal[place]))

    def pair(name: str) -> tuple[Array, Array]:
        return number(f"{name}.0"), number(f"{name}.1")

    lens = lens_builds(
        drawn,
        design.wavelength,
        of_lens(values),
        trials,
        light=values.get("light.wavelength"),
        diameter=diameter,
        tilt=pair("main_lens.tilt"),
        warmth=warmth,
    )
    around, front = _around(design, values), camera.first_order.front_principal
    mla = camera.first_order.rear_principal + _mla_distance(around, values, number(DISTANCE))
    chain, known = around.chain, around.numbers
    before, behind = chain.before_array(known), chain.behind_array(known)
    fronts = {at.place: front - number(f"{at.place}.distance") for at in design.placed}
    lens_x, lens_y = pair("main_lens.decentre")

    def placed(part: str, z: Array, roll: Number = 0.0) -> Array:
        x, y = pair(f"{part}.decentre")
        pose = frame((x - lens_x, y - lens_y), z, pair(f"{part}.tilt"), roll)
        return np.column_stack([np.broadcast_to(part, trials) for vector in pose for part in vector])

    numbers: dict[str, Number] = {**nominal, **values}
    rims = [rim_row(placed(stop, fronts[stop]), ClearAperture.of(numbers, stop)) for stop in stops_of(design)]
    planes = Planes(
        placed("microlens_array", mla - before, number("microlens_array.rotation")),
        placed("sensor", mla - before + (number("sensor.distance") - behind)),
        np.stack(rims[: 1 if design.elements else None], axis=1),
    )
    origin = np.stack([-lens_x, -lens_y, np.full(trials, front)], axis=-1)
    train = Train.of(lens.stack, ObjectSpaceFaces.of(around), origin) if design.elements else Train.in_air(lens.stack)
    twins = {place: value for place, value in values.items() if not in_lens(place) and place != PLANE}
    twins |= {FOCAL: 1 / lens.power, DISTANCE: mla - lens.rear_principal}
    twins[HIATUS] = lens.rear_principal - lens.front_principal
    twins |= {f"{part}.distance": lens.front_principal - z for part, z in fronts.items()}
    sound = lens.sound & (mla - before > lens.rear)
    for part, z in fronts.items():
        image = (part == "aperture") & (number("aperture.distance") < 0)  # which is nowhere in the way
        sound = sound & ((z <= np.minimum(lens.front, camera.front)) | (image & (z > lens.front_principal)))
    world = -np.stack([lens_x, lens_y, 0 * lens_x], axis=-1)
    mount = Mount(train, planes, lens.front_principal, lens.rear_principal, world)
    return _RealLensBuilds(lens, mount, twins, sound)


def _warmed(design: Design, values: Mapping[str, Array]) -> dict[str, Array]:
    """Places of the parts around the lens at the temperatures of builds; the lens's own stay."""
    camera = Camera.of(design)
    assert camera.growth is not None
    numbers = {**camera.numbers, **{place: value for place, value in values.items() if not in_lens(place)}}
    moved = camera.growth.moved(numbers, camera[TEMPERATURE], values[TEMPERATURE], lens_stays=True)
    trials = np.shape(values[TEMPERATURE])
    around = {place: value for place, value in moved.items() if place not in (FOCAL, *BESIDE)}
    return {place: np.broadcast_to(value, trials).copy() for place, value in around.items()}


def _around(design: Design, values: Mapping[str, Any]) -> Camera:
    """Camera around the nominal lens, its object-side principal plane at 0; the lens and the focus as drawn."""
    changed = {place: value for place, value in values.items() if not in_lens(place) and place not in CONJUGATES}
    return Camera.of(design.thin_twin).as_measured.replace(changed)


def _mla_distance(around: Camera, values: Mapping[str, Any], given: Any) -> Any:
    """d_1 as given, or refocused to a focal plane by the nominal lens's constants [mm]."""
    if PLANE not in values:
        return given
    numbers = {**around.numbers, PLANE: values[PLANE]}
    return around.chain.followed(numbers, DISTANCE)


def as_built(design: Design, values: Mapping[str, float]) -> Design:
    """One build, by its number at each place, as a design of its own, whose traced camera is the build.

    Its lens is written out as made; distances then count from that lens's own principal planes.

    Raises
    ------
    InputError
        The numbers make no camera.
    """
    drawn, constants = design.lens, camera_of(design).first_order
    assert drawn is not None
    nominal, values = nominal_values(design), of_parts(design, values)
    made = as_made(drawn, of_lens(values), design.wavelength)
    if "main_lens.diameter" in values:
        wide, narrowest = values["main_lens.diameter"] / 2, min(surface.semi_diameter for surface in drawn.surfaces)
        narrow = (surface.semi_diameter <= narrowest * (1 + 1e-9) for surface in made.surfaces)
        cut = (replace(s, semi_diameter=wide) if bare else s for s, bare in zip(made.surfaces, narrow, strict=True))
        made = replace(made, surfaces=tuple(cut))
    changes: dict[str, object] = {p: v for p, v in values.items() if not in_lens(p) and p not in (DISTANCE, PLANE)}
    own = first_order(made, values.get("light.wavelength", design.wavelength))
    d_1 = _mla_distance(_around(design, values), values, values.get(DISTANCE, nominal[DISTANCE]))
    changes[DISTANCE] = constants.rear_principal + d_1 - own.rear_principal
    for place in (f"{at.place}.distance" for at in design.placed):
        changes[place] = own.front_principal - (constants.front_principal - values.get(place, nominal[place]))
    changes |= {"main_lens.prescription": made, "main_lens.reversed": False, "main_lens.diameter": None}
    temperature = changes.pop(TEMPERATURE, None)
    built = design.replace({**changes, "main_lens.focal_length": None})
    return built if temperature is None else built.replace({TEMPERATURE: temperature})


class _LocalMaps(NamedTuple):
    """Image centres about n places of the array, to second order [mm]."""

    place: Array
    """(n, 2)."""
    terms: Array
    """Coefficients of 1, u, v, u^2, u v and v^2, the steps from the place, (n, 6, 2)."""

    def at(self, x: Array, y: Array) -> Array:
        """Image centres at places (n, T) of the array, (n, T, 2)."""
        u, v = x - self.place[:, :1], y - self.place[:, 1:]
        return np.asarray(np.einsum("knt,nkc->ntc", np.array([np.ones_like(u), u, v, u * u, u * v, v * v]), self.terms))


class _Reference(NamedTuple):
    """All that builds of one question share: rays in the nominal camera, and what its decoder knows. F fields."""

    rays: FieldRays
    ends: Array
    """Ends of both axes of the array at `IdealBuilds.reach`, (4, 2) [mm]."""
    end_rays: RayTargets
    """Rays from there to the FAP's centre."""
    folded: NDArray[np.bool_]
    """Fields whose nominal image is folded: it has no outline, (F,)."""
    points: Array
    """Object points that nominal chief rays meet at the object's distance, in the system's frame [mm], (F, 3)."""
    axis_points: Array
    """Points on the axis at the depths of a calibration, (3, 3)."""
    centres: _LocalMaps
    end_centres: _LocalMaps
    axis_centres: _LocalMaps
    slopes: Array
    """Nominal slopes at those depths along each field's chief ray, (F, 3)."""
    axis_slopes: Array
    """Slopes on the axis, (3,)."""


@lru_cache(maxsize=8)
def reference(
    design: Design, fields: tuple[tuple[float, float], ...], reach: float, distance: float, depths: tuple[float, ...]
) -> _Reference:
    """Trace the nominal camera of a question; arguments as `TracedBuilds` has them."""
    camera, at = camera_of(design), np.array(fields, float).reshape(-1, 2)
    mount, thin = Mount.of(design), Camera.of(design)
    on_lens, straight = on_array(thin, np.zeros(2)), camera.fap.straight
    rays = FieldRays(partial(nominal_targets, design), at, on_lens, straight=straight)

    def centres(place: Array) -> _LocalMaps:
        wanted = rays.to((place[:, None] + STEP * STENCIL).reshape(-1, 2), MIDDLE)
        landed = aimed(mount.train, mount.planes, np.array([design.d / 2]), wanted, 1).landed
        o, w, e, s, n, sw, ne, nw, se = np.moveaxis(landed.reshape(-1, 9, 2), 1, 0)
        bends = (e - 2 * o + w) / 2, (ne + sw - nw - se) / 4, (n - 2 * o + s) / 2
        terms = o, (e - w) / 2 / STEP, (n - s) / 2 / STEP, *(bend / STEP**2 for bend in bends)
        return _LocalMaps(place, np.stack(terms, axis=1))

    front = camera.first_order.front_principal

    def along_chief(depth: float) -> Array:
        chief = sensor_of_pupil(camera, microlenses(design, at), np.array([camera.fap.x, camera.fap.y]))
        aside = chief.views.at(depth - design.d_3) + np.asarray(design.main_lens.decentre)
        aside[~chief.ok] = np.nan
        return np.concatenate([aside, np.full((len(at), 1), front - depth)], axis=1)

    def slopes(points: Array, azimuth: tuple[Array, Array], maps: _LocalMaps) -> Array:
        return _epi_slopes(mount, thin, points, azimuth, lambda x, y: maps.at(x, y) / design.q)[:, 0]

    near, axis = centres(at), centres(MIDDLE)
    on_axis = np.array([[0.0, 0.0, front - depth] for depth in depths])
    ends = -reach * CROSS
    return _Reference(
        rays=rays,
        ends=ends,
        end_rays=rays.to(ends, MIDDLE),
        folded=folded(design, at),
        points=along_chief(distance),
        axis_points=on_axis,
        centres=near,
        end_centres=centres(ends),
        axis_centres=axis,
        slopes=np.stack([slopes(along_chief(z), azimuths(at[:, :1], at[:, 1:]), near) for z in depths], axis=-1),
        axis_slopes=np.concatenate([slopes(point[None], ALONG_X, axis) for point in on_axis]),
    )


def fates(design: Design, fields: ArrayLike) -> NDArray[np.int64]:
    """Fates of the nominal images at fields (F, 2) [mm], (F,)."""
    return np.asarray(real_images(camera_of(design), microlenses(design, np.asarray(fields))).status)


def folded(design: Design, fields: ArrayLike) -> NDArray[np.bool_]:
    """Whether the nominal images at fields (F, 2) [mm] are folded, (F,)."""
    return np.asarray(fates(design, fields) == ImageFate.FOLDED)


def notes(design: Design, fields: Sequence[tuple[float, float]]) -> tuple[str, ...]:
    """How builds behind a real lens are traced, and where their images have no shape; nothing behind an ideal one."""
    if design.lens is None:
        return ()
    where = ", ".join(f"{x:g}, {y:g} mm" for (x, y), odd in zip(fields, folded(design, fields), strict=True) if odd)
    shape = f"the nominal image at {where} is folded (a caustic lies in it): its shape is undefined in every trial"
    return (METHOD, shape) if where else (METHOD,)


def _epi_slopes(
    mount: Mount,
    camera: Camera,
    points: Array,
    azimuth: tuple[Array, Array],
    centre: Callable[[Array, Array], Array],
) -> Array:
    """Slopes between points' rays through the FAP's two ends, as a decoder has them [microlenses per pixel], (n, T).

    Of points (n, 3) in the system's frame and directions of the ends (n, 1), by T builds and their thin-lens models;
    `centre` takes places on the array (n, T) [mm] to the image centres believed in [px], (n, T, 2).
    """
    cos, sin = azimuth
    fap = camera.fap.outline
    way = np.stack(np.broadcast_arrays(*fap.shares(*fap.rim(cos, sin))), axis=-1).swapaxes(0, 1)
    ends = np.concatenate([way, -way], axis=1)
    met = landings(mount.train, mount.planes, mount.world, np.concatenate([points, points]), ends)
    (u0, v0, x0, y0), (u1, v1, x1, y1) = (np.moveaxis(end, (0, 1), (2, 1)) for end in np.split(met, 2, axis=1))
    (s0, t0), (s1, t1) = (np.moveaxis(centre(u, v), -1, 0) for u, v in ((u0, v0), (u1, v1)))
    across = ((x0 / camera.q - s0) - (x1 / camera.q - s1)) * cos + ((y0 / camera.q - t0) - (y1 / camera.q - t1)) * sin
    return np.asarray(((u0 - u1) * cos + (v0 - v1) * sin) / camera.d / across)


class TracedBuilds(LensImages, IdealBuilds):
    """Builds (`made`) of a design behind a real lens, and what its decoder makes of them.

    `afresh` is for builds far from the nominal camera, whose rays are then no place to start from, and whose images are
    not folded because its are.
    """

    def __init__(
        self,
        design: Design,
        made: _RealLensBuilds,
        camera: Camera,
        fields: tuple[tuple[float, float], ...],
        object_distance: float,
        calibrated: bool,
        strays: tuple[Number, Number] | None = None,
        afresh: bool = False,
    ) -> None:
        IdealBuilds.__init__(self, camera, Camera.of(design), fields, object_distance, calibrated, strays)
        self.made = made
        self.known = known = reference(design, fields, self.reach, object_distance, self.calibration_depths)
        rays, folded = known.rays, known.folded
        if afresh:
            rays = FieldRays(partial(thin_targets, camera), rays.fields, rays.axis, straight=rays.straight, own=True)
            folded = np.zeros_like(folded)
        LensImages.__init__(self, camera, fields, made.mount, rays, folded)

    def _believed(self, maps: _LocalMaps) -> Callable[[Array, Array], Array]:
        """Image centres that the decoder believes in [px] at places of the array [mm], near those of some maps."""
        scale = self.nominal.d / np.asarray(self.camera.d)

        def centre(x: Array, y: Array) -> Array:
            at = maps.at(x * scale, y * scale) / self.nominal.q
            if not self.calibrated:
                return at
            rows = self.correction
            return np.asarray(at + rows[0] + (x * scale)[..., None] * rows[1] + (y * scale)[..., None] * rows[2])

        return centre

    @cached_property
    def correction(self) -> Array:
        """Corrections of an affine calibration to the nominal centres, (3, trials, 2).

        At the middle, per mm in x, in y.
        """
        wanted = self.rays.to(self.known.ends, MIDDLE) if self.rays.own else self.known.end_rays
        landed = self._aimed(wanted, 1).landed[:, 0]
        at = self._grid(landed) / np.asarray(self.camera.q)[..., None]
        scale = np.broadcast_to(self.nominal.d / np.asarray(self.camera.d), (self.trials,))
        x, y = (self.reach * np.array(way)[:, None] for way in ((1.0, -1.0, 0.0, 0.0), (0.0, 0.0, 1.0, -1.0)))
        off = at - self.known.end_centres.at(x * scale, y * scale) / self.nominal.q
        width = 2 * self.reach * scale[:, None]
        return np.stack([(off[0] + off[1]) / 2, (off[0] - off[1]) / width, (off[2] - off[3]) / width])

    @cached_property
    def centre_error(self) -> tuple[Number, Number]:
        """Image centres less where the decoder believes them [px]."""
        x, y = (np.broadcast_to(part, (len(self.fields), self.trials)) for part in (self.x, self.y))
        believed = self._believed(self.known.centres)(x, y)
        off = (at / self.camera.q - believed[..., axis] for axis, at in enumerate(self.chief))
        return self._strayed(*off)

    @cached_property
    def depth_error_mm(self) -> Number:
        """Decoded depth less true depth of the targets [mm]; slopes mean what they do in the nominal camera."""
        known, depths = self.known, self.calibration_depths
        slope: Number = self._traced_slopes(known.points, self.azimuth, known.centres)
        if self.calibrated:
            own = [self._traced_slopes(point[None], ALONG_X, known.axis_centres) for point in known.axis_points]
            slope = fractional(fractional(slope, own, depths), depths, tuple(known.axis_slopes.tolist()))
        return fractional(slope, tuple(known.slopes.T[:, :, None]), depths) - self.object_distance

    def _traced_slopes(self, points: Array, azimuth: tuple[Array, Array], maps: _LocalMaps) -> Array:
        return _epi_slopes(self.mount, self.camera, points, azimuth, self._believed(maps))

    @cached_property
    def blur_pitches(self) -> Number:
        """Root-mean-square radius on the array of the targets' light [microlens pitches]."""
        return self._spot_radii(self.known.points, self.mount.world) / self.camera.d

    @cached_property
    def spot_pitches(self) -> Number:
        """Spot radius [pitches] of the points in each build's focus that its own chief rays come from."""
        points = self.points_in_focus
        known = np.asarray(np.isfinite(points).all(axis=-1))
        rows = [self._spot_radii(ORIGIN, point)[0] for point in np.where(known[..., None], points, 0.0)]
        return np.where(known, np.stack(rows), np.nan) / self.camera.d

    def _spot_radii(self, points: Array, world: Array) -> Array:
        """Spot radii of object points (n, 3) in frames shifted by `world`, (n, T) [mm]."""
        planes = self.mount.planes
        pupil = _pupil_rule(self.rays.straight)
        return spot_radii(self.mount.train, planes.array, planes.rims, world, points, *pupil).T


@cache
def _pupil_rule(straight: bool) -> tuple[Array, Array]:
    """Points of the FAP by their shares of its opening, (P, 2), and their weights, (P,)."""
    if straight:
        nodes, weights = np.polynomial.legendre.leggauss(SPOT_SIDE)
        return np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2), np.outer(weights, weights).ravel() / 4
    nodes, weights = np.polynomial.legendre.leggauss(SPOT_RADII)
    radius, turn = np.sqrt(0.5 + 0.5 * nodes), 2 * np.pi * np.arange(SPOT_TURNS) / SPOT_TURNS
    pupil = np.stack([np.outer(radius, np.cos(turn)).ravel(), np.outer(radius, np.sin(turn)).ravel()], axis=-1)
    return pupil, np.repeat(weights / 2, SPOT_TURNS) / SPOT_TURNS
