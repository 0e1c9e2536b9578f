"""Tube of a scope: the parts in it and how wide it is."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from .._arrays import Array
from ..bore.opening import ClearAperture
from ..bore.part import Number
from ..camera import Camera
from ..design import PATHS
from ..lenses.prescription import Prescription
from ..words import number

WALL, GUIDE, LENGTH, OUTER = "tube.wall", "tube.light_guide", "tube.length", "tube.outer_diameter"
PACKAGE = "sensor.package"


class _Housed(NamedTuple):
    """A part of known width."""

    name: str
    """Name in ray budgets; of an element's two faces both."""
    width: Number
    """Diameter, of a real lens that of its widest surface, or diagonal, and twice how far it is decentred [mm]."""
    place: Number
    """Its end towards the scene [mm before the main lens, below 0 behind it]."""
    clear: Number
    """Width of its clear aperture [mm]."""

    def inside(self, c: Camera) -> Array:
        """Whether it lies in the tube: no farther behind the tip than that is long."""
        numbers = c.numbers
        return np.asarray(self.place >= c.tip - numbers[LENGTH] if LENGTH in numbers else np.True_)


def housed(c: Camera) -> tuple[_Housed, ...]:
    """FAP, stops, elements, main lens, array and sensor.

    Without elements of no known diameter, and without the sensor where a relay stands between, which may be anywhere.
    """
    numbers = c.numbers

    def part(name: str, key: str, width: Number, place: Number, glass: float = 0.0) -> _Housed:
        aside = 2 * np.hypot(numbers[f"{key}.decentre.0"], numbers[f"{key}.decentre.1"])
        return _Housed(name, np.maximum(width, glass) + aside, place, width + aside)

    def diagonal(key: str) -> Number:
        size: Number = np.hypot(numbers[f"{key}.0"], numbers[f"{key}.1"])
        return size

    parts = [
        part(rim.name, rim.part, 2 * ClearAperture.of(numbers, rim.part).reach, rim.ruler_distance)
        for rim in c.stop_openings
    ]
    for at in c.in_bore:
        glass = _widest(at.element.prescribed)
        if glass or f"{at.at.place}.diameter" in numbers:
            parts.append(part(at.name, at.at.place, at.at.get("diameter", glass), at.end, glass))
    array, d_2 = -numbers[PATHS["d_1"]] - c.lens.gap, numbers[PATHS["d_2"]]
    parts.append(part("main lens", "main_lens", numbers[PATHS["D"]], 0.0, _widest(c.lens.prescribed)))
    parts.append(part("microlens array", "microlens_array", diagonal("microlens_array.size"), array))
    if _holds_sensor(c):
        parts.append(part("sensor", "sensor", diagonal(PACKAGE if _packaged(c) else "sensor.size"), array - d_2))
    return tuple(parts)


def _widest(lenses: Iterable[Prescription]) -> float:
    """Diameter of the widest surface of real lenses [mm], which a stop at them makes no narrower; 0 of none."""
    return 2 * max((surface.semi_diameter for lens in lenses for surface in lens.surfaces), default=0.0)


def _holds_sensor(c: Camera) -> bool:
    """Whether the sensor stands behind the array, and no relay between them."""
    return bool(np.all(np.equal(c.numbers["sensor.relay_magnification"], 1)))


def _packaged(c: Camera) -> bool:
    """Whether the sensor's package is known."""
    return f"{PACKAGE}.0" in c.numbers


def shell(c: Camera) -> Number:
    """Thickness of wall and light guide about the parts [mm]; 0 where no design states a tube."""
    return c.numbers.get(WALL, 0.0) + c.numbers.get(GUIDE, 0.0)


def uncounted(c: Camera) -> str:
    """Things that stand in a scope's tube and that its width does not count, in words; empty where it counts all."""
    package = _holds_sensor(c) and not _packaged(c)
    left = {"wall": OUTER not in c.numbers, "sensor package": package, "light guide": GUIDE not in c.numbers}
    names = [name for name, out in left.items() if out]
    return f"without {' or '.join(filter(None, (', '.join(names[:-1]), names[-1])))}" if names else ""


def room(c: Camera) -> Array:
    """Width that the tube leaves its parts [mm]; infinite where no design states one."""
    return np.asarray(c.numbers[OUTER] - 2 * shell(c) if OUTER in c.numbers else np.inf)


def widest_fap(c: Camera) -> Array:
    """Diameter up to which a FAP fits the tube, and the main lens lets all of its light through [mm]."""
    return np.minimum(room(c), c.D)


def walls(c: Camera) -> tuple[str, str]:
    """Tube that the outer diameter is of: the design's, or the narrowest one; walls that it counts and does not count.

    Both in words.
    """
    if OUTER not in c.numbers:
        return "narrowest tube about the optics,", uncounted(c)
    outer, wall, narrowest = float(c[OUTER]), float(shell(c)), float(np.max(_about(c)))
    walls = "walls with light guide" if GUIDE in c.numbers else "walls"
    parts = f"parts of {number(narrowest - 2 * wall, 4)} mm and {walls} of {number(wall, 4)} mm"
    counted = f"as stated: {parts}, clearance {number(outer - narrowest, 3, 1e-9)} mm"
    if outer < narrowest * (1 - 1e-9):
        counted = f"with its wall: {parts}; {number(outer, 4)} mm as stated is too narrow"
    return "tube", "; ".join(filter(None, (counted, uncounted(c))))


def outer_diameters(c: Camera) -> Array:
    """Outer diameter of a tube about each of `housed`, last of the tube that is stated, if one is [mm]: (K, ...)."""
    about = _about(c)
    return np.stack(np.broadcast_arrays(*about, *([c.numbers[OUTER]] if OUTER in c.numbers else [])))


def _about(c: Camera) -> Array:
    """Outer diameter of a tube about each of `housed` [mm], shape (K, ...); for what lies behind it, about the FAP."""
    parts = housed(c)
    fap = parts[0].width
    widths = [np.where(part.inside(c), part.width, fap) + 2 * shell(c) for part in parts]
    return np.stack(np.broadcast_arrays(*widths))
