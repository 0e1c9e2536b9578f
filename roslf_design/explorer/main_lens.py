"""The main lens in the explorer, ideal or real: what is traced of builds, what a search holds, what is evaluated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

from ..bore.main_lens import IdealMainLens, RealMainLens, SheetMainLens
from ..camera import Camera
from ..design import Design
from ..evaluation import Evaluation, default_fields
from ..theory.depth_budget import depth_budget

TRIALS = 16384
"""Builds of a tolerance run where nobody says otherwise."""
FILLED = (0.98, 1.0)
"""Fill factor that counts as matched."""
UNCUT = 0.999
"""Part of a traced image that counts as all of it."""


class _IdealLens:
    """An ideal main lens, of which all is told at once."""

    trials: ClassVar[int] = TRIALS
    """Builds of a tolerance run that the form offers."""
    twin: ClassVar[str] = ""
    """Ending of names of files with pictures of its thin-lens model."""
    searches: ClassVar[str] = "eight searches and a check"
    """Work of a search for a better design."""
    own: ClassVar[tuple[str, ...]] = ()
    """Symbols of numbers that are the lens's own, which no search varies."""

    def matched(self, design: Design) -> dict[str, Any]:
        """Limit of a search, as a study file has it, that has microlens images fill their cells without overlap."""
        return {"quantity": "fill_factor", "min": FILLED[0], "max": FILLED[1]}

    def undistorted(self, design: Design) -> dict[str, Any]:
        """Limit of a search, as a study file has it, that has images on the sensor whole."""
        return {"quantity": "non_distortion_room_mm", "min": "0 mm"}

    def evaluation(
        self, design: Design, thin: Callable[[Design], Evaluation], traced: Evaluation | Exception | None
    ) -> Evaluation:
        """Evaluation to show: the traced one, once it is known, of a lens that is traced."""
        return thin(design)


class _RealLens(_IdealLens):
    """A real main lens, through which designs and builds are traced."""

    trials = 1024
    twin = "-thin-lens"

    searches = (
        "eight searches and a check, in which rays tell of each design tried what belongs to a field (the first on a "
        "machine compiles for a minute)"
    )
    own = ("D", "f")

    def matched(self, design: Design) -> dict[str, Any]:
        """In the middle: towards the edge a real lens has images grow."""
        return super().matched(design) | {"field": "0 mm"}

    def undistorted(self, design: Design) -> dict[str, Any]:
        """At the corner, but for what rays do not settle."""
        corner = [f"{length!r} mm" for length in default_fields(design)[-1]]
        return {"quantity": "kept_fraction", "field": corner, "min": UNCUT}

    def evaluation(
        self, design: Design, thin: Callable[[Design], Evaluation], traced: Evaluation | Exception | None
    ) -> Evaluation:
        """The traced one, or the thin-lens model's until it is known; depth warms by the lens's own glass in both."""
        if isinstance(traced, Exception):
            raise traced
        return traced or replace(thin(design.thin_twin), depth_budget=depth_budget(Camera.of(design)))


class _SheetLens(_IdealLens):
    """A main lens by its data sheet."""

    own = ("f",)


_LENSES = {IdealMainLens: _IdealLens(), SheetMainLens: _SheetLens(), RealMainLens: _RealLens()}


def explored_lens(design: Design) -> _IdealLens:
    """The main lens of a design as the explorer has it."""
    return _LENSES[type(design.main_lens.kind)]
