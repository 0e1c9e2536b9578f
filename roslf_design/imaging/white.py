"""White images: by geometry the exact share of every pixel that microlens images cover; by waves a Fourier series.

Unclipped images repeat with the lattice, and diffraction lets no frequency above d/(lambda d_2) pass: a handful of
harmonics (7 x 7 in the paper's camera) is then the whole image, overlaps with all neighbours included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..design import Design
from ..effects import Plan, plan
from ..rays.exact_openings import ExactOpenings
from ..shapes.coverage import LARGEST_PART, coverage, coverage_bands
from ..shapes.discs import shapes
from ..shapes.openings import Openings
from ..theory.colours import BRIGHTEST, filters, mosaic, per_watt
from ..theory.exit_pupil import microlens_image_diameter
from ..theory.lens_shapes import LENS_SHAPES
from ..theory.light import chief_slope
from ..theory.stop_images import stop_openings
from ..theory.transfer import MicrolensTransfer, pair_transfer, pixel_box
from .camera import Floats, Image, ImageLattice, Region, pixel_centres, pixel_response, planned_camera
from .transfer import MOST_HALO, fineness

FRAME = MOST_HALO
"""Pixels around the sensor that convolutions may ask for."""

_NODES, _SHARES = np.polynomial.legendre.leggauss(3)
ACROSS = tuple(
    (math.sqrt(3) * float(u), math.sqrt(3) * float(v), float(a * b) / 4)
    for v, b in zip(_NODES, _SHARES, strict=True)
    for u, a in zip(_NODES, _SHARES, strict=True)
)
"""Places on a microlens, over their root mean square along each axis, and shares of its light that stand for all."""
MIDDLE = ((0.0, 0.0, 1.0),)
"""Place of the middle, and all of the light."""
MOST_ORDERS = 200
"""Harmonics along an axis beyond which there are too many to add up."""
MOST_ROWS = 3000
"""Different y frequencies beyond which convolution is the cheaper way: an upright array has some tens, a turned one as
many as harmonics."""

SMALLEST = 1e-9
"""Harmonics below this part of the mean are left out."""
ROUNDED = 1e-13
"""Below this part of it they are what is left of mirror images that cancel."""

INTERFERING = 3
"""Steps of the lattice between microlenses whose interference is counted; with more its largest changes by 3 %."""
MOST_INTERFERING = 8.0
"""4 N_F beyond which microlenses are taken to interfere as they do there: less."""

NEIGHBOURS = 1.5
"""Microlens pitches around the patch that lend their light."""
MOST_IMAGES = 400
"""Microlenses that may light one pixel; beyond, their images are one grey."""
MOST_SUBPIXELS = 256
"""Subpixels across the patch and its surroundings."""
ALWAYS_ON = ("+microlens_diffraction", "+overlap")
"""Effects that are on whatever their size."""


@dataclass(frozen=True, eq=False)
class WhiteGeometry:
    """Shapes of microlens images under uniform light, of a camera in which nothing but further stops leans."""

    camera: Camera
    """Camera as planned: whatever clips is in it."""
    lattice: ImageLattice
    falloff: bool
    """Whether brightness falls off with the chief ray's angle."""
    own_only: bool
    """Whether light on top of a neighbour's is left out: no pixel gets more than a whole image gives."""
    exact: ExactOpenings | None = None
    """Shapes by Snell's law; None leaves them where first order has them."""
    across: float = 0.0
    """Root mean square of places over a microlens, along each axis, that see stops cut otherwise than its middle does
    [mm]; 0 leaves cuts where the middle sees them."""

    @classmethod
    def of(cls, camera: Camera, plan: Plan) -> WhiteGeometry:
        """Geometry of a planned camera."""
        whole = plan.on("finite_microlens_aperture")
        across = float(camera.d) * math.sqrt(LENS_SHAPES[camera.lens_shape].variance) if whole else 0.0
        return cls(camera, ImageLattice.of(camera), plan.on("cos4"), not plan.on("overlap"), across=across)

    def by_snell(self, error: float, wavelength: float) -> WhiteGeometry | None:
        """Geometry with shapes where exact rays through elements put them.

        Parameters
        ----------
        error : float
            By how much an image's edge may be off [px].
        wavelength : float
            Of the light in the elements [mm].

        Returns
        -------
        WhiteGeometry or None
            None where no openings are known that near.
        """
        half, pixel = np.array(self.camera.pixels) * float(self.camera.q) / 2, float(self.camera.q)
        axis = self.lattice.microlens(self.lattice.indices(-half[0], half[0], -half[1], half[1]))
        exact = ExactOpenings.of(self.camera, axis.min(0), axis.max(0), wavelength) if len(axis) else None
        if exact is None or exact.error > error * pixel:
            return None
        farther = replace(self.lattice, reach=self.lattice.reach + exact.farthest)
        return replace(self, lattice=farther, exact=exact)

    def image(self, region: Region, fine: int = 1) -> Image:
        """Relative intensities of a region's pixels, float32; parameters as `coverage`."""
        cover = self.coverage(region, fine)
        if self.own_only:
            np.minimum(cover, 1.0, out=cover)
        image = cover.astype(np.float32)
        return add_falloff(image, self.camera, *pixel_centres(self.camera, region, fine)) if self.falloff else image

    def coverage(self, region: Region, fine: int = 1) -> Floats:
        """Shares of pixels that microlens images cover, added up.

        Parameters
        ----------
        region : Region
            May reach beyond the sensor.
        fine : int
            Subpixels per pixel and axis.

        Returns
        -------
        ndarray, shape (rows * fine, columns * fine)
            1 where one microlens image covers a whole pixel.
        """
        x, y = pixel_centres(self.camera, region, fine)
        pixel = float(self.camera.q) / fine
        ends = x[0] - pixel / 2, x[-1] + pixel / 2, y[0] - pixel / 2, y[-1] + pixel / 2
        axis = self.lattice.microlens(self.lattice.indices(*ends))
        middle = self._stops(axis)
        width, height = self.camera.pixels
        # Pixels are counted on the whole sensor and a frame around it: a value does not depend on the region.
        first_row, first_column = (region.row + FRAME) * fine, (region.column + FRAME) * fine
        total = np.zeros((y.size, x.size))
        for along, down, share in ACROSS if self.across and _cutting(middle).total > 1 else MIDDLE:
            beside = self.across * np.array([along, down])
            openings = self._stops(axis + beside) if beside.any() else middle
            # All of a microlens shows the FAP in one place, and other stops where each part sees them.
            openings = openings.moved(middle.centres[..., 0, :] - openings.centres[..., 0, :])
            cover = _cutting(openings).coverage(
                axis - np.array(self.camera.decentre("sensor")),
                pixel=pixel,
                size=((width + 2 * FRAME) * fine, (height + 2 * FRAME) * fine),
                window=(slice(first_row, first_row + y.size), slice(first_column, first_column + x.size)),
                parallel=True,
            )
            total += share * np.asarray(cover)
        return total

    def _stops(self, axis: Floats) -> Openings:
        """Openings as seen from places on the array (n, 2), relative to them [mm]."""
        return stop_openings(self.camera, *axis.T) if self.exact is None else self.exact.at(*axis.T)


def _cutting(openings: Openings) -> Openings:
    """The FAP's opening, and those that cut it anywhere."""
    cuts = np.any(openings.least_rooms < 0, axis=0, keepdims=True)[0]
    cuts[0] = True
    return openings.some(np.flatnonzero(cuts).tolist())


def add_falloff(image: Image, camera: Camera, x: Floats, y: Floats) -> Image:
    """Darken an image, shape (y.size, x.size), in place by its chief rays' `falloff`; sensor's frame [mm].

    Taken at each pixel's own place, between two microlenses as everywhere else: against one value for each microlens
    this differs by less than the change over half a pitch.
    """
    lattice = ImageLattice.of(camera)
    scale = float(chief_slope(camera))
    shift = lattice.offset - lattice.image_origin / lattice.grow
    across = ((x / lattice.grow + shift[0]) * scale).astype(np.float32) ** 2
    along = ((y / lattice.grow + shift[1]) * scale).astype(np.float32) ** 2
    for row in range(image.shape[0]):
        camera.mapping.dim(image[row], along[row], across)
    return image


@dataclass(frozen=True, eq=False)
class HarmonicSeries:
    """A periodic image, even about its origin: ``sum over G of C(G) cos(2 pi G . (p - origin))``."""

    frequencies: Floats
    """G [1/mm], shape (M, 2); of G and -G only one."""
    coefficients: Floats
    """C(G), shape (M,)."""
    origin: Floats
    """Origin in the sensor's frame [mm], shape (2,)."""

    @property
    def rows(self) -> int:
        """Number of different y frequencies, without their signs."""
        return int(np.unique(np.round(np.abs(self.frequencies[:, 1]), 9)).size)

    @cached_property
    def products(self) -> tuple[tuple[bool, float, Floats, Floats], ...]:
        """Terms that the image is a sum of: even or odd, |y frequency|, and the x frequencies it goes with, weighted.

        ``cos(a + b)`` is ``cos a cos b - sin a sin b``. Of mirror images G and (G_x, -G_y), which every upright
        lattice has, the second parts cancel.
        """
        x, y = self.frequencies.T
        heights, group = np.unique(np.round(np.abs(y), 9), return_inverse=True)
        terms = []
        for n, height in enumerate(heights):
            mine = group == n
            widths, place = np.unique(np.round(np.abs(x[mine]), 9), return_inverse=True)
            for even, sign in ((True, 1.0), (False, -np.sign(x[mine] * y[mine]))):
                weights = np.bincount(place, sign * self.coefficients[mine])
                kept = np.abs(weights) > ROUNDED * np.abs(self.coefficients).max()
                if kept.any():
                    terms.append((even, height, widths[kept], weights[kept]))
        return tuple(terms)

    def at(self, x: Floats, y: Floats) -> Image:
        """Values on a grid of points in the sensor's frame [mm], shape (y.size, x.size): one product of matrices."""
        u, v = 2 * math.pi * (x - self.origin[0]), 2 * math.pi * (y - self.origin[1])
        along = np.empty((len(self.products), u.size), np.float32)
        across = np.empty((v.size, len(self.products)), np.float32)
        every = {width for _, _, widths, _ in self.products for width in widths}
        place = {width: n for n, width in enumerate(sorted(every))}
        waves = {
            even: wave(np.outer(list(place), u)).astype(np.float32) for even, wave in ((True, np.cos), (False, np.sin))
        }
        for n, (even, height, widths, weights) in enumerate(self.products):
            along[n] = weights.astype(np.float32) @ waves[even][[place[width] for width in widths]]
            across[:, n] = (np.cos if even else np.sin)(height * v)
        return across @ along


def harmonic_series(camera: Camera, transfer: MicrolensTransfer, pixel: bool = True) -> HarmonicSeries:
    """Series of the white image of a camera whose microlens images are all alike.

    Parameters
    ----------
    camera : Camera
        As planned: nothing vignettes, nothing is tilted.
    transfer : MicrolensTransfer
        With diffraction, as otherwise the series never ends.
    pixel : bool
        Whether pixels integrate over their squares.

    Returns
    -------
    HarmonicSeries
        Relative intensities: 1 inside a geometric image.
    """
    lattice = ImageLattice.of(camera)
    _, frequencies = _orders(lattice, transfer.cutoff * transfer.shape.diagonal)
    weight = _uncut(camera, lattice, frequencies) * transfer(*frequencies.T)
    if pixel:
        weight = weight * _pixels(camera, frequencies)
    kept = np.abs(weight) > SMALLEST * np.abs(weight).max()
    return HarmonicSeries(frequencies[kept], weight[kept], lattice.image_origin)


def _orders(lattice: ImageLattice, limit: float) -> tuple[NDArray[np.int64], Floats]:
    """Orders of the lattice's frequencies up to `limit` [1/mm] and more, and these; one of each pair G, -G."""
    axes = lattice.image_axes
    most = [math.ceil(limit * np.linalg.norm(axis)) for axis in axes.T]
    index = np.stack(np.meshgrid(np.arange(-most[0], most[0] + 1), np.arange(0, most[1] + 1)), -1).reshape(-1, 2)
    index = index[(index[:, 1] > 0) | (index[:, 0] >= 0)]
    return index, index @ np.linalg.inv(axes)


def _uncut(camera: Camera, lattice: ImageLattice, frequencies: Floats) -> Floats:
    """Weights of the geometric image of uncut openings, those of G and -G together."""
    height = np.hypot(*frequencies.T)
    spectrum = camera.fap.outline.sized(float(microlens_image_diameter(camera))).spectrum(*frequencies.T)
    return np.asarray(spectrum / abs(np.linalg.det(lattice.image_axes)) * np.where(height > 0, 2.0, 1.0))


def _pixels(camera: Camera, frequencies: Floats) -> Floats:
    return np.asarray(pixel_box(frequencies, float(camera.q)).prod(-1))


def _interference_series(
    camera: Camera, transfer: MicrolensTransfer, pixel: bool = True, reach: int = INTERFERING
) -> HarmonicSeries:
    """Series that interference of neighbouring microlenses adds to `harmonic_series`, which leaves it out.

    Parameters
    ----------
    camera, transfer, pixel
        As for `harmonic_series`.
    reach : int
        Steps of the lattice between microlenses that count, and as many orders of the frequencies that they pass.
    """
    lattice = ImageLattice.of(camera)
    steps = np.arange(-reach, reach + 1)
    pairs = [np.array([i, j]) for i in steps for j in steps if i or j]
    index, frequencies = _orders(lattice, (reach + 1) * transfer.cutoff)
    passed = np.zeros(len(frequencies))
    for pair in pairs:
        part = pair_transfer(transfer, frequencies, lattice.turned @ pair, float(camera.seen.vergence))
        passed += np.where(index @ pair % 2, -part, part)
    weight = _uncut(camera, lattice, frequencies) * passed * (_pixels(camera, frequencies) if pixel else 1.0)
    return HarmonicSeries(frequencies, weight, lattice.image_origin)


def neighbour_interference(camera: Camera, transfer: MicrolensTransfer) -> float:
    """Largest change that interference of neighbouring microlenses makes in a pixel of a white image [full scale].

    For a camera whose images are all alike; where some are cut, about as much.
    """
    least = transfer.width**2 / (MOST_INTERFERING * transfer.sensor_distance)
    limited = replace(transfer, wavelengths=tuple(max(wavelength, least) for wavelength in transfer.wavelengths))
    reach = transfer.shape.neighbours
    series, lattice = _interference_series(camera, limited, reach=reach), ImageLattice.of(camera)
    sides = np.abs(lattice.image_axes).sum(1)
    at = np.linspace(0, 1, 8 * math.ceil((reach + 1) * limited.cutoff * sides.max()))
    x, y = (side * at + origin for side, origin in zip(sides, lattice.image_origin, strict=True))
    return float(np.abs(series.at(x, y)).max())


def white_patch(design: Design, columns: slice, rows: slice) -> Floats | None:
    """Pixels of the white image with diffraction at the microlenses.

    Parameters
    ----------
    design : Design
        Tilts and aberrations are left out.
    columns, rows : slice
        Pixels of the sensor, counted from its left and its lower edge.

    Returns
    -------
    ndarray, shape (rows, columns), or None
        Relative intensities, 1 where geometry lights a whole pixel, as `render` with a white scene has them, but for
        light of microlenses more than `NEIGHBOURS` pitches away, for which those on the other side stand in, and for
        what coarser subpixels fold back: within about 1e-2 of full scale or of the brightest pixel. None where more
        than `MOST_IMAGES` images overlap or one is thousands of pixels wide.
    """
    if kinds := filters(design.sensor.colours):
        bare = design.model_copy(update={"sensor": design.sensor.model_copy(update={"colours": "mono"})})
        parts = [white_patch(bare.replace({"light.wavelength": one.wavelength}), columns, rows) for one in kinds]
        size = columns.stop - columns.start, rows.stop - rows.start
        if any(part is None for part in parts) or min(size) <= 0:
            return parts[0]
        levels = [per_watt(one) / BRIGHTEST for one in kinds]
        own = mosaic(design.sensor.colours, columns.start, rows.start, *size)
        return np.choose(own, [level * part for level, part in zip(levels, parts, strict=True) if part is not None])
    effects = plan(design.thin_twin, overrides=ALWAYS_ON)
    camera = planned_camera(design, effects)
    transfer = MicrolensTransfer.of(camera, effects)
    wide, high = columns.stop - columns.start, rows.stop - rows.start
    vast = 4 * microlens_image_diameter(camera) > LARGEST_PART * camera.q  # up to four subpixels a pixel
    if vast or (2 * ImageLattice.of(camera).neighbours) ** 2 > MOST_IMAGES:
        return None
    if wide <= 0 or high <= 0:
        return np.zeros((max(high, 0), max(wide, 0)))
    halo = min(FRAME, math.ceil(NEIGHBOURS * float(camera.d / camera.q)))
    fine = max(1, min(fineness(transfer, float(camera.q)), MOST_SUBPIXELS // (max(wide, high) + 2 * halo)))
    region = Region(columns.start - halo, rows.start - halo, wide + 2 * halo, high + 2 * halo)
    light = WhiteGeometry.of(camera, effects).image(region, fine)
    step = float(camera.q) / fine
    frequency_y, frequency_x = np.fft.fftfreq(light.shape[0], step), np.fft.rfftfreq(light.shape[1], step)
    wave = np.fft.irfft2(np.fft.rfft2(light) * transfer(frequency_x, frequency_y[:, None]), s=light.shape)
    pixels = wave.reshape(light.shape[0] // fine, fine, -1, fine).mean((1, 3))
    shown = np.asarray(np.maximum(pixels[halo:-halo, halo:-halo], 0.0))
    taken = pixel_response(camera, Region(columns.start, rows.start, wide, high))
    return shown if taken is None else shown * taken


def warm_up() -> None:
    """Load the compiled kernels that pictures use (half a second, or several where they were never compiled)."""
    for kernel in (shapes, coverage, coverage_bands):
        _ = kernel.compiled
