"""Pictures that simulated depth is measured in: part of the sensor, scene by default, rays, and what they cost."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..calibration.lattice import CentreLattice
from ..camera import Camera
from ..design import Design
from ..design.parts import MOST_CONTRAST
from ..effects import Budget, plan
from ..effects.elements import PLATE_ABERRATION
from ..imaging import transfer
from ..imaging.camera import ImageLattice, Region
from ..imaging.render import RawImage, render
from ..imaging.sampling import (
    LOOKS,
    RAYS,
    SECONDS,
    SLOWER,
    even_sampling,
    light_met,
    looked_at,
    rays_for,
    render_seconds,
    samples_along,
)
from ..imaging.surfaces import seen_distances
from ..options import Options
from ..scenes import Noise, Plane, Scene
from ..scenes.scene import chief_ray_limits
from ..seeds import Seed
from ..shapes.lattice import PACKINGS
from ..theory.depth_error import overlapping
from ..theory.photometry import electrons, exposure
from ..theory.quantities import QUANTITIES
from ..theory.stop_images import MicrolensImages
from .geometry import ArrayGeometry, depth_of, disparity_of
from .traced_views import TracedViews

Array = NDArray[np.float64]

DETAIL = 2.5
"""Period of the finest detail of the scene that is looked at where none is given [microlenses]."""
SLANT = 0.5
"""Half the range of disparities over the width of that scene [pitches]."""
LONGEST, STEEPEST = 1.25, 3.0
"""Length of that scene between two neighbouring microlenses over the frontal one, at most: so its finest detail has two
microlenses a period wherever it is looked at. Slope at most."""
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
START, DECODED = 0.5, 7e-7
"""Processor time of an exposure, about, and of each of its pixels, which is decoded and measured [s]."""
JOINT = 0.015
"""Processor time of each microlens, about, whose texture and disparity are fitted together [s]."""


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


class PictureOptions(Options):
    """Pictures that are taken, of a camera that is simulated."""

    region: tuple[int, int, int, int] | None = None
    """Column, row, columns and rows of the sensor. Default: a strip across its middle."""
    seed: Seed = 0
    """Seed of the noise; the same seed gives the same bytes."""
    exposures: Annotated[int, Field(ge=1)] = 1
    """Pictures, which differ by noise alone."""
    rays: Annotated[int, Field(ge=1)] | None = None
    """Rays of each pixel. Default: as many as the light calls for."""

    def part(self, design: Design) -> Region:
        """Part of a design's sensor that is looked at."""
        return Region.checked(Camera.of(design), self.region) if self.region else _default_region(design)


class Framed(NamedTuple):
    """Part of the sensor that is looked at, and what is taken around it."""

    region: Region
    wide: Region
    """With its margin, as far as the sensor reaches."""
    margin: int
    """Width of what is measured beside the region [px]: `BESIDE` microlenses, and as many as views look past it."""

    @classmethod
    def of(cls, design: Design, scene: Scene | None, region: Region) -> Framed:
        """Around a region in which a design looks at a scene; of None what lies out of focus is left out."""
        camera = Camera.of(design.thin_twin)
        pitch = abs(float(QUANTITIES["image_pitch_mm"](camera) / camera.q))
        margin = math.ceil(_beside(design, scene, region) * pitch)
        return cls(region, region.grown(margin).common(Region.checked(camera, None)), margin)


class Unexposed(NamedTuple):
    """Pictures without noise and veil, of which exposures are made with any light; of a region with its margin."""

    scene: RawImage
    white: RawImage

    @classmethod
    def of(
        cls,
        design: Design,
        scene: Scene,
        framed: Framed,
        *,
        seed: int = 0,
        rays: int = RAYS,
        progress: Callable[[float], None] = lambda share: None,
        white_progress: Callable[[float], None] = lambda share: None,
    ) -> Unexposed:
        """Rendered of a scene and of white, with so many rays a pixel."""
        # Rays through elements go as depth has them, however near that is to first order.
        exact = [f"+{PLATE_ABERRATION.name}"] if PLATE_ABERRATION.available(design) else []
        lines = plan(design, scene, Budget(), ["-noise", *SHIFTING, *exact]).without("veil")
        sampling = even_sampling(Camera.of(design.thin_twin), rays, seed)
        # Light is drawn so far around what has to be right, and no microlens of the margin is to be left dark.
        right = framed.region.grown(max(0, framed.margin - transfer.LEAST_HALO)).common(framed.wide)
        quiet = scene.model_copy(update={"light": scene.light.model_copy(update={"exposure": None})})
        shown = partial(render, design, seed=seed, region=framed.wide, inner=right)
        white = shown(None, effects=lines, sampling=replace(sampling, side=0), progress=white_progress)
        over = scene.brightness if scene.white is None and scene.surfaces else 0.0
        geometry = ArrayGeometry(design)
        over *= light_on(scene, geometry, framed.region)
        picture = shown(quiet, effects=lines, over=over, sampling=sampling, progress=progress)
        # Rays tell only what the scene is brighter or darker than its mean, which the white picture has without them.
        return cls(replace(picture, pixels=picture.pixels + np.float32(over) * white.pixels), white)


def default_scene(design: Design) -> Scene:
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
    sample = _stretched(design) * float(QUANTITIES["object_sample_mm"](camera))
    texture = Noise(finest=DETAIL * sample, contrast=contrast, seed=1)
    return Scene(name="slanted wall", objects=(Plane(tilt=(0.0, math.atan(slope)), texture=texture),))


def _steepest(sight: float) -> float:
    """Largest slope of a wall on which neighbouring chief rays, of slopes up to `sight`, lie `LONGEST` apart at most.

    A wall z = z_0 + m x meets the chief ray of slope t at x = t (z_0 - d_3)/(1 - m t): microlenses alike in t lie
    sqrt(1 + m^2)/(1 - m t)^2 as far apart on it as on one that faces the camera.
    """
    slopes = np.linspace(0, min(STEEPEST, 1 / max(sight, 1e-9)), 3001)[:-1]
    longer = np.sqrt(1 + slopes**2) / (1 - slopes * sight) ** 2
    return float(slopes[longer <= LONGEST][-1])


def _stretched(design: Design) -> float:
    """How far apart neighbouring chief rays meet the focal plane over first order, where that is most; at least 1."""
    geometry, share = ArrayGeometry(design), np.linspace(-0.5, 0.5, LOOKS)
    if geometry.traced is None:
        return 1.0
    d = float(geometry.camera.d)
    along, down = (share * size / abs(design.sensor.relay_magnification) for size in design.sensor.size)
    places = np.stack(np.meshgrid(along, down), -1).reshape(-1, 1, 2) + d / 2 * np.concatenate([np.eye(2), -np.eye(2)])
    rays = chief_rays(geometry.camera, geometry.traced, places.reshape(-1, 2))
    met = (rays[:, :2] - rays[:, 2:] * design.d_f).reshape(-1, 2, 2, 2)
    apart = met[:, 0] - met[:, 1]
    most = np.linalg.norm(apart[np.isfinite(apart).all((1, 2))], 2, (1, 2)).max(initial=0.0)
    return max(1.0, float(most) / float(QUANTITIES["object_sample_mm"](geometry.camera)))


def _rays_seen(geometry: ArrayGeometry, region: Region) -> Array:
    """Chief rays at some places of a region."""
    return chief_rays(geometry.camera, geometry.traced, looked_at(geometry.camera, region))


def light_on(scene: Scene, geometry: ArrayGeometry, region: Region) -> float:
    """Mean light of a region over that of the focal plane, where a scene is as bright as on average."""
    return light_met(scene, geometry.camera, _rays_seen(geometry, region))


def in_scene_light(design: Design, scene: Scene, level: float) -> Design:
    """Design that exposes as a scene states; itself where it states nothing.

    Parameters
    ----------
    level : float
        Brightness of what is looked at over white, as bright as the scene has it at the focal plane.
    """
    white, camera = scene.light.exposure, Camera.of(design.thin_twin)
    if white is None:
        return design
    changes = {"light.exposure": float(exposure(camera)) * white * level / float(electrons(camera))}
    if "read_noise" in scene.light.model_fields_set:
        changes["sensor.read_noise"] = scene.light.read_noise
    return design.replace(changes)


def _beside(design: Design, scene: Scene | None, region: Region) -> float:
    """Microlenses beside a region that are measured as well: `BESIDE`, and as many as views look past it."""
    geometry = ArrayGeometry(design)
    camera, beside = geometry.camera, BESIDE + _aside(design, region) / 2
    if scene is not None:
        met = seen_distances(scene, camera, _rays_seen(geometry, region))
        beside += float(np.abs(disparity_of(camera, met[np.isfinite(met)])).max(initial=0.0)) / 2
    return beside


@lru_cache(maxsize=4)
def _aside(design: Design, region: Region) -> float:
    """Microlenses that views of a focal plane look aside, at most, as lens and elements make them."""
    geometry = ArrayGeometry(design)
    if geometry.traced is None:
        return 0.0
    _, aside = geometry.traced.bends(looked_at(geometry.camera, region))
    return float(np.linalg.norm(aside, 2, (1, 2)).max())


def _default_region(design: Design) -> Region:
    """A strip of microlenses through the middle, all of the sensor's width where `LONG` allows."""
    camera, window = Camera.of(design.thin_twin), design.depth.window
    width, height = camera.pixels
    pitch = abs(float(QUANTITIES["image_pitch_mm"](camera)) / float(camera.q))
    across = max(STRIP, WINDOWS * window**2 / max(width / pitch - window, 1.0) + window)
    each = rays_for(camera) * max(1.0, float(QUANTITIES["fill_factor"](camera)) ** 2)  # of all that overlap
    strip = min(height, math.ceil(STRIP * pitch))
    beside = _beside(design, None, Region(0, (height - strip) // 2, width, strip))
    across = np.clip(LONG / (each * width * pitch) - 2 * beside, STRIP, across)
    rows = min(height, math.ceil(across * pitch))
    columns = min(width, math.ceil(max(LONG / (each * (across + 2 * beside)) / pitch, STRIP * pitch)))
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
    def of(
        cls, design: Design, options: PictureOptions, framed: Framed | None = None, light: float | None = None
    ) -> Work:
        """Work of pictures that a design takes, in so many electrons; of a scene that nobody knows yet without both."""
        camera = Camera.of(design.thin_twin)
        _, wide, _ = framed or Framed.of(design, None, options.part(design))
        rays = options.rays or rays_for(camera, wide, light)
        pixels, slower = wide.columns * wide.rows, SLOWER if design.traced_through else 1.0
        if design.thin_twin is not design:
            rays = samples_along(rays) ** 2
        white = pixels * SECONDS["pixel"] * (slower - 0.9)
        exposure = START + pixels * DECODED
        if not design.traced_through and overlapping(camera):
            exposure += JOINT * pixels * float(camera.q / QUANTITIES["image_pitch_mm"](camera)) ** 2
        return cls(pixels, rays, white, render_seconds(design, pixels, rays), exposure, options.exposures)

    @property
    def seconds(self) -> float:
        """All of it."""
        return self.white + self.picture + self.exposures * self.exposure

    def __str__(self) -> str:
        shots = "" if self.exposures == 1 else f", {self.exposures} exposures"
        return f"{self.pixels / 1e6:.2g} million pixels x {self.rays} rays{shots}"


def chief_rays(camera: Camera, traced: TracedViews | None, places: Array) -> Array:
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
