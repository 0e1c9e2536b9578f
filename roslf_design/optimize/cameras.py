"""Many cameras at once: the numbers of a base design with arrays in place of some, without making each a `Design`.

An optimiser asks for thousands of cameras that need not exist (d_3 beyond d_f, a lens shorter than its conjugates), so
nothing is refused here: the quantities go on with their sign, and the problem's own constraints keep such cameras out.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design import PATHS, Design
from ..design.check import CONJUGATES
from ..theory.aperture import effective_image_distance
from ..theory.conjugates import focal_length, focal_plane_distance, inverse_magnification, mla_distance
from ..theory.pupils import exit_pupil_vergence

Array = NDArray[np.float64]

FOCAL, PLANE, DISTANCE = CONJUGATES

TIP = "tip"
"""Beside the places: where a bore ends that the design's own stops do not show [mm]."""


def places_of(design: Design) -> dict[str, float]:
    """Every place of a design that a quantity depends on, with its number [mm; magnification without unit]."""
    resolved = {FOCAL: design.f, PLANE: design.d_f, DISTANCE: design.d_1}
    found = {place: resolved.get(place, 0.0) or _read(design, place) for place in PATHS.values()}
    for index in range(len(design.stops)):
        found |= {f"stops.{index}.{name}": _read(design, f"stops.{index}.{name}") for name in ("diameter", "distance")}
    for part in ("main_lens", "aperture", *(f"stops.{index}" for index in range(len(design.stops)))):
        found |= {f"{part}.decentre.{axis}": _read(design, f"{part}.decentre.{axis}") for axis in (0, 1)}
    for part in ("sensor", "microlens_array"):
        found |= {f"{part}.size.{axis}": _read(design, f"{part}.size.{axis}") for axis in (0, 1)}
    return found | {"sensor.relay_magnification": design.sensor.relay_magnification}


def _read(design: Design, place: str) -> float:
    value: object = design
    for step in place.split("."):
        value = value[int(step)] if isinstance(value, tuple) else getattr(value, step)
    assert isinstance(value, (int, float))
    return float(value)


class Cameras:
    """Cameras that share a base design.

    Parameters
    ----------
    places : mapping
        What `places_of` gives for the base design.
    values : mapping
        Place to numbers, arrays that broadcast together. Of f, d_f and d_1 the same one follows as in
        `Design.replace`: d_f unless d_f itself varies.
    in_focus : bool
        Whether the microlenses' focal length follows the focus, ``1/f_ml = 1/d_2 + 1/L``.
    """

    def __init__(self, places: Mapping[str, float], values: Mapping[str, ArrayLike], *, in_focus: bool = False) -> None:
        self._numbers: dict[str, ArrayLike] = {**places, **values}
        self._varied = frozenset(values)
        self._in_focus = in_focus
        self.stops = sum(place.startswith("stops.") and place.endswith(".distance") for place in places)

    def at(self, place: str) -> Array:
        """The numbers at a place."""
        symbol = _RESOLVED.get(place)
        found: Array = np.asarray(self._numbers[place] if symbol is None else getattr(self, symbol), np.float64)
        return found

    @cached_property
    def _conjugates(self) -> tuple[Array, Array, Array]:
        f, d_f, d_1 = (np.asarray(self._numbers[place], np.float64) for place in CONJUGATES)
        if PLANE in self._varied:
            if DISTANCE in self._varied:
                return focal_length(d_f, d_1), d_f, d_1
            return f, d_f, mla_distance(f, d_f)
        return f, focal_plane_distance(f, d_1), d_1

    @property
    def f(self) -> Array:
        """F [mm]."""
        return self._conjugates[0]

    @property
    def d_f(self) -> Array:
        """d_f [mm]."""
        return self._conjugates[1]

    @property
    def d_1(self) -> Array:
        """d_1 [mm]."""
        return self._conjugates[2]

    @cached_property
    def f_ml(self) -> Array:
        """f_ml [mm]."""
        if not self._in_focus:
            return np.asarray(self._numbers[PATHS["f_ml"]], np.float64)
        return self.d_2 / (1 + self.d_2 * self.vergence)

    @property
    def D(self) -> Array:
        """D [mm]."""
        return self.at(PATHS["D"])

    @property
    def D_F(self) -> Array:
        """D_F [mm]."""
        return self.at(PATHS["D_F"])

    @property
    def d_3(self) -> Array:
        """d_3 [mm]."""
        return self.at(PATHS["d_3"])

    @property
    def d(self) -> Array:
        """D [mm]."""
        return self.at(PATHS["d"])

    @property
    def d_2(self) -> Array:
        """d_2 [mm]."""
        return self.at(PATHS["d_2"])

    @cached_property
    def q(self) -> Array:
        """Pixel pitch q as seen at the MLA's image plane [mm]."""
        return self.at(PATHS["q"]) / self.at("sensor.relay_magnification")

    @property
    def wavelength(self) -> Array:
        """Lambda [mm]."""
        return self.at(PATHS["wavelength"])

    @property
    def optics(self) -> tuple[Array, Array, Array]:
        """f, d_f and d_3, as most closed forms take them."""
        return self.f, self.d_f, self.d_3

    @cached_property
    def reach(self) -> Array:
        """A = d_1/H [mm]."""
        return effective_image_distance(*self.optics)

    @cached_property
    def vergence(self) -> Array:
        """1/L [1/mm]."""
        return exit_pupil_vergence(*self.optics)

    @cached_property
    def object_scale(self) -> Array:
        """d_f/d_1: object-side millimetres per millimetre on the array."""
        return inverse_magnification(self.f, self.d_f)

    @cached_property
    def half_sizes(self) -> tuple[Array, Array]:
        """Half width and half height of the array that the sensor sees [mm]."""
        relay = self.at("sensor.relay_magnification")
        x, y = (
            np.minimum(self.at(f"microlens_array.size.{axis}"), self.at(f"sensor.size.{axis}") / relay) / 2
            for axis in (0, 1)
        )
        return x, y

    @cached_property
    def half_diagonal(self) -> Array:
        """From the axis to the corner of what the sensor sees, on the array [mm]."""
        return np.hypot(*self.half_sizes)

    @cached_property
    def tip(self) -> Array:
        """Distance of the bore's outer end from the main lens: the farthest of FAP, stops and `TIP` [mm]."""
        farthest = np.maximum(self.d_3, self._numbers.get(TIP, 0.0))
        for index in range(self.stops):
            farthest = np.maximum(farthest, self.at(f"stops.{index}.distance"))
        return farthest

    def depth(self, ahead: float | None) -> Array:
        """Z_F of a point `ahead` of the bore's tip [mm]; of the focal plane where none is given."""
        return self.d_f - self.d_3 if ahead is None else ahead + self.tip - self.d_3

    def rims(self) -> list[tuple[Array, Array, tuple[Array, Array]]]:
        """Diameter, distance and decentre against the main lens, of the main lens and then of each stop [mm]."""
        zero = np.zeros(())
        found = [(self.D, zero, (zero, zero))]
        for index in range(self.stops):
            part = f"stops.{index}"
            found.append((self.at(f"{part}.diameter"), self.at(f"{part}.distance"), self.decentre(part)))
        return found

    def decentre(self, part: str) -> tuple[Array, Array]:
        """Of a stop or the FAP, against the main lens [mm]."""
        x, y = (self.at(f"{part}.decentre.{axis}") - self.at(f"main_lens.decentre.{axis}") for axis in (0, 1))
        return x, y


_RESOLVED = {FOCAL: "f", PLANE: "d_f", DISTANCE: "d_1", PATHS["f_ml"]: "f_ml"}
