"""Textured scenes by backward rays: pixel, microlens aperture and the FAP's diffraction sampled by Sobol points.

Every pixel has its own random exclusive-or scramble of one common point set, so that a pixel's value depends on the
seed and its place alone, never on tiles or threads. Surfaces and textures are laid out as rows of numbers.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel
from ..bore.opening import ClearAperture, inside
from ..camera import Camera
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
from ..scenes import Scene
from ..sobol import direction_numbers
from ..theory.exit_pupil import microlens_image_diameter
from ..theory.lens_shapes import LENS_SHAPES
from ..theory.light import chief_slope
from ..theory.object_space import ObjectSpaceFaces, outwards
from ..theory.photometry import source_in_tip
from .camera import Floats, Image, ImageLattice, Region, pixel_centres, planned_camera
from .surfaces import (
    BLOCK_ROWS,
    HIT,
    KICK_X,
    KICK_Y,
    LENS_AT_X,
    LENS_AT_Y,
    LIGHT,
    LIT,
    NEAR,
    SLOPE_X,
    SLOPE_Y,
    Surfaces,
    U,
    V,
    X,
    Y,
    encode,
    look,
    on_circle,
)

KICKS = 4096
"""Directions that stand for an opening's diffraction."""
GROUPS = 4
"""Groups of a pixel's rays whose means tell its error, each spread as evenly as all; as many rays at first."""
FEWEST = 4
"""Rays of a pixel, at least."""
TOGETHER = 4
"""Subpixels along the side of blocks whose rays are spread together, where diffraction averages them."""
WELL_OUTSIDE = 2.0
"""Multiple of the distance by which exact rays miss the closed forms, within which they may pass the FAP's rim."""
STRIP = 64
"""Pixels of a row that are traced together."""
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
    """Rays before the error is first looked at."""
    most: int = 1024
    """Rays after which no more are spent."""
    tolerance: float = 0.01
    """Standard error at which a pixel's value is done."""
    seed: int = 0
    """Same seed, same bytes."""
    side: int = 0
    """Behind a real main lens: samples along a pixel's side, instead of rays; 0 is a few."""
    together: int = 1
    """Subpixels along the side of blocks whose rays are spread evenly together, a power of two: what they scatter is
    then opposite in neighbours, and diffraction takes most of it away. Samples behind a real main lens always are."""
    below_noise: bool = False
    """Whether rays are so many that what they scatter stays well below the noise drawn in the same picture."""

    def thinned(self, share: float) -> RaySampling:
        """Fewer rays, by a share, for what counts little."""
        least, most = (max(min(FEWEST, rays), math.ceil(rays * share)) for rays in (self.least, self.most))
        return replace(self, least=least, most=most, side=math.ceil(self.side * math.sqrt(share)))


@kernel()
def refocused(d_3: float, d_f: float, hx: float, hy: float, ox: float, oy: float) -> Any:
    """The ray from the FAP's middle to where a ray (height on the lens, slope) crosses the focal plane."""
    fx, fy = hx - ox * d_f, hy - oy * d_f
    ox, oy = -fx / (d_f - d_3), -fy / (d_f - d_3)
    return ox * d_3, oy * d_3, ox, oy


@functools.lru_cache(maxsize=4)
def sobol_points(count: int) -> NDArray[np.uint32]:
    """First points of the Sobol sequence times 2^32, shape (count, 6): an exclusive-or scrambles them evenly.

    In the order of Gray's code.
    """
    points = np.zeros((1, DIMENSIONS), np.uint32)
    directions = direction_numbers(DIMENSIONS).astype(np.uint32).T
    while len(points) < count:
        points = np.concatenate([points, points[::-1] ^ directions[len(points).bit_length() - 1]])
    return points[:count]


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
            encode(scene, design.d_f, camera.chain.mirrored, over, source_in_tip(Camera.of(design))),
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
        # Of a net that neighbours share nobody may leave a part out: all would leave out the same.
        each = math.ceil(sampling.most / fine**2)
        counts = (each if sampling.together == 1 else 1 << (each - 1).bit_length(),) * 2
        if sampling.least < sampling.most:
            least = 1 << (max(GROUPS, math.ceil(sampling.least / fine**2)) - 1).bit_length()
            counts = least, least << max(0, (each // least).bit_length() - 1)
        images = np.zeros((len(self.colours), y.size, x.size), np.float32)
        place = np.array([region.column * fine, region.row * fine, sampling.seed])
        points, shifts = sobol_points(counts[1]), _shifts(sampling.together, counts[1])
        inverse = np.linalg.inv(lattice.image_axes)
        steps = lattice.axes, lattice.image_axes, inverse, lattice.half_size, lattice.neighbours
        lengths, rays = (self.mouth, float(camera.seen.d_3), float(camera.seen.d_f)), 0
        for space, image in zip(self.colours, images, strict=True):
            # Rays that go face by face are compiled only where some do. Threads would count shared arrays together.
            faces = (space.table, space.media, space.openings) if self.flags[EXACT] else None
            room = np.empty(ROWS * BLOCK), np.empty(BLOCK)
            rays += _trace.compiled(
                x, y, float(camera.q) / fine, steps, lattice.image_origin, lattice.reach, self.flags,
                tuple(own.copy() for own in self.layout), faces and (*(own.copy() for own in faces), *room),
                tuple(self.surfaces), self.kicks, self.falloff, lengths, points, shifts, counts,
                sampling.tolerance * fine, place, image,
            )  # fmt: skip
        return images[0] if len(images) == 1 else images.mean(0), rays


def _kicks(opening: ClearAperture, wavelengths: tuple[float, ...]) -> Floats:
    """Directions of an opening's diffraction at even shares of the light, shape (KICKS, 5): `Tracer.kicks`."""
    count = KICKS
    even = _even_shares(opening.half is not None, count) * (sum(wavelengths) / len(wavelengths))
    if opening.half is not None:  # along each side by itself
        (u_x, u_y), (v_x, v_y) = opening.axes
        first, second = (even / float(2 * half) for half in opening.half)
        return np.stack([np.ones(count), second * v_x, second * v_y, first * u_x, first * u_y], -1)
    turn = 2 * math.pi * ((np.arange(count) + 0.5) / count)
    nothing = np.zeros(count)
    return np.stack([even / (math.pi * 2 * float(opening.radius)), np.cos(turn), np.sin(turn), nothing, nothing], -1)


@functools.cache
def _even_shares(slit: bool, count: int) -> Floats:
    """Directions of even shares of light from a slit [wavelengths/width] or a disc [wavelengths/circumference]."""
    from scipy.special import j0, j1, sici

    if slit:
        x = np.concatenate([-np.geomspace(1e-4, 1e4, 500_000)[::-1], np.geomspace(1e-4, 1e4, 500_000)])
        encircled = 0.5 + (sici(2 * math.pi * x)[0] - np.sin(math.pi * x) ** 2 / (math.pi * x)) / math.pi
    else:
        x = np.concatenate([np.linspace(0, 400, 400_001), np.geomspace(400, 2e4, 100_000)[1:]])
        encircled = 1 - j0(x) ** 2 - j1(x) ** 2
    return np.asarray(np.interp((np.arange(count) + 0.5) / count, np.maximum.accumulate(encircled), x))


@kernel()
def _hash3(a: Any, b: Any, c: Any) -> Any:
    """Hash of three whole numbers (64-bit finaliser of the splitmix kind)."""
    z = (a * np.uint64(0x9E3779B97F4A7C15)) ^ (b * np.uint64(0xC2B2AE3D27D4EB4F)) ^ (c * np.uint64(0x165667B19E3779F9))
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@kernel()
def _to_scene(space: Any, flags: Any, k: Any, front: Any, law: Any, d_3: float, d_f: float, rays: Any, m: int) -> None:
    """Carry a block that leaves the main lens on to before all elements."""
    lens_x, lens_y = k[LENS_X], k[LENS_X + 1]
    if space is not None:
        table, media, openings, room, work = space
        count = 0
        for i in range(m):
            if rays[LIT + i] != 0.0:
                room[count], room[BLOCK + count] = rays[X + i], rays[Y + i]
                room[3 * BLOCK + count], room[4 * BLOCK + count] = rays[SLOPE_X + i], rays[SLOPE_Y + i]
                count += 1
        outwards(table, media, openings, law, room, work, count)
        count = 0
        for i in range(m):
            if rays[LIT + i] == 0.0:
                continue
            hx, hy, ox, oy = rays[X + i], rays[Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i]
            hx, hy, ox, oy = behind_elements(front, lens_x, lens_y, hx, hy, ox, oy)
            hx, hy, ox, oy, _ = mapped(law, front, hx, hy, ox, oy)
            # So far does the exact ray go beside that of the closed forms.
            rays[U + i], rays[V + i] = room[count] - hx, room[BLOCK + count] - hy
            rays[NEAR + i], rays[HIT + i] = room[3 * BLOCK + count] - ox, room[4 * BLOCK + count] - oy
            rays[LIT + i] = 1.0 if room[6 * BLOCK + count] == 0.0 else 0.0
            count += 1
    for i in range(m if flags[IN_FOCUS] else 0):
        rays[X + i], rays[Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i] = refocused(
            d_3, d_f, rays[X + i], rays[Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i]
        )
    for i in range(m if flags[KICKED] else 0):
        rays[X + i], rays[SLOPE_X + i] = rays[X + i] + rays[KICK_X + i] * d_3, rays[SLOPE_X + i] + rays[KICK_X + i]
        rays[Y + i], rays[SLOPE_Y + i] = rays[Y + i] + rays[KICK_Y + i] * d_3, rays[SLOPE_Y + i] + rays[KICK_Y + i]
    for i in range(m if flags[THROUGH] else 0):
        if rays[LIT + i] != 0.0:
            hx, hy, ox, oy = rays[X + i], rays[Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i]
            hx, hy, ox, oy = behind_elements(front, lens_x, lens_y, hx, hy, ox, oy)
            rays[X + i], rays[Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i], imaged = mapped(law, front, hx, hy, ox, oy)
            rays[LIT + i] = 1.0 if imaged else 0.0
    if space is not None:
        for i in range(m):
            rays[X + i], rays[Y + i] = rays[X + i] + rays[U + i], rays[Y + i] + rays[V + i]
            rays[SLOPE_X + i], rays[SLOPE_Y + i] = rays[SLOPE_X + i] + rays[NEAR + i], rays[SLOPE_Y + i] + rays[HIT + i]


@kernel()
def _share_of_light(shade: Any, slope: float) -> float:
    """`falloff` at one place."""
    if shade.shape[0] == 0:
        return 1.0 / (1.0 + slope * slope) ** 2
    return float(illumination(shade, slope))


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


@kernel()
def _gather(
    x: Any, y: float, begin: int, j: int, lattice: Any, origin: Any, margin: float, k: Any, shade: Any, falloff: float,
    place: Any, shifts: Any, lenses: Any, strip: Any,
) -> int:  # fmt: skip
    """How many pixels of a strip any microlens may light; lists the pairs, always in the same order."""
    axes, image_axes, inverse, half_size, neighbours = lattice
    items, owners, starts, last, codes, gains, sums = strip
    size, by, near, n, left = min(STRIP, x.size - begin), y - origin[1], 0, 0, 0
    west, east = x[begin] - origin[0], x[begin + size - 1] - origin[0]
    m_0, m_1 = inverse[0, 0] * west + inverse[0, 1] * by, inverse[0, 0] * east + inverse[0, 1] * by
    n_0, n_1 = inverse[1, 0] * west + inverse[1, 1] * by, inverse[1, 0] * east + inverse[1, 1] * by
    for m in range(math.floor(min(m_0, m_1) + 0.5) - neighbours, math.floor(max(m_0, m_1) + 0.5) + neighbours + 1):
        for l in range(math.floor(min(n_0, n_1) + 0.5) - neighbours, math.floor(max(n_0, n_1) + 0.5) + neighbours + 1):
            gx, gy = image_axes[0, 0] * m + image_axes[0, 1] * l, image_axes[1, 0] * m + image_axes[1, 1] * l
            cx, cy = axes[0, 0] * m + axes[0, 1] * l, axes[1, 0] * m + axes[1, 1] * l
            there = abs(cx) <= half_size[0] and abs(cy) <= half_size[1]
            if there and abs(gy - by) <= margin and west - margin <= gx <= east + margin:
                lenses[near, 0], lenses[near, 1], lenses[near, 2], lenses[near, 3] = cx, cy, gx, gy
                near += 1
    for p in range(size):
        bx, starts[p] = x[begin + p] - origin[0], n
        for c in range(near):
            if (bx - lenses[c, 2]) ** 2 + (by - lenses[c, 3]) ** 2 <= margin * margin:
                items[n, 0], items[n, 1], owners[n] = lenses[c, 0], lenses[c, 1], p
                items[n, 2], items[n, 3] = lenses[c, 2] + origin[0], lenses[c, 3] + origin[1]
                n += 1
        last[p] = n == starts[p]
        if last[p]:
            continue
        left += 1
        # At the pixel's own place, as in white images: what falls off there must fall off here, pixel by pixel.
        mid_m, mid_n = inverse[0, 0] * bx + inverse[0, 1] * by, inverse[1, 0] * bx + inverse[1, 1] * by
        at_x = axes[0, 0] * mid_m + axes[0, 1] * mid_n + k[ARRAY_X]
        at_y = axes[1, 0] * mid_m + axes[1, 1] * mid_n + k[ARRAY_X + 1]
        gains[p] = _share_of_light(shade, falloff * math.hypot(at_x, at_y))
        codes[p, 0], codes[p, 1], codes[p, 2], codes[p, 3], codes[p, 4], codes[p, 5] = _seeds(
            place, shifts, begin + p, j
        )
    starts[size] = n
    sums[:, :n] = 0.0
    return left


@kernel()
def _draw(
    points: Any, seeds: Any, places: Any, w: int, first: int, count: int, flags: Any, half: float, pixel: float,
    kicks: Any, rays: Any,
) -> None:  # fmt: skip
    """Fill a block with `count` points of each of `w` pairs of pixel and microlens, first those of one point."""
    unit = 1.0 / 4294967296.0
    finite, is_round, kicked = not flags[PINHOLE], flags[ROUND], flags[KICKED]
    for r in range(count):
        p0, p1, p2, p3 = points[first + r, 0], points[first + r, 1], points[first + r, 2], points[first + r, 3]
        mine = rays[r * w :]
        for t in range(w):
            mine[X + t] = places[2 * STRIP + t] + ((np.uint32(p0 ^ seeds[t]) + 0.5) * unit - 0.5) * pixel
            mine[Y + t] = places[3 * STRIP + t] + ((np.uint32(p1 ^ seeds[STRIP + t]) + 0.5) * unit - 0.5) * pixel
            mine[SLOPE_X + t] = (np.uint32(p2 ^ seeds[2 * STRIP + t]) + 0.5) * unit
            mine[SLOPE_Y + t] = (np.uint32(p3 ^ seeds[3 * STRIP + t]) + 0.5) * unit
            mine[LENS_AT_X + t], mine[LENS_AT_Y + t], mine[LIT + t] = places[t], places[STRIP + t], 1.0
        if kicked:
            p4, p5 = points[first + r, 4], points[first + r, 5]
            for t in range(w):
                near = int(np.uint32(p4 ^ seeds[4 * STRIP + t]) * unit * kicks.shape[0])
                turn = int(np.uint32(p5 ^ seeds[5 * STRIP + t]) * unit * kicks.shape[0])
                mine[KICK_X + t] = kicks[near, 0] * kicks[turn, 1] + kicks[near, 3]
                mine[KICK_Y + t] = kicks[near, 0] * kicks[turn, 2] + kicks[near, 4]
    if finite and is_round:
        for i in range(count * w):
            rho = half * math.sqrt(rays[SLOPE_X + i])
            cosine, sine = on_circle(rays[SLOPE_Y + i])
            rays[SLOPE_X + i], rays[SLOPE_Y + i] = rho * cosine, rho * sine
        return
    half = half if finite else 0.0
    for i in range(count * w):
        rays[SLOPE_X + i], rays[SLOPE_Y + i] = (
            (2.0 * rays[SLOPE_X + i] - 1.0) * half, (2.0 * rays[SLOPE_Y + i] - 1.0) * half,
        )  # fmt: skip


@kernel()
def _keep_nearest(strip: Any, queue: Any, w: int, count: int, rays: Any) -> None:
    """Leave out rays that another microlens's image is nearer to."""
    items, owners, starts, _, _, _, _ = strip
    for i in range(count * w):
        item = queue[i % w]
        best, nearest = 1e300, -1
        for other in range(starts[owners[item]], starts[owners[item] + 1]):
            far = (rays[X + i] - items[other, 2]) ** 2 + (rays[Y + i] - items[other, 3]) ** 2
            if far < best:
                best, nearest = far, other
        rays[LIT + i] = 1.0 if nearest == item else 0.0


@kernel()
def _through_lens(posed: bool, k: Any, maps: Any, rims: Any, rays: Any, m: int) -> None:
    """Carry a block of backward rays past the main lens, in the system's axes, and through the rims."""
    lens_square, count = k[LENS_RADIUS] * k[LENS_RADIUS], rims.shape[0]
    if posed:
        for i in range(m):
            at_x, at_y, vx, vy = rays[LENS_AT_X + i], rays[LENS_AT_Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i]
            hx, hy, ox, oy, good = posed_ray(k, maps, rays[X + i], rays[Y + i], at_x, at_y, vx, vy)
            good = good and hx * hx + hy * hy <= lens_square
            for t in range(count):
                ax, ay, _, _, ahead = crossing(maps[3 + t], hx, hy, ox, oy)
                good = good and ahead and inside(rims[t], 3, ax, ay)
            rays[X + i], rays[Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i], ahead = crossing(maps[2], hx, hy, ox, oy)
            rays[LIT + i] *= 1.0 if good and ahead else 0.0
        return
    d_1, per_d_2, per_f_ml, per_f, lens_x, lens_y = k[D_1], k[PER_D_2], k[PER_F_ML], k[PER_F], k[LENS_X], k[LENS_X + 1]
    sensor_x, sensor_y, array_x, array_y = k[SENSOR_X], k[SENSOR_X + 1], k[ARRAY_X], k[ARRAY_X + 1]
    for i in range(m):
        at_x, at_y, vx, vy = rays[LENS_AT_X + i], rays[LENS_AT_Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i]
        hx, ox = aligned_ray(d_1, per_d_2, per_f_ml, per_f, sensor_x, array_x, rays[X + i], at_x, vx)
        hy, oy = aligned_ray(d_1, per_d_2, per_f_ml, per_f, sensor_y, array_y, rays[Y + i], at_y, vy)
        rays[X + i], rays[Y + i], rays[SLOPE_X + i], rays[SLOPE_Y + i] = hx, hy, ox, oy
        rays[LIT + i] = rays[LIT + i] if hx * hx + hy * hy <= lens_square else 0.0
    for t in range(count):
        off_x, off_y, ahead = rims[t, 0], rims[t, 1], rims[t, 2]
        opening: Any = (rims[t, 3], rims[t, 4], rims[t, 5], rims[t, 6], rims[t, 7])
        for i in range(m):
            ax, ay = rays[X + i] + off_x - rays[SLOPE_X + i] * ahead, rays[Y + i] + off_y - rays[SLOPE_Y + i] * ahead
            rays[LIT + i] = rays[LIT + i] if inside(opening, 0, ax, ay) else 0.0
    for i in range(m):
        rays[X + i], rays[Y + i] = rays[X + i] + lens_x, rays[Y + i] + lens_y


@kernel()
def _judge(strip: Any, size: int, done: int, most: int, tolerance: float, row: Any) -> int:
    """How many of a strip's pixels need more rays; values of the others go to their row of the image.

    Means of `GROUPS` groups tell the error. Two make one for the next look, as large as two of as many rays again.
    """
    _, _, starts, last, _, gains, sums = strip
    left = 0
    for p in range(size):
        if last[p]:
            continue
        total, squares, scale = 0.0, 0.0, gains[p] / done
        for g in range(GROUPS):
            group = 0.0
            for item in range(starts[p], starts[p + 1]):
                group += sums[g, item]
            total, squares = total + group, squares + group * group
        spread = (GROUPS * squares - total * total) / (GROUPS - 1.0) * scale * scale
        if done >= most or spread <= tolerance * tolerance:
            row[p], last[p] = scale * total, True
            continue
        left += 1
        for item in range(starts[p], starts[p + 1]):
            for g in range(GROUPS // 2):
                sums[g, item] = sums[2 * g, item] + sums[2 * g + 1, item]
            sums[GROUPS // 2 :, item] = 0.0
    return left


@kernel()
def _trace(
    x: Any, y: Any, pixel: float, lattice: Any, origin: Any, reach: float, flags: Any, layout: Any, space: Any,
    surfaces: Any, kicks: Any, falloff: float, lengths: Any, points: Any, shifts: Any, counts: Any, tolerance: float,
    place: Any, image: Any,
) -> int:  # fmt: skip
    """How many rays it took to trace pixels; tuples as `Tracer.image` makes them."""
    k, maps, rims, front, law, shade = layout
    rows, pictures, beyond, mirrored, over, source = surfaces
    mouth, d_3, d_f = lengths
    inverse, wide = lattice[2], 2 * lattice[4] + 3
    across, along = int(abs(inverse[0, 0]) * STRIP * pixel) + wide, int(abs(inverse[1, 0]) * STRIP * pixel) + wide
    most, used = STRIP * across * along, 0
    items, owners, sums = np.empty((most, 4)), np.empty(most, np.int64), np.empty((GROUPS, most))
    starts, last, codes = np.empty(STRIP + 1, np.int64), np.empty(STRIP, np.bool_), np.empty((STRIP, 6), np.uint32)
    strip = items, owners, starts, last, codes, np.empty(STRIP), sums
    lenses, queue, rays = np.empty((across * along, 4)), np.empty(most, np.int64), np.empty(BLOCK_ROWS * BLOCK)
    places, seeds = np.empty(4 * STRIP), np.empty(DIMENSIONS * STRIP, np.uint32)
    for j in range(y.size):
        for begin in range(0, x.size, STRIP):
            size, done, more = min(STRIP, x.size - begin), 0, counts[0]
            left = _gather(
                x, y[j], begin, j, lattice, origin, reach + pixel * 0.7072, k, shade, falloff, place, shifts, lenses,
                strip,
            )  # fmt: skip
            while left > 0:
                used, waiting = used + left * more, 0
                for item in range(starts[size]):
                    if not last[owners[item]]:
                        queue[waiting] = item
                        waiting += 1
                for a in range(0, waiting, STRIP):
                    mine = queue[a : min(a + STRIP, waiting)]
                    w = mine.size
                    for t in range(w):
                        item, p = mine[t], owners[mine[t]]
                        places[t], places[STRIP + t] = items[item, 0], items[item, 1]
                        places[2 * STRIP + t], places[3 * STRIP + t] = x[begin + p], y[j]
                        for d in range(DIMENSIONS):
                            seeds[d * STRIP + t] = codes[p, d]
                    for first in range(done, done + more, BLOCK // w):
                        count = min(BLOCK // w, done + more - first)
                        _draw(points, seeds, places, w, first, count, flags, k[HALF], pixel, kicks, rays)
                        if flags[OWN_ONLY]:
                            _keep_nearest(strip, mine, w, count, rays)
                        _through_lens(flags[POSED], k, maps, rims, rays, count * w)
                        _to_scene(space, flags, k, front, law, d_3, d_f, rays, count * w)
                        look(rows, pictures, beyond, mirrored, over, source, mouth, rays, count * w)
                        for r in range(count):
                            part = GROUPS if done == 0 else GROUPS // 2
                            group = GROUPS - part + (first + r - done) * part // more
                            for t in range(w):
                                light = rays[LIGHT + r * w + t]
                                sums[group, mine[t]] += light if rays[LIT + r * w + t] != 0.0 else 0.0
                done += more
                more = done
                left = _judge(strip, size, done, counts[1], tolerance, image[j, begin:])
    return used
