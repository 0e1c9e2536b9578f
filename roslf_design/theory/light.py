"""Diffraction, defocus and sampling: how sharp wave optics lets a microlens image be, how many samples it holds.

One number rules, the microlens's Fresnel number ``N_F = d^2/(4 lambda d_2)``: the image is shadow-sharp for N_F >> 1
and has 4 N_F independent views per axis whatever the pixel count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, magnitude, product, ratio
from ..camera import Camera, Number
from .exit_pupil import microlens_image_diameter, stop_angle

AIRY = 1.22
"""First zero of the Airy pattern over lambda times f-number, to the three digits that the field quotes."""
CUT_MARGIN, STOCK = 0.1, 0.01
"""Rim that a cut array has beyond what the sensor sees of it, on each side [mm]: what dicing may chip; share by which a
size may differ from its stock's."""


def fresnel_number(c: Camera) -> Array:
    """Fresnel number of a microlens seen from the sensor, ``d^2/(4 lambda d_2)``; inf at d_2 = 0."""
    return ratio(c.d, c.wavelength) * ratio(c.d, 4 * c.seen.d_2)


def independent_views(c: Camera) -> Array:
    """Views per axis that diffraction leaves independent, 4 N_F, whatever the pixel count; inf at d_2 = 0."""
    return 4 * fresnel_number(c)


def geometric_views(c: Camera) -> Array:
    """Pixels across an uncut microlens image, the views per axis that ray optics promises; inf at d_3 = d_f."""
    return microlens_image_diameter(c) / c.q


def diffraction_width(c: Camera) -> Array:
    """Width ``lambda d_2/d`` of the blur that a microlens's own aperture makes on the sensor [mm]."""
    return c.wavelength * ratio(c.seen.d_2, c.d)


def airy_radius(c: Camera) -> Array:
    """Airy radius on the sensor of a microlens of diameter d, ``1.22 lambda d_2/d`` [mm]."""
    return AIRY * diffraction_width(c)


def pupil_airy_radius(c: Camera) -> Array:
    """Airy radius on the microlens array of the FAP's own aperture, ``1.22 lambda A/D_F`` [mm]; inf at D_F = 0.

    Of a rectangle the first zero across its shorter side, ``lambda A`` over that.
    """
    pupil = c.fap.outline
    return pupil.first_zero * c.wavelength * ratio(c.seen.A, c.seen.D_F * pupil.slimness)


def microlens_defocus(c: Camera) -> Array:
    """``1 - d_2/f_ml + d_2/L``, signed: 0 where the microlenses image the exit pupil onto the sensor."""
    return ratio(c.f_ml - c.seen.d_2, c.f_ml) + product(c.seen.d_2, c.seen.vergence)


def microlens_defocus_blur(c: Camera) -> Array:
    """Width of the ray blur by defocus of a microlens, ``d d_2 |1/f_ml - 1/d_2 - 1/L|`` [mm]; inf at d_3 = d_f."""
    return c.d * np.abs(microlens_defocus(c))


def microlens_defocus_waves(c: Camera) -> Array:
    """Wavefront error at the middle of a square microlens's edge [waves].

    ``(d^2/8 lambda) |1/f_ml - 1/d_2 - 1/L|``; inf at d_2 = 0 and at d_3 = d_f.
    """
    return ratio(np.abs(microlens_defocus(c)), c.seen.d_2) * (c.d / c.wavelength * (c.d / 8))


def object_sample(c: Camera) -> Array:
    """Footprint ``d d_f/d_1`` of one microlens on the focal plane: the lateral sampling step [mm]; inf at d_f = inf."""
    return product(c.d, object_scale(c))


def object_scale(c: Camera, at: Number | None = None) -> Array:
    """Millimetres on the focal plane per millimetre on the array, about the axis; ``d_f/d_1`` in air, inf at d_f = inf.

    Or on a plane `at` ahead of the bore's tip [mm], along chief rays, which meet in the FAP.
    """
    if at is None:
        return magnitude(product(c.seen.inverse_m, c.focus.magnification))
    plane = c.plane_ahead(at)
    # What a rod or a lens shows beyond infinity has depth and magnification both below 0.
    return magnitude(c.seen.inverse_m * (np.asarray(plane.distance - c.seen.d_3) / c.seen.gap * plane.magnification))


def chief_spread(c: Camera) -> Number:
    """Slope of a chief ray before all that bends light, over its slope where the main lens sees it; 1 in air.

    Flat glass leaves it; an objective before the FAP does not. cos^4 is of the angle there: what the FAP takes of a
    Lambertian surface through its image, the entrance pupil, wherever that lies.
    """
    _, front = c.front
    return magnitude(front.d - front.c * c.seen.d_3)


def chief_slope(c: Camera) -> Array:
    """Slope of the chief ray in the scene for a microlens a millimetre off the axis [1/mm]."""
    return ratio(c.seen.inverse_m * chief_spread(c), c.seen.gap)


def outer_slope(c: Camera, place: ArrayLike) -> Array:
    """Index times slope, to first order, at which the chief ray of a microlens comes out of the bore.

    Parameters
    ----------
    place : array_like
        Of the microlens, from the main lens's axis [mm].
    """
    slope = chief_slope(c) * np.asarray(place)
    return np.asarray(np.sqrt(slope * slope))


def field_stretch(c: Camera, place: ArrayLike) -> tuple[Number, Number]:
    """Slope of the rays of a microlens before the bore over the first order's, along the field's radius and across it.

    `place` is that of the microlens from the main lens's axis [mm]. 1 but behind an objective with a mapping.
    """
    return c.mapping.stretches(lambda: outer_slope(c, place), lambda: c.front[1].medium)


def field_angle(c: Camera, place: ArrayLike) -> Array:
    """Angle at which the chief ray of a microlens comes out of the bore, by Snell's law in the medium there [rad].

    Index times slope of that ray follows from the closed forms; as tangent in air, or as its objective maps it, its
    sine over the index is the sine. Where nothing is imaged, the largest angle that is.

    Parameters
    ----------
    place : array_like
        Of the microlens, from the main lens's axis [mm].
    """
    angle = c.mapping.angle(outer_slope(c, place))
    return np.asarray(np.arcsin(np.sin(angle) / c.front[1].medium))


def falloff(c: Camera, slope: ArrayLike) -> Array:
    """Light on the array against its middle: cos^4 of the chief ray's angle, or what the objective's mapping says.

    Of an objective with a mapping the entrance pupil, the FAP's image before it, counts as an opening of one size, and
    each part of the image gets what comes through it from the angles that the mapping gives it
    (`..lenses.angles.illumination`, which is cos^4 for f tan).

    Parameters
    ----------
    slope : array_like
        Index times slope of the chief ray to first order, as `chief_slope` gives it.
    """
    return np.asarray(c.mapping.light(np.abs(slope)))


class SensorField(NamedTuple):
    """The rectangle of the microlens array that the sensor sees."""

    low: tuple[Array, Array]
    """Its left and lower end, from the main lens's axis [mm]."""
    high: tuple[Array, Array]
    """Ends to the right and above."""

    @property
    def half(self) -> tuple[Array, Array]:
        """Half its width and half its height [mm]."""
        x, y = ((high - low) / 2 for low, high in zip(*self, strict=True))
        return x, y

    @property
    def half_diagonal(self) -> Array:
        """Distance from its middle to a corner [mm]."""
        x, y = self.half
        return np.asarray(np.sqrt(x * x + y * y))  # complex numbers, too: derivatives

    @property
    def radius(self) -> Array:
        """Distance from the main lens's axis to its farthest corner [mm]."""
        x, y = (np.maximum(-low, high) for low, high in zip(*self, strict=True))
        return np.asarray(np.sqrt(x * x + y * y))

    @property
    def corners(self) -> Array:
        """Its corners from the main lens's axis, the upper right one first; shape (..., 4, 2) [mm]."""
        x, y = zip(*self, strict=True)
        places = [np.broadcast_arrays(x[i], y[j]) for i, j in ((1, 1), (0, 1), (1, 0), (0, 0))]
        return np.stack([np.stack(place, -1) for place in places], -2)


def on_array(c: Camera, points: ArrayLike) -> Array:
    """Points counted from the main lens's axis in the array's own axes: its decentre and rotation undone.

    Parameters
    ----------
    c : Camera
        One build; its tilts are left out.
    points : array_like, shape (..., 2)
        [mm].
    """
    turn = c["microlens_array.rotation"]
    cos, sin = np.cos(turn), np.sin(turn)
    from_centre = np.asarray(points) - np.asarray(c.decentre("microlens_array"))
    return np.asarray(from_centre @ np.array([[cos, -sin], [sin, cos]]))


def cut_sides(c: Camera, asked: tuple[float, float] = (0.0, 0.0)) -> tuple[Number, Number]:
    """Sides of the array [mm] cut to what the sensor sees of it, and `CUT_MARGIN` beyond; it reaches places `asked`."""
    view, sides = sensor_field(c), []
    for axis, (most, reach) in enumerate(zip(c.array_size, asked, strict=True)):
        decentre = c[f"microlens_array.decentre.{axis}"]
        half = np.maximum(np.maximum(view.high[axis] - decentre, decentre - view.low[axis]), reach)
        sides.append(np.fmin(most, 2 * (half + CUT_MARGIN)))
    return sides[0], sides[1]


def as_cut(c: Camera) -> tuple[Number, Number]:
    """Sides of the array [mm]; of one as large as the stock that it is cut from those to which it is cut."""
    if c.stock is None:
        return c.array_size
    pairs = zip(c.array_size, c.stock, cut_sides(c), strict=True)
    width, height = (np.where(np.isclose(size, stock, rtol=STOCK), cut, size) for size, stock, cut in pairs)
    return width, height


def sensor_field(c: Camera, margin: ArrayLike = 0.0) -> SensorField:
    """Field of the array whose image centres lie on the sensor, or up to the array's end.

    Half the sensor over ``1 + d_2/L``, the image pitch over the pitch; decentred parts move it.

    Parameters
    ----------
    c : Camera
        Its tilts and the array's rotation are left out.
    margin : array_like, optional
        How far beyond the sensor's edge image centres may lie [mm]; below 0 they lie inside.
    """
    if np.any(margin):
        return _sensor_field(c, np.asarray(margin))
    if SensorField not in c.worked_out:  # several quantities of a camera hang on it
        c.worked_out[SensorField] = _sensor_field(c, np.zeros(()))
    field: SensorField = c.worked_out[SensorField]
    return field


def _sensor_field(c: Camera, margin: Array) -> SensorField:
    grow = 1 + product(c.seen.d_2, c.seen.vergence)
    backward = np.real(grow) < 0
    spread = product(c.seen.d_2, stop_angle(c, c.seen.d_3))
    lows, highs = [], []
    for pupil, array, sensor, wide, size in zip(
        *(c.decentre(part) for part in ("aperture", "microlens_array", "sensor")),
        c.array_size,
        c.sensor_size,
        strict=True,
    ):
        middle, half = sensor + product(spread, pupil), np.maximum(size / 2 + margin, 0.0)
        ends = ratio(middle - half, grow), ratio(middle + half, grow)
        low = np.clip(np.where(backward, ends[1], ends[0]), array - wide / 2, array + wide / 2)
        lows.append(low)
        highs.append(np.clip(np.where(backward, *ends), low, array + wide / 2))
    return SensorField((lows[0], lows[1]), (highs[0], highs[1]))


def view_baseline(c: Camera) -> Array:
    """Distance on the FAP between neighbouring pixels' views, ``q A/d_2 = q d_1/(H d_2)`` [mm]; inf at d_2 = 0."""
    own: Number = np.where(c.fap.behind, 1.0, c.fap.scale)
    return ratio(c.q * c.seen.A, c.seen.d_2) * own


def solid_angle(c: Camera) -> Array:
    """Solid angle of the pupil seen from the array, ``pi/4 (D_F/A)^2`` of a disc [sr]: the light a pixel gets."""
    return np.asarray(c.fap.outline.sized(ratio(c.seen.D_F, c.seen.A)).area)
