"""What an optimiser may change: places of the design, or lengths derived from several of them, scaled to 0 to 1."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..design import PATHS
from ..design.check import CONJUGATES

Array = NDArray[np.float64]

DERIVED = {
    "working_distance": "from the bore's tip (the farthest of FAP and stops) to the focal plane; sets d_f",
    "tube_length": "from the FAP, the tube's inner rim, to its outer rim, the design's last stop; moves that stop",
    "tube_diameter": "of the FAP and every further stop together",
}
"""Lengths that set several places."""

LOG_ABOVE = 4.0
"""Ratio of bounds from which a variable is scaled by its logarithm."""


@dataclass(frozen=True)
class Variable:
    """A length that may change within bounds."""

    name: str
    """As written in the study: a symbol of the paper, a dotted place, or one of `DERIVED`."""
    low: float
    """[mm]."""
    high: float
    start: float | None = None
    """Where one search starts; None leaves it to the Sobol points."""

    @property
    def place(self) -> str:
        """Dotted place in the design, or the derived name."""
        return PATHS.get(self.name, self.name)

    @property
    def logarithmic(self) -> bool:
        """Whether it is scaled by its logarithm."""
        return self.low > 0 and self.high / self.low >= LOG_ABOVE

    def value(self, unit: Array) -> Array:
        """[mm] from the scaled value, 0 at the lower and 1 at the upper bound; exact at both."""
        if self.logarithmic:
            inside = self.low * np.exp(unit * math.log(self.high / self.low))
        else:
            inside = self.low + unit * (self.high - self.low)
        return np.where(unit == 1, self.high, inside)

    def unit(self, value: float) -> float:
        """Scaled value, clipped to the bounds."""
        if self.high == self.low:
            return 0.0
        value = min(max(value, self.low), self.high)
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def rate(self, unit: float) -> float:
        """Millimetres per scaled unit, there."""
        if self.logarithmic:
            return float(self.value(np.asarray(unit))) * math.log(self.high / self.low)
        return self.high - self.low


def known_variables(places: Mapping[str, float]) -> tuple[str, ...]:
    """Every name that a study may vary, for a design with these places (see `cameras.places_of`)."""
    lengths = [place for place in places if "." in place and "decentre" not in place and "relay" not in place]
    short = [symbol for symbol, place in PATHS.items() if place in lengths]
    derived = [name for name in DERIVED if name != "tube_length" or "stops.0.distance" in places]
    return (*short, *(place for place in lengths if place not in PATHS.values()), *derived, *PATHS.values())


def check_name(name: str, places: Mapping[str, float]) -> None:
    """Refuse a name that is no variable.

    Raises
    ------
    ValueError
        Names the nearest.
    """
    known = known_variables(places)
    if name in known:
        return
    if name == "tube_length":
        raise ValueError("'tube_length' needs a design with a further stop, the tube's outer rim; add [[stops]] to it")
    lowered = {each.lower(): each for each in known}
    near = difflib.get_close_matches(name.lower(), lowered, 1, 0.4)
    remedy = f"did you mean '{lowered[near[0]]}'?" if near else f"known are {', '.join(known)}"
    raise ValueError(f"'{name}' is nothing that can vary; {remedy}")


def check_together(names: Sequence[str]) -> None:
    """Refuse variables that set the same place twice.

    Raises
    ------
    ValueError
        Says which.
    """
    places = [PATHS.get(name, name) for name in names]
    for place in places:
        if places.count(place) > 1:
            raise ValueError(f"'{place}' varies twice; name it once")
    if all(place in places for place in CONJUGATES):
        raise ValueError("f, d_f and d_1 cannot all vary: two of them give the third; drop one")
    if "working_distance" in places and CONJUGATES[1] in places:
        raise ValueError("'working_distance' sets d_f, which varies too; drop one of them")
    if "working_distance" in places and CONJUGATES[0] in places and CONJUGATES[2] in places:
        raise ValueError("'working_distance', f and d_1 cannot all vary: two of them give the third; drop one")
    if "tube_diameter" in places and any(
        p == "aperture.diameter" or (p.startswith("stops.") and "diameter" in p) for p in places
    ):
        raise ValueError("'tube_diameter' sets the FAP's and every stop's diameter, one of which varies too; drop one")


def spread(values: Mapping[str, Array], places: Mapping[str, float]) -> dict[str, Array]:
    """Numbers at places, with derived lengths turned into those that they set."""
    found = {name: value for name, value in values.items() if name not in DERIVED}
    stops = sorted({place.split(".")[1] for place in places if place.startswith("stops.")}, key=int)
    if "tube_diameter" in values:
        found |= {f"{part}.diameter": values["tube_diameter"] for part in ("aperture", *(f"stops.{k}" for k in stops))}
    d_3 = found.get("aperture.distance", np.asarray(places["aperture.distance"]))
    if "tube_length" in values:
        found[f"stops.{stops[-1]}.distance"] = d_3 + values["tube_length"]
    if "working_distance" in values:
        tip = np.maximum(d_3, places.get("tip", 0.0))
        for k in stops:
            tip = np.maximum(tip, found.get(f"stops.{k}.distance", places[f"stops.{k}.distance"]))
        found[CONJUGATES[1]] = tip + values["working_distance"]
    return found
