"""From a pixel of a microlens image to a point of the pupil, and back: Eqs. 1, 2 and 4.

A pixel's coordinate s' counts pixels within one microlens image from that image's own centre s'_0, which is where the
chief ray (through the pupil's centre) lands. The microlens turns the picture round: s' up is S' down.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from ._arrays import Array, floats, product, ratio
from .pupils import centre_shift_per_microlens


def pixel_to_pupil(
    pixel: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    effective_image_distance: ArrayLike,
    centre: ArrayLike = 0.0,
) -> Array:
    """Coordinate on the flexible angular plane that a pixel looks at.

    Parameters
    ----------
    pixel, centre : array_like
        s' and s'_0 [px].
    pixel_pitch, sensor_distance : array_like
        q and d_2 [mm].
    effective_image_distance : array_like
        A = d_1/H [mm].

    Returns
    -------
    ndarray
        ``S' = -(q A / d_2)(s' - s'_0)`` [mm], broadcast; inf at ``d_2 = 0`` but for the centre pixel (finite twin:
        `pupil_to_pixel`).

    Notes
    -----
    Eq. 2.
    """
    s, q, d2, reach, s0 = floats(pixel, pixel_pitch, sensor_distance, effective_image_distance, centre)
    return ratio(-product(s - s0, q * reach), d2)


def pupil_to_pixel(
    coordinate: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    effective_image_distance: ArrayLike,
    centre: ArrayLike = 0.0,
) -> Array:
    """Pixel of a microlens image that looks at a coordinate on the flexible angular plane.

    Parameters
    ----------
    coordinate : array_like
        S' [mm].
    pixel_pitch, sensor_distance : array_like
        q and d_2 [mm].
    effective_image_distance : array_like
        A = d_1/H [mm].
    centre : array_like
        s'_0 [px].

    Returns
    -------
    ndarray
        ``s' = s'_0 - d_2 S' / (q A)`` [px], broadcast; inf at ``A = 0`` (``d_3 = d_f``) but for ``S' = 0`` (finite
        twin: `pixel_to_pupil`).

    Notes
    -----
    Eq. 2, inverted.
    """
    coord, q, d2, reach, s0 = floats(coordinate, pixel_pitch, sensor_distance, effective_image_distance, centre)
    return s0 - ratio(d2 * coord, q * reach)


def pixel_to_lens(
    pixel: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    mla_distance: ArrayLike,
    centre: ArrayLike = 0.0,
) -> Array:
    """Coordinate on the main lens that a pixel looks at in a traditional light-field camera.

    Parameters
    ----------
    pixel, centre : array_like
        s' and s'_0 [px], s'_0 where the ray through the lens's centre lands.
    pixel_pitch, sensor_distance, mla_distance : array_like
        q, d_2 and d_1 [mm].

    Returns
    -------
    ndarray
        ``-(q d_1 / d_2)(s' - s'_0)`` [mm], broadcast; inf at ``d_2 = 0`` but for the centre pixel.

    Notes
    -----
    Eq. 1: Eq. 2 with the flexible angular plane at the lens, ``d_3 = 0``, ``A = d_1``.
    """
    return pixel_to_pupil(pixel, pixel_pitch, sensor_distance, mla_distance, centre)


def centre_deviation(
    index: ArrayLike,
    microlens_pitch: ArrayLike,
    pixel_pitch: ArrayLike,
    sensor_distance: ArrayLike,
    focal_length: ArrayLike,
    focal_plane_distance: ArrayLike,
    pupil_distance: ArrayLike,
) -> Array:
    """Deviation of a microlens image's centre from where a traditional light field has it.

    Parameters
    ----------
    index : array_like
        x - x_0, microlenses from the axis.
    microlens_pitch, pixel_pitch, sensor_distance : array_like
        d, q and d_2 [mm].
    focal_length, focal_plane_distance, pupil_distance : array_like
        f, d_f and d_3 [mm]; d_f may be inf.

    Returns
    -------
    ndarray
        ``d d_2 d_3 d_f / (q d_1^2 (d_f - d_3)) (x - x_0)`` [px], broadcast; towards the axis where of the index's sign;
        inf at ``d_3 = d_f`` off axis (finite twin: `inverse_aperture_constant`).

    Notes
    -----
    Eq. 4, x counted in microlenses.
    """
    (x,) = floats(index)
    return product(
        x,
        centre_shift_per_microlens(
            microlens_pitch, pixel_pitch, sensor_distance, focal_length, focal_plane_distance, pupil_distance
        ),
    )


def view_baseline(pixel_pitch: ArrayLike, sensor_distance: ArrayLike, effective_image_distance: ArrayLike) -> Array:
    """Distance on the flexible angular plane between the views of two neighbouring pixels.

    Parameters
    ----------
    pixel_pitch, sensor_distance : array_like
        q and d_2 [mm].
    effective_image_distance : array_like
        A = d_1/H [mm].

    Returns
    -------
    ndarray
        ``q d_1 / (H d_2)`` [mm], broadcast; inf at ``d_2 = 0`` (finite twin: `pupil_to_pixel`).

    Notes
    -----
    The step of Eq. 2.
    """
    q, d2, reach = floats(pixel_pitch, sensor_distance, effective_image_distance)
    return ratio(q * reach, d2)
