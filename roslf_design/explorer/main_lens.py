"""The main lens in the explorer, ideal or real: how many builds are traced, what is searched, whose verdicts stand."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from ..bore.main_lens import IdealMainLens, RealMainLens, SheetMainLens
from ..design import Design
from ..errors import InputError, Problem

Lights = list[dict[str, str]]

TRIALS = 16384
"""Builds of a tolerance run where nobody says otherwise."""


class _IdealLens:
    """An ideal main lens, of which all is told at once."""

    trials: ClassVar[int] = TRIALS
    """Builds of a tolerance run that the form offers."""
    named_apart: ClassVar[bool] = False
    """Whether the page says which pictures are of a thin lens."""
    twin: ClassVar[str] = ""
    """Ending of names of files with pictures of its thin-lens model."""

    def searched(self, design: Design) -> Design:
        """The design that an optimisation starts from.

        Raises
        ------
        InputError
            Its main lens is not varied.
        """
        return design

    def lights(self, thin: Lights, waiting: Lights, traced: Callable[[], Lights | None]) -> Lights:
        """Verdicts to show, the thin-lens model's and traced ones; as long as these are not known, those that wait."""
        return thin


class _RealLens(_IdealLens):
    """A real main lens, of which verdicts and builds are traced."""

    trials = 1024
    named_apart = True
    twin = "-thin-lens"

    def searched(self, design: Design) -> Design:
        """None: its thin-lens model is searched."""
        name = design.main_lens.kind.name
        message = f"{name} is a real lens, and the search varies ideal ones; optimise its thin-lens model"
        raise InputError((Problem("main lens", message),))

    def lights(self, thin: Lights, waiting: Lights, traced: Callable[[], Lights | None]) -> Lights:
        """Traced ones, or the thin-lens model's until they are known."""
        known = traced()
        return [*thin, *waiting] if known is None else known


_LENSES = {IdealMainLens: _IdealLens(), SheetMainLens: _IdealLens(), RealMainLens: _RealLens()}


def explored_lens(design: Design) -> _IdealLens:
    """The main lens of a design as the explorer has it."""
    return _LENSES[type(design.main_lens.kind)]
