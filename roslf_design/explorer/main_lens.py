"""The main lens in the explorer, ideal or real: how many builds are traced, what is searched, what is evaluated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

from ..bore.main_lens import IdealMainLens, RealMainLens, SheetMainLens
from ..camera import Camera
from ..design import Design
from ..errors import InputError, Problem
from ..evaluation import Evaluation
from ..theory.depth_budget import depth_budget

TRIALS = 16384
"""Builds of a tolerance run where nobody says otherwise."""


class _IdealLens:
    """An ideal main lens, of which all is told at once."""

    trials: ClassVar[int] = TRIALS
    """Builds of a tolerance run that the form offers."""
    twin: ClassVar[str] = ""
    """Ending of names of files with pictures of its thin-lens model."""
    unsearched: ClassVar[str] = ""
    """Why it is not searched here, and what searches it; empty where it is."""

    def searched(self, design: Design) -> Design:
        """The design that an optimisation starts from.

        Raises
        ------
        InputError
            Its main lens is not varied.
        """
        if self.unsearched:
            raise InputError((Problem(design.main_lens.kind.name, self.unsearched),))
        return design

    def evaluation(
        self, design: Design, thin: Callable[[Design], Evaluation], traced: Evaluation | Exception | None
    ) -> Evaluation:
        """Evaluation to show: the traced one, once it is known, of a lens that is traced."""
        return thin(design)


class _RealLens(_IdealLens):
    """A real main lens, through which designs and builds are traced."""

    trials = 1024
    twin = "-thin-lens"

    unsearched = (
        "a real lens is traced for every design that a search tries, which takes minutes and is not done here: save "
        "the design, name it in a study file, and run roslf optimize study.toml"
    )

    def evaluation(
        self, design: Design, thin: Callable[[Design], Evaluation], traced: Evaluation | Exception | None
    ) -> Evaluation:
        """The traced one, or the thin-lens model's until it is known; depth warms by the lens's own glass in both."""
        if isinstance(traced, Exception):
            raise traced
        return traced or replace(thin(design.thin_twin), depth_budget=depth_budget(Camera.of(design)))


_LENSES = {IdealMainLens: _IdealLens(), SheetMainLens: _IdealLens(), RealMainLens: _RealLens()}


def explored_lens(design: Design) -> _IdealLens:
    """The main lens of a design as the explorer has it."""
    return _LENSES[type(design.main_lens.kind)]
