"""What an effect is: a name, a unit, a closed-form size for a design and a scene, and what it costs to render."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from ..design import Design
from .brief import SceneBrief

Unit = Literal["px", "pitch", "intensity"]
"""Displacement on the sensor [pixels], displacement on the microlens array [pitches], fraction of full scale (rms)."""


class Estimate(NamedTuple):
    """How large an effect is, and a few words on it."""

    value: float
    """In the effect's unit; its magnitude is what the budget is compared with."""
    note: str
    """Where the number comes from, for the plan's reason."""


@dataclass(frozen=True)
class Effect:
    """One physical effect. Its file holds the estimate and, beside it, what the effect does to the image."""

    name: str
    """Stable name, as in `--effects +name`."""
    title: str
    """The field's term, for tables and charts."""
    unit: Unit
    estimate: Callable[[Design, SceneBrief], Estimate]
    """Closed form; microseconds."""
    cost_per_pixel: float = 0.0
    """Extra time to render it [s per pixel], measured on two cores; prints the plan's cost."""
    always: bool = False
    """True where the image means nothing without it."""
    required_by: tuple[str, ...] = ()
    """Effects that spread light in a way that makes this one matter whatever its own size."""
    available: Callable[[Design], bool] = lambda design: True
    """False where the design's model holds no such physics."""
