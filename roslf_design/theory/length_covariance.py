"""How sure the lengths of a camera are, and what that leaves uncertain in whatever follows from them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from .._arrays import Array
from ..camera import Camera

STEP = 0.05
"""Step of a length, for derivatives [standard deviations]."""
EXACT = 1e-6
"""Standard deviation, in that of a build, of lengths that a data sheet knows exactly."""

ROUNDING = 1e-14
"""Part of a variance that counts as none."""


class LengthCovariance(NamedTuple):
    """Covariance of lengths of a camera."""

    places: tuple[str, ...]
    """Places of the lengths, such as "aperture.distance"."""
    matrix: Array
    """[mm^2] of lengths, shape (n, n)."""

    def of(self, places: tuple[str, ...]) -> LengthCovariance:
        """Covariance of some of the lengths."""
        some = [self.places.index(place) for place in places]
        return LengthCovariance(places, self.matrix[np.ix_(some, some)])

    def informed(self, information: Array) -> LengthCovariance:
        """Covariance with what measurements tell besides, ``(C^-1 + F)^-1``; never larger.

        Parameters
        ----------
        information : ndarray, shape (n, n)
            F of the likelihood alone [1/mm^2]. It may leave lengths open, as C may hold some exactly: neither is
            inverted.
        """
        unit, own = self._scaled
        values, vectors = np.linalg.eigh((information + information.T) / 2 * np.outer(unit, unit))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        moved = own @ root
        taken = moved @ np.linalg.solve(np.eye(len(values)) + root.T @ moved, moved.T)
        return LengthCovariance(self.places, _rest(own, (taken + taken.T) / 2) * np.outer(unit, unit))

    def split(self, known: LengthCovariance) -> tuple[LengthCovariance, LengthCovariance]:
        """Covariance of all lengths from that of some which are known better, and that of what these leave open.

        Parameters
        ----------
        known : LengthCovariance
            Of some of the lengths, and perhaps of others; in place of their own.

        Returns
        -------
        tuple of LengthCovariance
            Of the known lengths and of what follows from them of the others; of what does not, independent of it. The
            sum of both is the covariance of all.
        """
        (unit, own), count = self._scaled, len(known.places)
        rest = tuple(place for place in self.places if place not in known.places)
        open_, shared = (np.array([self.places.index(p) for p in some], int) for some in (
            rest, [p for p in known.places if p in self.places]))  # fmt: skip
        mixed = own[np.ix_(open_, shared)]
        slopes = mixed @ np.linalg.pinv(own[np.ix_(shared, shared)], rcond=1e-9, hermitian=True)
        left = _rest(own[np.ix_(open_, open_)], slopes @ mixed.T) * np.outer(unit[open_], unit[open_])
        follow = np.eye(count + len(rest), count)
        columns = [known.places.index(self.places[k]) for k in shared]
        per_length = 1 / np.where(unit > 0, unit, 1.0)
        follow[np.ix_(range(count, count + len(rest)), columns)] = slopes * np.outer(unit[open_], per_length[shared])
        told = LengthCovariance((*known.places, *rest), follow @ known.matrix @ follow.T)
        return told, LengthCovariance(rest, left)

    def plus(self, other: LengthCovariance) -> LengthCovariance:
        """Covariance with independent errors of some of the lengths on top."""
        at, matrix = [self.places.index(place) for place in other.places], self.matrix.copy()
        matrix[np.ix_(at, at)] += other.matrix
        return LengthCovariance(self.places, matrix)

    @property
    def _scaled(self) -> tuple[Array, Array]:
        """Standard deviations, and the covariance in units of them."""
        unit = np.sqrt(np.diag(self.matrix))
        safe = np.where(unit > 0, unit, 1.0)
        return unit, self.matrix / np.outer(safe, safe)

    def carried(self, camera: Camera, compute: Callable[[Camera], Array]) -> Array:
        """Standard error of what is computed of a camera, ``sqrt(J C J^T)``: to first order (GUM 5.2).

        Parameters
        ----------
        camera : Camera
            With the lengths that are best known; its builds may have any shape (...).
        compute : callable
            Of cameras of shape (b, ...), an array of shape (b, ...), or (b, n) of single ones.

        Returns
        -------
        ndarray
            Shape (...) or (n,); NaN where there is nothing finite to derive.
        """
        sigma = np.sqrt(np.diag(self.matrix))
        uncertain = np.flatnonzero(sigma)
        with np.errstate(invalid="ignore"):
            values = np.asarray(compute(_stepped(camera, self.places, sigma.tobytes())), float)
            values = np.broadcast_to(values, (2 * uncertain.size, *values.shape[1:]))
            ahead, behind = values[: uncertain.size], values[uncertain.size :]
            rates = np.moveaxis(ahead - behind, 0, -1) / (2 * STEP * sigma[uncertain])
            own = self.matrix[np.ix_(uncertain, uncertain)]
            variance = np.einsum("...i,ij,...j->...", rates, own, rates)
        return np.sqrt(np.where(variance < 0, 0.0, variance))  # below 0 by rounding alone


@lru_cache(maxsize=4)
def _stepped(camera: Camera, places: tuple[str, ...], deviations: bytes) -> Camera:
    """Builds of a camera with each uncertain length a step off, first one way, then the other.

    Kept, as many lines of a data sheet ask for those of one camera.
    """
    sigma = np.frombuffer(deviations)
    steps = STEP * np.diag(sigma)[:, np.flatnonzero(sigma)]
    offsets = np.concatenate([steps, -steps], axis=1).reshape(len(sigma), -1, *(1,) * len(camera.shape))
    return camera.replace({place: camera[place] + off for place, off in zip(places, offsets, strict=True)})


def _rest(covariance: Array, taken: Array) -> Array:
    """Covariance less what is known of it, both in units of standard deviations; what rounding leaves is nothing."""
    rest = covariance - taken
    some = np.diag(rest) > ROUNDING
    return np.where(np.outer(some, some), rest, 0.0)


class CalibratedLengths(NamedTuple):
    """Lengths of a camera as a calibration knows them."""

    covariance: LengthCovariance
    """By itself: its data sheet is what was known of them before."""
    information: LengthCovariance | None = None
    """F, what measurements alone tell of these and of all other lengths that move what they see [1/mm^2]; None of a
    calibration that does not say."""
    sheet: Array | None = None
    """Standard deviations that the data sheet knows the latter to, shape (n,); infinite where it says nothing."""
    planned: bool = False
    """Whether the calibration is yet to be made."""
    uncovered_mm: tuple[float, ...] = ()
    """Distances ahead of the tip, of those asked for, that its boards do not cover."""

    def after(self, build: LengthCovariance | None) -> tuple[LengthCovariance, LengthCovariance]:
        """Covariance of a build's lengths, its tolerances being what was known before, as `LengthCovariance.split`.

        A data sheet counts for as much as it knows a length better than the build's tolerances do. Without a build,
        and of a calibration that does not say what measurements alone tell, known lengths have the calibration's own.
        """
        if build is None:
            return self.covariance, LengthCovariance((), np.zeros((0, 0)))
        if self.information is None:
            return build.split(self.covariance)
        shared = tuple(place for place in self.information.places if place in build.places)
        at = [self.information.places.index(place) for place in shared]
        prior, information = build.of(shared), self.information.of(shared).matrix
        if self.sheet is not None:
            made = np.sqrt(np.diag(prior.matrix))
            told = np.maximum(self.sheet[at], EXACT * made)
            better = np.array([t**-2 - m**-2 if t < m else 0.0 for t, m in zip(told, made, strict=True)])
            information = information + np.diag(better)
        return build.split(prior.informed(information))

    def to_dict(self) -> dict[str, Any]:
        """As JSON's types, without `planned`; null where the data sheet says nothing."""
        data: dict[str, Any] = {"places": list(self.covariance.places), "matrix": self.covariance.matrix.tolist()}
        if self.information is not None:
            told = {"places": list(self.information.places), "matrix": self.information.matrix.tolist()}
            sheet = [] if self.sheet is None else self.sheet.tolist()
            told["sheet_sigma"] = [sigma if math.isfinite(sigma) else None for sigma in sheet] or None
            data["information"] = told
        return data
