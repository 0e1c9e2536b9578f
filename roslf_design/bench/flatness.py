"""Flatness, probing and sphere-spacing errors of measured points, in the terms of VDI/VDE 2634-2."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from .._arrays import Array
from ..depth.surface_fit import fitted

ROUND = 0.4
"""Share by which spheres' sizes and spacing may be off what is calibrated: beyond, they are something else."""
CAP = 0.75
"""Radius of the cap of a sphere that windows read well, over the sphere's: beyond, they meet what stands behind it."""
_STEEPEST = 1e-3
"""Square of the cosine at which a sphere's slope ends: one that turned away would have no Z."""
_FEWEST = 20
"""Points that a sphere, or a cap of one, is fitted to."""
_LEAST_CAP = 30
"""Windows in a cap that tells its curvature: depth takes up to three windows' width for a microlens, so that few err
alike (caps of some 15 windows told diameters that were twice their U off)."""
REJECTED = 0.003
"""Share of the points that may be left out as strays before ranges are taken."""


class SurfaceFit(NamedTuple):
    """Measured points about the surface that fits them best."""

    parameters: Array
    """Plane: Z at x = y = 0, and its growth along x and y. Sphere: its centre. Cap: its foremost point, and by how much
    it is more curved than calibrated."""
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
        parameters, covariance, off = fitted(distance, start, sigma, window, REJECTED)
        return cls(parameters, covariance, *_range(off, max(1.0, z.size / window)))

    @classmethod
    def sphere(cls, points: Array, sigma: Array, window: float, centre: Array, radius: float) -> SurfaceFit:
        """Sphere of a radius that fits points best, from a centre to begin with.

        Errors of Z count along the sphere's normal. Other arguments as of `plane`.
        """

        def distance(at: Array) -> Array:
            return np.asarray(np.linalg.norm(points - at, axis=1) - radius)

        start, own = np.asarray(centre, float), sigma
        for _ in range(2):
            parameters, covariance, off = fitted(distance, start, own, window, REJECTED)
            away = points - parameters
            steep = np.abs(away[:, 2]) / np.maximum(np.linalg.norm(away, axis=1), 1e-30)
            own, start = sigma * np.maximum(steep, 0.2), parameters
        return cls(parameters, covariance, *_range(off, max(1.0, len(points) / window)))

    @classmethod
    def cap(cls, points: Array, sigma: Array, window: float, front: Array, radius: float) -> SurfaceFit:
        """Cap of a sphere that fits points best by Z, from its foremost point to begin with.

        Its curvature differs from that of a radius to first order. Distances from it are along Z: noise in Z that is
        taken along the normals of a small cap would look like curvature. Other arguments as of `plane`.
        """
        x, y, z = points.T

        def distance(at: Array) -> Array:
            square = (x - at[0]) ** 2 + (y - at[1]) ** 2
            steep = np.sqrt(np.maximum(1 - square / radius**2, _STEEPEST))
            return np.asarray(z - at[2] - square / (1 + steep) * (1 / radius + at[3] / steep))

        parameters, covariance, off = fitted(distance, np.append(front, 0.0), sigma, window, REJECTED)
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


class SphereSpacing(NamedTuple):
    """Two spheres as measured."""

    spacing: float
    """Distance between their centres [mm]."""
    sigma: float
    caps: tuple[SurfaceFit, ...]
    """Caps of free curvature, where windows lie on the spheres; none where they are too few."""
    size: float | None = None
    """Error of the diameter, the mean of both caps' by their errors, to first order in curvature [mm]; None where they
    do not tell it."""
    size_sigma: float = math.inf

    @classmethod
    def of(
        cls, points: Array, sigma: Array, window: float, diameter: float, spacing: float, reach: float
    ) -> SphereSpacing | None:
        """Spacing of a pair of spheres in front of whatever else was measured; None where they are not seen.

        The pair is looked for where most points lie on two spheres so far apart, from the points nearest to the camera.

        Parameters
        ----------
        points, sigma, window
            As of `SurfaceFit.plane`.
        diameter, spacing : float
            As calibrated [mm].
        reach : float
            Half the width of a window on the spheres [mm].
        """
        radius = diameter / 2
        smooth = max(float(np.median(sigma)), 1e-3 * radius)
        starts: list[Array] = []
        left = np.ones(len(points), bool)
        for _ in range(2):
            if left.sum() < _FEWEST:
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
                if near.sum() < _FEWEST:
                    return None
                if (near == fitted).all():
                    break
                fitted = near
                centre = SurfaceFit.sphere(points[near], sigma[near], window, centre, radius).parameters
            starts.append(centre)
            left &= np.hypot(*(points - centre)[:, :2].T) > 1.1 * radius
        fits, caps, fewest = [], [], math.inf
        for centre in starts:
            near = np.linalg.norm(points - centre, axis=1) < radius + max(5 * smooth, 0.1 * radius)
            near &= points[:, 2] < centre[2] - 0.3 * radius
            fits.append(SurfaceFit.sphere(points[near], sigma[near], window, centre, radius))
            front = fits[-1].parameters - np.array([0, 0, radius])
            near = np.hypot(*(points - front)[:, :2].T) < CAP * radius - reach
            near &= np.abs(points[:, 2] - front[2]) < radius
            if near.sum() >= max(_FEWEST, window):
                fewest = min(fewest, near.sum() / window)
                caps.append(SurfaceFit.cap(points[near], sigma[near], window, front, radius))
        between = fits[1].parameters - fits[0].parameters
        apart = float(np.linalg.norm(between))
        if not abs(apart / spacing - 1) < ROUND:
            return None
        way = between / apart
        own = math.sqrt(sum(float(way @ fit.covariance @ way) for fit in fits))
        if len(caps) < 2:
            return cls(apart, own, ())
        known = np.array([1 / cap.covariance[3, 3] for cap in caps]) / radius**2
        size = -diameter * float(known @ [radius * cap.parameters[3] for cap in caps] / known.sum())
        size_sigma = diameter / math.sqrt(known.sum())
        if fewest < _LEAST_CAP or 2 * size_sigma > ROUND * diameter:
            return cls(apart, own, tuple(caps), None, size_sigma)
        return cls(apart, own, tuple(caps), size, size_sigma) if abs(size) < ROUND * diameter else None
