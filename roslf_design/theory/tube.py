"""Tube of a scope: the parts in it and how wide it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._arrays import Array
from ..bore.opening import ClearAperture
from ..bore.part import Number
from ..camera import Camera
from ..design import PATHS
from ..words import number

BARE = "without its wall"
"""Words on a tube that no design states."""
WALL, LENGTH, OUTER = "tube.wall", "tube.length", "tube.outer_diameter"


class _Housed(NamedTuple):
    """A part of known width."""

    name: str
    """Name in ray budgets; of an element's two faces both."""
    width: Number
    """Diameter or diagonal, and twice how far it is decentred [mm]."""
    place: Number
    """Its end towards the scene [mm before the main lens, below 0 behind it]."""

    def inside(self, c: Camera) -> Array:
        """Whether it lies in the tube: no farther behind the tip than that is long."""
        numbers = c.numbers
        return np.asarray(self.place >= c.tip - numbers[LENGTH] if LENGTH in numbers else np.True_)


def housed(c: Camera) -> tuple[_Housed, ...]:
    """FAP, stops, elements, main lens, array and sensor.

    Without elements of no given diameter, and without the sensor where a relay stands between, which may be anywhere.
    """
    numbers = c.numbers

    def part(name: str, key: str, width: Number, place: Number) -> _Housed:
        return _Housed(name, width + 2 * np.hypot(numbers[f"{key}.decentre.0"], numbers[f"{key}.decentre.1"]), place)

    def diagonal(key: str) -> Number:
        size: Number = np.hypot(numbers[f"{key}.size.0"], numbers[f"{key}.size.1"])
        return size

    parts = [
        part(rim.name, rim.part, 2 * ClearAperture.of(numbers, rim.part).reach, rim.ruler_distance)
        for rim in c.stop_openings
    ]
    wide = (at for at in c.in_bore if f"{at.at.place}.diameter" in numbers)
    parts += [part(at.name, at.at.place, at.diameter, at.end) for at in wide]
    array, d_2 = -numbers[PATHS["d_1"]] - c.lens.gap, numbers[PATHS["d_2"]]
    parts.append(part("main lens", "main_lens", numbers[PATHS["D"]], 0.0))
    parts.append(part("microlens array", "microlens_array", diagonal("microlens_array"), array))
    if np.all(np.equal(numbers["sensor.relay_magnification"], 1)):
        parts.append(part("sensor", "sensor", diagonal("sensor"), array - d_2))
    return tuple(parts)


def room(c: Camera) -> Array:
    """Width that the tube leaves its parts [mm]; infinite where no design states one."""
    return np.asarray(c.numbers[OUTER] - 2 * c.numbers[WALL] if OUTER in c.numbers else np.inf)


def widest_fap(c: Camera) -> Array:
    """Diameter up to which a FAP fits the tube, and the main lens lets all of its light through [mm]."""
    return np.minimum(room(c), c.D)


def walls(c: Camera) -> str:
    """Walls that the outer diameter counts, in words, and the tube as the design states it."""
    if OUTER not in c.numbers:
        return BARE
    outer, wall, narrowest = float(c[OUTER]), float(c[WALL]), float(np.max(_about(c)))
    parts = f"parts of {number(narrowest - 2 * wall, 4)} mm and walls of {number(wall, 4)} mm"
    if outer < narrowest * (1 - 1e-9):
        return f"with its wall: {parts}; {number(outer, 4)} mm as stated is too narrow"
    return f"as stated: {parts}, clearance {number(outer - narrowest, 3, 1e-9)} mm"


def outer_diameters(c: Camera) -> Array:
    """Outer diameter of a tube about each of `housed`, last of the tube that is stated, if one is [mm]: (K, ...)."""
    about = _about(c)
    return np.stack(np.broadcast_arrays(*about, *([c.numbers[OUTER]] if OUTER in c.numbers else [])))


def _about(c: Camera) -> Array:
    """Outer diameter of a tube about each of `housed` [mm], shape (K, ...); for what lies behind it, about the FAP."""
    parts, wall = housed(c), c.numbers.get(WALL, 0.0)
    fap = parts[0].width
    widths = [np.where(part.inside(c), part.width, fap) + 2 * wall for part in parts]
    return np.stack(np.broadcast_arrays(*widths))
