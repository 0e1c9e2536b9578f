"""Laws by which an objective takes angles in air to image heights, p = h/f = g(theta), as kernels want them.

A law is an array: a row of kind and largest p; of a table also a row an interval, with a cubic of p^2 for theta/p.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._jit import kernel

Law = NDArray[np.float64]

THETA, SINE, STEREOGRAPHIC, TABLE = range(4)
NOTHING = 1e-150
"""Added to p where it divides: changes no other number."""
LAW_COLUMNS = 5
"""Numbers of a law's row."""


@kernel()
def angle_in_air(law: Any, p: Any) -> Any:
    """Angle theta [rad] with g(theta) = p, where p does not exceed the law's largest."""
    kind = law[0, 0]
    if kind == THETA:
        return p * 1.0
    if kind == SINE:
        return np.arcsin(p)
    if kind == STEREOGRAPHIC:
        return 2.0 * np.arctan(p / 2.0)
    q = p * p
    i = 1 + np.maximum(np.searchsorted(law[1:, 0], q.real, "right") - 1, 0)
    t = q - law[:, 0][i]
    return p * (((law[:, 1][i] * t + law[:, 2][i]) * t + law[:, 3][i]) * t + law[:, 4][i])


@kernel()
def stretch(law: Any, p: Any, n: Any) -> Any:
    """Slope in a medium of index n over the first order's, p/n: 1 near the axis, huge at 90 degrees.

    Beyond the law's largest p that of the largest.
    """
    held = np.minimum(p, law[0, 1]) + NOTHING
    angle = angle_in_air(law, held)
    sine, cosine = np.sin(angle), np.cos(angle)
    return sine / np.sqrt((n - 1.0) * (n + 1.0) + cosine * cosine) * (n / held)


@kernel()
def illumination(law: Any, p: Any) -> Any:
    """Irradiance against the axis, through an entrance pupil that is a flat opening of one size: 1 for f sin.

    A part of the image of area dA = f^2 g dg dphi gets its light from the solid angle dOmega = sin(theta) dtheta dphi,
    through an opening that is seen foreshortened, by cos(theta). Its etendue over dA, against that on the axis, is

        cos(theta) sin(theta)/(g g') = sin(theta) cos(theta) theta'(p)/p,

    cos^4 for f tan, sin(theta) cos(theta)/theta for f theta, cos(theta) cos^4(theta/2) for 2f tan(theta/2), 1 for
    f sin. Flat windows and liquid change nothing: n^2 cos(theta) dOmega is the same in each.
    """
    held = np.minimum(p, law[0, 1]) + NOTHING
    angle = angle_in_air(law, held)
    light = np.sin(angle) * np.cos(angle) / held
    kind = law[0, 0]
    if kind == THETA:
        return light
    if kind == SINE:
        return held * 0.0 + 1.0
    if kind == STEREOGRAPHIC:
        return light / (1.0 + held * held / 4.0)
    q = held * held
    i = 1 + np.maximum(np.searchsorted(law[1:, 0], q.real, "right") - 1, 0)
    t = q - law[:, 0][i]
    steepness = (3.0 * law[:, 1][i] * t + 2.0 * law[:, 2][i]) * t + law[:, 3][i]
    return light * (angle / held + 2.0 * q * steepness)


@kernel()
def image_height(law: Any, angle: Any) -> Any:
    """P = g(theta) of angles in air [rad]; beyond what is imaged, the largest."""
    largest = law[0, 1]
    kind = law[0, 0]
    held = np.minimum(angle, angle_in_air(law, largest))
    if kind == THETA:
        return held * 1.0
    if kind == SINE:
        return np.sin(held)
    if kind == STEREOGRAPHIC:
        return 2.0 * np.tan(held / 2.0)
    p, step = held * 0.0, largest
    for _ in range(60):  # the angle rises with p
        step = step / 2.0
        p = p + step * (angle_in_air(law, p + step) < held)
    return p


@kernel()
def first_order(law: Any, slope: Any, n: Any) -> Any:
    """Inverse of p/n times `stretch`: p, of a slope in a medium of index n."""
    return image_height(law, np.arcsin(np.minimum(n * np.sin(np.arctan(slope)), 1.0)))
