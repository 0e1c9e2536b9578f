"""Back-substitution: from what a calibration finds (A and m) to the lengths of the camera, with their errors.

A calibration of decoded light fields determines A = d_1/H and m = d_1/d_f, not the focal length: f must be known, and
its error enters d_3 magnified by ``1 + 1/m``. An f assumed without a stated error makes d_3 look better than it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._arrays import Array, floats


class BackSubstituted(NamedTuple):
    """Lengths of the camera from a calibration; the order of rows in the Jacobian is d_1, d_f, H, d_3."""

    mla_distance: Array
    """d_1 = f (1 + m) [mm]."""
    focal_plane_distance: Array
    """d_f = f (1 + m)/m [mm]."""
    aperture_constant: Array
    """H = f (1 + m)/A; inf at A = 0."""
    pupil_distance: Array
    """d_3 = f + (f - A)/m [mm]."""
    inverse_aperture_constant: Array
    """1/H = A/(f (1 + m)), finite."""


def back_substitute(
    focal_length: ArrayLike, effective_image_distance: ArrayLike, magnification: ArrayLike
) -> BackSubstituted:
    """Lengths d_1, d_f, d_3 and the aperture constant from f, A and m.

    Parameters
    ----------
    focal_length, effective_image_distance, magnification : array_like
        f, A [mm] and m.

    Returns
    -------
    BackSubstituted
        Broadcast; only H can be infinite (``A = 0``; finite twin: 1/H, beside it).

    Raises
    ------
    ValueError
        f or m is not positive: at ``m = 0`` the camera is focused at infinity, where ``A = f`` says nothing of d_3.

    Notes
    -----
    Table 2 of the paper is f = 100 mm, A = 91.09 mm, m = 0.42.
    """
    f, reach, m = _determined(focal_length, effective_image_distance, magnification)
    d1 = f * (1 + m)
    with np.errstate(divide="ignore"):
        constant = d1 / reach
    return BackSubstituted(d1, d1 / m, constant, f + (f - reach) / m, reach / d1)


def back_substitution_jacobian(
    focal_length: ArrayLike, effective_image_distance: ArrayLike, magnification: ArrayLike
) -> Array:
    """Derivatives of (d_1, d_f, H, d_3) by (f, A, m).

    Parameters
    ----------
    focal_length, effective_image_distance, magnification : array_like, shape (...)
        f, A [mm] and m; A not 0.

    Returns
    -------
    ndarray, shape (..., 4, 3)
        Rows d_1, d_f, H, d_3; columns f, A, m. Its element (3, 0) is ``1 + 1/m``: 3.4 in the paper's system, where an f
        wrong by 1 % moves d_3 by 3.4 mm.

    Raises
    ------
    ValueError
        As `back_substitute`, and where A is 0.
    """
    f, reach, m = _determined(focal_length, effective_image_distance, magnification)
    if (reach == 0).any():
        raise ValueError("effective_image_distance is 0, where H is infinite: use the inverse aperture constant")
    grown = 1 + m
    f, reach, m, grown = np.broadcast_arrays(f, reach, m, grown)
    jacobian = np.zeros((*m.shape, 4, 3))
    jacobian[..., 0, 0], jacobian[..., 0, 2] = grown, f
    jacobian[..., 1, 0], jacobian[..., 1, 2] = grown / m, -f / (m * m)
    jacobian[..., 2, 0] = grown / reach
    jacobian[..., 2, 1], jacobian[..., 2, 2] = -f * grown / (reach * reach), f / reach
    jacobian[..., 3, 0], jacobian[..., 3, 1] = grown / m, -1 / m
    jacobian[..., 3, 2] = (reach - f) / (m * m)
    return jacobian


def _determined(f: ArrayLike, reach: ArrayLike, m: ArrayLike) -> tuple[Array, ...]:
    values = floats(f, reach, m)
    for name, value in zip(("focal_length", "magnification"), (values[0], values[2]), strict=True):
        if not (value > 0).all():
            raise ValueError(
                f"{name} must be positive, got {float(np.ravel(value[~(value > 0)])[0])}: "
                "without it the pupil distance is not determined"
            )
    return values
