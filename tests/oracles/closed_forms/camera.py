"""The camera that the oracles trace: four planes, straight rays, a thin lens, pinhole microlenses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath as mp


def affine_root(function: Callable[[mp.mpf], mp.mpf], target: Any = 0, tries: tuple[Any, Any] = (1, 2)) -> mp.mpf:
    """Where an affine function takes a value; inf where it never does."""
    a, b = (mp.mpf(t) for t in tries)
    at_a, at_b = function(a), function(b)
    if at_a == at_b:
        return mp.inf
    return a + (target - at_a) * (b - a) / (at_b - at_a)


class Camera(NamedTuple):
    """Lens at z = 0, array at d_1; tilts and heights paraxial."""

    f: mp.mpf
    d_1: mp.mpf

    @classmethod
    def focused_at(cls, f: mp.mpf, d_f: mp.mpf) -> Camera:
        """Array where a ray from the focal plane's axis point comes back to the axis."""
        height, slope = d_f, 1 - d_f / f
        return cls(f, -height / slope)

    def height(self, sensor: Any, microlens: Any, d_2: Any, z: Any) -> mp.mpf:
        """Height at z before the lens of the ray from a sensor point back through a microlens's centre."""
        slope = (sensor - microlens) / d_2
        lens = microlens - slope * self.d_1
        return lens - (slope + lens / self.f) * z

    def landing(self, microlens: Any, d_2: Any, z: Any, height: Any) -> mp.mpf:
        """Sensor point that sees `height` at z through that microlens."""
        return affine_root(lambda p: self.height(p, microlens, d_2, z), height)

    def pitch(self, d: Any, d_2: Any, d_3: Any) -> mp.mpf:
        return self.landing(d, d_2, d_3, 0) - self.landing(0, d_2, d_3, 0)

    def diameter(self, D_F: Any, d_2: Any, d_3: Any) -> mp.mpf:
        return self.landing(0, d_2, d_3, -D_F / 2) - self.landing(0, d_2, d_3, D_F / 2)

    def reach(self, d_3: Any) -> mp.mpf:
        """A: height on the FAP over the slope with which that ray comes to the array's centre."""
        return self.height(-1, 0, 1, d_3)

    def seen(self, X: Any, Z_F: Any, d_3: Any, pupil: Any) -> tuple[mp.mpf, mp.mpf]:
        """Where on the array, and how steeply, arrives the ray from a scene point through a pupil point."""
        tilt = (pupil - X) / Z_F
        lens = pupil + tilt * d_3
        slope = tilt - lens / self.f
        return lens + slope * self.d_1, slope
