"""Simulated measurement of a scene: its picture with noise, decoded, disparity and depth of every microlens."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._arrays import product, ratio
from ..calibration.decoding import Decoder, LightField
from ..calibration.frames import ColourBalance
from ..calibration.lattice import CentreLattice
from ..camera import Camera
from ..design import Design
from ..effects.waves import add_noise
from ..errors import InputError, Problem
from ..evaluation import evaluate
from ..imaging.camera import Region
from ..imaging.render import RawImage
from ..imaging.sampling import rays_for
from ..imaging.surfaces import seen_distances
from ..json_data import plain
from ..progress import part_of
from ..scenes import Noise, Scene, Sphere
from ..tables import BriefValue
from ..theory.colours import filters
from ..theory.disparity_error import disparity_sigma
from ..theory.disparity_information import Seen
from ..theory.photometry import FILLED, NOTHING, dark_variance, electrons, veil_electrons
from ..theory.stop_images import MicrolensImages
from .bends import straightened
from .crosstalk import with_shared_light
from .dense import DenseMap
from .estimate import DisparityMap, DisparityStatus, PixelNoise, Start, estimate_disparity
from .geometry import ArrayGeometry, ViewGeometry, Viewing, disparity_of, sigma_of
from .pictures import (
    SLANT,
    Framed,
    PictureOptions,
    Unexposed,
    Work,
    chief_rays,
    default_scene,
    in_scene_light,
    lattice_of,
    light_on,
)
from .sphere import SphereFit
from .traced_views import TracedViews
from .unmixing import places_on_array
from .windows import QUORUM

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SEEN, BLACK = 2.0, 0.01
"""Microlenses a period below which texture aliases; share of it that may be black, cut off where no light is."""
EXACTLY, ABOUT = 1.001, 1.03
"""How many times finer a texture is counted as at that edge: by rounding alone, and not surely beyond it."""
HELD = 0.9
"""Part of the full well that the brightest pixels may hold: light of images that overlap adds up."""
MARGIN = 0.5
"""Disparities searched beyond those of the scene [pitches]."""
POINTS = 2000
"""Microlenses that a result tells one by one."""
LEAST = 5
"""Microlenses along each side of the smallest light field that is measured."""
DIRECTIONS = 6
"""Directions of a texture whose errors behind a real lens are averaged."""
PREDICTED = 8
"""Fields along each axis at which the error is predicted."""


FLAT = 2.0
"""Rms distance from the best plane, or sphere, over the standard error up to which a scene is taken for one."""
BEYOND = 100
"""Among `REASONS`: a disparity that nothing at a distance has."""
REASONS = {status.value: status.reason for status in DisparityStatus} | {BEYOND: "behind infinity, by its disparity"}
"""Reasons why a microlens has a depth (0) or none."""


class Prediction(NamedTuple):
    """Standard errors as light, veil, noise and texture allow them, at some microlenses."""

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    disparity: Array
    """[pitches]"""
    depth: Array
    """[mm]"""


class Flatness(NamedTuple):
    """Depths against the plane that fits them best."""

    rms: float
    """RMS in the unit of depths."""
    inside_68: float
    """Share within the standard errors for noise reported with each: 0.68 of a plane."""


@dataclass(frozen=True, eq=False)
class Depths:
    """Depth of every microlens. Arrays have the shape (v, u) of the light field's views."""

    geometry: ViewGeometry
    """Geometry that gave the depths of `disparities`; depths and errors have its unit."""
    field: LightField
    pupil: NDArray[np.floating]
    """Where on the FAP each view's light passed, as `estimate_disparity` takes it."""
    aside: NDArray[np.floating] | None
    """How far views see to the side, by faults of lens and elements and past the microlenses' middles, likewise."""
    disparities: DisparityMap
    x_ml: Array
    """Places of the microlenses on the array [mm], or of the views' pixels [px], shape (v, u, 2)."""
    depth: Array
    """Z from the main lens, along its axis [mm]; NaN where `disparities` has none."""
    noise_sigma: Array
    """Standard error for light, texture and matching, each microlens's own; inf there."""
    calibration_sigma: Array | None = None
    """Standard error for what calibration leaves open, common to all; NaN there. None of a camera taken as exact."""

    @property
    def sigma(self) -> Array:
        """Standard error of both together; inf where there is no depth."""
        if self.calibration_sigma is None:
            return self.noise_sigma
        known = np.isfinite(self.noise_sigma)
        return np.where(known, np.hypot(self.noise_sigma, np.where(known, self.calibration_sigma, 0)), np.inf)

    def within(self, rows: slice, columns: slice) -> Depths:
        """A part of them."""
        part = (..., rows, columns)
        field = replace(
            self.field, values=self.field.values[part], weight=self.field.weight[part], u=self.field.u[columns],
            v=self.field.v[rows], hexagonal=None, between=None,
        )  # fmt: skip
        pupil = self.pupil if self.pupil.ndim == 3 else self.pupil[part]
        aside = self.aside if self.aside is None or self.aside.ndim == 3 else self.aside[part]
        calibrated = None if self.calibration_sigma is None else self.calibration_sigma[part]
        return Depths(
            self.geometry, field, pupil, aside, self.disparities.within(rows, columns), self.x_ml[rows, columns],
            self.depth[part], self.noise_sigma[part], calibrated,
        )  # fmt: skip

    def flatness(self) -> Flatness | None:
        """How nearly a plane it is; None of a few microlenses. A plane's disparity is linear over the array."""
        known = self.measured
        if known.sum() < self.disparities.window**2:
            return None
        v, u = np.nonzero(known)
        disparity, weight = self.disparities.disparity[known], 1 / self.disparities.sigma[known]
        columns = np.stack([np.ones(u.size), self.field.u[u], self.field.v[v]], -1)
        plane = np.linalg.lstsq(columns * weight[:, None], disparity * weight, rcond=None)[0]
        off = disparity - columns @ plane
        rms = self.geometry.sigma(self.depth[known], np.abs(off))
        return Flatness(float(np.sqrt((rms**2).mean())), float((np.abs(off) * weight < 1).mean()))

    @cached_property
    def points(self) -> Array | None:
        """x, y and Z of what chief rays meet [mm], shape (v, u, 3); None where no camera is known."""
        if not isinstance(self.geometry, ArrayGeometry):
            return None
        x, y, along, down = np.moveaxis(
            chief_rays(self.geometry.camera, self.geometry.traced, self.x_ml.reshape(-1, 2)), -1, 0
        ).reshape(4, *self.depth.shape)
        return np.stack([x - along * self.depth, y - down * self.depth, self.depth], -1)

    def sphere(self) -> SphereFit | None:
        """The sphere that fits best; None of a few microlenses, or where no camera is known."""
        known = self.measured
        if self.points is None:
            return None
        return SphereFit.of(self.points[known], self.noise_sigma[known], float(self.disparities.window**2))

    @property
    def views_aside(self) -> Array:
        """Microlenses by which views look aside of one another at most, by faults of lens and elements."""
        if self.aside is None or self.aside.ndim == 3:
            return np.zeros(self.depth.shape)
        lit = self.field.weight > 0
        low, high = (end(self.aside, (1, 2), initial=0.0, where=lit) for end in (np.min, np.max))
        return np.asarray(np.hypot(*(high - low)))

    @property
    def measured(self) -> Flags:
        """True where there is a depth."""
        return np.asarray(self.disparities.measured & np.isfinite(self.depth))

    @property
    def status(self) -> NDArray[np.uint8]:
        """Why each microlens has a depth or none, a number of `REASONS`, shape (v, u)."""
        return np.where(self.disparities.measured & ~self.measured, BEYOND, self.disparities.status).astype(np.uint8)

    @cached_property
    def filled(self) -> DenseMap:
        """Disparities of all microlenses; where `disparities` has none, from the known ones nearby."""
        found = self.disparities
        return DenseMap.of(found.disparity, found.sigma, self.measured, found.picture)

    @property
    def dense(self) -> Array:
        """`depth`, and where there is none a fill from the known ones; NaN far from all of them."""
        return np.where(self.measured, self.depth, self.geometry.depth(self.filled.disparity))

    @property
    def dense_sigma(self) -> Array:
        """Standard error of `dense`, of fills as places held out have it; inf where there is none."""
        dense = self.dense
        some = np.isfinite(dense) & ~self.measured
        own = self.geometry.sigma(np.where(some, dense, np.nan), np.where(some, self.filled.sigma, np.nan))
        common = self.geometry.calibration_sigma(np.where(some, dense, np.nan))
        whole = own if common is None else np.hypot(own, common)
        return np.where(some, np.nan_to_num(whole, nan=np.inf), self.sigma)

    def dense_told(self) -> dict[str, float | None]:
        """Share filled in, rms of the errors reported there, and what places held out say of disparities [pitches]."""
        some = np.isfinite(self.dense_sigma) & ~self.measured
        rms = float(np.sqrt((self.dense_sigma[some] ** 2).mean())) if some.any() else None
        held_out, within = (value if math.isfinite(value) else None for value in self.filled[2:])
        return {
            "filled": float(some.mean()),
            f"told_{self.geometry.unit}": rms,
            "held_out_pitches": held_out,
            "held_out_inside_68": within,
        }

    def unknown(self) -> dict[str, float]:
        """Shares of the microlenses without a depth, by reason."""
        codes, counts = np.unique(self.status[~self.measured], return_counts=True)
        shares = zip(codes.tolist(), (counts / self.depth.size).tolist(), strict=True)
        return {REASONS[code]: share for code, share in shares}


@dataclass(frozen=True)
class Summary:
    """How estimates compare with the truth and with prediction, over all microlenses measured."""

    bias_mm: float | None
    """Mean error."""
    spread_mm: float | None
    """Rms of errors about each microlens's mean over exposures; of one exposure about the mean error."""
    predicted_mm: float | None
    """Rms of the standard errors predicted from light, noise and texture."""
    told_mm: float | None
    """Rms of the standard errors reported with the estimates."""
    inside_68: float | None
    """Share of the errors below the standard errors reported: 0.68 where these are right."""
    beyond_5: float | None
    """Share of the errors beyond five of the standard errors reported: nearly none where these are right."""
    measured: float
    """Share of the microlenses with a depth."""


@dataclass(frozen=True, eq=False)
class Measurement(BriefValue):
    """Depths of one or more exposures of the same, with the truth and the prediction as far as they are known."""

    runs: tuple[Depths, ...]
    """Depths of each exposure."""
    true: Array
    """Z that each microlens's chief ray meets, shape (v, u) [mm]; NaN where it meets nothing, or nothing is known."""
    prediction: Prediction | None

    def __str__(self) -> str:
        told = {name: value for name, value in asdict(self.summary()).items() if value is not None}
        return f"Depth in {len(self.runs)} pictures: {', '.join(f'{name} {told[name]:.3g}' for name in told)}"

    @property
    def first(self) -> Depths:
        """Depths from the first exposure."""
        return self.runs[0]

    @cached_property
    def sphere(self) -> SphereFit | None:
        """The sphere that the first exposure's depths are taken for, as surely as they tell one; None of others."""
        fit, some = self.first.sphere(), self.first.measured
        if fit is None or not fit.told or fit.rms >= FLAT * float(np.median(self.first.noise_sigma[some])):
            return None
        return fit

    @property
    def compared(self) -> Flags:
        """Where every exposure gave a depth and there is a truth, away from the edge; shape (v, u)."""
        half = self.first.disparities.window // 2
        rows, columns = self.true.shape
        inside = np.zeros((rows, columns), bool)
        inside[half : rows - half, half : columns - half] = True
        return np.asarray(inside & np.isfinite(self.true) & np.all([run.measured for run in self.runs], axis=0))

    @property
    def errors(self) -> Array:
        """Depth less truth, shape (exposures, v, u) [mm]."""
        return np.stack([run.depth for run in self.runs]) - self.true

    def summary(self) -> Summary:
        """Summary over all microlenses compared."""
        share = float(np.mean([run.measured.mean() for run in self.runs]))
        some = self.compared
        if not some.any():
            sigma = self.first.sigma[self.first.measured]
            stated = math.sqrt(float((sigma**2).mean())) if sigma.size and not np.isfinite(self.true).any() else None
            return Summary(None, None, None, stated, None, None, share)
        errors, sigma = self.errors[:, some], np.stack([run.sigma[some] for run in self.runs])
        if len(self.runs) > 1:
            own = errors - errors.mean(0)
            spread = float(np.sqrt((own**2).mean() * len(self.runs) / (len(self.runs) - 1)))
        else:
            spread = float(errors.std())
        predicted = None
        if self.prediction is not None:
            here = some[self.prediction.row, self.prediction.column] & np.isfinite(self.prediction.depth)
            predicted = math.sqrt(float((self.prediction.depth[here] ** 2).mean())) if here.any() else None
        stated = math.sqrt(float((sigma**2).mean()))
        inside, beyond = (float(part.mean()) for part in (np.abs(errors) < sigma, np.abs(errors) > 5 * sigma))
        return Summary(float(errors.mean()), spread, predicted, stated, inside, beyond, share)

    def unknown(self) -> dict[str, float]:
        """Shares of the microlenses without a depth, by reason; over all exposures."""
        each = [run.unknown() for run in self.runs]
        reasons = [reason for reason in REASONS.values() if any(reason in shares for shares in each)]
        return {reason: sum(shares.get(reason, 0.0) for shares in each) / len(each) for reason in reasons}


@dataclass(frozen=True, eq=False)
class Trial(Measurement):
    """A simulated measurement: every exposure's depths, the truth and the prediction."""

    prediction: Prediction
    scene: Scene
    region: Region
    believed: Design
    """The camera that depths were computed for."""
    electrons: float
    """In a pixel that its microlens lights fully, where the scene is as bright as on average."""
    raw: RawImage
    """The picture without noise, of the region with its margin."""
    white: RawImage
    """A white one, likewise."""
    viewing: Viewing
    """How its views look."""
    saturated: float
    """Share of its pixels that fill the well."""
    brightest: float
    """Electrons over the full well of the brightest pixels, but for one in a thousand."""
    aliased: float
    """Share of the field whose texture is finer than two microlenses, by more than `ABOUT`."""
    edge: float
    """Share of it where it is as fine as about two."""
    texture: Design
    """The design with the texture that errors are predicted for, as `assumed`."""

    @property
    def room(self) -> float:
        """Part of the exposure at which the brightest pixels hold `HELD` of the full well; 1 where they hold less."""
        return HELD / max(self.brightest, HELD)

    @property
    def ball(self) -> Sphere | None:
        """The sphere that is all of its scene; None of other scenes."""
        surfaces = self.scene.surfaces
        return surfaces[0] if len(surfaces) == 1 and isinstance(surfaces[0], Sphere) else None

    @cached_property
    def sphere(self) -> SphereFit | None:
        """The sphere that fits the first exposure's depths, where the scene is one."""
        return None if self.ball is None else self.first.sphere()

    @property
    def black(self) -> float:
        """Share of the scene's texture that is black with sharp edges, where that is much."""
        texture = _texture_of(self.scene)
        return texture.black if texture is not None and texture.black > BLACK else 0.0

    def assumes(self) -> dict[str, Any]:
        """Light, texture and matching that the prediction is for, as `evaluate` tells them."""
        design, window = self.raw.design, self.first.disparities.window
        light = evaluate(assumed(design, self.scene, window).thin_twin, [(0.0, 0.0)]).depth.assumes
        given = {"sigma_disparity_pitches": design.depth.disparity_error, "window": window}
        texture = "the scene's" if _texture_of(self.scene) is not None else "the design's, not the scene's"
        lit = given if light is None else plain(light) | {"electrons": self.electrons}
        return lit | {
            "texture": texture,
            "exposure": "the design's" if self.scene.light.exposure is None else "the scene's",
        }

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of `roslf depth`: microlenses of the first exposure, and what all of them say."""
        first = self.first
        return {
            "schema": "roslf.depth/1",
            "design": self.raw.design.name,
            "believed": self.believed.name,
            "scene": self.scene.name,
            "seed": self.raw.seed,
            "exposures": len(self.runs),
            "region_px": list(self.region),
            "microlenses": [self.true.shape[1], self.true.shape[0]],
            "searched_pitches": list(first.disparities.search),
            "tip_mm": first.geometry.tip,
            "summary": plain(self.summary()) | {"unknown": self.unknown()},
            "saturated": self.saturated,
            "aliased": self.aliased,
            "about_two_microlenses": self.edge,
            "assumes": self.assumes(),
            "sphere": None if self.sphere is None or self.ball is None else self.sphere.to_dict(self.ball.radius),
            "points": list(sampled(first, self.true, POINTS)),
        }


def measure(
    geometry: ViewGeometry,
    field: LightField,
    noise: PixelNoise,
    *,
    search: tuple[float, float],
    progress: Callable[[float], None] = lambda share: None,
    begun: Start | None = None,
    viewing: Viewing | None = None,
) -> Depths:
    """Depth of every microlens of a decoded light field, with its standard error.

    Windows mean a bent surface: what that takes off is given back, of views whose noise only they tell with its error.

    Parameters
    ----------
    geometry : ViewGeometry
        Of the camera that took it, or of its views.
    field : LightField
    noise : PixelNoise
        Of its samples.
    search : tuple of float
        Least and largest disparity [pitches].
    progress : callable
        Told the share that is done.
    begun : Start, optional
        Of an earlier measurement of the same field with the same search.
    viewing : Viewing, optional
        Of `geometry` and light fields like this one.
    """
    viewing = viewing or geometry.viewing(field)
    # Where neighbours' light is taken off, that takes half of the time, and is done once more at the phase found.
    prepared, found, turned = (0.2, 0.5, 0.75) if isinstance(geometry, ArrayGeometry) else (0.0, 1.0, 1.0)
    views = prepared_views = viewing.prepared(field)
    progress(prepared)
    disparities = viewing.jointly(field, noise, search, geometry.window, part_of(progress, prepared, 1.0))
    if disparities is None:
        estimate = partial(
            estimate_disparity, noise=noise, search=search, window=geometry.window, captured=field,
            edges=noise.measured, begun=begun,
        )  # fmt: skip
        disparities = estimate(views.field, views.pupil, aside=views.aside, progress=part_of(progress, prepared, found))
        if (again := viewing.at_phase(views, disparities)) is not None:
            views = again
            disparities = estimate(views.field, views.pupil, aside=views.aside, progress=part_of(progress, turned, 1.0))
        views, disparities = with_shared_light(field, noise, viewing, prepared_views, views, disparities, estimate)
    progress(1.0)
    field, pupil, aside = views
    bent = isinstance(geometry, ArrayGeometry) and not noise.measured  # else done, with its errors
    if bent and disparities.begun is not None:  # where all have a disparity
        everywhere = np.where(disparities.begun.dark, np.nan, disparities.begun.disparity)
        bend = straightened(everywhere, disparities.window, disparities.error) - everywhere
        disparities = replace(disparities, disparity=disparities.disparity + bend)
    z = geometry.depth(disparities.disparity)
    known = np.isfinite(z)
    sigma = np.full(z.shape, np.inf)
    sigma[known] = geometry.sigma(z[known], disparities.sigma[known])
    off = geometry.calibration_sigma(z)
    disparities = replace(disparities, begun=None)
    depths = Depths(geometry, field, pupil, aside, disparities, geometry.places(field), z, sigma, off)
    # Where hardly any is known it is no occlusion that views disagree by.
    far = depths.views_aside > disparities.window
    if far.any() and depths.measured[far].mean() < QUORUM:
        blurred = far & (disparities.status == DisparityStatus.INCONSISTENT)
        disparities.status[blurred] = DisparityStatus.UNSHARP
    return depths


def _aliased(
    camera: Camera, traced: TracedViews | None, field: LightField, texture: Noise | None, true: Array
) -> tuple[float, float]:
    """Shares of a field in which a texture's finest detail has fewer than `SEEN` microlenses a period, and about these.

    Edges of what is black are detail half as fine. Neighbours across a step are not of one surface: on each side the
    nearer one tells how far apart microlenses look.
    """
    if texture is None or min(true.shape) < 2:
        return 0.0, 0.0
    x, y, along, down = chief_rays(camera, traced, places_on_array(camera, field).reshape(-1, 2)).T.reshape(
        4, *true.shape
    )
    points = np.stack([x - along * true, y - down * true, true])
    apart = np.zeros(true.shape)
    for axis, at in enumerate((field.v, field.u)):
        away = np.linalg.norm(np.diff(points, axis=1 + axis), axis=0) / np.expand_dims(np.diff(at), 1 - axis)
        before, behind = (np.insert(away, end, np.nan, axis=axis) for end in (0, away.shape[axis]))
        apart = np.maximum(apart, np.fmin(before, behind))
    if min(true.shape) > 2:  # the outermost have a neighbour on one side alone
        apart = apart[1:-1, 1:-1]
    finer = apart[np.isfinite(apart)] * SEEN / (texture.finest / (2 if texture.black > BLACK else 1))
    if not finer.size:
        return 0.0, 0.0
    beyond, there = (float((finer > ends).mean()) for ends in (ABOUT, EXACTLY))
    return beyond, there - beyond


def simulate(
    design: Design,
    scene: Scene | None = None,
    options: PictureOptions | None = None,
    *,
    believed: Design | None = None,
    again: Trial | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Trial:
    """Take pictures of a scene, with noise, and measure depth in them.

    Parameters
    ----------
    design : Design
        The camera, its light and sensor.
    scene : Scene, optional
        Exposed as it states; where it states nothing, on average it is as bright as the design's light says. None is
        `default_scene`.
    options : PictureOptions, optional
    believed : Design, optional
        The camera that depth is computed for, where that is not the one that takes the pictures; its veil is taken off
        them. Centres of microlens images are those of the white image all the same.
    again : Trial, optional
        Of the same cameras, scene and region in any light, whose pictures are exposed anew; None renders them.
    progress : callable
        Told what is being done ("white", "picture", "depth"), and which share of all is done.

    Raises
    ------
    InputError
        A scene that the design cannot see; a region without microlenses, or too large; microlens images narrower
        than a pixel; an objective with a mapping.
    """
    options, believed = options or PictureOptions(), believed or design
    geometry, actual = ArrayGeometry(believed), ArrayGeometry(design)
    camera, part = actual.camera, options.part(design)
    scene = default_scene(design) if scene is None else scene.seen_by(design)
    framed = Framed.of(design, scene, part)
    lattice, inside = _lattice_seen(actual, framed.wide.drawn(), part)
    met, stated = light_on(scene, actual, part), scene.mean_exposure
    mean = met * (float(electrons(camera)) if stated is None else stated)
    work = Work.of(design, options, framed, mean)
    if again is not None:
        work = work._replace(white=0.0, picture=0.0)

    def doing(what: str, before: float, seconds: float) -> Callable[[float], None]:
        return lambda share: progress(what, (before + share * seconds) / work.seconds)

    if again is None:
        unexposed = Unexposed.of(
            design, scene, framed, seed=options.seed, rays=options.rays or rays_for(camera, framed.wide, mean),
            progress=doing("picture", work.white, work.picture), white_progress=doing("white", 0.0, work.white),
        )  # fmt: skip
    picture, white = unexposed if again is None else (again.raw, again.white)
    level = float(picture.pixels.sum() / max(float(white.pixels.sum()), 1e-30))
    if not level > 0:
        raise InputError((Problem("", "no light of the scene reaches this part of the sensor"),))
    lit_design = in_scene_light(design, scene, level / met)
    if lit_design is not design:
        believed, camera = lit_design if believed is design else believed, Camera.of(lit_design.thin_twin)
    mean = met * float(electrons(camera))
    full, saturation = mean / level, float(camera["sensor.full_well"])
    dark = math.sqrt(float(dark_variance(camera)))
    veil, known_veil = (float(veil_electrons(each)) for each in (camera, geometry.camera))
    flat = white.pixels + np.float32((veil - known_veil) / full)
    balance = ColourBalance.of(flat) if filters(design.sensor.colours) else None
    grey = balance or (lambda frame: frame)
    flat = grey(flat)
    decoder = Decoder.of(lattice, picture.pixels.shape, white=flat, reach=geometry.reach)
    even = decoder(flat)
    brightest = float(np.median(even.values[even.weight > 0])) if (even.weight > 0).any() else 1.0
    noise = PixelNoise(full * brightest, dark, saturation * FILLED).on_veil(known_veil)
    noise = noise.dimmed(1.0 if balance is None else balance.evenness)
    rows, columns = _reached(even, inside)
    true = _truth(camera, actual.traced, scene, even)
    disparities = disparity_of(camera, true[np.isfinite(true)])
    search = search_about(*((disparities.min(), disparities.max()) if disparities.size else (-SLANT, SLANT)))
    viewing = geometry.viewing(even) if again is None else again.viewing
    runs = []
    for number, generator in enumerate(np.random.default_rng(options.seed).spawn(options.exposures)):
        tell = doing("depth", work.white + work.picture + number * work.exposure, work.exposure)
        tell(0.0)
        taken = add_noise(picture.pixels + np.float32(veil / full), full, dark, generator)
        lit = grey(np.minimum(taken, np.float32(saturation / full)) - np.float32(known_veil / full))
        run = measure(
            geometry, decoder(lit / np.float32(brightest)), noise, search=search, progress=tell, viewing=viewing
        )
        runs.append(run.within(rows, columns))
    true = true[rows, columns]
    seen = float(np.isfinite(true).mean())
    texture = assumed(lit_design, scene, runs[0].disparities.window, float(electrons(camera)) / full, seen)
    exposed, picture = (picture.pixels * full + veil) / saturation, replace(picture, design=lit_design)
    return Trial(
        tuple(runs), true, _predict(texture, runs[0].field, true, actual.traced), scene, part,
        believed, mean, picture, white, viewing, float((exposed >= 1).mean()), float(np.quantile(exposed, 0.999)),
        *_aliased(camera, actual.traced, runs[0].field, _texture_of(scene), true), texture,
    )  # fmt: skip


def _lattice_seen(actual: ArrayGeometry, wide: Region, part: Region) -> tuple[CentreLattice, NDArray[np.int64]]:
    """Lattice of the images in what is rendered, and the microlenses of the part that is looked at.

    Raises
    ------
    InputError
        Images narrower than a pixel; too few of them.
    """
    camera = actual.camera
    lattice = lattice_of(camera, wide)
    if lattice.pitch < 1:
        message = f"microlens images {lattice.pitch:.3g} pixels apart give no depth: coarser pitch, or finer pixels"
        raise InputError((Problem("microlens_array.pitch", message),))
    if actual.traced is not None:
        lattice = actual.traced.lattice(lattice, lattice.inside((wide.rows, wide.columns)), float(camera.q))
    origin = lattice.origin[0] + wide.column - part.column, lattice.origin[1] + wide.row - part.row
    inside = replace(lattice, origin=origin).inside((part.rows, part.columns))
    if not inside.size or (np.ptp(inside, axis=0) < LEAST - 1).any():
        message = f"fewer than {LEAST} x {LEAST} microlens images lie in it; name a larger part of the sensor"
        raise InputError((Problem("region", message),))
    return lattice, inside


def search_about(low: float, high: float) -> tuple[float, float]:
    """Disparities to search where those of a scene lie between two [pitches]."""
    reach = MARGIN + 0.1 * (high - low)
    return float(low - reach), float(high + reach)


def _reached(field: LightField, inside: NDArray[np.int64]) -> tuple[slice, slice]:
    """Rows and columns of a light field that microlenses, by their indices, reach over."""
    hexagonal = field.hexagonal is not None
    ends = []
    for axis, places in (
        (field.v, inside[:, 1] * (math.sqrt(0.75) if hexagonal else 1.0)),
        (field.u, inside[:, 0] + (0.5 if hexagonal else 0.0) * inside[:, 1]),
    ):
        some = np.flatnonzero((axis > places.min() - 1e-6) & (axis < places.max() + 1e-6))
        ends.append(slice(int(some[0]), int(some[-1]) + 1))
    return ends[0], ends[1]


def _truth(camera: Camera, traced: TracedViews | None, scene: Scene, field: LightField) -> Array:
    """Z that the chief ray of each microlens meets [mm]."""
    z = seen_distances(scene, camera, chief_rays(camera, traced, places_on_array(camera, field).reshape(-1, 2)))
    return np.where(np.isfinite(z), z, np.nan).reshape(len(field.v), len(field.u))


def _texture_of(scene: Scene) -> Noise | None:
    """The noise that all of a scene shows, of one kind; None for other textures, which the design's stands for."""
    textures = [thing.texture for thing in scene.surfaces if hasattr(thing, "texture")]
    noise = [texture for texture in textures if isinstance(texture, Noise)]
    kinds = {(texture.finest, texture.contrast) for texture in noise}
    return noise[0] if len(kinds) == 1 and len(noise) == len(textures) else None


def assumed(design: Design, scene: Scene, window: int, level: float | None = None, seen: float = 1.0) -> Design:
    """The design with the texture that errors are predicted for: the scene's where that is known, else its own.

    Where the mean `level` over white of a part is known, contrast is relative to that: coarse octaves make a part
    brighter or darker than the whole, detail no stronger or fainter, and the exposure gives its mean the same light.
    The texture is `seen` in a share of the part, the background in the rest.
    """
    settings: dict[str, Any] = {"depth.window": window}
    texture = _texture_of(scene)
    if texture is not None:
        lit = 0.0 if level is None or not seen else (level - (1 - seen) * scene.background) / seen
        brightness = lit / texture.mean if lit > 0 else 1.0
        settings |= {
            "depth.contrast": max(texture.contrast / brightness, 1e-9),
            "depth.finest": texture.finest,
            "depth.period": None,
        }
    return design.replace(settings)


def _predict(texture: Design, field: LightField, true: Array, traced: TracedViews | None = None) -> Prediction:
    """Standard errors that light, noise and the texture `assumed` allow, at microlenses all over a light field."""
    camera = Camera.of(texture.thin_twin)
    beside = NOTHING._replace(veil=veil_electrons(camera))
    rows, columns = (
        np.unique(np.linspace(0, n - 1, min(n, PREDICTED) + 2)[1:-1].round().astype(int)) for n in true.shape
    )
    row, column = (index.ravel() for index in np.meshgrid(rows, columns, indexing="ij"))
    places = places_on_array(camera, field)[row, column]
    disparity, depth = np.full(row.size, np.inf), np.full(row.size, np.inf)
    turn = np.linspace(0, math.pi, DIRECTIONS if traced else 1, endpoint=False)
    ways, one = np.stack([np.cos(turn), np.sin(turn)]), np.broadcast_to(np.eye(2), (row.size, 2, 2))
    image, (pupil, aside) = (one, (one, 0 * one)) if traced is None else (traced.images(places), traced.bends(places))
    every = MicrolensImages(camera, places)
    cut = traced is not None and traced.cut(every) is not every
    for n, (place, z) in enumerate(zip(places, true[row, column], strict=True)):
        if math.isfinite(z):
            b, plane = disparity_of(camera, z), camera.plane(z)
            ahead = np.abs(product(camera.seen.inverse_m, ratio(plane.distance - camera.seen.d_3, camera.seen.gap)))
            plane_seen = Seen(b, np.asarray(ahead * np.abs(plane.magnification)), z - camera.tip)
            # Of each direction of the texture images are out of focus by another part of the faults.
            bends = np.linalg.norm((aside[n] + b * pupil[n]) @ ways, axis=0)
            wide = camera["aperture.diameter"] * math.sqrt(abs(np.linalg.det(image[n])))
            images = MicrolensImages(camera.replace({"aperture.diameter": wide}), [place])
            images = traced.cut(images) if traced is not None and cut else images
            each = disparity_sigma(images, plane_seen._replace(disparity=bends), beside)[0]
            sharp = math.sqrt(float(np.mean((np.linalg.norm(pupil[n] @ ways, axis=0) / each) ** 2)))
            disparity[n] = 1 / sharp if sharp else math.inf
            depth[n] = float(sigma_of(camera, z, disparity[n]))
    return Prediction(row, column, disparity, depth)


def sampled(depths: Depths, true: Array, most: int) -> Iterator[dict[str, Any]]:
    """Microlenses with a depth, at most so many, evenly over the field: place, truth, depth, error.

    Of views whose distances nobody knows, depths are null and disparities stand beside them.
    """
    rows, columns = np.nonzero(depths.measured)
    step = max(1, math.ceil(rows.size / most))
    sigma, unit = depths.sigma, depths.geometry.unit
    for row, column in zip(rows[::step], columns[::step], strict=True):
        at, z = (row, column), float(true[row, column])
        truth = z if math.isfinite(z) else None
        place = depths.x_ml[at].tolist()
        on_array = isinstance(depths.geometry, ArrayGeometry)
        point: dict[str, Any] = {"x_ml_mm": place if on_array else None}
        if unit == "mm":
            point |= {"true_mm": truth, "depth_mm": float(depths.depth[at]), "sigma_mm": float(sigma[at])}
            if on_array:
                point["ahead_of_tip_mm"] = float(depths.depth[at]) - depths.geometry.tip
        else:
            point |= {"true_mm": None, "depth_mm": None, "sigma_mm": None, "true_disparity_px": truth}
            point |= {"disparity_px": float(depths.depth[at]), "sigma_disparity_px": float(sigma[at])}
        if not on_array:
            point["pixel"] = [int(column), int(row)]
        if unit == "mm":
            own = depths.calibration_sigma
            point["sigma_noise_mm"] = float(depths.noise_sigma[at])
            point["sigma_calibration_mm"] = None if own is None else float(own[at])
            point["u_mm"] = float(sigma[at])
        yield point
