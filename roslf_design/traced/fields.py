"""Fields of a design behind a real main lens, in the terms that those of an ideal one are told in."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera import Camera, Number
from ..design import Design
from ..theory.light import object_scale, solid_angle
from ..theory.stop_images import MicrolensImages
from .builds import received
from .camera import camera_of, microlenses, sensor_of_pupil
from .images import TracedImages, polygon_moments, real_images

Array = NDArray[np.float64]


def images_of(design: Design, fields: ArrayLike) -> MicrolensImages:
    """Microlens images of a design at fields (N, 2) of its array [mm]; traced where its main lens is real."""
    return MicrolensImages(Camera.of(design), fields) if design.lens is None else LensImages(design, fields)


class LensImages(MicrolensImages):
    """Microlens images of a single design's thin twin, with light and magnification as its real lens makes them."""

    def __init__(self, design: Design, fields: ArrayLike) -> None:
        super().__init__(Camera.of(design), fields)
        self.lens, self.places = camera_of(design), microlenses(design, self.fields)

    @cached_property
    def traced(self) -> TracedImages:
        """Images as the lens makes them."""
        return real_images(self.lens, self.places)

    @cached_property
    def illumination(self) -> Number:
        """Light of a microlens against one whose image nothing cuts, on the lens's axis."""
        axis = real_images(self.lens, np.zeros((1, 2)))
        _, *whole = polygon_moments(axis.outline)
        uncut = uncut_light(self._light(np.zeros((1, 2)), axis.whole_area, *whole), self.camera)
        seen = self.traced
        return (self._light(self.places, seen.area, seen.centroid, seen.second_moments) / uncut)[:, None]

    def _light(self, places: Array, area: Array, centroid: Array, moments: Array) -> Array:
        """Of lit parts, centroids counted from the microlenses' axes [sr], (n,)."""
        shape = np.column_stack([area, places + centroid - self.lens.detector.centre, moments])
        return received(shape, places - self.lens.array.centre, self.lens.array.pose, self.lens.detector.pose)

    @cached_property
    def stretch(self) -> tuple[Number, Number]:
        """Of a microlens's part of the focal plane against that on the axis, along the field's radius and across it."""
        d = float(self.camera.d)
        near = self.places[:, None] + d / 2 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        chief = sensor_of_pupil(self.lens, near, self.lens.fap.centre)
        met = chief.views.at(self.lens.fap.z - self.lens.focal_plane)
        met = np.where(chief.ok[..., None], met, np.nan)
        moved = np.stack([met[:, 0] - met[:, 1], met[:, 2] - met[:, 3]], axis=-1) / d
        along, across = stretches(moved, self.places, object_scale(self.camera))
        return along[:, None], across[:, None]


def uncut_light(light: Array, camera: Camera) -> Array:
    """Of microlenses on the axis, as traced; by first order where the lens does not show them the whole FAP [sr]."""
    return np.where(np.isnan(light), solid_angle(camera), light)


def stretches(moved: Array, place: Array, scale: Number) -> tuple[Array, Array]:
    """How much larger than on the axis microlenses' parts of the focal plane are, along the field's radius and across.

    Parameters
    ----------
    moved : ndarray, (..., 2, 2)
        What chief rays' points on that plane move in x, y per microlens's way along x, y.
    place : ndarray, (..., 2)
        Microlenses, from the lens's axis, along the same axes as their ways.
    scale : float or ndarray
        `object_scale`.
    """
    radius = np.hypot(place[..., 0], place[..., 1])[..., None]
    way = np.where(radius > 0, place / np.where(radius > 0, radius, 1.0), np.array([1.0, 0.0]))
    aside = np.stack([-way[..., 1], way[..., 0]], axis=-1)
    along, across = (np.linalg.norm(np.einsum("...ij,...j", moved, u), axis=-1) / scale for u in (way, aside))
    return along, across
