"""Plane-to-view homographies, and the camera that they all have in common (Zhang's closed form)."""

from __future__ import annotations

import numpy as np

from .lattice import Array
from .model import Poses


def homography(plane: Array, image: Array) -> Array:
    """Homography from points of a plane to an image, by the normalised direct linear transform.

    Parameters
    ----------
    plane, image : ndarray
        Corresponding points, shape (n, 2), n >= 4, not all in one line.

    Returns
    -------
    ndarray
        Shape (3, 3), last element 1.
    """
    here, p = _normalised(plane)
    there, q = _normalised(image)
    zero = np.zeros_like(p)
    rows = np.concatenate(
        [
            np.concatenate([p, zero, -q[:, :1] * p], axis=1),
            np.concatenate([zero, p, -q[:, 1:2] * p], axis=1),
        ]
    )
    matrix = np.linalg.inv(there) @ np.linalg.svd(rows, full_matrices=len(rows) < 9)[2][-1].reshape(3, 3) @ here
    result: Array = matrix / matrix[2, 2]
    return result


def mapped(matrix: Array, points: Array) -> Array:
    """Points of the plane taken through a homography, shape (n, 2)."""
    whole = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    result: Array = whole[:, :2] / whole[:, 2:]
    return result


def shared_camera(homographies: Array, middle: Array) -> tuple[float, float, float] | None:
    """Focal length and principal point (in image units) of square pixels without skew.

    Parameters
    ----------
    homographies : ndarray
        Shape (b, 3, 3).
    middle : ndarray
        A point near the principal point, for scaling and as the fallback for it, shape (2,).

    Returns
    -------
    (F, x_0, y_0) or None
        None where the boards' directions do not determine F, not even with the principal point assumed.
    """
    shift = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, 1.0]])
    moved = shift @ homographies
    size = float(np.median(np.abs(moved[:, :2, :2]).max(axis=(1, 2)) / np.abs(moved[:, 2, 2])))
    scale = max(size * 100.0, 1.0)
    moved = np.diag([1 / scale, 1 / scale, 1.0]) @ moved
    moved = moved / np.cbrt(np.abs(np.linalg.det(moved)))[:, None, None]
    h1, h2 = moved[..., 0], moved[..., 1]
    # omega ~ [[1, 0, b], [0, 1, c], [b, c, e]]: h1' omega h2 = 0 and h1' omega h1 = h2' omega h2.
    crossed = np.column_stack(
        [
            h1[:, 0] * h2[:, 0] + h1[:, 1] * h2[:, 1],
            h1[:, 0] * h2[:, 2] + h1[:, 2] * h2[:, 0],
            h1[:, 1] * h2[:, 2] + h1[:, 2] * h2[:, 1],
            h1[:, 2] * h2[:, 2],
        ]
    )
    equal = np.column_stack(
        [
            (h1[:, :2] ** 2).sum(axis=1) - (h2[:, :2] ** 2).sum(axis=1),
            2 * (h1[:, 0] * h1[:, 2] - h2[:, 0] * h2[:, 2]),
            2 * (h1[:, 1] * h1[:, 2] - h2[:, 1] * h2[:, 2]),
            h1[:, 2] ** 2 - h2[:, 2] ** 2,
        ]
    )
    rows = np.concatenate([crossed, equal])
    values, vectors = np.linalg.svd(rows)[1:]
    a, b, c, e = vectors[-1]
    if len(values) == 4 and values[2] > 1e-6 * values[0] and a != 0:
        x, y = -b / a, -c / a
        square = e / a - x * x - y * y
        if square > 0 and np.hypot(x, y) < np.sqrt(square):
            return float(np.sqrt(square) * scale), float(x * scale + middle[0]), float(y * scale + middle[1])
    power = float(rows[:, 3] @ rows[:, 3])
    square = -float(rows[:, 3] @ rows[:, 0]) / power if power > 0 else 0.0
    return (float(np.sqrt(square) * scale), float(middle[0]), float(middle[1])) if square > 0 else None


def poses_from(homographies: Array, focal: float, centre: tuple[float, float]) -> Poses:
    """Boards' poses before a camera whose picture is turned round (u falls as X grows), from their homographies."""
    from scipy.spatial.transform import Rotation

    inverse = np.linalg.inv(np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]]))
    columns = inverse @ homographies
    columns = columns * np.sign(columns[:, 2:, 2:])
    columns = (
        columns
        / np.sqrt(np.linalg.norm(columns[..., 0], axis=1) * np.linalg.norm(columns[..., 1], axis=1))[:, None, None]
    )
    first, second, translation = np.moveaxis(columns, 2, 0)
    rough = np.stack([first, second, np.cross(first, second)], axis=-1)
    left, _, right = np.linalg.svd(rough)
    turned = np.diag([-1.0, -1.0, 1.0])
    return Poses(Rotation.from_matrix(turned @ left @ right).as_rotvec(), translation @ turned)


def parallel(plane: list[Array], image: list[Array], homographies: Array, sigma: float) -> bool:
    """Whether boards may all be parallel, as far as their corners tell.

    Parallel planes share one vanishing line. The lines, with their errors from corners of standard deviation `sigma`,
    are compared with their weighted mean.

    Parameters
    ----------
    plane, image : list of ndarray
        Each board's corners and their images, shape (n, 2).
    homographies : ndarray
        Shape (b, 3, 3).
    sigma : float
        Of one image coordinate.

    Returns
    -------
    bool
        True unless parallel boards would look as different in fewer than one of 1000 sets.
    """
    from scipy.stats import chi2

    middle = np.mean([points.mean(axis=0) for points in image], axis=0)
    lines, weights = [], []
    for points, matrix in zip(plane, homographies, strict=True):
        across = np.column_stack([points, np.ones(len(points))])
        mapped = across @ matrix.T
        zero = np.zeros_like(across)
        u, v, w = mapped.T
        by_matrix = np.concatenate(
            [
                np.concatenate([across, zero, -across * (u / w)[:, None]], axis=1) / w[:, None],
                np.concatenate([zero, across, -across * (v / w)[:, None]], axis=1) / w[:, None],
            ]
        )[:, :8]
        covariance = sigma**2 * np.linalg.pinv(by_matrix.T @ by_matrix)
        line = _vanishing_line(matrix, middle)
        slope = np.empty((2, 8))
        for k in range(8):
            step = 1e-6 * max(abs(matrix.ravel()[k]), 1e-9)
            nudged = matrix.ravel().copy()
            nudged[k] += step
            slope[:, k] = (_vanishing_line(nudged.reshape(3, 3), middle) - line) / step
        lines.append(line)
        weights.append(np.linalg.pinv(slope @ covariance @ slope.T))
    total = np.sum(weights, axis=0)
    mean = np.linalg.solve(total, np.einsum("bij,bj->i", weights, lines))
    away = np.array(lines) - mean
    misfit = float(np.einsum("bi,bij,bj->", away, weights, away))
    return misfit < float(chi2.ppf(0.999, max(2 * (len(lines) - 1), 1)))


def _vanishing_line(matrix: Array, middle: Array) -> Array:
    """Line of the plane's infinity in the image as (a, b) with a x + b y + 1 = 0 about `middle`; (0, 0): face on."""
    shift = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, 1.0]])
    line = np.linalg.inv(shift @ matrix)[2]
    result: Array = line[:2] / line[2]
    return result


def _normalised(points: Array) -> tuple[Array, Array]:
    middle = points.mean(axis=0)
    spread = float(np.sqrt(np.square(points - middle).sum(axis=1).mean() / 2)) or 1.0
    matrix = np.array([[1 / spread, 0, -middle[0] / spread], [0, 1 / spread, -middle[1] / spread], [0, 0, 1]])
    return matrix, np.column_stack([(points - middle) / spread, np.ones(len(points))])
