"""Rays as points and unit vectors, as oracles have them, sent through lenses by heights and slopes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Rays(NamedTuple):
    """Points and unit vectors, (3, ...)."""

    position: np.ndarray
    direction: np.ndarray

    @classmethod
    def between(cls, start, end):
        """From points to points."""
        along = np.subtract(end, start)
        return cls(np.broadcast_to(start, along.shape), along / np.sqrt(np.sum(along**2, axis=0)))


class Ended(NamedTuple):
    """Where rays cross a plane behind a lens; of those that were stopped only x and y of where mean anything."""

    position: np.ndarray
    direction: np.ndarray
    state: np.ndarray

    @property
    def kept(self):
        """Which came through."""
        return self.state == 0


def trace(lens, rays, wavelength, *, plane=None, backward=False, clip=True):
    """Through a lens to a plane; by default that through the vertex of its last surface on the way."""
    plane = (0.0 if backward else lens.length) if plane is None else plane
    (x, y, z), direction = rays.position, rays.direction
    out = lens.through(
        (x, y), direction[:2] / direction[2], wavelength, start=z, end=plane, backward=backward, clip=clip
    )
    unit = (-1 if backward else 1) / np.sqrt(1 + np.sum(out.slope**2, axis=0))
    position = np.concatenate([out.height, np.full((1, *out.state.shape), plane)])
    return Ended(position, np.concatenate([out.slope * unit, unit[None]]), out.state)
