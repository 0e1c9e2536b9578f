"""Textured scenes by backward rays: pixel, microlens aperture and the FAP's diffraction sampled by Sobol points.

Every pixel has its own random exclusive-or scramble of one common point set, so that a pixel's value depends on the
seed and its place alone, never on tiles or threads. Surfaces and textures are laid out as rows of numbers.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._jit import THREADS, kernel, prange
from ..bore.opening import ClearAperture, inside
from ..bore.part import Part
from ..camera import Camera
from ..camera.frames import frame
from ..design import Design
from ..effects import Plan, Subject
from ..effects.elements import exact_minus_paraxial
from ..lenses.angles import NO_LAW, illumination
from ..lenses.tracer import BLOCK, COLUMNS, ROWS
from ..rays.backward import (
    ARRAY_X,
    D_1,
    HALF,
    LENS_RADIUS,
    LENS_X,
    PER_D_2,
    PER_F,
    PER_F_ML,
    SENSOR_X,
    Layout,
    aligned_ray,
    behind_elements,
    crossing,
    lay_out,
    mapped,
    posed_ray,
)
from ..scenes import Checkerboard, Noise, PictureTexture, Plane, Scene, Sinusoid, Sphere, Uniform, White
from ..theory.exit_pupil import microlens_image_diameter
from ..theory.lens_shapes import LENS_SHAPES
from ..theory.light import chief_slope
from ..theory.object_space import ObjectSpaceFaces, outwards
from .camera import Floats, Image, ImageLattice, Region, pixel_centres, planned_camera

PLANE, SPHERE, TUBE = 0, 1, 2
UNIFORM, CHECKERBOARD, SINUSOID, PICTURE = 0, 1, 2, 3

KIND, ORIGIN, NORMAL, ACROSS, ALONG, EXTENT = 0, 1, 4, 7, 10, 13
"""Places in a surface's row: kind; x, y, Z of its origin; a plane's normal and its u and v axes; two lengths (half
width and height of a plane, radius of a sphere, radius and far end of a tube)."""
LOOK, LEVELS, WIDTH = 15, 16, 20
"""Texture's kind; its numbers; length of a row."""

FAR = 1e300
"""Distance of what is not met."""
BATCH = 16
"""Rays between two looks at a pixel's error, where there may be more or fewer."""
FEWEST = 4
"""Rays of pixels that count little, at least."""
WELL_OUTSIDE = 2.0
"""Multiple of the distance by which exact rays miss the closed forms, within which they may pass the FAP's rim."""
MOST = 64
"""Candidate microlenses that one pixel may have."""
DIMENSIONS = 6
"""Dimensions of the Sobol points: pixel (x, y), microlens aperture (x, y), diffraction at the FAP (radius, angle)."""

POSED, PINHOLE, IN_FOCUS, OWN_ONLY, KICKED, ROUND, THROUGH, EXACT = range(8)
"""Flags: something is tilted or rotated; rays through microlens centres; object taken on the focal plane; neighbours'
light left out; FAP diffraction; circular microlenses; elements before the main
lens; exact rays through them."""


@dataclass(frozen=True)
class RaySampling:
    """Sampling: the number of rays that a pixel gets."""

    least: int = 32
    """Rays before the first look at the error."""
    most: int = 1024
    """Rays after which no more are spent."""
    tolerance: float = 0.01
    """Standard error of a pixel's value at which it is done."""
    seed: int = 0
    """Same seed, same bytes."""
    side: int = 0
    """Behind a real main lens: samples along a pixel's side, instead of rays; 0 is a few."""
    together: int = 1
    """Subpixels along the side of blocks whose rays are spread evenly together, a power of two: what they scatter is
    then opposite in neighbours, and diffraction takes most of it away. Samples behind a real main lens always are."""

    def thinned(self, share: float) -> RaySampling:
        """Fewer rays, by a share, for what counts little."""
        least, most = (max(min(FEWEST, rays), math.ceil(rays * share)) for rays in (self.least, self.most))
        return replace(self, least=least, most=most, side=math.ceil(self.side * math.sqrt(share)))


NOWHERE = np.zeros(2)


class Surfaces(NamedTuple):
    """Surfaces that rays may meet."""

    rows: Floats
    """Rows of numbers, one a surface, shape (S, 20)."""
    pictures: Image
    """Pixels of all pictures, one after the other."""
    beyond: float
    """Radiance where nothing is met."""
    mirrored: Floats
    """Direction across the axis along which the scene is seen reversed, (2,); 0 where it is not."""
    over: float
    """Radiance above which what rays meet is counted."""


def encode(scene: Scene, focal_plane: float, mirrored: Floats = NOWHERE, over: float = 0.0) -> Surfaces:
    """Lay a scene out for the kernels; planes that give no distance lie at `focal_plane`, d_f [mm]."""
    rows: list[Floats] = []
    pictures: list[Image] = [np.zeros(1, np.float32)]
    beyond = scene.background
    for thing in scene.surfaces:
        if isinstance(thing, White):
            beyond = thing.level
            continue
        row = np.zeros(WIDTH)
        if isinstance(thing, Plane):
            pose = frame((0.0, 0.0), 0.0, thing.tilt)
            row[KIND] = PLANE
            row[ORIGIN : ORIGIN + 3] = (*thing.centre, focal_plane if thing.distance is None else thing.distance)
            row[ACROSS : ACROSS + 3], row[ALONG : ALONG + 3], row[NORMAL : NORMAL + 3] = pose.x, pose.y, pose.z
            row[EXTENT : EXTENT + 2] = np.inf if thing.size is None else np.divide(thing.size, 2)
        elif isinstance(thing, Sphere):
            row[KIND], row[EXTENT] = SPHERE, thing.radius
            row[ORIGIN : ORIGIN + 3] = (*thing.centre, thing.distance)
        else:
            row[KIND] = TUBE
            row[ORIGIN : ORIGIN + 3] = (*thing.centre, thing.start)
            row[EXTENT : EXTENT + 2] = thing.radius, thing.end
        look, levels = _texture(thing.texture, pictures)
        row[LOOK], row[LEVELS : LEVELS + len(levels)] = look, levels
        rows.append(row)
    return Surfaces(np.array(rows).reshape(-1, WIDTH), np.concatenate(pictures), beyond, mirrored, over)


def _texture(texture: Part, pictures: list[Image]) -> tuple[int, tuple[float, ...]]:
    """Kind and numbers of a texture; a picture's pixels go behind those of others."""
    if isinstance(texture, Checkerboard):
        return CHECKERBOARD, (2 / texture.period, texture.high, texture.low)
    if isinstance(texture, Sinusoid):
        wave = 2 * math.pi / texture.period
        return SINUSOID, (wave * math.cos(texture.angle), wave * math.sin(texture.angle), texture.contrast)
    if isinstance(texture, PictureTexture | Noise):
        values = texture.load()
        first = sum(map(len, pictures))
        pictures.append(values.ravel())
        return PICTURE, (values.shape[1] / texture.width, first, *values.shape)
    assert isinstance(texture, Uniform)
    return UNIFORM, (texture.level,)


@kernel()
def _shade(s: Any, u: float, v: float, pictures: Any) -> float:
    """Radiance of a surface at its own (u, v)."""
    look = int(s[LOOK])
    if look == UNIFORM:
        return float(s[LEVELS])
    if look == CHECKERBOARD:
        odd = (math.floor(u * s[LEVELS]) + math.floor(v * s[LEVELS])) & 1
        return float(s[LEVELS + 2] if odd else s[LEVELS + 1])
    if look == SINUSOID:
        return float(0.5 * (1.0 + s[LEVELS + 2] * math.cos(u * s[LEVELS] + v * s[LEVELS + 1])))
    first, rows, columns = int(s[LEVELS + 1]), int(s[LEVELS + 2]), int(s[LEVELS + 3])
    x = u * s[LEVELS] + 0.5 * columns - 0.5
    y = v * s[LEVELS] + 0.5 * rows - 0.5
    i, j = math.floor(x), math.floor(y)
    fx, fy = x - i, y - j
    i, j = int(i) % columns, int(j) % rows
    i2 = i + 1 if i + 1 < columns else 0
    j2 = j + 1 if j + 1 < rows else 0
    top = pictures[first + j * columns + i] * (1.0 - fx) + pictures[first + j * columns + i2] * fx
    low = pictures[first + j2 * columns + i] * (1.0 - fx) + pictures[first + j2 * columns + i2] * fx
    return float(top * (1.0 - fy) + low * fy)


@kernel()
def distance(s: Any, hx: float, hy: float, ox: float, oy: float) -> float:
    """Distance Z at which the ray (hx - ox Z, hy - oy Z), seen from the lens, meets a surface; FAR where it does not.

    Of a sphere the near side counts, of a tube the wall behind its near end.
    """
    if int(s[KIND]) == PLANE:
        fall = s[NORMAL] * ox + s[NORMAL + 1] * oy + s[NORMAL + 2]
        if fall <= 0.0:
            return FAR
        height = s[NORMAL] * (hx - s[ORIGIN]) + s[NORMAL + 1] * (hy - s[ORIGIN + 1]) + s[NORMAL + 2] * s[ORIGIN + 2]
        return float(height / fall)
    # Counted from the surface's own distance, where the numbers are small.
    rx, ry = hx - ox * s[ORIGIN + 2] - s[ORIGIN], hy - oy * s[ORIGIN + 2] - s[ORIGIN + 1]
    b = rx * ox + ry * oy
    c = rx * rx + ry * ry - s[EXTENT] * s[EXTENT]
    if int(s[KIND]) == SPHERE:
        a = 1.0 + ox * ox + oy * oy
        under = b * b - a * c
        if under < 0.0:
            return FAR
        return float(s[ORIGIN + 2] + (b - math.sqrt(under)) / a)
    a = ox * ox + oy * oy
    if c > 0.0 or a == 0.0:
        return FAR
    z = s[ORIGIN + 2] + (b + math.sqrt(b * b - a * c)) / a
    return float(z if z <= s[EXTENT + 1] else FAR)


@kernel()
def _reversed_along(way: Any, x: float, y: float) -> Any:
    """A point or slope reversed along a direction of unit length; as it is along none."""
    along = 2.0 * (way[0] * x + way[1] * y)
    return x - along * way[0], y - along * way[1]


@kernel()
def _first_hit(rows: Any, mirrored: Any, mouth: float, hx: float, hy: float, ox: float, oy: float) -> Any:
    """First surface beyond the bore's mouth that the ray (hx - ox Z, hy - oy Z) meets: Z, its number, and (u, v) on it.

    FAR and -1 where it meets nothing.
    """
    nearest, hit, at_u, at_v = FAR, -1, 0.0, 0.0
    hx, hy = _reversed_along(mirrored, hx, hy)
    ox, oy = _reversed_along(mirrored, ox, oy)
    for n in range(rows.shape[0]):
        s = rows[n]
        z = distance(s, hx, hy, ox, oy)
        if z >= nearest or z <= mouth:
            continue
        dx, dy, dz = hx - ox * z - s[ORIGIN], hy - oy * z - s[ORIGIN + 1], s[ORIGIN + 2] - z
        if int(s[KIND]) == PLANE:
            u = s[ACROSS] * dx + s[ACROSS + 1] * dy + s[ACROSS + 2] * dz
            v = s[ALONG] * dx + s[ALONG + 1] * dy + s[ALONG + 2] * dz
            if abs(u) > s[EXTENT] or abs(v) > s[EXTENT + 1]:
                continue
        elif int(s[KIND]) == SPHERE:
            u = s[EXTENT] * math.atan2(dx, dz)
            v = s[EXTENT] * math.asin(min(1.0, max(-1.0, dy / s[EXTENT])))
        else:
            u = s[EXTENT] * math.atan2(dy, dx)
            v = z
        nearest, hit, at_u, at_v = z, n, u, v
    return nearest, hit, at_u, at_v


@kernel()
def radiance(
    rows: Any, pictures: Any, beyond: float, mirrored: Any, over: float, mouth: float,
    hx: float, hy: float, ox: float, oy: float,
) -> float:  # fmt: skip
    """Radiance over `over` of what the ray (hx - ox Z, hy - oy Z) meets first beyond the bore's mouth."""
    _, hit, u, v = _first_hit(rows, mirrored, mouth, hx, hy, ox, oy)
    return float((beyond if hit < 0 else _shade(rows[hit], u, v, pictures)) - over)


def seen_distances(scene: Scene, camera: Camera, rays: Floats) -> Floats:
    """Distances Z of what rays meet first beyond the bore's mouth [mm]; inf where they meet nothing.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    rays : ndarray, shape (N, 4)
        (h_x, h_y, o_x, o_y) of rays at ``h - o Z``.
    """
    plane, mouth = float(camera["main_lens.focal_plane"]), float(camera.tip)
    surfaces = encode(scene, plane, camera.chain.mirrored)
    hits = (_first_hit.compiled(surfaces.rows, surfaces.mirrored, mouth, *map(float, ray)) for ray in rays)
    distances = np.array([distance for distance, *_ in hits])
    return np.where(distances < FAR, distances, np.inf)


@kernel()
def refocused(d_3: float, d_f: float, hx: float, hy: float, ox: float, oy: float) -> Any:
    """The ray from the FAP's middle to where a ray (height on the lens, slope) crosses the focal plane."""
    fx, fy = hx - ox * d_f, hy - oy * d_f
    ox, oy = -fx / (d_f - d_3), -fy / (d_f - d_3)
    return ox * d_3, oy * d_3, ox, oy


@functools.lru_cache(maxsize=4)
def sobol_points(count: int) -> NDArray[np.uint32]:
    """First points of the Sobol sequence times 2^32, shape (count, 6): an exclusive-or scrambles them evenly."""
    from scipy.stats.qmc import Sobol

    points = Sobol(DIMENSIONS, scramble=False, bits=32).random_base2((count - 1).bit_length())[:count]
    return np.asarray(points * 2.0**32).astype(np.uint32)


@functools.lru_cache(maxsize=4)
def _shifts(side: int, count: int) -> NDArray[np.uint32]:
    """Scrambles of subpixels in a block, shape (side, side, 6), beside the one that all of it has.

    Points that follow a power of two are the first ones, exclusive-or that one: each subpixel takes those that follow
    its neighbour's along Morton's curve, so that squares of 2, 4, ... subpixels share a net.
    """
    each = 1 << (count - 1).bit_length()
    spread = [sum((k >> bit & 1) << 2 * bit for bit in range(side.bit_length())) for k in range(side)]
    along = np.array(spread)
    return np.ascontiguousarray(sobol_points(side**2 * each)[::each][2 * along[:, None] + along])


NOTHING = ObjectSpaceFaces(np.zeros((0, COLUMNS)), np.zeros((0, 2)), np.zeros(0, np.int16), NO_LAW)


@dataclass(frozen=True, eq=False)
class Tracer:
    """Everything the kernel needs, laid out."""

    camera: Camera
    """Camera as planned."""
    lattice: ImageLattice
    layout: Layout
    flags: NDArray[np.bool_]
    surfaces: Surfaces
    kicks: Floats
    """FAP diffraction, from two numbers n and m: columns a to e give the kick (a_n b_m + d_n, a_n c_m + e_n) [rad]."""
    falloff: float
    """Slope of the chief ray per mm on the array, 0 without cos^4 fall-off."""
    mouth: float
    """Z of the bore's mouth [mm]."""
    colours: tuple[ObjectSpaceFaces, ...]
    """Faces that rays go through before the main lens, once a wavelength; empty where these are not exact."""
    rows: ClassVar[int] = 32
    """Rows of pixels that are best traced at a time."""

    @classmethod
    def of(cls, design: Design, plan: Plan, scene: Scene, over: float = 0.0) -> Tracer:
        """Tracer for a design, a plan and what of a scene is brighter than `over`."""
        camera = planned_camera(design, plan)
        lattice, layout, exact = ImageLattice.of(camera), lay_out(camera), plan.on("plate_aberration")
        if exact:  # rims are met in order, on the way: beforehand only what is far outside the FAP's is left out
            slack = exact_minus_paraxial(design, Subject(design).lens_field, ()).image
            near = layout.rims[:1].copy()
            pupil = camera.fap.outline
            narrowest = float(np.abs(microlens_image_diameter(camera)) * pupil.slimness)
            near[0, 3:] = pupil.scaled(1 + WELL_OUTSIDE * slack / (narrowest / 2)).row()
            lattice, layout = replace(lattice, reach=lattice.reach + slack), layout._replace(rims=near)
        # Where microlenses diffract, a ray blurred at the FAP too would count one uncertainty of place and direction
        # twice: against points carried as coherent waves, rays left alone are nearer the truth.
        kicked = plan.on("fap_diffraction") and not plan.on("microlens_diffraction")
        flags = [
            camera.tilted or camera["microlens_array.rotation"] != 0,
            not plan.on("finite_microlens_aperture"),
            not plan.on("object_defocus"),
            not plan.on("overlap"),
            kicked,
            LENS_SHAPES[camera.lens_shape].round,
            camera.chain.bends_rays,
            exact,
        ]
        wavelengths = scene.light.wavelengths or (design.wavelength,)
        return cls(
            camera,
            lattice,
            layout,
            np.array(flags),
            encode(scene, design.d_f, camera.chain.mirrored, over),
            _kicks(camera.fap.outline.sized(abs(float(camera.seen.D_F))), wavelengths) if kicked else np.zeros((1, 5)),
            float(chief_slope(camera)) if plan.on("cos4") else 0.0,
            float(Camera.of(design).tip),
            tuple(ObjectSpaceFaces.of(camera.replace({"wavelength": w})).for_pixels for w in wavelengths)
            if exact
            else (NOTHING,),
        )

    @property
    def finite(self) -> bool:
        """Whether rays go all over a microlens, rather than through its middle."""
        return not self.flags[PINHOLE]

    def image(self, region: Region, sampling: RaySampling, fine: int = 1) -> tuple[Image, int]:
        """Trace a region.

        Parameters
        ----------
        region : Region
            Pixels; may reach beyond the sensor.
        sampling : Sampling
            Rays are per pixel: subpixels share them.
        fine : int
            Subpixels per pixel and axis.

        Returns
        -------
        image : ndarray of float32, shape (rows * fine, columns * fine)
            Relative intensities: 1 where fully lit white is seen through the whole of a microlens.
        rays : int
            How many were traced.
        """
        camera, lattice = self.camera, self.lattice
        x, y = pixel_centres(camera, region, fine)
        if sampling.least == sampling.most:  # no more and no fewer than asked for
            each = math.ceil(sampling.most / fine**2)
            # Of a net that neighbours share nobody may leave a part out: all would leave out the same.
            counts = np.full(3, each if sampling.together == 1 else 1 << (each - 1).bit_length())
        else:
            counts = np.array([max(BATCH, rays // fine**2) for rays in (sampling.least, sampling.most)] + [BATCH])
        images = np.zeros((len(self.colours), y.size, x.size), np.float32)
        spent = np.zeros((len(self.colours), y.size), np.int64)
        place = np.array([region.column * fine, region.row * fine, sampling.seed])
        points, shifts = sobol_points(int(counts[1])), _shifts(sampling.together, int(counts[1]))
        inverse = np.linalg.inv(lattice.image_axes)
        steps = lattice.axes, lattice.image_axes, inverse, lattice.half_size, lattice.neighbours
        lengths = self.mouth, float(camera.seen.d_3), float(camera.seen.d_f)
        with THREADS:
            for space, image, used in zip(self.colours, images, spent, strict=True):
                _trace.compiled(
                    x, y, float(camera.q) / fine, steps, lattice.image_origin, lattice.reach, self.flags,
                    tuple(self.layout), (space.table, space.media, space.openings), tuple(self.surfaces), self.kicks,
                    self.falloff, lengths, points, shifts, counts, sampling.tolerance * fine, place, image, used,
                )  # fmt: skip
        return images[0] if len(images) == 1 else images.mean(0), int(spent.sum())


def _kicks(opening: ClearAperture, wavelengths: tuple[float, ...], count: int = 4096) -> Floats:
    """Directions of an opening's diffraction at even shares of the light, shape (count, 5): `Tracer.kicks`."""
    from scipy.special import j0, j1, sici

    if opening.half is not None:  # along each side by itself
        x = np.concatenate([-np.geomspace(1e-4, 1e4, 500_000)[::-1], np.geomspace(1e-4, 1e4, 500_000)])
        encircled = 0.5 + (sici(2 * math.pi * x)[0] - np.sin(math.pi * x) ** 2 / (math.pi * x)) / math.pi
        across = np.interp((np.arange(count) + 0.5) / count, np.maximum.accumulate(encircled), x)
        across *= sum(wavelengths) / len(wavelengths)
        (u_x, u_y), (v_x, v_y) = opening.axes
        first, second = (across / float(2 * half) for half in opening.half)
        return np.stack([np.ones(count), second * v_x, second * v_y, first * u_x, first * u_y], -1)
    diameter = 2 * float(opening.radius)
    x = np.concatenate([np.linspace(0, 400, 400_001), np.geomspace(400, 2e4, 100_000)[1:]])
    encircled = 1 - j0(x) ** 2 - j1(x) ** 2
    shares = (np.arange(count) + 0.5) / count
    mean = sum(wavelengths) / len(wavelengths)
    angle = np.interp(shares, np.maximum.accumulate(encircled), x) * mean / (math.pi * diameter)
    turn = 2 * math.pi * shares
    nothing = np.zeros(count)
    return np.stack([angle, np.cos(turn), np.sin(turn), nothing, nothing], -1)


@kernel()
def _hash3(a: Any, b: Any, c: Any) -> Any:
    """Hash of three whole numbers (64-bit finaliser of the splitmix kind)."""
    z = (a * np.uint64(0x9E3779B97F4A7C15)) ^ (b * np.uint64(0xC2B2AE3D27D4EB4F)) ^ (c * np.uint64(0x165667B19E3779F9))
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@kernel()
def _to_scene(
    flags: Any, k: Any, front: Any, law: Any, table: Any, media: Any, openings: Any, buffer: Any, work: Any,
    d_3: float, d_f: float, kick_x: float, kick_y: float, hx: float, hy: float, ox: float, oy: float,
) -> Any:  # fmt: skip
    """A ray that leaves the main lens, as it goes on before all elements, and whether it gets there."""
    ex, ey, tx, ty, fate, imaged = hx, hy, ox, oy, 0, True
    fx, fy, gx, gy = hx, hy, ox, oy
    if flags[EXACT]:
        ex, ey, tx, ty, fate = outwards(table, media, openings, law, buffer, work, hx, hy, ox, oy)
        if fate != 0 or (law.shape[0] == 0 and not flags[IN_FOCUS] and kick_x == 0.0 and kick_y == 0.0):
            return ex, ey, tx, ty, fate == 0
        fx, fy, gx, gy = behind_elements(front, k[LENS_X], k[LENS_X + 1], hx, hy, ox, oy)
        fx, fy, gx, gy, imaged = mapped(law, front, fx, fy, gx, gy)
    if flags[IN_FOCUS]:
        hx, hy, ox, oy = refocused(d_3, d_f, hx, hy, ox, oy)
    ox, oy = ox + kick_x, oy + kick_y
    hx, hy = hx + kick_x * d_3, hy + kick_y * d_3
    if flags[THROUGH]:
        hx, hy, ox, oy = behind_elements(front, k[LENS_X], k[LENS_X + 1], hx, hy, ox, oy)
        hx, hy, ox, oy, imaged = mapped(law, front, hx, hy, ox, oy)
    if flags[EXACT]:  # off the exact ray by as much as these two put the closed forms' ray off
        hx, hy, ox, oy = ex + (hx - fx), ey + (hy - fy), tx + (ox - gx), ty + (oy - gy)
    return hx, hy, ox, oy, fate == 0 and imaged


@kernel()
def _share_of_light(shade: Any, slope: float) -> float:
    """`falloff` at one place."""
    if shade.shape[0] == 0:
        return 1.0 / (1.0 + slope * slope) ** 2
    return float(illumination(shade, slope))


@kernel()
def _candidates(
    lattice: Any, margin: float, bx: float, by: float, lens_x: Any, lens_y: Any, away_x: Any, away_y: Any
) -> int:
    """How many microlenses may light a pixel at a place from the lattice's origin.

    Their axes in the array's frame go to `lens_x` and `lens_y`, how far the pixel is from their images' centres to
    `away_x` and `away_y`.
    """
    axes, image_axes, inverse, half_size, neighbours = lattice
    n = 0
    m0 = math.floor(inverse[0, 0] * bx + inverse[0, 1] * by + 0.5)
    n0 = math.floor(inverse[1, 0] * bx + inverse[1, 1] * by + 0.5)
    for dm in range(-neighbours, neighbours + 1):
        for dn in range(-neighbours, neighbours + 1):
            m, l = m0 + dm, n0 + dn
            gx = bx - (image_axes[0, 0] * m + image_axes[0, 1] * l)
            gy = by - (image_axes[1, 0] * m + image_axes[1, 1] * l)
            if gx * gx + gy * gy > margin * margin:
                continue
            cx, cy = axes[0, 0] * m + axes[0, 1] * l, axes[1, 0] * m + axes[1, 1] * l
            if abs(cx) > half_size[0] or abs(cy) > half_size[1]:
                continue
            if n < MOST:
                lens_x[n], lens_y[n], away_x[n], away_y[n] = cx, cy, gx, gy
                n += 1
    return n


@kernel()
def _seeds(place: Any, shifts: Any, column: int, row: int) -> Any:
    """Scrambles of a pixel's six dimensions: its block's, and its own in that."""
    i, j, side = place[0] + column + 1048576, place[1] + row + 1048576, shifts.shape[0]
    own = shifts[j % side, i % side]
    code = _hash3(np.uint64(i // side), np.uint64(j // side), np.uint64(place[2]))
    s01 = _hash3(code, np.uint64(1), np.uint64(2))
    s23 = _hash3(code, np.uint64(3), np.uint64(4))
    s45 = _hash3(code, np.uint64(5), np.uint64(6))
    low, half = np.uint64(0xFFFFFFFF), np.uint64(32)
    return (
        own[0] ^ np.uint32(s01 & low), own[1] ^ np.uint32(s01 >> half), own[2] ^ np.uint32(s23 & low),
        own[3] ^ np.uint32(s23 >> half), own[4] ^ np.uint32(s45 & low), own[5] ^ np.uint32(s45 >> half),
    )  # fmt: skip


@kernel(inline=True)
def _on_microlens(is_round: bool, a: float, b: float, half: float) -> Any:
    """Point of a microlens for two numbers from 0 to 1 [mm]."""
    if is_round:
        rho, phi = half * math.sqrt(a), 2.0 * math.pi * b
        return rho * math.cos(phi), rho * math.sin(phi)
    return (2.0 * a - 1.0) * half, (2.0 * b - 1.0) * half


@kernel(inline=True)
def _through_lens(
    posed: bool, k: Any, maps: Any, rims: Any, px: float, py: float, cx: float, cy: float, vx: float, vy: float
) -> Any:
    """Backward ray past the main lens, in the system's axes: height there, slope, and whether all rims pass it."""
    lens_square = k[LENS_RADIUS] * k[LENS_RADIUS]
    if posed:
        lx, ly, ox, oy, good = posed_ray(k, maps, px, py, cx, cy, vx, vy)
        if not good or lx * lx + ly * ly > lens_square:
            return lx, ly, ox, oy, False
        for t in range(rims.shape[0]):
            ax, ay, _, _, ahead = crossing(maps[3 + t], lx, ly, ox, oy)
            if not (ahead and inside(rims[t], 3, ax, ay)):
                return lx, ly, ox, oy, False
        return crossing(maps[2], lx, ly, ox, oy)
    lx, ox = aligned_ray(k[D_1], k[PER_D_2], k[PER_F_ML], k[PER_F], k[SENSOR_X], k[ARRAY_X], px, cx, vx)
    ly, oy = aligned_ray(k[D_1], k[PER_D_2], k[PER_F_ML], k[PER_F], k[SENSOR_X + 1], k[ARRAY_X + 1], py, cy, vy)
    if lx * lx + ly * ly > lens_square:
        return lx, ly, ox, oy, False
    for t in range(rims.shape[0]):
        ax, ay = lx + rims[t, 0] - ox * rims[t, 2], ly + rims[t, 1] - oy * rims[t, 2]
        if not inside(rims[t], 3, ax, ay):
            return lx, ly, ox, oy, False
    return lx + k[LENS_X], ly + k[LENS_X + 1], ox, oy, True


@kernel(parallel=True)
def _trace(
    x: Any, y: Any, pixel: float, lattice: Any, origin: Any, reach: float, flags: Any, layout: Any, space: Any,
    surfaces: Any, kicks: Any, falloff: float, lengths: Any, points: Any, shifts: Any, counts: Any, tolerance: float,
    place: Any, image: Any, spent: Any,
) -> None:  # fmt: skip
    """Values of pixels by backward rays; tuples as `Tracer.image` makes them."""
    axes, image_axes, inverse, half_size, neighbours = lattice
    k, maps, rims, front, law, shade = layout
    table, media, openings = space
    rows, pictures, beyond, mirrored, over = surfaces
    mouth, d_3, d_f = lengths
    half, margin, unit = k[HALF], reach + pixel * 0.7072, 1.0 / 4294967296.0
    for j in prange(y.size):
        lens_x, lens_y = np.empty(MOST), np.empty(MOST)
        away_x, away_y = np.empty(MOST), np.empty(MOST)
        buffer, work = np.empty(ROWS * BLOCK), np.empty(BLOCK)
        # Shared ones are counted by all threads.
        faces, indices, takes, own = table.copy(), media.copy(), openings.copy(), law.copy()
        used = 0
        for i in range(x.size):
            bx, by = x[i] - origin[0], y[j] - origin[1]
            n = _candidates(
                (axes, image_axes, inverse, half_size, neighbours), margin, bx, by, lens_x, lens_y, away_x, away_y
            )
            if n == 0:
                continue
            # At the pixel's own place, as in white images: what falls off there must fall off here, pixel by pixel.
            mid_m, mid_n = inverse[0, 0] * bx + inverse[0, 1] * by, inverse[1, 0] * bx + inverse[1, 1] * by
            at_x = axes[0, 0] * mid_m + axes[0, 1] * mid_n + k[ARRAY_X]
            at_y = axes[1, 0] * mid_m + axes[1, 1] * mid_n + k[ARRAY_X + 1]
            gain = _share_of_light(shade, falloff * math.hypot(at_x, at_y))
            s0, s1, s2, s3, s4, s5 = _seeds(place, shifts, i, j)
            total, squares, batches, done = 0.0, 0.0, 0, 0
            while done < counts[1]:
                batch = 0.0
                for r in range(done, done + counts[2]):
                    px = x[i] + ((np.uint32(points[r, 0] ^ s0) + 0.5) * unit - 0.5) * pixel
                    py = y[j] + ((np.uint32(points[r, 1] ^ s1) + 0.5) * unit - 0.5) * pixel
                    vx, vy, kick_x, kick_y = 0.0, 0.0, 0.0, 0.0
                    if not flags[PINHOLE]:
                        a = (np.uint32(points[r, 2] ^ s2) + 0.5) * unit
                        vx, vy = _on_microlens(flags[ROUND], a, (np.uint32(points[r, 3] ^ s3) + 0.5) * unit, half)
                    if flags[KICKED]:
                        near = int(np.uint32(points[r, 4] ^ s4) * unit * kicks.shape[0])
                        turn = int(np.uint32(points[r, 5] ^ s5) * unit * kicks.shape[0])
                        kick_x = kicks[near, 0] * kicks[turn, 1] + kicks[near, 3]
                        kick_y = kicks[near, 0] * kicks[turn, 2] + kicks[near, 4]
                    first, last = 0, n
                    if flags[OWN_ONLY]:
                        best = 1e300
                        for c in range(n):
                            far = (px - (x[i] - away_x[c])) ** 2 + (py - (y[j] - away_y[c])) ** 2
                            if far < best:
                                best, first, last = far, c, c + 1
                    for c in range(first, last):
                        hx, hy, ox, oy, kept = _through_lens(
                            flags[POSED], k, maps, rims, px, py, lens_x[c], lens_y[c], vx, vy
                        )
                        if not kept:
                            continue
                        hx, hy, ox, oy, kept = _to_scene(
                            flags, k, front, own, faces, indices, takes, buffer, work, d_3, d_f, kick_x, kick_y, hx, hy,
                            ox, oy,
                        )  # fmt: skip
                        if not kept:
                            continue
                        batch += radiance(rows, pictures, beyond, mirrored, over, mouth, hx, hy, ox, oy)
                batch /= counts[2]
                done += counts[2]
                used += counts[2]
                batches += 1
                total += batch
                squares += batch * batch
                if done >= counts[0] and batches > 1:
                    spread = squares / batches - (total / batches) ** 2
                    if gain * gain * spread <= tolerance * tolerance * (batches - 1):
                        break
            image[j, i] = gain * total / batches
        spent[j] = used
