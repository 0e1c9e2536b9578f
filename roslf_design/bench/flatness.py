"""Flatness, probing and sphere-spacing errors of measured points, in the terms of VDI/VDE 2634-2."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtri

from .._arrays import Array

ROUND = 0.4
"""Share by which spheres' radii and spacing may be off what is calibrated: beyond, they are something else."""
REJECTED = 0.003
"""Share of the points that may be left out as strays before ranges are taken."""


class SurfaceFit(NamedTuple):
    """Measured points about the surface that fits them best."""

    parameters: Array
    """Plane: Z at x = y = 0, and its growth along x and y. Sphere: its centre and, if fitted, its radius."""
    covariance: Array
    """Covariance of those, by the points' errors; neighbours within a window err alike."""
    error: float
    """Range of the points' distances from it, strays left out: flatness error, or probing error (form) [mm]."""
    error_sigma: float
    """Standard error of that range, of independent normal errors."""
    rms: float
    """[mm]"""
    rms_sigma: float

    @classmethod
    def plane(cls, points: Array, sigma: Array, window: float) -> SurfaceFit:
        """Plane that fits points best, by their distances square to it.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            x, y and Z [mm].
        sigma : ndarray, shape (n,)
            Standard errors of Z, each point's own [mm].
        window : float
            Points that share a measurement, and err alike.
        """
        x, y, z = points.T

        def distance(at: Array) -> Array:
            return np.asarray((z - at[0] - at[1] * x - at[2] * y) / math.sqrt(1 + at[1] ** 2 + at[2] ** 2))

        start = np.linalg.lstsq(np.stack([np.ones(z.size), x, y], -1) / sigma[:, None], z / sigma, rcond=None)[0]
        parameters, covariance, off = _fitted(distance, start, sigma, window)
        return cls(parameters, covariance, *_range(off, max(1.0, z.size / window)))

    @classmethod
    def sphere(cls, points: Array, sigma: Array, window: float, centre: Array, radius: float, free: bool) -> SurfaceFit:
        """Sphere that fits points best, from a centre and a radius to begin with; `free` fits the radius too.

        Errors of Z count along the sphere's normal. Other arguments as of `plane`.
        """

        def distance(at: Array) -> Array:
            return np.asarray(np.linalg.norm(points - at[:3], axis=1) - (at[3] if free else radius))

        start = np.append(centre, radius) if free else np.asarray(centre, float)
        own = sigma
        for _ in range(2):
            parameters, covariance, off = _fitted(distance, start, own, window)
            away = points - parameters[:3]
            steep = np.abs(away[:, 2]) / np.maximum(np.linalg.norm(away, axis=1), 1e-30)
            own, start = sigma * np.maximum(steep, 0.2), parameters
        return cls(parameters, covariance, *_range(off, max(1.0, len(points) / window)))


def _range(off: Array, independent: float) -> tuple[float, float, float, float]:
    """Range of distances without strays and its standard error, rms and its own.

    A range of normal errors is one of quantiles, whose errors are those of order statistics.
    """
    rejected = math.floor(REJECTED * off.size)
    nearest = np.sort(off)
    for _ in range(rejected):
        nearest = nearest[1:] if -nearest[0] > nearest[-1] else nearest[:-1]
    rms = float(np.sqrt(np.mean(off**2)))
    tail = max(REJECTED / 2, 0.5 / independent)
    density = math.exp(-(float(ndtri(tail)) ** 2) / 2) / math.sqrt(2 * math.pi)
    sigma = rms * math.sqrt(2 * tail / independent) / density
    return float(nearest[-1] - nearest[0]), sigma, rms, rms / math.sqrt(2 * independent)


def _fitted(
    distance: Callable[[Array], Array], start: Array, sigma: Array, window: float
) -> tuple[Array, Array, Array]:
    """Parameters, their covariance, and distances from the surface; strays beyond three thousandths do not count.

    Points that scatter more than their errors say, as a texture puts them off, widen the covariance (Birge).
    """
    used = np.ones(sigma.size, bool)
    rates = np.zeros((0, 0))

    def left(at: Array, some: NDArray[np.bool_]) -> Array:
        return np.asarray(distance(at)[some] / sigma[some])

    for _ in range(3):
        fit = least_squares(left, start, args=(used,), method="lm")
        start, rates = fit.x, np.asarray(fit.jac)
        off = np.abs(distance(start)) / sigma
        before, used = used, off <= np.quantile(off, 1 - REJECTED)
        if (used == before).all():
            break
    wider = max(1.0, float(np.mean(off[used] ** 2)))
    return start, np.asarray(np.linalg.pinv(rates.T @ rates) * window * wider, float), distance(start)


class SphereSpacing(NamedTuple):
    """Two spheres as measured."""

    spacing: float
    """Distance between their centres [mm]."""
    sigma: float
    spheres: tuple[SurfaceFit, SurfaceFit]
    """Spheres of free radii."""

    @classmethod
    def of(cls, points: Array, sigma: Array, window: float, diameter: float, spacing: float) -> SphereSpacing | None:
        """Spacing of a pair of spheres in front of whatever else was measured; None where they are not seen.

        The pair is looked for where most points lie on two spheres so far apart, from the points nearest to the camera.

        Parameters
        ----------
        points, sigma, window
            As of `SurfaceFit.plane`.
        diameter, spacing : float
            As calibrated [mm].
        """
        radius = diameter / 2
        smooth = max(float(np.median(sigma)), 1e-3 * radius)
        starts: list[Array] = []
        left = np.ones(len(points), bool)
        for _ in range(2):
            if left.sum() < 20:
                return None
            nearest = points[left][np.argsort(points[left][:, 2])[: max(5, int(0.02 * left.sum()))]]
            close = np.linalg.norm(nearest[:, None] - nearest, axis=-1) < 0.4 * radius
            centre = nearest[close[close.sum(axis=1).argmax()]].mean(axis=0) + np.array([0, 0, radius])
            fitted = np.zeros_like(left)
            for _ in range(6):
                near = left & (
                    np.abs(np.linalg.norm(points - centre, axis=1) - radius) < max(4 * smooth, 0.15 * radius)
                )
                near &= points[:, 2] < centre[2] - 0.3 * radius
                if near.sum() < 20:
                    return None
                if (near == fitted).all():
                    break
                fitted = near
                centre = SurfaceFit.sphere(points[near], sigma[near], window, centre, radius, free=False).parameters
            starts.append(centre)
            left &= np.hypot(*(points - centre)[:, :2].T) > 1.1 * radius
        fits, free = [], []
        for centre in starts:
            near = np.linalg.norm(points - centre, axis=1) < radius + max(5 * smooth, 0.1 * radius)
            near &= points[:, 2] < centre[2] - 0.3 * radius
            fits.append(SurfaceFit.sphere(points[near], sigma[near], window, centre, radius, free=False))
            free.append(SurfaceFit.sphere(points[near], sigma[near], window, centre, radius, free=True))
        between = fits[1].parameters - fits[0].parameters
        apart = float(np.linalg.norm(between))
        round_ = all(abs(float(fit.parameters[3]) / radius - 1) < ROUND for fit in free)
        if not (round_ and abs(apart / spacing - 1) < ROUND):
            return None
        way = between / apart
        variance = sum(float(way @ fit.covariance @ way) for fit in fits)
        return cls(apart, math.sqrt(variance), (free[0], free[1]))
