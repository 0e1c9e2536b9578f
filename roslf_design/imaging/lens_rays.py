"""Images through a real main lens: every sample of the sensor looks through its microlens and the traced lens.

Microlenses are taken one after the other. Where each one's light falls is found beforehand from a grid of exact rays,
and only there the sensor is sampled. A sample on the rim of an image counts by how much of it lies inside, so that few
are needed for smooth edges.

Radiance is the same all along a ray, so a pixel's light is what its rays towards the microlens meet, times cos^4 of
the angle of that through its middle: a microlens that images the pupil sharply, by Abbe's sine condition, spreads the
light of each of its points evenly over itself. Rays of a flat lens, each with its own cos^4, would come more from the
side of the microlens that the pixel lies on, and views look to there. The cos^4 in front of the lens, which an ideal
lens has to be given, is already there: a traced lens makes the microlens images larger or smaller by what it costs in
etendue.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .._jit import kernel
from ..camera import Camera
from ..design import Design
from ..effects import Plan
from ..errors import InputError, Problem
from ..lenses.tracer import BLOCK
from ..rays.backward import behind_elements, lay_out
from ..scenes import Scene
from ..shapes.lattice import Lattice, lens_centres
from ..theory.lens_shapes import LENS_SHAPES
from ..theory.light import microlens_defocus_blur
from ..theory.photometry import source_in_tip
from ..traced.camera import LensCamera, camera_of, chief_slope, microlenses, tilted_parts, views
from .camera import Floats, Image, Region, pixel_centres, straightened
from .surfaces import BLOCK_ROWS, LIGHT, SLOPE_X, SLOPE_Y, Surfaces, X, Y, encode, look
from .trace import RaySampling, refocused

LENS_EFFECTS = ("lens_aberrations", "lens_distortion", "field_curvature", "lens_colour")
"""Any of these asks for the traced lens."""
NODE_SPACING, RANGES = 1.5, (97, 33)
"""Distance of places on the array [mm], and sensor points behind each along a side, that tell where light falls: behind
all of the lens, then about what is lit."""
BATCH = 100_000
"""Samples traced at once."""
STRIP = 256
"""Rows of pixels sampled at once."""
PINHOLE_SAMPLES, LENS_SAMPLES = 4, 6
"""Samples along a pixel's side, through pinhole microlenses and through whole ones."""


class _ObjectRays(NamedTuple):
    """Rays in front of all elements, all arrays of one shape."""

    x: Floats
    y: Floats
    """Points where they, prolonged, cross the plane of the FAP [mm]."""
    slope_x: Floats
    slope_y: Floats
    margin: Floats
    """Least of 1 less squared heights over those of all that clips, negative where clipped."""


LensRays = Callable[[Floats, Floats, Floats, Floats], _ObjectRays]
"""Function from points of the microlens array and image-side slopes there to object-side rays."""


def real_camera(design: Design, scene: Scene, plan: Plan, over: float = 0.0) -> _RealLensTracer | None:
    """Tracer of a design's real lens for a plan, of what of a scene is brighter than `over`.

    None where the lens is ideal, or all its effects are off.

    Raises
    ------
    InputError
        Combinations that are not rendered: point sources, tilts of other parts than the main lens, FAP diffraction.
    """
    if not any(plan.on(name) for name in LENS_EFFECTS):
        return None
    straight = straightened(design, plan)
    off = "switch off " + ", ".join(f"-{name}" for name in LENS_EFFECTS) + " to take the lens as thin"
    problems = []
    if scene.points:
        problems.append(Problem("objects", f"point sources behind a real main lens are not rendered; {off}"))
    if tilted := tilted_parts(straight):
        message = f"a tilted {' and '.join(tilted)} behind a real main lens is not rendered; add -tilts, or {off}"
        problems.append(Problem("effects", message))
    textured = scene.white is None
    if textured and plan.on("fap_diffraction") and not plan.on("microlens_diffraction"):
        message = f"FAP diffraction alone is not rendered behind a real main lens; add -fap_diffraction, or {off}"
        problems.append(Problem("effects", message))
    if textured and not plan.on("overlap") and plan["overlap"].estimate > plan["overlap"].budget:
        problems.append(
            Problem("effects", f"a textured scene behind a real main lens keeps overlaps; drop -overlap, or {off}")
        )
    if problems:
        raise InputError(tuple(problems), design.name)
    return _tracer(straight, plan, scene, over)


@functools.lru_cache(maxsize=6)
def _tracer(design: Design, plan: Plan, scene: Scene, over: float) -> _RealLensTracer:
    """Remembered, as finding where light falls takes longer than a small region's picture."""
    return _RealLensTracer.of(design, plan, scene, over)


@dataclass(frozen=True, eq=False)
class _RealLensTracer:
    """Everything that tracing takes."""

    camera: Camera
    """Camera without the misalignments that are left out."""
    microlenses: Floats
    """Axes in the lens's frame (M, 2) [mm]."""
    boxes: Floats
    """Box in which the light behind each may fall, from its axis: low x, low y, high x, high y (M, 4) [mm]."""
    ways: tuple[LensRays, ...]
    """Rays of each wavelength."""
    apparent_pupil: Floats
    """Apparent pupil and focal plane, for rays to the scene: A and E (x, y) of the focal plane's `ImagedPlane`, the FAP
    and that plane as seen [mm], then `Layout.front`, (16,)."""
    surfaces: Surfaces | None
    """Surfaces of the scene; None for a uniform one."""
    level: float
    """Radiance of that."""
    finite: bool
    """Whether rays go all over a microlens, rather than through its middle."""
    in_focus: bool
    """Whether objects are taken on the focal plane."""
    falloff: bool
    own_only: bool
    """Whether no pixel of a uniform scene gets more than a whole image gives."""
    mouth: float
    """Z of the bore's mouth [mm]."""
    rows: ClassVar[int] = STRIP
    """Rows of pixels that are best traced at a time."""

    @classmethod
    def of(cls, design: Design, plan: Plan, scene: Scene, over: float) -> _RealLensTracer:
        """Tracer for a design without tilts of other parts than the main lens, a plan and a scene."""
        mounted = camera_of(design)
        camera = Camera.of(design).replace({}, in_focus=not plan.on("microlens_defocus"))
        waves = (scene.light.wavelengths or (design.wavelength,)) if plan.on("lens_colour") else (design.wavelength,)
        level = scene.white
        finite = level is None and plan.on("finite_microlens_aperture")
        blur = float(microlens_defocus_blur(camera)) * math.sqrt(0.5) + design.d * design.d_2 / design.d_1
        boxes = _boxes(design, waves) + (blur if finite else 0.0) * np.array([-1, -1, 1, 1])
        forced = not plan.on("vignetting") and plan["vignetting"].estimate > plan["vignetting"].budget
        focus = camera.focus
        sight = [focus.a, *focus.axis_offset, camera.seen.d_3, focus.distance, *lay_out(camera).front]
        return cls(
            camera,
            _axes(design),
            np.where(np.isfinite(boxes).all(1, keepdims=True), boxes, 0.0),
            tuple(_way(mounted, wave, forced) for wave in waves),
            np.array(sight, float),
            encode(scene, design.d_f, camera.chain.mirrored, over, source_in_tip(camera)) if level is None else None,
            0.0 if level is None else level,
            finite,
            not plan.on("object_defocus") and not camera.mapping.bends,
            plan.on("cos4"),
            level is not None and not plan.on("overlap"),
            float(camera.tip),
        )

    @property
    def side(self) -> int:
        """Samples along a pixel's side, where nobody says."""
        return LENS_SAMPLES if self.finite else PINHOLE_SAMPLES

    def image(self, region: Region, sampling: RaySampling, fine: int = 1) -> tuple[Image, int]:
        """Relative intensities of a region, float32 (rows * fine, columns * fine), and how many rays were traced."""
        per = math.ceil((sampling.side or self.side) / fine)
        out = np.zeros((region.rows * fine, region.columns * fine), np.float32)
        rays = 0
        for row in range(0, region.rows, STRIP):
            rows = min(STRIP, region.rows - row)
            piece = Region(region.column, region.row + row, region.columns, rows)
            strip, spent = self._strip(piece, fine * per, sampling.seed)
            rays += spent
            shape = (rows * fine, per, region.columns * fine, per)
            out[row * fine : (row + rows) * fine] = strip.reshape(shape).mean((1, 3))
        return out, rays

    def _strip(self, piece: Region, fine: int, seed: int) -> tuple[Image, int]:
        """One sample for each of so many subpixels, (rows * fine, columns * fine), and how many rays it took."""
        x, y = pixel_centres(self.camera, piece, fine)
        step = float(self.camera.q) / fine
        start = np.array([x[0], y[0]]) + np.array(self.camera.decentre("sensor"))
        total = np.zeros((y.size, x.size), np.float32)
        low = np.floor((self.microlenses + self.boxes[:, :2] - start) / step).astype(int)
        high = np.ceil((self.microlenses + self.boxes[:, 2:] - start) / step).astype(int)
        near = np.all((high >= 0) & (low < [x.size, y.size]) & (self.boxes[:, 2:] > self.boxes[:, :2]), axis=1)
        chosen = np.flatnonzero(near)
        # Alike in size, so that the common window of a batch fits all of it.
        sizes = (high - low)[chosen].max(1) + 3
        order = np.argsort(sizes, kind="stable")
        chosen, sizes, spent, first = chosen[order], sizes[order], 0, 0
        while first < len(chosen):
            batch = chosen[first : first + max(1, BATCH // int(sizes[first]) ** 2)]
            width = int(sizes[first + len(batch) - 1])
            first += len(batch)
            k = np.arange(width)
            columns, rows = low[batch, :1] - 1 + k, low[batch, 1:] - 1 + k
            p = start[0] + step * columns, start[1] + step * rows
            lens = self._points_on_lens(columns + piece.column * fine, rows + piece.row * fine, seed)
            light = sum(self._light(way, self.microlenses[batch], p, lens) for way in self.ways) / len(self.ways)
            _deposit.compiled(total, rows[:, 0], columns[:, 0], np.asarray(light, np.float32))
            spent += len(batch) * width * width * len(self.ways)
        if self.own_only:
            np.minimum(total, np.float32(self.level), out=total)
        return total, spent

    def _light(self, way: LensRays, c: Floats, p: tuple[Floats, Floats], w: tuple[Floats, Floats]) -> Floats:
        """Light of samples on windows behind microlenses at `c`, through points `w` of theirs, (n, rows, columns)."""
        n, width = p[0].shape
        shape = (n, width, width)
        x = np.broadcast_to(p[0][:, None, :], shape).reshape(n, -1)
        y = np.broadcast_to(p[1][:, :, None], shape).reshape(n, -1)
        at_x, at_y = c[:, 0, None] + w[0], c[:, 1, None] + w[1]
        leg_x, leg_y = (x - at_x) / self.camera.seen.d_2, (y - at_y) / self.camera.seen.d_2
        rays = way(at_x, at_y, leg_x + w[0] / self.camera.f_ml, leg_y + w[1] / self.camera.f_ml)
        room = np.maximum(rays.margin, -1.0).reshape(shape)
        if self.finite:
            weight = (room >= 0).astype(float)
        else:
            slopes = np.abs(np.gradient(room, axis=1)) + np.abs(np.gradient(room, axis=2))
            weight = np.clip(room / (slopes + 1e-300) + 0.5, 0.0, 1.0)
        light = weight * (self.level if self.surfaces is None else self._met(self.surfaces, rays, weight))
        if self.falloff:  # by the microlens's middle: one without faults fills evenly with light of any point
            off_x, off_y = ((at - c[:, k, None]) / self.camera.seen.d_2 for k, at in enumerate((x, y)))
            light = light / np.square(1 + off_x**2 + off_y**2).reshape(shape)
        return np.asarray(light)

    def _met(self, surfaces: Surfaces, rays: _ObjectRays, weight: Floats) -> Floats:
        """Radiance that rays meet, in the scene's frame: distances from the object-side principal plane."""
        camera = self.camera
        out = np.zeros(weight.size)
        lens_x, lens_y = (float(at) for at in camera.lens_centre)
        _shade_rays.compiled(
            *surfaces, self.mouth, float(camera["aperture.distance"]), float(camera["main_lens.focal_plane"]),
            self.in_focus, not camera.chain.in_air, self.apparent_pupil, lens_x, lens_y,
            rays.x.reshape(-1), rays.y.reshape(-1), rays.slope_x.reshape(-1), rays.slope_y.reshape(-1),
            weight.reshape(-1), out,
        )  # fmt: skip
        return out.reshape(weight.shape)

    def _points_on_lens(self, columns: Any, rows: Any, seed: int) -> tuple[Floats, Floats]:
        """A point on the microlens for every sample (n, rows * columns), evenly spread over neighbouring ones [mm]."""
        n = len(columns)
        if not self.finite:
            return np.zeros((n, 1)), np.zeros((n, 1))
        turn, i, j = 0.5 + 0.001 * (seed % 997), columns[:, None, :], rows[:, :, None]
        # Steps from the plastic number: low discrepancy along both axes and over any block.
        u = ((turn + 0.7548776662466927 * i) + 0.5698402909980532 * j).reshape(n, -1)
        u -= np.floor(u)
        v = ((turn + 0.5698402909980532 * i) + 0.3294 * j).reshape(n, -1) + 0.2 * u
        v -= np.floor(v)
        turned = float(self.camera["microlens_array.rotation"])
        return LENS_SHAPES[self.camera.lens_shape].places(u, v, float(self.camera.d) / 2, turned)


def _axes(design: Design) -> Floats:
    """Axes of all microlenses in the lens's frame (M, 2) [mm]."""
    array = design.microlens_array
    return microlenses(design, lens_centres(Lattice(array.pitch, array.size, array.layout)))


def _way(camera: LensCamera, wavelength: float, only_fap: bool) -> LensRays:
    """Rays of a wavelength; with `only_fap` nothing but the FAP clips."""
    train = camera.train(wavelength)
    rims = [(camera.fap.z - rim.z, rim.x, rim.y, rim.opening) for rim in camera.rims]

    def rays(x: Floats, y: Floats, slope_x: Floats, slope_y: Floats) -> _ObjectRays:
        there = train.lens.through((x, y), (slope_x, slope_y), start=camera.array.z, end=camera.fap.z)
        out = camera.beyond(there, train, clip=False)
        (at_x, at_y), (way_x, way_y) = there.height, there.slope
        room = np.where(out.state == there.state, np.inf, -1.0) if only_fap else out.margin
        for ahead, stop_x, stop_y, opening in rims[: 1 if only_fap else None]:
            off_x, off_y = at_x - way_x * ahead - stop_x, at_y - way_y * ahead - stop_y
            room = np.minimum(room, 1 - opening.height(off_x, off_y))
        (x, y), (slope_x, slope_y) = out.height, out.slope
        return _ObjectRays(x, y, slope_x, slope_y, room)

    return rays


@functools.lru_cache(maxsize=2)
def _boxes(design: Design, waves: tuple[float, ...]) -> Floats:
    """Boxes in which light behind microlenses may fall, low x, low y, high x, high y (M, 4) [mm]; infinite of none.

    From exact rays at nodes all over the array, against first-order rays from the FAP's middle: on a grid behind all of
    the lens, and on a finer one about what is lit.
    """
    camera, places = camera_of(design), _axes(design)
    low, high = places.min(0), places.max(0)
    across, along = (max(2, math.ceil(size / NODE_SPACING) + 1) for size in high - low)
    columns, rows = np.linspace(low[0], high[0], across), np.linspace(low[1], high[1], along)
    bounds = np.empty((along, across, 4))
    for row, y in enumerate(rows):
        c = np.stack([columns, np.full(across, y)], axis=-1)
        half = np.full((across, 1, 2), 0.6 * camera.lens.clear_diameter * camera.d_2 / camera.d_1)
        ends = c[:, None] * (camera.d_2 / camera.d_1) + np.stack([-half, half])
        for count in RANGES:
            share = np.linspace(0, 1, count)
            with np.errstate(invalid="ignore"):  # where nothing is lit
                spot = ends[0] + np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2) * (ends[1] - ends[0])
                step = (ends[1] - ends[0]) / (count - 1)
            lit = np.zeros((*spot.shape[:2], 1), np.bool_)
            for wave in waves:
                at = views(camera, c[:, None], c[:, None] + spot, wave, clip=False)
                lit |= (np.minimum(at.fap_margin, at.margin) >= 0)[..., None]
            least, most = (
                part(spot, axis=1, where=lit, initial=beyond, keepdims=True)
                for part, beyond in ((np.min, np.inf), (np.max, -np.inf))
            )
            ends = np.stack([least - step, most + step])
        ends = ends[:, :, 0] - camera.d_2 * chief_slope(camera, c, camera.fap.centre)
        bounds[row] = np.concatenate([*ends], axis=-1)
    # Each microlens takes what the four nodes around it take.
    around = [(slice(a, along - 1 + a), slice(b, across - 1 + b)) for a in (0, 1) for b in (0, 1)]
    low_box = np.minimum.reduce([bounds[place][..., :2] for place in around])
    high_box = np.maximum.reduce([bounds[place][..., 2:] for place in around])
    spacing = np.maximum((high - low) / [across - 1, along - 1], 1e-12)
    cell = np.minimum(((places - low) / spacing).astype(int), [across - 2, along - 2])
    boxes = np.concatenate([low_box, high_box], axis=-1)[cell[:, 1], cell[:, 0]]
    return np.asarray(boxes + np.tile(camera.d_2 * chief_slope(camera, places, camera.fap.centre), 2))


@kernel()
def _deposit(total: Any, rows: Any, columns: Any, light: Any) -> None:
    """Add windows of light (n, K, K) to an image; what lies beyond it is dropped."""
    for n in range(light.shape[0]):
        for a in range(light.shape[1]):
            j = rows[n] + a
            if j < 0 or j >= total.shape[0]:
                continue
            for b in range(light.shape[2]):
                i = columns[n] + b
                if 0 <= i < total.shape[1]:
                    total[j, i] += light[n, a, b]


@kernel()
def _shade_rays(
    rows: Any, pictures: Any, beyond: float, mirrored: Any, over: float, source: float, mouth: float, d_3: float,
    d_f: float, in_focus: bool, through: bool, sight: Any, lens_x: float, lens_y: float, x: Any, y: Any, slope_x: Any,
    slope_y: Any, weight: Any, out: Any,
) -> None:  # fmt: skip
    """Radiance that object-side rays (points on the FAP's plane and slopes) meet, where their weight is above 0."""
    block, which = np.empty(BLOCK_ROWS * BLOCK), np.empty(BLOCK, np.int64)
    for start in range(0, out.shape[0], BLOCK):
        m = 0
        for i in range(start, min(start + BLOCK, out.shape[0])):
            if not weight[i] > 0.0:
                continue
            ox, oy = slope_x[i], slope_y[i]
            hx, hy = x[i] + lens_x + ox * d_3, y[i] + lens_y + oy * d_3
            if in_focus and through:
                fx = lens_x + (hx - ox * d_f - lens_x - sight[1]) / sight[0]
                fy = lens_y + (hy - oy * d_f - lens_y - sight[2]) / sight[0]
                hx, hy, ox, oy = refocused(sight[3], sight[4], fx, fy, 0.0, 0.0)
                hx, hy, ox, oy = behind_elements(sight[5:], lens_x, lens_y, hx, hy, ox, oy)
            elif in_focus:
                hx, hy, ox, oy = refocused(d_3, d_f, hx, hy, ox, oy)
            block[X + m], block[Y + m], block[SLOPE_X + m], block[SLOPE_Y + m] = hx, hy, ox, oy
            which[m] = i
            m += 1
        look(rows, pictures, beyond, mirrored, over, source, mouth, block, m)
        for i in range(m):
            out[which[i]] = block[LIGHT + i]
