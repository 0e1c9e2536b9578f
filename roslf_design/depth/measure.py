"""Simulated measurement of a scene: its picture with noise, decoded, disparity and depth of every microlens."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from .._arrays import product, ratio
from ..calibration.decoding import Decoder, LightField
from ..calibration.frames import ColourBalance
from ..calibration.lattice import CentreLattice
from ..camera import Camera
from ..design import Design
from ..design.parts import MOST_CONTRAST
from ..effects import Budget, plan
from ..effects.elements import PLATE_ABERRATION
from ..effects.waves import add_noise
from ..errors import InputError, Problem
from ..evaluation import evaluate
from ..imaging import transfer
from ..imaging.camera import ImageLattice, Region
from ..imaging.render import RawImage, render
from ..imaging.trace import RaySampling, seen_distances
from ..json_data import plain
from ..options import Options, Seed
from ..scenes import Noise, Plane, Scene
from ..scenes.scene import chief_ray_limits
from ..shapes.lattice import PACKINGS
from ..theory.colours import filters
from ..theory.disparity_error import Seen, disparity_sigma
from ..theory.exit_pupil import microlens_image_diameter
from ..theory.photometry import NOTHING, dark_variance, electrons, veil_electrons
from ..theory.quantities import QUANTITIES
from ..theory.stop_images import MicrolensImages
from .dense import DenseMap
from .estimate import DisparityMap, DisparityStatus, PixelNoise, Start, estimate_disparity
from .geometry import ArrayGeometry, ViewGeometry, depth_of, disparity_of, sigma_of
from .traced_views import TracedViews
from .unmixing import places_on_array

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

RAYS, RAYS_FOR = 32, (5000.0, 13.0)
"""For each pixel of a textured scene whose pixels hold so many electrons, behind microlens images so many pixels wide
that no diffraction spreads: errors of depth scatter by up to a twentieth more than without their scatter. Rays scatter
alike in all exposures, so that what they add to errors reads as bias."""
LEAST_RAYS, MOST_RAYS = 8, 256
SPREADING = 1.9
"""Times fewer, at most, where diffraction spreads each one's light over several pixels."""
TOGETHER = 8
"""Subpixels along the side of blocks whose rays are spread evenly together."""
FEWER_SAMPLES = 2
"""So many times fewer samples along a pixel's side behind a real main lens: they are spread more evenly."""
SCATTER = 0.85
"""Power of the number of rays that what they scatter falls with."""
DETAIL = 2.5
"""Period of the finest detail of the scene that is looked at where none is given [microlenses]."""
SLANT = 0.5
"""Half the range of disparities over the width of that scene [pitches]."""
LONGEST, STEEPEST = 1.25, 3.0
"""Length of that scene between two neighbouring microlenses over the frontal one, at most: so its finest detail has two
microlenses a period wherever it is looked at. Slope at most."""
SEEN = 2.0
"""Microlenses a period below which texture aliases."""
MARGIN = 0.5
"""Disparities searched beyond those of the scene [pitches]."""
LOOKS = 9
"""Places along each axis of a region at which is looked how far views look past it."""
BESIDE = 3
"""Microlenses beyond each side of the region that are measured as well and left out: those at its border then have the
neighbours and windows of all others."""
SHIFTING = "+microlens_defocus", "+finite_microlens_aperture", "+object_defocus"
"""Effects that depth sees where no pixel does: what each side of a microlens shows is another place and direction."""
STRIP, WINDOWS = 12, 40
"""Microlenses across the strip that is looked at where no part of the sensor is named, at least, and windows without
common microlenses that it holds: enough to judge errors by."""
LONG = 3e7
"""Rays for which it is kept shorter."""
SECONDS = {"start": 0.5, "ray": 2e-7, "pixel": 2e-6, "decoded": 7e-7}
"""Processor time, about: of each ray and pixel of a picture, and of a pixel that is decoded and measured."""
SLOWER = 3.0
"""Times that rays take where they go face by face."""
POINTS = 2000
"""Microlenses that a result tells one by one."""
LEAST = 5
"""Microlenses along each side of the smallest light field that is measured."""
DIRECTIONS = 6
"""Directions of a texture whose errors behind a real lens are averaged."""
PREDICTED = 8
"""Fields along each axis at which the error is predicted."""


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


class _Flatness(NamedTuple):
    """Depths against the plane that fits them best."""

    rms: float
    """RMS in the unit of depths."""
    inside_68: float
    """Share within the standard errors for noise told with each: 0.68 of a plane."""


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

    def flatness(self) -> _Flatness | None:
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
        return _Flatness(float(np.sqrt((rms**2).mean())), float((np.abs(off) * weight < 1).mean()))

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
        """Share filled in, rms of the errors told there, and what places held out say of disparities [pitches]."""
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
    """Rms of the standard errors told with the estimates."""
    inside_68: float | None
    """Share of the errors below the standard errors told: 0.68 where these are right."""
    beyond_5: float | None
    """Share of the errors beyond five of the standard errors told: nearly none where these are right."""
    measured: float
    """Share of the microlenses with a depth."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """Depths of one or more exposures of the same, with the truth and the prediction as far as they are known."""

    runs: tuple[Depths, ...]
    """Depths of each exposure."""
    true: Array
    """Z that each microlens's chief ray meets, shape (v, u) [mm]; NaN where it meets nothing, or nothing is known."""
    prediction: Prediction | None

    @property
    def first(self) -> Depths:
        """Depths from the first exposure."""
        return self.runs[0]

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
    saturated: float
    """Share of its pixels that fill the well."""
    brightest: float
    """Electrons over the full well of the brightest pixels, but for one in a thousand."""
    aliased: float
    """Share of the field whose texture is finer than two microlenses."""

    def assumes(self) -> dict[str, Any]:
        """Light, texture and matching that the prediction is for, as `evaluate` tells them."""
        design, window = self.raw.design, self.first.disparities.window
        light = evaluate(assumed(design, self.scene, window).thin_twin, [(0.0, 0.0)]).depth.assumes
        given = {"sigma_disparity_pitches": design.depth.disparity_error, "window": window}
        texture = "the scene's" if _texture_of(self.scene) is not None else "the design's, not the scene's"
        return (given if light is None else plain(light)) | {"texture": texture}

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
            "summary": plain(self.summary()) | {"unknown": self.unknown()},
            "saturated": self.saturated,
            "aliased": self.aliased,
            "assumes": self.assumes(),
            "points": list(sampled(first, self.true, POINTS)),
        }


def lattice_of(camera: Camera, region: Region) -> CentreLattice:
    """Where a camera's microlens images lie in a region of its sensor [px]."""
    lattice, (width, height), q = ImageLattice.of(camera), camera.pixels, float(camera.q)
    origin = lattice.image_origin / q + [width / 2 - 0.5 - region.column, height / 2 - 0.5 - region.row]
    first, second = (axis / q for axis in lattice.image_axes.T)
    return CentreLattice(
        (float(origin[0]), float(origin[1])),
        (float(first[0]), float(first[1])),
        (float(second[0]), float(second[1])),
        camera.layout,
    )


def measure(
    geometry: ViewGeometry,
    field: LightField,
    noise: PixelNoise,
    *,
    search: tuple[float, float],
    progress: Callable[[float], None] = lambda share: None,
    begun: Start | None = None,
) -> Depths:
    """Depth of every microlens of a decoded light field, with its standard error.

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
    """
    views = geometry.prepared(field)
    progress(0.5)
    estimate = partial(
        estimate_disparity, noise=noise, search=search, window=geometry.window, captured=field,
        edges=noise.alike is not None, begun=begun,
    )  # fmt: skip
    disparities = estimate(views.field, views.pupil, aside=views.aside)
    if (turned := geometry.at_phase(views, disparities)) is not None:
        views = turned
        disparities = estimate(views.field, views.pupil, aside=views.aside)
    field, pupil, aside = views
    z = geometry.depth(disparities.disparity)
    known = np.isfinite(z)
    sigma = np.full(z.shape, np.inf)
    sigma[known] = geometry.sigma(z[known], disparities.sigma[known])
    off = geometry.calibration_sigma(z)
    return Depths(geometry, field, pupil, aside, disparities, geometry.places(field), z, sigma, off)


def _rays_for(camera: Camera) -> int:
    """Rays for each pixel that stay as far below a camera's noise as `RAYS` do.

    They scatter at the rims of microlens images, of which wide images have less a pixel.
    """
    pixels, width = float(camera.q), abs(float(microlens_image_diameter(camera) / camera.q))
    wanted = (float(electrons(camera)) / RAYS_FOR[0] * RAYS_FOR[1] / max(width, 1.0)) ** (0.5 / SCATTER)
    blur = float(camera.wavelength * camera.seen.d_2 / camera.d) / pixels
    some = float(np.clip(RAYS * wanted / np.clip(blur, 1.0, SPREADING), LEAST_RAYS, MOST_RAYS))
    return 1 << (math.ceil(some) - 1).bit_length()


class PictureOptions(Options):
    """Pictures that are taken, of a camera that is simulated."""

    region: tuple[int, int, int, int] | None = Field(
        None,
        description="Column, row, columns and rows of the sensor. Default: a strip across its middle.",
    )
    seed: Seed = Field(
        0,
        description="Seed of the noise; the same seed gives the same bytes.",
    )
    exposures: Annotated[int, Field(ge=1)] = Field(
        1,
        description="Pictures, which differ by noise alone.",
    )
    rays: Annotated[int, Field(ge=1)] | None = Field(
        None,
        description="Rays of each pixel. Default: as many as the light calls for.",
    )

    def part(self, design: Design) -> Region:
        """Part of a design's sensor that is looked at."""
        return Region.checked(Camera.of(design), self.region) if self.region else _default_region(design)


class _Unexposed(NamedTuple):
    """Pictures without noise and veil, of which exposures are made with any light; of a region with its margin."""

    scene: RawImage
    white: RawImage

    @classmethod
    def of(
        cls,
        design: Design,
        scene: Scene,
        region: tuple[int, int, int, int],
        *,
        seed: int = 0,
        rays: int = RAYS,
        progress: Callable[[float], None] = lambda share: None,
        white_progress: Callable[[float], None] = lambda share: None,
    ) -> _Unexposed:
        """Rendered of a scene and of white, with so many rays a pixel."""
        # Rays through elements go as depth has them, however near that is to first order.
        exact = [f"+{PLATE_ABERRATION.name}"] if PLATE_ABERRATION.available(design) else []
        lines = plan(design, scene, Budget(), ["-noise", *SHIFTING, *exact]).without("veil")
        side = math.ceil(math.sqrt(rays) / FEWER_SAMPLES)
        sampling = RaySampling(least=rays, most=rays, tolerance=1e-6, seed=seed, side=side, together=TOGETHER)
        part = Region(*region)
        margin = _margin(design, scene, part)
        wide = _grown(design, part, margin)
        # Light is drawn so far around what has to be right, and no microlens of the margin is to be left dark.
        right = part.grown(max(0, margin - transfer.LEAST_HALO)).common(wide)
        quiet = scene.model_copy(update={"light": scene.light.model_copy(update={"exposure": None})})
        shown = partial(render, design, seed=seed, region=wide, inner=right)
        # Uniform light shows no more of a whole microlens than its middle does.
        whole = lines.without("finite_microlens_aperture")
        white = shown(None, effects=whole, sampling=replace(sampling, side=0), progress=white_progress)
        over = scene.brightness if scene.white is None and scene.surfaces else 0.0
        picture = shown(quiet, effects=lines, over=over, sampling=sampling, progress=progress)
        # Rays tell only what the scene is brighter or darker than its mean, which the white picture has without them.
        return cls(replace(picture, pixels=picture.pixels + np.float32(over) * white.pixels), white)


def _default_scene(design: Design) -> Scene:
    """A slanted wall with texture at the focal plane, which runs through the disparities that it can tell best."""
    camera = Camera.of(design.thin_twin)
    half = float(QUANTITIES["field_half_width_mm"](camera))
    nearest = float(camera.tip) + 0.2 * (design.d_f - float(camera.tip))
    ends = [float(depth_of(camera, np.asarray(b))) for b in (SLANT, -SLANT)]
    slope = min(
        abs(end - design.d_f) / half if math.isfinite(end) else math.inf for end in (max(ends[0], nearest), ends[1])
    )
    slope = min(slope, _steepest(abs(chief_ray_limits(design)[0])))
    contrast = min(design.depth.contrast, MOST_CONTRAST)  # that of a single period may be more
    texture = Noise(finest=DETAIL * float(QUANTITIES["object_sample_mm"](camera)), contrast=contrast, seed=1)
    return Scene(name="slanted wall", objects=(Plane(tilt=(0.0, math.atan(slope)), texture=texture),))


def _steepest(sight: float) -> float:
    """Largest slope of a wall on which neighbouring chief rays, of slopes up to `sight`, lie `LONGEST` apart at most.

    A wall z = z_0 + m x meets the chief ray of slope t at x = t (z_0 - d_3)/(1 - m t): microlenses alike in t lie
    sqrt(1 + m^2)/(1 - m t)^2 as far apart on it as on one that faces the camera.
    """
    slopes = np.linspace(0, min(STEEPEST, 1 / max(sight, 1e-9)), 3001)[:-1]
    longer = np.sqrt(1 + slopes**2) / (1 - slopes * sight) ** 2
    return float(slopes[longer <= LONGEST][-1])


def _aliased(design: Design, texture: Noise | None, true: Array) -> float:
    """Share of a field in which a texture's finest detail has fewer than `SEEN` microlenses a period, about."""
    known = np.isfinite(true)
    if texture is None or not known.any() or min(true.shape) < 2:
        return 0.0
    camera = Camera.of(design.thin_twin)
    gap = float(design.d_f - design.d_3)
    step = float(QUANTITIES["object_sample_mm"](camera)) / gap
    rows, columns = ((np.arange(n) - (n - 1) / 2) * step for n in true.shape)
    away = true - design.d_3
    points = np.stack([columns * away, rows[:, None] * away, away])
    apart = np.max([np.sqrt((np.gradient(points, axis=axis) ** 2).sum(0)) for axis in (1, 2)], axis=0)
    return (
        float((apart[np.isfinite(apart)] * SEEN > texture.finest * 1.001).mean()) if np.isfinite(apart).any() else 0.0
    )


def _default_region(design: Design) -> Region:
    """A strip of microlenses through the middle, all of the sensor's width where `LONG` allows."""
    camera, window = Camera.of(design.thin_twin), design.depth.window
    width, height = camera.pixels
    pitch = abs(float(QUANTITIES["image_pitch_mm"](camera)) / float(camera.q))
    across = max(STRIP, WINDOWS * window**2 / max(width / pitch - window, 1.0) + window)
    each = _rays_for(camera) * max(1.0, float(QUANTITIES["fill_factor"](camera)) ** 2)  # of all that overlap
    across = np.clip(LONG / (each * width * pitch) - 2 * BESIDE, STRIP, across)
    rows = min(height, math.ceil(across * pitch))
    columns = min(width, math.ceil(max(LONG / (each * (across + 2 * BESIDE)) / pitch, STRIP * pitch)))
    return Region((width - columns) // 2, (height - rows) // 2, columns, rows)


def region_about(design: Design, place: tuple[float, float], across: int) -> Region:
    """A square of microlens images about one of them, as far as the sensor reaches.

    Parameters
    ----------
    design : Design
    place : tuple of float
        Of the microlens on the array [mm].
    across : int
        Microlenses along each side.
    """
    camera = Camera.of(design.thin_twin)
    width, height = camera.pixels
    lattice = lattice_of(camera, Region(0, 0, width, height))
    i, j = np.linalg.solve(PACKINGS[lattice.layout].steps, np.array(place) / float(camera.d))
    column, row = lattice.nodes(i, j)
    side = math.ceil(across * lattice.pitch)
    columns, rows = min(side, width), min(side, height)
    left, top = (
        int(np.clip(round(middle - size / 2 + 0.5), 0, most - size))
        for middle, size, most in ((float(column), columns, width), (float(row), rows, height))
    )
    return Region(left, top, columns, rows)


class Work(NamedTuple):
    """Effort of a simulated measurement, as far as it is known beforehand."""

    pixels: int
    rays: int
    """Rays of each pixel."""
    white: float
    picture: float
    exposure: float
    """Processor time of the pictures and of each exposure [s], about."""
    exposures: int

    @classmethod
    def of(cls, design: Design, options: PictureOptions) -> Work:
        """Work of pictures that a design takes."""
        camera = Camera.of(design.thin_twin)
        part, rays = options.part(design), options.rays or _rays_for(camera)
        wide = _grown(design, part, _margin(design, None, part))
        pixels, slower = wide.columns * wide.rows, SLOWER if design.traced_through else 1.0
        if design.thin_twin is not design:
            rays = math.ceil(math.sqrt(rays) / FEWER_SAMPLES) ** 2
        each = SECONDS["ray"] * rays * slower * max(1.0, float(QUANTITIES["fill_factor"](camera)) ** 2)
        white = pixels * SECONDS["pixel"] * (slower - 0.9)
        exposure = SECONDS["start"] + pixels * SECONDS["decoded"]
        return cls(pixels, rays, white, pixels * (each + SECONDS["pixel"]), exposure, options.exposures)

    @property
    def seconds(self) -> float:
        """All of it."""
        return self.white + self.picture + self.exposures * self.exposure

    def __str__(self) -> str:
        shots = "" if self.exposures == 1 else f", {self.exposures} exposures"
        return f"{self.pixels / 1e6:.2g} million pixels x {self.rays} rays{shots}"


def _grown(design: Design, region: Region, margin: int) -> Region:
    """With a margin [px], as far as the sensor reaches."""
    return region.grown(margin).common(Region.checked(Camera.of(design.thin_twin), None))


def _margin(design: Design, scene: Scene | None, region: Region) -> int:
    """Width of what is measured beside a region [px]: `BESIDE` microlenses, and as many as views look past it."""
    geometry = ArrayGeometry(design)
    camera, beside = geometry.camera, float(BESIDE)
    lattice, share = lattice_of(camera, region), np.linspace(0, 1, LOOKS)
    corners = np.stack(np.meshgrid(share * (region.columns - 1), share * (region.rows - 1)), -1).reshape(-1, 2)
    places = lattice.indices(corners) @ PACKINGS[lattice.layout].steps.T * float(camera.d)
    if geometry.traced is not None:
        beside += float(np.linalg.norm(geometry.traced.bends(places)[1], 2, (1, 2)).max()) / 2
    if scene is not None:
        met = seen_distances(scene, camera, _chief_rays(camera, geometry.traced, places))
        beside += float(np.abs(disparity_of(camera, met[np.isfinite(met)])).max(initial=0.0)) / 2
    return math.ceil(beside * abs(float(QUANTITIES["image_pitch_mm"](camera) / camera.q)))


def simulate(
    design: Design,
    scene: Scene | None = None,
    options: PictureOptions | None = None,
    *,
    believed: Design | None = None,
    unexposed: _Unexposed | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Trial:
    """Take pictures of a scene, with noise, and measure depth in them.

    Parameters
    ----------
    design : Design
        The camera, its light and sensor.
    scene : Scene, optional
        Brightness is relative: on average it is as bright as the design's light says. None is `_default_scene`.
    options : PictureOptions, optional
    believed : Design, optional
        The camera that depth is computed for, where that is not the one that takes the pictures; its veil is taken off
        them. Centres of microlens
        images are those of the white image all the same.
    unexposed : Unexposed, optional
        Of the same camera, scene and region, in any light; None renders them.
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
    scene = _default_scene(design) if scene is None else scene
    wide = _grown(design, part, _margin(design, scene, part)).drawn()
    lattice = lattice_of(camera, wide)
    if lattice.pitch < 1:
        message = (
            f"microlens images {lattice.pitch:.3g} pixels apart tell no depth; give a coarser pitch or finer pixels"
        )
        raise InputError((Problem("microlens_array.pitch", message),))
    if actual.traced is not None:
        lattice = actual.traced.lattice(lattice, lattice.inside((wide.rows, wide.columns)), float(camera.q))
    origin = lattice.origin[0] + wide.column - part.column, lattice.origin[1] + wide.row - part.row
    inside = replace(lattice, origin=origin).inside((part.rows, part.columns))
    if not inside.size or (np.ptp(inside, axis=0) < LEAST - 1).any():
        message = f"fewer than {LEAST} x {LEAST} microlens images lie in it; name a larger part of the sensor"
        raise InputError((Problem("region", message),))
    mean = float(electrons(camera))
    work = Work.of(design, options)
    if unexposed is not None:
        work = work._replace(white=0.0, picture=0.0)

    def doing(what: str, before: float, seconds: float) -> Callable[[float], None]:
        return lambda share: progress(what, (before + share * seconds) / work.seconds)

    if unexposed is None:
        unexposed = _Unexposed.of(
            design, scene, part, seed=options.seed, rays=options.rays or _rays_for(camera),
            progress=doing("picture", work.white, work.picture), white_progress=doing("white", 0.0, work.white),
        )  # fmt: skip
    picture, white = unexposed
    level = float(picture.pixels.sum() / max(float(white.pixels.sum()), 1e-30))
    if not level > 0:
        raise InputError((Problem("", "no light of the scene reaches this part of the sensor"),))
    full, saturation = mean / level, float(camera["sensor.full_well"])
    dark = math.sqrt(float(dark_variance(camera)))
    veil, known_veil = (float(veil_electrons(each)) for each in (camera, geometry.camera))
    flat = white.pixels + np.float32((veil - known_veil) / full)
    balance = ColourBalance.of(flat) if filters(design.sensor.colours) else None
    grey = balance or (lambda frame: frame)
    flat = grey(flat)
    decoder = Decoder.of(lattice, picture.pixels.shape, white=flat)
    even = decoder(flat)
    brightest = float(np.median(even.values[even.weight > 0])) if (even.weight > 0).any() else 1.0
    noise = PixelNoise(full * brightest, dark, saturation * 0.98).on_veil(known_veil)
    noise = noise.dimmed(1.0 if balance is None else balance.evenness)
    rows, columns = _reached(even, inside)
    true = _truth(camera, actual.traced, scene, even)
    disparities = disparity_of(camera, true[np.isfinite(true)])
    low, high = (float(disparities.min()), float(disparities.max())) if disparities.size else (-SLANT, SLANT)
    search = search_about(low, high)
    runs = []
    for number, generator in enumerate(np.random.default_rng(options.seed).spawn(options.exposures)):
        tell = doing("depth", work.white + work.picture + number * work.exposure, work.exposure)
        tell(0.0)
        taken = add_noise(picture.pixels + np.float32(veil / full), full, dark, generator)
        field = decoder(grey(np.minimum(taken, np.float32(saturation / full)) - np.float32(known_veil / full)))
        field = replace(field, values=field.values / np.float32(brightest))
        runs.append(measure(geometry, field, noise, search=search, progress=tell).within(rows, columns))
        tell(1.0)
    true = true[rows, columns]
    prediction = _predict(design, scene, runs[0].field, true, runs[0].disparities.window, actual.traced)
    exposed = (picture.pixels * full + veil) / saturation
    return Trial(
        tuple(runs), true, prediction, scene, part, believed, mean, picture,
        float((exposed >= 1).mean()), float(np.quantile(exposed, 0.999)), _aliased(design, _texture_of(scene), true),
    )  # fmt: skip


def search_about(low: float, high: float) -> tuple[float, float]:
    """Disparities to search where those of a scene lie between two [pitches]."""
    reach = MARGIN + 0.1 * (high - low)
    return low - reach, high + reach


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


def _chief_rays(camera: Camera, traced: TracedViews | None, places: Array) -> Array:
    """Chief rays of microlenses before all elements: x and y at the main lens [mm], and how they fall with Z; (n, 4).

    Parameters
    ----------
    camera : Camera
    traced : TracedViews or None
        Where first order is not exact.
    places : ndarray
        Of the microlenses on the array [mm], shape (n, 2).
    """
    if traced is not None:
        return traced.chief_rays(places)
    x, y = MicrolensImages(camera, places).from_lens.T
    # Chief rays meet in the FAP; as the main lens sees them, and then with a ruler.
    slopes = [np.asarray(at * camera.seen.inverse_m / camera.seen.gap) for at in (x, y)]
    near, _ = camera.front
    far = 2 * camera.seen.d_f if camera.chain.in_air else camera["main_lens.focal_plane"] + 1.0
    points = []
    for z in (near, far):
        plane = camera.plane(z)
        offsets = [-slope * (plane.distance - camera.seen.d_3) for slope in slopes]
        lens = zip(offsets, camera.lens_centre, plane.axis_offset, strict=True)
        points.append([at * plane.magnification + off + aside for at, off, aside in lens])
    along = [(a - b) / (far - near) for a, b in zip(*points, strict=True)]
    heights = [a + slope * near for a, slope in zip(points[0], along, strict=True)]
    return np.stack([*heights, *along], -1)


def _truth(camera: Camera, traced: TracedViews | None, scene: Scene, field: LightField) -> Array:
    """Z that the chief ray of each microlens meets [mm]."""
    z = seen_distances(scene, camera, _chief_rays(camera, traced, places_on_array(camera, field).reshape(-1, 2)))
    return np.where(np.isfinite(z), z, np.nan).reshape(len(field.v), len(field.u))


def _texture_of(scene: Scene) -> Noise | None:
    """The noise that all of a scene shows, of one kind; None for other textures, which the design's stands for."""
    textures = [thing.texture for thing in scene.surfaces if hasattr(thing, "texture")]
    noise = [texture for texture in textures if isinstance(texture, Noise)]
    kinds = {(texture.finest, texture.contrast) for texture in noise}
    return noise[0] if len(kinds) == 1 and len(noise) == len(textures) else None


def assumed(design: Design, scene: Scene, window: int) -> Design:
    """The design with the texture that errors are predicted for: the scene's where that is known, else its own."""
    settings: dict[str, Any] = {"depth.window": window}
    texture = _texture_of(scene)
    if texture is not None:
        settings |= {
            "depth.contrast": max(texture.contrast, 1e-9),
            "depth.finest": texture.finest,
            "depth.period": None,
        }
    return design.replace(settings)


def _predict(
    design: Design, scene: Scene, field: LightField, true: Array, window: int, traced: TracedViews | None = None
) -> Prediction:
    """Standard errors that light, noise and the scene's texture allow, at microlenses all over a light field."""
    camera = Camera.of(assumed(design, scene, window).thin_twin)
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
    for n, (place, z) in enumerate(zip(places, true[row, column], strict=True)):
        if math.isfinite(z):
            b, plane = disparity_of(camera, z), camera.plane(z)
            ahead = np.abs(product(camera.seen.inverse_m, ratio(plane.distance - camera.seen.d_3, camera.seen.gap)))
            plane_seen = Seen(b, np.asarray(ahead * np.abs(plane.magnification)))
            # Of each direction of the texture images are out of focus by another part of the faults.
            bends = np.linalg.norm((aside[n] + b * pupil[n]) @ ways, axis=0)
            wide = camera["aperture.diameter"] * math.sqrt(abs(np.linalg.det(image[n])))
            images = MicrolensImages(camera.replace({"aperture.diameter": wide}), [place])
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
