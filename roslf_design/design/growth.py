"""Growth of a camera with temperature: what that does to lengths, curvatures and indices.

One rule (`Growth.moved`) takes a camera's numbers from one temperature to another, one camera or arrays of builds.
Glass grows as glass, all between parts as the housing, wherever light meets both.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from ..bore.chain import Chain
from ..bore.lens import power_ratio
from ..bore.main_lens import HIATUS, MainLensKind
from ..bore.part import Number
from ..errors import Problem
from ..lenses.glass import Glass, growth
from .assembly import Assembly
from .parts import PATHS

BODY = "the housing", "the main lens", "the microlenses"
"""Parts of which one at least must be of a known material for depth to be told over temperature."""
STOP_PLACE = re.compile(r"(aperture|stops\.\d+)\.distance")
"""Places of where openings stand."""
NAMED_AT = dict(
    zip(BODY, ("housing in [environment]", "material in [main_lens]", "material in [microlens_array]"), strict=True)
)
"""Key that names the material of each."""


def about_environment(design: Assembly) -> tuple[Problem, ...]:
    """Temperatures that what is known of a material does not reach."""
    environment, problems = design.environment, []
    if environment is None:
        return ()
    asked = {"temperature": environment.temperature}
    asked |= dict(zip(("range.1", "range.2"), environment.range or (), strict=False))
    if environment.calibrated_at is not None:
        asked["calibrated_at"] = environment.calibrated_at
    for place, glass in design.glasses:
        for key, degrees in asked.items():
            if glass.warming.coldest <= degrees <= glass.warming.hottest:
                continue
            known = f"{glass.warming.coldest:g} to {glass.warming.hottest:g} degC"
            message = f"{degrees:g} degC is outside what is known of {glass.name} ({place}): {known}; stay inside"
            problems.append(Problem(f"environment.{key}", message))
    return tuple(dict.fromkeys(problems))


def not_known(design: Assembly) -> tuple[str, ...]:
    """Names of a design's materials whose index is taken not to change with temperature."""
    glasses = (glass for _, glass in design.glasses if glass.name != "air")
    return tuple(dict.fromkeys(glass.name for glass in glasses if glass.warming.law == "none"))


def not_named(design: Assembly) -> tuple[str, ...]:
    """Names of the parts that stay as they are at any temperature, because no material is given for them."""
    environment = design.environment
    housing = environment is None or environment.housing is None
    silent = dict(zip(BODY, (housing, not design.main_lens.grows, not design.microlens_array.grows), strict=True))
    silent |= {at.name: not at.part.grows for at in design.in_bore}
    return tuple(name for name, is_silent in silent.items() if is_silent)


@dataclass(frozen=True)
class Growth:
    """Materials of a camera's parts, by which it grows with temperature."""

    housing: float
    """Expansion of the housing [1/K]."""
    sensor: float
    """Expansion of what pixels are made on [1/K]."""
    lens: MainLensKind
    """Main lens."""
    array: Glass | None
    """Material of the microlenses; None where not given."""
    chain: Chain
    """Elements, and plates about the array."""
    glasses: tuple[tuple[str, Glass], ...]
    """Glass of each index, by the index's place."""
    silent: tuple[str, ...] = ()
    """Parts that stay as they are, because nothing says what they are made of."""
    tube: float | None = None
    """Expansion of the tube [1/K]; None where it is the housing's."""

    def known(self, degrees: Number) -> Iterator[tuple[str, NDArray[np.bool_]]]:
        """Materials whose index is known at some temperatures alone [degrees C], with these, and where it is known."""
        for glass in dict.fromkeys(glass for _, glass in self.glasses):
            low, high = glass.warming.coldest, glass.warming.hottest
            if math.isfinite(low) or math.isfinite(high):
                within = np.greater_equal(degrees, low) & np.less_equal(degrees, high)
                yield f"{glass.name} ({low:g} to {high:g} degC)", np.asarray(within)

    @property
    def unknown(self) -> bool:
        """Whether nothing but pixels grows, by what is known."""
        return {*BODY} <= {*self.silent}

    @classmethod
    def of(cls, design: Assembly) -> Growth | None:
        """Growth of a design; None of one without `[environment]`."""
        environment = design.environment
        if environment is None:
            return None
        return cls(
            environment.expansion,
            environment.sensor.expansion,
            design.main_lens.kind,
            design.microlens_array.made_of,
            design.chain,
            tuple(design.materials.items()),
            not_named(design),
            None if design.tube is None or design.tube.material is None else design.tube.material.expansion,
        )

    def moved(
        self, numbers: Mapping[str, Number], before: Number, after: Number, *, lens_stays: bool = False
    ) -> dict[str, Number]:
        """The numbers that change between two temperatures.

        Parameters
        ----------
        numbers : mapping
            Dotted place to number(s), at the first temperature.
        before, after : float or ndarray
            [degrees C].
        lens_stays : bool
            Whether distances go on counting from the principal planes that a real lens had before.
        """
        wavelength, housing = numbers[PATHS["wavelength"]], growth(self.housing, before, after)
        front, rear = self.lens.principal_shifts(wavelength, before, after, self.housing)
        wall = housing if self.tube is None else growth(self.tube, before, after)
        spans = list(self._spans(numbers, before, after, housing, wall))

        def stretched(z: Number) -> Number:
            """Distance from the lens's first vertex, from that."""
            longer: list[Number] = [more * np.clip(z + front[0] - start, 0.0, length) for start, length, more in spans]
            return housing * z + sum(longer)

        def before_lens(z: Number) -> Number:
            return stretched(z - front[0]) + front[0 if lens_stays else 1]

        def behind(length: Number, plates: tuple[str, ...]) -> Number:
            more = sum(
                (glasses[plate].grown(before, after) - housing) * numbers[f"{plate}.thickness"]
                for plate in plates
                if plate in glasses
            )
            return housing * length + more

        glasses = {place.removesuffix(".index"): glass for place, glass in self.glasses}
        sensor = growth(self.sensor, before, after)
        result: dict[str, Number] = {}
        for place, value in numbers.items():
            part, name = place.rsplit(".", 1) if "." in place else (place, "")
            kind = part.split(".", 1)[0]
            if place == PATHS["d_1"]:
                result[place] = (
                    behind(value - rear[0], self.chain.plates_before) + rear[1] - (rear[2] if lens_stays else 0.0)
                )
            elif place == HIATUS and not lens_stays:
                result[place] = value + (front[0] - front[1]) - rear[2]
            elif place == PATHS["d_2"]:
                result[place] = behind(value, self.chain.plates_behind)
            elif place == PATHS["d"] or place.startswith(PATHS["f_ml"]) or part == "microlens_array.size":
                if self.array is not None:
                    grows = self.array.grown(before, after)
                    power = place.startswith(PATHS["f_ml"])
                    weaker = power_ratio(self.array, wavelength, before, after) if power else 1.0
                    result[place] = value * grows * weaker
            elif place == PATHS["q"] or part == "sensor.size":
                result[place] = value * sensor
            elif place == PATHS["f"]:
                result |= self.lens.moved(numbers, before, after, wavelength, self.housing)
            elif name == "distance" and kind in ("aperture", "stops", "elements"):
                result[place] = before_lens(value)
            elif name == "thickness":
                result[place] = value * glasses[part].grown(before, after) if part in glasses else value
            elif name == "index" and part in glasses:
                glass_in = glasses[part]
                result[place] = value + (glass_in.index(wavelength, after) - glass_in.index(wavelength, before))
            elif place == PATHS["D"]:
                result[place] = value * self.lens.wider(before, after, self.housing, housing)
            elif name == "diameter" or part.endswith(("decentre", "sides")) or kind in ("tube", "tip"):
                result[place] = value * np.where(self._in_tube(numbers, part), wall, housing)
        for standing in self.chain.standing(numbers):
            moved = standing.element.moved(standing.at, before, after)
            result |= {f"{standing.at.place}.{key}": value for key, value in moved.items()}
        return {place: value[()] if isinstance(value, np.ndarray) else value for place, value in result.items()}

    def _tubed(self, numbers: Mapping[str, Number]) -> Number:
        """Distance before the main lens from which on a tube of a material of its own holds the parts [mm]."""
        return np.inf if self.tube is None else np.maximum(self._tip(numbers) - numbers["tube.length"], 0.0)

    def _in_tube(self, numbers: Mapping[str, Number], part: str) -> NDArray[np.bool_]:
        """Whether widths of a part are the tube's, or grow with it."""
        owner = part.removesuffix(".decentre").removesuffix(".sides")
        inside = np.greater(numbers.get(f"{owner}.distance", -np.inf), self._tubed(numbers))
        return np.asarray(inside | (part == "tube" or owner in self.chain.bores))

    def _tip(self, numbers: Mapping[str, Number]) -> Number:
        stops = [value for place, value in numbers.items() if STOP_PLACE.fullmatch(place)]
        return np.asarray(reduce(np.maximum, stops, self.chain.end(numbers)))

    def _spans(
        self, numbers: Mapping[str, Number], before: Number, after: Number, housing: Number, wall: Number
    ) -> Iterator[tuple[Number, Number, Number]]:
        """Tube and elements: where each begins, its length, and how much more it grows than what holds it."""
        tubed = self._tubed(numbers)
        if self.tube is not None:
            yield tubed, self._tip(numbers) - tubed, wall - housing
        for part in self.chain.standing(numbers):
            length, times = part.element.lengthened(part.at, before, after)
            yield part.start, length, times - np.where(np.greater(part.start, tubed), wall, housing)
