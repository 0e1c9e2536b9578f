"""Where the model puts a board's corners, and its derivatives.

A view is a pinhole at S' on the flexible angular plane (Eqs. 2 and 10); the slope of the ray from it to a corner is
distorted radially, then scaled to the array:

    S' = -(q A / d_2) s',    xi = (X - S')/Z_F,    xi_d = xi (1 + k_1 |xi|^2 + k_2 |xi|^4),
    u - u_0 = -(A xi_d + m S')/d.

Without distortion this is the light-field projection of `roslf_design.theory`. s'_0 is 0 by choice of origin: another
would move u_0 and the boards, nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .lattice import Array

GLOBALS = ("A", "m", "inverse_d_2", "x_0", "y_0", "k_1", "k_2", "q", "d")
"""Parameters all boards share, in the order of the Jacobian's columns."""


@dataclass(frozen=True)
class Camera:
    """What a calibration finds, in the paper's symbols."""

    A: float
    """d_1/H [mm]."""
    m: float
    """d_1/d_f."""
    inverse_d_2: float
    """1/d_2 [1/mm]."""
    x_0: float
    """Microlens on the axis [pitches]."""
    y_0: float
    """[pitches]"""
    k_1: float = 0.0
    """Radial distortion of ray slopes at the FAP."""
    k_2: float = 0.0
    q: float = 1.0
    """Pixel pitch [mm]: from the data sheet."""
    d: float = 1.0
    """Microlens pitch [mm]: from the data sheet."""

    def vector(self, names: tuple[str, ...] = GLOBALS) -> Array:
        """The parameters named, in order."""
        return np.array([getattr(self, name) for name in names])

    def with_values(self, names: tuple[str, ...], values: Array) -> Camera:
        """A camera with the parameters named changed."""
        return replace(self, **{name: float(value) for name, value in zip(names, values, strict=True)})


class Poses(NamedTuple):
    """Boards in the frame of the FAP (X, Y along the array, Z_F into the scene)."""

    rotation: Array
    """Rotation vectors [rad], shape (b, 3)."""
    translation: Array
    """Of the board's origin [mm], shape (b, 3)."""

    @property
    def vector(self) -> Array:
        """Six numbers a board, shape (b, 6)."""
        return np.concatenate([self.rotation, self.translation], axis=-1)

    @classmethod
    def from_vector(cls, vector: NDArray[Any]) -> Poses:
        """From six numbers a board, shape (b, 6) or flat."""
        six = vector.reshape(-1, 6)
        return cls(six[:, :3], six[:, 3:])


class Projected(NamedTuple):
    """Model coordinates and derivatives, for boards b, views v, corners n."""

    uv: NDArray[Any]
    """[pitches], shape (b, v, n, 2)."""
    by_globals: NDArray[Any] | None
    """Derivatives by `GLOBALS`, shape (b, v, n, 2, 9)."""
    by_pose: NDArray[Any] | None
    """Derivatives by the board's own pose, shape (b, v, n, 2, 6)."""


def rotation_matrix(vector: NDArray[Any]) -> NDArray[Any]:
    """Rotation matrices of rotation vectors, shape (..., 3) -> (..., 3, 3); also for complex vectors."""
    one, two, _ = _rotation_series(vector)
    cross = cross_matrix(vector)
    result: NDArray[Any] = np.eye(3) + one[..., None, None] * cross + two[..., None, None] * (cross @ cross)
    return result


def project_boards(
    camera: NDArray[Any], pose: NDArray[Any], points: Array, views: Array, derivatives: bool = False
) -> Projected:
    """Corners of boards in views, with analytic derivatives.

    Parameters
    ----------
    camera : ndarray
        The nine `GLOBALS`, shape (9,).
    pose : ndarray
        Rotation vector and translation of each board, shape (b, 6).
    points : ndarray
        Corners in the board's frame [mm], shape (n, 3).
    views : ndarray
        (s', t') [px], shape (v, 2).
    derivatives : bool
        Ask for the Jacobian.

    Returns
    -------
    Projected
        For complex arguments complex, so that a complex step checks the derivatives.
    """
    A, m, inverse_d_2, x_0, y_0, k_1, k_2, q, d = camera
    turn = rotation_matrix(pose[:, :3])
    scene = np.einsum("bij,nj->bni", turn, points) + pose[:, None, 3:]
    depth = scene[:, None, :, 2]
    pupil = -(q * A * inverse_d_2) * views[None, :, None, :]
    slope = (scene[:, None, :, :2] - pupil) / depth[..., None]
    radius2 = (slope * slope).sum(axis=-1)
    gain = 1 + radius2 * (k_1 + k_2 * radius2)
    bent = gain[..., None] * slope
    uv = np.array([x_0, y_0]) - (A * bent + m * pupil) / d
    if not derivatives:
        return Projected(uv, None, None)
    stretch = gain[..., None, None] * np.eye(2)
    stretch = stretch + (2 * (k_1 + 2 * k_2 * radius2))[..., None, None] * slope[..., :, None] * slope[..., None, :]
    by_pupil = (A / d) * stretch / depth[..., None, None] - (m / d) * np.eye(2)
    shear = np.einsum("bvnij,vj->bvni", by_pupil, views)
    by_globals = np.zeros((*uv.shape, len(GLOBALS)), uv.dtype)
    by_globals[..., 0] = -bent / d - q * inverse_d_2 * shear
    by_globals[..., 1] = -np.broadcast_to(pupil, uv.shape) / d
    by_globals[..., 2] = -q * A * shear
    by_globals[..., 0, 3] = by_globals[..., 1, 4] = 1.0
    by_globals[..., 5] = -(A / d) * radius2[..., None] * slope
    by_globals[..., 6] = -(A / d) * (radius2 * radius2)[..., None] * slope
    by_globals[..., 7] = -A * inverse_d_2 * shear
    by_globals[..., 8] = (A * bent + m * pupil) / (d * d)
    by_scene = np.concatenate([np.broadcast_to(np.eye(2), (*slope.shape, 2)), -slope[..., None]], axis=-1)
    by_scene = -(A / d) * (stretch @ by_scene) / depth[..., None, None]
    twist = -turn[:, None] @ cross_matrix(points) @ right_jacobian(pose[:, None, :3])
    by_pose = np.concatenate([by_scene @ twist[:, None], by_scene], axis=-1)
    return Projected(uv, by_globals, by_pose)


def bordered(shared: Array, own: Array) -> Array:
    """Jacobian with shared columns first, then six columns a board."""
    boards, rows, count = shared.shape
    full = np.zeros((boards, rows, count + 6 * boards))
    full[..., :count] = shared
    for b in range(boards):
        full[b, :, count + 6 * b : count + 6 * b + 6] = own[b]
    return full.reshape(boards * rows, -1)


def cross_matrix(vector: NDArray[Any]) -> NDArray[Any]:
    """Matrix of the cross product with a vector from the left, shape (..., 3) -> (..., 3, 3)."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2)


def right_jacobian(vector: NDArray[Any]) -> NDArray[Any]:
    """Right Jacobian J of the rotation vector: ``R(r + dr) = R(r) R(J dr)`` to first order in dr."""
    _, two, three = _rotation_series(vector)
    cross = cross_matrix(vector)
    result: NDArray[Any] = np.eye(3) - two[..., None, None] * cross + three[..., None, None] * (cross @ cross)
    return result


def _rotation_series(vector: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """sin(a)/a, (1 - cos a)/a^2, (a - sin a)/a^3 with series where a is small."""
    square = (vector * vector).sum(axis=-1)
    small = np.abs(square) < 1e-3
    safe = np.where(small, 1.0, square)
    angle = np.sqrt(safe)
    one = np.where(small, 1 - square / 6 * (1 - square / 20 * (1 - square / 42)), np.sin(angle) / angle)
    half = np.sin(angle / 2) / angle
    two = np.where(small, 0.5 - square / 24 * (1 - square / 30 * (1 - square / 56)), 2 * half * half)
    series = (1 - square / 20 * (1 - square / 42 * (1 - square / 72))) / 6
    three = np.where(small, series, (angle - np.sin(angle)) / (safe * angle))
    return one, two, three
