"""Least squares with shared parameters and one pose a board: what poses take up is eliminated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .frames import Array, CalibrationError
from .model import GLOBALS, Intrinsics, Poses, ProjectedCorners

_MOST = 200
"""Most evaluations: fits that are determined take 4 to 20, one that is not would wander on."""
_DAMPING = 1e-4
"""Damping of a fit's first step, as a share of each parameter's own information."""
_STRAIGHT = 1e-5
"""Weight of derivatives that hardly count, in place of 0."""
_SETTLED = 1e-12
"""Share of the squares that a last step takes off, or of the parameters that it moves."""
_SCALES = {"A": 100.0, "m": 0.4, "inverse_d_2": 0.5, "x_0": 100.0, "y_0": 100.0, "k_2": 1000.0}
_SCALES |= dict.fromkeys(("k_1", "c_1", "b_1"), 10.0)
_LOST = 0.3
"""Relative standard deviation of A, m or d_2 above which it counts as not determined."""
_CHANCE = 1e-3
"""Share of sets of parallel boards whose noise may pass for tilts."""


class Linear(NamedTuple):
    """A whitened model at one point."""

    off: Array
    """Residuals, shape (b, r)."""
    shared: Array
    """Derivatives by the shared parameters, shape (b, r, p)."""
    own: Array
    """Derivatives by the board's pose, shape (b, r, 6)."""

    def eliminated(self) -> Linear:
        """Residuals and shared columns without what poses take up, in `off` and `shared`.

        `own` is then an orthonormal basis of what poses take up.
        """
        length = np.sqrt(np.square(self.own).sum(axis=1, keepdims=True))
        basis = np.linalg.qr(self.own / np.where(length > 0, length, 1.0))[0]
        turned = np.swapaxes(basis, 1, 2)
        off = self.off - (basis @ (turned @ self.off[..., None]))[..., 0]
        return Linear(off, self.shared - basis @ (turned @ self.shared), basis)

    def information(self) -> Array:
        """Fisher information on the shared parameters, poses eliminated (Schur complement), shape (p, p).

        Computed from residuals of projections, not from a difference of products.
        """
        free = self.eliminated().shared
        return np.asarray(np.einsum("brp,brq->pq", free, free))

    def lengths(self) -> tuple[Array, Array]:
        """Lengths of the shared columns, shape (p,), and of each board's own, (b, 6); 1 where there is nothing."""
        shared = np.sqrt(np.square(self.shared).sum(axis=(0, 1)))
        own = np.sqrt(np.square(self.own).sum(axis=1))
        return np.where(shared > 0, shared, 1.0), np.where(own > 0, own, 1.0)

    def step(self, lengths: tuple[Array, Array], damping: float) -> tuple[Array, Array, float]:
        """Damped step to the least squares, in units of 1/`lengths`, and how much it takes off the sum of squares.

        Of the shared parameters, shape (p,), and of each board's pose, (b, 6).
        """
        boards, _, count = self.shared.shape
        none, root = np.zeros((boards, 6, count + 1)), math.sqrt(damping)
        known = np.concatenate([self.shared / lengths[0], self.off[..., None]], axis=-1)
        own = self.own / lengths[1][:, None]
        held = np.broadcast_to(root * np.eye(6), (boards, 6, 6))
        basis, upper = np.linalg.qr(np.concatenate([own, held], axis=1))
        taken = np.swapaxes(basis, 1, 2) @ np.concatenate([known, none], axis=1)
        free = (np.concatenate([known, none], axis=1) - basis @ taken).reshape(-1, count + 1)
        triangle = np.asarray(np.linalg.qr(np.concatenate([free, root * np.eye(count, count + 1)]), mode="r"))
        by_shared = np.asarray(-np.linalg.solve(triangle[:count, :count], triangle[:count, count]), float)
        by_pose = -np.linalg.solve(upper, taken[..., :count] @ by_shared[:, None] + taken[..., count:])[..., 0]
        moved = known[..., :count] @ by_shared + (own @ by_pose[..., None])[..., 0]
        length = float(by_shared @ by_shared + np.square(by_pose).sum())
        return by_shared, by_pose, float(np.square(moved).sum()) + 2 * damping * length


def whitened(model: ProjectedCorners, measured: Array, weight: Array | NDArray[np.bool_]) -> Linear:
    """Corners where they are modelled minus `measured`, both (b, v, n, k), in units of their errors 1/`weight`."""
    share = np.zeros(measured.shape) + weight
    off = ((model.values - measured) * share).reshape(*model.values.shape[:-3], -1)
    if not model.by_pose.size:
        return Linear(off, model.by_globals, model.by_pose)
    shared, own = ((part * share[..., None]).reshape(len(off), -1, part.shape[-1]) for part in model[1:])
    return Linear(off, shared, own)


class _SettledFit(NamedTuple):
    """A least-squares fit of a camera and its boards' poses."""

    camera: Intrinsics
    poses: Poses
    linear: Linear
    done: bool
    """False where it ran out of evaluations."""


def settle(
    model: Callable[[Array, Array, bool], Linear],
    camera: Intrinsics,
    poses: Poses,
    names: tuple[str, ...],
    far: float | None = None,
) -> _SettledFit:
    """Fit the shared parameters `names` and all poses by least squares, from `camera` and `poses`.

    `model` takes all `GLOBALS`, poses (b, 6) and whether to differentiate; `shared` then has their columns. With
    `far`, residuals beyond it count by Huber's loss: linearly.
    """
    columns = [GLOBALS.index(name) for name in names]

    def at(shared: Array, pose: Array) -> tuple[Linear, Linear, float]:
        linear = model(camera.with_values(names, shared).vector(), pose, True)
        linear = linear._replace(shared=linear.shared[..., columns])
        size = np.abs(linear.off)
        if far is None:
            return linear, linear, float(np.square(size).sum())
        # Beyond `far` a residual pulls as hard from wherever it is: its derivatives bend the sum of squares hardly.
        bends = np.where(size > far, _STRAIGHT, 1.0)
        off = linear.off / bends / np.maximum(size / far, 1.0)
        pulling = Linear(off, linear.shared * bends[..., None], linear.own * bends[..., None])
        return linear, pulling, float(np.where(size > far, far * (2 * size - far), size * size).sum())

    shared, pose = camera.vector(names), poses.vector
    linear, pulling, squares = at(shared, pose)
    lengths, damping, growth, done = pulling.lengths(), _DAMPING, 2.0, False
    for _ in range(_MOST):
        by_shared, by_pose, promised = pulling.step(lengths, damping)
        moved, whole = (
            math.hypot(float(np.linalg.norm(one)), float(np.linalg.norm(other)))
            for one, other in ((by_shared, by_pose), (shared * lengths[0], pose * lengths[1]))
        )
        further = shared + by_shared / lengths[0], pose + by_pose / lengths[1]
        there = at(*further)
        gained = squares - there[2]
        done = moved <= _SETTLED * whole or max(abs(gained), promised) <= _SETTLED * squares
        if gained >= 0:
            (shared, pose), (linear, pulling, squares) = further, there
            wide, own = pulling.lengths()
            lengths = np.maximum(lengths[0], wide), np.maximum(lengths[1], own)
            damping, growth = damping * (0.1 if gained > 0.75 * promised else 0.5), 2.0
        else:
            damping, growth = damping * growth, 2 * growth
        if done:
            break
    return _SettledFit(camera.with_values(names, shared), Poses.from_vector(pose), linear, done)


class Covariance(NamedTuple):
    """Covariance of a fit's shared parameters."""

    names: tuple[str, ...]
    matrix: Array
    """Covariance, shape (p, p)."""
    condition: float
    """Condition number of the normal matrix with its columns scaled to unit length."""

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return dict(zip(self.names, np.sqrt(np.diag(self.matrix)).tolist(), strict=True))

    @property
    def correlation(self) -> Array:
        """Correlation matrix, shape (p, p)."""
        sigma = np.sqrt(np.diag(self.matrix))
        return np.asarray(self.matrix / np.outer(sigma, sigma))

    def part(self, names: Sequence[str]) -> Array:
        """Covariance of the parameters named, in their order."""
        at = [self.names.index(name) for name in names]
        return self.matrix[np.ix_(at, at)]


def covariance_of(information: Array, names: tuple[str, ...]) -> Covariance:
    """Invert an information matrix after scaling it to unit diagonal.

    Raises
    ------
    CalibrationError
        A parameter has no information at all, or the matrix is singular: names what is lost.
    """
    diagonal = np.diag(information)
    typical = np.array([_SCALES.get(name, 1.0) for name in names])
    blind = ~(diagonal * typical**2 > 1e-12)
    if blind.any():
        raise CalibrationError(f"the images do not determine {_symbols(names, blind)}")
    scale = 1 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    if values[0] < 1e-13 * values[-1]:
        share = np.abs(vectors[:, 0]) * scale / typical
        raise CalibrationError(f"the images do not determine {_symbols(names, share > 0.1 * share.max())}: rank loss")
    inverse = (vectors / values) @ vectors.T
    return Covariance(names, inverse * np.outer(scale, scale), float(values[-1] / values[0]))


def _symbols(names: Sequence[str], chosen: NDArray[np.bool_]) -> str:
    return ", ".join("d_2" if name == "inverse_d_2" else name for name, one in zip(names, chosen, strict=True) if one)


def undetermined(covariance: Covariance, camera: Intrinsics, boards: int) -> str:
    """Which of A, m, d_2 so many boards leave open; "" where none.

    Those with a standard deviation above 30 % of their value; A already where parallel boards would seem to tell it as
    well. Of a board tilted by t, the foreshortening t^2/2 against the perspective, which goes with t/A, gives A: its
    relative error is 1/(2 sqrt(S)), with S the sum of squares of two foreshortenings a board over their variance.
    Parallel boards have an S, too: chi^2 with two degrees of freedom a board, the fit takes noise for tilts and finds
    an A several times too large.
    """
    from scipy.special import chdtri

    names = covariance.names[:3]
    sigma = np.sqrt(np.diag(covariance.matrix))[:3]
    most = np.array([min(_LOST, 0.5 / math.sqrt(chdtri(2 * boards, _CHANCE))), _LOST, _LOST])
    return _symbols(names, sigma > most * np.abs(camera.vector(names)))
