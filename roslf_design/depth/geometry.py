"""Where the views of a light field look from, and which depth a disparity has: of a camera, of a grid of cameras."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .._arrays import by_value
from ..calibration.decoding import HALF, LightField
from ..camera import Camera
from ..design import Design
from ..effects.lens import colour_spread
from ..errors import InputError, Problem
from ..progress import Share
from ..theory.colours import filters
from ..theory.depth_error import depth_told, overlapping
from ..theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from ..theory.focused import refuse_focused
from ..theory.length_covariance import LengthCovariance
from ..theory.light_field import depth_sigma, epi_slope, rim_disparity
from .estimate import DisparityMap, DisparityStatus, PixelNoise
from .joint import joint_disparities
from .phases import PhasedViews
from .traced_views import TracedViews
from .unmixing import PreparedViews, ViewLight, places_on_array, returned
from .view_files import CameraGrid

NEGLIGIBLE = 0.05
"""Bias of disparities by views' mean places, in standard errors, that is let be."""
SMOOTHED = 5
"""Microlenses whose median disparity says how far out of focus texture is."""
COLOURS_APART = 0.1
"""Disparity between colours by a real lens's focus beyond which depth is not computed behind colour filters [pitches];
half of it at most is a bias."""
FARTHEST_SAMPLE = 0.8
"""Pitches from the middle of a microlens image to which samples are read at most: work grows as the square."""
Array = NDArray[np.float64]
Unit = Literal["mm", "px"]


def first_order(design: Design) -> Camera:
    """The camera that depth is computed with.

    Raises
    ------
    InputError
        Its objective maps angles otherwise than f tan; behind colour filters, its real lens focuses colours apart; its
        microlenses are focused elsewhere than on the pupil.
    """
    refuse_focused(design, "depth from views")
    camera = Camera.of(design.thin_twin)
    if camera.chain.mapped:
        message = "depth is computed for rays as f tan has them before the objective; drop the mapping for it"
        raise InputError((Problem(camera.chain.mapped, message),), design.name)
    colours = tuple(one.wavelength for one in filters(design.sensor.colours))
    if colours and "lens_colour" in design.main_lens.kind.faults:
        apart = colour_spread(design, colours, 0.0) / design.d
        if apart > COLOURS_APART:
            name = design.main_lens.kind.name
            message = (
                f"{name} focuses the colours of the filters {apart:.2g} pitches apart on the axis, which depth does "
                "not take off; use an achromatic lens, or mono"
            )
            raise InputError((Problem("sensor.colours", message),), design.name)
    return camera


def depth_of(camera: Camera, disparity: Array) -> Array:
    """Z from the main lens of what has a disparity between the FAP's rims [mm]; NaN beyond infinity.

    The inverse of `rim_disparity`, ``Z_F = A/(m + B d/D_F)``.
    """
    inverse = (camera.seen.m + disparity * camera.d / camera.seen.D_F) / camera.seen.A
    if camera.chain.bends:  # which may show a plane in front of it at infinity and beyond
        z = np.asarray(camera.plane_of_vergence(inverse / (1 + camera.seen.d_3 * inverse)), float)
        return np.where(z > camera.chain.end(camera.numbers), z, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.asarray(camera.plane_seen_at(1 / inverse + camera.seen.d_3), float)
    return np.where(inverse > 0, z, np.nan)


def disparity_of(camera: Camera, z: Array) -> Array:
    """Disparity between the FAP's rims of what stands at Z from the main lens [pitches]."""
    return np.asarray(rim_disparity(camera, camera.plane(z).distance - camera.seen.d_3))


def sigma_of(camera: Camera, z: Array, disparity_error: Array) -> Array:
    """Standard error of depth at Z from the main lens for that of the disparity [mm]."""
    plane = camera.plane(z)
    with np.errstate(invalid="ignore"):
        return np.abs(depth_sigma(camera, plane.distance - camera.seen.d_3, disparity_error) * plane.depth)


def calibration_sigma(design: Design, covariance: LengthCovariance, z: Array) -> Array:
    """Standard error that a camera's lengths, known to a covariance, put into depths measured with it.

    What views show of a point is its slope in the epipolar-plane image; lengths that are off make another depth of it
    (Eq. 12), the same in all pictures. To first order.

    Parameters
    ----------
    design : Design
        As calibrated.
    covariance : LengthCovariance
    z : ndarray
        From the main lens [mm], shape (n,).
    """
    camera = Camera.of(design)
    slope = np.asarray(epi_slope(camera, camera.plane(z).distance - camera.seen.d_3))

    return covariance.carried(camera, lambda builds: depth_told(builds.with_axes(1), slope))


class Viewing(Protocol):
    """How the views of decoded light fields look."""

    def prepared(self, field: LightField) -> PreparedViews:
        """A light field with its views' own light, and where they look from."""

    def at_phase(self, views: PreparedViews, found: DisparityMap) -> PreparedViews | None:
        """Views as texture at the disparities found shows itself to them; None where they do not differ."""

    def with_shared(
        self, field: LightField, views: PreparedViews, disparity: Array, picture: Array
    ) -> PreparedViews | None:
        """Views with light that microlenses share, by disparities and a picture; None where that does not pay."""

    def returned(self, views: PreparedViews, disparity: float) -> float:
        """Part of an error of disparities that the picture brings back into such views."""

    def jointly(
        self, field: LightField, noise: PixelNoise, search: tuple[float, float], window: int, progress: Share
    ) -> DisparityMap | None:
        """Disparities with the texture, as of `joint_disparities`; None where pixels show mostly one microlens."""


class ViewGeometry(Protocol):
    """Geometry that turns the disparities of a light field into depths."""

    @property
    def unit(self) -> Unit:
        """Unit of depths; where no distances are known, disparities from view to view stand for them."""

    @property
    def place_unit(self) -> Unit:
        """Unit of `places`."""

    @property
    def tip(self) -> float:
        """Depth of the bore's tip; 0 where depths count from what is foremost."""

    @property
    def window(self) -> int:
        """Microlenses, or pixels of views, that are matched together."""

    def viewing(self, like: LightField) -> Viewing:
        """How the views of light fields look that were decoded as this one."""

    def places(self, field: LightField) -> Array:
        """Where the microlenses stand [mm on the array], or pixels of views [px], shape (v, u, 2)."""

    def depth(self, disparity: Array) -> Array:
        """Depth of points with a disparity over the pupil; NaN beyond infinity."""

    def disparity(self, depth: Array) -> Array:
        """The other way."""

    def sigma(self, depth: Array, disparity_error: Array) -> Array:
        """Standard error of a depth for that of the disparity."""

    def calibration_sigma(self, depth: Array) -> Array | None:
        """Standard error that calibration leaves in a depth; None where it is taken as exact."""


@by_value
@dataclass(frozen=True)
class ArrayGeometry:
    """Geometry of a camera with a microlens array; depths from its main lens [mm]."""

    design: Design
    covariance: LengthCovariance | None = None
    """Covariance of its lengths; None of exact ones."""
    matched: int | None = None
    """Instead of the design's window."""
    unit: Unit = "mm"
    place_unit: Unit = "mm"

    @cached_property
    def camera(self) -> Camera:
        """Camera to first order; errors as of `first_order`."""
        return first_order(self.design)

    @property
    def tip(self) -> float:
        """Z of the bore's tip [mm]."""
        return float(self.camera.tip)

    @property
    def window(self) -> int:
        """Microlenses along a side of the window, as the design has it, odd."""
        return max(3, (self.matched or self.design.depth.window) | 1)

    @cached_property
    def traced(self) -> TracedViews | None:
        """Traced views, where first order is not exact; None of an ideal lens in air."""
        if not self.design.traced_through:
            return None
        return TracedViews(self.design, self.camera, self.depth)

    @property
    def reach(self) -> float:
        """Pitches from the middle of a microlens image to its rim; half of one where images do not overlap."""
        fill = abs(float(microlens_image_diameter(self.camera) / microlens_image_pitch(self.camera)))
        return min(max(HALF, fill / 2), FARTHEST_SAMPLE)

    def viewing(self, like: LightField) -> Viewing:
        """By each view's own light."""
        if self.traced is not None:
            # Light falls by the pitch of first order; traced images lie a little closer together or farther apart.
            like = replace(like, pitch=abs(float(microlens_image_pitch(self.camera) / self.camera.q)))
        return _ArrayViewing(ViewLight(self.camera, like, self.traced), self.traced)

    def places(self, field: LightField) -> Array:
        """Places on the array [mm]."""
        return places_on_array(self.camera, field)

    def depth(self, disparity: Array) -> Array:
        """Z from the main lens [mm]."""
        return depth_of(self.camera, disparity)

    def disparity(self, depth: Array) -> Array:
        """Disparity between the FAP's rims [pitches]."""
        return disparity_of(self.camera, depth)

    def sigma(self, depth: Array, disparity_error: Array) -> Array:
        """Standard error of Z [mm]."""
        return sigma_of(self.camera, depth, disparity_error)

    def calibration_sigma(self, depth: Array) -> Array | None:
        """[mm]; NaN where there is no depth."""
        if self.covariance is None:
            return None
        sigma, known = np.full(np.shape(depth), np.nan), np.isfinite(depth)
        sigma[known] = calibration_sigma(self.design.thin_twin, self.covariance, depth[known])
        return sigma


@dataclass(frozen=True, eq=False)
class _ArrayViewing:
    """Viewing behind microlenses."""

    light: ViewLight
    traced: TracedViews | None

    @cached_property
    def _phased(self) -> PhasedViews:
        return PhasedViews(self.light)

    @cached_property
    def _looks(self) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Where views look from and by how much aside, as lens and elements make them."""
        pupil, aside = self.light.looks
        if self.traced is None:
            return pupil, aside
        seen, beside = self.traced.sight(self.light.like, pupil, self.light.nodes[:2])
        return seen, beside + (aside if aside.ndim > 3 else aside[..., None, None])

    def prepared(self, field: LightField) -> PreparedViews:
        """Freed of neighbours' light."""
        return PreparedViews(self.light.without_crosstalk(field), *self._looks)

    def at_phase(self, views: PreparedViews, found: DisparityMap) -> PreparedViews | None:
        """By the phases of each view's light, and of what is left of its neighbours'.

        Views that these put far apart disagree in bright light: what they have there counts as well.
        """
        told, start = found.measured | (found.status == DisparityStatus.INCONSISTENT), found.begun
        if start is None or not told.any():
            return None
        filled = np.where(told, start.disparity, np.median(start.disparity[told]))
        least = NEGLIGIBLE * found.error if found.measured.any() else 0.0
        return self._phased.in_phase(views, ndimage.median_filter(filled, SMOOTHED), least)

    def with_shared(
        self, field: LightField, views: PreparedViews, disparity: Array, picture: Array
    ) -> PreparedViews | None:
        """By what the picture says of neighbours' light."""
        if not self.light.shares:
            return None
        return self._phased.in_phase(self.light.with_shared(field, views, disparity, picture), disparity, 0.0, True)

    def returned(self, views: PreparedViews, disparity: float) -> float:
        """By the waves that neighbours send."""
        return returned(self.light, views, disparity)

    def jointly(
        self, field: LightField, noise: PixelNoise, search: tuple[float, float], window: int, progress: Share
    ) -> DisparityMap | None:
        """Fit behind an ideal lens whose images overlap so much that few samples show mostly one microlens."""
        if self.traced is not None or not overlapping(self.light.camera):
            return None
        return joint_disparities(self.light, field, noise, search, window, progress)


@dataclass(frozen=True)
class GridGeometry:
    """Geometry of views side by side; disparities between the outermost, and one step beyond."""

    across: int
    """Views along the longer side of the grid."""
    grid: CameraGrid | None = None
    """Where it is known how the cameras stood: depths from them [mm]; else disparities from view to view [px]."""
    window: int = 7
    place_unit: Unit = "px"
    tip: float = 0.0

    @property
    def unit(self) -> Unit:
        """Unit of depths."""
        return "px" if self.grid is None else "mm"

    def viewing(self, like: LightField) -> Viewing:
        """As cameras stand."""
        return self

    def prepared(self, field: LightField) -> PreparedViews:
        """As it is: cameras to the right see near points further left."""
        t, s = np.meshgrid(field.t, field.s, indexing="ij")
        return PreparedViews(field, np.stack([-s, -t]) / self.across)

    def at_phase(self, views: PreparedViews, found: DisparityMap) -> PreparedViews | None:
        """Views of cameras look from where they stand."""
        return None

    def with_shared(
        self, field: LightField, views: PreparedViews, disparity: Array, picture: Array
    ) -> PreparedViews | None:
        """Cameras share no light."""
        return None

    def returned(self, views: PreparedViews, disparity: float) -> float:
        """None."""
        return 0.0

    def jointly(
        self, field: LightField, noise: PixelNoise, search: tuple[float, float], window: int, progress: Share
    ) -> DisparityMap | None:
        """Cameras share no light."""
        return None

    def places(self, field: LightField) -> Array:
        """To the right and upwards from the middle of the views [px]."""
        u, v = np.meshgrid(field.u, field.v)
        return np.stack([u, -v], -1)

    def depth(self, disparity: Array) -> Array:
        """From the cameras [mm], or disparity from view to view [px], above 0 for what is near."""
        step = np.asarray(disparity, float) / self.across
        if self.grid is None:
            return step
        z = np.asarray(self.grid.distance(-step))
        return np.where((z > 0) & (z < math.inf), z, np.nan)

    def disparity(self, depth: Array) -> Array:
        """Disparity over all views [px]."""
        depth = np.asarray(depth, float)
        return self.across * (depth if self.grid is None else -np.asarray(self.grid.slope(depth)))

    def sigma(self, depth: Array, disparity_error: Array) -> Array:
        """Standard error of depths, in their unit."""
        step = disparity_error / self.across
        if self.grid is None:
            return np.asarray(step)
        return np.asarray(depth**2 * step / (self.grid.baseline * self.grid.focal_length))

    def calibration_sigma(self, depth: Array) -> Array | None:
        """Error by calibration, which is not known."""
        return None
