"""The camera that a plan asks for, its pixels, and where on its sensor the microlens images lie."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..design import Design
from ..effects import Plan
from ..effects.geometry import tilt_shift
from ..errors import refusal
from ..input_files import MOST_SAMPLES
from ..shapes.lattice import PACKINGS
from ..theory.light import microlens_defocus_blur
from ..theory.photometry import accepted
from ..theory.stop_images import stop_openings

Floats = NDArray[np.float64]
Image = NDArray[np.float32]


def planned_camera(design: Design, plan: Plan) -> Camera:
    """The camera of a design without what the plan leaves out, its main lens ideal."""
    camera = Camera.of(straightened(design, plan).thin_twin)
    for effect in plan.left_out:
        camera = effect.simplified(camera)
    return camera


def straightened(design: Design, plan: Plan) -> Design:
    """The design without the misalignments that the plan leaves out; a real main lens stays."""
    return design.replace({place: value for off in plan.left_out for place, value in off.straight(design).items()})


class Region(NamedTuple):
    """A rectangle of pixels."""

    column: int
    """First column."""
    row: int
    """First row."""
    columns: int
    """Number of columns."""
    rows: int
    """Number of rows."""

    def grown(self, by: int) -> Region:
        """Region with so many pixels more on each side."""
        return Region(self.column - by, self.row - by, self.columns + 2 * by, self.rows + 2 * by)

    def common(self, other: Region) -> Region:
        """Region common to both; where there is none, its rows or columns are not above 0."""
        left, top = max(self.column, other.column), max(self.row, other.row)
        right = min(self.column + self.columns, other.column + other.columns)
        bottom = min(self.row + self.rows, other.row + other.rows)
        return Region(left, top, right - left, bottom - top)

    def around(self, inner: Region) -> tuple[Region, ...]:
        """Rectangles that are left of it without a part of it: itself, where that is empty."""
        if inner.rows <= 0 or inner.columns <= 0:
            return (self,)
        below, right = inner.row + inner.rows, inner.column + inner.columns
        return (
            self._replace(rows=inner.row - self.row),
            self._replace(row=below, rows=self.row + self.rows - below),
            inner._replace(column=self.column, columns=inner.column - self.column),
            inner._replace(column=right, columns=self.column + self.columns - right),
        )

    @classmethod
    def checked(cls, camera: Camera, region: tuple[int, int, int, int] | None) -> Region:
        """A region of the sensor; None is all of it.

        Raises
        ------
        InputError
            Outside the sensor, or empty.
        """
        width, height = camera.pixels
        piece = (0, 0, width, height) if region is None else tuple(region)
        if len(piece) == 4 and all(isinstance(number, Integral) for number in piece):
            column, row, columns, rows = piece
            if 0 <= column < column + columns <= width and 0 <= row < row + rows <= height:
                return cls(*piece)
        message = f"{piece} is no part of the sensor; give column, row, columns, rows within {width} x {height}"
        raise refusal("region", message)

    def drawn(self) -> Region:
        """Itself, where a picture of it can be.

        Raises
        ------
        InputError
            More pixels than a picture that is read may have.
        """
        if self.columns * self.rows > MOST_SAMPLES:
            message = (
                f"{self.columns} x {self.rows} pixels are more than the {MOST_SAMPLES / 1e6:.0f} million of a picture; "
                "name a smaller part of the sensor, or give it fewer pixels (sensor.pixel, sensor.size)"
            )
            raise refusal("region", message)
        return self


def pixel_centres(camera: Camera, region: Region, fine: int = 1) -> tuple[Floats, Floats]:
    """Coordinates of pixel centres in the sensor's frame [mm].

    Parameters
    ----------
    region : Region
        May reach beyond the sensor.
    fine : int
        Subpixels per pixel and axis.

    Returns
    -------
    x, y : ndarray
        Shapes (columns * fine,) and (rows * fine,); the sensor's centre is 0, rows count along +y.
    """
    width, height = camera.pixels
    x = region.column + (np.arange(region.columns * fine) + 0.5) / fine - width / 2
    y = region.row + (np.arange(region.rows * fine) + 0.5) / fine - height / 2
    return x * camera.q, y * camera.q


def pixel_response(camera: Camera, region: Region) -> Image | None:
    """Share of their light that a region's pixels take of it slanting; None where nothing is known of that.

    Light of a pixel is taken to come from the middle of the microlens whose image's cell it lies in; tilts are left
    out.
    """
    half = camera.numbers.get("sensor.acceptance")
    if half is None:
        return None
    lattice = ImageLattice.of(camera)
    points = np.stack(np.meshgrid(*pixel_centres(camera, region)), -1)
    index = lattice.nearest(np.linalg.solve(lattice.image_axes, (points - lattice.image_origin)[..., None])[..., 0])
    away = points + np.array(camera.decentre("sensor")) - lattice.microlens(index)
    slope = np.hypot(away[..., 0], away[..., 1]) / float(camera.seen.d_2 * camera["sensor.relay_magnification"])
    return accepted(np.arctan(slope), half).astype(np.float32)


@dataclass(frozen=True, eq=False)
class ImageLattice:
    """Lattice of microlenses and of their images' centres on the sensor, all affine in a whole-numbered index.

    The index counts steps of the lattice's own two axes, so that images have reciprocal vectors and kernels find them
    by rounding; `shapes.lattice.Lattice` counts rows, and lists an array's microlenses.
    """

    axes: Floats
    """Columns: steps of a microlens in its array's frame [mm], shape (2, 2)."""
    turned: Floats
    """Steps of a microlens along the main lens's axes, turned as the array is [mm]."""
    offset: Floats
    """The array's centre from the main lens's [mm], shape (2,)."""
    grow: float
    """Pitch of the images over that of the microlenses."""
    image_origin: Floats
    """Image centre of the microlens at the array's centre, in the sensor's frame [mm], shape (2,)."""
    half_size: Floats
    """Microlenses whose centres lie beyond this in the array's frame are not there: whole cells only [mm]."""
    reach: float
    """Largest distance from an image's centre at which its light may fall, by rays [mm]."""

    @classmethod
    def of(cls, camera: Camera) -> ImageLattice:
        """The lattice of one camera; tilts widen `reach`, everything else is exact."""
        axes = camera.d * PACKINGS[camera.layout].steps
        angle = float(camera["microlens_array.rotation"])
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        offset = np.array(camera.decentre("microlens_array"))
        openings = stop_openings(camera, *offset)
        slack = 2 * tilt_shift(camera, float(np.hypot(*camera.array_size)) / 2) if camera.tilted else 0.0
        return cls(
            axes,
            turn @ axes,
            offset,
            float(1 + camera.seen.d_2 * camera.seen.vergence),
            offset + openings.centres[0] - np.array(camera.decentre("sensor")),
            (np.array(camera.array_size) - [camera.d, axes[1, 1]]) / 2 + 1e-9,
            # A stop cannot widen an image, but a microlens out of focus can, and a finite one moves it.
            float(openings.spans[0] / 2 + microlens_defocus_blur(camera) * math.sqrt(0.5) + slack),
        )

    @property
    def image_axes(self) -> Floats:
        """Columns: steps of an image's centre in the sensor's frame [mm]."""
        return self.grow * self.turned

    def microlens(self, index: NDArray[np.number]) -> Floats:
        """Axes of microlenses from the main lens's centre [mm], shape (..., 2)."""
        return np.asarray(index @ self.turned.T + self.offset)

    def image(self, index: NDArray[np.number]) -> Floats:
        """Centres of their images in the sensor's frame [mm]."""
        return np.asarray(index @ self.image_axes.T + self.image_origin)

    def nearest(self, index: NDArray[np.floating]) -> Floats:
        """Index of the microlens nearest to a fractional one, shape (..., 2), for square and hexagonal packing."""
        corners = [np.floor(index) + np.array([i, j]) for i in (0, 1) for j in (0, 1)]
        far = [np.hypot(*np.moveaxis((index - corner) @ self.axes.T, -1, 0)) for corner in corners]
        return np.asarray(np.choose(np.argmin(far, axis=0)[..., None], corners))

    def holds(self, index: NDArray[np.number]) -> NDArray[np.bool_]:
        """Whether the array has these microlenses."""
        return np.asarray((np.abs(index @ self.axes.T) <= self.half_size).all(-1))

    @property
    def neighbours(self) -> int:
        """Number of lattice steps around the nearest image that may reach a sensor point."""
        axes = self.image_axes
        height = abs(np.linalg.det(axes)) / np.linalg.norm(axes, axis=0).max()
        return math.ceil(float(self.reach / height) + 0.5)

    def indices(self, left: float, right: float, low: float, high: float) -> NDArray[np.int64]:
        """Indices of the microlenses whose images may touch a rectangle of the sensor, shape (N, 2), row by row."""
        least, most = np.array([left, low]) - self.reach, np.array([right, high]) + self.reach
        corners = np.array([[x, y] for x in (least[0], most[0]) for y in (least[1], most[1])])
        ends = np.linalg.solve(self.image_axes, (corners - self.image_origin).T)
        (i0, j0), (i1, j1) = np.floor(ends.min(1)).astype(int), np.ceil(ends.max(1)).astype(int)
        index = np.stack(np.meshgrid(np.arange(i0, i1 + 1), np.arange(j0, j1 + 1)), -1).reshape(-1, 2)
        image = self.image(index)
        near = ((image >= least) & (image <= most)).all(-1)
        return np.asarray(index[near & self.holds(index)])
