"""White images by geometry: the exact share of every pixel that the microlens images cover."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..effects import Plan
from ..microlens.images import stop_images
from ..shapes.coverage import coverage_image
from .camera import ImageLattice
from .grid import Region, pixel_centres

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

FRAME = 256
"""Pixels around the sensor that convolutions may ask for."""


@dataclass(frozen=True, eq=False)
class WhiteGeometry:
    """Shapes of a straight camera's microlens images under uniform light."""

    design: Design
    """As planned: whatever clips is in it."""
    lattice: ImageLattice
    falloff: bool
    """Whether brightness falls off with the chief ray's angle."""
    own_only: bool
    """Whether light on top of a neighbour's is left out: no pixel gets more than a whole image gives."""

    @classmethod
    def of(cls, design: Design, plan: Plan) -> WhiteGeometry:
        """For a planned design."""
        return cls(design, ImageLattice.of(design), plan.on("cos4"), not plan.on("overlap"))

    def image(self, region: Region, fine: int = 1) -> Image:
        """Relative intensities of a region's pixels, float32; parameters as `coverage`."""
        cover = self.coverage(region, fine)
        if self.own_only:
            np.minimum(cover, 1.0, out=cover)
        image = cover.astype(np.float32)
        return add_falloff(image, self.design, *pixel_centres(self.design, region, fine)) if self.falloff else image

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
        x, y = pixel_centres(self.design, region, fine)
        pixel = self.design.q / fine
        discs = self._discs(x[0] - pixel / 2, x[-1] + pixel / 2, y[0] - pixel / 2, y[-1] + pixel / 2)
        width, height = self.design.pixels
        # Pixels are counted on the whole sensor and a frame around it: a value does not depend on the region.
        first_row, first_column = (region.row + FRAME) * fine, (region.column + FRAME) * fine
        cover = coverage_image(
            *discs,
            pixel=pixel,
            size=((width + 2 * FRAME) * fine, (height + 2 * FRAME) * fine),
            window=(slice(first_row, first_row + y.size), slice(first_column, first_column + x.size)),
            parallel=True,
        )
        return np.asarray(cover, np.float64)

    def _discs(self, left: float, right: float, low: float, high: float) -> tuple[Floats, Floats, Floats]:
        """Microlens axes in the sensor's frame (n, 2), discs relative to them (n, K, 2) and (n, K) [mm]."""
        design, lattice = self.design, self.lattice
        lens = np.array(design.main_lens.decentre)
        stops = [*design.all_stops]
        index = lattice.indices(left, right, low, high)
        c, s = math.cos(design.microlens_array.rotation), math.sin(design.microlens_array.rotation)
        axis = index @ lattice.axes.T @ np.array([[c, s], [-s, c]]) + np.array(design.microlens_array.decentre) - lens
        decentres = [[0.0, 0.0] if stop is None else np.subtract(stop.decentre, lens) for stop in (*stops, None)]
        centres, radii = stop_images(
            axis,
            [*(stop.diameter for stop in stops), design.D],
            [*(stop.distance for stop in stops), 0.0],
            decentres,
            focal_length=design.f,
            focal_plane=design.d_f,
            mla_distance=design.d_1,
            sensor_distance=design.d_2,
        )
        apart = np.hypot(*np.moveaxis(centres - centres[:, :1], -1, 0))
        cuts = (apart + radii[:, :1] > radii).any(0)
        cuts[0] = True
        place = axis + lens - np.array(design.sensor.decentre)
        return np.ascontiguousarray(place), np.ascontiguousarray(centres[:, cuts]), np.ascontiguousarray(radii[:, cuts])


def add_falloff(image: Image, design: Design, x: Floats, y: Floats) -> Image:
    """Darken an image by cos^4 of its chief rays' angles, in place.

    Parameters
    ----------
    image : ndarray, shape (y.size, x.size)
    design : Design
    x, y : ndarray
        In the sensor's frame [mm].

    Notes
    -----
    Taken at each pixel's own place, between two microlenses as everywhere else: against one value for each microlens
    this differs by less than the change over half a pitch.
    """
    lattice = ImageLattice.of(design)
    to_array = np.linalg.inv(lattice.image_axes)
    c, s = math.cos(design.microlens_array.rotation), math.sin(design.microlens_array.rotation)
    steps = np.array([[c, -s], [s, c]]) @ lattice.axes @ to_array
    grow = float(steps[0, 0])
    shift = np.subtract(design.microlens_array.decentre, design.main_lens.decentre) - grow * lattice.image_origin
    scale = design.d_f / design.d_1 / (design.d_f - design.d_3)
    across = ((grow * x + shift[0]) * scale).astype(np.float32) ** 2
    along = ((grow * y + shift[1]) * scale).astype(np.float32) ** 2
    for row in range(image.shape[0]):
        slope = 1 + along[row] + across
        image[row] /= slope * slope
    return image
