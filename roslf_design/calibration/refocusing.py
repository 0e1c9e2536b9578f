"""Refocus stacks of a light field: which slopes show something sharp, and how far away that is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .._arrays import by_value
from ..camera import Camera
from ..theory.light_field import depth_of_slope, epi_slope
from .decoding import LightField, Samples
from .frames import Array

PLANES = 7
"""Number of planes in a stack, by default."""
_FARTHEST, _STEP = 24.0, 1.5
"""Disparities across the views that are looked through [pitches], and from one to the next [pixels of the views, or
pitches where they are finer]."""
_VIEWS = 7
"""Views along an axis that this takes."""
_TILES = 12
"""Parts of the picture along an axis, each with a depth of its own."""
_STANDS_OUT, _FAINT = 0.5, 0.005
"""For a part of the picture to have a say: by how much its gradients are stronger where they are strongest than they
mostly are, and their least share of the values."""
_SHARE = 0.03
"""Share of the votes for sharp places that is left out at either end: strays."""


class Distances(Protocol):
    """Conversion between slopes and distances; distances count from the camera [mm]."""

    def distance(self, slope: float) -> float:
        """Distance of what has a slope; below 0 or not finite where no point is."""

    def slope(self, distance: float) -> float:
        """Du/Ds of a point at a distance."""


@by_value
@dataclass(frozen=True)
class CameraDistances:
    """Distances before the main lens, with a ruler, of the camera that a raw image is from."""

    camera: Camera

    def distance(self, slope: float) -> float:
        """Where a plane of that slope stands [mm]; nan where no point is or something of the bore stands there."""
        c = self.camera
        depth = float(depth_of_slope(c, slope))
        if not depth > 0:
            return math.nan
        place = float(np.asarray(c.plane_seen_at(float(c.seen.d_3) + depth)))
        return place if place > float(np.asarray(c.front[0])) else math.nan

    def slope(self, distance: float) -> float:
        """Microlens pitches a pixel; Eq. 12."""
        c = self.camera
        return float(epi_slope(c, c.plane(distance).distance - c.seen.d_3))


@dataclass(frozen=True, eq=False)
class FocusPlane:
    """A picture refocused to one plane."""

    slope: float
    """Du/Ds of what is sharp in it [pitches per px]."""
    disparity: float
    """-slope times the pitch: of what is sharp in it, between opposite edges of the views [pitches]."""
    distance: float | None
    """Distance from the camera [mm], where that is known."""
    values: Samples
    """Shape (v, u)."""
    weight: Samples
    """Sum of the views' weights, of the same shape."""

    def to_dict(self) -> dict[str, float | None]:
        """As results have it."""
        names = {"distance_mm": self.distance, "disparity_pitches": self.disparity}
        return names | {"slope_pitches_per_px": self.slope}


def focus_stack(
    field: LightField, disparities: Array | None = None, distances: Distances | None = None
) -> tuple[FocusPlane, ...]:
    """Refocus to several planes, near ones last.

    Parameters
    ----------
    disparities : ndarray, optional
        Across the views [pitches]; None for seven over all that is sharp somewhere.
    distances : Distances, optional
        Names the planes in mm; chosen ones that stand nowhere are then left out.
    """
    chosen = sharp_disparities(field) if disparities is None else disparities
    planes = []
    for disparity in chosen:
        slope = -float(disparity) / field.pitch
        away = None if distances is None else distances.distance(slope)
        if away is not None and not (0 < away < math.inf):
            if disparities is None:
                continue
            away = None
        planes.append(FocusPlane(slope, float(disparity), away, *field.refocused(slope)))
    return tuple(planes)


def sharp_disparities(field: LightField, views: int = _VIEWS) -> Array:
    """Disparities across the views [pitches], evenly over those at which some part of the picture is sharpest.

    Every part of the picture votes for where its gradients are strongest, by how much stronger they are there than
    they mostly are; a step is added on either side. Without any texture: about the focal plane. It takes so many
    `views` along an axis.
    """
    most = min(_FARTHEST, max(min(len(field.u), len(field.v)) / 4, _STEP))
    step = _STEP * max(1.0, float(field.u[-1] - field.u[0]) / max(len(field.u) - 1, 1))
    steps = math.ceil(most / step)
    tried = step * np.arange(-steps, steps + 1.0)
    every = math.ceil(max(len(field.s), len(field.t)) / views)
    sharpness = np.array([_sharpness(*field.refocused(-float(b) / field.pitch, every)) for b in tried])
    mostly = np.median(sharpness, axis=0)
    votes = sharpness.max(axis=0) - mostly
    power = _in_parts(np.square(field.view(), dtype=float) * (field.view_weight() > 0))
    votes[(votes < _STANDS_OUT * mostly) | (sharpness.max(axis=0) < _FAINT**2 * power)] = 0
    low, high = -2 * step, 2 * step
    if votes.sum() > 0:
        best = tried[sharpness.argmax(axis=0)]
        order = np.argsort(best, kind="stable")
        share = np.cumsum(votes[order]) / votes.sum()
        low, high = (float(best[order][np.searchsorted(share, at)]) for at in (_SHARE, 1 - _SHARE))
        low, high = low - _STEP, high + _STEP
    return np.linspace(low, high, PLANES)


def _sharpness(values: Samples, weight: Samples) -> Array:
    """Sum of squared gradients in each part of a picture, shape (parts,)."""
    held = weight > 0.25 * float(weight.max(initial=0.0))
    power = np.zeros(values.shape)
    across, down = (np.square(np.diff(values, axis=axis)) for axis in (1, 0))
    power[:, 1:] += across * (held[:, 1:] & held[:, :-1])
    power[1:] += down * (held[1:] & held[:-1])
    return _in_parts(power)


def _in_parts(power: Array) -> Array:
    """Sums over the parts of a picture."""
    for axis in (0, 1):
        tiles = min(_TILES, power.shape[axis])
        power = np.add.reduceat(power, np.arange(tiles) * power.shape[axis] // tiles, axis)
    return np.asarray(power.ravel())
