"""Likelihood of camera parameters with every board's pose eliminated, for many cameras at once."""

from __future__ import annotations

import math

import numpy as np

from .._jit import kernel
from .lattice import Array
from .model import GLOBALS
from .statistics_fit import StatisticsFit

_CAMERA = 7
"""Parameters of `GLOBALS` that a likelihood takes: A, m, 1/d_2, x_0, y_0, k_1, k_2."""


class ProfileLikelihood:
    """Log-likelihood of (A, m, 1/d_2, x_0, y_0, k_1, k_2), each board's pose taken along.

    For a camera off the best fit, each pose is moved as the linear fit says, one Gauss-Newton step's gain is taken off
    its misfit in closed form (the Schur complement of the pose block), and what is left is summed over the boards.
    With poses Gaussian about their best, and flat in units of their own standard deviation, this is the likelihood
    with poses integrated out, up to a constant. Flat in millimetres instead would favour far boards, twelve times over,
    and pull A by up to its own standard deviation.
    """

    def __init__(self, fit: StatisticsFit) -> None:
        names = fit.covariance.names
        columns = [GLOBALS.index(name) for name in names]
        self.best = fit.camera.vector()[:_CAMERA]
        self._follow = np.zeros((*fit.pose_by_shared.shape[:2], _CAMERA))
        self._follow[..., columns] = fit.pose_by_shared
        self._fixed = np.array([fit.camera.q, fit.camera.d])
        self._pose = np.ascontiguousarray(fit.poses.vector)
        data = fit.statistics
        weight = 1 / data.sigma
        self._data = tuple(map(np.ascontiguousarray, (data.points, data.values, data.at, data.share, weight)))
        zero = self(self.best[None])
        self.peak = float(zero[0])
        """Log-likelihood at the best fit."""

    def __call__(self, cameras: Array) -> Array:
        """Log-likelihood, up to a constant, shape (w,), of cameras, shape (w, 7); -inf where a board is behind one."""
        cameras = np.ascontiguousarray(cameras, float)
        out = np.empty(len(cameras))
        points, values, at, share, weight = self._data
        shape = self.best, self._follow, self._pose, self._fixed
        _eliminate.compiled(cameras, *shape, points, values, at, share, weight, out)
        return out


@kernel()
def _eliminate(
    cameras: Array,
    best: Array,
    follow: Array,
    pose: Array,
    fixed: Array,
    points: Array,
    values: Array,
    at: Array,
    share: Array,
    weight: Array,
    out: Array,
) -> None:
    boards, corners = share.shape
    for w in range(cameras.shape[0]):
        A, m, x_0, y_0 = cameras[w, 0], cameras[w, 1], cameras[w, 3], cameras[w, 4]
        k_1, k_2, q, d = cameras[w, 5], cameras[w, 6], fixed[0], fixed[1]
        step = q * A * cameras[w, 2]
        R, p, J, H, g = np.empty((3, 3)), np.empty(6), np.empty((3, 6)), np.empty((6, 6)), np.empty(6)
        r = np.empty(3)
        total, behind = 0.0, A <= 0.0 or m <= 0.0 or step <= 0.0
        for b in range(boards):
            for i in range(6):
                p[i] = pose[b, i]
                for j in range(7):
                    p[i] += follow[b, i, j] * (cameras[w, j] - best[j])
            _turn(p, R)
            H[:] = 0.0
            g[:] = 0.0
            misfit = 0.0
            for n in range(corners):
                if weight[b, n, 0] == 0.0:
                    continue
                px, py, pz = points[n, 0], points[n, 1], points[n, 2]
                z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + p[5]
                if z <= 0.0:
                    behind = True
                    break
                sx, sy = -step * at[b, n, 0], -step * at[b, n, 1]
                fx = (R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + p[3] - sx) / z
                fy = (R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + p[4] - sy) / z
                r2 = fx * fx + fy * fy
                gain, bend, curl = 1.0 + r2 * (k_1 + k_2 * r2), k_1 + 2.0 * k_2 * r2, 2.0 * k_2
                wx, wy = share[b, n], 1.0 - share[b, n]
                tilted = wx * fx * fx + wy * fy * fy
                stretch = gain + 2.0 * bend * tilted
                r[0] = weight[b, n, 0] * (x_0 - (A * gain * fx + m * sx) / d - values[b, n, 0])
                r[1] = weight[b, n, 1] * (y_0 - (A * gain * fy + m * sy) / d - values[b, n, 1])
                r[2] = weight[b, n, 2] * (step / d * (m - A * stretch / z) - values[b, n, 2])
                # Derivatives by the ray's slope, then by the corner's place, then by the board's turn and shift.
                a = -A / (d * z)
                txx, txy, tyy = gain + 2.0 * bend * fx * fx, 2.0 * bend * fx * fy, gain + 2.0 * bend * fy * fy
                lx = 2.0 * bend * fx + 4.0 * curl * tilted * fx + 4.0 * bend * wx * fx
                ly = 2.0 * bend * fy + 4.0 * curl * tilted * fy + 4.0 * bend * wy * fy
                J[0, 3], J[0, 4], J[0, 5] = a * txx, a * txy, -a * (txx * fx + txy * fy)
                J[1, 3], J[1, 4], J[1, 5] = a * txy, a * tyy, -a * (txy * fx + tyy * fy)
                s = a * step / z
                J[2, 3], J[2, 4], J[2, 5] = s * lx, s * ly, -s * (lx * fx + ly * fy + stretch)
                for i in range(3):
                    k = weight[b, n, i]
                    for j in range(3, 6):
                        J[i, j] *= k
                    for j in range(3):
                        # dX = R (turn x P): column j of -R [P]_x.
                        u, v = (j + 1) % 3, (j + 2) % 3
                        J[i, j] = 0.0
                        for c in range(3):
                            J[i, j] += J[i, 3 + c] * (R[c, v] * points[n, u] - R[c, u] * points[n, v])
                    misfit += r[i] * r[i]
                    for j in range(6):
                        g[j] += J[i, j] * r[i]
                        for c in range(j + 1):
                            H[j, c] += J[i, j] * J[i, c]
            gained = _gain(H, g)
            if behind or gained < 0.0:
                behind = True
                break
            total += misfit - gained
        out[w] = -math.inf if behind else -0.5 * total


@kernel()
def _turn(vector: Array, R: Array) -> None:
    """Rotation matrix of the first three numbers of a pose."""
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    if square < 1e-8:
        one, two = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = math.sqrt(square)
        half = math.sin(0.5 * angle) / angle
        one, two = math.sin(angle) / angle, 2.0 * half * half
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - two * (y * y + z * z), two * x * y - one * z, two * x * z + one * y
    R[1, 0], R[1, 1], R[1, 2] = two * x * y + one * z, 1.0 - two * (x * x + z * z), two * y * z - one * x
    R[2, 0], R[2, 1], R[2, 2] = two * x * z - one * y, two * y * z + one * x, 1.0 - two * (x * x + y * y)


@kernel()
def _gain(H: Array, g: Array) -> float:
    """``g' H^-1 g`` by Cholesky's method in place; -1 where H is not positive definite."""
    gained = 0.0
    for j in range(6):
        for i in range(j, 6):
            total = H[i, j]
            for k in range(j):
                total -= H[i, k] * H[j, k]
            if i == j:
                if total <= 0.0:
                    return -1.0
                H[j, j] = math.sqrt(total)
            else:
                H[i, j] = total / H[j, j]
        for k in range(j):
            g[j] -= H[j, k] * g[k]
        g[j] /= H[j, j]
        gained += g[j] * g[j]
    return gained
