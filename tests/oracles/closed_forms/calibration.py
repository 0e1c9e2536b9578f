"""Back-substitution of what a calibration finds."""

from __future__ import annotations

import mpmath as mp

from .camera import Camera, affine_root
from .judging import oracle


@oracle
def back_substitute(focal_length, effective_image_distance, magnification):
    """The camera that shows A and m: d_1 and d_3 from two tries each, d_f and H from rays."""
    d_1 = affine_root(lambda d: d - focal_length, magnification * focal_length)
    d_f = Camera.focused_at(focal_length, d_1).d_1
    d_3 = affine_root(Camera(focal_length, d_1).reach, effective_image_distance, (0, 1))
    return d_1, d_f, d_f / (d_f - d_3), d_3, (d_f - d_3) / d_f


@oracle
def back_substitution_jacobian(focal_length, effective_image_distance, magnification):
    step = mp.mpf(10) ** -25
    base = {
        "focal_length": focal_length,
        "effective_image_distance": effective_image_distance,
        "magnification": magnification,
    }
    columns = []
    for name, value in base.items():
        up, down = (back_substitute(**{**base, name: value * (1 + side * step)})[:4] for side in (1, -1))
        columns.append([(u - v) / (2 * step * value) for u, v in zip(up, down, strict=True)])
    return tuple(tuple(column[row] for column in columns) for row in range(4))
