"""A number of a camera: its name, unit, words, function, and where it is told."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from ..camera import Camera, Number
from ..tables import BriefValue
from ..units import format_quantity, parse_in, read_quantity
from ..words import number
from .light import SensorField
from .stop_images import MicrolensImages

FEASIBLE = 1e-9
"""Largest violation of a scaled limit that counts as none, in searches and of what a design requires: 1e-9 of it."""
Depth = float | None
"""Distance ahead of the bore's tip at which a number is asked for [mm]; None is the focal plane."""


Way = Literal["width", "height", "diagonal"]
"""Way across the field."""


class Rays(Protocol):
    """Rays of a single design through its own main lens, as quantities ask them."""

    def angle(self, way: Way, at: Depth, *, from_tip: bool) -> float:
        """Angle of view [deg] over a way across the field, from the entrance pupil or, on a plane, from the tip."""

    def half_field(self, way: Way, at: Depth) -> float:
        """Half a way across the field [mm] on a plane."""

    def round_field(self, at: Depth, *, angle: bool) -> float:
        """Full angle [deg] of the widest round field, or the radius of the largest on a plane [mm]."""

    def undistorted(self) -> float:
        """Largest undistorted object radius at the focal plane [mm]."""

    def detail(self, level: float, at: Depth) -> float:
        """Detail [lp/mm] of a plane that the refocused image shows with so much of its contrast; NaN of none."""

    def usable(self, at: Depth) -> float:
        """Detail [lp/mm] that keeps half its contrast, no finer than the Nyquist frequency."""


@dataclass(frozen=True)
class Listed:
    """Line that a quantity has in a result."""

    under: str
    """Group of `roslf evaluate`, as "sampling"; subject of the data sheet, as "Distances"."""
    label: str | None = ""
    """Text before the number; empty: the quantity's own label; None: no line, it stands in the JSON alone."""
    remark: str | Callable[[Any], str] = ""
    """Text behind it, or a function of the group's numbers (evaluate) or of the camera (data sheet) that makes it."""
    key: str = ""
    """In the group's JSON; the quantity's name where empty."""
    value: Callable[[Array], Any] = float
    """Value in the JSON."""
    text: Callable[[Any], str] | None = None
    """Number with its unit, where that is not in the quantity's own."""

    def remark_on(self, numbers: Any) -> str:
        """Remark on a group's numbers, or on a camera."""
        return self.remark if isinstance(self.remark, str) else self.remark(numbers)


@dataclass(frozen=True)
class Quantity(BriefValue):
    """A number of a camera."""

    name: str
    unit: str
    words: str
    """Meaning, in a line."""
    of: Callable[[Camera, Depth], Array] | None = None
    """Function of straight cameras (tilts left out), at a distance where `at` allows one: shape of the builds, or (K,
    ...) where `worst` is set. None: it exists only per field."""
    local: Callable[[MicrolensImages], Number] | None = None
    """Function at the fields of misaligned builds, shape (fields, builds); None: the camera has it only as a whole."""
    of_rays: Callable[[Rays, Depth], float] | None = None
    """Function of the rays of a single design; None where rays tell nothing of it."""
    equation: str = ""
    """Equation in the paper."""
    label: str = ""
    """Name in plain words, on pages and in pictures, where it is no symbol; the unit goes beside."""
    digits: int = 5
    """Significant ones in tables."""
    evaluated: Listed | None = None
    """Where `roslf evaluate` has it."""
    sheet: Listed | None = None
    """Where the data sheet has it: a line that is asked for at a distance, one for each plane of the working range."""
    positive: bool = True
    """Whether every camera that can be built has it above zero: then ratios count, not differences."""
    least: float = -math.inf
    """Value that none which is not `positive` falls below by nature."""
    most: float = math.inf
    """Value that none exceeds by nature."""
    at: Literal["never", "optional", "needed"] = "never"
    """Whether it is asked for at a distance."""
    worst: Callable[[Array], Array] | None = None
    """The one that counts of several values, as one a rim."""
    monotone: bool = True
    """Whether `of` rises or falls in each single design length throughout, also beyond d_3 = d_f, the others held, f
    excepted where `bent_in_f`: its extremes over a box then lie at corners."""
    monotone_with: str = ""
    """A place of a design: where something stands there the quantity is monotone all the same."""
    of_views: bool = False
    """Whether it takes each pixel behind a microlens for a view: of a focused array it means nothing."""
    numeric: bool = False
    """Whether it is summed or tabulated, and so has no derivative by complex numbers."""
    bent_in_f: bool = False
    traced: bool = False
    """Whether chief rays are traced for it where something stands before the main lens: it then neither has derivatives
    by complex numbers nor its extremes at corners."""
    signed: Callable[[Camera, Depth], Array] | None = None
    """Signed value behind one that is a magnitude."""
    infinite: bool = False
    """Whether it is infinite for cameras that can be built: builds are then told apart by its `finite` twin."""
    past_infinity: Callable[[Camera, Depth], Array] | None = None
    """Function for -1 over a quantity that may be infinite and is above 0, going on above 0 where it has gone past
    infinity. Smooth, so that an optimiser finds its way into and out of infinity."""
    over: Callable[[Camera, Depth, SensorField], Array] | None = None
    """Function of a given rectangle of the array, for a quantity that depends on how much of it the sensor sees.
    `monotone` is then about this function, and the rectangle's ends are further lengths in which it rises or falls."""
    lit: bool = False
    """Whether it ends where light does: `over`, of all of the rectangle, is then the most that it can be."""

    def __post_init__(self) -> None:
        # `times` has no share of these.
        assert self.of_rays is None or (self.signed is None and self.past_infinity is None), self.name

    def __str__(self) -> str:
        return f"{self.name}{f' [{self.unit}]' * bool(self.unit)}: {self.words}"

    def __call__(self, camera: Camera, at: Depth = None) -> Array:
        """Its value for every build; of several values the one that counts; NaN behind the tip, where nothing can be.

        Raises
        ------
        ValueError
            It exists only per field.
        """
        if self.of is None:
            raise ValueError(f"{self.name} belongs to a field; take it from MicrolensImages")
        behind = None if at is None or self.at == "never" else np.asarray(np.less(at, 0))
        if behind is not None and behind.all():
            return np.full(np.broadcast_shapes(camera.shape, behind.shape), np.nan)
        values = self.of(camera, at)
        values = values if self.worst is None else self.worst(values)
        return values if behind is None or not behind.any() else np.where(behind, np.nan, values)

    def times(self, share: float | Array) -> Quantity:
        """The quantity, so many times as large; as many as there are builds, or one number."""
        of, over = self.of, self.over
        return replace(
            self,
            of=of and (lambda camera, at: share * of(camera, at)),
            over=over and (lambda camera, at, field: share * over(camera, at, field)),
        )

    def at_fields(self, images: MicrolensImages) -> Number:
        """Its values at the fields of builds, shape (fields, builds).

        Raises
        ------
        ValueError
            It belongs to the whole camera.
        """
        if self.local is None:
            raise ValueError(f"{self.name} belongs to a whole camera")
        return self.local(images)

    def text(self, value: Any) -> str:
        """A value with its unit, as tables of `roslf evaluate` have it."""
        if self.evaluated is not None and self.evaluated.text is not None:
            return self.evaluated.text(value)
        return f"{number(value, self.digits)} {self.unit}".rstrip()

    @property
    def analytic(self) -> bool:
        """Whether complex numbers in a camera give its derivatives: no absolute value, no worst of several."""
        closed = self.signed is None and self.worst is None and not self.numeric
        return self.of is not None and closed and self.at != "needed"

    @property
    def length(self) -> bool:
        """Whether limits are lengths."""
        return self.unit == "mm"

    def limit(self, value: Any, *, from_file: bool = True) -> float:
        """A limit on it as a study writes it: text with its unit, or a number in the unit that its name tells.

        Raises
        ------
        ValueError
            Neither; a number where nothing tells the unit.
        """
        if self.length:
            in_name = self.name.endswith("_mm")
            return read_quantity(value, "length", unit_required=from_file and not in_name)
        if isinstance(value, str):
            return parse_in(value, self.unit)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            unit = f" (in {self.unit})" if self.unit else ""
            raise ValueError(f"{self.name} is limited by a number{unit}, got {value!r}")
        return float(value)

    def fault_of_distance(self, at: Depth) -> str:
        """Fault of asking for it at a distance, or at none; empty where there is none."""
        if self.at == "needed" and at is None:
            return f'{self.name} needs a distance ahead of the tip; write e.g. at = "40 mm"'
        if self.at == "never" and at is not None:
            return f"{self.name} is not asked for at a distance; drop at"
        return ""

    def fault_of_limits(self, low: float | None, high: float | None) -> str:
        """Fault of limits that contradict each other, or that by nature no camera holds or every one; else empty."""
        least, above = (0.0, "above") if self.positive else (self.least, "at least")

        def words(value: float) -> str:
            return format_quantity(value, "length", 6) if self.length else f"{value:.6g} {self.unit}".rstrip()

        floor, ceiling = (
            f"{self.name} is {above} {words(least) if least else 0}",
            f"{self.name} is at most {words(self.most)}",
        )
        if low is not None and high is not None and low > high:
            return f"min {words(low)} is above max {words(high)}: nothing lies between; did you swap them?"
        if high is not None and (high < least or (self.positive and high <= 0)):
            return f"max {words(high)} is none that a camera holds, {floor}; raise it"
        if low is not None and low > self.most:
            return f"min {words(low)} is none that a camera holds, {ceiling}; lower it"
        if low is not None and low < least:
            return f"min {words(low)} limits nothing, {floor}; raise it or leave it out"
        if high is not None and self.most < high < math.inf:
            return f"max {words(high)} limits nothing, {ceiling}; lower it or leave it out"
        return ""

    def within(self, low: float | None, high: float | None, values: Array | float) -> NDArray[np.bool_]:
        """Where values are between limits, but for what an optimiser's rounding leaves; nowhere where they are NaN."""
        least = -np.inf if low is None else low - self.slack(low)
        most = np.inf if high is None else high + self.slack(high)
        return np.asarray((np.asarray(values) >= least) & (np.asarray(values) <= most))

    def slack(self, limit: float) -> float:
        """Violation of a limit that is rounding: `FEASIBLE` of it or, about 0, of one of the quantity's units."""
        return FEASIBLE * (abs(limit) if self.positive and limit else max(abs(limit), 1.0))


def finite(values: Array | float) -> Array:
    """Finite twin of what may be infinite: itself less 2 up to 1, -1 over it beyond; it rises where that rises."""
    values = np.asarray(values, float)
    return np.where(values < 1, values - 2, -1 / np.where(values < 1, 1.0, values))


def from_finite(twins: Array | float) -> Array:
    """Values that have these finite twins."""
    twins = np.asarray(twins, float)
    with np.errstate(divide="ignore"):
        beyond = np.where(twins < 0, -1 / np.where(twins < 0, twins, -1.0), np.inf)
    return np.where(np.isnan(twins), np.nan, np.where(twins < -1, twins + 2, beyond))
