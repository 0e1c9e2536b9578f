"""Which pictures a calibration has, drawn by `pictures.calibration`."""

from __future__ import annotations

from ..pictures.calibration import pictures_of
from ..pictures.picture import Picture
from .datasheet import UNITS
from .result import Outcome

PLOTS = pictures_of(UNITS)
"""Name of each picture's file: its title and what draws it."""


def drawn(result: Outcome) -> dict[str, Picture]:
    """Every picture that the calibration has."""
    return {name: plot(result) for name, (_, plot) in PLOTS.items()}
