"""Least squares with shared parameters and one pose a board: what poses take up is eliminated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .frames import Array, CalibrationError
from .model import GLOBALS, Intrinsics, Poses, ProjectedCorners

_MOST = 200
"""Most evaluations: fits that are determined take 4 to 20, one that is not would wander on."""
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
    from scipy.optimize import least_squares

    count, columns = len(names), [GLOBALS.index(name) for name in names]

    def at(x: Array, derivatives: bool) -> Linear:
        return model(camera.with_values(names, x[:count]).vector(), x[count:].reshape(-1, 6), derivatives)

    def residuals(x: Array) -> Array:
        return at(x, False).off.ravel()

    def jacobian(x: Array) -> Array:
        linear = at(x, True)
        boards, rows = linear.off.shape
        full = np.zeros((boards, rows, len(x)))
        full[..., :count] = linear.shared[..., columns]
        for b in range(boards):
            full[b, :, count + 6 * b : count + 6 * b + 6] = linear.own[b]
        return full.reshape(boards * rows, -1)

    way: dict[str, Any] = {"method": "lm"} if far is None else {"method": "trf", "loss": "huber", "f_scale": far}
    run = least_squares(
        residuals, np.concatenate([camera.vector(names), poses.vector.ravel()]), jacobian,
        x_scale="jac", xtol=1e-12, ftol=1e-12, max_nfev=_MOST, **way,
    )  # fmt: skip
    linear = at(run.x, True)
    linear = linear._replace(shared=linear.shared[..., columns])
    best = camera.with_values(names, run.x[:count])
    return _SettledFit(best, Poses.from_vector(run.x[count:]), linear, bool(run.success))


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
