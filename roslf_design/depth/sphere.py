"""The sphere that measured depths fit best: its radius, and how surely they tell it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._arrays import Array
from .surface_fit import fitted

FEWEST = 4
"""Windows without common points that a sphere is fitted to, at least: it has as many unknowns."""
SURE = 3.0
"""Standard errors from none that a curvature has from which it is told."""
_FLATTEST = 1e-3
"""Square of the cosine at which a sphere's slope ends: one that turned away would have no Z."""


class SphereFit(NamedTuple):
    """Sphere that fits points best by Z; flat ones are none of it that differ."""

    middle: tuple[float, float]
    """x and y about which it is counted [mm]."""
    parameters: Array
    """Z there, its growth along x and y, and the curvature [1/mm]: positive of what bulges towards the camera."""
    curvature_sigma: float
    """Standard error of the curvature, by the points' errors; those within a window err alike [1/mm]."""
    rms: float
    """Rms of the points' distances from it along Z [mm]."""
    inside_68: float
    """Share within the standard errors reported with each: 0.68 of a sphere."""

    @classmethod
    def of(cls, points: Array, sigma: Array, window: float) -> SphereFit | None:
        """Sphere about points; None of a few.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            x, y and Z [mm].
        sigma : ndarray, shape (n,)
            Standard errors of Z, each point's own [mm].
        window : float
            Points that share a measurement, and err alike.
        """
        if len(points) < FEWEST * window:
            return None
        x, y, z = points.T
        mean_x, mean_y = float(x.mean()), float(y.mean())
        x, y = x - mean_x, y - mean_y
        reach = max(float(np.hypot(x, y).max()), 1e-30)

        def off(scaled: Array) -> Array:
            return np.asarray(z - _height(scaled / [1, reach, reach, reach**2], x, y))

        columns = np.stack([np.ones_like(x), x / reach, y / reach, (x**2 + y**2) / (2 * reach**2)], -1)
        start = np.linalg.lstsq(columns / sigma[:, None], z / sigma, rcond=None)[0]
        scaled, covariance, left = fitted(off, start, sigma, window)
        parameters = scaled / [1, reach, reach, reach**2]
        rms = float(np.sqrt(np.mean(left**2)))
        own = float(np.sqrt(covariance[3, 3])) / reach**2
        return cls((mean_x, mean_y), parameters, own, rms, float((np.abs(left) < sigma).mean()))

    @property
    def radius(self) -> float:
        """As a scene has it: negative of a hollow one [mm]."""
        return float(1 / self.parameters[3])

    @property
    def sigma(self) -> float:
        """Standard error of the radius, to first order [mm]."""
        return self.curvature_sigma * self.radius**2

    @property
    def told(self) -> bool:
        """True where the points tell it from a plane."""
        return abs(float(self.parameters[3])) > SURE * self.curvature_sigma

    @property
    def flattest(self) -> float:
        """Least radius, hollow or not, of those within two standard errors: of one that is not told [mm]."""
        return 1 / (abs(float(self.parameters[3])) + 2 * self.curvature_sigma)

    def to_dict(self, true: float | None = None) -> dict[str, float | bool | None]:
        """As in the JSON of `roslf depth`."""
        return {
            "radius_mm": self.radius,
            "sigma_mm": self.sigma,
            "true_radius_mm": true,
            "significant": self.told,
            "rms_mm": self.rms,
            "inside_68": self.inside_68,
        }

    def height(self, x: Array, y: Array) -> Array:
        """Z of the sphere at places [mm]."""
        return _height(self.parameters, x - self.middle[0], y - self.middle[1])


def _height(parameters: Array, x: Array, y: Array) -> Array:
    """Z of a sphere through (0, 0, z) with a slope and a curvature there, or of a plane where that is none.

    Points q from there lie on it where ``k q^2/2 = n q``, n the unit normal.
    """
    z, along, down, curvature = parameters
    upright = 1 / np.sqrt(1 + along**2 + down**2)
    flat = (along * x + down * y) * upright + curvature * (x**2 + y**2) / 2
    root = np.sqrt(np.maximum(upright**2 - 2 * curvature * flat, _FLATTEST))
    return np.asarray(z + 2 * flat / (upright + root))
