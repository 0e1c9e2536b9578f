"""Single microlenses: the shape of each image, and the ray budget: of what fills the pupil, what each element takes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arrays import sunflower
from ..camera import Camera
from ..design import Design
from ..rays import Status, trace_pupil
from ..shapes.cells import area_in_polygon
from ..shapes.discs import ClipStatus, intersect
from ..shapes.lattice import cell_polygon
from ..theory.exit_pupil import microlens_image_pitch
from ..theory.light import half_field
from ..theory.stop_images import MicrolensImages, stop_discs
from .result import Field, RayBudget, Share

Array = NDArray[np.float64]

STATUS = {ClipStatus.FULL: "full", ClipStatus.CLIPPED: "clipped", ClipStatus.EMPTY: "dark"}

RAYS = 65_536
"""Rays per microlens, evenly over the FAP, where no accuracy is asked for."""
BEST_ACCURACY = 3e-5
"""Below this, counting takes more rays than memory holds comfortably."""


def default_fields(design: Design) -> tuple[tuple[float, float], ...]:
    """Centre, edge and corner of what the sensor sees of the MLA [mm].

    Edge and corner are where the sensor or the array ends or, where images move outwards, the outermost microlenses
    whose own cells still lie on the sensor.
    """
    camera = Camera.of(design)
    pitch = abs(float(microlens_image_pitch(camera)))
    edge, corner = (
        min(float(half), max(0.0, sensor / 2 - pitch / 2) * design.d / pitch) if pitch else float(half)
        for half, sensor in zip(half_field(camera), design.sensor_size, strict=True)
    )
    x, y = (sensor - mla for sensor, mla in zip(design.sensor.decentre, design.microlens_array.decentre, strict=True))
    return ((x, y), (x + edge, y), (x + edge, y + corner))


def evaluate_fields(design: Design, axes: Sequence[tuple[float, float]], rays: int = RAYS) -> tuple[Field, ...]:
    """Shape and ray budget of the microlens at each place.

    Parameters
    ----------
    design : Design
    axes : sequence of (x, y)
        Microlens axes, on the MLA [mm].
    rays : int
        Counted for the budget where something is tilted.

    Returns
    -------
    tuple of Field
        From exact areas. Where something is tilted, stops are ellipses on the sensor, still exactly, but shares of the
        ray budget are counted from rays.
    """
    if not axes:
        return ()
    camera = Camera.of(design)
    return _straight(camera, axes) if design.aligned else _tilted(camera, axes, rays)


def axes_in_space(design: Design, axes: ArrayLike) -> Array:
    """Microlens axes against the optical axis: the MLA's rotation and decentre applied; shape (N, 2) [mm]."""
    on_array = np.asarray(axes, float).reshape(-1, 2)
    cosine, sine = math.cos(design.microlens_array.rotation), math.sin(design.microlens_array.rotation)
    turned = on_array @ np.array([[cosine, sine], [-sine, cosine]])
    return np.asarray(turned + np.asarray(design.microlens_array.decentre))


def field_discs(design: Design, axes: ArrayLike) -> tuple[Array, Array]:
    """Discs that the FAP, the main lens and the stops cut out on the sensor, relative to each microlens axis.

    Parameters
    ----------
    design : Design
        Its tilts are left out.
    axes : array_like, shape (N, 2)
        Microlens axes, on the MLA [mm].

    Returns
    -------
    (centres, radii)
        Shapes (N, K, 2) and (N, K) [mm], the FAP first, then `Camera.rims`.
    """
    x, y = (axes_in_space(design, axes) - np.asarray(design.main_lens.decentre)).T
    return stop_discs(Camera.of(design), x, y)


def _names(camera: Camera) -> tuple[str, ...]:
    return tuple(rim.name for rim in (camera.fap, *camera.rims))


def _budget(camera: Camera, past: Array, kept: Array, sensor: float, own: float) -> RayBudget:
    """A budget from shares past the first few rims in the order of light, and in that of the design file."""
    return RayBudget(
        fap=1.0,
        main_lens=float(kept[1]),
        stops=tuple(float(share) for share in kept[2:]),
        own_cell=own,
        by_name=(
            *(Share(rim.name, float(share)) for rim, share in zip(camera.in_light_order, past, strict=True)),
            Share("sensor", sensor),
            Share("own cell", own),
            Share("neighbours", sensor - own),
        ),
    )


def _straight(camera: Camera, axes: Sequence[tuple[float, float]]) -> tuple[Field, ...]:
    """Every stop is a disc on the sensor."""
    images = MicrolensImages(camera, axes)
    centres, radii = (values[:, 0] for values in images.discs)
    names = _names(camera)
    light = [0, *(names.index(rim.name) for rim in camera.in_light_order if rim.name != "FAP")]
    in_file, in_light = (
        np.stack(
            [intersect(centres[:, order[:k]], radii[:, order[:k]]).kept_fraction for k in range(1, len(order) + 1)], -1
        )
        for order in (list(range(len(names))), light)
    )
    # The FAP stands among the others; what stops before it take is taken of the rays that fill it.
    at_fap = [rim.name for rim in camera.in_light_order].index("FAP")
    past = np.concatenate([in_light[:, 1 : at_fap + 1], in_light[:, at_fap : at_fap + 1], in_light[:, at_fap + 1 :]], 1)
    shape = intersect(centres, radii)
    sensor, own = (
        np.minimum(area / (math.pi * radii[:, 0] ** 2), shape.kept_fraction)
        for area in _areas_on_sensor(camera, images, centres, radii)
    )
    return tuple(
        Field(
            x_ml_mm=axis,
            status=STATUS[ClipStatus(int(shape.status[i]))],
            area_mm2=float(shape.area[i]),
            kept_fraction=float(shape.kept_fraction[i]),
            lost_fraction=float(shape.lost_fraction[i]),
            centroid_mm=(float(shape.centroid[i, 0]), float(shape.centroid[i, 1])) if shape.lit[i] else None,
            axis_ratio=float(shape.axis_ratio[i]) if shape.lit[i] else None,
            ray_budget=_budget(camera, past[i], in_file[i], float(sensor[i]), float(min(own[i], sensor[i]))),
            rays=None,
        )
        for i, axis in enumerate(axes)
    )


def _areas_on_sensor(camera: Camera, images: MicrolensImages, centres: Array, radii: Array) -> tuple[Array, Array]:
    """Area of each image on the sensor, and of that in its own cell (0 where the images' pitch is) [mm^2]."""
    pitch = abs(float(microlens_image_pitch(camera)))
    cell = cell_polygon(camera.layout, pitch, float(camera["microlens_array.rotation"])) if pitch else np.empty((0, 2))
    half = np.asarray(camera.sensor_size, float) / 2
    middle = np.asarray(camera.decentre("sensor"), float)
    on_sensor, own = np.zeros(len(radii)), np.zeros(len(radii))
    for i, axis in enumerate(images.from_lens):
        low, high = middle - half - axis, middle + half - axis
        box = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
        on_sensor[i] = area_in_polygon(centres[i], radii[i], box)
        polygon = clipped_to_box(centres[i, 0] + cell, low, high)
        if len(polygon) > 2:
            own[i] = area_in_polygon(centres[i], radii[i], polygon)
    return on_sensor, own


def clipped_to_box(polygon: Array, low: Array, high: Array) -> Array:
    """Part of a convex polygon inside an upright box; corners in order, fewer than three where nothing is left.

    Parameters
    ----------
    polygon : ndarray
        Corners in order, shape (M, 2).
    low, high : ndarray
        Opposite corners of the box, shape (2,).
    """
    for side in (0, 1):
        for sign, limit in ((1.0, high[side]), (-1.0, -low[side])):
            room = limit - sign * polygon[:, side]
            inside: list[Array] = []
            for i in range(len(polygon)):
                j = (i + 1) % len(polygon)
                if room[i] >= 0:
                    inside.append(polygon[i])
                if room[i] * room[j] < 0:
                    inside.append(polygon[i] + (polygon[j] - polygon[i]) * (room[i] / (room[i] - room[j])))
            polygon = np.array(inside).reshape(-1, 2)
    if len(polygon) < 3:
        return np.empty((0, 2))
    x, y = (polygon - polygon[0]).T
    return polygon if abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))) > 0 else np.empty((0, 2))


def rays_for(accuracy: float) -> int:
    """Rays that count a share to within `accuracy`.

    Points that fill the FAP evenly, cut by a rim, miss its share by at most about ``N^-3/4`` (largest of six tilted
    cameras each at 256 to 262 144 rays); twice that is allowed for.

    Raises
    ------
    ValueError
        Not between `BEST_ACCURACY` and 1.
    """
    if not BEST_ACCURACY <= accuracy <= 1:
        raise ValueError(
            f"accuracy {accuracy:g} is out of reach of counted rays; give {BEST_ACCURACY:g} to 1, or leave out tilts: "
            "straight designs are exact"
        )
    return max(256, math.ceil(math.pow(2 / accuracy, 4 / 3)))


def _tilted(camera: Camera, axes: Sequence[tuple[float, float]], rays: int) -> tuple[Field, ...]:
    """Stops are ellipses on the sensor; the shares of the budget are counted."""
    images = MicrolensImages(camera, axes)
    shape = images.shapes
    points = sunflower(rays)
    fields = []
    for i, axis in enumerate(axes):
        kept, past, sensor, own = _count(camera, axis, points)
        lit = bool(shape.lit[i, 0])
        middle = np.array(
            [np.ravel(part)[i if np.size(part) > 1 else 0] for part in (images.outline.x, images.outline.y)]
        )
        centroid = shape.centroid[i, 0] + middle + np.asarray(_part_decentre(camera, "sensor")) - images.in_system[i]
        fields.append(
            Field(
                x_ml_mm=axis,
                status=STATUS[ClipStatus(int(shape.status[i, 0]))],
                area_mm2=float(shape.area[i, 0]),
                kept_fraction=float(shape.kept_fraction[i, 0]),
                lost_fraction=float(shape.lost_fraction[i, 0]),
                centroid_mm=(float(centroid[0]), float(centroid[1])) if lit else None,
                axis_ratio=float(shape.axis_ratio[i, 0]) if lit else None,
                ray_budget=_budget(camera, past, kept, sensor, own),
                rays=rays,
            )
        )
    return tuple(fields)


def _part_decentre(camera: Camera, part: str) -> tuple[float, float]:
    return float(camera[f"{part}.decentre.0"]), float(camera[f"{part}.decentre.1"])


def _count(camera: Camera, axis: tuple[float, float], points: Array) -> tuple[Array, Array, float, float]:
    """Shares of rays past the rims, in the order of the file and of light; on the sensor; in the own cell."""
    rays = trace_pupil(camera, (points[0], points[1]), axis)
    traceable = rays.status != Status.UNTRACEABLE

    def shares(names: Sequence[str]) -> Array:
        past = np.logical_and.accumulate([rays.passes[name] & traceable for name in names])
        return np.asarray(past.mean(axis=1))

    own = rays.status == Status.KEPT
    on_sensor = own | (rays.status == Status.NEIGHBOUR)
    in_light = shares([rim.name for rim in camera.in_light_order])
    return shares(_names(camera)), in_light, float(on_sensor.mean()), float(own.mean())
