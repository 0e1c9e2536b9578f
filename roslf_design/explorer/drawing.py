"""Which pictures the page has, in which of its views, and how each is made of what is seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from ..design import Design
from ..evaluation import Evaluation, evaluate
from .link import WHOLE, Look
from .optimise_run import OptimiseResult
from .pictures.axes import Picture
from .pictures.depth import depth_precision
from .pictures.effects import effects
from .pictures.matching_plane import matching_plane
from .pictures.meridional import meridional
from .pictures.microlens import microlens_image, nearest_microlens
from .pictures.mla_map import mla_map
from .pictures.optimise import change_bars, front, search_history
from .pictures.theme import ThemeName
from .pictures.tolerance import offender_bars, spread_bars, yield_bars, yield_curve
from .places import place_on_mla
from .tolerance_run import ToleranceResult

Size = tuple[int, int]


@dataclass(frozen=True)
class Seen:
    """A design, and what of it is looked at."""

    design: Design
    """With an ideal lens: the pictures are of the thin twin."""
    look: Look
    limits: tuple[float, float] | None = None
    """Where the axes of the plane of d_3 and D_F end [mm], kept still while its point is dragged."""
    tolerance: ToleranceResult | None = None
    optimum: OptimiseResult | None = None
    """What the last runs found."""

    @cached_property
    def evaluation(self) -> Evaluation:
        """All that closed forms say of the design."""
        return evaluate(self.design)

    @cached_property
    def place(self) -> tuple[float, float]:
        """Of the microlens that is shown [mm]."""
        place = place_on_mla(self.design, self.look.place)
        return nearest_microlens(self.design, place, inward=isinstance(self.look.place, str))


class Drawing(NamedTuple):
    """One picture of the page."""

    tab: str
    """The view that shows it."""
    label: str
    """Its heading."""
    size: Size
    """[px], until the browser tells how much room there is."""
    inputs: Callable[[Seen], Any]
    """What it is a function of, besides theme and size: equal inputs, equal picture; None where there is none."""
    make: Callable[[Any, ThemeName, Size], Picture]
    """The inputs, theme and size to a picture."""


def _section(inputs: tuple[Design, bool | None], theme: ThemeName, size: Size) -> Picture:
    design, whole = inputs
    return meridional(design, theme, size, whole=whole)


def _image(inputs: tuple[Design, tuple[float, float], bool, bool], theme: ThemeName, size: Size) -> Picture:
    design, place, diffraction, pixels = inputs
    return microlens_image(design, place, theme, size, diffraction=diffraction, pixels=pixels)


def _map(inputs: tuple[Design, tuple[float, float]], theme: ThemeName, size: Size) -> Picture:
    return mla_map(*inputs, theme, size)


def _plane(inputs: tuple[Design, tuple[float, float] | None], theme: ThemeName, size: Size) -> Picture:
    design, limits = inputs
    return matching_plane(design, theme, size, limits=limits)


DRAWINGS: dict[str, Drawing] = {
    "meridional": Drawing(
        "camera",
        "Rays in the meridional section",
        (1040, 240),
        lambda seen: (seen.design, WHOLE[seen.look.whole]),
        _section,
    ),
    "microlens": Drawing(
        "camera",
        "Image of a microlens",
        (340, 330),
        lambda seen: (seen.design, seen.place, seen.look.diffraction, seen.look.pixels),
        _image,
    ),
    "mla-map": Drawing("camera", "Microlens array", (340, 330), lambda seen: (seen.design, seen.place), _map),
    "matching-plane": Drawing(
        "camera", "Pupil diameter and distance", (340, 330), lambda seen: (seen.design, seen.limits), _plane
    ),
    "depth": Drawing("depth", "Depth precision", (520, 360), lambda seen: seen.design, depth_precision),
    "effects": Drawing("depth", "Effects against their budgets", (520, 420), lambda s: s.evaluation.effects, effects),
    "yield": Drawing("tolerance", "Yield of each grade", (420, 200), lambda seen: seen.tolerance, yield_bars),
    "yield-curve": Drawing("tolerance", "Yield over tolerance", (420, 260), lambda seen: seen.tolerance, yield_curve),
    "offenders": Drawing(
        "tolerance",
        "Worst offenders",
        (560, 300),
        lambda seen: seen.tolerance and seen.tolerance.offenders,
        offender_bars,
    ),
    "spreads": Drawing(
        "tolerance",
        "Scatter of the limited numbers",
        (560, 300),
        lambda seen: seen.tolerance and seen.tolerance.spreads,
        spread_bars,
    ),
    "changes": Drawing("optimise", "What changed", (560, 240), lambda seen: seen.optimum, change_bars),
    "search": Drawing("optimise", "Where the searches ended", (420, 260), lambda seen: seen.optimum, search_history),
    "front": Drawing(
        "optimise",
        "Goal against goal",
        (420, 300),
        lambda seen: seen.optimum if seen.optimum is not None and seen.optimum.front else None,
        front,
    ),
}
"""By the name that addresses and the page use."""

LEAST, MOST = 160, 3000
"""Sizes that a picture is made in [px]."""


def fitting(size: Any, fallback: Size) -> Size:
    """A size that the browser tells, kept within reason."""
    try:
        width, height = (round(float(value)) for value in size)
    except (TypeError, ValueError, OverflowError):
        return fallback
    return min(max(width, LEAST), MOST), min(max(height, LEAST), MOST)
