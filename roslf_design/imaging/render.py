"""Rendering: from design, scene and plan to the raw image that the sensor would record."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..camera import Camera, Number
from ..design import Design
from ..effects import Budget, Plan, plan
from ..effects.geometry import mapped_blur
from ..errors import InputError, Problem, refusal
from ..progress import part_of
from ..scenes import WHITE_FIELD, Scene, White
from ..seeds import check_seed
from ..tables import BriefValue
from ..theory.colours import BRIGHTEST, FILTERS, ColourFilter, filters, mosaic, per_watt
from ..theory.light import chief_spread, falloff, outer_slope
from ..theory.photometry import full_level
from ..theory.transfer import MicrolensTransfer
from .camera import Image, ImageLattice, Region, pixel_centres, pixel_response, planned_camera
from .lens_rays import real_camera
from .point_source import PointSource
from .points import point_image
from .sampling import even_sampling, mean_light, rays_for
from .trace import FEWEST, TOGETHER, RaySampling, Tracer
from .transfer import CORE, Geometry, bands, blurred, fineness, halo, near_reach
from .white import MOST_ORDERS, MOST_ROWS, HarmonicSeries, WhiteGeometry, add_falloff, harmonic_series

NEGLIGIBLE = 0.25
"""Share of the budget of intensity below which light is left out."""
PATCH, PATCHES, SAFETY = 20, 12, 1.25
"""Pixels across patches that tell how many rays are enough, their number, and errors of other patches over theirs."""
AROUND = 1 / 16
"""Rays of pixels that only lend their light, against those of pixels that are looked at."""


@dataclass(frozen=True, eq=False)
class RawImage(BriefValue):
    """Raw image that the sensor recorded, and how it was computed."""

    pixels: Image
    """Relative intensities, shape (rows, columns), row 0 at the lowest y: 1 is a fully lit pixel, behind colour filters
    one of the brightest colour."""
    region: Region
    """Region of the sensor's pixels."""
    design: Design
    scene: Scene
    plan: Plan
    seed: int
    method: str
    """"coverage", "harmonics", "convolution" or "rays", as far as it explains the whole scene."""
    sampling: RaySampling
    """Rays that each pixel was to get."""
    rays: int
    """Backward rays traced."""
    seconds: float
    """Wall time."""
    accuracy: dict[str, Any] | None = None
    """Accuracy of its pixels, as stated where it was made; None where nobody asked."""

    def __str__(self) -> str:
        rows, columns = self.pixels.shape
        low, high = self.pixels.min(), self.pixels.max()
        return f"Raw image of {self.design.name}: {columns} x {rows} px, {low:.3g} to {high:.3g} (.pixels)"

    def metadata(self) -> dict[str, Any]:
        """Everything but the pixels, JSON-ready."""
        full = float(full_level(Camera.of(self.design.thin_twin), self.scene.light.exposure))
        return {
            "schema": "roslf.render/1",
            "design": self.design.model_dump(mode="json", exclude_defaults=True),
            "scene": self.scene.model_dump(mode="json", exclude_defaults=True),
            "region": dict(zip(Region._fields, self.region, strict=True)),
            "seed": self.seed,
            "method": self.method,
            "full_well": None if math.isinf(full) else full,
            "rays": self.rays,
            "effects": self.plan.as_dicts(),
            **({} if self.accuracy is None else {"accuracy": self.accuracy}),
        }


def render(
    design: Design,
    scene: Scene | None = None,
    *,
    effects: Plan | None = None,
    budget: Budget | None = None,
    overrides: Iterable[str] = (),
    seed: int = 0,
    region: tuple[int, int, int, int] | None = None,
    inner: tuple[int, int, int, int] | None = None,
    over: float = 0.0,
    threads: int | None = None,
    sampling: RaySampling | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> RawImage:
    """Raw light-field image of a scene; behind colour filters a mosaic, in white light.

    Parameters
    ----------
    scene : Scene, optional
        None is a white field.
    effects : Plan, optional
        None makes one from `budget` and `overrides`.
    budget : Budget, optional
        How large an effect may be and still be left out; also the accuracy asked of sampled pixels, where its intensity
        is given or no noise is drawn.
    overrides : iterable of str
        As in `effects.plan`.
    seed : int
        Of sampling and noise. The same seed gives the same bytes, with any number of threads.
    region : (column, row, columns, rows), optional
        Part of the sensor; None is all of it.
    inner : (column, row, columns, rows), optional
        What of it has to be right: a textured scene's light that diffracts from so far away that none of this gets it
        is left out, which takes some of what pixels around it get; pixels outside the region that lend their light
        get few rays. None is all of the region.
    over : float
        Radiance that is taken off everything that rays meet. What is left, with `over` times the picture of a white
        field, is the picture: of a scene about as bright everywhere, rays scatter less in what is left. Not of scenes
        without surfaces.
    threads : int, optional
        None is one for each processor.
    sampling : Sampling, optional
        Rays per pixel; None is `sampling_of`.
    progress : callable
        Told the share of rays, or of rows, that are done.

    Raises
    ------
    InputError
        A scene that the design cannot see, an effect that is unknown, a region outside the sensor, or too large.
    """
    start = time.perf_counter()
    scene = WHITE_FIELD if scene is None else scene
    budget = budget or Budget()
    scene.check(design)
    if design.microlens_array.focal_lengths:
        message = "pictures are drawn of one type of microlenses; give focal_length in its place, type after type"
        raise InputError((Problem("microlens_array.focal_lengths", message),), design.name)
    if effects is None:
        effects = plan(design, scene, budget, overrides)
    check_seed(seed)
    if threads is not None and threads < 1:
        raise refusal("threads", f"{threads} is out of range; give a whole number from 1, or leave it out")
    piece = Region.checked(Camera.of(design), region).drawn()
    sampling = sampling or sampling_of(design, scene, effects, budget, piece, seed)
    core = None if inner is None else Region.checked(Camera.of(design), inner)
    count = threads or os.cpu_count() or 1
    scenes, whites = _scenes(design, scene.seen_by(design)), list[tuple[ColourFilter | None, _Job]]()
    level = mean_light(scene.seen_by(design), Camera.of(design.thin_twin), piece) if sampling.below_noise else 0.0
    if scene.surfaces and level > 0:
        mean = {"objects": (White(level=level),), "background": 0.0}
        even = [(one, each.model_copy(update=mean)) for one, each in scenes]
        whites = [(one, _Job(design, each, effects, budget, sampling, count, core)) for one, each in even]
        # Where rays have to tell white as well, they would scatter as much in it.
        whites = [] if any(job.traced for _, job in whites) else whites
        over = level if whites else over
    jobs = [(one, _Job(design, each, effects, budget, sampling, count, core, over)) for one, each in scenes] + whites
    pixels = np.zeros((piece.rows, piece.columns), np.float32)
    generator = np.random.default_rng(seed)
    for number, (one, job) in enumerate(jobs):
        share = part_of(progress, min(number / len(scenes), 1.0), min((number + 1) / len(scenes), 1.0))
        for row, band in job.bands(piece, share):
            _put(pixels, row, band, one, design, piece)
        for light, source in job.sources():
            _put(pixels, 0, light * point_image(source, piece, job.colours, job.tolerance), one, design, piece)
    camera = jobs[0][1].camera
    for row in range(0, piece.rows, CORE):
        rows = piece._replace(row=piece.row + row, rows=min(CORE, piece.rows - row))
        if (taken := pixel_response(camera, rows)) is not None:
            pixels[row : row + CORE] *= taken
    for change in filter(None, (effect.detected for effect in effects.drawn)):
        brief = scene.brief(design)
        # Rows in fixed groups: memory stays small, and the bytes do not depend on anything but the region and the seed.
        for row in range(0, piece.rows, CORE):
            part = pixels[row : row + CORE]
            part[:] = change(part, brief, generator)
    seconds = time.perf_counter() - start
    rays = sum(job.rays for _, job in jobs)
    return RawImage(pixels, piece, design, scene, effects, seed, jobs[0][1].method, sampling, rays, seconds)


def sampling_of(
    design: Design, scene: Scene, effects: Plan, budget: Budget, region: Region, seed: int = 0
) -> RaySampling:
    """Rays for each pixel: as exact as the budget of intensity, or where none is given well below the noise drawn."""
    exposure = scene.light.exposure
    by_noise = budget.intensity is None and effects.on("noise")
    if exposure is None or not by_noise or method_of(design, scene, effects) != "rays":
        return RaySampling(tolerance=max(budget.of("intensity"), 1e-4), seed=seed)
    camera = Camera.of(design.thin_twin)
    rays = rays_for(camera, region, exposure * (mean_light(scene.seen_by(design), camera, region) or 1.0))
    return replace(even_sampling(camera, rays, seed), below_noise=True)


def method_of(design: Design, scene: Scene, effects: Plan) -> str:
    """Method by which a scene would be rendered, as `RawImage.method` has it."""
    _, first = _scenes(design, scene)[0]
    return _Job(design, first, effects, Budget(), RaySampling(), 1).method


def _scenes(design: Design, scene: Scene) -> list[tuple[ColourFilter | None, Scene]]:
    """Scenes that a raw image is put together from: one, or one a colour of the sensor's filters."""
    return [(one, scene.in_light((one.wavelength,))) for one in filters(design.sensor.colours)] or [(None, scene)]


def _put(pixels: Image, row: int, light: Image, one: ColourFilter | None, design: Design, region: Region) -> None:
    """Add light to rows from `row` on: to all their pixels, or to those of one colour."""
    part = pixels[row : row + light.shape[0]]
    if one is None:
        part += light
        return
    own = mosaic(design.sensor.colours, region.column, region.row + row, region.columns, light.shape[0])
    part += np.where(own == FILTERS.index(one), light * np.float32(per_watt(one) / BRIGHTEST), np.float32(0))


class _Layer(NamedTuple):
    """Light without diffraction, on any pixels, what microlenses make of it, and the rays that it takes."""

    light: Geometry
    transfer: MicrolensTransfer
    sampling: RaySampling


def _effort(region: Region, sampling: RaySampling) -> float:
    """Rays of a region, at most."""
    return float(region.columns * region.rows * (sampling.side**2 or sampling.most))


class _Job:
    """One rendering: chooses the way that is exact for the scene, and counts rays."""

    def __init__(
        self,
        design: Design,
        scene: Scene,
        effects: Plan,
        budget: Budget,
        sampling: RaySampling,
        threads: int,
        inner: Region | None = None,
        over: float = 0.0,
    ) -> None:
        self.design, self.scene, self.plan, self.over = design, scene, effects, over
        self.budget, self.tolerance = budget, budget.of("intensity")
        self.sampling, self.threads = sampling, threads
        self.camera = planned_camera(design, effects)
        self.rays, self.done = 0, 0.0
        self.tell: Callable[[float], None] = lambda done: None
        real = real_camera(design, scene, effects)
        self.traced = scene.white is None and bool(scene.surfaces or scene.background)
        exact = effects.on("plate_aberration")
        self.white = self._white(exact) if scene.white is not None and real is None and self.camera.straight else ()
        self.traced |= scene.white is not None and not self.white
        self.transfer = MicrolensTransfer.of(self.camera, effects, scene.light.wavelengths)
        self.lit: Region | None = None
        self.shown = Region(0, 0, 0, 0)
        if inner is not None and self.traced and not self.transfer.trivial:
            self.lit = inner.grown(halo(self.transfer, float(self.camera.q), self.tolerance))
        self.series = self._series()
        ways = {
            "points": scene.white is None and not self.traced,
            "harmonics": self.series is not None,
            "rays": self.traced,
            "convolution": not self.transfer.trivial,
        }
        self.method = next((name for name, used in ways.items() if used), "coverage")

    @cached_property
    def reach(self) -> int:
        """Pixels around the region that scatter into it: defocus is in some layers carried by rays."""
        ways = {self.transfer, replace(self.transfer, defocus=0.0)}
        return max(near_reach(one, float(self.camera.q), self.tolerance) for one in ways)

    @cached_property
    def layers(self) -> list[_Layer]:
        """Layers that a picture is the sum of."""
        if not self.traced:
            return [_Layer(self._lit, self.transfer, RaySampling())]
        light, carried, sampling = self._rays(self.plan, self.sampling)
        if not (carried and self.transfer.defocus):
            return [_Layer(light, self.transfer, sampling)]
        layers = [_Layer(light, replace(self.transfer, defocus=0.0), sampling)]
        # Diffraction out of focus is not that in focus spread as rays are: the rest goes on light in focus.
        rest = replace(self.transfer, beyond_rays=True)
        if self.transfer.wavelengths and rest.largest > NEGLIGIBLE * self.tolerance:
            fewer = sampling.thinned(rest.largest)
            focused, _, fewer = self._rays(self.plan.without("microlens_defocus"), fewer)
            layers.append(_Layer(focused, rest, fewer))
        return layers

    def bands(self, region: Region, progress: Callable[[float], None]) -> Iterator[tuple[int, Image]]:
        """Everything but point sources, a band of rows at a time; `progress` is told the share that is done."""
        white = self.scene.white
        if self.series is not None and white is not None:
            for row in range(0, region.rows, CORE):
                piece = region._replace(row=region.row + row, rows=min(CORE, region.rows - row))
                yield row, np.float32(white) * self._harmonics(self.series, piece)
                progress((row + piece.rows) / region.rows)
        elif not self.traced and white is None:
            yield 0, np.zeros((region.rows, region.columns), np.float32)
        else:
            pixel, tolerance = float(self.camera.q), self.tolerance
            self.shown = region
            wide = region if self.transfer.trivial else region.grown(halo(self.transfer, pixel, tolerance))
            due = sum(_effort(*part) for layer in self.layers for part in self._parts(wide, layer.sampling))
            self.tell = lambda done: progress(min(done / due, 1.0))
            each = [bands(region, layer.light, layer.transfer, pixel, self.threads, tolerance) for layer in self.layers]
            for pieces in zip(*each, strict=True):
                yield pieces[0][0], sum((image for _, image in pieces[1:]), pieces[0][1])

    def _lit(self, region: Region, fine: int) -> Image:
        """White light without diffraction, on any pixels."""
        first, *others = (way.image(region, fine) for way in self.white)
        self._told(region, RaySampling())
        return np.float32(self.scene.white or 0.0) * (np.mean([first, *others], axis=0) if others else first)

    def _rays(self, effects: Plan, sampling: RaySampling) -> tuple[Geometry, bool, RaySampling]:
        """Traced light without diffraction, on any pixels; if it carries the defocus of whole microlenses; its rays."""
        real = real_camera(self.design, self.scene, effects, self.over)
        tracer = real or Tracer.of(self.design.thin_twin, effects, self.scene, self.over)
        if real is not None:
            sampling = replace(sampling, side=sampling.side or real.side)
        elif sampling.least < sampling.most and self.transfer.wavelengths:
            sampling = self._enough(tracer, sampling)

        def some(part: Region, each: RaySampling, fine: int) -> tuple[Region, RaySampling, Image, int]:
            coarse = fine if each.most >= fine**2 else max(1, fine // 2)
            light, rays = tracer.image(part, each, coarse)
            return part, each, light.repeat(fine // coarse, 0).repeat(fine // coarse, 1), rays

        def traced(region: Region, fine: int) -> Image:
            image = np.zeros((region.rows * fine, region.columns * fine), np.float32)
            pieces = [
                (part._replace(row=row, rows=min(tracer.rows, part.row + part.rows - row)), each, fine)
                for part, each in self._parts(region, sampling)
                for row in range(part.row, part.row + part.rows, tracer.rows)
            ]
            # A traced lens takes much room at a time.
            with ThreadPoolExecutor(self.threads if real is None else 1) as pool:
                for part, each, light, rays in pool.map(some, *zip(*pieces, strict=True)):
                    self.rays += rays
                    top, left = (part.row - region.row) * fine, (part.column - region.column) * fine
                    image[top : top + light.shape[0], left : left + light.shape[1]] = light
                    self._told(part, each)
            return image

        return traced, tracer.finite, sampling

    def _enough(self, tracer: Any, sampling: RaySampling) -> RaySampling:
        """As many rays for each pixel as keep 99 of 100 within twice the tolerance, behind diffraction, on patches.

        A pixel's own rays cannot tell it: those that agree by chance would stop, and their error not be averaged.
        """
        transfer, pixel = replace(self.transfer, defocus=0.0), float(self.camera.q)
        fine, reach, shown = fineness(transfer, pixel), near_reach(transfer, pixel, self.tolerance), self.shown
        columns, rows = min(PATCH, shown.columns), min(PATCH, shown.rows)
        corners = np.random.default_rng([sampling.seed, PATCH]).random((PATCHES, 2))
        corners = (corners * [shown.columns - columns + 1, shown.rows - rows + 1]).astype(int) + shown[:2]
        patches = [Region(column, row, columns, rows).grown(reach) for column, row in corners.tolist()]
        rays = FEWEST
        while rays < sampling.most:
            ways = [replace(sampling, least=rays, most=rays, seed=sampling.seed + n, together=TOGETHER) for n in (0, 1)]
            pairs = [[tracer.image(patch, way, fine)[0] for way in ways] for patch in patches]
            off = [blurred(one - other, transfer, pixel / fine, reach * fine, fine) for one, other in pairs]
            if SAFETY * np.quantile(np.abs(off), 0.99) <= 2 * math.sqrt(2) * sampling.tolerance:
                break
            rays *= 2
        return replace(sampling, least=min(rays, sampling.most), most=min(rays, sampling.most), together=TOGETHER)

    def _parts(self, region: Region, sampling: RaySampling) -> Iterator[tuple[Region, RaySampling]]:
        """Parts of a region whose light is looked at, with the rays that it gets."""
        lit = region if self.lit is None else region.common(self.lit)
        near = lit.common(self.shown.grown(self.reach))
        parts = [(near, sampling), *((part, sampling.thinned(AROUND)) for part in lit.around(near))]
        yield from (part for part in parts if part[0].rows > 0 and part[0].columns > 0)

    def _told(self, region: Region, sampling: RaySampling) -> None:
        """Count what is done."""
        self.done += _effort(region, sampling)
        self.tell(self.done)

    def _white(self, exact: bool) -> tuple[WhiteGeometry, ...]:
        """Shapes of a uniform scene's images, one a wavelength by Snell's law; none where rays have to tell them."""
        geometry = WhiteGeometry.of(self.camera, self.plan)
        if not exact:
            return (geometry,)
        colours = self.scene.light.wavelengths or (self.design.wavelength,)
        most = self.plan["plate_aberration"].budget
        ways = [way for colour in colours if (way := geometry.by_snell(most, colour)) is not None]
        return tuple(ways) if len(ways) == len(colours) else ()

    def _harmonics(self, series: HarmonicSeries, region: Region) -> Image:
        x, y = pixel_centres(self.camera, region)
        image = series.at(x, y)
        return add_falloff(image, self.camera, x, y) if self.plan.on("cos4") else image

    def _series(self) -> HarmonicSeries | None:
        """The exact series, where neighbours are alike and diffraction ends it."""
        if self.scene.white is None or self.traced or not self.transfer.wavelengths:
            return None
        if self.plan.on("plate_aberration"):
            return None
        if self.plan.on("vignetting") and self.plan["vignetting"].estimate > 0:
            return None
        if not self.plan.on("overlap") or not _array_fills_the_view(self.camera):
            return None
        if self.transfer.cutoff * self.camera.d > MOST_ORDERS:
            return None
        series = harmonic_series(self.camera, self.transfer)
        return series if series.rows <= MOST_ROWS else None

    def sources(self) -> Iterator[tuple[np.float32, PointSource]]:
        """Point sources and their light, as the main lens's centre sees them."""
        if self.scene.points and self.camera.tilted:
            message = "point sources through tilted parts are not rendered; add `effects` -tilts to take them as ideal"
            raise refusal("effects", message)
        exact = self.plan.on("plate_aberration")
        camera = self.camera
        lens_x, lens_y = camera.lens_centre
        for thing in self.scene.points:
            for position in camera.chain.unfolded(thing.positions):
                share, apparent = (self._mapped if camera.mapping.bends else self._straight)(*position)
                light = thing.flux * share
                x, y, distance = (float(number) for number in apparent)
                if light == 0:  # outside what the objective images
                    continue
                place = (float(position[0]), float(position[1]), float(position[2])) if exact else None
                yield np.float32(light), PointSource(camera, float(x - lens_x), float(y - lens_y), distance, place)

    def _straight(self, x: float, y: float, z: float) -> tuple[float, tuple[Number, Number, Number]]:
        """Light of a point, and where the main lens sees it."""
        camera = self.camera
        apparent = camera.image_of(x, y, z)
        if not self.plan.on("cos4"):
            return 1.0, apparent
        u, v, distance = (float(number) for number in apparent)
        away = (distance - camera.seen.d_3) / chief_spread(camera)
        return float(camera.mapping.light(math.hypot(u, v) / abs(float(away)))), apparent

    def _mapped(self, x: float, y: float, z: float) -> tuple[float, tuple[Number, Number, Number]]:
        """Light of a point before an objective with a mapping, and where the main lens sees it.

        It is drawn smaller off the axis, with as much less light; its place is midway between its foci along and across
        the field.

        Raises
        ------
        InputError
            These are so far apart that one focus does not stand for both.
        """
        camera = self.camera
        _, p = camera.straight_ray(x, y, z)
        if p >= camera.mapping.kernel[0, 1]:
            return 0.0, camera.image_of(x, y, z)
        along, across = float(camera.tangential_stretch(p)), float(camera.sagittal_stretch(p))
        place = float(p / outer_slope(camera, 1.0))
        one, other = (blur / float(camera.d) for blur in mapped_blur(camera, z, place))
        if abs(one - other) > self.budget.pitch:
            message = (
                f"the point at ({x:g}, {y:g}, {z:g}) mm is drawn out by {abs(one - other):.3g} pitches by the "
                f"objective's mapping, more than the budget of {self.budget.pitch:g}; move it nearer the axis or "
                "farther away, or draw it as a small plane"
            )
            raise InputError((Problem("objects", message),), self.scene.name)
        pupil = camera.entrance_pupil_distance
        focus = pupil + (z - pupil) * 2 / (1 / along + 1 / across)
        (u, v), _ = camera.straight_ray(x, y, z, plane=focus)
        shown = float(falloff(camera, p)) if self.plan.on("cos4") else 1.0
        return shown / (along * across), camera.first_order_image(u, v, focus)

    @property
    def colours(self) -> tuple[float, ...]:
        """Wavelengths in which point sources diffract; none where no diffraction is asked for."""
        if not (self.plan.on("microlens_diffraction") or self.plan.on("fap_diffraction")):
            return ()
        return self.scene.light.wavelengths or (self.design.wavelength,)


def _array_fills_the_view(camera: Camera) -> bool:
    """Whether microlens images cover all of the sensor, with half of one to spare on each side."""
    lattice = ImageLattice.of(camera)
    half = np.array(camera.pixels) * camera.q / 2
    corners = half * [[-1, -1], [-1, 1], [1, -1], [1, 1]]
    place = np.linalg.solve(lattice.image_axes, (corners - lattice.image_origin).T).T @ lattice.axes.T
    return bool((np.abs(place) <= lattice.half_size - camera.d / 2).all())
